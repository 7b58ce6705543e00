"""Stage `packing`: periodic tiles of hard spheres, what they look like, and what lies between the spheres."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import numpy as np

from bakery import rng
from bakery.errors import StageError
from bakery.stages import rules
from bakery.stages.declaration import ANY, Cost, Knob, Output, Result, Stage, datasets, later
from bakery.stages.packing.section import PACKING, radii_law
from bakery.stages.packing.view import tiles
from bakery.store.tree import Dataset, Group

LEAST_GAP = -1e-9  # of the mean diameter: less is rounding, more an overlap
ORDERED = 6  # times what random directions give: dense random tiles have up to 4
_CHORDS = 1.8e6  # chords a second and core
_LOADING = 0.7  # seconds
_KERNELS = ("packing._kernels", "packing._chords")
_TILE = (
    Output("centers", "(N, 3)", "1", "centres of the spheres, in mean radii, from 0 to the edges of the cell"),
    Output("radii", "(N,)", "1", "radii of the spheres over their mean"),
    Output("cell", "(3,)", "1", "edges of the periodic cell, in mean radii"),
    Output("fraction", "(1,)", "1", "share of the cell in spheres", within=(0, 1)),
    Output("fraction_wished", "(1,)", "1", "share that the recipe asks for", within=(0, 1)),
    Output("smallest_gap", "(1,)", "1", "smallest distance of two surfaces, in mean diameters", within=ANY),
    Output("contacts_per_sphere", "(1,)", "1", "mean number of gaps below 1e-3 mean diameters a sphere"),
    Output("contacts_per_sphere_error", "(1,)", "1", "standard error of contacts_per_sphere, between tiles of the kind"),
    Output("rattlers", "(1,)", "1", "share of spheres with fewer than four contacts, other such spheres not counted"),
    Output("bond_order", "(1,)", "1", "global Q6 of bonds up to 1.4 contact distances: 0.57 in fcc, 0.48 in hcp crystals"),
    Output("bond_order_random", "(1,)", "1", "Q6 of as many bonds in random directions"),
    Output("bond_order_local", "(1,)", "1", "mean over spheres of q6 of their own bonds"),
    Output("pressure", "(1,)", "1", "PV/NkT at the end of the dynamics", optional=True),
    Output("pair_correlation/edges", "(P + 1,)", "1", "edges of the bins of r", optional=True),
    Output("pair_correlation/r", "(P,)", "1", "distance of centres in mean radii, middle of the bin", optional=True),
    Output("pair_correlation/g", "(P,)", "1", "density of centres over the mean density, mean over the shell", optional=True),
    Output("pair_correlation/g_error", "(P,)", "1", "standard error of g, between tiles of the kind", optional=True),
    Output("chord_length/edges", "(C + 1,)", "1",
           "edges of the bins of length, in mean radii; the last is the longest chord seen"),
    Output("chord_length/density", "(C,)", "1", "density of chords between spheres along isotropic lines, mean over the bin"),
    Output("chord_length/density_error", "(C,)", "1", "standard error of density, from the number of lines"),
    Output("chord_length/mean", "(1,)", "1", "mean chord in mean radii"),
    Output("chord_length/mean_error", "(1,)", "1", "standard error of mean, from the number of lines"),
    Output("chord_length/mean_exact", "(1,)", "1", "4 V/S, volume outside over surface of the spheres"),
    Output("chord_length/second_moment", "(1,)", "1", "mean square over twice the squared mean: 1 for an exponential law"),
    Output("chord_length/second_moment_error", "(1,)", "1", "standard error of second_moment, from the number of lines"),
    Output("chord_length/cut", "(1,)", "1", "share of the chords that were followed no further than 1000 mean chords"),
)
OUTPUTS = tuple(replace(output, path=prefix + output.path, optional=True)
                for prefix in ("", "TILE/") for output in _TILE)
_REQUIRED = tuple(output.path for output in _TILE if not output.optional)


# ---- tiles of a group


def tile_name(fraction: float) -> str:
    """Name of a tile in a dictionary: its wished fraction in percent, `f60`, `f62_5`."""
    return f"f{100 * fraction:g}".replace(".", "_")


def nearest_denser(group: Group, fraction: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """The least dense tile that fills at least a fraction of its cell, with the cell widened until it fills just that.

    Parameters
    ----------
    group : `packing`, one tile or a dictionary
    fraction : 1, wished

    Returns
    -------
    centers : (N, 3), radii : (N,), cell : (3,) in mean radii; positions are scaled, radii are not
    name : of the tile, "" where there is only one

    Raises
    ------
    ValueError : no tile is as dense
    """
    fractions = {name: float(tile["fraction"].data[0]) for name, tile in tiles(group).items()}
    dense = {name: f for name, f in fractions.items() if f >= fraction * (1 - 1e-9)}
    if not dense:
        raise ValueError(f"found no tile as dense as {fraction:g}; the densest fills {max(fractions.values(), default=0):.4g}")
    name = min(dense, key=dense.get)
    tile = tiles(group)[name]
    wider = (dense[name] / fraction) ** (1 / 3) if dense[name] > fraction else 1.0
    return tile["centers"].data * wider, tile["radii"].data, tile["cell"].data * wider, name


# ---- recipe


def _radii(packing) -> np.ndarray:
    from bakery.physics.packing import radii

    law = radii_law(packing.radii)
    if law.distribution == "lognormal":
        return radii.lognormal(law.sigma, packing.count)
    if law.distribution == "list":
        return radii.species(*zip(*law.of, strict=True), packing.count)
    return np.ones(packing.count)


def inputs(recipe, upstream) -> dict:
    packing = recipe.packing
    return {"fractions": tuple(sorted(packing.fraction)), "radii": _radii(packing), "cell": packing.cell,
            "growth": packing.growth, "equilibration": packing.equilibration, "seed": packing.seed}


def _schedule(tolerance: float, growth: float | None, equilibration: int | None):
    """Growth and rest of the spheres: by the tolerance unless the recipe says otherwise."""
    from bakery.physics.packing import SCHEDULES

    chosen = SCHEDULES["draft" if tolerance >= 0.1 else "preview" if tolerance >= 0.03 else "final"]
    if growth is not None:
        faster = growth / min(rate for _, rate in chosen.growth)
        # top: the growth that is asked for holds for dense tiles too
        chosen = replace(chosen, growth=tuple((until, min(rate * faster, 1.0)) for until, rate in chosen.growth), top=1.0)
    return chosen if equilibration is None else replace(chosen, equilibrate=equilibration)


def _seconds(arguments: dict, tolerance: float) -> list[float]:
    """Expected seconds of one core for the dynamics of each tile."""
    from bakery.physics.packing import predicted

    spread = float(np.std(arguments["radii"]) / np.mean(arguments["radii"]))
    schedule = _schedule(tolerance, arguments["growth"], arguments["equilibration"])
    return [predicted(f, arguments["radii"].size, spread, schedule) for f in arguments["fractions"]]


def _measuring(count: int, tolerance: float) -> float:
    """Expected seconds of one core for chords and neighbours of a tile."""
    return 64 / tolerance**2 / _CHORDS + 1.6e-4 * count


def cost(recipe) -> Cost:
    arguments = inputs(recipe, {})
    count, number = arguments["radii"].size, len(arguments["fractions"])
    by_tile = _seconds(arguments, recipe.tolerance)
    packing = sum(by_tile)
    seconds = packing + number * _measuring(count, recipe.tolerance)
    return Cost(seconds, (3000.0 + 200.0 * number) * count + 8e7, number * (34.0 * count + 9e3),
                f"{number} tile{'s' * (number > 1)} of {count:,} spheres: {packing:.2g} s of one core for the dynamics, "
                f"{seconds - packing:.2g} s for chords and neighbours; {_LOADING:g} s to load kernels", _LOADING,
                kernels=_KERNELS, most=seconds / max(by_tile))  # a tile is packed on one core


# ---- work


class _Watch:
    """How far the tiles of one bake are; told from the threads that pack them."""

    def __init__(self, context, wished, weight):
        self.context, self.wished, self.weight = context, wished, np.asarray(weight, float)  # share of all work in each tile
        self.share, self.stopped = np.zeros(len(wished)), False

    def tell(self, k: int, fraction: float, pressure: float, share: float) -> None:
        if self.stopped:
            raise KeyboardInterrupt
        self.share[k] = share
        # a gas of which no spheres have met yet has no pressure to tell
        against = f", pressure {pressure:.3g}" if math.isfinite(pressure) else ""
        self.context.report(float(self.share @ self.weight), None,
                            f"fraction {fraction:.3f} of {self.wished[k]:g}{against}")


_watches: dict[int, _Watch] = {}
_numbers = itertools.count()


@contextmanager
def _watched(context, wished, weight):
    """A number under which tasks find the watch, if they run in this process; on the way out they are told to stop."""
    number = next(_numbers)
    _watches[number] = _Watch(context, wished, weight)
    try:
        yield number
    finally:
        _watches.pop(number).stopped = True


def _packed(number, k, fraction, radii, cell, seed, schedule):
    """One tile; a task that any worker may run."""
    from bakery.physics.packing import pack

    watch = _watches.get(number)

    def report(reached, pressure, share):
        if watch:
            watch.tell(k, reached, pressure, share)

    return pack(fraction, radii, cell, seed=seed, schedule=schedule, report=report)


def _stream(seed: int, block: int):
    """The random stream of a task of chords; the same for each tile of a dictionary, which does not depend on the others."""
    return rng.generator(seed, "packing.chords", block)


def compute(inputs: dict, context) -> Result:
    schedule = _schedule(context.tolerance, inputs["growth"], inputs["equilibration"])
    fractions = inputs["fractions"]
    seconds = np.array(_seconds(inputs, context.tolerance))
    weight = seconds / (seconds.sum() + len(seconds) * _measuring(inputs["radii"].size, context.tolerance))
    with _watched(context, np.array(fractions), weight) as number:
        packed = context.map(_packed, [(number, k, f, inputs["radii"], inputs["cell"], inputs["seed"], schedule)
                                       for k, f in enumerate(fractions)])
    members, notes, missed, reached = {}, [], [], 0.0
    for k, tile in enumerate(packed):
        name = tile_name(tile.wished)
        if tile.status == "crystal":
            raise StageError(f"fraction {tile.wished:g}: {tile.reason}; nothing is stored. A larger packing.growth, more spheres "
                             "or several sizes would do")
        members[name], error = _measured(tile, inputs["seed"], context)
        reached = max(reached, error)
        if not tile.reached:
            missed.append(f"fraction {tile.wished:g} was not reached: {tile.reason}; stored is the tile of fraction "
                          f"{tile.fraction:.5g}. A smaller packing.growth, more spheres or another packing.seed may come closer")
        order, random = (float(members[name][path].data[0]) for path in ("bond_order", "bond_order_random"))
        if order > max(ORDERED * random, 0.1):
            notes.append(f"fraction {tile.wished:g}: bond order Q6 is {order:.2g} where random directions give {random:.2g}: "
                         f"{len(tile.radii)} spheres order themselves in so small a cell; more would not")
        cut = members[name]["chord_length/cut"].data[0]
        if cut:
            notes.append(f"fraction {tile.wished:g}: {cut:.2g} of the chords are longer than 1000 mean chords: {len(tile.radii)} "
                         "spheres leave straight corridors through all tiles")
        context.report(1 - (1 - weight.sum()) * (1 - (k + 1) / len(packed)), reached)
    if len(packed) == 1:
        members = next(iter(members.values())).members
    return Result(members, reached, tuple(notes), tuple(missed))


def _measured(tile, seed: int, context) -> tuple[Group, float]:
    """A tile's group, and the error in the stage's measure."""
    from bakery.physics.packing import structure

    form = (tile.centers, tile.radii, tile.cell)
    count = len(tile.radii)
    touching, order = structure.contacts(*form), structure.bond_order(*form)
    chords = structure.chord_lengths(*form, context.tolerance, partial(_stream, seed), context.map)
    values = {
        "centers": tile.centers, "radii": tile.radii, "cell": tile.cell, "fraction": [structure.fraction(tile.radii, tile.cell)],
        "fraction_wished": [tile.wished], "smallest_gap": [structure.smallest_gap(*form)],
        "contacts_per_sphere": [touching.mean], "contacts_per_sphere_error": [touching.error], "rattlers": [touching.rattlers],
        "bond_order": [order.q6], "bond_order_random": [order.random(count)], "bond_order_local": [order.local],
    }
    if math.isfinite(tile.pressure):
        values["pressure"] = [tile.pressure]
    members: dict[str, Dataset | Group] = dict(datasets(_TILE, {name: np.asarray(v, float) for name, v in values.items()}))
    if count > 1:
        g2 = structure.pair_correlation(*form, structure.shells(*form[1:]))
        members["pair_correlation"] = Group(datasets(_TILE, {
            "edges": g2.edges, "r": 0.5 * (g2.edges[1:] + g2.edges[:-1]), "g": g2.g, "g_error": g2.g_error}, "pair_correlation/"))
    single = {"mean": chords.mean, "mean_error": chords.mean_error, "mean_exact": chords.exact, "second_moment": chords.spread,
              "second_moment_error": chords.spread_error, "cut": chords.cut / chords.lines}
    members["chord_length"] = Group(datasets(_TILE, {
        "edges": chords.edges, "density": chords.density, "density_error": chords.density_error,
        **{name: np.array([value]) for name, value in single.items()}}, "chord_length/"))
    return Group(members), max(abs(tile.fraction - tile.wished) / tile.wished, chords.error)


# ---- rules


def sound(group: Group) -> Iterable[str]:
    """Whether each tile is complete, its spheres have room in it, and its bins ascend."""
    by_name = tiles(group)
    if not by_name:
        yield "holds no tile"
    for name, tile in by_name.items():
        v = {path: member.data for path, member in tile.walk() if isinstance(member, Dataset)}
        missing = [path for path in _REQUIRED if path not in v]
        faults = [f"{', '.join(missing)} missing"] if missing else [*_room(v["centers"], v["radii"], v["cell"]), *_bins(v)]
        yield from (f"{name}: {fault}" if name else fault for fault in faults)


def _room(centers, radii, cell) -> Iterable[str]:
    """Whether spheres (N, 3), (N,) can lie in a cell (3,) at all.

    What searches for neighbours takes time and memory by the number of spheres in reach; this holds it down without a search.
    """
    if not radii.size or not (radii > 0).all() or not (cell > 0).all():
        yield "radii and cell are not above 0"
    elif abs(radii.mean() - 1) > 1e-12:
        yield f"the mean radius is {radii.mean():.15g}, not the unit 1"
    elif cell.min() < 2 * radii.max() * (1 + 2 * LEAST_GAP):
        yield "a sphere that overlaps its own images: cell is smaller than its diameter"
    elif (centers < 0).any() or (centers >= cell).any():
        yield "a centre outside of the cell"
    elif 4 / 3 * np.pi * np.sum(radii**3) > np.prod(cell) * (1 + 1e-9):
        yield "centers, radii: more spheres than the cell has room for"
    else:
        kind = np.floor(np.log2(radii / radii.min())).astype(int)
        for of in np.unique(kind):
            ours = kind == of
            # two centres in a cube are at most its diagonal apart, here just below the distance of two of these spheres
            cube = (2 * radii[ours].min() - 4e-9) / np.sqrt(3)
            _, number = np.unique(np.floor(centers[ours] / cube), axis=0, return_counts=True)
            if number.max() > 1:
                yield f"centers: two spheres overlap, {number.max()} centres lie where one has room"
                return


def _bins(v: Mapping[str, np.ndarray]) -> Iterable[str]:
    edges = v["chord_length/edges"]
    if edges[0] != 0 or not (np.diff(edges) > 0).all():
        yield "chord_length: edges do not ascend from 0, one more than density has bins"
    if "pair_correlation/g" in v and not (np.diff(v.get("pair_correlation/edges", np.zeros(2))) > 0).all():
        yield "pair_correlation: edges do not ascend, one more than g has bins"


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `packing` group, in words."""
    by_name = tiles(group)
    if not by_name:
        yield "holds no tile"
    for name, tile in by_name.items():
        yield from (f"{name}: {fault}" if name else fault for fault in _check_tile(tile))


