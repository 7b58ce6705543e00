"""Paths through translucent bodies and media without a boundary beside Mitsuba's `volpath` and `volpathmis` in the same scenes.

    python benchmarks/transport.py [--small] [--width 128] [--rounds 6] [--roulette 1000] [--scenes NAME ...]

Ten bodies of continuous media of three wavelengths, matched and refracting, balls and shipped meshes: albedo 0.3 to 1, g -0.3 to
0.9, and the published wax, milk and skin.  Three media without a body: everywhere, in a box, on a grid.  Each engine renders a
million paths in turns; Mitsuba's roulette begins at depth 1000, as before it would end bright paths, but at 5 where a medium is
everywhere, of which few paths find an end.  A row a scene: microseconds of processor time a path, the first pass with all that it
compiles (s, also from Dr.Jit's cache on the disk), and of our engine: time over that of `volpath`; variance, and variance times
time, over those of the engine of Mitsuba that is better in the product (of a pixel, mean square over colours and the picture).
`mean` is our picture's over that of `volpathmis`, with its standard error by the scatter of the rounds; with early roulette, with
which that is 0.8 % too dark, over that of `volpath`, which has few bright pixels where wavelengths differ.
--small: four scenes, 32 pixels wide, three rounds.
"""

import argparse
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from bakery.physics.medium import phase
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from benchmarks.sizes import sized
from renderers.materials.bodies import methods
from renderers.mitsuba import variants
from renderers.mitsuba.world import World
from renderers.transport import passes as transport
from renderers.transport import regions
from renderers.transport.scattering import of_asset

SHIPPED = Path(__file__).resolve().parents[1] / "assets" / "scenes"
NULL = '<bsdf type="null"/>'
GLASS = '<bsdf type="dielectric"><float name="int_ior" value="1.4"/><float name="ext_ior" value="1"/></bsdf>'
FROST = ('<bsdf type="roughdielectric"><float name="int_ior" value="1.4"/><float name="ext_ior" value="1"/>'
         '<float name="alpha" value="0.2"/></bsdf>')
# Wang, Ge and Holzschuch 2018, table 1, and Jensen et al. 2001 (recipes/): albedo, mean free paths in mm, g
SKIN = (0.958, 0.838, 0.678), (1.29, 0.95, 0.67), 0.0
WAX = (0.980, 0.962, 0.750), (0.65, 0.63, 0.59), 0.8
MILK = (0.99987, 0.99978, 0.99889), (0.1176, 0.0934, 0.0795), 0.7
SCENE = """<scene version="3.0.0"><integrator type="{integrator}"><integer name="max_depth" value="-1"/>
<integer name="rr_depth" value="{roulette}"/></integrator>
<sensor type="perspective"><float name="fov" value="30"/><transform name="to_world"><lookat origin="0, -{far}, {up}"
target="0, 0, 0" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="{width}"/>
<integer name="height" value="{width}"/><rfilter type="box"/></film>{around}</sensor>
{body}
<shape type="rectangle"><transform name="to_world"><scale value="{floor}"/><translate z="-{low}"/></transform>
<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.5 0.5"/></bsdf></bsdf>{around}</shape>
<shape type="rectangle"><transform name="to_world"><scale value="{low}"/><rotate x="1" angle="180"/>
<translate x="{low}" y="-{low}" z="{high}"/></transform><emitter type="area"><rgb name="radiance" value="4 4 4"/></emitter>
{around}</shape>{sky}</scene>"""
SKY = '<emitter type="constant"><rgb name="radiance" value="0.3 0.35 0.4"/></emitter>'
DENSITY = np.random.default_rng(1).random((12, 13, 14)) ** 2  # of the grid: x, y, z
ROUND = sized(1 << 20, 1 << 15)  # paths of a round
EARLY, LATE = 5, 1000  # depths at which Mitsuba's roulette begins


class Body(NamedTuple):
    """albedo, free_path (3,) 1, mm;  g;  BSDF of the boundary;  mesh, a shipped file, or None: a ball;  radius : mm, of either
    region : of a medium without a boundary: everywhere, box, grid
    """

    albedo: tuple
    free_path: tuple
    g: float
    bsdf: str
    mesh: str | None = None
    radius: float = 5.0
    region: str | None = None


