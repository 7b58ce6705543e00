"""How the tables of a medium are made: which orders are solved, where a forward peak is cut, when photons stand in."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from bakery.physics.medium.phase import without_delta
from bakery.physics.medium.similarity import without_peak
from bakery.physics.multiple import build, counted, legendre, peaks, solution
from bakery.physics.multiple.backward import KEPT, WHOLE
from bakery.physics.multiple.table import Table

POOR = 0.2  # error of the solver's tables above which photons are tried
_MOMENTS = 140
_ALL = 1 - 1e-9  # share of the scattered light above which nothing but the delta is left


class Medium(NamedTuple):
    """One wavelength of a medium."""

    albedo: float  # 1
    # theta, phase: (A,) rad, 1/sr, linear in cos theta, normalised
    theta: np.ndarray
    phase: np.ndarray
    delta: float  # share of the scattered light that keeps its direction, part of phase below theta[1] (packed grains)


class Asked(NamedTuple):
    """What is asked of tables."""

    extent: float | None  # mfp, or None: all but 1e-4 of the light
    length: float  # of the segment, mfp
    tolerance: float  # error of a lobe
    orders: int | None  # Legendre orders, or None: as many as it takes, or so many that narrower peaks may be left out
    photons: int | None  # most of them, or None: `counted.MOST_FLIGHTS`
    seed: int  # of all random numbers


class Solved(NamedTuple):
    """The solution for one wavelength, and what was done with a forward peak."""

    solution: solution.Solution  # of the medium without the peak
    peak: float  # share of the scattered light that counts as not scattered
    phase: np.ndarray  # (A,) 1/sr, that of the solution
    peak_angle: float = 0.0  # rad, below which light is in the peak; 0 where there is none
    peak_effect: float = 0.0  # what it would change if light in the peak kept its direction (see `peaks.effect`)


class Tabulated(NamedTuple):
    """A table, and the medium that it holds for."""

    table: Table  # error and all
    albedo: float  # of that medium
    extinction: float  # sigma_t of that medium over that of the one asked for
    # peak, phase, peak_angle, peak_effect: as in `Solved`
    peak: float
    phase: np.ndarray
    peak_angle: float
    peak_effect: float
    # what tables of photons alone have, name -> array: offset_error (N,), photons (1,), resolution (1,) rad
    counted: dict[str, np.ndarray]


def solved(medium: Medium, orders: int | None) -> Solved:
    """Solves for one wavelength; `orders` as in `Asked`.

    Raises ValueError : a narrow peak backward
    """
    albedo, theta, phase, delta = medium
    p = legendre.moments(theta, phase, max(_MOMENTS, (orders or 0) + 8))
    if delta >= _ALL:
        nothing = np.eye(1, len(p))[0]
        return Solved(solution.solve(0.0, nothing), min(delta, 1.0), phase, float(theta[1]))
    remaining = (p - delta) / (1 - delta)
    remaining[0] = 1.0
    needed = legendre.order_needed(remaining)
    most = orders or (WHOLE if needed is not None and needed <= WHOLE else KEPT)
    if needed is None or needed > most:
        clip = peaks.clipped(theta, phase, most)
        result = peaks.solve(albedo, clip, most)
        return Solved(result, clip.peak, clip.phase, clip.angle, peaks.effect(clip, result, build.extent_needed(result.medium)))
    result = solution.solve(without_peak(albedo, delta)[0], remaining, most=most)
    return Solved(result, delta, without_delta(theta, phase, delta), _angle(medium))


def by_solver(medium: Medium, kinds: Iterable[int], asked: Asked) -> dict[int, Tabulated]:
    """Tables of several kinds of sources from one solution, by kind.

    Raises ValueError : the solver or a table refuses
    """
    result = solved(medium, asked.orders)
    prepared = result.solution.medium
    extent = build.extent_needed(prepared) if asked.extent is None else asked.extent
    extinction = without_peak(medium.albedo, result.peak)[1]
    return {kind: Tabulated(build.table(result.solution, kind, extent=extent, length=asked.length, tolerance=asked.tolerance,
                                        seed=asked.seed), prepared.albedo, extinction, *result[1:], {}) for kind in kinds}


def by_photons(medium: Medium, kinds: Iterable[int], asked: Asked) -> dict[int, Tabulated]:
    """Tables of several kinds of sources from the same photons, by kind."""
    albedo, extinction = without_peak(medium.albedo, medium.delta)
    phase = without_delta(medium.theta, medium.phase, medium.delta)
    if medium.delta >= _ALL:
        albedo = 0.0
    counts = counted.build(albedo, medium.theta, phase, tuple(kinds), extent=asked.extent, length=asked.length,
                         tolerance=asked.tolerance, photons=asked.photons, seed=asked.seed)
    members = {"photons": np.array([counts.photons]), "resolution": np.array([counts.resolution])}
    return {kind: Tabulated(table, albedo, extinction, medium.delta, phase, _angle(medium), 0.0,
                            {"offset_error": counts.offset_error[kind]} | members) for kind, table in counts.tables.items()}


def error(tables: Iterable[Tabulated | None]) -> float:
    """The largest error of a wavelength's tables with what the solver contributes; infinite where one or all are missing."""
    return max((math.inf if table is None else table.table.error_with_solver for table in tables), default=math.inf)


def _angle(medium: Medium) -> float:
    """Angle below which a delta stands in the table; 0 where there is none."""
    return float(medium.theta[1]) if medium.delta > 0 else 0.0
