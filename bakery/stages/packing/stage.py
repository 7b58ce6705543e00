"""Stage `packing`: periodic tiles of hard spheres, what they look like, and what lies between the spheres."""

import itertools
import math
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import numpy as np

from bakery import rng
from bakery.errors import StageError
from bakery.stages.declaration import Cost, Knob, Result, Stage, datasets, later
from bakery.stages.packing.measures import measures
from bakery.stages.packing.outputs import OUTPUTS, TILE, TOGETHER
from bakery.stages.packing.rules import check, sound
from bakery.stages.packing.section import PACKING, radii_law
from bakery.stages.packing.view import tile_name
from bakery.store.tree import Dataset, Group

ORDERED = 6  # times what random directions give: dense random tiles have up to 4
_CHORDS = 1.8e6  # chords a second and core
_LOADING = 0.3  # seconds
_KERNELS = ("packing._lists", "packing._queue", "packing._events", "packing.cells", "packing._chords")


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
    # of each tile of a dictionary the same random streams: it does not depend on the others
    chords = structure.chord_lengths(*form, context.tolerance, partial(rng.generator, seed, "packing.chords"), context.map)
    values = {
        "centers": tile.centers, "radii": tile.radii, "cell": tile.cell, "fraction": [structure.fraction(tile.radii, tile.cell)],
        "fraction_wished": [tile.wished], "smallest_gap": [structure.smallest_gap(*form)],
        "contacts_per_sphere": [touching.mean], "contacts_per_sphere_error": [touching.error], "rattlers": [touching.rattlers],
        "bond_order": [order.q6], "bond_order_random": [order.random(count)], "bond_order_local": [order.local],
    }
    if math.isfinite(tile.pressure):
        values["pressure"] = [tile.pressure]
    members: dict[str, Dataset | Group] = dict(datasets(TILE, {name: np.asarray(v, float) for name, v in values.items()}))
    if count > 1:
        g2 = structure.pair_correlation(*form, structure.shells(*form[1:]))
        members["pair_correlation"] = Group(datasets(TILE, {
            "edges": g2.edges, "r": 0.5 * (g2.edges[1:] + g2.edges[:-1]), "g": g2.g, "g_error": g2.g_error}, "pair_correlation/"))
    single = {"mean": chords.mean, "mean_error": chords.mean_error, "mean_exact": chords.exact, "second_moment": chords.spread,
              "second_moment_error": chords.spread_error, "cut": chords.cut / chords.lines}
    members["chord_length"] = Group(datasets(TILE, {
        "edges": chords.edges, "density": chords.density, "density_error": chords.density_error,
        **{name: np.array([value]) for name, value in single.items()}}, "chord_length/"))
    return Group(members), max(abs(tile.fraction - tile.wished) / tile.wished, chords.error)


STAGE = Stage(
    name="packing",
    version=2,
    title="periodic tiles of packed spheres",
    reads=("tolerance", "packing"),
    needs=(),
    applies=lambda recipe: recipe.packing is not None,
    sections=(PACKING,),
    outputs=OUTPUTS,
    together=TOGETHER,
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
