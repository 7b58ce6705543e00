"""What a periodic tile of spheres looks like: gaps, contacts, pair correlation, bond order, chords between spheres.

Any radii and any cuboid cell; a sphere may meet its own images.  Nothing here knows how the tile was made: neighbours come from
a k-d tree over explicit periodic images.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre

from bakery.physics.packing.theory import mean_chord

CONTACT = 1e-3  # of the mean diameter: spheres this close touch
BOND = 1.4  # of the contact distance: the first minimum of g2 of dense packings
_CHUNK = 4096  # spheres whose neighbours are held at a time
_LINES = 1 << 15  # chords a task: a random stream of its own


def images(centers, cell, margin: float):
    """Centres of all periodic images in the cell widened by `margin` on each side, and the spheres that they belong to.

    Parameters
    ----------
    centers : (N, 3)
    cell : (3,)

    Returns
    -------
    position : (M, 3)
    owner : (M,)
    """
    position, owner = np.mod(centers, cell), np.arange(len(centers))
    for axis in range(3):
        reach = math.ceil(margin / cell[axis])
        shifted = [position + np.eye(3)[axis] * k * cell[axis] for k in range(-reach, reach + 1)]
        owner = np.concatenate([owner] * len(shifted))
        position = np.concatenate(shifted)
        near = (position[:, axis] >= -margin) & (position[:, axis] <= cell[axis] + margin)
        position, owner = position[near], owner[near]
    return position, owner


def neighbours(centers, radii, cell, reach: float, factor: float = 0.0) -> Iterator[tuple[np.ndarray, ...]]:
    """Ordered pairs of a sphere and an image whose centres are at most `reach` + `factor` times the sum of their radii apart.

    Parameters
    ----------
    centers : (N, 3), radii : (N,), cell : (3,), one unit of length

    Yields
    ------
    i, j : (P,) sphere, sphere that the image belongs to (i itself for its own images)
    vector : (P, 3) from centre to centre
    distance : (P,) its length

    Notes
    -----
    Spheres are searched by classes of radius, factors of two wide, so that small ones are not listed around large ones in vain.
    """
    for i, j, vector, distance in _pairs(centers, radii, cell, reach, factor):
        order = np.lexsort((distance, i * np.int64(len(radii)) + j))
        yield i[order], j[order], vector[order], distance[order]


def _pairs(centers, radii, cell, reach, factor):
    """`neighbours` in no order: sorting takes as long as the search."""
    from scipy.spatial import cKDTree

    centers, radii, cell = (np.asarray(a, float) for a in (centers, radii, cell))
    wrapped = np.mod(centers, cell)
    kind = np.floor(np.log2(radii / radii.min())).astype(int)
    kinds = np.unique(kind)
    largest = {k: radii[kind == k].max() for k in kinds}
    for image_kind in kinds:
        members = np.flatnonzero(kind == image_kind)
        position, owner = images(centers[members], cell, reach + factor * (radii.max() + largest[image_kind]))
        tree, owner = cKDTree(position), members[owner]
        for centre_kind in kinds:
            limit = reach + factor * (largest[centre_kind] + largest[image_kind])
            centre = np.flatnonzero(kind == centre_kind)
            for first in range(0, centre.size, _CHUNK):
                part = centre[first:first + _CHUNK]
                pairs = cKDTree(wrapped[part]).sparse_distance_matrix(tree, limit, output_type="coo_matrix")
                i, j, distance = part[pairs.row], owner[pairs.col], pairs.data
                vector = position[pairs.col] - wrapped[i]
                keep = (distance <= reach + factor * (radii[i] + radii[j])) & ((i != j) | (np.abs(vector).max(1) > 0))
                yield i[keep], j[keep], vector[keep], distance[keep]


def smallest_gap(centers, radii, cell) -> float:
    """Smallest distance between two surfaces over the mean diameter; negative where spheres overlap.

    Own images count.  Exact however large the gap.
    """
    radii = np.asarray(radii, float)
    diameter = 2 * radii.mean()
    reach = 0.05 * diameter
    while True:
        gaps = [(distance - radii[i] - radii[j]).min() for i, j, _, distance in _pairs(centers, radii, cell, reach, 1.0)
                if i.size]
        if gaps:
            return float(min(gaps) / diameter)
        reach *= 2


def fraction(radii, cell) -> float:
    """Share of the cell's volume in spheres that do not overlap."""
    return float(4 / 3 * np.pi * np.sum(np.asarray(radii, float) ** 3) / np.prod(cell))


