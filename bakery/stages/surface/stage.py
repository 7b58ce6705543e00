"""Stage `surface`: light that a plane layer of the medium sends back and lets through, by direction."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from bakery.errors import StageError
from bakery.physics.medium.similarity import without_delta
from bakery.stages.declaration import ANY, Cost, Output, Result, Stage, datasets, later
from bakery.stages.surface import base as bases
from bakery.stages.surface import costs, spread, under
from bakery.stages.surface.section import INFINITE, SURFACE
from bakery.stages.surface.triangles import integers, packed, whole
from bakery.stages.surface.view import QUERIES
from bakery.store.tree import Dataset, Group

_ORDERS = "of light scattered more than once: values at pairs of directions, row by row of an upper triangle"
_EXPONENT = "times 2 to this power, for order 0, odd orders, and even ones from 2 on, and each pair of directions"
OUTPUTS = (
    Output("thickness", "(T,)", "um", "of the layers; absent where the layer is infinite", optional=True),
    Output("depth", "(L, T)", "1", "optical depth of the layers; absent where they are infinite", optional=True),
    Output("index", "(1,)", "1", "refractive index of the medium over that of the air"),
    Output("roughness", "(1,)", "1", "of the boundary's facets (GGX), 0: smooth", within=(0, 1)),
    Output("base", "(L,)", "1", "albedo of the base, under all layers; absent where there is none", optional=True, within=(0, 1)),
    Output("moments", "(1,)", "1", "Legendre moments of the phase function that the solver carried", whole=True),
    Output("peak", "(L,)", "1", "share of the scattered light in a forward peak that the solver leaves out", within=(0, 1)),
    Output("cosine", "(N,)", "1", "of the solver's directions in air, with the normal", within=(0, 1)),
    Output("flux", "(N,)", "1", "share of the flux of isotropic light that each stands for, at most 1 in all", within=(0, 1)),
    Output("reflected", "(L, T, M, P)", "1", f"Fourier orders {_ORDERS}", within=ANY, scaled=True),
    Output("transmitted", "(L, T, M, Y)", "1", f"the same below the layer, {_ORDERS}; of layers on each other, of the whole "
           "square, whose rows are directions of exitance", optional=True, within=ANY, scaled=True),
    Output("reflected_exponent", "(L, T, 3, P)", "1", f"reflected counts {_EXPONENT}; absent where it holds no integers",
           optional=True, within=ANY, whole=True),
    Output("transmitted_exponent", "(L, T, 3, Y)", "1", f"transmitted counts {_EXPONENT}; absent where it holds no integers",
           optional=True, within=ANY, whole=True),
    Output("albedo", "(L, T, N)", "1", "share of the light from each direction that comes back", within=(0, 1)),
    Output("passed", "(L, T, N)", "1", "share that leaves below the layer, unscattered light included", within=(0, 1)),
    Output("spherical_albedo", "(L, T)", "1", "share of the light from all sides that comes back", within=(0, 1)),
    Output("change", "(L, T)", "1", "largest relative error of reflectance and transmittance, by the last change and rounding"),
    *under.OUTPUTS,
    *spread.OUTPUTS,
)
TOGETHER = (("thickness", "depth"), under.NAMES, spread.NAMES)
_THINNEST = 1e-15  # optical depth
_TOGETHER = 4
_ROUNDING = 1e-6  # energy that may be lost or gained


def inputs(recipe, upstream) -> dict:
    medium, surface = upstream["medium"], recipe.surface
    values = {name: np.asarray(medium[name].data, float) for name in ("sigma_t", "sigma_s", "theta", "phase")}
    if "forward_delta" in medium.members:
        deflecting = without_delta(*values.values(), np.asarray(medium["forward_delta"].data, float))
        values = dict(zip(values, (deflecting[0], deflecting[1], values["theta"], deflecting[2]), strict=True))
    thickness, base = surface.thickness, surface.base
    boundary = surface.boundary if surface.boundary != "none" else None
    return values | {"thickness": None if thickness == INFINITE else np.asarray(thickness, float),
                     "index": boundary.index if boundary else 1.0, "roughness": boundary.roughness if boundary else 0.0,
                     "base": None if base is None or base.albedo is None else np.asarray(base.albedo, float),
                     "under": None if base is None else base.asset or base.recipe,
                     "layer": (0 if base is None else base.layer) or 0, "wavelength": recipe.wavelength}


def slabs(inputs: dict, layers: list | None = None) -> list:
    """What is solved, wavelength by wavelength, all thicknesses of each.

    layers : of each wavelength, what lies under them in place of a base
    """
    from bakery.physics.surfaces.slab import Slab

    result, infinite = [], [(math.inf, math.inf)]
    depths = None if inputs["thickness"] is None else _depths(inputs).tolist()
    for k, (sigma_t, sigma_s) in enumerate(zip(inputs["sigma_t"], inputs["sigma_s"], strict=True)):
        albedo = float(sigma_s / sigma_t) if sigma_t > 0 else 0.0
        base = None if inputs["base"] is None else float(inputs["base"][k])
        for width, depth in infinite if depths is None else zip(inputs["thickness"], depths[k], strict=True):
            result.append(Slab(inputs["theta"], inputs["phase"][k], albedo, depth, inputs["index"], base, inputs["roughness"],
                               layers[k] if layers else None, spread.length(sigma_t, width)))
    return result


def _depths(inputs: dict) -> np.ndarray:
    """(L, T) optical depths of the layers."""
    depths = np.outer(1e-6 * inputs["sigma_t"], inputs["thickness"])
    # between a smooth boundary and a base light goes to and fro even in a layer of no depth, and its orders are stored over the
    # shares that the layer scatters: over 0 they would be infinite
    return np.maximum(depths, _THINNEST) if inputs["index"] != 1 and inputs["base"] is not None else depths


def by_moments(slab, count: int, tolerance: float):
    """A slab by a given number of moments, more than it needs; a task that any worker may run."""
    from bakery.physics.surfaces.refine import moments_of
    from bakery.physics.surfaces.solution import solve

    return solve(slab, moments_of(slab, count + 1), count, tolerance)


def alike(slabs: list, solutions: list, tolerance: float, context) -> list:
    """Solutions (solution, error) of slabs, all with the largest number of moments that any of them needs, rounded."""
    from bakery.physics.surfaces.refine import compact

    counts = [len(solution.cut.moments) for solution, _ in solutions]
    fewer = [k for k, count in enumerate(counts) if count < max(counts)]
    finer = dict(zip(fewer, context.map(by_moments, [(slabs[k], max(counts), tolerance) for k in fewer]), strict=True))
    return context.map(compact, [(finer.get(k, solution), error, tolerance) for k, (solution, error) in enumerate(solutions)])


def compute(inputs: dict, context) -> Result:
    from bakery.physics.surfaces import refine

    on = inputs.get("under")
    below = None if on is None else bases.layers_of(on, inputs["wavelength"], inputs["layer"], context)
    cases, tolerance = slabs(inputs, below), context.tolerance
    shape = len(inputs["sigma_t"]), 1 if inputs["thickness"] is None else len(inputs["thickness"])
    needed = []
    for start in range(0, len(cases), _TOGETHER):  # a few at a time, so that progress can be reported
        try:
            needed += context.map(refine.converged, [(case, tolerance) for case in cases[start:start + _TOGETHER]])
        except ArithmeticError as fault:
            raise StageError(f"surface: {fault}") from None
        context.report(0.6 * len(needed) / len(cases))
    solutions, errors = zip(*alike(cases, needed, tolerance, context), strict=True)
    change = np.array(errors)
    context.report(0.8)
    values = stored(inputs, solutions, shape) | {"change": change.reshape(shape)}
    values |= _spread(cases, shape, context) | ({} if below is None else under.stored(cases, solutions, shape))
    context.report(1.0)
    worst = float(change.max())
    count = len(solutions[0].cut.moments)
    missed = f"{count} moments leave the reflectance an error of {worst:.2g}; a larger surface.tolerance would do"
    return Result(dict(datasets(OUTPUTS, values)), worst, (), (missed,) if worst > tolerance else ())


def _spread(cases: list, shape: tuple[int, int], context) -> dict:
    """Arrays of how far light spreads in the layers; none where that is not known of what lies under them."""
    if not spread.has_spread(cases[0]):
        return {}
    spreads = context.map(spread.spread_of, [(case, context.tolerance, context.seed, *divmod(k, shape[1]))
                                             for k, case in enumerate(cases)])
    return spread.stored(spreads, shape)


def stored(inputs: dict, solutions: list, shape: tuple[int, int]) -> dict:
    """The arrays of the group, but for the errors."""
    from bakery.physics.surfaces.slab import free

    first = solutions[0]
    leaving = len(first.albedo)
    values = {"index": [inputs["index"]], "roughness": [inputs["roughness"]], "cosine": first.nodes.air,
              "flux": first.nodes.flux[:leaving], "peak": [solution.cut.share for solution in solutions[::shape[1]]],
              "spherical_albedo": [solution.spherical_albedo for solution in solutions],
              "albedo": [np.clip(solution.albedo, 0, 1) for solution in solutions],
              "passed": [np.clip(solution.passed, 0, 1) for solution in solutions]}
    values = {name: np.asarray(value, float) for name, value in values.items()}
    for name in ("albedo", "passed", "spherical_albedo"):
        values[name] = values[name].reshape(*shape, *values[name].shape[1:])
    values["moments"] = np.array([len(first.cut.moments)])
    names = ("reflected", "transmitted") if free(first.slab) else ("reflected",)
    most = max(len(getattr(solution, name)) for solution in solutions for name in names)
    for name in names:
        pack = packed if name == "reflected" or first.slab.under is None else whole
        orders = [pack(getattr(solution, name), most) for solution in solutions]
        orders = np.stack(orders).reshape(*shape, *orders[0].shape)
        exact = integers(orders)  # and exponents, where they are rounded
        values |= {name: orders.astype(np.float32)} if exact is None else {name: exact[0], f"{name}_exponent": exact[1]}
    if inputs["thickness"] is not None:
        values["thickness"] = inputs["thickness"]
        values["depth"] = _depths(inputs)
    if inputs["base"] is not None:
        values["base"] = inputs["base"]
    return values


# ---- rules and plan


def sound(group: Group) -> Iterable[str]:
    """Whether the directions ascend, and there is a value for each pair of them."""
    cosine = group["cosine"].data
    if not (np.diff(cosine) > 0).all() or not cosine[0] >= 0:
        yield "cosine does not ascend from 0"
    pairs = len(cosine) * (len(cosine) + 1) // 2
    counts = {"reflected": pairs, "transmitted": len(cosine) ** 2 if "under_index" in group.members else pairs}
    yield from (f"{name} does not hold one value a pair of directions" for name, count in counts.items()
                if name in group.members and group[name].data.shape[-1] != count)
    for name in counts:
        yield from _exponents(name, group)
    if not group["index"].data[0] > 0:
        yield "index is not above 0"
    if "thickness" not in group.members and group["reflected"].data.shape[1] > 1:
        yield "thickness missing, of which there are several"
    yield from under.sound(group)


def _exponents(name: str, group: Group) -> Iterable[str]:
    """Whether integers have their powers of two."""
    scaled, exponent = (group.members.get(part) for part in (name, f"{name}_exponent"))
    if (exponent is not None) != (scaled is not None and scaled.data.dtype.kind in "iu"):
        yield f"{name} holds integers without {name}_exponent" if exponent is None else f"{name}_exponent without integers"
    if exponent is None or scaled is None:
        return
    if (np.abs(exponent.data.astype(int)) > 127).any():
        yield f"{name}_exponent holds other values than integers of -127 to 127"


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `surface` group, in words."""
    v = {name: np.asarray(member.data, float) for name, member in group.members.items()
         if isinstance(member, Dataset)}
    if (v["albedo"] + v["passed"] > 1 + _ROUNDING).any():
        yield "more light leaves than enters"
    enters = 1.0 if v["roughness"][0] > 0 else min(v["index"][0], 1.0)**2
    mean = enters * (v["albedo"] @ v["flux"]) / v["flux"].sum() + 1 - enters
    if not np.allclose(mean, v["spherical_albedo"], atol=_ROUNDING):
        yield "spherical_albedo is not the mean of albedo"
    if "spread" in v and (v["spread"].sum(axis=(3, 4)) > 1 + _ROUNDING).any():
        yield "spread holds more light than enters"
    if "transmitted" not in v and not {"base", "under_index", "under_reflected"} & v.keys() and "thickness" in v:
        yield "transmitted missing"
    if "under_index" in v and not {"base", "under_reflected", "transmitted"} & v.keys() and (v["under_depth"][:, -1] >= 0).all():
        yield "transmitted missing, which air below needs"


