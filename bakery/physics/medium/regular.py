"""A phase function on a regular grid in the cosine, as stock renderers want it, with the loss.

A narrow forward peak does not fit on a regular grid.  Values are therefore averages over the cells, not samples: light that
the grid cannot place exactly is moved to a neighbouring angle, and neither its sum nor the mean cosine changes.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Loss:
    """What a regular table has lost against the phase function that it stands for."""

    misdirected: float  # 1, share of the scattered light that the table sends to another angle (half of the mean absolute error)
    largest: float  # 1, largest relative error of the value at any angle
    largest_at: float  # rad, the angle where that is
    g: float  # 1, mean cosine of the table less that of the source
    peak: float  # 1, share of the forward peak that was cut: of the light within `peak_angle`, what the table puts outside of it
    peak_angle: float  # rad, where the source has fallen to half of its forward value (pi where it never does)


def haversine(theta):
    """s = (1 - cos theta) / 2 without cancellation; solid angle is 4 pi ds."""
    return np.sin(0.5 * np.asarray(theta)) ** 2


def regular_table(theta, phase, count):
    """Averages of a phase function on a regular grid in the cosine.

    theta : (A,) rad, ascending from 0 (forward) to pi
    phase : (A,) 1/sr, linear in cos theta between the angles
    count : number of values, at least 2

    Returns values : (count,) 1/sr, at equidistant cosines from -1 (backward) to +1 (forward), linear between them

    The value at a grid point is the average of `phase` weighted with the hat function of that point.  The hats add up to 1
    everywhere, so the integral is kept exactly; their first moments make the mean cosine exact but for the two end cells
    (error: a third of a cell times the light in the last half cell).
    """
    s, value = haversine(theta), np.asarray(phase, float)
    cell = 1.0 / (count - 1)
    lower, right, at_left, at_right = _segments(s, value, np.arange(count) * cell)
    index = np.minimum((0.5 * (lower + right) / cell).astype(np.int64), count - 2)
    # integral of (linear) x (linear), exact by Simpson's rule; `rise` is the hat of the upper grid point
    rise_left, rise_right = lower / cell - index, right / cell - index
    middle, rise_middle = 0.5 * (at_left + at_right), 0.5 * (rise_left + rise_right)
    upper = (right - lower) / 6 * (at_left * rise_left + 4 * middle * rise_middle + at_right * rise_right)
    areas = (right - lower) * middle
    sums = np.bincount(index, areas - upper, count) + np.bincount(index + 1, upper, count)
    area = np.full(count, cell)
    area[[0, -1]] *= 0.5
    return (sums / area)[::-1]


def loss(theta, phase, values) -> Loss:
    """What is lost when a regular table takes the place of a phase function.

    theta, phase : (A,) rad, 1/sr, as for `regular_table`; integrates to 1 over the sphere
    values : (N,) as from `regular_table`, in the precision that will be used
    """
    s, value = haversine(theta), np.asarray(phase, float)
    table = np.asarray(values, float)[::-1]
    grid = np.arange(len(table)) / (len(table) - 1)
    lower, right, at_left, at_right = _segments(s, value, grid)
    table_left, table_right = np.interp(lower, grid, table), np.interp(right, grid, table)
    first, last = table_left - at_left, table_right - at_right
    width = right - lower
    # mean of |linear|: where the sign changes inside, two triangles
    crossing = first * last < 0
    total = np.abs(first) + np.abs(last)
    mean = np.where(crossing, (first**2 + last**2) / np.where(crossing, 2 * total, 1), 0.5 * total)
    # first moment of the difference about s, times 4 pi, gives the change of (1 - g) / 2
    moment = width / 6 * (lower * first + (lower + right) * (first + last) + right * last)
    relative = np.abs(np.interp(s, grid, table) - value) / np.where(value > 0, value, np.inf)
    worst = int(np.argmax(relative))
    below = np.flatnonzero(value < 0.5 * value[0])
    edge = float(s[below[0]]) if below.size else 1.0
    inside = right <= edge
    source = float(np.sum((width * 0.5 * (at_left + at_right))[inside]))
    peak_table = float(np.sum((width * 0.5 * (table_left + table_right))[inside]))
    return Loss(misdirected=float(2 * np.pi * np.sum(width * mean)), largest=float(relative[worst]),
                largest_at=float(theta[worst]), g=float(-8 * np.pi * np.sum(moment)), peak=max(0.0, 1 - peak_table / source),
                peak_angle=float(2 * np.arcsin(np.sqrt(edge))))


def adaptive_table(theta, phase, limit=1e-3, smallest=6, largest=20):
    """The shortest table of 2**k + 1 values (k from `smallest` to `largest`) that misdirects at most `limit` of the light.

    Powers of two make every grid point exact in single precision.  Where the longest table still loses more than the limit it
    is returned, and its loss says so.

    Returns
    -------
    values : (2**k + 1,) float32, 1/sr
    loss : Loss, of these values
    """
    for exponent in range(smallest, largest + 1):
        values = regular_table(theta, phase, 2**exponent + 1).astype(np.float32)
        resampling = loss(theta, phase, values)
        if resampling.misdirected <= limit:
            break
    return values, resampling


def _segments(s, value, grid):
    """Ends of the pieces on which both the source and the grid's hats are linear, and the source there."""
    ends = np.union1d(s, grid)
    ends = ends[(ends >= 0) & (ends <= 1)]
    at = np.interp(ends, s, value)
    return ends[:-1], ends[1:], at[:-1], at[1:]
