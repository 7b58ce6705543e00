"""A rough boundary between air and the medium: facets after Trowbridge and Reitz (GGX), by Fourier orders in azimuth.

Single reflection and refraction by facets with Smith's shadowing (Walter et al. 2007) loses the light that meets a second facet.
That is sent on in proportion to what each direction loses, to both sides (Kulla and Conty 2017): nothing is lost then, and
reciprocity stays.

Lobes can be much narrower than what lies between two nodes, but only act on radiance that is a polynomial between the nodes: it
is averaged over the facets that a node sees (their normals are uniform in a spherical cap, Dupuy and Benyoub 2023), where it is
smooth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.surfaces import fresnel
from bakery.physics.surfaces.nodes import interpolation

_FACETS = 48  # heights of the cap at least; twice as many azimuths of half a turn
LEAST = 0.05  # roughness: of smoother facets the nodes of a layer tell too little; at 0.05 shares are right to 1e-3


@dataclass(frozen=True)
class Facets:
    """Operators of the boundary in the form of `layer`, flux inside counted with the square of the index.

    Attributes
    ----------
    inward : (M, N, N) from air into the medium; outward it is the transpose
    within : (M, N, N) reflected inside
    again : (N, N) of light from air, what facets send back after it met several of them, order 0
    mirrored : (N,) share of light from air that is sent back in all
    """

    inward: np.ndarray
    within: np.ndarray
    again: np.ndarray
    mirrored: np.ndarray


def facets(mu, flux, at, index: float, roughness: float, orders: int) -> Facets:
    """The boundary between directions in air and in the medium that have the same cosines.

    Parameters
    ----------
    mu, flux, at : (N,) of `nodes.Nodes` without a boundary
    orders : M
    """
    root = np.sqrt(flux)
    # rounding of what grazing nodes are seen by, over their small flux
    trust = flux / (flux[:, None] + flux)
    above, outward = _averages(mu, root, at, index, roughness, orders)
    within, inward = _averages(mu, root, at, 1 / index, roughness, orders)
    # shares of light that is reflected or refracted once, whose averages are smooth and exact
    refracted, emerging, *mirrored = (orders[0] @ root for orders in (outward, inward, above, within))
    above, within = (part * trust + np.swapaxes(part * trust, 1, 2) for part in (above, within))
    for operator, share in zip((above, within), mirrored, strict=True):
        operator[0] = _balanced(operator[0], share, share, root)
    # radiance in the medium counts less by the square of the index, flux more: both ways are one operator
    inward = index * inward * trust + np.swapaxes(outward / index * trust, 1, 2)
    inward[0] = _balanced(inward[0], index * emerging, refracted / index, root)
    lost = np.concatenate([root - mirrored[0] - index * inward[0].T @ root, index * (root - mirrored[1]) - inward[0] @ root])
    total = lost @ np.concatenate([root, index * root])
    if not total > 0:
        raise ArithmeticError("facets so smooth need more directions")
    front, back = np.split(lost / math.sqrt(total), 2)
    inward[0] += np.outer(back, front)
    within[0] += np.outer(back, back)
    again = np.outer(front, front)
    return Facets(inward, within, again, (above[0] + again) @ root / root)


def _balanced(matrix, rows, columns, root):
    """A matrix that turns `root` into `rows`, and its transpose into `columns`: what it lacks is spread like isotropic light."""
    rows, columns = rows - matrix @ root, columns - matrix.T @ root
    twice = 0.5 * (rows + columns) @ root
    return matrix + np.outer(rows, root) + np.outer(root, columns) - twice * np.outer(root, root)


def _averages(mu, root, at, index: float, roughness: float, orders: int):
    """(M, N, N) of radiance that leaves at the nodes (rows): what they see reflected (columns) and refracted."""
    z, weight = np.polynomial.legendre.leggauss(max(_FACETS, 2 * len(mu) // 3))
    turn = math.pi * (np.arange(2 * len(z)) + 0.5) / (2 * len(z))
    results = np.zeros((2, orders, len(mu), len(mu)))
    sines = np.sqrt((1 - mu) * (1 + mu))
    for row, cosine in enumerate(mu):
        for side, (share, cosines, phi) in enumerate(_seen(cosine, z, turn, index, roughness)):
            share = (0.5 * weight[:, None] / len(turn) * share).ravel()
            onto = interpolation(at, np.sqrt(cosines.ravel()))
            odd = np.sqrt((1 - cosines) * (1 + cosines)).ravel()
            turned = np.cos(phi.ravel())
            waves = np.empty((orders, share.size))  # cos(m phi), by Chebyshev's recurrence
            waves[:2] = np.stack([np.ones_like(turned), turned])[:orders]
            for m in range(2, orders):
                waves[m] = 2 * turned * waves[m - 1] - waves[m - 2]
            results[side, ::2, row] = (share * waves[::2]) @ onto
            results[side, 1::2, row] = (share * odd * waves[1::2]) @ onto / sines
    results *= root[:, None] / root
    return results


def _seen(cosine: float, z, turn, index: float, roughness: float):
    """Facets (Z, T) that a direction sees: by reflection and by refraction, share of light, cosine and azimuth of travel."""
    stretched = np.array([roughness * math.sqrt((1 - cosine) * (1 + cosine)), cosine])
    x, up = stretched / np.linalg.norm(stretched)
    height = (0.5 * (1 + z) * (1 + up) - up)[:, None]
    flat = np.sqrt((1 - height) * (1 + height))
    normal = np.stack(np.broadcast_arrays(roughness * (x + flat * np.cos(turn)), roughness * flat * np.sin(turn), height + up))
    normal /= np.sqrt(np.sum(normal**2, axis=0))
    direction = np.array([math.sqrt((1 - cosine) * (1 + cosine)), 0.0, cosine])[:, None, None]
    onto = np.clip(np.sum(direction * normal, axis=0), 0.0, 1.0)
    mirrored, under = fresnel.reflected(onto, index), fresnel.inside(onto, index)
    for share, seen in ((mirrored, 2 * onto * normal - direction),
                        (1 - mirrored, (onto / index - under) * normal - direction / index)):
        cosines = np.clip(seen[2] if share is mirrored else -seen[2], 0.0, 1.0)
        visible = cosines > 1e-12
        cosines = np.where(visible, cosines, 1.0)
        yield np.where(visible, share * _visible(cosines, roughness), 0.0), cosines, np.arctan2(seen[1], -seen[0])


def _visible(cosine, roughness):
    """Smith's share of facets that are seen from a direction (G1)."""
    tangent = np.maximum(1 - cosine * cosine, 0.0) / cosine**2
    return 2 / (1 + np.sqrt(1 + roughness**2 * tangent))


def _density(cosine, roughness):
    """Of normals of facets, 1/sr (D)."""
    return roughness**2 / (math.pi * ((roughness**2 - 1) * cosine**2 + 1) ** 2)


def reflected(mu, mu0, phi, index: float, roughness: float):
    """R of light that facets reflect once, from a side of the boundary whose other side has a relative index."""
    # the cosine of twice the angle between a direction and the normal of the facet
    doubled = mu * mu0 - np.sqrt((1 - mu * mu) * (1 - mu0 * mu0)) * np.cos(phi)
    onto = np.sqrt(np.maximum(0.5 * (1 + doubled), 1e-30))
    upright = np.minimum(0.5 * (mu + mu0) / onto, 1.0)
    shares = _visible(mu, roughness) * _visible(mu0, roughness) * fresnel.reflected(onto, index)
    return math.pi * shares * _density(upright, roughness) / (4 * mu * mu0)
