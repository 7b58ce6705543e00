"""Draws a mesh of triangles, or a ball, in the light of sun and sky: a depth buffer for each direction.  For pictures only.

Why not matplotlib's polygons: quicker, but with seams and facets, and without the shadows that show the form
(`python benchmarks/meshes.py picture`, docs/grain-shapes.md).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from bakery.draw.view import looking_from, srgb

CREASE = math.cos(math.radians(32.0))  # faces that meet at less are shaded as one surface
_FINE = 2  # samples a pixel and axis
_SHADOW = 420  # pixels of a light's depth buffer
_SUN, _SUN_SHARE, _SPREAD = (-0.55, 0.66, 0.51), 0.62, 0.20  # towards it; share of the lights in it; its radius, sine


def rendered(vertices, faces, colour, pixels: int = 500, gloss: float = 0.2) -> np.ndarray:
    """A grain in the square from -1.02 to 1.02 of its bounding sphere's plane, seen from above a corner.

    Parameters
    ----------
    vertices : (V, 3) in bounding radii; None draws the unit ball
    faces : (F, 3)
    colour : (3,) linear, of the surface
    pixels : of an edge
    gloss : strength of highlights

    Returns
    -------
    image : (pixels, pixels, 4) uint8, sRGB and coverage, first row on top
    """
    size = _FINE * pixels
    low, pixel = np.array([-1.02, -1.02]), 2.04 / size
    ball = vertices is None
    if ball:
        place, normal = _ball(low, pixel, size)
    else:
        faces = np.ascontiguousarray(faces, np.int64)
        seen = np.ascontiguousarray(vertices, float) @ looking_from(np.array([1.0, 0.72, 0.62])).T
        index, depth = depths(seen, faces, low, pixel, size, size)
        place, normal = surfaces(index, depth, seen, faces, smooth_normals(seen, faces, CREASE), low, pixel)
    light = np.zeros((size, size, 3))
    nothing = np.full((1, 1), -np.inf)
    for towards, rgb, shine in _lights(24):
        frame = looking_from(towards)
        shadow, corner, step = nothing, np.zeros(2), 1.0
        if not ball:
            from_light = seen @ frame.T
            corner, step = np.array([-1.02, -1.02]), 2.04 / _SHADOW
            _, shadow = depths(from_light, faces, corner, step, _SHADOW, _SHADOW)
        add_light(light, place, normal, towards, rgb, gloss * shine, colour, frame, shadow, corner, step)
    covered = np.isfinite(place[..., 2])
    rim = np.where(covered, 0.10 * (1 - np.clip(normal[..., 2], 0, 1)) ** 3, 0.0)
    image = np.concatenate([light + rim[..., None], covered[..., None]], axis=-1)
    image = image.reshape(pixels, _FINE, pixels, _FINE, 4).mean(axis=(1, 3))[::-1]
    mean = image[..., :3] / np.maximum(image[..., 3:], 1e-9)
    image[..., :3] = srgb(1 - np.exp(-1.3 * mean))
    return np.round(255 * image).astype(np.uint8)


@njit(cache=True, nogil=True, error_model="numpy")
def depths(position, faces, low, pixel, width, height):
    """Nearest triangle of each pixel seen along -z: its index or -1, and the z of its surface, both (height, width).

    Parameters
    ----------
    position : (V, 3) in the frame of the view; faces : (F, 3)
    low : (2,) lower left corner; pixel : edge of a pixel
    """
    index = np.full((height, width), -1, np.int64)
    depth = np.full((height, width), -np.inf)
    for i in range(len(faces)):
        a, b, c = faces[i, 0], faces[i, 1], faces[i, 2]
        ax, ay, az = position[a, 0], position[a, 1], position[a, 2]
        bx, by, bz = position[b, 0] - ax, position[b, 1] - ay, position[b, 2] - az
        cx, cy, cz = position[c, 0] - ax, position[c, 1] - ay, position[c, 2] - az
        area = bx * cy - by * cx
        if area <= 0.0:
            continue  # seen from inside: another one of a closed surface hides it
        first = max(int((ay + min(by, cy, 0.0) - low[1]) / pixel), 0)
        last = min(int((ay + max(by, cy, 0.0) - low[1]) / pixel) + 1, height)
        left = max(int((ax + min(bx, cx, 0.0) - low[0]) / pixel), 0)
        right = min(int((ax + max(bx, cx, 0.0) - low[0]) / pixel) + 1, width)
        for row in range(first, last):
            y = low[1] + (row + 0.5) * pixel - ay
            for column in range(left, right):
                x = low[0] + (column + 0.5) * pixel - ax
                u, v = (x * cy - y * cx) / area, (bx * y - by * x) / area
                if u >= -1e-12 and v >= -1e-12 and u + v <= 1.0 + 1e-12:
                    z = az + u * bz + v * cz
                    if z > depth[row, column]:
                        depth[row, column] = z
                        index[row, column] = i
    return index, depth


@njit(cache=True, nogil=True, error_model="numpy")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True, error_model="numpy")
def smooth_normals(position, faces, crease):
    """Unit normals (F, 3 corners, 3): means over the faces around a corner that meet its own at a cosine above `crease`."""
    count = len(faces)
    flat = np.zeros((count, 3))  # as long as twice the area: large faces weigh more
    for i in range(count):
        a, b, c = position[faces[i, 0]], position[faces[i, 1]], position[faces[i, 2]]
        flat[i] = np.cross(b - a, c - a)
    start = np.zeros(len(position) + 1, np.int64)
    for i in range(count):
        for k in range(3):
            start[faces[i, k] + 1] += 1
    start = np.cumsum(start)
    filled, around = start.copy(), np.zeros(3 * count, np.int64)
    for i in range(count):
        for k in range(3):
            around[filled[faces[i, k]]] = i
            filled[faces[i, k]] += 1
    normal = np.zeros((count, 3, 3))
    for i in range(count):
        own = math.sqrt(_dot(flat[i], flat[i]))
        for k in range(3):
            total = np.zeros(3)
            for at in range(start[faces[i, k]], start[faces[i, k] + 1]):
                other = flat[around[at]]
                if around[at] == i or _dot(other, flat[i]) >= crease * own * math.sqrt(_dot(other, other)):
                    total += other
            length = math.sqrt(_dot(total, total))
            normal[i, k] = total / (length if length > 0 else 1.0)
    return normal


@njit(cache=True, nogil=True, error_model="numpy")
def surfaces(index, depth, position, faces, normals, low, pixel):
    """Place and unit normal of what each pixel shows, (H, W, 3) each; the z of a place is -inf where there is nothing."""
    height, width = index.shape
    place, normal = np.full((height, width, 3), -np.inf), np.zeros((height, width, 3))
    for row in range(height):
        for column in range(width):
            i = index[row, column]
            if i < 0:
                continue
            x, y = low[0] + (column + 0.5) * pixel, low[1] + (row + 0.5) * pixel
            a, b, c = position[faces[i, 0]], position[faces[i, 1]], position[faces[i, 2]]
            area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            u = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
            v = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
            n = (1 - u - v) * normals[i, 0] + u * normals[i, 1] + v * normals[i, 2]
            normal[row, column] = n / max(math.sqrt(_dot(n, n)), 1e-300)
            place[row, column, 0], place[row, column, 1], place[row, column, 2] = x, y, depth[row, column]
    return place, normal


@njit(cache=True, nogil=True, error_model="numpy")
def add_light(light, place, normal, towards, rgb, shine, colour, frame, shadow, low, pixel):
    """Add one direction's light to an image (H, W, 3) wherever its depth buffer does not show something nearer to it."""
    height, width = place.shape[:2]
    hx, hy, hz = towards[0], towards[1], towards[2] + 1.0
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    hx, hy, hz = hx / length, hy / length, hz / length
    for row in range(height):
        for column in range(width):
            p, n = place[row, column], normal[row, column]
            facing = n[0] * towards[0] + n[1] * towards[1] + n[2] * towards[2]
            if facing <= 0.0 or p[2] == -np.inf:
                continue
            x = frame[0, 0] * p[0] + frame[0, 1] * p[1] + frame[0, 2] * p[2]
            y = frame[1, 0] * p[0] + frame[1, 1] * p[1] + frame[1, 2] * p[2]
            z = frame[2, 0] * p[0] + frame[2, 1] * p[1] + frame[2, 2] * p[2]
            bias = 0.012 + 1.5 * pixel * math.sqrt(1.0 - min(facing, 1.0) ** 2) / max(facing, 0.15)
            u, v = int((x - low[0]) / pixel), int((y - low[1]) / pixel)
            if 0 <= u < shadow.shape[1] and 0 <= v < shadow.shape[0] and shadow[v, u] > z + bias:
                continue
            glint = shine * max(n[0] * hx + n[1] * hy + n[2] * hz, 0.0) ** 50
            for k in range(3):
                light[row, column, k] += rgb[k] * (colour[k] * facing + glint)


