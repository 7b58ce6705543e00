"""Small lamps on clear grains: variance times time of methods, and what discs in place of the lamps change.

usage: python -m benchmarks.small_lamps [--small] [--passes 8] [--scene beads,sugar,spot] [--bias]

A heap of glass beads in the sun (sky and sun of Mitsuba), one of cane sugar under a bulb of 8 mm at 30 cm, and beads
under a spot.  Processor time of passes in turn, one method after the other; `--bias`: the mean light of the grains in a
distant lamp, by the radius of its disc, which does not shrink there.
"""

import argparse
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import bakery
from benchmarks.sizes import sized
from renderers import colour, scene
from renderers.materials.grains import methods
from renderers.mitsuba.world import World
from renderers.scene import assets
from renderers.transport import regularised

ROOT = Path(__file__).resolve().parents[1]
XML = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="{fov}"/> <string name="fov_axis" value="x"/>
<transform name="to_world"> <lookat origin="-62, -108, 62" target="0, 0, {height}" up="0, 0, 1"/> </transform>
<film type="hdrfilm"> <integer name="width" value="{width}"/> <integer name="height" value="{height_in_pixels}"/> </film></sensor>
<shape type="rectangle" id="floor"> <transform name="to_world"> <scale value="200"/> <translate z="-0.5"/> </transform>
<bsdf type="diffuse"> <rgb name="reflectance" value="0.3, 0.3, 0.3"/> </bsdf> </shape>
{light}</scene>"""
ROOM = '<emitter type="constant" id="room"><rgb name="radiance" value="0.05"/></emitter>'
LIGHTS = {
    "beads": '<emitter type="sunsky" id="sunsky"><vector name="sun_direction" value="0.5, -0.6, 0.7"/></emitter>',
    "sugar": '<shape type="sphere" id="bulb"><point name="center" x="150" y="-180" z="190"/><float name="radius" value="4"/>'
             '<emitter type="area"><rgb name="radiance" value="4000"/></emitter></shape>' + ROOM,
    "spot": '<emitter type="spot" id="spot"><transform name="to_world"><lookat origin="150, -180, 190" target="0, 0, 5" '
            'up="0, 0, 1"/></transform><rgb name="intensity" value="200000"/><float name="cutoff_angle" value="12"/></emitter>'
            + ROOM,
    "distant": '<emitter type="directional" id="sun"><vector name="direction" value="-0.5, 0.6, -0.7"/>'
               '<rgb name="irradiance" value="3"/></emitter>'}
RECIPES = {"sugar": "cane_sugar"}
WIDTH = sized(64, 8)


def method(folder, name, light, method, widen=None, edge=24):
    """`renderers.pictures.passes.Method` of a heap under a light, with cubes of an edge, mm."""
    room = XML.format(width=WIDTH, height_in_pixels=WIDTH * 3 // 4, fov=0.9 * edge, height=edge / 2.4, light=LIGHTS[light])
    (folder / f"{light}.xml").write_text(room)
    file = folder / f"{name}.yaml"
    file.write_text(f"bakery_scene: 2\nname: lamps\ntolerance: 10%\nscene: {{mitsuba: {light}.xml, unit: 1 mm}}\nmaterials:\n"
                    f"  - {{where: {{mesh: {ROOT}/assets/scenes/cube.ply, unit: {edge} mm}}, method: {method}, "
                    f"recipe: {ROOT}/recipes/{RECIPES.get(name, 'glass_beads')}.yaml"
                    + ("}\n" if widen is None else f", widen: {widen} deg}}\n"))
    baked = assets.baked(scene.load(file))
    job = SimpleNamespace(scene=baked, assets=[bakery.open(path) for path in baked.assets])
    return methods.prepare(job, World.of(baked), 0)


def cost(part, passes):
    """Mean, variance of a pixel by one sample, and seconds of a sample."""
    part.render(passes)
    start = time.process_time()
    pictures = np.array([part.render(number)[""] @ colour.LUMINANCE for number in range(passes)])
    seconds = (time.process_time() - start) / passes / part.samples
    return pictures.mean(), part.samples * pictures.var(axis=0, ddof=1).mean(), seconds


def compared(folder, name, passes):
    """Prints the noise of methods and the product of variance and time, at the best share of passes of their parts."""
    for asked, widen in (("ept", None), ("ept+wide", None), ("ept+vpt+da", 0), ("ept+vpt+da", None)):
        if asked == "ept" and name == "spot":
            continue  # it does not find the lamp
        costs = [cost(part, passes) for part in method(folder, name, name, asked, widen).parts]
        mean = sum(part[0] for part in costs)
        noise = [np.sqrt(part[1]) / mean for part in costs]
        product = sum(n * np.sqrt(part[2]) for n, part in zip(noise, costs)) ** 2
        print(f"{name:6} {asked:12} {'' if widen is None else 'as they are':12} mean {mean:.4f}, noise of a sample "
              f"{' and '.join(f'{100 * n:.0f} %' for n in noise)}, variance times time {product:.3g} s", flush=True)


def biased(folder, name, passes):
    """Prints the light of grains in a distant lamp by the radius of its disc."""
    regularised._SHRINKS = 0.0
    for angle in (30, 20, 10, 5):
        part, = method(folder, name, "distant", "ept+wide", angle, 11).parts
        light = np.array([sum(part.render(number)[order].mean() for order in ("order1", "order2", "orders"))
                          for number in range(passes * max(1, (10 // angle) ** 2))])
        print(f"{name}: {angle} degrees {light.mean():.5f} +- {light.std(ddof=1) / np.sqrt(len(light)):.5f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--passes", type=int, default=sized(8, 2))
    parser.add_argument("--scene", default=sized("beads,sugar,spot", "beads"))
    parser.add_argument("--bias", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.scene.split(","):
            (biased if arguments.bias else compared)(Path(folder), name, arguments.passes)


if __name__ == "__main__":
    main()
