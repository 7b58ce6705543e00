"""Stage `surface` of packed grains: light counted among them; under boundaries and on other assets by their medium."""

import itertools
import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from bakery.errors import StageError
from bakery.physics.packing.tiles import tile_of
from bakery.stages.declaration import Cost, Output, Result, Stage, datasets, later
from bakery.stages.grains.stage import inputs as inputs_of_grains
from bakery.stages.members import Members
from bakery.stages.surface import stage as surface
from bakery.stages.surface.section import INFINITE, SURFACE, among_grains
from bakery.stages.surface.view import QUERIES, counted_in
from bakery.store.tree import Group

_PAIR = "over pairs of directions (`bakery/physics/surfaces/pairs.py`)"
_OF_GRAINS = (
    Output("first", "(L, C, D, F)", "1", f"light that one grain deflects over that of the medium, {_PAIR}", optional=True),
    Output("second", "(L, H, U, V)", "1", f"light that two grains deflect over what the medium scatters several times, {_PAIR}",
           optional=True),
    Output("higher", "(L, G, U, V)", "1", f"light that more grains deflect over what the medium scatters several times, {_PAIR}",
           optional=True),
    Output("scale", "(L, 3, B)", "1", "factor of either direction, by order, over the root of its cosine", optional=True),
    Output("least", "(1,)", "1", "root of the cosine where bins of incidence begin; they end at 1", optional=True, within=(0, 1)),
    Output("order_albedo", "(L, 3, B)", "1", "share of the light of each bin of incidence that comes back, by order",
           optional=True),
    Output("order_albedo_error", "(L, 3, B)", "1", "standard error of order_albedo", optional=True),
    Output("noise", "(L, H, U, V)", "1", f"relative standard error of the light that comes back, {_PAIR}", optional=True),
    Output("inside", "(L,)", "1", "share of the higher orders that was still among the grains when its walk ended", optional=True,
           within=(0, 1)),
)
_LAYERS = "layers"  # group of what is counted in layers of a thickness
OUTPUTS = (
    *surface.OUTPUTS,
    *_OF_GRAINS,
    Output("hits", "(1,)", "1", "of grains by light that was followed", optional=True),
    *(replace(output, path=f"{_LAYERS}/{output.path}", shape=output.shape.replace("(L,", "(L, T, Z,").replace(",)", ")"),
              description=output.description.replace("comes back", "leaves"))
      for output in _OF_GRAINS if output.path != "least"),
    Output(f"{_LAYERS}/least", "(1,)", "1", "root of the cosine where bins of incidence begin; they end at 1", optional=True,
           within=(0, 1)),
    Output(f"{_LAYERS}/straight", "(L, T, B)", "1", "share of the light of each bin of incidence that leaves below undeflected; "
           "absent over a base", optional=True, within=(0, 1)),
)
_NEEDED = ("first", "second", "higher", "scale", "least", "order_albedo", "order_albedo_error", "noise")
_SHAPE = 0.05  # tolerance of the medium's layer, of which only shapes within cells are taken
# of the tolerance: indices that share walks, over |index - 1|. They are walked by their mean, and the light of cells changes by a
# third of that (balls of 1.3 and 1.5), so they are off by a third of the tolerance
_APART = 2.0
_TOGETHER = 16  # wavelengths that share walks at most
# hits times the squared tolerance, and seconds of one core of a hit: light that grains let through comes back late
_HITS, _HIT, _HITS_CLEAR, _HIT_CLEAR = 1.5e3, 0.55e-6, 1.3e3, 0.6e-6
_MESH, _MESH_CLEAR = 2.5, 6.0  # times as long for a hit of grains that are no balls
_FIT = 0.5  # seconds of a wavelength and thickness


