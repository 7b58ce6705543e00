"""Light of a beam by transport in a homogeneous half space: every order, every angle, tails included.

Light that has been scattered once has a closed integral (`single`).  The rest is computed for a point where light of power 1
enters a collision in an infinite medium, exactly: transport in Fourier space is tridiagonal in the Legendre order, so one row of
its inverse costs a few operations an order and wave number.  The beam is that point's light summed along the axis with what the
beam has left.  Two things are approximate: a mirror beam of negative power takes out what would have come back through z = 0, and
forward and backward light are separated by their first two moments.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import fft

from bakery.system.compiled import njit

WAVES = 64  # wave numbers a decade
_LOW, _HIGH = 1e-5, 1e5  # 1/mfp, for phase functions of up to `_BROAD` orders
_BROAD = 60
_LEVELS = 400  # above the last order, where the infinite chain of streaming is started
_FLOOR = 1e-8  # of the largest value, where rounding begins to show and the last decay is continued
_NODES = 16  # of a panel of the beam
_PANEL = 4.0  # width of one, in asinh of the distance over r
_TURN = 0.04  # step of the angle, in asinh of it over the width of the phase function
_MILNE = 0.7104  # reduced mean free paths outside of the face at which diffuse light extrapolates to 0 (Milne's problem)
_GONE = 36.0  # mfp after which nothing is left of the beam


@dataclass(frozen=True)
class Point:
    """Light scattered at least twice, of power 1 that enters its first collision at the origin along +z."""

    r: np.ndarray  # (K,) mfp, equal steps of the logarithm
    theta: np.ndarray  # (T,) rad from +z, equal steps of asinh(theta/scale)
    scale: float  # rad
    light: np.ndarray  # (K, T, 2) mfp^-1, fluence and net flux along +z, times r
    decay: float  # 1/mfp, of the light beyond the last r


def point(albedo, p, width=1.0) -> Point:
    """Solves transport for a point.

    albedo : 0 to 1
    p : (L + 1,) Legendre moments of the phase function, p_0 = 1; those above L are taken as 0
    width : rad, angle in which the phase function varies most

    Coefficients within 1e-5 from r = 0.01 to 40 mfp (against twice the wave numbers over ten times the range).
    """
    p = np.append(np.asarray(p, float), 0.0)
    L = len(p) - 1
    high = _HIGH * max(1.0, L / _BROAD)
    k = np.geomspace(_LOW, high, round(WAVES * math.log10(high / _LOW)))
    step = math.log(k[1] / k[0])
    fluence, along, across = _rows(k, float(albedo), p)
    l = np.arange(L + 1.0)[:, None]
    fluence *= np.sqrt(2 * l + 1)
    # cos times P_l, and sin times P_l^1, as P_(l+1) and P_(l-1)
    along /= np.sqrt(3 * (2 * l + 1))
    across *= np.sqrt(2 * l * (l + 1) / (3 * (2 * l + 1)))
    flux = np.zeros_like(fluence)
    flux[1:] -= l[1:] * along[:-1] - across[:-1]
    flux[:-1] += l[1:] * along[1:] + across[1:]
    # 1/(k^2 + m^2) has the transform e^(-m r)/(4 pi r): the ends of order 0, the source and diffusion (all of it at albedo 1)
    diffusion = math.sqrt(3 * (1 - albedo) * max(1 - albedo * p[1], 0.0))
    farther = math.hypot(diffusion, 1.0)
    kernel = 1 / (k * k + diffusion**2) - 1 / (k * k + farther**2)
    near = 1 / (k * k + 1)
    r = 1 / k[::-1]
    # of order 0 the ends, of which the transform is known, apart
    source = fluence[0, -1] / near[-1], flux[0, -1] / near[-1]
    diffuse = (fluence[0, 0] - source[0] * near[0]) / kernel[0]
    rows = np.stack([fluence, flux])
    rows[0, 0] -= source[0] * near + diffuse * kernel
    rows[1, 0] -= source[1] * near
    out = np.empty((2, L + 1, len(k)))
    for order in range(L + 1):
        for which in ([0], [1]) if order == 0 else ([0, 1],):
            bias = 0.5 if order > 1 or (order == 0 and which == [0]) else 0.0  # both ends then fall off, to 3e-3 at least
            out[which, order] = fft.fht(k**1.5 * rows[which, order], step, order + 0.5, 0.0, bias)
    out *= math.sqrt(math.pi / 2) / np.sqrt(r) / (2 * math.pi**2)
    out[0, 0] += (source[0] * np.exp(-r) + diffuse * (np.exp(-diffusion * r) - np.exp(-farther * r))) / (4 * math.pi)
    out[1, 0] += source[1] * np.exp(-r) / (4 * math.pi)
    # the ends of the transform: r times the light is constant at the source, and falls exponentially far away
    first = np.searchsorted(r, 300 / high)
    total = np.abs(out[0, 0])
    low = np.flatnonzero((total < _FLOOR * total[first:].max()) & (r > 1))
    last = min(int(low[0]) if low.size else len(r), np.searchsorted(r, 1 / (30 * _LOW))) - 1
    decay = math.log(out[0, 0, last - 4] / out[0, 0, last]) / (r[last] - r[last - 4])
    scale = min(width, 1.0)
    x = np.linspace(0, math.asinh(math.pi / scale), math.ceil(math.asinh(math.pi / scale) / _TURN) + 1)
    theta = scale * np.sinh(x)
    light = _polar(np.ascontiguousarray(out[:, :, first:last + 1].transpose(2, 0, 1)), theta)
    return Point(r[first:last + 1], theta, scale, light, max(decay, 0.0))


def twice(at: Point, depth, r):
    """Light of a beam that was scattered at least twice.

    at : of `point`
    depth, r : mfp, r > 0; broadcast against each other

    Returns fluence, flux : mfp^-2, of the shape of depth and r; flux is net, forward less back
    """
    depth, r = np.broadcast_arrays(np.asarray(depth, float), np.asarray(r, float))
    out = np.zeros((2, depth.size))
    x, w = np.polynomial.legendre.leggauss(_NODES)
    turn = math.asinh(at.theta[1] / at.scale)
    _sum(np.array(depth, order="C").ravel(), np.array(r, order="C").ravel(), at.r, (turn, at.scale, at.light, at.decay), (x, w),
         out)
    return out[0].reshape(depth.shape), out[1].reshape(depth.shape)


def half_space(at: Point, mean_path, depth, r):
    """Light scattered at least twice of a beam that enters the medium z >= 0, as `twice`.

    A mirror beam of negative power, 2 times 0.7104 mean_path outside of the face, takes out what would have come back.

    mean_path : mfp, 1/(1 - albedo g), after which light has forgotten its direction

    Fluence against photons, depths and rings to 5 mfp, root mean square, albedo 0.9 and 1: spread 30 degrees 0.4 and 0.9 % (7.5 %
    without the mirror); 60 degrees below 0.5 and 1.5 % (49 %); 90 degrees below 0.5 and 3.1 % (91 %).
    """
    fluence, flux = twice(at, depth, r)
    lost, against = twice(at, -np.asarray(depth, float) - 2 * _MILNE * mean_path, r)
    fluence = np.maximum(fluence - lost, 0.0)
    return fluence, np.clip(flux + against, -fluence, fluence)


def split(fluence, flux):
    """Forward and backward light from fluence and net flux: directions are distributed as e^(lambda cos).

    That is the distribution of largest entropy with these two moments; it is a beam at one end and isotropic at the other.

    Returns forward, back : (2, ...), fluence and flux of each, all >= 0
    """
    mean = np.divide(flux, fluence, out=np.zeros(np.shape(fluence)), where=np.asarray(fluence) > 0)
    lam = np.geomspace(1e-4, 700, 2000)
    cosine = 1 / np.tanh(lam) - 1 / lam  # below 1e-3 it has few digits, and hardly matters
    absolute = (lam - 1 + 2 * np.exp(-lam) - np.exp(-2 * lam) * (1 + lam)) / lam / -np.expm1(-2 * lam)
    knots = np.concatenate([[0.0], cosine, [1.0]])
    larger = fluence * np.interp(np.abs(mean), knots, np.concatenate([[0.5], 1 / (1 + np.exp(-lam)), [1.0]]))
    total = fluence * np.interp(np.abs(mean), knots, np.concatenate([[0.5], absolute, [1.0]]))
    ahead = np.where(mean >= 0, larger, fluence - larger)
    return (np.array([ahead, np.maximum((total + flux) / 2, 0.0)]),
            np.array([fluence - ahead, np.maximum((total - flux) / 2, 0.0)]))


@njit(cache=True, nogil=True, error_model="numpy")
def _rows(k, albedo, p):
    """Rows of K Lam G Lam: what a source's orders give to the fluence (row 0), to the flux along and across the wave (row 1)."""
    L = len(p) - 1
    out = np.zeros((3, L + 1, len(k)))
    d, x, a = np.empty(L + 1), np.empty(L + 1), np.zeros(L + 2)
    for which in range(3):
        M, row = (1, 1) if which == 2 else (0, which)
        for l in range(M, L + 2):
            a[l] = math.sqrt((l * l - M * M) / (4.0 * l * l - 1.0)) if l else 0.0
        for i in range(len(k)):
            q = k[i]
            tail = 0.5 * (1 + math.sqrt(1 + q * q))
            for l in range(L + 1 + _LEVELS, L, -1):
                tail = 1 + q * q * (((l + 1) ** 2 - M * M) / (4.0 * (l + 1) ** 2 - 1)) / tail
            x[:] = 0.0
            x[row] = 1.0
            for event in range(2):
                # (1 - q B - c) y = x from above; c = 0 for the flight after the last event
                for l in range(L, M - 1, -1):
                    d[l] = 1 - event * albedo * p[l] + q * q * a[l + 1] ** 2 / (tail if l == L else d[l + 1])
                for l in range(L - 1, M - 1, -1):
                    x[l] -= q * a[l + 1] * x[l + 1] / d[l + 1]
                x[M] /= d[M]
                for l in range(M + 1, L + 1):
                    x[l] = (x[l] + q * a[l] * x[l - 1]) / d[l]
                for l in range(M, L + 1):
                    x[l] *= albedo * p[l]
            for l in range(M, L + 1):
                out[which, l, i] = x[l]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _polar(legendre, theta):
    """Sums of the Legendre series at the angles, (K, T, 2)."""
    radii, _, orders = legendre.shape
    out = np.zeros((radii, len(theta), 2))
    polynomial = np.empty(orders)
    rounding = 0.0
    for i in range(radii):
        rounding = max(rounding, 1e-11 * np.sum(np.abs(legendre[i, 0])))
    for j in range(len(theta)):
        v, step = 2 * math.sin(theta[j] / 2) ** 2, 0.0
        polynomial[0] = 1.0
        for l in range(orders - 1):
            # P_(l+1) - P_l from the difference before it: no rounding of 1 - v
            step = (l * step - (2 * l + 1) * v * polynomial[l]) / (l + 1)
            polynomial[l + 1] = polynomial[l] + step
        for i in range(radii):
            for which in range(2):
                total = 0.0
                for l in range(orders):
                    total += polynomial[l] * legendre[i, which, l]
                out[i, j, which] = total
            # no light here, only ripples of the last order and rounding of the transform
            if out[i, j, 0] < 3 * abs(legendre[i, 0, orders - 2]) + rounding:
                out[i, j, :] = 0.0
    return out


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _cubic(position, last):
    """First of four neighbours and their weights (Lagrange)."""
    position = min(max(position, 0.0), last)
    i = min(max(int(position) - 1, 0), last - 3)
    f = position - i
    return (i, -(f - 1) * (f - 2) * (f - 3) / 6, f * (f - 2) * (f - 3) / 2, -f * (f - 1) * (f - 3) / 2, f * (f - 1) * (f - 2) / 6)


