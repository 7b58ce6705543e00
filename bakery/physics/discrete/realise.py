"""Stored realisations: independent places in a box, class by class, block by block.

A medium of independent particles is a Poisson process.  Given how many there are, classes are multinomial and places are
independent of each other and of the classes; so each class is drawn for itself, slab of cells by slab of cells, each slab with a
random stream of its own.  Blocks are fixed by the inputs, and memory is that of the result and of a few blocks.

Where the density is not the same everywhere, candidates are kept with the chance of the relative density at their place.  There
are six standard deviations more of them than needed, and what is left over is taken away at random, which leaves the law alone.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bakery import rng
from bakery.physics.discrete._places import sorted_by_cell
from bakery.physics.tasks import in_turn

BLOCK = 1 << 18  # candidates in a block: 3 MB of places
_TOGETHER = 32  # blocks whose results are held at once
LEAST_VOLUME = 1e-4  # share of the box below which rejection would throw nearly everything away
_TRIES = 8


@dataclass(frozen=True)
class Region:
    """Where particles are: a box from the origin, and in it everything, a grid of densities, or the inside of a mesh."""

    edge: tuple[float, float, float]  # (3,) m
    # (X, Y, Z) relative density 0 to 1 at the middles of the voxels, trilinear in between, constant in the outer halves
    density: np.ndarray | None = None
    # vertices, faces: (V, 3) m, (F, 3), a closed mesh inside the box, wound outward
    vertices: np.ndarray | None = None
    faces: np.ndarray | None = None

    @property
    def whole(self) -> bool:
        """Whether the density is that of the box everywhere."""
        return self.density is None and self.vertices is None

    @cached_property
    def volume(self) -> float:
        """Integral of the relative density, m^3; exact."""
        if self.vertices is not None:
            from bakery.physics.shapes.quality import volume

            return volume(self.vertices, self.faces)
        # each value counts for its own voxel: the interpolant's hats, and the constant outer halves, all have that integral
        share = 1.0 if self.density is None else float(np.mean(self.density, dtype=np.float64))
        return math.prod(self.edge) * share

    def at(self, position):
        """Relative density (n,) at places (n, 3) m inside the box; what renderers ask."""
        from bakery.physics.discrete.region import region_densities

        return region_densities(self._compiled, position)

    @cached_property
    def _compiled(self):
        from bakery.physics.discrete import region

        if self.vertices is not None:
            return region.region_mesh(self.vertices, self.faces)
        if self.whole:
            return region.region_box(np.zeros(3), self.edge)
        return region.region_grid(np.zeros(3), self.edge, self.density)


class NoRoom(ValueError):
    """A region that fills next to nothing of its box."""


@dataclass(frozen=True)
class _Slab:
    """Candidates of one class in some layers of its cells: indices of their random stream, how many, which cells."""

    stream: tuple[int, int, int]  # class, slab, attempt
    candidates: int
    first: int  # cells along x, from first to before last
    last: int
    cells: tuple[int, int, int]
    extra: int = 0  # how many of those that the density keeps are taken away again


def numbers(seed: int, share, expected: float, count: int | None = None):
    """How many particles of each class there are, (K,).

    share : (K,) of the number, adds up to 1;  expected : mean number;  count : exactly so many in all; None: as chance has it
    """
    share = np.asarray(share, float)
    random = rng.generator(seed, "discrete.numbers")
    total = int(random.poisson(expected)) if count is None else int(count)
    return random.multinomial(total, share / math.fsum(share))


def realised(region: Region, number, seed: int, map: Callable = in_turn,
             report: Callable[[float], None] = lambda share: None):
    """Places of so many particles of each class.

    region : where they are
    number : (K,) from `numbers`
    map : `map(function, tasks)` -> list in the order of the tasks
    report : takes the share of the work that is done

    Returns position : (N, 3) float32 m, class by class; those of a class cell by cell, row-major (x slowest), about one particle
        a cell
    Raises NoRoom : the region fills too little of its box for rejection
    """
    filled = region.volume / math.prod(region.edge)
    if filled < LEAST_VOLUME:
        raise NoRoom(f"fills {filled:.2g} of its box, where {LEAST_VOLUME:g} or more would do")
    position = np.empty((int(np.sum(number)), 3), np.float32)
    slabs = []
    for k, n in enumerate(number):
        slabs += _slabs(region, int(n), k, 0, seed, int(n)) if region.whole else _kept(region, int(n), k, filled, seed, map)
    done = 0
    for start in range(0, len(slabs), _TOGETHER):
        for batch in map(_places, [(region, seed, slab) for slab in slabs[start:start + _TOGETHER]]):
            position[done:done + len(batch)] = batch
            done += len(batch)
        report(min(1.0, (start + _TOGETHER) / len(slabs)))
    return position


def _slabs(region, candidates, k, attempt, seed, number):
    """Candidates of class k spread over slabs of cells; `number` decides the cells."""
    if candidates == 0:
        return []
    side = (region.volume / max(number, 1)) ** (1 / 3)
    cells = tuple(int(min(max(1, round(edge / side)), max(number, 1))) for edge in region.edge)
    count = min(cells[0], math.ceil(candidates / BLOCK))
    wall = np.arange(count + 1) * cells[0] // count
    shared = rng.generator(seed, "discrete.slabs", k, attempt).multinomial(candidates, np.diff(wall) / cells[0])
    return [_Slab((k, i, attempt), int(n), int(wall[i]), int(wall[i + 1]), cells) for i, n in enumerate(shared) if n]


def _kept(region, number, k, filled, seed, map):
    """Slabs of which rejection leaves just so many particles: all are counted once before they are drawn to stay."""
    if number == 0:
        return []
    for attempt in range(_TRIES):
        # six standard deviations are too few once in 1e9 times, and then twice as many are tried
        spare = (6 * math.sqrt(number) + 20) * 2**attempt
        slabs = _slabs(region, math.ceil((number + spare) / filled), k, attempt, seed, number)
        counts = np.array(map(_count, [(region, seed, slab) for slab in slabs]))
        if counts.sum() >= number:
            extra = rng.generator(seed, "discrete.extra", k, attempt).multivariate_hypergeometric(
                counts, int(counts.sum()) - number, method="marginals")
            return [replace(slab, extra=int(n)) for slab, n in zip(slabs, extra)]
    raise NoRoom(f"keeps fewer places than its volume, {region.volume:.3g} m^3, lets expect")


def _count(region, seed, slab):
    """How many candidates the density keeps."""
    return len(_candidates(region, seed, slab)[0])


def _places(region, seed, slab):
    """Places (n, 3) float32 m of a slab, by cells."""
    position, random = _candidates(region, seed, slab)
    if slab.extra:
        position = np.delete(position, random.choice(len(position), slab.extra, replace=False), axis=0)
    out = np.empty_like(position)
    sorted_by_cell(position, slab.first, slab.last, np.array(slab.cells), np.array(region.edge, float), out)
    return out


def _candidates(region, seed, slab):
    """Places (n, 3) float32 m that the density keeps, and the random stream after them."""
    random = rng.generator(seed, "discrete.places", *slab.stream)
    unit = random.random((slab.candidates, 3), np.float32).astype(float)
    unit[:, 0] = (slab.first + unit[:, 0] * (slab.last - slab.first)) / slab.cells[0]
    edge = np.array(region.edge, float)
    top = edge.astype(np.float32)
    top = np.where(top >= edge, np.nextafter(top, np.float32(0)), top)  # a place lies inside the box, rounded or not
    position = np.minimum((unit * edge).astype(np.float32), top)
    if not region.whole:
        position = position[random.random(len(position)) < region.at(position.astype(float))]
    return position, random
