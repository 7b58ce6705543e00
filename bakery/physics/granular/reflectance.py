"""Reflectance and transmittance of packed grains to an error that is asked for: walks of a goniometer, smoothed by a medium's
plane layer.

Walks to the second order are cheap and walks to their end are dear; each kind goes on for as long as it is worth it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bakery.physics.grains.sphere import ball
from bakery.physics.grains.surface import DIELECTRIC
from bakery.physics.granular._goniometer import HITS, WALKS
from bakery.physics.granular.goniometer import BINS, CELLS, LEAST, REPLICATES, Goniometer, together
from bakery.physics.medium.phase import phase_at
from bakery.physics.surfaces.corrected import Factors
from bakery.physics.surfaces.fit import SHOWN, Fit, factors_of, kept_shares, lower_albedos, merged
from bakery.physics.surfaces.solution import Solution
from bakery.physics.tasks import in_turn

HITS_MAX = 1 << 32
_NARROW = 5  # slices of the phase angle, to 2 degrees, that are narrower than the steps of phase functions resolve
_FIRST = 1 << 11, 1 << 8  # walks of a replicate to begin with: to the second order, to their end
_MOST_MORE = 16  # times as many walks in a round
_SPARE = 1.01  # of the variance


@dataclass(frozen=True)
class Reflectance:
    """What light of one wavelength does."""

    factors: Factors  # as of `surfaces.corrected.Corrected`
    lossless: bool  # whether grains keep all light
    # albedo, albedo_error: (3, B) by order and bin of the root of the cosine of incidence, a polynomial through what was counted,
    # and the standard error of a bin's own count
    albedo: np.ndarray
    albedo_error: np.ndarray
    error: np.ndarray  # (A, U, V) relative standard error of the light in the cells of `SHOWN`
    achieved_error: float  # root mean square of that over the light of the walks, of both sides
    inside: float  # share of the higher orders that was still inside when its walks ended, and counts as leaving like late light
    below: "Reflectance | None" = None  # the same of light that leaves below; None where none does
    straight: np.ndarray | None = None  # (B,) share of the light of each bin of incidence that leaves below undeflected


@dataclass(frozen=True)
class Measured:
    """Of all wavelengths of a goniometer."""

    each: tuple[Reflectance, ...]  # one a channel
    hits: int
    walks: int
    # given_up, contradicted, cut: shares of the walks that ended so
    given_up: float
    contradicted: float
    cut: float
    reached: bool  # whether the error does not exceed the tolerance

    @property
    def achieved_error(self) -> float:
        return max(channel.achieved_error for channel in self.each)


def measured(goniometer: Goniometer, solutions: Sequence[Solution], tolerance: float, *, hits: int | None = None,
             map: Callable | None = None, report: Callable[[float, float], None] | None = None) -> Measured:
    """Walk until the reflectance is known.

    solutions : half space or layer of the medium that stands for the grains, for each channel of the goniometer
    tolerance : relative standard error of the reflectance in cells of `SHOWN`, root mean square weighted by their light
    hits : stop after about so many; 2^32 if not given
    map : `map(function, tasks)` returns [function(*task) for task in tasks]
    report : called with the share of the work that is done and the error reached so far

    The same bytes for any number of workers: what is walked follows from counts alone.
    """
    map, most = map or in_turn, HITS_MAX if hits is None else hits
    fits = [[Fit(solution, CELLS, BINS, LEAST, side, straight_back(goniometer, solution, c) if side < 0 else None)
             for side in (-1, 1)[:goniometer.sides]] for c, solution in enumerate(solutions)]
    done, new, sums, worst = [0, 0], list(_FIRST), [0.0, 0.0], 0
    while True:
        for kind in (0, 1):
            if new[kind]:
                sums[kind] = sums[kind] + goniometer.counted(new[kind], done[kind], kind == 1, map)
                done[kind] += new[kind]
        counts = together(goniometer, *sums)

        def fitted(c, counts=counts):
            return _reflectance(fits[c], counts, c, bool(goniometer.lossless[c]))

        # hits of a walk of either kind
        dear = [float(max(goniometer.unpacked(part).sums[:, HITS].sum() / (REPLICATES * number), 1.0))
                for part, number in zip(sums, done, strict=True)]
        total = counts[0].sums.sum(axis=0)
        channel, variance = fitted(worst)
        new = _additions(variance, done, dear, tolerance, most - total[HITS])
        ended = channel.achieved_error <= tolerance or not any(new)
        if ended:  # the others, which share its walks, are known about as well
            channels, variances = zip(*((channel, variance) if c == worst else fitted(c) for c in range(len(fits))), strict=True)
            worst = int(np.argmax([channel.achieved_error for channel in channels]))
            channel = channels[worst]
            new = _additions(variances[worst], done, dear, tolerance, most - total[HITS])
            ended = channel.achieved_error <= tolerance or not any(new)
        if report is not None:
            report(min(1.0, tolerance / max(channel.achieved_error, 1e-300)), channel.achieved_error)
        if ended:
            shares = (total[2:] / max(total[WALKS], 1.0)).tolist()
            return Measured(channels, int(total[HITS]), int(total[WALKS]), *shares, channel.achieved_error <= tolerance)


def straight_back(goniometer: Goniometer, solution: Solution, c: int):
    """The light of a smooth clear ball over that of the medium's phase function by slice of the phase angle, 1 but straight back;
    None where grains are others.

    A ring of rays goes straight back from balls of an index of 1.41 to 2, and around it the light grows as 1 over the phase
    angle: next to no walk goes there, and steps of the phase function of a degree hold 0.43 of it within 0.3 degrees.
    """
    grain = goniometer.grains[0]
    if (len(goniometer.grains) > 1 or grain.mesh is not None or grain.surface.kind != DIELECTRIC or grain.surface.roughness > 0
            or grain.surface.index == 1):
        return None
    at = np.arange(_NARROW + 1) / CELLS[0]
    figures = ball(grain.surface, goniometer.mu[0, [c]] * goniometer.radii.mean(), np.append(0.0, math.pi * (1 - at[::-1]**2)))
    light, slab = figures.phase[0, :0:-1], solution.slab
    smooth = phase_at(slab.theta, slab.phase, math.pi * (1 - (0.5 * (at[1:] + at[:-1]))**2))
    ratio = np.divide(light, smooth, out=np.ones(_NARROW), where=(light > 0) & (smooth > 0))
    return np.append(ratio, np.ones(CELLS[0] - _NARROW))


def _additions(variance, done, dear, tolerance: float, hits: float) -> list[int]:
    """Walks of a replicate that each kind should still make: least hits for the tolerance, no more than are left."""
    v, n, cost = np.array(variance), np.array(done, float), np.array(dear)
    # variance v n / N of either kind: N in proportion to sqrt(v n / cost) costs least
    root = np.sqrt(v * n * cost)
    wanted = np.sqrt(v * n / cost) * root.sum() * _SPARE / tolerance**2
    added = np.clip(np.ceil(wanted - n), 0, _MOST_MORE * n)
    needed = REPLICATES * float(added @ cost)
    return [int(number) for number in np.floor(added * min(1.0, max(hits, 0.0) / needed))] if needed else [0, 0]


def _reflectance(fits: Sequence[Fit], counts, c: int, lossless: bool):
    """What counts at each side say of channel c, and the variances that walks of either kind leave."""
    walks, through = counts[0].walks.sum(axis=0), counts[0].walks_through.sum(axis=0)
    deeper, straight = (part[:, c].sum(axis=0) for part in (counts[0].deeper, counts[0].straight))
    entered = np.stack([side.entered[:, :, c].sum(axis=0) for side in counts])
    later = entered[:, 2]
    # of grains that keep all light what leaves in higher orders at either side is all that lower ones left
    whole = later.sum(axis=0) if lossless else deeper
    kept = np.divide(later, whole, out=np.full(later.shape, 1 / len(counts) if lossless else 0.0), where=whole > 0)
    kept = kept_shares(fits[0], kept, lossless)
    passed = np.divide(straight, walks, out=np.zeros_like(straight), where=walks > 0)
    lower = np.stack([sum(lower_albedos(fit, part, walks)) for fit, part in zip(fits, entered, strict=True)])
    elsewhere = passed + lower.sum(axis=0) - lower
    parts, light, relative, misfit = [], [], [], []
    for side, fit in enumerate(fits):
        cells = counts[side].cells[:, :, c]
        factors, *of_cells = factors_of(fit, cells.sum(axis=0), entered[side], (walks, through), kept[side], elsewhere[side],
                                        _overdispersion(cells))
        parts.append((factors, of_cells[1], _spread(counts[side], c)))
        light.append([np.bincount(merged(CELLS, SHOWN), part) for part in of_cells[0]])
        relative.append(of_cells[2])
        misfit.append(of_cells[3])
    error, by_kind = _errors(*(np.concatenate(part, axis=1) for part in (light, relative, misfit)))
    achieved, inside = math.sqrt(sum(by_kind)), float(counts[0].inside[c])
    sides = [Reflectance(factors, lossless, albedo, scatter, noise.reshape(SHOWN), achieved, inside)
             for (factors, albedo, scatter), noise in zip(parts, np.split(error, len(parts)), strict=True)]
    if len(sides) == 1:
        return sides[0], by_kind
    return replace(sides[0], below=sides[1], straight=passed), by_kind


def _errors(by_order, relative, misfit):
    """Relative standard error in each of K cells, and by kind of walk the variance over the light of all cells; (3, K) light,
    relative variance and, which more walks would not make less, squared misfit by order."""
    whole, variance = by_order.sum(axis=0), np.minimum(relative, 1.0) * by_order**2
    # a cell's error counts by its light
    by_kind = [float(np.sum(np.divide(part, whole, out=np.zeros_like(whole), where=whole > 0)) / max(whole.sum(), 1e-300))
               for part in (variance[0] + variance[1], variance[2])]
    off = np.sqrt(sum(variance + misfit * by_order**2))
    return np.divide(off, whole, out=np.zeros_like(whole), where=whole > 0), by_kind


def _overdispersion(cells):
    """Variance (3, K) of the light in cells (R, 3, K) over that of as many walks that bring all or nothing, by order and slice of
    the phase angle, as walks that are aimed bring little each; where a slice has none, that of all."""
    slices = cells.reshape(*cells.shape[:2], CELLS[0], -1)
    total, variance = slices.sum(axis=(0, -1)), len(cells) * slices.var(axis=0, ddof=1).sum(axis=-1)
    whole = np.maximum(variance.sum(axis=1), 1e-300) / np.maximum(total.sum(axis=1), 1e-300)
    ratio = np.divide(variance, total, out=np.repeat(whole[:, None], CELLS[0], axis=1), where=total > 0)
    return np.repeat(np.clip(ratio, 1e-9, 10.0), slices.shape[-1], axis=1)


def _spread(counts, c: int):
    """Standard errors (3, B) of the albedos by the scatter of replicates."""
    entered = counts.entered[:, :, c]
    walks = np.stack([counts.walks, counts.walks, counts.walks_through], axis=1)
    albedos = np.divide(entered, walks, out=np.zeros_like(entered), where=walks > 0)
    return albedos.std(axis=0, ddof=1) / math.sqrt(len(albedos))

