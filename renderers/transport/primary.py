"""Primary samples of paths: the uniform numbers that a path is made of, kept in arrays, moved about and followed again.

A path takes its numbers one after the other.  The first ones stand in a table, a row for each number and a column for each path;
those behind are the path's random stream, which goes on as it began.  So paths of any length have their numbers, and one that is
followed again goes the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
from renderers.transport import loop
from renderers.transport.wavefront import ORDERS

import mitsuba as mi  # isort: skip

FILM = 2  # the first numbers: where on the film, 0 to 1 of its width and height
_BELOW_ONE = float(np.nextafter(np.float32(1), np.float32(0)))
# small steps (Kelemen et al. 2002, section 3): of sizes whose logarithm is uniform; on the film in pixels, up to a share of it
_SMALL, _NEAR, _FAR = (1 / 1024, 1 / 64), 0.25, 0.05


@dataclass
class Numbers:
    """Numbers of paths, one path a lane, as PCG32 gives them.

    stream : of each path;  taken : how many numbers;  table : `Table`, or None: all are those of the stream
    """

    stream: mi.PCG32
    taken: mi.UInt32
    table: object

    def next_float32(self, active=True):
        number = self.stream.next_float32(active)
        if self.table is None:
            return number
        kept = self.table.has(self.taken)
        number = dr.select(kept, self.table.at(self.taken, kept), number)
        self.taken += dr.select(active, mi.UInt32(1), mi.UInt32(0))
        return number


class Table:
    """The first numbers of paths.

    values : of all paths of the first number, then of the second, ...;  count : numbers of a path;  width : paths
    """

    def __init__(self, values, count, width):
        self.values, self.count, self.width = values, count, width
        self._count, self._width = dr.opaque(mi.UInt32, count), dr.opaque(mi.UInt32, width)

    def has(self, number):
        return number < self._count

    def at(self, number, active):
        lane = dr.arange(mi.UInt32, self.width)
        return dr.gather(mi.Float, self.values, number * self._width + lane, active)


def streams(words):
    """Random streams of paths, by two words (2, n) of 32 bits each."""
    low, high = mi.sample_tea_32(mi.UInt32(words[0]), mi.UInt32(words[1]))
    return mi.PCG32(1, mi.UInt64(low), mi.UInt64(high))


def drawn(pixel, size, words, count):
    """Table of paths whose numbers are those of their streams, in pixels (n,) of a film of `size` (height, width)."""
    stream, lanes = streams(words), len(pixel)
    values = dr.zeros(mi.Float, count * lanes)
    lane, width = dr.arange(mi.UInt32, lanes), dr.opaque(mi.UInt32, lanes)
    for axis, place in enumerate(_on_film(mi.UInt32(pixel), _offset(stream), size)):
        dr.scatter(values, place, axis * width + lane)
    end = dr.opaque(mi.UInt32, count)

    def fill(stream, number):
        dr.scatter(values, stream.next_float32(), number * width + lane)
        return stream, number + 1

    dr.while_loop((stream, mi.UInt32(FILM) + dr.zeros(mi.UInt32, lanes)), lambda stream, number: number < end, fill,
                  label="numbers")
    dr.eval(values)
    return Table(values, count, lanes)


def moved(table, size, words):
    """Table of numbers near those of another: each by a small step, to either side, around the ends to the other one."""
    index = dr.arange(mi.UInt32, table.count * table.width)
    number = index // dr.opaque(mi.UInt32, table.width)
    first, second = mi.sample_tea_32(index ^ dr.opaque(mi.UInt32, words[0]), dr.opaque(mi.UInt32, words[1]))
    share = mi.Float(first >> 8) * 2.0**-24
    least, most = (dr.opaque(mi.Float, value) for value in _SMALL)
    for axis, pixels in enumerate(reversed(size)):
        least = dr.select(number == axis, dr.opaque(mi.Float, min(_NEAR / pixels, _FAR)), least)
        most = dr.select(number == axis, dr.opaque(mi.Float, _FAR), most)
    step = most * dr.exp(share * dr.log(least / most))
    value = table.values + dr.select((second & 1) == 0, step, -step)
    return Table(dr.minimum(value - dr.floor(value), _BELOW_ONE), table.count, table.width)


def either(chosen, table, other):
    """Table of the columns of one where they are chosen (n,), else of another."""
    index = dr.arange(mi.UInt32, table.count * table.width)
    column = index - index // dr.opaque(mi.UInt32, table.width) * dr.opaque(mi.UInt32, table.width)
    values = dr.select(dr.gather(mi.Bool, mi.Bool(chosen), column), table.values, other.values)
    dr.eval(values)
    return Table(values, table.count, table.width)


def columns(table, numbers):
    """Table of some of the columns, by their numbers (n,)."""
    index = dr.arange(mi.UInt32, table.count * len(numbers))
    row = index // dr.opaque(mi.UInt32, len(numbers))
    column = dr.gather(mi.UInt32, mi.UInt32(numbers), index - row * dr.opaque(mi.UInt32, len(numbers)))
    values = dr.gather(mi.Float, table.values, row * dr.opaque(mi.UInt32, table.width) + column)
    dr.eval(values)
    return Table(values, table.count, len(numbers))


def _offset(stream):
    return mi.Point2f(stream.next_float32(), stream.next_float32())


def _on_film(pixel, offset, size):
    """Places on a film, 0 to 1 of its width and height."""
    height, width = (dr.opaque(mi.UInt32, side) for side in size)
    row = pixel // width
    return [dr.minimum((mi.Float(whole) + part) / mi.Float(side), _BELOW_ONE)
            for whole, part, side in ((pixel - row * width, offset.x, width), (row, offset.y, height))]


def _in_pixel(place, size):
    """Pixels, and places in them."""
    sides = [dr.opaque(mi.UInt32, side) for side in reversed(size)]
    scaled = [value * mi.Float(side) for value, side in zip(place, sides)]
    whole = [dr.minimum(mi.UInt32(value), side - 1) for value, side in zip(scaled, sides)]
    return whole[1] * sides[0] + whole[0], mi.Point2f(*[value - mi.Float(k) for value, k in zip(scaled, whole)])


def begun(pixel, size, words):
    """Paths that take their numbers from their streams, in pixels (n,): arguments of `light`."""
    stream = streams(words)
    pixel, offset = _in_pixel(_on_film(mi.UInt32(pixel), _offset(stream), size), size)
    return pixel, offset, Numbers(stream, dr.zeros(mi.UInt32, dr.width(pixel)), None)


def again(table, size, words):
    """Paths that take their numbers from a table, and later ones from their streams: arguments of `light`."""
    stream = streams(words)
    _offset(stream)
    lane = dr.arange(mi.UInt32, table.width)
    pixel, offset = _in_pixel([dr.gather(mi.Float, table.values, axis * dr.opaque(mi.UInt32, table.width) + lane)
                               for axis in range(FILM)], size)
    return pixel, offset, Numbers(stream, dr.full(mi.UInt32, FILM, table.width), table)


def light(scene, pixel, offset, numbers):
    """Light of a path a lane, (n, 3 ORDERS) single precision, linear sRGB of each order of scattering, and its pixels (n,)."""
    width = dr.width(pixel)
    path = loop.camera_paths(scene, pixel, offset, numbers, dr.zeros(mi.UInt32, width), dr.full(mi.Bool, True, width))
    turn = loop.Turn(lambda scene, path: path, loop.advance, loop.next_event, loop.turned)

    def step(path, sums):
        path, event = turn.advance(scene, path)
        loop.add(sums, path.order, *(radiance for radiance, _ in loop.brought(scene, turn, path, event)))
        return turn.turned(scene, path, event), sums

    sums = [dr.zeros(mi.Float, width) for _ in range(3 * ORDERS)]
    sums = dr.while_loop((path, sums), lambda path, sums: path.alive, step, label="primary samples")[1]
    dr.eval(sums, pixel)
    return np.stack([np.asarray(channel) for channel in sums], axis=1), np.asarray(pixel)
