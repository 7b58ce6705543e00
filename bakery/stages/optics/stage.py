"""Stage `optics`: cross sections and phase functions of each component, averaged over its sizes."""

import hashlib
import math
from collections import deque
from collections.abc import Iterable

import numpy as np

from bakery.stages import declaration, measures, rules
from bakery.stages.declaration import ANY, Cost, Knob, Output, Result, Stage, datasets, later
from bakery.stages.optics import spheres
from bakery.stages.optics.elements import ELEMENTS
from bakery.stages.optics.quantities import QUERIES
from bakery.stages.optics.section import PARTICLES, PHASE
from bakery.store.tree import Dataset, Group, read_text, text

_KERNELS = ("mie.coefficients", "mie.angular")
_OF_SHELLS = ("mie.coated",)
_OF_RAYS = tuple(f"goa._{name}" for name in ("asymptotic", "edge", "field", "rays", "solve", "special", "surface"))
# the rates are those of an AMD EPYC (Zen 5), of which an Intel Xeon with AVX-512 has less than half: a machine in between
_SLOWER = 1.6
_RESTLESS = 1.75  # rays jump here and there: at tolerances of every angle, a few angles take many times the nodes of the others
_RAYS_LOADED = 1e8  # bytes
_LAST = deque(maxlen=2)  # recipes and what their averages are expected to take
METHODS = ("rayleigh", "mie", "goa")
WEIGHTS = 0.2  # of what a component may be off: what the weights of several add, from cross sections held to a tenth of it
OUTPUTS = (
    Output("theta", "(A,)", "rad", "angle between the directions of travel, from 0 (forward) to pi", within=(0, math.pi)),
    Output("COMPONENT/radius", "(R,)", "um", "quadrature nodes of the size distribution"),
    Output("COMPONENT/weight", "(R,)", "1", "share of the particle number at each node, adding up to 1", within=(0, 1)),
    Output("COMPONENT/mean_volume", "(1,)", "um^3", "mean volume of a particle, exact"),
    Output("COMPONENT/extinction", "(L, R)", "um^2", "extinction cross section of a sphere"),
    Output("COMPONENT/scattering", "(L, R)", "um^2", "scattering cross section of a sphere"),
    Output("COMPONENT/absorption", "(L, R)", "um^2", "absorption cross section of a sphere"),
    Output("COMPONENT/method", "(L, R)", "1", "how each sphere was computed", choices=METHODS),
    Output("COMPONENT/mean_extinction", "(L,)", "um^2", "extinction averaged over the distribution"),
    Output("COMPONENT/mean_scattering", "(L,)", "um^2", "scattering averaged over the distribution"),
    Output("COMPONENT/mean_absorption", "(L,)", "um^2", "absorption averaged over the distribution"),
    Output("COMPONENT/mean_absorption_bias", "(L,)", "um^2", "change of mean_absorption when nodes are halved", optional=True),
    Output("COMPONENT/error", "(L,)", "1", "largest relative error of phase function and mean cross sections, rays apart"),
    Output("COMPONENT/switch", "(L,)", "1", "size parameter from which amplitudes are by rays; 0: nowhere", optional=True),
    Output("COMPONENT/ray_difference", "(L,)", "1", "integral of |f - f by series| where rays take part, from sample spheres",
           optional=True),
    Output("COMPONENT/phase", "(L, A)", "1/sr", "phase function averaged by scattering, linear in cos theta"),
    Output("COMPONENT/phase_bias", "(L, A)", "1/sr", "estimated error of phase (and of s12, s33, s34): sizes, angles, rays",
           optional=True),
    *(Output(f"COMPONENT/{name}", "(L, A)", "1/sr", f"Mueller element {name}, in the scale of phase (= s11)", optional=True,
             within=ANY)
      for name in ELEMENTS),
)


def inputs(recipe, upstream) -> dict:
    from bakery.physics.averages import Rays

    phase = recipe.phase
    rays = Rays(phase.method, phase.orders, phase.rainbow, phase.axis, None if phase.edge == "none" else phase.edge, phase.switch)
    particles, host = recipe.particles, np.asarray(recipe.particles.host.n, float)
    return {"components": [spheres.component(part, host, particles.relative_humidity) for part in particles.components],
            "wavelength": np.asarray(recipe.wavelength, float), "host": host,
            "polarized": bool(phase.polarized), "rays": rays, "radii": phase.radii, "angles": phase.angles,
            "integrated": recipe.measure == "integrated"}


