"""Stage `multiple`: tables of the light that is scattered three times and more, around a point and a segment source."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from bakery.errors import StageError
from bakery.stages import rules
from bakery.stages.declaration import Cost, Knob, Output, Result, Stage, datasets
from bakery.store.tree import Dataset, Group, text

KINDS = ("point", "segment")
_TEXTS = (("coordinates", "map from the position to the unit square that the quadtree divides"),
          ("frame", "frame of the directions at a position, and coordinates in it"),
          ("singular", "part that was divided out before interpolation"),
          ("interpolation", "how a value is looked up"))
_ARRAYS = (
    Output("node_bounds", "(M, 4)", "1", "u_min, u_max, v_min, v_max of each cell of the quadtree"),
    Output("node_child", "(M,)", "1", "first of the four children of a cell, or -1; nodes 0 and 1 are the roots"),
    Output("corner", "(N, 2)", "1", "place of a corner: u = corner[0] 2^-depth, v = corner[1] 2^-(depth + 1)"),
    Output("offset", "(N,)", "1", "coefficient 0 at each corner, of the natural logarithm"),
    Output("coefficient", "(N, K)", "1", "coefficients 1 .. K at each corner, in units of coefficient_scale"),
    Output("coefficient_scale", "(K,)", "1", "scales of the coefficients"),
    Output("basis", "(K + 1, S, T)", "1", "functions of the direction, in units of basis_scale"),
    Output("basis_scale", "(K + 1,)", "1", "scales of the basis"),
    Output("error", "(1,)", "1", "relative error of a lobe between the corners, of the table alone"),
    Output("error_with_solver", "(1,)", "1", "the same with what the solver contributes"),
    Output("error_worst", "(1,)", "1", "largest error of the positions that were looked at"),
)
OUTPUTS = (
    Output("wavelength", "(L,)", "um", "of the tables w0, w1, ..."),
    Output("extinction", "(L,)", "1", "sigma_t that the tables' mean free paths belong to, over the medium's: 1 - albedo peak"),
    Output("albedo", "(L,)", "1", "that the tables were made for, without the peak"),
    Output("peak", "(L,)", "1", "share of the scattered light in a forward peak that counts as not scattered (delta-M)"),
    Output("k0", "(L,)", "1", "decay of diffuse light beyond the extent, per mean free path"),
    Output("extent", "(L,)", "1", "where the tables end, mean free paths"),
    Output("length", "(1,)", "1", "of the tabulated segment, mean free paths"),
    *(Output(f"{kind}/{name}", "(bytes,)", "utf-8", said, optional=True) for kind in KINDS for name, said in _TEXTS),
    *(Output(f"{kind}/WAVELENGTH/{o.path}", o.shape, o.units, o.description, optional=True) for kind in KINDS for o in _ARRAYS),
)
_REQUIRED = ("wavelength", "extinction", "albedo", "peak", "k0", "extent", "length")
_WHOLE, _CUT = 96, 64  # orders that are solved in full; orders that are kept where more would be needed
_MOMENTS = 140


def inputs(recipe, upstream) -> dict:
    medium, options = upstream["medium"], recipe.multiple_scattering
    return {"wavelength": np.asarray(recipe.wavelength, float), "albedo": np.asarray(medium["albedo"].data, float),
            "theta": np.asarray(medium["theta"].data, float), "phase": np.asarray(medium["phase"].data, float),
            "straight": np.asarray(medium["forward_delta"].data, float) if "forward_delta" in medium.members
            else np.zeros(len(recipe.wavelength)),
            "sources": options.sources, "extent": options.extent, "length": options.length, "orders": options.orders}


# ---- work


def solved(albedo: float, theta, phase, straight: float, orders: int | None):
    """The solution for one wavelength, and the share of the light that counts as not scattered.

    straight : share of the scattered light that keeps its direction, part of phase below theta[1] (packed grains)
    orders : Legendre orders, or None: as many as it takes, or so many that narrower peaks may be left out

    Returns
    -------
    solution : of the medium without the peak
    peak : share of the scattered light that was taken out
    """
    from bakery.multiple import legendre, solution

    p = legendre.moments(theta, phase, max(_MOMENTS, (orders or 0) + 8))
    if straight >= 1 - 1e-9:
        albedo, p, straight = 0.0, np.eye(1, len(p))[0], min(straight, 1.0)
    else:
        p, albedo = (p - straight) / (1 - straight), albedo * (1 - straight) / (1 - albedo * straight)
    p[0] = 1.0
    needed = legendre.order_needed(p)
    most = orders or (_WHOLE if needed is not None and needed <= _WHOLE else _CUT)
    found = solution.solve(albedo, p, most=most)
    return found, 1 - (1 - straight) * (1 - found.peak)


def tabulated(number, kind, albedo, theta, phase, straight, orders, extent, length, tolerance, seed):
    """A table of one wavelength (its number) and kind of source; a task that any worker may run."""
    from bakery.multiple import table

    try:
        found, peak = solved(albedo, theta, phase, straight, orders)
        reach = table.extent_needed(found.medium) if extent is None else extent
        made = table.build(found, kind, extent=reach, length=length, tolerance=tolerance, seed=seed)
    except ValueError as fault:
        raise StageError(f"wavelength number {number}, {kind} source: {fault}") from None
    return number, kind, made, peak, found.medium.albedo


def compute(inputs: dict, context) -> Result:
    from bakery.multiple import table

    length, count = inputs["length"], len(inputs["wavelength"])
    tasks = [(k, kind, float(inputs["albedo"][k]), inputs["theta"], inputs["phase"][k], float(inputs["straight"][k]),
              inputs["orders"], inputs["extent"], length, context.tolerance, context.seed)
             for kind in sorted(inputs["sources"], reverse=True) for k in range(count)]  # segments first: they take longest
    found = []
    for start in range(0, len(tasks), _TOGETHER):  # a few at a time, so that progress can be told
        found += context.map(tabulated, tasks[start:start + _TOGETHER])
        context.report(len(found) / len(tasks), max(made.error_with_solver for _, _, made, _, _ in found))
    values = {name: np.zeros(count) for name in ("extinction", "albedo", "peak", "k0", "extent")}
    places: dict[str, dict] = {kind: {} for kind in inputs["sources"]}
    reached, notes, bytes_ = 0.0, [], 0
    for number, kind, made, peak, albedo in found:
        values["peak"][number], values["albedo"][number] = peak, albedo
        values["extinction"][number] = 1 - inputs["albedo"][number] * peak
        values["k0"][number], values["extent"][number] = made.k0, made.extent
        figures = {"error": made.error, "error_with_solver": made.error_with_solver, "error_worst": made.worst}
        places[kind][f"w{number}"] = Group(datasets(
            OUTPUTS, made.arrays() | {name: np.array([value]) for name, value in figures.items()}, f"{kind}/WAVELENGTH/"))
        reached, bytes_ = max(reached, made.error_with_solver), bytes_ + made.nbytes
        if made.empty:
            notes.append(f"{inputs['wavelength'][number]:g} um: nothing is scattered, so the {kind} table is empty")
    for k in np.flatnonzero((values["peak"] > inputs["straight"] + 1e-9) & (inputs["albedo"] > 0)):
        notes.append(f"{inputs['wavelength'][k]:g} um: {values['peak'][k]:.2g} of the scattered light is a forward peak too "
                     "narrow to be solved and counts as not scattered (delta-M); orders one and two must be computed alike")
    said = {"coordinates": table.COORDINATES, "frame": (table.FRAME,) * 2, "singular": table.SINGULAR,
            "interpolation": (table.INTERPOLATION,) * 2}
    members: dict = dict(datasets(OUTPUTS, {"wavelength": inputs["wavelength"], **values, "length": np.array([length])}))
    for kind in inputs["sources"]:
        words = {name: text(said[name][KINDS.index(kind)], described) for name, described in _TEXTS}
        members[kind] = Group(words | dict(sorted(places[kind].items(), key=lambda item: int(item[0][1:]))))
    missed = (f"tables are good to {reached:.2g} instead of {context.tolerance:.2g}; a larger multiple_scattering.tolerance or, "
              "where the error is the solver's, more multiple_scattering.orders would do",) if reached > context.tolerance else ()
    return Result(members, reached, tuple(dict.fromkeys(notes)), missed)


def tables_of(group: Group, kind: str) -> list:
    """The tables of a `multiple` group, one a wavelength, as `bakery.multiple.table.Table`."""
    from bakery.multiple import frame, table

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


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `multiple` group, in words."""
    v = {name: np.asarray(member.data, float) for name, member in group.members.items() if isinstance(member, Dataset)}
    faults = list(rules.complete(v, _REQUIRED))
    yield from faults
    if faults:
        return
    for name in ("extinction", "albedo", "peak"):
        if ((v[name] < 0) | (v[name] > 1 + 1e-12)).any():
            yield f"{name} outside 0 .. 1"
    if (v["k0"] < 0).any() or (v["extent"] <= 0).any() or (v["length"] <= 0).any():
        yield "k0 below 0, or extent or length not above 0"
    kinds = [kind for kind in KINDS if kind in group.members]
    if not kinds:
        yield "holds neither point nor segment"
    for kind in kinds:
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
    seconds = number * (_FEW + _MANY * max(g - 0.5, 0.0) ** 2)
    return Cost(seconds, 4e8, 2e5 * number, f"{number} tables", 3.0)


