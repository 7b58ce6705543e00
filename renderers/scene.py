"""Scene files: how they are read, and which renderer each is for.

A scene is YAML in the grammar of recipes: units, no unknown keys, every problem at once with its file, line and key.  What all
may say stands in `renderers.common`.  One of its sections names the renderer (`RENDERERS`), a package:

- `render(scene, output, *, quality, variant, seed, overwrite, progress) -> report` and `describe(report) -> lines`, for which
  `renderers.running` has what all do alike;
- its module `scene`: `SceneFile(Common)`, what the whole file may hold; `NEEDS`, stages of the asset; `FILES`, its own keys of
  files, `*` where any name may stand; `BODIES`, the key that may be a list of bodies, each with its own asset and files, or "";
  `UNUSED`, dotted common keys that it does without, each with what would do instead; `RESUMES`, whether `render` takes
  `resume` and goes on from the samples of the EXR that stands; `CHOICE`, the dotted key that chooses the method, and the names
  that it may have; `POINTS`, `EXACT` and `KEPT`, methods as `bake compare` takes them: those that `bake trade` tries, those
  without an error of their own (unless a report's `left_out` says what a picture lacks), and those that keep within a scene's
  tolerance by themselves; `problems(root, values)`,
  what has to hold between keys; and it may have `approximations(values, tolerance)`, the error that the chosen method states,
  relative to the picture's mean, and `PACE`, seconds of a core that a pixel takes to a relative variance of 1.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from collections.abc import Mapping as MappingType
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

from pydantic import ValidationError

from bakery.errors import Problem, RecipeError, UsageError
from bakery.grammar import fields, files, overrides, text
from bakery.grammar.problems import distinct, places, translate
from bakery.grammar.text import Mapping, Node, Sequence
from renderers import budget, common
from renderers.common import FORMAT, Common, names_at, node_at, value_at
from renderers.inputs import files_of, integrators, sources_of, unbounded

SUFFIXES = (".yaml", ".yml")
# section of a scene -> the package that renders it
RENDERERS = {"fog": "renderers.fog", "discrete": "renderers.discrete", "granular": "renderers.granular",
             "translucent": "renderers.translucent"}
_ABSENT = ", and there is no such file"


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
    asset : path of the material; None where `renderers.assets` has still to bake a recipe, or bodies have their own
    assets : of the materials of all bodies, in their order; of the one material; () before `renderers.assets` has seen to them
    share : of the tolerance's square that their tables may take, see `renderers.budget`
    """

    path: Path
    section: str
    renderer: str
    values: Common
    overrides: MappingType[str, str]
    asset: Path | None
    places: MappingType[str, str] = dataclasses.field(repr=False)
    assets: tuple[Path, ...] = ()
    share: float = budget.HALF

    @property
    def bodies(self) -> list:
        """What the scene says of each of its bodies, where it has a list of them; else all that it says."""
        found = value_at(self.values, self.rules.BODIES) if self.rules.BODIES else None
        return found if isinstance(found, list) else [self.values]

    @property
    def rules(self):
        """The renderer's module `scene`."""
        return import_module(f"{self.renderer}.scene")

    @property
    def picture(self) -> Path:
        """Where the picture goes unless the user says."""
        return self.path.parent / f"{self.values.name}.png"

    @property
    def inputs(self) -> list[Path]:
        """The scene and every file that it is made of."""
        return self._made_of(self.keys_of_files(), files_of)

    @property
    def sources(self) -> list[Path]:
        """The same but for its assets, which bakes write."""
        return self._made_of([key for key in self.keys_of_files() if not key.endswith("asset")], sources_of)

    def _made_of(self, keys, files_of) -> list[Path]:
        files = [self.path]
        for key in keys:
            value = value_at(self.values, key)
            files += files_of(self.file(value)) if value is not None else []
        return files

    def keys_of_files(self) -> list[str]:
        """Dotted keys that may name files."""
        return _keys_of_files(self.rules, 0 if self.bodies == [self.values] else len(self.bodies),
                              lambda key: value_at(self.values, key))

    def file(self, name: str) -> Path:
        """A file that the scene names."""
        return self.path.parent / name

    def wrong(self, key: str, message) -> UsageError:
        """What to raise where the value of a key turns out to be wrong later than on reading."""
        return UsageError(f"{self.places.get(key, text.label_of(self.path))}: {key}: {message}")

    def no_camera(self) -> UsageError:
        """What to raise where neither the scene nor its Mitsuba file has one."""
        return self.wrong("camera", "there is no camera; camera: {origin: …, target: …, fov: …} would do")


