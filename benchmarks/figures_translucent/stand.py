"""What the claims share: bodies, media, methods at work for so much processor time, and how they are compared.

Of a picture only pixels that see a body count.  Its noise is the standard error of a pixel's luminance, root mean square, over
the mean, from the scatter of passes.  Its bias is measured on means over blocks of pixels, where there is less noise: the root
mean square difference from a reference, less what the noise of both brings about.
"""

import re
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

import bakery
from bakery.kernels import stream_key
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from benchmarks.sizes import SMALL, sized
from renderers import scene as scenes
from renderers.colour import LUMINANCE
from renderers.materials.bodies import methods, shells, smooth, transport
from renderers.materials.bodies.bias import CLOSER
from renderers.materials.bodies.scene import METHODS
from renderers.mitsuba.world import World
from renderers.pictures.running import Render
from renderers.scene.entries import BOUNDARIES

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "assets" / "scenes"
ALL, SCATTERED, SECOND, LATER = "all", "one", "two", "three"  # light; of so many events and more
LAYERS = {ALL: ("",), SCATTERED: ("order1", "order2", "orders"), SECOND: ("order2", "orders"), LATER: ("orders",)}
BLOCKS = 8  # along a side of a picture
FEWEST = sized(3, 2)  # passes
RECIPE = """bakery: 1
name: {name}
wavelengths: {wavelengths}
tolerance: TOLERANCE
medium: {{albedo: {albedo}, mean_free_path: 1 mm, phase: {{type: hg, g: {g}}}}}
multiple_scattering: {{sources: [point, segment], tolerance: TOLERANCE}}
""".replace("TOLERANCE", sized("1%", "20%"))
SENSOR = """<sensor type="perspective"><float name="fov" value="34"/><transform name="to_world"><lookat origin="0, -3.8, 1"
target="0, 0, 0" up="0, 0, 1"/></transform><film type="hdrfilm"><rfilter type="box"/></film></sensor>"""
CAUSTIC_SENSOR = SENSOR.replace("0, -3.8, 1", "0, -7, -1.5").replace("0, 0, 0", "0, 0, -1.8")
PANEL = """<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><translate x="0.6" y="-0.6" z="2.6"/>
</transform><emitter type="area"><rgb name="radiance" value="4 4 4"/></emitter></shape>"""
SKY = '<emitter type="constant"><rgb name="radiance" value="1 1 1"/></emitter>'


def every_method():
    """Names of all methods, with boundaries where there is a choice: "vrl+tables" is negative, "vrl+tables, none" without."""
    each = [name for name, method in METHODS.items() if not (method.candidates or method.surface)]
    return [name if boundary == "negative" else f"{name}, {boundary}" for name in each
            for boundary in (BOUNDARIES if "tables" in name else ("negative",))]


@cache
def folder() -> Path:
    """Where assets and pictures go."""
    made = Path(tempfile.gettempdir()) / "figures_translucent"
    made.mkdir(exist_ok=True)
    return made


@cache
def medium(albedo, g):
    """The asset, of a mean free path of 1 mm, of an albedo: one, or a tuple of those of red, green, blue."""
    colours = isinstance(albedo, tuple)
    name = "m" + f"{albedo}_{g}".translate(str.maketrans("., ", "__-", "()"))
    recipe = folder() / f"{name}.yaml"
    recipe.write_text(RECIPE.format(name=name, wavelengths="rgb" if colours else "[0.55]",
                                    albedo=list(albedo) if colours else albedo, g=g))
    made = folder() / f"{name}.h5"
    bakery.bake(recipe, output=made)
    return bakery.open(made)


def shipped(name, size, changes=()):
    """Light in a shipped scene, `setup.Transport`, after changes (pattern, what takes its place) of its XML."""
    job = Render(scenes.load(SCENES / f"{name}.yaml", {"method": "vrl+tables"}), folder() / f"{name}.png", overwrite=True)
    values, text = job.scene.values, (SCENES / f"{name}.xml").read_text(encoding="utf-8")
    for pattern, other in [(r'"filename" value="', f'"filename" value="{SCENES}/'), *changes]:
        text, count = re.subn(pattern, other, text)
        if not count:
            raise ValueError(f"{name}.xml has no {pattern}")
    (folder() / f"{name}.xml").write_text(text, encoding="utf-8")
    world = World(folder() / f"{name}.xml", values.scene.unit, size=(size, size))
    return _transport(world, [one.where.shape for one in values.materials], job.assets)


