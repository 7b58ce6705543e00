"""A virtual goniometer over packed grains: light that a half space or a layer of them sends back and lets through.

Light falls on the tile of a packing, repeated without end, of which the grains are there whose centres lie below a plane, as
renderers have it.  The plane lies anywhere in the tile, and each walk has grains and rotations of its own (`packing.instances`):
means are over surfaces of one arrangement.  Of a layer the grains are there whose centres lie no deeper below that plane than
its thickness; a matt plane under it touches the lowest that there may be.  Nothing about a medium is assumed.  Light is told by
orders and by pairs of directions: an order is one hit of a grain, or of that plane, that deflects light; whatever light does
inside of a grain's bounding sphere belongs to it.
"""

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass

import numpy as np

from bakery import rng
from bakery.physics.grains.figures import in_order
from bakery.physics.grains.surface import DIELECTRIC, DIFFUSE
from bakery.physics.grains.walk import EVENTS_MAX
from bakery.physics.granular import _goniometer as kernel
from bakery.physics.granular._packed import Grains, Tile
from bakery.physics.granular.exemplars import exemplars
from bakery.physics.granular.packed import checked_tile
from bakery.physics.packing.cells import counts, tile_grid
from bakery.physics.surfaces.fit import forgotten

CELLS = (48, 8, 8)  # along the coordinates of `surfaces.pairs`
BINS = 16  # of the root of the cosine of incidence
LEAST = math.sqrt(kernel.STEEPEST)  # root of the cosine where they begin; they end at 1
REPLICATES = 16
# hits over 1 - g, and at least, after which light is late, and of walks most end; times that, after which the others do.  By half
# as many what leaves in higher orders is half as wrong again (clear balls)
LATE, LEAST_LATE, LATEST = 4, 8, 16
# of a layer L transport lengths thick, extrapolated faces included, further hits over (1 - g) L^2: the slowest mode falls by 1/e
_SLOWEST, _EXTRAPOLATED = 0.304, 1.42
_LIMIT = 1e5  # longest flight between two spheres, in mean ones
_BLOCK = 1 << 13  # walks of a task that goes to the second order, four times that of others


@dataclass(frozen=True)
class Counts:
    """Light that left at one side, of C channels; the last axis of `cells` numbers those of `CELLS`, that of others the bins."""

    cells: np.ndarray  # (R, 3, C, K) share of the light of a walk, by order: first, second, higher; sums over walks
    entered: np.ndarray  # (R, 3, C, B) the same, by bin of entry
    # walks, walks_through: (R, B) all walks, and those that go beyond the second order, which alone count higher ones
    walks: np.ndarray
    walks_through: np.ndarray
    deeper: np.ndarray  # (R, C, B) light of the latter that the first two orders did not bring out
    inside: np.ndarray  # (C,) share of the higher orders that counts as leaving like late light, as its walks had ended
    straight: np.ndarray  # (R, C, B) light of all walks that left below undeflected
    sums: np.ndarray  # (R, 5) of all walks: hits, walks, given up, contradicted, cut


