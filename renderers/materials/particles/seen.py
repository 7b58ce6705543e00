"""How much of a picture is light that particles scatter: before anything is baked, from a medium and rays through the scene."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import phase_at, stream_key
from renderers import colour
from renderers.materials.particles.box import inside
from renderers.materials.particles.detail import edges_of
from renderers.transport import wavefront

_PROBES, _DEPTHS = 1024, 24


class Box(NamedTuple):
    """Corners (3,) m of what holds the particles."""

    lo: np.ndarray
    hi: np.ndarray


def share(world, medium, box, peak) -> float:
    """Root mean square, over pixels, of the light of particles over the larger of the pixel and the mean of the picture; 0 to 1.

    world : `renderers.mitsuba.world.World`, with a camera and lights
    medium : `renderers.scene.requirements.About.medium`, of which the middle wavelength counts
    box : `Box`
    peak : rad, light that is scattered by less counts as unscattered

    Light that is scattered once, of one sample of the lights at some depths along one ray in each of `_PROBES` places; light of
    surfaces is one sample of the lights too.  Lamps that are seen themselves are left out: how many rays meet them is chance.
    """
    pixel = _probes(*world.size)
    origin, direction = world.camera_rays(np.full(pixel.shape, 0.5), pixel)
    numbers = wavefront.uniforms(wavefront.streams(stream_key(0, "render.seen"), len(pixel) * _DEPTHS), 6)
    behind = _surfaces(world, origin, direction, numbers[:len(pixel)])
    light = _scattered(world, medium, box, peak, origin, direction, numbers)
    mean = float(np.mean(light + behind))
    return math.sqrt(float(np.mean((light / np.maximum(light + behind, mean)) ** 2))) if mean > 0 else 1.0


def _probes(height, width):
    """Pixels (n, 2), row and column, evenly over the picture."""
    step = max(1.0, math.sqrt(height * width / _PROBES))
    sides = (np.arange(0, side, step).astype(int) for side in (height, width))
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2)


def _surfaces(world, origin, direction, numbers):
    """Luminance (n,) of what is seen behind the particles."""
    n = len(origin)
    shading = world.shade(origin, direction, numbers, np.zeros(n), np.ones(n, bool))
    return np.where(shading.hit[:, None], shading.light.radiance, shading.emitted).astype(float) @ colour.LUMINANCE


def _scattered(world, medium, box, peak, origin, direction, numbers):
    """Luminance (n,) of light that is scattered once."""
    n, middle = len(origin), len(medium.wavelength) // 2
    sigma_t, albedo = float(medium.sigma_t[middle]), float(medium.albedo[middle])
    begin, end = inside(box, origin, direction, world.trace(origin, direction, np.full(n, np.inf)))
    edges = edges_of(begin, end, _DEPTHS)
    depth = (edges[:, 1:] + edges[:, :-1]) / 2
    point = (origin[:, None] + depth[..., None] * direction[:, None]).reshape(-1, 3)
    light = world.lights(point, numbers)
    towards = light.direction.astype(float)
    _, out = inside(box, point, towards, light.distance)
    angle = np.arccos(np.clip((towards * np.repeat(direction, _DEPTHS, axis=0)).sum(axis=1), -1, 1))
    arrives = light.radiance.astype(float) @ colour.LUMINANCE * np.exp(-sigma_t * np.maximum(out, 0))
    turned = np.where(angle < peak, 0.0, phase_at(medium.theta, medium.phase[middle], angle))
    seen = np.exp(-sigma_t * (depth - begin[:, None])) * np.diff(edges, axis=1)
    return sigma_t * albedo * ((arrives * turned).reshape(n, -1) * seen).sum(axis=1)
