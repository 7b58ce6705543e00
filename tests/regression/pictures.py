"""Pictures that stay what they are: means by order, light and region of the shipped scenes and of small ones, by method.

    python -m tests.regression.pictures                        # compare: every entry against pictures.json, 10 minutes of a core
    python -m tests.regression.pictures --seconds 2 --only candle/paths small/glass_ball
    python -m tests.regression.pictures --keep --seconds 60    # write: go on with each entry until its error or time is reached

A picture is small and noisy, many of them are not: `pictures.json` has of each entry (a scene by a method) the mean picture,
its orders and its lights, and the luminance of 4 x 4 regions, with standard errors from the scatter of blocks.  A block is a few
passes of each part of the method; its figures are what one such picture has.  Blocks are independent, and those of a comparison
have other random numbers than those that were kept.

`--keep` goes on where an earlier call stopped, entry after entry, and writes the file after each.  An entry whose values are
meant to change is begun again by `--anew`, and the changelog says why.
"""

import argparse
import json
import re
import shutil
import sys
import tempfile
import time
import weakref
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bakery.errors import BakeryError
from renderers import scene as scenes
from tests.regression.picture_figures import Deviation, Figures, compare, figures
from tests.regression.picture_scenes import SMALL

ROOT = Path(__file__).resolve().parents[2]
FILE = Path(__file__).with_name("pictures.json")
SEED = 1 << 15  # of the first picture of a comparison; those that are kept begin at 0
FALSE_ALARM = 0.01  # that a comparison of all entries calls one of them changed that is not, were its random numbers drawn anew
AIM = 0.005  # standard error of the mean of each order, over the mean luminance of the picture
BLOCK = 0.1  # s, about what a block takes
LEAST, FEWEST = 24, 12  # blocks that are kept at least; of a comparison

SHIPPED = {"fog": ("filter",), "discrete": ("particles", "continuous"), "granular": ("ept", "vpt"),
           "translucent": ("paths", "shells", "vrl+tables"), "mixed": ("auto",)}
EXACT = ("particles", "ept", "paths")
# width and height of films: kernels of NumPy's arrays want many paths in a pass, the loop of `paths` makes several of a pixel
LARGE, SMALLER = (64, 48), (24, 18)


class Entry(NamedTuple):
    """A scene by a method.

    name : SCENE/METHOD;  path : of a shipped scene, or None;  renderer : as `Scene.section`;  method : as scenes name it
    """

    name: str
    path: Path | None
    renderer: str
    method: str

    def load(self, folder: Path):
        """The scene, its files in `folder` where it is a small one."""
        if self.renderer == "fog":
            return scenes.load(self.path, smaller_picture(self.path, folder))
        path = self.path or SMALL[self.name.split("/")[1]].write(folder)
        width, height = SMALLER if self.renderer == "translucent" else LARGE
        size = {"film": f"{{width: {width}, height: {height}}}"} if self.path else {}
        return scenes.load(path, size | {"method": self.method})

    @property
    def restarts(self) -> bool:
        """Whether pictures depend on how many passes they have, so that each has a block of its own: beams through glass get
        narrower from pass to pass."""
        return self.renderer == "translucent" and (self.method.startswith("beams") or "point" in self.name)


def entries() -> list[Entry]:
    """All of them; methods without an error of their own first."""
    made = []
    for path in sorted((ROOT / "assets" / "scenes").glob("*.yaml")):
        scene = scenes.load(path)
        # surfaces hold no tables for other methods
        methods = ("surface",) if scene.section == "mixed" and scene.values.method == "surface" else SHIPPED[scene.section]
        made += [Entry(f"{path.stem}/{method}", path, scene.section, method) for method in methods]
    for name, small in SMALL.items():
        kinds = [material.kind for material in small.materials]
        made += [Entry(f"small/{name}/{method}", None, scenes.renderer_of(kinds, [method] * len(kinds)), method)
                 for method in small.methods]
    return sorted(made, key=lambda entry: (entry.method not in EXACT, entry.name))


