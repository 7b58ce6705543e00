"""The filter of fog in screen space by its definition, pair of pixels by pair of pixels; slow.  What the sums are:
`renderers.fog._filter`."""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from bakery.system.compiled import njit
from renderers.fog import _columns, _filter
from renderers.fog._filter import FAR, MET, NEAR, REST, SHARE, _place
from renderers.fog._lanes import LANES
from renderers.fog._prepared import Prepared

_SOME = 64  # pixels of a task


def direct(image, distance, angle, column, lever, medium, *, pixels=None, reach=None, **options):
    """`filter.fogged` by its definition, every pair of pixels.

    Parameters
    ----------
    image ... medium, options : as of `fogged`
    pixels : (N,) flat indices of pixels that are wanted, or None for all
    reach : pixels; what is farther away along a row or a column is left out

    Returns
    -------
    (H, W, C), or (N, C) of the wanted pixels
    """
    image = np.asarray(image, float)
    p = Prepared(image, (distance, angle, column, lever), medium, **options)
    chosen = np.arange(p.z.size) if pixels is None else np.asarray(pixels, np.int64)
    sums = np.zeros((len(chosen), _filter.SUMS, LANES))
    farthest = max(p.z.shape) if reach is None else int(reach)
    table = Table(p.kernels, _number(p._offsets))
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for task in [pool.submit(every_pair, chosen[k:k + _SOME], farthest, p.pixels, table, p.outside == "black",
                                 sums[k:k + _SOME]) for k in range(0, len(chosen), _SOME)]:
            task.result()
    result = p.finished(sums, chosen)
    return result.reshape(image.shape) if pixels is None else result


def _number(offsets):
    """Of the means over pixels at |dy|, |dx|, -1 where there is none."""
    side = 1 + int(offsets.max())
    number = np.full((side, side), -1)
    for o, (dy, dx) in enumerate(offsets):
        number[dy, dx] = number[dx, dy] = o
    return number


class Table(NamedTuple):
    """Kernels of pairs of pixels.

    kernels : `_filter.Kernels`
    offset : (R, R) number of the mean over pixels at |dy|, |dx|, or -1: the kernel at the pixel's centre
    """

    kernels: tuple
    offset: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def _shares(pixels, y, x, distance, along, o, kernels, out):
    """Shares (LANES,) of a pixel's light in another one: at offset number o by the mean over the pixel, or else at its centre."""
    shape, means = kernels.shape, kernels.means
    last_t, last_u = means.shape[1] - 1.001, means.shape[2] - 1.001
    v = pixels.lever[y, x] if o >= 0 else pixels.lever[y, x] + along
    if o < 0 and v > last_u:
        out[:] = 0
        return
    v = _place(v, last_u)
    j = int(v)
    g = v - j
    factor = pixels.u[y, x] if o >= 0 else pixels.u[y, x] / distance
    for c in range(LANES):
        t = _place(pixels.column[y, x] + kernels.depth_of[c], last_t)
        i = int(t)
        f = t - i
        if o >= 0:
            out[c] = factor * ((1 - f) * ((1 - g) * means[c, i, j, o] + g * means[c, i, j + 1, o])
                               + f * ((1 - g) * means[c, i + 1, j, o] + g * means[c, i + 1, j + 1, o]))
        else:
            out[c] = factor * ((1 - f) * ((1 - g) * shape[c, i, j] + g * shape[c, i, j + 1])
                               + f * ((1 - g) * shape[c, i + 1, j] + g * shape[c, i + 1, j + 1]))


@njit(cache=True, nogil=True, error_model="numpy")
def every_pair(chosen, reach, pixels, table, remainder, out):
    """The sums of chosen pixels (flat indices) over every pixel at most `reach` away along either axis; out (N, SUMS, LANES).

    remainder : whether `REST` is wanted
    """
    z, light, offset = pixels.distance, pixels.light, table.offset
    height, width = z.shape
    near = len(offset)
    share = np.empty(LANES)
    for n in range(len(chosen)):
        y, x = chosen[n] // width, chosen[n] % width
        this, sums = z[y, x], out[n]
        for yy in range(max(y - reach, 0), min(y + reach + 1, height)):
            for xx in range(max(x - reach, 0), min(x + reach + 1, width)):
                dy, dx = abs(yy - y), abs(xx - x)
                o = offset[dy, dx] if dy < near and dx < near else -1
                distance = math.sqrt(float(dy * dy + dx * dx))
                along = math.log(distance) / table.kernels.step if o < 0 else 0.0
                if z[yy, xx] < this:
                    _shares(pixels, yy, xx, distance, along, o, table.kernels, share)
                    for c in range(LANES):
                        sums[NEAR, c] += share[c] * light[yy, xx, 2 * LANES + c]
                        sums[SHARE, c] += share[c] * light[yy, xx, 3 * LANES + c]
                    if remainder:
                        _shares(pixels, y, x, distance, along, o, table.kernels, share)
                        for c in range(LANES):
                            sums[REST, c] += share[c]
                else:
                    _shares(pixels, y, x, distance, along, o, table.kernels, share)
                    for c in range(LANES):
                        sums[FAR, c] += share[c] * light[yy, xx, c]
                        sums[MET, c] += share[c]


def look(fog, channel, tau, ratio):
    """s(tau, x) of a channel of a `renderers.fog.kernels.Fog`, broadcast; 0 beyond the largest ratio: what a filter looks up."""
    i, j = np.broadcast_arrays(fog.place(tau, fog.depth), fog.place(ratio, fog.ratio))
    m, n, table = i.astype(int), j.astype(int), fog.shape[channel]
    f, g = i - m, j - n
    values = (1 - f) * ((1 - g) * table[m, n] + g * table[m, n + 1]) + f * ((1 - g) * table[m + 1, n] + g * table[m + 1, n + 1])
    return np.where(np.broadcast_to(np.asarray(ratio) <= fog.ratio[-1], i.shape), values, 0.0)


def diffuse(albedo, g, tau, total, *, mu=1.0, irradiance=1.0):
    """`_columns.column` of arguments that broadcast: (phi, flux)."""
    return np.vectorize(_columns.column)(*(np.asarray(value, float) for value in (albedo, g, tau, total, mu, irradiance)))