@dataclass(frozen=True)
class Contacts:
    """Touching spheres: `mean` number of contacts a sphere with its standard `error`, and the share of `rattlers`.

    Rattlers are spheres with fewer than four contacts, counted again without those found, until none is left.
    """

    mean: float
    error: float
    rattlers: float


def contacts(centers, radii, cell) -> Contacts:
    """Contacts of each sphere: gaps below 1e-3 of the mean diameter.

    The error is that of eight sub-volumes against each other: 1.0 to 1.1 times the spread between tiles.
    """
    centers, radii = np.asarray(centers, float), np.asarray(radii, float)
    count = len(radii)
    pairs = [np.stack([i, j]) for i, j, _, _ in neighbours(centers, radii, cell, 2 * CONTACT * radii.mean(), 1.0)]
    i, j = np.concatenate(pairs, axis=1)
    number = np.bincount(i, minlength=count)
    backbone = np.ones(count, bool)
    while True:
        degree = np.bincount(i[backbone[i] & backbone[j]], minlength=count)
        loose = backbone & (degree < 4)
        if not loose.any():
            break
        backbone &= ~loose
    return Contacts(float(number.mean()), float(_between_octants(number[:, None], _octant(centers, cell))[0]),
                    float(1 - backbone.mean()))


@dataclass(frozen=True)
class PairCorrelation:
    """g2 as means over the shells between `edges` (B + 1,), with the standard error of each (B,)."""

    edges: np.ndarray
    g: np.ndarray
    g_error: np.ndarray


def shells(radii, cell, reach: float = 8.0) -> np.ndarray:
    """Edges for `pair_correlation`: from the closest possible pair to `reach` mean radii, at most half of the shortest edge.

    Finer where more spheres give smaller errors: 0.2, 0.1 or 0.05 mean radii wide below 100, below 4000, from 4000 spheres on.
    """
    radii = np.asarray(radii, float)
    mean = radii.mean()
    width = (0.2 if radii.size < 100 else 0.1 if radii.size < 4000 else 0.05) * mean
    first = width * math.floor(2 * radii.min() / width + 1e-9)
    last = max(min(reach * mean, 0.5 * np.min(cell)), first + 10 * width)
    return first + width * np.arange(math.floor((last - first) / width + 1e-9) + 1)


def pair_correlation(centers, radii, cell, edges) -> PairCorrelation:
    """Pair correlation of centres, all species together: number of pairs over that of random points.

    centers : (N, 3), N at least 2; radii : (N,); cell : (3,), one unit of length
    edges : (B + 1,) ascending, in the same unit

    Random points: (N - 1) others a sphere, so that a tile of random points has g = 1 on average; own images are left out.
    Beyond half of the shortest edge a tile meets its own periodicity, which the errors do not know.
    Errors are what another tile of the same kind would differ by: the larger of the Poisson error of the number of pairs and of
    the spread between eight sub-volumes (of the middles of pairs).  Against the spread between 300 independent fluids of 500
    spheres at fractions of 0.1 and 0.3 that is 1.0 to 1.2 times too large; in dense tiles, where neighbours are more regular
    than Poisson's, up to 1.3 (fraction 0.5, 500 spheres) to 3.5 times (0.63, 2000) next to contact.
    """
    centers, cell, edges = (np.asarray(a, float) for a in (centers, cell, edges))
    count, bins = len(centers), edges.size - 1
    if count < 2:
        raise ValueError("one sphere has no pairs")
    octants = np.zeros((8, bins))
    point = np.ones(count)  # classes of radius serve no purpose where distances of centres are asked for
    for i, j, vector, distance in neighbours(centers, point, cell, edges[-1]):
        b = np.searchsorted(edges, distance, side="right") - 1
        keep = (i != j) & (b >= 0) & (b < bins)
        where = _octant(centers[i[keep]] + 0.5 * vector[keep], cell)
        octants += np.bincount(where * bins + b[keep], minlength=8 * bins).reshape(8, bins)
    pairs = octants.sum(axis=0)
    expected = count * (count - 1) / np.prod(cell) * 4 / 3 * np.pi * np.diff(edges**3)
    share = np.bincount(_octant(centers, cell), minlength=8) / count
    between = np.sum((octants - pairs * share[:, None]) ** 2, axis=0) * 8 / 7
    poisson = 2 * np.maximum(pairs, 1)  # variance of a number that counts each pair twice; none seen: as if one were
    # eight sub-volumes give a variance to a half: a mean over nine bins gives it to a sixth
    window = np.ones(min(9, bins))
    ratio = np.convolve(between / poisson, window, "same") / np.convolve(np.ones(bins), window, "same")
    error = np.sqrt(poisson * np.maximum(ratio, 1))
    return PairCorrelation(edges, pairs / expected, error / expected)


