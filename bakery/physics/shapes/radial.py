"""Closed meshes of star-shaped bodies: the length of the radius in each direction, on a sphere divided into triangles.

Radii that are positive give a mesh that crosses itself nowhere: each triangle stays in the cone of its own directions.
"""

from functools import lru_cache
from itertools import combinations

import numpy as np

from bakery.physics.shapes.noise import directions, fractal_noise


@lru_cache(maxsize=2)
def icosphere(triangles):
    """Directions and triangles of a sphere, from an icosahedron whose edges are divided evenly.

    triangles : wanted number, at least 20; made are 20 n^2, the nearest

    Returns vertices : (V, 3) unit vectors;  faces : (F, 3) int32, outward; both read-only
    """
    n = max(round((triangles / 20) ** 0.5), 1)
    corner, face = _icosahedron()
    vertices, edges = [corner], {}
    count = len(corner)
    share = np.arange(1, n)[:, None] / n
    for a, b in {(min(f[i], f[i - 1]), max(f[i], f[i - 1])): None for f in face.tolist() for i in range(3)}:
        vertices.append(corner[a] * (1 - share) + corner[b] * share)
        edges[a, b] = np.arange(count, count + n - 1)
        edges[b, a] = edges[a, b][::-1]
        count += n - 1
    faces = []
    for a, b, c in face.tolist():
        # index[i, j]: i steps from a towards b, j towards c
        index = np.full((n + 1, n + 1), -1)
        index[0, 0], index[n, 0], index[0, n] = a, b, c
        step = np.arange(1, n)
        index[step, 0], index[0, step], index[n - step, step] = edges[a, b], edges[a, c], edges[b, c]
        i, j = (k.ravel() for k in np.meshgrid(step, step, indexing="ij"))
        i, j = i[i + j < n], j[i + j < n]
        index[i, j] = np.arange(count, count + i.size)
        count += i.size
        vertices.append((corner[a] * (n - i - j)[:, None] + corner[b] * i[:, None] + corner[c] * j[:, None]) / n)
        i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
        up, down = i + j < n, i + j < n - 1
        faces.append(np.stack([index[i[up], j[up]], index[i[up] + 1, j[up]], index[i[up], j[up] + 1]], axis=1))
        i, j = i[down], j[down]
        faces.append(np.stack([index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]], axis=1))
    vertices, faces = unit(np.concatenate(vertices)), np.concatenate(faces).astype(np.int32)
    vertices.flags.writeable = faces.flags.writeable = False
    return vertices, faces


def sampling(triangles, axes=(1.0, 1.0, 1.0), corners=()):
    """Directions (V, 3) on which to sample a body with these axes, and their triangles (F, 3).

    Those of the sphere, moved with its points.  Where the body has corners, (C, 3), the most important first, the nearest
    direction is moved there, unless that is closer than three edges to one before: else the size would depend on how nearly
    the farthest corner happens to be met, by 1 % with 20,000 triangles.
    """
    vertices, faces = icosphere(triangles)
    apart = np.cos(min(3 * 2.7 / len(faces) ** 0.5, 1.0))
    taken = np.zeros((0, 3))
    for corner in corners:
        direction = unit(corner / np.asarray(axes, float))
        if len(taken) and (taken * direction).sum(axis=1).max() > apart:
            continue
        if not len(taken):
            vertices = vertices.copy()
        # within its own share of the sphere a point sees all its neighbours the right way round
        vertices[np.argmax(sum(vertices[:, k] * direction[k] for k in range(3)))] = direction
        taken = np.concatenate([taken, [direction]])
    return unit(vertices * np.asarray(axes, float)), faces


def between_planes(direction, normal, distance, sharpness):
    """Radius (N,) of the body within planes n.x = h > 0, whose edges are rounded: 1/r = (sum (n.u/h)^p)^(1/p) over n.u > 0.

    direction : (N, 3) unit vectors;  normal : (P, 3) outward unit vectors;  distance : (P,)
    sharpness : p; edges of two planes lose a share of about ln 2 / p of the radius; inf leaves them sharp
    """
    inverse = np.zeros(len(direction))
    for k in range(0, len(normal), 8):
        n, h = normal[k:k + 8], distance[k:k + 8]
        reach = sum(direction[:, i, None] * (n[:, i] / h) for i in range(3))
        inverse = np.maximum(inverse, reach.max(axis=1))
    if not np.isfinite(sharpness):
        return 1 / inverse
    total = np.zeros(len(direction))
    for n, h in zip(normal, distance, strict=True):
        reach = sum(direction[:, i] * (n[i] / h) for i in range(3))
        total += np.maximum(reach / inverse, 0.0) ** sharpness
    return 1 / (inverse * total ** (1 / sharpness))


def roughened(points, roughness, rng, frequency):
    """Star-shaped bodies with radii times exp(roughness * noise), five octaves from `frequency` times the distance; (N, 3)."""
    if roughness == 0:
        return points
    return points * np.exp(roughness * fractal_noise(points, rng, frequency=frequency))[:, None]


def hull_planes(points):
    """Outward unit normals (P, 3) and distances (P,) from the origin of the planes of a convex hull."""
    from scipy.spatial import ConvexHull

    equation = ConvexHull(points).equations
    return equation[:, :3], -equation[:, 3]


def corners_of(normal, distance):
    """Corners (C, 3) of the body within planes."""
    from scipy.spatial import HalfspaceIntersection

    return HalfspaceIntersection(np.column_stack([normal, -distance]), np.zeros(3)).intersections


def cut_corners(normal, distance, rng, chips, depth):
    """Planes with `chips` more, each of which takes a random share of up to `depth` of the height off what stands out farthest
    in a random direction: mostly a corner."""
    for _ in range(chips):
        direction = directions(rng, 1)[0]
        reach = (corners_of(normal, distance) * direction).sum(axis=1).max()
        normal = np.concatenate([normal, [direction]])
        distance = np.append(distance, reach * (1 - depth * (0.3 + 0.7 * rng.random())))
    return normal, distance


def unit(v):
    """Vectors (..., 3) of length 1."""
    v = np.asarray(v, float)
    return v / np.sqrt((v**2).sum(axis=-1, keepdims=True))


def _icosahedron():
    long = 0.5 * (1 + 5**0.5)
    corner = np.array([[s, t * long, 0] for s in (-1, 1) for t in (-1, 1)], float)
    corner = unit(np.concatenate([corner, np.roll(corner, 1, axis=1), np.roll(corner, 2, axis=1)]))
    near = ((corner[:, None] - corner) ** 2).sum(axis=-1) < 1.2
    face = [f for f in combinations(range(12), 3) if all(near[a, b] for a, b in combinations(f, 2))]
    return corner, np.array([f if np.linalg.det(corner[list(f)]) > 0 else f[::-1] for f in face])
