"""Cross sections and phase functions averaged over a size distribution, refined until a tolerance is met.

The error that counts is pointwise: at every stored angle, the change of the averaged intensity when the nodes are halved,
relative to the intensity itself (Mueller elements: to S11), and the same for each mean cross section.  Angles stop being computed
when they have converged, and only the stubborn ones (the glory, where spheres without absorption converge like 1/nodes) go on.

One quantity is beyond any grid: the absorption of spheres that hardly absorb.  Per unit of k it grows by some 2 % with every
decade that k falls (fog, 1e-4 .. 1e-8: docs/averages.md), because ever narrower resonances, down to a width of k x, take part.
Its error therefore counts relative to the absorption or to `0.01 tolerance` times the extinction, whichever is larger: an error
of 0.01 tolerance^2 in the albedo changes what a half-space of cloud reflects by less than the tolerance.  The relative change of
the absorption itself is kept beside it.

All work is cut into blocks whose size depends on the inputs alone; sums of blocks are formed in their order, so values do not
depend on where the blocks were run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bakery.errors import StageError
from bakery.medium import grid, phase
from bakery.mie.predicted import (
    COEFFICIENT,
    CROSS,
    FIRST_LEVEL,
    HELD,
    INTENSITY,
    MUELLER,
    Channel,
    Component,
    features_of,
    predict,
    predicted_angles,
    terms,
)
from bakery.sizes.nodes import Nodes

LONGEST = 6 * 3600.0  # seconds of work beyond which a stage is refused
_BLOCK = 0.2  # seconds in a block
_FEWEST_ANGLES, _MOST_ANGLES = 512, 16384  # in a block
_WINDOW = 4  # neighbours on either side whose error an angle shares, and those within one ripple pi/x
_SHARE = 0.45  # of the tolerance, for the quadrature; the rest is the interpolant's
_MARGIN = 0.8  # of the tolerance, for both together; the rest is the normalisation's
_CROSS = 0.1  # of the tolerance, for cross sections: they cost little, and bound what the normalisation may be off


@dataclass(frozen=True)
class Average:
    """Averages of one component.

    Attributes
    ----------
    radius, weight : (R,) um, 1; quadrature nodes of the cross sections, weights add up to 1
    scattering, absorption : (L, R) um^2
    cosine : (L, R) 1, mean cosine of each sphere
    elements : (L, E, A) 1/sr; the phase function, and with polarisation S12, S33, S34 in the same unit (E = 1 or 4)
    phase_error : (L, A) 1/sr, absolute, quadrature and interpolation next to the angle, for all elements
    error : (L,) 1, the largest relative error of phase function and mean cross sections (absorption as said above)
    absorption_error : (L,) 1, relative change of the mean absorption alone
    scale : (L,) 1, integral of the phase function before it was normalised, over the mean scattering cross section
    """

    name: str
    radius: np.ndarray
    weight: np.ndarray
    scattering: np.ndarray
    absorption: np.ndarray
    cosine: np.ndarray
    elements: np.ndarray
    phase_error: np.ndarray
    error: np.ndarray
    absorption_error: np.ndarray
    scale: np.ndarray


def cross_block(m, x):
    """(4, R): Q_sca, Q_abs and g of spheres x (R,), and Q_ext."""
    from bakery.mie._kernels import cross_section_block

    out = np.zeros((4, len(x)))
    cross_section_block(complex(m), x, out[3], out[0], out[1], out[2])
    return out


def angular_block(m, x, weight, theta, polarized):
    """(E, A): weighted sums of the intensity, or of S11, S12, S33, S34, over spheres x (R,) at theta (A,) rad."""
    from bakery.mie._kernels import intensity_block, mueller_block

    out = np.zeros((4 if polarized else 1, len(theta)))
    if polarized:
        mueller_block(complex(m), x, weight, theta, out)
    else:
        intensity_block(complex(m), x, weight, theta, out[0])
    return out


def averages(
    components: Sequence[Component],
    wavelength,
    host,
    tolerance: float,
    polarized: bool = False,
    map: Callable = lambda function, tasks: [function(*task) for task in tasks],
    report: Callable[[float, float | None], None] = lambda seconds, error: None,
) -> tuple[np.ndarray, list[Average]]:
    """Averages of all components at all wavelengths on one grid of angles.

    Parameters
    ----------
    components : with indices m (L,)
    wavelength : (L,) um, in vacuum
    host : (L,) real index of the host
    tolerance : largest relative error of any mean cross section and of the phase function at any angle
    polarized : also S12, S33, S34
    map : `map(function, tasks)` -> list in the order of the tasks
    report : called with the work that is done, in seconds as predicted for one core, and the error reached

    Returns
    -------
    theta : (A,) rad, ascending from 0 to pi
    averages : one for each component

    Raises
    ------
    StageError : the tolerance is out of reach, or would take too many angles or hours

    Notes
    -----
    Spheres of one size have interference minima of any depth, in which a relative error means nothing; for them (one part, x > 5,
    x times relative width < 3) the reference is the largest value within half a ripple, pi/(2x).
    """
    wavelength, host = np.asarray(wavelength, float), np.asarray(host, float)
    k = 2 * math.pi * host / wavelength
    work = _Work(map, report)
    work.expect(predict(components, wavelength, host, tolerance, polarized))
    nodes = [Nodes(component.sizes, k, tolerance) for component in components]
    crosses = [_cross_sections(c, n, wavelength, k, tolerance, work) for c, n in zip(components, nodes)]
    channels = [Channel(c.name, float(w), complex(m), float(q), n)
                for c, n in zip(components, nodes) for w, m, q in zip(wavelength, c.m, k)]
    reach = np.array([math.pi / (2 * features_of(c)[0][0]) if len(features_of(c)) == 1 and _rippled(*features_of(c)[0]) else 0.0
                      for c in channels])
    theta = first_grid(channels, tolerance)
    margin, target, known = _MARGIN * tolerance, _SHARE * tolerance, None

    def evaluate(new, floor):
        return _solve(channels, new, floor, target, polarized, work)

    for _ in range(3):
        try:
            table = grid.refine(theta, evaluate, margin, reach, known)
        except grid.TooManyAngles:
            raise StageError(_too_many(channels, tolerance)) from None
        found = [_finish(table, i, channel, crosses[i // len(k)], i % len(k)) for i, channel in enumerate(channels)]
        if all(error <= tolerance for *_, error in found):
            break
        # the normalisation took more than its share: leave it more room
        theta, margin, known = table.theta, 0.85 * margin, (table.values, table.error, table.tag)
    else:
        worst = max(range(len(channels)), key=lambda i: found[i][3])
        raise StageError(
            f"{channels[worst].component} at {channels[worst].wavelength:g} um: the phase function reaches a relative error of "
            f"{found[worst][3]:.2g}, not the tolerance of {tolerance:g}; a larger tolerance or a wider size range would do")
    out = []
    for i, (component, cross) in enumerate(zip(components, crosses)):
        own = found[i * len(k) : (i + 1) * len(k)]
        out.append(Average(component.name, cross.radius, cross.weight, cross.scattering, cross.absorption, cross.cosine,
                           np.array([f[0] for f in own]), np.array([f[1] for f in own]),
                           np.array([max(f[3], float(e)) for f, e in zip(own, cross.all_error)]), cross.absorption_error,
                           np.array([f[2] for f in own])))
    return table.theta, out


def first_grid(channels, tolerance):
    """First angles for all channels together; StageError where the predicted number of angles is beyond the limit."""
    if predicted_angles([f for c in channels for f in features_of(c)], tolerance) > grid.LIMIT:
        raise StageError(_too_many(channels, tolerance))
    features = sorted({f for c in channels for f in features_of(c)})
    bows = [(angle, x ** (-2 / 3)) for c in channels for x, _ in features_of(c) if x > 20 for angle in grid.bows(c.m.real)]
    try:
        return grid.start(features, bows)
    except grid.TooManyAngles:
        raise StageError(_too_many(channels, tolerance)) from None


def _rippled(x, width):
    return x > 5 and x * width < 3


def _too_many(channels, tolerance):
    worst = max(channels, key=lambda c: predicted_angles(features_of(c), tolerance))
    x, width = max(features_of(worst), key=lambda f: predicted_angles([f], tolerance))
    what = f"spheres of one size, x = {x:.3g}," if width == 0 else f"sizes of a relative width of {width:.2g} at x = {x:.3g}"
    count = predicted_angles([(x, width)], tolerance)
    return (f"{worst.component} at {worst.wavelength:g} um: {what} scatter in ripples of "
            f"{math.degrees(math.pi / x):.2g} degrees, about {count:.2g} angles at a tolerance of {tolerance:g}, "
            f"and at most {grid.LIMIT:g} are stored; give the size a width (distribution: lognormal, sigma: 1.05) "
            "or take a larger tolerance")


class _Work:
    """Runs blocks, keeps account of the work, and refuses when it becomes endless."""

    def __init__(self, map, report):
        self.map, self.report, self.seconds = map, report, 0.0

    def expect(self, made):
        if made.seconds > LONGEST and made.angles <= grid.LIMIT:
            raise StageError(
    f"about {made.seconds / 3600:.3g} hours of one core for {made.angles} angles and {made.spheres} spheres, more than "
    f"the {LONGEST / 3600:g} hours allowed; smaller spheres, a narrower size range or a larger tolerance would do")

    def charge(self, seconds, what):
        self.seconds += seconds
        if self.seconds > LONGEST:
            raise StageError(f"{what}: the work has grown beyond {LONGEST / 3600:g} hours of one core; smaller spheres, "
                             "a narrower size range or a larger tolerance would do")


@dataclass(frozen=True)
class _Cross:
    radius: np.ndarray
    weight: np.ndarray
    scattering: np.ndarray
    absorption: np.ndarray
    cosine: np.ndarray
    error: np.ndarray  # of extinction and scattering
    all_error: np.ndarray  # with absorption
    absorption_error: np.ndarray  # of absorption alone


def _cross_sections(component, nodes, wavelength, k, tolerance, work):
    """The component's cross sections at the first level where all its means have converged at all wavelengths."""
    r = nodes.fixed()[0]
    known = {None: _spheres(component, r, k, work)}
    means = []
    for level in range(nodes.levels):
        if nodes.refinable:
            known[level] = _spheres(component, nodes.fresh(level)[0], k, work)
        radius, weight = nodes.whole(level)
        values = _assembled(nodes, known, level)
        means.append(np.stack([np.sum(values[0] * weight, axis=-1), np.sum(values[1] * weight, axis=-1)]))
        error, absorption, alone = _halving(means, tolerance) if nodes.refinable else np.zeros((3, len(k)))
        if not nodes.refinable or (
                level >= FIRST_LEVEL and (error <= _CROSS * tolerance).all() and (absorption <= _SHARE * tolerance).all()):
            break
    else:
        what, off, allowed = max(("extinction and scattering", error, _CROSS), ("absorption", absorption, _SHARE),
                                 key=lambda item: item[1].max() / item[2])
        worst = int(np.argmax(off))
        raise StageError(f"{component.name} at {wavelength[worst]:g} um: mean {what} reach a relative error of "
                         f"{off[worst]:.2g} with {nodes.count(level)} sizes, and the tolerance leaves "
                         f"{allowed * tolerance:.2g} for it; a larger tolerance or a narrower size range would do")
    dark = np.flatnonzero(means[-1][0] <= 0)
    if len(dark):
        raise StageError(
    f"{component.name} at {wavelength[dark[0]]:g} um does not scatter: its index is that of the host, or it is too "
    "small for double precision; another material or host would do")
    return _Cross(radius, weight, values[0], values[1], values[2], error, np.maximum(error, absorption), alone)


