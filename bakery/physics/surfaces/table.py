"""Solutions of layers as tables that compiled loops and plugins look up (`look_up`): a grid in place of Fourier orders.

What is left of reflectance and transmittance without light scattered once is sampled over both directions and the azimuth.  The
grid is uniform in x = 1 - sqrt(1 - s), s the coordinate of `nodes`: the cosine in air where all media have a larger index, else
the root of the cosine in the thinnest one.  There grazing angles have room, and the sine, with which odd orders begin at normal
incidence, is linear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bakery import rng
from bakery.physics.medium.phase import phase_at
from bakery.physics.surfaces import fresnel, single
from bakery.physics.surfaces.corrected import Corrected
from bakery.physics.surfaces.look_up import surface_reflectance, surface_transmittance
from bakery.physics.surfaces.nodes import coordinate, interpolation, vanishing
from bakery.physics.surfaces.slab import free, layers
from bakery.physics.surfaces.solution import Solution
from bakery.physics.surfaces.stack import Stacked
from bakery.physics.surfaces.unscattered import unscattered
from bakery.system.compiled import njit

GRIDS = (32, 24), (48, 32), (64, 48), (96, 64)  # directions and azimuths, from which the first one that is good enough is taken
TOLERANCE = 2e-3
PROBES = 4000  # pairs of directions at which the error is measured, from normal incidence to 89.9 degrees
_GRAZING = math.cos(math.radians(89.9))
_LEAST = 1e-9  # cosine in air at which grids begin where theirs is 0
_UNSCATTERED = 129  # cosines at which unscattered light of layers on each other is told: 2e-4 in between
_BUCKETS = 2048  # of scattering angles, in which their interval is looked for


class SurfaceTable(NamedTuple):
    """A layer at L wavelengths, for `look_up`."""

    index: float  # refractive index of the medium over that of the air
    roughness: float  # of the boundary's facets, 0 for a smooth one or none
    depth: np.ndarray  # (L,) optical depth without the cut peak, inf of infinite layers
    once: np.ndarray  # (L,) a quarter of the single-scattering albedo over the share of the depth that is left without the peak
    peak: np.ndarray  # (L,) optical depth of the peak, whose light transmittance counts as deflected once
    base: np.ndarray  # (L,) albedo of the base, 0 where there is none
    s: np.ndarray  # (A,) sin^2 of half the scattering angle, ascending from 0 to 1
    phase: np.ndarray  # (L, A) 4 pi times the phase function, linear in s
    guide: np.ndarray  # (B,) int64, interval of s at which the bucket of its root begins
    # reflected, transmitted: (L, K, K, P) float32, what is smooth; transmitted (0, 1, 1, 1) where nothing is let through
    reflected: np.ndarray
    transmitted: np.ndarray
    free: bool  # whether there is air below
    index_below: float  # of the lowest medium over that of the air
    rooted: bool  # whether the grids go by the root of the cosine
    # whether nodes crowd at grazing angles, straight ahead and straight back: between grazing directions, the factors of what is
    # counted among grains change over azimuths as small as the cosines
    crowded: bool
    # (L, S) of layers on each other, share of the light that boundaries below the uppermost send back unscattered, at S cosines
    # (`cosines`); (L, 0) where the upper numbers tell it
    mirrored: np.ndarray
    straight: np.ndarray  # the same of light that leaves below unscattered, less what of it is counted as deflected once by peaks

    def combined(self, weights) -> SurfaceTable:
        """Of layers of infinite depth: tables that are means over the wavelengths, by (N, L) weights.

        Raises ValueError where depths differ: then means of values are no values of means.
        """
        if np.isfinite(self.depth).any():
            raise ValueError("only tables of infinite layers can be averaged")
        weights = np.atleast_2d(np.asarray(weights, float))
        phase = np.einsum("nl,l,la->na", weights, self.once, self.phase)
        unchanged = [np.full(len(weights), value) for value in (math.inf, 1.0, 0.0, 0.0)]
        return self._replace(depth=unchanged[0], once=unchanged[1], peak=unchanged[2], base=unchanged[3], phase=phase,
                             mirrored=weights @ self.mirrored, straight=weights @ self.straight,
                             **{name: np.einsum("nl,lijk->nijk", weights, grid).astype(np.float32)
                                for name in ("reflected", "transmitted") if len(grid := getattr(self, name))})


class Errors(NamedTuple):
    """Of a table against the solutions: largest and root mean square relative error at `PROBES` pairs of directions.

    The largest is over angles to 89.9 degrees; values below a thousandth of the median are compared with that.
    """

    largest: float
    mean_square: float


def surface_table(solutions: Sequence, tolerance: float = TOLERANCE) -> tuple[SurfaceTable, Errors]:
    """The table of one layer, and its error.

    solutions : `solution.Solution`, `covered.Covered`, `stack.Stacked` or `corrected.Corrected` of each of L wavelengths, of the
        same layer, base or none, and boundary
    tolerance : largest relative error, which the finest grid may miss: the errors say so
    """
    probes = probed(solutions)
    # factors of cells are not smooth: only the finest grid will do
    for nodes, azimuths in GRIDS[-1:] if isinstance(solutions[0], Corrected) else GRIDS:
        table = _sampled(solutions, nodes, azimuths)
        errors = errors_of(table, probes)
        if errors.largest <= tolerance:
            break
    return table, errors


def probed(solutions: Sequence, count: int = PROBES):
    """Cosines and azimuth (3, Q) of pairs of directions, and exact reflectance and transmittance (L, Q) of each."""
    random = rng.generator(0, "surface.probes")
    grazing = np.where(random.random((2, count)) < 0.5, 1, 3)
    mu, mu0 = np.maximum(random.random((2, count)) ** grazing, _GRAZING)
    at = np.stack([mu, mu0, math.pi * random.random(count)])
    return at, np.stack([solution.reflection(*at) for solution in solutions]), \
        np.stack([solution.transmission(*at) for solution in solutions])


def errors_of(table: SurfaceTable, probes) -> Errors:
    """Of a table at what `probed` gives."""
    (mu, mu0, phi), *exact = probes
    values = np.empty((2, len(table.once), len(mu)))
    _evaluate(table, mu, mu0, np.cos(phi), values)
    relative = [np.abs(value - true)[true > 0] / np.maximum(true, 1e-3 * np.median(true[true > 0]))[true > 0]
                for value, true in zip(values, exact, strict=True) if np.any(true)]
    return Errors(float(max((part.max() for part in relative), default=0.0)),
                  float(max((np.sqrt(np.mean(part**2)) for part in relative), default=0.0)))


@njit(cache=True, nogil=True, error_model="numpy")
def _evaluate(table, mu, mu0, cos_phi, values):
    for wave in range(values.shape[1]):
        for q in range(len(mu)):
            values[0, wave, q] = surface_reflectance(table, wave, mu[q], mu0[q], cos_phi[q])
            values[1, wave, q] = surface_transmittance(table, wave, mu[q], mu0[q], cos_phi[q])


def _sampled(solutions, nodes: int, azimuths: int) -> SurfaceTable:
    if isinstance(solutions[0], Corrected):
        return _counted(solutions, nodes, azimuths)
    if isinstance(solutions[0], Stacked):
        return _of_stacks(solutions, nodes, azimuths)
    first = solutions[0].slab
    rough = first.roughness > 0 and first.index != 1
    s = np.sin(first.theta / 2) ** 2
    keep = np.concatenate([[True], np.diff(s) > 0])
    phase = 4 * math.pi * np.stack([solution.slab.phase[keep] for solution in solutions])
    buckets = np.searchsorted(s[keep], np.linspace(0, 1, _BUCKETS) ** 2, side="right") - 1
    through = free(first)
    transmitted = [_grid(solution, solution.through, nodes, azimuths) for solution in solutions] if through else []
    return SurfaceTable(
        float(first.index), first.roughness if rough else 0.0,
        np.array([solution.slab.depth * solution.cut.shrinks if solution.slab.depth else 0.0 for solution in solutions]),
        np.array([0.25 * solution.slab.albedo / solution.cut.shrinks for solution in solutions]),
        np.array([solution.slab.depth * solution.slab.albedo * solution.cut.share if solution.cut.share else 0.0
                  for solution in solutions]),
        np.array([solution.slab.base or 0.0 for solution in solutions]), s[keep], phase,
        np.clip(buckets, 0, len(phase[0]) - 2).astype(np.int64),
        np.stack([_grid(solution, solution.reflected, nodes, azimuths) for solution in solutions]),
        np.stack(transmitted) if through else np.zeros((0, 1, 1, 1), np.float32), through, float(first.index),
        rough or first.index <= 1, False, *np.zeros((2, len(solutions), 0)))


def _counted(solutions, nodes: int, azimuths: int) -> SurfaceTable:
    """Of layers that are counted among grains: all of their light is in the grid, that of the first order too, as if they were
    infinite; but for light that passes a layer undeflected."""
    table = _sampled([solution.solution for solution in solutions], 2, 2)
    nothing = np.zeros(len(solutions))
    mu = np.maximum(spread(np.linspace(0, 1, nodes)) ** 2, _LEAST)
    at = mu[:, None, None], mu[:, None], 2 * np.arcsin(np.sqrt(spread(spread(np.linspace(0, 1, azimuths)))))

    def grid(name, factor=1.0):
        return np.ascontiguousarray(np.stack([getattr(solution, name)(*at) for solution in solutions]) * factor, np.float32)

    table = table._replace(depth=nothing + math.inf, once=nothing, peak=nothing, base=nothing, crowded=True,
                           reflected=grid("reflection", at[0] + at[1]))
    if not table.free:
        return table
    straight = np.stack([solution.unscattered(_unscattered_at()) for solution in solutions])
    return table._replace(transmitted=grid("transmission"), mirrored=np.zeros_like(straight), straight=straight)


def _of_stacks(solutions, nodes: int, azimuths: int) -> SurfaceTable:
    """Of layers on each other: as if the first one were infinite and scattered as much once, what else there is in the grid; all
    that leaves below is in its own."""
    tops = [Solution(replace(solution.slab, under=None, depth=math.inf), solution.nodes, solution.cut, np.zeros((1, *2 * [
        solution.nodes.leaving])), np.zeros((1, *2 * [solution.nodes.leaving])), solution.albedo, solution.passed)
            for solution in solutions]
    table = _sampled(tops, 2, 2)
    scattered = -np.expm1(-2 * np.array([solution.slab.depth * solution.cut.shrinks if solution.slab.depth else 0.0
                                         for solution in solutions]))
    table = table._replace(once=table.once * scattered, peak=np.zeros(len(solutions)))
    parts, _ = layers(solutions[0].slab)
    thinnest, last = min(part.index for part in parts), float(parts[-1].index)
    mu = np.maximum(cosines(nodes, thinnest), _LEAST)
    at = np.broadcast_arrays(mu[:, None, None], mu[:, None], angles(azimuths))
    inner, inner0 = (fresnel.inside(cosine, table.index) for cosine in at[:2])
    turned = single.turned(inner, inner0, at[2], -1)
    grid = np.stack([solution.inside(*at) * (inner + inner0) for solution in solutions])
    for row, once, slab in zip(grid, table.once, (solution.slab for solution in solutions), strict=True):
        row -= once * 4 * math.pi * phase_at(slab.theta, slab.phase, turned)
    mirrored, passed, peaks = np.stack([unscattered(solution.slab, solution.cuts, _unscattered_at()) for solution in solutions],
                                       axis=1)
    table = table._replace(reflected=np.ascontiguousarray(grid, np.float32), mirrored=mirrored, straight=passed * (1 - peaks),
                           rooted=thinnest <= 1)
    if not free(solutions[0].slab):
        return table
    grid = np.stack([solution.transmission(*at) / solution.boundaries(*at[:2]) for solution in solutions])
    return table._replace(transmitted=np.ascontiguousarray(grid, np.float32), free=True, index_below=last)


def _unscattered_at():
    """Cosines (S,) at which unscattered light is told."""
    return np.maximum(cosines(_UNSCATTERED, 1.0), _LEAST)


def _grid(solution, orders, nodes: int, azimuths: int):
    """(K, K, P) float32 of the sum of Fourier orders at a grid's nodes."""
    rough = solution.slab.roughness > 0 and solution.slab.index != 1
    index = 1.0 if rough else solution.slab.index
    mu = cosines(nodes, index)
    weights = interpolation(solution.nodes.at, coordinate(mu, index))
    sines = np.sqrt((1 - mu) * (1 + mu)) / index
    falling = weights if rough else vanishing(weights, solution.nodes.air, mu)
    spans = [falling if m > 1 and m % 2 == 0 else weights for m in range(len(orders))]
    terms = np.stack([span @ order @ span.T for span, order in zip(spans, orders, strict=True)])
    terms[1:] *= 2
    terms[1::2] *= np.outer(sines, sines)
    waves = np.cos(np.arange(len(orders))[:, None] * angles(azimuths))
    return np.ascontiguousarray(np.tensordot(terms, waves, (0, 0)), np.float32)


def angles(azimuths: int):
    """(P,) rad, of a grid's nodes."""
    return 2 * np.arcsin(np.sqrt(spread(np.linspace(0, 1, azimuths))))


def spread(x):
    """What has a coordinate x of `look_up._crowded`."""
    return np.sin(0.25 * math.pi + np.arcsin((2 * np.asarray(x, float) - 1) * math.sqrt(0.5))) ** 2


def cosines(nodes: int, index: float):
    """(K,) cosines in air of the nodes of a grid; of those that an index below 1 reflects totally there are none."""
    s = 1 - (1 - np.linspace(0, 1, nodes)) ** 2
    return s if index > 1 else np.clip(fresnel.outside(s * s, index), 0, 1)
