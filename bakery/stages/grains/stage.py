"""Stage `grains`: what light does in the bounding sphere of each exemplar grain, by the virtual scatterometer."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping

import numpy as np

from bakery.errors import StageError
from bakery.stages import rules
from bakery.stages.declaration import ANY, SIGNED, Cost, Knob, Output, Result, Stage, datasets, later
from bakery.stages.grains.section import GRAINS, SCATTEROMETER, absorption, shape_keys
from bakery.stages.measures import integrated_difference
from bakery.stages.packing.section import radii_law
from bakery.store.tree import Dataset, Group, read_text, text

PEAK = 1e-3  # rad, second angle of the table: room for unscattered (delta) transmission, in tables of media
_APART = 0.02  # of the tolerance: indices of one walk; figures change by less than that
# seconds on one core, between those of an AMD EPYC (Zen 5) and of an Intel Xeon: of a path, of its look-ups among 200,000
# triangles (they grow like the square root of the number; light inside of a grain takes several), of a triangle that is made, of
# a ball
_PATH, _LOOKUPS, _LOOKUPS_INSIDE, _BUILD, _BALL = 0.3e-6, 1.2e-6, 4.4e-6, 8e-6, 0.08
_LOADING = 0.3
_TRIANGLE, _ROUND = 17.0, 7.0  # bytes of a triangle as stored: of a grain, of a sphere
_OF_BALLS = ("grains.sphere", "grains.surface")
_OF_WALKS = ("grains._walk", "grains.surface", "grains.scatterometer", "grains.points")
_OF_MESHES, _OF_SHAPES = ("grains.bvh", "grains.grid"), ("shapes._triangles", "shapes.simplify")
_SPREAD = 6.0  # times 1/sqrt(paths): error of the phase function
SCALARS = ("hit_probability", "lambda_delta", "chord")
FIGURES = ("albedo", "lambda_s", "lambda_o", "mean_square", "g", "forward_delta", "inner_path")
BY_RADIUS = ("albedo", "lambda_s", "mean_square", "g", "forward_delta")
LOSSLESS = ("lambda_s", "mean_square", "g", "forward_delta")
_SHARES = ("hit_probability", "albedo", "forward_delta", "contradicted", "lost")
_ASKED = ("hit_probability", "lambda_delta", "albedo", "lambda_s", "mean_square", "g", "phase")
_SAID = {
    "hit_probability": ("1", "share of rays through the bounding sphere that meet the surface"),
    "lambda_delta": ("1", "mean chord of the bounding sphere of rays that do not, in its radii"),
    "chord": ("1", "mean chord of the bounding sphere of rays that do, in its radii"),
    "albedo": ("1", "share of the light that hits which leaves"),
    "lambda_s": ("1", "mean displacement from entry to exit of the sphere along the incoming direction, in its radii"),
    "lambda_o": ("1", "the same along the outgoing direction"),
    "mean_square": ("1", "mean squared distance of entry and exit, in squared radii"),
    "g": ("1", "mean cosine of the light that leaves, undeflected light included"),
    "forward_delta": ("1", "share of the light that leaves in its old direction"),
    "inner_path": ("1", "mean path length inside the grain of the light that leaves, in radii of the sphere"),
    "phase": ("1/sr", "phase function of light that leaves changed, linear in cos theta; a node holds the mean over its cell"),
}
# what is thrown back may leave the sphere before where it entered
_WITHIN = dict.fromkeys(_SHARES, (0, 1)) | {"g": SIGNED, "lambda_s": ANY, "lambda_o": ANY}


def _with_errors(prefix: str, names, shape: str, **more) -> tuple[Output, ...]:
    return tuple(Output(f"{prefix}{name}{end}", shape, _SAID[name][0], ("standard error of " + name) if end else _SAID[name][1],
                        within=_WITHIN.get(name + end, (0, math.inf)), **more) for name in names for end in ("", "_error"))


OUTPUTS = (
    Output("theta", "(A,)", "rad", "angle between the directions of travel, from 0 (forward) to pi", within=(0, math.pi)),
    Output("radius", "(S,)", "m", "radii of bounding spheres that stand for the law of sizes"),
    Output("radius_share", "(S,)", "1", "share of the grains at each radius, adding up to 1", within=(0, 1)),
    Output("COMPONENT/vertices", "(V, 3)", "1", "corners of the exemplar, in radii of its bounding sphere", within=(-1.01, 1.01)),
    Output("COMPONENT/faces", "(F, 3)", "1", "triangles, counterclockwise from outside; of a sphere for pictures only",
           within=(0, "V - 1"), whole=True),
    Output("COMPONENT/weight", "(1,)", "1", "share of the number of grains", within=(0, 1)),
    Output("COMPONENT/shape", "(bytes,)", "utf-8", "shape as in the recipe (JSON)"),
    Output("COMPONENT/surface", "(bytes,)", "utf-8", "surface, indices relative to the host (JSON)"),
    Output("COMPONENT/interior", "(L,)", "1/m", "absorption coefficient of the inside"),
    *_with_errors("COMPONENT/", SCALARS, "(1,)"),
    *_with_errors("COMPONENT/", FIGURES, "(L,)"),
    *_with_errors("COMPONENT/", ("phase",), "(L, A)"),
    Output("COMPONENT/paths", "(1,)", "1", "rays that were followed; 0: closed form", whole=True),
    Output("COMPONENT/hits", "(1,)", "1", "rays that met the surface", whole=True),
    Output("COMPONENT/events", "(1,)", "1", "meetings with the surface of a ray that hits"),
    Output("COMPONENT/contradicted", "(1,)", "1", "share of rays given up because inside and outside did not agree",
           within=(0, 1)),
    Output("COMPONENT/lost", "(1,)", "1", "share of the light of hits that was still under way when its path was cut"),
    *_with_errors("COMPONENT/by_radius/", BY_RADIUS, "(S, L)", optional=True),
    *_with_errors("COMPONENT/by_radius/", ("phase",), "(S, L, A)", optional=True),
    *_with_errors("COMPONENT/lossless/", LOSSLESS, "(L,)"),
)
_REQUIRED = ("vertices", "faces", "weight", "interior", *SCALARS, *FIGURES, "phase", "paths", "hits", "contradicted", "lost")


# ---- recipe


def inputs(recipe, upstream) -> dict:
    from bakery.physics.granular import sizes

    grains, host = recipe.grains, np.asarray(recipe.grains.host.n, float)
    classes, shares = sizes.classes(radii_law(recipe.packing.radii))
    components = []
    for i, grain in enumerate(grains.components):
        surface = vars(grain.surface)
        material, reflectance = surface.get("material"), surface.get("reflectance")
        index = None if material is None else (material.n + 1j * material.k) / host
        components.append({
            "name": grain.name, "weight": float(grain.weight), "shape": shape_keys(grain.shape), "type": surface["type"],
            "index": index,
            "file": recipe.leaves.get(f"grains.components[{i}].shape.file", ""),
            "roughness": float(surface.get("roughness", 0.0)),
            "absorption": absorption(grain.interior, recipe.wavelength),
            "reflectance": reflectance})
    options = recipe.scatterometer
    return {"components": components, "radius": 1e-6 * grains.radius, "classes": classes, "shares": shares,
            "wavelengths": len(recipe.wavelength), "triangles": options.triangles, "paths": options.paths,
            "depth": options.depth, "engine": options.engine}


# ---- work


def compute(inputs: dict, context) -> Result:
    from bakery.physics.grains import traces

    theta, _ = traces.nodes()
    table = np.insert(theta, 1, PEAK)
    classes = np.unique(np.append(1.0, inputs["classes"])) * inputs["radius"]
    # places of the recipe's own radius and of the law's among all that are traced
    own, at = int(np.searchsorted(classes, inputs["radius"])), np.searchsorted(classes, inputs["classes"] * inputs["radius"])
    if inputs["engine"] == "mitsuba":
        from bakery.physics.grains.mitsuba_walk import require

        require()
    if any("repair" in component["shape"] for component in inputs["components"]):
        from bakery.physics.shapes.repair import require

        require()
    members: dict = dict(datasets(OUTPUTS, {"theta": table, "radius": classes[at], "radius_share": inputs["shares"]}))
    notes, missed, reached = [], [], 0.0
    all_traces = [traces.traces(component, classes, inputs["wavelengths"], _APART * context.tolerance)
                  for component in inputs["components"]]
    number, done = sum(map(len, all_traces)), 0
    for k, (component, traced) in enumerate(zip(inputs["components"], all_traces)):
        name = component["name"]
        grain = _mesh_of(component, inputs["triangles"])
        notes += [f"{name}: {note}" for note in grain.notes]
        tree = _tree(grain, inputs["engine"])
        measured = []
        for i, trace in enumerate(traced):
            context.report(done / number, None, name)
            measured.append(_measured(grain, tree, trace, inputs, context, 1000 * k + i, done, number, name))
            done += 1
        group, error, remarks = _group(component, grain, traced, measured, own, at if len(at) > 1 else None, table)
        members[name] = group
        reached = max(reached, error)
        notes += remarks
        if inputs["paths"] is None and not all(stats.reached for stats in _walks(measured)):
            missed.append(f"{name}: errors of {error:.2g} are left after {int(group['paths'].data[0]):,} paths; a larger "
                          "scatterometer.tolerance would do")
    context.report(1.0, reached)
    return Result(members, reached, tuple(notes), tuple(missed))


def _mesh_of(component: dict, triangles: int):
    """The exemplar; StageError says which grain cannot be made, and why."""
    from bakery.physics.shapes import build as shapes

    try:
        return shapes.build(component["shape"], triangles)
    except ValueError as error:
        what = component["file"] or component["shape"]["type"]
        raise StageError(f"grain {component['name']}: {what}: {error}") from None


def _tree(grain, engine):
    if grain.analytic == "sphere" or engine != "numba":
        return None
    from bakery.physics.grains.bvh import Mesh

    return Mesh(grain.vertices, grain.faces)


def _walks(measured):
    return [stats for stats in measured if hasattr(stats, "paths")]


def _measured(grain, tree, trace, inputs, context, stream, done, number, name):
    """Statistics of one trace: `scatterometer.Statistics`, or `sphere.Ball`, whose figures have the same names."""
    from bakery.physics.grains import scatterometer, sphere, traces

    _, edges = traces.nodes()
    tracer = traces.tracer_of(grain, trace, inputs["depth"], inputs["engine"], tree)
    if tracer is None:
        return sphere.ball(trace.surface, trace.mu, edges)

    def report(share, error):
        context.report((done + share) / number, error, name)

    paths = inputs["paths"]
    return scatterometer.measure(
        tree, trace.surface, trace.mu, seed=context.seed, stream=stream, tracer=tracer, edges=edges, asked=_ASKED,
        tolerance=context.tolerance if paths is None else scatterometer.TOLERANCE_MIN,
        paths_max=scatterometer.PATHS_MAX if paths is None else paths, map=context.map, report=report)


def _group(component, grain, traced, measured, own, at, table):
    """A component's group, its error in the stage's measure, remarks."""
    from bakery.physics.grains import traces
    from bakery.physics.medium import phase

    theta, _ = traces.nodes()

    values = {"vertices": grain.vertices, "faces": grain.faces, "weight": np.array([component["weight"]]),
              "interior": component["absorption"]}
    for name in SCALARS:  # geometry alone: the same in every trace
        scalar = [getattr(stats, name) for stats in measured]
        errors = [float(stats.errors.get(name, 0.0)) for stats in measured]
        values[name] = np.array([math.fsum(scalar) / len(scalar)])
        values[name + "_error"] = np.array([math.hypot(*errors) / len(scalar)])
    tables = {}
    for name in (*FIGURES, "phase"):
        value, error = traces.figures(traced, measured, name)
        if name == "phase":
            value, _ = phase.normalised(table, phase.evaluate(theta, value, table))
            error = phase.evaluate(theta, error, table)
        tables[name] = value, error
        values[name], values[name + "_error"] = value[own], error[own]
    walks = _walks(measured)
    total = {name: sum(getattr(stats, name) for stats in walks) for name in ("paths", "hits")}
    hits = max(total["hits"], 1)
    values |= {"paths": np.array([total["paths"]]), "hits": np.array([total["hits"]]),
               "events": np.array([math.fsum(s.events * s.hits for s in walks) / hits]),
               "contradicted": np.array([max((s.contradicted for s in walks), default=0.0)]),
               "lost": np.array([max((float(s.lost.max()) for s in walks), default=0.0)])}
    members: dict = dict(datasets(OUTPUTS, values, "COMPONENT/"))
    shape = {key: "inf" if value == math.inf else value for key, value in component["shape"].items() if key != "data"}
    members["shape"] = text(json.dumps(shape, sort_keys=True), "shape as in the recipe (JSON)")
    members["surface"] = text(json.dumps(_surface(component), sort_keys=True), "surface, indices relative to the host (JSON)")
    if at is not None:
        members["by_radius"] = Group(datasets(OUTPUTS, {
            name + end: tables[name][i][at] for name in (*BY_RADIUS, "phase") for i, end in enumerate(("", "_error"))},
            "COMPONENT/by_radius/"))
    lossless = {name: traces.figures(traced, measured, name, white=True) for name in LOSSLESS}
    members["lossless"] = Group(datasets(OUTPUTS, {
        name + end: lossless[name][i][0] for name in LOSSLESS for i, end in enumerate(("", "_error"))}, "COMPONENT/lossless/"))
    error, notes = _reached(values, walks, component["name"])
    return Group(members), error, notes


def _surface(component) -> dict:
    index, kind = component["index"], component["type"]
    if kind == "dielectric":
        return {"type": kind, "index": index.real.tolist(), "roughness": component["roughness"]}
    if kind == "conductor":
        return {"type": kind, "n": index.real.tolist(), "k": index.imag.tolist(), "roughness": component["roughness"]}
    return {"type": kind, "reflectance": component["reflectance"].tolist()}


def _reached(values, walks, name) -> tuple[float, list[str]]:
    """The error in the stage's measure, and what a user should know of the paths."""
    from bakery.physics.grains.scatterometer import CONTRADICTED_MAX, LOST_MAX

    lost, contradicted = float(values["lost"][0]), float(values["contradicted"][0])
    notes = []
    if lost > LOST_MAX:
        notes.append(f"{name}: {lost:.2g} of the light was still under way when its path was cut, and counts as absorbed; a "
                     "larger scatterometer.depth would follow it")
    if contradicted > CONTRADICTED_MAX:
        notes.append(f"{name}: {contradicted:.2g} of the paths were given up because the surface did not say clearly what is "
                     "inside; a finer or sounder mesh would do")
    return max([stats.achieved_error for stats in walks] + [lost, contradicted]), notes


