"""Renders the shipped scenes as docs/ shows them: `python docs/pictures/stills.py [NAME …] [--time 90] [--keep]`.

The longer side gets so many pixels.  A render ends after the time, or once its pixels have a noise of 4 %, and has its noise
taken out; the picture beneath a filter of fog ends after the time, or its samples, and has its noise taken out, too.  Noise,
samples and seconds of each are printed.  `--jobs` renders so many scenes side by side, in the order of their names as given.  A
graphics card that works is used; `CUDA_VISIBLE_DEVICES= ` before the command keeps a call off it, so that two calls share a
machine: bodies on its card, grains and particles on its processors.  `--keep` puts the PNG into this folder, with colours as
coarse as it takes to stay below 450 kB; `--only-keep` does that with what an earlier call has rendered.
"""

from __future__ import annotations

import argparse
import io
import json
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from renderers.mitsuba.world import World
from renderers.scene import load

HERE = Path(__file__).parent
SCENES = Path(__file__).resolve().parents[2] / "assets" / "scenes"
NOISE = "4%"
SIDE = r'name="{}" value="([0-9]+)"'  # of a film
LARGEST = 450_000  # bytes of a picture that is kept
STEPS = 1, 2, 4  # of the 256 levels of a colour, of which every so manieth is kept


def of_fog(scene, folder: Path, longest: int) -> list[str]:
    """Options for a filter of a picture, whose size is that of the picture: the file of Mitsuba, written with another size."""
    shipped = scene.file(scene.values.picture.mitsuba)
    text = shipped.read_text()
    sides = {side: int(re.search(SIDE.format(side), text)[1]) for side in ("width", "height")}
    for side, pixels in sides.items():
        larger = f'name="{side}" value="{round(pixels * longest / max(sides.values()))}"'
        text = re.sub(SIDE.format(side), larger, text)
    (folder / shipped.name).write_text(text)
    return ["--denoise", "--set", f"picture.mitsuba={(folder / shipped.name).resolve()}"]


def settings(path: Path, folder: Path, longest: int, seconds: float) -> list[str]:
    """Options of `bake render` for a scene."""
    scene = load(path, assets=False)
    if scene.section == "fog":
        return [*of_fog(scene, folder, longest), "--set", f"stop.time={seconds:g} s"]
    height, width = World.of(scene).size
    scale = longest / max(height, width)
    chosen = {"film.width": round(width * scale), "film.height": round(height * scale), "stop.noise": NOISE,
              "stop.time": f"{seconds:g} s"}
    return ["--denoise", *(word for key, value in chosen.items() for word in ("--set", f"{key}={value}"))]


def rendered(picture: Path, options: list[str], resume: bool) -> dict:
    """The report of a render of the scene of that name, which may have missed its noise (status 3)."""
    path = SCENES / f"{picture.stem}.yaml"
    command = [sys.executable, "-m", "bakery", "render", str(path), "-o", str(picture), "--json",
               "--resume" if resume and picture.with_suffix(".exr").is_file() else "--overwrite"]
    done = subprocess.run([*command, *options], stdout=subprocess.PIPE, text=True)
    if done.returncode not in (0, 3):
        sys.exit(f"{path}: bake render ended with status {done.returncode}")
    return json.loads(done.stdout)


def candidates(image: Image.Image):
    """The picture in finer to coarser colours, the last with 256 of them."""
    levels = np.asarray(image, float)
    for step in STEPS:
        yield Image.fromarray(np.clip(np.round(levels / step) * step, 0, 255).astype(np.uint8))
    # medians alone leave out colours of few pixels: blue bowls came out grey
    palette = image.quantize(256, method=Image.Quantize.MEDIANCUT, kmeans=4)
    yield image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)


def keep(picture: Path):
    """Puts a PNG into this folder, with the finest colours that its size allows, and the texts that were in it."""
    with Image.open(picture) as image:
        texts, rgb = dict(image.text), image.convert("RGB")
    words = PngInfo()
    for key, text in texts.items():
        words.add_text(key, text)
    for candidate in candidates(rgb):
        stored = io.BytesIO()
        candidate.save(stored, "png", optimize=True, pnginfo=words)
        if stored.tell() <= LARGEST:
            break
    (HERE / picture.name).write_bytes(stored.getvalue())


def described(name: str, report: dict) -> str:
    """A line about a picture."""
    noise = report.get("pixel_noise") or report["noise"]
    return (f"{name}: {report['method']}, {report['size'][0]} x {report['size'][1]}, {report['samples']} samples, noise "
            f"{'none' if noise is None else f'{noise:.1%}'}, {report['seconds']['total']:.0f} s")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="scenes; all that ship if none is named")
    parser.add_argument("--longest", type=int, default=1024, help="pixels of the longer side")
    parser.add_argument("--time", type=float, default=90.0, help="seconds of passes a scene")
    parser.add_argument("--jobs", type=int, default=1, help="scenes rendered side by side")
    parser.add_argument("-o", "--output", type=Path, default=Path("build"))
    parser.add_argument("--resume", action="store_true", help="goes on from the samples of an earlier call")
    parser.add_argument("--keep", action="store_true", help="puts the pictures into docs/pictures")
    parser.add_argument("--only-keep", action="store_true", help="and renders none")
    chosen = parser.parse_args()
    chosen.output.mkdir(parents=True, exist_ok=True)
    pictures = [chosen.output / f"{name}.png" for name in chosen.names or sorted(path.stem for path in SCENES.glob("*.yaml"))]
    # Mitsuba reads files of one scene at a time
    options = [[] if chosen.only_keep else settings(SCENES / f"{picture.stem}.yaml", chosen.output, chosen.longest, chosen.time)
               for picture in pictures]

    def work(picture, options):
        if not chosen.only_keep:
            print(described(picture.stem, rendered(picture, options, chosen.resume)), flush=True)
        if chosen.keep or chosen.only_keep:
            keep(picture)

    with ThreadPoolExecutor(chosen.jobs) as side_by_side:
        list(side_by_side.map(work, pictures, options))


if __name__ == "__main__":
    main()