@dataclass(frozen=True)
class BondOrder:
    """Bond order of degree six: `q6` of all bonds, `local` the mean over spheres, `bonds` the number a sphere."""

    q6: float
    local: float
    bonds: float

    def random(self, count: int) -> float:
        """What `q6` would be if the bonds of `count` spheres pointed anywhere."""
        return 1 / math.sqrt(max(0.5 * count * self.bonds, 1.0))


def bond_order(centers, radii, cell) -> BondOrder:
    """Bond order of Steinhardt, Nelson and Ronchetti over bonds up to 1.4 times the distance at contact.

    q6 is 0.5745 in the face-centred cubic crystal, 0.4848 in the hexagonal one, 0.3536 in the simple cubic one, and about
    1/sqrt(number of bonds) where bonds point anywhere.

    Source: Phys. Rev. B 28, 784 (1983), eq. 1.3.
    """
    from scipy.special import sph_harm_y

    radii = np.asarray(radii, float)
    count = len(radii)
    total = np.zeros((count, 7), complex)
    number = np.zeros(count)
    for i, _, vector, distance in neighbours(centers, radii, cell, 0.0, BOND):
        polar, azimuth = np.arccos(np.clip(vector[:, 2] / distance, -1, 1)), np.arctan2(vector[:, 1], vector[:, 0])
        for m in range(7):
            y = sph_harm_y(6, m, polar, azimuth)
            total[:, m] += np.bincount(i, y.real, count) + 1j * np.bincount(i, y.imag, count)
        number += np.bincount(i, minlength=count)
    if not number.any():
        return BondOrder(0.0, 0.0, 0.0)

    def order(q):
        square = np.abs(q) ** 2
        return np.sqrt(4 * np.pi / 13 * (square[..., 0] + 2 * square[..., 1:].sum(-1)))

    bound = number > 0
    return BondOrder(float(order(total.sum(axis=0) / number.sum())),
                     float(order(total[bound] / number[bound, None]).mean()), float(number.mean()))


def global_bond_order(centers, radii, cell) -> float:
    """`q6` of `bond_order` alone, to 1e-12: Y_6m is exp(i m azimuth) sin^m d^m P_6/dz^m, up to a factor whose square is known."""
    total, number = np.zeros(7, complex), 0
    for i, _, vector, distance in neighbours(centers, radii, cell, 0.0, BOND):
        x, y, z = (vector / distance[:, None]).T
        power = np.ones(i.size, complex)
        for m in range(7):
            total[m] += np.sum(power * Legendre.basis(6).deriv(m)(z))
            power *= x + 1j * y
        number += i.size
    weights = np.array([(1 + (m > 0)) * math.factorial(6 - m) / math.factorial(6 + m) for m in range(7)])
    return float(np.sqrt(np.sum(weights * np.abs(total) ** 2)) / max(number, 1))


@dataclass(frozen=True)
class Chords:
    """Chords between spheres along isotropic uniform lines through one tile, with standard errors of the sampling of lines."""

    edges: np.ndarray  # (B + 1,)
    # density, density_error: (B,) whose integral is 1
    density: np.ndarray
    density_error: np.ndarray
    # mean, mean_error: of the chords; `exact` is 4 V_void/S
    mean: float
    mean_error: float
    exact: float
    # spread, spread_error: <z^2>/(2 <z>^2), 1 for an exponential law
    spread: float
    spread_error: float
    lines: int  # number of chords; `cut` of them were followed no further than 1000 mean chords
    cut: int
    error: float  # largest relative standard error of the mean and of any bin with at least 1/64 of the chords


