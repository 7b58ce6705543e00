"""What every scene may say, whichever renderer it chooses: the material, the Mitsuba scene, camera, film, when to stop, display.

A renderer that does without one of these keys refuses it (`UNUSED` of its module `scene`): no key is read and ignored.
"""

# no annotations from __future__: pydantic would have to compile each of them again
from collections.abc import Iterator
from collections.abc import Mapping as MappingType
from typing import Annotated

import numpy as np
from pydantic import Discriminator, Field, Tag

from bakery.errors import Problem
from bakery.grammar import fields, text, units
from bakery.grammar.fields import leaf, number, scalar, three, whole, word
from bakery.grammar.section import Section, given
from bakery.grammar.text import Mapping, Node, Scalar, Sequence, owner
from bakery.grammar.units import ANGLE, FRACTION, NUMBER_ONLY, Quantity, Wrong
from renderers.scene.frames import read as read_frames

FORMAT = 2
FILES = ("scene.mitsuba",)  # keys of files
DENOISE = ("auto", "yes", "no")

# scenes are as large as rooms and landscapes: their lengths are in m
LENGTH = Quantity("length", "lengths", "m", {"um": -6, "mm": -3, "cm": -2, "m": 0, "km": 3}, "m")
TIME = Quantity("time", "times", "s", {"ms": -3, "s": 0}, "s")


# ---- kinds of values


def _read_format(node):
    version = scalar(node, f"the scene format, {FORMAT}").text
    if version != str(FORMAT) or node.quoted:
        raise Wrong(f"found {text.show(version)}", f"this version of bakery reads scene format {FORMAT}")
    return FORMAT


def vector(quantity: Quantity = NUMBER_ONLY, example: str = "[0, 0, 1]"):
    """Three numbers, as a list or as a list with one unit behind it."""

    def read(node):
        node = scalar(node, f"three numbers such as {example}")
        values = units.parse_list(node.text, quantity) if units.is_list(node.text) else ()
        if len(values) != 3:
            raise Wrong(f"found {text.show(node.text)}", f"expected three numbers such as {example}")
        return values

    listed = three(number(quantity))
    return Annotated[
        Annotated[leaf(read, {"type": "string"}), Tag("text")] | Annotated[listed, Tag("list")],
        Discriminator(lambda node: "list" if isinstance(node, (Sequence, list, tuple)) else "text"),
    ]


def _read_parameter(node):
    """A text, or several numbers as Mitsuba writes them."""
    if isinstance(node, Sequence) and node and all(isinstance(item, Scalar) for item in node):
        return ", ".join(item.text for item in node)
    return scalar(node, "a value as the Mitsuba scene has it, such as 5 or [0.8, 0.5, 0.2]").text


Format = leaf(_read_format, {"const": FORMAT})
Parameter = leaf(_read_parameter, {"type": ["number", "string", "array"]})
Length = number(LENGTH, above=0, most=1e12)
Position = vector(LENGTH, "[0, -12, 1.7] m")
Direction = vector()
Share = number(FRACTION, above=0, most=1)
Tolerance = number(FRACTION, least=1e-6, most=1)
Edge = whole(1, 65536)


# ---- sections


class Surfaces(Section):
    """A scene of Mitsuba: surfaces, lights, camera."""

    mitsuba: fields.Path = Field(description="Mitsuba scene (XML), relative to the scene's folder.")
    unit: Length = Field(1.0, description="Length of one unit of the Mitsuba scene, such as 1 cm.")
    parameters: dict[str, Parameter] | None = Field(
        None, description="Values of $NAME in the Mitsuba scene, by name; default: the <default> of the file."
    )


class Grid(Section):
    """Densities in a box: a file, and the box that they fill."""

    grid: fields.Path = Field(description="File of densities: HDF5, NPY or Mitsuba's VOL.")
    dataset: fields.Path | None = Field(None, description="Name of the dataset in an HDF5 file.")
    lo: Position | None = Field(None, description="Corner of the box that the grid fills; a VOL file holds its own.")
    hi: Position | None = Field(None, description="The opposite corner.")