def ball(asset, index, size, around=PANEL + SKY):
    """Light in a ball of radius 1 mm, one mean free path of an asset of `medium`."""
    vertices, faces = icosphere(1280)
    (folder() / "ball.ply").write_bytes(ply.mesh(vertices, faces))
    bsdf = '<bsdf type="null"/>' if index == 1 else (f'<bsdf type="dielectric"><float name="int_ior" value="{index}"/>'
                                                     '<float name="ext_ior" value="1"/></bsdf>')
    body = f'<shape type="ply" id="ball"><string name="filename" value="ball.ply"/>{bsdf}</shape>'
    (folder() / "ball.xml").write_text(f'<scene version="3.0.0">{SENSOR}{body}{around}</scene>')
    return _transport(World(folder() / "ball.xml", 1e-3, size=(size, size)), ["ball"], [asset])


def caustic(asset, size):
    """Light of a small lamp that a glass ball focuses into a box of fog beneath: 4 mm wide, two mean free paths of an asset of
    `medium` deep.  A black plate around the ball lets no other light in."""
    around = np.linspace(0.0, 2 * np.pi, 129)[:-1]
    ring = np.concatenate([np.c_[r * np.cos(around), r * np.sin(around), 0 * around] for r in (0.5, 20.0)])
    inner = np.arange(128)
    after = (inner + 1) % 128
    corners = np.array([[x, y, z] for z in (-2.8, -0.8) for y in (-2.0, 2.0) for x in (-2.0, 2.0)])
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    vertices, faces = icosphere(5120)
    meshes = {"fog": (corners, np.array([[(a, b, c), (a, c, d)] for a, b, c, d in sides]).reshape(-1, 3)),
              "glass": (0.5 * vertices, faces),
              "plate": (ring, np.concatenate([np.c_[inner, inner + 128, after], np.c_[after, inner + 128, after + 128]]))}
    bsdfs = {"fog": '<bsdf type="null"/>', "glass": '<bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf>',
             "plate": '<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf>'}
    for name, mesh in meshes.items():
        (folder() / f"{name}.ply").write_bytes(ply.mesh(*mesh))
    shapes = "".join(f'<shape type="ply" id="{name}"><string name="filename" value="{name}.ply"/>'
                     f'<boolean name="face_normals" value="{"false" if name == "glass" else "true"}"/>{bsdf}</shape>'
                     for name, bsdf in bsdfs.items())
    lamp = ('<shape type="sphere"><point name="center" x="0" y="0" z="2"/><float name="radius" value="0.3"/>'
            '<emitter type="area"><rgb name="radiance" value="400 400 400"/></emitter></shape>')
    (folder() / "caustic.xml").write_text(f'<scene version="3.0.0">{CAUSTIC_SENSOR}{shapes}{lamp}</scene>')
    return _transport(World(folder() / "caustic.xml", 1e-3, size=(size, size)), ["fog"], [asset])


def _transport(world, bodies, assets):
    return methods.transport_of(world, bodies, assets, [None] * len(bodies), lambda number, key, message: ValueError(message))


def thicker(how, factor):
    """The same with mean free paths so many times shorter."""
    return how._replace(bodies=[body._replace(medium=body.medium._replace(sigma_t=factor * body.medium.sigma_t))
                                for body in how.bodies])


class Found(NamedTuple):
    """What a method has found of the light of a layer.

    mean, square : (B,) luminance of each block, and its variance;  pixels : (B,) in each block
    total, error : mean over all pixels, and its standard error
    seconds : of processor time until the noise of a pixel is 1 %, kinds of passes at the best division
    noise : of a pixel, now, 1
    image : (H, W, 3), passes so far
    """

    mean: np.ndarray
    square: np.ndarray
    pixels: np.ndarray
    total: float
    error: float
    seconds: float
    noise: float
    image: np.ndarray


class Passes:
    """Of one kind; `block` (H, W) is the number of each pixel's block, -1 where it does not count."""

    def __init__(self, part, block):
        self.render, self.samples, self.block, self.seen = part.render, part.samples, block[block >= 0], block >= 0
        self.pixels = np.bincount(self.block)
        self.count, self.seconds, self.images, self.squares, self.blocks = 0, 0.0, {}, {}, {name: [] for name in LAYERS}
        self.closer = dict.fromkeys(CLOSER, 0.0)
        if not SMALL:
            self.render(10**6)  # compiles, and finds where light comes in

    def go_on(self, until):
        """Renders until so many processor seconds are spent in all, `FEWEST` passes at least."""
        while self.seconds < until or self.count < FEWEST:
            begin = time.process_time()
            layers = self.render(self.count)
            self.seconds, self.count = self.seconds + time.process_time() - begin, self.count + 1
            for name, means in self.blocks.items():
                image = sum((layers[one] for one in LAYERS[name] if one in layers), np.zeros_like(layers[""]))
                light = (image @ LUMINANCE)[self.seen]
                self.images[name], self.squares[name] = self.images.get(name, 0) + image, self.squares.get(name, 0) + light**2
                means.append(np.bincount(self.block, light) / np.maximum(self.pixels, 1))
            for name in self.closer.keys() & layers.keys():
                self.closer[name] += (layers[name] @ LUMINANCE)[self.seen]

    def loss(self):
        """Luminance of a pixel that sharing loses, root mean square, by what half the distance changes (loss goes with its power
        2.7: `smooth`): of the product of even and odd passes, in which noise cancels."""
        odd = self.count // 2
        product = float(np.mean(self.closer[CLOSER[0]] * self.closer[CLOSER[1]])) / (odd * (self.count - odd))
        return max(product, 0.0) ** 0.5 / (1 - 0.5**2.7)

    def variance(self, name):
        """Of a pixel in a pass, mean of all."""
        mean = (self.images[name] @ LUMINANCE)[self.seen] / self.count
        return float(np.mean(self.squares[name] / self.count - mean**2)) * self.count / (self.count - 1)


