"""Stage `grains`: what light does in the bounding sphere of each exemplar grain, by the virtual scatterometer."""

import json
import math

import numpy as np

from bakery.errors import StageError
from bakery.physics.shapes.limits import SHARE_HIT, share_hit
from bakery.stages.declaration import Cost, Knob, Result, Stage, datasets, later
from bakery.stages.grains.measures import measures
from bakery.stages.grains.outputs import ASKED, BY_RADIUS, FIGURES, LOSSLESS, OUTPUTS, PEAK, SCALARS, TOGETHER
from bakery.stages.grains.rules import check, sound
from bakery.stages.grains.section import GRAINS, SCATTEROMETER, absorption, shape_keys
from bakery.stages.packing.section import radii_law
from bakery.store.tree import Group, text

_APART = 0.02  # of the tolerance: indices of one walk; figures change by less than that
# seconds on one core, between those of an AMD EPYC (Zen 5) and of an Intel Xeon: of a path, of its look-ups among 200,000
# triangles (they grow like the square root of the number; light inside of a grain takes several), of a triangle that is made, of
# a ball; of a triangle of an aggregate that is simplified, and of one that is marched, a body (0.2 for balls, 0.6 for rods)
_PATH, _LOOKUPS, _LOOKUPS_INSIDE, _BUILD, _BALL = 0.3e-6, 1.2e-6, 4.4e-6, 8e-6, 0.02
_SIMPLIFY, _MARCH = 5e-6, 0.4e-6
_LOADING = 0.15
_TRIANGLE, _ROUND = 17.0, 7.0  # bytes of a triangle as stored: of a grain, of a sphere
_OF_BALLS = ("grains.sphere", "grains.surface")
_OF_WALKS = ("grains._walk", "grains.surface", "grains.scatterometer", "grains.points")
_OF_MESHES, _OF_SHAPES = ("grains.bvh", "grains.grid"), ("shapes._triangles", "shapes.simplify")
_SPREAD = 6.0  # times 1/sqrt(paths): error of the phase function


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
            "depth": options.depth}


# ---- work


def compute(inputs: dict, context) -> Result:
    from bakery.physics.grains import bvh, traces

    theta, _ = traces.nodes()
    table = np.insert(theta, 1, PEAK)
    classes = np.unique(np.append(1.0, inputs["classes"])) * inputs["radius"]
    # places of the recipe's own radius and of the law's among all that are traced
    index, at = int(np.searchsorted(classes, inputs["radius"])), np.searchsorted(classes, inputs["classes"] * inputs["radius"])
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
        tree = None if grain.analytic == "sphere" else bvh.Mesh(grain.vertices, grain.faces)
        measured = []
        for i, trace in enumerate(traced):
            context.report(done / number, None, name)
            measured.append(_measured(grain, tree, trace, inputs, context, 1000 * k + i, done, number, name))
            done += 1
        group, error, remarks = _group(component, grain, traced, measured, index, at if len(at) > 1 else None, table)
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

    grain = f"grain {component['name']}: {component['file'] or component['shape']['type']}"
    try:
        mesh = shapes.build(component["shape"], triangles)
    except ValueError as error:
        raise StageError(f"{grain}: {error}") from None
    share = mesh.area / (4 * math.pi)  # that of a convex body (Cauchy), else more than it is
    if share < SHARE_HIT:
        raise StageError(f"{grain}: {share:.2g} of the rays through its bounding sphere hit it, or fewer; at least {SHARE_HIT:g} "
                         "are needed: a thicker grain would do")
    return mesh


def _walks(measured):
    return [stats for stats in measured if hasattr(stats, "paths")]