# ---- rules


def sound(group: Group) -> Iterable[str]:
    """Whether angles ascend, and every grain is a mesh in the unit sphere with a shape and a surface that can be read."""
    yield from rules.angles(group["theta"].data)
    parts = {name: member for name, member in group.members.items() if isinstance(member, Group)}
    if not parts:
        yield "holds no grain"
    for name, part in parts.items():
        yield from (f"{name}: {fault}" for fault in (*_mesh(part["vertices"].data, part["faces"].data), *_texts(part)))


def _mesh(vertices, faces) -> Iterable[str]:
    if (faces[:, 0] == faces[:, 1]).any() or (faces[:, 1] == faces[:, 2]).any() or (faces[:, 2] == faces[:, 0]).any():
        yield "faces holds a triangle that names a vertex twice"
    if np.sqrt((vertices**2).sum(axis=1)).max() > 1 + 1e-9:
        yield "a vertex outside of the bounding sphere"


def _texts(part: Group) -> Iterable[str]:
    for name in ("shape", "surface"):
        try:
            decoded = json.loads(read_text(part[name]))
        except (ValueError, RecursionError):
            decoded = None
        if not isinstance(decoded, dict):
            yield f"{name} is no JSON object"


def check(group: Group) -> Iterable[str]:
    """Broken rules of a `grains` group, in words."""
    v = {name: np.asarray(member.data, float) for name, member in group.members.items() if isinstance(member, Dataset)}
    faults = list(rules.complete(v, ("theta", "radius", "radius_share"))) or list(rules.angles(v["theta"]))
    yield from faults
    if faults:
        return
    if not (v["radius"] > 0).all() or not (v["radius_share"] > 0).all() or abs(v["radius_share"].sum() - 1) > 1e-9:
        yield "radius is not above 0, or radius_share does not add up to 1"
    parts = {name: member for name, member in group.members.items() if isinstance(member, Group)}
    if not parts:
        yield "holds no grain"
    for name, part in parts.items():
        yield from (f"{name}: {fault}" for fault in _check_component(part, v["theta"]))
    # of all components or not at all: a component without one has been named, and what is left of the sum says nothing
    weights = [float(part.members["weight"].data[0]) for part in parts.values() if "weight" in part.members]
    if parts and len(weights) == len(parts) and abs(math.fsum(weights) - 1) > 1e-6:
        yield f"weights add up to {math.fsum(weights):.9g}, not 1"