@dataclass(eq=False)
class Goniometer:
    """A half space or a layer of packed grains, at wavelengths that share the paths of light.

    Attributes
    ----------
    centers, radii, cell : the tile of `packed.walk`;  grains, weights, seed, depth : as of that
    mu : (T, C) absorption coefficient of the interiors, in 1/unit of the tile's lengths
    channels : (T, 2, C) of the surfaces, as `surface.Surface` has them; C columns each
    g : mean cosine of a hit, from which follows when light has forgotten where it came from
    decay : (C,) with which light deep inside falls off towards the surface, 1/unit; 0 where nothing is absorbed
    stream : tells random numbers of several apart
    surface : lowest and highest place of the plane in the cell's height, 0 to 1
    thickness : in the tile's unit, between the planes that hold the centres; inf: a half space
    base : (C,) albedos of a matt plane under a layer; None: air
    """

    centers: np.ndarray
    radii: np.ndarray
    cell: np.ndarray
    grains: Sequence
    weights: Sequence | None = None
    _: KW_ONLY
    mu: np.ndarray
    channels: np.ndarray
    seed: int
    g: float = 0.0
    decay: np.ndarray | float = 0.0
    depth: int = EVENTS_MAX
    stream: int = 0
    surface: tuple[float, float] = (0.0, 1.0)
    thickness: float = math.inf
    base: np.ndarray | None = None

    def __post_init__(self):
        self.centers, self.radii, self.cell, self.grains, self.shares = checked_tile(
            self.centers, self.radii, self.cell, self.grains, self.weights, self.seed)
        self.mu, self.channels = np.array(self.mu, float), np.array(self.channels, float)
        if self.channels.shape != (len(self.grains), 2, self.mu.shape[1]) or len(self.mu) != len(self.grains):
            raise ValueError(f"mu {self.mu.shape}, channels {self.channels.shape}: (T, C) and (T, 2, C) are needed for "
                             f"{len(self.grains)} types of grain")
        self.decay = np.array(np.broadcast_to(np.asarray(self.decay, float), self.mu.shape[1]))
        self.sides = 2 if self.base is None and self.thickness < math.inf else 1
        forward = min(max(1 - self.g, 1e-2), 1)
        self.late = max(LEAST_LATE, math.ceil((LATE + self._slowest(forward)) / forward))
        self._arrays, self._lock = None, threading.Lock()

    def __getstate__(self):
        return {name: value for name, value in self.__dict__.items() if name not in ("_arrays", "_lock")}

    def __setstate__(self, state):
        self.__dict__.update(state, _arrays=None, _lock=threading.Lock())

    @property
    def _mean_flight(self) -> float:
        """Between two spheres."""
        fraction = 4 / 3 * math.pi * np.sum(self.radii**3) / np.prod(self.cell)
        return 4 / 3 * np.sum(self.radii**3) / np.sum(self.radii**2) * (1 - fraction) / fraction

    def _slowest(self, forward: float) -> float:
        """Hits over 1 - g in which light in a layer falls by 1/e, at most; 0 of a half space, which has no such number."""
        if self.thickness == math.inf:
            return 0.0
        # under a base light finds one face alone
        length = self.thickness / self._mean_flight * forward * (3 - self.sides) + _EXTRAPOLATED
        return _SLOWEST * length**2

    @property
    def lossless(self) -> np.ndarray:
        """Whether grains, and what is under them, keep all light (C,)."""
        keeps = np.ones(self.mu.shape[1], bool) if self.base is None else np.asarray(self.base) == 1
        for grain, mu, channels in zip(self.grains, self.mu, self.channels, strict=True):
            if grain.surface.kind == DIELECTRIC:
                keeps &= mu == 0
            elif grain.surface.kind == DIFFUSE:
                keeps &= channels[0] == 1
            else:
                keeps &= np.isinf(channels[0])
            keeps &= grain.surface.roughness == 0
        return keeps

    @property
    def returns(self) -> bool:
        """Whether there are smooth clear balls: before them others send light back to where it came from, as eyes of cats do."""
        return any(grain.mesh is None and grain.surface.kind == DIELECTRIC and grain.surface.roughness == 0
                   for grain in self.grains)

    def arrays(self):
        """Arguments of `_goniometer.counted` before those that tell walks apart."""
        with self._lock:
            if self._arrays is None:
                m = counts(self.cell, len(self.radii))
                grid = (self.cell, m, *tile_grid(self.centers, self.radii, self.cell, m))
                area = np.cumsum(self.radii**2) / np.sum(self.radii**2)
                key = rng.key(self.seed, "granular.goniometer", self.stream)
                self._arrays = (Tile(self.centers, self.radii, area, grid, _LIMIT * self._mean_flight),
                                Grains(self.shares, *exemplars(self.grains), np.uint64(self.seed), self.depth),
                                kernel.Matter(self.mu, self.channels), (np.uint64(key[0]), np.uint64(key[1])))
            return self._arrays

    def counted(self, number: int, first: int, through: bool, map: Callable) -> np.ndarray:
        """Sums (R, ...) of walks first ... first + number - 1 of each replicate; `through`: to their end, else to order two."""
        block = _BLOCK // 4 if through else _BLOCK
        tasks = [(self, replicate, start, min(block, first + number - start), through)
                 for replicate in range(REPLICATES) for start in range(first, first + number, block)]
        return in_order(np.stack(list(map(run, tasks))).reshape(REPLICATES, -1, self.length))

    @property
    def length(self) -> int:
        """Numbers that a task returns."""
        return sum(map(math.prod, self._shapes))

    @property
    def _shapes(self):
        """Of the arrays of `_goniometer.Counted`."""
        channels, of_orders = len(self.decay), (self.sides, kernel.ORDERS, len(self.decay))
        of_bins = channels, BINS
        return ((*of_orders, math.prod(CELLS)), (*of_orders, BINS), (BINS,), of_bins, (channels,), (self.sides, channels),
                (channels,), of_bins, (kernel.SUMS,))

    def unpacked(self, sums):
        """`_goniometer.Counted` of sums (R, ...)."""
        ends = np.cumsum([math.prod(shape) for shape in self._shapes])[:-1]
        parts = zip(np.split(sums, ends, axis=1), self._shapes, strict=True)
        return kernel.Counted(*(part.reshape(-1, *shape) for part, shape in parts))


