"""How far light gets among packed grains, by walks through them, against the medium that stands for them.

    python benchmarks/granular.py                    several grains and fractions, errors of 0.2 %
    python benchmarks/granular.py --quick            errors of 1 %
    python benchmarks/granular.py sand.yaml          the grains and the packing of a recipe, or
    python benchmarks/granular.py sand.h5            of an asset, at the wavelength in the middle, without absorption

M is the mean square displacement a hit at long times.  A medium with mean free path l and mean cosine g has 2 l^2 / (1 - g); so
the root of M over that of the medium, less 1, is how much too short a length the medium's sigma_t makes of it.  Statistics of
single grains are of closed forms or of the scatterometer; times are of one core, without compilation.
"""

import argparse
import sys
import time
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np  # noqa: E402

from bakery.physics.grains.bvh import Mesh  # noqa: E402
from bakery.physics.grains.scatterometer import measure  # noqa: E402
from bakery.physics.grains.sphere import ball  # noqa: E402
from bakery.physics.grains.surface import conductor, dielectric, diffuse  # noqa: E402
from bakery.physics.granular.effective import Means, effective, mixed, void_chord  # noqa: E402
from bakery.physics.granular.packed import Grain, walk  # noqa: E402
from bakery.physics.packing import pack  # noqa: E402
from bakery.physics.packing.structure import fraction as filled  # noqa: E402
from bakery.physics.packing.tiles import tile_of  # noqa: E402
from bakery.physics.shapes import build as shapes  # noqa: E402
from benchmarks.sizes import sized  # noqa: E402
from tests.grain_examples import EXAMPLES  # noqa: E402
from tests.oracles.balls import statistics  # noqa: E402

PUBLISHED = {("glass ball", 0.3): 120.3, ("glass ball", 0.63): 33.34, ("glass cube", 0.63): 37.88}  # good to 1 %
HEAD = ("grains", "fraction", "N", "M", "published", "window", "drift, %", "lambda_t", "its theory", "chord, sigma from exact",
        "sqrt(M) over Eq. 4, %", "over second moment, %", "correlation", "hits", "Mhit/s")


@dataclass(frozen=True)
class Case:
    """Grains (T,) with weights in a tile of spheres."""

    name: str
    centers: np.ndarray
    radii: np.ndarray
    cell: np.ndarray
    grains: tuple[Grain, ...]
    weights: tuple[float, ...] = (1.0,)


@cache
def mesh_of(name, triangles=sized(20_000, 320)):
    made = shapes.build(EXAMPLES.get(name, {"type": "box", "size": [1, 1, 1]}), triangles)
    return Mesh(made.vertices, made.faces)


