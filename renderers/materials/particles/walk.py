"""The walk from particle to particle: camera paths of all orders, with next-event estimation to the lights.

One pass is one camera path a pixel, more where bright lamps are seen, whose first particle sends several on.  All paths go on
together, bounce by bounce: kernels for particles, Mitsuba for surfaces and lights.

Steps of its own beside `renderers.transport.waves`, with those of `renderers.transport.steps`: paths part at their first
particle, lights guide scattering, particles stop rays up to a depth of each pixel, and light that splats bring is left out.
"""

from typing import NamedTuple

import numpy as np

from bakery.kernels import NO_DISC, stream_key
from renderers import colour
from renderers.materials.particles import _transport, shadow
from renderers.materials.particles._transport import Guide, Walk, Ways
from renderers.materials.particles.box import absorb
from renderers.mitsuba.shading import FAR, selected
from renderers.threads import run
from renderers.transport import steps, wavefront
from renderers.transport.paths import Paths, follow, joined, of_camera

# ways on from the first particle, which takes as long to find as the next one: some four take least time to an error; passes of
# the first picture take one each, as that comes sooner
_SPLIT, _BEGINNING = 4, 2
_SMALL = 1.0  # 1/sr: density of places on lights from which on their direction is worth following
_PARTS = 16  # of a box along each axis, in which rays are gathered
_SPREAD = np.array([sum((i >> bit & 1) << 3 * bit for bit in range(4)) for i in range(_PARTS)])  # bits with two free ones between
# Of pixels that show what shines so many times the picture's mean of it: squares of a pixel that have a path each, along a side,
# as many as add this share of the pixels to a pass.  One path a pixel left the rim of a bulb, and what hides it by chance, 99.9 %
# of the variance of dust and of rain around it
_BRIGHT, _FINEST, _ADDED = 4.0, 8, 1 / 4


class Squares(NamedTuple):
    """Parts of pixels: pixel (n,), number (n,) of the square in that, and how many squares there are along its side (n,)."""

    pixel: np.ndarray
    number: np.ndarray
    side: np.ndarray

    @classmethod
    def every(cls, side) -> "Squares":
        """All of pixels with so many, (H W,): the first one of each, and after them all others."""
        others = np.repeat(np.arange(len(side)), side**2 - 1)
        pixel = np.concatenate([np.arange(len(side)), others])
        number = np.concatenate([np.zeros(len(side), np.int64), 1 + np.arange(len(others)) - np.searchsorted(others, others)])
        return cls(pixel, number, side[pixel])

    of = selected


class Discs:
    """How particles stop rays and scatter: as discs, or as the continuous medium that they make on average.

    medium : `renderers.materials.particles.medium.Medium`
    later : m, distance up to which particles stop rays that are not the camera's: inf or 0
    splatted : whether single scattering by particles, straight from a light and straight to the camera, is left out
    eye : (3,) m, of the camera, where the continuous medium stands for particles, which hide what is seen from there and from a
        light beside it together (`renderers.materials.particles.shadow`); None: it stands for itself
    """

    squares = None  # (H W,) along the side of each pixel, as of `squares_of`; None: one each; `explicit` and `query` have it too

    def __init__(self, medium, later=np.inf, splatted=False, eye=None):
        self.medium, self.later, self.splatted, self.eye = medium, later, splatted, eye

    def collide(self, paths, far):
        """The next scattering of each path before `far` (n,) m: class (n,) or NO_DISC, distance (n,) and place (n, 3) m."""
        n = paths.count
        kind, distance, point = np.empty(n, np.int64), np.empty(n), np.empty((n, 3))
        run(_transport.collide, n, self.medium, paths.part(Walk), far, paths.discrete, kind, distance, point)
        return kind, distance, point

    def scattered(self, world, paths, kind, point, sums):
        """Paths that go on from a scattering, after light from there has been added."""
        n, medium = paths.count, self.medium
        particle = kind < len(medium.albedo) - 1
        first = (paths.bounces == 0) & particle & self.splatted
        numbers = wavefront.uniforms(paths.states, 6 if self.eye is None else 8)
        # two places on lights, in one call: one to connect to, and one whose direction guides the path
        samples = world.lights(np.concatenate([point, point]), np.concatenate([numbers[:, :3], numbers[:, 3:6]]))
        sample, guide_sample = (samples.of(part) for part in (slice(n), slice(n, None)))
        guide = Guide(guide_sample.direction.astype(float),
                      (guide_sample.radiance > 0).any(axis=1) & (guide_sample.delta | (guide_sample.density > _SMALL)))
        added = np.empty((n, 3))
        share = _together(self, (paths.bounces == 0) & ~particle, point, sample.direction, sample.distance, numbers[:, 6:])
        sample.radiance[first] = 0.0
        _let_through(medium, paths, point, sample, point, share)
        run(_transport.light, n, medium.scatterer, kind, paths.part(Walk), guide, share, sample, added)
        sums.add(paths, sample.light, added)
        paths = paths._replace(origin=point, left_out=point.copy(), single=np.zeros(n, bool), splatted=first)
        copies = np.repeat(np.arange(n), paths.ways)
        paths = _split(paths, copies)
        guide = Guide(guide.direction[copies], guide.used[copies])
        run(_transport.scatter, paths.count, medium.scatterer, kind[copies], paths.part(Walk), guide)
        return paths


