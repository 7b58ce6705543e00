"""Angular sums over the nodes, refined angle by angle until the quadrature has converged.

Angles stop being computed when they have converged, and only the slowly converging ones (the glory, where spheres without
absorption converge like 1/nodes) go on.  Sums of blocks are formed in their order, so values do not depend on where the
blocks were run.
"""

import math

import numpy as np

from bakery.physics.averages.predicted import (
    COATED,
    COEFFICIENT,
    FIRST_LEVEL,
    HELD,
    INTENSITY,
    MUELLER,
    angular_seconds,
    trace_seconds,
)
from bakery.physics.averages.spheres import Layers, features_of, terms
from bakery.physics.averages.work import BLOCK, cut, in_one
from bakery.physics.medium import grid, phase

_FEWEST_ANGLES, _MOST_ANGLES = 512, 16384  # in a block
_WINDOW = 4  # neighbours on either side whose error an angle shares, and those within one ripple pi/x


def angular_block(sphere, x, weight, theta, polarized, rays=None):
    """(E, A): weighted sums of the intensity, or of S11, S12, S33, S34, over spheres x (R,) at theta (A,) rad.

    By series; with `rays` (orders, options) by `bakery.goa`.  sphere: an index, or `spheres.Layers`.
    """
    if isinstance(sphere, Layers):
        from bakery.physics.mie.coated import coated_angles

        sums = np.zeros((1, len(theta), 4))
        coated_angles(sphere.core, sphere.shell, sphere.inner(x), x, weight, theta, 2 if polarized else 1, sums)
        return np.ascontiguousarray(sums[0].T[:4 if polarized else 1])
    m, out = sphere, np.zeros((4 if polarized else 1, len(theta)))
    if rays is None:
        from bakery.physics.mie.angular import intensity_block, mueller_block

        orders, options = (), {}
    else:
        from bakery.physics.goa import intensity_block, mueller_block

        orders, options = (rays[0],), rays[1]
    if polarized:
        mueller_block(complex(m), x, weight, theta, out, *orders, **options)
    else:
        intensity_block(complex(m), x, weight, theta, out[0], *orders, **options)
    return out


def solve(channels, switches, theta, floor, target, polarized, rays, work, integrated=False):
    """Values (C, E, B) of the averaged elements at new angles, their errors and levels (C, B).

    `integrated`: the errors of all angles of a first grid (no floor) together meet the target, as a share of the integral over
    the sphere, instead of each; angles between them take the level of their neighbours.
    switches (C,): size parameter from which each channel takes `rays`; inf: nowhere.
    """
    elements = 4 if polarized else 1
    # angles between the first ones take the level that these needed
    areas = (phase.areas(theta) if floor is None else np.zeros(len(theta))) if integrated else None
    batches, start = [], 0
    for spectrum in _spectra(channels):
        part = slice(start, start + len(spectrum))
        batches.append(_Batch(spectrum, switches[part], theta, None if floor is None else floor[part], target, elements, areas))
        start = part.stop
    while True:
        jobs = [(batch, places, level) for batch in batches for places, level in batch.wanted()]
        if not jobs:
            break
        _run(jobs, polarized, rays, work)
    work.unfinished |= any(batch.left.any() for batch in batches)
    return tuple(np.concatenate(of_all) for of_all in zip(*((b.values(), b.error(), b.levels()) for b in batches)))


def _spectra(channels):
    """The channels of each component, which share their nodes."""
    spectra = []
    for channel in channels:
        if not spectra or spectra[-1][0].nodes is not channel.nodes:
            spectra.append([])
        spectra[-1].append(channel)
    return spectra