class Run:
    """A method, or kinds of passes, at work in a scene."""

    def __init__(self, how, method, seed=0, kinds=None):
        """kinds : names of parts that are rendered; all if None"""
        name, _, boundary = method.partition(", ")
        if name == "shells":
            how = shells.laid(how)
        block = blocks(how)
        self.parts = [Passes(part, block) for part in methods.parts(how, name, boundary or "negative", seed)
                      if kinds is None or part.name in kinds]

    def go_on(self, until):
        """Until so many processor seconds are spent, in equal shares."""
        for part in self.parts:
            part.go_on(until / len(self.parts))

    def found(self, name=ALL, more=None) -> Found:
        """Of a layer; with the parts of another run, if `more` is one."""
        parts = self.parts + (more.parts if more else [])
        pixels = parts[0].pixels
        means = [np.array(part.blocks[name]) for part in parts]
        totals = [values @ pixels / pixels.sum() for values in means]
        total = sum(one.mean() for one in totals)
        scale = max(total, 1e-300)
        spread = sum(np.sqrt(part.variance(name) * part.seconds / part.count) for part in parts)
        return Found(sum(values.mean(axis=0) for values in means),
                     sum(values.var(axis=0, ddof=1) / len(values) for values in means), pixels, total,
                     float(np.sqrt(sum(one.var(ddof=1) / len(one) for one in totals))), float((spread / scale / 0.01) ** 2),
                     float(np.sqrt(sum(part.variance(name) / part.count for part in parts)) / scale),
                     sum(part.images[name] / part.count for part in parts))


def blocks(how):
    """(H, W) number of each pixel's block, -1 where it sees no body."""
    height, width = how.world.size
    seen = smooth.seen(how, transport.begin(how, np.arange(height * width), stream_key(0, "render.translucent", 0))).body >= 0
    y, x = np.indices(seen.shape)
    _, number = np.unique((y * BLOCKS // height * BLOCKS + x * BLOCKS // width)[seen], return_inverse=True)
    found = np.full(seen.shape, -1)
    found[seen] = number
    return found


def together(runs, seconds, rounds=4):
    """Runs by name, each for its processor seconds, in rounds that take turns."""
    for number in range(1, rounds + 1):
        for name, run in runs.items():
            run.go_on(seconds[name] * number / rounds)


def ratio(found, reference):
    """Of mean luminances, and its standard error."""
    if found.total == reference.total:
        return 1.0, 0.0  # both dark
    if reference.total == 0:
        return np.inf, np.inf
    value = found.total / reference.total
    return value, np.hypot(found.error, value * reference.error) / abs(reference.total)


def bias(found, reference):
    """Root mean square difference of blocks, relative to the mean, noise taken away, and between what it is in 18 of 20 cases."""
    weight, noise = found.pixels / found.pixels.sum(), found.square + reference.square
    square = weight @ ((found.mean - reference.mean) ** 2 - noise)
    # of independent blocks with normal noise
    error = np.sqrt(weight**2 @ (2 * noise**2 + 4 * noise * max(square, 0.0)))
    return tuple(float(np.sqrt(max(one, 0.0)) / abs(reference.total))
                 for one in (square, square - 1.64 * error, square + 1.64 * error))


def over(value, error, digits=3):
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def of_bias(value, least, most):
    """Text, %."""
    return f"{100 * value:.1f} ({100 * least:.1f} to {100 * most:.1f})" if least > 0 else f"< {100 * most:.1f}"


def of_seconds(value):
    """Text of two digits."""
    return f"{float(f'{value:.2g}'):g}"


def shown(image, white):
    """(H, W, 3) of 0 to 1."""
    return np.clip(image / white, 0, 1) ** (1 / 2.2)


def conditions(size, seconds=None, share=1.0):
    """A sentence under a table."""
    said = "; ".join(f"`{name}` {share * one:g}" for name, one in (seconds or {}).items())
    return f"{size} x {size} pixels" + (f", processor seconds: {said}." if said else ".")
