"""Draws a mesh of triangles, or a ball, in the light of sun and sky: a depth buffer for each direction.  For pictures only.

In plain NumPy: loading compiled kernels takes longer than a picture (`python benchmarks/pictures.py`).
Why not matplotlib's polygons: quicker, but with seams and facets, and without the shadows that show the form
(`python benchmarks/meshes.py picture`, docs/grain-shapes.md).
"""

import math

import numpy as np

from bakery.draw.light import shaded
from bakery.draw.view import along, blocks, finished, looking_from, nearest, runs

CREASE = math.cos(math.radians(32.0))  # faces that meet at less are shaded as one surface
_SHADOW = 240  # pixels of a light's depth buffer
_ROUNDING = 1e-9  # pixels


def rendered(vertices, faces, colour, pixels: int = 500, gloss: float = 0.2) -> np.ndarray:
    """A grain in the square from -1.02 to 1.02 of its bounding sphere's plane, seen from above a corner.

    vertices : (V, 3) in bounding radii; None draws the unit ball
    faces : (F, 3)
    colour : (3,) linear, of the surface
    pixels : of an edge
    gloss : strength of highlights

    Returns image : (pixels, pixels, 4) uint8, sRGB and coverage, first row on top
    """
    low, pixel = np.array([-1.02, -1.02]), 2.04 / pixels
    ball = vertices is None
    if ball:
        covered, position, normal = _ball(low, pixel, pixels)
    else:
        seen = _turned(np.asarray(vertices, float), looking_from(np.array([1.0, 0.72, 0.62])))
        index, depth = depths(seen, faces, low, pixel, pixels, pixels)
        covered, position, normal = surfaces(index, depth, seen, faces, smooth_normals(seen, faces, CREASE), low, pixel)

    def shadow(frame):
        step = 2.04 / _SHADOW
        return None if ball else (depths(_turned(seen, frame), faces, low, step, _SHADOW, _SHADOW)[1], low, step)

    light = shaded(position.T, normal.T, colour, gloss, shadow)
    image = np.zeros((pixels, pixels, 3))
    image[covered] = light
    return finished(image, np.where(covered, 0, -1), 1.3)


def depths(position, faces, low, pixel, width, height):
    """Nearest triangle of each pixel seen along -z: its index or -1, and the z of its surface, both (height, width).

    position : (V, 3) in the frame of the view; faces : (F, 3)
    low : (2,) lower left corner; pixel : edge of a pixel
    """
    index, depth = np.full(height * width, -1), np.full(height * width, -np.inf)
    corners = np.take(np.ascontiguousarray(position.T, float), faces.T, axis=1)  # (axis, corner, face)
    for k in (0, 1):
        corners[k] = (corners[k] - low[k]) / pixel - 0.5  # centres of pixels at whole numbers
    (xa, xb, xc), (ya, yb, yc), _ = corners
    area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
    first = np.maximum(np.ceil(corners[1].min(axis=0) - _ROUNDING), 0).astype(int)
    last = np.minimum(np.floor(corners[1].max(axis=0) + _ROUNDING), height - 1).astype(int)
    front = np.flatnonzero((area > 0) & (last >= first))  # seen from inside: another one of a closed surface hides it
    x, y, z = np.take(corners, front, axis=2)
    first, lines, area = first[front], last[front] - first[front] + 1, area[front]
    u, v = (z[1] - z[0]) / area, (z[2] - z[0]) / area
    slope_x, slope_y = u * (y[2] - y[0]) - v * (y[1] - y[0]), v * (x[1] - x[0]) - u * (x[2] - x[0])
    above = z[0] - x[0] * slope_x - y[0] * slope_y
    edges = []
    for p, q in ((0, 1), (1, 2), (2, 0)):
        up = y[q] - y[p]
        lean = np.divide(x[q] - x[p], up, out=np.zeros_like(up), where=up != 0)
        edges.append((np.where(up < 0, x[p], -np.inf), y[p], lean, np.maximum))
        edges.append((np.where(up > 0, x[p], np.inf), y[p], lean, np.minimum))
    for block in blocks(lines * (np.ptp(x, axis=0).astype(int) + 1)):
        face, row = runs(first[block], lines[block])
        face += block.start
        leftmost, right = np.zeros(len(face)), np.full(len(face), width - 1.0)
        for start, foot, lean, tighter in edges:
            limit = leftmost if tighter is np.maximum else right
            tighter(limit, start[face] + (row - foot[face]) * lean[face], out=limit)
        leftmost = np.ceil(leftmost - _ROUNDING).astype(int)
        line, column = runs(leftmost, np.maximum(np.floor(right + _ROUNDING).astype(int) - leftmost + 1, 0))
        face, ahead = face[line], (above[face] + row * slope_y[face])[line]
        nearest(index, depth, (row * width)[line] + column, ahead + column * slope_x[face], front[face])
    return index.reshape(height, width), depth.reshape(height, width)


