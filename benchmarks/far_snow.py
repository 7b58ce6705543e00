"""A field of snow, 200 m wide: what `auto` takes beside paths through the medium that stands for the grains.

    python -m benchmarks.far_snow [--small] [--seconds 60] [--width 200] [--eye] [--grains snow|sand] [--sun 11]
                                  [--height 1.7] [--tolerance 5%] [--methods ept ept+vpt+surface] [--pictures FOLDER]

The scene is assets/scenes/field_of_snow with the field as a closed body, so that paths can go into it, and snow of the same
grains with the surface of their medium, which is what both show.  A row a method, which take turns: processor seconds a pass;
the mean of the lower half of the picture over that of paths, with its standard error; processor seconds to a noise of 1 % of a
pixel over the picture's mean, and that over paths'.  Before that the table of `auto` and the processor seconds of its pilots.
--eye: from its edge, at the height of eyes, from 2 m before them to the horizon, with a post where near changes into far; then
paths+surface, too, and no table of `auto`.  --grains: so, with the field a mesh that grains fill, ept in place of paths, ept+vpt,
the surface counted among the grains, as snow_field.yaml or beach_sand.yaml says, and a sun as wide as --sun says, in degrees;
times are those of both parts of such a method, before paths switch to the medium and after, each with its best share.
--height: of the eyes, m; the picture begins as far as 1.2 times that.
--methods: only these (ept+vpt takes 20 times as long a pass through snow as ept).
--pictures: means of the methods, and their differences from paths in standard errors of blocks of pixels, as PNG.
--small: 32 pixels wide, 2 seconds.
"""

import argparse
import re
import tempfile
import time
from pathlib import Path

import numpy as np

import bakery
from bakery.store import ply
from benchmarks.sizes import sized
from renderers import choice, colour
from renderers import scene as scenes
from renderers.mitsuba.world import World
from renderers.pictures import images
from renderers.scene import assets, candidates

ROOT = Path(__file__).parents[1]
FIELD = """<shape type="cube" id="plain"> <transform name="to_world"> <scale value="100, 100, 1"/> <translate z="-4"/>
</transform> <bsdf type="null"/> </shape>"""
SCENE = """\
bakery_scene: 2
name: far_snow
scene: {{mitsuba: far_snow.xml, unit: 1 m}}
tolerance: {tolerance}
stop: {{noise: 1%, time: {time} s}}
film: {{width: {width}, height: {height}}}
materials:
  - {{where: {{{where}}}, asset: {asset}}}
"""
# 58 degrees down to 4 degrees up; a post 12 m off, whose shadow lies from 12 to 15 m off
EYE = """<sensor type="perspective"> <float name="fov" value="62"/> <string name="fov_axis" value="y"/>
<transform name="to_world"> <lookat origin="0, -99, {}" target="0, -98.1, {}" up="0, 0, 1"/> </transform> </sensor>
<shape type="cylinder"> <float name="radius" value="0.1"/> <point name="p0" x="3" y="-87" z="-2.95"/>
<point name="p1" x="3" y="-87" z="-1"/> <ref id="wood"/> </shape>"""
BLOCK_OF_SNOW = (np.array([[x, y, z] for x in (-100.0, 100.0) for y in (-100.0, 100.0) for z in (-23.0, -3.0)]),
                 np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                           [0, 6, 4], [1, 5, 7], [1, 7, 3]]))  # m
RECIPES = {None: "snow_field", "snow": "snow_field", "sand": "beach_sand"}
GRAINS = ("ept", "ept+vpt", "ept+vpt+surface")
# as far up and as bright, but wide: light of a sun without extent does not show in clear grains
WIDE_SUN = """<shape type="sphere"> <point name="center" x="2600" y="1138" z="975"/> <float name="radius" value="{}"/>
<emitter type="area"> <rgb name="radiance" value="{}, {}, {}"/> </emitter> </shape>"""
DISTANCE = 3000.0  # m, of its centre
_LEAST = 4  # passes of each part
ROUNDS = 4  # in which methods take turns
BLOCK = 8  # pixels a side, of the blocks whose differences are shown


