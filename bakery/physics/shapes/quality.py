"""What a closed mesh measures: volume, area, bodies, which of them lie in others, and where it crosses itself.

Topology is `mending`'s to tell; here stands what generated shapes need as well.
Crossings are our own: trimesh and manifold3d do not find them, and pymeshlab, which does, is an extra because of its licence.
"""

from dataclasses import dataclass

import numpy as np

FACES = 4, 2_000_000  # triangles of a usable mesh, fewest and most


@dataclass(frozen=True)
class Tree:
    """A mesh with a tree of boxes over its triangles, in the order of a space-filling curve."""

    vertices: np.ndarray
    faces: np.ndarray
    order: np.ndarray
    box: np.ndarray


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

    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    links = coo_array((np.ones(len(start), np.int8), (start, end)), shape=(len(vertices),) * 2)
    label = connected_components(links, directed=False)[1][faces[:, 0]]
    body = np.unique(label, return_inverse=True)[1]
    return body, body_volumes(vertices, faces, body)


def body_volumes(vertices, faces, body):
    """Volumes (B,) of closed bodies, negative where triangles are wound inward."""
    corner = np.asarray(vertices, float)
    corner = (corner - corner.mean(axis=0))[faces]
    return np.bincount(body, (np.cross(corner[:, 0], corner[:, 1]) * corner[:, 2]).sum(axis=1)) / 6


def around(vertices, faces, body):
    """How many other bodies each body (B,) lies in, if none crosses another.

    Solid angles of a body's triangles, seen from a corner of another, add up to 4 pi inside and 0 outside, whatever the winding.
    Source: Van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30, 125 (1983).
    """
    corner = np.asarray(vertices, float)[faces]
    number = int(body.max()) + 1
    low, high = np.full((number, 3), np.inf), np.full((number, 3), -np.inf)
    np.minimum.at(low, body, corner.min(axis=1))
    np.maximum.at(high, body, corner.max(axis=1))
    first = np.unique(body, return_index=True)[1]
    count = np.zeros(number, int)
    for k, point in enumerate(corner[first, 0]):
        near = ((low <= point) & (point <= high)).all(axis=1)
        near[k] = False
        if near.any():
            seen = near[body]
            angle = np.bincount(body[seen], _solid_angles(corner[seen] - point), number)
            count[k] = (np.abs(angle) > 2 * np.pi).sum()
    return count


def _solid_angles(corner):
    """Signed solid angles (F,) of triangles (F, 3, 3) seen from the origin."""
    a, b, c = corner.transpose(1, 0, 2)
    la, lb, lc = (np.sqrt((x * x).sum(axis=1)) for x in (a, b, c))
    across = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return 2 * np.arctan2((a * np.cross(b, c)).sum(axis=1), across)


def tree(vertices, faces) -> Tree:
    """A tree of boxes over triangles (F, 3) of vertices (V, 3)."""
    from bakery.physics.shapes._triangles import boxes

    vertices, faces = np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces, np.int32)
    centre = vertices[faces].mean(axis=1)
    low = centre.min(axis=0)
    cell = (1023 * ((centre - low) / max(float(np.ptp(centre, axis=0).max()), 1e-300))).astype(np.int64)
    order = np.argsort(_spread(cell[:, 0]) | _spread(cell[:, 1]) << 1 | _spread(cell[:, 2]) << 2, kind="stable")
    return Tree(vertices, faces, order, boxes(vertices, faces, order))


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


def _spread(x):
    """Bits of ten-bit numbers with two zeros between each and the next."""
    x = (x | x << 16) & 0x030000FF
    x = (x | x << 8) & 0x0300F00F
    x = (x | x << 4) & 0x030C30C3
    return (x | x << 2) & 0x09249249
