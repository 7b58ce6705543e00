"""Fits of the factors of `corrected` to light that was counted by cells of pairs of directions.

The table of an order is a polynomial of the pair's coordinates through the counts; cells leave it where counts say so.
"""

import math
from copy import copy
from functools import lru_cache

import numpy as np

from bakery.physics.surfaces import pairs
from bakery.physics.surfaces.corrected import DEGREE, Factors, hemisphere, middles, shares
from bakery.physics.surfaces.solution import Solution

SHOWN = (12, 8, 8)  # cells whose errors are told
AROUND = (12, 4, 2)  # larger ones, than by whose counts no cell is known better
# of each order: cells of its table, fewer where its light is smooth, and levels of larger ones that leave the polynomial.  Those
# of 48, 8, 8 that left it made straight back 2.7 % off in root mean square beside 1.4 % (dark balls, 1 %), and nothing better
TABLES = ((48, 8, 8), SHOWN, SHOWN)
LEVELS = ((SHOWN, (48, 2, 2)), (SHOWN,), (SHOWN,))
# half, of the even polynomials along the coordinates of pairs.  Cells that were held to larger ones, not to these, kept 3 % of
# the light of beach sand from where its azimuth is 45 to 90 degrees
DEGREES = ((16, 4, 4), (6, 3, 3), (6, 3, 3))
_MIXED = 1.5  # of the shares of these degrees in a term, their sum at most
# of the mean factor: no polynomial falls below that where next to no light goes.  By 0.2 what passes a layer of dark balls 1.5
# radii thick was 20 % off in root mean square, 8 % by this, and up to 7 times too much where it grazes
_FAINTEST = 0.01
_BENT = 0.01  # times the squared degree of a term, by which it is held more; from 0.03 on narrow peaks of sparse grains are lost
_ROUNDS = 8  # of fits in turn to cells and to albedos
_LEAST_LIGHT = 1e-12  # of all: what a cell's misfit counts by at least
# variances of counts, beyond which a cell's own say that the cells around do not speak for it, and that the fit is off
_CONFLICT, _RESOLVED = 9.0, 1.0
_FEW = 8.0  # walks' worth of light by which a cell is held to the medium: what noise moves where next to none goes
_NARROW = 12  # slices of the phase angle, to 11 degrees, that the light of higher orders which goes straight back may fill
_POINTS = (1, 4, 3)  # of quadrature along the coordinates of a cell
_RIM = 64  # points along the second coordinate, which tell how much light enters in a cell


@lru_cache(maxsize=4)
def _entering(cells, least: float):
    """Pairs mu, mu0, phi (C, P) in cells, and what R counts by in the light of a walk, which enters at one of them.

    No walk enters below a cosine of least^2, and next to that light that enters does so most often.  Points that alone say which
    part of the cells at the rim that is missed 7 % of the light of an eighth of all: finer ones tell how much there is in each.
    """
    def light(points):
        mu, mu0, phi, weight = pairs.quadrature(cells, points)
        density = [np.where(into >= least**2, 0.5 / np.sqrt(np.maximum(into, 1e-300)) / (1 - least), 0.0) for into in (mu, mu0)]
        return mu, mu0, phi, weight * (mu * density[1] + mu0 * density[0]) / (2 * math.pi**2)

    (mu, mu0, phi, coarse), (*_, fine) = light(_POINTS), light((1, _RIM, _POINTS[2]))
    return mu, mu0, phi, coarse * (fine.sum(axis=1) / np.maximum(coarse.sum(axis=1), 1e-300))[:, None]


