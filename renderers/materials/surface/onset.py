"""From which distance to the camera the boundary of a body is its baked surface, and how far a picture is off by that.

Near, where light spreads over pixels, paths go into the body; far, where it spreads within one, the surface sends them on.  In
between, up to twice the distance, either happens with a chance that the place gives (`renderers.transport.far`), so that what
the surface leaves out fades in with it: a place is off by the chance times what its surface is off there.
"""

import math
from typing import NamedTuple

import numpy as np

from renderers.materials.surface import far
from renderers.scene import budget
from renderers.scene.budget import percent
from renderers.scene.meshes import length
from renderers.transport import solids
from renderers.transport.far import chance

_STEPS = 200  # distances that are tried, between the nearest and the farthest that the camera sees


class Onset(NamedTuple):
    """near : m, distance up to which paths go in, inf where they do everywhere;  error : expected, root mean square over the
    body's light;  share : of the surface in what the camera sees of the body"""

    near: float
    error: float
    share: float


class Look(NamedTuple):
    """What tells how far off the surface of a material is.

    bent : (L,) error where its boundary bends;  mean : (L,) m, distance that light spreads
    seen : `far.Seen`;  single : (N,) error of pixels at the places of `seen` by what may be told apart in them
    """

    bent: np.ndarray
    mean: np.ndarray
    seen: far.Seen
    single: np.ndarray | float = 0.0


def of(scene, number, asset, world) -> Onset:
    """Of a body of a scene, by its number."""
    entry = scene.values.materials[number]
    (shape,) = (shape for shape in world.shapes() if shape.name == entry.where.shape)
    layer = entry.layer or 0
    look = Look(far.bent(shape, far.spread(asset, layer)), far.mean_distance(asset, layer), far.seen_by(world, shape))
    return begins(scene, number, look)


def begins(scene, number, look: Look, near_error=0.0) -> Onset:
    """Of an entry of a scene: as it says, or else the nearest where the error is what a method may have, near_error : that of
    what is near included, where that is less.

    Nearer than where a pixel is as wide as light spreads in the mean, edges of shadows would be seen to be sharper; and a
    boundary that bends too much is nowhere a surface.
    """
    stated = scene.values.materials[number].surface_from
    if stated is not None:
        return _at(stated, look)
    allowed = budget.ROOM * (scene.values.tolerance or budget.DEFAULT)
    allowed = math.sqrt(allowed**2 - near_error**2) if near_error < allowed else allowed
    if math.sqrt(float(np.mean(look.bent**2))) > allowed:
        return Onset(math.inf, 0.0, 0.0)
    seen = look.seen
    least = float(np.max(look.mean)) / seen.angle
    nearest, farthest = float(seen.width.min()) / seen.angle, float(seen.width.max()) / seen.angle
    tried = np.geomspace(max(least, nearest / 2, 1e-9), max(least, farthest, 1e-9), _STEPS)
    return next((onset for near in tried if (onset := _at(near, look)).error <= allowed and onset.share > 0),
                Onset(math.inf, 0.0, 0.0))


def _at(near, look) -> Onset:
    """Of a distance."""
    seen = look.seen
    if near <= 0:
        chances = np.ones(len(seen.width))
    else:
        chances = chance(seen.width / seen.angle, near, np)
    share = float(chances.mean())
    others = (chances**2 * (look.bent[:, None] ** 2 + np.square(look.single))).mean()
    square = far.at_edges(look.mean, seen, chances**2).mean() + others
    return Onset(float(near), min(1.0, math.sqrt(float(square))), share)


def in_words(number, begins: Onset, paths="paths", into="it") -> str:
    """At which distance a material changes, and how far off that is expected to be; paths, into : what is near, and goes where"""
    if begins.near == np.inf:
        return f"materials[{number}]: all of it is by {paths}: nowhere would its surface keep the tolerance"
    where = f"from {length(begins.near)} to {length(2 * begins.near)} from the camera" if begins.near else "at the camera"
    return (f"materials[{number}]: paths go into {into} near the camera, and its surface sends light on far from it; it changes "
            f"{where}. {percent(begins.share)} of what the camera sees of it is its surface, and an error of "
            f"{percent(begins.error)} of its light is expected of that, but for caustics and other edges of indirect light")


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
