"""Stage `multiple`: tables of the light that is scattered three times and more, around a point and a segment source."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from bakery import rng
from bakery.errors import StageError
from bakery.physics.multiple.backward import KEPT, WHOLE, refused
from bakery.physics.multiple.kinds import KINDS
from bakery.stages.declaration import ANY, Cost, Knob, Output, Result, Stage, datasets, later
from bakery.stages.multiple.lookup import QUERIES
from bakery.stages.multiple.section import MULTIPLE
from bakery.stages.multiple.view import tables_of
from bakery.store.tree import Group, text

_TEXTS = (("coordinates", "map from the position to the unit square that the quadtree divides"),
          ("frame", "frame of the directions at a position, and coordinates in it"),
          ("singular", "part that was divided out before interpolation"),
          ("interpolation", "how a value is looked up"))
_ARRAYS = (
    Output("node_bounds", "(M, 4)", "1", "u_min, u_max, v_min, v_max of each cell of the quadtree", within=(0, 1)),
    Output("node_child", "(M,)", "1", "first of the four children of a cell, or -1; nodes 0 and 1 are the roots",
           within=(-1, "M - 1"), whole=True),
    Output("corner", "(N, 2)", "1", "place of a corner: u = corner[0] 2^-depth, v = corner[1] 2^-(depth + 1)", whole=True),
    Output("offset", "(N,)", "1", "coefficient 0 at each corner, of the natural logarithm", within=ANY),
    Output("coefficient", "(N, K)", "1", "coefficients 1 .. K at each corner, in units of coefficient_scale", within=ANY,
           whole=True),
    Output("coefficient_scale", "(K,)", "1", "scales of the coefficients"),
    Output("basis", "(K + 1, S, T)", "1", "functions of the direction, in units of basis_scale", within=ANY, whole=True),
    Output("basis_scale", "(K + 1,)", "1", "scales of the basis"),
    Output("error", "(1,)", "1", "relative error of a lobe between the corners, of the table alone"),
    Output("error_with_solver", "(1,)", "1", "the same with what the solver, or the noise of photons, contributes"),
    Output("error_worst", "(1,)", "1", "largest error of the positions that were looked at"),
    Output("offset_error", "(N,)", "1", "standard error of offset, that of the integral over directions; tables of photons only"),
    Output("photons", "(1,)", "1", "photons that were followed; tables of photons only", whole=True),
    Output("resolution", "(1,)", "rad", "of cones that narrow peaks were spread over, 0: none; tables of photons only"),
)
OUTPUTS = (
    Output("wavelength", "(L,)", "um", "of the tables w0, w1, ..."),
    Output("extinction", "(L,)", "1", "sigma_t that the tables' mean free paths belong to, over the medium's: 1 - albedo peak",
           within=(0, 1)),
    Output("albedo", "(L,)", "1", "that the tables were made for, without the peak", within=(0, 1)),
    Output("peak", "(L,)", "1", "share of the scattered light in a forward peak that counts as not scattered", within=(0, 1)),
    Output("peak_angle", "(L,)", "rad", "angle below which light is in that peak; 0 where there is none"),
    Output("peak_effect", "(L,)", "1", "relative difference of the lobes from those where light in the peak is unscattered"),
    Output("phase", "(L, A)", "1/sr", "phase function of the tables on medium/theta: without the peak, integral 1"),
    Output("k0", "(L,)", "1", "decay of diffuse light beyond the extent, per mean free path"),
    Output("extent", "(L,)", "1", "where the tables end, mean free paths"),
    Output("length", "(1,)", "1", "of the tabulated segment, mean free paths"),
    *(Output(f"{kind}/{name}", "(bytes,)", "utf-8", description, optional=True)
      for kind in KINDS for name, description in _TEXTS),
    *(replace(o, path=f"{kind}/WAVELENGTH/{o.path}", optional=True) for kind in KINDS for o in _ARRAYS),
)
_OF_PHOTONS = ("offset_error", "photons", "resolution")
_OF_MEDIUM = ("extinction", "albedo", "peak", "peak_angle", "peak_effect")


def inputs(recipe, upstream) -> dict:
    medium, options = upstream["medium"], recipe.multiple_scattering
    return {"wavelength": np.asarray(recipe.wavelength, float), "albedo": np.asarray(medium["albedo"].data, float),
            "theta": np.asarray(medium["theta"].data, float), "phase": np.asarray(medium["phase"].data, float),
            "delta": np.asarray(medium["forward_delta"].data, float) if "forward_delta" in medium.members
            else np.zeros(len(recipe.wavelength)),
            "sources": options.sources, "extent": options.extent, "length": options.length, "orders": options.orders,
            "method": options.method, "photons": options.photons, "tolerance": options.tolerance}


# ---- work


def tabulated(number, kinds, medium, asked):
    """Tables of one wavelength (its number) by the solver, number, kind and table of each; a task that any worker may run."""
    from bakery.physics.multiple import choice

    try:
        tables = choice.by_solver(medium, map(KINDS.index, kinds), asked)
    except ValueError as fault:
        raise StageError(f"wavelength number {number}: {fault}") from None
    return [(number, KINDS[kind], table) for kind, table in tables.items()]


def attempted(number, kinds, *task):
    """`tabulated`, with the reason (a string) in place of tables where the solver refuses."""
    try:
        return tabulated(number, kinds, *task)
    except StageError as fault:
        return [(number, kind, str(fault)) for kind in kinds]


def counted(number, kinds, medium, asked):
    """Tables of one wavelength by photons, as `tabulated` returns them."""
    from bakery.physics.multiple import choice

    tabulated = choice.by_photons(medium, map(KINDS.index, kinds), asked)
    return [(number, KINDS[kind], table) for kind, table in tabulated.items()]


def with_photons(inputs, media, results, asked, context):
    """Puts tables of photons in the place of those that the solver refused or did badly; of all, where no solver was asked.

    Parameters
    ----------
    media : `choice.Medium` of every wavelength
    results : what `attempted` returned

    Returns
    -------
    results : one table a wavelength and source
    notes : what was done and why
    """
    from bakery.physics.multiple import choice

    def error(done):
        return choice.error(None if isinstance(table, str) else table for *_, table in done)

    solvers = {k: [attempt for attempt in results if attempt[0] == k] for k in range(len(media))}
    poor = [k for k, done in solvers.items() if error(done) > choice.POOR]
    tasks = [(k, tuple(inputs["sources"]), media[k], asked) for k in poor]
    notes = []
    for k, done in zip(poor, context.map(counted, tasks) if tasks else [], strict=True):
        um, solver = f"{inputs['wavelength'][k]:g} um", solvers[k]
        if error(solver) <= error(done):
            notes.append(f"{um}: the solver's tables have an error of {error(solver):.2g}, photons' would have {error(done):.2g}")
            continue
        photons, resolution = (done[0][2].counted[name][0] for name in ("photons", "resolution"))
        why = [table for *_, table in solver if isinstance(table, str)] or [
            f"the solver's tables would have an error of {error(solver):.2g}"]
        notes.append(f"{um}: tables are made of {photons} photons" + (f"; {why[0]}" if solver else ""))
        if resolution > 0:
            notes.append(f"{um}: the phase function has a peak too narrow for a table; for the first and last scattering it is "
                         f"spread over a cone of {np.degrees(resolution):.2g} degrees; errors are those of such lobes")
        results = [attempt for attempt in results if attempt[0] != k] + done
    return results, notes


def compute(inputs: dict, context) -> Result:
    from bakery.physics.multiple import choice, table

    count, method = len(inputs["wavelength"]), inputs["method"]
    media = [choice.Medium(float(inputs["albedo"][k]), inputs["theta"], inputs["phase"][k], float(inputs["delta"][k]))
             for k in range(count)]
    asked = choice.Asked(*(inputs[key] for key in ("extent", "length", "tolerance", "orders", "photons")), context.seed)
    kinds = tuple(sorted(inputs["sources"], reverse=True))
    tasks = [(k, kinds, media[k], asked) for k in range(count)]
    results: list = []
    for start in range(0, count if method != "photons" else 0, _TOGETHER):  # a few at a time, so that progress is reported
        for done in context.map(tabulated if method == "solver" else attempted, tasks[start:start + _TOGETHER]):
            results += done
        errors = [table.table.error_with_solver for *_, table in results if not isinstance(table, str)]
        context.report(len(results) / (count * len(kinds)), max(errors, default=None))
    results.sort(key=lambda result: kinds.index(result[1]))  # messages go by source, then by wavelength
    results, notes = with_photons(inputs, media, results, asked, context)
    values = {name: np.zeros(count) for name in (*_OF_MEDIUM, "k0", "extent")}
    values["phase"] = np.zeros_like(inputs["phase"])
    places: dict[str, dict] = {kind: {} for kind in inputs["sources"]}
    reached = 0.0
    for number, kind, computed in results:
        lobe_table = computed.table
        for name in (*_OF_MEDIUM, "phase"):
            values[name][number] = getattr(computed, name)
        values["k0"][number], values["extent"][number] = lobe_table.k0, lobe_table.extent
        figures = {"error": lobe_table.error, "error_with_solver": lobe_table.error_with_solver, "error_worst": lobe_table.worst}
        places[kind][f"w{number}"] = Group(datasets(
            OUTPUTS, lobe_table.arrays() | {name: np.array([value]) for name, value in figures.items()} | computed.counted,
            f"{kind}/WAVELENGTH/"))
        reached = max(reached, lobe_table.error_with_solver)
        if lobe_table.empty:
            notes.append(f"{inputs['wavelength'][number]:g} um: nothing is scattered, so the {kind} table is empty")
    for k in np.flatnonzero((values["peak"] > inputs["delta"] + 1e-9) & (inputs["albedo"] > 0)):
        notes.append(f"{inputs['wavelength'][k]:g} um: {values['peak'][k]:.2g} of the scattered light, in a forward peak of "
                     f"{np.degrees(values['peak_angle'][k]):.2g} degrees, counts as not scattered (delta-M as a function of the "
                     "angle); the first two events take multiple/phase, albedo and extinction.  Between events the tables turn "
                     f"light as the peak does, which changes their lobes by {100 * values['peak_effect'][k]:.2g} %")
    descriptions = {"coordinates": table.COORDINATES, "frame": (table.FRAME,) * 2, "singular": table.SINGULAR,
            "interpolation": (table.INTERPOLATION,) * 2}
    values |= {"wavelength": inputs["wavelength"], "length": np.array([inputs["length"]])}
    members: dict = dict(datasets(OUTPUTS, values))
    for kind in inputs["sources"]:
        words = {name: text(descriptions[name][KINDS.index(kind)], described) for name, described in _TEXTS}
        members[kind] = Group(words | dict(sorted(places[kind].items(), key=lambda item: int(item[0][1:]))))
    missed = ("a larger multiple_scattering.tolerance or, where the error is the solver's, more multiple_scattering.orders, "
              "where it is that of photons, more multiple_scattering.photons would do",) if reached > context.tolerance else ()
    return Result(members, reached, tuple(dict.fromkeys(notes)), missed)


# ---- rules and plan


def sound(group: Group) -> Iterable[str]:
    """Whether every table is there, and its tree takes no more room than its depth says."""
    from bakery.physics.multiple import tree

    kinds = [kind for kind in KINDS if kind in group.members]
    if not kinds:
        yield "holds neither point nor segment"
    for kind in kinds:
        for k in range(len(group["wavelength"].data)):
            tables = group[kind].members.get(f"w{k}")
            members = tables.members if isinstance(tables, Group) else {}
            missing = [output.path for output in _ARRAYS if output.path not in members and output.path not in _OF_PHOTONS]
            if missing:
                yield f"{kind}/w{k}: {', '.join(missing)} missing"
            else:
                yield from (f"{kind}/w{k}: {fault}" for fault in tree.broken(members["corner"].data, members["node_bounds"].data))


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `multiple` group, in words."""
    v = {name: np.asarray(member.data, float) for name, member in group.datasets.items()}
    # in mean free paths of the medium with its peak at most 1, where nothing is scattered, and 0 only where nothing is absorbed
    if (v["k0"] * v["extinction"] > 1 + 1e-9).any() or ((v["k0"] <= 0) & (v["albedo"] < 1 - 1e-9)).any():
        yield "k0 is not the decay of diffuse light: 0 although light is absorbed, or faster than extinction"
    if (v["extent"] <= 0).any() or (v["length"] <= 0).any():
        yield "extent or length not above 0"
    for kind in [kind for kind in KINDS if kind in group.members]:
        try:
            stored = tables_of(group, kind)
        except (KeyError, ValueError) as fault:
            yield f"{kind}: {fault}"
            continue
        for k, table in enumerate(stored):
            if table.empty and v["albedo"][k] > 0:
                yield f"{kind}/w{k}: empty although something is scattered"


