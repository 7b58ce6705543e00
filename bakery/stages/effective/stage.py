"""Stage `medium` from packed grains: the continuous medium that stands for them, held against a walk through the grains."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from bakery.errors import StageError
from bakery.physics.granular.kinds import CHOICES
from bakery.physics.packing.tiles import tile_of
from bakery.physics.shapes.limits import share_hit
from bakery.stages.coordinates import BIAS
from bakery.stages.declaration import ANY, Cost, Knob, Output, Result, Stage, datasets, later
from bakery.stages.effective.section import EFFECTIVE
from bakery.stages.grains.outputs import BY_RADIUS, LOSSLESS
from bakery.stages.grains.section import shape_keys
from bakery.stages.grains.stage import inputs as inputs_of_grains
from bakery.stages.measures import integrated_difference
from bakery.stages.medium import stage as medium
from bakery.stages.members import Members
from bakery.store.tree import Group

_LOADING = 0.2
# hits times the squared tolerance; seconds of one core of a hit on a mesh, on a ball, of a sphere that is entered
_HITS, _HIT, _HIT_BALL, _SPHERE = 60.0, 1.2e-6, 0.6e-6, 0.5e-6
_NAMES = ("hit_probability", "lambda_delta", "albedo", "lambda_s", "mean_square", "g", "forward_delta")
_WALK = (
    ("mean_square_displacement", "m^2", "mean square displacement that a hit adds at long times"),
    ("mean_square_rte", "m^2", "the same in a medium with the walks' own mean free path, lambda_t, and mean cosine"),
    ("flight", "m", "mean path from leaving the sphere of one hit to entering that of the next"),
    ("void_chord", "m", "mean flight from sphere to sphere"),
    ("hit_probability", "1", "share of the entered spheres whose grain is hit"),
    ("lambda_s", "m", "mean displacement from entry to exit of a hit's sphere along the incoming direction"),
    ("g", "1", "mean cosine of a hit"),
    ("correlation", "1", "between the lengths of successive flights"),
)
OUTPUTS = (
    *(output for output in medium.OUTPUTS if not output.path.endswith(BIAS)),
    Output("phase_error", "(L, A)", "1/sr", "standard error of phase"),
    Output("sigma_t_error", "(L,)", "1/m", "standard error of sigma_t"),
    Output("sigma_t_bias", "(L,)", "1/m", "difference from the sigma_t that matches the random walk", optional=True),
    Output("albedo_error", "(L,)", "1", "standard error of albedo"),
    Output("fraction", "(1,)", "1", "share of the volume in bounding spheres", within=(0, 1)),
    Output("tile_fraction", "(1,)", "1", "the `fraction` of the tile of `packing` in which the grains stand, widened to that of "
           "the medium; absent in assets of version 6 of this stage and before", optional=True, within=(0, 1)),
    Output("hit_probability", "(1,)", "1", "share of the spheres on light's path whose grain it hits", within=(0, 1)),
    Output("hit_probability_error", "(1,)", "1", "standard error of hit_probability"),
    Output("void_chord", "(1,)", "m", "mean free path between bounding spheres (Eq. 1)"),
    Output("lambda_beta", "(1,)", "m", "mean path from hit to hit, outside of the spheres hit (Eq. 3)"),
    Output("lambda_beta_error", "(1,)", "m", "standard error of lambda_beta"),
    Output("lambda_s", "(L,)", "m", "mean displacement from entry to exit of a hit sphere along the incoming ray", within=ANY),
    Output("lambda_s_error", "(L,)", "m", "standard error of lambda_s"),
    Output("mean_square", "(L,)", "m^2", "mean squared distance of entry and exit"),
    Output("mean_square_error", "(L,)", "m^2", "standard error of mean_square"),
    Output("forward_delta", "(L,)", "1", "unscattered (delta) share of scattered light; part of phase, below theta[1]",
           within=(0, 1)),
    Output("forward_delta_error", "(L,)", "1", "standard error of forward_delta"),
    *(Output(f"sigma_t_{name}{end}", "(L,)", "1/m", ("standard error of sigma_t_" + name) if end else description,
             optional=name == "random_walk")
      for name, description in (("mean_flight", "1/(lambda_beta + albedo lambda_s) (Eq. 4)"),
                         ("second_moment", "with the mean square displacement of light that is teleported by grains"),
                         ("random_walk", "with the mean square displacement of the random walk through explicit grains"))
      for end in ("", "_error")),
    Output("diffusion_coefficient", "(L,)", "m", "improved (Grosjean) diffusion coefficient"),
    Output("sigma_tr_improved", "(L,)", "1/m", "effective transport coefficient with it"),
    *(Output(f"random_walk/{name}{end}", "(1,)", units, ("standard error of " + name) if end else description, optional=True,
             within=ANY if not end and name in ("g", "correlation", "lambda_s", "mean_square_displacement") else (0, math.inf))
      for name, units, description in _WALK for end in ("", "_error")),
    Output("random_walk/hits", "(1,)", "1", "hits that were walked", optional=True),
    Output("random_walk/wavelength", "(1,)", "um", "whose indices the grains had; nothing is absorbed", optional=True),
)


def inputs(recipe, upstream) -> dict:
    group, fraction = upstream["grains"], float(recipe.packing.fraction[0])
    *tile, tile_fraction = tile_of(Members(upstream["packing"], "packing"), {"fraction": [fraction]})
    names = [grain.name for grain in recipe.grains.components]
    arguments = inputs_of_grains(recipe, {})
    sizes = len(group["radius"].data)

    def rows(name, figure, lossless=False):
        """Values and errors (S, L, …)."""
        part = group[name]
        source = part["lossless"] if lossless and figure in LOSSLESS else part
        if not lossless and "by_radius" in part.members and figure in (*BY_RADIUS, "phase"):
            source = part["by_radius"]
            return np.asarray(source[figure].data, float), np.asarray(source[figure + "_error"].data, float)
        value, error = (np.asarray(source[figure + end].data, float) for end in ("", "_error"))
        return np.repeat(value[None], sizes, axis=0), np.repeat(error[None], sizes, axis=0)

    figures = (*_NAMES, "phase")
    return {
        "names": names, "weights": [float(group[f"{name}/weight"].data[0]) for name in names],
        "parts": [{figure: rows(name, figure) for figure in figures} for name in names],
        "lossless": [{figure: rows(name, figure, True) for figure in figures} for name in names],
        "radius": np.asarray(group["radius"].data, float), "share": np.asarray(group["radius_share"].data, float),
        "theta": np.asarray(group["theta"].data, float), "fraction": fraction, "mean_radius": arguments["radius"],
        "tile": tile, "tile_fraction": tile_fraction, "components": arguments["components"], "depth": arguments["depth"],
        "meshes": [(group[f"{name}/vertices"].data, group[f"{name}/faces"].data) for name in names],
        "wavelength": np.asarray(recipe.wavelength, float),
        "choice": None if recipe.effective_medium.sigma_t == "auto" else recipe.effective_medium.sigma_t,
        "walks": recipe.effective_medium.walks}


# ---- work


def _means(parts, inputs, lossless=False):
    """Means of the mixture over components and sizes, lengths in m."""
    from bakery.physics.granular.effective import mixed_of_sizes

    return mixed_of_sizes([{name: value for name, (value, _) in part.items()} for part in parts],
                          [{name: error for name, (_, error) in part.items()} for part in parts],
                          inputs["weights"], inputs["radius"], inputs["share"], lossless)


def compute(inputs: dict, context) -> Result:
    from bakery.physics.granular import choice
    from bakery.physics.granular.effective import effective, void_chord
    from bakery.physics.medium import diffusion, phase

    R, tile = inputs["mean_radius"], inputs["tile"]
    chord = void_chord(inputs["fraction"], R * tile[1])
    means, white = _means(inputs["parts"], inputs), _means(inputs["lossless"], inputs, lossless=True)
    coefficients, lossless = effective(means, chord), effective(white, chord)
    at = len(inputs["wavelength"]) // 2
    # light that passes hundreds of spheres between hits has forgotten where the last one was: Eq. 4 is exact in that limit
    rare = means.hit_probability < context.tolerance and inputs["choice"] != "random_walk" and inputs["walks"] is None
    walks = None if rare else _walked(inputs, at, context)
    try:
        match = choice.matched(coefficients, lossless, walks, R, at, inputs["choice"])
    except ValueError as fault:
        raise StageError(f"effective_medium.sigma_t: {fault}; mean_flight would do") from None
    notes, missed = _remarks(match, walks, means.hit_probability, inputs, context.tolerance)
    sigma_t = match.sigma_t
    theta, f = inputs["theta"], means.phase
    f, _ = phase.normalised(theta, phase.with_delta(theta, f, means.forward_delta))
    albedo = np.clip(means.albedo, 0.0, 1.0)
    sigma_s = albedo * sigma_t
    sigma_a = sigma_t - sigma_s
    # spread over the table in proportion to what is not in the peak
    error = means.errors["phase"] * (1 - means.forward_delta[:, None])
    members = medium.members_of(sigma_s, sigma_a, theta, f[:, None], sigma_t, albedo)
    single = {"fraction": inputs["fraction"], "tile_fraction": inputs["tile_fraction"], "hit_probability": means.hit_probability,
              "hit_probability_error": means.errors["hit_probability"], "void_chord": chord,
              "lambda_beta": coefficients.lambda_beta, "lambda_beta_error": coefficients.errors["lambda_beta"]}
    values = {name: np.array([float(value)]) for name, value in single.items()}
    values |= {"phase_error": error, "sigma_t_error": match.error, "albedo_error": means.errors["albedo"]}
    if match.walked:
        values["sigma_t_bias"] = match.bias
    for name in ("lambda_s", "mean_square", "forward_delta"):
        values[name], values[name + "_error"] = getattr(means, name), means.errors[name]
    for name, (value, error) in match.each.items():
        values["sigma_t_" + name], values[f"sigma_t_{name}_error"] = value, error
    values["diffusion_coefficient"], values["sigma_tr_improved"] = diffusion.improved(sigma_s, sigma_a, members["g"].data)
    members |= datasets(OUTPUTS, values)
    if match.walked:
        members["random_walk"] = Group(_walk_members(walks, R, inputs["wavelength"][at]))
    total = np.hypot(match.error, match.bias)
    relative = float(np.max(np.divide(total, sigma_t, out=np.zeros_like(sigma_t), where=sigma_t > 0)))
    turned = _turned_wrongly(albedo, means, phase.mean_cosine(theta, f))
    if turned > context.tolerance:
        missed.append("grains turn light by less than the table of the phase function shows: its 1 - albedo g is off by "
                      f"{turned:.0%}")
    reached = max(abs(match.farther), relative, match.spread, turned, means.hit_probability if rare else 0.0)
    context.report(1.0, reached)
    return Result(members, reached, tuple(notes), tuple(missed))


def _remarks(match, walks, hit_probability: float, inputs: dict, tolerance: float) -> tuple[list[str], list[str]]:
    """Notes on the extinction, and what misses the tolerance; walks : None where there was no random walk"""
    notes, missed = [], []
    if walks is None:
        notes.append(f"light hits one in {1 / hit_probability:,.0f} grains on its way, so that the mean flight is right to "
                     f"{hit_probability:.2g}: there was no random walk")
    elif not match.walked:
        notes.append(f"the random walk gives no mean square displacement: {walks.reason}")
    elif abs(match.farther) > max(3 * match.spread, tolerance):
        direction = "farther" if match.farther > 0 else "less far"
        missed.append(f"light among the grains themselves spreads {abs(match.farther):.0%} {direction} than sigma_t says; "
                      "effective_medium.sigma_t: random_walk matches it")
    if match.walked and inputs["walks"] is None and not walks.reached:
        missed.append(f"the random walk's mean square displacement is known to {2 * match.spread:.2g} only: {walks.reason}")
    return notes, missed


def _turned_wrongly(albedo, means, g) -> float:
    """Relative error of 1 - albedo g with the g (L,) of a table, largest of the wavelengths; 0 where grains turn no light."""
    away = 1 - albedo * means.g
    off = np.divide(albedo * np.abs(g - means.g), away, out=np.zeros_like(away), where=(means.forward_delta < 1) & (away > 0))
    return float(np.max(off))


def _walked(inputs, at, context):
    """Random walks through the tile; nothing is absorbed, indices are those of wavelength number `at`."""
    from bakery.physics.grains import bvh, surface
    from bakery.physics.granular import packed

    grains = []
    for component, (vertices, faces) in zip(inputs["components"], inputs["meshes"]):
        index = None if component["index"] is None else component["index"].real[at]
        grains.append(packed.Grain(surface.lossless(component["type"], index, component["roughness"]),
                                 None if component["shape"]["type"] == "sphere" else bvh.Mesh(vertices, faces)))
    return packed.walk(inputs["tile"], grains, inputs["weights"], seed=context.seed, hits=inputs["walks"], depth=inputs["depth"],
                       tolerance=max(0.5 * context.tolerance, 1e-4), map=context.map,
                       report=lambda share, error: context.report(share, error, "random walk through the grains"))


def _walk_members(walks, R, wavelength):
    values = {}
    for name, units, _ in _WALK:
        scale = R ** {"m": 1, "m^2": 2}.get(units, 0)
        values[name], values[name + "_error"] = getattr(walks, name) * scale, walks.errors[name] * scale
    values |= {"hits": walks.hits, "wavelength": wavelength}
    return datasets(OUTPUTS, {name: np.array([float(value)]) for name, value in values.items()}, "random_walk/")


# ---- rules and plan


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `medium` group from grains, in words."""
    yield from medium.check(group)
    v = {name: member.data for name, member in group.datasets.items()}
    if not np.allclose(v["sigma_t_mean_flight"] * (v["lambda_beta"] + v["albedo"] * v["lambda_s"]), 1, rtol=1e-9):
        yield "sigma_t_mean_flight is not 1/(lambda_beta + albedo lambda_s)"
    if not any(np.array_equal(v["sigma_t"], v.get("sigma_t_" + name)) for name in CHOICES):
        yield "sigma_t is none of " + ", ".join("sigma_t_" + name for name in CHOICES)


