"""Light samples along flights through thin media: `paths` with and without them, and Mitsuba's volume integrators.

    python benchmarks/haze.py [--small] [--width 96] [--rounds 16] [--depths 0.1 1] [--scenes NAME ...]

A floor and a wall in a haze of three wavelengths (albedo 0.95 to 0.8, g 0.6) that fills all, a box or a matched ball, under a
point lamp, a small sphere that shines above the frame (the edge of a lamp in it is as noisy by any method), six of these, a spot
lamp, panels, or an even sky (which a medium everywhere would hide).  Optical depths are those of the middle wavelength along 20,
the way of the camera to the middle.  Engines render in turns, 16 samples a pixel and round; Mitsuba's roulette begins at depth
1000, but at 5 in what has no end.  A row a scene: `auto`, what it does by itself; processor time of a path; variance of a pixel
(mean square over colours and picture) with over without light samples along flights, and times the time; variance times time over
the better of `volpath` and `volpathmis`, with and without; differences of the means in standard errors.
--small: one scene, 16 pixels wide, four rounds.
"""

import argparse
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from bakery.physics.medium import phase
from benchmarks.lamps import SAMPLES, Engine, _apart
from benchmarks.sizes import sized
from renderers.mitsuba import variants
from renderers.mitsuba.world import World
from renderers.transport import passes, regions
from renderers.transport.scattering import of_asset

COLOURS = SimpleNamespace(to_rgb=np.eye(3), to_waves=np.eye(3))
FAR, ALBEDO, G = 20.0, (0.95, 0.9, 0.8), 0.6
RELATIVE = (0.8, 1.0, 1.3)  # extinction of the wavelengths
NULL = '<bsdf type="null"/>'
LOW, HIGH = (-9.0, -9.0, -2.9), (9.0, 9.0, 8.0)
GREY = '<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.5 0.5"/></bsdf></bsdf>'
SCENE = """<scene version="3.0.0">INTEGRATOR<sensor type="perspective"><float name="fov" value="34"/><transform name="to_world">
<lookat origin="0, -20, 2" target="0, 0, 0" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="WIDTH"/>
<integer name="height" value="WIDTH"/><rfilter type="box"/></film>OUTSIDE</sensor>
<shape type="rectangle"><transform name="to_world"><scale value="60"/><translate z="-3"/></transform>GREY OUTSIDE</shape>
<shape type="rectangle"><transform name="to_world"><scale value="60"/><rotate x="1" angle="90"/><translate y="10"/></transform>
GREY OUTSIDE</shape>LIGHT</scene>"""
POINT = '<emitter type="point"><point name="position" x="1" y="-3" z="2"/><rgb name="intensity" value="40 36 30"/></emitter>'
SPOT = """<emitter type="spot"><transform name="to_world"><lookat origin="3, -3, 5" target="-2, 0, -3" up="0, 1, 0"/></transform>
<float name="cutoff_angle" value="25"/><rgb name="intensity" value="200 180 150"/></emitter>"""
BULB = """<shape type="sphere"><point name="center" x="X" y="Y" z="6.5"/><float name="radius" value="0.1"/>OUTSIDE
<emitter type="area"><rgb name="radiance" value="800 720 600"/></emitter></shape>"""
PANEL = """<shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate x="1" angle="180"/><translate z="5.5"/>
</transform>OUTSIDE<emitter type="area"><rgb name="radiance" value="4 4 4"/></emitter></shape>"""
SKY = '<emitter type="constant"><rgb name="radiance" value="0.8 0.9 1"/></emitter>'
BULBS = "".join(BULB.replace("X", f"{3 * (k % 3) - 3}").replace("Y", f"{6 * (k // 3) - 4}") for k in range(6))
ONE = BULB.replace("X", "1").replace("Y", "-3")
# lights, and where the medium is
SCENES = {"point lamp": (POINT, "everywhere"), "small lamp": (ONE, "everywhere"), "six lamps": (BULBS, "everywhere"),
          "spot lamp": (SPOT, "everywhere"), "panel": (PANEL, "everywhere"),
          "small panel": (PANEL.replace('value="3"', 'value="0.5"').replace("4 4 4", "120 120 120"), "everywhere"),
          "point lamp, box": (POINT, "box"), "small lamp, box": (ONE, "box"), "sky, box": (SKY, "box"),
          "sky and lamp, box": (SKY + POINT, "box"), "small lamp, ball": (ONE, "ball"), "sky, ball": (SKY, "ball")}


def scatterer(depth):
    theta = np.concatenate([[0.0], np.geomspace(1e-3, np.pi, 500)])
    table = (1 - G**2) / (4 * np.pi * (1 + G**2 - 2 * G * np.cos(theta)) ** 1.5)
    medium = type("Medium", (dict,), {})(phase=np.tile(table / phase.phase_integral(theta, table), (3, 1)))
    medium.sigma_t, medium.albedo, medium.theta = depth / FAR * np.array(RELATIVE), np.array(ALBEDO), theta
    return of_asset(SimpleNamespace(medium=medium, stages=("medium",), wavelength=np.array([0.65, 0.55, 0.45])))


def theirs(depth, kind):
    """Of Mitsuba, XML; kind : interior or exterior"""
    values = ", ".join(str(value / max(RELATIVE)) for value in RELATIVE)
    return (f'<medium type="homogeneous" name="{kind}"><rgb name="sigma_t" value="{values}"/><rgb name="albedo" value='
            f'"{", ".join(map(str, ALBEDO))}"/><float name="scale" value="{depth / FAR * max(RELATIVE)!r}"/><phase type="hg">'
            f'<float name="g" value="{G}"/></phase></medium>')