def written(folder, width, asset, time=3600.0, eye=0.0, tolerance="5%", sun=0.0):
    """The scene in a folder: the field a body, and no drift or posts in it.

    eye : m above it, from its edge; 0: as shipped
    sun : degrees, how wide it is, and the field is full of grains; 0: that of the shipped scene
    """
    text = (ROOT / "assets/scenes/field_of_snow.xml").read_text(encoding="utf-8")
    text = re.sub(r'<shape type="rectangle" id="plain">.*?</shape>', FIELD, text)
    text = re.sub(r'<shape type="ply" id="drift">.*?</shape>', "", text)
    text = re.sub(r'(<point name="p0" [^>]*z=)"-4"', r'\1"-2.9"', text)
    if eye:
        text = re.sub(r'(?s)<sensor.*?</sensor>', "", text).replace("</scene>", EYE.format(eye - 3, eye - 3.46) + "</scene>")
        text = text.replace('100, 100, 1"/> <translate z="-4"', '100, 100, 10"/> <translate z="-13"')  # 20 m deep
    if sun:
        text = re.sub(r'(?s)<shape type="cube" id="plain">.*?</shape>', "", text)
        vertices, faces = BLOCK_OF_SNOW
        (folder / "plain.ply").write_bytes(ply.mesh(vertices, faces))
        share = np.sin(np.radians(sun / 2))
        disc = WIDE_SUN.format(DISTANCE * share, *(np.array([1.34, 1.08, 0.8]) / share**2))
        text = re.sub(r'(?s)<emitter type="directional".*?</emitter>', disc, text)
    (folder / "far_snow.xml").write_text(text, encoding="utf-8")
    path = folder / "far_snow.yaml"
    height = 3 * width // 4
    where = "mesh: plain.ply" if sun else "shape: plain"
    path.write_text(SCENE.format(width=width, height=height, asset=asset, time=time, tolerance=tolerance, where=where),
                    encoding="utf-8")
    return path


def baked(folder, grains=None):
    """Snow of the shipped grains, its surface that of their medium; or snow or sand, its surface counted among the grains."""
    text = (ROOT / f"recipes/{RECIPES[grains]}.yaml").read_text(encoding="utf-8")
    name = f"{grains}_grains" if grains else "snow"
    recipe = folder / f"{name}.yaml"
    recipe.write_text(text if grains else re.sub(r"(?m)^surface: .*$", "surface: {method: medium, tolerance: 1%}", text),
                      encoding="utf-8")
    bakery.bake(recipe, output=folder / f"{name}.h5")
    return f"{name}.h5"