def _check_tile(tile: Group) -> Iterable[str]:
    from bakery.physics.packing import structure, theory

    v = {path: np.asarray(member.data, float) for path, member in tile.walk() if isinstance(member, Dataset)}
    faults = list(rules.complete(v, _REQUIRED))
    yield from faults
    if faults:
        return
    centers, radii, cell = v["centers"], v["radii"], v["cell"]
    if radii.ndim != 1 or not radii.size or centers.shape != (radii.size, 3) or cell.shape != (3,) \
            or not (radii > 0).all() or not (cell > 0).all():
        yield "centers, radii and cell are not (N, 3), (N,) and (3,), radii and cell above 0"
        return
    faults = list(_room(centers, radii, cell))
    yield from faults
    if faults:
        return
    gap = structure.smallest_gap(centers, radii, cell)
    if not gap >= LEAST_GAP:
        yield f"two spheres overlap by {-gap:.2g} mean diameters"
    if abs(gap - v["smallest_gap"][0]) > 1e-12 * max(1, abs(gap)):
        yield f"smallest_gap is not that of the spheres, {gap:.6g}"
    filled = structure.fraction(radii, cell)
    if abs(v["fraction"][0] / filled - 1) > 1e-12:
        yield f"fraction is not the volume of the spheres over that of the cell, {filled:.15g}"
    yield from _check_shares(v)
    edges, density = v["chord_length/edges"], v["chord_length/density"]
    if edges.shape != (density.size + 1,) or edges[0] != 0 or not (np.diff(edges) > 0).all():
        yield "chord_length: edges do not ascend from 0, one more than density has bins"
        return
    total = float(np.sum(density * np.diff(edges)))
    if abs(total - 1) > 1e-12:
        yield f"chord_length: density integrates to {total:.15g}, not 1"
    exact = float(theory.mean_chord(filled, radii))
    if abs(v["chord_length/mean_exact"][0] / exact - 1) > 1e-12:
        yield f"chord_length: mean_exact is not 4 V/S = {exact:.15g}"
    # six standard errors: a false alarm in 5e8 tiles; a chord cut off makes the mean too small by an unknown amount
    if v["chord_length/cut"][0] == 0 and abs(v["chord_length/mean"][0] - exact) > 6 * v["chord_length/mean_error"][0]:
        yield f"chord_length: mean is more than six standard errors away from 4 V/S = {exact:.6g}"


