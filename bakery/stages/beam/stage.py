"""Stage `beam`: how a narrow beam spreads in the medium, as tables over depth and distance from its axis."""

from collections.abc import Iterable, Mapping

import numpy as np

from bakery.errors import StageError
from bakery.physics.beam import predicted
from bakery.physics.beam.kinds import MEASURES, MODELS
from bakery.stages.beam.section import BEAM, LARGEST
from bakery.stages.beam.view import tables_of
from bakery.stages.declaration import Cost, Knob, Output, Result, Stage, datasets, later
from bakery.store.tree import Group

_SAID = {"fluence": "scattered light of all directions", "forward": "of the directions that go on forward",
         "flux": "power forward through a unit of area", "small_angle": "by the small-angle model, for comparison"}
OUTPUTS = (
    Output("depth", "(D,)", "1", "depths in mean free paths, equal steps of the logarithm"),
    Output("ratio", "(U,)", "1", "distance from the axis over the depth, equal steps of the logarithm"),
    *(Output(name, "(L, D, U)", "1", f"r depth kernel, {description}; the kernel is per squared mean free path and unit power")
      for name, description in _SAID.items()),
    Output("model", "(L,)", "1", "what fluence, forward and flux are computed with", choices=MODELS),
    *(Output(f"m{n}", "(L, D)", "1", f"moment of r^{n} of the small-angle kernel, mean free paths^{n}") for n in (0, 2, 4)),
    Output("alpha", "(L, D)", "1", "of the error-function kernel with m0 and m2: alpha/r G(r/beta), per mean free path"),
    Output("beta", "(L, D)", "1", "of the same, mean free paths"),
    Output("gaussian_b", "(L,)", "rad^2", "of the Gaussian lobe with the table's width: a quarter of its mean square angle"),
    *(Output(f"{name}_rms", "(L,)", "1", f"relative root mean square difference of {name} from photons, less their noise")
      for name in MEASURES),
    *(Output(f"{name}_noise", "(L,)", "1", f"the photons' own noise, in the measure of {name}_rms") for name in MEASURES),
    Output("photons", "(L,)", "1", "that were counted for each", whole=True),
)
_TOGETHER = 4
_KERNELS = tuple(f"beam.{name}" for name in ("transport", "single", "photons", "table")) + ("multiple.legendre",)
_PHOTON, _MANY, _FEW = 2.4e-6, 0.75, 0.3  # seconds of one core: a photon; tables of many orders, of few


def inputs(recipe, upstream) -> dict:
    medium = upstream["medium"]
    return {"albedo": np.asarray(medium["albedo"].data, float), "theta": np.asarray(medium["theta"].data, float),
            "phase": np.asarray(medium["phase"].data, float), "depth": recipe.beam.depth, "photons": recipe.beam.photons}


def compute(inputs: dict, context) -> Result:
    from bakery.physics.beam import choice, kernels, moments, planar, table

    count = len(inputs["albedo"])
    try:
        widths = [planar.width(inputs["theta"], phase) for phase in np.unique(inputs["phase"], axis=0)]
    except ValueError as fault:
        raise StageError(f"narrow beams: {fault}") from None
    nodes = table.grid(inputs["depth"], min(widths))
    tasks = [(float(inputs["albedo"][k]), inputs["theta"], inputs["phase"][k], nodes, inputs["photons"], context.tolerance,
              context.seed, k) for k in range(count)]
    tabulated = []
    for start in range(0, count, _TOGETHER):  # a few at a time, so that progress can be reported
        tabulated += context.map(choice.tabulated, tasks[start:start + _TOGETHER])
        context.report(len(tabulated) / count)
    z = nodes[0]
    values = {"depth": z, "ratio": nodes[1], "photons": np.array([table.photons for table in tabulated]),
              "model": np.array([MODELS.index(table.model) for table in tabulated], np.int8),
              "gaussian_b": np.array([table.B for table in tabulated])}
    values |= {name: np.stack([table.values[name] for table in tabulated]).astype(np.float32) for name in _SAID}
    albedo, B = inputs["albedo"][:, None], values["gaussian_b"][:, None]
    levers = moments.levers(z, albedo)
    for name, value in zip(("m0", "m2", "m4"), moments.moments(*levers, (1 - albedo) * z, B)):
        values[name] = value
    values["alpha"], values["beta"] = kernels.erf_parameters(values["m0"], moments.mean_square(levers[0], levers[1], B))
    for name in MEASURES:
        values[name + "_rms"], values[name + "_noise"] = (
            np.array([table.errors[name][i] for table in tabulated]) for i in (0, 1))
    notes = [f"wavelength number {k}: too narrow a phase function for transport; the small-angle model stands in"
             for k, table in enumerate(tabulated) if table.model != "transport"]
    # the photons' noise could hide as much as it makes
    reached = float((values["fluence_rms"] + values["fluence_noise"]).max())
    missed = (_missed(values["fluence_rms"], values["fluence_noise"]),) if reached > context.tolerance else ()
    return Result(dict(datasets(OUTPUTS, values)), reached, tuple(notes), missed)


