"""Stage `discrete`: separate particles by place and class, and what the classes do to light."""

import math
from collections.abc import Iterable

import numpy as np

from bakery import rng
from bakery.errors import StageError
from bakery.stages import measures, rules
from bakery.stages.declaration import Cost, Output, Result, Stage, datasets, later
from bakery.stages.discrete.section import DISCRETE, METHODS, too_many
from bakery.stages.discrete.view import classes_of
from bakery.stages.optics import stage as optics
from bakery.stages.optics.amounts import amounts
from bakery.stages.optics.spheres import dry
from bakery.store.tree import Dataset, Group

_METRES, _CUBIC = 1e-6, 1e-18  # m a um, m^3 a um^3
_FILE = 12.1  # bytes a particle
_SLOWER = 2.4  # than the rates of averages, on the machine that plans are made for, choices of rays included
_STORING, _WRITING = 23.0, 50.0  # bytes a particle: while it is drawn; on top, while the file is written and read back
_PLACING, _REJECTING = 1.5e-7, 1.5e-6  # seconds a particle, without and with a grid or a mesh: benchmarks/discrete_stage.py
_EDGES = 1e-9, 1e7  # m, of a mesh, as those of a box
_OFF = 8.0  # standard errors that a statistic may be off: by chance once in 1e15
_FLOAT32 = 1e-6  # integral of a phase function whose values are float32
OUTPUTS = (
    Output("method", "(1,)", "1", "whether places are in the asset or come from hashes", choices=METHODS),
    Output("number", "(1,)", "1", "particles; procedural: expected number"),
    Output("number_density", "(1,)", "1/m^3", "particles per volume where the relative density is 1"),
    Output("box", "(3,)", "m", "edges of the box, one of whose corners is the origin"),
    Output("volume", "(1,)", "m^3", "integral of the relative density over the box"),
    Output("key", "(2,)", "1", "words of 32 bits that a procedural realisation is drawn from", whole=True),
    Output("position", "(N, 3)", "m", "centres, component by component, class by class, those of a class cell by cell", True),
    Output("radius", "(N,)", "um", "radius of each particle's class", True),
    Output("component", "(N,)", "1", "index of each particle's component", True, whole=True),
    Output("density", "(X, Y, Z)", "1", "relative density at the middles of voxels, trilinear in between, constant in the outer "
           "halves", True, within=(0, 1)),
    Output("mesh_vertices", "(V, 3)", "m", "vertices of the closed mesh that holds the particles", True),
    Output("mesh_faces", "(F, 3)", "1", "triangles of the mesh, counterclockwise seen from outside", True, within=(0, "V - 1"),
           whole=True),
    Output("theta", "(B,)", "rad", "angle between the directions of travel, from 0 (forward) to pi", within=(0, math.pi)),
    Output("host", "(L,)", "1", "real index of the host"),
    Output("host_absorption", "(L,)", "1/m", "absorption coefficient of the host, by the share of volume that it fills"),
    Output("mean_extinction", "(L,)", "um^2", "mean extinction cross section of the particles that are there", True),
    Output("mean_extinction_error", "(L,)", "um^2", "standard deviation of mean_extinction over realisations", True),
    Output("law_extinction", "(L,)", "um^2", "mean extinction cross section by the law: shares of classes times their means"),
    Output("cell_dispersion", "(1,)", "1", "variance of counts in cells over its expectation: 1 for independent places", True),
    Output("cell_dispersion_error", "(1,)", "1", "standard deviation of cell_dispersion over realisations", True),
    Output("cell_edge", "(H + 1,)", "1", "numbers of particles in a cell: from each to before the next", True),
    Output("cell_count", "(H,)", "1", "cells that hold so many", True),
    Output("cell_count_law", "(H,)", "1", "cells that hold so many by the Poisson law of their expectations", True),
    Output("class_dispersion", "(1,)", "1", "variance of counts in classes over its expectation: 1 by the law", True),
    Output("class_dispersion_error", "(1,)", "1", "standard deviation of class_dispersion over realisations", True),
    Output("COMPONENT/index", "(1,)", "1", "number of the component in the recipe's order, from 0", whole=True),
    Output("COMPONENT/fraction", "(1,)", "1", "share of the particle number", within=(0, 1)),
    Output("COMPONENT/radius", "(R,)", "um", "radius of each class, root mean square of its particles' radii"),
    Output("COMPONENT/edge", "(R + 1,)", "um", "radii between the classes; equal to the radius where all spheres are equal"),
    Output("COMPONENT/share", "(R,)", "1", "share of the component's number in each class, adding up to 1", within=(0, 1)),
    Output("COMPONENT/extinction", "(L, R)", "um^2", "mean extinction cross section of a class"),
    Output("COMPONENT/scattering", "(L, R)", "um^2", "mean scattering cross section of a class"),
    Output("COMPONENT/spread", "(L, R)", "1", "relative variance of the extinction cross section within a class"),
    Output("COMPONENT/phase", "(L, R, B)", "1/sr", "phase function of a class, averaged by scattering, linear in cos theta "
           "between the angles"),
    Output("COMPONENT/n", "(L,)", "1", "real part of the refractive index, relative to vacuum"),
    Output("COMPONENT/k", "(L,)", "1", "imaginary part of the refractive index"),
)
_TOGETHER = (("position", "radius", "component"), ("mesh_vertices", "mesh_faces"), ("mean_extinction", "mean_extinction_error"),
             ("cell_dispersion", "cell_dispersion_error", "cell_edge", "cell_count", "cell_count_law"),
             ("class_dispersion", "class_dispersion_error"))


