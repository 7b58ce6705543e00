"""Media of separate particles made by hand, and worlds of one light in closed form, for tests of their renderer."""

import math

import numpy as np
from scipy import stats

from bakery import kernels
from renderers.camera import Camera
from renderers.materials.particles import splat
from renderers.materials.particles.medium import Classes, Medium, medium
from renderers.mitsuba.world import FAR, LightSample, Shading

THETA = math.pi * np.linspace(0, 1, 721)
CUBE = kernels.region_box([0, 0, 0], [1, 1, 1])


def henyey_greenstein(g):
    """(A,) 1/sr at `THETA`, normalised as a table that is linear in cos theta."""
    f = (1 - g * g) / (4 * math.pi) / (1 + g * g - 2 * g * np.cos(THETA)) ** 1.5
    return f / kernels.phase_integral(THETA, f)


def classes(density, extinction, albedo=1.0, phase=None, host=0.0) -> Classes:
    """K classes: density (K,) 1/m^3, extinction (L, K) m^2, phase (A,) of all or (L, K, A)."""
    extinction = np.atleast_2d(np.asarray(extinction, float))
    phase = henyey_greenstein(0.0) if phase is None else phase
    waves, count = extinction.shape
    return Classes(np.atleast_1d(np.asarray(density, float)), extinction, albedo * extinction, THETA,
                   np.broadcast_to(phase, (waves, count, len(THETA))).copy(), np.full(count, 1e-3), np.zeros(count, np.uint8),
                   np.zeros(waves), np.full(waves, float(host)))


def of_depth(optical_depth, number, volume=1.0, waves=1, **more):
    """One class of `number` particles in a volume (m^3), whose optical depth a metre is given."""
    return classes(number / volume, np.full((waves, 1), optical_depth * volume / number), **more)


def hashed(kinds, region=CUBE, seed=1, to_rgb=None, to_waves=None) -> Medium:
    """A procedural realisation; one wavelength is grey, three are R, G, B."""
    def discs(extinction, density, order):
        return kernels.procedural_discs(region, extinction, density, (seed, 77))

    return _medium(kinds, discs, to_rgb, to_waves)


def kept(kinds, place, kind, region=CUBE) -> Medium:
    """Particles at places (N, 3) m, of classes kind (N,) of `kinds`."""
    def discs(extinction, density, order):
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order))
        return kernels.stored_discs(region, extinction, place, rank[kind])

    return _medium(kinds, discs, None, None)


def _medium(kinds, discs, to_rgb, to_waves):
    waves = len(kinds.extinction)
    if to_rgb is None:
        to_rgb = np.eye(3) if waves == 3 else np.full((3, waves), 1 / waves)
        to_waves = np.eye(3) if waves == 3 else np.full((waves, 3), 1 / 3)
    return medium(kinds, discs, to_rgb, to_waves)[0]


def _kinds(sample):
    """The arrays of a sample as Mitsuba gives them: kernels are compiled for no other kinds."""
    single = {name: getattr(sample, name).astype(np.float32) for name in ("direction", "radiance", "density")}
    return sample._replace(**single, light=sample.light.astype(np.int32))


