"""Light among packed grains by brute force: random walks through a periodic tile of them, without end: `walk`.

Every copy of the tile holds its own grains in its own rotations (`packing.instances`).  What the walks show of the medium that is
to stand for the grains, and the figures' definitions: docs/random-walk.md.
"""

import itertools
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bakery import rng
from bakery.physics.grains.bvh import Mesh
from bakery.physics.grains.figures import WithErrors, in_order
from bakery.physics.grains.surface import DIELECTRIC, Surface
from bakery.physics.grains.walk import EVENTS_MAX
from bakery.physics.granular import _packed as kernel
from bakery.physics.granular.exemplars import exemplars
from bakery.physics.packing.cells import counts, tile_grid
from bakery.physics.packing.instances import cumulated_shares
from bakery.physics.packing.structure import fraction, smallest_gap
from bakery.physics.packing.theory import mean_chord
from bakery.physics.tasks import in_turn

REPLICATES = 32
HITS_MAX = 1 << 27
WINDOW_MIN, WINDOW_OVER, WINDOW_REACH = 16, 4.0, 5.0  # shortest window; over M / <step^2>; reach in radii: see `_window`
_LENGTH, _LONGER, _LENGTH_MAX = 512, 8, 1 << 18  # hits of a walk
_WARM = 64  # hits that come before, where surfaces lose light
_BLOCK = 1 << 16  # hits of a task, about
_LIMIT = 1e5  # longest flight between two spheres, in mean ones
_STRAIGHT = 0.2  # drift with windows twice as long beyond which M has no value
_GAP = -1e-9  # of the mean diameter: so much spheres may overlap by rounding


@dataclass(frozen=True)
class Grain:
    """A type of grain in its bounding sphere of radius 1; whatever has a `mesh` and a `surface` will do too (`walk.Walker`)."""

    surface: Surface  # from `bakery.physics.grains.surface`
    mesh: Mesh | None = None  # closed, inside the unit sphere; None for an exact ball
    radius: float = 1.0  # of the ball, up to 1


@dataclass(frozen=True)
class Walks(WithErrors):
    """Means over the walks, in the unit of the tile; figure X has its standard error as X_error."""

    hit_probability: float  # share of the entered spheres whose grain is hit
    # void_chord, second_moment: mean flight z from sphere to sphere, and <z^2>/(2 <z>^2)
    void_chord: float
    second_moment: float
    # flight, flight_second: mean path from leaving the sphere of one hit to entering that of the next, and mean square
    flight: float
    flight_second: float
    # lambda_s, lambda_o: mean displacement from entry to exit of a hit's sphere along the incoming and the outgoing direction
    lambda_s: float
    lambda_o: float
    mean_square: float  # mean squared distance from entry to exit
    g: float  # mean cosine of a hit
    correlation: float  # between the lengths of successive flights, -1 to 1
    mean_square_displacement: float  # M, a hit, at long times
    lambda_t: float  # flight + lambda_s, the mean free path of the medium
    mean_square_rte: float  # 2 lambda_t^2 / (1 - g): M of that medium
    mean_square_tele: float  # M of a medium in which light is teleported and successive flights know nothing of each other
    drift: float  # relative change of M with windows twice as long: its bias, with an error of its own
    # windows, by_window: (W,) hits n, and M from windows of n and 2n
    windows: np.ndarray
    by_window: np.ndarray
    window: int  # the n that M is taken from
    void_chord_exact: float  # 4 V/S of the tile
    hits: int
    walks: int
    length: int  # hits of a walk
    events: float  # mean meetings with the surface of a hit
    # lost, contradicted, cut: hits that were drawn again because a rough surface kept the light, because inside and outside did
    # not agree, because they met the surface too often; over all hits
    lost: float
    contradicted: float
    cut: float
    given_up: float  # share of the walks that ended before their time and count nowhere
    achieved_error: float  # relative standard error of sqrt(M)
    reached: bool  # whether it meets the tolerance
    reason: str  # why not, in words
    errors: dict[str, float | np.ndarray] = field(repr=False)