# ---- recipe


def _region(recipe):
    """Where the particles are; StageError says what is wrong with a mesh."""
    from bakery.physics.discrete.realise import Region

    discrete, key = recipe.discrete, "discrete.mesh.file"
    if discrete.mesh is not None:
        try:
            return _mesh(*discrete.mesh.file, discrete.mesh.unit * _METRES)
        except ValueError as fault:
            raise StageError(f"{recipe.where(key)}: {key}: {recipe.leaves[key]}: {fault}") from None
    edge = tuple(_METRES * length for length in discrete.box)
    return Region(edge, None if discrete.grid is None else discrete.grid.file)


def _mesh(data: bytes, kind: str, unit: float):
    """The inside of a mesh file, moved to the origin; ValueError where it has none."""
    from bakery.physics.discrete.realise import Region
    from bakery.physics.shapes.files import triangles
    from bakery.physics.shapes.mending import mended

    vertices, faces, _ = mended(*triangles(data, kind))
    vertices = unit * (vertices - vertices.min(axis=0))
    edge = tuple(vertices.max(axis=0).tolist())
    if not all(_EDGES[0] <= length <= _EDGES[1] for length in edge):
        raise ValueError(f"its box is {' x '.join(f'{length:.3g}' for length in edge)} m; edges of {_EDGES[0]:g} to "
                         f"{_EDGES[1]:g} m would do: another discrete.mesh.unit")
    return Region(edge, None, vertices, faces)


def _settings(recipe) -> dict:
    """What the work is, without what comes from other stages."""
    from bakery.physics.discrete import classes
    from bakery.physics.medium import mixing

    arguments, discrete = optics.inputs(recipe, {}), recipe.discrete
    region = _region(recipe)
    most = classes.per_component(len(arguments["components"]))
    by_component = [classes.classes(c.sizes, most, discrete.classes) for c in arguments["components"]]
    per_volume, fraction = amounts(recipe.particles, *dry(recipe.particles))
    density = per_volume if discrete.count is None else discrete.count / region.volume
    fault = too_many(density * region.volume, discrete.method)
    if fault:
        raise StageError(f"discrete: {fault[0]}; {fault[1]}")
    # as stage `medium` counts it
    filled = mixing.volume_fraction(fraction, [c.sizes.mean_volume for c in arguments["components"]], density)
    absorption = mixing.bulk_absorption(recipe.particles.host.k, arguments["wavelength"])
    return {key: arguments[key] for key in ("components", "wavelength", "host", "rays")} | {
            "classes": by_component, "region": region, "method": discrete.method, "seed": discrete.seed, "count": discrete.count,
            "number_density": density, "fraction": fraction,
            "index": [_index(c, of, arguments["host"]) for c, of in zip(recipe.particles.components, arguments["components"])],
            "host_absorption": np.maximum(1 - filled, 0.0) * absorption, "medium_density": per_volume}


