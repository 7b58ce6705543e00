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
is given back as 1/T, which is right in the mean where T is known; `behind` of `add_light`.

The mean is off by c^2 times the curvature of what light of one direction becomes.  The chord goes with n samples as n^(-1/6), as
that of the discs of Kaplanyan & Dachsbacher 2013 (Path Space Regularization for Holistic and Robust Light Transport), so that
the picture goes to that of the lamp itself, and its variance to 0.
"""

import math

import numpy as np

from renderers.mitsuba.shading import FAR
from renderers.transport import steps, wavefront

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


def begin(paths, c, turned=True):
    """Gives directions that have no density and come from grains that of their cone, and says which paths (m,) those are.

    turned : (n,) whether what turned paths last was a material
    """
    if c == 0:
        return np.zeros(0, int)
    rows = np.flatnonzero(paths.single & (paths.order > 0) & turned)
    paths.density[rows], paths.single[rows] = 1 / (math.pi * c * c), False
    return rows


def add_light(world, colours, paths, distance, c, sums, behind=None):
    """Adds what light samples from where paths began bring in their cones, before the surfaces that they meet.

    distance : (n,) m, to these; inf where there are none
    behind : function of paths (m,), points (m, 3) m of lamps on their ways, and distances (m,) m from there to surfaces -> share
        (m, L) of the light that media between these leave, which paths that came so far have lost; None: there are no media
    """
    numbers, density = np.empty((paths.count, 3)), 1 / (math.pi * c * c)
    wavefront.draw(paths.states, numbers)
    sample = world.lights(paths.origin, numbers, hidden=False)
    within = np.sum((sample.direction - paths.direction) ** 2, axis=1) < c * c
    # a lamp of a density p has a solid angle of 1/p or less: what is nearer than its point by its width may be its own surface
    depth = np.where(sample.delta, 0.0, np.minimum(2 / np.sqrt(math.pi * np.maximum(sample.density, 1e-30)), c))
    rows = np.flatnonzero(within & (sample.distance * (1 - depth) <= distance))
    sample, paths, distance = sample.of(rows), paths.of(rows), distance[rows]
    if behind is not None:
        near = np.flatnonzero(sample.distance < np.minimum(distance, FAR))
        group, to_lamp = paths.of(near), sample.distance[near]
        passed = behind(group, group.origin + to_lamp[:, None] * group.direction, distance[near] - to_lamp)
        paths.throughput[near] /= np.where(passed > 0, passed, 1.0)
    radiance = sample.radiance * (density * sample.share(density))[:, None]
    steps.add_light(colours, paths.throughput, paths.order, radiance.astype(np.float32), sample.light, paths, sums)
