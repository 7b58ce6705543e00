"""A flat field of beach sand, or of snow, under an even sky: how bright it is from the angles at which one sees it.

    python -m benchmarks.flat_sand [--small] [--grains sand] [--seconds 8] [--angles 20 60 80 85] [--turns 0 25 45]
        [--methods ept ept+vpt]

A row an angle from the normal and an azimuth against the tile's first axis: green light by explicit grains, and with the medium
behind them, over the albedo of the baked surface, which is the mean over all azimuths and over all heights at which the tile may
be cut; standard errors in brackets.  The field is 0.6 m wide and 12 mm deep, that of snow, which is clear, 200 m and 20 m.
--small: one angle, half a second.
"""

import argparse
import math
import tempfile
import time
from pathlib import Path

import numpy as np

import bakery
from bakery.store import ply
from benchmarks.far_snow import BLOCK_OF_SNOW, baked
from benchmarks.sizes import sized
from renderers import choice
from renderers import scene as scenes
from renderers.mitsuba.world import World
from renderers.scene import assets

SCENE = """\
bakery_scene: 2
name: flat_sand
scene: {{mitsuba: sky.xml, unit: 1 m}}
materials: [{{where: {{mesh: field.ply}}, asset: {asset}, method: {method}}}]
camera: {{origin: [{x}, {y}, {z}] m, target: [0, 0, 0] m, fov: 1 deg}}
film: {{width: 8, height: 8}}
tolerance: 5%
stop: {{noise: 1%, time: 600 s}}
"""


def seen(folder, asset, method, theta, turn, seconds):
    """Green radiance of the field from an angle and an azimuth, rad, and its standard error."""
    path = folder / f"{method}_{theta:.3f}_{turn:.3f}.yaml"
    x, y, z = -math.sin(theta) * math.cos(turn), -math.sin(theta) * math.sin(turn), math.cos(theta)
    path.write_text(SCENE.format(asset=asset, method=method, x=f"{x:.9f}", y=f"{y:.9f}", z=f"{z:.9f}"), encoding="utf-8")
    scene = choice.Opened.of(assets.together([scenes.load(path)])[0])
    mean, variance, parts = 0.0, 0.0, scene.scene.prepare(scene, World.of(scene.scene), 0).parts
    for part in parts:
        part.render(1 << 20)  # compiles
        passes, end = [], time.process_time() + seconds / len(parts)
        while time.process_time() < end or len(passes) < 4:
            passes.append(np.asarray(part.render(len(passes))[""], float)[..., 1].mean())
        mean, variance = mean + np.mean(passes), variance + np.var(passes, ddof=1) / len(passes)
    return mean, math.sqrt(variance)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grains", choices=("snow", "sand"), default="sand")
    parser.add_argument("--seconds", type=float, default=sized(8.0, 0.5), help="of processors, of each number")
    parser.add_argument("--angles", type=float, nargs="+", default=sized([20.0, 60.0, 80.0, 85.0], [60.0]), help="degrees")
    parser.add_argument("--turns", type=float, nargs="+", default=sized([0.0, 25.0, 45.0], [0.0]), help="degrees")
    parser.add_argument("--methods", nargs="+", default=["ept", "ept+vpt"])
    parser.add_argument("--folder", type=Path, help="where the asset is kept")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        asset = baked(folder, args.grains)
        block = (BLOCK_OF_SNOW[0] + [0, 0, 3]) * ([3e-3, 3e-3, 6e-4] if args.grains == "sand" else 1.0)  # its top at 0
        (folder / "field.ply").write_bytes(ply.mesh(block, BLOCK_OF_SNOW[1]))
        (folder / "sky.xml").write_text('<scene version="3.0.0"> <emitter type="constant"/> </scene>', encoding="utf-8")
        surface = bakery.open(folder / asset).surface
        print(f"| angle | azimuth | {' | '.join(args.methods)} |\n|---|---|{'---|' * len(args.methods)}")
        for angle in args.angles:
            albedo = surface.albedo(math.radians(angle))[1]
            for turn in args.turns:
                values = [np.array(seen(folder, asset, method, math.radians(angle), math.radians(turn), args.seconds)) / albedo
                          for method in args.methods]
                print(f"| {angle:g} | {turn:g} | {' | '.join(f'{mean:.3f}({1000 * error:.0f})' for mean, error in values)} |",
                      flush=True)


if __name__ == "__main__":
    main()
