"""Primary samples of paths: the uniform numbers that a path is made of, kept in arrays, moved about and followed again.

A path takes its numbers one after the other.  The first ones stand in a table, a row for each number and a column for each path;
those behind are the path's random stream, which goes on as it began.  So paths of any length have their numbers, and one that is
followed again goes the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np

from renderers.mitsuba import variants  # before mitsuba: it finds LLVM
from renderers.transport import loop
from renderers.transport.wavefront import ORDERS

import mitsuba as mi  # isort: skip

# paths of a lane, which share space for records.  Variance times time of a glass of milk with 4, 16, 64: 1, 0.74, 0.67; a ball of
# wax is as quick with 16 as with 64.  A graphics card wants many lanes
_TOGETHER, _ON_GPU = 32, 4
FILM = 2  # the first numbers: where on the film, 0 to 1 of its width and height
_BELOW_ONE = float(np.nextafter(np.float32(1), np.float32(0)))
# small steps (Kelemen et al. 2002, section 3): of sizes whose logarithm is uniform; on the film in pixels, up to a share of it
_SMALL, _NEAR, _FAR = (1 / 1024, 1 / 64), 0.25, 0.05


@dataclass
class Numbers:
    """Numbers of paths, one path a lane, as PCG32 gives them.

    stream : of each path;  taken : how many numbers;  column : of the table
    table : `Table`, or None: all are those of the stream
    """

    stream: mi.PCG32
    taken: mi.UInt32
    column: mi.UInt32
    table: object

    def next_float32(self, active=True):
        number = self.stream.next_float32(active)
        if self.table is None:
            return number
        kept = self.table.has(self.taken)
        number = dr.select(kept, self.table.at(self.taken, self.column, kept), number)
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

    def at(self, number, column, active):
        return dr.gather(mi.Float, self.values, number * self._width + column, active)


class Source:
    """Paths to be followed: where their numbers are.

    count : paths
    """

    def __init__(self, size, pixel, words, table=None):
        """
        size : height and width of the film, pixels
        pixel : (n,) in which paths begin, where there is no table
        words : (2, n) of 32 bits, of each path's random stream
        table : `Table` of the first numbers; None: these are the stream's, too
        """
        self.count, self._size, self._table = words.shape[1], size, table
        self._pixel = mi.UInt32(pixel)
        low, high = mi.sample_tea_32(mi.UInt32(words[0]), mi.UInt32(words[1]))
        self._streams = mi.PCG32(1, mi.UInt64(low), mi.UInt64(high))
        dr.eval(self._streams)

    def begin(self, number, active=True):
        """Pixels, places in them and `Numbers` of paths."""
        stream = dr.gather(mi.PCG32, self._streams, number, active)
        offset = _offset(stream)
        if self._table:
            taken = [self._table.at(mi.UInt32(axis), number, active) for axis in range(FILM)]
        else:
            taken = _on_film(dr.gather(mi.UInt32, self._pixel, number, active), offset, self._size)
        return *_in_pixel(taken, self._size), Numbers(stream, FILM + dr.zeros(mi.UInt32, dr.width(number)), number, self._table)

    def drawn(self, count):
        """Table of the first numbers of the paths, all of which are their streams'."""
        values, lane = dr.zeros(mi.Float, count * self.count), dr.arange(mi.UInt32, self.count)
        width, end = (dr.opaque(mi.UInt32, number) for number in (self.count, count))
        stream = dr.gather(mi.PCG32, self._streams, lane)
        for axis, coordinate in enumerate(_on_film(self._pixel, _offset(stream), self._size)):
            dr.scatter(values, coordinate, axis * width + lane)

        def fill(stream, number):
            dr.scatter(values, stream.next_float32(), number * width + lane)
            return stream, number + 1

        dr.while_loop((stream, FILM + dr.zeros(mi.UInt32, self.count)), lambda stream, number: number < end, fill,
                      label="numbers")
        dr.eval(values)
        return Table(values, count, self.count)


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


