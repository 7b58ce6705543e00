"""What a person sees after a minute: scenes, without their noise, beside long references.

    python benchmarks/first_picture.py [SCENE …] [--longest 512] [--seconds 60] [--cores 2] [--reference 600]
                                       [-o build/first_picture]

Time is that of processors, so that others on the machine do not count: `--seconds` of `--cores`, from baked assets, of the whole
process with its imports, pilots, filter and files; smaller pictures have as much less for what comes after the start.  The
reference takes `--reference` seconds of so many cores, by the first method without an error of its own, with other random
numbers; where each of those lacks light, as `ept` does of the sun on smooth grains, by the one of the least error (`ept+wide`).
A row a scene: method; processor seconds; samples a pixel, and noise of the picture before the filter; FLIP (mean, 67 pixels a
degree) of what is shown against the reference as it was rendered, and against that without its noise; noise of the reference,
and FLIP between it with and without its noise, below which nothing is told; `*` where both FLIP of the picture are above 0.05.
References that are there already are taken again.
"""

import argparse
import dataclasses
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.sizes import SMALL, sized
from renderers import choice
from renderers.mitsuba.world import World
from renderers.pictures import differences
from renderers.scene import assets, budget, candidates, load

SCENES = Path(__file__).resolve().parents[1] / "assets" / "scenes"
WISHED = 0.05  # FLIP
STARTS = 8.0  # processor seconds of a process before its passes: imports, scene, choice
ENDS = 6.0  # of the filter and of files, for 512 x 512


def settings(path, longest, exact) -> dict[str, str]:
    """Of a scene at a size; `exact`: by a way to render it that brings all light and has the least error of its own, the first of
    those, where its methods are open."""
    scene = assets.baked(load(path)) if exact else load(path, assets=False)
    world = World.of(scene)
    height, width = world.size
    scale = longest / max(height, width)
    chosen = {"film.width": str(round(width * scale)), "film.height": str(round(height * scale)), "stop.noise": "0.5%",
              "stop.samples": "1000000", "denoise": "yes"}
    listed = candidates.of(scene) if exact else ()
    ways = [candidate for candidate in listed if not candidate.lacks(choice.Opened.of(scene).assets, world)] or listed
    way = min(ways, key=lambda candidate: (not candidate.exact, candidate.stated(budget.DEFAULT)), default=None)
    return chosen | {f"materials[{number}].method": method for number, method in enumerate(way.methods if way else ())}


def render(path, picture, options, seconds, *, exact, seed) -> dict:
    """Report of a process of its own that takes so many processor seconds; what it shows lies beside the picture."""
    asked = {"scene": str(path), "picture": str(picture), "seconds": seconds, "cores": options.cores, "seed": seed,
             "longest": options.longest, "settings": settings(path, options.longest, exact)}
    done = subprocess.run([sys.executable, "-m", "benchmarks.first_picture", "--alone", json.dumps(asked)], cwd=SCENES.parents[1],
                          capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{path}: {done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def alone(asked) -> dict:
    """Renders in this process, until its processors have worked for so long."""
    from renderers.pictures import images
    from renderers.pictures.passes import Rendering
    from renderers.pictures.running import Render

    ends = ENDS * (asked["longest"] / 512) ** 2
    limit = asked["seconds"] - ends
    # pilots take a share of the time that a picture is asked for in
    wall = {"stop.time": f"{max(asked['seconds'] - STARTS - ends, 1.0) / asked['cores']:.6g} s"}
    job = Render(asked["scene"], asked["picture"], overrides=asked["settings"] | wall, overwrite=True)
    rendering = Rendering(job, seed=asked["seed"])
    rendering.stop = dataclasses.replace(rendering.stop, time=None)
    before, longest = time.process_time(), 0.0

    def over(noise):
        nonlocal before, longest
        now = time.process_time()
        before, longest = now, max(longest, now - before)
        return noise is not None and now + longest > limit  # as in any render two passes end, however long they take

    rendering.run(over)
    report, display = rendering.finish(), dict(rendering.job.scene.values.display)
    cleared = rendering.estimate.rgb if rendering.denoised is None else rendering.denoised.rgb
    for name, linear in (("rendered", rendering.estimate.rgb), ("cleared", cleared)):
        np.save(Path(asked["picture"]).with_suffix(f".{name}.npy"), images.eight_bits(images.shown(linear, **display)[0]))
    return {key: report[key] for key in ("method", "samples", "noise", "noise_region")} | {"seconds": time.process_time()}


def shown(picture, name):
    return np.load(picture.with_suffix(f".{name}.npy")) / 255.0


def measured(path, options) -> str:
    """The row of a scene."""
    picture, reference = (options.output / f"{path.stem}{kind}.png" for kind in ("", ".reference"))
    smaller, words = min((options.longest / 512) ** 2, 1.0), reference.with_suffix(".json")
    render(path, picture, options, 0.0, exact=False, seed=0)  # bakes and compiles
    if not words.exists():
        seconds = options.reference * options.cores * smaller
        words.write_text(json.dumps(render(path, reference, options, STARTS + seconds, exact=True, seed=1)))
    seconds = STARTS + (options.seconds * options.cores - STARTS) * smaller
    report, long = render(path, picture, options, seconds, exact=False, seed=0), json.loads(words.read_text())
    noisy, clean, minute = shown(reference, "rendered"), shown(reference, "cleared"), shown(picture, "cleared")
    flips = [differences.flip(*images)[0] for images in ((minute, noisy), (minute, clean), (noisy, clean))]
    star = " *" * (min(flips[:2]) > WISHED)
    return (f"| {path.stem} | {report['method']} | {report['seconds']:.0f} of {seconds:.0f} | {report['samples']} | "
            f"{report['noise']:.2g} | {flips[0]:.3f} | {flips[1]:.3f}{star} | {long['method']}, {long['samples']} | "
            f"{long['noise']:.2g} | {flips[2]:.3f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenes", nargs="*", help="names, or files NAME.yaml; all but those of the fog filter if none is given")
    parser.add_argument("--longest", type=int, default=sized(512, 24), help="pixels of the longer side")
    parser.add_argument("--seconds", type=float, default=sized(60.0, 8.0), help="of the whole process, on so many cores")
    parser.add_argument("--cores", type=float, default=2.0, help="processor seconds in a second")
    parser.add_argument("--reference", type=float, default=sized(600.0, 1.0), help="seconds of the reference")
    parser.add_argument("-o", "--output", type=Path, default=Path("build/first_picture"))
    parser.add_argument("--alone", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.alone:
        print(json.dumps(alone(options.alone)))
        return
    if missing := differences.flip_missing():
        sys.exit(missing)
    options.output = options.output.resolve()
    options.output.mkdir(parents=True, exist_ok=True)
    names = options.scenes or (["candle"] if SMALL else sorted(path.stem for path in SCENES.glob("*.yaml")))
    print("| scene | method | processor s | samples | noise | FLIP | without the reference's noise | reference | its noise | "
          "FLIP of that |\n|---|---|---|---|---|---|---|---|---|---|")
    for name in names:
        path = Path(name).resolve() if name.endswith(".yaml") else SCENES / f"{name}.yaml"
        if load(path, assets=False).section != "fog":
            print(measured(path, options), flush=True)


if __name__ == "__main__":
    main()