def _lights(count):
    """(unit vector towards it, its colour (3,), share of highlights), a sun of some width and a sky that is brighter above."""
    sun = np.array(_SUN) / np.linalg.norm(_SUN)
    frame = looking_from(sun)
    suns = count // 4
    for i in range(suns):
        radius, turn = _SPREAD * math.sqrt((i + 0.5) / suns), 2.399963 * i  # the golden angle
        towards = np.array([radius * math.cos(turn), radius * math.sin(turn), math.sqrt(1 - radius * radius)]) @ frame
        yield towards, 1.9 * _SUN_SHARE / suns * np.array([1.0, 0.96, 0.88]), 1.0
    rest = count - suns
    for i in range(rest):
        z = 1 - 2 * (i + 0.5) / rest
        radius = math.sqrt(1 - z * z)
        towards = np.array([radius * math.cos(2.399963 * i), z, radius * math.sin(2.399963 * i)])
        yield towards, 2.6 * (1 - _SUN_SHARE) / rest * (0.55 + 0.45 * z) * np.array([0.90, 0.97, 1.10]), 0.1


def _ball(low, pixel, size):
    at = low[0] + (np.arange(size) + 0.5) * pixel
    x, y = np.broadcast_arrays(at, at[:, None])
    inside = 1 - x * x - y * y
    normal = np.stack([x, y, np.sqrt(np.maximum(inside, 0))], axis=-1)
    return np.where(inside[..., None] > 0, normal, -np.inf), np.where(inside[..., None] > 0, normal, 0.0)
