"""Tables of plugins: in device memory for the variants of Dr.Jit, in plain Python floats for scalar ones, a direction a call."""

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


def held(values):
    """Numbers as a table holds them."""
    values = np.asarray(values, float).ravel()
    return mi.Float(values.astype(np.float32)) if dr.is_jit_v(mi.Float) else values.tolist()


def at(array, index, active=True):
    """Entries of what is `held`; in a scalar variant, or of a number that is known, one is read here and now."""
    return dr.gather(mi.Float, array, index, active) if dr.is_jit_v(mi.Float) else array[int(index)]


class Rows:
    """Tables of phase functions row behind row; `row` and `i` are UInt32 arrays, in scalar variants integers."""

    def __init__(self, tables):
        self.count = tables.s.size
        self.s, self.value, self.cdf = map(held, (tables.s, tables.value, tables.cdf()))
        self.elements = None if tables.elements is None else list(map(held, tables.elements))

    def interval(self, array, row, x, active):
        """The one in which x lies, of a row that ascends."""
        start = mi.UInt32(row) * self.count
        if not dr.is_jit_v(mi.Float):
            return bisect_right(array, x, start + 1, start + self.count - 1) - start - 1
        above = dr.binary_search(1, self.count - 1, lambda i: dr.gather(mi.Float, array, start + i, active) <= x)
        return mi.UInt32(above) - 1

    def pair(self, array, row, i, active):
        """Values at both ends of an interval."""
        start = mi.UInt32(row) * self.count + i
        return at(array, start, active), at(array, start + 1, active)