BODIES = {
    "thin, g 0": Body((0.9, 0.6, 0.3), (2.0, 1.6, 1.2), 0.0, NULL),
    "back, g -0.3": Body((0.95, 0.9, 0.8), (1.0, 0.8, 0.6), -0.3, NULL),
    "forward, g 0.9": Body((0.99, 0.95, 0.9), (0.5, 0.4, 0.3), 0.9, NULL),
    "lossless, g 0.5": Body((1.0, 1.0, 1.0), (1.0, 0.8, 0.6), 0.5, NULL),
    "skin, matched": Body(*SKIN, NULL, "head.ply", 40.0),
    "skin, glass": Body(*SKIN, GLASS, "head.ply", 40.0),
    "wax, matched": Body(*WAX, NULL, radius=10.0),
    "wax, rough": Body(*WAX, FROST, radius=10.0),
    "milk, matched": Body(*MILK, NULL, radius=2.0),
    "milk, glass": Body(*MILK, GLASS, radius=2.0),
    "fog everywhere": Body((0.95, 0.9, 0.8), (20.0, 16.0, 12.0), 0.5, NULL, region="everywhere"),
    "fog in a box": Body((0.95, 0.9, 0.8), (4.0, 3.0, 2.0), 0.5, NULL, region="box"),
    "cloud on a grid": Body((0.99, 0.99, 0.99), (1.0, 1.0, 1.0), 0.8, NULL, region="grid"),
}
SMALL = "thin, g 0", "wax, matched", "skin, glass", "cloud on a grid"


def written(folder, body):
    """The body's mesh, about the origin, or the grid's densities."""
    import mitsuba as mi

    if body.region:
        mi.VolumeGrid(np.ascontiguousarray(DENSITY.T, np.float32)).write(str(folder / "density.vol"))
        return
    if body.mesh is None:
        vertices, faces = icosphere(1280)
    else:
        mesh = mi.load_dict({"type": "ply", "filename": str(SHIPPED / body.mesh)})
        vertices = np.array(mesh.vertex_positions_buffer(), float).reshape(-1, 3)
        faces = np.array(mesh.faces_buffer(), np.int64).reshape(-1, 3)
        vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        vertices /= np.abs(vertices).max()
    (folder / "body.ply").write_bytes(ply.mesh(body.radius * vertices, faces))


def medium(body, kind):
    """Of Mitsuba, XML; kind : interior or exterior"""
    least = min(body.free_path)  # colours of the file may not be above 1
    sigma, albedo = (", ".join(map(repr, values)) for values in ([least / one for one in body.free_path], body.albedo))
    sigma = f'<rgb name="sigma_t" value="{sigma}"/>'
    if body.region == "grid":
        r = body.radius
        sigma = ('<volume name="sigma_t" type="gridvolume"><string name="filename" value="density.vol"/><transform '
                 f'name="to_world"><translate x="-0.5" y="-0.5" z="-0.5"/><scale value="{2 * r}"/></transform></volume>')
    return (f'<medium type="{"heterogeneous" if body.region == "grid" else "homogeneous"}" name="{kind}">{sigma}'
            f'<rgb name="albedo" value="{albedo}"/><float name="scale" value="{1 / least}"/><phase type="hg">'
            f'<float name="g" value="{body.g}"/></phase></medium>')


def scene(folder, body, width, integrator="path", roulette=LATE):
    """A file of the scene, with the medium unless the integrator is `path`."""
    r, with_medium = body.radius, integrator != "path"
    everywhere, interior = body.region == "everywhere", medium(body, "interior") if with_medium else ""
    if body.region is None:
        boundary = f'<shape type="ply" id="body"><string name="filename" value="body.ply"/>{body.bsdf}{interior}</shape>'
    elif with_medium and not everywhere:
        boundary = f'<shape type="cube"><transform name="to_world"><scale value="{r}"/></transform>{NULL}{interior}</shape>'
    else:
        boundary = ""
    path = folder / f"{integrator}.xml"
    path.write_text(SCENE.format(integrator=integrator, roulette=roulette, far=4 * r, up=1.2 * r, width=width, body=boundary,
                                 around=medium(body, "exterior") if with_medium and everywhere else "",
                                 sky="" if everywhere else SKY, floor=5 * r, low=1.02 * r, high=2.5 * r))
    return path


