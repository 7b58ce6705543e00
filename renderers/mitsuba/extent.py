"""How far the surfaces of a Mitsuba scene are from its camera, and how far they reach."""

from typing import NamedTuple

import numpy as np

from bakery.errors import UsageError
from renderers.mitsuba.world import FAR, World

_SIZE = 48, 64  # rays of the camera


class Extent(NamedTuple):
    """Of a scene, in its own units.

    depth : median distance of the surfaces that the camera sees
    low, high : (3,) corners of the box around surfaces and camera
    sky : whether a light at infinity shines
    sensors : how many the file has, of which the first is the camera
    """

    depth: float
    low: np.ndarray
    high: np.ndarray
    sky: bool
    sensors: int


def seen(path) -> Extent:
    """Of a scene's file; UsageError where it cannot be loaded, has no camera, or that sees no surface."""
    world = World(path, size=_SIZE)
    if world.camera is None:
        raise UsageError(f"{path}: found no sensor; expected a scene with a perspective camera")
    pixels = np.indices(_SIZE).reshape(2, -1).T
    distance = world.trace(*world.camera_rays(np.full(pixels.shape, 0.5), pixels), FAR)
    distance = distance[np.isfinite(distance)]
    if not len(distance):
        raise UsageError(f"{path}: found no surface before the camera, so nothing says how large the scene is; "
                         "expected a scene with a surface in view")
    corners = np.concatenate([world.box, [world.camera.origin]])
    return Extent(float(np.median(distance)), corners.min(axis=0), corners.max(axis=0), world.sky,
                  len(world.scene.sensors()))