def inputs(recipe, upstream) -> dict:
    values = surface.inputs(recipe, upstream)
    if not among_grains(recipe):
        return values | {"counted": False}
    group, medium, arguments = upstream["grains"], upstream["medium"], inputs_of_grains(recipe, {})
    names = [grain.name for grain in recipe.grains.components]
    return values | {
        "counted": True, "components": arguments["components"], "radius": arguments["radius"], "depth": arguments["depth"],
        "tile": tile_of(Members(upstream["packing"], "packing"), Members(medium, "medium"))[:3],
        "weights": [float(group[f"{name}/weight"].data[0]) for name in names],
        "meshes": [(group[f"{name}/vertices"].data, group[f"{name}/faces"].data) for name in names],
        "g": np.asarray(medium["g"].data, float), "decay": np.asarray(medium["sigma_tr_improved"].data, float)}


def compute(inputs: dict, context) -> Result:
    # black grains, and those of the host's index, send nothing back: there is nothing to count
    if not inputs["counted"] or inputs["thickness"] is None and not inputs["sigma_s"].any():
        return surface.compute(inputs, context)
    solutions = _solutions(inputs, context)
    widths = [None] if inputs["thickness"] is None else inputs["thickness"]
    groups = alike(inputs["components"], len(inputs["sigma_t"]), _APART * context.tolerance)
    rows: list = [None] * len(solutions)
    hits, notes, missed = 0, [], []
    for number, (t, group) in enumerate(itertools.product(range(len(widths)), groups)):
        result = _measured(inputs, (widths[t], group), (number, len(widths) * len(groups)), solutions[t::len(widths)], context)
        hits += result.hits
        for k, counted in zip(group, result.each, strict=True):
            rows[k * len(widths) + t] = counted
        lost = result.given_up + result.contradicted + result.cut
        if lost > 0.1 * context.tolerance:
            notes.append(f"{lost:.2g} of the walks were given up: {result.given_up:.2g} because no grain was ahead, "
                         f"{result.contradicted:.2g} in grains whose mesh contradicts itself, {result.cut:.2g} because they met "
                         "one grain's surface too often")
        if not result.reached:
            missed.append(f"{result.hits:.2g} hits leave an error of {result.achieved_error:.2g}; a larger surface.tolerance "
                          "would do")
    values = surface.stored(inputs, solutions, (-1, len(widths))) | {"hits": np.array([float(hits)])}
    values |= _shares(rows, solutions, len(widths))
    counted = _counted(rows, len(widths))
    if inputs["thickness"] is None:
        members = datasets(OUTPUTS, values | {name: part if name == "least" else part[:, 0, 0] for name, part in counted.items()})
    else:
        members = datasets(OUTPUTS, values) | {_LAYERS: Group(datasets(OUTPUTS, counted, f"{_LAYERS}/"), {})}
    return Result(members, float(values["change"].max()), tuple(dict.fromkeys(notes)), tuple(missed))


def _solutions(inputs: dict, context) -> list:
    """Half spaces or layers of the medium that stands for the grains, all with as many moments."""
    from bakery.physics.surfaces.refine import converged

    slabs = surface.slabs(inputs)
    try:
        solutions = context.map(converged, [(slab, _SHAPE) for slab in slabs])
    except ArithmeticError as fault:
        raise StageError(f"surface: {fault}") from None
    return [solution for solution, _ in surface.alike(slabs, solutions, _SHAPE, context)]


def alike(components, wavelengths: int, apart: float) -> list[list[int]]:
    """Wavelengths that share walks: those at which no index n of a dielectric differs by more than `apart` times |n - 1|."""
    index = np.array([component["index"].real for component in components if component["type"] == "dielectric"]).reshape(
        -1, wavelengths)
    groups: list[list[int]] = []
    for k in range(wavelengths):
        for group in groups:
            if len(group) < _TOGETHER and np.all(np.abs(index[:, k] - index[:, group[0]]) <= apart * np.abs(index[:, k] - 1)):
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _measured(inputs: dict, case: tuple, number: tuple[int, int], solutions: list, context):
    """Walks of a thickness (um; None: without end) and a group of wavelengths; their number, and of how many cases."""
    from bakery.physics.granular.goniometer import Goniometer
    from bakery.physics.granular.reflectance import measured

    (width, group), (stream, count) = case, number
    grains, mu, channels = _grains(inputs, group)
    goniometer = Goniometer(*inputs["tile"], grains, inputs["weights"], mu=mu, channels=channels, seed=context.seed,
                            g=float(inputs["g"][group].max()), decay=inputs["decay"][group] * inputs["radius"],
                            depth=inputs["depth"], stream=stream,
                            thickness=math.inf if width is None else 1e-6 * width / inputs["radius"],
                            base=None if inputs["base"] is None else inputs["base"][group])

    def report(share, error):
        context.report((stream + share) / count, error, "light counted among the grains")

    return measured(goniometer, [solutions[k] for k in group], context.tolerance, map=context.map, report=report)