def cost(recipe) -> Cost:
    needed = -_SMALL / math.log(max(_width(recipe), 1e-9))  # Legendre orders: of Henyey and Greenstein's phase function g^l
    orders = min(needed, recipe.multiple_scattering.orders or (needed if needed <= WHOLE else KEPT))
    number = len(recipe.wavelength) * len(recipe.multiple_scattering.sources)
    if counted := _counted(recipe):
        share = min((recipe.multiple_scattering.photons or _PHOTONS) / _PHOTONS, 1.0)
        seconds = counted * (_FITTED + _FLOWN * share + _BESIDE * ("segment" in recipe.multiple_scattering.sources))
        return Cost(seconds, 6e8, 2e5 * number, f"tables of photons for {counted} wavelengths", 1.0,
                    kernels=_KERNELS + _KERNELS_OF_PHOTONS, kind="photons", most=counted)
    beyond = max(math.exp(-_SMALL / orders) - 0.5, 0.0)
    seconds = number * (_FEW + _MORE * beyond + _MANY * orders**3)
    return Cost(seconds, 1.1e8 + 2e9 * beyond**2, number * (1.5e4 + 3.3e5 * beyond), f"{number} tables", 0.5,
                kernels=_KERNELS, kind="solver", most=min(len(recipe.wavelength), _TOGETHER), blocks=len(recipe.wavelength))


