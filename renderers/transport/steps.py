"""Steps that all wavefronts share: what paths meet at surfaces of the scene, roulette, sums of light."""

import math

import numpy as np

from bakery.kernels import stream_key
from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.paths import Colours

ALL = 1 << 16  # paths that go on together; more take more memory, and fewer more calls
# where fewer paths than that, and than that share of them, are left, lights are sampled less; with less than the last share each
# sample would be seen
_MANY, _SHARE, LEAST = 4096, 1 / 16, 1 / 8
# What is added from pass to pass to numbers of [0, 1), so that they fill it evenly: to places in a pixel or on a disc (powers of
# 1 over the root of x^3 = x + 1, Roberts 2018), to the choice of a light (golden ratio), and to the place on it.  None is a
# rational function of others, so that all places get all lights
PLACES, LIGHTS = np.array([0.7548776662466927, 0.5698402909980532]), np.array([0.6180339887498949, 0.4142135623730951])


def places(seed, number, which, pixels, samples=1):
    """(n, 2) places in pixels, which samples of a pass and those of all passes share out.

    which : (n,) of the paths of a pass: pixel + pixels * sample

    By chance alone the edge of a white wall has a noise of 9 % after 32 passes.
    """
    sample, pixel = np.divmod(which, pixels)
    begins = wavefront.uniforms(wavefront.streams(stream_key(seed, "render.places"), pixels, 0), 2)
    return (begins[pixel] + (number * samples + sample)[:, None] * PLACES) % 1.0


def light_choices(size, offset):
    """(pixels,) numbers of [0, 1) that choose among lights, far apart in pixels that are near; offset : of a pass"""
    down, right = np.indices(size)
    return (offset + PLACES[0] * right + PLACES[1] * down).ravel() % 1


def shared_choices(size, seed, number):
    """`light_choices` that passes share out."""
    return light_choices(size, int(stream_key(seed, "render.choices")) / 2**64 + number * LIGHTS[0])


class Sums:
    """Light that a pass has brought, linear sRGB.

    by_order : (ORDERS, pixels, 3);  by_light : (lights, pixels, 3)
    """

    def __init__(self, pixels, lights, paths=ALL, choices=None):
        """paths : of the pass;  choices : (pixels,), of `light_choices`; None: all paths draw their own"""
        self._choices = choices
        self.by_order, self.by_light = np.zeros((wavefront.ORDERS, pixels, 3)), np.zeros((lights, pixels, 3))
        self._many = min(_MANY, _SHARE * min(paths, ALL))

    def often(self, count, least=LEAST):
        """Share of the light samples that are taken, a power of 1/2, where a call of Mitsuba's is for so many paths.

        Pictures are the same in the mean; the fewer paths go on, the more each of these calls costs.
        """
        return min(max(2.0 ** math.floor(math.log2(max(count / self._many, 1e-9))), least), 1.0)

    @staticmethod
    def skips(paths):
        """Whether the light of paths is left to other passes."""
        return False

    def light_choices(self, paths):
        """(n,) uniform numbers that choose among lights at the first surface of paths; None: all paths draw their own."""
        return None if self._choices is None else self._choices[paths.pixel]

    def add(self, paths, light, added):
        """What paths bring, added (n, 3), from lights (n,)."""
        wavefront.accumulate(added, paths.order, light, paths.pixel, self.by_order, self.by_light)


def met(world, paths, hidden=True, choices=None):
    """What paths meet at surfaces, a `renderers.mitsuba.world.Shading`; choices : as of `Sums.light_choices`."""
    numbers = wavefront.uniforms(paths.states, 6)
    if choices is not None:
        numbers[:, 0] = np.where(paths.bounces == 0, choices, numbers[:, 0])
    drawn = () if paths.drawn is None else (paths.drawn,)  # else where they begin
    options = {} if hidden else {"hidden": False}
    return world.shade(paths.origin, paths.direction, numbers, paths.density, paths.single, *drawn, **options)


def at_surfaces(world, colours, paths, sums, let_through, *, brought=None, wider=None, hidden=True):
    """Paths that go on from surfaces of the scene, after light that they meet, and that of light samples, has been added.

    let_through : function of paths (m,), points (m, 3) m, and samples of lights from there -> share (m, L) that gets through
    brought : function of paths and of what they met -> their throughput and order, as they count for the light there
    wider : `regularised.Wider`; None: small lamps are seen as they are
    hidden : surfaces hide lights; else `let_through` has what they leave
    """
    if paths.count == 0:
        return paths
    widened = wider.begin(paths) if wider else ()
    shading = met(world, paths, hidden, sums.light_choices(paths))
    throughput, order = brought(paths, shading) if brought else (paths.throughput, paths.order)
    add_light(colours, throughput, order, shading.emitted, shading.source, paths, sums)
    if len(widened):
        add_light(colours, *wider.light(world, paths, shading, widened), sums)
    return turned(colours, paths, shading, sums, let_through)


def turned(colours, paths, shading, sums, let_through=None):
    """Paths that go on from surfaces as they have met them, after what light samples send there has been added.

    sums : None: no light counts;  let_through : as of `at_surfaces`; None: all of it
    """
    hit = np.flatnonzero(shading.hit)
    paths = paths.of(hit)
    paths.bounces[:] += 1
    if paths.left_out is not None:
        paths.left_out[:] = np.nan
    bright = np.flatnonzero((shading.light.radiance[hit] > 0).any(axis=1))
    if sums is not None and len(bright) and not sums.skips(paths):
        group, sample = paths.of(bright), shading.light.of(hit[bright])
        passed = let_through(group, shading.point[hit[bright]], sample) if let_through else 1.0
        paths.states[bright] = group.states
        add_light(colours, group.throughput * passed, group.order, sample.radiance, sample.light, group, sums)
    run(wavefront.reflect, paths.count, _alone(colours), paths.throughput, shading.weight[hit])
    paths.origin[:], paths.direction[:] = shading.origin[hit], shading.direction[hit]
    paths.density[:], paths.single[:] = shading.density[hit], shading.delta[hit]
    return paths


def add_light(colours, throughput, order, radiance, light, paths, sums):
    """Adds radiance (n, 3) that paths have met of lights (n,); throughput (n, L), order (n,) : below 0 it does not count."""
    added = np.empty((paths.count, 3))
    wavefront.emitted(_alone(colours), throughput, order, radiance, added)
    sums.add(paths, light, added)


def _alone(colours) -> Colours:
    """Colours without what else a record has: kernels are compiled for each type of record, and the longer the more it has."""
    return Colours(colours.to_rgb, colours.to_waves)


def survivors(paths):
    """Paths that roulette leaves."""
    alive = np.empty(paths.count, bool)
    run(wavefront.roulette, paths.count, paths.throughput, paths.states, paths.bounces, alive)
    return paths.of(alive)


def thinned(paths, most):
    """Without some of the paths of more bounces than `most`, as `renderers.transport.loop.roulette`."""
    far = np.flatnonzero(paths.bounces > most)
    if not len(far):
        return paths
    numbers, goes = wavefront.uniforms(paths.states, 1, far), np.ones(paths.count, bool)
    chance = 1 - 1 / paths.bounces[far]
    paths.throughput[far] /= chance[:, None]
    goes[far] = numbers[:, 0] < chance
    return paths.of(goes)
