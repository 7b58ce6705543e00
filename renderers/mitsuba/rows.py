"""Rows of a table for plugins: in device memory for the variants of Dr.Jit, in plain Python floats for the scalar ones."""

from bisect import bisect_right

import drjit as dr
import mitsuba as mi
import numpy as np


def pick(condition, a, b):
    """a where a condition holds, elsewhere b."""
    return dr.select(condition, a, b) if dr.is_jit_v(condition) else (a if condition else b)


def bands() -> str:
    """mono, rgb or spectral: what colours are in the variant that is set."""
    return "mono" if mi.is_monochromatic else "rgb" if mi.is_rgb else "spectral"


def between(knots, wavelength):
    """The row of a table below a wavelength, and the weight of the next one.  knots : um, of the rows;  wavelength : nm"""
    lower, weight = mi.UInt32(0), mi.Float(0.0)
    for row, (low, high) in enumerate(zip(knots, knots[1:])):
        low, high = 1e3 * low, 1e3 * high
        inside = wavelength >= low
        lower = pick(inside, mi.UInt32(row), lower)
        weight = pick(inside, dr.clip((wavelength - low) / (high - low), 0.0, 1.0), weight)
    return lower, weight


class JitRows:
    """Rows of a table in device memory; `row` and `i` are UInt32 arrays."""

    def __init__(self, tables, cdf):
        self.count = tables.s.size
        self.s, self.value, self.cdf = (mi.Float(array.ravel().astype(np.float32)) for array in (tables.s, tables.value, cdf))
        self.elements = None if tables.elements is None else [mi.Float(e.ravel().astype(np.float32)) for e in tables.elements]

    def _interval(self, array, start, x, active):
        above = dr.binary_search(1, self.count - 1, lambda i: dr.gather(mi.Float, array, start + i, active) <= x)
        return mi.UInt32(above) - 1

    def interval(self, s, active):
        return self._interval(self.s, mi.UInt32(0), s, active)

    def interval_cdf(self, row, u, active):
        return self._interval(self.cdf, mi.UInt32(row) * self.count, u, active)

    def node(self, i, active):
        s0 = dr.gather(mi.Float, self.s, i, active)
        return s0, dr.gather(mi.Float, self.s, i + 1, active) - s0

    def pair(self, array, row, i, active):
        start = mi.UInt32(row) * self.count + i
        return dr.gather(mi.Float, array, start, active), dr.gather(mi.Float, array, start + 1, active)

    def below(self, row, i, active):
        return dr.gather(mi.Float, self.cdf, mi.UInt32(row) * self.count + i, active)


class ScalarRows:
    """The same for scalar variants, in plain Python floats: every call handles one direction."""

    def __init__(self, tables, cdf):
        self.count = tables.s.size
        self.s = tables.s.tolist()
        self.value, self.cdf = tables.value.tolist(), cdf.tolist()
        self.elements = None if tables.elements is None else tables.elements.tolist()

    def interval(self, s, active):
        return bisect_right(self.s, s, 1, self.count - 1) - 1

    def interval_cdf(self, row, u, active):
        return bisect_right(self.cdf[row], u, 1, self.count - 1) - 1

    def node(self, i, active):
        return self.s[i], self.s[i + 1] - self.s[i]

    def pair(self, array, row, i, active):
        return array[row][i], array[row][i + 1]

    def below(self, row, i, active):
        return self.cdf[row][i]
