"""Scene files: the part that all renderers of scenes share.

A scene is YAML in the grammar of recipes: units, no unknown keys, every problem at once with its file, line and key.  One of its
sections names the renderer (`RENDERERS`), a package:

- `render(scene, output, *, quality, variant, seed, overwrite, progress) -> report` and `describe(report) -> lines`, for which
  `renderers.running` has what all do alike;
- its module `scene`: `SceneFile(Common)`, what the whole file may hold; `NEEDS`, stages of the asset; `FILES`, keys of the files
  that a scene names; `problems(root, values)`, what has to hold between keys.
"""

# no annotations from __future__: pydantic would have to compile each of them again
import dataclasses
import os
from collections.abc import Iterator
from collections.abc import Mapping as MappingType
from importlib import import_module
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Discriminator, Field, Tag, ValidationError

from bakery.errors import Problem, RecipeError, UsageError
from bakery.grammar import fields, files, overrides, text, units
from bakery.grammar.fields import leaf, number, scalar
from bakery.grammar.problems import distinct, places, translate
from bakery.grammar.section import Section
from bakery.grammar.text import Mapping, Node, Sequence, owner
from bakery.grammar.units import ANGLE, NUMBER_ONLY, Quantity, Wrong
from renderers.inputs import files_of

FORMAT = 1
SUFFIXES = (".yaml", ".yml")
RENDERERS = {"fog": "renderers.fog"}  # section of a scene -> the package that renders it

# scenes are as large as rooms and landscapes: their lengths are in m
LENGTH = Quantity("length", "lengths", "m", {"um": -6, "mm": -3, "cm": -2, "m": 0, "km": 3}, "m")


# ---- kinds of values


def _read_format(node):
    found = scalar(node, f"the scene format, {FORMAT}").text
    if found != str(FORMAT) or node.quoted:
        raise Wrong(f"found {text.show(found)}", f"this version of bakery reads scene format {FORMAT}")
    return FORMAT


def vector(quantity: Quantity = NUMBER_ONLY, example: str = "[0, 0, 1]"):
    """Three numbers, as a list or as a list with one unit behind it."""

    def read(node):
        node = scalar(node, f"three numbers such as {example}")
        values = units.parse_list(node.text, quantity) if units.is_list(node.text) else ()
        if len(values) != 3:
            raise Wrong(f"found {text.show(node.text)}", f"expected three numbers such as {example}")
        return values

    listed = Annotated[list[number(quantity)], Field(min_length=3, max_length=3)]
    return Annotated[
        Annotated[leaf(read, {"type": "string"}), Tag("text")] | Annotated[listed, Tag("list")],
        Discriminator(lambda node: "list" if isinstance(node, (Sequence, list, tuple)) else "text"),
    ]


Format = leaf(_read_format, {"const": FORMAT})
Length = number(LENGTH, above=0, most=1e12)
Position = vector(LENGTH, "[0, -12, 1.7] m")
Direction = vector()


class Camera(Section):
    """A pinhole camera."""

    origin: Position = Field(description="Where the camera stands.")
    target: Position = Field(description="A point that lies in the middle of the picture.")
    up: Direction = Field((0.0, 0.0, 1.0), description="Direction that is up in the picture.")
    fov: number(ANGLE, above=0, below=3.141592653589793) = Field(
        description="Angle between the left and the right edge of the picture, such as 40 deg."
    )


class Common(Section):
    """Keys of every scene."""

    bakery_scene: Format = Field(description=f"Scene format, {FORMAT}.")
    name: fields.Name = Field(description="Of the scene; without -o the pictures are NAME.png and NAME.exr beside it.")
    description: fields.Text = Field("", description="Free text.")
    asset: fields.Path = Field(description="Asset of the medium, relative to the scene's folder.")
    camera: Camera | None = Field(None, description="Where the picture was taken from.")


# ---- reading


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    """A scene whose values are all well formed and whose files are there.

    Attributes
    ----------
    path : of the scene
    section : the one that names the renderer
    renderer : the package that renders it
    values : `SceneFile` of that renderer; lengths in m, angles in rad
    overrides : dotted key -> text
    """

    path: Path
    section: str
    renderer: str
    values: Common
    overrides: MappingType[str, str]
    places: MappingType[str, str] = dataclasses.field(repr=False)

    @property
    def picture(self) -> Path:
        """Where the picture goes unless the user says."""
        return self.path.parent / f"{self.values.name}.png"

    @property
    def inputs(self) -> list[Path]:
        """The scene and every file that it is made of."""
        found = [self.path]
        for key in import_module(f"{self.renderer}.scene").FILES:
            value = self.values
            for step in key.split("."):
                value = getattr(value, step, None)
            found += files_of(self.file(value)) if value is not None else []
        return found

    def file(self, name: str) -> Path:
        """A file that the scene names."""
        return self.path.parent / name

    def wrong(self, key: str, message) -> UsageError:
        """What to raise where the value of a key turns out to be wrong later than on reading."""
        return UsageError(f"{self.places.get(key, text.label_of(self.path))}: {key}: {message}")


