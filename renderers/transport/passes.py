"""Pictures by paths of the loop: its passes, as `renderers.pictures.progressive` takes them."""

from functools import cache, partial
from types import MappingProxyType

import drjit as dr
import numpy as np

from bakery.kernels import stream_key
from renderers.mitsuba import variants
from renderers.mitsuba.recording import undisturbed
from renderers.pictures.engine import Part, by_samples, layers_of
from renderers.transport import loop
from renderers.transport.scene import Scene
from renderers.transport.state import Numbers
from renderers.transport.wavefront import ORDERS

_PATHS = 1 << 20  # of a pass, at most, where a pixel has several: one to three seconds of a core
_ON_GPU = 4  # times as many there: what processors do for a pass, a tenth of a second, has nothing to do with their number
_SAMPLES = 16  # a pixel and pass, at most: the noise of small pictures is known from several passes


def part(name, world, entries, colours, seed, by_light=False, far=MappingProxyType({}), most=None, shared=False) -> Part:
    """Passes of paths through continuous media, bodies among them, and over the surfaces and lights of a scene.

    Parameters
    ----------
    name : of the part
    world : `renderers.mitsuba.world.World`
    entries : at most `scene.MOST` media of the same L wavelengths, in any order.  `regions.Medium(region, scatterer, name)` is
        one without a boundary, `Everywhere()`, `Box(lo, hi)`, `Mesh(vertices, faces)` or `Grid(lo, hi, density)`, in m, with a
        `renderers.transport.scattering.Scatterer` (`scatterer(sigma_t, albedo, theta, phase)`); `density` multiplies its sigma_t.
        Anything else is a body, a shape of the Mitsuba scene, with name (its id), vertices, faces, medium (a Scatterer),
        matched, as `renderers.materials.bodies.bodies.Body` has them.  Where several overlap the one of the least volume
        counts, of equal ones the body; `Everywhere` is outermost, and hides lights at infinity.  The camera may stand in any.
    colours : to_rgb (3, L), linear sRGB from radiances, and to_waves (L, 3), radiances from linear sRGB
    seed : of the random numbers of all passes
    by_light : whether passes have layers light.NAME, too, of each of `world.light_names`
    far : `far.Far` of bodies that are surfaces far from the camera, by their numbers among the entries
    most : of each entry, all of them bodies, how often light may scatter between two surfaces; None: as often as it does
    shared : whether the entries are bodies and no surfaces change, so that pilots share `Scene.of_bodies` with the picture

    Returns
    -------
    part : its passes have layers "", the picture (H, W, 3) of linear sRGB, and `engine.ORDERS`, by how often light has scattered
        in media.  The first pass compiles.

    Raises
    ------
    variants.SeveralScenes : a graphics card cannot render these entries

    Notes
    -----
    Lights without extent are found from media without a boundary, from matched bodies and from surfaces, but not through
    boundaries that turn light, as no ray meets them.
    """
    # with the first pass
    scene = cache(lambda: Scene.of_bodies(world, entries, colours, most) if shared
                  else Scene(world, entries, colours, far=far, most=most))
    if variants.on_gpu(world.variant):
        scene()  # refuses here what a graphics card cannot render
    return of_loop(name, world, lambda *arguments: loop.trace(scene(), *arguments), seed, by_light)


def of_loop(name, world, traced, seed, by_light=False, most=_SAMPLES, paths=_PATHS) -> Part:
    """Passes of a loop, as `part` has them.

    traced : function of the key, pixels, samples and by_light of `loop.trace`
    most, paths : samples a pixel and pass;  paths of a pass where a pixel has several samples
    """
    height, width = world.size
    paths *= _ON_GPU if variants.on_gpu(world.variant) else 1
    samples = 1 << max(0, min(most, paths // (height * width)).bit_length() - 1)
    lights = world.light_names if by_light else ()
    return by_samples(name, partial(_rendered, traced, (height, width), seed, lights), samples)


def recorded(view, turn):
    """`loop.trace` of a scene by a turn, as `of_loop` takes it, traced once and replayed in later passes.

    Dr.Jit's work to trace what all shapes do was two thirds of the time of passes among some hundred of them.
    """
    def summed(numbers, variables, size, by_light):
        return loop.summed(view, Numbers.from_list(numbers), size, by_light, turn)

    # a recording sees the surfaces and lights of all scenes that there are only if this one has some
    replayed = view.scene.shapes() and view.scene.emitters()
    summed = dr.freeze(summed, warn_after=1 << 30) if replayed else summed

    def sums(_view, numbers, size, by_light, _turn, _lamps):
        with undisturbed():
            return summed(numbers.to_list(), view.variables(), size, by_light)

    return partial(loop.trace, view, turn=turn, sums=sums)


def materials(world, entries, colours, seed, samples=16):
    """Layer `material` (H, W): which entry most paths of a pixel first scatter in, of those that scatter; -1 where none does.

    samples : paths of a pixel;  other parameters as of `part`
    """
    scene, (height, width) = Scene(world, entries, colours, drawn=False), world.size
    numbers = np.empty((samples, height * width), int)
    for sample in range(samples):
        key = halves(stream_key(seed, "render.materials", sample))
        numbers[sample] = np.asarray(loop.first_media(scene, key, height * width))
    counts = np.array([(numbers == number).sum(axis=0) for number in range(len(entries))])
    entry = np.array(scene.entries)[counts.argmax(axis=0)]
    return np.where(counts.any(axis=0), entry, -1).reshape(height, width)


def halves(key):
    """Of a key of 64 bits."""
    return int(key) & 0xFFFFFFFF, int(key) >> 32


def _rendered(traced, size, seed, lights, samples, number):
    """Layers of a pass."""
    by_order, by_light = traced(halves(stream_key(seed, "render.paths", number)), size[0] * size[1], samples, len(lights) > 0)
    by_order = np.moveaxis(by_order.reshape(*size, ORDERS, 3), 2, 0) / samples
    if lights:
        by_light = np.moveaxis(by_light.reshape(*size, len(lights), 3), 2, 0) / samples
    return layers_of(by_order, by_light, lights)
