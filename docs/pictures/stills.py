"""Renders the shipped scenes as docs/ shows them: `python docs/pictures/stills.py [NAME …] [--longest 1024] [--time 90]`.

The longer side gets so many pixels.  A render ends after the time, or once its pixels have a noise of 4 %, and has its noise
taken out.  Noise, samples and seconds of each are printed; `--keep` puts the PNG into this folder.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path

from renderers.mitsuba.world import World
from renderers.scene import load

HERE = Path(__file__).parent
SCENES = Path(__file__).resolve().parents[2] / "assets" / "scenes"
NOISE = "4%"


def settings(path: Path, longest: int, seconds: float) -> list[str]:
    """Options of `bake render` for a scene."""
    scene = load(path, assets=False)
    if scene.section == "fog":
        return []  # a filter of a picture, whose size is that of the picture
    height, width = World.of(scene).size
    scale = longest / max(height, width)
    chosen = {"film.width": round(width * scale), "film.height": round(height * scale), "stop.noise": NOISE,
              "stop.time": f"{seconds:g} s"}
    return ["--denoise", *(word for key, value in chosen.items() for word in ("--set", f"{key}={value}"))]


def rendered(path: Path, picture: Path, longest: int, seconds: float) -> dict:
    """The report of a render, which may have missed its noise (status 3)."""
    command = [sys.executable, "-m", "bakery", "render", str(path), "-o", str(picture), "--overwrite", "--json"]
    done = subprocess.run([*command, *settings(path, longest, seconds)], stdout=subprocess.PIPE, text=True)
    if done.returncode not in (0, 3):
        sys.exit(f"{path}: bake render ended with status {done.returncode}")
    return json.loads(done.stdout)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("names", nargs="*", help="scenes; all that ship if none is named")
    options.add_argument("--longest", type=int, default=1024, help="pixels of the longer side")
    options.add_argument("--time", type=float, default=90.0, help="seconds of passes a scene")
    options.add_argument("-o", "--output", type=Path, default=Path("build"))
    options.add_argument("--keep", action="store_true", help="puts the pictures into docs/pictures")
    chosen = options.parse_args()
    chosen.output.mkdir(parents=True, exist_ok=True)
    for name in chosen.names or sorted(path.stem for path in SCENES.glob("*.yaml")):
        picture = chosen.output / f"{name}.png"
        report = rendered(SCENES / f"{name}.yaml", picture, chosen.longest, chosen.time)
        noise = report.get("pixel_noise") or report["noise"]
        print(f"{name}: {report['method']}, {report['size'][0]} x {report['size'][1]}, {report['samples']} samples, noise "
              f"{'none' if noise is None else f'{noise:.1%}'}, {report['seconds']['total']:.0f} s", flush=True)
        if chosen.keep:
            shutil.copy(picture, HERE / picture.name)


if __name__ == "__main__":
    main()
