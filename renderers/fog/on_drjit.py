"""The filter on arrays of Dr.Jit: `cuda` for graphics cards, `llvm` for the processor's vectors.

The sums of `filter.fogged`, each band at every pixel, in single precision; distances are compared in double precision, so that
the same pixels are the nearer ones.  Blocks are put together on the card too: entry by entry from those of the four blocks below.
"""

import importlib
import math
from functools import lru_cache
from types import SimpleNamespace

import numpy as np

from bakery.errors import UsageError
from bakery.system import llvm
from renderers.fog import _filter, kernels
from renderers.fog._lanes import LANES
from renderers.fog._prepared import CLASSES, DARK, INNER, Prepared, class_of_bins

llvm.find()  # before Dr.Jit looks for it
import drjit as dr  # noqa: E402

_NODES = _filter.NODES
_ROWS = 6  # of four numbers in an entry: see `_rows`
_BINS = 256


def fogged(image, distance, angle, column, lever, medium, *, backend="cuda", **options):
    """As `filter.fogged`, of whose options it takes outside, energy and cut_off."""
    card = _filter_of(medium, np.shape(image)[2], backend=backend, **options)
    return card.fogged(image, distance, angle, column, lever).numpy().astype(float)


class Filter:
    """A medium on a card, for pictures of up to LANES channels.

    medium : kernels.Fog
    channels : of the pictures
    backend : cuda or llvm
    outside, energy, cut_off : as of `filter.fogged`
    """

    def __init__(self, medium, channels=3, *, backend="cuda", outside="edge", energy="kept", cut_off=None):
        self._types = types = _types(backend)
        # tables alone: a picture of one pixel
        tables = Prepared(np.ones((1, 1, channels)), [1.0] * 4, medium, outside=outside, energy=energy, cut_off=cut_off)
        fog = medium.cut(cut_off)
        self._black, self._channels, self._fog = outside == "black", channels, fog
        self._sigma_t, self._sigma_s = (np.broadcast_to(a, channels) for a in (fog.sigma_t, fog.sigma_s))
        self._depth_of = [float(d) for d in tables.kernels.depth_of]
        self._first, self._last_u = tables.kernels.first, float(fog.ratio[-1])
        self._shape, self._means = (_Table(types, table) for table in (tables.kernels.shape, tables.kernels.means))
        nearest = tables.nearest()
        self._taps = types.Int(np.ascontiguousarray(nearest.taps, np.int32).ravel())
        self._offsets, self._weights = len(nearest.weight), types.Float(nearest.weight)
        self._band = types.Float(np.ascontiguousarray(tables.band.table).ravel())
        self._band_steps = len(tables.band.table)
        self._ratios = _Ratios(types, fog, energy, channels)

    def fogged(self, image, distance, angle, column, lever):
        """A picture seen through fog, (H, W, C) float32 of Dr.Jit; arguments as of `filter.fogged`, all (H, W) or (H, W, C)."""
        types, (height, width) = self._types, np.shape(distance)
        pixels = self._pixels(image, distance, angle, column, lever)
        sums = self._nearest(pixels, height, width)
        blocks = SimpleNamespace(height=height, width=width, mask=pixels.mask, start=dr.arange(types.UInt, height * width),
                                 rows=pixels.rows, near=pixels.z, far=pixels.z, mean=pixels.z)
        side = 1
        while INNER * side < math.hypot(height, width):
            side *= 2
            blocks = _merged(types, blocks)
            shift = (math.log(INNER / 2) + math.log(side)) / kernels.STEP
            row = dr.gather(types.Four, blocks.rows, dr.arange(types.UInt, blocks.count) * _ROWS + 1)
            blocks.profiles = self._profiles(row[1], row[2], shift, side)
            beam = self._profiles(pixels.column, pixels.lever, shift, side)
            brought = _level_sums(types, pixels.y, pixels.x, pixels.z, blocks, beam, self._band, self._band_steps, float(side))
            sums = [total + part for total, part in zip(sums, brought)]
            dr.eval(sums)
        return self._finished(pixels, sums, height, width)

    def _pixels(self, image, distance, angle, column, lever):
        types = self._types
        count = np.size(distance)
        image = types.Float(np.ascontiguousarray(image, np.float32).ravel())
        z = types.Double(np.ascontiguousarray(distance, float).ravel())
        angle, column, lever = (types.Float(np.ascontiguousarray(np.broadcast_to(a, np.shape(distance)), np.float32).ravel())
                                for a in (angle, column, lever))
        index = dr.arange(types.UInt, count)
        width = np.shape(distance)[1]
        y, x = types.Float(index // width) + 0.5, types.Float(index % width) + 0.5
        u = dr.select(lever > 0, types.Float(z) * angle / dr.select(lever > 0, lever, 1), self._last_u)
        u = dr.clip(u, 1e-30, self._last_u)
        lever_at = (dr.log(u) - self._first) / kernels.STEP
        column_at = (dr.log(dr.maximum(column, 1e-37)) - math.log(kernels.SHALLOWEST)) / kernels.STEP
        col, share, power = types.Four(0), types.Four(0), types.Four(0)
        for c in range(self._channels):
            col[c] = dr.gather(types.Float, image, index * self._channels + c)
            share[c] = _scattered(column * float(self._sigma_s[c]))
            power[c] = share[c] * self._ratios.at(dr.log(dr.maximum(column * float(self._sigma_t[c]), 1e-37)), c)
        glow, weight = (sum(values[c] for c in range(self._channels)) for values in (dr.abs(col), share))
        glow += dr.maximum(DARK * dr.max(glow), 1e-30)
        kernel = weight / self._channels, column_at, lever_at, 0
        rows = _rows(types, (y, x, 1, glow), kernel, (1, 1, 0, 0), col, power * col, share)
        pixels = SimpleNamespace(y=y, x=x, z=z, column=column_at, lever=lever_at, u=u, col=col, share=share, power=power,
                                 depth=column, rows=rows, mask=self._classes(z))
        dr.eval(pixels.y, pixels.x, column_at, lever_at, u, col, share, power, pixels.mask, rows)
        return pixels

    def _classes(self, z):
        """Bit of the class of every pixel, see `_prepared.class_of_bins`."""
        types, log_z = self._types, dr.log(z)
        low, high = (float(extreme(log_z)[0]) for extreme in (dr.min, dr.max))
        if high - low < 1e-9:
            return dr.full(types.UInt, 1, dr.width(z))
        number = types.UInt(dr.minimum((log_z - low) / (high - low) * _BINS, _BINS - 1))
        counted = dr.zeros(types.UInt, _BINS)
        dr.scatter_reduce(dr.ReduceOp.Add, counted, types.UInt(1), number)
        return types.UInt(1) << dr.gather(types.UInt, types.UInt(class_of_bins(counted.numpy())), number)

    def _profiles(self, column, lever, shift, side):
        """Radial profiles, (N, NODES, LANES), see `_filter.profiles`."""
        types = self._types
        lane = dr.arange(types.UInt, dr.width(column) * _NODES)
        e, n = lane // _NODES, lane % _NODES
        lever = dr.gather(types.Float, lever, e)
        factor = dr.exp(self._first + kernels.STEP * lever) / side
        out = self._shape.at(dr.gather(types.Float, column, e), self._depth_of, lever + shift, n, _NODES + 1.001)
        return _stored(types, factor * out)

    def _nearest(self, pixels, height, width):
        """Level 0, see `_filter.nearest_rows`."""
        types = self._types
        lane = dr.arange(types.UInt, height * width * self._offsets)
        e, o = lane // self._offsets, lane % self._offsets
        column, lever, u = (dr.gather(types.Float, a, e) for a in (pixels.column, pixels.lever, pixels.u))
        shares = self._means.at(column, self._depth_of, lever, o, 1.001)
        shares = _stored(types, u * dr.gather(types.Float, self._weights, o) * shares)
        brought = _nearest_sums(types, pixels.z, pixels.rows, shares, self._offsets, self._taps, height, width)
        dr.eval(brought)
        return brought

    def _finished(self, pixels, sums, height, width):
        """See `Prepared.finished`."""
        types = self._types
        near, gathered, far, reached, remainder = sums
        share, power = pixels.share, pixels.power
        near = dr.select(gathered > share, near * (share / dr.maximum(gathered, 1e-37)), near)
        unspent = dr.select(share > 0, power * dr.maximum(1 - gathered / dr.maximum(share, 1e-37), 0), 0)
        if self._black:
            reached = reached + dr.maximum(1 - reached - remainder, 0)
        mean = dr.select(reached > 0, far / dr.maximum(reached, 1e-37), 0)
        index = dr.arange(types.UInt, height * width) * self._channels
        out = dr.zeros(types.Float, height * width * self._channels)
        for c in range(self._channels):
            seen = dr.exp(-pixels.depth * float(self._sigma_t[c])) * pixels.col[c] + near[c] + unspent[c] * mean[c]
            dr.scatter(out, seen, index + c)
        return types.Tensor(out, (height, width, self._channels))


_filter_of = lru_cache(maxsize=4)(Filter)


def _types(backend):
    fault = llvm.fault(dr.detail.llvm_version()) if backend == "llvm" else None
    if fault:
        raise UsageError(fault)
    if backend == "cuda" and not dr.has_backend(dr.JitBackend.CUDA):
        raise UsageError("fog: no graphics card that CUDA could use was found; a variant that does not begin with cuda would do")
    module = importlib.import_module(f"drjit.{backend}")
    return SimpleNamespace(Float=module.Float, Double=module.Float64, UInt=module.UInt32, Int=module.Int32, Four=module.Array4f,
                           Bool=module.Bool, Tensor=module.TensorXf)


class _Table:
    """A table (LANES, T, X) or (LANES, T, X, O), linear in T and X."""

    def __init__(self, types, values):
        self._types, self._size = types, values.shape[1:]
        self._values = types.Float(np.ascontiguousarray(values, np.float32).ravel())

    def at(self, column, depth_of, lever, n, margin):
        """Values of all lanes at an index of the column and one of log u: of number n, or n nodes on where there are no numbers.

        margin : of the last index of log u
        """
        types, (rows, columns, *numbers) = self._types, self._size
        step = numbers[0] if numbers else 1
        v = dr.clip(lever, 0, columns - margin)
        j = types.UInt(v)
        g = v - types.Float(j)
        out = types.Four(0)
        for k, depth in enumerate(depth_of):
            t = dr.clip(column + depth, 0, rows - 1.001)
            i = types.UInt(t)
            f = t - types.Float(i)
            at = ((i + k * rows) * columns + j) * step + n
            a, b, c, d = (dr.gather(types.Float, self._values, at + further)
                          for further in (0, step, columns * step, columns * step + step))
            out[k] = (1 - f) * ((1 - g) * a + g * b) + f * ((1 - g) * c + g * d)
        return out


class _Ratios:
    """Power over the share that is scattered, linear on equal steps of log tau, 768 a decade: the spline of `kernels.Fog`."""

    def __init__(self, types, fog, energy, channels):
        nodes, values = fog.ratios(energy, 8)
        self._types, self._nodes, self._count = types, nodes, len(nodes)
        self._values = types.Float(np.ascontiguousarray(np.broadcast_to(values, (channels, len(nodes))), np.float32).ravel())

    def at(self, log_tau, channel):
        step = (self._nodes[-1] - self._nodes[0]) / (self._count - 1)
        position = dr.clip((log_tau - float(self._nodes[0])) / step, 0, self._count - 1.001)
        i = self._types.UInt(position)
        f = position - self._types.Float(i)
        low, high = (dr.gather(self._types.Float, self._values, i + channel * self._count + n) for n in (0, 1))
        return low + f * (high - low)


def _scattered(tau):
    """1 - e^-tau, also where it is small."""
    return dr.select(tau < 0.1, tau * (1 - tau / 2 * (1 - tau / 3 * (1 - tau / 4 * (1 - tau / 5)))), 1 - dr.exp(-tau))


def _stored(types, four):
    """(N, 4) in memory."""
    out = dr.empty(types.Float, LANES * dr.width(four))
    dr.scatter(out, four, dr.arange(types.UInt, dr.width(four)))
    return out


# ---- entries of blocks


def _rows(types, centre, kernel, ends, col, sent, share):
    """Entries in memory, (N, _ROWS, 4).

    centre : y, x, pixels, brightness;  kernel : weight, indices of column and lever;  ends : pixels at the nearest and at the
    farthest distance, and how others lie between them (`_blocks.BETWEEN`)
    """
    width = dr.width(col)
    out = dr.empty(types.Float, LANES * _ROWS * width)
    index = dr.arange(types.UInt, width) * _ROWS
    for n, row in enumerate((types.Four(*centre), types.Four(*kernel), types.Four(*ends), col, sent, share)):
        dr.scatter(out, row, index + n)
    return out


def _merged(types, below):
    """Blocks of two by two of the blocks `below`; see `_blocks.merge_rows`."""
    height, width = (below.height + 1) // 2, (below.width + 1) // 2
    block = dr.arange(types.UInt, height * width)
    mask = dr.zeros(types.UInt, height * width)
    for _, active, index in _children(types, block, width, below):
        mask |= dr.gather(types.UInt, below.mask, index, active)
    number = dr.popcnt(mask)
    end = dr.cumsum(number)
    start = end - number
    dr.eval(mask, start)
    count = int(end[-1])
    # which block and class each entry is of
    lane = dr.arange(types.UInt, height * width * CLASSES)
    block_of, bit = lane // CLASSES, types.UInt(1) << (lane % CLASSES)
    bits = dr.gather(types.UInt, mask, block_of)
    index = dr.gather(types.UInt, start, block_of) + dr.popcnt(bits & (bit - 1))
    block, kind = dr.empty(types.UInt, count), dr.empty(types.UInt, count)
    active = (bits & bit) != 0
    dr.scatter(block, block_of, index, active)
    dr.scatter(kind, bit, index, active)
    parts = []
    for _, active, index in _children(types, block, width, below):
        bits = dr.gather(types.UInt, below.mask, index, active)
        active = active & ((bits & kind) != 0)
        index = dr.gather(types.UInt, below.start, index, active) + dr.popcnt(bits & (kind - 1))
        parts.append(_part(types, below, index, active))
    merged = SimpleNamespace(height=height, width=width, mask=mask, count=count,
                             start=dr.zeros(types.UInt, height * width + 1), **_sum_of(types, parts))
    dr.scatter(merged.start, start, dr.arange(types.UInt, height * width))
    dr.scatter(merged.start, types.UInt(count), types.UInt(height * width))
    dr.eval(merged.start, merged.rows, merged.near, merged.far, merged.mean)
    return merged


def _children(types, block, width, below):
    """Number, whether it is there, and index of each block below."""
    y, x = block // width, block % width
    for n in range(4):
        yy, xx = 2 * y + n // 2, 2 * x + n % 2
        yield n, (yy < below.height) & (xx < below.width), yy * below.width + xx


def _part(types, below, index, active):
    rows = [dr.gather(types.Four, below.rows, index * _ROWS + n, active) for n in range(_ROWS)]
    near, far, mean = (dr.gather(types.Double, a, index, active) for a in (below.near, below.far, below.mean))
    return SimpleNamespace(rows=rows, near=dr.select(active, near, math.inf), far=dr.select(active, far, 0), mean=mean)


def _sum_of(types, parts):
    """An entry from its parts, see `_blocks._add` and `_finish`."""
    near, far = parts[0].near, parts[0].far
    for part in parts[1:]:
        near, far = dr.minimum(near, part.near), dr.maximum(far, part.far)
    total = lambda value: sum(value(part) for part in parts[1:]) + value(parts[0])  # noqa: E731
    count, glow, weight = total(lambda p: p.rows[0][2]), total(lambda p: p.rows[0][3]), total(lambda p: p.rows[1][0])
    y, x = (total(lambda p, k=k: p.rows[0][3] * p.rows[0][k]) / glow for k in (0, 1))
    column, lever = (total(lambda p, k=k: p.rows[1][0] * p.rows[1][k]) / dr.select(weight > 0, weight, 1) for k in (1, 2))
    at_near = total(lambda p: dr.select(p.near == near, p.rows[2][0], 0))
    at_far = total(lambda p: dr.select(p.far == far, p.rows[2][1], 0))
    distance = total(lambda p: types.Double(p.rows[0][2]) * p.mean)
    span, number = far - near, types.Double(count)
    between = number - types.Double(at_near) - types.Double(at_far)
    inside = between > 0.5
    mean = (distance - near * number - types.Double(at_far) * span) / dr.select(inside, between * span, 1)
    mean = dr.clip(mean, 1e-3, 1 - 1e-3)
    ends = at_near, at_far, types.Float(dr.select(inside, mean / (1 - mean), 0)), 0
    light = (total(lambda p, k=k: p.rows[k]) for k in (3, 4, 5))
    rows = _rows(types, (y, x, count, glow), (weight, column, lever, 0), ends, *light)
    return {"rows": rows, "near": near, "far": far, "mean": distance / number}


# ---- sums


@dr.syntax
def _nearest_sums(types, z, rows, shares, offsets, taps, height, width):
    """NEAR, SHARE, FAR, MET, REST of every pixel from those at the taps."""
    index = dr.arange(types.UInt, height * width)
    y, x = types.Int(index // width), types.Int(index % width)
    near, share, far, weights, nearer_weights = types.Four(0), types.Four(0), types.Four(0), types.Four(0), types.Four(0)
    n, count = types.UInt(0), dr.width(taps) // 3
    while n < count:
        yy, xx = y + dr.gather(types.Int, taps, 3 * n), x + dr.gather(types.Int, taps, 3 * n + 1)
        o = types.UInt(dr.gather(types.Int, taps, 3 * n + 2))
        if (yy >= 0) & (yy < height) & (xx >= 0) & (xx < width):
            neighbour = types.UInt(yy * width + xx)
            by_beam = dr.gather(types.Four, shares, index * offsets + o)
            if dr.gather(types.Double, z, neighbour) < z:
                sent = dr.gather(types.Four, shares, neighbour * offsets + o)
                near += sent * dr.gather(types.Four, rows, neighbour * _ROWS + 4)
                share += sent * dr.gather(types.Four, rows, neighbour * _ROWS + 5)
                nearer_weights += by_beam
            else:
                far += by_beam * dr.gather(types.Four, rows, neighbour * _ROWS + 3)
                weights += by_beam
        n += 1
    return [near, share, far, weights, nearer_weights]


@dr.syntax
def _level_sums(types, y, x, z, blocks, beam, band, steps, side):
    """The same of a level, see `_filter.level_targets`."""
    pixel = dr.arange(types.UInt, dr.width(z))
    near, share, far, weights, nearer_weights = types.Four(0), types.Four(0), types.Four(0), types.Four(0), types.Four(0)
    around = 2 * INNER + 0.71
    v, h = y / side, x / side
    by = types.Int(dr.maximum(dr.floor(v - around), 0))
    bottom = dr.minimum(types.Int(dr.floor(v + around)) + 1, blocks.height)
    while by < bottom:
        across = around * around - dr.square(types.Float(by) + 0.5 - v)
        reach = dr.sqrt(dr.maximum(across, 0))
        first = types.Int(dr.maximum(dr.ceil(h - reach - 0.5), 0))
        last = dr.minimum(types.Int(dr.floor(h + reach - 0.5)) + 1, blocks.width)
        crossed = (across > 0) & (first < last)
        row = by * blocks.width
        e = dr.gather(types.UInt, blocks.start, types.UInt(row + first), crossed)
        end = dr.gather(types.UInt, blocks.start, types.UInt(row + last), crossed)
        while e < end:
            centre = dr.gather(types.Four, blocks.rows, e * _ROWS)
            w, n, g = _looked(types, band, steps, side, dr.square(centre[0] - y) + dr.square(centre[1] - x))
            if w > 0:
                nearest, farthest = (dr.gather(types.Double, a, e) for a in (blocks.near, blocks.far))
                nearer = types.Float(0)
                if z > farthest:
                    nearer = types.Float(1)
                elif z > nearest:
                    ends = dr.gather(types.Four, blocks.rows, e * _ROWS + 2)
                    between = centre[2] - ends[0] - ends[1]
                    t = types.Float((z - nearest) / (farthest - nearest))
                    nearer = (ends[0] + dr.select(between < 0.5, 0, between * dr.power(t, ends[2]))) / centre[2]
                by_beam = w * _mixed(types, beam, pixel * _NODES + n, g)
                nearer_weights += nearer * centre[2] * by_beam
                if nearer > 0:
                    sent = w * nearer * _mixed(types, blocks.profiles, e * _NODES + n, g)
                    near += sent * dr.gather(types.Four, blocks.rows, e * _ROWS + 4)
                    share += sent * dr.gather(types.Four, blocks.rows, e * _ROWS + 5)
                if nearer < 1:
                    far += (1 - nearer) * by_beam * dr.gather(types.Four, blocks.rows, e * _ROWS + 3)
                    weights += (1 - nearer) * centre[2] * by_beam
            e += 1
        by += 1
    return [near, share, far, weights, nearer_weights]


def _looked(types, band, steps, side, square):
    """Weight of the band over the distance (0 outside of it), node and fraction of a profile."""
    position = square * (steps * (1 - 1e-6) / (2 * INNER * side) ** 2)
    inside = (square > (INNER / 2 * side) ** 2) & (square < (2 * INNER * side) ** 2)
    i = types.UInt(dr.select(inside, dr.minimum(position, steps - 1), 0))
    row = dr.gather(types.Four, band, i, inside)
    s = position - types.Float(i)
    g = row[2] + s * row[3]
    n = types.UInt(dr.select(inside, g, 0))
    return dr.select(inside, row[0] + s * row[1], 0), n, g - types.Float(n)


def _mixed(types, profiles, index, g):
    low, high = (dr.gather(types.Four, profiles, index + n) for n in (0, 1))
    return low + g * (high - low)
