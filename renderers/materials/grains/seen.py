"""How what stands for grains is turned, as a camera sees it."""

import numpy as np

_BESIDE = 1e-4  # rad, between rays whose ends tell how a surface is turned


def by_ends(entry, point, direction, far):
    """Distances (n,) m of a function of points (n, 3) m, directions (n, 3) and far (n,) m, and normals (n, 3) there, from where
    rays beside each other end; 0 where one of them meets nothing."""
    across = np.cross(direction, np.eye(3)[np.argmin(abs(direction), axis=1)])
    rays = [direction, *(direction + _BESIDE * side for side in (across, np.cross(direction, across)))]
    distances = [entry(point, ray, far) for ray in rays]
    first, *beside = [np.where(np.isfinite(t), t, 0.0)[:, None] * ray for t, ray in zip(distances, rays)]
    normal = np.cross(*(end - first for end in beside))
    length = np.linalg.norm(normal, axis=1) * np.isfinite(distances).all(axis=0)
    return distances[0], normal * np.divide(1.0, length, out=np.zeros(len(length)), where=length > 0)[:, None]


def remembering(seen):
    """A function of arrays that gives what it gave last where it is asked for the same: layer `depth.Z` and the filter of a draft
    both ask what rays through the middles of the pixels meet."""
    asked, told = [], []

    def again(*rays):
        if not (asked and all(map(np.array_equal, asked, rays))):
            asked[:], told[:] = rays, seen(*rays)
        return told

    return again