def _together(method, straight, seen, towards, distance, numbers=None):
    """Factors (n, L) of `shadow` for light in places that are seen straight from the camera, bool (n,); 1 elsewhere.

    numbers : (n, 2) uniform, of places where the continuous medium scatters; None of surfaces
    """
    together = np.ones((len(seen), len(method.medium.sigma_t)))
    chosen = np.flatnonzero(straight) if method.eye is not None else []
    if len(chosen):
        light = method.medium, method.eye, seen[chosen], towards[chosen].astype(float), distance[chosen]
        together[chosen] = shadow.factors(*light, np.zeros((len(chosen), 3))) if numbers is None \
            else shadow.of_continuum(*light, numbers[chosen])
    return together


def _let_through(medium, paths, point, sample, left_out, share):
    """Multiplies share (n, L) of light of samples by what gets through to points (n, 3) m; 0 where they are dark."""
    share[~(sample.radiance > 0).any(axis=1)] = 0.0
    ways = Ways(paths.states, point, sample.direction.astype(float), sample.distance.astype(float), paths.discrete, left_out)
    run(_transport.transmit, len(share), medium, ways, share)


def _split(paths, copies):
    """Paths copies (n,), equal ones in a row: they share their weight, and their random streams part."""
    shares, part = np.bincount(copies)[copies], np.zeros(len(copies), np.int64)
    for step in range(1, _SPLIT):
        part[step:][copies[step:] == copies[:-step]] = step
    split = paths.of(copies)
    split.throughput[:] /= shares[:, None]
    split.ways[:] = 1
    wavefront.branch(split.states, part)
    return split


def squares_of(world, camera, height, width):
    """How many squares along its side each pixel has a path in, (H W,) from 1: more where bright lamps are seen.

    Lamps are looked for by rays at corners and in the middle of pixels, and, around what those show, in the middle of squares;
    a lamp that none of them meets has one path, as other things have.
    """
    from scipy.ndimage import binary_dilation

    rows, columns = np.mgrid[:height + 1, :width + 1]
    inside = _shining(world, camera, columns[:-1, :-1] + 0.5, rows[:-1, :-1] + 0.5)
    bright = _BRIGHT * inside.mean()
    at_corners = _shining(world, camera, columns, rows)[:-1, :-1]
    row, column = np.nonzero(binary_dilation(np.maximum(inside, at_corners) > bright, np.ones((3, 3))))
    down, right = (np.mgrid[:_FINEST, :_FINEST].reshape(2, -1, 1) + 0.5) / _FINEST
    shows = (_shining(world, camera, column + right, row + down) > bright).any(axis=0)
    finest = _FINEST
    while finest > 1 and shows.sum() * (finest**2 - 1) > _ADDED * inside.size:
        finest //= 2
    squares = np.ones(inside.shape, np.int64)
    squares[row[shows], column[shows]] = finest
    return squares.ravel()


def _shining(world, camera, x, y):
    """Luminance of what shines by itself, as a camera sees it straight at places x, y (…) of its film, in pixels."""
    n = x.size
    origin, direction = camera.rays_at(np.zeros((n, 2)), np.stack([x.ravel(), y.ravel()], axis=1))
    shading = world.shade(origin, direction, np.full((n, 6), 0.5), np.zeros(n), np.ones(n, bool))
    return (shading.emitted @ colour.LUMINANCE).reshape(x.shape)