def text_of(name, depth, width, integrator="path"):
    light, where = SCENES[name]
    with_medium = integrator != "path"
    (x, y, z), (u, v, w) = ((np.array(HIGH) - LOW) / 2, (np.array(HIGH) + LOW) / 2)
    inside = theirs(depth, "interior") if with_medium else ""
    bounds = {"box": f'<shape type="cube"><transform name="to_world"><scale x="{x}" y="{y}" z="{z}"/><translate x="{u}" y="{v}" '
                     f'z="{w}"/></transform>{NULL}{inside}</shape>',
              "ball": f'<shape type="ply" id="ball"><string name="filename" value="ball.ply"/>{NULL}{inside}</shape>'}
    light = light + (bounds.get(where, "") if with_medium or where == "ball" else "")
    roulette = 5 if where == "everywhere" else 1000
    depths = f'<integer name="max_depth" value="-1"/><integer name="rr_depth" value="{roulette}"/>' if with_medium else ""
    outside = theirs(depth, "exterior") if with_medium and where == "everywhere" else ""
    text = SCENE.replace("INTEGRATOR", f'<integrator type="{integrator}">{depths}</integrator>').replace("LIGHT", light)
    return text.replace("WIDTH", str(width)).replace("GREY", GREY).replace("OUTSIDE", outside)


def scene_of(folder, name, depth, width):
    """World and medium."""
    (folder / "path.xml").write_text(text_of(name, depth, width))
    world, medium, where = World(folder / "path.xml"), scatterer(depth), SCENES[name][1]
    if where == "ball":
        vertices, faces = ball()
        entry = SimpleNamespace(name="ball", vertices=vertices.astype(np.float32).astype(float), faces=faces, medium=medium,
                                matched=True)
    else:
        entry = regions.Medium(regions.Everywhere() if where == "everywhere" else regions.Box(LOW, HIGH), medium)
    return world, entry


def ours(folder, name, depth, width, along):
    """Passes of `paths`, function of a number -> its picture, alone in an axis."""
    from renderers.transport import thin

    world, entry = scene_of(folder, name, depth, width)
    part = passes.part("paths", world, [entry], COLOURS, int(along))  # two seeds: their means are compared
    limits = thin.THICKEST, thin.LARGEST, thin.LEAST
    try:
        thin.THICKEST, thin.LARGEST, thin.LEAST = (np.inf, np.inf, 0.0) if along else (0.0, 0.0, 0.0)
        part.render(1 << 20)  # compiles
    finally:
        thin.THICKEST, thin.LARGEST, thin.LEAST = limits
    count = max(1, SAMPLES // part.samples)
    return lambda number: np.mean([part.render(number * count + k)[""] for k in range(count)], axis=0)[None]


def decided(folder, name, depth, width):
    """Whether the scene takes light samples along flights by itself."""
    from renderers.transport.scene import Scene

    world, entry = scene_of(folder, name, depth, width)
    return Scene(world, [entry], COLOURS).airlight is not None


def ball():
    from bakery.physics.shapes.radial import icosphere

    vertices, faces = icosphere(1280)
    return 5.9 * vertices + (0, 0, 3), faces


def row(name, depth, width, rounds):
    """Measures a scene and prints its row."""
    import mitsuba as mi

    from bakery.store import ply

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "ball.ply").write_bytes(ply.mesh(*ball()))
        engines = {"with": Engine(ours(folder, name, depth, width, True)),
                   "without": Engine(ours(folder, name, depth, width, False))}
        for kind in ("volpath", "volpathmis"):
            (folder / f"{kind}.xml").write_text(text_of(name, depth, width, kind))
            loaded = mi.load_file(str(folder / f"{kind}.xml"), optimize=False)
            engines[kind] = Engine(lambda number, loaded=loaded: np.array(
                mi.render(loaded, spp=SAMPLES, seed=number), float)[None, ..., :3])
        auto = "with" if decided(folder, name, depth, width) else "without"
        for number in range(rounds):
            for engine in engines.values():
                engine.go(number)
    product = {kind: engine.variance[0] * engine.seconds for kind, engine in engines.items()}
    best = min(("volpath", "volpathmis"), key=product.get)
    first, second = engines["with"], engines["without"]
    apart = [_apart(first.mean(), engines[kind].mean())[0] for kind in ("without", best)]
    seconds = [1e6 * engine.seconds / rounds / SAMPLES / width**2 for engine in engines.values()]
    print(f"| {name} | {depth:g} | {auto} | " + " | ".join(f"{value:.2f}" for value in seconds)
          + f" | {first.variance[0] / second.variance[0]:.4f} | {product['with'] / product['without']:.4f} | "
          f"{product['with'] / product[best]:.4f} | {product['without'] / product[best]:.4f} ({best}) | "
          + " | ".join(f"{value:+.1f}" for value in apart) + " |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=sized(96, 16))
    parser.add_argument("--rounds", type=int, default=sized(16, 4))
    parser.add_argument("--depths", type=float, nargs="+", default=sized([0.1, 1.0], [0.3]))
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=sized(list(SCENES), ["point lamp"]))
    args = parser.parse_args()
    print(variants.activate("rgb"))
    print("| scene | depth | auto | with, us | without | volpath | volpathmis | variance, with over without | times time "
          "| with, over Mitsuba's better | without | apart | apart from Mitsuba's |\n|" + "---|" * 13, flush=True)
    for name in args.scenes:
        for depth in args.depths:
            row(name, depth, args.width, args.rounds)


if __name__ == "__main__":
    main()
