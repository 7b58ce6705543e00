"""Scattering of light by one large homogeneous sphere: geometrical optics, corrected where it fails.

Rays with phases, diffraction, uniform formulas at rainbows and on the axis, and a short sum of exact partial waves at the
edge.  Conventions of `bakery.mie`.  Measured errors, and where it pays: docs/goa.md.  Below x = 30 take `bakery.mie`.
"""

import numpy as np

from bakery.physics.goa import _inputs
from bakery.physics.goa.cross import absorption, extinction_of_rays
from bakery.physics.mie import by_index, in_threads, parts_of_work

BLOCK = 1024  # angles of one job of `amplitudes`
ANGLES_AT_ONCE = 4096  # bounds the memory of their rays
TOGETHER = 16  # spheres whose coefficients are computed side by side

__all__ = ["absorption", "amplitudes", "extinction", "intensity_block", "mueller_block"]


def amplitudes(m, x, theta, orders=3, *, rainbow=True, axis=True, edge="narrow"):
    """Scattering amplitudes of large spheres.

    Parameters
    ----------
    m : complex, n + ik with k >= 0, relative to the host; `inf` is a perfect conductor
    x : size parameter, 1 to 1e8, meant for x >= 30; m and x broadcast
    theta : any shape; rad, 0 (forward) to pi
    orders : int, 0 to 50; highest number p of chords inside the sphere
    rainbow : uniform (Airy) formula for the ray pair at a rainbow, with its dark side; else floored rays
    axis : uniform (Bessel) formula for ray pairs near 0 and pi; else floored rays
    edge : "narrow", "wide" or None; window of partial waves around n = x (and n x, for bubbles) that is summed exactly.
        None: tapered Fraunhofer diffraction, which is also what is left above x = 2e6

    Returns
    -------
    S1, S2 : complex, shape broadcast(m, x).shape + theta.shape

    Raises
    ------
    ValueError : x or theta out of range, gain (k < 0), an index that is no passive material's, unknown options

    Notes
    -----
    rms over angle of log10 of the intensity of single water spheres against Lorenz-Mie, six orders, narrow: 0.072 at x = 105,
    0.037 at 1047; hardly any cost grows with x.  At m = 1 both are 0.
    Sources: van de Hulst 1957, ch. 12; Chester, Friedman & Ursell 1957 (rainbow); docs/goa.md (axis, edge).

    Examples
    --------
    >>> S1, S2 = amplitudes(1.33, 1000.0, np.array([0.0, 1.0]))
    >>> bool(abs(abs(S1[0]) / 5.042e5 - 1) < 0.01), bool(abs(S1[0] - S2[0]) < 1)
    (True, True)
    """
    shape, m, x = _inputs.large(m, x)
    theta = np.asarray(theta, dtype=np.float64)
    angles = np.ascontiguousarray(theta.reshape(-1))
    bad = ~((angles >= 0.0) & (angles <= np.pi))
    if bad.any():
        raise ValueError(f"theta = {angles[bad][0]:g}: scattering angles are in radians, 0 (forward) to pi (backward)")
    orders, edge = _inputs.options(orders, edge)
    s1, s2 = np.zeros((2, x.size, angles.size), dtype=np.complex128)
    order = np.argsort(angles, kind="stable")  # rays are traced for ascending angles
    jobs = []
    for index, places in by_index(m, x):
        if index == 1.0 or not angles.size:
            continue
        cuts = np.split(order, range(BLOCK, order.size, BLOCK))
        parts = parts_of_work(places.size * angles.size * 1.2e-7)
        pieces = np.array_split(places, parts) if len(cuts) < 4 * parts and places.size >= 4 * parts else [places]
        jobs += [(index, piece, cut) for piece in pieces for cut in cuts]

    def run(job):
        index, places, cut = job
        for group, field in _fields(index, x[places], angles[cut], orders, rainbow, axis, edge):
            s1[places[group, None], cut], s2[places[group, None], cut] = field[..., 0].conj(), field[..., 1].conj()

    in_threads(run, jobs)
    return s1.reshape(shape + theta.shape)[()], s2.reshape(shape + theta.shape)[()]