def standard(count):
    """The cases that the documentation shows."""
    glass, matt, mirror = dielectric(1.5), diffuse(1.0), conductor(np.inf)
    single = {"glass ball": Grain(glass), "glass cube": Grain(glass, mesh_of("cube")), "matt ball": Grain(matt),
              "mirror ball": Grain(mirror), "mirror cube": Grain(mirror, mesh_of("cube")),
              "sand, 1.54": Grain(dielectric(1.54), mesh_of("sand")), "snow, 1.31": Grain(dielectric(1.31), mesh_of("snow")),
              "ball of index 1.1": Grain(dielectric(1.1))}
    jobs = [("glass ball", f) for f in (0.1, 0.3, 0.5, 0.63)] + [("glass cube", f) for f in (0.1, 0.3, 0.63)] + [
        ("matt ball", 0.3), ("matt ball", 0.63), ("mirror ball", 0.63), ("mirror cube", 0.63), ("sand, 1.54", 0.6),
        ("snow, 1.31", 0.6), ("ball of index 1.1", 0.63)]
    for name, f in jobs:
        tile = pack(f, np.ones(count), seed=1)
        yield Case(name, tile.centers, tile.radii, tile.cell, (single[name],))
    radii = np.where(np.arange(count) < count // 20, 3.0, 1.0)
    tile = pack(0.6, radii, seed=1)
    yield Case("glass ball, 5 % of them 3 times as large", tile.centers, tile.radii, tile.cell, (single["glass ball"],))
    tile = pack(0.6, np.ones(count), seed=1)
    yield Case("glass balls, cubes and matt balls", tile.centers, tile.radii, tile.cell,
               tuple(single[k] for k in ("glass ball", "glass cube", "matt ball")), (1.0, 1.0, 1.0))


def of_recipe(path):
    from bakery.recipe import load
    from bakery.stages.grains import stage as grains
    from bakery.stages.packing import stage as packing

    recipe = load(path, {})
    if recipe.grains is None or recipe.packing is None:
        sys.exit(f"{path} has no grains with a packing")
    given = grains.inputs(recipe, {})
    parts = []
    for part in given["components"]:
        at = len(recipe.wavelength) // 2
        mesh = None
        if part["shape"]["type"] != "sphere":
            made = shapes.build(part["shape"], given["triangles"])
            mesh = Mesh(made.vertices, made.faces)
        index = None if part["index"] is None else part["index"][at].real
        parts.append((part["weight"], coat(part["type"], index, part["roughness"]), mesh))
    tile = pack(recipe.packing.fraction[0], packing._radii(recipe.packing), seed=recipe.packing.seed)
    return Case(recipe.name, tile.centers, tile.radii, tile.cell, *grains_of(parts))


def of_asset(path):
    from bakery.stages.grains.view import exemplar
    from bakery.stages.members import Members
    from bakery.store.read import read

    root = read(path)
    if not {"grains", "packing", "medium"} <= set(root.members):
        sys.exit(f"{path} has no grains with a packing and a medium")
    parts = []
    for part in root["grains"].groups.values():
        grain = exemplar(part)
        surface = grain.surface
        index = surface["index"][len(surface["index"]) // 2] if "index" in surface else None
        mesh = None if grain.ball else Mesh(grain.vertices, grain.faces)
        parts.append((float(part["weight"].data[0]), coat(surface["type"], index, surface.get("roughness", 0.0)), mesh))
    tile = tile_of(*(Members(root[name], name) for name in ("packing", "medium")))
    return Case(Path(path).stem, *tile[:3], *grains_of(parts))


def grains_of(parts):
    """Grains and their weights from (weight, surface, mesh) each."""
    return tuple(Grain(surface, mesh) for _, surface, mesh in parts), tuple(weight for weight, _, _ in parts)


def coat(kind, index, roughness):
    """A surface that absorbs nothing."""
    if kind == "dielectric":
        return dielectric(index, roughness)
    return diffuse(1.0) if kind == "diffuse" else conductor(np.inf, roughness)


def means_of(grain, tolerance):
    """Statistics of the single grain, of the light that leaves it."""
    if grain.mesh is not None:
        found = measure(grain.mesh, grain.surface, seed=1, tolerance=tolerance)
    elif grain.surface.roughness > 0:
        found = statistics(grain.surface, radius=grain.radius, seed=1, tolerance=tolerance)
    else:
        found = ball(grain.surface, radius=grain.radius)
    means = Means.of(found)
    return replace(means, albedo=np.ones_like(means.g), errors=means.errors | {"albedo": 0.0})


def row(case, tolerance, quick):
    parts = [means_of(grain, 0.01 if quick else sized(0.001, 0.1)) for grain in case.grains]
    f = filled(case.radii, case.cell)
    classes, number = np.unique(case.radii, return_counts=True)
    each = [(part, weight * n, radius) for part, weight in zip(parts, case.weights) for radius, n in zip(classes, number)]
    means = mixed(*zip(*each))
    chord = void_chord(f, case.radii)
    start = time.thread_time()
    found = walk((case.centers, case.radii, case.cell), case.grains, case.weights, seed=1, tolerance=tolerance)
    seconds = time.thread_time() - start
    plain = effective(means, chord)
    M, error = found.mean_square_displacement, found.errors["mean_square_displacement"]

    def over(medium):
        return f"{100 * (np.sqrt(M / medium) - 1):+.2f}"

    away = (found.void_chord - found.void_chord_exact) / found.void_chord_error
    cells = (case.name, f"{f:.3g}", len(case.radii), f"{M:.5g} ± {error:.2g}", PUBLISHED.get((case.name, round(f, 4)), ""),
             found.window, f"{100 * found.drift:.2f} ± {100 * found.errors['drift']:.2f}",
             f"{found.lambda_t:.4f} ± {found.lambda_t_error:.4f}",
             f"{plain.lambda_t[0]:.4f}", f"{away:+.1f}", over(plain.m_rte[0]),
             over(plain.m_tele[0]),
             f"{found.correlation:+.3f}", f"{found.hits:.2g}", f"{found.hits / seconds / 1e6:.2f}")
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)
    if found.reason:
        print(f"  ({case.name}: {found.reason})")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", help="a recipe or an asset with grains; several standard grains if not given")
    parser.add_argument("--quick", action="store_true", help="errors of 1 %% instead of 0.2 %%, tiles of 250 spheres")
    parser.add_argument("--count", type=int, help="spheres in a tile of the standard grains")
    options = parser.parse_args()
    tolerance, count = sized((0.01, 250), (0.2, 60)) if options.quick else sized((0.002, 1000), (0.2, 60))
    walk(([[0, 0, 0]], [1], [2.1] * 3), [Grain(dielectric(1.5), mesh_of("cube"))], seed=0, tolerance=1)  # compiles
    cases = standard(options.count or count) if options.what is None else [
        of_asset(options.what) if options.what.endswith((".h5", ".hdf5")) else of_recipe(options.what)]
    print("| " + " | ".join(HEAD) + " |\n|" + "---|" * len(HEAD))
    for case in cases:
        row(case, tolerance, options.quick)


if __name__ == "__main__":
    main()
