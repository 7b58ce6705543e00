"""Phase functions given by a formula, as tables: Henyey-Greenstein, isotropic, Rayleigh, Gaussian, or the user's own table.

All wavelengths share one grid, bisected until linear interpolation in cos theta meets the tolerance.
"""

import math

import numpy as np

from bakery.physics.medium import grid, phase

# where a function falls below any double its relative error means nothing; a gaussian falls that low
SMALLEST = 1e-200


def henyey_greenstein(theta, g):
    """Henyey & Greenstein 1941, 1/sr, at theta (A,) rad for -1 < g < 1; mean cosine exactly g.

    The denominator is (1 - g)^2 + 2 g v with v = 1 - cos theta, or its mirror for g < 0: no cancellation for |g| -> 1.
    """
    s = np.sin(theta / 2) ** 2 if g >= 0 else np.cos(theta / 2) ** 2
    a = abs(g)
    return (1 - a) * (1 + a) / (4 * math.pi * ((1 - a) ** 2 + 4 * a * s) ** 1.5)


def rayleigh(theta):
    """Scattering by spheres much smaller than the wavelength, unpolarised light, 1/sr: 3/(16 pi) (1 + cos^2)."""
    return 3 / (16 * math.pi) * (1 + np.cos(theta) ** 2)


def gaussian(theta, spread):
    """exp(-theta^2 / (2 spread^2)), not normalised; `spread` (rad) is the deviation of theta along one axis if small."""
    return np.exp(-0.5 * (theta / spread) ** 2)


def tabulated(kind, tolerance, wavelengths, g=None, spread=None, table=None):
    """Table of an analytic phase function.

    Parameters
    ----------
    kind : hg | isotropic | rayleigh | gaussian | table
    tolerance : largest relative error between the angles
    wavelengths : L, number of rows
    g : (L,) for hg, -1 < g < 1
    spread : rad, for gaussian
    table : (theta (B,) rad ascending from 0 to pi, value (B,) >= 0) for table: kept as it is, linear in cos theta by definition

    Returns
    -------
    theta : (A,) rad
    values : (L, A) 1/sr, normalised
    error : (L, A) 1/sr, absolute
    relative : float, the largest relative error

    Raises
    ------
    ValueError : |g| = 1, a table that does not span 0 to pi or is zero
    """
    if kind == "table":
        return _of_table(table, wavelengths)
    if kind == "hg":
        g = np.asarray(g, float)
        if not (np.abs(g) < 1).all():
            raise ValueError("the Henyey-Greenstein function needs -1 < g < 1")
        rows = [lambda t, g=float(value): henyey_greenstein(t, g) for value in np.unique(g)]
        source_row = np.searchsorted(np.unique(g), g)
        finest = float(1 - np.abs(g).max())
    else:
        rows = [{"isotropic": lambda t: np.full_like(t, 1 / (4 * math.pi)), "rayleigh": rayleigh,
                 "gaussian": lambda t: gaussian(t, spread)}[kind]]
        source_row = np.zeros(wavelengths, int)
        finest = min(spread, 1.0) if kind == "gaussian" else 1.0
    if kind == "isotropic":
        theta = np.array([0.0, math.pi])
        return theta, np.full((wavelengths, 2), 1 / (4 * math.pi)), np.zeros((wavelengths, 2)), 0.0

    def evaluate(theta, floor):
        values = np.array([[np.maximum(row(theta), SMALLEST)] for row in rows])
        return values, np.zeros((len(rows), len(theta))), np.zeros((len(rows), len(theta)), int)

    refined = grid.refine(grid.start([(1 / finest, 1.0)]), evaluate, tolerance)
    values, was = phase.normalised(refined.theta, refined.values[:, 0])
    cells = refined.between / was[:, None]
    error = np.maximum(np.concatenate([cells[:, :1], cells], axis=1), np.concatenate([cells, cells[:, -1:]], axis=1))
    shift = np.sum(cells * phase.steps(refined.theta), axis=-1) * 2 * math.pi
    error = error + shift[:, None] * values
    return refined.theta, values[source_row], error[source_row], float((refined.relative + shift).max())


def predicted_angles(kind, tolerance, g=None, spread=None, table=None) -> int:
    """Angles that `tabulated` will take: the integral of sqrt(|f''/(8 f tolerance)|) over cos theta, times 1.45 for the powers
    of two of bisection.  Within a factor 1.5 of what it took for |g| from 0.1 to 0.999 and spreads from 0.01 to 0.5.
    """
    if kind == "table":
        return len(table[0])
    if kind == "isotropic":
        return 2
    if kind == "hg":
        steepest = min(float(np.abs(g).max()), 1 - 1e-15)
        bend = math.sqrt(15) * math.log((1 + steepest) / (1 - steepest))
    elif kind == "gaussian":
        bend = min(math.pi**2 / (2 * spread**2), -math.log(SMALLEST))
    else:
        bend = 2.5
    return int(max(181, 130 + 1.45 * bend / math.sqrt(8 * tolerance)))


def _of_table(table, wavelengths):
    theta, value = (np.asarray(column, float) for column in table)
    if len(theta) < 2 or theta[0] > 1e-9 or abs(theta[-1] - math.pi) > 1e-6 or not (np.diff(theta) > 0).all():
        raise ValueError("a phase table needs ascending angles from 0 to 180 degrees")
    if not (np.isfinite(value).all() and (value >= 0).all() and value.max() > 0):
        raise ValueError("a phase table needs values >= 0 that are not all zero")
    theta = theta.copy()
    theta[0], theta[-1] = 0.0, math.pi
    values, _ = phase.normalised(theta, value / value.max())
    return theta, np.repeat(values[None], wavelengths, axis=0), np.zeros((wavelengths, len(theta))), 0.0
