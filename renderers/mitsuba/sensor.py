"""What a sensor of a Mitsuba scene sees: the pinhole camera that it is, and distances along its rays."""

import drjit as dr
import mitsuba as mi
import numpy as np

from bakery.errors import UsageError
from renderers.camera import Camera, length
from renderers.mitsuba import shading


def camera_of(sensor, path, width, height):
    """The pinhole camera that a sensor is, from the rays that it sends through four corners of its film.

    sensor : of Mitsuba
    path : of its scene, for the message
    width, height : of its film, pixels

    Raises UsageError: no perspective camera.
    """
    matrix = np.array(sensor.world_transform().matrix, float).reshape(4, 4)
    origin, ahead = matrix[:3, 3], matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    plane = []
    # meters have no film in front of them: all corners are one ray, or none
    for start, direction in zip(*_corner_rays(sensor)) if isinstance(sensor, mi.ProjectiveCamera) else ():
        start = start - origin
        if np.linalg.norm(np.cross(start, direction)) > 1e-4 * max(1.0, np.linalg.norm(origin)) or not direction @ ahead > 0:
            plane = []
            break
        plane.append(direction / (direction @ ahead))
    if not plane or np.abs(plane[1] + plane[2] - plane[0] - plane[3]).max() > 1e-4 * np.abs(plane[3] - plane[0]).max():
        raise UsageError(f"{path}: the first sensor is of the kind {sensor.class_name()}; expected a perspective camera")
    return Camera(origin, plane[0], (plane[1] - plane[0]) / width, (plane[2] - plane[0]) / height)


def _corner_rays(sensor):
    """Origins (4, 3) and directions (4, 3) of rays through the corners of a film, by one kernel: top left, top right, bottom."""
    x, y = [0, 1, 0, 1], [0, 0, 1, 1]
    if dr.is_jit_v(mi.Float):
        ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(mi.Float(x), mi.Float(y)), mi.Point2f(0.5))
        return [rows.astype(float) for rows in shading.arrays(4, ray.o, ray.d)]
    rays = [sensor.sample_ray(0.0, 0.5, mi.Point2f(*corner), mi.Point2f(0.5))[0] for corner in zip(x, y)]
    return np.array([ray.o for ray in rays], float), np.array([ray.d for ray in rays], float)


def distances(scene, sensor, camera, height, width):
    """Distances of the first surfaces between the clipping planes, (H, W) in units of the scene; inf where there is none.

    One ray a pixel, through its middle, whatever the surface is made of.
    """
    directions = camera.rays(height, width).reshape(-1, 3)
    slant = length(camera.points(height, width)).reshape(-1)  # distance over z
    near, far = sensor.near_clip() * slant, sensor.far_clip() * slant
    start = camera.origin + near[:, None] * directions
    depth = np.full(len(directions), np.inf)
    if dr.is_jit_v(mi.Float):
        ray = mi.Ray3f(mi.Point3f(*shading.columns(start)), mi.Vector3f(*shading.columns(directions)))
        ray.maxt = shading.rows(far - near)
        hit = scene.ray_intersect_preliminary(ray, coherent=True)
        valid, distance = shading.arrays(len(depth), hit.is_valid(), hit.t)
        depth = np.where(valid, distance.astype(float), np.inf)
    else:
        for i, (begin, direction, limit) in enumerate(zip(start.tolist(), directions.tolist(), (far - near).tolist())):
            ray = mi.Ray3f(begin, direction)
            ray.maxt = limit
            hit = scene.ray_intersect_preliminary(ray, coherent=True)
            if hit.is_valid():
                depth[i] = hit.t
    return (depth + near).reshape(height, width)
