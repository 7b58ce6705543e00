"""Pairs of directions by the angle between them and how they stand to the surface: coordinates in which reciprocity is plain.

The two directions, toward the light and toward the eye, span a plane that cuts the sphere in the luminance equator.  The normal
has a latitude beta over it and a longitude Lambda from the middle between the two, as a place on a planet has for its sun and its
observer.  Exchanging the two turns the sign of Lambda, mirroring that of beta: both reflectances are one value at |Lambda| and
|beta|.  With alpha the phase angle, 0 where the light goes straight back, all pairs are as many as alpha and the normal's places:
sin alpha dalpha cos beta dbeta dLambda.

    mu = cos beta cos(Lambda - alpha/2),  mu0 = cos beta cos(Lambda + alpha/2)

Coordinates here run from 0 to 1: sqrt(alpha/pi), so that places lie close where light goes back (opposition effect);
1 - sqrt(1 - |Lambda|/limit) with limit = (pi - alpha)/2, close where one of the two grazes; |beta|/(pi/2).
Source: Hapke 2012, Theory of Reflectance and Emittance Spectroscopy, section 8.3 (luminance coordinates).
"""

import math

import numpy as np

from bakery.system.compiled import njit


@njit(cache=True, nogil=True, error_model="numpy")
def coordinates(mu, mu0, cosine):
    """The three coordinates of a pair, from cosines with the normal, above 0, and the cosine of the phase angle."""
    half = 0.5 * math.acos(min(max(cosine, -1.0), 1.0))
    x, y = 0.5 * (mu + mu0) / max(math.cos(half), 1e-300), 0.5 * abs(mu - mu0) / max(math.sin(half), 1e-300)
    across = math.hypot(x, y)
    longitude = math.atan2(y, x) if half > 1e-9 else 0.0
    limit = 0.5 * math.pi - half
    share = min(longitude / limit, 1.0) if limit > 0.0 else 0.0
    return math.sqrt(2.0 * half / math.pi), 1.0 - math.sqrt(1.0 - share), math.acos(min(across, 1.0)) / (0.5 * math.pi)


@njit(cache=True, nogil=True, error_model="numpy")
def cell_of(mu, mu0, cosine, counts):
    """Number of the cell of a pair; counts : (3,) cells along the coordinates, each of equal width."""
    a, b, c = coordinates(mu, mu0, cosine)
    i, j = min(int(a * counts[0]), counts[0] - 1), min(int(b * counts[1]), counts[1] - 1)
    return (i * counts[1] + j) * counts[2] + min(int(c * counts[2]), counts[2] - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _spread(mu, mu0, cosine, counts, index, weight):
    """Cells (K, 8) and weights (K, 8) between whose middles pairs lie; beyond the outermost middles, these."""
    at = np.empty(3)
    for k in range(len(mu)):
        at[0], at[1], at[2] = coordinates(mu[k], mu0[k], cosine[k])
        for corner in range(8):
            number, share = 0, 1.0
            for axis in range(3):
                level = min(max(at[axis] * counts[axis] - 0.5, 0.0), counts[axis] - 1.0)
                low = min(int(level), max(counts[axis] - 2, 0))
                up = (corner >> axis) & 1
                share *= level - low if up else 1.0 - (level - low)
                number = number * counts[axis] + min(low + up, counts[axis] - 1)
            index[k, corner], weight[k, corner] = number, share


def interpolation(mu, mu0, phi, counts):
    """Where pairs lie among the middles of cells.

    mu, mu0, phi : (K,) cosines above 0, and the azimuth between the directions of travel (0: forward)
    counts : (3,) cells along the coordinates

    Returns index, weight : (K, 8) cells and weights that add up to 1
    """
    cosine = mu * mu0 - np.sqrt(np.maximum((1 - mu * mu) * (1 - mu0 * mu0), 0.0)) * np.cos(phi)
    index, weight = np.empty((len(mu), 8), np.int64), np.empty((len(mu), 8))
    _spread(*(np.ascontiguousarray(a, float) for a in (mu, mu0, cosine)), np.asarray(counts, np.int64), index, weight)
    return index, weight


def by_slice(values, where, counts):
    """Values (A,) of slices of the phase angle, between their middles, (K,) at pairs; where : their `interpolation`."""
    index, weight = where
    return np.einsum("kc,kc->k", values[index // (counts[1] * counts[2])], weight)


def finer(table, slices: int):
    """A table (A, U, V) at the middles of more slices of the phase angle, (slices, U, V)."""
    at = np.clip((np.arange(slices) + 0.5) / slices * len(table) - 0.5, 0, len(table) - 1)
    low = np.minimum(at.astype(int), len(table) - 2)
    up = (at - low)[:, None, None]
    return table[low] * (1 - up) + table[low + 1] * up


def quadrature(counts, points):
    """Pairs of directions for integrals over cells: `points` (3,) Gauss points along the coordinates of each cell.

    Returns
    -------
    mu, mu0, phi : (C, P) of one half of each pair's cell: mu0 >= mu; the other half is the pair exchanged
    weight : (C, P) of integrals over both directions, sr^2, of that half and all azimuths: all add up to 2 pi^2
    """
    rules = [np.polynomial.legendre.leggauss(number) for number in points]
    axes = [(np.arange(count)[:, None] + 0.5 * (1 + x)) / count for count, (x, _) in zip(counts, rules, strict=True)]
    share = np.prod(np.meshgrid(*(0.5 * weight for _, weight in rules), indexing="ij"), axis=0).ravel() / np.prod(counts)
    shape = *counts, *points
    a, b, c = (np.broadcast_to(axis.reshape([n if k % 3 == at else 1 for k, n in enumerate(shape)]), shape)
               .reshape(-1, share.size) for at, axis in enumerate(axes))
    alpha, beta, limit = math.pi * a * a, 0.5 * math.pi * c, 0.5 * math.pi * (1 - a * a)
    longitude = limit * (1 - (1 - b) ** 2)
    # both signs of the latitude, all azimuths of the first direction, both senses of the second about the first
    weight = share * 2 * math.pi * a * np.sin(alpha) * np.cos(beta) * 0.5 * math.pi * limit * 2 * (1 - b) * 4 * math.pi
    mu0, mu = np.cos(beta) * np.cos(longitude - 0.5 * alpha), np.cos(beta) * np.cos(longitude + 0.5 * alpha)
    sines = np.sqrt(np.maximum((1 - mu * mu) * (1 - mu0 * mu0), 1e-300))
    phi = np.arccos(np.clip((mu * mu0 - np.cos(alpha)) / sines, -1, 1))
    # the integral of sin alpha times limit over each slice, in closed form: near alpha = 0 it is of a^3 da, of which a point in
    # the middle of the first slice has half, and of the second 0.9
    alpha = math.pi * np.linspace(0, 1, counts[0] + 1) ** 2
    share = -np.diff((math.pi - alpha) * np.cos(alpha) + np.sin(alpha)) / math.pi
    whole = weight.reshape(counts[0], -1)
    whole *= (2 * math.pi**2 * share / whole.sum(axis=1))[:, None]
    return mu, mu0, phi, weight
