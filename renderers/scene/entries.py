"""The list `materials` of a scene: what its entries may say, and of which kind each is.

An entry says where a material is, which asset or recipe it is made of, and by which method it is rendered.  Its kind follows from
`where` and from what the asset holds; `as` decides where several kinds would do.
"""

# no annotations from __future__: pydantic would have to compile each of them again
import dataclasses
import math
from collections.abc import Iterator
from importlib import import_module
from os.path import isfile  # False of names that no file can have, where a Path raises
from pathlib import Path as File
from typing import Annotated

import h5py
from pydantic import Discriminator, Field, Tag, create_model

from bakery.errors import BakeryError, Problem
from bakery.grammar import fields, files, text
from bakery.grammar.fields import Path, leaf, number, scalar, word
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping, Scalar, Sequence, owner, show
from bakery.grammar.units import ANGLE, Quantity, Wrong, parse
from renderers.scene.common import (
    LENGTH,
    TIME,
    Every,
    Grid,
    Length,
    Position,
    asset_problems,
    box_problems,
    names_at,
    node_at,
    vector,
)

MOST = 256  # entries
OF_ENTRIES = ("asset", "recipe")  # keys that were common to a scene, and are of each entry
FILES = ("asset", "recipe", "where.mesh", "where.grid", "fraction.grid", "mixture.*.grid")  # keys of files in an entry
KINDS = {"particles": "particles", "grains": "grains", "medium": "a medium", "body": "a body"}  # kind -> in a sentence
# kind -> the package that declares its methods and stages; a medium has neither of its own
PACKAGES = {"particles": "renderers.materials.particles", "grains": "renderers.materials.grains",
            "body": "renderers.materials.bodies"}
BOUNDARIES = ("negative", "mirrored", "none")  # how tables see the boundary of a body
PLACES = {"particles": ("box", "mesh", "grid", ""), "grains": ("mesh",), "medium": ("everywhere", "box", "mesh", "shape", "grid"),
          "body": ("shape",)}  # kind -> keys of `where`; "" where it may be absent
# kind -> keys that not all kinds have
KEYS = {"particles": ("velocity", "time", "footprint", "peak"), "medium": (), "body": ("boundary", "layer", "surface_from"),
        "grains": ("spread", "widen", "fraction", "mixture", "surface_from")}
SPEED = Quantity("speed", "speeds", "m/s", {"um/s": -6, "mm/s": -3, "cm/s": -2, "m/s": 0, "km/s": 3}, "m/s")

# ---- where a material is


class Box(Section):
    lo: Position = Field(description="Corner of the box.")
    hi: Position = Field(description="The opposite corner.")


class InBox(Section):
    box: Box = Field(description="A box.")


class InMesh(Section):
    """What is inside of a mesh."""

    mesh: Path = Field(description="PLY, OBJ, STL or OFF file of a closed mesh, which the material fills.")
    unit: Length = Field(1.0, description="Length of one unit of the mesh.")


class InShape(Section):
    """What is inside of a shape of the Mitsuba scene."""

    shape: fields.Text = Field(description="Id of a shape of the Mitsuba scene: a closed mesh.")


@dataclasses.dataclass(frozen=True)
class Everywhere:
    """All that no other material fills."""

    everywhere: bool = True


_PLACES = ("box", "mesh", "shape", "grid")
_WHERE = "everywhere, {box: {lo: …, hi: …}}, {mesh: …}, {shape: …} or {grid: …, lo: …, hi: …}"


def _everywhere(node):
    if scalar(node, _WHERE).text != "everywhere":
        raise Wrong(f"found {show(node.text)}", f"expected {_WHERE}")
    return Everywhere()


def _place(node) -> str | None:
    """The key of `where` that says what kind of place it is; "everywhere" of a word."""
    if isinstance(node, Mapping):
        return next((key for key in _PLACES if key in node), None)
    return "everywhere" if isinstance(node, Scalar) else None


Where = Annotated[
    Annotated[leaf(_everywhere, {"const": "everywhere"}), Tag("everywhere")] | Annotated[InBox, Tag("box")]
    | Annotated[InMesh, Tag("mesh")] | Annotated[InShape, Tag("shape")] | Annotated[Grid, Tag("grid")],
    Discriminator(_place, custom_error_type="choice",
                  custom_error_message="|everywhere|{box: {lo: …, hi: …}}|{mesh: …}|{shape: …}|{grid: …, lo: …, hi: …}"),
]