def _halving(means, tolerance):
    """(3, L): relative change of the mean cross sections in the last two halvings, the older one halved.

    Rows: the larger of extinction and scattering; absorption, over at least 0.01 tolerance of the extinction; absorption alone.
    """
    if len(means) < 3:
        return np.full((3, means[0].shape[-1]), math.inf)
    s, a = means[-1]
    scale = np.stack([s + a, s, np.maximum(a, 0.01 * tolerance * (s + a)), a])
    change = np.zeros_like(scale)
    for new, old, share in ((means[-1], means[-2], 1.0), (means[-2], means[-3], 0.5)):
        ds, da = new - old
        step = share * np.abs(np.stack([ds + da, ds, da, da]))
        change = np.maximum(change, np.divide(step, scale, out=np.zeros_like(step), where=scale > 0))
    return np.stack([change[:2].max(axis=0), change[2], change[3]])


def _spheres(component, radius, k, work):
    """(3, L, R): scattering and absorption cross sections (um^2) and mean cosine of single spheres."""
    tasks, seconds = [], 0.0
    for m, q in zip(component.m, k):
        x = q * radius
        cost = terms(x) * CROSS
        seconds += float(np.sum(cost))
        tasks += [(m, x[a:b]) for a, b in _cut(cost)]
    work.charge(seconds, component.name)
    blocks = work.map(cross_block, tasks) if tasks else []
    work.report(work.seconds, None)
    q = np.concatenate(blocks, axis=1).reshape(4, len(k), len(radius)) if len(radius) else np.zeros((4, len(k), 0))
    area = math.pi * radius**2
    return np.stack([q[0] * area, q[1] * area, q[2]])