class Sky:
    """Light from infinity and nothing else: a distant lamp of irradiance 1 W/m^2 that shines along `sun`, radiance `above` where
    z > 0 and `below` elsewhere; RGB alike.

    A world as `renderers.mitsuba.world.World`, in closed form.
    """

    light_names = ("sun", "sky")
    camera = None
    extended = True

    def __init__(self, sun=None, above=0.0, below=0.0):
        self.sun = None if sun is None else np.array(sun) / np.linalg.norm(sun)
        self.above, self.below = above, below
        self._chance = 0.0 if sun is None else 1.0 if above == below == 0 else 0.5  # of the lamp

    def camera_rays(self, random, pixel):
        place = pixel + random
        points = self.camera.corner + place[:, 1:] * self.camera.right + place[:, :1] * self.camera.down
        return np.tile(self.camera.origin, (len(place), 1)), points / np.linalg.norm(points, axis=1)[:, None]

    def trace(self, origin, direction, longest):
        return np.full(len(origin), np.inf)

    def _radiance(self, direction):
        return np.repeat(np.where(direction[:, 2] > 0, self.above, self.below)[:, None], 3, axis=1)

    def lights(self, point, random, *, hidden=True):
        n, random = len(point), np.asarray(random)
        delta = random[:, 0] < self._chance
        # as Mitsuba: one number chooses a light, and what is left of it a place there
        place = np.where(delta, 0.5, (random[:, 0] - self._chance) / max(1 - self._chance, 1e-30))
        z, turn = 2 * place - 1, 2 * math.pi * random[:, 1]
        sine = np.sqrt(1 - z * z)
        direction = np.stack([sine * np.cos(turn), sine * np.sin(turn), z], axis=1)
        density = np.full(n, (1 - self._chance) / (4 * math.pi))
        radiance = self._radiance(direction) / np.maximum(density, 1e-30)[:, None]
        if self.sun is not None:
            direction[delta], radiance[delta], density[delta] = -self.sun, 1 / self._chance, self._chance
        return _kinds(LightSample(direction, np.full(n, FAR), radiance, density, delta, np.where(delta, 0, 1)))

    def shade(self, origin, direction, random, density, delta):
        n, none = len(origin), np.zeros(len(origin), bool)
        by_light = np.full(n, (1 - self._chance) / (4 * math.pi))
        share = np.where(delta, 1.0, density / np.maximum(density + by_light, 1e-30))
        empty = _kinds(LightSample(np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3)), np.zeros(n), none, np.full(n, -1)))
        emitted = self._radiance(direction) * share[:, None]
        zero = np.zeros((n, 3))
        return Shading(none, zero, emitted.astype(np.float32), np.ones(n, np.int32), by_light, empty, origin, direction,
                       zero, np.zeros(n), none)


class Lamp(Sky):
    """A lamp without extent, of intensity 1 W/sr, at a place (m); nothing else shines."""

    light_names = ("lamp",)

    def __init__(self, place):
        super().__init__()
        self.place = np.array(place, float)

    def lights(self, point, random, *, hidden=True):
        towards = self.place - point
        distance = np.linalg.norm(towards, axis=1)
        n = len(point)
        radiance = np.repeat(1 / distance[:, None] ** 2, 3, axis=1)
        return _kinds(LightSample(towards / distance[:, None], distance, radiance, np.ones(n), np.ones(n, bool),
                                  np.zeros(n, int)))


def camera(size, origin=(0.5, -3.0, 0.5), target=(0.5, 0.5, 0.5), fov=15, up=(0, 0, 1)):
    """A camera with a film of size (height, width) that sees `fov` degrees."""
    return Camera.looking(origin, target, up, math.radians(fov), *size)


def passes(function, world, what, view, size, numbers, *, discrete=np.inf, seed=0, order=None):
    """Pictures (passes, H, W, 3) of `walk.one_pass` or `splat.one_pass`: of one order of scattering, or of all."""
    depth = np.array(np.broadcast_to(np.asarray(discrete, float), size))
    what = (what, splat.Plan()) if function is splat.one_pass else what
    lights = len(world.light_names)
    made = (function(world, what, view, *size, number, seed, discrete=depth, lights=lights)[0] for number in numbers)
    return np.array([one.sum(axis=0) if order is None else one[order] for one in made])


def blocks(pictures, shape):
    """Means over blocks of pixels, luminance of grey pictures: (passes, H, W, 3) to (passes, *shape)."""
    count, height, width, _ = pictures.shape
    return pictures.reshape(count, shape[0], height // shape[0], shape[1], width // shape[1], 3).mean(axis=(2, 4, 5))


def averaged(found):
    """Mean and standard error of repeated estimates, along the first axis."""
    return np.mean(found, axis=0), np.std(found, axis=0, ddof=1) / math.sqrt(len(found))


def same(ours, theirs):
    """Probability that means of two sets of passes, (P, ...) and (Q, ...), differ by chance as they do: Welch's t of each pixel
    as a normal score, the squares of all added up."""
    p, q = len(ours), len(theirs)
    a, b = ours.var(axis=0, ddof=1) / p, theirs.var(axis=0, ddof=1) / q
    known = a + b > 0
    assert np.array_equal(ours.mean(axis=0)[~known], theirs.mean(axis=0)[~known])
    a, b = a[known], b[known]
    t = (ours.mean(axis=0) - theirs.mean(axis=0))[known] / np.sqrt(a + b)
    free = (a + b) ** 2 / (a**2 / (p - 1) + b**2 / (q - 1))
    scores = stats.norm.isf(np.maximum(stats.t.sf(np.abs(t), free), 1e-300))
    return stats.chi2.sf((scores**2).sum(), len(scores))