def _grains(inputs: dict, group: list[int]):
    """Grains as walks take them, and what takes light away: mu (T, C) over mean radii, channels (T, 2, C)."""
    from bakery.physics.grains import bvh
    from bakery.physics.grains import surface as surfaces
    from bakery.physics.granular.packed import Grain

    grains, mu, channels = [], [], []
    for component, (vertices, faces) in zip(inputs["components"], inputs["meshes"], strict=True):
        kind, roughness = component["type"], component["roughness"]
        if kind == "dielectric":
            coat = surfaces.dielectric(float(component["index"].real[group].mean()), roughness)
        elif kind == "diffuse":
            coat = surfaces.diffuse(component["reflectance"][group])
        else:
            coat = surfaces.conductor(component["index"][group], roughness)
        mesh = None if component["shape"]["type"] == "sphere" else bvh.Mesh(vertices, faces)
        grains.append(Grain(coat, mesh))
        mu.append(component["absorption"][group] * inputs["radius"])
        channels.append(np.broadcast_to(coat.channels, (2, len(group))))
    return grains, np.stack(mu), np.stack(channels)


def _shares(rows: list, solutions: list, widths: int) -> dict:
    """Arrays that stand in for those of the medium's layers."""
    air, flux = solutions[0].nodes.air, solutions[0].nodes.flux[:solutions[0].nodes.leaving]
    albedo, passed = np.stack([_shares_of(counted, solution, air) for counted, solution in zip(rows, solutions, strict=True)],
                              axis=1).reshape(2, -1, widths, len(air))
    return {"albedo": albedo, "passed": passed, "spherical_albedo": albedo @ flux / flux.sum(),
            "change": np.array([counted.achieved_error for counted in rows]).reshape(-1, widths)}


def _counted(rows: list, widths: int) -> dict:
    """Arrays of what was counted, by wavelength, thickness and side."""
    from bakery.physics.granular.reflectance import LEAST

    light = [[_of_side(side) for side in (counted, counted.below) if side is not None] for counted in rows]
    values = {name: np.stack([[side[name] for side in sides] for sides in light]) for name in light[0][0]}
    if rows[0].straight is not None:
        values["straight"] = np.stack([counted.straight for counted in rows])
    return {name: value.reshape(-1, widths, *value.shape[1:]) for name, value in values.items()} | {"least": np.array([LEAST])}


def _of_side(counted) -> dict:
    """Arrays of the light that leaves at one side, at one wavelength."""
    from bakery.physics.surfaces.corrected import ORDERS

    values = dict(zip(ORDERS, counted.factors.cells, strict=True)) | {"scale": counted.factors.scale, "noise": counted.error}
    return {name: value.astype(np.float32) for name, value in values.items()} | {
        "order_albedo": counted.albedo, "order_albedo_error": counted.albedo_error, "inside": counted.inside}


def _shares_of(counted, solution, air) -> np.ndarray:
    """Shares (2, N) of light from directions that come back and that leave below."""
    from bakery.physics.surfaces.corrected import Corrected

    whole = counted.lossless and counted.below is None
    back = np.ones(len(air)) if whole else np.clip(_smoothed(counted, air, solution.albedo), 0, 1)
    if counted.below is None:
        return np.stack([back, np.zeros(len(air))])
    straight = Corrected(solution, counted.factors, counted.below.factors, counted.straight).unscattered(air)
    scattered = solution.passed - np.exp(-solution.slab.depth / air)
    return np.stack([back, 1 - back if counted.lossless
                     else np.clip(_smoothed(counted.below, air, scattered) + straight, 0, 1 - back)])


