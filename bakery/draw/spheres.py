"""Draws spheres: depth buffer, light with shadows, and the light of the sky that neighbours take away.  For pictures only.

In plain NumPy: loading compiled kernels takes longer than a picture.  Why not matplotlib's: it knows no spheres that hide and
shade each other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bakery.draw.view import along, blocks, nearest, runs

_TOGETHER = 512  # spheres whose neighbours are looked for at once


def depths(position, radius, low, pixel, width, height):
    """Nearest sphere of each pixel seen along -z: its index or -1, and the z of its surface, both (height, width).

    Parameters
    ----------
    position : (N, 3), radius : (N,) in the frame of the view
    low : (2,) lower left corner; pixel : edge of a pixel
    """
    index, depth = np.full(height * width, -1), np.full(height * width, -np.inf)
    x, y = ((position[:, k] - low[k]) / pixel - 0.5 for k in (0, 1))  # centres of pixels at whole numbers
    z, r = position[:, 2], radius / pixel
    first = np.maximum(np.ceil(y - r), 0).astype(int)
    lines = np.maximum(np.minimum(np.floor(y + r), height - 1).astype(int) - first + 1, 0)
    for part in blocks(lines * (2 * r.astype(int) + 1)):
        ball, row = runs(first[part], lines[part])
        ball += part.start
        square = np.maximum(r[ball] ** 2 - (row - y[ball]) ** 2, 0)
        half = np.sqrt(square)
        leftmost = np.maximum(np.ceil(x[ball] - half), 0).astype(int)
        line, column = runs(leftmost, np.maximum(np.minimum(np.floor(x[ball] + half), width - 1).astype(int) - leftmost + 1, 0))
        up = np.sqrt(np.maximum(square[line] - (column - x[ball][line]) ** 2, 0))
        nearest(index, depth, (row * width)[line] + column, z[ball][line] + pixel * up, ball[line])
    return index.reshape(height, width), depth.reshape(height, width)


def neighbours(position, visible, reach, most):
    """The spheres nearest to each visible one, (N, most): -1 where fewer have their centres within `reach`, nearest first.

    Parameters
    ----------
    position : (N, 3) ascending in z; visible : (N,) bool, the others get none
    """
    near, wanted = np.full((len(position), most), -1), np.flatnonzero(visible)
    for part in (wanted[i:i + _TOGETHER] for i in range(0, len(wanted), _TOGETHER)):
        first, last = np.searchsorted(position[:, 2], (position[part[0], 2] - reach, position[part[-1], 2] + reach))
        square = sum((position[part, k, None] - position[first:last, k]) ** 2 for k in range(3))
        square[np.arange(len(part)), part - first] = np.inf
        count = min(most, last - first)
        nearest = np.argpartition(square, count - 1, axis=1)[:, :count]
        away = np.take_along_axis(square, nearest, axis=1)
        order = np.argsort(away, axis=1, kind="stable")
        nearest, away = (np.take_along_axis(values, order, axis=1) for values in (nearest, away))
        near[part, :count] = np.where(away < reach * reach, nearest + first, -1)
    return near


class Spheres(NamedTuple):
    """Centres (N, 3), radii (N,), colours (N, 3), and (N, K) neighbours of each, -1 where there are fewer."""

    position: np.ndarray
    radius: np.ndarray
    colour: np.ndarray
    near: np.ndarray


class Buffer(NamedTuple):
    """What `depths` gives of spheres, with the corner and the pixel that it was asked for."""

    index: np.ndarray
    depth: np.ndarray
    low: np.ndarray
    pixel: float


def shaded(spheres: Spheres, seen: Buffer, sun, to_sun, shadow: Buffer):
    """Colour of each pixel, (height, width, 3): linear light, 0 where nothing is.

    Parameters
    ----------
    sun : (3,) unit vector towards the sun; to_sun : (3, 3) rotation into its frame
    shadow : of the same spheres in the sun's frame
    """
    (position, radius, colour, near), (index, depth, low, pixel) = spheres, seen
    image = np.zeros((*index.shape, 3))
    rows, columns = np.nonzero(index >= 0)
    for part in (slice(i, i + 16384) for i in range(0, len(rows), 16384)):  # what fits into the processor's cache
        row, column = rows[part], columns[part]
        i = index[row, column]
        p = np.stack([low[0] + (column + 0.5) * pixel, low[1] + (row + 0.5) * pixel, depth[row, column]])
        n = (p - position[i].T) / radius[i]
        open_sky = _open(p, n, near[i].T, position, radius)
        facing = np.maximum(along(sun, n), 0)
        brightness = facing * _lit([along(axis, p) for axis in to_sun], facing, radius[i], shadow)
        half = (sun + np.array([0, 0, 1])) / np.sqrt(2 + 2 * sun[2])
        gloss = 0.22 * np.maximum(along(half, n), 0) ** 60 * (brightness > 0) * half[2]
        rim = 0.10 * (1 - np.maximum(n[2], 0)) ** 3 * open_sky
        sky = open_sky * open_sky * (0.62 + 0.38 * n[1])
        image[row, column] = colour[i] * (0.95 * brightness + 0.55 * sky)[:, None] + (gloss + rim)[:, None]
    return image


def _open(p, n, near, position, radius):
    """Share of the sky that neighbours (K, P) leave to places (3, P) with normals (3, P)."""
    x, y, z = (position[near, k].astype(np.float32) - p[k].astype(np.float32) for k in range(3))
    a, b, c = n.astype(np.float32)
    square = x * x + y * y + z * z
    cosine = (x * a + y * b + z * c) / np.sqrt(square)
    squared_radius = radius.astype(np.float32)[near] ** 2
    share = squared_radius / np.maximum(square, squared_radius)
    # a sphere takes cos * r^2/d^2 of a cosine-weighted sky where it stands clear of the horizon, and fades below it
    clear = np.sqrt(share)
    taken = share * np.where(cosine < clear, 0.25 * np.maximum(cosine + clear, 0) ** 2 / clear, cosine)
    return np.prod(1 - np.where(near >= 0, taken, 0), axis=0)


def _lit(q, facing, radius, shadow: Buffer):
    """Share of the nine pixels of a depth buffer around places (3, P), in its frame, that show nothing nearer to the light."""
    _, depth, low, pixel = shadow
    limit = q[2] + 0.04 * radius + 1.5 * pixel * np.sqrt(1 - np.minimum(facing, 1) ** 2) / np.maximum(facing, 0.1)
    u, v = (((q[k] - low[k]) / pixel).astype(int) for k in (0, 1))
    rows, columns = (np.clip(at + np.arange(-1, 2)[:, None], 0, most - 1) for at, most in zip((v, u), depth.shape, strict=True))
    return sum((depth[a, b] <= limit).astype(float) for a in rows for b in columns) / 9
