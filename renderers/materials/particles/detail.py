"""Where particles can be told apart: the depth, by pixel, up to which they have to be particles.

Campbell's theorem gives mean and variance of a pixel over realisations before anything is rendered: with w what one particle
adds to it, mean = integral of n <w>, variance = integral of n <w^2>, along what the pixel sees.  Beyond the depth behind which
the rest of the variance is below (tolerance x mean)^2 the continuous medium does as well.  A particle adds the light that it
scatters, and takes away what is behind its disc; a disc larger than the pixel adds to it only its part.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import phase_value, region_densities, stream_key
from bakery.system.compiled import njit
from renderers import colour
from renderers.materials.particles import medium as media
from renderers.materials.particles import place
from renderers.materials.particles.box import column, inside
from renderers.threads import run
from renderers.transport import wavefront

_PROBES = 2048  # pixels that are looked at; depths between them are the largest around
_DEPTHS = 40
_NEAREST = 1e-4  # of the farthest depth: where looking begins, and particles are particles in any case


def depths(world, medium, camera, height, width, tolerance, seed):
    """Depths (H, W) in m up to which particles stop camera rays as particles; 0 where nowhere, inf where everywhere.

    tolerance : relative deviation of a pixel that may be lost

    Light is what one sample of the lights brings to each depth, weakened by the mean medium; surfaces behind it shine as their
    emission and one sample of the lights make them.  Light that is scattered more than once is not counted: it makes pixels
    smoother than predicted.
    """
    from scipy.ndimage import maximum_filter

    if not world.light_names:
        return np.zeros((height, width))
    probes = _probed(world, medium, camera, height, width, seed)
    begin, end, edges, rows, columns = probes.begin, probes.end, probes.edges, probes.rows, probes.columns
    # what is left of the variance from each edge on
    remaining = np.concatenate([np.cumsum(probes.variance[:, ::-1], axis=1)[:, ::-1], np.zeros((len(begin), 1))], axis=1)
    enough = remaining <= (tolerance * probes.mean[:, None]) ** 2
    first = enough.argmax(axis=1)
    depth = np.where(first == 0, 0.0, np.take_along_axis(edges, first[:, None], axis=1)[:, 0])
    depth = np.where((first == enough.shape[1] - 1) | (begin >= end), np.where(begin >= end, 0.0, np.inf), depth)
    # between probes the largest of those around
    grid = maximum_filter(depth.reshape(len(rows), len(columns)), 3)
    return grid.repeat(probes.stride, axis=0).repeat(probes.stride, axis=1)[:height, :width]


class _Probes(NamedTuple):
    """Of n pixels in rows and columns: where their rays enter and leave the region's box (n,) m, depths (n, _DEPTHS + 1) m, mean
    luminance (n,) and its variance between the depths (n, _DEPTHS)."""

    stride: int
    rows: np.ndarray
    columns: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    edges: np.ndarray
    mean: np.ndarray
    variance: np.ndarray


def _probed(world, medium, camera, height, width, seed) -> _Probes:
    stride = max(1, math.ceil(math.sqrt(height * width / _PROBES)))
    rows, columns = (np.minimum(np.arange(0, side + stride, stride), side - 1) for side in (height, width))
    pixel = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
    origin, direction = world.camera_rays(np.full((len(pixel), 2), 0.5), pixel)
    begin, end = inside(medium.discs.region, origin, direction, world.trace(origin, direction, np.full(len(pixel), np.inf)))
    numbers = wavefront.uniforms(wavefront.streams(stream_key(seed, "render.detail"), len(pixel)), 6)
    shading = world.shade(origin, direction, numbers, np.zeros(len(pixel)), np.ones(len(pixel), bool))
    behind = np.maximum((shading.emitted + shading.light.radiance) @ colour.LUMINANCE, 0.0).astype(float)
    edges = edges_of(begin, end, _DEPTHS)
    middle = (edges[:, 1:] + edges[:, :-1]) / 2
    solid = float(np.linalg.norm(np.cross(camera.right, camera.down))) \
        * (direction @ _axis(camera)) ** 3
    mean, variance = _along(world, medium, origin, direction, middle, np.diff(edges, axis=1), behind, solid,
                            stream_key(seed, "render.depths"))
    return _Probes(stride, rows, columns, begin, end, edges, mean, np.where((begin < end)[:, None], variance, 0.0))


def deviation(scene, number, asset, world) -> float:
    """By how much pixels deviate from the continuous medium because of an entry's particles: root mean square over the picture's
    mean, whatever hides them but surfaces."""
    group, entry, waves = asset.discrete, scene.values.materials[number], np.asarray(asset.wavelength, float)
    region = place.region_of(scene, group, number)
    classes = media.without_peak(media.classes_of(group), media.peak_of(entry.peak, world))
    discs = place.discs_of(group, region, entry.velocity, entry.time)
    tabulated, _ = media.medium(classes, discs, colour.srgb_matrix(waves), colour.spread_matrix(waves))
    if not world.light_names:
        return 0.0
    probes = _probed(world, tabulated, world.camera, *world.size, 0)
    return math.sqrt(float(probes.variance.sum(axis=1).mean())) / max(float(probes.mean.mean()), 1e-300)


def _axis(camera):
    across = np.cross(camera.right, camera.down)
    return across / np.linalg.norm(across) * np.sign(across @ camera.corner)


def edges_of(begin, end, depths):
    """Depths (n, depths + 1), equal in ratio, from the box's near to its far side."""
    end = np.maximum(end, begin * (1 + 1e-9) + 1e-300)
    near = np.maximum(begin, _NEAREST * end)
    return near[:, None] * (end / near)[:, None] ** np.linspace(0, 1, depths + 1)


