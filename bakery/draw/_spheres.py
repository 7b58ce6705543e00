"""Draws spheres: depth buffer, light with shadows, and the light of the sky that neighbours take away.  For pictures only.

Why not matplotlib's: it knows no spheres that hide and shade each other.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def depths(position, radius, low, pixel, width, height):
    """Nearest sphere of each pixel seen along -z: its index or -1, and the z of its surface, both (height, width).

    Parameters
    ----------
    position : (N, 3), radius : (N,) in the frame of the view
    low : (2,) lower left corner; pixel : edge of a pixel
    """
    index = np.full((height, width), -1, np.int32)
    depth = np.full((height, width), -np.inf)
    for i in range(len(radius)):
        x, y, z, r = position[i, 0], position[i, 1], position[i, 2], radius[i]
        for row in range(max(int((y - r - low[1]) / pixel), 0), min(int((y + r - low[1]) / pixel) + 1, height)):
            dy = low[1] + (row + 0.5) * pixel - y
            for column in range(max(int((x - r - low[0]) / pixel), 0), min(int((x + r - low[0]) / pixel) + 1, width)):
                dx = low[0] + (column + 0.5) * pixel - x
                inside = r * r - dx * dx - dy * dy
                if inside > 0 and z + math.sqrt(inside) > depth[row, column]:
                    depth[row, column] = z + math.sqrt(inside)
                    index[row, column] = i
    return index, depth


@njit(cache=True, nogil=True)
def neighbours(position, visible, reach, most):
    """The spheres nearest to each visible one, (N, most): -1 where fewer have their centres within `reach`, nearest first.

    Parameters
    ----------
    position : (N, 3) ascending in z; visible : (N,) bool, the others get none
    """
    near, square = np.full((len(position), most), -1), np.empty(most)
    for i in np.flatnonzero(visible):
        square[:] = reach * reach
        first = np.searchsorted(position[:, 2], position[i, 2] - reach)
        last = np.searchsorted(position[:, 2], position[i, 2] + reach)
        for j in range(first, last):
            x, y, z = position[j, 0] - position[i, 0], position[j, 1] - position[i, 1], position[j, 2] - position[i, 2]
            found = x * x + y * y + z * z
            if i == j or found >= square[-1]:
                continue
            at = most - 1
            while at > 0 and square[at - 1] > found:
                square[at], near[i, at] = square[at - 1], near[i, at - 1]
                at -= 1
            square[at], near[i, at] = found, j
    return near


@njit(cache=True, nogil=True)
def shaded(index, depth, position, radius, colour, near, low, pixel, sun, to_sun, shadow, shadow_low, shadow_pixel):
    """Colour of each pixel, (height, width, 4): linear light and coverage.

    Parameters
    ----------
    near : (N, K) neighbours of each sphere, -1 where there are fewer
    sun : (3,) unit vector towards the sun; to_sun : (3, 3) rotation into its frame
    shadow : depth buffer in the sun's frame, with its corner and pixel
    """
    height, width = index.shape
    image = np.zeros((height, width, 4))
    n, p, q = np.zeros(3), np.zeros(3), np.zeros(3)
    for row in range(height):
        for column in range(width):
            i = index[row, column]
            if i < 0:
                continue
            p[0], p[1], p[2] = low[0] + (column + 0.5) * pixel, low[1] + (row + 0.5) * pixel, depth[row, column]
            for k in range(3):
                n[k] = (p[k] - position[i, k]) / radius[i]
            open_sky = 1.0
            for s in range(near.shape[1]):
                j = near[i, s]
                if j < 0:
                    break
                dx, dy, dz = position[j, 0] - p[0], position[j, 1] - p[1], position[j, 2] - p[2]
                square = dx * dx + dy * dy + dz * dz
                cosine = (dx * n[0] + dy * n[1] + dz * n[2]) / math.sqrt(square)
                share = radius[j] * radius[j] / max(square, radius[j] * radius[j])
                # a sphere takes cos * r^2/d^2 of a cosine-weighted sky where it stands clear of the horizon, and fades below it
                clear = math.sqrt(max(share, 1e-12))
                open_sky *= 1 - share * max(0.25 * (cosine + clear) ** 2 / clear if cosine < clear else cosine, 0.0) \
                    * (1.0 if cosine > -clear else 0.0)
            facing = n[0] * sun[0] + n[1] * sun[1] + n[2] * sun[2]
            lit = 0.0
            if facing > 0:
                for k in range(3):
                    q[k] = to_sun[k, 0] * p[0] + to_sun[k, 1] * p[1] + to_sun[k, 2] * p[2]
                bias = 0.04 * radius[i] + 1.5 * shadow_pixel * math.sqrt(1 - min(facing, 1.0) ** 2) / max(facing, 0.1)
                u, v = int((q[0] - shadow_low[0]) / shadow_pixel), int((q[1] - shadow_low[1]) / shadow_pixel)
                seen = 0
                for a in range(v - 1, v + 2):
                    for b in range(u - 1, u + 2):
                        if a < 0 or b < 0 or a >= shadow.shape[0] or b >= shadow.shape[1] or shadow[a, b] <= q[2] + bias:
                            seen += 1
                lit = facing * seen / 9
            sky = open_sky * open_sky * (0.62 + 0.38 * n[1])
            half = (sun[2] + 1) / math.sqrt(2 + 2 * sun[2])
            glint = (n[0] * sun[0] + n[1] * sun[1] + n[2] * (sun[2] + 1)) / math.sqrt(2 + 2 * sun[2])
            gloss = 0.22 * max(glint, 0.0) ** 60 * (lit > 0) * half
            rim = 0.10 * (1 - max(n[2], 0.0)) ** 3 * open_sky
            for k in range(3):
                image[row, column, k] = colour[i, k] * (0.95 * lit + 0.55 * sky) + gloss + rim
            image[row, column, 3] = 1.0
    return image