def cost(recipe) -> Cost:
    number = len(recipe.grains.components)
    hits = recipe.effective_medium.walks or min(max(_HITS / recipe.tolerance**2, 32 * 512 * 2), 1 << 27)
    round_ = all(grain.shape["type"] == "sphere" for grain in recipe.grains.components)
    share = sum(grain.weight * share_hit(shape_keys(grain.shape)) for grain in recipe.grains.components)
    if share < recipe.tolerance and not recipe.effective_medium.walks and recipe.effective_medium.sigma_t != "random_walk":
        hits = 0
    seconds = hits * max(_HIT_BALL if round_ else _HIT, _SPHERE / share)
    rows = len(recipe.wavelength)
    return Cost(seconds, 1e8 + 300.0 * recipe.scatterometer.triangles * number, 8 * 4 * 190 * rows + 2e4,
                f"about {hits:.2g} hits of a random walk through explicit grains", _LOADING + 0.1 * number,
                kernels=("granular._packed", "packing.cells", "packing.instances"), kind="of grains")


def measures(group: Group, reference: Group) -> Mapping[str, float]:
    """Errors of a `medium` group from grains against a converged one.

    Returns
    -------
    dict of floats, in this order, each the largest over wavelengths

    error : the largest of `spread` and half of `phase`
    spread : relative difference of sigma_t from the one that makes light spread as in the explicit grains
    albedo, g : differences
    phase : integral of |f - f_ref| over the sphere
    """
    true = reference["sigma_t_random_walk" if "sigma_t_random_walk" in reference.members else "sigma_t"].data
    errors = {"spread": np.abs(group["sigma_t"].data / true - 1)}
    errors |= {name: np.abs(group[name].data - reference[name].data) for name in ("albedo", "g")}
    errors["phase"] = integrated_difference(reference["theta"].data, group["phase"].data, reference["phase"].data)
    largest = {name: float(np.max(value)) for name, value in errors.items()}
    return {"error": max(largest["spread"], 0.5 * largest["phase"])} | largest


