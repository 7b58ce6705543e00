"""Tables on a uniform grid, made of lobes that noise has made uncertain.

Two independent estimates of each lobe come in, those of two halves of the photons.  The basis is fitted to their mean with
weights of the noise, and has as many functions as are needed where the noise does not count: in the product of what both halves
leave over, noise has the mean 0.
"""

import numpy as np

from bakery.physics.multiple import basis as bases
from bakery.physics.multiple import budget, build, frame, legendre, lookup
from bakery.physics.multiple.table import STEPS, Table, margins, quantised, scales, shape
from bakery.physics.multiple.tree import ASPECT

DEPTH = 5  # of the tree everywhere: every second box of `tally` is a corner
_SAMPLE = 300  # places that the basis is made of
_ORDERS = (2e-3, 64)  # of the directions of a basis: until p_l is small, at most


class Fit:
    """Directions, bounds and weights that the lobes of a medium are fitted with.

    Parameters
    ----------
    medium : `tally.Medium`
    tolerance : relative error of a lobe that the basis may have
    random : Generator that draws places

    Attributes
    ----------
    shape, solid_angle, polar, azimuth : of the directions of the basis, D = A B in all
    test_polar, test_azimuth, test_weight : other directions, (A',), (B',), (A', B'), for errors
    """

    def __init__(self, medium, tolerance, random):
        p = legendre.moments(medium.theta, medium.phase, _ORDERS[1])
        order = int(np.flatnonzero(np.abs(p) > _ORDERS[0])[-1])
        self.tolerance, self.random = min(tolerance, budget.COARSEST), random
        self.shape = shape(order)
        self.solid_angle = frame.solid_angles(self.shape).ravel()
        self.polar, self.azimuth = frame.polar(np.linspace(0, 1, self.shape[0])), np.linspace(0, np.pi, self.shape[1])
        # a lobe is at least the least value of the phase function times its integral
        smooth = medium.outer[1]
        self.least, self.greatest = max(smooth.min(), 1e-6), smooth.max()
        x, gauss = np.polynomial.legendre.leggauss(max(20, order))
        self.test_polar, across = np.arccos(x), max(10, order // 2)
        self.test_azimuth = (np.arange(across) + 0.37) * np.pi / across
        self.test_weight = gauss[:, None] * np.ones(across)

    def share(self, product, lobe):
        """Of products (..., A', B') of deviations of lobes, relative to the squares of lobes."""
        return (self.test_weight * product).sum(axis=(-2, -1)) / (self.test_weight * lobe**2).sum(axis=(-2, -1))

    def represent(self, halves, integral, usable, margin=budget.BASIS):
        """Basis and coefficients of lobes.

        Parameters
        ----------
        halves : (2, N, D) estimates of lobes
        integral : (N,) of the lobes over directions
        usable : (N,) whether a place may be among those that the basis is made of
        margin : share of the tolerance that the basis may miss

        Returns
        -------
        a : (3, N, K + 1) a_0 = 0, a_1 .. a_K of the mean; the same with what either half says instead, to first order
        basis : (K + 1, D) the basis, rounded as a file holds it
        """
        mean = halves.mean(axis=0) / integral[:, None]
        lobe = np.clip(mean, self.least, self.greatest)
        lobe /= (lobe * self.solid_angle).sum(axis=1, keepdims=True)
        logs, weight = np.log(lobe), bases.weights(lobe, self.solid_angle)
        # what each half says of the logarithm, to first order; where it is dark noise may exceed the lobe many times
        apart = np.clip((halves[0] - halves[1]) / (2 * integral[:, None] * lobe), -1.0, 1.0)
        basis = self.basis(logs, apart, weight, np.flatnonzero(usable), margin)
        a, apart_weights = _in_basis(logs, apart, weight, basis)
        a[:, 0] = 0.0
        return np.stack([a, a + apart_weights, a - apart_weights]), basis

    def basis(self, logs, apart, weight, usable, margin):
        """Functions (K + 1, D): as few as miss `margin` of the tolerance, or else those that miss least with their noise."""
        noise = (weight * apart**2).sum(axis=1)
        sample = np.sort(self.random.choice(usable, min(_SAMPLE, len(usable)), replace=False))
        quiet = sample[noise[sample] <= np.quantile(noise[sample], 0.6)]
        of_row = 1 / (1 + noise[sample] / max(np.median(noise[sample]), 1e-12))
        first = bases.start(logs[quiet], weight[quiet], build.COUNTS[-1])
        logs, apart, weight = logs[sample], apart[sample], weight[sample]
        best = np.inf, first[:1]
        for count in build.COUNTS:
            basis = quantised(bases.improved(first[:count + 1], logs, weight * of_row[:, None]))
            a, apart_weights = _in_basis(logs, apart, weight, basis)
            residual = logs - basis[0] - bases.combine(a, bases.with_one(basis))
            apart_residual = apart - bases.combine(apart_weights, bases.with_one(basis))
            # of the product of both halves' residuals the noise has mean 0
            missed = max(float(((residual + apart_residual) * (residual - apart_residual) * weight).sum(axis=1).mean()), 0.0)
            if missed < (self.tolerance * margin) ** 2:
                return basis
            noisy = float((bases.combine(apart_weights, bases.with_one(basis)) ** 2 * weight).sum(axis=1).mean())
            best = min(best, (missed + noisy, basis), key=lambda candidate: candidate[0])
        return best[1]

    def pack(self, kind, length, medium, a, basis) -> Table:
        """A table of coefficients (N, K + 1), rounded as a file holds it; a_0: logarithm of the integral over directions."""
        corner = np.argwhere(np.ones((2**DEPTH + 1, ASPECT * 2**DEPTH + 1)))
        scale = (np.maximum(np.abs(a[:, 1:]).max(axis=0), 1e-30) / STEPS).astype(np.float32)
        whole = np.rint(a[:, 1:] / scale).astype(np.int16)
        basis_scale = scales(basis)
        rounded = np.rint(basis / basis_scale[:, None].astype(float)).astype(np.int16)
        functions = rounded * basis_scale[:, None].astype(float)
        stored = np.exp(functions[0] + bases.combine(whole * scale.astype(float), functions[1:]))
        offset = a[:, 0] - np.log((stored * self.solid_angle).sum(axis=1))
        return Table(kind, length, medium.extent, medium.k0, *_tree(), corner.astype(np.int16), offset.astype(np.float32), whole,
                     scale, rounded.reshape(-1, *self.shape), basis_scale)


def places(kind, length, extent):
    """rho, z (N,) of the corners, those of one u after each other."""
    u, v = np.meshgrid(np.linspace(0, 1, 2**DEPTH + 1), np.linspace(0, 1, ASPECT * 2**DEPTH + 1), indexing="ij")
    return frame.position(kind, length, extent, u.ravel(), v.ravel())


def changed(ready: lookup.Ready, table: Table, change) -> lookup.Ready:
    """A table ready for look-ups with other coefficients: change (N, K + 1)."""
    a = np.column_stack([table.offset, table.coefficient * table.coefficient_scale.astype(float)]) + change
    grid = margins(a.reshape(2**DEPTH + 1, ASPECT * 2**DEPTH + 1, -1))
    return ready._replace(grid=lookup.padded(grid))


def _tree():
    """Bounds and children of the tree of that depth everywhere."""
    bounds, child = [(0.0, 1.0, i / ASPECT, (i + 1) / ASPECT) for i in range(ASPECT)], [-1] * ASPECT
    leaves = range(ASPECT)
    for _ in range(DEPTH):
        first = len(bounds)
        for leaf in leaves:
            lower, right, low, high = bounds[leaf]
            child[leaf] = len(bounds)
            middle, centre = (lower + right) / 2, (low + high) / 2
            bounds += [(x, x + middle - lower, y, y + centre - low) for x in (lower, middle) for y in (low, centre)]
            child += [-1] * 4
        leaves = range(first, len(bounds))
    return np.array(bounds, np.float32), np.array(child, np.int32)


def _in_basis(logs, apart, weight, basis):
    return bases.coefficients(logs, weight, basis), bases.solve(apart, weight, bases.with_one(basis))