def run(goniometer: Goniometer, replicate: int, first: int, count: int, through: bool):
    """Sums of walks first ... first + count - 1 of a replicate; a task that any worker may run."""
    tile, grains, matter, key = goniometer.arrays()
    # walks to their end have numbers of their own, whatever the others'
    first += 1 << 40 if through else 0
    height = goniometer.cell[2]
    rules = kernel.Rules(0 if through else 2, goniometer.late, LATEST * goniometer.late, goniometer.depth,
                         np.array(CELLS, np.int64), BINS, goniometer.decay, float(goniometer.thickness), goniometer.sides,
                         np.zeros(0) if goniometer.base is None else np.array(goniometer.base, float), goniometer.returns)
    low, high = goniometer.surface
    return kernel.counted(tile, grains, matter, key, np.uint64(replicate), first, count, (low * height, high * height), rules)


def together(goniometer: Goniometer, short, through) -> tuple[Counts, ...]:
    """What walks to the second order and walks to their end count, at each side.

    Late light has forgotten where it came from.  How much of it leaves at a side is a number, which few walks tell, and by
    reciprocity it leaves to directions as light from them becomes late (`fit.forgotten`).
    """
    a, b = goniometer.unpacked(short), goniometer.unpacked(through)
    mean = np.maximum(b.followed.mean(axis=0), 1e-300)
    late, inside = b.late.mean(axis=0), b.inside.mean(axis=0)
    divided = np.divide(late, late.sum(axis=0), out=np.full(late.shape, 1 / goniometer.sides), where=late.sum(axis=0) > 0)
    # (R, S, C) of late light, what leaves at each side: the ratio of sums, and as each replicate moves it
    leaves = (late + divided * inside) / mean
    leaves = leaves + (b.late + divided * b.inside[:, None] - leaves * b.followed[:, None]) / mean
    entered = np.stack([b.deep * leaves[:, side, :, None] for side in range(goniometer.sides)], axis=1)
    higher = entered.sum(axis=(0, 1, 3)) + b.entered[:, :, kernel.HIGHER].sum(axis=(0, 1, 3))
    held = b.deep.sum(axis=(0, 2)) * inside / mean / np.maximum(higher, 1e-300)
    deeper = b.walks[:, None] - b.straight - b.entered[:, :, : kernel.HIGHER].sum(axis=(1, 2))

    def at(side):
        cells, of_bins = a.cells[:, side].copy(), a.entered[:, side].copy()
        for lower in (kernel.FIRST, kernel.SECOND):  # walks to their end tell of them, too
            cells[:, lower] += b.cells[:, side, lower]
            of_bins[:, lower] += b.entered[:, side, lower]
        cells[:, kernel.HIGHER] *= (b.walks.sum(axis=1) / np.maximum(a.walks.sum(axis=1), 1.0))[:, None, None]
        of_bins[:, kernel.HIGHER] = b.entered[:, side, kernel.HIGHER] + entered[:, side]
        for c in range(cells.shape[2]):
            cells[:, kernel.HIGHER, c] += b.cells[:, side, kernel.HIGHER, c] + forgotten(
                CELLS, LEAST, entered[:, side, c], b.walks)
        return Counts(cells, of_bins, a.walks + b.walks, b.walks, deeper, held, a.straight + b.straight, a.sums + b.sums)

    return tuple(map(at, range(goniometer.sides)))