def forgotten(cells, least: float, entered, walks):
    """Light (R, K) in cells of walks that have forgotten where they entered, of which R replicates know how much leaves.

    By reciprocity R(mu, mu0) = L(mu) L(mu0) / int 2 mu L dmu, with L the share of the light that leaves so, a polynomial in the
    root of the cosine.  It is that of all walks; replicates differ from it in first order, as the light of their bins moves it.

    entered : (R, B) light that leaves so, by bin of entry;  walks : (R, B) of these
    """
    at, whole = middles(entered.shape[1], least), entered.sum(axis=0)
    if not whole.any():
        return np.zeros((len(entered), math.prod(cells)))
    x, weight = np.polynomial.legendre.leggauss(32)
    root = 0.5 * (1 + x)
    bins = np.concatenate([[whole / np.maximum(walks.sum(axis=0), 1.0)], entered / np.maximum(walks, 1.0)])
    for degree in (min(DEGREE, len(at) - 1), 0):  # a constant where too few walks are late for more: all of it may be below 0
        mean, *parts = np.linalg.lstsq(np.polynomial.legendre.legvander(2 * at - 1, degree), bins.T)[0].T
        flux = 4 * (root**3 * 0.5 * weight) @ np.polynomial.legendre.legvander(x, degree)  # int 2 mu L dmu over coefficients
        if flux @ mean > 0.1 * bins[0].mean():
            break
    mu, mu0, _, light = _entering(tuple(cells), least)
    outgoing, incident = (np.polynomial.legendre.legvander(2 * np.sqrt(cosine.ravel()) - 1, degree) for cosine in (mu, mu0))
    reflected, received, total = np.maximum(outgoing @ mean, 0), np.maximum(incident @ mean, 0), float(flux @ mean)

    def summed(values):
        return (light.reshape(-1, 1) * values).reshape(math.prod(cells), -1, values.shape[1]).sum(axis=1)

    value = summed((reflected * received)[:, None]) / total
    moves = summed(outgoing * received[:, None] + incident * reflected[:, None]) / total - value * flux / total
    return walks.sum(axis=1)[:, None] * (value.T + (np.stack(parts) - mean) @ moves.T)


