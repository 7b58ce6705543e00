"""Camera paths among grains: their state, and explicit path tracing from grain to grain, with next-event estimation to the lights
where a surface is not smooth.

Compiled loops take each path through the grains until it needs something that all paths get together (`transport`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from bakery.kernels import stream_key
from renderers.granular import _paths
from renderers.granular._grains import UNKNOWN
from renderers.threads import run

NEVER = 2**62  # a stage that no path comes to
SELDOM = 1 / 64  # chance of a light sample far inside
_LEAST = 1 / 8  # of the light samples; with fewer, each of them would be seen
_POWERS = np.cumprod(np.full(7, 0x9E3779B97F4A7C15, np.uint64))  # odd, modulo 2^64: make a number of a way's seven words


class Colours(NamedTuple):
    """to_rgb : (3, L) linear sRGB from radiances;  to_waves : (L, 3) radiances from linear sRGB"""

    to_rgb: np.ndarray
    to_waves: np.ndarray


class Seldom:
    """Layouts with a `chance` (X, Y, Z) of light samples, and the same with less.

    Pictures are the same in the mean; the fewer paths go on, the more each call of Mitsuba's for lights costs.
    """

    def __init__(self, layout):
        self._made = {1.0: layout}

    def by(self, share):
        """With a share, a power of 1/2, of the samples; far inside, where they are seldom anyway, no less."""
        share = max(share, _LEAST)
        if share not in self._made:
            layout = self._made[1.0]
            less = {"chance": np.maximum(np.float32(share) * layout.chance, np.float32(SELDOM))}
            self._made[share] = layout._replace(**less | ({"often": share} if "often" in layout._fields else {}))
        return self._made[share]


class Explicit:
    """Paths from grain to grain.

    grains : `Grains` of one mesh;  occupied : (X, Y, Z) uint8, its voxels with surfaces of the scene, empty where there are none
    colours : `Colours`
    """

    def __init__(self, grains, occupied, colours):
        self.grains, self.occupied, self.colours = grains, occupied, colours
        self._seldom = Seldom(grains)

    def sample_lights(self, share):
        """Lights are sampled so often, against what the grains' `chance` says, until this is called again."""
        self.grains = self._seldom.by(share)

    def advance(self, paths):
        """Takes paths on until they need something: what (n,), and normal and type of grain of those that need LIGHT."""
        n = len(paths)
        normal, kind, status, alive = np.empty((n, 3)), np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, bool)
        run(_paths.advance, n, self.grains, self.occupied, paths.origin, paths.direction, paths.weight, paths.states,
            paths.met, paths.place, paths.far, paths.order, paths.bounces, paths.single, paths.density, paths.last, paths.stage,
            paths.switching, normal, kind, status, alive)
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

    def entry(self, point, direction, far, inside=True):
        """Distances (n,) m to the first grain before far (n,) m, inf where there is none; not `inside`: of paths that have passed
        all grains of the body."""
        return first_grain(self.grains, point, direction, far) if inside else np.full(len(point), np.inf)


def first_grain(grains, point, direction, far):
    """Distances (n,) m from points along directions to the first of `_grains.Grains` before far (n,) m; inf: none."""
    t = np.full(len(point), np.inf)
    run(_paths.first_grain, len(point), grains, point, direction, far, t)
    return t


@dataclass
class Paths:
    """Camera paths on their way, n of them.

    origin, direction : (n, 3) m, unit;  weight : (n, L);  states : (n,) random streams;  pixel : (n,)
    met, place : (n, 4), (n,) sphere and triangle that each starts on (`_grains.next_surface`)
    far : (n,) m, to the first surface of the scene, or what is of another body; nan: not known
    beyond : (n,) that body, -1 where it is a surface or nothing
    density : (n,) 1/sr, with which the direction was drawn;  single : (n,) whether light sampling cannot take it
    order : (n,) grains met;  bounces : (n,) surfaces met
    body : (n,) in which each goes on, -1 where that is not known
    technique : (n,) GRAINS, MEDIUM or DIFFUSION
    last : (n, 3) m, where it met the last grain
    stage, switching : (n,) grains after which it waits for others; whether the next one is a scattering of the medium
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
    beyond: np.ndarray
    density: np.ndarray
    single: np.ndarray
    order: np.ndarray
    bounces: np.ndarray
    body: np.ndarray
    technique: np.ndarray
    last: np.ndarray
    stage: np.ndarray
    switching: np.ndarray
    centre: np.ndarray

    @classmethod
    def begun(cls, origin, direction, waves, states, pixel, technique):
        """Paths from places in the open."""
        n = len(pixel)
        none, zero, unknown = np.full(n, -1), np.zeros(n, np.int64), np.full((n, 3), np.nan)
        return cls(origin=origin, direction=direction, weight=np.ones((n, waves)), states=states, pixel=pixel,
                   met=np.full((n, 4), UNKNOWN), place=none, far=np.full(n, np.nan), beyond=none.copy(), density=np.zeros(n),
                   single=np.ones(n, bool), order=zero, bounces=zero.copy(), body=none.copy(), technique=np.full(n, technique),
                   last=unknown, stage=np.full(n, NEVER), switching=np.zeros(n, bool), centre=unknown.copy())

    def of(self, chosen):
        """Some of the paths: a mask (n,), numbers of paths or a slice; copies."""
        # `take` copies whole rows: a third to two thirds of the time of indexing with a mask
        rows = np.arange(len(self))[chosen]
        return Paths(*(getattr(self, field.name).take(rows, axis=0) for field in fields(self)))

    def __len__(self):
        return len(self.pixel)


def streams_of(point, direction, distance):
    """Random streams (n,) of ways from points (n, 3) along directions (n, 3) to a distance (n,): the same for the same way."""
    words = np.concatenate([point, direction, np.reshape(distance, (len(point), 1))], axis=1).astype(float, order="C")
    return stream_key(0, "render.clear") ^ (words.view(np.uint64) @ _POWERS)


def joined(parts) -> Paths:
    """Paths of several."""
    parts = [part for part in parts if len(part)] or parts[:1]
    return parts[0] if len(parts) == 1 else Paths(*(np.concatenate([getattr(part, field.name) for part in parts])
                                                    for field in fields(Paths)))
