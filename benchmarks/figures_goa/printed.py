"""The paper's formulas as printed, without floors: eqs. 4-11 for amplitudes, 12-14 for cross sections.

Kept apart from `bakery.goa`, which corrects them, and only as complete as its claims need: real index, time factor exp(+i w t).
"""

from functools import lru_cache

import numpy as np
from numba import njit
from scipy.special import j1

STRICT = dict(cache=True, nogil=True, error_model="numpy")


@njit(**STRICT)
def _turned(m, p, t):
    """Eq. 5."""
    return 2.0 * p * np.arcsin(min(np.sin(t) / m, 1.0)) - 2.0 * t - (p - 1.0) * np.pi


@njit(**STRICT)
def _solved(m, p, target, low, high):
    rising = _turned(m, p, high) > _turned(m, p, low)
    for _ in range(48):
        middle = 0.5 * (low + high)
        if (_turned(m, p, middle) < target) == rising:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit(**STRICT)
def _ray(m, p, t, theta, target, q, row):
    """row = S1/x, S2/x (eqs. 7, 8) without the path (phase/x, eq. 9) and the focal lines (phase, eq. 10), which follow.

    Totally reflected rays of bubbles have Fresnel's complex coefficients (wave that decays inwards); the paper is silent.
    """
    cos, square = np.cos(t), 1.0 - (np.sin(t) / m) ** 2
    inside = complex(np.sqrt(square), 0.0) if square > 0.0 else complex(0.0, -np.sqrt(-square))
    slope = 2.0 * p * cos / (m * inside.real) - 2.0 if p else -2.0
    width = np.sqrt(np.sin(2.0 * t) / (2.0 * np.sin(theta) * abs(slope)))
    r1, r2 = (cos - m * inside) / (cos + m * inside), (m * cos - inside) / (m * cos + inside)
    turns = round((target - q * theta) / (2.0 * np.pi))
    row[0] = width * (r1 if p == 0 else (1.0 - r1 * r1) * (-r1) ** (p - 1))
    row[1] = width * (r2 if p == 0 else (1.0 - r2 * r2) * (-r2) ** (p - 1))
    row[2] = 2.0 * (cos - p * m * (inside.real if p else 0.0))
    row[3] = 0.5 * np.pi * (1.0 + p - 2.0 * turns - 0.5 * np.sign(slope) - 0.5 * q)


@njit(**STRICT)
def _trace(m, theta, orders, one, owner, rays):
    """Rays of every angle into owner (N,), rays (N, 4); returns how many there are, also when the arrays are empty."""
    count, best, ray = 0, np.empty(4, dtype=np.complex128), np.empty(4, dtype=np.complex128)
    for j in range(theta.shape[0]):
        for p in range(orders + 1):
            end = np.pi / 2 if m >= 1.0 or p == 0 else np.arcsin(m)
            bow = np.arccos(np.sqrt((m * m - 1.0) / (p * p - 1.0))) if 1.0 < m < p else end
            power = -1.0
            for half in range(2 if bow < end else 1):
                low, high = (0.0, bow) if half == 0 else (bow, end)
                a, b = _turned(m, p, low), _turned(m, p, high)
                a, b = min(a, b), max(a, b)
                for q in (1.0, -1.0):
                    for turns in range(int(np.ceil((a - q * theta[j]) / (2 * np.pi))),
                                       int(np.floor((b - q * theta[j]) / (2 * np.pi))) + 1):
                        if not one and owner.shape[0] == 0:  # the first pass counts
                            count += 1
                            continue
                        target = 2 * np.pi * turns + q * theta[j]
                        _ray(m, p, _solved(m, p, target, low, high), theta[j], target, q, ray)
                        if one:
                            now = abs(ray[0]) ** 2 + abs(ray[1]) ** 2
                            if now > power:
                                power = now
                                best[:] = ray
                            continue
                        owner[count] = j
                        rays[count] = ray
                        count += 1
            if one and power >= 0.0:
                if owner.shape[0]:
                    owner[count] = j
                    rays[count] = best
                count += 1
    return count