OF_GRAINS = Stage(
    name="medium",
    version=7,
    title="the continuous medium that stands for the packed grains",
    reads=("wavelengths", "tolerance", "seed", "grains.radius", "grains.components[*].weight", "packing.fraction",
           "effective_medium"),
    needs=("packing", "grains"),
    applies=lambda recipe: recipe.grains is not None,
    sections=(EFFECTIVE,),
    outputs=OUTPUTS,
    error_measure="how far light spreads with sigma_t against a random walk through the explicit grains of the tile (relative "
                  "difference of the square roots of the mean square displacements, nothing absorbed); or the standard error of "
                  "that, or of sigma_t, or the relative error of 1 - albedo g with the table's g, if larger; where fewer grains "
                  "are hit than the tolerance asks for, the hit probability",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    sound=medium.sound,
    view=later("bakery.stages.medium.view:view"),
    measures=measures,
    knobs=(Knob("sigma_t", "effective_medium.sigma_t", "auto", "what sigma_t matches", CHOICES),
           Knob("walks", "effective_medium.walks", "auto", "hits of the random walk", ("10000", "100000", "1000000"))),
    pictures=later("bakery.stages.effective.pictures:pictures"),
    tables=later("bakery.stages.medium.pictures:tables"),
    rendered=True,
)