def _counted(recipe) -> int:
    """Wavelengths whose tables are made of photons, as far as the recipe alone tells."""
    phase, options = None if recipe.medium is None else recipe.medium.phase, recipe.multiple_scattering
    if options.method == "photons":
        return len(recipe.wavelength)
    if options.method == "solver" or phase is None or phase.type != "hg":
        return 0
    return int(np.sum(refused(np.broadcast_to(phase.g, len(recipe.wavelength)), options.orders)))


def _width(recipe) -> float:
    """About how forward the phase function is, from the recipe alone."""
    phase = None if recipe.medium is None else recipe.medium.phase
    if phase is not None and phase.type == "hg":
        return float(np.abs(phase.g).max())
    if phase is not None and phase.type in ("isotropic", "rayleigh"):
        return 0.0
    return 0.5 if recipe.grains is not None else 0.78  # without their peak, 40 orders hold what spheres scatter


def measures(group: Group, reference: Group) -> Mapping[str, float]:
    """Errors of a `multiple` group against a converged one.

    Returns
    -------
    dict of floats, in this order, each the largest over tables

    error : relative difference of the lobes, root mean square over 168 directions and 200 places
    integral : the same of their means over directions
    """
    from bakery.physics.multiple import lookup

    random = rng.generator(0, "multiple.compare")
    errors = {"error": 0.0, "integral": 0.0}
    reach = float(min(group["extent"].data.min(), reference["extent"].data.min()))
    r, angle = np.exp(random.uniform(np.log(0.1), np.log(reach), 200)), np.pi * random.random(200)
    polar, azimuth = np.arccos(1 - (np.arange(24) + 0.5) / 12), np.pi * (np.arange(7) + 0.5) / 7  # equal solid angles
    for kind in KINDS:
        if kind not in group.members or kind not in reference.members:
            continue
        for mine, true in zip(tables_of(group, kind), tables_of(reference, kind)):
            if true.empty:
                continue
            of, exact = (lookup.lobes(lookup.ready(table), r * np.sin(angle), r * np.cos(angle), polar, azimuth)
                         for table in (mine, true))
            square = np.mean((of - exact) ** 2, axis=(1, 2)) / np.mean(exact**2, axis=(1, 2))
            whole = np.mean(of, axis=(1, 2)) / np.mean(exact, axis=(1, 2)) - 1
            errors = {"error": max(errors["error"], float(np.sqrt(square.mean()))),
                      "integral": max(errors["integral"], float(np.sqrt(np.mean(whole**2))))}
    return errors


