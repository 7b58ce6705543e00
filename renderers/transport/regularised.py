"""Small lamps in smooth grains, seen wider than they are (path space regularisation).

Light samples do not reach a smooth surface: a path from there meets a lamp of solid angle W by a chance that goes as W, and
brings 1/W of its light then.  So light L of a direction is parted by the density p with which lights are sampled,

    L = L p / (p + 1/A) + L (1/A) / (p + 1/A),        A = pi c^2

the solid angle of a cone of directions, c the chord of its half angle.  The second part, nearly all of what is wide, is met by
chance, as before; the first one, nearly all of what is small, is taken of a light sample wherever that is within the cone around
the direction of the path, over A.  A small lamp so looks as a disc of radius c, of the same power, and a wide one as it is: the
balance heuristic of `renderers.transport`, with 1/A as the density of a direction that has none.  Lamps without extent are seen,
too.

A path brings a lamp's light when it has come past it, to a surface.  Light that media between these have taken from it, T of it,
is given back as 1/T, which is right in the mean where T is known; `Wider.behind`.

The mean is off by c^2 times the curvature of what light of one direction becomes.  The chord goes with n samples as n^(-1/6), as
that of the discs of Kaplanyan & Dachsbacher 2013 (Path Space Regularization for Holistic and Robust Light Transport), so that
the picture goes to that of the lamp itself, and its variance to 0.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from renderers.mitsuba.shading import FAR
from renderers.transport import wavefront

MOST = math.radians(20.0)  # half angle of the cone at first
_SHRINKS = -1 / 6


def chord(angle, samples) -> float:
    """Of a half angle, rad, at the first sample; with so many samples of each pixel, 1 or more."""
    return 2 * math.sin(angle / 2) * samples**_SHRINKS


def angle_of(pixels_wide) -> float:
    """Half angle, rad, at the first sample that pixels do not show, where the largest grains are so many of them wide.

    A ball mirrors a disc of radius b as one of b/4 of its width, and shows it, as a lens of glass, as one of 3/4 b.
    """
    return min(MOST, 1 / max(pixels_wide, 1e-30))


class Wider(NamedTuple):
    """How paths see small lamps by way of smooth grains.

    chord : of the half angle of the cone; 0: as they are
    behind : function of paths (m,), points (m, 3) m of lamps on their ways, and distances (m,) m from there to surfaces -> share
        (m, L) of the light that media between these leave, which paths that came so far have lost; None: there are no media
    """

    chord: float
    behind: Callable | None = None

    def begin(self, paths):
        """Gives directions that have no density and come from grains that of their cone, and says which paths (m,) those are."""
        if self.chord == 0:
            return np.zeros(0, int)
        turned = True if paths.shaded is None else ~paths.shaded
        rows = np.flatnonzero(paths.single & (paths.order > 0) & turned)
        paths.density[rows], paths.single[rows] = 1 / (math.pi * self.chord**2), False
        return rows

    def light(self, world, paths, shading, rows):
        """Of paths `rows` (m,) what light samples from where they began bring in their cones, before the surfaces that they met:
        throughputs, orders, radiance, numbers of lights, and the paths."""
        group, c = paths.of(rows), self.chord
        if paths.drawn is not None:
            group = group._replace(origin=group.drawn)
        distance = np.where(shading.hit[rows], np.linalg.norm(shading.point[rows] - group.origin, axis=1), np.inf)
        density = 1 / (math.pi * c * c)
        sample = world.lights(group.origin, wavefront.uniforms(group.states, 3), hidden=False)
        within = np.sum((sample.direction - group.direction) ** 2, axis=1) < c * c
        # a lamp of a density p has a solid angle of 1/p or less: what is nearer than its point by its width may be its surface
        depth = np.where(sample.delta, 0.0, np.minimum(2 / np.sqrt(math.pi * np.maximum(sample.density, 1e-30)), c))
        seen = np.flatnonzero(within & (sample.distance * (1 - depth) <= distance))
        paths.states[rows] = group.states
        sample, group, distance = sample.of(seen), group.of(seen), distance[seen]
        if self.behind is not None:
            near = np.flatnonzero(sample.distance < np.minimum(distance, FAR))
            past, to_lamp = group.of(near), sample.distance[near]
            passed = self.behind(past, past.origin + to_lamp[:, None] * past.direction, distance[near] - to_lamp)
            group.throughput[near] /= np.where(passed > 0, passed, 1.0)
        radiance = sample.radiance * (density * sample.share(density))[:, None]
        return group.throughput, group.order, radiance.astype(np.float32), sample.light, group
