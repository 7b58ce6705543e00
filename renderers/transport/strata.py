"""Samples of a pixel in one pass share out the pixel, and what its first smooth boundary does, among them.

Each is in a stratum of its own, of the pixel (jittered, so that edges of lamps are less noisy) and, independently, of the number
that chooses whether the path is reflected or refracted.  A sample by itself is spread evenly over both.
"""

import math

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

_BELOW_ONE = 1 - 2.0**-24
_STRIDE = 7  # between strata of choices of samples whose strata of the pixel are neighbours


class Strata:
    """Strata of the samples of pixels.

    key : two numbers of 32 bits, of the pass
    count : samples of a pixel
    columns : of their strata
    """

    def __init__(self, key, count, columns):
        """Variables, as numbers would be part of the kernel, and others another kernel: `of` takes numbers."""
        self.key, self.count, self.columns = key, count, columns
        self._size = dr.rcp(mi.Float(columns)), mi.Float(columns) / mi.Float(count)
        self._chosen = dr.rcp(mi.Float(count))

    @classmethod
    def of(cls, key, samples) -> "Strata":
        """Of a pass of so many samples of each pixel."""
        columns = max(divisor for divisor in range(1, math.isqrt(samples) + 1) if samples % divisor == 0)
        *halves, count, columns = (dr.opaque(mi.UInt32, number) for number in (*key, samples, columns))
        return cls(halves, count, columns)

    def drawn(self, pixel, sample, random, active):
        """Places in pixels, and numbers for choices, of their samples."""
        row = sample // self.columns
        offset = mi.Point2f((mi.Float(sample - row * self.columns) + random.next_float32(active)) * self._size[0],
                            (mi.Float(row) + random.next_float32(active)) * self._size[1])
        turn = mi.sample_tea_32(pixel ^ self.key[1], self.key[0])[0] % self.count
        chosen = (sample * _STRIDE + turn) % self.count
        return offset, dr.minimum((mi.Float(chosen) + random.next_float32(active)) * self._chosen, _BELOW_ONE)