@njit(cache=True, nogil=True, error_model="numpy")
def _sum(depth, r, radii, light_of, rule, out):
    """Light along the beam, added up.  light_of : its step in angle, scale, table and decay;  rule : of Gauss, x and w."""
    (turn, scale, light, decay), (x, w) = light_of, rule
    step, origin, last, turns = math.log(radii[1] / radii[0]), math.log(radii[0]), len(radii) - 1, light.shape[1] - 1
    for n in range(len(depth)):
        z, rho = depth[n], r[n]
        # s = z + rho sinh(t): no peak is left beside the beam; split where it passes the point
        begin, end = math.asinh(-z / rho), math.asinh((_GONE - z) / rho)
        for half in range(2):
            lower = begin if half == 0 else max(begin, 0.0)
            right = min(end, 0.0) if half == 0 else end
            if right <= lower:
                continue
            panels = math.ceil((right - lower) / _PANEL)
            width = (right - lower) / panels
            for panel in range(panels):
                for node in range(len(x)):
                    t = lower + (panel + 0.5 * (1 + x[node])) * width
                    beyond, far = rho * math.sinh(t), rho * math.cosh(t)
                    weight = w[node] * 0.5 * width * math.exp(-(z + beyond))  # ds / far = dt
                    if far > radii[last]:
                        weight *= math.exp(-decay * (far - radii[last]))
                    if weight < 1e-300:
                        continue
                    i, a0, a1, a2, a3 = _cubic((math.log(far) - origin) / step, last)
                    j, b0, b1, b2, b3 = _cubic(math.asinh(math.atan2(rho, -beyond) / scale) / turn, turns)
                    for which in range(2):
                        total = 0.0
                        for m, a in enumerate((a0, a1, a2, a3)):
                            row = light[i + m]
                            total += a * (b0 * row[j, which] + b1 * row[j + 1, which] + b2 * row[j + 2, which]
                                          + b3 * row[j + 3, which])
                        out[which, n] += weight * total
