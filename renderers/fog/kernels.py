"""Kernels of an asset's narrow beams as a picture's filter takes them: shares of what is scattered, as shapes of one table.

Behind an optical depth tau at distance z the scattered light that arrives at r from the axis is P(tau) s(tau, x)/(r z), x = r/z
(`lever` stands for z where the density varies).  The integral of 2 pi s over x is 1, so s is a share; P is the power
(`Fog.powers`).  Shapes are on equal steps of log tau and log x and looked up linearly in both.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from bakery.errors import AssetError, UsageError
from renderers.fog import _columns

PER_DECADE = 24  # steps of the optical depth and of the ratio
SHALLOWEST, DEEPEST = 1e-3, 1e3  # optical depths; below and above the shape is that of the last one
_INSIDE, _OUTSIDE = 1e-4, 1e-5  # shares of the light that may lie below the smallest and above the largest ratio
_WIDEST = 1e4
_TRANSPORT = ("flux", "fluence", "forward")  # kernels that count light each time it passes; the others have a power of their own
_SHALLOW = 5.0  # optical depth to which the cut goes by what a slab lets pass; see `_arriving`
_NOTHING = 1e-35  # power that the tables' single precision cannot hold
_LARGEST = 3000.0  # mean free paths from the axis; the tables say nothing of use farther out
_SEARCH = np.geomspace(1e-9, _WIDEST, 13 * 12 + 1)
STEP = math.log(10) / PER_DECADE


@dataclass(frozen=True, eq=False)
class Fog:
    """A medium and its kernels.

    sigma_t, sigma_s : (C,) 1/m, at relative density 1
    g, peak : (C,) 1, of the phase function (`_columns.moments`)
    depth : (T,) 1, optical depths, 24 a decade from 1e-3 to 1e3
    ratio : (X,) 1, distance from the axis over the lever, 24 a decade; narrower than any kernel to wider than all
    shape : (C, T, X) 1, r z Psi/P; 0 where a channel does not scatter
    model_power : (C, T) 1, power of a model for comparison over M0 = e^-tau_a (1 - e^-tau_s), 1 at most; None for transport
    width : (C, T) 1, ratio that is called one length by a cut-off: sqrt(3/2 M2/M0)/z of the small-angle beam
    """

    sigma_t: np.ndarray
    sigma_s: np.ndarray
    g: np.ndarray
    peak: np.ndarray
    depth: np.ndarray
    ratio: np.ndarray
    shape: np.ndarray
    model_power: np.ndarray | None
    width: np.ndarray

    @cached_property
    def within(self):
        """(C, T, X) 1, share of the light inside of a ratio."""
        return _within(self.ratio, self.shape)

    def powers(self, column, energy):
        """What becomes of a viewing beam that is scattered behind columns (...) m: shares of it that arrive at its surface, and
        that come out behind the camera (0 with kept), (..., C) each.

        energy : lost, the power T that a slab lets pass (`_columns.slab`; of a model for comparison, its own); kept, (1 - e^-tau)
            T(albedo)/T(1): what goes back past the camera is added, so that only absorption takes anything
        """
        tau = np.asarray(column, float)[..., None] * self.sigma_t
        albedo = np.divide(self.sigma_s, self.sigma_t, out=np.zeros(len(self.sigma_t)), where=self.sigma_t > 0)
        passed, back, _ = _columns.slab(albedo, self.g, self.peak, tau)
        if energy == "kept":
            most = _columns.slab(1.0, self.g, self.peak, tau)[0]
            return -np.expm1(-tau) * np.divide(passed, most, out=np.zeros_like(most), where=most > 0), np.zeros_like(back)
        if self.model_power is None:
            return passed, back
        position = self.place(tau, self.depth)
        power = np.stack([np.interp(position[..., c], np.arange(len(row)), row) for c, row in enumerate(self.model_power)],
                         axis=-1)
        return power * np.exp(-(1 - albedo) * tau) * -np.expm1(-albedo * tau), back

    def arriving(self, column, scattered, energy):
        """The first of `powers` for many columns (...), of which so much is `scattered` (..., C): their ratio from a spline.

        Within 1e-8 of it.  A pixel takes 0.1 us so, 1.8 us by `powers`.
        """
        with np.errstate(divide="ignore"):
            at = np.log(np.asarray(column, float)[..., None] * self.sigma_t)
        ratio = [spline(np.clip(at[..., c], spline.x[0], spline.x[-1])) for c, spline in enumerate(self._ratios(energy))]
        return scattered * np.maximum(np.stack(ratio, axis=-1), 0)

    def ratios(self, energy, finer):
        """That ratio on equal steps of log tau, so many to each of the spline: nodes (N,), values (C, N)."""
        splines = self._ratios(energy)
        nodes = np.linspace(splines[0].x[0], splines[0].x[-1], finer * (len(splines[0].x) - 1) + 1)
        return nodes, np.maximum([spline(nodes) for spline in splines], 0)

    @lru_cache(maxsize=4)  # noqa: B019  # as below
    def _ratios(self, energy):
        """Splines of power over the share that is scattered, over log tau."""
        from scipy.interpolate import CubicSpline

        tau = np.geomspace(_columns.THIN, _columns.DEEPEST, 14 * 96 + 1)
        splines = []
        for c, (sigma_t, sigma_s) in enumerate(zip(self.sigma_t, self.sigma_s)):
            scattered = -np.expm1(-tau / max(sigma_t, 1e-300) * sigma_s)
            power = self.powers(tau / max(sigma_t, 1e-300), energy)[0][:, c]
            ratio = np.divide(power, scattered, out=np.zeros_like(power), where=scattered > 0)
            splines.append(CubicSpline(np.log(tau), ratio))
        return splines

    def place(self, value, nodes):
        """Where values lie on the `nodes` (depth or ratio), as a fractional index inside of the table."""
        with np.errstate(divide="ignore"):
            return np.clip((np.log(value) - math.log(nodes[0])) / STEP, 0, len(nodes) - 1.001)

    @lru_cache(maxsize=16)  # noqa: B019  # a few media, of a picture's whole life
    def cut(self, lengths):
        """The same with nothing beyond so many lengths (`width`), renormalised; the edge is one step of the table wide."""
        if lengths is None:
            return self
        if not (np.isfinite(lengths) and lengths > 0):
            raise UsageError(f"filter.cut_off: {lengths!r}; a number of lengths above 0 would do, or none")
        beyond = (np.log(np.maximum(lengths * self.width, 1e-300))[..., None] - np.log(self.ratio)) / STEP
        return replace(self, shape=_normalised(self.ratio, self.shape * np.clip(beyond + 0.5, 0, 1))[0])


def fog_of(asset, channels=3, kernel="flux"):
    """The filter's medium from an asset.

    Parameters
    ----------
    asset : as `bakery.open` gives it, with the stages medium and beam
    channels : of the picture
    kernel : any name that `asset.beam.kernel` takes: flux, which a surface across the beam receives; fluence, forward; others for
        comparison

    Returns
    -------
    Fog; one wavelength serves all channels (C = 1), otherwise there are as many of them and the first channel has the longest

    Raises
    ------
    AssetError : a stage is missing, or kernels are not finite
    UsageError : numbers of wavelengths and channels do not go together, no such kernel

    Notes
    -----
    The plane integral of transport's flux counts light each time it passes, 1.3 times that of the beam deep in a medium that
    absorbs nothing, and at shallow depths it holds a wide glow that is the model's error.  A surface stops light when it first
    arrives, so a kernel by transport is cut at the radius that holds that much (`_arriving`); errors:
    docs/measurements/screen.md.

    Optical depths below 1e-3 have the shape of 1e-3 (their power stays right).  Depths tau beyond the asset's deepest D have the
    shape at D with another width: x goes with sqrt(q), q = b/(1 + b), b the mean square of x in the small-angle model with
    absorption on longer paths (Gaussian closure of Fokker-Planck with loss), which grows with tau and falls as 1/tau where
    absorption rules; where the beam is as wide as deep it stops, as diffusion without absorption has one shape in r/z.
    """
    sigma_t, albedo = (np.atleast_1d(np.asarray(asset.medium[name], float)) for name in ("sigma_t", "albedo"))
    if len(sigma_t) not in (1, channels):
        raise UsageError(f"{getattr(asset, 'path', 'the asset')}: {len(sigma_t)} wavelengths for a picture of {channels} "
                         f"channels; an asset of 1 wavelength would do, or one of {channels}")
    order = np.argsort(-np.asarray(asset.wavelength))
    planes = _Planes(asset, albedo, kernel)
    g, peak = _columns.moments(asset.medium.phase)
    within = _within(_SEARCH, planes.light(_SEARCH))
    once = planes.arriving(within[..., -1], g, peak)
    ratio = _ratios(np.minimum(within, once[..., None]).reshape(-1, len(_SEARCH)))
    shape, total = _normalised(ratio, _once(ratio, planes.light(ratio), once))
    model_power = None if kernel in _TRANSPORT else planes.power(total)[order]
    return Fog(sigma_t[order], (sigma_t * albedo)[order], g[order], peak[order], planes.depth, ratio, shape[order], model_power,
               planes.width[order])


class _Planes:
    """Light in planes across an asset's narrow beams.

    depth : (T,) 1, optical depths
    inside : (T,) 1, the same, but for those beyond the asset's tables, which are their deepest
    stretch : (L, T) 1, how much wider the light is than at `inside`
    """

    def __init__(self, asset, albedo, kernel):
        """albedo : (L,) 1;  kernel : see `fog_of`"""
        self._beam, self._path, self._albedo, self._kernel = asset.beam, getattr(asset, "path", "the asset"), albedo, kernel
        last = min(float(asset.beam["depth"][-1]), DEEPEST)
        self.depth = SHALLOWEST * np.exp(STEP * np.arange(1 + round(math.log(DEEPEST / SHALLOWEST) / STEP)))
        q = _spread(np.atleast_1d(asset.beam["gaussian_b"])[:, None], albedo[:, None], np.append(self.depth, last))
        self.inside = np.minimum(self.depth, last)
        with np.errstate(divide="ignore", invalid="ignore"):
            self.stretch = np.where((self.depth > last) & (albedo[:, None] > 0), np.sqrt(q[:, :-1] / q[:, -1:]), 1.0)

    def light(self, ratio):
        """r z Psi (L, T, X) at ratios r/z (X,)."""
        inside = self.inside[:, None]
        values = np.empty((*self.stretch.shape, len(ratio)))
        for k, stretch in enumerate(self.stretch[:, :, None]):
            x = ratio / stretch
            r = np.minimum(x * inside, _LARGEST)
            value = inside ** 2 * x * _kernel(self._beam, inside, r, self._kernel)[k] / stretch
            values[k] = np.where(r < _LARGEST, value, 0.0)
        values[self._albedo == 0] = 0
        if not (np.isfinite(values) & (values >= 0)).all():
            raise AssetError(f"{self._path}: kernel {self._kernel!r} is not finite; bake the asset again")
        return values

    def arriving(self, total, g, peak):
        """What of the planes' light `total` (L, T) arrives there for the first time; g, peak (L,) of the phase functions."""
        if self._kernel not in _TRANSPORT:
            return total
        first = _arriving(lambda tau: _columns.slab(self._albedo[:, None], g[:, None], peak[:, None], tau), total, self.inside,
                          self.depth)
        # 0 is transport; where the small-angle model stands in for it light passes once already
        return np.where(np.asarray(self._beam["model"])[:, None] == 0, first, total)

    def power(self, total):
        """Power (L, T) of a model for comparison, see `Fog.model_power`."""
        albedo = self._albedo[:, None]
        M0 = np.exp(-(1 - albedo) * self.inside) * -np.expm1(-albedo * self.inside)
        return np.minimum(np.divide(total, M0, out=np.zeros_like(M0), where=M0 > 0), 1)

    @property
    def width(self):
        """(L, T) 1, see `Fog.width`."""
        nodes = np.asarray(self._beam["depth"], float)
        return np.stack([np.interp(np.log(self.inside), np.log(nodes), row / nodes)
                         for row in np.asarray(self._beam["beta"], float)]) * self.stretch