def _measured(grain, tree, trace, inputs, context, stream, done, number, name):
    """Statistics of one trace: `scatterometer.Statistics`, or `sphere.Ball`, whose figures have the same names."""
    from bakery.physics.grains import scatterometer, sphere, traces

    _, edges = traces.nodes()
    tracer = traces.tracer_of(grain, trace, inputs["depth"], tree)
    if tracer is None:
        return sphere.ball(trace.surface, trace.mu, edges)

    def report(share, error):
        context.report((done + share) / number, error, name)

    paths = inputs["paths"]
    return scatterometer.measure(
        tree, trace.surface, trace.mu, seed=context.seed, stream=stream, tracer=tracer, edges=edges, asked=ASKED,
        tolerance=context.tolerance if paths is None else scatterometer.TOLERANCE_MIN,
        paths_max=scatterometer.PATHS_MAX if paths is None else paths, map=context.map, report=report)


def _group(component, grain, traced, measured, class_index, at, table):
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
            value, _ = phase.normalised(table, phase.phase_at(theta, value, table))
            error = phase.phase_at(theta, error, table)
        tables[name] = value, error
        values[name], values[name + "_error"] = value[class_index], error[class_index]
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


# ---- plan


def cost(recipe) -> Cost:
    from bakery.physics.grains import traces
    from bakery.physics.grains.scatterometer import HITS_MIN

    arguments = inputs(recipe, {})
    radii = np.unique(np.append(1.0, arguments["classes"])) * arguments["radius"]
    triangles, most = arguments["triangles"], 0
    walks = balls = 0
    tables = file = building = 0.0
    for component in arguments["components"]:
        number = len(traces.traces(component, radii, arguments["wavelengths"], _APART * recipe.scatterometer.tolerance))
        round_ = component["shape"]["type"] == "sphere"
        file += triangles * (_ROUND if round_ else _TRIANGLE)
        building += 0.0 if round_ else _BUILD * triangles + _growing(component["shape"], triangles)
        if traces.is_ball(component):
            balls += number
        else:
            walks += number
            lookups = _LOOKUPS_INSIDE if component["type"] == "dielectric" else _LOOKUPS
            paths = arguments["paths"] or max(predicted_paths(recipe.scatterometer.tolerance),
                                              math.ceil(HITS_MIN / share_hit(component["shape"])))
            most = max(most, paths)
            tables += number * paths * (_PATH + (0.0 if round_ else lookups * math.sqrt(triangles / 200_000)))
    figures = len(arguments["classes"]) * arguments["wavelengths"] * (traces.CELLS + 2) * 2
    before = _LOADING + building + _BALL * balls  # on one core
    return Cost(tables, 4e7 + 260.0 * triangles + 300.0 * 2**18,
                file + len(arguments["components"]) * (8 * figures + 6e3),
                f"{walks} walks of up to about {most:,} paths, {balls} balls in closed form, {triangles:,} triangles a grain; "
                f"{before:.2g} s to load kernels and to make grains", before, kernels=_kernels(arguments["components"]),
                kind="walks" if walks else "balls")


def _growing(shape: dict, triangles: int) -> float:
    """Seconds of one core that it takes to grow an aggregate; those of other shapes are those of their triangles."""
    from bakery.physics.shapes import rods

    if shape["type"] != "aggregate":
        return 0.0
    marched, last = rods.grown(**{name: value for name, value in shape.items() if name != "type"}).triangles(triangles)
    return _SIMPLIFY * last + _MARCH * shape["bodies"] * marched


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


STAGE = Stage(
    name="grains",
    version=2,
    title="scattering statistics of each exemplar grain",
    reads=("wavelengths", "seed", "grains", "packing.radii", "scatterometer"),
    needs=(),
    applies=lambda recipe: recipe.grains is not None,
    sections=(GRAINS, SCATTEROMETER),
    outputs=OUTPUTS,
    together=TOGETHER,
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
        Knob("depth", "scatterometer.depth", 100_000, "surface interactions after which a path is cut",
             ("10", "30", "100", "1000", "100000")),
    ),
    measures=measures,
    view=later("bakery.stages.grains.view:view"),
    reference={"scatterometer.paths": "auto", "scatterometer.depth": "100000"},
    pictures=later("bakery.stages.grains.pictures:pictures"),
    tables=later("bakery.stages.grains.pictures:tables"),
    files=later("bakery.stages.grains.files:csv_figures"),
    rendered=True,
)
