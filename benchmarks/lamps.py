"""Light samples of lamps through boundaries of bodies: `paths` with and without them, and Mitsuba's volume integrators.

    python benchmarks/lamps.py [--small] [--width 128] [--rounds 24] [--scenes NAME ...]

Shipped scenes with media of published wax and skin and of dilute milk (in a tumbler), and a ball of glass (index 1.4, radius
5) under a sphere of radius 0.6, with and without a pane between them, or under a panel; such balls of rough glass.  Engines
render in turns: 16 samples a pixel and round; Mitsuba's roulette begins at depth 1000.  A row a scene and order of
scattering: variance of a pixel (mean square over colours and picture), processor time, and their product, with light samples
over without; the difference of both means in standard errors; of the whole picture also the product over that of the better of
`volpath` and `volpathmis`, and the difference from it.
What no body scatters (`order0`: edges and reflections of lamps, caustics) has the same variance in both, so that of the whole
picture falls less.  Samples in strata and reflections that are drawn more often (`strata`, `splitting` in `renderers/transport/`)
are in both.  Rare bright pixels, where lamps are met by chance, make variances without light samples uncertain: too low where
none was among the rounds.
--small: one scene, 32 pixels wide, four rounds.
"""

import argparse
import re
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from bakery.physics.medium import phase
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from benchmarks.sizes import sized
from benchmarks.transport import FROST, GLASS, LATE, SHIPPED, SKIN, WAX, Body, medium
from renderers.materials.bodies import methods
from renderers.mitsuba import variants
from renderers.mitsuba.world import World

LAYERS = ("order0", "order1", "order2", "orders", "")
SAMPLES = 16  # of a pixel and round
BALL = """<scene version="3.0.0"><integrator type="path"/>
<sensor type="perspective"><float name="fov" value="34"/><transform name="to_world"><lookat origin="0, -19, 5" target="0, 0, 0"
up="0, 0, 1"/></transform><film type="hdrfilm"><rfilter type="box"/></film></sensor>
<shape type="ply" id="ball"> <string name="filename" value="ball.ply"/>GLASS</shape>
<shape type="rectangle"><transform name="to_world"><scale value="12"/><translate z="-6"/></transform>
<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.5 0.5"/></bsdf></bsdf></shape>LAMP</scene>
""".replace("GLASS", GLASS)
SPHERE = """<shape type="sphere"><point name="center" x="3" y="-4" z="8"/><float name="radius" value="0.6"/>
<emitter type="area"><rgb name="radiance" value="100 100 100"/></emitter></shape>"""
PANEL = """<shape type="rectangle"><transform name="to_world"><scale value="SIZE"/><rotate x="1" angle="180"/>
<translate x="3" y="-3" z="13"/></transform><emitter type="area"><rgb name="radiance" value="4 4 4"/></emitter></shape>"""
# the sun is 0.54 degrees wide
SUNSKY = """<emitter type="sunsky"><vector name="sun_direction" value="-0.5 -0.4 0.7"/>
<float name="sun_scale" value="0.05"/><float name="sky_scale" value="0.05"/></emitter>"""
MILK = (0.999, 0.999, 0.999), (0.84, 0.75, 0.68), 0.7  # diluted, recipes/milk_dilute.yaml
PANE = """<shape type="cube"><transform name="to_world"><scale x="9" y="9" z="0.25"/><translate z="6.3"/></transform>
<bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf></shape>"""
SOAP = (0.962, 0.895, 0.892), (2.67, 2.30, 1.75), 0.8  # recipes/soap.yaml
GREY = (0.95, 0.9, 0.8), (1.0, 1.2, 1.5), 0.0
ROUGH = {f"rough {alpha}": FROST.replace('"0.2"', f'"{alpha}"') for alpha in (0.05, 0.1, 0.3)}
# XML, or the name of a file;  shape;  medium, free paths in mm
SCENES = {
    "small sphere": (BALL.replace("LAMP", SPHERE), "ball", Body(*GREY, GLASS)),
    "behind a pane": (BALL.replace("LAMP", SPHERE + PANE), "ball", Body(*GREY, GLASS)),
    "panel": (BALL.replace("LAMP", PANEL.replace("SIZE", "5")), "ball", Body(*GREY, GLASS)),
    "wide panel": (BALL.replace("LAMP", PANEL.replace("SIZE", "30")), "ball", Body(*GREY, GLASS)),
    **{name: (BALL.replace(GLASS, bsdf).replace("LAMP", SPHERE), "ball", Body(*GREY, bsdf)) for name, bsdf in ROUGH.items()},
    "rough wax": (BALL.replace(GLASS, ROUGH["rough 0.1"]).replace("LAMP", SPHERE), "ball", Body(*WAX, ROUGH["rough 0.1"])),
    "rough, panel": (BALL.replace(GLASS, ROUGH["rough 0.1"]).replace("LAMP", PANEL.replace("SIZE", "5")), "ball",
                     Body(*GREY, ROUGH["rough 0.1"])),
    "rough, wide panel": (BALL.replace(GLASS, ROUGH["rough 0.1"]).replace("LAMP", PANEL.replace("SIZE", "30")), "ball",
                          Body(*GREY, ROUGH["rough 0.1"])),
    "candle": ("candle.xml", "candle", Body(*WAX, GLASS)),
    "candle_ball": ("candle_ball.xml", "candle", Body(*WAX, GLASS)),
    "bumpy_ball": ("bumpy_ball.xml", "ball", Body((0.95, 0.9, 0.7), (4.0, 4.0, 4.0), 0.5, GLASS)),
    "soap_and_lamp": ("soap_and_lamp.xml", "soap", Body(*SOAP, FROST)),
    "head": ("head.xml", "head", Body(*SKIN, GLASS)),
    "glass_of_milk": ("glass_of_milk.xml", "milk", Body(*MILK, GLASS)),
    "milk, small window": ("glass_of_milk.xml", "milk", Body(*MILK, GLASS)),
    "ball in the sun": (BALL.replace("LAMP", SUNSKY), "ball", Body(*GREY, GLASS)),
    "milk in the sun": ("glass_of_milk.xml", "milk", Body(*MILK, GLASS)),
}
# of a window of 220 mm x 220 mm, which is wider, and an even sky: 120 mm x 120 mm, brighter, and less sky
SMALL_WINDOW = {'"110, 110, 1"/> <lookat origin="-150, -30, 150"': '"60, 60, 1"/> <lookat origin="-130, -40, 140"',
                "5, 5, 4.85": "8, 8, 7.7", "0.34, 0.365, 0.39": "0.24, 0.26, 0.28"}


