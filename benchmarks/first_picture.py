"""What a person sees after a minute: shipped scenes, without their noise, beside long references.

    python benchmarks/first_picture.py [SCENE …] [--longest 512] [--seconds 60] [--reference 600] [-o build/first_picture]

Each scene is rendered by the command line, from baked assets, so that the whole command takes the seconds asked for.  The
reference is by the first method without an error of its own, with other random numbers, its noise left in.  A row a scene:
method, seconds of the whole command, noise of the picture before the filter, FLIP (mean, 67 pixels a degree) of what is shown
against the reference, and the noise of that; `*` where FLIP is above 0.05.  References that are there already are taken again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import matplotlib.image
import numpy as np

from benchmarks.sizes import SMALL, sized
from renderers.mitsuba.world import World
from renderers.pictures import differences
from renderers.scene import candidates, load

SCENES = Path(__file__).resolve().parents[1] / "assets" / "scenes"
WISHED = 0.05  # FLIP
STARTS = 8.0  # s of a command that are not passes: imports, scene, choice, filter, files


def exact_method(scene) -> list[str]:
    """Options for the first way to render it without an error of its own; none where the scene names its methods."""
    exact = [candidate for candidate in candidates.of(scene) if candidate.exact]
    named = [f"materials[{number}].method={method}" for number, method in enumerate(exact[0].methods)] if exact else []
    return [word for setting in named for word in ("--set", setting)]


def film(scene, longest) -> list[str]:
    """Options for the size of the picture."""
    height, width = World.of(scene).size
    scale = longest / max(height, width)
    return ["--set", f"film.width={round(width * scale)}", "--set", f"film.height={round(height * scale)}"]


def render(path, picture, *options) -> tuple[dict, float]:
    """Report and seconds of a render, which may miss its noise."""
    begin = time.monotonic()
    command = [sys.executable, "-m", "bakery", "render", str(path), "-o", str(picture), "--overwrite", "--quiet", "--json"]
    done = subprocess.run([*command, *options], capture_output=True, text=True)
    if done.returncode not in (0, 3):
        sys.exit(f"{path}: {done.stderr}")
    return json.loads(done.stdout), time.monotonic() - begin


def measured(path, options) -> str:
    """The row of a scene."""
    scene, folder = load(path, assets=False), options.output
    size = film(scene, options.longest)
    render(path, folder / "baked.png", *size, "--set", "stop.samples=1", "--no-denoise")
    reference, words = folder / f"{path.stem}.reference.png", folder / f"{path.stem}.reference.json"
    if not words.exists():
        long, _ = render(path, reference, *size, *exact_method(scene), "--seed", "1", "--set", f"stop.time={options.reference} s",
                         "--set", "stop.noise=0.5%", "--set", "stop.samples=1000000", "--no-denoise")
        words.write_text(json.dumps(long))
    report, seconds = render(path, folder / f"{path.stem}.png", *size, "--set", "stop.noise=0.5%", "--denoise",
                             "--set", "stop.samples=1000000", "--set", f"stop.time={max(options.seconds - STARTS, 1.0)} s")
    shown, wanted = (np.asarray(matplotlib.image.imread(one)[..., :3], float) for one in (folder / f"{path.stem}.png", reference))
    flip = differences.flip(shown, wanted)[0]
    return (f"| {path.stem} | {report['method']} | {seconds:.0f} | {report['noise']:.2g} | {flip:.3f}{' *' * (flip > WISHED)} | "
            f"{json.loads(words.read_text())['noise']:.2g} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenes", nargs="*", help="names; all but those of the fog filter if none is given")
    parser.add_argument("--longest", type=int, default=sized(512, 24), help="pixels of the longer side")
    parser.add_argument("--seconds", type=float, default=sized(60.0, 1.0), help="of the whole command")
    parser.add_argument("--reference", type=float, default=sized(600.0, 1.0), help="seconds of passes of the reference")
    parser.add_argument("-o", "--output", type=Path, default=Path("build/first_picture"))
    options = parser.parse_args()
    if missing := differences.flip_missing():
        sys.exit(missing)
    options.output.mkdir(parents=True, exist_ok=True)
    names = options.scenes or (["candle"] if SMALL else sorted(path.stem for path in SCENES.glob("*.yaml")))
    print("| scene | method | seconds | noise | FLIP | noise of the reference |\n|---|---|---|---|---|---|")
    for name in names:
        path = SCENES / f"{name}.yaml"
        if load(path, assets=False).section != "fog":
            print(measured(path, options), flush=True)


if __name__ == "__main__":
    main()
