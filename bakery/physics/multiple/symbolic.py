"""Look-ups of tables of multiple scattering on arrays of Dr.Jit: the queries of `queries`, inside of a renderer's own kernels.

The same tables, constants and rules as in `lookup`, `sums` and `queries`; look-ups are loops of the kernel that is recorded, so
any number of them is compiled once.  Values are those of numba's to 1e-6 (root mean square; 5e-6 at worst) with double positions,
to 2e-6 (5e-5; 4e-4 where a line of sight begins on the source) with single ones.
"""

import math
import sys

import numpy as np

from bakery.errors import UsageError
from bakery.physics.multiple import frame, lookup, queries
from bakery.physics.multiple.frame import CORE, SKEW
from bakery.physics.multiple.kinds import POINT
from bakery.system import llvm

_LEAST = 1e-6  # that 1 - k0 counts as: where nothing scatters k0 is 1
_PACK = 4  # functions that are read at once


class Tables:
    """Tables of one wavelength on Dr.Jit's arrays.

    points, segments : `lookup.Ready` of a point and of a segment source; without segments only points can be asked
    Float : Dr.Jit's type of the numbers, such as `mitsuba.Float` or `drjit.llvm.Float64`

    Raises UsageError : Dr.Jit, or for LLVM's arrays an LLVM that it can use, is missing

    Lengths are mean free paths; positions and unit vectors are arrays of three components, such as `mitsuba.Point3f`.
    """

    def __init__(self, points, segments, Float):
        self._dr = required(Float)
        self.Float, self._rounding = Float, 1e-12 if self._dr.type_v(Float) == self._dr.VarType.Float64 else 1e-6
        self._points = _Table(self._dr, points, Float)
        self._segments = None if segments is None else _Table(self._dr, segments, Float)
        rules = (lookup.X, lookup.WEIGHT), (queries.X, queries.WEIGHT)
        self._beam, self._sight = ((len(x), Float(x), Float(weight)) for x, weight in rules)

    def point_to_point(self, vertex, incoming, target, outgoing):
        """In-scattered light at `target` into `outgoing` of power 1 that enters a collision at `vertex`, mfp^-3 sr^-1."""
        return self._points.value(*self._local(target - vertex, incoming, outgoing, 1.0))

    def segment_to_point(self, origin, direction, length, target, outgoing):
        """The same of a beam from `origin` along `direction`, whose first events within `length` count; inf is a pencil."""
        return self._from_beam(self.Float(length), *self._local(target - origin, direction, outgoing, 1.0))

    def point_to_segment(self, vertex, incoming, eye, view, distance):
        """Radiance at the eye against `view`: integral over `distance`, attenuated, mfp^-2 sr^-1."""
        return self._seen(vertex, incoming, None, eye, view, self.Float(distance))

    def segment_to_segment(self, origin, direction, length, eye, view, distance):
        """The same from a beam."""
        return self._seen(origin, direction, self.Float(length), eye, view, self.Float(distance))

    # ---- as in `queries`

    def _local(self, p, axis, outgoing, turn):
        """rho, z of a place relative to the source, and a direction (times turn) along rho, across, along z."""
        dr = self._dr
        z = dr.dot(p, axis)
        q = p - z * axis
        rho = dr.norm(q)
        along = turn * dr.dot(outgoing, axis)
        flat = dr.safe_sqrt(1 - along * along)
        # on the axis the azimuth means nothing
        side = dr.select(rho > 0, turn * dr.dot(outgoing, q) / dr.maximum(rho, _tiny(dr, rho)), flat)
        return rho, z, side, dr.safe_sqrt(flat * flat - side * side), along

    def _seen(self, origin, axis, length, eye, v, distance):
        dr, Float = self._dr, self.Float
        o = origin - eye
        if length is not None:
            # the place of the source that the line of sight passes closest
            cosine = dr.dot(axis, v)
            sine = 1 - cosine * cosine
            nearest = (cosine * dr.dot(o, v) - dr.dot(o, axis)) / dr.maximum(sine, _tiny(dr, sine))
            o = o + dr.select(sine > 0, dr.clip(nearest, 0, length), 0) * axis
        middle = dr.dot(o, v)
        close = dr.maximum(dr.norm(o - middle * v), frame.CLOSEST)
        far = dr.minimum(distance, dr.maximum(middle, 0) + lookup.GONE)
        low, high = dr.asinh(-middle / close), dr.asinh((far - middle) / close)

        def piece(low, total):
            stride = dr.asinh(dr.sinh(low) + queries.STRIDE / close) - low
            step = dr.minimum(dr.minimum(queries.PIECE, self._piece(low)), dr.maximum(stride, self._rounding))
            step = dr.minimum(step, high - low)

            def sample(i, total):
                at = low + self._at(self._sight, i, 1) * step
                t = middle + close * dr.sinh(at)
                weight = self._at(self._sight, i, 2) * step * close * dr.cosh(at) * dr.exp(-t)
                at_eye = self._local(eye + t * v - origin, axis, v, -1.0)
                q = self._points.value(*at_eye) if length is None else self._from_beam(length, *at_eye)
                return i + 1, total + weight * q

            total = self._repeated(self._sight[0], sample, total)
            return dr.select(high - low <= step, high, low + step), total

        return dr.while_loop((low, Float(0)), lambda low, total: low < high, piece)[1]

    def _at(self, rule, i, which):
        return self._dr.gather(self.Float, rule[which], i)

    def _repeated(self, count, body, total):
        """Adds to a total what body(i, total) does for i from 0 on."""
        dr = self._dr
        return dr.while_loop((dr.uint32_array_t(self.Float)(0), total), lambda i, total: i < count, body)[1]

    # ---- as in `lookup`

    def _piece(self, t):
        dr = self._dr
        return lookup.LONGEST / (1 + self._points.table.turn / dr.cosh(dr.maximum(dr.abs(t) - 1, 0)))

    def _touches(self, rho, z, length):
        dr = self._dr
        away = dr.minimum(dr.abs(z), dr.abs(z - length))
        return (rho * rho + away * away < lookup.END**2) | ((rho < lookup.BESIDE) & (z > 0) & (z < length))

    def _from_beam(self, length, rho, z, x, y, along):
        """Whole tiles by the table of segments, but for those that the position touches; these and the rest by that of points."""
        dr, Float, tile = self._dr, self.Float, self._segments.table.length
        deep = lookup.DEEP / max(1 - self._segments.table.k0, _LEAST)
        length = dr.minimum(length, (dr.floor(dr.minimum(dr.maximum(z, 0) + lookup.GONE, deep) / tile) + 1) * tile)
        whole = dr.floor(length / tile * (1 + self._rounding))
        remainder = length - whole * tile > self._rounding * tile

        def one(n, total):
            alone = ~self._touches(rho, z - n * tile, tile)
            q = self._segments.value(rho, z - n * tile, x, y, along)
            return n + 1, total + dr.select(alone, dr.exp(-n * tile) * q, 0)

        total = dr.while_loop((Float(0), Float(0)), lambda n, total: n < whole, one)[1]

        # a position touches the tiles on both sides of the end next to it, if any
        following = dr.floor(z / tile + 0.5)

        def integrated(i, total):
            n = dr.select(i == 0, whole, following + (i - 2))
            start = n * tile
            stop = dr.minimum(start + tile, length)
            wanted = dr.select(i == 0, remainder, (n >= 0) & (n < whole) & self._touches(rho, z - start, tile))
            return i + 1, total + self._integral(start, dr.select(wanted, stop, start), rho, z, x, y, along)

        return dr.while_loop((Float(0), total), lambda i, total: i < 3, integrated)[1]

    def _integral(self, start, stop, rho, z, x, y, along):
        dr, Float = self._dr, self.Float
        close = dr.maximum(rho, frame.CLOSEST)
        t, last = dr.asinh((start - z) / close), dr.asinh((stop - z) / close)
        shortest = dr.select(self._touches(rho, z - start, stop - start), Float(lookup.SHORT), lookup.PIECE)

        def piece(t, total):
            step = dr.minimum(dr.minimum(lookup.PIECE, dr.maximum(shortest, dr.abs(t) / 2)), self._piece(t))
            step = dr.minimum(step, last - t)

            def sample(i, total):
                at_source = t + self._at(self._beam, i, 1) * step
                away = close * dr.sinh(at_source)
                weight = self._at(self._beam, i, 2) * step * close * dr.cosh(at_source) * dr.exp(-(z + away))
                return i + 1, total + weight * self._points.value(rho, -away, x, y, along)

            total = self._repeated(self._beam[0], sample, total)
            return dr.select(last - t <= step, last, t + step), total

        return dr.while_loop((t, Float(0)), lambda t, total: t < last, piece)[1]