def _check_component(part: Group, theta) -> Iterable[str]:
    v = {path: np.asarray(member.data, float) for path, member in part.walk()
         if isinstance(member, Dataset) and path not in ("shape", "surface")}
    faults = list(rules.complete(v, _REQUIRED))
    yield from faults
    if faults:
        return
    vertices, faces = v["vertices"], part["faces"].data
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu" \
            or not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        yield "faces do not name vertices"
        return
    yield from _mesh(vertices, faces)
    if (v["interior"] < 0).any():
        yield "interior below 0"
    for path, value in v.items():
        name = path.rpartition("/")[2]
        if name in _SHARES and ((value < 0) | (value > 1 + 1e-9)).any():
            yield f"{path} outside 0 .. 1"
        if name == "g" and (np.abs(value) > 1 + 1e-9).any():
            yield f"{path} outside -1 .. 1"
        if name.endswith("_error") and (value < 0).any():
            yield f"{path} below 0"
        if name == "phase":
            yield from rules.phase_function(theta, value)
        if name == "mean_square" and ((value < 0) | (value > 4 + 1e-9)).any():
            yield f"{path} outside 0 .. 4"
    beta = v["hit_probability"][0]
    # chords of a sphere have the mean 4/3, whatever the grain; six standard errors, and rounding
    mean = (1 - beta) * v["lambda_delta"][0] + beta * v["chord"][0]
    spread = math.hypot(*(float(v[name + "_error"][0]) for name in SCALARS)) if "chord_error" in v else 0.0
    if abs(mean - 4 / 3) > 6 * spread + 1e-3 / math.sqrt(max(v["paths"][0], 1e6) / 1e6):
        yield f"chords of the bounding sphere have the mean {mean:.6g}, not 4/3"