def one_pass(world, method, camera, height, width, number, seed, *, discrete, lights):
    """One camera path for each square of each pixel; those of `Discs` part at their first particle.  Gives by_order
    (ORDERS, H, W, 3) and by_light (lights, H, W, 3), linear sRGB.

    method : `Discs` or another one with its attributes and methods
    number, seed : of the pass: its random numbers
    discrete : (H, W) m, depth up to which particles stop camera rays
    lights : number of lights
    """
    pixels = height * width
    sums = steps.Sums(pixels, lights, choices=steps.shared_choices((height, width), seed, number))
    squares = Squares.every(np.ones(pixels, np.int64) if method.squares is None else method.squares)

    def begin(first, last):
        places = steps.places(seed, number, np.arange(first, last), len(squares.pixel))
        return _begin(method.medium, camera, width, squares.of(slice(first, last)), number, seed, discrete, first, places)

    follow(len(squares.pixel), steps.ALL, begin, lambda paths: _bounce(world, method, paths, sums))
    return sums.by_order.reshape(-1, height, width, 3), sums.by_light.reshape(-1, height, width, 3)


def _begin(medium, camera, width, squares, number, seed, discrete, first, places):
    """Paths of squares, whose streams are numbered from `first` on."""
    pixel, side = squares.pixel, squares.side[:, None]
    n, waves, corners = len(pixel), len(medium.sigma_t), np.stack([pixel % width, pixel // width], axis=1)
    cell = np.stack([squares.number % squares.side, squares.number // squares.side], axis=1)
    states, origin, direction = of_camera(lambda offset, corner: camera.rays_at((cell + offset) / side, corner),
                                          stream_key(seed, "render.walk", number), first, corners, places)
    paths = Paths.begun(origin, direction, waves, states, pixel, left_out=np.full((n, 3), np.nan),
                        discrete=discrete.reshape(-1)[pixel], splatted=False, ways=1 if number < _BEGINNING else _SPLIT)
    paths.throughput[:] /= side**2
    return paths


def _bounce(world, method, paths, sums):
    """Paths after their next scattering or surface, those that go on."""
    far = world.trace(paths.origin, paths.direction, np.full(paths.count, np.inf))
    kind, distance, point = method.collide(paths, far)
    stopped = kind != NO_DISC
    absorb(method.medium, paths, np.where(stopped, distance, far))
    parts = [_among_particles(world, method, paths.of(stopped), kind[stopped], point[stopped], sums),
             _at_surfaces(world, method, paths.of(~stopped), sums)]
    alive, region = steps.survivors(joined(parts)), method.medium.discs.region
    return alive.of(_coherent(region.lo, region.hi, alive.origin, alive.direction))


def _coherent(lo, hi, origin, direction):
    """An order of rays in which those that go alike from the same part of a box follow each other.

    What one has read of the lattice is in the cache for the next.
    """
    cell = np.clip((origin - lo) * (_PARTS / (hi - lo)), 0, _PARTS - 1).astype(np.int64)
    voxel = _SPREAD[cell[:, 0]] | _SPREAD[cell[:, 1]] << 1 | _SPREAD[cell[:, 2]] << 2
    octant = (direction > 0) @ np.array([1, 2, 4])
    main = np.argmax(abs(direction), axis=1)
    return np.argsort((main * 8 + octant) * _PARTS**3 + voxel, kind="stable")


def _among_particles(world, method, paths, kind, point, sums):
    if not paths.count:
        return paths
    paths.order[:] += 1
    paths.discrete[:] = method.later
    paths = method.scattered(world, paths, kind, point, sums)
    paths.bounces[:] += 1
    return paths


def _at_surfaces(world, method, paths, sums):
    def brought(paths, shading):
        order = np.where(paths.splatted, -1, paths.order)
        if method.eye is None:
            return paths.throughput, order
        # what light sampling finds from the same places counts as much
        numbers = wavefront.uniforms(paths.states, 2)
        far = np.where(shading.hit, np.sqrt(((shading.point - paths.origin) ** 2).sum(axis=1)), FAR)
        once, light = paths.bounces == 1, (paths.origin, paths.direction, far)
        arriving = _together(method, once & (paths.order == 0), *light)
        return paths.throughput * arriving * _together(method, once & (paths.order == 1), *light, numbers), order

    def let_through(paths, point, sample):
        share = _together(method, paths.bounces == 1, point, sample.direction, sample.distance)
        ways = paths._replace(discrete=np.full(paths.count, method.later))
        _let_through(method.medium, ways, point, sample, paths.left_out, share)
        return share

    paths = steps.at_surfaces(world, method.medium, paths, sums, let_through, brought=brought)
    paths.ways[:], paths.discrete[:], paths.splatted[:] = 1, method.later, False
    return paths
