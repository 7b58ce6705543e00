"""A phase function as a table over the scattering angle, linear in cos theta between its nodes.

Whatever is stated of such a table (integral, mean cosine, cumulative distribution, samples) is exact for that interpolant, not
for the function it was made from.  Everything is written in v = 1 - cos theta = 2 sin^2(theta/2), and differences of v as
products of sines: cosines of small angles have lost the digits that a forward peak needs.

Shapes: theta (A,) rad, ascending from 0 to pi; f (..., A) 1/sr.
"""

import math

import numpy as np


def steps(theta):
    """cos theta_i - cos theta_(i+1), (A-1,), to full relative precision however small the angles are."""
    theta = np.asarray(theta, float)
    return 2 * np.sin((theta[1:] + theta[:-1]) / 2) * np.sin((theta[1:] - theta[:-1]) / 2)


def areas(theta):
    """(A,) weights of the angles in an integral over cos theta."""
    cells = steps(theta)
    return (np.append(cells, 0.0) + np.insert(cells, 0, 0.0)) / 2


def phase_integral(theta, f):
    """2 pi times the integral of f over cos theta, (...,)."""
    f = np.asarray(f, float)
    return 2 * math.pi * np.sum((f[..., 1:] + f[..., :-1]) / 2 * steps(theta), axis=-1)


def normalised(theta, f):
    """f scaled so that its integral over the sphere is 1, and the integral that it had.

    Returns
    -------
    phase : (..., A) 1/sr
    was : (...,) the integral before
    """
    f = np.asarray(f, float)
    was = phase_integral(theta, f)
    phase = f / was[..., None]
    # once more: the division leaves an error of a few units in the last place
    return phase / phase_integral(theta, phase)[..., None], was


def with_delta(theta, f, share):
    """A phase function with unscattered (delta) transmission beside it, which stands in the table as a peak below theta[1].

    f : (..., A) 1/sr, of light that is deflected
    share : (...,) of the light that keeps its direction, 0 to 1
    """
    share = np.asarray(share, float)
    f = (1 - share[..., None]) * np.asarray(f, float)
    f[..., 0] += share / (2 * math.pi * areas(theta)[0])
    return f


def without_delta(theta, f, share):
    """The phase function of deflected light alone, (..., A) and normalised: `with_delta` undone.

    Rows without a delta stay as they are; where there is nothing else (share 1) the result is isotropic.
    """
    share, f = np.asarray(share, float), np.asarray(f, float)
    smooth = f.copy()
    smooth[..., 0] = np.maximum(smooth[..., 0] - share / (2 * math.pi * areas(theta)[0]), 0.0)
    smooth[share == 1] = 1.0
    return np.where((share > 0)[..., None], normalised(theta, smooth)[0], f)


def cumulative(theta, f):
    """Probability (..., A) that the angle is below theta: 0 at theta = 0, 1 at pi, exact for a normalised table."""
    f = np.asarray(f, float)
    cells = (f[..., 1:] + f[..., :-1]) / 2 * steps(theta)
    total = np.cumsum(cells, axis=-1)
    return np.concatenate([np.zeros_like(total[..., :1]), total / total[..., -1:]], axis=-1)


def mean_cosine(theta, f):
    """<cos theta> of a normalised table, (...,)."""
    f = np.asarray(f, float)
    v = 2 * np.sin(np.asarray(theta, float) / 2) ** 2
    # integral of f v over a cell where both are linear in v; 1 - g keeps its digits when g -> 1
    cells = steps(theta) * (f[..., :-1] * (2 * v[:-1] + v[1:]) + f[..., 1:] * (v[:-1] + 2 * v[1:])) / 6
    return 1 - 2 * math.pi * np.sum(cells, axis=-1)


def phase_at(theta, f, at):
    """The table at any angles.

    Parameters
    ----------
    theta : (A,) rad
    f : (..., A)
    at : angles of any shape, rad, 0 to pi

    Returns
    -------
    (..., *at.shape), unit of f

    Raises
    ------
    ValueError : an angle outside 0 .. pi, or not finite
    """
    theta, f, at = np.asarray(theta, float), np.asarray(f, float), np.asarray(at, float)
    outside = at[~((at >= 0) & (at <= math.pi))]
    if outside.size:
        raise ValueError(f"scattering angle {outside.flat[0]:g}; 0 (forward) to pi (backward) would do")
    i = np.clip(np.searchsorted(theta, at, side="right") - 1, 0, len(theta) - 2)
    a, b = theta[i], theta[i + 1]
    t = np.sin((at + a) / 2) * np.sin((at - a) / 2) / (np.sin((a + b) / 2) * np.sin((b - a) / 2))
    return f[..., i] * (1 - t) + f[..., i + 1] * t
