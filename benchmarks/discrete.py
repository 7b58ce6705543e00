"""Rendering separate particles, beside explicit path tracing and the query cylinder: python benchmarks/discrete.py [N ...]

All methods render one realisation of one asset, in turns, lit by an area light, which explicit path tracing needs to find any
light.  The error of a method is its noise: the scatter of its passes about its own mean, relative root mean square over the
picture's luminance.  With variance V and processor seconds S of a pass the time to an error e is V S / e^2; methods of two kinds
of passes share the time best, (sqrt(V1 S1) + sqrt(V2 S2))^2 / e^2.  Printed is that time, relative to explicit path tracing, for
single scattering and for all orders; below 1 we are quicker.  Then the time to a first picture of two passes, 640 x 480, and its
memory.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

import numpy as np  # noqa: E402

from benchmarks.sizes import sized  # noqa: E402
from renderers import colour  # noqa: E402
from renderers.materials.particles import methods  # noqa: E402
from renderers.mitsuba.world import World  # noqa: E402
from renderers.pictures.running import Render  # noqa: E402

PASSES = sized(8, 2)
WIDTH, HEIGHT = sized((640, 480), (16, 12))
METHODS = ("particles", "auto", "query", "explicit")
# water in air: the sizes of drizzle, at a size parameter of some thousand; optical depth 1 along the box, whatever the number
RECIPE = """bakery: 1
name: drops
wavelengths: visible8
tolerance: 10%
measure: integrated
particles:
  host: air
  number_density: {density:g} /m^3
  components:
    - {{name: drops, material: water, size: {{distribution: lognormal, radius: {radius:g} um, sigma: 1.4}}}}
discrete: {{count: {count}, box: [1 m, 1 m, 1 m], method: {method}}}
""".replace("visible8", sized("visible8", "[0.55]"))
SURFACES = """<scene version="3.0.0">
<shape type="rectangle" id="lamp"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="180"/>
<translate x="0.5" y="0.5" z="1.5"/></transform><emitter type="area"><rgb name="radiance" value="10"/></emitter></shape>
<sensor type="perspective"><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0.5, -1.2, 0.5" target="0.5, 0.5, 0.5" up="0, 0, 1"/></transform>
<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/></film></sensor>
</scene>
"""


def asset(folder, count, method="stored"):
    """A baked asset; <C> is about 2 pi <r^2>."""
    radius = 1e6 * (1 / (2 * np.pi * np.exp(2 * np.log(1.4) ** 2) * count)) ** 0.5
    path = folder / f"drops_{count:.0e}.yaml"
    path.write_text(RECIPE.format(density=count, radius=radius, count=int(count), method=method))
    subprocess.run([sys.executable, "-m", "bakery", path, "-o", path.with_suffix(".h5"), "--force"], check=True,
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return path.with_suffix(".h5")


def scene(folder, name, method, width, height):
    (folder / "lamp.xml").write_text(SURFACES.format(width=width, height=height))
    path = folder / f"{method}.yaml"
    path.write_text(f"bakery_scene: 2\nname: {method}\nscene: {{mitsuba: lamp.xml}}\n"
                    f"materials: [{{asset: {name}, method: {method}}}]\n")
    return path


def prepared(folder, name, method, width, height):
    job = Render(scene(folder, name, method, width, height), overwrite=True)
    world = World(job.scene.file("lamp.xml"))
    return methods.prepare(job, world, 0, 0.025)


def passes(parts):
    """Layers `order1` and the whole as (PASSES, H, W) luminance, and seconds of a pass, of each part, in turns."""
    found = {name: ([], [], []) for name in parts}
    for part in parts.values():
        part.render(1000)  # compiles
    for number in range(PASSES):
        for name, part in parts.items():
            begin = time.process_time()
            layers = part.render(number)
            found[name][2].append(time.process_time() - begin)
            found[name][0].append(layers["order1"] @ colour.LUMINANCE)
            found[name][1].append(layers[""] @ colour.LUMINANCE)
    return {name: [np.array(single), np.array(whole), min(seconds)] for name, (single, whole, seconds) in found.items()}


def cost(parts, which):
    """Seconds to a relative error of 1: which is 0 for single scattering, 1 for all orders."""
    mean = sum(part[which].mean() for part in parts)
    return sum(np.sqrt(part[which].var(axis=0, ddof=1).mean() * part[2]) for part in parts) ** 2 / mean**2, mean


def compare(folder, count, width=WIDTH // 2, height=HEIGHT // 2):
    path = asset(folder, count)
    found = passes({(method, part.name): part for method in METHODS
                    for part in prepared(folder, path.name, method, width, height).parts})
    base = {}
    print(f"{count:.0e} particles, {width} x {height}, {PASSES} passes each")
    for method in reversed(METHODS):
        parts = [values for (of, _), values in found.items() if of == method]
        line = f"  {method:10s}"
        for which, label in ((0, "single"), (1, "all")):
            seconds, mean = cost(parts, which)
            base.setdefault(which, seconds)
            line += f"  {label}: mean {mean:.4g}, {seconds:8.3g} s to 100 %, {seconds / base[which]:.2g} of explicit's;"
        each = ", ".join(f"{part} {values[2]:.2f} s" for (of, part), values in found.items() if of == method)
        print(f"{line}  a pass: {each}", flush=True)


def first(folder, count, method, kind):
    path = asset(folder, count, kind)
    where = scene(folder, path.name, method, WIDTH, HEIGHT)
    begin = time.monotonic()
    command = [sys.executable, "-m", "bakery", "render", where, "--set", "stop.samples=2", "-o", folder / "first.png",
               "--overwrite"]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    if status:
        sys.exit("the picture could not be rendered")
    peak = used.ru_maxrss / 1e3
    print(f"first picture of {count:.0e} {kind} particles, {WIDTH} x {HEIGHT}, method {method}: {time.monotonic() - begin:.1f} "
          f"s, at most {peak:.0f} MB", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("particles", nargs="*", type=float, default=sized([1e5, 1e6], [1e5]))
    parser.add_argument("--first", action="store_true", help="first pictures alone")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        for count in () if asked.first else asked.particles:
            compare(folder, count)
        first(folder, sized(1e6, 1e5), "particles", "stored")
        first(folder, sized(1e6, 1e5), "auto", "stored")
        first(folder, sized(1e9, 1e6), "auto", "procedural")


if __name__ == "__main__":
    main()