def chord_edges(mean: float) -> np.ndarray:
    """Bins of chords: 31 of equal share under an exponential law, then tails of halving share down to 2^-12; (40,)."""
    survival = np.concatenate([np.arange(31, 0, -1) / 32, 0.5 ** np.arange(6, 13)])
    return np.concatenate([[0.0], -mean * np.log(survival), [9 * mean]])


def chord_lengths(centers, radii, cell, tolerance: float, stream: Callable, map_tasks: Callable | None = None,
                  most: int = 1 << 26) -> Chords:
    """Distribution of the chords between spheres along isotropic uniform lines.

    centers : (N, 3), radii : (N,), cell : (3,), one unit of length
    tolerance : relative standard error of the mean and of every bin that holds at least 1/64 of the chords
    stream : task index -> numpy Generator; a task draws its lines from its own
    map_tasks : `[function(*task) for task in tasks]`, in order, on any workers; one by one if not given
    most : chords at most; beyond, the errors say what was reached

    A line that leaves a sphere does so uniformly in area and with the cosine of the angle: chords are started that way and
    followed to the next sphere, through as many repeats of the tile as it takes.  There is no bias from ends of lines.
    """
    from bakery.physics.packing import _chords, cells

    centers, radii, cell = (np.ascontiguousarray(a, float) for a in (np.mod(centers, cell), radii, cell))
    exact = float(mean_chord(fraction(radii, cell), radii))
    edges, limit = chord_edges(exact), 1000 * exact
    m = np.maximum(np.floor(cell / (0.8 * (np.prod(cell) / len(radii)) ** (1 / 3))), 1).astype(np.int64)
    share = np.cumsum(radii**2) / np.sum(radii**2)
    tile = _chords.Tile(centers, radii, share, cell, m, *cells.tile_grid(centers, radii, cell, m)[:2])
    map_tasks = map_tasks or (lambda function, tasks: [function(*task) for task in tasks])
    counts, sums, longest, cut, tasks = np.zeros(edges.size - 1, np.int64), np.zeros(_chords.MOMENTS), 0.0, 0, 0
    target = 8
    while tasks < target:
        for block in map_tasks(_block, [(stream, index, (tile, edges, limit)) for index in range(tasks, target)]):
            counts, sums, longest, cut = counts + block[0], sums + block[1], max(longest, block[2]), cut + block[3]
        tasks = target
        lines = int(counts.sum())
        p, z = counts / lines, sums / lines
        full = p >= 1 / 64
        variance = max((z[1] - z[0] ** 2) / z[0] ** 2, np.max((1 - p[full]) / p[full], initial=0))
        target = max(min(math.ceil(variance / tolerance**2 / _LINES), most // _LINES), tasks)
    edges[-1] = max(edges[-1], longest * (1 + 1e-12))
    width = np.diff(edges)
    spread = z[1] / (2 * z[0] ** 2)
    # delta method: d spread = dz2 / (2 z^2) - z2 dz / z^3
    a, b = 1 / (2 * z[0] ** 2), -z[1] / z[0] ** 3
    of_spread = a**2 * (z[3] - z[1] ** 2) + 2 * a * b * (z[2] - z[0] * z[1]) + b**2 * (z[1] - z[0] ** 2)
    return Chords(edges, p / width, np.sqrt(np.maximum(p * (1 - p), 1 / lines) / lines) / width,
                  float(z[0]), math.sqrt(max(z[1] - z[0] ** 2, 0) / lines), exact, float(spread),
                  math.sqrt(max(of_spread, 0) / lines), lines, int(cut), math.sqrt(variance / lines))


def _block(stream, index, arguments):
    from bakery.physics.packing import _chords

    return _chords.chords(stream(index).random((_LINES, 5)), *arguments)


def _octant(position, cell):
    """Which of the eight half-cells each position (..., 3) lies in."""
    half = np.floor(2 * np.mod(position, cell) / cell).astype(int) % 2
    return half @ np.array([4, 2, 1])


def _between_octants(values, octant):
    """Standard error of the means of values (N, B) over spheres, from the sums over eight sub-volumes; (B,)."""
    count = len(values)
    away = values - values.mean(axis=0)
    sums = np.stack([np.bincount(octant, column, 8) for column in away.T], axis=1)
    return np.sqrt(np.sum(sums**2, axis=0) * 8 / 7) / count
