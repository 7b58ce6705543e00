"""Tables of multiple scattering made of photons: for any phase function, with error bars of their own.

The point table comes from `tally` on a uniform grid; the segment table is the integral of the point table along the beam.  Both
are `table.Table`s, looked up like those of the solver.

Two halves of the photons, independent of each other, measure the error: in the product of what each half says of a deviation the
noise has the mean 0.  Deviations are those of the table from arrivals in boxes and at angles between its corners, and a third of
what twice as wide bins of angles change.  The noise is half the difference of the tables of both halves.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bakery import rng
from bakery.physics.multiple import along, budget, frame, lookup, tally, uniform
from bakery.physics.multiple.build import LENGTH, TOLERANCE, upper
from bakery.physics.multiple.kinds import POINT, SEGMENT
from bakery.physics.multiple.table import Table, empty
from bakery.physics.multiple.tree import ASPECT

MOST_FLIGHTS = 4e7  # of photons for one wavelength, by default: 15 s
_PILOT, _FIRST = 3200, 4e6  # photons of a first look; flights of the first batch
_ROUNDS = 3  # batches after that
_NEAREST = 0.03  # mfp from the source, of the places that the basis is made of
_FROM, _ANGLES = 0.1, 8  # mfp: boxes that the error is measured in; angles in each
_SECOND = 1 / 3  # halving bins makes an error of second order 1/4 of it


@dataclass(frozen=True)
class Counted:
    """Tables by kind, and what they are made of."""

    tables: dict[int, Table]  # kind -> Table; `error` holds what more photons would not change, `error_with_solver` all
    # kind -> (N,) standard error of each `offset`: the relative one of the integral over directions at a corner
    offset_error: dict[int, np.ndarray]
    # rad, of the cone about forward (and backward) that the phase function was spread over where the first and the last
    # scattering are done, because its peak is narrower than a table resolves; 0: it was not
    resolution: float
    # photons, flights: followed
    photons: int
    flights: int


def build(albedo, theta, phase, kinds=(POINT,), *, extent=None, length=LENGTH, tolerance=TOLERANCE, photons=None,
          seed=0) -> Counted:
    """Tables of the light of third and later events around a source, by following photons.

    albedo : 1
    theta, phase : (A,) rad, 1/sr, linear in cos theta, normalised
    kinds : POINT, SEGMENT
    extent : mfp; None: 1e-4 of the light is beyond it
    length : of the segment, mfp
    tolerance : relative error of a lobe to be reached; photons are added until it is, or there are too many
    photons : most of them; None: as many as fly `MOST_FLIGHTS` times
    seed : of all random numbers

    Returns Counted : the same for any number of workers
    """
    medium = tally.medium(albedo, theta, phase, extent)
    if albedo == 0:
        tables = {kind: empty(kind, float(length) if kind == SEGMENT else 0.0, medium.extent, medium.k0) for kind in kinds}
        return Counted(tables, {kind: np.zeros(0) for kind in kinds}, 0.0, 0, 0)
    sums = tally.follow(medium, min(_PILOT, photons or _PILOT), seed, 0)
    most = photons or MOST_FLIGHTS / sums.flights * sums.photons
    wanted = _FIRST / sums.flights * sums.photons
    for batch in range(1, _ROUNDS + 1):
        photons_more = min(wanted, most) - sums.photons
        if photons_more >= tally.BLOCKS:
            sums = sums + tally.follow(medium, photons_more, seed, batch)
        fit = uniform.Fit(medium, tolerance, rng.generator(0, "multiple.fit"))
        points = _points(medium, sums, fit)
        biased, whole = points.table.error, points.table.error_with_solver
        if whole <= tolerance or sums.photons >= 0.99 * most:
            break
        # squares of noise fall as the number; what is left of a bias, and of its own scatter, does so at most
        allowed_square = tolerance**2 - min(biased, budget.BIAS * tolerance) ** 2
        wanted = sums.photons * float(np.clip(1.2 * whole**2 / allowed_square, 1.5, 20.0))
        if batch == _ROUNDS - 1:
            wanted *= 1.5
    tables, errors = {POINT: points.table}, {POINT: points.offset_error}
    if SEGMENT in kinds:
        tables[SEGMENT], errors[SEGMENT] = along.build(points.table, points.halves, fit, medium, float(length),
                                                      max(points.table.error, points.ahead), points.deviations)
    return Counted({kind: tables[kind] for kind in kinds}, {kind: errors[kind] for kind in kinds},
                   medium.resolution, sums.photons, sums.flights)


def agreement(photons: Table, offset_error, compared: Table, nearest=_FROM):
    """Integrals over directions at the corners of a table of photons against those of another table, in standard errors.

    offset_error : (N,) of the table of photons
    nearest : m (see `frame`) of the first corners that are compared, mfp

    Returns (P,) deviations: their mean square is 1 where both agree.  Neighbours share photons, so they come in groups.
    """
    u, v = (photons.corner / ((1 << photons.depth) * np.array([1, ASPECT]))).T
    these = u >= math.asinh(nearest / frame.CORE[photons.kind]) / math.asinh(photons.extent / frame.CORE[photons.kind])
    rho, z = frame.position(photons.kind, photons.length, photons.extent, u[these], v[these])
    shape = photons.basis.shape[1:]
    polar, azimuth = frame.polar(np.linspace(0, 1, shape[0])), np.linspace(0, np.pi, shape[1])
    tabulated, reference = (
        (lookup.lobes(lookup.ready(table), rho, z, polar, azimuth) * frame.solid_angles(shape)).sum(axis=(1, 2))
        for table in (photons, compared))
    return (tabulated / reference - 1) / offset_error[these]


class _Points(NamedTuple):
    """The table of points, and what that of segments takes besides."""

    table: Table
    halves: list[lookup.Ready]  # what either half of the photons makes of it
    ahead: float  # its error ahead of the source, where segments get their light from
    offset_error: np.ndarray
    deviations: np.ndarray  # (R, J, BLOCKS) of the integrals over directions, relative


def _points(medium, sums, fit) -> _Points:
    r = np.maximum(tally.far(medium, np.arange(0, tally.BOXES + 1, 2)), frame.NEAREST[POINT])
    Theta = np.pi * np.linspace(0, 1, ASPECT * 2**uniform.DEPTH + 1)  # of v
    first, last = tally.means(medium, Theta), tally.means(medium, fit.polar)
    halves = np.array([tally.lobes(medium, tally.at_even(half), first, last, fit.azimuth) for half in sums.halves])
    blocks = np.array([tally.integrals(medium, tally.at_even(block), first) for block in sums.blocks])
    integral = blocks.mean(axis=0)
    # where photons are too few to tell, at least a tenth of what neighbours have
    padded = np.concatenate([integral[:1], integral, integral[-1:]])
    integral = np.maximum(integral, 0.1 * np.maximum(np.maximum(padded[:-2], padded[2:]), 1e-12 * integral.max()))
    deviations = blocks / blocks.mean(axis=0).clip(0.1 * integral) - 1
    offset_error = np.minimum(blocks.std(axis=0, ddof=1) / math.sqrt(tally.BLOCKS) / integral, 1.0).ravel()
    integral, distance = integral.ravel(), np.repeat(r, len(Theta))
    a, basis = fit.represent(halves.reshape(2, len(distance), -1), integral, distance >= _NEAREST)
    a[..., 0] += np.log(integral) - medium.k0 * distance
    packed = fit.pack(POINT, 0.0, medium, a[0], basis)
    variants = [uniform.changed(lookup.ready(packed), packed, shift) for shift in a[1:] - a[0]]
    packed, ahead = _measured(medium, sums, fit, packed, variants)
    return _Points(packed, variants, ahead, offset_error, np.moveaxis(deviations, 0, -1))


def _measured(medium, sums, fit, packed, variants):
    """The table of points with its errors, and its error ahead."""
    boxes = np.arange(1, tally.BOXES, 2)
    boxes = boxes[tally.far(medium, boxes) >= min(_FROM, medium.extent / 5)]
    Theta = np.pi * fit.random.random(_ANGLES)
    Theta[0] = 0.3 * fit.random.random()  # ahead, where segments get their light from
    r = tally.far(medium, boxes)
    rho, z = np.outer(r, np.sin(Theta)).ravel(), np.outer(r, np.cos(Theta)).ravel()
    scale = (r * np.exp(medium.k0 * r))[:, None, None, None]

    def looked_up(ready):
        lobes = lookup.lobes(ready, rho, z, fit.test_polar, fit.test_azimuth)
        return lobes.reshape(len(r), len(Theta), *lobes.shape[1:]) * scale

    def counted(medium, sums):
        """The same as both halves of the photons have them."""
        first, last = (tally.means(medium, angles) for angles in (Theta, fit.test_polar))
        return [tally.lobes(medium, tally.at_boxes(half, boxes), first, last, fit.test_azimuth) for half in sums.halves]

    table, halves = looked_up(lookup.ready(packed)), [looked_up(variant) for variant in variants]
    fine, coarse = counted(medium, sums), counted(*tally.coarser(medium, sums))
    bias = (fit.share((halves[0] - fine[0]) * (halves[1] - fine[1]), table)
            + _SECOND**2 * fit.share((fine[0] - coarse[0]) * (fine[1] - coarse[1]), table))
    noise = fit.share((halves[0] - halves[1]) ** 2, table).mean(axis=1) / 4
    ahead, bias = upper(bias[:, 0]), bias.mean(axis=1)
    return replace(packed, error=upper(bias), error_with_solver=upper(bias + noise, noise),
                   worst=float(np.sqrt(np.maximum(bias + noise, noise).max()))), ahead