# ---- an entry


def _peak(node):
    """`keep`, `auto`, or an angle in rad."""
    value = scalar(node, "keep, auto, or an angle such as 0.1 deg")
    if value.text in ("keep", "auto"):
        return value.text
    angle = parse(value.text, ANGLE)
    if not 0 <= angle <= math.pi:
        raise Wrong(f"found {show(value.text)}", "expected keep, auto, or an angle from 0 to 180 deg")
    return angle


class BodyBoundary(Section):
    """Between a body and what is around it."""

    index: number(above=0, most=10) | None = Field(
        None, description="Refractive index inside over outside, equal to that of the shape's BSDF; default: the BSDF's."
    )
    tables: word(*BOUNDARIES) = Field(
        "negative", description="Correction of the tables, which are of an infinite medium. negative: exact, by beams of "
        "negative power; mirrored: approximate, by a mirror outside of the boundary; none."
    )


class _Entry(Section):
    where: Where | None = Field(None, description="Where the material is; default for particles: the asset's own box, "
                                                  "its corner at the origin.")
    asset: Path | None = Field(None, description="Asset of the material, relative to the scene's folder.")
    recipe: Path | None = Field(
        None, description="Recipe, instead of the asset: baked into the cache unless its asset exists and is good enough."
    )
    method: fields.Text = Field("auto", description="Rendering method; auto: the cheapest that keeps the tolerance.")
    velocity: vector(SPEED, "[0, 0, -1] m/s") = Field((0.0, 0.0, 0.0), description="Velocity of all particles.")
    time: number(TIME) = Field(0.0, description="Time at which moving particles are seen.")
    footprint: number(above=0, most=100) = Field(
        0.5, description="For method query: cross section of the cylinder, in pixels (k of the paper)."
    )
    peak: leaf(_peak, {"type": ["string", "number"]}) = Field(
        "auto", description="Light scattered by less than this angle counts as unscattered; auto: half a pixel; keep: none."
    )
    spread: number(above=0, most=1e6) = Field(
        4.0, description="Radii of the largest sphere by which paths of neighbouring pixels separate before they switch."
    )
    widen: number(ANGLE, least=0, most=math.radians(30)) | None = Field(
        None, description="Radius of the disc as which smooth grains show small lamps at the first sample; 0: as they are; "
        "default: as wide as pixels do not tell, 20 deg at most."
    )
    fraction: Grid | None = Field(None, description="Local packing fraction, by volume; default: the asset's everywhere.")
    mixture: Annotated[dict[str, Grid], Field(min_length=1)] | None = Field(
        None, description="Component of the asset -> its local share of the number of grains; default: the asset's."
    )
    boundary: BodyBoundary | None = Field(None, description="Boundary of a body; default: that of the shape's BSDF.")
    layer: fields.whole(0, 1000) | None = Field(
        None, description="For method surface: index of the asset's thickness, from 0; default 0."
    )
    surface_from: number(LENGTH, least=0, most=1e12) | None = Field(
        None, description="For methods paths+surface and ept+vpt+surface: distance to the camera up to which paths go into the "
        "body or its grains; from twice that on it is its baked surface; default: by the tolerance."
    )

    @property
    def kind(self) -> str:
        """One of `KINDS`; of an entry of a scene that was loaded."""
        return getattr(self, "as")

    @property
    def index(self) -> float | None:
        """Refractive index of the boundary; None where the shape's BSDF says it."""
        return self.boundary and self.boundary.index

    @property
    def tables(self) -> str:
        """How tables see the boundary."""
        return self.boundary.tables if self.boundary else "negative"


def _kind(node):
    kind, kinds = scalar(node, fields.one_of(list(KINDS))).text, list(KINDS)
    if kind not in kinds:
        raise Wrong(f"found {show(kind)}", f"expected {fields.one_of(kinds)}{_hint(kind, kinds)}")
    return kind


def _hint(word: str, accepted) -> str:
    """What to add where a word is none of those that are accepted."""
    if word == "surface":
        return ": what fills a shape of the scene may be one, by method: surface"
    return fields.nearest(word, accepted)


# `as` is a word of Python
Entry = create_model("Entry", __base__=_Entry, **{"as": (leaf(_kind, {"enum": list(KINDS)}) | None, Field(
    None, description="Kind of material, where several are possible.")), "__doc__": "A material: where, what, and how rendered."})


