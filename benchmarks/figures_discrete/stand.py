"""The stand of all figures: particles in a cube of 0.1 m, nothing else, a lamp beside or behind them, and a camera in front."""

import math
import tempfile
import time
from functools import cache
from pathlib import Path

import numpy as np

import bakery
from benchmarks.sizes import sized
from renderers import colour
from renderers.materials.particles import methods
from renderers.mitsuba import bitmaps
from renderers.mitsuba.world import World
from renderers.pictures import passes
from renderers.pictures.means import Mean
from renderers.pictures.running import Render

EDGE = 0.1  # m, of the cube
PIXELS = sized(64, 16)  # of a picture, along each side
LAYERS = ("", "order1.")
SIDE, BEHIND = "side", "behind"  # where the lamp is: scattering by about 110, and by 16 to 37 degrees
_LAMPS = {SIDE: (0.4, -0.15, 0.1, 0.3), BEHIND: (0.2, 0.4, 0, 0.08)}  # m, middle and radius
_SCENE = """<scene version="3.0.0">
<sensor type="perspective"> <float name="fov" value="15"/> <transform name="to_world">
    <lookat origin="0, -0.35, 0" target="0, 0, 0" up="0, 0, 1"/> </transform>
    <film type="hdrfilm"> <integer name="width" value="{pixels}"/> <integer name="height" value="{pixels}"/> </film> </sensor>
<bsdf type="diffuse" id="black"> <rgb name="reflectance" value="0"/> </bsdf>
<shape type="sphere" id="lamp"> <point name="center" value="{place}"/> <float name="radius" value="{radius}"/> <ref id="black"/>
    <emitter type="area"> <rgb name="radiance" value="1"/> </emitter> </shape>
</scene>
"""


@cache
def folder() -> Path:
    """Where assets and pictures go."""
    made = Path(tempfile.gettempdir()) / "figures_discrete"
    made.mkdir(exist_ok=True)
    return made


def asset(size, count, index="{n: 1.5, k: 0}", wavelength=0.55) -> Path:
    """Baked particles: `size` and `index` as a recipe writes them, `count` of them."""
    text = f"""bakery: 1
name: particles
wavelengths: [{wavelength}]
tolerance: 10%
measure: integrated
particles:
  host: vacuum
  number_density: 1 /m^3
  components: [{{name: p, material: {index}, size: {size}}}]
discrete: {{count: {int(count)}, box: [{EDGE} m, {EDGE} m, {EDGE} m]}}
"""
    from renderers.pictures.progressive import fingerprint

    path = folder() / f"{fingerprint(text)}.yaml"
    path.write_text(text)
    bakery.bake(path, output=path.with_suffix(".h5"))
    return path.with_suffix(".h5")


def single(radius_um):
    """All of about one size: one per cent apart, so that no interference of one size stands for all."""
    return f"{{distribution: lognormal, radius: {radius_um:.6g} um, sigma: 1.02}}"


def radius_of(count, depth):
    """um, of so many spheres that together have an optical depth along the cube, by an extinction efficiency of 2."""
    return 1e6 * math.sqrt(depth * EDGE**2 / (2 * math.pi * count))


class Picture:
    """Luminance (H, W) by layer, the renderer's report, and the processor time of its passes in s."""

    def __init__(self, layers, report, seconds):
        self.layers, self.report, self.seconds = layers, report, seconds

    @property
    def all(self):
        return self.layers[""]

    @property
    def single(self):
        return self.layers["order1."]

    @property
    def cost(self):
        """Processor time in s that 1 % noise takes; infinite where no light was found."""
        return self.seconds * (self.report["noise"] / 0.01) ** 2 or math.inf


def picture(made, method, samples, lamp=SIDE, **settings) -> Picture:
    """A picture of an asset, by a method of the scene, with so many samples a pixel; `settings` of its entry."""
    begin = time.process_time()
    report = passes.render(_scene(made, method, samples, lamp, settings), folder() / "scene.png", overwrite=True)
    seconds = (time.process_time() - begin) * report["seconds"]["passes"] / report["seconds"]["total"]
    channels, _ = bitmaps.read(folder() / "scene.exr")
    found = {layer: np.stack([channels[f"{layer}{c}"] for c in "RGB"], -1).astype(float) @ colour.LUMINANCE for layer in LAYERS}
    return Picture(found, report, seconds)


def parts(made, method, passes) -> dict[str, tuple[float, float]]:
    """Processor time (s) of a pass and relative variance of a pixel in one, by part of the picture.

    passes : of each part by its name, 2 or more; one more before them compiles
    """
    path = _scene(made, method, 1, SIDE, {})
    job, world = Render(path, folder() / "scene.png", overwrite=True), World(path.parent / f"{SIDE}.xml")
    found, mean = {}, 0.0
    for part in methods.prepare(job, world, 0, 1e-4).parts:
        part.render(0)
        sums, begin = Mean(), time.process_time()
        for number in range(1, passes[part.name] + 1):
            sums.add(part.render(number))
        found[part.name] = (time.process_time() - begin) / sums.count, float(np.mean(sums.square[..., 3])) / (sums.count - 1)
        mean = mean + float(np.mean(sums.layers[""] @ colour.LUMINANCE))
    return {name: (seconds, variance / mean**2) for name, (seconds, variance) in found.items()}


def _scene(made, method, samples, lamp, settings) -> Path:
    *place, radius = _LAMPS[lamp]
    text = _SCENE.format(place=str(place)[1:-1], radius=radius, pixels=PIXELS)
    (folder() / f"{lamp}.xml").write_text(text)
    half = EDGE / 2
    scene = folder() / "scene.yaml"
    more = "".join(f"    {key}: {value}\n" for key, value in settings.items())
    scene.write_text(f"""bakery_scene: 2
name: scene
tolerance: 0.01%
scene: {{mitsuba: {lamp}.xml}}
stop: {{samples: {samples}}}
materials:
  - where: {{box: {{lo: [-{half}, -{half}, -{half}] m, hi: [{half}, {half}, {half}] m}}}}
    asset: {made.name}
    method: {method}
{more}""")
    return scene


def blocks(image, size=8):
    """Means over squares of pixels."""
    height, width = image.shape
    return image.reshape(height // size, size, width // size, size).mean(axis=(1, 3))


def graininess(image, size=1):
    """Standard deviation of a mean over size x size pixels over its mean, from the differences of neighbours.

    Of each four neighbours two are taken from the two on the other diagonal: what varies slowly over the picture drops out.
    """
    a = blocks(image, size)
    mixed = a[:-1, :-1] + a[1:, 1:] - a[:-1, 1:] - a[1:, :-1]
    return float(np.sqrt(np.mean(mixed**2) / 4) / image.mean())