def ours(folder, body, width):
    """Passes of our engine: function of the number -> picture, and samples of a pass."""
    theta = np.concatenate([[0.0], np.geomspace(1e-3, np.pi, 500)])
    table = (1 - body.g**2) / (4 * np.pi * (1 + body.g**2 - 2 * body.g * np.cos(theta)) ** 1.5)
    tabulated = type("Medium", (dict,), {})(phase=np.tile(table / phase.phase_integral(theta, table), (3, 1)))
    tabulated.sigma_t, tabulated.albedo, tabulated.theta = 1e3 / np.array(body.free_path), np.array(body.albedo), theta
    asset = SimpleNamespace(medium=tabulated, stages=("medium",), wavelength=np.array([0.65, 0.55, 0.45]))
    world = World(scene(folder, body, width), unit=1e-3)
    if body.region:
        colours = SimpleNamespace(to_rgb=np.eye(3), to_waves=np.eye(3))
        part = transport.part("paths", world, [regions.Medium(region(body), of_asset(asset))], colours, 0)
    else:
        how = methods.transport_of(world, ["body"], [asset], [None], lambda number, key, message: ValueError(message), "paths")
        (part,) = methods.parts(how, "paths", "negative", 0)
    return (lambda number: part.render(number)[""]), part.samples


def region(body):
    if body.region == "everywhere":
        return regions.Everywhere()
    low, high = (np.full(3, side * 1e-3 * body.radius) for side in (-1, 1))
    return regions.Grid(low, high, DENSITY) if body.region == "grid" else regions.Box(low, high)


def theirs(folder, body, width, integrator, samples, roulette):
    import mitsuba as mi

    loaded = mi.load_file(str(scene(folder, body, width, integrator, roulette)), optimize=False)
    return lambda number: np.array(mi.render(loaded, spp=samples, seed=number), float)[..., :3]


class Engine:
    """Passes of one engine and what they took: `first`, and each of the later ones (s of processor time)."""

    def __init__(self, render):
        self.render, self.pictures, self.seconds = render, [], []
        begin = time.process_time()
        render(1 << 20)
        self.first = time.process_time() - begin

    def go(self, number, passes):
        begin = time.process_time()
        self.pictures.append(np.mean([self.render(number * passes + k) for k in range(passes)], axis=0))
        self.seconds.append(time.process_time() - begin)

    @property
    def variance(self):
        return float(np.var(self.pictures, axis=0, ddof=1).mean())

    def mean(self):
        means = np.mean(self.pictures, axis=(1, 2, 3))
        return means.mean(), means.std(ddof=1) / len(means) ** 0.5


def row(name, body, width, rounds, roulette):
    """Measures a scene, prints its row, and returns the three ratios."""
    roulette = EARLY if body.region == "everywhere" else roulette
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        written(folder, body)
        render, samples = ours(folder, body, width)
        passes = max(1, ROUND // (samples * width**2))
        engines = {"paths": Engine(render)}
        for kind in ("volpath", "volpathmis"):
            engines[kind] = Engine(theirs(folder, body, width, kind, passes * samples, roulette))
        for number in range(rounds):
            for kind, engine in engines.items():
                engine.go(number, passes if kind == "paths" else 1)
    paths = rounds * passes * samples * width**2
    took = {kind: 1e6 * sum(engine.seconds) / paths for kind, engine in engines.items()}
    best = min(("volpath", "volpathmis"), key=lambda kind: took[kind] * engines[kind].variance)
    time_ratio = took["paths"] / took["volpath"]
    variance = engines["paths"].variance / engines[best].variance
    product = variance * took["paths"] / took[best]
    reference = "volpathmis" if roulette >= LATE else "volpath"
    (mean, error), (other, its) = engines["paths"].mean(), engines[reference].mean()
    print(f"| {name} | " + " | ".join(f"{took[kind]:.2f}" for kind in engines) + " | "
          + " | ".join(f"{engine.first:.1f}" for engine in engines.values())
          + f" | {time_ratio:.2f} | {variance:.2f} ({best}) | {product:.2f} | {mean / other:.4f} "
          f"({np.hypot(error / mean, its / other):.4f}) |", flush=True)
    return time_ratio, variance, product


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=sized(128, 32))
    parser.add_argument("--rounds", type=int, default=sized(6, 3))
    parser.add_argument("--roulette", type=int, default=LATE, help="depth at which that of Mitsuba begins among bodies")
    parser.add_argument("--scenes", nargs="+", choices=BODIES, default=sized(list(BODIES), list(SMALL)))
    args = parser.parse_args()
    print(variants.activate("rgb"))
    print("| scene | paths, us | volpath | volpathmis | first, s | volpath | volpathmis | time over volpath "
          "| variance over the better | variance x time | mean |\n|" + "---|" * 11, flush=True)
    ratios = np.array([row(name, BODIES[name], args.width, args.rounds, args.roulette) for name in args.scenes])
    print("worst: time {:.2f}, variance {:.2f}, variance x time {:.2f}".format(*ratios.max(axis=0)))


if __name__ == "__main__":
    main()