def _index(part, of, host):
    """n and k (L,) of a component as it is, water included."""
    if part.growth is None:
        return np.asarray(part.material.n, float), np.asarray(part.material.k, float)
    return (of.m * host).real, (of.m * host).imag


def inputs(recipe, upstream) -> dict:
    single, medium = upstream["optics"], upstream["medium"]
    names = [c.name for c in recipe.particles.components]
    means = {kind: np.stack([np.asarray(single[f"{name}/mean_{kind}"].data, float) for name in names])
             for kind in ("extinction", "scattering")}
    return _settings(recipe) | {"means": means, "medium_theta": np.asarray(medium["theta"].data, float),
                                "medium_phase": np.asarray(medium["phase"].data, float)}


def cost(recipe) -> Cost:
    from bakery.physics.discrete.classes import predicted

    settings = _settings(recipe)
    expectation = predicted(settings["components"], settings["classes"], settings["wavelength"], settings["host"],
                            recipe.discrete.tolerance, rays=settings["rays"], remember=optics.remember)
    number = settings["number_density"] * settings["region"].volume
    stored = number if settings["method"] == "stored" else 0.0
    of_classes = sum(len(bins.radius) for bins in settings["classes"])
    tables = 4.0 * expectation.angles * of_classes * len(settings["wavelength"])
    placing = (_PLACING if settings["region"].whole else _REJECTING) * stored
    in_region = ("grains.bvh", "discrete.region") * (not settings["region"].whole)
    kernels = ("discrete._places", "mie.coefficients", "mie.angular", *in_region)
    return Cost(_SLOWER * expectation.seconds + placing, expectation.memory + tables * 4 + (_STORING + _WRITING) * stored + 1e8,
                _FILE * stored + tables, f"{number:.3g} particles {settings['method']}, {of_classes} classes of radii, about "
                f"{expectation.angles} angles" + f"; {_STORING:g} bytes a particle while they are drawn, {_STORING + _WRITING:g} "
                "while they are written" * (stored > 0), 0.15, kernels=kernels,
                kind=recipe.discrete.method)


# ---- work


def compute(inputs: dict, context) -> Result:
    from bakery.physics.discrete import classes

    expected = classes.predicted(*(inputs[name] for name in ("components", "classes", "wavelength", "host")), context.tolerance,
                                 rays=inputs["rays"], remember=optics.remember).seconds

    def report(seconds, error):
        context.report(0.7 * min(seconds / max(expected, 1e-9), 1.0), error)

    theta, averaged = classes.optics(*(inputs[name] for name in ("components", "classes", "wavelength", "host")),
                                     context.tolerance, context.map, report, rays=inputs["rays"], remember=optics.remember)
    region = inputs["region"]
    members: dict = dict(datasets(OUTPUTS, {
        "method": np.array([METHODS.index(inputs["method"])], np.uint8), "number_density": [inputs["number_density"]],
        "box": np.array(region.edge, float), "volume": [region.volume], "theta": theta, "host": inputs["host"],
        "host_absorption": inputs["host_absorption"],
        "key": rng.key(inputs["seed"], "discrete.cells").astype(np.uint32)}))
    if region.density is not None:
        members |= datasets(OUTPUTS, {"density": region.density})
    if region.vertices is not None:
        members |= datasets(OUTPUTS, {"mesh_vertices": region.vertices, "mesh_faces": region.faces})
    members |= _components(inputs, averaged)
    share = np.concatenate([f * bins.share for f, bins in zip(inputs["fraction"], inputs["classes"])])
    extinction = np.concatenate([of.extinction for of in averaged], axis=1)
    notes, ratio = [], inputs["number_density"] / inputs["medium_density"]
    if inputs["count"] and abs(ratio - 1) > 0.01:
        notes.append(f"discrete.count brings {inputs['number_density']:.3g} particles a cubic metre, {ratio:.3g} times those of "
                     "`particles`: the group `medium` belongs to the latter")
    if inputs["method"] == "stored":
        members |= _stored(inputs, share, extinction, context)
    else:
        members |= datasets(OUTPUTS, {"number": [inputs["number_density"] * region.volume], "law_extinction": extinction @ share})
    worst = max(max(float(of.error.max()) for of in averaged), _against_medium(inputs, theta, averaged))
    context.report(1.0, worst)
    missed = [] if worst <= context.tolerance else [
        f"the averages of the classes are off by {worst:.2g}; a larger discrete.tolerance, or a smaller one of the recipe where "
        "the medium itself is as coarse, would do"]
    return Result(members, worst, tuple(notes), tuple(missed))