class Camera(Section):
    """A pinhole camera."""

    origin: Position = Field(description="Position of the camera.")
    target: Position = Field(description="A point at the centre of the picture.")
    up: Direction = Field((0.0, 0.0, 1.0), description="Direction that is up in the picture.")
    fov: number(ANGLE, above=0, below=3.141592653589793) = Field(
        description="Angle between the left and the right edge of the picture, such as 40 deg."
    )


class Film(Section):
    """The picture's pixels and wavelengths."""

    width: Edge | None = Field(None, description="Pixels; default: the Mitsuba scene's, or else the renderer's.")
    height: Edge | None = Field(None, description="Pixels; given together with the width.")
    wavelengths: word("asset", "rgb") = Field(
        "asset", description="asset: every wavelength of the asset, converted to colours at the end; rgb: three bands."
    )


class Stop(Section):
    """When a renderer that samples stops: whichever comes first."""

    noise: Share | None = Field(None, description="Relative noise of the picture; default: its share of the tolerance.")
    time: number(TIME, above=0, most=1e9) | None = Field(None, description="Time in s after which no pass starts.")
    samples: whole(1, 10**9) | None = Field(None, description="Most samples a pixel.")


class Display(Section):
    """How the PNG shows linear radiance; the EXR is not touched by it."""

    curve: word("reinhard", "none") = Field("reinhard", description="Tone curve of the PNG.")
    exposure: number(above=0, most=1e12) = Field(1.0, description="Factor before the curve.")
    white: number(above=0, most=1e12) = Field(4.0, description="Luminance after exposure that becomes white (reinhard).")


class Every(Section):
    """Keys of every scene."""

    bakery_scene: Format = Field(description=f"Scene format, {FORMAT}.")
    name: fields.Name = Field(description="Name of the scene; without -o the pictures are NAME.png and NAME.exr beside it.")
    description: fields.Text = Field("", description="Free text.")
    tolerance: Tolerance | None = Field(
        None, description="Relative root mean square error of the picture's linear radiance; default: the renderer's."
    )
    measure: word("picture", "pixels") = Field(
        "picture", description="Whether the tolerance holds for the picture as a whole, or for each of 99 of 100 pixels."
    )
    scene: Surfaces | None = Field(None, description="Surfaces, lights and camera.")
    camera: Camera | None = Field(None, description="The camera, instead of the Mitsuba scene's sensor.")
    film: Film = Field(Film.model_construct(width=None, height=None, wavelengths="asset"), description="Pixels, wavelengths.")
    stop: Stop = Field(Stop.model_construct(noise=None, time=None, samples=None), description="When to stop.")
    display: Display = Field(
        Display.model_construct(curve="reinhard", exposure=1.0, white=4.0), description="How the PNG shows the picture."
    )
    denoise: word(*DENOISE) = Field("auto", description="Whether noise is removed from the PNG; auto: at draft and preview.")
    frames: leaf(read_frames, {"type": "object"}) | None = Field(
        None, description="For a sequence: dotted key -> its value in each frame; used by `--frames` only."
    )


class Common(Every):
    """Keys of a scene whose section names the renderer: it has one asset."""

    asset: fields.Path | None = Field(None, description="Asset of the medium, relative to the scene's folder.")
    recipe: fields.Path | None = Field(
        None, description="Recipe, instead of the asset: baked into the cache unless its asset exists and is good enough."
    )


# ---- what has to hold between keys


def problems(root: Mapping, values: dict, renderer: str, unused: MappingType[str, str]) -> Iterator[Problem]:
    """Problems of the common keys; `values` are those that are well formed by themselves.

    renderer : its name
    unused : dotted key that it does without -> what would do instead
    """
    for key, instead in unused.items():
        if (node := node_at(root, key)) is not None:
            yield owner(node).problem(f"found a key that {renderer} does not use", f"expected {instead}")
    film = root.get("film")
    if "film" not in unused and isinstance(film, Mapping) and len(sizes := given(film, "width", "height")) == 1:
        lacking = "height" if sizes == ["width"] else "width"
        yield owner(film).problem("missing", f"expected {lacking}: pixels, beside the {sizes[0]}", key=f"film.{lacking}")
    yield from camera_problems(root, values)