# ---- plan


def cost(recipe) -> Cost:
    from bakery.physics.grains import traces

    arguments = inputs(recipe, {})
    radii = np.unique(np.append(1.0, arguments["classes"])) * arguments["radius"]
    triangles, paths = arguments["triangles"], arguments["paths"] or predicted_paths(recipe.scatterometer.tolerance)
    walks = balls = 0
    tables = file = 0.0
    for component in arguments["components"]:
        number = len(traces.traces(component, radii, arguments["wavelengths"], _APART * recipe.scatterometer.tolerance))
        round_ = component["shape"]["type"] == "sphere"
        file += triangles * (_ROUND if round_ else _TRIANGLE)
        if traces.is_ball(component):
            balls += number
        else:
            walks += number
            lookups = _LOOKUPS_INSIDE if component["type"] == "dielectric" else _LOOKUPS
            tables += number * paths * (_PATH + (0.0 if round_ else lookups * math.sqrt(triangles / 200_000)))
    building = _BUILD * triangles * len(arguments["components"])
    figures = len(arguments["classes"]) * arguments["wavelengths"] * (traces.CELLS + 2) * 2
    before = _LOADING + building + _BALL * balls  # on one core
    return Cost(tables, 4e7 + 260.0 * triangles + 300.0 * 2**18,
                file + len(arguments["components"]) * (8 * figures + 6e3),
                f"{walks} walks of about {paths:,} paths, {balls} balls in closed form, {triangles:,} triangles a grain; "
                f"{before:.2g} s to load kernels and to make grains", before, kernels=_kernels(arguments["components"]),
                kind="walks" if walks else "balls")


