"""Tables of a solution, by an error-driven quadtree: a cell is divided where interpolation misses the lobe at its middle."""

import math
from dataclasses import replace

import numpy as np

from bakery import rng
from bakery.physics.multiple import basis as bases
from bakery.physics.multiple import budget, frame, locate, lookup, point, segment
from bakery.physics.multiple.kinds import POINT, SEGMENT
from bakery.physics.multiple.table import STEPS, Table, between, empty, fill, quantised, scales, shape
from bakery.physics.multiple.tree import ASPECT, COARSE
from bakery.system.memory import give_back

MOST_EXTENT = 200.0  # mfp
OUTSIDE = 1e-5  # share of the light beyond which no table goes
LENGTH = 2.0  # mfp of the tabulated segment
TOLERANCE = 2e-3
COUNTS = (0, 7, 15, 23, 31)  # functions of a basis; with a_0 whole vectors of a processor
_FINE = 6  # depth of the smallest cells
_SOLVED = 0.9  # of the solver's longest distance: room for the length of a segment
_SAMPLE = 300  # places for the basis
_DARKEST = 1e-6  # of the mean over directions, 1/sr: below it a lobe is noise of the solver
_LEAST = 1e-3  # of the integral of the absolute value
_NOTHING = 1e-300  # what is scattered where a double holds no less
_NEAR = 0.05  # mfp from the ends of the source; nearer ones count in proportion
_TOGETHER = 32  # lobes, in double precision half a megabyte
_TESTS, _RINGS = 480, 30  # places of the error estimate, and different distances among them


def extent_needed(medium, share=1e-4):
    """m beyond which less than this share of the light of a point source is scattered, mfp; 1 to 200.

    Where less than everything is absorbed within 200 mean free paths, the tail beyond goes on with k0.
    """
    if medium.albedo == 0:
        return 1.0
    r = np.exp(medium.log_r)
    shell = np.maximum(medium.scaled[0] * np.exp(-medium.k0 * r), 0) * r**2  # light in a step of ln r
    if not shell.sum() > 0:
        return 1.0  # less than a double holds
    outside = np.cumsum(shell[::-1])[::-1] / shell.sum()
    beyond = r[np.argmax(outside < share)] if outside[-1] < share else r[-1]
    return float(np.clip(beyond, 1.0, MOST_EXTENT))


def coefficients(medium, kind, length, rho, z):
    """Harmonic coefficients (N, (L + 1)(L + 2)/2) of the lobes in the frames of positions (N,)."""
    rho = np.maximum(rho, frame.CLOSEST)
    if kind == POINT:
        return point.coefficients(medium, np.hypot(rho, z), np.arctan2(rho, z))
    return segment.coefficients(medium, rho, z, length, np.arctan2(rho, z))


def table(solution, kind, *, extent, length=LENGTH, tolerance=TOLERANCE, most=COUNTS[-1], finest=_FINE, seed=0) -> Table:
    """The table of a solution.

    solution : from `solution.solve`
    kind : POINT or SEGMENT
    extent : mfp; the table ends earlier where less than `OUTSIDE` of the light is left
    length : of the segment, mfp
    tolerance : error of a lobe between corners that is aimed at, root mean square over directions
    most : functions of the basis, at most
    finest : depth of the smallest cells: 2^finest in each direction of the square
    seed : of the places where the basis and the error are taken

    Returns Table : its `error` says what was reached; empty (no corner) where nothing scatters
    Raises ValueError : extent or length out of range
    """
    medium, length = solution.medium, float(length) if kind == SEGMENT else 0.0
    if not 0.5 <= extent <= MOST_EXTENT:
        raise ValueError(f"the table's extent is {extent:g} mean free paths; 0.5 to {MOST_EXTENT:g} will do")
    if kind == SEGMENT and not 0.1 <= length <= 10:
        raise ValueError(f"the tabulated segment is {length:g} mean free paths long; 0.1 to 10 will do")
    if medium.albedo == 0:
        return empty(kind, length, extent, medium.k0)
    extent = min(float(extent), extent_needed(medium, OUTSIDE), _SOLVED * float(np.exp(medium.log_r[-1])))
    return _Build(solution, (kind, length, extent), (tolerance, most, finest), seed).run()


