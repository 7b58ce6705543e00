"""Stage `medium`: what a continuous renderer needs, from particles or from given coefficients."""

from collections.abc import Iterable

import numpy as np

from bakery.errors import StageError
from bakery.stages import rules
from bakery.stages.declaration import Cost, Result, Stage, datasets, later
from bakery.stages.medium import of_file
from bakery.stages.medium.expansion import QUERIES
from bakery.stages.medium.outputs import OUTPUTS, members_of
from bakery.stages.medium.section import MEDIUM, coefficients, phase_keys
from bakery.stages.optics import stage as optics
from bakery.stages.optics.amounts import AMOUNTS, amounts
from bakery.stages.optics.spheres import dry
from bakery.store.tree import Group

_ANALYTIC = 0.1  # share of the tolerance for phase functions that are formulas: angles cost nothing there


def _inputs_of_particles(recipe, upstream) -> dict:
    particles, group = recipe.particles, upstream["optics"]
    names = [c.name for c in particles.components]

    def stacked(path):
        return np.stack([np.asarray(group[f"{name}/{path}"].data, float) for name in names])

    fields = ["phase"] + [name for name in optics.ELEMENTS if name in group[names[0]].members]
    volume = stacked("mean_volume")[:, 0]
    number, fraction = amounts(particles, *dry(particles))
    return {
        "names": names, "fraction": fraction, "number_density": number, "mean_volume": volume,
        "scattering": stacked("mean_scattering"), "absorption": stacked("mean_absorption"),
        "absorption_bias": stacked("mean_absorption_bias"),
        "elements": np.stack([stacked(name) for name in fields], axis=2),
        "phase_bias": stacked("phase_bias"), "error": stacked("error"),
        "theta": np.asarray(group["theta"].data, float), "wavelength": np.asarray(recipe.wavelength, float),
        "host_k": np.asarray(particles.host.k, float),
    }


def _compute_of_particles(inputs: dict, context) -> Result:
    from bakery.physics.medium import mixing

    fraction, volume = inputs["fraction"], inputs["mean_volume"]
    number = inputs["number_density"]
    filled = mixing.volume_fraction(fraction, volume, number)
    if filled > 1:
        raise StageError(f"{number:.3g} particles per m^3 would fill {filled:.3g} of the volume; "
                         "a smaller number_density, volume or mass would do")
    sigma_s, sigma_a, elements, bias = mixing.mixed(
        fraction, number, inputs["scattering"], inputs["absorption"], inputs["elements"], inputs["phase_bias"], inputs["theta"])
    host = (1 - filled) * mixing.bulk_absorption(inputs["host_k"], inputs["wavelength"])
    notes = []
    if filled > 0.01:
        notes.append(
            f"particles fill {100 * filled:.2g} % of the volume: beyond about 1 % spheres no longer scatter independently, "
            "as assumed")
    if (host > context.tolerance * sigma_a).any():
        notes.append(
            f"the host absorbs up to {host.max():.2g} /m; that is added to sigma_a, the spheres are computed for its real index")
    # a weighted mean is no worse than its worst part; the weights of several parts are off by the error of cross sections
    worst = float(inputs["error"].max()) + (optics.WEIGHTS * optics.share(len(fraction)) * context.tolerance
                                            if len(fraction) > 1 else 0.0)
    context.report(1.0, worst)
    members = members_of(sigma_s, sigma_a + host, inputs["theta"], elements)
    absorbed = mixing.coefficient(fraction, number, inputs["absorption_bias"])
    # sigma_tr goes like the square root of sigma_a
    half = np.divide(0.5 * absorbed, sigma_a + host, out=np.zeros_like(absorbed), where=sigma_a + host > 0)
    members |= datasets(OUTPUTS, {"phase_bias": bias, "sigma_a_bias": absorbed, "sigma_tr_bias": half * members["sigma_tr"].data})
    return Result(members, worst, tuple(notes))


def _inputs_of_coefficients(recipe, upstream) -> dict:
    if of_file.given(recipe.medium):
        return of_file.inputs(recipe)
    sigma_t, albedo = coefficients(recipe.medium)
    return {"sigma_t": sigma_t, "albedo": albedo, "wavelengths": len(recipe.wavelength)} | phase_keys(recipe.medium.phase)


def _compute_of_coefficients(inputs: dict, context) -> Result:
    if "file" in inputs:
        return of_file.compute(inputs, context, OUTPUTS, members_of)
    from bakery.physics.medium import analytic

    try:
        theta, values, bias, worst = analytic.tabulated(
            inputs["type"], _ANALYTIC * context.tolerance, inputs["wavelengths"], inputs["g"], inputs["spread"], inputs["table"])
    except ValueError as fault:
        raise StageError(f"phase function {inputs['type']}: {fault}") from None
    sigma_t, albedo = (np.broadcast_to(inputs[name], (inputs["wavelengths"],)).astype(float) for name in ("sigma_t", "albedo"))
    context.report(1.0, worst)
    members = members_of(albedo * sigma_t, (1 - albedo) * sigma_t, theta, values[:, None], sigma_t, albedo)
    return Result(members | datasets(OUTPUTS, {"phase_bias": bias}), worst)