def predicted_paths(tolerance: float) -> int:
    """Paths that a tolerance is expected to take: that of the phase function takes the most."""
    return max(1 << 14, math.ceil((_SPREAD / tolerance) ** 2))


def _kernels(components) -> tuple[str, ...]:
    """Modules whose kernels make and walk these grains."""
    from bakery.physics.grains import traces

    modules: list[str] = []
    for component in components:
        kind = component["shape"]["type"]
        modules += _OF_BALLS if traces.is_ball(component) else _OF_WALKS
        modules += ("grains.balls",) if kind == "sphere" else _OF_MESHES + (_OF_SHAPES if kind in ("aggregate", "mesh") else ())
    return tuple(dict.fromkeys(modules))


# ---- how far from converged


def measures(group: Group, reference: Group) -> Mapping[str, float]:
    """Errors of a `grains` group against a converged one: of each measure the largest over components, radii and wavelengths.

    Returns
    -------
    dict of floats, in this order

    error : the largest of the others, half of `phase`
    hit_probability, albedo : relative (of an albedo of at least 0.01)
    phase : integral of |f - f_ref| over the sphere
    lambda_delta, lambda_s, mean_square, g, forward_delta : differences, in radii of the bounding sphere
    """
    errors = dict.fromkeys((*_ASKED, "forward_delta"), 0.0)
    theta = np.asarray(reference["theta"].data, float)
    for name, true in reference.members.items():
        if not isinstance(true, Group):
            continue
        for key in errors:
            pairs = [(group[f"{name}/{path}"].data, member.data) for path, member in true.walk()
                     if isinstance(member, Dataset) and path.rpartition("/")[2] == key]
            for own, converged in pairs:
                if key == "phase":
                    error = integrated_difference(theta, own, converged)
                else:
                    scale = {"hit_probability": converged, "albedo": np.maximum(converged, 0.01)}.get(key, 1.0)
                    error = np.abs(own - converged) / scale
                errors[key] = max(errors[key], float(np.max(error)))
    return {"error": max(0.5 * value if key == "phase" else value for key, value in errors.items())} | errors


