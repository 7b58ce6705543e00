"""Light that fog scatters between a picture's surfaces and the camera: a blur whose kernel differs from pixel to pixel.

A viewing ray spreads like a narrow beam that starts at the camera (`kernels`).  A pixel p shows

    e^-tau col + near + far:
    near: sum over nearer pixels p' of K_p'(d) col',  K = P k,  P the power (`kernels.Fog.powers`),  k its share in a pixel,
    far:  what the beam has left after those, P (1 - q/s), times the mean of col over the other pixels, weighted by k_p(d);
          s = 1 - e^-tau_s is scattered, nearer pixels take q = sum of s' k_p'(d) of it,

so a nearer thing is blurred by its own, shorter path (Shinya et al. 2016, section 5), each pair of pixels counts once, and a
constant picture without absorption stays constant for any distances.

The sums go over all pixels.  `direct` does so; `fogged` takes near pixels one by one and others in blocks of 2, 4, 8 ... pixels,
whose side is a fifth to four fifths of their distance: the kernel is split into smooth bands, K = sum K w_l, and band l is summed
over blocks of 2^l pixels, their light at its centre.  A block keeps its sums in classes of distance from the camera.  The cost of
a pixel goes with the logarithm of the picture's size and does not know the kernel's.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np

from bakery.errors import UsageError
from renderers.fog import _filter, kernels

# A band's weight rises from INNER/2 to INNER blocks and falls from there to twice that; the nearest has pixels for blocks.
INNER = 2.5
CLASSES = 16  # of distance
_ROWS, _SOME = 16, 64  # rows, pixels of a task
_FINE = 2048  # steps of the squared distance for a band's weight
OUTSIDE, ENERGY = ("edge", "black"), ("kept", "lost")


def fogged(image, distance, angle, column, lever, medium, *, outside="edge", energy="kept", cut_off=None, threads=None,
           progress=None):
    """A picture seen through fog, without light from elsewhere.

    Parameters
    ----------
    image : (H, W, C) radiance of the surfaces as seen without fog
    distance : (H, W) m, along the viewing ray
    angle : (H, W) rad, side of a pixel
    column : (H, W) m, integral of the relative density along the ray
    lever : (H, W) m, sqrt(3 S_2/S_0), S_n the integral of density times (distance to the surface)^n; at constant density it is
        the distance
    medium : kernels.Fog of C channels, or of one for all
    outside : edge, the surroundings look like what the picture shows of them; black, they are dark
    energy : lost, scattered light has the power that transport gives it; kept, what went back past the camera is added
    cut_off : lengths (kernels.Fog.width) beyond which a kernel is cut and renormalised, or None
    threads : None for all processors; the result does not depend on it
    progress : function of the share that is done, or None

    Returns
    -------
    (H, W, C) radiance; where column is 0 it is the image's, to the last bit

    Raises
    ------
    UsageError : shapes do not fit, something is not finite or negative; the text names it

    Notes
    -----
    Root mean square difference from `direct`: 0.5 % of the image's mean for a scene with lamps and edges (benchmarks/screen.py);
    with CLASSES of 12 and 24 the same, with INNER 3 it is 0.3 % in 1.3 times the time.  Memory: some 600 bytes a pixel.
    """
    p = _Prepared(image, distance, angle, column, lever, medium, energy, cut_off, outside)
    height, width = p.z.shape
    sums = np.zeros((height, width, 5, p.channels))
    if not p.power.any():  # nothing is scattered
        return p.finished(sums)
    levels = 1 + max(math.ceil(math.log2(math.hypot(height, width) / INNER)), 0)
    with _workers(threads) as pool:
        finished = 0

        def rows(function, *arguments):
            nonlocal finished
            tasks = [pool.submit(function, low, min(low + _ROWS, height), p.pixels, *arguments, sums)
                     for low in range(0, height, _ROWS)]
            for task in tasks:
                task.result()
                finished += 1
                if progress:
                    progress(finished / (levels * len(tasks)))

        rows(_filter.nearest_rows, p.nearest())
        band = _band()
        for level in _levels(p):
            rows(_filter.level_rows, level, band)
    return p.finished(sums)


def _band():
    """Distances of every level above 0."""
    square = np.linspace(0, 4 * INNER**2, _FINE)
    rho = np.sqrt(np.maximum(square, INNER**2 / 4))
    # a profile's first node lies where the band begins
    node = np.log(rho / (INNER / 2)) / kernels.STEP
    return _filter.Band(INNER / 2, 2 * INNER, node, (_rise(2 * rho / INNER) - _rise(rho / INNER)) / rho)


def _levels(p):
    """Levels above 0, from small blocks to large ones, each made from the one before; p : `_Prepared`"""
    shift = math.log(INNER / 2) / kernels.STEP
    entries, mask = p.entries(), np.left_shift(1, _classes(p.z).astype(np.int64))
    start, side = np.arange(p.z.size + 1), 1
    padded = np.concatenate([p.shape, np.zeros((*p.shape.shape[:2], _filter.NODES + 1), np.float32)], axis=2)
    while INNER * side < math.hypot(*p.z.shape):
        side *= 2
        below, below_mask, below_start = entries, mask, start
        mask, start = _filter.count(below_mask, *below_mask.shape)
        entries = np.empty((start[-1], below.shape[1]))
        _filter.merge(below, below_mask, below_start, mask, start, CLASSES, entries)
        profiles = np.empty((len(entries), _filter.NODES, p.kinds), np.float32)
        at = shift + math.log(side) / kernels.STEP
        _filter.profiles(entries, p.pixels.depth_of, padded, kernels.STEP, p.lever_first, at, float(side), profiles)
        yield _filter.Level(padded, at, float(side), start, mask.shape, entries, profiles)


def direct(image, distance, angle, column, lever, medium, *, outside="edge", energy="kept", cut_off=None, threads=None,
           pixels=None, reach=None):
    """`fogged` by its definition, every pair of pixels: the reference, and slow.

    Parameters
    ----------
    image ... threads : as of `fogged`
    pixels : (N,) flat indices of pixels that are wanted, or None for all
    reach : pixels; what is farther away along a row or a column is left out

    Returns
    -------
    (H, W, C), or (N, C) of the wanted pixels
    """
    p = _Prepared(image, distance, angle, column, lever, medium, energy, cut_off, outside)
    chosen = np.arange(p.z.size) if pixels is None else np.asarray(pixels, np.int64)
    sums = np.zeros((len(chosen), 5, p.channels))
    farthest = max(p.z.shape) if reach is None else int(reach)
    side = 1 + int(p.offsets.max())
    offset = np.full((side, side), -1)
    for o, (dy, dx) in enumerate(p.offsets):
        offset[dy, dx] = offset[dx, dy] = o
    with _workers(threads) as pool:
        table = _filter.Table(p.shape, p.means, offset, kernels.STEP)
        tasks = [pool.submit(_filter.every_pair, chosen[k:k + _SOME], farthest, p.pixels, table, outside == "black",
                             sums[k:k + _SOME])
                 for k in range(0, len(chosen), _SOME)]
        for task in tasks:
            task.result()
    result = p.finished(sums, chosen)
    return result.reshape(*p.z.shape, p.channels) if pixels is None else result


@contextmanager
def _workers(threads):
    """Threads that leave what has not begun when they are interrupted."""
    pool = ThreadPoolExecutor(threads or os.cpu_count() or 1)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


class _Prepared:
    """Checked inputs as the loops take them."""

    def __init__(self, image, distance, angle, column, lever, medium, energy, cut_off, outside):
        if outside not in OUTSIDE or energy not in ENERGY:
            raise UsageError(f"filter: outside {outside!r}, energy {energy!r}; {' or '.join(OUTSIDE)} and {' or '.join(ENERGY)} "
                             "would do")
        image = np.asarray(image, float)
        kinds, self.outside, self.image = len(medium.sigma_t), outside, image
        if image.ndim != 3 or kinds not in (1, image.shape[2]) or image.size == 0:
            raise UsageError(f"image: shape {image.shape}; (height, width, {kinds if kinds > 1 else 'any'}) would do")
        self.channels, self.kinds = image.shape[2], kinds
        self.z, angle, column, lever = (_plane(name, value, image.shape[:2], least) for name, value, least in
                                        (("distance", distance, True), ("angle", angle, True), ("column", column, False),
                                         ("lever", lever, False)))
        if not np.isfinite(image).all():
            raise UsageError(f"image: {_first(~np.isfinite(image).all(2))} is not finite")
        fog = self.fog = medium.cut(cut_off)
        self.tau = column[..., None] * fog.sigma_t
        self.share, self.power = -np.expm1(-column[..., None] * fog.sigma_s), fog.powers(column, energy)[0]
        self.shape = fog.shape.astype(np.float32)
        reach = int(2 * INNER)
        self.offsets = np.array([(y, x) for y in range(reach + 1) for x in range(y + 1) if y * y + x * x < 4 * INNER**2])
        self.means = kernels.over_pixels(fog, tuple(map(tuple, self.offsets.tolist())))
        number = {tuple(o): n for n, o in enumerate(self.offsets.tolist())}
        self.taps = np.array([(y, x, number[max(abs(y), abs(x)), min(abs(y), abs(x))]) for y in range(-reach, reach + 1)
                              for x in range(-reach, reach + 1) if y * y + x * x < 4 * INNER**2])
        # no lever or no column: a kernel that is a point, or nothing at all
        with np.errstate(divide="ignore", over="ignore"):
            pixel = np.where(lever > 0, self.z * angle / np.where(lever > 0, lever, 1), np.inf)
            at_depth = (np.log(np.maximum(column, 1e-300)) - math.log(fog.depth[0])) / kernels.STEP
            depth_of = tuple((np.log(np.maximum(fog.sigma_t, 1e-300)) / kernels.STEP).tolist())
        u = np.clip(pixel, 1e-30, fog.ratio[-1])
        self.lever_first = math.log(fog.ratio[0])
        self.pixels = _filter.Pixels(self.z, at_depth, (np.log(u) - self.lever_first) / kernels.STEP, u,
                                     np.concatenate([image, self.power * image, self.share], axis=2), depth_of)

    def nearest(self):
        """Level 0."""
        weight = (1 - _rise(np.hypot(*self.offsets.T) / INNER)).astype(np.float32)
        return _filter.Nearest(self.means, self.taps, weight)

    def entries(self):
        """Pixels as entries, (H W, F)."""
        height, width = self.z.shape
        out = np.empty((height, width, _filter.FIRST + self.pixels.light.shape[2]))
        out[..., _filter.COUNT] = 1
        out[..., _filter.Y], out[..., _filter.X] = np.arange(height)[:, None] + 0.5, np.arange(width) + 0.5
        out[..., _filter.GLOW] = np.abs(self.image).sum(2)
        out[..., _filter.GLOW_Y], out[..., _filter.GLOW_X] = out[..., _filter.Y], out[..., _filter.X]
        out[..., _filter.AT_NEAREST] = out[..., _filter.AT_FARTHEST] = 1
        for column in (_filter.NEAREST, _filter.FARTHEST, _filter.DISTANCE):
            out[..., column] = self.z
        out[..., _filter.COLUMN], out[..., _filter.LEVER] = self.pixels.column, self.pixels.lever
        out[..., _filter.WEIGHT] = self.share.mean(2)
        out[..., _filter.FIRST:] = self.pixels.light
        return out.reshape(height * width, -1)

    def finished(self, sums, chosen=None):
        """The picture from the sums."""
        def of(array):
            return array if chosen is None else array.reshape(-1, array.shape[-1])[chosen]

        image, share, power = of(self.image), of(self.share), of(self.power)
        near, far = sums[..., _filter.NEAR, :], sums[..., _filter.FAR, :]
        gathered, reached, remainder = (sums[..., k, :self.kinds] for k in (_filter.SHARE, _filter.MET, _filter.REST))
        with np.errstate(divide="ignore", invalid="ignore"):
            # nearer things take no more than the beam has
            near = np.where(gathered > share, near * (share / gathered), near)
            unspent = np.where(share > 0, power * np.maximum(1 - gathered / share, 0), 0.0)
            if self.outside == "black":
                reached = reached + np.maximum(1 - reached - remainder, 0)
            mean = np.where(reached > 0, far / reached, 0.0)
        return np.exp(-of(self.tau)) * image + near + unspent * mean


def _plane(name, value, shape, positive):
    value = np.asarray(value, float)
    try:
        value = np.broadcast_to(value, shape)
    except ValueError:
        raise UsageError(f"{name}: shape {value.shape}; {shape} would do") from None
    wrong = ~(np.isfinite(value) & ((value > 0) if positive else (value >= 0)))
    if wrong.any():
        raise UsageError(f"{name}: {value[wrong][0]:g} at {_first(wrong)}; a finite number "
                         f"{'above 0' if positive else 'of 0 or more'} would do")
    return np.array(value, order="C")  # not read-only: one kind of array is compiled for


def _first(wrong):
    y, x = (int(i) for i in np.argwhere(wrong)[0])
    return f"row {y}, column {x}"


def _rise(x):
    """0 below 1, 1 above 2, smooth."""
    t = np.clip(x - 1, 0, 1)
    return t * t * (3 - 2 * t)


def _classes(z):
    """Class of every pixel by its distance, ascending.

    As many pixels to the third as gives least squares of log distance (Panter and Dite 1951): gaps cost nothing.
    """
    log_z = np.log(z)
    low, high = float(log_z.min()), float(log_z.max())
    if high - low < 1e-9:
        return np.zeros(z.shape, np.int64)
    bin_of = np.minimum((log_z - low) / (high - low) * 256, 255).astype(int)
    density = np.cumsum(np.cbrt(np.bincount(bin_of.ravel(), minlength=256)))
    return np.minimum(((density - 1e-9) / density[-1] * CLASSES).astype(int), CLASSES - 1)[bin_of]
