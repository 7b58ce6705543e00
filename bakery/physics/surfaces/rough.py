"""A rough boundary between air and a medium, or two media: facets after Trowbridge and Reitz (GGX), by Fourier orders in azimuth.

Single reflection and refraction by facets with Smith's shadowing (Walter et al. 2007) loses the light that meets a second facet.
That is sent on in proportion to what each direction loses, to both sides (Kulla and Conty 2017): nothing is lost then, and
reciprocity stays.

Lobes can be much narrower than what lies between two nodes, but only act on radiance that is a polynomial between the nodes: it
is averaged over the facets that a node sees (their normals are uniform in a spherical cap, Dupuy and Benyoub 2023), where it is
smooth.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.surfaces import fresnel
from bakery.physics.surfaces.nodes import interpolation

_FACETS = 48  # heights of the cap at least; twice as many azimuths of half a turn
# the same where radiance has kinks, as light is totally reflected: with 48, one layer changed by 11 % from 54 to 81 moments
_KINKED = 128
_TOGETHER = 1024  # facets: what they take stays in the processor's cache
LEAST = 0.05  # roughness: of smoother facets the nodes of a layer tell too little; at 0.05 shares are right to 1e-3


@dataclass(frozen=True)
class Facets:
    """Operators of the boundary in the form of `layer`, flux inside counted with the square of the index."""

    above: np.ndarray  # (M, A, A) reflected once, back to where light comes from
    inward: np.ndarray  # (M, B, A) from above into the medium; outward it is the transpose
    within: np.ndarray  # (M, B, B) reflected inside
    again: np.ndarray  # (A, A) of light from above, what facets send back after it met several of them, order 0
    mirrored: np.ndarray  # (A,) share of light from above that is sent back in all

    def over(self, inside, order: int):
        """Of one order, all that comes back to above the facets but for what they reflect once.

        inside : (B, B) reflection of what is under them
        """
        inward, within = self.inward[order], self.within[order]
        result = inward.T @ inside @ np.linalg.solve(np.eye(len(within)) - within @ inside, inward)
        return result + self.again if order == 0 else result


def facets(above, below, index: float, roughness: float, orders: int) -> Facets:
    """The boundary between directions above and below it.

    above, below : directions, such as `shared.Side`: mu and flux, (A,) and (B,), and polynomials between them (`spans`)
    index : of the medium below over that above
    orders : M
    """
    front, back = np.sqrt(above.flux), np.sqrt(below.flux)
    upward, outward = _averages(above, below, index, roughness, orders)
    within, inward = _averages(below, above, 1 / index, roughness, orders)
    # shares of light that is reflected or refracted once, whose averages are smooth and exact
    refracted, emerging = outward[0] @ back, inward[0] @ front
    upward, mirrored = _symmetric(upward, above.flux, front)
    within, mirrored_within = _symmetric(within, below.flux, back)
    # radiance in the medium counts less by the square of the index, flux more: both ways are one operator
    trust = _trust(below.flux, above.flux)
    inward = index * inward * trust + np.swapaxes(outward / index * (1 - trust).T, 1, 2)
    inward[0] = _balanced(inward[0], index * emerging, refracted / index, back, front)
    lost_above, lost_below = _sent_on(front - mirrored - index * inward[0].T @ back,
                                      index * (back - mirrored_within) - inward[0] @ front, front, index * back)
    inward[0] += np.outer(lost_below, lost_above)
    within[0] += np.outer(lost_below, lost_below)
    again = np.outer(lost_above, lost_above)
    return Facets(upward, inward, within, again, (upward[0] + again) @ front / front)


def _sent_on(above, below, front, back):
    """Of what light from above (A,) and below (B,) loses by second facets, vectors whose products send it on to both sides."""
    total = above @ front + below @ back
    if not total > 0:
        raise ArithmeticError("facets so smooth need more directions")
    return above / math.sqrt(total), below / math.sqrt(total)


def _trust(rows, columns):
    """Weights of what rows see of columns, by their flux; the rest goes to what columns see of rows.

    Small flux of grazing columns is over itself, with the rounding of the rows' averages.
    """
    return columns / (rows[:, None] + columns)


def _symmetric(matrices, flux, root):
    """Averages (M, N, N) of reflected light made symmetric; and the shares that they reflect, kept by order 0."""
    shares, trust = matrices[0] @ root, _trust(flux, flux)
    matrices = matrices * trust + np.swapaxes(matrices * trust, 1, 2)
    matrices[0] = _balanced(matrices[0], shares, shares, root, root)
    return matrices, shares


def _balanced(matrix, rows, columns, row_root, column_root):
    """A matrix that turns `column_root` into `rows`, and its transpose `row_root` into `columns`, by adding isotropic light."""
    rows, columns = rows - matrix @ column_root, columns - matrix.T @ row_root
    twice = 0.5 * (rows @ row_root + columns @ column_root)
    return matrix + np.outer(rows, column_root) + np.outer(row_root, columns) - twice * np.outer(row_root, column_root)


def _averages(side, across, index: float, roughness: float, orders: int):
    """(M, N, N) and (M, N, K) of radiance that leaves at the nodes of a side (rows): what they see reflected, and refracted."""
    mu, roots = side.mu, (np.sqrt(side.flux), np.sqrt(across.flux))
    kinked = any(sum(1 for _ in part.spans(part.mu[:1])) > 1 for part in (side, across))
    z, weight = np.polynomial.legendre.leggauss(max(_KINKED if kinked else _FACETS, 2 * max(len(root) for root in roots) // 3))
    turn = math.pi * (np.arange(2 * len(z)) + 0.5) / (2 * len(z))
    results = [np.zeros((orders, len(mu), len(root))) for root in roots]
    weight = 0.5 * weight[:, None] / len(turn)
    for row, cosine in enumerate(mu):
        for result, seen_side, (share, cosines, phi) in zip(results, (side, across), _seen(cosine, z, turn, index, roughness),
                                                            strict=True):
            visible = share > 0
            _add_facets(result[:, row], seen_side, orders, (weight * share)[visible], cosines[visible], np.cos(phi[visible]))
    for result, root, part in zip(results, roots, (side, across), strict=True):
        result[1::2] /= np.sqrt((1 - part.mu) * (1 + part.mu))
        result *= roots[0][:, None] / root
    return results


def _add_facets(result, side, orders: int, share, cosines, turned):
    """To the orders (M, K) of a direction, what facets (Q,) show it of the nodes of a side; odd ones times the sine there."""
    for facets, columns, at, coordinate in side.spans(cosines):
        for k in range(0, len(facets), _TOGETHER):
            batch = facets[k:k + _TOGETHER]
            waves = _waves(orders, turned[batch]) * share[batch]
            waves[1::2] *= np.sqrt((1 - cosines[batch]) * (1 + cosines[batch]))
            result[:, columns] += waves @ interpolation(at, coordinate[k:k + _TOGETHER])


def _waves(orders: int, turned):
    """(M, Q) cos(m phi) of cos(phi) (Q,): from those up to n, by their products with cos(n phi), those up to twice n."""
    waves = np.empty((orders, len(turned)))
    waves[0], waves[1:2] = 1.0, turned
    for n in (1 << k for k in range(orders.bit_length())):
        higher = waves[n + 1:2 * n + 1]
        if len(higher):
            np.multiply(2 * waves[n], waves[1:len(higher) + 1], out=higher)
            higher -= waves[n - len(higher):n][::-1]
    return waves


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


def reflected(mu, mu0, phi, index: float, roughness: float):
    """R of light that facets reflect once, from a side of the boundary whose other side has a relative index."""
    # the cosine of twice the angle between a direction and the normal of the facet
    doubled = mu * mu0 - np.sqrt((1 - mu * mu) * (1 - mu0 * mu0)) * np.cos(phi)
    onto = np.sqrt(np.maximum(0.5 * (1 + doubled), 1e-30))
    upright = np.minimum(0.5 * (mu + mu0) / onto, 1.0)
    shares = _visible(mu, roughness) * _visible(mu0, roughness) * fresnel.reflected(onto, index)
    density = roughness**2 / (math.pi * ((roughness**2 - 1) * upright**2 + 1) ** 2)  # of normals of facets, 1/sr (D)
    return math.pi * shares * density / (4 * mu * mu0)