def _cost_of_particles(recipe) -> Cost:
    angles, rows = optics.predicted(recipe).angles, len(recipe.wavelength) * (7 if recipe.phase.polarized else 3)
    return Cost(0.002 + 1e-6 * angles * rows, 8 * 4 * angles * rows + 2**20, 8 * angles * rows + 9000,
                f"{angles} angles, {len(recipe.wavelength)} wavelengths", kind="of particles")


def _cost_of_coefficients(recipe) -> Cost:
    from bakery.physics.medium import analytic

    if of_file.given(recipe.medium):
        angles = of_file.angles(recipe)
        return Cost(0.01 + 1e-6 * angles * len(recipe.wavelength), 8 * 12 * angles * len(recipe.wavelength) + 2**20,
                    8 * angles * 3 * len(recipe.wavelength) + 7000, f"about {angles} angles", kind="of a file")
    phase = phase_keys(recipe.medium.phase)
    g = phase["g"]
    angles = analytic.predicted_angles(phase["type"], _ANALYTIC * recipe.tolerance, g, phase["spread"], phase["table"])
    rows = 3 * (1 if g is None else len(np.unique(g)))  # equal rows pack to one
    return Cost(0.001 + 1e-5 * angles, 8 * 6 * angles * rows + 2**20, 8 * angles * (1 + rows) + 7000,
                f"about {angles} angles", kind="of coefficients")


def sound(group: Group) -> Iterable[str]:
    """Whether the angles ascend."""
    return rules.angles(group["theta"].data)


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `medium` group, in words."""
    from bakery.physics.medium import phase, similarity

    v = {name: np.asarray(member.data, float) for name, member in group.datasets.items()}

    def near(a, b):
        return np.allclose(a, b, rtol=1e-12, atol=0)

    if not near(v["sigma_t"], v["sigma_s"] + v["sigma_a"]):
        yield "sigma_t is not sigma_s + sigma_a"
    if not near(v["albedo"] * v["sigma_t"], v["sigma_s"]):
        yield "albedo is not sigma_s / sigma_t"
    yield from rules.phase_function(v["theta"], v["phase"], [v.get(name) for name in optics.ELEMENTS])
    if not np.allclose(v["g"], phase.mean_cosine(v["theta"], v["phase"]), rtol=0, atol=1e-12):
        yield "g is not the mean cosine of phase"
    for name, value in zip(("sigma_t_reduced", "albedo_reduced", "sigma_tr"),
                           similarity.reduced(v["sigma_s"], v["sigma_a"], v["g"])):
        if not near(v[name], value):
            yield f"{name} does not follow from sigma_s, sigma_a and g"
    cdf = v["cdf"]
    if (cdf[:, 0] != 0).any() or (cdf[:, -1] != 1).any() or (np.diff(cdf) < 0).any():
        yield "cdf does not rise from 0 to 1"
    elif not np.allclose(cdf, phase.cumulative(v["theta"], v["phase"]), rtol=0, atol=1e-12):
        yield "cdf is not the integral of phase"
    if "s11" in v and not near(v["s11"], v["phase"]):
        yield "s11 is not phase"


_VIEW = later("bakery.stages.medium.view:view")
_PICTURES = later("bakery.stages.effective.pictures:pictures")  # grains' medium is recognised by its members

OF_PARTICLES = Stage(
    name="medium",
    version=4,
    title="coefficients and phase function of the suspended particles",
    reads=("wavelengths", "tolerance", "particles.host", *(f"particles.{name}" for name in AMOUNTS),
           *(f"particles.components[*].{name}" for name in ("fraction", "name", "density", "coating", "growth", *AMOUNTS)),
           "particles.relative_humidity"),
    needs=("optics",),
    applies=lambda recipe: recipe.particles is not None,
    outputs=OUTPUTS,
    error_measure="largest relative error of sigma_t, sigma_s, albedo, g and of the phase function at any angle, as estimated by "
                  "optics; sigma_a has its own, sigma_a_bias",
    cost=_cost_of_particles,
    inputs=_inputs_of_particles,
    compute=_compute_of_particles,
    check=check,
    sound=sound,
    view=_VIEW,
    pictures=_PICTURES,
    tables=later("bakery.stages.medium.pictures:tables"),
    queries=QUERIES,  # of every medium, from whatever source
    rendered=True,
)

OF_COEFFICIENTS = Stage(
    name="medium",
    version=2,
    title="coefficients and phase function as given by the recipe",
    reads=("wavelengths", "tolerance", "medium"),
    needs=(),
    applies=lambda recipe: recipe.medium is not None,
    outputs=OUTPUTS,
    error_measure="largest relative error of the tabulated phase function between its angles; "
                  "a user's table is exact by definition, and a file of optical properties at its wavelengths; between them the "
                  "largest relative error of interpolation",
    cost=_cost_of_coefficients,
    inputs=_inputs_of_coefficients,
    compute=_compute_of_coefficients,
    check=check,
    sections=(MEDIUM,),
    sound=sound,
    view=_VIEW,
    pictures=_PICTURES,
    tables=later("bakery.stages.medium.pictures:tables"),
    rendered=True,
)
