"""What paths of a wavefront share, whatever scatters them: random streams, colours, sums by order and by light, roulette.

Each path has a random stream of its own, so that values do not depend on threads.  It carries one weight a wavelength; `colours`
is any tuple with to_rgb (3, L), linear sRGB from radiances, and to_waves (L, 3), radiances from linear sRGB.
"""

import numpy as np

from bakery.kernels import hashed, stream_key
from bakery.system.compiled import njit

_GOLDEN, _BRANCH = np.uint64(0x9E3779B97F4A7C15), stream_key(0, "render.branch")
ORDERS = 4  # of scattering that are told apart: 0, 1, 2, 3 and more


@njit(cache=True, nogil=True, error_model="numpy")
def begin_streams(key, first, states):
    """Random streams (n,) uint64 of paths first, first + 1, ...; key uint64, of `bakery.kernels.stream_key`."""
    for i in range(len(states)):
        states[i] = hashed(key ^ (np.uint64(first + i) * _GOLDEN))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def uniform(states, i):
    """The next number of stream i, in [0, 1)."""
    s = states[i] + _GOLDEN
    states[i] = s
    return (hashed(s) >> np.uint64(11)) * 2.0**-53


@njit(cache=True, nogil=True, error_model="numpy")
def draw(states, out):
    """Uniform numbers out (n, m) in [0, 1), row i from stream i."""
    for i in range(len(states)):
        for j in range(out.shape[1]):
            out[i, j] = uniform(states, i)


def streams(key, count, first=0) -> np.ndarray:
    """Random streams (count,) of paths first, first + 1, ..., as `begin_streams`."""
    states = np.empty(count, np.uint64)
    begin_streams(key, first, states)
    return states


def uniforms(states, columns, rows=slice(None)) -> np.ndarray:
    """Uniform numbers (n, columns) in [0, 1), row i from the i-th of all streams, or of some rows."""
    chosen = states[rows]
    numbers = np.empty((len(chosen), columns))
    draw(chosen, numbers)
    states[rows] = chosen
    return numbers


def branch(states, copies=None):
    """Gives paths that part from others random streams of their own, in the place of theirs (n,).

    copies : (n,) int64, which ones of those that part from a path before it has drawn another number; None: the only ones
    """
    _branch(_BRANCH, np.zeros(len(states), np.int64) if copies is None else copies, states)


@njit(cache=True, nogil=True, error_model="numpy")
def _branch(key, copies, states):
    for i in range(len(states)):
        states[i] = hashed(hashed(states[i] ^ key) ^ (np.uint64(copies[i]) * _GOLDEN))


@njit(cache=True, nogil=True, error_model="numpy")
def to_rgb(colours, values, radiance, rgb):
    """What factors values (L,) make of radiance (3,), linear sRGB."""
    to_waves, to_rgb = colours.to_waves, colours.to_rgb
    rgb[:] = 0.0
    for w in range(len(values)):
        value = values[w] * (to_waves[w, 0] * radiance[0] + to_waves[w, 1] * radiance[1] + to_waves[w, 2] * radiance[2])
        for c in range(3):
            rgb[c] += to_rgb[c, w] * value


@njit(cache=True, nogil=True, error_model="numpy")
def emitted(colours, weight, order, radiance, added):
    """What paths bring of radiance (n, 3), linear sRGB, that they have met: added (n, 3); nothing where the order is below 0."""
    for i in range(len(added)):
        added[i] = 0.0
        if order[i] >= 0 and (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
            to_rgb(colours, weight[i], radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def reflect(colours, weight, factor, begin, end):
    """Multiplies weights (n, L) by reflectances factor (n, 3), linear sRGB."""
    to_waves = colours.to_waves
    for i in range(begin, end):
        for w in range(weight.shape[1]):
            weight[i, w] *= to_waves[w, 0] * factor[i, 0] + to_waves[w, 1] * factor[i, 1] + to_waves[w, 2] * factor[i, 2]


@njit(cache=True, nogil=True, error_model="numpy")
def add(added, order, index, pixel, by_order, by_light):
    for c in range(3):
        by_order[order, pixel, c] += added[c]
        if 0 <= index < len(by_light):
            by_light[index, pixel, c] += added[c]


@njit(cache=True, nogil=True, error_model="numpy")
def accumulate(added, order, index, pixel, by_order, by_light):
    """Adds added (n, 3) to pixels (n,) of by_order (ORDERS, pixels, 3) and by_light (lights, pixels, 3), one after the other."""
    for i in range(len(pixel)):
        if added[i, 0] != 0 or added[i, 1] != 0 or added[i, 2] != 0:
            add(added[i], min(order[i], ORDERS - 1), index[i], pixel[i], by_order, by_light)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def goes_on(weight, states, bounces, i):
    """Whether Russian roulette leaves path i: those of little weight end, and of those of n > 100,000 bounces some 4 / n do so at
    each.  Changes the weight of those that go on.

    Many paths in a large lossless body are as long as that; what ends them earlier, or as quickly as one in a thousand, makes the
    others bright.
    """
    most = 0.0
    for w in range(weight.shape[1]):
        most = max(most, weight[i, w])
    chance = min(most, 1.0 if bounces[i] < 100_000 else (1 - 1 / bounces[i]) ** 4)
    if most > 0 and bounces[i] < 4:
        chance = 1.0
    alive = chance > 0 and (chance >= 1.0 or uniform(states, i) < chance)
    if alive:
        for w in range(weight.shape[1]):
            weight[i, w] /= chance
    return alive


@njit(cache=True, nogil=True, error_model="numpy")
def roulette(weight, states, bounces, alive, begin, end):
    """Russian roulette of paths begin to end: alive (n,) becomes whether each goes on."""
    for i in range(begin, end):
        alive[i] = goes_on(weight, states, bounces, i)
