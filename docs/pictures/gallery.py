"""Writes one page of all shipped recipes and scenes: `python docs/pictures/gallery.py build/gallery.html`.

Pictures are those of the page's folder where `make pictures` and `make scenes` have put them, else those of this folder.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from bakery.draw.files import as_jpeg
from bakery.errors import UsageError
from bakery.grammar import text
from bakery.report.html import document, image, paragraph, section
from bakery.store.outputs import PAGE, check_outputs
from bakery.store.put import put
from renderers.scene import load

ROOT = Path(__file__).resolve().parents[2]
WIDTH = 640  # pixels
# renderer of a scene, section of a recipe -> heading
SCENES = {"fog": "Scenes: fog", "discrete": "Scenes: separate particles", "granular": "Scenes: grains that fill a mesh",
          "translucent": "Scenes: translucent bodies", "mixed": "Scenes: several materials, and surfaces"}
BALLS = {"mixed": "Surfaces: a ball on a plate of each; their recipes below show their lobes"}  # scenes of this folder
RECIPES = {"particles": "Recipes: suspended particles", "medium": "Recipes: media by their coefficients",
           "grains": "Recipes: packed grains", "packing": "Recipes: packings of spheres"}
LEAD = ("Everything that ships with bakery. Recipes are shown as blocks of their medium under two lights, packed grains with "
        "exemplars on the left, or in a scene.")
COMMENT = re.compile(r"(?:^# (?!yaml-language-server).*\n)+", re.MULTILINE)
MATERIAL = re.compile(r"(?:recipes|build)/(\w+)\.(?:yaml|h5)")


@dataclass(frozen=True)
class Entry:
    """One picture.

    Attributes
    ----------
    name : what stands below it
    text : a sentence, or ""
    place : path of the file that it was made of
    command : what makes it
    picture : PNG or JPEG; b"" where there is none yet
    """

    name: str
    text: str
    place: str
    command: str
    picture: bytes


def page(title: str, lead: str, sections: Mapping[str, Sequence[Entry]]) -> str:
    """The whole page, UTF-8; sections by their headings, those without entries are left out."""
    parts = [f"<h1>{escape(title)}</h1>\n", paragraph(lead, "lead")]
    for heading, entries in sections.items():
        figures = "".join(map(_figure, entries))
        parts += section(heading, [f'<div class="grid">\n{figures}</div>\n'] if figures else [])
    return document(title, parts, broad=True)


def _figure(entry: Entry) -> str:
    shown = image(entry.picture, entry.name) if entry.picture else (
        f'<div class="empty">No picture yet: <code>{escape(entry.command)}</code> renders one.</div>')
    text = f"{escape(entry.text)}<br>\n" if entry.text else ""
    return (f"<figure>{shown}<figcaption><strong>{escape(entry.name)}</strong> {text}<code>{escape(entry.place)}</code>"
            "</figcaption></figure>\n")


def reduced(path: Path, width: int) -> bytes:
    """A picture file as JPEG, no more than so many pixels wide and high.

    Raises UsageError where it is no picture.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            image = image.convert("RGB")
    except (OSError, UnidentifiedImageError):
        raise UsageError(f"{path}: cannot be read as a picture; a whole PNG or JPEG would do") from None
    image.thumbnail((width, width))
    return as_jpeg(image)


def shipped(folder: str, headings, build: Path, command: str, shown=None) -> dict[str, list[Entry]]:
    """What a folder of YAML files holds, under the headings of its files' sections.

    shown : name of a recipe -> name of a scene that shows it, where it has no picture of its own
    """
    found: dict[str, list[Entry]] = {heading: [] for heading in headings.values()}
    for path in sorted((ROOT / folder).glob("*.yaml")):
        source = text.Source(path.name, path.read_text(encoding="utf-8"))
        tree, name, place = text.parse(source).root, path.stem, path.relative_to(ROOT)
        words = tree["description"].text if "description" in tree else _comment(source.text)
        picture = _picture(name, build)
        if not picture and (scene := (shown or {}).get(name)):
            picture, words = _picture(scene, build), f"{words}, in the scene {scene}"
        section = load(path, assets=False).section if "bakery_scene" in tree else next(one for one in headings if one in tree)
        found[headings[section]].append(Entry(name, words, str(place), command.format(place=place, name=name), picture))
    return found


def _comment(words: str) -> str:
    """The lines of a file's first comment, as one."""
    comment = COMMENT.match(words)
    return " ".join(line.removeprefix("# ") for line in comment[0].splitlines()) if comment else ""


def _picture(name: str, build: Path) -> bytes:
    places = build / f"{name}.png", Path(__file__).with_name(f"{name}.png")
    return next((reduced(place, WIDTH) for place in places if place.is_file()), b"")


def _materials(build: Path) -> dict[str, str]:
    """Name of a recipe -> name of a scene of it that has a picture."""
    scenes = [path for path in sorted((ROOT / "assets/scenes").glob("*.yaml")) if _picture(path.stem, build)]
    return {name: path.stem for path in scenes for name in MATERIAL.findall(path.read_text(encoding="utf-8"))}


def main(output: str) -> None:
    target = Path(output)
    check_outputs([(target, PAGE)])
    sections = shipped("assets/scenes", SCENES, target.parent, "bake render {place} -o build/{name}.png")
    sections |= shipped("docs/pictures", BALLS, target.parent, "bake render {place} -o build/{name}.png")
    sections |= shipped("recipes", RECIPES, target.parent, "bake {place} -o build/{name}.h5 && bake render build/{name}.h5",
                        _materials(target.parent))
    put(target, page("Recipes and scenes of bakery", LEAD, sections))
    print(target)


if __name__ == "__main__":
    main(sys.argv[1])
