"""Samples of a pixel in one pass share out the pixel, and what its first smooth boundary does, among them.

Each is in a stratum of its own, of the pixel (jittered, so that edges of lamps are less noisy) and, independently, of the number
that chooses whether the path is reflected or refracted.  A sample by itself is spread evenly over both.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

_BELOW_ONE = 1 - 2.0**-24
_STRIDE = 7  # between strata of choices of samples whose strata of the pixel are neighbours


class Counts(NamedTuple):
    """Variables, as numbers would be part of the kernel.

    lanes, samples : of a pixel, and of each of its lanes;  count : samples of a pixel;  columns : of their strata
    """

    lanes: mi.UInt32
    samples: mi.UInt32
    count: mi.UInt32
    columns: mi.UInt32

    @classmethod
    def of(cls, lanes, samples) -> Counts:
        count = lanes * samples
        columns = max(divisor for divisor in range(1, math.isqrt(count) + 1) if count % divisor == 0)
        return cls(*(dr.opaque(mi.UInt32, number) for number in (lanes, samples, count, columns)))


class Strata:
    """Strata of the samples of pixels."""

    def __init__(self, lane, pixel, key, counts):
        """lane, pixel : numbers of lanes, and of their pixels;  key : two numbers of 32 bits, of the pass;  counts : `Counts`"""
        _, self._samples, self._count, self._columns = counts
        self._first = (lane - pixel * counts.lanes) * self._samples
        self._size = dr.rcp(mi.Float(self._columns)), mi.Float(self._columns) / mi.Float(self._count)
        self._chosen = dr.rcp(mi.Float(self._count))
        self._turn = mi.sample_tea_32(pixel ^ key[1], key[0])[0] % self._count

    def drawn(self, sample, random, active):
        """Places in pixels, and numbers for choices, of samples, by their numbers in each lane."""
        number = self._first + dr.minimum(sample, self._samples - 1)
        row = number // self._columns
        offset = mi.Point2f((mi.Float(number - row * self._columns) + random.next_float32(active)) * self._size[0],
                            (mi.Float(row) + random.next_float32(active)) * self._size[1])
        chosen = (number * _STRIDE + self._turn) % self._count
        return offset, dr.minimum((mi.Float(chosen) + random.next_float32(active)) * self._chosen, _BELOW_ONE)
