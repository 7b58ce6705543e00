"""From which distance to the camera the boundary of a body is its baked surface, and how far a picture is off by that.

Near, where light spreads over pixels, paths go into the body; far, where it spreads within one, the surface sends them on.  In
between, up to twice the distance, either happens with a chance that the place gives (`renderers.transport.far`), so that what
the surface leaves out fades in with it: a place is off by the chance times what its surface is off there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderers.materials.bodies import far
from renderers.scene import budget
from renderers.transport import solids
from renderers.transport.far import chance

_STEPS = 200  # distances that are tried, between the nearest and the farthest that the camera sees


class Onset(NamedTuple):
    """near : m, distance up to which paths go in, inf where they do everywhere;  error : expected, root mean square over the
    body's light;  share : of the surface in what the camera sees of the body"""

    near: float
    error: float
    share: float


def of(scene, number, asset, world) -> Onset:
    """Of an entry of a scene, by its number: as it says, or else the nearest where the error is what a method may have.

    Notes
    -----
    Nearer than where a pixel is as wide as light spreads in the mean, edges of shadows would be seen to be sharper; and a
    boundary that bends too much is nowhere a surface.
    """
    entry = scene.values.materials[number]
    (shape,) = (shape for shape in world.shapes() if shape.name == entry.where.shape)
    spread, mean = far.spread(asset, entry.layer or 0), far.mean_distance(asset, entry.layer or 0)
    bent, seen = far.bent(shape, spread), far.seen_by(world, shape)
    if entry.surface_from is not None:
        return _at(entry.surface_from, bent, mean, seen)
    allowed = budget.ROOM * (scene.values.tolerance or budget.DEFAULT)
    if math.sqrt(float(np.mean(bent**2))) > allowed:
        return Onset(math.inf, 0.0, 0.0)
    least = float(np.max(mean)) / seen.angle
    nearest, farthest = float(seen.width.min()) / seen.angle, float(seen.width.max()) / seen.angle
    tried = np.geomspace(max(least, nearest / 2, 1e-9), max(least, farthest, 1e-9), _STEPS)
    return next((onset for near in tried if (onset := _at(near, bent, mean, seen)).error <= allowed and onset.share > 0),
                Onset(math.inf, 0.0, 0.0))


def _at(near, bent, mean, seen) -> Onset:
    """Of a distance; bent, mean : (L,) as of `far`;  seen : `far.Seen`"""
    if near <= 0:
        chances = np.ones(len(seen.width))
    else:
        chances = chance(seen.width / seen.angle, near, np)
    share = float(chances.mean())
    edges = far.at_edges(mean, seen.width) * far.crossed_by_edges(share * seen.pixels)
    square = (chances**2 * (edges + bent[:, None] ** 2)).mean()
    return Onset(float(near), min(1.0, math.sqrt(float(square))), share)


def unfit(entry, asset, world) -> str:
    """Why the boundary of a body cannot be its surface from some distance on; "" where it can."""
    if fault := far.unfit(entry, asset, world):
        return fault
    (shape,) = (shape for shape in world.shapes() if shape.name == entry.where.shape)
    if shape.faces is not None and (shape.flipped or solids.volume(shape.vertices, shape.faces) < 0):
        return "its normals point inside, where a surface is black"
    return ""


def reach(world, name) -> tuple[float, float]:
    """Distances to the camera, m, between which all of a shape lies."""
    (shape,) = (shape for shape in world.shapes() if shape.name == name)
    beside = np.maximum(np.maximum(shape.box[0] - world.camera.origin, world.camera.origin - shape.box[1]), 0)
    across = np.max(np.abs(shape.box - world.camera.origin), axis=0)
    return float(np.linalg.norm(beside)), float(np.linalg.norm(across))