def load(path, settings: MappingType[str, str] | None = None) -> Scene:
    """Reads and checks a scene.

    Parameters
    ----------
    path : of the scene, a regular file of at most 1 MiB
    settings : dotted key -> value as YAML text, such as `{"fog.density.scale": "5"}`

    Raises
    ------
    UsageError : there is no such regular file
    RecipeError : with every problem of the scene and of the settings
    """
    path = Path(path)
    if not path.is_file():
        raise UsageError(f"{text.label_of(path)}: there is no such scene; give the path of a scene (NAME.yaml)")
    source, tree = _parsed(path)
    problems = tree.problems + overrides.apply(source, tree, settings or {})[1]
    if not isinstance(tree.root, Mapping):
        found = "nothing" if tree.root is None else fields.describe(tree.root)
        expected = f"expected `key: value` lines; a scene starts with `bakery_scene: {FORMAT}`"
        place = None if tree.root is None else tree.root.place.begin
        raise RecipeError([*problems, source.problem(place, "", f"found {found}", expected)])
    section, problem = _section(source, tree.root)
    if not section:
        raise RecipeError([*problems, problem])
    renderer = RENDERERS[section]
    kind = import_module(f"{renderer}.scene")
    values: dict = {}
    try:
        parsed = kind.SceneFile.model_validate(tree.root, context=values)
    except ValidationError as error:
        parsed = None
        problems += [problem for one in error.errors(include_url=False) for problem in translate(one)]
    problems += _files(path, tree.root, values, kind.FILES)
    problems += camera_problems(tree.root, values)
    problems += kind.problems(tree.root, values)
    if problems:
        raise RecipeError(distinct(problems))
    where = {place.key: str(place) for place in places(tree.root)}
    return Scene(path, section, renderer, parsed, dict(settings or {}), where)


def needs(path) -> tuple[str, ...]:
    """Names of the stages that a scene's asset must hold; the asset need not be there yet.

    Raises UsageError or RecipeError where the file is no scene.
    """
    path = Path(path)
    if not path.is_file():
        raise UsageError(f"{text.label_of(path)}: there is no such scene; give the path of a scene (NAME.yaml or NAME.xml)")
    if path.suffix.lower() not in SUFFIXES:
        return ("medium",)  # Mitsuba's; bakery's plugins for it read no other stage
    source, tree = _parsed(path)
    if tree.problems:
        raise RecipeError(tree.problems)
    section, problem = _section(source, tree.root)
    if not section or section not in tree.root:
        raise RecipeError([problem])
    return import_module(f"{RENDERERS[section]}.scene").NEEDS


def _section(source: text.Source, root: Node | None) -> tuple[str, Problem | None]:
    """The section that names the renderer, else the one that an unknown key seems to stand for, else ""; and what is wrong."""
    keys = list(root) if isinstance(root, Mapping) else []
    named = [name for name in RENDERERS if name in keys]
    if len(named) == 1:
        return named[0], None
    expected = f"expected {fields.one_of(list(RENDERERS))}"
    if named:
        place = root.names[max(named, key=keys.index)]
        return "", place.problem(f"found the sections of {len(named)} renderers, {', '.join(named)}", expected)
    near = [fields.closest(key, RENDERERS) for key in keys if key not in Common.model_fields]
    return next(filter(None, near), ""), source.problem(None, "", "found no renderer's section", expected)


def _parsed(path: Path) -> tuple[text.Source, text.Tree]:
    """Text and tree; what the grammar says of recipes holds for scenes."""
    try:
        source = text.Source(text.label_of(path), text.decode(files.read_recipe(path), text.label_of(path)))
        tree = text.parse(source)
    except RecipeError as error:
        raise RecipeError(map(_of_scenes, error.problems)) from None
    return source, text.Tree(tree.root, list(map(_of_scenes, tree.problems)))


def _of_scenes(problem: Problem) -> Problem:
    return dataclasses.replace(problem, expected=problem.expected.replace("recipe", "scene"))


def _files(path: Path, root: Mapping, values: dict, keys: tuple[str, ...]) -> Iterator[Problem]:
    """Files that are named and not there."""
    for key in keys:
        name = values.get(key)
        if name is None:
            continue
        node = node_at(root, key)
        if not name.strip() or not name.isprintable() or len(os.fsencode(name)) > 1000:
            yield node.place.problem(f"found {text.show(name)}", "expected a path relative to the scene's folder")
        elif not (path.parent / name).exists():
            yield node.place.problem(f"found {text.show(name)}, and there is no such file",
                                     f"expected a file relative to {text.label_of(path.parent)}")
        elif not (path.parent / name).is_file():
            yield node.place.problem(f"found {text.show(name)}, which is no regular file", "expected a file")


def node_at(root: Mapping, key: str) -> Node | None:
    """The node at a dotted key, or None."""
    node = root
    for step in key.split("."):
        node = node.get(step) if isinstance(node, Mapping) else None
    return node


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
        place = node_at(root, "camera.up") or node_at(root, "camera.target")
        yield owner(place).problem("found a camera that looks along its own up", "expected another up, such as [0, 1, 0]")


def direction_problems(root: Mapping, values: dict, key: str) -> Iterator[Problem]:
    """A direction without length."""
    if key in values or f"{key}[2]" in values:
        found = triple(values, key)
        if found is not None and not np.any(found):
            yield node_at(root, key).place.problem("found a direction of length 0", "expected one such as [0, 0, 1]")


def triple(values: dict, key: str):
    """The three numbers at a key, (3,), or None where they are missing or wrong."""
    found = values.get(key, tuple(values.get(f"{key}[{i}]") for i in range(3)))
    return None if None in found else np.array(found, float)