def _ratios(inner):
    """Nodes of the ratio between which all but a little of the light lies; inner (N, X) is what lies within `_SEARCH`."""
    inner = inner[inner[..., -1] > 0]
    first, final = 0, len(_SEARCH) - 1
    if len(inner):
        share = inner / inner[..., -1:]
        first = max(int((share > _INSIDE).any(0).argmax()) - 1, 0)
        final = int((share > 1 - _OUTSIDE).all(0).argmax())
    lowest = _SEARCH[first]
    return lowest * np.exp(STEP * np.arange(2 + math.ceil(math.log(_SEARCH[final] / lowest) / STEP)))


def _spread(B, albedo, tau):
    """How the mean square of r/z goes with the optical depth; 0 without scattering."""
    y = np.sqrt(2 * B * albedo * (1 - albedo)) * tau
    with np.errstate(divide="ignore", invalid="ignore"):
        b = 4 / 3 * B * albedo * tau * np.where(y < 0.03, 1 - 0.4 * y * y, 3 * (y - np.tanh(y)) / y**3)
    return b / (1 + b)


def _kernel(beam, depth, r, name):
    try:
        return beam.kernel(depth, r, name)
    except ValueError as fault:
        raise UsageError(f"filter.kernel: {fault}") from None


def _within(ratio, shape):
    """Integral of 2 pi s from 0, (..., X): constant below the first ratio, trapezoids in the logarithm between the others."""
    g = 2 * math.pi * shape * ratio
    step = math.log(ratio[1] / ratio[0])
    return np.cumsum(np.concatenate([g[..., :1], (g[..., 1:] + g[..., :-1]) / 2 * step], axis=-1), axis=-1)


