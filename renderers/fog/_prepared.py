"""What the filter's loops take of a picture, and the picture from their sums."""

import math

import numpy as np

from bakery.errors import UsageError
from renderers.fog import _blocks, _filter, kernels
from renderers.fog._lanes import LANES

# A band's weight rises from INNER/2 to INNER blocks and falls from there to twice that; the nearest has pixels for blocks.
INNER = 2.5
CLASSES = 16  # of distance
OUTSIDE, ENERGY = ("edge", "black"), ("kept", "lost")
_FINE = 512  # steps of the squared distance for a band's weight


DARK = 1e-6  # of the brightest pixel: what a block is centred by where it is black


class Prepared:
    """Checked inputs as the loops take them.

    rays : distance, angle, column, lever;  options : outside, energy, cut_off;  all as of `filter.fogged`
    z : (H, W) m;  mask : (H, W), bit of a pixel's class
    pixels : `_blocks.Pixels`;  kernels : `_filter.Kernels`;  band : `_filter.Band`, of every level above 0
    power : (H, W, K), see `kernels.Fog.powers`
    """

    def __init__(self, image, rays, medium, *, outside="edge", energy="kept", cut_off=None):
        distance, angle, column, lever = rays
        if outside not in OUTSIDE or energy not in ENERGY:
            raise UsageError(f"filter: outside {outside!r}, energy {energy!r}; {' or '.join(OUTSIDE)} and {' or '.join(ENERGY)} "
                             "would do")
        self.outside, self._image = outside, image
        self.z, angle, column, lever = (_plane(name, value, image.shape[:2], least) for name, value, least in
                                        (("distance", distance, True), ("angle", angle, True), ("column", column, False),
                                         ("lever", lever, False)))
        if not np.isfinite(image).all():
            raise UsageError(f"image: {_first(~np.isfinite(image).all(2))} is not finite; finite numbers of 0 or more would do")
        fog = medium.cut(cut_off)
        self._tau = column[..., None] * fog.sigma_t
        self._share = -np.expm1(-column[..., None] * fog.sigma_s)
        self.power = fog.arriving(column, self._share, energy)
        reach = int(2 * INNER)
        self._offsets = np.array([(y, x) for y in range(reach + 1) for x in range(y + 1) if y * y + x * x < 4 * INNER**2])
        self.mask = np.left_shift(1, _classes(self.z))
        self._tables(fog)
        # no lever or no column: a kernel that is a point, or nothing at all
        with np.errstate(divide="ignore", over="ignore"):
            pixel = np.where(lever > 0, self.z * angle / np.where(lever > 0, lever, 1), np.inf)
            at_depth = (np.log(np.maximum(column, 1e-300)) - math.log(fog.depth[0])) / kernels.STEP
        u = np.clip(pixel, 1e-30, fog.ratio[-1])
        light = np.zeros((*self.z.shape, 4, LANES))
        for k, values in enumerate((image, 1.0, self.power * image, self._share)):
            light[..., k, :image.shape[2]] = values
        glow = np.abs(image).sum(2)
        glow += max(DARK * float(glow.max()), 1e-30)
        self.pixels = _blocks.Pixels(self.z, at_depth, (np.log(u) - self.kernels.first) / kernels.STEP, u, glow,
                                     self._share.mean(2), light.reshape(*self.z.shape, -1))

    def _tables(self, fog):
        means = kernels.over_pixels(fog, tuple(map(tuple, self._offsets.tolist())))
        with np.errstate(divide="ignore"):
            depth_of = np.log(np.maximum(fog.sigma_t, 1e-300)) / kernels.STEP
        shape = np.concatenate([fog.shape, np.zeros((*fog.shape.shape[:2], _filter.NODES + 1))], axis=2).astype(np.float32)
        self.kernels = _filter.Kernels(_lanes(shape), _lanes(means), _lanes(depth_of), kernels.STEP, math.log(fog.ratio[0]))
        square = np.linspace(0, 4 * INNER**2, _FINE + 1)
        rho = np.sqrt(np.maximum(square, INNER**2 / 4))
        # a profile's first node lies where the band begins
        node = np.log(rho / (INNER / 2)) / kernels.STEP
        weight = (_rise(2 * rho / INNER) - _rise(rho / INNER)) / rho
        table = np.stack([weight[:-1], np.diff(weight), node[:-1], np.diff(node)], axis=1)
        self.band = _filter.Band(INNER / 2, 2 * INNER, table.astype(np.float32))

    def nearest(self):
        """Level 0."""
        reach = int(2 * INNER)
        number = {tuple(o): n for n, o in enumerate(self._offsets.tolist())}
        taps = np.array([(y, x, number[max(abs(y), abs(x)), min(abs(y), abs(x))]) for y in range(-reach, reach + 1)
                         for x in range(-reach, reach + 1) if y * y + x * x < 4 * INNER**2])
        return _filter.Nearest(taps, (1 - _rise(np.hypot(*self._offsets.T) / INNER)).astype(np.float32))

    def targets(self):
        """The pixels as places where sums are wanted."""
        y, x = np.indices(self.z.shape) + 0.5
        arrays = (a.reshape(-1) for a in (y, x, self.z, self.pixels.column, self.pixels.lever))
        return _blocks.Targets(self.mask, np.arange(self.z.size + 1), *arrays)

    def finished(self, sums, chosen=None):
        """The picture from the sums (..., SUMS, LANES)."""
        def of(array):
            return array if chosen is None else array.reshape(-1, array.shape[-1])[chosen]

        image, share, power = of(self._image), of(self._share), of(self.power)
        near, gathered, far, reached, remainder = (
            sums[..., k, :self._image.shape[2]] for k in (_filter.NEAR, _filter.SHARE, _filter.FAR, _filter.MET, _filter.REST))
        with np.errstate(divide="ignore", invalid="ignore"):
            # nearer things take no more than the beam has
            near = np.where(gathered > share, near * (share / gathered), near)
            unspent = np.where(share > 0, power * np.maximum(1 - gathered / share, 0), 0.0)
            if self.outside == "black":
                reached = reached + np.maximum(1 - reached - remainder, 0)
            mean = np.where(reached > 0, far / reached, 0.0)
        return np.exp(-of(self._tau)) * image + near + unspent * mean


def _lanes(table):
    """A table of kinds (K, ...) for LANES channels: one kind serves all, and there is nothing in channels that are not there."""
    if len(table) == 1:
        return np.repeat(table, LANES, axis=0)
    return np.concatenate([table, np.zeros((LANES - len(table), *table.shape[1:]), table.dtype)])


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
    return class_of_bins(np.bincount(bin_of.ravel(), minlength=256))[bin_of]


def class_of_bins(count):
    """Classes of equal steps of log distance that hold so many pixels."""
    density = np.cumsum(np.cbrt(count))
    return np.minimum(((density - 1e-9) / density[-1] * CLASSES).astype(int), CLASSES - 1)