def share(components: int) -> float:
    """Of the tolerance, what each of so many components may be off, so that the medium of them all meets it."""
    return 1.0 if components == 1 else 1 / (1 + WEIGHTS)


def _asked(inputs, tolerance: float):
    """Components, wavelengths, host and aim, as `averages` takes them."""
    from bakery.physics.averages import Aim

    goal = {name: inputs[name] for name in Aim._fields if name not in ("tolerance", "sparse", "peaks")}
    return inputs["components"], inputs["wavelength"], inputs["host"], Aim(share(len(inputs["components"])) * tolerance, **goal)


def predicted(recipe):
    """The work that the averages of a recipe are expected to take."""
    return _expected(recipe)[0]


def _expected(recipe):
    from bakery.physics.averages import expected

    # plans ask several times for the same recipe, which cannot change
    for known, expectation in _LAST:
        if known is recipe:
            return expectation
    arguments = inputs(recipe, {})
    expectation = expected(*_asked(arguments, recipe.tolerance), remember=remember)
    _LAST.append((recipe, expectation))
    return expectation


def remember(measure, *asked):
    """`measure(*asked)`, a `Choice` of rays, or what an earlier plan or bake found for the very same arguments.

    Measuring takes seconds where spheres are large; plan, bake and the plan after it ask for the same.
    """
    memory = declaration.memory()
    if memory is None:
        return measure(*asked)
    # repr writes the shortest digits that give the same float back
    key = hashlib.sha256(repr((STAGE.version, asked)).encode()).hexdigest()
    entry = memory.get("rays", key)
    choice = _choice_of(entry[0]) if entry else None
    if choice is None:
        choice = measure(*asked)
        memory.put("rays", key, _kept(choice, key), Group())
    return choice


def _kept(choice, key: str) -> Group:
    return Group({"figures": Dataset(np.array([choice.switch, choice.error, choice.saved]), "1", "switch, error, share saved"),
                  "theta": Dataset(choice.theta, "rad", "sample angles"),
                  "difference": Dataset(choice.difference, "1/sr", "largest difference of the phase functions near each angle"),
                  "why": text(choice.why, "the choice in words")}, {"input_hash": key})


def _choice_of(group: Group):
    """The choice that a group holds; None where it holds something else."""
    from bakery.physics.averages.choice import Choice

    try:
        figures, theta, difference = (np.asarray(group[name].data, float) for name in ("figures", "theta", "difference"))
        why = read_text(group["why"])
    except (KeyError, AttributeError, ValueError):
        return None
    if figures.shape != (3,) or theta.ndim != 1 or theta.shape != difference.shape or np.isnan(figures).any():
        return None
    return Choice(*figures.tolist(), theta, difference, why)


def cost(recipe) -> Cost:
    from bakery.physics.averages.predicted import LOADING

    expectation, channels, choices = _expected(recipe)
    rays, coated = any(choice.taken for choice in choices), any(channel.coated for channel in channels)
    seconds = _SLOWER * expectation.seconds * (_RESTLESS if rays and recipe.measure == "pointwise" else 1.0)
    return Cost(seconds, expectation.memory + rays * _RAYS_LOADED, expectation.file,
                f"about {expectation.angles} angles, {expectation.spheres} spheres, {seconds:.2g} s of one core by the rates of "
                f"benchmarks/averages.py; {LOADING:g} s to load kernels", LOADING, _remarks(channels, choices),
                kernels=_KERNELS + rays * _OF_RAYS + coated * _OF_SHELLS, kind=f"{'rays' if rays else 'series'} {recipe.measure}")


def _remarks(channels, choices) -> tuple[str, ...]:
    """One line for each component, or for each wavelength where they differ."""
    lines = {}
    for channel, choice in zip(channels, choices):
        lines.setdefault((channel.component, choice.why), []).append(f"{channel.wavelength:g}")
    return tuple(f"{component} at {', '.join(at)} um: {'' if 'rays' in why else 'series only; '}{why}"
                 for (component, why), at in lines.items())


