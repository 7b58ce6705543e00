"""Reflectance of packed grains to an error that is asked for: walks of a goniometer, smoothed by a plane layer of the medium.

Walks to the second order are cheap and walks to their end are dear; each kind goes on for as long as it is worth it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bakery.physics.granular._goniometer import HITS, STEEPEST, WALKS
from bakery.physics.granular.goniometer import BINS, CELLS, REPLICATES, Goniometer, together
from bakery.physics.surfaces.corrected import SHOWN, Factors, Fit, factors_of, merged
from bakery.physics.surfaces.solution import Solution
from bakery.physics.tasks import in_turn

LEAST = math.sqrt(STEEPEST)
HITS_MAX = 1 << 32
_FIRST = 1 << 11, 1 << 8  # walks of a replicate to begin with: to the second order, to their end
_MOST_MORE = 16  # times as many walks in a round
_SPARE = 1.1  # of the variance


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
    achieved_error: float  # root mean square of that over the light of the walks
    inside: float  # share of the higher orders that was still inside when its walks ended, and counts as leaving like late light


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

    solutions : half space of the medium that stands for the grains, for each channel of the goniometer
    tolerance : relative standard error of the reflectance in cells of `SHOWN`, root mean square weighted by their light
    hits : stop after about so many; 2^32 if not given
    map : `map(function, tasks)` returns [function(*task) for task in tasks]
    report : called with the share of the work that is done and the error reached so far

    The same bytes for any number of workers: what is walked follows from counts alone.
    """
    map, most = map or in_turn, HITS_MAX if hits is None else hits
    fits = [Fit(solution, CELLS, BINS, LEAST) for solution in solutions]
    done, new, sums = [0, 0], list(_FIRST), [0.0, 0.0]
    while True:
        for kind in (0, 1):
            if new[kind]:
                sums[kind] = sums[kind] + goniometer.counted(new[kind], done[kind], kind == 1, map)
                done[kind] += new[kind]
        counts = together(goniometer, *sums)
        channels, variances = zip(*(_reflectance(fit, counts, c, bool(goniometer.lossless[c])) for c, fit in enumerate(fits)),
                              strict=True)
        worst = int(np.argmax([channel.achieved_error for channel in channels]))
        error, total = channels[worst].achieved_error, counts.sums.sum(axis=0)
        if report is not None:
            report(min(1.0, tolerance / max(error, 1e-300)), error)
        # hits of a walk of either kind
        dear = [float(max(goniometer.unpacked(part).sums[:, HITS].sum() / (REPLICATES * number), 1.0))
                for part, number in zip(sums, done, strict=True)]
        new = _additions(variances[worst], done, dear, tolerance, most - total[HITS])
        if error <= tolerance or not any(new):
            shares = (total[2:] / max(total[WALKS], 1.0)).tolist()
            return Measured(channels, int(total[HITS]), int(total[WALKS]), *shares, error <= tolerance)


def _additions(variance, done, dear, tolerance: float, hits: float) -> list[int]:
    """Walks of a replicate that each kind should still make: least hits for the tolerance, no more than are left."""
    v, n, cost = np.array(variance), np.array(done, float), np.array(dear)
    # variance v n / N of either kind: N in proportion to sqrt(v n / cost) costs least
    root = np.sqrt(v * n * cost)
    wanted = np.sqrt(v * n / cost) * root.sum() * _SPARE / tolerance**2
    added = np.clip(np.ceil(wanted - n), 0, _MOST_MORE * n)
    needed = REPLICATES * float(added @ cost)
    return [int(number) for number in np.floor(added * min(1.0, max(hits, 0.0) / needed))] if needed else [0, 0]


def _reflectance(fit: Fit, counts, c: int, lossless: bool):
    """What counts say of channel c, and the variances that walks of either kind leave."""
    cells, entered = counts.cells[:, :, c], counts.entered[:, :, c].sum(axis=0)
    walks, through = counts.walks.sum(axis=0), counts.walks_through.sum(axis=0)
    spread = _overdispersion(cells)
    deeper, later = (part[:, c].sum(axis=0) for part in (counts.deeper, counts.later))
    kept = np.ones(len(deeper)) if lossless else np.divide(later, deeper, out=np.zeros(len(deeper)), where=deeper > 0)
    factors, light, albedo, relative = factors_of(fit, cells.sum(axis=0), entered, (walks, through), kept, spread)
    by_order = np.stack([np.bincount(merged(CELLS, SHOWN), part) for part in light])
    whole, variance = by_order.sum(axis=0), np.minimum(relative, 1.0) * by_order**2
    # a cell's error counts by its light
    by_kind = [float(np.sum(np.divide(part, whole, out=np.zeros_like(whole), where=whole > 0)) / max(whole.sum(), 1e-300))
               for part in (variance[0] + variance[1], variance[2])]
    error = np.divide(np.sqrt(sum(variance)), whole, out=np.zeros_like(whole), where=whole > 0)
    return Reflectance(factors, lossless, albedo, _spread(counts, c), error.reshape(SHOWN), math.sqrt(sum(by_kind)),
                       float(counts.inside[:, c].mean())), by_kind


def _overdispersion(cells):
    """Variance of the light in cells (R, 3, K) over that of as many walks that bring all or nothing, by order."""
    total = cells.sum(axis=(0, 2))
    variance = len(cells) * cells.var(axis=0, ddof=1).sum(axis=-1)
    return np.clip(np.divide(variance, total, out=np.ones(3), where=total > 0), 0.01, 10.0)


def _spread(counts, c: int):
    """Standard errors (3, B) of the albedos by the scatter of replicates."""
    entered = counts.entered[:, :, c]
    walks = np.stack([counts.walks, counts.walks, counts.walks_through], axis=1)
    albedos = np.divide(entered, walks, out=np.zeros_like(entered), where=walks > 0)
    return albedos.std(axis=0, ddof=1) / math.sqrt(len(albedos))

