"""Scene files: how they are read, and which renderer each is for.

A scene is YAML in the grammar of recipes: units, no unknown keys, every problem at once with its file, line and key.  What all
may say stands in `renderers.scene.common`.  Most have a list `materials` (`renderers.scene.entries`), whose kinds and methods
decide which package renders them (`OF_MATERIALS`, `renderer_of`); others have a section that names it (`RENDERERS`).

What a package has stands in docs/architecture.md, "Adding a renderer".  Of its module `scene` only this does not: `problems(root,
values)` gets the kind and the method of each entry in `values`, `materials[0].as` and `materials[0].method`, and in `method` that
of all; there may be `PACE`, seconds of a core that a pixel takes to a relative variance of 1.
"""

import dataclasses
import os
from collections.abc import Iterator
from collections.abc import Mapping as MappingType
from collections.abc import Sequence as Sequence_
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

from bakery.errors import Problem, RecipeError, UsageError
from bakery.grammar import fields, files, overrides, text
from bakery.grammar.problems import distinct, no_keys, places, validated
from bakery.grammar.text import Mapping, Node
from renderers.scene import budget, common, entries, former, frames
from renderers.scene.common import FORMAT, Every, names_at, node_at, value_at
from renderers.scene.inputs import files_of, integrators, parameters_of, sources_of, unbounded

SUFFIXES = (".yaml", ".yml")
RENDERERS = {"fog": "renderers.fog"}  # section of a scene -> the package that renders it
# renderer of a scene of materials -> its package
OF_MATERIALS = {"discrete": "renderers.materials.particles", "granular": "renderers.materials.grains",
                "translucent": "renderers.materials.bodies", "mixed": "renderers.mixed"}
_OF_ONE_KIND = {"grains": "granular", "body": "translucent"}
_ABSENT = ", and there is no such file"


def renderer_of(kinds: Sequence_[str], methods: Sequence_[str]) -> str:
    """Which of `OF_MATERIALS` renders entries of these kinds and methods."""
    if list(kinds) == ["particles"]:
        return "discrete"
    if any(map(entries.has_surface, kinds, methods)):
        return "mixed"
    return _OF_ONE_KIND.get(kinds[0], "mixed") if len(set(kinds)) == len(set(methods)) == 1 else "mixed"


# ---- reading


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    """A scene whose values are all well formed and whose files are there.

    Attributes
    ----------
    path : of the scene
    section : name of the renderer: one of `RENDERERS` or of `OF_MATERIALS`
    renderer : the package that renders it
    values : `entries.SceneFile`, or `SceneFile` of a renderer that a section names; lengths in m, angles in rad
    overrides : dotted key -> text; of a frame also what its number gives
    frame : number of the frame of a sequence; None: the scene as it stands
    mark : fingerprint of a frame, which its finished pictures keep; "" of other scenes
    choice : `renderers.choice.Choice` of its method where that was chosen before; None: a render chooses
    asset : path of the first material; None where one of them may have to be baked and `renderers.scene.assets` has not seen to
        it
    assets : of the materials, in their order; () before `renderers.scene.assets` has seen to them
    share : of the tolerance's square that their tables may take, see `renderers.scene.budget`
    whole : whether passes are those of a long render, however short `stop.time` is
    """

    path: Path
    section: str
    renderer: str
    values: Every
    overrides: MappingType[str, str]
    asset: Path | None
    places: MappingType[str, str] = dataclasses.field(repr=False)
    assets: tuple[Path, ...] = ()
    share: float = budget.HALF
    whole: bool = False
    frame: int | None = None
    mark: str = ""
    choice: object = dataclasses.field(default=None, repr=False)

    @property
    def prepare(self):
        """What makes a `renderers.pictures.passes.Method` of a scene of materials: (Render, World, seed) -> Method."""
        return import_module(f"{self.renderer}.methods").prepare

    @property
    def drawn_by(self):
        """The module whose `render` and `describe` make its picture: one for all scenes of materials, else its renderer."""
        return import_module("renderers.pictures.passes" if self.section in OF_MATERIALS else self.renderer)

    @property
    def materials(self) -> list:
        """What names an asset or a recipe: the entries of the scene, or the scene itself."""
        return getattr(self.values, "materials", None) or [self.values]

    @property
    def followed(self) -> list[str]:
        """Kinds of its materials in which light is followed: not those that are surfaces alone."""
        of_kinds = [(entry.kind, entries.declared(entry.kind).get(entry.method)) for entry in self.materials
                    if hasattr(entry, "kind")]
        return sorted({kind for kind, method in of_kinds if method is None or not method.surface})

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
            files += files_of(self.file(value), self.parameters if key == "scene.mitsuba" else None) if value is not None else []
        return files

    @property
    def parameters(self) -> MappingType[str, str] | None:
        """What stands for `$name` in the Mitsuba scene; None: its own values."""
        return self.values.scene and self.values.scene.parameters

    def keys_of_files(self) -> list[str]:
        """Dotted keys that may name files."""
        return _keys_of_files(self.section, len(self.materials), lambda key: value_at(self.values, key))

    def file(self, name: str) -> Path:
        """A file that the scene names."""
        return self.path.parent / name

    def wrong(self, key: str, message) -> UsageError:
        """What to raise where the value of a key turns out to be wrong later than on reading."""
        return UsageError(f"{self.places.get(key, text.label_of(self.path))}: {key}: {message}")

    def no_camera(self) -> UsageError:
        """What to raise where neither the scene nor its Mitsuba file has one."""
        return self.wrong("camera", "there is no camera; expected camera: {origin: …, target: …, fov: …}")


