"""What rendered pictures share: where the viewer stands, depth buffers, and how light becomes the numbers of a picture."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

_BRIGHTEST, _STEPS = 6.0, 1 << 16  # of linear light: a step is less than one of 8 bits, the brightest is white
_AT_ONCE = 1 << 16  # pixels: what fits into the processor's cache


def looking_from(direction) -> np.ndarray:
    """Rotation whose rows are right, up and towards the viewer, for a viewer in a direction; z (or y) is up."""
    back = direction / np.linalg.norm(direction)
    up = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def along(direction, vectors):
    """Dot products (P,) of a direction with vectors (3, P), of their kind of number.

    Not by BLAS: its threads, waiting for each other, take more of the processor's time than the rest of a picture.
    """
    x, y, z = (vectors.dtype.type(value) for value in direction)
    return x * vectors[0] + y * vectors[1] + z * vectors[2]


def srgb(linear):
    """Linear light, 0 to 1, as sRGB encodes it."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-12) ** (1 / 2.4) - 0.055)


def finished(light, shown, exposure: float) -> np.ndarray:
    """Linear light (H, W, 3), first row below, as an image (H, W, 4) uint8: sRGB and coverage, first row on top.

    shown : (H, W) number of what each pixel shows, negative where nothing is; its borders are softened by their neighbours
    """
    steps = np.linspace(0, _BRIGHTEST, _STEPS)
    tone = np.round(255 * srgb(1 - np.exp(-exposure * steps))).astype(np.uint8)  # powers of every pixel take a fifth of a picture
    image = np.empty((*shown.shape, 4), np.uint8)
    image[..., :3] = tone[np.minimum(light * ((_STEPS - 1) / _BRIGHTEST) + 0.5, _STEPS - 1).astype(np.uint16)]
    image[..., 3] = np.where(shown >= 0, 255, 0)
    border = np.zeros(shown.shape, bool)
    border[1:-1, 1:-1] = ((shown[1:-1, :-2] != shown[1:-1, 2:]) | (shown[:-2, 1:-1] != shown[2:, 1:-1]))
    pixels, at = image.reshape(-1, 4), np.flatnonzero(border)
    around = pixels[at[:, None] + (0, 1, -1, shown.shape[1], -shown.shape[1])].astype(np.float32)
    covered = around[..., 3:]
    colour = (around[..., :3] * covered).sum(axis=1) / np.maximum(covered.sum(axis=1), 1)
    pixels[at] = np.round(np.concatenate([colour, covered.mean(axis=1)], axis=1))
    return image[::-1]


def runs(first, count) -> tuple[np.ndarray, np.ndarray]:
    """Whole numbers from each of `first` on, `count` of them: (which one they belong to, the numbers)."""
    which = np.repeat(np.arange(len(count)), count)
    return which, np.arange(len(which)) + np.repeat(first - (np.cumsum(count) - count), count)


def blocks(count) -> Iterator[slice]:
    """Slices of consecutive items that have about `_AT_ONCE` of what is counted together."""
    total = np.cumsum(count)
    cuts = np.searchsorted(total, np.arange(_AT_ONCE, total[-1] if len(total) else 0, _AT_ONCE))
    for start, end in pairwise([0, *np.unique(cuts[cuts > 0]).tolist(), len(count)]):
        yield slice(start, end)


def nearest(index, depth, pixel, z, value) -> None:
    """Enter pixels (P,) of surfaces at z (P,) into a depth buffer and the index of what it shows; of equals the last."""
    np.maximum.at(depth, pixel, z)
    shown = z == depth[pixel]
    index[pixel[shown]] = value[shown]