def _along(world, medium, origin, direction, middle, thick, behind, solid, key):
    """Mean luminance (n,) and its variance from each depth (n, _DEPTHS)."""
    n, depths = middle.shape
    region, share = medium.discs.region, colour.LUMINANCE @ medium.to_rgb
    point = (origin[:, None] + middle[..., None] * direction[:, None]).reshape(-1, 3)
    rho = np.asarray(region_densities(region, point)).reshape(n, -1)
    sample = world.lights(point, wavefront.uniforms(wavefront.streams(key, len(point)), 3))
    light = np.maximum(sample.radiance.astype(float) @ medium.to_waves.T, 0.0)
    out = column(region, point, sample.direction.astype(float), sample.distance)
    dense, thickness = np.cumsum(rho * thick, axis=1), np.cumsum(thick, axis=1) - thick / 2
    passed = np.exp(-medium.sigma_t * (dense - rho * thick / 2).reshape(-1, 1) - medium.host * thickness.reshape(-1, 1))
    arrives = np.exp(-medium.sigma_t * (rho.reshape(-1) * out)[:, None] - medium.host * out[:, None])
    towards = sample.direction.astype(float) - np.repeat(direction, depths, axis=0)
    v = np.minimum(0.5 * (towards**2).sum(axis=1), 2.0)
    mean, variance = np.empty(len(point)), np.empty(len(point))
    background = behind * np.exp(-(medium.sigma_t @ share) * dense[:, -1])
    area = (middle**2 * solid[:, None]).reshape(-1)
    at = _At(v, light, passed, arrives, np.repeat(background, depths), area)
    run(_moments, len(point), medium.scatterer, (medium.density, medium.discs.square), share, at, mean, variance)
    weight = rho * thick
    return (mean.reshape(n, -1) * weight).sum(axis=1) + background, variance.reshape(n, -1) * weight


class _At(NamedTuple):
    """Depths of pixels: coordinate v (n,) of the angle between light and ray, light (n, L) from the lamp, shares of it (n, L)
    that pass towards the eye and arrive from the lamp, luminance (n,) from behind the medium, m^2 (n,) that a pixel sees."""

    v: np.ndarray
    light: np.ndarray
    passed: np.ndarray
    arrives: np.ndarray
    behind: np.ndarray
    area: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def _moments(scatterer, classes, share, at, mean, variance, begin, end):
    """Mean and variance of luminance a metre of depth at full density, from all classes: their density and `Discs.square`."""
    v, light, passed, arrives, behind, area = at
    density, square = classes
    waves = square.shape[1]
    for i in range(begin, end):
        mean[i], variance[i] = 0.0, 0.0
        for k in range(len(square)):
            bright, free, reach = 0.0, 0.0, 0.0
            for w in range(waves):
                size = math.pi * square[k, w]
                value = phase_value(scatterer.v, scatterer.steps, scatterer.phase[k * waves + w], v[i])
                bright += share[w] * size * scatterer.albedo[k * waves + w] * value * light[i, w]
                free += share[w] * passed[i, w] * arrives[i, w]
                reach = max(reach, size)
            over = max(area[i], reach)
            mean[i] += density[k] * bright * free
            variance[i] += density[k] * (bright * bright * free + (reach * behind[i]) ** 2) / over