def _components(inputs, averaged) -> dict[str, Group]:
    out = {}
    for i, (component, bins, of) in enumerate(zip(inputs["components"], inputs["classes"], averaged)):
        n, k = inputs["index"][i]
        out[component.name] = Group(datasets(OUTPUTS, {
            "index": np.array([i]), "fraction": [inputs["fraction"][i]], "radius": bins.radius, "edge": bins.edge,
            "share": bins.share, "extinction": of.extinction, "scattering": of.scattering, "spread": of.spread,
            "phase": of.phase, "n": n, "k": k}, "COMPONENT/"))
    return out


def _stored(inputs, share, extinction, context) -> dict[str, Dataset]:
    """Places, radii, components, and how far they are from the law."""
    from bakery.physics.discrete import realise, statistics

    region = inputs["region"]
    number = realise.numbers(inputs["seed"], share, inputs["number_density"] * region.volume, inputs["count"])
    try:
        position = realise.realised(region, number, inputs["seed"], context.map, lambda done: context.report(0.7 + 0.2 * done))
    except realise.NoRoom as fault:
        raise StageError(f"discrete: the place of the particles {fault}") from None
    radius = np.concatenate([bins.radius for bins in inputs["classes"]]).astype(np.float32)
    of = np.repeat(np.arange(len(inputs["classes"]), dtype=np.uint8), [len(bins.radius) for bins in inputs["classes"]])
    mean, error, law = statistics.mean_cross_section(number, share, extinction)
    values = {"number": [float(len(position))], "position": position, "radius": np.repeat(radius, number),
              "component": np.repeat(of, number), "law_extinction": law}
    if len(position):
        values |= {"mean_extinction": mean, "mean_extinction_error": error}
    counted, shares = statistics.in_cells(region, position)
    for name, figure in (("cell", statistics.dispersion(counted, shares)), ("class", statistics.dispersion(number, share))):
        if figure is not None:
            values |= {f"{name}_dispersion": [figure.value], f"{name}_dispersion_error": [figure.error]}
    if "cell_dispersion" in values:
        alike = slice(None) if region.vertices is None else slice(-1)  # the last holds all that a surface cuts
        held = statistics.histogram(counted[alike], shares[alike])
        values |= {name: np.asarray(value, float) for name, value in zip(("cell_edge", "cell_count", "cell_count_law"), held)}
    return datasets(OUTPUTS, values)


def _against_medium(inputs, theta, averaged) -> float:
    """Largest relative difference of the sum over classes from the continuous medium: cross sections, integral of the phase."""
    worst, table, weight = 0.0, 0.0, 0.0
    for i, (bins, of) in enumerate(zip(inputs["classes"], averaged)):
        for name in ("extinction", "scattering"):
            mean = inputs["means"][name][i]
            worst = max(worst, float(np.max(np.abs(getattr(of, name) @ bins.share / mean - 1))))
        scattered = inputs["fraction"][i] * of.scattering * bins.share
        table = table + np.einsum("lr,lra->la", scattered, of.phase.astype(float))
        weight = weight + scattered.sum(axis=1)
    return max(worst, _difference(theta, table / weight[:, None], inputs["medium_theta"], inputs["medium_phase"]))


def _difference(theta, f, other_theta, g) -> float:
    """Largest integral of the difference of two phase functions (L, A) over the sphere."""
    from bakery.physics.medium import phase

    angles = np.union1d(theta, other_theta)
    tables = phase.phase_at(theta, f, angles), phase.phase_at(other_theta, g, angles)
    return float(measures.integrated_difference(angles, *tables).max())


# ---- rules


