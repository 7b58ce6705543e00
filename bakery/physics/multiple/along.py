"""Tables of segments as integrals along the beam of a table of points made of photons.

No photons of its own: what the table of points misses, the integral has too, and noise of the few arrivals close to the source is
shared by all places along the beam.
"""

import math
from dataclasses import replace

import numpy as np

from bakery.physics.multiple import budget, frame, locate, lookup, uniform
from bakery.physics.multiple._elementary import exp
from bakery.physics.multiple.build import places, upper
from bakery.physics.multiple.kinds import POINT, SEGMENT
from bakery.physics.multiple.sums import directed, logarithm
from bakery.physics.multiple.table import Table
from bakery.system.compiled import njit


def build(points: Table, halves, fit: uniform.Fit, medium, length, inherited, deviations) -> tuple[Table, np.ndarray]:
    """The table of a segment.

    Parameters
    ----------
    points : of the medium, made of photons
    halves : two `lookup.Ready`, what either half of the photons makes of `points`
    fit : of the medium, too
    medium : `tally.Medium`
    length : mfp
    inherited : relative error of lobes of `points`, without noise
    deviations : (R, J, blocks) relative ones of the integrals over directions at the corners of `points`, of independent blocks

    Returns
    -------
    table : with errors
    offset_error : (N,) standard errors of its offsets
    """
    rho, z = uniform.places(SEGMENT, length, medium.extent)
    ready = lookup.ready(points)
    lobe = lobes(ready, length, rho, z, fit.polar, fit.azimuth).reshape(len(rho), -1)
    integral = (lobe * fit.solid_angle).sum(axis=1)
    a, basis = fit.represent(np.stack([lobe, lobe]), integral, np.ones(len(rho), bool), budget.SEGMENT)
    a = a[0]
    a[:, 0] = np.log(integral / locate.measure(SEGMENT, length, rho, z)[1])
    packed = fit.pack(SEGMENT, length, medium, a, basis)
    # its own error against the same integrals between the corners, and the noise of those
    rho_t, z_t = (x[::3] for x in places(SEGMENT, length, medium.extent, fit.random))
    exact, *apart = (lobes(source, length, rho_t, z_t, fit.test_polar, fit.test_azimuth) for source in (ready, *halves))
    table = lookup.lobes(lookup.ready(packed), rho_t, z_t, fit.test_polar, fit.test_azimuth)
    of_fit, noise = fit.share((table - exact) ** 2, exact), fit.share((apart[0] - apart[1]) ** 2, exact) / 4
    worst = math.hypot(float(np.sqrt((of_fit + noise).max())), inherited)
    packed = replace(packed, error=math.hypot(upper(of_fit), inherited), worst=worst,
                   error_with_solver=math.hypot(upper(of_fit + noise), inherited))
    errors = np.zeros(len(rho))
    _deviations(ready, length, np.ascontiguousarray(deviations), rho, z, errors)
    return packed, np.minimum(errors, 1.0)


def lobes(points, length, rho, z, polar, azimuth):
    """Lobes (N, A, B) of a segment in the frames of positions (N,): integrals of a `lookup.Ready` table of points."""
    sine = np.sin(polar)[:, None]
    directions = np.stack([np.broadcast_to(np.cos(polar)[:, None], (len(polar), len(azimuth))), sine * np.cos(azimuth),
                           sine * np.sin(azimuth)]).reshape(3, -1)
    out = np.zeros((len(rho), directions.shape[1]))
    _along(points, float(length), *(np.ascontiguousarray(x, float) for x in (rho, z, directions)), out)
    return out.reshape(len(rho), len(polar), len(azimuth))


@njit(cache=True, nogil=True, error_model="numpy")
def _along(points, length, rho, z, directions, out):
    """Adds lobes to out (N, D), of directions (3, D): along the axes of the frames, towards +z, across."""
    work = np.empty((2, directions.shape[1]))
    blended = np.empty(points.grid.shape[2])
    for n in range(len(rho)):
        # s - z = close sinh(t): smooth however close the beam is, but for lobes that turn as fast as the beam is passed
        close = max(rho[n], frame.CLOSEST)
        axis = locate.place(SEGMENT, length, close, z[n])[3:]
        t, last = math.asinh(-z[n] / close), math.asinh((length - z[n]) / close)
        while t < last:
            step = min(lookup.piece(points.turn, t), last - t)
            for k in range(lookup.GAUSS):
                at = t + lookup.X[k] * step
                away, r = close * math.sinh(at), close * math.cosh(at)
                factor = lookup.WEIGHT[k] * step * r * math.exp(-(z[n] + away))
                factor *= lookup.coefficients(points, close, -away, blended)
                # from the frame of the segment into that of the point of the beam, whose axis is (close, -away) / r
                turn = (axis[1] * close + axis[0] * away) / r, (axis[0] * close - axis[1] * away) / r
                _add_lobe(points, blended.astype(np.float32), factor, turn, directions, work, out[n])
            t = last if last - t <= step else t + step


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _add_lobe(points, a, factor, turn, directions, work, out):
    """Adds a factor times the lobe of coefficients (K',) in directions (3, D) of a frame that is turned by sine and cosine."""
    # three loops: the first and the last are done for several directions at once
    for d in range(len(out)):
        work[0, d], work[1, d] = directed(points, turn[0], turn[1], -directions[1, d], directions[2, d], directions[0, d])
    for d in range(len(out)):
        work[0, d] = logarithm(points, a, work[0, d], work[1, d])
    for d in range(len(out)):
        out[d] += factor * exp(work[0, d])


@njit(cache=True, nogil=True, error_model="numpy")
def _deviations(points, length, deviations, rho, z, out):
    """Relative standard errors of integrals over directions of a segment, from those of blocks (R, J, BLOCKS) at the corners."""
    R, J, blocks = deviations.shape
    total = np.empty(blocks)
    for n in range(len(rho)):
        close = max(rho[n], frame.CLOSEST)
        low, high = math.asinh(-z[n] / close), math.asinh((length - z[n]) / close)
        count = 4 * (int(high - low) + 1)
        whole = 0.0
        total[:] = 0.0
        for i in range(count):
            away = close * math.sinh(low + (high - low) * (i + 0.5) / count)
            r = math.hypot(rho[n], away)
            s = min(math.asinh(r / frame.CORE[POINT]) * points.stretch * (R - 1), R - 1.0)
            t = math.atan2(rho[n], -away) / math.pi * (J - 1)
            x, y = min(int(s), R - 2), min(int(t), J - 2)
            s, t = s - x, t - y
            beyond = max(r - points.extent, 0.0)
            # a_0 without the basis: what is left varies slowly
            a = ((1 - s) * ((1 - t) * points.grid[x + 1, y + 1, 0] + t * points.grid[x + 1, y + 2, 0])
                 + s * ((1 - t) * points.grid[x + 2, y + 1, 0] + t * points.grid[x + 2, y + 2, 0]))
            weight = math.exp(a - points.k0 * beyond - (z[n] + away))  # dt = ds / r, and the singular part 1 / r
            whole += weight
            for k in range(blocks):
                total[k] += weight * ((1 - s) * ((1 - t) * deviations[x, y, k] + t * deviations[x, y + 1, k])
                                      + s * ((1 - t) * deviations[x + 1, y, k] + t * deviations[x + 1, y + 1, k]))
        mean = total.mean()
        square = 0.0
        for k in range(blocks):
            square += (total[k] - mean) ** 2
        out[n] = math.sqrt(square / (blocks - 1) / blocks) / whole