def _arriving(slab, total, inside, depth):
    """What of a plane integral (..., T) at depths `inside` is the light that arrives for the first time, at `depth`.

    Shallow, what a slab lets pass, as the integral holds a glow that is not there; deep, that share of the integral which P1
    gives, as P1's decay with depth is not exact but cancels in the ratio.
    """

    def first(tau):
        passed, _, crossing = slab(tau)
        return passed, np.divide(passed, crossing, out=np.ones_like(passed), where=crossing > 0)

    passed, share = first(inside)
    shallow = np.exp(-inside / _SHALLOW)
    arriving = np.maximum(passed, 1e-300) ** shallow * (share * total) ** (1 - shallow)
    return arriving * np.divide(first(depth)[1], share, out=np.ones_like(share), where=share > 0)


def _once(ratio, shape, power):
    """Shapes cut where so much power (..., T) lies within: the rest crosses the plane for a second time, and is the widest."""
    within = _within(ratio, shape)
    inside = np.concatenate([np.zeros_like(within[..., :1]), within[..., :-1]], axis=-1)
    cell = within - inside
    return shape * np.clip(np.divide(power[..., None] - inside, cell, out=np.ones_like(cell), where=cell > 0), 0, 1)


def _normalised(ratio, shape):
    """Shapes with integral 1, and what it was; a depth behind which nothing is left has the nearest shape that is known."""
    total = _within(ratio, shape)[..., -1]
    nonzero = total > _NOTHING
    normalised = np.divide(shape, total[..., None], out=np.zeros_like(shape), where=nonzero[..., None])
    for k in range(len(shape)):
        rows = np.flatnonzero(nonzero[k])
        if len(rows):
            normalised[k] = normalised[k, rows[np.abs(rows - np.arange(len(nonzero[k]))[:, None]).argmin(1)]]
    return normalised, total