def _smoothed(counted, air, medium):
    """A polynomial through the shares of bins, at directions.

    medium : (N,) the same share of the medium's light.  Steeper than the middle of the last bin, 20 degrees, the share changes as
        that does: the polynomial went astray, of beach sand at 5 % to 8 % too much at 14 degrees.
    """
    from bakery.physics.granular.reflectance import LEAST
    from bakery.physics.surfaces.corrected import DEGREE, middles

    shares, root = counted.albedo.sum(axis=0), np.sqrt(air)
    at = middles(len(shares), LEAST)
    within = np.minimum(root, at[-1])
    fitted = np.interp(within, root, medium)
    trend = np.divide(medium, fitted, out=np.ones(len(air)), where=(fitted > 0) & (root > within))
    return np.polynomial.Polynomial.fit(at, shares, DEGREE)(within) * trend


# ---- rules and plan


def sound(group: Group) -> Iterable[str]:
    """Whether all that a look-up among grains takes is there."""
    yield from surface.sound(group)
    counted = counted_in(group)
    if "scale" in counted.members and counted["scale"].data.shape[-1] < 2:
        yield "scale has fewer than two bins"
    elif counted is not group:
        sides = 2 if "transmitted" in group.members else 1
        if counted["scale"].data.shape[2] != sides or ("straight" in counted.members) != (sides == 2):
            yield f"{_LAYERS} does not hold the light of {sides} sides, and what passes straight where there are two"


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `surface` group of grains, in words."""
    yield from surface.check(group)
    counted = counted_in(group)
    if "scale" not in counted.members:
        return
    albedo, error = (np.asarray(counted[name].data, float).sum(axis=-2) for name in ("order_albedo", "order_albedo_error"))
    if (albedo > 1 + 6 * error + 1e-6).any():
        yield "more light leaves at one side than enters"


def cost(recipe) -> Cost:
    if not among_grains(recipe):
        return surface.cost(recipe)
    arguments = inputs_of_grains(recipe, {})
    components, tolerance = arguments["components"], recipe.surface.tolerance
    groups = len(alike(components, len(recipe.wavelength), _APART * tolerance))
    clear = any(component["type"] == "dielectric" for component in components)
    layers = 1 if recipe.surface.thickness == INFINITE else len(recipe.surface.thickness)
    hits = groups * layers * min((_HITS_CLEAR if clear else _HITS) / tolerance**2, 2.0**32)
    sides = 1 if recipe.surface.thickness == INFINITE or recipe.surface.base is not None else 2
    balls = all(component["shape"]["type"] == "sphere" for component in components)
    slower = 1.0 if balls else _MESH_CLEAR if clear else _MESH
    seconds = slower * hits * (_HIT_CLEAR if clear else _HIT) + _FIT * len(recipe.wavelength) * layers
    return Cost(seconds, 3e8, 2.7e5 * len(recipe.wavelength) * layers * sides, f"about {hits:.2g} hits of light among explicit "
                f"grains, {groups} groups of wavelengths, {layers} layers", 0.3,
                kernels=("granular._goniometer", "multiple.legendre", "packing.cells"), kind="of grains")


OF_GRAINS = Stage(
    name="surface",
    version=20,
    title="reflectance and transmittance of packed grains",
    reads=("wavelengths", "seed", "surface", "grains.radius", "grains.components[*].weight"),
    needs=("medium", "packing", "grains"),
    applies=lambda recipe: recipe.surface is not None and recipe.grains is not None,
    sections=(SURFACE,),
    outputs=OUTPUTS,
    together=(*surface.TOGETHER, _NEEDED, (_LAYERS, *(f"{_LAYERS}/{name}" for name in _NEEDED))),
    error_measure="among grains: relative standard error of the light that comes back, root mean square over cells of pairs of "
                  "directions, by their light; of a plane layer of the medium: largest relative error as the last change of the "
                  "Legendre moments",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    tolerance_key="surface.tolerance",
    sound=sound,
    measures=surface.measures,
    view=later("bakery.stages.surface.view:view"),
    pictures=later("bakery.stages.surface.pictures:pictures"),
    files=later("bakery.stages.surface.files:csv_tables"),
    queries=QUERIES,
)
