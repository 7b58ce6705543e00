"""Samples of a pixel in one pass share out the pixel, and what its first smooth boundary does, among them.

Each is in a stratum of its own, of the pixel (jittered, so that edges of lamps are less noisy) and, independently, of the number
that chooses whether the path is reflected or refracted.  A sample by itself is spread evenly over both.
"""

from __future__ import annotations

import math

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

_BELOW_ONE = 1 - 2.0**-24
_STRIDE = 7  # between strata of choices of samples whose strata of the pixel are neighbours


class Strata:
    """Strata of the samples of pixels."""

    def __init__(self, key, samples):
        """key : two numbers of 32 bits, of the pass;  samples : of a pixel"""
        columns = max(divisor for divisor in range(1, math.isqrt(samples) + 1) if samples % divisor == 0)
        # as variables: numbers would be part of the kernel
        self._count, self._columns, *self._key = (dr.opaque(mi.UInt32, n) for n in (samples, columns, *key))
        self._size = dr.rcp(mi.Float(self._columns)), mi.Float(self._columns) / mi.Float(self._count)
        self._chosen = dr.rcp(mi.Float(self._count))

    def drawn(self, pixel, sample, random, active):
        """Places in pixels, and numbers for choices, of their samples."""
        row = sample // self._columns
        offset = mi.Point2f((mi.Float(sample - row * self._columns) + random.next_float32(active)) * self._size[0],
                            (mi.Float(row) + random.next_float32(active)) * self._size[1])
        turn = mi.sample_tea_32(pixel ^ self._key[1], self._key[0])[0] % self._count
        chosen = (sample * _STRIDE + turn) % self._count
        return offset, dr.minimum((mi.Float(chosen) + random.next_float32(active)) * self._chosen, _BELOW_ONE)
