"""The kernels of one medium by name: what `asset.beam.kernel` and `asset.beam.layered` return."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bakery.physics.beam import kernels, layers, moments, planar, single, small_angle
from bakery.physics.beam.table import Table

TABLES = ("fluence", "forward", "flux", "small_angle")
KERNELS: Mapping[str, str] = {
    "fluence": "all scattered light, by transport",
    "forward": "what goes on forward, by transport",
    "flux": "power forward through a surface across the beam, by transport",
    "single": "light scattered once, exact",
    "small_angle": "small-angle model, exact",
    "small_angle_absorbing": "small-angle model, longer paths absorbed",
    "erf": "error function, Shinya et al. 2016 with corrected constants",
    "path_integral": "path integral, Premoze et al. 2003, width derived by us",
    "elek": "approximates Elek et al. 2013, whose constants are unknown to us"}
LAYERED = ("forward", "flux", "single", "small_angle", "erf")


@dataclass(frozen=True)
class Kernels:
    """Kernels of one wavelength."""

    albedo: float  # 1
    # theta, phase: (A,) rad, 1/sr
    theta: np.ndarray
    phase: np.ndarray
    B: float  # rad^2, of the Gaussian lobe that the closed forms are given
    transport: bool  # whether the tables are by transport; otherwise all are by the small-angle model
    table: Callable[[str], Table]  # name in `TABLES` -> Table

    def kernel(self, depth, r, name):
        """Psi, mfp^-2, at depths up to the tables' last and distances r from the axis, mfp; broadcast.

        At depth 0 it is 0.  On the axis it is infinite, but for `path_integral` and `elek`.
        """
        _refuse_unknown(name, KERNELS)
        depth, r = np.asarray(depth, float), np.asarray(r, float)
        self._reachable(depth)
        if not (r >= 0).all():
            raise ValueError(f"a distance from the axis of {r[~(r >= 0)].flat[0]:g} mean free paths; 0 or more would do")
        if self.albedo == 0:
            return np.zeros(np.broadcast(depth, r).shape)
        if name in TABLES:
            return self.table(name).kernel(depth, r)
        with np.errstate(all="ignore"):
            value = getattr(self, "_" + name)(depth, r)
        # nothing is scattered at once; a Gaussian narrower than a double holds has nothing beside its axis
        return np.where((depth == 0) | np.isnan(value), 0.0, value)

    def layered(self, thickness, density, r, name):
        """Psi behind layers, per square of the unit of length, which is the mean free path at density 1.

        thickness, density : (N,) of the layers from where the beam enters to the plane
        r : any shape, > 0
        name : of `LAYERED`
        """
        _refuse_unknown(name, LAYERED)
        edges, density = layers.checked(thickness, density)
        shape, r = np.shape(r), np.asarray(r, float).ravel()
        outside = r[~(np.isfinite(r) & (r > 0))]
        if outside.size:
            raise ValueError(f"a distance from the axis of {outside[0]:g} behind layers; a finite one above 0 would do")
        tau = layers.equivalent(edges, density)[0]
        self._reachable(tau)
        if tau == 0 or self.albedo == 0:
            return np.zeros(shape)
        if name == "erf":
            S = [lever[-1] for lever in moments.layered_levers(edges, self.albedo * density)]
            M0 = moments.moments(*S, (1 - self.albedo) * tau, self.B)[0]
            kernel = kernels.erf_kernel(*kernels.erf_parameters(M0, moments.mean_square(S[0], S[1], self.B)), r)
        elif name == "single":
            kernel = layers.single(self.albedo, self.theta, self.phase, edges, density, r)[0]
        elif name == "small_angle" or not self.transport:
            kernel = small_angle.layered(self._planar, self.albedo, edges, density, r)
        else:
            names = ("forward", "flux")
            kernel = layers.forward(self.albedo, self.theta, self.phase, self.line, self._planar,
                                    lambda *at: np.array([self.table(name).stretched(*at) for name in names]), edges, density,
                                    r)[names.index(name)]
        return kernel.reshape(shape)

    def rings(self, depth, edges, name):
        """Psi averaged over rings, (D, R) mfp^-2, at depths (D,) between edges (R + 1,) mfp; 1/r at the axis is integrated."""
        if name in TABLES:
            return self.table(name).rings(depth, edges)
        return ring_averages(lambda z, r: self.kernel(z, r, name), depth, edges)

    @cached_property
    def line(self):
        """The phase function as light scattered once needs it."""
        return single.line(self.theta, self.phase)

    @cached_property
    def _planar(self):
        return planar.table(self.theta, self.phase)

    def _reachable(self, depth):
        last = self.table("small_angle").depth[-1]
        if not ((depth >= 0) & (depth <= last * (1 + 1e-12))).all():
            raise ValueError(f"depths lie between 0 and {last:g} mean free paths; for deeper ones set beam.depth in the recipe, "
                             "which goes to 1000")

    def _M0(self, depth):
        return moments.moments(*moments.levers(depth, self.albedo), (1 - self.albedo) * depth, self.B)[0]

    def _single(self, depth, r):
        ahead, back = single.single(self.albedo, self.line, depth, r)
        return ahead[0] + back[0]

    def _small_angle_absorbing(self, depth, r):
        weight, shrink = moments.absorbed(depth, self.albedo, 1 - self.albedo, self.B)
        return self.table("small_angle").kernel(depth, r / np.sqrt(shrink)) * weight / shrink

    def _erf(self, depth, r):
        S = moments.levers(depth, self.albedo)
        return kernels.erf_kernel(*kernels.erf_parameters(self._M0(depth), moments.mean_square(S[0], S[1], self.B)), r)

    def _path_integral(self, depth, r):
        return kernels.path_integral(depth, self.albedo, 1 - self.albedo, self.B, self._M0(depth), r)

    def _elek(self, depth, r):
        return kernels.elek(depth, self.albedo, self.B, self._M0(depth), r)


def ring_averages(kernel, depth, edges, points=8):
    """Averages of kernel(depth, r) over rings, (D, R), by Gauss's rule in the square root of r: it may rise as 1/r."""
    x, w = np.polynomial.legendre.leggauss(points)
    root = np.sqrt(edges)
    half = np.diff(root)[:, None] / 2
    at = (root[:-1, None] + root[1:, None]) / 2 + half * x
    weight = 4 * half * w * at**3 / np.diff(np.square(edges))[:, None]  # 2 r dr, r = at^2
    weight = np.broadcast_to(weight, (len(depth), *weight.shape))
    return np.sum(kernel(np.asarray(depth, float)[:, None, None], at**2) * weight, axis=-1)


def _refuse_unknown(name, names):
    if name not in names:
        raise ValueError(f"measure {name!r}: {', '.join(list(names)[:-1])} and {list(names)[-1]} are there")
