"""How large grains are seen."""

from __future__ import annotations

import numpy as np


def pixels_wide(world, triangles, radius) -> float:
    """Diameter of grains of a radius, m, at the nearest point of a mesh, triangles (F, 3, 3) m, in pixels."""
    return 2 * radius / (angle_of_pixel(world) * max(distance(world.camera.origin, triangles), radius))


def angle_of_pixel(world) -> float:
    """Width of a pixel over its distance, rad."""
    return float(np.sqrt(np.linalg.norm(world.camera.right) * np.linalg.norm(world.camera.down)))


def distance(point, triangles) -> float:
    """From a point (3,) to the nearest of triangles (F, 3, 3)."""
    from trimesh.triangles import closest_point

    return float(np.linalg.norm(closest_point(triangles, np.broadcast_to(point, (len(triangles), 3))) - point, axis=1).min())