def load(path, settings: MappingType[str, str] | None = None, *, assets: bool = True, frame: int | None = None) -> Scene:
    """Reads and checks a scene.

    Parameters
    ----------
    path : of the scene, a regular file of at most 1 MiB
    settings : dotted key -> value as YAML text, such as `{"fog.density.scale": "5"}`
    assets : whether the assets that it names, or recipes beside them, must exist
    frame : number of a frame, whose values replace the scene's; None: the scene itself

    Raises
    ------
    UsageError : there is no such regular file, or no such frame
    RecipeError : with every problem of the scene and of the settings
    """
    path = Path(path)
    source, tree = _read(path)
    problems = tree.problems + overrides.apply(source, tree, settings or {})[1]
    if not isinstance(tree.root, Mapping):
        raise RecipeError([*problems, no_keys(source, tree.root, f"a scene starts with `bakery_scene: {FORMAT}`")])
    settings = dict(settings or {})
    if frame is not None:
        texts, wrong = _framed(path, source, tree.root, frame, settings)
        settings, problems = settings | texts, problems + wrong
    section, problem = _section(source, tree.root)
    if not section:
        raise RecipeError([*problems, problem])
    method = settings.get("method")  # of the command line: that of all entries
    written = entries.known(tree.root, path.parent, method) if section == "materials" else []
    if written:
        section = renderer_of([entry.kind for entry in written], [entry.method for entry in written])
    model = entries.SceneFile if section in OF_MATERIALS or section == "materials" else _rules(section).SceneFile
    parsed, values, wrong = validated(model, tree.root)
    problems += [problem for problem in wrong if not (written and problem.key in entries.OF_ENTRIES)]
    if section == "materials":  # it has no entries
        raise RecipeError(distinct(problems))
    keys = _keys_of_files(section, len(written), lambda key: node_at(tree.root, key))
    problems += _files(path, tree.root, values, keys, assets)
    problems += entries.problems(tree.root, values, written) if written else common.asset_problems(tree.root)
    problems += _of_renderer(tree.root, values, section, written)
    problems += values["frames"].problems if "frames" in values else ()
    if problems:
        raise RecipeError(distinct(problems))
    where = {position.key: str(position) for position in places(tree.root)}
    parsed = _decided(parsed, written)
    named = [entry.asset and path.parent / entry.asset for entry in (parsed.materials if written else [parsed])]
    asset = None if any(file is None or beside(file) for file in named) else named[0]
    return Scene(path, section, _package(section), parsed, settings, asset, where, frame=frame)


def frames_of(path, settings: MappingType[str, str] | None = None) -> frames.Frames:
    """The section `frames` of a scene, whose `count` is 0 where something is wrong with it: `load` says what.

    Raises UsageError or RecipeError where the file is no scene, or has no such section.
    """
    source, tree = _read(Path(path))
    _, problems = overrides.apply(source, tree, settings or {})
    if tree.problems or problems or not isinstance(tree.root, Mapping):
        raise RecipeError([*tree.problems, *problems] or [source.problem(None, "", "found no keys", "expected a scene")])
    if "frames" not in tree.root:
        raise _no_frames(source)
    return frames.read(tree.root["frames"]) if isinstance(tree.root["frames"], Mapping) else frames.Frames()


def _no_frames(source: text.Source) -> RecipeError:
    return RecipeError([source.problem(None, "frames", "missing", "expected frames: {count: 48, KEY: {from: …, to: …}}, what "
                                       "changes from frame to frame")])