def either(chosen, table, second):
    """Table of the columns of one where they are chosen (n,), else of the second."""
    index = dr.arange(mi.UInt32, table.count * table.width)
    column = index - index // dr.opaque(mi.UInt32, table.width) * dr.opaque(mi.UInt32, table.width)
    values = dr.select(dr.gather(mi.Bool, mi.Bool(chosen), column), table.values, second.values)
    dr.eval(values)
    return Table(values, table.count, table.width)


def _offset(stream):
    return mi.Point2f(stream.next_float32(), stream.next_float32())


def _on_film(pixel, offset, size):
    """Places on a film, 0 to 1 of its width and height."""
    height, width = (dr.opaque(mi.UInt32, side) for side in size)
    row = pixel // width
    return [dr.minimum((mi.Float(whole) + part) / mi.Float(side), _BELOW_ONE)
            for whole, part, side in ((pixel - row * width, offset.x, width), (row, offset.y, height))]


def _in_pixel(coordinates, size):
    """Pixels, and places in them."""
    sides = [dr.opaque(mi.UInt32, side) for side in reversed(size)]
    scaled = [value * mi.Float(side) for value, side in zip(coordinates, sides)]
    whole = [dr.minimum(mi.UInt32(value), side - 1) for value, side in zip(scaled, sides)]
    return whole[1] * sides[0] + whole[0], mi.Point2f(*[value - mi.Float(k) for value, k in zip(scaled, whole)])


def light(scene, source):
    """Light of the paths of a `Source`, (n, 3 ORDERS) single precision, linear sRGB of each order, and their pixels (n,).

    A lane follows several paths, one after the other, so that those of a packet wait less for each other.
    """
    together = _ON_GPU if variants.on_gpu(mi.variant()) else _TOGETHER
    lanes = -(-source.count // together)
    step, count = dr.opaque(mi.UInt32, lanes), dr.opaque(mi.UInt32, source.count)
    brought = [dr.zeros(mi.Float, source.count) for _ in range(3 * ORDERS)]
    turn = loop.THROUGH_MEDIA
    records, counts = scene.lamps.records(lanes, together) if scene.lamps else (None, None)

    def camera(number, counts):
        alive = number < count
        pixel, offset, numbers = source.begin(number, alive)
        drawn = offset, numbers.next_float32(alive)
        path = loop.camera_paths(scene, pixel, drawn, numbers, alive, number)
        path.counts = counts
        return path

    def following(path, sums):
        for channel, value in zip(brought, sums):
            dr.scatter(channel, value, path.number)
        number = path.number + step
        return camera(number, path.counts), [dr.zeros(mi.Float, dr.width(number)) for _ in sums]

    def go(path, sums):
        path, event = turn.advance(scene, path, records)
        for radiance, _, order in loop.brought(scene, turn, path, event, records):
            _add(sums, order, radiance)
        path = turn.turned(scene, path, event, records)
        return dr.if_stmt((path, sums), ~path.alive, following, lambda *state: state, label="following paths")

    number = dr.arange(mi.UInt32, lanes)
    start = camera(number, counts), [dr.zeros(mi.Float, lanes) for _ in range(3 * ORDERS)]
    dr.while_loop(start, lambda path, sums: path.alive, go, label="primary samples")
    dr.eval(brought)
    light = np.stack([np.asarray(channel) for channel in brought], axis=1)
    for number, order, _, refracted in scene.lamps.light(records) if scene.lamps else ():
        loop.add(light.reshape(-1, 3), number * ORDERS + np.minimum(order, ORDERS - 1), refracted)
    pixel = source.begin(dr.arange(mi.UInt32, source.count))[0]
    return light, np.asarray(pixel)


def _add(sums, order, light):
    """Adds light to the sums of its order."""
    for k in range(3 * ORDERS):
        sums[k] = sums[k] + dr.select(dr.minimum(order, ORDERS - 1) == k // 3, light[k % 3], 0)