def walk(tile, grains, weights=None, *, seed, tolerance, hits=None, depth=EVENTS_MAX, map: Callable | None = None,
         report: Callable[[float, float], None] | None = None) -> Walks:
    """Random walks of light through the grains of a tile, repeated without end in all directions.

    tile : centers (N, 3), radii (N,), cell (3,): spheres that do not overlap, in a periodic cuboid; from `packing.pack`
    grains : (T) types of grain, each with `mesh` (None: an exact ball) and `surface`; their unit sphere is the tile's sphere
    weights : (T,) share of each type in the number; equal ones if not given
    seed : whole number >= 0; the same one gives the same bytes, on any number of threads.  Grains are those of `instances(seed)`
    tolerance : relative standard error of sqrt(M) to be reached, 1e-4 to 1
    hits : stop at about so many, but not before 2^15; 2^27 if not given
    depth : meetings with the surface after which a hit is drawn again
    map : `map(function, tasks)` returns [function(*task) for task in tasks]
    report : called with the share of the work that is done and the error reached so far

    Raises ValueError : before any work

    Light is not absorbed: reflectances, conductors' losses and interiors are left out.  Where a rough surface would keep the
    light, the hit is drawn again from the same entry, so the figures are those of light that goes on.
    Errors: jackknife over 32 replicates.  They do not hold what another tile of the same kind would differ by.

    >>> from bakery.physics.grains.surface import dielectric
    >>> from bakery.physics.packing import pack
    >>> tile = pack(0.3, np.ones(100), seed=1, schedule="draft")
    >>> walks = walk((tile.centers, tile.radii, tile.cell), [Grain(dielectric(1.5))], seed=1, tolerance=0.05)
    >>> bool(walks.mean_square_displacement_error < 0.1 * walks.mean_square_displacement)  # the tolerance is that of the root
    True
    """
    scene = _checked(tile, grains, weights, seed, tolerance, depth)
    map = map or in_turn
    most = HITS_MAX if hits is None else max(int(hits), 1)
    warm = _WARM if any(g.surface.roughness > 0 for g in scene.grains) else 0
    endless = _endless(scene)
    length, done, sums, count = _LENGTH, 0, None, 2  # count: walks of a replicate in this round
    while True:
        block = max(1, _BLOCK // (length + warm))
        tasks = [(scene, replicate, start, min(block, done + count - start), length, warm)
                 for replicate in range(REPLICATES) for start in range(done, done + count, block)]
        new = in_order(np.stack(map(run, tasks)).reshape(REPLICATES, -1, len(_windows(length)) + kernel.SUMS))
        sums, done = (new if sums is None else sums + new), done + count
        walks, short = _result(sums, length, scene, tolerance, endless)
        if report is not None:
            report(min(1.0, (tolerance / max(walks.achieved_error, 1e-300)) ** 2), walks.achieved_error)
        remaining = most // REPLICATES - done * length  # hits of a replicate that may still be walked
        if walks.reached or endless or walks.given_up == 1:
            return walks
        # not where light keeps its direction for longer than the longest walks can tell: M is 2 lambda^2/(1 - g) where it is
        # large, and its window WINDOW_OVER M/<step^2>, with <step^2> of at most 2 lambda^2
        if short and length < _LENGTH_MAX and remaining >= 2 * _LONGER * length \
                and (1 - walks.g) * _windows(_LENGTH_MAX)[-3] >= WINDOW_OVER:
            length, done, sums, count = _LONGER * length, 0, None, 2
            continue
        if remaining < length or walks.achieved_error == math.inf:
            return walks
        missing = math.ceil(done * min(1.0, 1.1 * (walks.achieved_error / tolerance) ** 2 - 1))
        count = max(1, min(missing, remaining // length))


def run(scene, replicate, first, count, length, warm):
    """Sums of walks first ... first + count - 1 of a replicate."""
    return kernel.walks(*scene.arrays, np.uint64(replicate), first, count, length, warm)


def _windows(length):
    """Windows n of walks of so many hits: powers of two up to a quarter of them."""
    return 1 << np.arange(int(math.log2(length)) - 1)


# ---- figures


def _window(M, steps, windows, radius):
    """Index of the window to take M from, or -1 where none is long enough.

    Directions are forgotten over about M / (2 <step^2>) hits, exponentially: eight times that leaves 5e-5 of M out.  Light that
    goes to and fro must come away from where it was, too.  Windows of twice n must be there for M, of four times n for its drift.
    """
    for j, n in enumerate(windows[:-2]):
        if n >= WINDOW_MIN and n >= WINDOW_OVER * M[j] / max(steps, 1e-300) and n * M[j] >= (WINDOW_REACH * radius) ** 2:
            return j
    return -1


def _figures(total, windows, radius, j=None):
    """Figures of sums over replicates (SUMS + W,); j : index of M's window, found if not given."""
    counted = total[kernel.WALKS] - total[kernel.GIVEN_UP]
    n, chords = max(total[kernel.HITS], 1.0), max(total[kernel.VOIDS], 1.0)
    squares = total[kernel.SUMS:] / max(counted, 1.0)
    z1, z2 = total[kernel.FLIGHT] / n, total[kernel.FLIGHT2] / n
    out = {"hit_probability": total[kernel.HITS] / max(total[kernel.ENTRIES], 1.0), "void_chord": total[kernel.VOID] / chords,
           "flight": z1, "flight_second": z2,
           "lambda_s": total[kernel.ALONG] / n, "lambda_o": total[kernel.ACROSS] / n, "mean_square": total[kernel.SQUARE] / n,
           "g": total[kernel.COSINE] / n}
    out["second_moment"] = total[kernel.VOID2] / chords / max(2 * out["void_chord"] ** 2, 1e-300)
    pairs = max(total[kernel.HITS] - counted, 1.0)
    out["correlation"] = (total[kernel.NEXT] / pairs - z1 * z1) / max(z2 - z1 * z1, 1e-300)
    s, away = out["lambda_s"], 1 - out["g"]
    away = away if away > 1e-12 else 0.0  # undeflected, but for rounding
    out["lambda_t"] = z1 + s
    ahead = (z1 + s) / away if away else math.inf
    out["mean_square_rte"] = 2 * (z1 + s) * ahead
    out["mean_square_tele"] = z2 + 2 * z1 * s + out["mean_square"] + 2 * ahead * (z1 * out["g"] + s)
    slope = np.diff(squares) / windows[:-1]
    j = _window(slope, squares[0], windows, radius) if j is None else j
    out["by_window"] = slope
    out["mean_square_displacement"] = slope[j]
    out["drift"] = slope[j + 1] / slope[j] - 1 if slope[j] > 0 else np.nan
    return out, j


def _result(sums, length, scene, tolerance, endless):
    """Figures with errors, and whether longer walks are needed."""
    windows = _windows(length)
    total = np.zeros(sums.shape[1])
    for part in sums:
        total += part
    values, j = _figures(total, windows, scene.radius)
    short = j < 0
    if short:  # the longest window, all the same
        values, j = _figures(total, windows, scene.radius, len(windows) - 3)
    one_less = [_figures(total - part, windows, scene.radius, j)[0] for part in sums]
    errors = {name: _jackknife(np.array([figures[name] for figures in one_less])) for name in values}
    M, spread, reason = values["mean_square_displacement"], errors["mean_square_displacement"], ""
    if total[kernel.WALKS] == total[kernel.GIVEN_UP]:
        spread, reason = math.inf, "no walk came to its end: light does not get out of these grains, or meets none"
    elif endless:
        M, spread, reason = math.inf, math.inf, endless
    elif short and not values["drift"] < _STRAIGHT:
        spread, reason = math.inf, f"light keeps its direction for more than {windows[j]} hits: M is more than what was found"
    elif short:
        spread = math.hypot(spread, 2 * M * values["drift"])
        reason = f"M is from windows of {windows[j]} hits, shorter than it takes; its error holds what longer ones may change"
    values["mean_square_displacement"], errors["mean_square_displacement"] = M, spread
    error = 0.5 * spread / M if 0 < M < math.inf else math.inf
    if not reason and error > tolerance:
        reason = f"the error of sqrt(M) is {error:.2g} after {int(total[kernel.HITS])} hits"
    n, walks = max(total[kernel.HITS], 1.0), total[kernel.WALKS]
    plain = {name: value if np.ndim(value) else float(value) for name, value in values.items()}
    result = Walks(**plain, windows=windows[:-1], window=int(windows[j]), void_chord_exact=scene.exact,
                  hits=int(total[kernel.HITS]), walks=int(walks), length=length, events=float(total[kernel.EVENTS] / n),
                  lost=float(total[kernel.LOSSES] / n), contradicted=float(total[kernel.CONTRADICTIONS] / n),
                  cut=float(total[kernel.CUTS] / n), given_up=float(total[kernel.GIVEN_UP] / walks), achieved_error=float(error),
                  reached=not reason, reason=reason, errors=errors)
    return result, short


def _endless(scene):
    """In words why the light of these grains has no M; "" where it has one."""
    if all(grain.surface.kind == DIELECTRIC and grain.surface.index == 1 for grain in scene.grains):
        return "grains of the host's index turn no light: it flies on for ever, and M is infinite"
    axes = open_planes(scene.centers, scene.radii, scene.cell)
    if axes is not None:
        return (f"planes {axes} of the tile pass between its spheres: flights along them have no mean square, and M grows "
                "without end; a tile of more spheres would do")
    return ""


def open_planes(centers, radii, cell):
    """Miller indices up to 2 of lattice planes that meet no sphere of a periodic tile; None where there are none.

    Light flies far along them: the chance of a flight longer than z falls as 1/z^2 only (Bourgain, Golse & Wennberg 1998).
    """
    for axes in itertools.product(range(-2, 3), repeat=3):
        if axes <= (0, 0, 0) or math.gcd(*axes) > 1:
            continue
        half = radii * np.linalg.norm(np.divide(axes, cell))
        begin = np.mod((centers / cell) @ np.array(axes, float) - half, 1.0)
        order = np.argsort(begin, kind="stable")
        begin, end = begin[order], begin[order] + 2 * half[order]
        reach = np.maximum(np.maximum.accumulate(end), end.max() - 1)  # what lies beyond 1 covers the beginning too
        if np.any(np.append(begin[1:], 1 + begin[0]) > reach):
            return axes
    return None


def _jackknife(batches):
    """Standard error from figures (replicates, ...) with one replicate left out in turn."""
    if not np.all(np.isfinite(batches)):
        return math.inf
    return np.sqrt((len(batches) - 1) / len(batches) * np.sum((batches - batches.mean(0)) ** 2, axis=0))


# ---- what the loops take


class _Scene:
    """The tile and its grains; pickled without the trees and lists that follow from them."""

    def __init__(self, centers, radii, cell, grains, shares, seed, depth):
        self.centers, self.radii, self.cell, self.grains, self.shares = centers, radii, cell, grains, shares
        self.seed, self.depth = seed, depth
        self.exact = float(mean_chord(fraction(radii, cell), radii))
        self.radius = float(np.sum(radii**3) / np.sum(radii**2))  # that light meets on average
        self._arrays, self._lock = None, threading.Lock()

    @property
    def arrays(self):
        """Arguments of `kernel.walks` before those that tell walks apart."""
        with self._lock:
            if self._arrays is None:
                self._arrays = self._tile_grains_key()
        return self._arrays

    def _tile_grains_key(self):
        m = counts(self.cell, len(self.radii))
        grid = (self.cell, m, *tile_grid(self.centers, self.radii, self.cell, m))
        area = np.cumsum(self.radii**2) / np.sum(self.radii**2)
        key = rng.key(self.seed, "granular.walk")
        return (kernel.Tile(self.centers, self.radii, area, grid, _LIMIT * self.exact),
                kernel.Grains(self.shares, *exemplars(self.grains), np.uint64(self.seed), self.depth),
                (np.uint64(key[0]), np.uint64(key[1])))

    def __getstate__(self):
        return self.centers, self.radii, self.cell, self.grains, self.shares, self.seed, self.depth

    def __setstate__(self, state):
        self.__init__(*state)


def _checked(tile, grains, weights, seed, tolerance, depth):
    centers, radii, cell, grains, shares = checked_tile(*tile, grains, weights, seed)
    if not 1e-4 <= tolerance <= 1:
        raise ValueError(f"tolerance {tolerance:g}: 1e-4 to 1 are possible")
    if depth < 1:
        raise ValueError(f"depth {depth}: at least 1 is needed")
    return _Scene(centers, radii, cell, grains, shares, int(seed), int(depth))


def checked_tile(centers, radii, cell, grains, weights, seed):
    """A tile and its grains as the loops take them: centers, radii, cell, grains, cumulated shares.

    Raises ValueError : spheres overlap, grains or shares are missing, a seed is none
    """
    # copies can be written to: for arrays that cannot, as those of an asset, the loops would be compiled anew
    centers, radii, cell = (np.array(a, float, order="C") for a in (centers, radii, cell))
    if radii.ndim != 1 or not radii.size or centers.shape != (radii.size, 3) or cell.shape != (3,):
        raise ValueError(f"centers {centers.shape}, radii {radii.shape}, cell {cell.shape}: (N, 3), (N,) and (3,) are needed")
    if not (np.all(np.isfinite(centers)) and np.all((radii > 0) & np.isfinite(radii)) and np.all((cell > 0) & np.isfinite(cell))):
        raise ValueError("centers must be finite, radii and cell finite and above 0")
    if 2 * radii.max() > cell.min() * (1 - _GAP):
        raise ValueError(f"the cell's shortest edge is {cell.min():.6g}; a sphere of diameter {2 * radii.max():.6g} would meet "
                         "its own image")
    centers = np.mod(centers, cell)
    if smallest_gap(centers, radii, cell) < _GAP:
        raise ValueError("spheres overlap: light would be in two grains at once")
    grains = tuple(grains)
    if not grains or not all(hasattr(grain, "surface") and hasattr(grain, "mesh") for grain in grains):
        raise ValueError("grains: at least one is needed, each with a surface and a mesh (None for a ball)")
    for grain in grains:
        if grain.mesh is None and not 0 < grain.radius <= 1:
            raise ValueError(f"a ball of radius {grain.radius:g}: more than 0 and up to 1 (the bounding sphere) is possible")
    shares = cumulated_shares(np.ones(len(grains)) if weights is None else weights)
    if len(shares) != len(grains):
        raise ValueError(f"{len(shares)} weights for {len(grains)} types of grain")
    if not 0 <= int(seed) < 1 << 64:
        raise ValueError(f"seed {seed}: 0 to 2^64 - 1 is possible")
    return centers, radii, cell, grains, shares