_TOGETHER = 2
_KERNELS = tuple(f"multiple.{name}" for name in ("_kernels", "_plane", "_products", "basis", "locate", "legendre", "lookup",
                                                 "sums", "point"))
_KERNELS_OF_PHOTONS = ("multiple._tally",)
# seconds of one core for the tables of a wavelength by photons: a table of points; the flights of so many photons (all that are
# followed at an albedo of 0.9); integrals of the table of points along a segment
_FITTED, _FLOWN, _PHOTONS, _BESIDE = 4.0, 25.0, 4e6, 4.0
_FEW, _MORE, _MANY = 0.06, 0.15, 2.9e-6  # seconds of one core for a table: at g up to 0.5; times g - 0.5; times orders^3
_SMALL = 8.5  # moments count down to exp(-8.5) = 2e-4

STAGE = Stage(
    name="multiple",
    version=9,
    title="light scattered three times and more, around point and segment sources",
    reads=("wavelengths", "seed", "multiple_scattering"),
    needs=("medium",),
    applies=lambda recipe: recipe.multiple_scattering is not None,
    sections=(MULTIPLE,),
    outputs=OUTPUTS,
    error_measure="relative error of a lobe over directions, root mean square over positions between the corners of the tables, "
                  "with two of its standard errors and what the solver contributes; the largest of all tables",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    sound=sound,
    tolerance_key="multiple_scattering.tolerance",
    measures=measures,
    knobs=(Knob("tolerance", "multiple_scattering.tolerance", 0.01, "error of the tables", ("10%", "3%", "1%", "0.3%", "0.1%")),
           Knob("orders", "multiple_scattering.orders", "auto", "Legendre orders that are solved", ("16", "32", "64", "96"))),
    reference={"multiple_scattering.orders": "auto"},
    view=later("bakery.stages.multiple.view:view"),
    pictures=later("bakery.stages.multiple.pictures:pictures"),
    queries=QUERIES,
)