def smooth_normals(position, faces, crease):
    """Unit normals (F, 3 corners, 3): means over the faces around a corner that meet its own at a cosine above `crease`."""
    flat = np.cross(position[faces[:, 1]] - position[faces[:, 0]], position[faces[:, 2]] - position[faces[:, 0]]).T.copy()
    area = np.sqrt((flat**2).sum(axis=0))  # twice: large faces weigh more
    corner = np.asarray(faces).reshape(-1)
    around = np.argsort(corner, kind="stable") // 3  # faces by vertex
    count = np.bincount(corner, minlength=len(position))
    start = np.cumsum(count) - count
    total = np.zeros((3, len(corner)))
    for block in blocks(count[corner]):
        mine, at = runs(start[corner[block]], count[corner[block]])
        mine, neighbour = (mine + block.start) // 3, around[at]
        near = np.take(flat, neighbour, axis=1)
        x, y, z = near * np.take(flat, mine, axis=1)
        near[:, (x + y + z < crease * area[mine] * area[neighbour]) & (mine != neighbour)] = 0
        first = np.cumsum(count[corner[block]]) - count[corner[block]]
        total[:, block] = np.add.reduceat(near, first, axis=1)
    length = np.sqrt((total**2).sum(axis=0))
    return (total / np.where(length > 0, length, 1.0)).T.reshape(-1, 3, 3)


def surfaces(index, depth, position, faces, normals, low, pixel):
    """What each pixel shows: whether anything, (H, W), and of those that do the places and unit normals, (P, 3) each."""
    covered = index >= 0
    row, column = np.nonzero(covered)
    face = index[covered]
    x, y = low[0] + (column + 0.5) * pixel, low[1] + (row + 0.5) * pixel
    a, b, c = (position[faces[:, k], :2] for k in range(3))
    b, c = b - a, c - a
    over = 1 / np.where((area := b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]) != 0, area, 1.0)
    dx, dy = x - a[face, 0], y - a[face, 1]
    u = dx * (c[:, 1] * over)[face] - dy * (c[:, 0] * over)[face]
    v = dy * (b[:, 0] * over)[face] - dx * (b[:, 1] * over)[face]
    first, second, third = (normals[:, k] for k in range(3))
    n = first[face] + u[:, None] * (second - first)[face] + v[:, None] * (third - first)[face]
    n /= np.maximum(np.sqrt((n**2).sum(axis=1, keepdims=True)), 1e-300)
    return covered, np.stack([x, y, depth[covered]], axis=1), n


def _turned(position, frame):
    return np.stack([along(axis, position.T) for axis in frame], axis=1)


def _ball(low, pixel, size):
    at = low[0] + (np.arange(size) + 0.5) * pixel
    x, y = np.broadcast_arrays(at, at[:, None])
    inside = 1 - x * x - y * y
    covered = inside > 0
    normal = np.stack([x[covered], y[covered], np.sqrt(inside[covered])], axis=1)
    return covered, normal, normal