def _width(recipe) -> float:
    """About how forward the phase function is, from the recipe alone."""
    if recipe.medium is not None and recipe.medium.phase.g is not None:
        return float(np.abs(recipe.medium.phase.g).max())
    return 0.5 if recipe.grains is not None else 0.9


def measures(found: Group, reference: Group) -> Mapping[str, float]:
    """Errors of a `multiple` group against a converged one.

    Returns
    -------
    dict of floats, in this order, each the largest over tables

    error : relative difference of the lobes, root mean square over 168 directions and 200 places
    integral : the same of their means over directions
    """
    from bakery.multiple import lookup

    random = np.random.default_rng(1)
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
_FEW, _MANY = 1.0, 60.0  # seconds of one core for a table: at g up to 0.5; times (g - 0.5)^2

STAGE = Stage(
    name="multiple",
    version=1,
    title="light scattered three times and more, around point and segment sources",
    reads=("wavelengths", "seed", "multiple_scattering"),
    needs=("medium",),
    applies=lambda recipe: recipe.multiple_scattering is not None,
    outputs=OUTPUTS,
    error_measure="relative error of a lobe over directions, root mean square over positions between the corners of the tables, "
                  "with two of its standard errors and what the solver contributes; the largest of all tables",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    tolerance_key="multiple_scattering.tolerance",
    measures=measures,
    knobs=(Knob("tolerance", "multiple_scattering.tolerance", 0.003, "error of the tables", ("10%", "3%", "1%", "0.3%", "0.1%")),
           Knob("orders", "multiple_scattering.orders", "auto", "Legendre orders that are solved", ("16", "32", "64", "96"))),
    reference={"multiple_scattering.orders": "auto"},
)
