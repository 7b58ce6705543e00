"""Stage `multiple`: tables of the light that is scattered three times and more, around a point and a segment source."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bakery import rng
from bakery.errors import StageError
from bakery.stages import rules
from bakery.stages.declaration import ANY, Cost, Knob, Output, Result, Stage, datasets
from bakery.stages.multiple.section import MULTIPLE
from bakery.store.tree import Dataset, Group, text

KINDS = ("point", "segment")
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
    *(Output(f"{kind}/{name}", "(bytes,)", "utf-8", said, optional=True) for kind in KINDS for name, said in _TEXTS),
    *(replace(o, path=f"{kind}/WAVELENGTH/{o.path}", optional=True) for kind in KINDS for o in _ARRAYS),
)
_OF_PHOTONS = ("offset_error", "photons", "resolution")
_REQUIRED = ("wavelength", "extinction", "albedo", "peak", "peak_angle", "peak_effect", "phase", "k0", "extent", "length")
_WHOLE, _CUT = 96, 40  # orders that are solved in full; orders that are kept where more would be needed
_MOMENTS = 140


def inputs(recipe, upstream) -> dict:
    medium, options = upstream["medium"], recipe.multiple_scattering
    return {"wavelength": np.asarray(recipe.wavelength, float), "albedo": np.asarray(medium["albedo"].data, float),
            "theta": np.asarray(medium["theta"].data, float), "phase": np.asarray(medium["phase"].data, float),
            "straight": np.asarray(medium["forward_delta"].data, float) if "forward_delta" in medium.members
            else np.zeros(len(recipe.wavelength)),
            "sources": options.sources, "extent": options.extent, "length": options.length, "orders": options.orders,
            "method": options.method, "photons": options.photons, "aim": options.aim}


# ---- work


class Solved(NamedTuple):
    """The solution for one wavelength, and what was done with a forward peak.

    Attributes
    ----------
    solution : `bakery.physics.multiple.solution.Solution` of the medium without the peak
    peak : share of the scattered light that counts as not scattered
    phase : (A,) 1/sr, that of the solution
    peak_angle : rad, below which light is in the peak; 0 where there is none
    peak_effect : what it would change if light in the peak were unscattered (see `peaks.effect`)
    """

    solution: object
    peak: float
    phase: np.ndarray
    peak_angle: float = 0.0
    peak_effect: float = 0.0


def solved(albedo: float, theta, phase, straight: float, orders: int | None) -> Solved:
    """Solves for one wavelength.

    straight : unscattered (delta) share of the scattered light, part of phase below theta[1] (packed grains)
    orders : Legendre orders, or None: as many as it takes, or so many that narrower peaks may be left out
    """
    from bakery.physics.medium.phase import areas, normalised
    from bakery.physics.multiple import legendre, peaks, solution, table

    p = legendre.moments(theta, phase, max(_MOMENTS, (orders or 0) + 8))
    if straight >= 1 - 1e-9:
        nothing = np.eye(1, len(p))[0]
        return Solved(solution.solve(0.0, nothing), min(straight, 1.0), phase, float(theta[1]))
    rest = (p - straight) / (1 - straight)
    rest[0] = 1.0
    needed = legendre.order_needed(rest)
    most = orders or (_WHOLE if needed is not None and needed <= _WHOLE else _CUT)
    if needed is None or needed > most:
        clip = peaks.clipped(theta, phase, most)
        found = peaks.solve(albedo, clip, most)
        return Solved(found, clip.peak, clip.phase, clip.angle, peaks.effect(clip, found, table.extent_needed(found.medium)))
    found = solution.solve(albedo * (1 - straight) / (1 - albedo * straight), rest, most=most)
    if straight > 0:
        phase = phase.copy()
        phase[0] = max(phase[0] - straight / (2 * np.pi * areas(theta)[0]), 0.0)
        phase, _ = normalised(theta, phase)
    return Solved(found, straight, phase, float(theta[1]) if straight > 0 else 0.0)


def tabulated(number, kind, albedo, theta, phase, straight, orders, extent, length, tolerance, seed):
    """A table of one wavelength (its number) and kind of source; a task that any worker may run."""
    from bakery.physics.multiple import table

    try:
        found = solved(albedo, theta, phase, straight, orders)
        medium = found.solution.medium
        reach = table.extent_needed(medium) if extent is None else extent
        made = table.build(found.solution, kind, extent=reach, length=length, tolerance=tolerance, seed=seed)
    except ValueError as fault:
        raise StageError(f"wavelength number {number}, {kind} source: {fault}") from None
    return number, kind, made, found._replace(solution=None), medium.albedo


def attempted(*task):
    """`tabulated`, with the reason in place of a table where the solver refuses."""
    try:
        return tabulated(*task)
    except StageError as fault:
        return *task[:2], None, str(fault), 0.0


def counted(number, kinds, albedo, theta, phase, straight, extent, length, tolerance, photons, seed):
    """Tables of one wavelength made of photons, as `tabulated` returns them, and what they alone have, by kind of source."""
    from bakery.physics.medium.phase import areas, normalised
    from bakery.physics.multiple import counted as photon_tables

    rest = phase
    if straight > 0:  # packed grains: what keeps its direction is not scattered
        rest = phase.copy()
        rest[0] = max(rest[0] - straight / (2 * np.pi * areas(theta)[0]), 0.0)
        rest, _ = normalised(theta, rest)
    albedo = 0.0 if straight >= 1 - 1e-9 else albedo * (1 - straight) / (1 - albedo * straight)
    made = photon_tables.build(albedo, theta, rest, tuple(KINDS.index(kind) for kind in kinds), extent=extent, length=length,
                               tolerance=tolerance, photons=photons, seed=seed)
    of = Solved(None, straight, rest, float(theta[1]) if straight > 0 else 0.0)
    return [(number, kind, made.tables[KINDS.index(kind)], of, albedo,
             {"offset_error": made.offset_error[KINDS.index(kind)], "photons": np.array([made.photons]),
              "resolution": np.array([made.resolution])}) for kind in kinds]


def with_photons(inputs, each, found, context):
    """Puts tables of photons in the place of those that the solver refused or did badly; of all, where no solver was asked.

    Parameters
    ----------
    each : albedo, theta, phase, straight of every wavelength
    found : what `attempted` returned

    Returns
    -------
    found : one table a wavelength and source
    own : (number, kind) -> datasets that tables of photons have besides
    notes : what was done and why
    """
    def error(ways):
        made = [way[2] for way in ways]
        return np.inf if not made or any(one is None for one in made) else max(one.error_with_solver for one in made)

    solvers = {k: [way for way in found if way[0] == k] for k in range(len(each))}
    poor = [k for k, ways in solvers.items() if error(ways) > _POOR]
    tasks = [(k, tuple(inputs["sources"]), *each[k], inputs["extent"], inputs["length"], inputs["aim"], inputs["photons"],
              context.seed) for k in poor]
    own, notes = {}, []
    for k, ways in zip(poor, context.map(counted, tasks) if tasks else [], strict=True):
        um, solver = f"{inputs['wavelength'][k]:g} um", solvers[k]
        if error(solver) <= error(ways):
            notes.append(f"{um}: the solver's tables have an error of {error(solver):.2g}, photons' would have {error(ways):.2g}")
            continue
        more = ways[0][5]
        why = [way[3] for way in solver if way[2] is None] or [f"the solver's tables would have an error of {error(solver):.2g}"]
        notes.append(f"{um}: tables are made of {more['photons'][0]} photons" + (f"; {why[0]}" if solver else ""))
        if more["resolution"][0] > 0:
            notes.append(f"{um}: the phase function has a peak too narrow for a table; for the first and last scattering it is "
                         f"spread over a cone of {np.degrees(more['resolution'][0]):.2g} degrees; errors are those of such lobes")
        found = [way for way in found if way[0] != k] + [way[:5] for way in ways]
        own |= {(k, way[1]): way[5] for way in ways}
    return found, own, notes


def compute(inputs: dict, context) -> Result:
    from bakery.physics.multiple import table

    length, count, method = inputs["length"], len(inputs["wavelength"]), inputs["method"]
    each = [(float(inputs["albedo"][k]), inputs["theta"], inputs["phase"][k], float(inputs["straight"][k])) for k in range(count)]
    tasks = [(k, kind, *each[k], inputs["orders"], inputs["extent"], length, inputs["aim"], context.seed)
             for kind in sorted(inputs["sources"], reverse=True) for k in range(count)]  # segments first: they take longest
    found: list = []
    for start in range(0, len(tasks) if method != "photons" else 0, _TOGETHER):  # a few at a time, so that progress is reported
        found += context.map(tabulated if method == "solver" else attempted, tasks[start:start + _TOGETHER])
        errors = [made.error_with_solver for _, _, made, *_ in found if made is not None]
        context.report(len(found) / len(tasks), max(errors, default=None))
    found, own, notes = with_photons(inputs, each, found, context)
    values = {name: np.zeros(count) for name in ("extinction", "albedo", "peak", "peak_angle", "peak_effect", "k0", "extent")}
    values["phase"] = np.zeros_like(inputs["phase"])
    places: dict[str, dict] = {kind: {} for kind in inputs["sources"]}
    reached, bytes_ = 0.0, 0
    for number, kind, made, of, albedo in found:
        for name in ("peak", "peak_angle", "peak_effect", "phase"):
            values[name][number] = getattr(of, name)
        values["albedo"][number], values["extinction"][number] = albedo, 1 - inputs["albedo"][number] * of.peak
        values["k0"][number], values["extent"][number] = made.k0, made.extent
        figures = {"error": made.error, "error_with_solver": made.error_with_solver, "error_worst": made.worst}
        places[kind][f"w{number}"] = Group(datasets(
            OUTPUTS, made.arrays() | {name: np.array([value]) for name, value in figures.items()} | own.get((number, kind), {}),
            f"{kind}/WAVELENGTH/"))
        reached, bytes_ = max(reached, made.error_with_solver), bytes_ + made.nbytes
        if made.empty:
            notes.append(f"{inputs['wavelength'][number]:g} um: nothing is scattered, so the {kind} table is empty")
    for k in np.flatnonzero((values["peak"] > inputs["straight"] + 1e-9) & (inputs["albedo"] > 0)):
        notes.append(f"{inputs['wavelength'][k]:g} um: {values['peak'][k]:.2g} of the scattered light, in a forward peak of "
                     f"{np.degrees(values['peak_angle'][k]):.2g} degrees, counts as not scattered (delta-M as a function of the "
                     "angle); the first two events take multiple/phase, albedo and extinction.  Between events the tables turn "
                     f"light as the peak does, which changes their lobes by {100 * values['peak_effect'][k]:.2g} %")
    said = {"coordinates": table.COORDINATES, "frame": (table.FRAME,) * 2, "singular": table.SINGULAR,
            "interpolation": (table.INTERPOLATION,) * 2}
    members: dict = dict(datasets(OUTPUTS, {"wavelength": inputs["wavelength"], **values, "length": np.array([length])}))
    for kind in inputs["sources"]:
        words = {name: text(said[name][KINDS.index(kind)], described) for name, described in _TEXTS}
        members[kind] = Group(words | dict(sorted(places[kind].items(), key=lambda item: int(item[0][1:]))))
    missed = ("a larger multiple_scattering.tolerance or, where the error is the solver's, more multiple_scattering.orders, "
              "where it is that of photons, more multiple_scattering.photons would do",) if reached > context.tolerance else ()
    return Result(members, reached, tuple(dict.fromkeys(notes)), missed)


def tables_of(group: Group, kind: str) -> list:
    """The tables of a `multiple` group, one a wavelength, as `bakery.physics.multiple.table.Table`."""
    from bakery.physics.multiple import frame, table

    made = []
    for k in range(len(group["wavelength"].data)):
        place = group[f"{kind}/w{k}"]
        made.append(table.from_arrays(
            {name: place[name].data for name in table.ARRAYS}, kind=(frame.POINT, frame.SEGMENT)[KINDS.index(kind)],
            length=float(group["length"].data[0]) if kind == "segment" else 0.0, extent=float(group["extent"].data[k]),
            k0=float(group["k0"].data[k]), error=float(place["error"].data[0]),
            error_with_solver=float(place["error_with_solver"].data[0]), worst=float(place["error_worst"].data[0])))
    return made


# ---- rules and plan


def sound(group: Group) -> Iterable[str]:
    """Whether every table is there, and its tree takes no more room than its depth says."""
    from bakery.physics.multiple import tree

    kinds = [kind for kind in KINDS if kind in group.members]
    if not kinds:
        yield "holds neither point nor segment"
    for kind in kinds:
        for k in range(len(group["wavelength"].data)):
            place = group[kind].members.get(f"w{k}")
            held = place.members if isinstance(place, Group) else {}
            missing = [output.path for output in _ARRAYS if output.path not in held and output.path not in _OF_PHOTONS]
            if missing:
                yield f"{kind}/w{k}: {', '.join(missing)} missing"
            else:
                yield from (f"{kind}/w{k}: {fault}" for fault in tree.broken(held["corner"].data, held["node_bounds"].data))


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `multiple` group, in words."""
    v = {name: np.asarray(member.data, float) for name, member in group.members.items() if isinstance(member, Dataset)}
    faults = list(rules.complete(v, _REQUIRED))
    yield from faults
    if faults:
        return
    if (v["phase"] < 0).any() or v["peak_angle"].min() < 0 or v["peak_effect"].min() < 0:
        yield "phase, peak_angle or peak_effect below 0"
    for name in ("extinction", "albedo", "peak"):
        if ((v[name] < 0) | (v[name] > 1 + 1e-12)).any():
            yield f"{name} outside 0 .. 1"
    if (v["k0"] < 0).any() or (v["extent"] <= 0).any() or (v["length"] <= 0).any():
        yield "k0 below 0, or extent or length not above 0"
    faults = list(sound(group))
    yield from faults
    for kind in [kind for kind in KINDS if kind in group.members and not faults]:
        try:
            made = tables_of(group, kind)
        except (KeyError, ValueError) as fault:
            yield f"{kind}: {fault}"
            continue
        for k, one in enumerate(made):
            if one.empty and v["albedo"][k] > 0:
                yield f"{kind}/w{k}: empty although something is scattered"


