"""Samples of a pixel in one pass share out the pixel, and what its first smooth boundary does, among them.

Each is in a stratum of its own, of the pixel (jittered, so that edges of lamps are less noisy) and, independently, of the number
that chooses whether the path is reflected or refracted.  A sample by itself is spread evenly over both.
"""

from __future__ import annotations

import math

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

_STRIDE = 7  # between strata of choices of samples whose strata of the pixel are neighbours


class Strata:
    """Strata of the samples of pixels."""

    def __init__(self, lane, pixel, key, lanes, samples):
        """
        Parameters
        ----------
        lane, pixel : numbers of lanes, and of their pixels;  key : two numbers of 32 bits, of the pass
        lanes, samples : of a pixel, and of each of its lanes
        """
        count = lanes * samples
        columns = max(divisor for divisor in range(1, math.isqrt(count) + 1) if count % divisor == 0)
        # as variables: numbers would be part of the kernel
        lanes, self._samples, self._count, self._columns = (dr.opaque(mi.UInt32, n) for n in (lanes, samples, count, columns))
        self._first = (lane - pixel * lanes) * self._samples
        self._size = dr.rcp(mi.Float(self._columns)), mi.Float(self._columns) / mi.Float(self._count)
        self._chosen = dr.rcp(mi.Float(self._count))
        self._turn = mi.sample_tea_32(pixel ^ key[1], key[0])[0] % self._count

    def drawn(self, sample, random, active):
        """Places in pixels, and numbers for choices, of samples, by their numbers in each lane."""
        number = self._first + dr.minimum(sample, self._samples - 1)
        row = number // self._columns
        place = mi.Point2f((mi.Float(number - row * self._columns) + random.next_float32(active)) * self._size[0],
                           (mi.Float(row) + random.next_float32(active)) * self._size[1])
        chosen = (number * _STRIDE + self._turn) % self._count
        return place, (mi.Float(chosen) + random.next_float32(active)) * self._chosen
