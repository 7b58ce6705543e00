"""The renderer of grains against others, and its methods against each other.

    python benchmarks/granular_render.py [--only explicit methods] [--rounds 3] [--grains 1e5]
                                         [--scenes ...] [--methods ...] [--width 160] [--lamp 1] [--seconds 10]

explicit  paths from grain to grain (`ept`) against `path` of Mitsuba, scalar_rgb with Embree, where each grain is an instance of
          a shape group: the same grains of 20,480 triangles at the same places, the same floor and lights, no limit of depth.
          Both are unbiased: what counts is processor time times variance.  Memory: what the resident set grows by in the
          setup, and by the end of the last picture; ours has compiled before.
methods   shipped scenes, each method for so many seconds of processor time.  Light that met grains, over that of `ept`, and the
          time in which the variance of a pixel would be 1: variance of a pass times its time.  Where light before and after
          the switch has passes of its own, that of the best division between them.  --lamp 0.1 makes lamps of a tenth of the
          width, as bright in all: how much is gained over paths that find lamps by chance hangs on their size.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from benchmarks.sizes import sized

SIZE, SAMPLES = sized((192, 256), (9, 12)), 1  # of a round
LUMINANCE = (0.2126, 0.7152, 0.0722)
SCENE = """<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="-1"/><integer name="rr_depth" value="1000"/></integrator>
<sensor type="perspective"><float name="fov" value="24"/><transform name="to_world">
  <lookat origin="{x}, {y}, {z}" target="0, 0, 0" up="0, 0, 1"/></transform>
  <film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>
  <rfilter type="box"/></film>
</sensor>
<shape type="rectangle"><transform name="to_world"><scale value="{wide}"/><translate z="{floor}"/></transform>
  <bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.4 0.3"/></bsdf></shape>
<shape type="rectangle"><transform name="to_world"><scale value="{lamp}"/><rotate x="1" angle="180"/><translate z="{high}"/>
  </transform><emitter type="area"><rgb name="radiance" value="2 2 2"/></emitter></shape>
<emitter type="constant"><rgb name="radiance" value="0.3 0.4 0.6"/></emitter>
MORE</scene>"""
GRAIN = """<bsdf type="dielectric" id="glass"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>
<shape type="shapegroup" id="grain"><shape type="ply"><string name="filename" value="grain.ply"/>
<boolean name="face_normals" value="true"/><ref id="glass"/></shape></shape>"""


def resident():
    """MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**20


