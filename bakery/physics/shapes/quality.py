"""What a closed mesh measures: volume, area, bodies, and where it crosses itself.

Topology is trimesh's to tell (`mending` asks it); here stands what generated shapes need as well, which load no trimesh.
Crossings are our own: trimesh and manifold3d do not find them, and pymeshlab, which does, is an extra because of its licence.
"""

from __future__ import annotations

import numpy as np

from bakery.physics.shapes.lines import Tree

FACES = 4, 2_000_000  # triangles of a usable mesh, fewest and most


def volume(vertices, faces) -> float:
    """Volume enclosed by a closed mesh, positive where triangles are wound outward."""
    corner = np.asarray(vertices, float)[faces]
    corner = corner - corner.reshape(-1, 3).mean(axis=0)
    return float((np.cross(corner[:, 0], corner[:, 1]) * corner[:, 2]).sum() / 6)


def area(vertices, faces) -> float:
    """Area of all triangles."""
    return float(0.5 * np.sqrt((double_normals(vertices, faces) ** 2).sum(axis=1)).sum())


def bodies(vertices, faces):
    """Triangles connected by their corners: number of each triangle's body (F,), and volumes (B,), negative for cavities."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    one, two = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    links = coo_array((np.ones(len(one), np.int8), (one, two)), shape=(len(vertices),) * 2)
    label = connected_components(links, directed=False)[1][faces[:, 0]]
    body = np.unique(label, return_inverse=True)[1]
    return body, body_volumes(vertices, faces, body)


def body_volumes(vertices, faces, body):
    """Volumes (B,) of closed bodies, negative where triangles are wound inward."""
    corner = np.asarray(vertices, float)
    corner = (corner - corner.mean(axis=0))[faces]
    return np.bincount(body, (np.cross(corner[:, 0], corner[:, 1]) * corner[:, 2]).sum(axis=1)) / 6


def self_crossings(mesh: Tree, limit=1000):
    """Pairs of triangles (K, 2) that share more than their common corners, at most `limit`; 0.5 s for 200,000 triangles.

    Triangles that merely touch to rounding do not count.
    """
    from bakery.physics.shapes._triangles import self_crossings as found

    return found(mesh.vertices, mesh.faces, mesh.order, mesh.box, limit)


def double_normals(vertices, faces):
    """Normals (F, 3) as long as twice the area."""
    corner = np.asarray(vertices, float)[faces]
    return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