def cost(recipe) -> Cost:
    g = _width(recipe)
    number = len(recipe.wavelength) * len(recipe.multiple_scattering.sources)
    if recipe.multiple_scattering.method == "photons":
        return Cost(_COUNTED * len(recipe.wavelength), 6e8, 2e5 * number, f"{number} tables of photons", 1.0,
                    kernels=_KERNELS + _KERNELS_OF_PHOTONS, kind="photons", most=len(recipe.wavelength))
    beyond = max(g - 0.5, 0.0)
    seconds = number * (_FEW + _MORE * beyond + _MANY * beyond**5)
    return Cost(seconds, 1.5e8 + 3e9 * beyond**2, number * (1.5e4 + 3.3e5 * beyond), f"{number} tables", 1.0,
                kernels=_KERNELS, kind="solver", most=min(number, _TOGETHER))


def _width(recipe) -> float:
    """About how forward the phase function is, from the recipe alone."""
    if recipe.medium is not None and recipe.medium.phase.type == "hg":
        return float(np.abs(recipe.medium.phase.g).max())
    if recipe.medium is not None and recipe.medium.phase.type in ("isotropic", "rayleigh"):
        return 0.0
    return 0.5 if recipe.grains is not None else 0.78  # without their peak, 40 orders hold what spheres scatter