def _check_shares(v: Mapping[str, np.ndarray]) -> Iterable[str]:
    for name in ("rattlers", "bond_order", "bond_order_local", "bond_order_random", "chord_length/cut"):
        if not 0 <= v[name][0] <= 1 + 1e-12:
            yield f"{name} outside 0 .. 1"
    positive = ("contacts_per_sphere", "pressure", "pair_correlation/g", "chord_length/density")
    for name, value in v.items():
        if (name in positive or name.endswith("_error")) and (value < 0).any():
            yield f"{name} below 0"
    if "pair_correlation/g" in v:
        edges, g = v.get("pair_correlation/edges", np.zeros(0)), v["pair_correlation/g"]
        if edges.shape != (g.size + 1,) or not (np.diff(edges) > 0).all():
            yield "pair_correlation: edges do not ascend, one more than g has bins"
        elif g[edges[1:] < 2 * v["radii"].min() * (1 + LEAST_GAP)].any():
            yield "pair_correlation: pairs closer than the two smallest spheres"


# ---- how far from converged


def measures(found: Group, reference: Group) -> Mapping[str, float]:
    """Errors of a `packing` group against a converged one: of each measure the largest over the tiles.

    Returns
    -------
    dict of floats, in this order

    error : the largest of `fraction`, `mean_chord` and `second_moment`
    fraction : |reached - wished| over wished
    mean_chord : relative difference from the exact mean chord at the wished fraction
    second_moment : difference of <z^2>/(2<z>^2): the shape of the law of chords
    g2 : root mean square difference over shells of 0.4 mean radii, up to where both tiles reach
    """
    from bakery.physics.packing import theory

    errors = {"fraction": 0.0, "mean_chord": 0.0, "second_moment": 0.0, "g2": 0.0}
    for name, true in tiles(reference).items():
        own = tiles(found)[name]
        wished = float(true["fraction_wished"].data[0])
        exact = float(theory.mean_chord(wished, own["radii"].data))
        chords, converged = own["chord_length"], true["chord_length"]
        for key, value in (
            ("fraction", abs(own["fraction"].data[0] / wished - 1)),
            ("mean_chord", abs(chords["mean"].data[0] / exact - 1)),
            ("second_moment", abs(chords["second_moment"].data[0] - converged["second_moment"].data[0])),
            ("g2", _difference(own, true)),
        ):
            errors[key] = max(errors[key], float(value))
    return {"error": max(errors["fraction"], errors["mean_chord"], errors["second_moment"])} | errors


