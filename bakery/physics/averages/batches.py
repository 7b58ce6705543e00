"""Angular sums over the nodes, refined angle by angle until the quadrature has converged.

Angles stop being computed when they have converged, and only the slowly converging ones (the glory, where spheres without
absorption converge like 1/nodes) go on.  Sums of blocks are formed in their order, so values do not depend on where the
blocks were run.
"""

from __future__ import annotations

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
from bakery.physics.averages.spheres import Layers, features_of
from bakery.physics.averages.work import BLOCK, cut
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
    batches = [_Batch(c, switches[i], theta, None if floor is None else floor[i], target, elements, areas)
               for i, c in enumerate(channels)]
    while True:
        jobs = [(batch, index, level) for batch in batches for index, level in batch.wanted()]
        if not jobs:
            break
        _run(jobs, polarized, rays, work)
    work.unfinished |= any(batch.left.any() for batch in batches)
    values = np.stack([batch.values() for batch in batches])
    return values, np.stack([batch.error() for batch in batches]), np.stack([batch.level for batch in batches])


class _Batch:
    """Angles of one channel on their way to convergence."""

    def __init__(self, channel, switch, theta, floor, target, elements, areas=None):
        count = len(theta)
        self.channel, self.switch, self.theta, self.target, self.elements = channel, switch, theta, target, elements
        self.last = channel.nodes.levels - 1
        self.floor = np.minimum(np.full(count, FIRST_LEVEL) if floor is None else np.maximum(floor, FIRST_LEVEL), self.last)
        self.level = np.full(count, -1)
        self.fixed = np.zeros((elements, count))
        self.sums = np.zeros((elements, count))
        unknown = math.inf if channel.nodes.refinable else 0.0
        self.change, self.earlier = np.full(count, unknown), np.full(count, unknown)
        self.weights = [0.0]  # of the refinable nodes, by level, shifted by one
        self.begun, self.areas = False, areas
        self.left = np.zeros(count, bool)  # angles that nodes do not bring to the target
        ripple = math.pi / max(x for x, _ in features_of(channel))
        index = np.arange(count)
        low = np.minimum(np.searchsorted(theta, theta - ripple, side="left"), index - _WINDOW)
        high = np.maximum(np.searchsorted(theta, theta + ripple, side="right"), index + _WINDOW + 1)
        self.window = np.maximum(low, 0), np.minimum(high, count)

    def wanted(self):
        """[(indices of angles, level)] still to be summed, level None for the discrete sizes; empty when all is done."""
        if not self.begun:
            self.begun = True
            jobs = [(np.arange(len(self.theta)), None)] if len(self.channel.nodes.fixed()[0]) else []
            if self.channel.nodes.refinable:
                for level in range(int(self.floor.max()) + 1):
                    jobs.append((np.flatnonzero(self.floor >= level), level))
            return jobs
        if not self.channel.nodes.refinable:
            return []
        error = self.error()
        if self.areas is not None:
            light = self.areas * self.values()[0]
            error = np.full(len(error), np.sum(light * error) / np.sum(light) if light.any() else 0.0)
        open_ = (error > self.target) & ~self.left
        # the last level is used up, or cannot be expected to suffice: halving the step at best halves the error
        further = self.last - self.level
        hopeless = open_ & ((further <= 0) | ((self.level >= FIRST_LEVEL + 3) & (error > 4 * self.target * 2.0**further)))
        self.left |= hopeless
        open_ &= ~hopeless
        return [(np.flatnonzero(open_ & (self.level == level)), int(level) + 1) for level in np.unique(self.level[open_])]

    def absorb(self, index, level, sums):
        """Take the sums (E, B) over the nodes that `level` adds, for the angles `index`."""
        if level is None:
            self.fixed[:, index] = sums
            return
        old = self.average(index, level - 1) if level > 0 else None
        while len(self.weights) <= level + 1:
            self.weights.append(self.weights[-1] / 2 + float(np.sum(self.channel.nodes.fresh(len(self.weights) - 1)[1])))
        self.sums[:, index] = self.sums[:, index] / 2 + sums
        self.level[index] = level
        if old is not None:
            new = self.average(index, level)
            step = np.abs(new - old).max(axis=0)
            self.earlier[index] = self.change[index]
            self.change[index] = np.divide(step, new[0], out=np.zeros_like(step), where=new[0] > 0)

    def average(self, index, level):
        total = float(np.sum(self.channel.nodes.fixed()[1])) + self.weights[level + 1]
        return (self.fixed[:, index] + self.sums[:, index]) / total

    def error(self):
        """(A,): change on halving and half the change before, added in squares; the largest among neighbours.

        Where only the mean over all angles counts, each angle has its own.
        """
        estimate = np.hypot(self.change, self.earlier / 2)
        return estimate if self.areas is not None else grid.largest(estimate, *self.window)

    def values(self):
        total = float(np.sum(self.channel.nodes.fixed()[1])) + np.array(self.weights)[self.level + 1]
        return (self.fixed + self.sums) / total


def _run(jobs, polarized, rays, work):
    """Sum the jobs block by block, holding a bounded number of results at a time, and hand each to its batch."""
    sums = [np.zeros((batch.elements, len(index))) for batch, index, _ in jobs]
    size, tasks, places = 0, [], []

    def flush():
        for (job, part), block in zip(places, work.map(angular_block, tasks)):
            sums[job][:, part] += block
        tasks.clear()
        places.clear()
        worst = max((float(b.error().max()) for b, *_ in jobs), default=0.0)
        work.report(work.seconds, worst if math.isfinite(worst) else None)

    for job, (batch, index, level) in enumerate(jobs):
        channel = batch.channel
        radius, weight = channel.nodes.fixed() if level is None else channel.nodes.fresh(level)
        x = channel.k * radius
        # S is summed, the phase function is S / (k^2 C_sca): k^2 stays out until the end
        for part, spheres, by, seconds in _blocks(channel, x, batch.switch, len(index), polarized, rays):
            work.charge(seconds, f"{channel.component} at {channel.wavelength:g} um")
            tasks.append((channel.sphere, x[spheres], weight[spheres], batch.theta[index[part]], polarized, by))
            places.append((job, part))
            size += 8 * batch.elements * len(part) + 16 * len(spheres)
            if size > HELD:
                flush()
                size = 0
    if tasks:
        flush()
    for (batch, index, level), total in zip(jobs, sums):
        batch.absorb(index, level, total)


def _blocks(channel, x, switch, angles, polarized, rays):
    """(places of angles, places of spheres, method, seconds) of blocks of bounded size; nothing but the inputs decides.

    Series first: they are sharp about where rays begin, and sums keep this order.
    """
    per_angle, coefficient = MUELLER if polarized else INTENSITY, COATED if channel.coated else COEFFICIENT
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