class SceneFile(Every):
    """A scene of materials."""

    materials: Annotated[list[Entry], Field(min_length=1, max_length=MOST)] = Field(description="The materials, with places.")
    method: fields.Text | None = Field(None, description="Method of all materials without one of their own.")


def declared(kind: str) -> dict:
    """`renderers.scene.declaration.SceneMethod` of each method of a kind, by name."""
    return import_module(f"{PACKAGES.get(kind, 'renderers.mixed')}.declared").methods()


def methods(kind: str) -> tuple[str, ...]:
    """Names of the methods of a kind."""
    return tuple(declared(kind))


def is_surface(kind: str, method: str) -> bool:
    """Whether a material is a surface of the Mitsuba scene by a method, which need not be one of its kind."""
    stated = declared(kind).get(method)
    return stated is not None and stated.surface


def has_surface(kind: str, method: str) -> bool:
    """Whether a material is a surface of the Mitsuba scene by a method, all of it or what is far from the camera: grains, which
    are no shape of it, look their own one up."""
    stated = declared(kind).get(method)
    return stated is not None and (stated.surface or stated.surface_far) and stated.beside


def stages(kind: str, method: str = "auto") -> tuple[str, ...]:
    """Stages of the asset that a kind is made of, by a method."""
    if (stated := declared(kind).get(method)) is not None and stated.stages:
        return stated.stages
    return import_module(f"{PACKAGES[kind]}.scene").NEEDS if kind in PACKAGES else ("medium",)


# ---- kinds and methods, from the tree: they are known also where some of it is wrong


@dataclasses.dataclass(frozen=True)
class Known:
    """What is known of an entry before all of it is checked: its kind and its method, and whether `as` contradicts its asset.

    kinds : which it may be; several where its asset or recipe cannot be read, which says so when it is opened
    """

    kind: str
    method: str
    kinds: tuple[str, ...]
    contradiction: str = ""


def known(root: Mapping, folder: File, method: str | None = None) -> list[Known]:
    """Of each entry; `method`, where it is given, is that of all of them, whatever they say."""
    listed = root.get("materials")
    default = _text(root, "method") or "auto"
    return [_known(entry if isinstance(entry, Mapping) else Mapping(root.place, True), folder, method, default)
            for entry in (listed if isinstance(listed, Sequence) else ())]


def _known(entry: Mapping, folder: File, method: str | None, default: str) -> Known:
    volume, claimed = _place(entry.get("where")) or "", _text(entry, "as")
    misspelt = "where" in entry and not volume  # what it should say is told; the kind goes by the asset
    able = [kind for kind, places in PLACES.items() if misspelt or volume in places]
    chosen = method or _text(entry, "method") or default
    meant = claimed or chosen != "auto" and chosen in methods("particles")
    if "where" not in entry and not meant and (parts := _parts(entry, folder)) and not parts & {"discrete", "particles"}:
        able = ["grains" if "grains" in parts else "medium"]  # these have no place of their own, and one is missing
    held = None if len(able) == 1 and not claimed else _held(entry, folder)
    contradiction = ""
    if claimed in KINDS:
        kind, fitting = claimed, [claimed]
        if held is not None and kind not in held and isfile(folder / _text(entry, "asset")):  # of recipes bakes say it
            contradiction = f"its asset holds {fields.one_of([KINDS[holds] for holds in held]) or 'no such stage'}"
    else:
        fitting = [kind for kind in able if held is None or kind in held] or able
        kind = "body" if "body" in fitting else next(iter(fitting), "medium")  # a body rather than the medium in a shape
    kinds = tuple(fitting) if held is None else (kind,)
    return Known(kind, chosen, kinds, contradiction)


def _text(node: Mapping, key: str) -> str:
    value = node.get(key)
    return value.text if isinstance(value, Scalar) else ""


def _held(entry: Mapping, folder: File) -> list[str] | None:
    """Kinds that an asset or a recipe holds; None where that cannot be read."""
    own = {"particles": "discrete", "grains": "grains"}  # of a medium and of bodies opening the asset says what lacks
    parts = _parts(entry, folder)
    return None if parts is None else [kind for kind in KINDS if kind not in own or own[kind] in parts]


