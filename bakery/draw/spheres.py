"""Draws spheres in the light of sun and sky: a depth buffer for each direction.  For pictures only.

In plain NumPy: loading compiled kernels takes longer than a picture.  Why not matplotlib's: it knows no spheres that hide and
shade each other.
"""

import numpy as np

from bakery.draw.light import shaded
from bakery.draw.view import blocks, finished, nearest, runs

_SHADOW, _GLOSS = 420, 0.22  # pixels of a light's depth buffer; strength of highlights


def rendered(position, radius, colour, low, pixel, width, height):
    """The spheres seen along -z.

    position : (N, 3), radius : (N,), colour : (N, 3) linear, in the frame of the view
    low : (2,) lower left corner; pixel : edge of a pixel

    Returns image : (height, width, 4) uint8, sRGB and coverage, first row on top
    """
    index, depth = depths(position, radius, low, pixel, width, height)
    row, column = np.nonzero(index >= 0)
    ball = index[row, column]
    points = np.stack([low[0] + (column + 0.5) * pixel, low[1] + (row + 0.5) * pixel, depth[row, column]])

    def shadow(frame):
        turned = position @ frame.T
        corner = (turned[:, :2] - radius[:, None]).min(0)
        step = ((turned[:, :2] + radius[:, None]).max(0) - corner).max() / (_SHADOW - 1)
        return depths(turned, radius, corner, step, _SHADOW, _SHADOW)[1], corner, step

    image = np.zeros((height, width, 3))
    normal = (points - position[ball].T) / radius[ball]
    image[row, column] = shaded(points, normal, colour[ball], _GLOSS, shadow, 3 * radius.mean())
    return finished(image, index, 1.25)


def depths(position, radius, low, pixel, width, height):
    """Nearest sphere of each pixel seen along -z: its index or -1, and the z of its surface, both (height, width).

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