def asset_problems(entry: Mapping, prefix: str = "") -> Iterator[Problem]:
    """Neither asset nor recipe, or both; `prefix` of the keys."""
    if not given(entry, "asset", "recipe"):
        yield owner(entry).problem("missing", "expected asset: a baked asset, or recipe: what to bake it from",
                                   key=f"{prefix}asset")
    if "asset" in entry and "recipe" in entry:
        yield entry.names["recipe"].problem("found a recipe beside an asset", "expected one of them")


def camera_problems(root: Mapping, values: dict) -> Iterator[Problem]:
    """A camera that looks nowhere, or along its own up."""
    yield from direction_problems(root, values, "camera.up")
    origin, target = triple(values, "camera.origin"), triple(values, "camera.target")
    if origin is None or target is None:
        return
    ahead = target - origin
    up = triple(values, "camera.up") if node_at(root, "camera.up") is not None else np.array([0.0, 0.0, 1.0])
    if not np.any(ahead):
        yield owner(node_at(root, "camera.target")).problem("found the camera's own place", "expected a point ahead of it")
    elif up is not None and np.linalg.norm(np.cross(ahead, up)) < 1e-6 * np.linalg.norm(ahead) * np.linalg.norm(up):
        node = node_at(root, "camera.up") or node_at(root, "camera.target")
        yield owner(node).problem("found a camera that looks along its own up", "expected another up, such as [0, 1, 0]")


def direction_problems(root: Mapping, values: dict, key: str) -> Iterator[Problem]:
    """A direction without length."""
    if key in values or f"{key}[2]" in values:
        direction = triple(values, key)
        if direction is not None and not np.any(direction):
            yield node_at(root, key).place.problem("found a direction of length 0", "expected one such as [0, 0, 1]")


def box_problems(root: Mapping, values: dict, key: str) -> Iterator[Problem]:
    """A box without volume: `lo` and `hi` below a dotted key."""
    lo, hi = triple(values, f"{key}.lo"), triple(values, f"{key}.hi")
    if lo is not None and hi is not None and not np.all(lo < hi):
        yield owner(node_at(root, f"{key}.hi")).problem("found a box without volume", "expected hi above lo in x, y and z")


def names_at(node) -> list[str]:
    """The names in a mapping that may be part of a dotted key; none where there is no mapping."""
    return [name for name in node if not set(name) & set(".[]")] if isinstance(node, dict) else []


def node_at(root: Mapping, key: str) -> Node | None:
    """The node at a dotted key such as `materials[1].where.mesh`, or None."""
    node = root
    for step in key.replace("[", ".[").split("."):
        if step.startswith("["):
            node = node[int(step[1:-1])] if isinstance(node, Sequence) else None
        else:
            node = node.get(step) if isinstance(node, Mapping) else None
    return node


def value_at(values: Section, key: str):
    """The value at a dotted key of a scene's values, or None."""
    for step in key.replace("[", ".[").split("."):
        if step.startswith("["):
            values = values[int(step[1:-1])] if isinstance(values, list) else None
        else:
            values = values.get(step) if isinstance(values, dict) else getattr(values, step, None)
    return values


def triple(values: dict, key: str):
    """The three numbers at a key, (3,), or None where they are missing or wrong."""
    numbers = values.get(key, tuple(values.get(f"{key}[{i}]") for i in range(3)))
    return None if None in numbers else np.array(numbers, float)


def differing(root: Mapping, values: dict, key: str, default) -> Iterator[Problem]:
    """Entries that say different values of a key of which a renderer takes one for all."""
    listed = root.get("materials")
    entries = [values.get(f"materials[{i}].{key}", default) for i in range(len(listed) if isinstance(listed, Sequence) else 0)]
    for i, value in enumerate(entries):
        if value != entries[0]:
            node = node_at(root, f"materials[{i}].{key}") or node_at(root, f"materials[0].{key}")
            yield owner(node).problem(f"found {value}, but materials[0] has {entries[0]}", "expected the same in all entries")
            return