class _Batch:
    """Angles of the channels (L,) of one component on their way to convergence.

    Arrays are over places: all angles of the first channel, then all of the second, L A in all.
    """

    def __init__(self, channels, switches, theta, floor, target, elements, areas=None):
        self.channels, self.switches, self.theta, self.target, self.elements = channels, switches, theta, target, elements
        self.nodes, count = channels[0].nodes, len(channels) * len(theta)
        self.last = self.nodes.levels - 1
        least = np.full(count, FIRST_LEVEL) if floor is None else np.maximum(np.ravel(floor), FIRST_LEVEL)
        self.floor = np.minimum(least, self.last)
        self.level = np.full(count, -1)
        self.fixed = np.zeros((elements, count))
        self.sums = np.zeros((elements, count))
        unknown = math.inf if self.nodes.refinable else 0.0
        self.change, self.earlier = np.full(count, unknown), np.full(count, unknown)
        self.weights = [0.0]  # of the refinable nodes, by level, shifted by one
        self.begun, self.areas = False, areas
        self.left = np.zeros(count, bool)  # angles that nodes do not bring to the target
        self.windows = None if areas is not None else [self._window(channel) for channel in channels]

    def _window(self, channel):
        """First and last of the neighbours whose error each angle shares."""
        theta, index = self.theta, np.arange(len(self.theta))
        ripple = math.pi / max(x for x, _ in features_of(channel))
        low = np.minimum(np.searchsorted(theta, theta - ripple, side="left"), index - _WINDOW)
        high = np.maximum(np.searchsorted(theta, theta + ripple, side="right"), index + _WINDOW + 1)
        return np.maximum(low, 0), np.minimum(high, len(theta))

    def _by_channel(self, values):
        """(..., L, A) of values (..., L A)."""
        return values.reshape(*values.shape[:-1], len(self.channels), len(self.theta))

    def wanted(self):
        """[(places, level)] still to be summed, level None for the discrete sizes; empty when all is done."""
        if not self.begun:
            self.begun = True
            jobs = [(np.arange(len(self.level)), None)] if len(self.nodes.fixed()[0]) else []
            if self.nodes.refinable:
                for level in range(int(self.floor.max()) + 1):
                    jobs.append((np.flatnonzero(self.floor >= level), level))
            return jobs
        if not self.nodes.refinable:
            return []
        error = self.error()
        if self.areas is not None:
            light = self.areas * self._by_channel((self.fixed + self.sums)[0] / self._totals())
            scattered, missed = np.sum(light, axis=1), np.sum(light * error, axis=1)
            share = np.divide(missed, scattered, out=np.zeros_like(scattered), where=scattered > 0)
            error = np.broadcast_to(share[:, None], error.shape)
        error = np.ravel(error)
        open_ = (error > self.target) & ~self.left
        # the last level is used up, or cannot be expected to suffice: halving the step at best halves the error
        further = self.last - self.level
        hopeless = open_ & ((further <= 0) | ((self.level >= FIRST_LEVEL + 3) & (error > 4 * self.target * 2.0**further)))
        self.left |= hopeless
        open_ &= ~hopeless
        return [(np.flatnonzero(open_ & (self.level == level)), int(level) + 1) for level in np.unique(self.level[open_])]

    def absorb(self, places, level, sums):
        """Take the sums (E, B) over the nodes that `level` adds, at the places (B,)."""
        if level is None:
            self.fixed[:, places] = sums
            return
        old = self.average(places, level - 1) if level > 0 else None
        while len(self.weights) <= level + 1:
            self.weights.append(self.weights[-1] / 2 + float(np.sum(self.nodes.fresh(len(self.weights) - 1)[1])))
        self.sums[:, places] = self.sums[:, places] / 2 + sums
        self.level[places] = level
        if old is not None:
            new = self.average(places, level)
            step = np.abs(new - old).max(axis=0)
            self.earlier[places] = self.change[places]
            self.change[places] = np.divide(step, new[0], out=np.zeros_like(step), where=new[0] > 0)

    def average(self, places, level):
        total = float(np.sum(self.nodes.fixed()[1])) + self.weights[level + 1]
        return (self.fixed[:, places] + self.sums[:, places]) / total

    def error(self):
        """(L, A): change on halving and half the change before, added in squares; the largest among neighbours.

        Where only the mean over all angles counts, each angle has its own.
        """
        estimate = self._by_channel(np.hypot(self.change, self.earlier / 2))
        if self.windows is None:
            return estimate
        return np.stack([grid.largest(of_one, *window) for of_one, window in zip(estimate, self.windows)])

    def _totals(self):
        return float(np.sum(self.nodes.fixed()[1])) + np.array(self.weights)[self.level + 1]

    def values(self):
        """(L, E, A)."""
        return np.ascontiguousarray(np.moveaxis(self._by_channel((self.fixed + self.sums) / self._totals()), 1, 0))

    def levels(self):
        """(L, A)."""
        return self._by_channel(self.level)