def _difference(own: Group, true: Group) -> float:
    if "pair_correlation" not in own.members or "pair_correlation" not in true.members:
        return 0.0
    edges = [tile["pair_correlation/edges"].data for tile in (own, true)]
    low, high = max(e[0] for e in edges), min(e[-1] for e in edges)
    common = np.arange(low, high + 1e-9, 0.4)
    if common.size < 2:
        return 0.0
    pairs = []
    for tile, e in zip((own, true), edges):
        below = np.concatenate([[0], np.cumsum(tile["pair_correlation/g"].data * np.diff(e**3))])
        pairs.append(np.diff(np.interp(common**3, e**3, below)) / np.diff(common**3))
    return float(np.sqrt(np.mean((pairs[0] - pairs[1]) ** 2)))


STAGE = Stage(
    name="packing",
    version=2,
    title="periodic tiles of packed spheres",
    reads=("tolerance", "packing"),
    needs=(),
    applies=lambda recipe: recipe.packing is not None,
    sections=(PACKING,),
    outputs=OUTPUTS,
    error_measure="largest of |fraction reached - wished| / wished and, of the chords between spheres, the relative standard "
                  "errors of the mean and of every bin with at least 1/64 of them; what other tiles of the kind would differ by "
                  "in g2 and in contacts stands beside these and falls with packing.count only",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    sound=sound,
    knobs=(
        Knob("tolerance", "tolerance", 0.01, "error of the law of chords; and how slowly spheres grow, where growth is auto",
             ("10%", "3%", "1%")),
        Knob("count", "packing.count", 500, "spheres in a tile", ("125", "250", "500", "1000", "2000", "4000")),
        Knob("growth", "packing.growth", "auto", "growth of diameters over thermal speed where it is slowest",
             ("0.2", "0.05", "0.02", "0.008", "0.003")),
        Knob("equilibration", "packing.equilibration", "auto", "collisions a sphere at the final size, up to fraction 0.5",
             ("0", "10", "30", "100", "300")),
    ),
    measures=measures,
    reference={"packing.count": "8000", "packing.growth": "auto", "packing.equilibration": "auto"},
    pictures=later("bakery.stages.packing.pictures:pictures"),
    files=later("bakery.stages.packing.files:csv_tables"),
)