class _Build:
    """source : kind, length, extent;  limits : tolerance, most, finest;  all as of `table`"""

    def __init__(self, solution, source, limits, seed):
        self.solution, self.medium = solution, solution.medium
        self.kind, self.length, self.extent = source
        self.tolerance, self.most, self.finest = limits
        self.shape = shape(self.medium.order)
        self.solid_angle = frame.solid_angles(self.shape).ravel()
        self.polar = frame.polar(np.linspace(0, 1, self.shape[0]))
        self.azimuth = np.linspace(0, np.pi, self.shape[1])
        self.directions = point.directions(self.medium.order, self.polar, self.azimuth)
        self.random = rng.generator(seed, "multiple.places", self.kind)

    def run(self) -> Table:
        size = 1 << self.finest
        self.size = np.array([size, ASPECT * size])
        coarse = np.argwhere(np.ones((2 ** COARSE + 1, ASPECT * 2 ** COARSE + 1))) * (size >> COARSE)
        leaves = self.plant()
        middle = np.array([self.bounds[leaf] for leaf in leaves])[:, ::2] + (size >> COARSE + 1)
        first = np.concatenate([coarse, middle[:len(middle) if self.finest > COARSE else 0]])
        sample = self.random.permutation(len(first))[:_SAMPLE]
        tests = places(self.kind, self.length, self.extent, self.random)
        rho, z = self.positions(first)
        give_back()  # 40 to 70 MB that the solver or the table before has freed
        at_once = self.kind == SEGMENT  # a table of the point source is shared
        rho, z = (np.append(rho, tests[0]), np.append(z, tests[1])) if at_once else (rho, z)
        c = coefficients(self.medium, self.kind, self.length, rho, z)
        lobe, integral, near = self.normalised(first, c[:len(first)])
        of_tests = c[len(first):].copy()
        del c  # the largest array, of which the tests' are needed once more
        give_back()
        self.choose(lobe[sample].astype(float), near[sample])
        values = np.full((*(self.size + 1), len(self.basis)), np.nan)
        exact = self.represent(lobe, integral)
        values[tuple(coarse.T)] = exact[:len(coarse)]
        if self.finest > COARSE:
            middles = (exact[len(coarse):], lobe[len(coarse):].copy(), near[len(coarse):])
            del lobe
            self.divide(values, leaves, *middles)
        corner = np.argwhere(~np.isnan(values[:, :, 0]))
        of_tests = of_tests if at_once else coefficients(self.medium, self.kind, self.length, *tests)
        return self.measured(self.pack(corner, values[tuple(corner.T)]), *tests, of_tests)

    def positions(self, lattice):
        return frame.position(self.kind, self.length, self.extent, *(lattice / self.size).T)

    def sample(self, lattice):
        """Coefficients a (N, K + 1), lobes (N, D) and how much places near the source count (N,)."""
        c = coefficients(self.medium, self.kind, self.length, *self.positions(lattice))
        lobe, integral, near = self.normalised(lattice, c)
        return self.represent(lobe, integral), lobe, near

    def normalised(self, lattice, c):
        """Normalised lobes (N, D) float32, integrals over the singular part, and how much places near the source count."""
        rho, z = self.positions(lattice)
        # rounding of the solver can leave less than nothing where a forward peak is a thousand times brighter ahead
        integral = np.sqrt(4 * np.pi) * c[:, 0]
        lobes = np.empty((len(c), len(self.solid_angle)), np.float32)
        for of in _blocks(len(c)):
            lobe = point.lobes_at(c[of], self.directions).reshape(len(c[of]), -1)
            integral[of] = np.maximum(integral[of], _LEAST * (np.abs(lobe) * self.solid_angle).sum(axis=1))
            # next to nothing is scattered (albedo 1e-12, far away), less than a double holds: lobes without light are even
            integral[of] = np.maximum(integral[of], _NOTHING)
            lobes[of] = np.maximum(lobe / integral[of, None], _DARKEST)
        ends = np.minimum(np.hypot(rho, z), np.hypot(rho, z - self.length))
        return lobes, integral / locate.measure(self.kind, self.length, rho, z)[1], np.minimum(1.0, ends / _NEAR)

    def choose(self, lobe, near):
        """The smallest basis that represents the sample to its share of the tolerance."""
        logs, weight = np.log(lobe), bases.weights(lobe, self.solid_angle)
        first = bases.start(logs, weight, self.most)
        for count in [k for k in COUNTS if k <= self.most]:
            self.basis = quantised(bases.improved(first[:count + 1], logs, weight))
            a = bases.coefficients(logs, weight, self.basis)
            error = near * bases.distance(logs - self.basis[0], a, weight, self.basis)
            if np.sqrt((error**2).mean()) < budget.BASIS * self.tolerance:
                break

    def represent(self, lobe, integral):
        """a_0 .. a_K, with a_0 such that the integral over directions is exact."""
        a = np.empty((len(lobe), len(self.basis)))
        for of in _blocks(len(lobe)):
            block = lobe[of].astype(float)
            a[of] = bases.coefficients(np.log(block), bases.weights(block, self.solid_angle), self.basis)
        a[:, 0] = np.log(integral)
        return a

    def missed(self, lobe, off):
        """Errors (N,) of lobes (N, D) whose coefficients (N, K + 1) are off by so much."""
        error = np.empty(len(lobe))
        for of in _blocks(len(lobe)):
            weight = bases.weights(lobe[of].astype(float), self.solid_angle)
            error[of] = bases.distance(np.zeros_like(weight), off[of], weight, self.basis)
        return error

    def plant(self):
        """The tree down to the coarsest cells; their numbers."""
        size = 1 << self.finest
        self.bounds, self.child = [(0, size, root * size, (root + 1) * size) for root in range(ASPECT)], [-1] * ASPECT
        leaves = list(range(ASPECT))
        for _ in range(COARSE):
            leaves = self.quarter(leaves)
        return np.array(leaves)

    def quarter(self, leaves):
        """Divides cells; the numbers of their children, four of each."""
        after = []
        for leaf in leaves:
            lower, right, low, _ = self.bounds[leaf]
            half = (right - lower) // 2
            self.child[leaf] = len(self.bounds)
            for u in (lower, lower + half):
                for v in (low, low + half):
                    after.append(len(self.bounds))
                    self.bounds.append((u, u + half, v, v + half))
                    self.child.append(-1)
        return after

    def divide(self, values, leaves, exact, lobe, near):
        """Divides cells, corners into `values`, from what is at the middles of the leaves: coefficients, lobes and nearness."""
        for depth in range(COARSE, self.finest):
            half = (1 << self.finest) >> depth + 1
            cells = np.array([self.bounds[leaf] for leaf in leaves]).reshape(-1, 4)
            middle = cells[:, ::2] + half
            guess = between(fill(values[::2 * half, ::2 * half]))[tuple(middle.T // half)]
            error = near * self.missed(lobe, exact - guess)
            split = error > self.tolerance
            if not split.any():
                return
            values[tuple(middle[split].T)] = exact[split]
            edges = np.concatenate([cells[split, ::2] + half * np.array(at) for at in ((0, 1), (1, 0), (2, 1), (1, 2))])
            edges = np.unique(edges, axis=0)
            edges = edges[np.isnan(values[edges[:, 0], edges[:, 1], 0])]
            leaves = np.array(self.quarter(leaves[split]))
            # what is expected to be good enough is not looked at, nor what is as fine as it gets
            leaves = leaves[np.repeat(error[split], 4) > budget.GAIN * self.tolerance] if half > 1 else leaves[:0]
            after = np.array([self.bounds[leaf] for leaf in leaves], int).reshape(-1, 4)[:, ::2] + half // 2
            wanted = np.concatenate([edges, after])
            if not len(wanted):
                return
            del lobe
            exact, lobe, near = self.sample(wanted)
            values[tuple(edges.T)] = exact[:len(edges)]
            exact, lobe, near = exact[len(edges):], lobe[len(edges):], near[len(edges):]
            if not len(leaves):
                return

    def pack(self, corner, a):
        """Rounds, and makes the integrals of the rounded lobes exact."""
        while not (corner & 1).any():
            corner >>= 1
        scale = np.maximum(np.abs(a[:, 1:]).max(axis=0), 1e-30) / STEPS
        whole = np.rint(a[:, 1:] / scale.astype(np.float32)).astype(np.int16)
        offset = np.empty(len(a))
        for of in _blocks(len(a)):
            stored = np.exp(self.basis[0] + bases.combine(whole[of] * scale.astype(np.float32).astype(float), self.basis[1:]))
            offset[of] = a[of, 0] - np.log((stored * self.solid_angle).sum(axis=1))
        basis_scale = scales(self.basis)
        bounds = np.array(self.bounds) / np.repeat(self.size, 2)
        return Table(self.kind, self.length, self.extent, self.medium.k0, bounds.astype(np.float32),
                     np.array(self.child, np.int32), corner.astype(np.int16), offset.astype(np.float32), whole,
                     scale.astype(np.float32),
                     np.rint(self.basis / basis_scale[:, None].astype(float)).astype(np.int16).reshape(-1, *self.shape),
                     basis_scale)

    def measured(self, table, rho, z, c):
        """The table with its error, measured at positions (N,) where the lobes have coefficients c."""
        error = _errors(table, self.medium.order, rho, z, c)
        nearest = np.clip(z, 0, self.length)
        r, angle = np.hypot(rho, z - nearest), np.arctan2(rho, z - nearest)
        total = np.hypot(error, self.solution.error(r, angle))
        return replace(table, error=upper(error**2), error_with_solver=upper(total**2), worst=float(error.max()))


def _blocks(count):
    """Slices of so many lobes, a few at a time: all of them in double precision would take most of the memory."""
    return [slice(n, n + _TOGETHER) for n in range(0, count, _TOGETHER)]


def places(kind, length, extent, random):
    """Positions of an error estimate: distances logarithmic from 0.1 mfp to the extent in all directions, every eighth close to
    the axis; for a segment every second one beside it, 0.01 to 2 mfp away."""
    low = min(0.1, extent / 2)
    r = np.repeat(low * (extent / low) ** random.random(_RINGS), _TESTS // _RINGS)
    angle = np.pi * random.random(_TESTS)
    angle[::8] = np.where(random.random(_TESTS // 8) < 0.5, 0.0, np.pi) + 0.3 * (2 * random.random(_TESTS // 8) - 1)
    rho, z = np.abs(r * np.sin(angle)), r * np.cos(angle)
    if kind == SEGMENT:
        beside = slice(1, None, 2)
        rho[beside] = 0.01 * 200 ** random.random(_TESTS // 2)
        z[beside] = length * random.random(_TESTS // 2)
        inside = locate.measure(kind, length, rho, z)[0] <= extent
        rho, z = rho[inside], z[inside]
    return rho, z


def errors(table, medium, rho, z):
    """Relative error of the table's lobes at positions (N,): root mean square over directions that are not the basis's."""
    return _errors(table, medium.order, rho, z, coefficients(medium, table.kind, table.length, rho, z))


def between_directions(order):
    """polar (A,), azimuth (B,), weights (A,) of directions that are not the basis's."""
    count = max(24, int(0.75 * order))
    x, gauss = np.polynomial.legendre.leggauss(count)
    return np.arccos(x), (np.arange(count // 2) + 0.37) * np.pi / (count // 2), gauss


def _errors(table, order, rho, z, c):
    polar, azimuth, weight = between_directions(order)
    table, grid = lookup.ready(table), point.directions(order, polar, azimuth)
    return np.concatenate([_apart(point.lobes_at(c[of], grid), lookup.lobes(table, rho[of], z[of], polar, azimuth),
                                  weight[:, None]) for of in _blocks(len(c))])


def _apart(exact, tabulated, weight):
    """Relative differences (N,) of lobes (N, A, B), root mean square over directions of such weights (A, 1)."""
    # squares of what is scattered far away in a dark medium are less than a double holds: in units of a power of two, exactly
    largest = np.abs(exact).max(axis=(1, 2))
    exponent = -np.frexp(largest)[1][:, None, None]
    exact, tabulated = np.ldexp(exact, exponent), np.ldexp(tabulated, exponent)
    norm = (weight * exact**2).sum(axis=(1, 2))
    nonzero = largest > _NOTHING
    return np.where(nonzero, np.sqrt((weight * (tabulated - exact) ** 2).sum(axis=(1, 2)) / np.where(nonzero, norm, 1.0)), 0.0)


def upper(square, least=0.0):
    """Root of a mean over places, plus three of its standard errors; the mean is at least that of `least`."""
    mean = max(float(np.mean(square)), float(np.mean(least)))
    return math.sqrt(max(mean + 3 * float(np.std(square)) / math.sqrt(len(square)), 0.0))
