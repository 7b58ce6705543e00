"""What a closed mesh measures: volume, area, bodies, handles, the shape of its triangles, and where it crosses itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bakery.physics.shapes.lines import Tree

FACES = 4, 2_000_000  # triangles of a usable mesh, fewest and most


@dataclass(frozen=True)
class Figures:
    """What a closed mesh measures, in its own unit.

    Attributes
    ----------
    volume, area : signed by the winding, and of all triangles
    bodies : connected surfaces, cavities included;  genus : handles of all of them together
    shortest, longest : edges;  sharpest : smallest angle of any triangle, rad
    """

    volume: float
    area: float
    bodies: int
    genus: int
    shortest: float
    longest: float
    sharpest: float


def figures(vertices, faces) -> Figures:
    """Volume, area, topology and the shape of the triangles of a closed mesh."""
    corner = np.asarray(vertices, float)[faces]
    side = np.roll(corner, -1, axis=1) - corner
    length = np.sqrt((side**2).sum(axis=2))
    double = np.sqrt((np.cross(side[:, 0], side[:, 1]) ** 2).sum(axis=1))
    cosine = -(side * np.roll(side, -1, axis=1)).sum(axis=2)
    angle = np.arctan2(np.broadcast_to(double[:, None], cosine.shape), cosine)
    number = len(bodies(vertices, faces)[1])
    euler = len(np.unique(faces)) - 3 * len(faces) // 2 + len(faces)
    return Figures(volume(vertices, faces), float(0.5 * double.sum()), number, number - euler // 2, float(length.min()),
                   float(length.max()), float(angle.min()))


def volume(vertices, faces) -> float:
    """Volume enclosed by a closed mesh, positive where triangles are wound outward."""
    corner = np.asarray(vertices, float)[faces]
    corner = corner - corner.reshape(-1, 3).mean(axis=0)
    return float((np.cross(corner[:, 0], corner[:, 1]) * corner[:, 2]).sum() / 6)


def area(vertices, faces) -> float:
    """Area of all triangles."""
    return float(0.5 * np.sqrt((double_normals(vertices, faces) ** 2).sum(axis=1)).sum())


def bodies(vertices, faces, order=None, count=None):
    """Connected surfaces of a closed mesh: number of each triangle's surface (F,), and their volumes (B,), cavities negative."""
    from bakery.physics.shapes._triangles import oriented

    if order is None:
        _, order, count = edges(faces, len(vertices))
    body = oriented(*neighbours(faces, order, count))[0]
    corner = np.asarray(vertices, float)
    corner = (corner - corner.mean(axis=0))[faces]
    return body, np.bincount(body, (np.cross(corner[:, 0], corner[:, 1]) * corner[:, 2]).sum(axis=1)) / 6


def self_crossings(mesh: Tree, limit=1000):
    """Pairs of triangles (K, 2) that share more than their common corners, at most `limit`; 0.5 s for 200,000 triangles.

    Triangles that merely touch to rounding do not count.
    """
    from bakery.physics.shapes._triangles import self_crossings as found

    return found(mesh.vertices, mesh.faces, mesh.order, mesh.box, limit)


def key(a, b, number):
    """Edges between vertices a and b as whole numbers."""
    return a.astype(np.int64) * number + b


def edges(faces, number):
    """Undirected edges as keys (E,), the sides of triangles in the order of their edges, and how many each edge has."""
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edge = key(np.minimum(a, b), np.maximum(a, b), number)
    order = np.argsort(edge, kind="stable")
    edge = edge[order]
    start = np.flatnonzero(np.concatenate([[True], edge[1:] != edge[:-1]]))
    return edge[start], order, np.diff(start, append=len(edge))


def neighbours(faces, order, count):
    """Triangle across each side (F, 3), -1 where there is none, and whether it runs along that side in the same direction."""
    neighbour, against = np.full(faces.size, -1, np.int64), np.zeros(faces.size, bool)
    start = (np.cumsum(count) - count)[count == 2]
    one, two = order[start], order[start + 1]
    upward = (faces < np.roll(faces, -1, axis=1)).ravel()
    neighbour[one], neighbour[two] = two // 3, one // 3
    against[one] = against[two] = upward[one] == upward[two]
    return neighbour.reshape(-1, 3), against.reshape(-1, 3)


def double_normals(vertices, faces):
    """Normals (F, 3) as long as twice the area."""
    corner = np.asarray(vertices, float)[faces]
    return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