class Mitsuba:
    """Its scene in a process of its own, as a process has one kind of variant.

    setup : seconds of the processor and MiB by which the process has grown;  memory : that up to the end of the last picture
    """

    def __init__(self, path):
        self.process = subprocess.Popen([sys.executable, __file__, "--child", str(path)], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True)
        self.setup = self._answer()

    def _answer(self):
        return json.loads(self.process.stdout.readline())

    def render(self, seed):
        """Seconds of the processor, picture (H, W, 3)."""
        print(seed, file=self.process.stdin, flush=True)
        seconds, self.memory, picture = self._answer()
        return seconds, np.array(picture)

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def child(path):
    """Answers, one a line: seconds and MiB of the setup; then for each seed seconds, MiB, picture."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    mi.render(mi.load_dict({"type": "scene", "ball": {"type": "sphere"}, "sensor": {"type": "perspective"},
                            "integrator": {"type": "path"}}), spp=1)
    before, begin = resident(), time.process_time()
    scene = mi.load_file(path)
    print(json.dumps([time.process_time() - begin, resident() - before]), flush=True)
    for line in sys.stdin:
        begin = time.process_time()
        picture = np.array(mi.render(scene, spp=SAMPLES, seed=int(line)), float)
        print(json.dumps([time.process_time() - begin, resident() - before, picture.tolist()]), flush=True)


class Ours:
    """The same of ours, in this process; its kernels are compiled before."""

    def __init__(self, path, vertices, faces, spheres, mesh, size=SIZE):
        from renderers.mitsuba.world import World
        from tests.physics.test_granular_render import GLASS, Kind, grains, place

        self.before, begin = resident(), time.process_time()
        self.world = World(path, size=size)
        self.grains = grains([Kind(GLASS, mesh)], (vertices, faces), spheres)
        self.where = place(self.grains, self.world)
        self.setup = time.process_time() - begin, resident() - self.before

    def render(self, seed):
        from tests.physics.test_granular_render import passes

        begin, numbers = time.process_time(), range(SAMPLES * seed, SAMPLES * (seed + 1))
        picture = passes(self.world, self.where, self.world.camera, self.world.size, numbers).mean(axis=0)
        seconds, self.memory = time.process_time() - begin, resident() - self.before
        return seconds, picture


def grain():
    """A stone of 20,480 triangles in the unit sphere."""
    from bakery.physics.shapes.radial import icosphere

    vertices, faces = icosphere(sized(20480, 320))
    radius = 1 + 0.3 * np.sin(3 * vertices[:, 0] + 1) * np.cos(4 * vertices[:, 1]) * np.sin(2 * vertices[:, 2] + 0.5)
    vertices = vertices * radius[:, None]
    return vertices / np.linalg.norm(vertices, axis=1).max(), faces


def written(folder, name, edge, more):
    places = {"x": -1.6 * edge, "y": -2.6 * edge, "z": 1.5 * edge, "wide": 5 * edge, "floor": -edge / 2 - 1, "lamp": 2.5 * edge,
              "high": 3 * edge, "width": SIZE[1], "height": SIZE[0]}
    path = folder / f"{name}.xml"
    path.write_text(SCENE.format(**places).replace("MORE", more))
    return path


def instanced(found, mesh):
    """XML of each grain of an aggregate in a mesh."""
    from bakery.physics.packing.instances import instances, rotation_matrix
    from tests.physics.test_aggregate import listed

    met, centre, radius = listed(*(getattr(found.aggregate, name) for name in ("centers", "radii", "cell")), *mesh)
    turn = instances(int(found.seed), met[:, 1:], met[:, 0], np.ones(1))[1]
    rows = []
    for place, size, one in zip(centre, radius, turn):
        whole = np.column_stack([size * np.array(rotation_matrix(*one)).reshape(3, 3), place])
        rows.append('<shape type="instance"><ref id="grain"/><transform name="to_world"><matrix value="'
                    + " ".join(f"{value:.9g}" for value in whole.ravel()) + ' 0 0 0 1"/></transform></shape>')
    return len(rows), GRAIN + "\n".join(rows)


def explicit(options):
    from bakery.store import ply
    from tests.physics.test_aggregate import CUBE, tile

    spheres, mesh = tile(0.6, 500), grain()
    edge = (options.grains / len(spheres[1]) * np.prod(spheres[2])) ** (1 / 3)
    cube = (CUBE[0] - 0.5) * edge, CUBE[1]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "grain.ply").write_bytes(ply.mesh(*mesh))
        path = written(folder, "ours", edge, "")
        Ours(path, 0.1 * cube[0], cube[1], spheres, mesh, (6, 8)).render(0)  # compiles
        ours = Ours(path, *cube, spheres, mesh)
        count, more = instanced(ours.grains, cube)
        peers = {"ept": ours, "Mitsuba": Mitsuba(written(folder, "theirs", edge, more))}
        found = {key: [] for key in peers}
        for seed in range(options.rounds):
            for key, peer in peers.items():
                found[key].append(peer.render(seed))
        peers["Mitsuba"].close()
    report(count, mesh, peers, found)


def report(count, mesh, peers, found):
    paths, rows = SIZE[0] * SIZE[1] * SAMPLES, {}
    meshes = (mesh[0].nbytes + mesh[1].nbytes) / 2**20
    print(f"{count} grains of {len(mesh[1])} triangles ({meshes:.1f} MiB), {SIZE[1]} x {SIZE[0]} pixels, "
          f"{SAMPLES * len(found['ept'])} samples each\n")
    print("| | setup, s | MiB | MiB with pictures | us a path | mean | variance | time x variance, us |\n" + "|---" * 8 + "|")
    for key, peer in peers.items():
        seconds, pictures = zip(*found[key])
        grey = np.array(pictures) @ LUMINANCE
        spent, variance = 1e6 * np.median(seconds) / paths, SAMPLES * trimmed(grey.var(axis=0, ddof=1))
        error = grey.mean(axis=(1, 2)).std(ddof=1) / len(grey) ** 0.5
        rows[key] = spent, variance
        print(f"| {key} | {peer.setup[0]:.1f} | {peer.setup[1]:.0f} | {peer.memory:.0f} | {spent:.0f} | "
              f"{grey.mean():.4f} ± {error:.4f} | {variance:.4f} | {spent * variance:.1f} |")
    (ours, noise), (theirs, other) = rows["ept"], rows["Mitsuba"]
    print(f"\ntime a path, ept over Mitsuba: {ours / theirs:.2f}; time to equal noise: {ours * noise / (theirs * other):.2f}")


def trimmed(values):
    """Mean without the largest thousandth: the few paths of more than a thousand bounces may have weights of hundreds in both,
    and one of them would be all of the variance of so few samples."""
    values = np.sort(values, axis=None)
    return values[: len(values) - len(values) // 1000].mean()


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


SECTIONS = {"explicit": explicit, "methods": methods}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--rounds", type=int, default=sized(3, 2))
    parser.add_argument("--grains", type=float, default=sized(1e5, 100))
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    parser.add_argument("--width", type=int, default=sized(160, 8))
    parser.add_argument("--lamp", type=float, default=1.0)
    parser.add_argument("--seconds", type=float, default=sized(10, 0.0))
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        child(options.child)
        return
    for name in options.only:
        SECTIONS[name](options)


if __name__ == "__main__":
    main()