def text_of(name):
    """XML of a scene, with whole paths of the files that it names."""
    xml = SCENES[name][0]
    if xml.endswith(".xml"):
        xml = (SHIPPED / xml).read_text()
        xml = re.sub(r'name="filename" value="([^"]*)"', lambda match: f'name="filename" value="{SHIPPED / match[1]}"', xml)
    if name == "milk in the sun":
        xml = re.sub('<shape type="rectangle" id="window">.*?</shape>', SUNSKY, xml)
        xml = re.sub('<emitter type="constant".*?</emitter>', "", xml)
    for wide, small in SMALL_WINDOW.items() if "small window" in name else ():
        xml = xml.replace(wide, small)
    return xml


def ours(folder, name, width, drawn):
    """Passes of `paths`, functions of a number -> layers."""
    from renderers.transport import scene

    _, shape, body = SCENES[name]
    theta = np.concatenate([[0.0], np.geomspace(1e-3, np.pi, 500)])
    table = (1 - body.g**2) / (4 * np.pi * (1 + body.g**2 - 2 * body.g * np.cos(theta)) ** 1.5)
    tabulated = type("Medium", (dict,), {})(phase=np.tile(table / phase.phase_integral(theta, table), (3, 1)))
    tabulated.sigma_t, tabulated.albedo, tabulated.theta = 1e3 / np.array(body.free_path), np.array(body.albedo), theta
    asset = SimpleNamespace(medium=tabulated, stages=("medium",), wavelength=np.array([0.65, 0.55, 0.45]))
    (folder / "path.xml").write_text(text_of(name))
    world = World(folder / "path.xml", unit=1e-3, size=(width, width))
    how = methods.transport_of(world, [shape], [asset], [None], lambda number, key, message: ValueError(message), "paths")
    # two seeds: their means are compared
    (part,) = methods.parts(how, "paths", "negative", int(drawn))
    samples = scene.samples
    try:
        scene.samples = samples if drawn else lambda *arguments: None
        part.render(1 << 20)  # compiles
    finally:
        scene.samples = samples
    passes = max(1, SAMPLES // part.samples)

    def render(number):
        layers = [part.render(number * passes + k) for k in range(passes)]
        return np.array([np.mean([one[layer] for one in layers], axis=0) for layer in LAYERS])

    return render


def theirs(folder, name, width, integrator):
    """Passes of an integrator of Mitsuba: the picture alone."""
    import mitsuba as mi

    _, shape, body = SCENES[name]
    depths = f'<integer name="max_depth" value="-1"/><integer name="rr_depth" value="{LATE}"/>'
    xml = text_of(name).replace('<integrator type="path"/>', f'<integrator type="{integrator}">{depths}</integrator>')
    xml = xml.replace(f'id="{shape}">', f'id="{shape}">{medium(body, "interior")}')
    xml = re.sub(r'<film type="hdrfilm">.*?</film>', f'<film type="hdrfilm"><integer name="width" value="{width}"/><integer '
                 f'name="height" value="{width}"/><rfilter type="box"/></film>', xml, flags=re.DOTALL)
    (folder / f"{integrator}.xml").write_text(xml)
    loaded = mi.load_file(str(folder / f"{integrator}.xml"), optimize=False)
    return lambda number: np.array(mi.render(loaded, spp=SAMPLES, seed=number), float)[None, ..., :3]


class Engine:
    """Rounds of one engine: sums, sums of squares, means (rounds, layers), processor time in s."""

    def __init__(self, render):
        self._render, self.means, self.seconds, self._sum, self._square = render, [], 0.0, 0.0, 0.0
        render(1 << 16)  # compiles

    def go(self, number):
        begin = time.process_time()
        layers = self._render(number)
        self.seconds += time.process_time() - begin
        self._sum, self._square = self._sum + layers, self._square + layers**2
        self.means.append(layers.mean(axis=(1, 2, 3)))

    @property
    def variance(self):
        return self._by_pixel().mean(axis=(1, 2, 3))

    @property
    def of_few(self):
        """Share of the variance of the picture that 1 % of the pixels have."""
        pixels = np.sort(self._by_pixel()[-1].sum(axis=-1), axis=None)
        return pixels[-max(1, len(pixels) // 100):].sum() / pixels.sum()

    def _by_pixel(self):
        n = len(self.means)
        return (self._square - self._sum**2 / n) / (n - 1)

    def mean(self):
        return np.mean(self.means, axis=0), np.std(self.means, axis=0, ddof=1) / len(self.means) ** 0.5


def rows(name, width, rounds):
    """Measures a scene and prints its rows."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        vertices, faces = icosphere(1280)
        (folder / "ball.ply").write_bytes(ply.mesh(5 * vertices, faces))
        engines = {"with": Engine(ours(folder, name, width, True)), "without": Engine(ours(folder, name, width, False))}
        engines |= {kind: Engine(theirs(folder, name, width, kind)) for kind in ("volpath", "volpathmis")}
        for number in range(rounds):
            for engine in engines.values():
                engine.go(number)
    drawn, by_chance = engines["with"], engines["without"]
    slower, variance = drawn.seconds / by_chance.seconds, drawn.variance / by_chance.variance
    best = min(("volpath", "volpathmis"), key=lambda kind: engines[kind].variance[-1] * engines[kind].seconds)
    product = drawn.variance[-1] * drawn.seconds / (engines[best].variance[-1] * engines[best].seconds)
    before = by_chance.variance[-1] * by_chance.seconds / (engines[best].variance[-1] * engines[best].seconds)
    apart = _apart(drawn.mean(), by_chance.mean())
    for k, layer in enumerate(LAYERS):
        peer = f"{product:.3f} ({before:.3f} without; {best})" if k == len(LAYERS) - 1 else ""
        other = f"{_apart([part[-1:] for part in drawn.mean()], engines[best].mean())[0]:+.1f}" if peer else ""
        print(f"| {name} | {layer or 'all'} | {variance[k]:.4f} | {slower:.2f} | {variance[k] * slower:.4f} | {apart[k]:+.1f} | "
              f"{peer} | {other} |", flush=True)
    for kind, engine in engines.items():
        time_of_path = engine.seconds / rounds / SAMPLES / width**2 * 1e6
        print(f"{name}, {kind}: {time_of_path:.2f} us a path, variance {engine.variance[-1]:.4g}, "
              f"{100 * engine.of_few:.0f} % of it in 1 % of the pixels", flush=True)


def _apart(first, second):
    return (first[0] - second[0]) / np.maximum(np.hypot(first[1], second[1]), 1e-300)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=sized(128, 32))
    parser.add_argument("--rounds", type=int, default=sized(24, 4))
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=sized(list(SCENES), ["small sphere"]))
    args = parser.parse_args()
    print(variants.activate("rgb"))
    print("| scene | light | variance | time | variance x time | means apart | over Mitsuba's better | apart |\n|" + "---|" * 8,
          flush=True)
    for name in args.scenes:
        rows(name, args.width, args.rounds)


if __name__ == "__main__":
    main()