def _framed(path: Path, source: text.Source, root: Mapping, number: int, settings) -> tuple[dict[str, str], list[Problem]]:
    """Puts the values of a frame into the tree: they as text, and what is wrong with them."""
    node = root.get("frames")
    if node is None:
        raise _no_frames(source)
    if not isinstance(node, Mapping):
        return {}, []  # its kind of value says what it should be
    section = frames.read(node)
    if section.problems:
        return {}, []
    if not 1 <= number <= section.count:
        raise UsageError(f"{text.label_of(path)}: found no frame {number}; it has frames 1 to {section.count} (frames.count)")
    return section.put(root, number, settings)


def _package(section: str) -> str:
    return OF_MATERIALS.get(section) or RENDERERS[section]


def _rules(section: str):
    """The module `scene` of a renderer."""
    return import_module(f"{_package(section)}.scene")


def _of_renderer(root: Mapping, values: dict, section: str, written: list) -> Iterator[Problem]:
    """What the renderer of a scene says of it."""
    rules = _rules(section)
    for i, entry in enumerate(written):
        values |= {f"materials[{i}].as": entry.kind, f"materials[{i}].method": entry.method}
    values |= {"method": written[0].method} if len({entry.method for entry in written}) == 1 else {}
    yield from common.problems(root, values, section, rules.UNUSED)
    yield from rules.problems(root, values)


def _decided(values: Every, written: list) -> Every:
    """The values of a scene with the kind and method of each entry, and the method of all, where they have one."""
    if not written:
        return values
    methods = {entry.method for entry in written}
    listed = [model.model_copy(update={"as": entry.kind, "method": entry.method})
              for model, entry in zip(values.materials, written, strict=True)]
    return values.model_copy(update={"materials": listed, "method": methods.pop() if len(methods) == 1 else None})


def beside(asset: Path) -> Path | None:
    """The recipe from which an asset that is not there can be baked: the YAML file of its name beside it; None: there is none."""
    recipes = [asset.with_suffix(suffix) for suffix in SUFFIXES if asset.with_suffix(suffix).is_file()]
    return recipes[0] if recipes and not asset.exists() else None


def unfinished(fault: RecipeError) -> bool:
    """Whether nothing is wrong with a scene but that keys or files are still to come."""
    return all(problem.found == "missing" or problem.found.endswith(_ABSENT) for problem in fault.problems)


def needs(path) -> tuple[str, ...]:
    """Names of the stages that a scene's asset must hold; the asset need not be there yet.

    Raises UsageError or RecipeError where the file is no scene.
    """
    if not Path(path).is_file() or Path(path).suffix.lower() not in (*SUFFIXES, ".xml"):
        fault = "no scene" if Path(path).exists() and str(path) else "there is no such scene"
        raise UsageError(f"{text.label_of(path)}: {fault}; give the path of a scene (NAME.yaml or NAME.xml)")
    path = Path(path)
    if path.suffix.lower() == ".xml":
        return _of_plugins(path)
    source, tree = _parsed(path)
    if tree.problems:
        raise RecipeError(tree.problems)
    section, problem = _section(source, tree.root)
    if not section or section not in tree.root:
        raise RecipeError([problem])
    if section != "materials":
        return _rules(section).NEEDS
    known = entries.known(tree.root, path.parent)
    return tuple(dict.fromkeys(stage for entry in known for stage in entries.stages(entry.kind, entry.method)))


def _of_plugins(path: Path) -> tuple[str, ...]:
    """Stages that bakery's plugins read in a Mitsuba scene: those of the integrators, bakedphase the medium."""
    try:
        ElementTree.parse(path)
    except (OSError, ElementTree.ParseError) as error:
        raise UsageError(f"{text.label_of(path)}: cannot be read as a Mitsuba scene: {error}") from None
    kinds = {f"bakery_{name}": _rules(name).NEEDS for name in (*RENDERERS, *OF_MATERIALS)}
    stages = [stage for file in files_of(path) if file.suffix.lower() == ".xml" for kind in integrators(file)
             for stage in kinds.get(kind, ())]
    return tuple(dict.fromkeys(stages)) or ("medium",)


def _section(source: text.Source, root: Node | None) -> tuple[str, Problem | None]:
    """`materials` or the section that names the renderer, else what an unknown key seems to stand for, else ""; and what is
    wrong."""
    keys = list(root) if isinstance(root, Mapping) else []
    names = ["materials", *RENDERERS]
    named = [name for name in names if name in keys]
    if len(named) == 1:
        return named[0], None
    expected = f"expected {fields.one_of(names)}"
    if named:
        last = root.names[max(named, key=keys.index)]
        return "", last.problem(f"found {' beside '.join(named)}", f"{expected}, one of them")
    near = [text.closest(key, names) for key in keys if key not in common.Common.model_fields]
    return next(filter(None, near), ""), source.problem(None, "", "found nothing to render", expected)