def _run(jobs, polarized, rays, work):
    """Sum the jobs block by block, holding a bounded number of results at a time, and hand each to its batch."""
    sums = [np.zeros((batch.elements, len(places))) for batch, places, _ in jobs]
    size, tasks, seconds, into = 0, [], [], []

    def flush():
        for (job, part), block in zip(into, work.run(angular_block, tasks, seconds)):
            sums[job][:, part] += block
        for filled in (tasks, seconds, into):
            filled.clear()
        worst = max((float(b.error().max()) for b, *_ in jobs), default=0.0)
        work.report(work.seconds, worst if math.isfinite(worst) else None)

    for job, (batch, places, level) in enumerate(jobs):
        for first, block in _blocks(batch, places, level, polarized, rays):
            channel, x, weight, index, by, cost = block
            work.charge(cost, f"{channel.component} at {channel.wavelength:g} um")
            tasks.append((channel.sphere, x, weight, batch.theta[index], polarized, by))
            seconds.append(cost)
            into.append((job, slice(first, first + len(index))))
            size += 8 * batch.elements * len(index) + 16 * len(x)
            if size > HELD:
                flush()
                size = 0
    if tasks:
        flush()
    for (batch, places, level), total in zip(jobs, sums):
        batch.absorb(places, level, total)


def _blocks(batch, places, level, polarized, rays):
    """(where in the places it begins, (channel, x, weight, indices of angles, method, seconds)) of blocks of bounded size."""
    radius, weight = batch.nodes.fixed() if level is None else batch.nodes.fresh(level)
    # S is summed, the phase function is S / (k^2 C_sca): k^2 stays out until the end
    x = np.array([channel.k for channel in batch.channels])[:, None] * radius
    weight = weight.copy()  # numba would compile the kernels anew for a read-only array
    bounds = np.searchsorted(places, np.arange(len(batch.channels) + 1) * len(batch.theta))
    small = _in_one(batch, x, np.diff(bounds), polarized)
    for i, channel in enumerate(batch.channels):
        index = places[bounds[i]:bounds[i + 1]] - i * len(batch.theta)
        if not len(index):
            continue
        if small[i] > 0:
            yield bounds[i], (channel, x[i], weight, index, None, float(small[i]))
            continue
        for part, spheres, by, seconds in _cut(channel, x[i], batch.switches[i], len(index), polarized, rays):
            yield bounds[i] + part[0], (channel, x[i][spheres], weight[spheres], index[part], by, seconds)


def _in_one(batch, x, angles, polarized):
    """(L,): seconds of channels whose spheres x (L, R) are one block of series, as `_cut` would have it; 0 of others."""
    per_angle, coefficient = _rates(batch.channels[0], polarized)
    of_all = terms(x)
    seconds = np.sum(of_all, axis=1) * (coefficient + per_angle * angles)
    chunk = np.clip(BLOCK / (np.max(of_all, axis=1) * (coefficient + per_angle)), _FEWEST_ANGLES, _MOST_ANGLES)
    at_once = in_one(seconds) & (angles <= np.floor(0.99 * chunk)) & (np.max(x, axis=1) < batch.switches)
    return np.where(at_once, seconds, 0.0)


def _rates(channel, polarized):
    """Seconds per term and angle, and per term."""
    return MUELLER if polarized else INTENSITY, COATED if channel.coated else COEFFICIENT


def _cut(channel, x, switch, angles, polarized, rays):
    """(places of angles, places of spheres, method, seconds) of blocks of bounded size; nothing but the inputs decides.

    Series first: they are sharp about where rays begin, and sums keep this order.
    """
    per_angle, coefficient = _rates(channel, polarized)
    large = x >= switch
    for spheres, used in ((np.flatnonzero(~large), None), (np.flatnonzero(large), rays)):
        if not len(spheres):
            continue
        dearest = float(np.max(angular_seconds(channel.m, x[spheres], 1, per_angle, used, coefficient)))
        chunk = int(np.clip(BLOCK / dearest, _FEWEST_ANGLES, _MOST_ANGLES))
        for start in range(0, angles, chunk):
            part = np.arange(start, min(start + chunk, angles))
            cost = angular_seconds(channel.m, x[spheres], len(part), per_angle, used, coefficient)
            tracing = trace_seconds(len(part), used) if used else 0.0
            for a, b in cut(cost):
                yield part, spheres[a:b], used and (used.orders, used.options), float(np.sum(cost[a:b])) + tracing
