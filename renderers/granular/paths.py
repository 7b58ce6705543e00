"""Explicit path tracing of grains: camera paths from grain to grain, with next-event estimation to the lights where a surface is
not smooth.

All paths of a pass go on together: compiled loops take each through the grains until it needs a light or a surface of the scene,
Mitsuba answers for all that do.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers import wavefront
from renderers.granular import _paths
from renderers.granular._grains import UNKNOWN
from renderers.mitsuba.world import LightSample
from renderers.threads import run

_ALL = 1 << 16  # paths that go on together; more take more memory, and fewer more calls


class Colours(NamedTuple):
    """to_rgb : (3, L) linear sRGB from radiances;  to_waves : (L, 3) radiances from linear sRGB"""

    to_rgb: np.ndarray
    to_waves: np.ndarray


class Explicit:
    """Paths from grain to grain.

    grains : `Grains` of one mesh;  occupied : (X, Y, Z) uint8, its voxels with surfaces of the scene, empty where there are none
    colours : `Colours`
    """

    def __init__(self, grains, occupied, colours):
        self.grains, self.occupied, self.colours = grains, occupied, colours

    def advance(self, paths):
        """Takes paths on until they need something: what (n,), and normal and type of grain of those that need LIGHT."""
        n = len(paths)
        normal, kind, status, alive = np.empty((n, 3)), np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, bool)
        run(_paths.advance, n, self.grains, self.occupied, paths.origin, paths.direction, paths.weight, paths.states, paths.met,
            paths.place, paths.far, paths.order, paths.bounces, paths.single, paths.density, normal, kind, status, alive)
        return status, (normal, kind)

    def lit(self, paths, found, sample, added):
        """What light samples send by way of rough and matt grains, added (n, 3); found : what `advance` found of these paths."""
        run(_paths.light, len(paths), self.grains, self.colours, paths.origin, paths.direction, paths.weight, paths.met,
            paths.place, *found, *sample[:5], added)

    def scattered(self, paths, found, alive):
        """Turns paths at rough and matt grains; alive (n,) becomes whether they go on."""
        run(_paths.scatter, len(paths), self.grains, paths.origin, paths.direction, paths.weight, paths.states, paths.bounces,
            *found, paths.density, paths.single, alive)

    def open(self, point, direction, distance, share):
        """Share (n, L) of light that gets from points along directions to a distance."""
        run(_paths.open_share, len(point), self.grains, point, direction, distance, share)


@dataclass
class Paths:
    """Camera paths on their way, n of them.

    origin, direction : (n, 3) m, unit;  weight : (n, L);  states : (n,) random streams;  pixel : (n,)
    met, place : (n, 4), (n,) sphere and triangle that each starts on (`_grains.next_surface`)
    far : (n,) m, to the first surface of the scene; nan: not known
    density : (n,) 1/sr, with which the direction was drawn;  single : (n,) whether light sampling cannot take it
    order : (n,) grains met;  bounces : (n,) surfaces met
    centre : (n, 3) m, of the sphere that each starts in where its place is drawn; nan elsewhere
    """

    origin: np.ndarray
    direction: np.ndarray
    weight: np.ndarray
    states: np.ndarray
    pixel: np.ndarray
    met: np.ndarray
    place: np.ndarray
    far: np.ndarray
    density: np.ndarray
    single: np.ndarray
    order: np.ndarray
    bounces: np.ndarray
    centre: np.ndarray

    def of(self, chosen):
        """Some of the paths."""
        return Paths(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def __len__(self):
        return len(self.pixel)


def one_pass(world, method, camera, height, width, number, seed, *, lights):
    """One camera path for each pixel.

    Parameters
    ----------
    world : `renderers.mitsuba.world.World`
    method : `Explicit`, or another one with its methods
    camera : `renderers.camera.Camera`
    number, seed : of the pass: its random numbers
    lights : number of lights

    Returns
    -------
    by_order : (ORDERS, H, W, 3), by_light : (lights, H, W, 3) linear sRGB
    """
    pixels = height * width
    by_order, by_light = np.zeros((wavefront.ORDERS, pixels, 3)), np.zeros((lights, pixels, 3))
    for first in range(0, pixels, _ALL):
        paths = _begin(len(method.colours.to_waves), camera, width, np.arange(first, min(first + _ALL, pixels)), number, seed)
        while len(paths):
            paths = _on(world, method, paths, by_order, by_light)
    return by_order.reshape(-1, height, width, 3), by_light.reshape(-1, height, width, 3)


def _begin(waves, camera, width, pixel, number, seed):
    n = len(pixel)
    states, offset = np.empty(n, np.uint64), np.empty((n, 2))
    wavefront.begin_streams(stream_key(seed, "render.grains", number), int(pixel[0]), states)
    wavefront.draw(states, offset)
    direction = camera.corner + (pixel % width + offset[:, 0])[:, None] * camera.right \
        + (pixel // width + offset[:, 1])[:, None] * camera.down
    direction /= np.sqrt((direction**2).sum(axis=1))[:, None]
    return Paths(np.tile(camera.origin, (n, 1)), direction, np.ones((n, waves)), states, pixel, np.full((n, 4), UNKNOWN),
                 np.full(n, -1), np.full(n, np.nan), np.zeros(n), np.ones(n, bool), np.zeros(n, np.int64), np.zeros(n, np.int64),
                 np.full((n, 3), np.nan))


def _on(world, method, paths, by_order, by_light):
    """Paths after what each needed next, those that go on."""
    start = np.flatnonzero((paths.met[:, 0] == UNKNOWN) & np.isnan(paths.far))
    paths.far[start] = world.trace(paths.origin[start], paths.direction[start], np.inf)
    status, found = method.advance(paths)
    near = paths.of(status == _paths.TRACE)
    near.far[:] = world.trace(near.origin, near.direction, np.inf)
    lit = status == _paths.LIGHT
    parts = [near, _at_grains(world, method, paths.of(lit), [one[lit] for one in found], by_order, by_light),
             _at_surfaces(world, method, paths.of(status == _paths.LEAVES), by_order, by_light)]
    return Paths(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Paths)))


def _at_grains(world, method, paths, found, by_order, by_light):
    """Paths that go on from where light samples are taken, after those have been added."""
    n = len(paths)
    if n == 0:
        return paths
    numbers, added, alive = np.empty((n, 3)), np.empty((n, 3)), np.empty(n, bool)
    wavefront.draw(paths.states, numbers)
    sample = world.lights(paths.origin, numbers)
    method.lit(paths, found, sample, added)
    wavefront.accumulate(added, paths.order, sample.light, paths.pixel, by_order, by_light)
    method.scattered(paths, found, alive)
    return paths.of(alive)


def _at_surfaces(world, method, paths, by_order, by_light):
    """Paths that go on from surfaces of the scene, after their light has been added."""
    n, colours = len(paths), method.colours
    if n == 0:
        return paths
    numbers, added = np.empty((n, 6)), np.empty((n, 3))
    wavefront.draw(paths.states, numbers)
    shading = world.shade(paths.origin, paths.direction, numbers, paths.density, paths.single)
    wavefront.emitted(colours, paths.weight, paths.order, shading.emitted, added)
    wavefront.accumulate(added, paths.order, shading.source, paths.pixel, by_order, by_light)
    hit = np.flatnonzero(shading.hit)
    m, paths = len(hit), paths.of(hit)
    if m == 0:
        return paths
    paths.bounces += 1
    _lit_surfaces(method, paths, shading.point[hit], LightSample(*(values[hit] for values in shading.light)), by_order, by_light)
    run(wavefront.reflect, m, colours, paths.weight, shading.weight[hit])
    paths.origin, paths.direction = shading.origin[hit], shading.direction[hit].astype(float)
    paths.met[:], paths.place[:], paths.far[:] = UNKNOWN, -1, np.nan
    paths.density, paths.single = shading.density[hit].astype(float), shading.delta[hit]
    alive = np.empty(m, bool)
    run(wavefront.roulette, m, paths.weight, paths.states, paths.bounces, alive)
    return paths.of(alive)


def _lit_surfaces(method, paths, point, sample, by_order, by_light):
    """Adds what light samples send by way of surfaces of the scene, through what is between the grains."""
    bright = np.flatnonzero((sample.radiance > 0).any(axis=1))
    if not len(bright):
        return
    paths, sample = paths.of(bright), LightSample(*(values[bright] for values in sample))
    share, added = np.empty(paths.weight.shape), np.empty((len(bright), 3))
    method.open(point[bright], sample.direction, sample.distance, share)
    wavefront.emitted(method.colours, paths.weight * share, paths.order, sample.radiance, added)
    wavefront.accumulate(added, paths.order, sample.light, paths.pixel, by_order, by_light)
