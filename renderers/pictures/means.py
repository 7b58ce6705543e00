"""Means over passes, and what their scatter says of them: noise of pixels, of regions and of the whole picture.

Pixels of a pass may share noise, such as that of the beams of light from which all of them gather.  Then the mean of a region is
no better than its pixels, however many they are; the scatter of the regions' own means tells.
"""

import copy
import math
from collections.abc import Iterable

import numpy as np

from renderers import colour

LEAST = 2  # passes before which the scatter of a part says nothing
_TILES, _SMALLEST = 8, 4  # tiles along a side of the picture, at most; pixels along a side of a tile, at least
_ONE_SIGMA = 0.8413447460685429  # probability that a normal number is at most one standard deviation above its mean


class Mean:
    """Means of layers over passes, and the scatter of the passes' sums (Welford 1962), in double precision.

    count : passes
    samples : of a pixel, in all of them
    layers : (H, W, 3) by name, means; but for the layer "" in single precision, as the EXR has them
    square : (H, W, 4), squared distances of the passes from their mean, added up, of R, G, B and luminance of the layer ""
    spread : (4,), the same of the mean over all pixels: noise that pixels of a pass share is in it
    regions : the same of the luminance's means over the tiles of `tiled`
    lost : values that were no number, from a weight that overflowed, and count as dark
    seconds : of the quickest pass seen, as the first one compiles; inf before it
    resumed : passes that were not seen, as a file had them
    """

    def __init__(self):
        self.count, self.layers, self.square, self.spread, self.regions = 0, {}, 0.0, np.zeros(4), 0.0
        self.samples, self.lost, self.seconds, self.resumed = 0, 0, math.inf, 0

    def add(self, layers, seconds=math.inf, samples=1):
        """One more pass, of so many samples a pixel; a layer that it lacks is black in it."""
        self.count += 1
        self.samples += samples
        self.seconds = min(self.seconds, seconds)
        for name in dict.fromkeys([*self.layers, *layers]):
            image, mean = np.array(layers.get(name, 0.0), float), self.layers.get(name, 0.0)
            wrong = ~np.isfinite(image)
            image[wrong] = 0.0
            self.lost += int(wrong.sum())
            self.layers[name] = (mean + (image - mean) / self.count).astype(float if name == "" else np.float32)
            if name == "":
                before, after = _with_luminance(image - mean), _with_luminance(image - self.layers[""])
                self.square = self.square + _product(before, after)
                self.spread = self.spread + _product(before.mean((0, 1)), after.mean((0, 1)))
                self.regions = self.regions + _product(tiled(before[..., 3]), tiled(after[..., 3]))

    def so_far(self) -> "Mean":
        """The same as a mean of its own: `add` puts new arrays in the place of those that both have."""
        still = copy.copy(self)
        still.layers = dict(self.layers)
        return still

    @property
    def variance(self):
        """(H, W, 4), of the mean of the layer "" and its luminance; None before the second pass."""
        return self.square / (self.count * (self.count - 1)) if self.count >= LEAST else None

    @property
    def expected(self):
        """Seconds of another pass, 0 where none was seen."""
        return self.seconds if math.isfinite(self.seconds) else 0.0

    def gain(self):
        """Variance of the picture that another pass takes away, a second."""
        return np.mean(self.variance[..., 3]) / (self.count + 1) / max(self.seconds, 1e-9)


def _product(before, after):
    """Of differences from the mean before a pass and after it, which have one sign: where they cancel, rounding has another."""
    return np.maximum(before * after, 0.0)


def tiled(image):
    """Means (rows, columns) of an image (H, W) over tiles of it, 8 x 8 of a large one."""
    starts = _starts(*image.shape[:2])
    sums, counts = (np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
                    for values in (image, np.ones(image.shape)))
    return sums / counts


def tiles(height: int, width: int):
    """(height, width), numbers of the tiles in which pixels are."""
    rows, columns = (np.searchsorted(first, np.arange(side), side="right") - 1
                     for first, side in zip(_starts(height, width), (height, width)))
    return rows[:, None] * (columns[-1] + 1) + columns


def _starts(height, width):
    """First rows and first columns of tiles."""
    return [np.arange(count) * side // count for side in (height, width) for count in [max(1, min(_TILES, side // _SMALLEST))]]


def student(variances: Iterable[float], counts: Iterable[int]) -> float:
    """By how much a standard error is to be multiplied that few passes tell, so that the mean is within it as often as within
    one of many: in 68 of 100 pictures.

    variances : of means, which add up;  counts : passes that each is known from, 2 and more

    Student's t with the degrees of freedom of Welch and Satterthwaite: 1.84 after two passes, 1.2 after four, 1.08 after eight.
    """
    from scipy.special import stdtrit

    variances, counts = np.array(list(variances), float), np.array(list(counts), float)
    if not np.sum(variances) > 0:
        return 1.0
    freedom = np.sum(variances) ** 2 / np.sum(variances**2 / (counts - 1))
    return float(stdtrit(freedom, _ONE_SIGMA))


def _with_luminance(rgb):
    """(H, W, 4) from (H, W, 3)."""
    return np.dstack([rgb, rgb @ colour.LUMINANCE])