def _assembled(nodes, known, level):
    """Values of all nodes of a level by ascending radius, from those of the levels."""
    radius = [nodes.fixed()[0]]
    values = [known[None]]
    if nodes.refinable:
        for j in range(level + 1):
            radius.append(nodes.fresh(j)[0])
            values.append(known[j])
    order = np.argsort(np.concatenate(radius), kind="stable")
    return np.concatenate(values, axis=2)[:, :, order]


def _cut(cost):
    """Ranges of consecutive items, each of at most `_BLOCK` seconds or one item."""
    if not len(cost):
        return []
    which = np.floor(np.cumsum(cost) / _BLOCK).astype(np.int64)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(which)) + 1, [len(cost)]])
    return list(zip(edges[:-1].tolist(), edges[1:].tolist()))


class _Batch:
    """Angles of one channel on their way to convergence."""

    def __init__(self, channel, theta, floor, target, elements):
        count = len(theta)
        self.channel, self.theta, self.target, self.elements = channel, theta, target, elements
        self.last = channel.nodes.levels - 1
        self.floor = np.minimum(np.full(count, FIRST_LEVEL) if floor is None else np.maximum(floor, FIRST_LEVEL), self.last)
        self.level = np.full(count, -1)
        self.fixed = np.zeros((elements, count))
        self.sums = np.zeros((elements, count))
        unknown = math.inf if channel.nodes.refinable else 0.0
        self.change, self.earlier = np.full(count, unknown), np.full(count, unknown)
        self.weights = [0.0]  # of the refinable nodes, by level, shifted by one
        self.begun = False
        ripple = math.pi / max(x for x, _ in features_of(channel))
        here = np.arange(count)
        low = np.minimum(np.searchsorted(theta, theta - ripple, side="left"), here - _WINDOW)
        high = np.maximum(np.searchsorted(theta, theta + ripple, side="right"), here + _WINDOW + 1)
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
        open_ = error > self.target
        if open_.any():
            self._give_up(open_, error)
        return [(np.flatnonzero(open_ & (self.level == level)), int(level) + 1) for level in np.unique(self.level[open_])]

    def _give_up(self, open_, error):
        """Raise where the last level is used up, or cannot be expected to suffice: halving the step at best halves the error."""
        left = self.last - self.level
        hopeless = open_ & ((left <= 0) | ((self.level >= FIRST_LEVEL + 3) & (error > 4 * self.target * 2.0**left)))
        if hopeless.any():
            worst = int(np.argmax(np.where(hopeless, error, 0.0)))
            c = self.channel
            raise StageError(
                f"{c.component} at {c.wavelength:g} um: the phase function at {math.degrees(self.theta[worst]):.4g} degrees "
                f"reaches a relative error of {error[worst]:.2g} with {c.nodes.count(int(self.level[worst]))} sizes of at most "
                f"{c.nodes.count(self.last)}, and the tolerance leaves {self.target:.2g} for it; a larger tolerance, "
                "a wider size distribution or a little absorption would do")

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
        whole = float(np.sum(self.channel.nodes.fixed()[1])) + self.weights[level + 1]
        return (self.fixed[:, index] + self.sums[:, index]) / whole

    def error(self):
        """(A,): change on halving and half the change before, added in squares; the largest among neighbours."""
        own = np.hypot(self.change, self.earlier / 2)
        return grid.largest(own, *self.window)

    def values(self):
        whole = float(np.sum(self.channel.nodes.fixed()[1])) + np.array(self.weights)[self.level + 1]
        return (self.fixed + self.sums) / whole