@njit(**STRICT)
def _summed(x, owner, rays, s1, s2):
    for i in range(x.shape[0]):
        for k in range(owner.shape[0]):
            phase = x[i] * rays[k, 2].real + rays[k, 3].real
            wave = x[i] * complex(np.cos(phase), np.sin(phase))
            s1[i, owner[k]] += wave * rays[k, 0]
            s2[i, owner[k]] += wave * rays[k, 1]


def trace(m, theta, orders=3, *, one=False):
    """Rays that reach the angles, independent of the size of the sphere.

    Parameters
    ----------
    m : real index, relative to the host
    theta : (A,) rad, inside 0 to pi
    orders : highest number p of chords
    one : the brightest ray of each order alone, as eq. 11 can be read, whose sum runs over p and no more; else all

    Returns
    -------
    owner : (N,) the angle of each ray
    rays : (N, 4), see `_ray`
    """
    return _kept(float(m), np.ascontiguousarray(theta, dtype=np.float64).tobytes(), orders, one)


@lru_cache(maxsize=8)  # 0.1 GB each at p = 100
def _kept(m, theta, orders, one):
    theta, count = np.frombuffer(theta), 0
    for _ in range(2):
        owner, rays = np.empty(count, dtype=np.int64), np.empty((count, 4), dtype=np.complex128)
        count = _trace(m, theta, orders, one, owner, rays)
    return owner, rays


def amplitudes(m, x, theta, orders=3, *, one=False, diffraction="printed"):
    """S1, S2 (R, A) of spheres x (R,) by eq. 11; `diffraction`: "printed" (eq. 4 below 90 degrees), "taper" or None."""
    x = np.atleast_1d(np.asarray(x, dtype=np.float64))
    s1, s2 = np.zeros((2, x.size, theta.size), dtype=np.complex128)
    _summed(x, *trace(m, theta, orders, one=one), s1, s2)
    if diffraction is not None:
        fan = diffracted(x, theta, diffraction)
        s1, s2 = s1 + fan, s2 + fan
    return s1, s2


def diffracted(x, theta, form="printed"):
    """Amplitude (R, A) of diffraction: eq. 4 with the switch of eq. 11, or with u = x theta, tapered as by a soft edge."""
    x = np.atleast_1d(np.asarray(x, dtype=np.float64))[:, None]
    u = x * (np.sin(theta) if form == "printed" else theta)
    fan = x * x * np.where(u > 1e-9, j1(u) / np.maximum(u, 1e-9), 0.5)
    if form == "printed":
        return np.where(theta < np.pi / 2, fan, 0.0)
    return fan * np.exp(-((theta * x ** (1 / 3) / 1.75) ** 2))


def extinction(m, x):
    """Efficiency by eq. 14 as printed."""
    return 2.0 + 8.0 * m * m / ((m + 1) ** 2 * abs(m - 1) * x) * np.sin(2.0 * x * (1.0 - m))


def extinction_of_orders(m, x, orders):
    """Efficiency by eq. 12: the axial rays of p = 1, 3, ..., orders; s = q of the limit towards theta = 0."""
    q, r = 2.0, (1.0 - m) / (1.0 + m)
    for p in range(1, orders + 1, 2):
        share = (1 - r * r) * (-r) ** (p - 1) / abs(p / m - 1)
        q = q + 2.0 / x * share * np.cos(2.0 * x * (1.0 - p * m) + 0.5 * np.pi * (2 * p - np.sign(p / m - 1)))
    return q


def absorption(n, k, x):
    """Efficiency by eq. 13, linear in k; the bracket's second term is imaginary for n < 1 and left out there."""
    return 8.0 * x * k / (3.0 * n) * (n**3 - max(n * n - 1.0, 0.0) ** 1.5)
