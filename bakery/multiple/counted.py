"""Tables of multiple scattering made of photons: for any phase function, with error bars of their own.

The point table comes from `tally` on a uniform grid; the segment table is the integral of the point table along the beam.  Both
are `table.Table`s, looked up like those of the solver.

Two halves of the photons, independent of each other, measure the error: in the product of what each half says of a deviation the
noise has the mean 0.  Deviations are those of the table from arrivals in boxes and at angles between its corners, and a third of
what twice as wide bins of angles change.  The noise is half the difference of the tables of both halves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from bakery.multiple import basis as bases
from bakery.multiple import frame, legendre, lookup, tally
from bakery.multiple import table as tables
from bakery.multiple.frame import POINT, SEGMENT
from bakery.multiple.table import ASPECT, Table

MOST_FLIGHTS = 4e7  # of photons for one wavelength, if not told otherwise: 15 s
_PILOT, _FIRST = 3200, 4e6  # photons of a first look; flights of the first batch
_ROUNDS = 3  # batches after that
_DEPTH = 5  # of the tree: every second box is a corner
_SAMPLE, _NEAREST = 300, 0.03  # places that the basis is made of, mfp from the source
_ORDERS = (2e-3, 64)  # of the directions of a basis: until p_l is small, at most
_FROM, _ANGLES = 0.1, 8  # mfp: boxes that the error is measured in; angles in each
_SECOND = 1 / 3  # halving bins makes an error of second order 1/4 of it
_STEPS = 32767
_SEED = 0x636F756E  # of the places of tests


@dataclass(frozen=True)
class Counted:
    """Tables by kind, and what they are made of.

    Attributes
    ----------
    tables : kind -> Table; `error` holds what more photons would not change, `error_with_solver` all
    offset_error : kind -> (N,) standard error of each `offset`: the relative one of the integral over directions at a corner
    resolution : rad, of the cone about straight on (and back) that the phase function was spread over where the first and the
        last scattering are done, because its peak is narrower than a table resolves; 0: it was not
    photons, flights : followed
    """

    tables: dict[int, Table]
    offset_error: dict[int, np.ndarray]
    resolution: float
    photons: int
    flights: int


def build(albedo, theta, phase, kinds=(POINT,), *, extent=None, length=tables.LENGTH, tolerance=tables.TOLERANCE, photons=None,
          seed=0) -> Counted:
    """Tables of the light of third and later events around a source, by following photons.

    Parameters
    ----------
    albedo : 1
    theta, phase : (A,) rad, 1/sr, linear in cos theta, normalised
    kinds : POINT, SEGMENT
    extent : mfp; None: 1e-4 of the light is beyond it
    length : of the segment, mfp
    tolerance : relative error of a lobe to be reached; photons are added until it is, or there are too many
    photons : most of them; None: as many as fly `MOST_FLIGHTS` times
    seed : of all random numbers

    Returns
    -------
    Counted : the same for any number of workers
    """
    medium = tally.medium(albedo, theta, phase, extent)
    if albedo == 0:
        made = {kind: _empty(kind, length, medium) for kind in kinds}
        return Counted(made, {kind: np.zeros(0) for kind in kinds}, 0.0, 0, 0)
    sums = tally.follow(medium, min(_PILOT, photons or _PILOT), seed, 0)
    most = photons or MOST_FLIGHTS / sums.flights * sums.photons
    wanted = _FIRST / sums.flights * sums.photons
    for batch in range(1, _ROUNDS + 1):
        more = min(wanted, most) - sums.photons
        if more >= tally.BLOCKS:
            sums = sums + tally.follow(medium, more, seed, batch)
        made = _Build(medium, sums, length, tolerance)
        points = made.point()
        biased, whole = points.error, points.error_with_solver
        if whole <= tolerance or sums.photons >= 0.99 * most:
            break
        # squares of noise fall as the number; what is left of a bias, and of its own scatter, does so at most
        room = tolerance**2 - min(biased, 0.7 * tolerance) ** 2
        wanted = sums.photons * float(np.clip(1.2 * whole**2 / room, 1.5, 20.0))
        if batch == _ROUNDS - 1:
            wanted *= 1.5
    found, errors = {POINT: points}, {POINT: made.offset_error}
    if SEGMENT in kinds:
        found[SEGMENT], errors[SEGMENT] = made.segment(points)
    return Counted({kind: found[kind] for kind in kinds}, {kind: errors[kind] for kind in kinds}, medium.resolution, sums.photons,
                   sums.flights)


class _Build:
    def __init__(self, medium, sums, length, tolerance):
        self.medium, self.sums, self.length, self.tolerance = medium, sums, float(length), tolerance
        p = legendre.moments(medium.theta, medium.phase, _ORDERS[1])
        order = int(np.flatnonzero(np.abs(p) > _ORDERS[0])[-1])
        self.shape = tables.shape(order)
        self.solid_angle = frame.solid_angles(self.shape).ravel()
        self.polar, self.azimuth = frame.polar(np.linspace(0, 1, self.shape[0])), np.linspace(0, np.pi, self.shape[1])
        smooth = medium.outer[1]
        self.least, self.greatest = max(smooth.min(), 1e-6), smooth.max()
        self.random = np.random.default_rng(_SEED)
        # directions of tests: not those of a basis
        x, gauss = np.polynomial.legendre.leggauss(max(20, order))
        self.test_polar, across = np.arccos(x), max(10, order // 2)
        self.test_azimuth = (np.arange(across) + 0.37) * np.pi / across
        self.test_weight = gauss[:, None] * np.ones(across)

    # ---- point

    def point(self) -> Table:
        medium, sums = self.medium, self.sums
        r = np.maximum(tally.far(medium, np.arange(0, tally.BOXES + 1, 2)), frame.NEAREST[POINT])
        Theta = np.pi * np.linspace(0, 1, ASPECT * 2**_DEPTH + 1)  # of v
        first, last = tally.means(medium, Theta), tally.means(medium, self.polar)
        halves = np.array([tally.lobes(medium, tally.at_even(half), first, last, self.azimuth) for half in sums.halves])
        halves = halves.reshape(2, len(r) * len(Theta), -1)
        blocks = np.array([tally.integrals(medium, tally.at_even(block), first) for block in sums.blocks])
        integral = _positive(blocks.mean(axis=0))
        self.deviations = blocks / blocks.mean(axis=0).clip(0.1 * integral) - 1  # of blocks, (BLOCKS, R, J)
        self.offset_error = np.minimum(blocks.std(axis=0, ddof=1) / math.sqrt(tally.BLOCKS) / integral, 1.0).ravel()
        integral = integral.ravel()
        distance = np.repeat(r, len(Theta))
        a, self.found = self.represent(halves, integral, distance >= _NEAREST)
        a[..., 0] += np.log(integral) - medium.k0 * distance
        corner = np.argwhere(np.ones((len(r), len(Theta))))
        made = _pack(POINT, 0.0, medium, corner, a[0], self.found, self.shape, self.solid_angle)
        return self.measured(made, a[1:] - a[0])

    def represent(self, halves, integral, near_enough, room=0.5):
        """Coefficients a_0 .. a_K of lobes (2, N, D) with these integrals, of their mean and of both; the basis.

        It may miss `room` of the tolerance.
        """
        # a lobe is at least the least value of the phase function times its integral
        mean = halves.mean(axis=0) / integral[:, None]
        lobe = np.clip(mean, self.least, self.greatest)
        lobe /= (lobe * self.solid_angle).sum(axis=1, keepdims=True)
        logs, weight = np.log(lobe), bases.weights(lobe, self.solid_angle)
        # what each half says of the logarithm, to first order; where it is dark noise may exceed the lobe many times
        apart = np.clip((halves[0] - halves[1]) / (2 * integral[:, None] * lobe), -1.0, 1.0)
        noise = (weight * apart**2).sum(axis=1)
        sample = np.flatnonzero(near_enough)
        sample = np.sort(self.random.choice(sample, min(_SAMPLE, len(sample)), replace=False))
        quiet = sample[noise[sample] <= np.quantile(noise[sample], 0.6)]
        of_row = 1 / (1 + noise[sample] / max(np.median(noise[sample]), 1e-12))
        first = bases.start(logs[quiet], weight[quiet], tables.COUNTS[-1])
        best = None
        for count in tables.COUNTS:
            found = bases.improved(first[:count + 1], logs[sample], weight[sample] * of_row[:, None])
            scale = _scales(found).astype(float)[:, None]
            found = np.rint(found / scale) * scale
            a, more = self.in_basis(logs[sample], apart[sample], weight[sample], found)
            rest = logs[sample] - found[0] - bases.combine(a, _with_one(found))
            left = apart[sample] - bases.combine(more, _with_one(found))
            # of the product of both halves' residuals the noise has mean 0
            missed = max(float(((rest + left) * (rest - left) * weight[sample]).sum(axis=1).mean()), 0.0)
            noisy = float((bases.combine(more, _with_one(found)) ** 2 * weight[sample]).sum(axis=1).mean())
            if best is None or missed + noisy < best[0]:
                best = missed + noisy, found
            if missed < (self.tolerance * room) ** 2:
                best = missed, found
                break
        found = best[1]
        a, more = self.in_basis(logs, apart, weight, found)
        a[:, 0] = 0.0
        return np.stack([a, a + more, a - more]), found

    @staticmethod
    def in_basis(logs, apart, weight, found):
        return bases.coefficients(logs, weight, found), bases.solve(apart, weight, _with_one(found))

    def measured(self, made, more):
        """With errors; more : (2, N, K + 1) of the coefficients of both halves."""
        medium = self.medium
        boxes = np.arange(1, tally.BOXES, 2)
        boxes = boxes[tally.far(medium, boxes) >= min(_FROM, medium.extent / 5)]
        Theta = np.pi * self.random.random(_ANGLES)
        Theta[0] = 0.3 * self.random.random()  # ahead, where segments get their light from
        r = tally.far(medium, boxes)
        rho, z = np.outer(r, np.sin(Theta)).ravel(), np.outer(r, np.cos(Theta)).ravel()
        scale = (r * np.exp(medium.k0 * r))[:, None, None, None]

        def of_table(ready):
            found = lookup.lobes(ready, rho, z, self.test_polar, self.test_azimuth)
            return found.reshape(len(r), len(Theta), *found.shape[1:]) * scale

        ready = lookup.ready(made)
        self.variants = [_changed(ready, made, change) for change in more]
        table, halves = of_table(ready), [of_table(variant) for variant in self.variants]
        fine = self.counted(medium, self.sums, boxes, Theta)
        coarse = self.counted(*tally.coarser(medium, self.sums), boxes, Theta)

        def share(product):
            return ((self.test_weight * product).sum(axis=(2, 3)) / (self.test_weight * table**2).sum(axis=(2, 3)))

        bias = (share((halves[0] - fine[0]) * (halves[1] - fine[1]))
                + _SECOND**2 * share((fine[0] - coarse[0]) * (fine[1] - coarse[1])))
        self.ahead, bias, noise = _upper(bias[:, 0]), bias.mean(axis=1), share((halves[0] - halves[1]) ** 2).mean(axis=1) / 4
        return replace(made, error=_upper(bias), error_with_solver=_upper(bias + noise, noise),
                       worst=float(np.sqrt(np.maximum(bias + noise, noise).max())))

    def counted(self, medium, sums, boxes, Theta):
        """Lobes of tests as both halves of the photons have them."""
        first, last = (tally.means(medium, angles) for angles in (Theta, self.test_polar))
        return [tally.lobes(medium, tally.at_boxes(half, boxes), first, last, self.test_azimuth) for half in sums.halves]

    # ---- segment

    def segment(self, points):
        medium, length = self.medium, self.length
        u, v = (x.ravel() for x in np.meshgrid(np.linspace(0, 1, 2**_DEPTH + 1), np.linspace(0, 1, ASPECT * 2**_DEPTH + 1),
                                               indexing="ij"))
        rho, z = frame.position(SEGMENT, length, medium.extent, u, v)
        ready = lookup.ready(points)
        lobe = along(ready, length, rho, z, self.polar, self.azimuth).reshape(len(rho), -1)
        integral = (lobe * self.solid_angle).sum(axis=1)
        a, found = self.represent(np.stack([lobe, lobe]), integral, np.ones(len(rho), bool), 0.2)
        a = a[0]
        a[:, 0] = np.log(integral / frame.measure(SEGMENT, length, rho, z)[1])
        corner = np.argwhere(np.ones((2**_DEPTH + 1, ASPECT * 2**_DEPTH + 1)))
        made = _pack(SEGMENT, length, medium, corner, a, found, self.shape, self.solid_angle)
        # its own error against the same integrals between the corners, and the noise of those
        rho_t, z_t = tables.places(SEGMENT, length, medium.extent, self.random)
        rho_t, z_t = rho_t[::3], z_t[::3]
        exact, *halves = (along(one, length, rho_t, z_t, self.test_polar, self.test_azimuth) for one in (ready, *self.variants))
        table = lookup.lobes(lookup.ready(made), rho_t, z_t, self.test_polar, self.test_azimuth)

        def share(square):
            return (self.test_weight * square).sum(axis=(1, 2)) / (self.test_weight * exact**2).sum(axis=(1, 2))

        inherited = max(points.error, self.ahead)
        # places along the beam share the few arrivals close to the source: one draw of the noise, which is counted four times
        own, noise = share((table - exact) ** 2), share((halves[0] - halves[1]) ** 2)
        worst = math.hypot(float(np.sqrt((own + noise).max())), inherited)
        made = replace(made, error=math.hypot(_upper(own), inherited), worst=worst,
                       error_with_solver=math.hypot(_upper(own + noise), inherited))
        errors = np.zeros(len(rho))
        _deviations(ready, length, np.ascontiguousarray(np.moveaxis(self.deviations, 0, -1)), rho, z, errors)
        return made, np.minimum(errors, 1.0)


def agreement(photons: Table, offset_error, other: Table, nearest=_FROM):
    """Integrals over directions at the corners of a table of photons against those of another table, in standard errors.

    Parameters
    ----------
    offset_error : (N,) of the table of photons
    nearest : m (see `frame`) of the first corners that are compared, mfp

    Returns
    -------
    (P,) deviations: their mean square is 1 where both agree.  Neighbours share photons, so they come in groups.
    """
    u, v = (photons.corner / ((1 << photons.depth) * np.array([1, ASPECT]))).T
    these = u >= math.asinh(nearest / frame.CORE[photons.kind]) / math.asinh(photons.extent / frame.CORE[photons.kind])
    rho, z = frame.position(photons.kind, photons.length, photons.extent, u[these], v[these])
    shape = photons.basis.shape[1:]
    polar, azimuth = frame.polar(np.linspace(0, 1, shape[0])), np.linspace(0, np.pi, shape[1])
    found, reference = ((lookup.lobes(lookup.ready(one), rho, z, polar, azimuth) * frame.solid_angles(shape)).sum(axis=(1, 2))
                        for one in (photons, other))
    return (found / reference - 1) / offset_error[these]


def along(points, length, rho, z, polar, azimuth):
    """Lobes (N, A, B) of a segment in the frames of positions (N,): integrals of a `lookup.Ready` table of points."""
    out = np.empty((len(rho), len(polar), len(azimuth)))
    arrays = (np.ascontiguousarray(x, float) for x in (rho, z, polar, azimuth))
    _along(points, points._replace(length=10.0 * length), length, *arrays, out)  # longer: never a whole one of these
    return out


def _upper(square, least=0.0):
    """Root of a mean over boxes, plus three of its standard errors; the mean is at least that of `least`."""
    mean = max(float(np.mean(square)), float(np.mean(least)))
    return math.sqrt(max(mean + 3 * float(np.std(square)) / math.sqrt(len(square)), 0.0))


def _positive(integral):
    """Integrals (R, J): where photons are too few to tell, at least a tenth of what their neighbours have."""
    wide = np.concatenate([integral[:1], integral, integral[-1:]])
    return np.maximum(integral, 0.1 * np.maximum(np.maximum(wide[:-2], wide[2:]), 1e-12 * integral.max()))


def _changed(ready, made, change):
    """A table ready for look-ups with other coefficients: change (N, K + 1)."""
    a = np.column_stack([made.offset, made.coefficient * made.coefficient_scale.astype(float)]) + change
    grid = tables.margins(a.reshape(2**_DEPTH + 1, ASPECT * 2**_DEPTH + 1, -1))
    return ready._replace(grid=np.ascontiguousarray(grid, np.float32))


def _pack(kind, length, medium, corner, a, found, shape, solid_angle) -> Table:
    """A table on the uniform grid, rounded as the file holds it; a_0 is the logarithm of the integral over directions."""
    scale = (np.maximum(np.abs(a[:, 1:]).max(axis=0), 1e-30) / _STEPS).astype(np.float32)
    whole = np.rint(a[:, 1:] / scale).astype(np.int16)
    basis_scale = _scales(found)
    basis = np.rint(found / basis_scale[:, None].astype(float)).astype(np.int16)
    functions = basis * basis_scale[:, None].astype(float)
    stored = np.exp(functions[0] + bases.combine(whole * scale.astype(float), functions[1:]))
    offset = a[:, 0] - np.log((stored * solid_angle).sum(axis=1))
    return Table(kind, length, medium.extent, medium.k0, *_tree(), corner.astype(np.int16), offset.astype(np.float32), whole,
                 scale, basis.reshape(-1, *shape), basis_scale)


def _empty(kind, length, medium):
    none = np.zeros((0, 2), np.int16)
    return Table(kind, float(length) if kind == SEGMENT else 0.0, medium.extent, medium.k0, *_tree(0), none,
                 np.zeros(0, np.float32), np.zeros((0, 0), np.int16), np.zeros(0, np.float32), np.zeros((1, 2, 2), np.int16),
                 np.zeros(1, np.float32))


def _tree(depth=_DEPTH):
    """Bounds and children of a tree of this depth everywhere."""
    bounds, child = [(0.0, 1.0, i / ASPECT, (i + 1) / ASPECT) for i in range(ASPECT)], [-1] * ASPECT
    leaves = range(ASPECT)
    for _ in range(depth):
        first = len(bounds)
        for leaf in leaves:
            left, right, low, high = bounds[leaf]
            child[leaf] = len(bounds)
            middle, centre = (left + right) / 2, (low + high) / 2
            bounds += [(x, x + middle - left, y, y + centre - low) for x in (left, middle) for y in (low, centre)]
            child += [-1] * 4
        leaves = range(first, len(bounds))
    return np.array(bounds, np.float32), np.array(child, np.int32)


def _scales(found):
    return np.maximum(np.abs(found).max(axis=1) / _STEPS, 1e-30).astype(np.float32)


def _with_one(found):
    regressors = found.copy()
    regressors[0] = 1.0
    return regressors


@njit(cache=True, nogil=True, error_model="numpy")
def _along(points, longer, length, rho, z, polar, azimuth, out):
    a, b = lookup.scratch(points)
    c, d = lookup.scratch(points)
    for n in range(len(rho)):
        sine, cosine = frame.place(SEGMENT, length, max(rho[n], frame.CLOSEST), z[n])[3:]
        for i in range(len(polar)):
            across, forward = math.sin(polar[i]), math.cos(polar[i])
            for j in range(len(azimuth)):
                side = across * math.cos(azimuth[j])
                out[n, i, j] = lookup.any_length(points, longer, length, rho[n], z[n], forward * sine - side * cosine,
                                                 across * math.sin(azimuth[j]), forward * cosine + side * sine, a, b, c, d)


@njit(cache=True, nogil=True, error_model="numpy")
def _deviations(points, length, deviations, rho, z, out):
    """Relative standard errors of integrals over directions of a segment, from those of blocks (R, J, BLOCKS) at the corners."""
    R, J, blocks = deviations.shape
    total = np.empty(blocks)
    for n in range(len(rho)):
        close = max(rho[n], frame.CLOSEST)
        low, high = math.asinh(-z[n] / close), math.asinh((length - z[n]) / close)
        count = 4 * (int(high - low) + 1)
        whole = 0.0
        total[:] = 0.0
        for i in range(count):
            away = close * math.sinh(low + (high - low) * (i + 0.5) / count)
            r = math.hypot(rho[n], away)
            s = min(math.asinh(r / frame.CORE[POINT]) * points.stretch * (R - 1), R - 1.0)
            t = math.atan2(rho[n], -away) / math.pi * (J - 1)
            x, y = min(int(s), R - 2), min(int(t), J - 2)
            s, t = s - x, t - y
            beyond = max(r - points.extent, 0.0)
            # a_0 without the basis: what is left varies slowly
            a = ((1 - s) * ((1 - t) * points.grid[x + 1, y + 1, 0] + t * points.grid[x + 1, y + 2, 0])
                 + s * ((1 - t) * points.grid[x + 2, y + 1, 0] + t * points.grid[x + 2, y + 2, 0]))
            weight = math.exp(a - points.k0 * beyond - (z[n] + away))  # dt = ds / r, and the singular part 1 / r
            whole += weight
            for k in range(blocks):
                total[k] += weight * ((1 - s) * ((1 - t) * deviations[x, y, k] + t * deviations[x, y + 1, k])
                                      + s * ((1 - t) * deviations[x + 1, y, k] + t * deviations[x + 1, y + 1, k]))
        mean = total.mean()
        square = 0.0
        for k in range(blocks):
            square += (total[k] - mean) ** 2
        out[n] = math.sqrt(square / (blocks - 1) / blocks) / whole