def _parts(entry: Mapping, folder: File) -> set[str] | None:
    """Groups of an asset or sections of a recipe; None where they cannot be read."""
    key = "asset" if "asset" in entry else "recipe"
    name = _text(entry, key)
    path = folder / name
    if not name or not path.name:
        return None
    if key == "asset" and not isfile(path):
        path = next((path.with_suffix(suffix) for suffix in (".yaml", ".yml") if isfile(path.with_suffix(suffix))), path)
    if not isfile(path):
        return None
    try:
        if path.suffix.lower() in (".yaml", ".yml"):
            root = text.parse(files.source_of(path, path.name)).root
            return set(root) if isinstance(root, Mapping) else None
        with h5py.File(path) as asset:
            return set(asset)
    except (BakeryError, OSError, ValueError):
        return None  # opening the asset, or reading the recipe, says what is wrong with it


# ---- what has to hold between keys


def problems(root: Mapping, values: dict, entries: list[Known]) -> Iterator[Problem]:
    """Problems of the list, whichever renderer it is for; `values` are those that are well formed by themselves."""
    for key in OF_ENTRIES:
        if key in root:
            yield root.names[key].problem(f"found {key} beside materials", f"expected it in each entry, materials[0].{key}")
    listed = root.get("materials")
    for i, (entry, of) in enumerate(zip(listed if isinstance(listed, Sequence) else (), entries)):
        if isinstance(entry, Mapping):
            yield from asset_problems(entry, f"materials[{i}].")
            yield from _of_kind(root, entry, of, f"materials[{i}]")
            grids = ("fraction", *(f"mixture.{name}" for name in names_at(entry.get("mixture"))))
            for below in ("where.box", "where", *grids):
                yield from box_problems(root, values, f"materials[{i}].{below}")
    yield from _places(root, values, len(entries))


def _of_kind(root: Mapping, entry: Mapping, of: Known, key: str) -> Iterator[Problem]:
    """Keys and a place that the kind of an entry does not have."""
    called, node = KINDS[of.kind], entry.get("where")
    volume = _place(node) or ""
    if of.contradiction:
        yield entry["as"].place.problem(f"found {of.kind}, but {of.contradiction}",
                                        "leave it out, or name an asset that holds it")
    if node is not None and volume and volume not in PLACES[of.kind]:
        yield owner(node).problem(f"found {volume} for {called}", f"expected {fields.one_of(_words(of.kind))}")
    elif node is None and "" not in PLACES[of.kind]:
        yield owner(entry).problem("missing", f"expected where: {fields.one_of(_words(of.kind))}", key=f"{key}.where")
    for name in dict.fromkeys(name for names in KEYS.values() for name in names):
        kinds = [kind for kind, names in KEYS.items() if name in names]
        if name in entry and not set(of.kinds) & set(kinds):
            does = "does" if called.startswith("a ") else "do"
            yield entry.names[name].problem(f"found {name}, which {called} {does} not have",
                                            f"expected it with {fields.one_of([KINDS[kind] for kind in kinds])}")
    if not any(of.method in methods(kind) for kind in of.kinds):
        accepted = methods(of.kind)
        node = next((asking["method"] for asking in (entry, root) if _text(asking, "method") == of.method), None)
        reason = f"found {show(of.method)}"
        expected = f"expected {fields.one_of(accepted)}, the methods of {called}{_hint(of.method, accepted)}"
        yield node.place.problem(reason, expected) if isinstance(node, Scalar) else \
            owner(entry).problem(reason, expected, key=f"{key}.method")


def _words(kind: str) -> list[str]:
    written = {"everywhere": "everywhere", "box": "{box: {lo: …, hi: …}}", "mesh": "{mesh: …}", "shape": "{shape: …}",
               "grid": "{grid: …, lo: …, hi: …}", "": "none, for the asset's own box"}
    return [written[volume] for volume in PLACES[kind]]


def _places(root: Mapping, values: dict, count: int) -> Iterator[Problem]:
    """A shape, or all the rest, that two entries fill; shapes without a Mitsuba scene."""
    taken: dict[str, str] = {}
    for i in range(count):
        entry = f"materials[{i}]"
        shape = values.get(f"{entry}.where.shape")
        node = node_at(root, f"{entry}.where" if shape is None else f"{entry}.where.shape")
        name = shape if shape is not None else "everywhere" if _place(node) == "everywhere" else None
        if name is not None and taken.setdefault(name, entry) != entry:
            yield owner(node).problem(f"found {show(name)}, which is {taken[name]} already", "expected each place once")
    if any(values.get(f"materials[{i}].where.shape") is not None for i in range(count)) and node_at(root, "scene") is None:
        yield owner(root).problem("missing", "expected scene: {mitsuba: …}, with the shapes that are bodies", key="scene")