def _read(path: Path) -> tuple[text.Source, text.Tree]:
    """Text and tree; UsageError where there is no such regular file."""
    if not path.is_file():
        raise UsageError(f"{text.label_of(path)}: there is no such scene; give the path of a scene (NAME.yaml)")
    return _parsed(path)


def _parsed(path: Path) -> tuple[text.Source, text.Tree]:
    """Text and tree; what the grammar says of recipes holds for scenes."""
    try:
        source = files.source_of(path)
        tree = text.parse(source)
    except RecipeError as error:
        raise RecipeError(map(_of_scenes, error.problems)) from None
    if isinstance(tree.root, Mapping) and "bakery" in tree.root and "bakery_scene" not in tree.root:
        instead = f"`bake {source.label}` bakes it, `bake render` takes its asset, and a scene that names it can be rendered " \
                  "(`bake new scene` writes one)"
        raise RecipeError([source.problem(None, "", "is a recipe", instead)])
    if isinstance(tree.root, Mapping) and not tree.problems and (anew := former.converted(source.text, tree.root)):
        where = tree.root.names.get("bakery_scene") or tree.root.place
        problem = where.problem("found a scene of an earlier format", f"expected its text in format {FORMAT}, to be saved in its "
                             f"place:\n\n{anew}")
        raise RecipeError([dataclasses.replace(problem, excerpt="")])
    return source, text.Tree(tree.root, list(map(_of_scenes, tree.problems)))


def _of_scenes(problem: Problem) -> Problem:
    return dataclasses.replace(problem, expected=problem.expected.replace("recipe", "scene"))


def _keys_of_files(section: str, count: int, at) -> list[str]:
    """Keys of files of a scene with so many entries; at(key): what stands there, or None."""
    if section in OF_MATERIALS:
        of_section = [f"materials[{i}].{key}" for i in range(count) for key in entries.FILES]
    else:
        of_section = ["asset", "recipe", *_rules(section).FILES]
    parts = [key.partition(".*") for key in of_section]  # with a `*` it is one for each name that stands there
    return [*common.FILES, *(f"{before}{name}{after}" for before, star, after in parts
                             for name in ([f".{name}" for name in names_at(at(before))] if star else [""]))]


def _files(path: Path, root: Mapping, values: dict, keys: list[str], assets: bool) -> Iterator[Problem]:
    """Files that are named and not there; of assets only where they are asked for, and cannot be baked."""
    for key in keys:
        name = values.get(key)
        if name is None:
            continue
        node = node_at(root, key)
        parts = os.fsencode(name).split(b"/")
        # no file system has longer names
        if not name.strip() or not name.isprintable() or len(os.fsencode(name)) > 1000 or max(map(len, parts)) > 255:
            yield node.place.problem(f"found {text.show(name)}", "expected a path relative to the scene's folder")
        elif key.endswith("asset") and not (path.parent / name).exists() and (not assets or beside(path.parent / name)):
            continue
        elif not (path.parent / name).exists():
            yield node.place.problem(f"found {text.show(name)}{_ABSENT}",
                                     f"expected a file, relative to the scene's folder {text.label_of(path.parent)}")
        elif not (path.parent / name).is_file():
            yield node.place.problem(f"found {text.show(name)}, which is a folder or a device", "expected a file")
        elif reason := unbounded(path.parent / name, _parameters(values) if key == "scene.mitsuba" else None):
            yield node.place.problem(f"found {text.show(name)}, which names {reason}", "")
        elif key == "scene.mitsuba":
            yield from _unused_parameters(path.parent / name, node_at(root, "scene.parameters"))


def _parameters(values: dict) -> dict[str, str]:
    """`scene.parameters`, as far as they are well formed."""
    below = "scene.parameters."
    return {key.removeprefix(below): value for key, value in values.items() if key.startswith(below)}


def _unused_parameters(mitsuba: Path, node: Node | None) -> Iterator[Problem]:
    """Parameters that the Mitsuba scene does not have."""
    if not isinstance(node, Mapping):
        return
    names = sorted(parameters_of(mitsuba))
    for name in node:
        if name not in names:
            has = f"it has {fields.one_of([f'${parameter}' for parameter in names])}" if names else "it has none"
            yield node.names[name].problem(f"found {text.show(name)}, but {text.label_of(mitsuba)} has no ${name}",
                                           f"expected a parameter of it; {has}{fields.nearest(name, names)}")