STAGE = Stage(
    name="grains",
    version=2,
    title="scattering statistics of each exemplar grain",
    reads=("wavelengths", "seed", "grains", "packing.radii", "scatterometer"),
    needs=(),
    applies=lambda recipe: recipe.grains is not None,
    sections=(GRAINS, SCATTEROMETER),
    outputs=OUTPUTS,
    error_measure="largest standard error of the hit probability and the albedo (relative, of an albedo of at least 0.01), of "
                  "lambda_delta, lambda_s, mean_square (in radii of the bounding sphere) and g, and half the integral of the "
                  "phase function's standard error over the sphere; or the light that was lost on cut paths, if that is more",
    cost=cost,
    inputs=inputs,
    compute=compute,
    check=check,
    sound=sound,
    tolerance_key="scatterometer.tolerance",
    knobs=(
        Knob("tolerance", "scatterometer.tolerance", 0.005, "standard error of the statistics, where paths is auto",
             ("10%", "3%", "1%", "0.5%", "0.2%")),
        Knob("paths", "scatterometer.paths", "auto", "rays through the bounding sphere", ("16384", "65536", "262144", "1048576")),
        Knob("triangles", "scatterometer.triangles", "middle", "triangles of the exemplar",
             ("300", "coarse", "5000", "middle", "fine")),
        Knob("depth", "scatterometer.depth", 100_000, "meetings with the surface after which a path is cut",
             ("10", "30", "100", "1000", "100000")),
    ),
    measures=measures,
    reference={"scatterometer.paths": "auto", "scatterometer.depth": "100000"},
    pictures=later("bakery.stages.grains.pictures:pictures"),
    tables=later("bakery.stages.grains.pictures:tables"),
    files=later("bakery.stages.grains.files:csv_figures"),
    rendered=True,
)