def compute(inputs: dict, context) -> Result:
    from bakery.physics.averages import averages, expected

    asked = _asked(inputs, context.tolerance)
    expectation = expected(*asked, remember=remember)
    whole = expectation[0].seconds

    def report(seconds, error):
        done = seconds / max(whole, 1e-9)  # of the work that was expected: more may be needed, and does not stop the bar
        context.report(done if done < 0.8 else 1 - 0.04 / (done - 0.6), error)

    theta, by_component = averages(*asked, map=context.map, report=report, expectation=expectation)
    members: dict[str, Dataset | Group] = dict(datasets(OUTPUTS, {"theta": theta}))
    notes, missed, reached = [], [], 0.0
    for component, average in zip(inputs["components"], by_component):
        members[component.name] = _group(component, average, inputs["wavelength"], inputs["host"])
        notes += _notes(component, average, inputs["wavelength"], context.tolerance)
        missed += _missed(component, average, inputs, context.tolerance)
        reached = max(reached, float(average.error.max()), *(choice.error for choice in average.choices))
    context.report(1.0, reached)
    return Result(members, reached, tuple(notes), tuple(missed))


def _notes(component, average, wavelength, tolerance) -> Iterable[str]:
    worst = int(np.argmax(average.absorption_bias))
    if average.absorption_bias[worst] > tolerance:
        absorption, extinction = (mean[worst] for mean in _means(average))
        yield (f"{component.name} at {wavelength[worst]:g} um: the mean absorption, {absorption / extinction:.1g} of "
               f"the extinction, changed by {100 * average.absorption_bias[worst]:.2g} % in the last halving: spheres that "
               "hardly absorb do so in resonances narrower than any grid")


def _missed(component, average, inputs, tolerance) -> Iterable[str]:
    """Why a tolerance was not met, and what would do."""
    wavelength, worst = inputs["wavelength"], int(np.argmax(average.error))
    if average.error[worst] > tolerance:
        where, error = f"{component.name} at {wavelength[worst]:g} um", average.error[worst]
        if inputs["radii"] or inputs["angles"]:
            yield (f"{where}: the numbers of sizes and angles that phase.radii and phase.angles fix leave an error of "
                   f"{error:.2g}; auto would do")
        else:
            yield (f"{where}: sums over as many sizes as are tried leave an error of {error:.2g}; a larger tolerance, a wider "
                   "size distribution or a little absorption would do")
    for at, choice in zip(wavelength, average.choices):
        if choice.error > tolerance:
            yield (f"{component.name} at {at:g} um: rays from size parameter {choice.switch:.3g} are off by {choice.error:.2g} "
                   "of the light; method: auto would keep to the tolerance")


def _means(average):
    scattering = np.sum(average.scattering * average.weight, axis=-1)
    absorption = np.sum(average.absorption * average.weight, axis=-1)
    return absorption, scattering + absorption


def _group(component, average, wavelength, host) -> Group:
    x = 2 * np.pi * (host / wavelength)[:, None] * average.radius
    switch = np.array([choice.switch for choice in average.choices])
    mean_absorption, mean_extinction = _means(average)
    mean_scattering = np.sum(average.scattering * average.weight, axis=-1)
    values = {
        "radius": average.radius, "weight": average.weight, "mean_volume": np.array([component.sizes.mean_volume]),
        "extinction": average.scattering + average.absorption, "scattering": average.scattering, "absorption": average.absorption,
        "method": np.where(x >= switch[:, None], METHODS.index("goa"), METHODS.index("mie")).astype(np.uint8),
        "switch": np.where(np.isfinite(switch), switch, 0.0),
        "ray_difference": np.array([choice.error for choice in average.choices]),
        "mean_extinction": mean_extinction, "mean_scattering": mean_scattering,
        "mean_absorption": mean_absorption, "mean_absorption_bias": average.absorption_bias * mean_absorption,
        "error": average.error, "phase": average.elements[:, 0], "phase_bias": average.phase_bias,
    }
    values |= dict(zip(ELEMENTS, np.moveaxis(average.elements[:, 1:], 1, 0), strict=False))
    return Group(datasets(OUTPUTS, values, "COMPONENT/"))


def sound(group: Group) -> Iterable[str]:
    """Whether angles and radii ascend."""
    yield from rules.angles(group["theta"].data)
    for name, part in group.members.items():
        if isinstance(part, Group):
            radius = part["radius"].data
            if not ((radius > 0).all() and (np.diff(radius) >= 0).all()):
                yield f"{name}: radius not above 0 and ascending"