def smaller_picture(path: Path, folder: Path) -> dict[str, str]:
    """Overrides by which a scene of fog has a picture of about `LARGE` and of few samples."""
    named = re.search(r"mitsuba: (\S+\.xml)", path.read_text())[1]
    text = (path.parent / named).read_text()
    share = LARGE[0] / int(re.search(r'name="width" value="(\d+)"', text)[1])
    (folder / named).write_text(re.sub(r'name="(width|height)" value="(\d+)"', lambda size:
                                       f'name="{size[1]}" value="{round(share * int(size[2]))}"', text))
    return {"picture.mitsuba": str(folder / named), "picture.samples": "16"}


# ---- pictures


def _folder_of(owner) -> Path:
    """A new folder, there as long as its owner."""
    folder = Path(tempfile.mkdtemp())
    weakref.finalize(owner, shutil.rmtree, folder, ignore_errors=True)
    return folder


class Source:
    """Blocks of pictures of an entry.

    passes : of each part in a block, by name; None or of other parts: as many as take about `BLOCK` in all, each part the same
    """

    def __init__(self, entry: Entry, passes: Mapping[str, int] | None, seed: int):
        from renderers.mitsuba.world import World
        from renderers.pictures.running import Render

        folder = _folder_of(self)
        self._job = Render(entry.load(folder), output=folder / "picture.png")
        self._world, self._seed, self._restarts = World.of(self._job.scene, None), seed, entry.restarts
        self._parts = self._prepared(seed)
        if passes is None or set(passes) != {part.name for part in self._parts}:
            passes = {part.name: 2 if entry.restarts else _passes(part, BLOCK / len(self._parts)) for part in self._parts}
        self.passes = dict(passes)

    def _prepared(self, seed):
        """Parts of the picture, as `renderers.pictures.progressive` takes them."""
        return self._job.scene.prepare(self._job, self._world, seed).parts

    def block(self, number: int) -> dict[str, np.ndarray]:
        """Figures of a picture; its random numbers depend on the seed and the number alone."""
        parts = self._prepared(self._seed + number) if self._restarts else self._parts
        total: dict = {}
        for part in parts:
            count = self.passes[part.name]
            for index in range(count):
                layers = part.render(index if self._restarts else number * count + index)
                for name, values in figures({name: np.nan_to_num(image) for name, image in layers.items()}).items():
                    total[name] = total.get(name, 0.0) + values / count
        return total


class Filtered:
    """The same of a scene of fog: a block is a render."""

    passes: Mapping[str, int] = {}

    def __init__(self, entry: Entry, seed: int):
        self._folder = _folder_of(self)
        self._scene, self._seed = entry.load(self._folder), seed

    def block(self, number: int) -> dict[str, np.ndarray]:
        from renderers.mitsuba import bitmaps

        report = self._scene.drawn_by.render(self._scene, self._folder / "picture.png",
                                                            seed=self._seed + number, overwrite=True)
        channels, _ = bitmaps.read(report["files"][1])
        picture, clear = (np.stack([channels[prefix + name] for name in "RGB"], axis=-1).astype(float)
                          for prefix in ("", "clear."))
        return figures({"": picture, "order": clear})  # "order": without the fog


def _passes(part, seconds: float) -> int:
    """Passes of a part that take so long; none of them is in a block."""
    part.render((1 << 30) - 1)  # compiles
    begin = time.process_time()
    part.render((1 << 30) - 2)
    return max(1, min(64, round(seconds / max(time.process_time() - begin, 1e-3))))


def blocks(entry: Entry, passes, seed: int, first: int, seconds: float, least: int, until=lambda: False) -> tuple[dict, Iterator]:
    """Passes of a block by part, and an iterator of blocks from number `first` for so many seconds of processor time."""
    source = Filtered(entry, seed) if entry.renderer == "fog" else Source(entry, passes, seed)

    def made():
        begin, number = time.process_time(), first
        while number - first < least or time.process_time() - begin < seconds and not until():
            yield source.block(number)
            number += 1

    return source.passes, made()


# ---- the file


def read() -> dict:
    return json.loads(FILE.read_text()) if FILE.exists() else {}


def written(kept: Mapping) -> str:
    """The text of the file, a line a figure."""
    text = json.dumps({name: kept[name] for name in sorted(kept)}, indent=1)
    return re.sub(r"[\[{][^\[\]{}]*(?:\[[^\[\]]*\][^\[\]{}]*)*[\]}]", lambda figure: " ".join(figure[0].split()), text) + "\n"