class _Table:
    """One table: as in `sums`."""

    def __init__(self, dr, table, Float):
        self.dr, self.table, self.Float = dr, table, Float
        single = dr.float32_array_t(Float)
        self.grid, self.basis = (single(np.ascontiguousarray(a).ravel()) for a in (table.grid, table.basis))
        self.Packed = sys.modules[Float.__module__].Array4f

    def _outwards(self, square):
        """u of m^2 in steps of the grid."""
        dr, core, scale = self.dr, CORE[self.table.kind], self.table.stretch * (self.table.grid.shape[0] - 3)
        return dr.asinh(dr.sqrt(square) / core) * scale

    def _cell(self, x, last):
        dr = self.dr
        i = dr.clip(dr.int32_array_t(self.Float)(x), 0, last)
        return i, dr.float32_array_t(self.Float)(x - self.Float(i))

    def value(self, rho, z, x, y, along):
        """`sums.point_source`."""
        dr, table = self.dr, self.table
        rho = dr.maximum(rho, frame.CLOSEST)
        m, tangent, singular, sine, cosine = self._place(rho, z)
        # the direction in the frame of the position
        forward, side = x * sine + along * cosine, along * sine - x * cosine
        across = dr.sqrt(side * side + y * y)
        above = dr.select(forward > 0, across, 1 - forward)
        below = dr.select(forward > 0, 1 + forward, across)
        U, V, A, B = table.grid.shape[0], table.grid.shape[1], table.basis.shape[0], table.basis.shape[1]
        s = dr.atan2(frame.SHARP * above, below) * (2 / math.pi * (A - 1))
        t = dr.atan2(dr.abs(y), side) * ((B - 1) / math.pi)
        j, v = self._cell(2 / math.pi * (V - 3) * dr.atan(SKEW[table.kind] * tangent), V - 4)
        k, s = self._cell(s, A - 2)
        l, t = self._cell(t, B - 2)
        i, u = self._cell(self._outwards(dr.square(dr.minimum(m, table.extent))), U - 4)
        beyond = dr.maximum(m - table.extent, 0)
        share = beyond / dr.maximum(m, table.extent) * (frame.INSIDE / (1 - frame.INSIDE))
        inner, p_inner = self._cell(self._outwards(self.Float((frame.INSIDE * table.extent) ** 2)), U - 4)
        value_there = self._blended((i, inner), (_catmull_rom(u), _catmull_rom(p_inner)), j, _catmull_rom(v), k * B + l,
                                    ((1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t), dr.float32_array_t(self.Float)(share))
        shift = share * table.k0 * (1 - frame.INSIDE) * table.extent - table.k0 * beyond
        return table.power * singular * dr.exp(self.Float(value_there) + shift)

    def _place(self, rho, z):
        """As `locate.place`."""
        dr, length = self.dr, self.table.length
        square = rho * rho
        r1 = dr.sqrt(square + z * z)
        plus1, minus1 = _sums(dr, square, r1, z)
        if self.table.kind == POINT:
            return r1, dr.sqrt(minus1 / plus1), 1 / r1, rho / r1, z / r1
        after = z - length
        plus2, minus2 = _sums(dr, square, dr.sqrt(square + after * after), after)
        beyond = minus1 + plus2  # r1 + r2 - length
        m = dr.sqrt(beyond * (2 * length + beyond)) / 2
        # far away the logarithm of 1 and a little more
        singular = dr.select(beyond > 2 * length, 2 * dr.atanh(length / (length + beyond)), dr.log(1 + 2 * length / beyond))
        return m, dr.sqrt((minus1 + minus2) / (plus1 + plus2)), singular, rho / r1, z / r1

    def _blended(self, i, p, j, w, column, f, share):
        """As `_blend.blend`; beyond the extent twice: (1 + share) times that of the rows i[0] less share times that of i[1]."""
        dr = self.dr
        Index = dr.int32_array_t(self.Float)
        Single = dr.float32_array_t(self.Float)
        V, packs, ring = self.table.grid.shape[1], self.table.grid.shape[2] // _PACK, self.table.basis.shape[1]

        def body(n, total):
            again = n >= packs
            k = dr.select(again, n - packs, n)
            factor = dr.select(again, -share, 1 + share)
            weights = [dr.select(again, far, near) for near, far in zip(*p, strict=True)]
            first = dr.select(again, i[1], i[0]) * V + j

            def corners(source, base, weights):
                return sum(weight * dr.gather(self.Packed, source, (base + m) * packs + k) for m, weight in enumerate(weights))

            a = sum(weights[m] * corners(self.grid, first + m * V, w) for m in range(4))
            b = corners(self.basis, column, f[:2]) + corners(self.basis, column + ring, f[2:])
            # k = 0 is added, the others are multiplied
            products = a * b
            products.x = dr.select(k == 0, a.x + b.x, products.x)
            return n + 1, total + factor * dr.sum(products)

        count = dr.select(share > 0, Index(2 * packs), Index(packs))
        return dr.while_loop((Index(0), Single(0)), lambda n, total: n < count, body)[1]


def required(Float):
    """The module drjit, with what numbers of this type need.

    Raises UsageError : it, or an LLVM that it can use, is missing
    """
    llvm.find()
    try:
        import drjit
    except ImportError as error:
        raise UsageError(f"look-ups on Dr.Jit's arrays: {error}; get it by: {llvm.INSTALL}") from None
    if not (drjit.is_jit_v(Float) and drjit.is_float_v(Float) and drjit.depth_v(Float) == 1):
        raise UsageError(f"look-ups on Dr.Jit's arrays: {Float.__name__} is no type of its arrays of numbers, such as "
                         "drjit.llvm.Float64; Mitsuba's scalar variants have none")
    fault = llvm.fault(tuple(drjit.detail.llvm_version())) if drjit.backend_v(Float) == drjit.JitBackend.LLVM else None
    if fault:
        raise UsageError(f"look-ups on Dr.Jit's arrays: {fault}")
    return drjit


def _tiny(dr, x):
    """The smallest number that x may be divided by."""
    return dr.smallest(dr.detached_t(type(x)))


def _sums(dr, square, r, z):
    """r + z and r - z, where r^2 = square + z^2."""
    long = r + dr.abs(z)
    short = square / long
    return dr.select(z > 0, long, short), dr.select(z > 0, short, long)


def _catmull_rom(t):
    first, last = -0.5 * t * (1 - t) * (1 - t), 0.5 * t * t * (t - 1)
    third = t * (0.5 + t * (2 - 1.5 * t))
    return first, 1 - first - third - last, third, last


def drjit_tables(points, segments, Float):
    """Tables of one wavelength, from `asset.multiple.segment.tables()`, for look-ups in kernels of Dr.Jit.

    points, segments : of both sources; None for segments where only points are asked;  Float : `mitsuba.Float`, or of Dr.Jit

    Returns `Tables` with `point_to_point`, `segment_to_point`, `point_to_segment` and
    `segment_to_segment`.  Raises UsageError where Dr.Jit, or an LLVM for it, is missing.
    """
    return Tables(points, segments, Float)