def load(path, settings: MappingType[str, str] | None = None, *, assets: bool = True) -> Scene:
    """Reads and checks a scene.

    Parameters
    ----------
    path : of the scene, a regular file of at most 1 MiB
    settings : dotted key -> value as YAML text, such as `{"fog.density.scale": "5"}`
    assets : those that it names have to be there, or else their recipes beside them

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
    bodies = node_at(tree.root, kind.BODIES) if kind.BODIES else None
    keys = _keys_of_files(kind, len(bodies) if isinstance(bodies, Sequence) else 0, lambda key: node_at(tree.root, key))
    problems += _files(path, tree.root, values, keys, assets)
    problems += common.problems(tree.root, values, section, kind.UNUSED, kind.BODIES)
    problems += kind.problems(tree.root, values)
    if problems:
        raise RecipeError(distinct(problems))
    where = {place.key: str(place) for place in places(tree.root)}
    asset = None if parsed.asset is None or beside(path.parent / parsed.asset) else path.parent / parsed.asset
    return Scene(path, section, renderer, parsed, dict(settings or {}), asset, where)


def beside(asset: Path) -> Path | None:
    """The recipe from which an asset that is not there can be baked: the YAML file of its name beside it; None: there is none."""
    found = [asset.with_suffix(suffix) for suffix in SUFFIXES if asset.with_suffix(suffix).is_file()]
    return found[0] if found and not asset.exists() else None


def unfinished(fault: RecipeError) -> bool:
    """Whether nothing is wrong with a scene but that keys or files are still to come."""
    return all(problem.found == "missing" or problem.found.endswith(_ABSENT) for problem in fault.problems)


def _to_be_baked(asset: Path, asked: bool) -> bool:
    """Whether an asset need not be there: nobody asked for it, or it can be baked."""
    return not asset.exists() and (not asked or beside(asset) is not None)


def needs(path) -> tuple[str, ...]:
    """Names of the stages that a scene's asset must hold; the asset need not be there yet.

    Raises UsageError or RecipeError where the file is no scene.
    """
    if not Path(path).is_file() or Path(path).suffix.lower() not in (*SUFFIXES, ".xml"):
        there = "no scene" if Path(path).exists() and str(path) else "there is no such scene"
        raise UsageError(f"{text.label_of(path)}: {there}; give the path of a scene (NAME.yaml or NAME.xml)")
    path = Path(path)
    if path.suffix.lower() == ".xml":
        return _of_plugins(path)
    source, tree = _parsed(path)
    if tree.problems:
        raise RecipeError(tree.problems)
    section, problem = _section(source, tree.root)
    if not section or section not in tree.root:
        raise RecipeError([problem])
    return import_module(f"{RENDERERS[section]}.scene").NEEDS


def _of_plugins(path: Path) -> tuple[str, ...]:
    """Stages that bakery's plugins read in a Mitsuba scene: those of the integrators, bakedphase the medium."""
    try:
        ElementTree.parse(path)
    except (OSError, ElementTree.ParseError) as error:
        raise UsageError(f"{text.label_of(path)}: cannot be read as a Mitsuba scene: {error}") from None
    kinds = {f"bakery_{name}": import_module(f"{package}.scene").NEEDS for name, package in RENDERERS.items()}
    found = [stage for file in files_of(path) if file.suffix.lower() == ".xml" for one in integrators(file)
             for stage in kinds.get(one, ())]
    return tuple(dict.fromkeys(found)) or ("medium",)


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
    if isinstance(tree.root, Mapping) and "bakery" in tree.root and "bakery_scene" not in tree.root:
        instead = f"`bake {source.label}` bakes it, `bake render` takes its asset, and a scene that names it can be rendered " \
                  "(`bake new scene` writes one)"
        raise RecipeError([source.problem(None, "", "is a recipe", instead)])
    return source, text.Tree(tree.root, list(map(_of_scenes, tree.problems)))


def _of_scenes(problem: Problem) -> Problem:
    return dataclasses.replace(problem, expected=problem.expected.replace("recipe", "scene"))


def _keys_of_files(kind, bodies: int, at) -> list[str]:
    """Keys of files of all renderers and of one, whose list of bodies is so long; at(key): what stands there, or None."""
    own = [f"{kind.BODIES}[{i}].{key}" for i in range(bodies) for key in ("asset", "recipe")]
    inside = [key.replace(kind.BODIES, f"{kind.BODIES}[{i}]") for i in range(bodies) for key in kind.FILES]
    return [*common.FILES, *(named for key in inside or kind.FILES for named in _by_name(key, at)), *own]


def _by_name(key: str, at) -> list[str]:
    """A key, or with a `*` in it one for each name that stands there."""
    before, star, after = key.partition(".*")
    return [f"{before}.{name}{after}" for name in names_at(at(before))] if star else [key]


def _files(path: Path, root: Mapping, values: dict, keys: list[str], assets: bool) -> Iterator[Problem]:
    """Files that are named and not there; of assets only where they are asked for, and cannot be baked."""
    for key in keys:
        name = values.get(key)
        if name is None:
            continue
        node = node_at(root, key)
        if not name.strip() or not name.isprintable() or len(os.fsencode(name)) > 1000:
            yield node.place.problem(f"found {text.show(name)}", "expected a path relative to the scene's folder")
        elif key.endswith("asset") and _to_be_baked(path.parent / name, assets):
            continue
        elif not (path.parent / name).exists():
            yield node.place.problem(f"found {text.show(name)}{_ABSENT}",
                                     f"expected a file relative to {text.label_of(path.parent)}")
        elif not (path.parent / name).is_file():
            yield node.place.problem(f"found {text.show(name)}, which is no regular file", "expected a file")
        elif reason := unbounded(path.parent / name):
            yield node.place.problem(f"found {text.show(name)}, which names {reason}", "")
