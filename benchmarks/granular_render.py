"""The methods of the renderer of grains against each other (against Mitsuba's `path`: benchmarks/ept.py).

    python benchmarks/granular_render.py [--scenes ...] [--methods ...] [--width 160] [--lamp 1] [--seconds 10]

Shipped scenes, each method for so many seconds of processor time.  Light that met grains, over that of `ept`, and the time in
which the variance of a pixel would be 1: variance of a pass times its time.  Where light before and after the switch has passes
of its own, that of the best division between them.  --lamp 0.1 makes lamps of a tenth of the width, as bright in all: how much
is gained over paths that find lamps by chance hangs on their size.
"""

import argparse
import re
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.sizes import sized

LUMINANCE = (0.2126, 0.7152, 0.0722)
SCENES = sized(("cube_of_beads", "snowman", "snowman_small", "sand_castle", "spices", "wet_beside_dry", "layers_of_sand",
          "heap_of_sand"), ("cube_of_beads",))
METHODS = ("ept", "vpt", "ept+vpt", "ept+vpt+da", "auto", "teleport")


def methods(options):
    print("| scene | method | share of ept | error | s to unit variance | ept over it |\n" + "|---" * 6 + "|", flush=True)
    for scene in options.scenes:
        first = None
        for method in options.methods:
            light, error, spent = measured(scene, method, options)
            first = first or (light, error, spent)
            ratio = light / first[0]
            off = ratio * np.hypot(error / light, first[1] / first[0]) if method != "ept" else error / light
            print(f"| {scene} | {method} | {ratio:.3f} | {off:.3f} | {spent:.3g} | {first[2] / spent:.3g} |", flush=True)


def smaller_lamps(folder, share):
    """Copies of the shipped scenes, whose lamps (rectangles) have that share of their width and all of their power."""
    shipped = Path(__file__).resolve().parents[1] / "assets" / "scenes"
    for path in shipped.iterdir():
        (folder / path.name).symlink_to(path)
    for path in shipped.glob("*.xml"):
        text = path.read_text()
        for shape in re.findall(r"<shape .*?</shape>", text, re.DOTALL):
            if "<emitter" in shape:
                lamp = re.sub(r'<scale value="([^"]*)"', lambda m: f'<scale value="{_times(m[1], share)}"', shape, count=1)
                lamp = re.sub(r'name="radiance" value="([^"]*)"',
                              lambda m: f'name="radiance" value="{_times(m[1], share**-2)}"', lamp)
                text = text.replace(shape, lamp)
        (folder / path.name).unlink()
        (folder / path.name).write_text(text)


def _times(numbers, factor):
    return ", ".join(f"{float(one) * factor:.6g}" for one in numbers.split(","))


def measured(scene, method, options):
    """Mean luminance of the light that met grains, its error, and seconds to unit variance of a pixel."""
    from renderers.materials.grains import methods as granular
    from renderers.mitsuba.world import World
    from renderers.pictures.running import Render

    width, seconds = options.width, options.seconds
    with tempfile.TemporaryDirectory() as folder:
        (scenes := Path(folder) / "assets" / "scenes").mkdir(parents=True)
        (Path(folder) / "recipes").symlink_to(Path(__file__).resolve().parents[1] / "recipes")
        smaller_lamps(scenes, options.lamp)
        job = Render(scenes / f"{scene}.yaml", Path(folder) / "x.png", overrides={"method": method})
        values = job.scene.values
        world = World(job.scene.file(values.scene.mitsuba), values.scene.unit, view=values.camera, size=(3 * width // 4, width))
        parts, light, square, spent = granular.prepare(job, world, 0).parts, 0.0, 0.0, 0.0
    for part in parts:
        part.render(1000)  # compiles
        begin, found = time.process_time(), []
        while time.process_time() - begin < seconds / len(parts) or len(found) < 4:
            found.append(part.render(len(found)))
        each = (time.process_time() - begin) / len(found)
        grains = [sum(one[name] for name in ("order1", "order2", "orders")).mean(axis=(0, 1)) @ LUMINANCE for one in found]
        light, square = light + np.mean(grains), square + np.var(grains, ddof=1) / len(found)
        spent += np.sqrt(each * np.var([one[""] @ LUMINANCE for one in found], axis=0, ddof=1).mean())
    return light, np.sqrt(square), spent**2


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    parser.add_argument("--width", type=int, default=sized(160, 8))
    parser.add_argument("--lamp", type=float, default=1.0)
    parser.add_argument("--seconds", type=float, default=sized(10, 0.0))
    methods(parser.parse_args())


if __name__ == "__main__":
    main()