def sound(group: Group) -> Iterable[str]:
    """Whether angles ascend, there are places or a key, and each particle has a component."""
    yield from rules.angles(group["theta"].data)
    count = len(group.groups)
    if not count:
        yield "holds no component"
    if METHODS[int(group["method"].data[0])] == "stored":
        if "position" not in group.members:
            yield "stored, but position is missing"
        elif group["component"].data.size and group["component"].data.max() >= count:
            yield f"component up to {group['component'].data.max()}, but there are {count}"
    if sorted(int(member["index"].data[0]) for member in group.groups.values()) != list(range(count)):
        yield "COMPONENT/index does not count the components"


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `discrete` group, in words."""
    for name, part in group.groups.items():
        yield from (f"{name}: {fault}" for fault in _check_component(part, group["theta"].data))
    total = sum(float(part["fraction"].data[0]) for part in group.groups.values())
    if abs(total - 1) > 1e-5:
        yield f"fractions add up to {total:.7g}"
    box, volume = group["box"].data, float(group["volume"].data[0])
    if not (box > 0).all() or not 0 < volume <= math.prod(box) * (1 + 1e-9):
        yield "box or volume not above 0, or volume larger than the box"
    if "position" in group.members:
        yield from _check_places(group)
    for name in ("cell_dispersion", "class_dispersion"):
        if name in group.members:
            value, error = (float(group[part].data[0]) for part in (name, name + "_error"))
            if abs(value - 1) > _OFF * error + 1e-9:
                yield f"{name} is {value:.4g}, {abs(value - 1) / error:.3g} standard deviations from 1"
    if "mean_extinction" in group.members:
        mean, error, law = (group[name].data for name in ("mean_extinction", "mean_extinction_error", "law_extinction"))
        if (np.abs(mean - law) > _OFF * error + 1e-9 * law).any():
            yield "mean_extinction is far from law_extinction"


def _check_component(group: Group, theta) -> Iterable[str]:
    from bakery.physics.medium import phase

    v = {name: np.asarray(member.data) for name, member in group.datasets.items()}
    radius, edge = v["radius"], v["edge"]
    if not (np.diff(radius) > 0).all() or (radius < edge[:-1]).any() or (radius > edge[1:]).any():
        yield "radius does not ascend, or does not lie between the edges of its class"
    if (radius.astype(np.float32) != radius).any():
        yield "a radius that float32 does not hold"
    if abs(v["share"].sum() - 1) > 1e-12:
        yield "share does not add up to 1"
    if (v["scattering"] > v["extinction"] * (1 + 1e-12)).any():
        yield "scattering above extinction"
    off = np.abs(phase.phase_integral(theta, v["phase"].astype(float)) - 1).max()
    if not off <= _FLOAT32:
        yield f"phase integrates to 1 with an error of {off:.1g}, not {_FLOAT32:g}"


def _check_places(group: Group) -> Iterable[str]:
    position, radius, component = (group[name].data for name in ("position", "radius", "component"))
    box = group["box"].data
    if len(position) != float(group["number"].data[0]):
        yield f"{len(position):,} positions, but number is {float(group['number'].data[0]):,.0f}"
    if position.size and ((position < 0).any() or any(position[:, axis].max() >= box[axis] for axis in range(3))):
        yield "a position outside of the box"
    of = np.array([], int) if not len(component) else np.flatnonzero(np.diff(component.astype(int), prepend=-1))
    if len(np.unique(component[of])) != len(of) or (np.diff(component.astype(int)) < 0).any():
        yield "component does not ascend"
    classes = classes_of(group)
    for start, end in zip(of, [*of[1:], len(component)]):
        radii = classes.radius[classes.component == component[start]].astype(np.float32)
        if not np.isin(np.unique(radius[start:end]), radii).all():
            yield "a radius that is none of its component's classes"


STAGE = Stage(
    name="discrete",
    version=4,
    title="separate particles, and what each does to light",
    reads=("wavelengths", "seed", "discrete", "phase", "particles"),
    needs=("optics", "medium"),
    applies=lambda recipe: recipe.discrete is not None,
    outputs=OUTPUTS,
    together=_TOGETHER,
    error_measure="largest of: relative error of a class's mean cross sections and integrated error of its phase function, as "
                  "estimated by halving the nodes over its sizes; relative difference of the sum over classes from the mean "
                  "cross sections of optics; integrated difference of the phase function of all classes from that of medium",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    sound=sound,
    sections=(DISCRETE,),
    tolerance_key="discrete.tolerance",
    view=later("bakery.stages.discrete.view:view"),
    pictures=later("bakery.stages.discrete.pictures:pictures"),
)
