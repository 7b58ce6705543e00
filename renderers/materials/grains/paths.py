"""Explicit path tracing from grain to grain, with next-event estimation to the lights where a surface is not smooth.

Compiled loops take each path through the grains until it needs something that all paths get together (`transport`).
"""

from functools import cache, partial

import numpy as np

from bakery.kernels import stream_key
from renderers.materials.grains import _paths
from renderers.materials.grains._paths import Event, Switching, Walk
from renderers.threads import run
from renderers.transport.paths import UNKNOWN, Paths

NEVER = 2**62  # a stage that no path comes to
TOGETHER = 256  # paths that one processor takes on: 4096 are often all those of a body, which then wait for one
SELDOM = 1 / 64  # chance of a light sample far inside
_POWERS = np.cumprod(np.full(7, 0x9E3779B97F4A7C15, np.uint64))  # odd, modulo 2^64: make a number of a way's seven words


def less_often(layout, share):
    """A layout with a `chance` (X, Y, Z) of light samples, with a share of these; far inside, where they are seldom anyway, no
    less."""
    if share == 1:
        return layout
    less = {"chance": np.maximum(np.float32(share) * layout.chance, np.float32(SELDOM))}
    return layout._replace(**less | ({"often": share} if "often" in layout._fields else {}))


class Explicit:
    """Paths from grain to grain.

    grains : `Grains` of one mesh;  occupied : (X, Y, Z) uint8, its voxels with surfaces of the scene, empty where there are none
    colours : `Colours`
    """

    def __init__(self, grains, occupied, colours):
        self.grains, self.occupied, self.colours = grains, occupied, colours
        self._with_share = cache(partial(less_often, grains))

    def sample_lights(self, share):
        """Lights are sampled so often, against what the grains' `chance` says, until this is called again."""
        self.grains = self._with_share(share)

    def advance(self, paths):
        """Takes paths on until they need something: an `Event`."""
        event = Event.empty(paths.count)
        switching = paths.part(Switching)
        run(_paths.advance, paths.count, self.grains, self.occupied, paths.part(Walk), switching, event, block=TOGETHER)
        return event

    def next_event(self, paths, event, sample, added):
        """What light samples send by way of rough and matt grains, added (n, 3); event : of these paths, by `advance`."""
        run(_paths.next_event, paths.count, self.grains, self.colours, paths.part(Walk), event, sample, added)

    def scatter(self, paths, event):
        """Turns paths at rough and matt grains; event.alive becomes whether they go on."""
        run(_paths.scatter, paths.count, self.grains, paths.part(Walk), event)

    def transmittance(self, point, direction, distance, share):
        """Share (n, L) of light that gets from points along directions to a distance."""
        share[:] = (self.entry(point, direction, distance) == np.inf)[:, None]

    def reached(self, point, direction, far):
        """Whether rays come to where grains of the body may be before far (n,) m: (n,) bool."""
        comes = np.empty(len(point), bool)
        run(_paths.reached, len(point), self.grains, point, direction, far, comes)
        return comes

    def entry(self, point, direction, far, inside=True):
        """Distances (n,) m to the first grain before far (n,) m, inf where there is none; not `inside`: of paths that have passed
        all grains of the body."""
        return first_grain(self.grains, point, direction, far) if inside else np.full(len(point), np.inf)

    def seen(self, point, direction, far):
        """As `seen_grain`."""
        return seen_grain(self.grains, point, direction, far)


def first_grain(grains, point, direction, far):
    """Distances (n,) m from points along directions to the first of `_grains.Grains` before far (n,) m; inf: none."""
    return seen_grain(grains, point, direction, far)[0]


def seen_grain(grains, point, direction, far):
    """The same, and outward normals (n, 3) there, 0 where there is none."""
    t, normal = first_surface(grains, point, direction, far, np.full((len(point), 4), UNKNOWN), np.full(len(point), -1))
    normal[t == np.inf] = 0.0
    return t, normal


def first_surface(grains, point, direction, far, sphere, triangle):
    """Distances (n,) m and normals (n, 3) as of `_paths.first_surface`."""
    n, start = len(point), (sphere, triangle)
    t, normal = np.empty(n), np.empty((n, 3))
    # of a camera they have single precision: the kernel takes double, and is compiled once
    direction = np.ascontiguousarray(direction, float)
    run(_paths.first_surface, n, grains, point, direction, far, start, t, normal, block=4 * TOGETHER)
    return t, normal


def starting(origin, direction, waves, states, pixel, technique) -> Paths:
    """Paths from places in the open."""
    n, unknown = len(pixel), np.full((len(pixel), 3), np.nan)
    return Paths.begun(origin, direction, waves, states, pixel, far=np.nan, sphere=np.full((n, 4), UNKNOWN), triangle=-1, body=-1,
                       beyond=-1, technique=technique, last=unknown, stage=NEVER, switching=False, centre=unknown.copy())


def streams_of(point, direction, distance):
    """Random streams (n,) of ways from points (n, 3) along directions (n, 3) to a distance (n,): the same for the same way."""
    words = np.concatenate([point, direction, np.reshape(distance, (len(point), 1))], axis=1).astype(float, order="C")
    return stream_key(0, "render.clear") ^ (words.view(np.uint64) @ _POWERS)
