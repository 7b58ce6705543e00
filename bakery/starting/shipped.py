"""The scenes that ship, with all files that they need."""

import re
from dataclasses import dataclass
from pathlib import Path

from bakery.errors import UsageError
from bakery.grammar.fields import nearest
from bakery.grammar.files import asset_root
from bakery.recipe.starting import Start, starts

_FILE = re.compile(r"(?:\.\./)*[\w./-]+\.(?:yaml|xml|ply|obj|exr|png|npy|h5|vol|csv)\b")
_COMMENT = re.compile(r"(?:^|(?<=\s))#.*$", re.MULTILINE)
_NAME = re.compile(r"^name: *\S+", re.MULTILINE)


@dataclass(frozen=True)
class Scene:
    """A scene that ships."""

    name: str  # of its file, without .yaml
    about: str  # one line
    path: Path  # of the scene

    def files(self, name: str) -> dict[str, bytes]:
        """Name of a file -> content: the scene, called `name`, and beside it all that it names, recipes too."""
        text = self.path.read_text(encoding="utf-8")
        files: dict[str, bytes] = {}
        keys = _COMMENT.sub("", text)  # a comment may name the scene itself
        for written in sorted(set(_FILE.findall(keys)), key=len, reverse=True):
            source = self.path.parent / written
            if source.is_file():
                files |= _with_needs(source)
                text = text.replace(written, source.name)
        text = _NAME.sub(f"name: {name}", text, count=1)
        return {f"{name}.yaml": text.encode()} | files


def _with_needs(path: Path) -> dict[str, bytes]:
    """A file, and the files of its folder that it names, by their names alone."""
    if path.suffix == ".yaml":
        recipe = next(recipe for recipe in (*starts().values(), Start(path.stem, "", "", path)) if recipe.path == path)
        return {name: text.encode() for name, text in recipe.files(path.stem).items()}
    files = {path.name: path.read_bytes()}
    if path.suffix == ".xml":
        named = {path.parent / name for name in _FILE.findall(path.read_text(encoding="utf-8")) if not name.endswith(".yaml")}
        files |= {file.name: file.read_bytes() for file in named if file.is_file()}
    return files


def scenes() -> dict[str, Scene]:
    """Name -> each scene that ships."""
    return {path.stem: Scene(path.stem, _about(path), path) for path in sorted((asset_root() / "scenes").glob("*.yaml"))}


def scene(name: str) -> Scene:
    """The one of a name; UsageError with the nearest name, of recipes and scenes, where there is none."""
    shipped = scenes()
    if name not in shipped:
        raise UsageError(f'found "{name}", which is no kind of recipe, no published material, and no recipe or scene that ships'
                         f"{nearest(name, (*starts(), *shipped))}; `bake new` lists them")
    return shipped[name]


def _about(path: Path) -> str:
    first = path.read_text(encoding="utf-8").splitlines()[0]
    return re.split(r"(?<=\.)\s", first.removeprefix("# "))[0] if first.startswith("# ") else ""