@lru_cache(maxsize=16)
def over_pixels(fog, offsets):
    """Means over square pixels, divided by u (pixel over lever): (C, T, X, O) float32; times u it is the share of the light that
    falls into the pixel, X stands for u on the nodes of `ratio`.

    offsets : ((dx, dy), ...) of a pixel's centre from the axis; the first one is 0, 0
    """
    log_u, first = np.arange(len(fog.ratio), dtype=float), fog.shape[..., :1]

    def at(table, r, low, high):
        """table (C, T, X) at ratios u r for u on all nodes; low (..., X) and high (..., 1) beyond its ends."""
        j = log_u + math.log(r) / STEP
        n = np.clip(j, 0, len(j) - 1.001).astype(int)
        f = j - n
        return np.where(j < 0, low, np.where(j > len(j) - 1, high, table[..., n] * (1 - f) + table[..., n + 1] * f))

    def rule(points):
        node, weight = np.polynomial.legendre.leggauss(points)
        return list(zip(node / 2, weight / 2))

    out = np.zeros((*fog.shape.shape, len(offsets)), np.float32)
    for o, (dx, dy) in enumerate(offsets):
        total = np.zeros(fog.shape.shape)
        if o == 0:
            # what lies within the square's edge, averaged over directions: finite where the kernel is not
            for x, w in rule(6):
                edge = 0.5 / math.cos((x + 0.5) * math.pi / 4)
                total += w * at(fog.within, edge, 2 * math.pi * first * fog.ratio * edge, fog.within[..., -1:])
            total /= fog.ratio
        else:
            points = rule(6 if max(dx, dy) < 2 else 2)
            for x, wx in points:
                for y, wy in points:
                    r = math.hypot(dx + x, dy + y)
                    total += wx * wy / r * at(fog.shape, r, first, 0.0)
        out[..., o] = total
    return out