def measures(found: Group, reference: Group) -> Mapping[str, float]:
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
    reach = float(min(found["extent"].data.min(), reference["extent"].data.min()))
    r, angle = np.exp(random.uniform(np.log(0.1), np.log(reach), 200)), np.pi * random.random(200)
    polar, azimuth = np.arccos(1 - (np.arange(24) + 0.5) / 12), np.pi * (np.arange(7) + 0.5) / 7  # equal solid angles
    for kind in KINDS:
        if kind not in found.members or kind not in reference.members:
            continue
        for own, true in zip(tables_of(found, kind), tables_of(reference, kind)):
            if true.empty:
                continue
            of, exact = (lookup.lobes(lookup.ready(one), r * np.sin(angle), r * np.cos(angle), polar, azimuth)
                         for one in (own, true))
            square = np.mean((of - exact) ** 2, axis=(1, 2)) / np.mean(exact**2, axis=(1, 2))
            whole = np.mean(of, axis=(1, 2)) / np.mean(exact, axis=(1, 2)) - 1
            errors = {"error": max(errors["error"], float(np.sqrt(square.mean()))),
                      "integral": max(errors["integral"], float(np.sqrt(np.mean(whole**2))))}
    return errors


_TOGETHER = 2
_KERNELS = tuple(f"multiple.{name}" for name in ("_kernels", "_plane", "basis", "frame", "legendre", "lookup", "point"))
_KERNELS_OF_PHOTONS = ("multiple._tally",)
_POOR = 0.2  # error of the solver's tables above which photons are tried
_COUNTED = 30.0  # seconds of one core for the tables of a wavelength by photons
_FEW, _MORE, _MANY = 0.2, 1.5, 520.0  # seconds of one core for a table: at g up to 0.5; times g - 0.5; times (g - 0.5)^5

STAGE = Stage(
    name="multiple",
    version=4,
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
)
