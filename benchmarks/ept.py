"""Paths from grain to grain (`ept`) beside Mitsuba's `path` over the same grains as shapes, in the same scenes.

    python benchmarks/ept.py [--small] [--width 64] [--seconds 10] [--cases NAME ...] [--grains 425] [--triangles 1280]

Some 425 balls, or stones as instances, clear, grey or of rough steel, fill a cube on a floor below a lamp and a sky.  Both
engines render in turns, each for so many seconds of processor time in all, and in a process of its own: Dr.Jit traces a call
through every shape of a process, whichever scene it belongs to.  A row a case: microseconds of processor time a path;
of a pixel, the variance of one path (mean square over colours and the picture, without the thousandth of the pixels where it is
largest), and variance times time, `ept` over `path`; MiB by which the setup grows the process, in turn; the mean of our picture
over that of Mitsuba's, with its standard error.
--small: two cases, 16 pixels wide, passes as few as possible.
"""

import argparse
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bakery import kernels
from bakery.physics.packing.instances import rotation_matrix
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from benchmarks.sizes import sized
from renderers.materials.grains import methods
from renderers.mitsuba import variants
from renderers.mitsuba.world import World
from tests.oracles.instances import instances
from tests.physics.test_aggregate import CUBE, listed, tile
from tests.physics.test_granular_render import Kind, grains, place, through

SCENE = """<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="-1"/></integrator>
<sensor type="perspective"><float name="fov" value="24"/><transform name="to_world">
  <lookat origin="{x}, {y}, {z}" target="0, 0, 0" up="0, 0, 1"/></transform>
  <film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{width}"/>
  <rfilter type="box"/></film>
</sensor>
<shape type="rectangle"><transform name="to_world"><scale value="{wide}"/><translate z="{floor}"/></transform>
  <bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.4 0.3"/></bsdf></shape>
<shape type="rectangle"><transform name="to_world"><scale value="{lamp}"/><rotate x="1" angle="180"/><translate z="{high}"/>
  </transform><emitter type="area"><rgb name="radiance" value="2 2 2"/></emitter></shape>
<emitter type="constant"><rgb name="radiance" value="0.3 0.4 0.6"/></emitter>
{more}</scene>"""
GLASS = '<bsdf type="dielectric" id="matter"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>'
GREY = '<bsdf type="diffuse" id="matter"><rgb name="reflectance" value="0.5 0.5 0.5"/></bsdf>'
STEEL = """<bsdf type="roughconductor" id="matter"><string name="distribution" value="ggx"/><float name="alpha" value="0.3"/>
<rgb name="eta" value="0.2 0.9 1.1"/><rgb name="k" value="3.9 2.5 2.4"/></bsdf>"""
GROUP = """<shape type="shapegroup" id="grain"><shape type="ply"><string name="filename" value="grain.ply"/>
<boolean name="face_normals" value="true"/><ref id="matter"/></shape></shape>"""


class Case(NamedTuple):
    """surface : of the grains, as kernels take it;  bsdf : the same for Mitsuba;  stones : instances of a mesh, not balls"""

    surface: object
    bsdf: str
    stones: bool = False


CASES = {
    "balls, glass": Case(kernels.dielectric(1.5), GLASS),
    "balls, grey": Case(kernels.diffuse(0.5), GREY),
    "balls, steel": Case(kernels.conductor([0.2 + 3.9j, 0.9 + 2.5j, 1.1 + 2.4j], 0.3), STEEL),
    "stones, glass": Case(kernels.dielectric(1.5), GLASS, True),
    "stones, grey": Case(kernels.diffuse(0.5), GREY, True),
}
SMALL = "balls, glass", "stones, grey"


def stone(triangles):
    """A stone in the unit sphere."""
    vertices, faces = icosphere(triangles)
    radius = 1 + 0.3 * np.sin(3 * vertices[:, 0] + 1) * np.cos(4 * vertices[:, 1]) * np.sin(2 * vertices[:, 2] + 0.5)
    vertices = vertices * radius[:, None]
    return vertices / np.linalg.norm(vertices, axis=1).max(), faces


def shapes(packed, mesh, stones):
    """XML of every grain of an aggregate in a mesh."""
    met, centre, radius = listed(*(getattr(packed.aggregate, name) for name in ("centers", "radii", "cell")), *mesh)
    if not stones:
        balls = (f'<shape type="sphere"><point name="center" x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>'
                 f'<float name="radius" value="{r:.9g}"/><ref id="matter"/></shape>' for (x, y, z), r in zip(centre, radius))
        return "\n".join(balls)
    turn = instances(int(packed.seed), met[:, 1:], met[:, 0], np.ones(1))[1]
    rows = [GROUP]
    for point, size, quaternion in zip(centre, radius, turn):
        whole = np.column_stack([size * np.array(rotation_matrix(*quaternion)).reshape(3, 3), point])
        rows.append('<shape type="instance"><ref id="grain"/><transform name="to_world"><matrix value="'
                    + " ".join(f"{value:.9g}" for value in whole.ravel()) + ' 0 0 0 1"/></transform></shape>')
    return "\n".join(rows)