class Passes:
    """Passes of a part of a method: luminance of the lower half, sums of pixels and of their squares, processor seconds."""

    def __init__(self, part):
        self.part = part.fewer(1) if part.fewer else part
        self.part.render(1 << 20)  # compiles
        self.lower, self.seconds, self.count, self.sum, self.square = [], 0.0, 0, 0.0, 0.0

    def again(self):
        """One more."""
        begin = time.process_time()
        image = np.asarray(self.part.render(self.count)[""], float) @ colour.LUMINANCE
        self.seconds += time.process_time() - begin
        self.lower.append(image[len(image) // 2:].mean())
        self.sum, self.square, self.count = self.sum + image, self.square + image**2, self.count + 1

    @property
    def variance(self):
        """Of a pixel of one pass, (H, W)."""
        mean = self.sum / self.count
        return np.maximum(self.square / self.count - mean**2, 0) * self.count / (self.count - 1)


class Run:
    """Passes of all parts of a method, which have as long each."""

    def __init__(self, opened, candidate):
        scene = candidates.by_methods(opened.scene, candidate.methods)
        method = scene.prepare(opened._replace(scene=scene), World.of(scene), 0)  # surfaces change shapes of their world
        self.parts, self.reasons = [Passes(part) for part in method.parts], method.reasons

    @property
    def seconds(self):
        """Of all passes."""
        return sum(part.seconds for part in self.parts)

    @property
    def of_a_pass(self):
        """Processor seconds of one of each part."""
        return sum(part.seconds / part.count for part in self.parts)

    def on(self, seconds):
        """More passes, for so many more processor seconds."""
        end = self.seconds + seconds
        while self.seconds < end or min(part.count for part in self.parts) < _LEAST:
            min(self.parts, key=lambda part: (part.count >= _LEAST, part.seconds)).again()

    @property
    def mean(self):
        """Of the lower half, and its standard error."""
        errors = [np.std(part.lower, ddof=1) / np.sqrt(part.count) for part in self.parts]
        return float(sum(np.mean(part.lower) for part in self.parts)), float(np.hypot.reduce(errors))

    @property
    def picture(self):
        """Luminance (H, W), and its standard error."""
        return (sum(part.sum / part.count for part in self.parts),
                np.sqrt(sum(part.variance / part.count for part in self.parts)))

    @property
    def to_noise(self):
        """Processor seconds until the noise of a pixel is 1 % of the picture's mean, each part with its best share of them."""
        root = sum(np.sqrt(np.mean(part.variance) * part.seconds / part.count) for part in self.parts)
        return float(root**2 / np.mean(self.picture[0]) ** 2 / 1e-4)


def table(runs):
    """Rows of the methods, by name; the first is what others are held against."""
    reference = next(iter(runs.values()))
    first = next(iter(runs))
    print(f"| method | s a pass | lower half over {first} | noise 1 % after, s | over {first} |\n|---|---|---|---|---|")
    for name, run in runs.items():
        ratio = run.mean[0] / reference.mean[0]
        error = np.hypot(run.mean[1], reference.mean[1] * (run is not reference)) / reference.mean[0]
        print(f"| {name} | {run.of_a_pass:.2g} | {ratio:.3f} +- {error:.3f} | {run.to_noise:.3g} | "
              f"{run.to_noise / reference.to_noise:.2g} |")


def by_rows(runs, bands=8):
    """Ratio to the first method in bands of rows below the horizon, from far to near, with standard errors."""
    (reference, its_error), *others = (run.picture for run in runs.values())
    first = len(reference) // 8
    for name, (mean, error) in zip(list(runs)[1:], others, strict=True):
        cells = []
        for rows in np.array_split(np.arange(first, len(reference)), bands):
            level = reference[rows].mean()
            noise = np.hypot(*(np.sqrt((part[rows] ** 2).sum()) / part[rows].size for part in (error, its_error))) / level
            cells.append(f"{mean[rows].mean() / level:.3f} +- {noise:.3f}")
        print(f"{name}, rows from far to near: {', '.join(cells)}")


def shown(runs, folder):
    """Means of the methods, and their differences from the first one over the standard error, of blocks: grey is none."""
    level = 2 * float(np.mean([run.picture[0].mean() for run in runs.values()]))
    pictures = {name: run.picture for name, run in runs.items()}
    reference, its_error = next(iter(pictures.values()))
    height, width = (BLOCK * (side // BLOCK) for side in reference.shape)

    def blocks(image):
        return image[:height, :width].reshape(height // BLOCK, BLOCK, -1, BLOCK).mean(axis=(1, 3))

    for name, (mean, error) in pictures.items():
        grey = np.clip(mean / level, 0, 1) ** (1 / 2.2)
        (folder / f"{name}.png").write_bytes(images.png(images.eight_bits(np.repeat(grey[..., None], 3, axis=2))))
        if mean is reference:
            continue
        deviation = blocks(mean - reference) / np.maximum(np.sqrt(blocks(error**2 + its_error**2)) / BLOCK, 1e-12)
        grey = np.kron(np.clip(0.5 + deviation / 12, 0, 1), np.ones((BLOCK, BLOCK)))
        (folder / f"{name}-paths.png").write_bytes(images.png(images.eight_bits(np.repeat(grey[..., None], 3, axis=2))))


def methods(scene, eye):
    """Candidates by name; the first is what others are held against."""
    if scene.values.materials[0].kind == "grains":
        return {candidate.name: candidate for candidate in candidates.of(scene) if candidate.name in GRAINS}
    near = {"paths": candidates.with_surfaces(scene, (), 0.0)}
    between = {"paths+surface": candidates.with_surfaces(scene, (), 0.0, (0,))} if eye else {}
    return near | between | {"surface": candidates.with_surfaces(scene, (0,), 0.0)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=sized(200, 32))
    parser.add_argument("--seconds", type=float, default=sized(60.0, 2.0), help="of paths, of processors; surfaces have a tenth")
    parser.add_argument("--folder", type=Path, help="where the asset is kept")
    parser.add_argument("--eye", action="store_true", help="from the height of eyes")
    parser.add_argument("--height", type=float, default=1.7, help="of the eyes over the snow, m")
    parser.add_argument("--grains", choices=("snow", "sand"), help="from there, and full of grains")
    parser.add_argument("--sun", type=float, default=11.0, help="degrees, how wide it is over grains: wider ones make less noise")
    parser.add_argument("--tolerance", default="5%", help="of the scene")
    parser.add_argument("--methods", nargs="+", metavar="NAME", help="only these; the first is what others are held against")
    parser.add_argument("--pictures", type=Path, help="a folder for PNG files")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        path = written(folder, args.width, baked(folder, args.grains), tolerance=args.tolerance,
                       eye=args.height if args.eye or args.grains else 0.0, sun=args.sun if args.grains else 0.0)
        scene = assets.together([scenes.load(path)])[0]
        opened = choice.Opened.of(scene)
        offered = methods(scene, args.eye)
        if args.methods:
            offered = {name: offered[name] for name in args.methods}
        if "surface" in offered and not args.eye:
            begin = time.process_time()
            taken = choice.chosen(opened, World.of(scene))
            print(f"pilots: {time.process_time() - begin:.1f} s of processors", *taken.reasons, sep="\n", flush=True)
        runs = {name: Run(opened, candidate) for name, candidate in offered.items()}
        for _ in range(ROUNDS):
            for name, run in runs.items():
                run.on(args.seconds / ROUNDS / (10 if name == "surface" else 1))
        for name in {"paths+surface", "ept+vpt+surface"} & runs.keys():
            print(*runs[name].reasons, sep="\n")
        table(runs)
        by_rows(runs)
        if args.pictures:
            args.pictures.mkdir(parents=True, exist_ok=True)
            shown(runs, args.pictures)


if __name__ == "__main__":
    main()
