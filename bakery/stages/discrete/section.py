"""Recipe section `discrete`: separate particles in a box, in a grid of densities or in a mesh."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
import math
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from pydantic import Field

from bakery.grammar import grids
from bakery.grammar.fields import AUTO, Path, Text, number, three, whole, word
from bakery.grammar.section import Section, given
from bakery.grammar.text import Mapping, Sequence, mappings, show
from bakery.grammar.units import FRACTION, LENGTH, Wrong
from bakery.stages.declaration import RecipeSection
from bakery.stages.grains.section import mesh_file

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

METHODS = ("stored", "procedural")
UNASKED, MOST = 10**8, 10**9  # particles that are stored without being asked for, and at all
# datasets of the group, beside which its components stand
TAKEN = ("method", "number", "number_density", "box", "volume", "key", "position", "radius", "component", "density",
         "mesh_vertices", "mesh_faces", "theta", "host", "host_absorption", "mean_extinction", "mean_extinction_error",
         "law_extinction",
         "cell_dispersion", "cell_dispersion_error", "cell_edge", "cell_count", "cell_count_law", "class_dispersion",
         "class_dispersion_error")
REACHED = 0.03  # what a class's averages take no trouble to meet better: their errors hardly add up
_CUBIC = 1e-18  # m^3 a um^3


class MeshBody(Section):
    """A closed mesh that holds the particles; its bounding box is the box."""

    file: Path = Field(description="ply, obj, stl or off file of a closed mesh.")
    unit: number(LENGTH, least=1e-3, most=1e13) = Field(1e6, description="Length of one unit of the file, such as 1 m or 1 cm.")


class DensityGrid(Section):
    """Relative densities in the box: the largest value is the full density."""

    file: Path = Field(description="h5 or npy file with densities on three axes, x, y, z.")
    dataset: Text | None = Field(None, description="Name of the dataset in an HDF5 file.")


class Discrete(Section):
    """Separate particles."""

    count: whole(0, 10**12) | None = Field(
        None, description="Number of particles; default: random (Poisson), by the number density of `particles`."
    )
    box: three(number(LENGTH, least=1e-3, most=1e13)) | None = Field(
        None, description="Edges of the box that holds them, such as [1 m, 1 m, 1 m]."
    )
    mesh: MeshBody | None = Field(None, description="A closed mesh that holds them, instead of a box.")
    grid: DensityGrid | None = Field(None, description="Relative densities in the box.")
    method: word(*METHODS) | None = Field(
        None, description="stored: the asset holds every position; procedural: none, a renderer draws them from hashes."
    )
    seed: whole(0, 2**53) | None = Field(None, description="Seed of the realisation; default: the recipe's.")
    classes: whole(1, 4096, words=AUTO) = Field("auto", description="Classes of radii of each component.")
    tolerance: number(FRACTION, least=1e-4, most=0.5) | None = Field(
        None, description="Error of the classes' averages; default: the recipe's tolerance, but at least 3 %."
    )


# ---- what holds between the keys


def check(checker: "Checker", section: Mapping) -> None:
    """Particles, a place for them, and not more than can be stored."""
    checker.only_with(section, "particles")
    for particles in mappings(checker.tree.get("particles")):
        node = particles.get("components")
        for part in mappings(*node) if isinstance(node, Sequence) else ():
            name = checker.value(part, "name")
            if name in TAKEN:
                checker.report(part["name"], f"found {show(name)}, which the asset uses for something else beside discrete",
                               "expected another name")
    places = given(section, "box", "mesh")
    if len(places) != 1:
        node = section.get("mesh", section)
        checker.report_section(node, "found a box beside a mesh" if places else "found neither box nor mesh",
                               "expected only one of them" if places else "expected one of them, such as box: [1 m, 1 m, 1 m]")
    if "grid" in section and "box" not in places:
        checker.report_section(section["grid"], "found a grid without a box", "expected the box that it fills")
    for mesh in mappings(section.get("mesh")):
        mesh_file(checker, mesh.get("file"))
    share = 1.0
    for grid in mappings(section.get("grid")):
        share = _grid(checker, grid)
    if share is not None:
        _number(checker, section, share)


def _grid(checker: "Checker", grid: Mapping) -> float | None:
    """Read the densities; their mean over the largest."""
    node = grid.get("file")
    name = None if node is None else checker.value(grid, "file")
    if name is None:
        return None
    kind = PurePosixPath(name).suffix[1:].lower()
    if kind not in grids.KINDS:
        checker.report(node, f"found {show(name)}", "expected a file that ends in .h5, .hdf5 or .npy")
        return None
    try:
        data, file = checker.folder.read(node.place.key, name, grids.BYTES, "grid")
        values = grids.read(data, kind, checker.value(grid, "dataset"))
    except Wrong as wrong:
        checker.report(node, wrong.found, wrong.expected)
        return None
    checker.files.append(file)
    checker.found[node.place.key] = values
    return float(values.mean(dtype=float))


def _number(checker: "Checker", section: Mapping, share: float) -> None:
    """More particles than are stored, as far as can be said before meshes and sizes are looked at."""
    count, method = checker.value(section, "count"), checker.value(section, "method")
    node, box = section.get("box"), None
    if isinstance(node, Sequence):
        box = checker.several(node)
    if count is None and "count" not in section and box is not None and len(box) == 3:
        for particles in mappings(checker.tree.get("particles")):
            density = checker.value(particles, "number_density")
            count = None if density is None else density * math.prod(box) * _CUBIC * share
    if count is None or "method" in section and method is None:
        return
    fault = too_many(count, method)
    if fault:
        checker.report_section(section.get("method", section), *fault)


def too_many(count: float, method: str | None) -> tuple[str, str] | None:
    """What is wrong with storing so many particles, and what would do; None: nothing."""
    if count <= (MOST if method else UNASKED) or method == "procedural":
        return None
    stored = f", or method: stored ({16 * count / 1e9:.2g} GB)" if count <= MOST else ""
    return (f"found {count:.3g} particles to be stored",
            f"expected method: procedural, which stores none{stored}, or a smaller number")


def _completed(discrete: Discrete, recipe) -> Discrete:
    return discrete.model_copy(update={
        "seed": recipe.seed if discrete.seed is None else discrete.seed, "method": discrete.method or METHODS[0],
        "tolerance": discrete.tolerance or max(recipe.tolerance, REACHED)})


DISCRETE = RecipeSection("discrete", Discrete, "Separate particles: one realisation of the medium.", check, completed=_completed)
