"""A field of snow, 200 m wide: what `auto` takes beside paths through the medium that stands for the grains.

    python -m benchmarks.far_snow [--small] [--seconds 60] [--width 200]

The scene is assets/scenes/field_of_snow with the field as a closed body, so that paths can go into it, and snow of the same
grains with the surface of their medium, which is what both show.  A row a method, which take turns: processor seconds a pass;
the mean of the lower half of the picture over that of paths, with its standard error; processor seconds to a noise of 1 % of a
pixel over the picture's mean, and that over paths'.  Before that the table of `auto` and the processor seconds of its pilots.
--small: 32 pixels wide, 2 seconds.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
from pathlib import Path

import numpy as np

import bakery
from benchmarks.sizes import sized
from renderers import choice, colour
from renderers import scene as scenes
from renderers.mitsuba.world import World
from renderers.scene import assets, candidates

ROOT = Path(__file__).parents[1]
FIELD = """<shape type="cube" id="plain"> <transform name="to_world"> <scale value="100, 100, 1"/> <translate z="-4"/>
</transform> <bsdf type="null"/> </shape>"""
SCENE = """\
bakery_scene: 2
name: far_snow
scene: {{mitsuba: far_snow.xml, unit: 1 m}}
tolerance: 5%
stop: {{noise: 1%, time: {time} s}}
film: {{width: {width}, height: {height}}}
materials:
  - {{where: {{shape: plain}}, asset: {asset}}}
"""


def written(folder, width, asset, time=3600.0):
    """The scene in a folder: the field a body, and no drift or posts in it."""
    text = (ROOT / "assets/scenes/field_of_snow.xml").read_text(encoding="utf-8")
    text = re.sub(r'<shape type="rectangle" id="plain">.*?</shape>', FIELD, text)
    text = re.sub(r'<shape type="ply" id="drift">.*?</shape>', "", text)
    text = re.sub(r'(<point name="p0" [^>]*z=)"-4"', r'\1"-2.9"', text)
    (folder / "far_snow.xml").write_text(text, encoding="utf-8")
    path = folder / "far_snow.yaml"
    path.write_text(SCENE.format(width=width, height=3 * width // 4, asset=asset, time=time), encoding="utf-8")
    return path


def baked(folder):
    """Snow of the shipped grains, its surface that of their medium."""
    text = (ROOT / "recipes/snow_field.yaml").read_text(encoding="utf-8")
    recipe = folder / "snow.yaml"
    recipe.write_text(re.sub(r"(?m)^surface: .*$", "surface: {method: medium, tolerance: 1%}", text), encoding="utf-8")
    bakery.bake(recipe, output=folder / "snow.h5")
    return "snow.h5"


class Run:
    """Passes of a method: luminance of the lower half, sums of pixels and of their squares, processor seconds."""

    def __init__(self, opened, world, candidate):
        scene = candidates.applied(opened.scene, candidate)
        (part,) = scene.prepare(opened._replace(scene=scene), world, 0).parts
        self.part = part.fewer(1)
        self.part.render(1 << 20)  # compiles
        self.lower, self.seconds, self.count, self.sum, self.square = [], 0.0, 0, 0.0, 0.0

    def on(self, seconds):
        """More passes, for so many processor seconds."""
        end = self.seconds + seconds
        while self.seconds < end or self.count < 4:
            begin = time.process_time()
            image = np.asarray(self.part.render(self.count)[""], float) @ colour.LUMINANCE
            self.seconds += time.process_time() - begin
            self.lower.append(image[len(image) // 2:].mean())
            self.sum, self.square, self.count = self.sum + image, self.square + image**2, self.count + 1

    @property
    def mean(self):
        """Of the lower half, and its standard error."""
        return float(np.mean(self.lower)), float(np.std(self.lower, ddof=1) / np.sqrt(self.count))

    @property
    def to_noise(self):
        """Processor seconds until the noise of a pixel is 1 % of the picture's mean."""
        variance = np.mean(self.square / self.count - (self.sum / self.count) ** 2) * self.count / (self.count - 1)
        return float(variance / np.mean(self.sum / self.count) ** 2 * self.seconds / self.count / 1e-4)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=sized(200, 32))
    parser.add_argument("--seconds", type=float, default=sized(60.0, 2.0), help="of paths, of processors; surfaces have a tenth")
    parser.add_argument("--folder", type=Path, help="where the asset is kept")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        scene = assets.together([scenes.load(written(folder, args.width, baked(folder)))])[0]
        opened, world = choice.Opened.of(scene), World.of(scene)
        begin = time.process_time()
        taken = choice.chosen(opened, world)
        print(f"pilots: {time.process_time() - begin:.1f} s of processors", *taken.reasons, sep="\n", flush=True)
        paths = Run(opened, world, candidates.with_surfaces(scene, (), 0.0))
        paths.on(args.seconds)
        surface = Run(opened, world, candidates.with_surfaces(scene, (0,), 0.0))  # it takes the place of the body's boundary
        surface.on(args.seconds / 10)
        print("| method | s a pass | lower half over paths | noise 1 % after, s | over paths |\n|---|---|---|---|---|")
        for name, run in (("paths", paths), ("surface", surface)):
            ratio = run.mean[0] / paths.mean[0]
            error = np.hypot(run.mean[1], paths.mean[1] * (run is not paths)) / paths.mean[0]
            print(f"| {name} | {run.seconds / run.count:.2g} | {ratio:.3f} +- {error:.3f} | {run.to_noise:.3g} | "
                  f"{run.to_noise / paths.to_noise:.2g} |")


if __name__ == "__main__":
    main()