def _missed(error, noise) -> str:
    """Why a tolerance is missed and what would help; errors and noise (L,) of wavelengths."""
    worst = int(np.argmax(error + noise))
    why = f"the tables miss counted photons by {error[worst]:.2g}, and the photons have a noise of {noise[worst]:.2g}"
    if noise[worst] > error[worst]:
        return f"{why}; a larger beam.tolerance or more beam.photons would do"
    if error[worst] + noise[worst] <= LARGEST:
        return f"{why}; a larger beam.tolerance would do"
    # measured for Henyey and Greenstein's lobes: 0.16 at g = -0.95, 0.7 at -0.99, 0.005 at 0.9999
    return (f"{why}; no beam.tolerance that may be asked for is met: such tables do not hold a narrow backward peak, and a phase "
            "function without one would do")


# ---- rules and plan


def sound(group: Group) -> Iterable[str]:
    """Whether the coordinates of the tables ascend."""
    if not all((np.diff(group[name].data) > 0).all() and group[name].data[0] > 0 for name in ("depth", "ratio")):
        yield "depth or ratio do not ascend from above 0"


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `beam` group, in words."""
    v = {name: np.asarray(member.data, float) for name, member in group.members.items()}
    if not np.allclose(v["alpha"] * np.sqrt(2 * np.pi) * v["beta"], v["m0"], rtol=1e-9, atol=1e-300):
        yield "alpha and beta do not give m0"
    if not np.allclose(v["beta"] ** 2 * v["m0"], 1.5 * v["m2"], rtol=1e-9, atol=1e-300):
        yield "beta^2 is not 3/2 m2 / m0"
    for part, whole in (("forward", "fluence"), ("flux", "forward")):
        if (v[part] > v[whole] * (1 + 1e-5)).any():  # of single precision
            yield f"{part} exceeds {whole}, of which it is a part"
    if (v["m0"] > 1 + 1e-9).any():
        yield "m0 above 1"


def cost(recipe) -> Cost:
    number = len(recipe.wavelength)
    photons = recipe.beam.photons or predicted.photons(recipe.beam.tolerance)
    tables = _MANY if recipe.particles is not None else _FEW  # orders: the peaks of spheres are narrow
    return Cost(number * (tables + _PHOTON * photons), 1e8, number * 1.5e5,
                f"{number} wavelengths, {photons:.2g} photons each", 0.5, kernels=_KERNELS, most=min(number, _TOGETHER),
                blocks=number)


def measures(group: Group, reference: Group) -> Mapping[str, float]:
    """Errors of a `beam` group against a converged one: relative root mean square over depths and rings, the largest of all."""
    from bakery.physics.beam import choice

    worst = {}
    for name in MEASURES:
        pairs = zip(tables_of(group, name), tables_of(reference, name))
        planes, edges = choice.counted_at(group["depth"].data[-1])
        errors = []
        for mine, true in pairs:
            a, b = mine.rings(planes, edges), true.rings(planes, edges)
            weight = 0.5 * (edges[1:] + edges[:-1])
            errors.append(np.sqrt(np.sum(((a - b) * weight) ** 2) / max(np.sum((b * weight) ** 2), 1e-300)))
        worst[name] = float(max(errors))
    return {"error": worst["fluence"]} | worst


STAGE = Stage(
    name="beam",
    version=4,
    title="spread of a narrow beam",
    reads=("wavelengths", "seed", "beam"),
    needs=("medium",),
    applies=lambda recipe: recipe.beam is not None,
    sections=(BEAM,),
    outputs=OUTPUTS,
    error_measure="relative root mean square difference of the fluence from counted photons, over planes and rings up to 5 mean "
                  "free paths, less the photons' noise, plus that noise",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    tolerance_key="beam.tolerance",
    sound=sound,
    knobs=(Knob("photons", "beam.photons", "auto", "photons that measure the error", ("20000", "200000")),),
    measures=measures,
    view=later("bakery.stages.beam.view:view"),
    pictures=later("bakery.stages.beam.pictures:pictures"),
)