def written(folder, name, edge, width, more=""):
    path = folder / f"{name}.xml"
    path.write_text(SCENE.format(x=-1.6 * edge, y=-2.6 * edge, z=1.5 * edge, wide=5 * edge, floor=-edge / 2 - 1, lamp=2.5 * edge,
                                 high=3 * edge, width=width, more=more))
    return path


def engine(name, case, folder, width, count, triangles):
    """Function of the number of a pass -> picture, and samples a pixel of a pass, of `ept` or `path`; files in a folder."""
    spheres = tile(0.6, 500)
    edge = (count / len(spheres[1]) * np.prod(spheres[2])) ** (1 / 3)
    cube = (CUBE[0] - 0.5) * edge, CUBE[1]
    packed = grains([Kind(case.surface, stone(triangles) if case.stones else None)], cube, spheres)
    if name == "ept":
        world = World(written(folder, "ours", edge, width))
        part = methods.part(world, through(place(packed, world)), "ept", 0)
        return lambda number: part.render(number)[""], part.samples
    import mitsuba as mi

    if case.stones:
        (folder / "grain.ply").write_bytes(ply.mesh(*stone(triangles)))
    scene = mi.load_file(str(written(folder, "theirs", edge, width, case.bsdf + shapes(packed, cube, case.stones))))
    samples = sized(64, 1)
    return lambda number: np.array(mi.render(scene, spp=samples, seed=number), float)[..., :3], samples


def _resident():
    """MiB of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20


def _begin(name, case, *sizes):
    variants.activate("rgb")
    with tempfile.TemporaryDirectory() as folder:
        before = _resident()
        RENDERED[:] = *engine(name, case, Path(folder), *sizes), _resident() - before
        RENDERED[0](1 << 20)  # compiles


def _samples_and_memory():
    return RENDERED[1:]


def _pass(number):
    begin = time.process_time()
    picture = RENDERED[0](number)
    return picture, time.process_time() - begin


RENDERED: list = []  # of a process of an engine


class Engine:
    """Passes of an engine in its process, and the seconds of processor time that each took."""

    def __init__(self, *what):
        self._process = ProcessPoolExecutor(1, get_context("spawn"), _begin, what)
        (self.samples, self.memory), self.pictures, self.seconds = self._process.submit(_samples_and_memory).result(), [], []

    def go(self):
        picture, seconds = self._process.submit(_pass, len(self.pictures)).result()
        self.pictures.append(picture)
        self.seconds.append(seconds)

    def close(self):
        self._process.shutdown()

    @property
    def time_of_path(self):
        """us"""
        return 1e6 * sum(self.seconds) / (len(self.seconds) * self.samples * self.pictures[0][..., 0].size)

    @property
    def variance(self):
        """Of one path.  A single path of rare weight would be all of the variance of so few passes, in either engine."""
        values = np.sort(self.samples * np.var(self.pictures, axis=0, ddof=1).mean(axis=-1), axis=None)
        return values[: len(values) - len(values) // 1000].mean()

    def mean(self):
        means = np.mean(self.pictures, axis=(1, 2, 3))
        return means.mean(), means.std(ddof=1) / len(means) ** 0.5


def row(name, case, seconds, *sizes):
    """Measures a case, prints its row, and returns variance times time over Mitsuba's."""
    ours, theirs = both = [Engine(engine, case, *sizes) for engine in ("ept", "path")]
    while any(sum(engine.seconds) < seconds or len(engine.seconds) < sized(8, 2) for engine in both):
        min(both, key=lambda engine: sum(engine.seconds)).go()
    for engine in both:
        engine.close()
    times, variances = ours.time_of_path / theirs.time_of_path, ours.variance / theirs.variance
    (mean, error), (other, its) = ours.mean(), theirs.mean()
    means = f"{mean / other:.4f} ({np.hypot(error / mean, its / other):.4f})"
    print(f"| {name} | {ours.time_of_path:.2f} | {theirs.time_of_path:.2f} | {ours.variance:.4f} | {theirs.variance:.4f} | "
          f"{times:.2f} | {variances:.2f} | {times * variances:.2f} | {ours.memory:.0f} | {theirs.memory:.0f} | {means} |",
          flush=True)
    return times * variances


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=sized(64, 16))
    parser.add_argument("--seconds", type=float, default=sized(10.0, 0.0))
    parser.add_argument("--cases", nargs="+", choices=CASES, default=sized(list(CASES), list(SMALL)))
    parser.add_argument("--grains", type=float, default=425)
    parser.add_argument("--triangles", type=int, default=1280, help="of a stone")
    args = parser.parse_args()
    print(variants.activate("rgb"))
    print("| case | ept, us a path | path | ept, variance | path | time | variance | variance x time | ept, MiB | path | mean |\n"
          + "|---" * 11 + "|", flush=True)
    worst = max(row(name, CASES[name], args.seconds, args.width, args.grains, args.triangles) for name in args.cases)
    print(f"worst: variance x time {worst:.2f}")


if __name__ == "__main__":
    main()