def keep(entry: Entry, old: Mapping | None, seconds: float, aim: float) -> dict:
    """An entry of the file: the old one gone on with until the error or the time is reached."""
    sums = Figures.of(old["figures"], old["blocks"]) if old else Figures()
    begin, passes = time.process_time(), old["passes"] if old else None
    if sums.worst() > aim:
        passes, made = blocks(entry, passes, 0, sums.count, seconds, LEAST if not old else 1, lambda: sums.worst() <= aim)
        for block in made:
            sums.add(block)
    spent = round((old["seconds"] if old else 0) + time.process_time() - begin, 1)
    return {"passes": passes, "blocks": sums.count, "seconds": spent, "error": float(f"{sums.worst():.2g}"),
            "figures": sums.kept()}


# ---- comparison


def differences(entry: Entry, kept: Mapping, seconds: float) -> tuple[list[Deviation], Figures]:
    """A new run of an entry against what is kept of it."""
    new = Figures()
    for block in blocks(entry, kept["passes"], SEED, 0, seconds, FEWEST)[1]:
        new.add(block)
    return compare(Figures.of(kept["figures"], kept["blocks"]), new), new


def described(kept: Mapping, new: Figures, worst: Deviation) -> str:
    """A line for people."""
    old, level = Figures.of(kept["figures"], kept["blocks"]).luminance, max(new.luminance, 1e-30)
    return (f"mean {old:.5g} -> {new.luminance:.5g} ({(new.luminance - old) / level:+.2%}; known to {kept['error']:.2%} "
            f"and {new.worst():.2%}); furthest {worst.name}: {worst.old:.5g} -> {worst.new:.5g} "
            f"({(worst.new - worst.old) / level:+.2%} of the mean, {abs(worst.new - worst.old) / max(worst.error, 1e-300):.1f} "
            f"standard errors, odds {worst.odds:.1e})")


def number_of_figures(kept: Mapping) -> int:
    """Of all entries."""
    return sum(len(figure["value"]) for entry in kept.values() for figure in entry["figures"].values())


# ---- commands


def _chosen(names) -> list[Entry]:
    every = entries()
    return [one for one in every if any(one.name.startswith(name) for name in names)] if names else every


def _keep(asked, kept: dict) -> int:
    for entry in _chosen(asked.only):
        old = None if asked.anew else kept.get(entry.name)
        if old and old["error"] <= asked.aim:
            continue
        try:
            kept[entry.name] = one = keep(entry, old, asked.seconds, asked.aim)
        except BakeryError as fault:
            print(f"{entry.name}: {fault}", flush=True)
            continue
        asked.file.write_text(written(kept))
        print(f"{entry.name}: {one['error']:.2%}, {one['blocks']} blocks, {one['seconds']:.0f} s", flush=True)
    return 0


def _compare(asked, kept: dict) -> int:
    chosen, limit, wrong = [one for one in _chosen(asked.only) if one.name in kept], FALSE_ALARM / number_of_figures(kept), 0
    for entry in chosen:
        found, new = differences(entry, kept[entry.name], asked.seconds)
        worst, wrong = found[0], wrong + (found[0].odds < limit)
        print(f"{'DEVIATES ' if worst.odds < limit else ''}{entry.name}: {described(kept[entry.name], new, worst)}", flush=True)
    print(f"{wrong} of {len(chosen)} entries deviate; chance has one in {FALSE_ALARM:.0%} of calls of all")
    return int(wrong > 0)


def main(arguments=None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", help="beginnings of names of entries, such as candle or small/glass_ball/paths")
    parser.add_argument("--seconds", type=float, default=3.0, help="of processor time for each entry, beside its preparation")
    parser.add_argument("--keep", action="store_true", help="write instead of comparing")
    parser.add_argument("--anew", action="store_true", help="with --keep: forget what is kept of these entries")
    parser.add_argument("--aim", type=float, default=AIM, help="with --keep: standard error at which an entry is good enough")
    parser.add_argument("--file", type=Path, default=FILE)
    asked = parser.parse_args(arguments)
    kept = json.loads(asked.file.read_text()) if asked.file.exists() else {}
    return (_keep if asked.keep else _compare)(asked, kept)


if __name__ == "__main__":
    sys.exit(main())