def intensity_block(m, x, weight, theta, out, orders=3, *, rainbow=True, axis=True, edge="narrow"):
    """out (A,) = sum over the spheres x (R,) of weight (|S1|^2 + |S2|^2)/2 at theta (A,) rad, summed in the order of x.

    As `bakery.mie.angular.intensity_block`: arguments are not checked, one thread, releases the lock.  Options as
    `amplitudes`.  The rays are traced once for all sizes.
    """
    out[:] = _sums(m, x, weight, theta, orders, rainbow, axis, edge)[0]


def mueller_block(m, x, weight, theta, out, orders=3, *, rainbow=True, axis=True, edge="narrow"):
    """out (4, A) = weighted sums of S11, S12, S33, S34 over the spheres x (R,), as `bakery.mie.angular.mueller_block`."""
    out[:] = _sums(m, x, weight, theta, orders, rainbow, axis, edge)


def extinction(m, x, *, edge=None, orders=3):
    """Extinction efficiency of large spheres.

    Parameters
    ----------
    m, x : as `amplitudes`
    edge : None: diffraction, the axial ray and the first edge term in closed form; "narrow" or "wide": 4 Re S(0)/x^2
    orders : as `amplitudes`, for S(0)

    Returns
    -------
    q_ext : of the broadcast shape; 1

    Raises
    ------
    ValueError : as `amplitudes`

    Notes
    -----
    See `cross.extinction_of_rays`; where x |m - 1| < 1 the closed form is anomalous diffraction.  rms relative error for water
    within 10 % of x = 100 and 1000: closed 7e-3 and 8e-4, narrow 3e-3 and 2e-3, wide (six orders) 4e-4 and 2e-4.
    """
    if edge is None:
        return extinction_of_rays(m, x)
    s1 = amplitudes(m, x, 0.0, orders, edge=edge)[0]
    return 4.0 * np.real(s1) / np.asarray(x, dtype=np.float64) ** 2


def _fields(m, x, theta, orders, rainbow, axis, edge):
    """(places in x, S1 and S2 for exp(+i w t) of shape (places, A, 2)) for some spheres at a time, in their order."""
    from bakery.physics.goa import _edge, _field, _rays

    items, rays = _rays.trace(m, theta, orders, bool(rainbow), bool(axis), float(np.min(x)))
    scales = _edge.scales_of(m, x, edge)
    field = np.empty((min(x.size, TOGETHER), theta.size, 2), dtype=np.complex128)
    for start in range(0, x.size, TOGETHER):
        group = np.arange(start, min(start + TOGETHER, x.size))
        block = field[:group.size]
        _field.ray_block(x[group], theta, items, rays, scales[group], block)
        _edge.wave_block(m, x[group], theta, scales[group], block)
        yield group, block


def _sums(m, x, weight, theta, orders, rainbow, axis, edge):
    """(4, A) weighted Mueller elements."""
    from bakery.physics.goa import _field

    orders, edge = _inputs.options(orders, edge)
    m = complex(m)
    x, weight, theta = (np.ascontiguousarray(v, dtype=np.float64) for v in (x, weight, theta))
    sums = np.zeros((4, theta.size))
    if m == 1.0 or not x.size:
        return sums
    if np.any(theta[1:] < theta[:-1]):
        order = np.argsort(theta, kind="stable")
        sums[:, order] = _sums(m, x, weight, theta[order], orders, rainbow, axis, edge)
        return sums
    for start in range(0, theta.size, ANGLES_AT_ONCE):
        part = slice(start, start + ANGLES_AT_ONCE)
        for group, field in _fields(m, x, theta[part], orders, rainbow, axis, edge):
            _field.gather(field, weight[group], sums[:, part])
    return sums