def merged(cells, coarse):
    """Number of the coarse cell in which each cell lies."""
    index = np.meshgrid(*(np.arange(n) * m // n for n, m in zip(cells, coarse, strict=True)), indexing="ij")
    return np.ravel_multi_index(index, coarse).ravel()


def _worth(light, walks, to):
    """Walks that bring all or nothing by which light is as well known in the larger cells `to` (K,) of cells (K,), whose walks
    are given: all of it over the sum of its variances."""
    light = np.maximum(light, 1e-300)
    together, variance = (np.bincount(to, part) for part in (light, light / walks))
    return together / np.maximum(variance, 1e-300)


def _held(wanted, modelled, walks, kinds):
    """Inverse (K,) of the relative variance of cells about what larger ones say, beyond that of counts; infinite where none is
    beyond two standard errors, for few cells of few walks scatter by chance.

    It is one number for the cells of each kind; kinds : (K,) numbers from 0
    """
    counted = modelled * walks >= 1
    wanted, modelled = (np.where(counted, light, 0.0) for light in (wanted, modelled))
    chance = modelled / walks
    off = np.bincount(kinds, (wanted - modelled) ** 2 - chance) - 2 * np.sqrt(2 * np.bincount(kinds, chance**2))
    held = np.divide(np.bincount(kinds, modelled**2), off, out=np.full(len(off), math.inf), where=off > 0)
    return np.maximum(held, _FEW)[kinds]


def _disputed(wanted, modelled, walks):
    """The same of each cell (K,) by its own counts, which say so where they are three standard errors off; else infinite.

    Without that few cells that differ are held by many that do not: where shining balls hide what would come back, cells had up
    to 130 times their light, at a stated error of 7 %.
    """
    off = (wanted - modelled) ** 2 - _CONFLICT * modelled / walks
    return np.maximum(np.divide(modelled**2, off, out=np.full(len(off), math.inf), where=off > 0), 1.0)


def _degrees(degrees):
    """(3, P) of the polynomials in each of P terms; degrees : half the largest."""
    half = np.indices(np.add(degrees, 1)).reshape(3, -1)
    return 2 * half[:, (half / np.array(degrees)[:, None]).sum(axis=0) <= _MIXED]


@lru_cache(maxsize=8)
def _terms(cells, degrees):
    """Products (K, P) of even Legendre polynomials of the coordinates at the middles of cells, 1 first.

    Factors are smooth in the angles of `pairs`, and the same at either sign of the longitude and of the latitude: even.  Odd
    terms made straight back, where few walks go, 14 % off in root mean square beside 3 % (dark balls, fraction 0.6, 1 %).
    """
    along = [np.polynomial.legendre.legvander((np.arange(n) + 0.5) / n, 2 * degree)
             for n, degree in zip(cells, degrees, strict=True)]
    return np.einsum("ip,jp,kp->ijkp", *(part[:, of] for part, of in zip(along, _degrees(degrees), strict=True))).reshape(
        math.prod(cells), -1)


class Fit:
    """Fits `Factors` to counted light, of one medium.

    solution : of the medium's half space or layer
    cells : (3,) cells of what was counted
    bins, least : bins of the root of the cosine of incidence, from `least` to 1
    side : -1: of light that comes back, 1: that leaves below
    peak : (48,) what the first order's factors are before any count, by slice of the phase angle; 1 if None.  With it higher
        orders have a peak that is counted, and no slices leave the polynomial
    """

    def __init__(self, solution: Solution, cells, bins: int, least: float, side: int = -1, peak=None):
        self.tables, self.bins, self.least, self.solution = TABLES, bins, least, solution
        self.side, self.peak = side, peak
        mu, mu0, phi, light = (part.ravel() for part in _entering(tuple(cells), least))
        self.points, self.light = math.prod(_POINTS), light
        self.inward = middles(bins, least) ** 2
        out, azimuth, self.albedo_weight = hemisphere()
        shape = len(self.inward), len(out)
        at = [np.broadcast_to(a, shape).ravel() for a in (out, self.inward[:, None], azimuth)]
        self.sets = [self._prepared(*points) for points in ((mu, mu0, phi), at)]
        self.cells = cells

    def _prepared(self, mu, mu0, phi):
        """Shapes, where the pairs lie among cells and bins."""
        of_cells = {fine: pairs.interpolation(mu, mu0, phi, fine) for fine in set(self.tables)}
        once, *others = shares(self.solution, mu, mu0, phi if self.side < 0 else math.pi - phi, self.side)
        if self.peak is not None:
            once = once * pairs.by_slice(self.peak, of_cells[TABLES[0]], TABLES[0])
        return (once, *others), of_cells, [self._between(cosine) for cosine in (mu, mu0)]

    def _between(self, mu):
        """Bins and weight of the upper one, as `np.interp` takes them."""
        at = np.clip((np.sqrt(mu) - self.least) / (1 - self.least) * self.bins - 0.5, 0, self.bins - 1)
        low = np.minimum(at.astype(int), self.bins - 2)
        return low, at - low

    def _values(self, which: int, order: int, table, scale):
        """Light of an order at the points of a set."""
        shapes, of_cells, bins = self.sets[which]
        index, weight = of_cells[self.tables[order]]
        value = shapes[order] * np.einsum("kc,kc->k", table.take(index), weight)
        for low, up in bins:
            value = value * (scale[low] * (1 - up) + scale[low + 1] * up)
        return value

    def in_cells(self, order: int, table, scale):
        """Light of an order in each cell, of a walk."""
        return (self.light * self._values(0, order, table, scale)).reshape(-1, self.points).sum(axis=1)

    def albedo(self, order: int, table, scale):
        """Albedo of an order in the middle of each bin of incidence."""
        return self._values(1, order, table, scale).reshape(self.bins, -1) @ self.albedo_weight

    def narrowed(self, cells, walks):
        """This fit with a peak of higher orders straight back, as slices of the phase angle have it over what goes beside it.

        Light that another ball sends back to the one by which it entered leaves almost parallel.  cells, walks : as of `fitted`
        """
        light = self.in_cells(2, np.ones(math.prod(self.tables[2])), np.ones(self.bins))
        to, beside = merged(self.cells, (TABLES[0][0], 1, 1)), slice(_NARROW, 2 * _NARROW)
        wanted, modelled, worth = np.bincount(to, cells), np.bincount(to, light), _worth(light, walks, to)
        whole = wanted[beside].sum() / max(modelled[beside].sum(), 1e-300)
        peak = (worth * wanted + _FEW) / (worth * modelled * whole + _FEW)
        peak[_NARROW:] = 1.0
        peaked = copy(self)
        peaked.peak = peak
        peaked.sets = [((*lower, higher * pairs.by_slice(peak, of_cells[TABLES[0]], TABLES[0])), of_cells, bins)
                       for (*lower, higher), of_cells, bins in self.sets]
        return peaked

    def fitted(self, order: int, cells, albedo, walks):
        """Table and scale of an order, and of its light in the cells of `SHOWN` the relative variance (K,) and misfit (K,).

        cells : light in each cell, of a walk;  albedo : (B,) of each bin of incidence
        walks : that were counted, those that bring all or nothing; of all cells or (K,) of each

        A polynomial takes the light that was counted.  Then, level by level, each cell moves from what that and larger ones say
        by as much as its own counts are worth beside a number that is the inverse of the relative variance which they leave
        (empirical Bayes with a gamma distribution).
        """
        fine, walks = self.tables[order], np.broadcast_to(np.asarray(walks, float), len(cells))
        table, scale, variance = self._smooth(order, cells, albedo, walks)
        for level in LEVELS[order] if self.peak is None else (SHOWN,):
            to, of = merged(self.cells, level), merged(fine, level)
            light = self.in_cells(order, table, scale)
            wanted, modelled, worth = np.bincount(to, cells), np.bincount(to, light), _worth(light, walks, to)
            # light straight back is that of a slice or two, and says nothing of the others
            holds = _held(wanted, modelled, worth, merged(level, (1 if level == SHOWN else level[0], 1, 1)))
            if level == SHOWN:
                holds = np.minimum(holds, _disputed(wanted, modelled, worth))
                # the polynomial's counts as far as cells are held to it
                kept = 1 / (1 + worth * modelled / holds)
                variance = kept**2 * variance + 1 / (worth * modelled + holds)
            base, before = table, modelled
            free = np.isfinite(holds)
            for _ in range(_ROUNDS if free.any() else 0):
                ratio = np.bincount(of, table) / np.bincount(of, base)  # by which the cells of this level moved
                # cells are held to their light, not to their table: as scale took over what others' tables gave, slices lost half
                unit = modelled / ratio
                stays = np.divide(before, unit, out=np.ones(len(unit)), where=unit > 0)
                change = np.divide(worth * wanted + holds * stays, worth * unit + holds, out=stays, where=free)
                table = base * change[of]
                scale = self._scaled(order, table, scale, albedo)
                modelled = np.bincount(to, self.in_cells(order, table, scale))
        for _ in range(2 * _ROUNDS):
            scale = self._scaled(order, table, scale, albedo)
        misfit = self._misfit(cells, self.in_cells(order, table, scale), walks, variance)
        return table, scale, variance, misfit

    def _misfit(self, cells, light, walks, variance):
        """Squared relative error (K,) of the light of a fit that its variance leaves out.

        Where light ends within a cell, as that of shining balls does, the straight lines between middles do not follow: what they
        are off by beyond one standard error of counts.  And no cell is known better than by the counts of few around it.
        """
        to, around = merged(self.cells, SHOWN), merged(SHOWN, AROUND)
        wanted, modelled, worth = np.bincount(to, cells), np.bincount(to, light), _worth(light, walks, to)
        off = np.maximum((wanted - modelled) ** 2 - _RESOLVED * modelled / worth, 0.0)
        off /= np.maximum(modelled, max(_LEAST_LIGHT * modelled.sum(), 1e-150)) ** 2
        return np.maximum(off, 1 / (1 + np.bincount(around, worth * wanted)[around]) - variance)

    def _smooth(self, order: int, cells, albedo, walks):
        """The polynomial's table, the scale beside it, and the polynomial's relative variance in the cells of `SHOWN`.

        Least squares, by the variance of counts; its terms are held to 0 and its mean to that of all light, by a few walks', and
        more for higher degrees: straight back, dark balls by 4 % are 12 % off in root mean square, 16 % without.
        Where next to no light goes, as where both directions graze, its own variance holds it to the mean: it went astray there.
        """
        fine = self.tables[order]
        to, terms = merged(self.cells, fine), _terms(fine, DEGREES[order])
        table, scale, wanted = np.ones(len(terms)), np.ones(self.bins), np.bincount(to, cells)
        prior = _FEW * np.diag(1 + _BENT * (_degrees(DEGREES[order]) ** 2).sum(axis=0))
        for _ in range(_ROUNDS):
            light = self.in_cells(order, table, scale)
            unit_light = np.bincount(to, light) / table  # at a factor of 1
            worth, whole = _worth(light, walks, to), _worth(light, walks, 0 * to)[0]
            mean = (whole * wanted.sum() + _FEW) / (whole * unit_light.sum() + _FEW)
            weights = worth * unit_light / (worth * unit_light * table + 1)
            root = terms * np.sqrt(weights * (worth * unit_light))[:, None]
            held = prior / mean**2
            inverse = np.linalg.inv(root.T @ root + held)  # BLAS makes a half of such a product
            factors = inverse @ ((weights * worth * wanted) @ terms + mean * held[0])
            table = np.maximum(terms @ factors, _FAINTEST * mean)
            scale = self._scaled(order, table, scale, albedo)
        table, _ = self._kept(terms, factors, inverse, mean)
        return table, scale, self._kept(_terms(SHOWN, DEGREES[order]), factors, inverse, mean)[1]

    @staticmethod
    def _kept(terms, factors, inverse, mean: float):
        """The polynomial's table, held to its mean by its variance, and the relative variance of that table."""
        variance, raw = np.sum(terms @ inverse * terms, axis=1), terms @ factors
        held = 1 / (1 + variance / mean**2)
        table = mean + (np.maximum(raw, _FAINTEST * mean) - mean) * held
        return table, variance / np.minimum(table, mean) ** 2

    def _scaled(self, order: int, table, scale, albedo):
        """The scale after a step towards the albedo of each bin."""
        modelled = self.albedo(order, table, scale)
        change = np.divide(albedo, modelled, out=np.ones(self.bins), where=modelled > 0)
        # light that grazes in and out has the scale of its bin twice, other light once: the root settles either way
        return scale * np.sqrt(change)


def _smooth(at, albedo):
    """Polynomial in the root of the cosine through albedos of bins: what they scatter by is the walks' noise."""
    return np.maximum(np.polynomial.Polynomial.fit(at, albedo, min(DEGREE, len(at) - 1))(at), 0.0)


def kept_shares(fit: Fit, kept, lossless: bool):
    """Shares (S, B) of the light that no lower order brought out which leave at each side, without the scatter of bins; all of it
    where nothing is lost."""
    smooth = np.stack([_smooth(middles(fit.bins, fit.least), part) for part in kept])
    return smooth / np.maximum(smooth.sum(axis=0), 1e-300) if lossless else smooth


def lower_albedos(fit: Fit, entered, walks) -> list:
    """Albedos (B,) of the first and the second order without the scatter of bins, from sums (2 or more, B) over walks (B,)."""
    at = middles(fit.bins, fit.least)
    return [_smooth(at, np.divide(part, walks, out=np.zeros(len(walks)), where=walks > 0)) for part in entered[:2]]


def factors_of(fit: Fit, cells, entered, walks, kept, elsewhere=0.0, spread=(1.0, 1.0, 1.0)):
    """Factors from sums over walks, and what they make of the light.

    Parameters
    ----------
    cells : (3, K) light in cells by order;  entered : (3, B) by bin of entry
    walks : (B,) of the first two orders, and of the higher ones
    kept : (B,) of the light that no lower order brought out, the share that a higher one brings back (`kept_shares`): of clear
        grains hardly less than 1 in any walk, while whether a walk comes back in a lower order or a higher one is chance
    elsewhere : (B,) share of the light that lower orders, or none, brought out at the other side
    spread : variance of the light in cells, by order (and cell), over that of walks that bring all or nothing

    Returns
    -------
    Factors, (3, K) light of a walk in each cell, (3, B) albedos without the scatter of bins, and by order the relative variance
    of the light in the cells of `SHOWN`, and what no more walks would mend (`Fit._misfit`)
    """
    numbers = (walks[0], walks[0], walks[1])
    albedos = lower_albedos(fit, entered, walks[0])
    albedos.append(kept * np.maximum(1 - albedos[0] - albedos[1] - elsewhere, 0.0))
    tables, scales, light, variances, misfits = [], [], [], [], []
    for order, (part, n) in enumerate(zip(cells, numbers, strict=True)):
        part, n = part / max(n.sum(), 1.0), n.sum() / spread[order]
        of_order = fit.narrowed(part, n) if order == 2 and fit.peak is not None else fit
        table, scale, variance, misfit = of_order.fitted(order, part, albedos[order], n)
        light.append(of_order.in_cells(order, table, scale))
        table = table.reshape(fit.tables[order])
        peak = None if fit.peak is None or order == 1 else of_order.peak[:, None, None]
        tables.append(table if peak is None else pairs.finer(table, len(peak)) * peak)
        scales.append(scale)
        variances.append(variance)
        misfits.append(misfit)
    return (Factors(tuple(tables), np.stack(scales), fit.least), np.stack(light), np.stack(albedos), np.stack(variances),
            np.stack(misfits))