def check(group: Group) -> Iterable[str]:
    """Broken rules of an `optics` group, in words."""
    for name, member in group.members.items():
        if isinstance(member, Group):
            yield from (f"{name}: {fault}" for fault in _check_component(member, group["theta"].data))


def _check_component(group: Group, theta) -> Iterable[str]:
    values = {name: np.asarray(member.data) for name, member in group.datasets.items()}
    weight = values["weight"]
    if abs(weight.sum() - 1) > 1e-12:
        yield "weight does not add up to 1"
    for prefix in ("", "mean_"):
        ext, sca, ab = (values[prefix + kind] for kind in ("extinction", "scattering", "absorption"))
        if not np.allclose(ext, sca + ab, rtol=1e-12, atol=0):
            yield f"{prefix}extinction is not {prefix}scattering + {prefix}absorption"
    for kind in ("extinction", "scattering", "absorption"):
        if not np.allclose(values["mean_" + kind], np.sum(values[kind] * weight, axis=-1), rtol=1e-12, atol=0):
            yield f"mean_{kind} is not the weighted sum of {kind}"
    if (switch := values.get("switch")) is not None and ((switch < 30) & (switch != 0)).any():
        yield "switch to rays below size parameter 30"
    if not (values["mean_volume"] > 0).all():
        yield "mean_volume not above 0"
    yield from rules.phase_function(theta, values["phase"], [values.get(name) for name in ELEMENTS])


STAGE = Stage(
    name="optics",
    version=12,
    title="single scattering of each component, averaged over its sizes",
    reads=("wavelengths", "tolerance", "measure", "particles.host", "particles.components[*].name",
           "particles.components[*].material", "particles.components[*].size", "particles.components[*].coating",
           "particles.components[*].growth", "particles.relative_humidity", "phase"),
    needs=(),
    applies=lambda recipe: recipe.particles is not None,
    outputs=OUTPUTS,
    together=(tuple(f"COMPONENT/{name}" for name in ELEMENTS),),
    error_measure="largest relative change, when the nodes over size are halved, of any mean cross section (absorption: relative "
                  "to at least 0.01 tolerance times extinction) and of the phase function at any angle, there with the error of "
                  "linear interpolation in cos theta half-way between angles; in troughs between ripples of (nearly) equal "
                  "spheres relative to the lower crest beside them (with measure: integrated, instead of all this the integral "
                  "of the phase function's error over the sphere); or, where rays stand for series, the integral of the "
                  "difference that they make to the phase function over the sphere, if that is larger",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    sound=sound,
    knobs=(
        Knob("tolerance", "tolerance", 0.01, "largest error of cross sections and phase function",
             ("30%", "10%", "3%", "1%", "0.3%")),
        Knob("measure", "measure", "pointwise", "where the tolerance of the phase function holds", ("integrated", "pointwise")),
        Knob("method", "phase.method", "auto", "series, rays, or rays where they are good enough and save time",
             ("goa", "auto", "mie")),
        Knob("switch", "phase.switch", "auto", "size parameter from which rays are taken", ("30", "100", "300", "1000", "3000")),
        Knob("orders", "phase.orders", 3, "highest number of chords of a ray", ("1", "3", "6", "12")),
        Knob("edge", "phase.edge", "narrow", "window of exact waves at the edge", ("none", "narrow", "wide")),
        Knob("rainbow", "phase.rainbow", True, "uniform formula at rainbows", ("false", "true")),
        Knob("axis", "phase.axis", True, "uniform formula on the axis", ("false", "true")),
        Knob("radii", "phase.radii", "auto", "number of sizes", ("33", "65", "129", "257", "513", "1025")),
        Knob("angles", "phase.angles", "auto", "number of angles", ("91", "181", "361", "721", "1801")),
    ),
    measures=measures.optics,
    sections=(PARTICLES, PHASE),
    reference={"measure": "pointwise", "phase.method": "mie", "phase.radii": "auto", "phase.angles": "auto",
               "phase.switch": "auto"},
    pictures=later("bakery.stages.optics.pictures:pictures"),
    remarks=later("bakery.stages.optics.methods:remarks"),
    view=later("bakery.stages.optics.view:view"),
    queries=QUERIES,
)
