"""Stage `optics`: cross sections and phase functions of each component, averaged over its sizes (Lorenz-Mie)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from bakery.errors import StageError
from bakery.stages import rules
from bakery.stages.declaration import Cost, Knob, Output, Result, Stage, datasets
from bakery.store.tree import Dataset, Group

METHODS = ("rayleigh", "mie", "goa")
ELEMENTS = ("s12", "s33", "s34")
_REQUIRED = ("radius", "weight", "extinction", "scattering", "absorption", "method", "mean_extinction", "mean_scattering",
             "mean_absorption", "phase")
OUTPUTS = (
    Output("theta", "(A,)", "rad", "angle between the directions of travel, from 0 (forward) to pi"),
    Output("COMPONENT/radius", "(R,)", "um", "quadrature nodes of the size distribution"),
    Output("COMPONENT/weight", "(R,)", "1", "share of the particle number at each node, adding up to 1"),
    Output("COMPONENT/mean_volume", "(1,)", "um^3", "mean volume of a particle, exact"),
    Output("COMPONENT/extinction", "(L, R)", "um^2", "extinction cross section of a sphere"),
    Output("COMPONENT/scattering", "(L, R)", "um^2", "scattering cross section of a sphere"),
    Output("COMPONENT/absorption", "(L, R)", "um^2", "absorption cross section of a sphere"),
    Output("COMPONENT/method", "(L, R)", "1", "how each sphere was computed", choices=METHODS),
    Output("COMPONENT/mean_extinction", "(L,)", "um^2", "extinction averaged over the distribution"),
    Output("COMPONENT/mean_scattering", "(L,)", "um^2", "scattering averaged over the distribution"),
    Output("COMPONENT/mean_absorption", "(L,)", "um^2", "absorption averaged over the distribution"),
    Output("COMPONENT/mean_absorption_error", "(L,)", "um^2", "change of mean_absorption when nodes are halved"),
    Output("COMPONENT/error", "(L,)", "1", "largest relative error of phase function and mean cross sections"),
    Output("COMPONENT/phase", "(L, A)", "1/sr", "phase function averaged by scattering, linear in cos theta"),
    Output("COMPONENT/phase_error", "(L, A)", "1/sr", "estimated error of phase (and of s12, s33, s34)"),
    *(Output(f"COMPONENT/{name}", "(L, A)", "1/sr", f"Mueller element {name}, in the scale of phase (= s11)", optional=True)
      for name in ELEMENTS),
)


def _population(component):
    from bakery.sizes import population

    try:
        return population(component.size)
    except ValueError as error:
        raise StageError(f"{component.name}: {error}") from None


def _components(recipe):
    """Components with indices relative to the host's real index: an absorbing host is `medium`'s affair (medium/mixing.py)."""
    from bakery.averages.predicted import Component

    host = np.asarray(recipe.particles.host.n, float)
    return [Component(c.name, (np.asarray(c.material.n, float) + 1j * np.asarray(c.material.k, float)) / host, _population(c))
            for c in recipe.particles.components]


def inputs(recipe, upstream) -> dict:
    return {"components": _components(recipe), "wavelength": np.asarray(recipe.wavelength, float),
            "host": np.asarray(recipe.particles.host.n, float), "polarized": bool(recipe.phase.polarized)}


def _prediction(recipe):
    from bakery.averages.predicted import predict

    return predict(_components(recipe), recipe.wavelength, recipe.particles.host.n, recipe.tolerance, recipe.phase.polarized)


def cost(recipe) -> Cost:
    from bakery.averages.predicted import startup

    made = _prediction(recipe)
    before, why = startup()
    return Cost(made.seconds, made.memory, made.file,
                f"about {made.angles} angles, {made.spheres} spheres, {made.seconds:.2g} s of one core by the rates of "
                f"benchmarks/averages.py; {before:g} s for {why}", before)


def compute(inputs: dict, context) -> Result:
    from bakery.averages import averages
    from bakery.averages.predicted import predict

    expected = predict(inputs["components"], inputs["wavelength"], inputs["host"], context.tolerance, inputs["polarized"]).seconds

    def report(seconds, error):
        context.report(min(seconds / max(expected, 1e-9), 0.99), error)

    theta, found = averages(inputs["components"], inputs["wavelength"], inputs["host"], context.tolerance, inputs["polarized"],
                            context.map, report)
    members: dict[str, Dataset | Group] = dict(datasets(OUTPUTS, {"theta": theta}))
    notes = []
    for component, average in zip(inputs["components"], found):
        members[component.name] = _group(component, average)
        worst = int(np.argmax(average.absorption_error))
        if average.absorption_error[worst] > context.tolerance:
            absorption, extinction = (mean[worst] for mean in _means(average))
            notes.append(
                f"{component.name} at {inputs['wavelength'][worst]:g} um: the mean absorption, {absorption / extinction:.1g} of "
                f"the extinction, changed by {100 * average.absorption_error[worst]:.2g} % in the last halving: spheres that "
                "hardly absorb do so in resonances narrower than any grid")
    context.report(1.0, max(float(a.error.max()) for a in found))
    return Result(members, max(float(a.error.max()) for a in found), tuple(notes))


def _means(average):
    scattering = np.sum(average.scattering * average.weight, axis=-1)
    absorption = np.sum(average.absorption * average.weight, axis=-1)
    return absorption, scattering + absorption


def _group(component, average) -> Group:
    mean_absorption, mean_extinction = _means(average)
    mean_scattering = np.sum(average.scattering * average.weight, axis=-1)
    values = {
        "radius": average.radius, "weight": average.weight, "mean_volume": np.array([component.sizes.mean_volume]),
        "extinction": average.scattering + average.absorption, "scattering": average.scattering, "absorption": average.absorption,
        "method": np.full(average.scattering.shape, METHODS.index("mie"), np.uint8),
        "mean_extinction": mean_extinction, "mean_scattering": mean_scattering,
        "mean_absorption": mean_absorption, "mean_absorption_error": average.absorption_error * mean_absorption,
        "error": average.error, "phase": average.elements[:, 0], "phase_error": average.phase_error,
    }
    values |= dict(zip(ELEMENTS, np.moveaxis(average.elements[:, 1:], 1, 0), strict=False))
    return Group(datasets(OUTPUTS, values, "COMPONENT/"))


def check(group: Group) -> Iterable[str]:
    """Broken rules of an `optics` group, in words."""
    theta = group["theta"].data if "theta" in group.members else None
    if theta is not None:
        faults = list(rules.angles(theta))
        yield from faults
        theta = None if faults else theta
    for name, member in group.members.items():
        if isinstance(member, Group):
            yield from (f"{name}: {fault}" for fault in _check_component(member, theta))


def _check_component(group: Group, theta) -> Iterable[str]:
    values = {name: np.asarray(member.data) for name, member in group.members.items() if isinstance(member, Dataset)}
    faults = list(rules.complete(values, _REQUIRED))
    yield from faults
    if faults:
        return
    radius, weight = values["radius"], values["weight"]
    if not ((radius > 0).all() and (np.diff(radius) >= 0).all()):
        yield "radius not above 0 and ascending"
    if (weight < 0).any() or abs(weight.sum() - 1) > 1e-12:
        yield "weight does not add up to 1"
    for prefix in ("", "mean_"):
        ext, sca, ab = (values[prefix + kind] for kind in ("extinction", "scattering", "absorption"))
        if (sca < 0).any() or (ab < 0).any():
            yield f"{prefix}scattering or {prefix}absorption below 0"
        if not np.allclose(ext, sca + ab, rtol=1e-12, atol=0):
            yield f"{prefix}extinction is not {prefix}scattering + {prefix}absorption"
    for kind in ("extinction", "scattering", "absorption"):
        if not np.allclose(values["mean_" + kind], np.sum(values[kind] * weight, axis=-1), rtol=1e-12, atol=0):
            yield f"mean_{kind} is not the weighted sum of {kind}"
    if values["method"].size and values["method"].max() >= len(METHODS):
        yield "method is none of " + ", ".join(METHODS)
    if "mean_volume" in values and not (values["mean_volume"] > 0).all():
        yield "mean_volume not above 0"
    if any((values[name] < 0).any() for name in ("error", "mean_absorption_error", "phase_error") if name in values):
        yield "an error estimate below 0"
    if theta is not None:
        yield from rules.phase_function(theta, values["phase"], [values.get(name) for name in ELEMENTS])
    elif (values["phase"] < 0).any():
        yield "phase below 0"


STAGE = Stage(
    name="optics",
    version=2,
    title="single scattering of each component, averaged over its sizes",
    reads=("wavelengths", "tolerance", "particles.host", "particles.components[*].name", "particles.components[*].material",
           "particles.components[*].size", "phase.method", "phase.polarized"),
    needs=(),
    applies=lambda recipe: recipe.particles is not None,
    outputs=OUTPUTS,
    error_measure="largest relative change, when the nodes over size are halved, of any mean cross section (absorption: relative "
                  "to at least 0.01 tolerance times extinction) and of the phase function at any angle, there with the error of "
                  "linear interpolation in cos theta half-way between angles; for (nearly) equal spheres relative to the "
                  "nearest crest",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    knobs=(Knob("tolerance", "tolerance", 0.01, "largest relative error of cross sections and phase function"),),
)