def cost(recipe) -> Cost:
    surface, count = recipe.surface, len(recipe.wavelength)
    layers = 1 if surface.thickness == INFINITE else len(surface.thickness)
    rough = surface.boundary != "none" and surface.boundary.roughness > 0
    layer = costs.expected(recipe)
    return Cost(layer.seconds * count * layers + (4.0 if rough else 0.0), 1.5e8, layer.file * count * layers + 3e4,
                f"{count} wavelengths, {layers} layers", 0.3, most=min(count * layers, _TOGETHER), blocks=count * layers,
                kernels=("multiple.legendre", "surfaces._spread", "surfaces.orders"))


def measures(group: Group, reference: Group) -> Mapping[str, float]:
    """Errors against a converged group: plane albedos at the reference's directions, and the spherical albedo."""
    from bakery.stages.surface.view import albedo_at

    cosine = reference["cosine"].data
    true = np.asarray(reference["albedo"].data, float)
    values = albedo_at(group, cosine)
    spherical = np.abs(group["spherical_albedo"].data - reference["spherical_albedo"].data).max()
    return {"error": float(np.max(np.abs(values - true) / np.maximum(true, 1e-3))), "spherical": float(spherical)}


STAGE = Stage(
    name="surface",
    version=15,
    title="reflectance of a plane layer",
    reads=("wavelengths", "seed", "surface"),
    needs=("medium",),
    applies=lambda recipe: recipe.surface is not None and recipe.grains is None,
    sections=(SURFACE,),
    outputs=OUTPUTS,
    together=TOGETHER,
    error_measure="largest relative error of reflectance and transmittance over angles to 89.9 degrees, as their change from two "
                  "thirds of the Legendre moments tells, and that by rounding; below a thousandth of the median, of that",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    tolerance_key="surface.tolerance",
    sound=sound,
    measures=measures,
    view=later("bakery.stages.surface.view:view"),
    pictures=later("bakery.stages.surface.pictures:pictures"),
    files=later("bakery.stages.surface.files:csv_tables"),
    queries=QUERIES,
)
