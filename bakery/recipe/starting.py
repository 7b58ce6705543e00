"""Recipes to start from: one commented recipe a kind, the catalogue of published materials, and the recipes that ship."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bakery.grammar.files import asset_root

KINDS, PUBLISHED, SHIPPED = "starting", "catalogue", ""  # folders
_SCHEMA = re.compile(r"\A# yaml-language-server: \$schema=.*\n")
_BASE = re.compile(r"^[^#\n]*\bbase: *{recipe: *([\w-]+)\.yaml\b", re.MULTILINE)
_NAME = re.compile(r"^name: *\S+( +(?=#))?", re.MULTILINE)  # up to a comment, whose column is kept


@dataclass(frozen=True)
class Start:
    """A recipe to start from."""

    name: str  # of the file, without .yaml
    folder: str  # `KINDS`, `PUBLISHED` or `SHIPPED`
    about: str  # one line
    path: Path  # of the recipe

    def files(self, name: str) -> dict[str, str]:
        """Name of a file -> text: the recipe, called `name`, its tables, and the recipes of the layers below it."""
        files = {f"{name}.yaml": self.text(name)}
        for path in sorted(self.path.parent.glob(f"{self.name}.*")):
            files.setdefault(f"{name}{path.suffix}", path.read_text(encoding="utf-8"))
        for base in _BASE.findall(files[f"{name}.yaml"]):
            files = Start(base, self.folder, "", self.path.with_name(f"{base}.yaml")).files(base) | files
        return files

    def text(self, name: str) -> str:
        """The recipe, called `name` as files beside it are; its first line names the schema where this installation has it."""
        text = self.path.read_text(encoding="utf-8")
        schema = (asset_root() / "schemas" / "recipe-1.json").as_posix()
        text = _SCHEMA.sub(f"# yaml-language-server: $schema={schema}\n", text)
        text = re.sub(rf"\b{self.name}(?=\.(?:yaml|h5|png|exr|xml|csv)\b)", name, text)
        head = f"name: {name}"
        return _NAME.sub(lambda match: head.ljust(len(match[0]) - 1) + " " if match[1] else head, text, count=1)


def starts() -> dict[str, Start]:
    """Name -> what may be started from: the kinds first, which take a name before the recipes that ship."""
    listed = [start for folder in (KINDS, PUBLISHED, SHIPPED) for start in _of(folder)]
    by_name: dict[str, Start] = {}
    for start in listed:
        by_name.setdefault(start.name, start)
    return by_name


def _of(folder: str) -> Iterator[Start]:
    for path in sorted((asset_root("recipes") / folder).glob("*.yaml")):
        if path.stem == "published":  # the figures of the sources
            continue
        about = next(line for line in path.read_text(encoding="utf-8").splitlines() if not _SCHEMA.match(line + "\n"))
        yield Start(path.stem, folder, re.split(r"(?<=\.)\s", about.removeprefix("# "))[0], path)