def _solve(channels, theta, floor, target, polarized, work):
    """Values (C, E, B) of the averaged elements at new angles, their errors and levels (C, B)."""
    elements = 4 if polarized else 1
    batches = [_Batch(c, theta, None if floor is None else floor[i], target, elements) for i, c in enumerate(channels)]
    while True:
        jobs = [(batch, index, level) for batch in batches for index, level in batch.wanted()]
        if not jobs:
            break
        _run(jobs, polarized, work)
    values = np.stack([batch.values() for batch in batches])
    return values, np.stack([batch.error() for batch in batches]), np.stack([batch.level for batch in batches])


def _run(jobs, polarized, work):
    """Sum the jobs block by block, holding a bounded number of results at a time, and hand each to its batch."""
    sums = [np.zeros((batch.elements, len(index))) for batch, index, _ in jobs]
    held, tasks, places = 0, [], []

    def flush():
        for (job, part), block in zip(places, work.map(angular_block, tasks)):
            sums[job][:, part] += block
        tasks.clear()
        places.clear()
        worst = max((float(b.error().max()) for b, *_ in jobs), default=0.0)
        work.report(work.seconds, worst if math.isfinite(worst) else None)

    per_angle = MUELLER if polarized else INTENSITY
    for job, (batch, index, level) in enumerate(jobs):
        channel = batch.channel
        radius, weight = channel.nodes.fixed() if level is None else channel.nodes.fresh(level)
        x = channel.k * radius
        # S is summed, the phase function is S / (k^2 C_sca): k^2 stays out until the end
        chunk = int(np.clip(_BLOCK / (terms(x.max()) * per_angle), _FEWEST_ANGLES, _MOST_ANGLES))
        for start in range(0, len(index), chunk):
            part = np.arange(start, min(start + chunk, len(index)))
            cost = terms(x) * (COEFFICIENT + per_angle * len(part))
            work.charge(float(np.sum(cost)), f"{channel.component} at {channel.wavelength:g} um")
            for a, b in _cut(cost):
                tasks.append((channel.m, x[a:b], weight[a:b], batch.theta[index[part]], polarized))
                places.append((job, part))
                held += 8 * batch.elements * len(part) + 16 * (b - a)
                if held > HELD:
                    flush()
                    held = 0
    if tasks:
        flush()
    for (batch, index, level), total in zip(jobs, sums):
        batch.absorb(index, level, total)


def _finish(table, i, channel, cross, wavelength):
    """Normalised elements (E, A), absolute error (A,), integral before over C_sca, relative error of one channel."""
    values = table.values[i]
    _, was = phase.normalised(table.theta, values[0])
    mean = float(np.sum(cross.scattering[wavelength] * cross.weight))
    scale = float(was) / (channel.k**2 * mean)
    s11, _ = phase.normalised(table.theta, values[0])
    factor = s11 / values[0]
    elements = np.concatenate([s11[None], values[1:] * factor])
    between = table.between[i]
    near = np.maximum(np.concatenate([between[:1], between]), np.concatenate([between, between[-1:]]))
    shift = min(_shift(table.theta, values[0], between), abs(scale - 1) + float(cross.error[wavelength]))
    absolute = np.maximum(near / was, table.error[i] * s11) + shift * s11
    return elements, absolute, scale, float(table.relative[i]) + shift


def _shift(theta, f, between):
    """Bound of the relative error of the integral of the table: the mean of the errors of its cells."""
    cells = phase.steps(theta)
    return float(np.sum(between * cells) / np.sum((f[1:] + f[:-1]) / 2 * cells)) if len(theta) > 1 else 0.0
