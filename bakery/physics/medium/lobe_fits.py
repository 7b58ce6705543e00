"""Best mixtures of one or two lobes for a phase function that is given as a table.

What is minimised is the share of the scattered light that goes to another angle, half of the integral of |fit - table| over the
sphere.  It is what a single scattering gets wrong, it is bounded however high a peak is, and for given shapes of the lobes the
best weight is a weighted median: exact, without a search.  A search over the shapes remains: a scan of a fixed grid, then
Nelder-Mead from its best places; nothing is random.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.medium.lobes import PUBLISHED, Lobes, Misfit, draine, draine_mean_cosine, misfit, published, quadrature
from bakery.physics.medium.phase import mean_cosine, phase_at, steps

NARROWEST = 1e-8  # 1 - |g|
# alpha.  A lobe is darker by 1 + alpha at 90 degrees than without: large values put a dark ring there, which is next to no light.
# Without a bound drizzle and cirrus took 1e4 and were up to 88 times too dark; this one costs them 0.05 to 0.2 % of the light.
LARGEST = 30.0
GAIN = 1e-4  # of the light: what a further parameter must save; tables are not known better than that
CELLS = 4000  # of a table that the search looks at; what is reported is measured on all
_FLATTEST = math.log1p(LARGEST)
_SCAN = 0.4  # step of atanh g
_STARTS = 3


@dataclass(frozen=True)
class Fit:
    """A mixture, its misfit, and the droplet diameter (um) that its parameters were computed from, if any."""

    lobes: Lobes
    misfit: Misfit
    diameter: float | None = None


def fits(theta, phase, diameter: float | None = None) -> dict[str, Fit]:
    """Mixtures for one phase function, by name.

    theta, phase : (A,) rad, 1/sr; linear in cos theta, integrates to 1 over the sphere
    diameter : um, of water droplets in air: adds the published parametrisation

    Returns fits : hg_g (the table's mean cosine), hg2_moments (its first three Legendre moments, where two lobes have them),
        hg2_g, hg_draine_g (its mean cosine, else least misdirected light); hg, draine, hg2, hg_draine (least misdirected light);
        hg_draine_published (for `diameter`, where the parametrisation reaches), hg_draine_published_best (for the diameter that
        misdirects least).  A kind that holds another is never worse.

    |g| <= 1 - 1e-8, alpha <= 30.  A lobe or an alpha that saves less than 1e-4 of the light is left out.
    """
    search = _Search(theta, phase)
    g = float(np.clip(mean_cosine(theta, phase), NARROWEST - 1, 1 - NARROWEST))
    same, hg = Lobes((1.0,), (g,), (0.0,)), search.one_hg()
    draine_one = search.one_draine(hg)
    two, two_g = search.two([hg], None), search.two([same], g)
    mixtures = {"hg_g": same, "hg": hg, "draine": draine_one, "hg2_moments": matched(theta, phase), "hg2": two, "hg2_g": two_g,
                "hg_draine": search.two_draine([hg, draine_one, two], None), "hg_draine_g": search.two_draine([same, two_g], g)}
    fitted = {name: Fit(lobes, misfit(theta, phase, lobes)) for name, lobes in mixtures.items() if lobes is not None}
    if diameter is not None:
        for name, size in (("hg_draine_published", diameter), ("hg_draine_published_best", search.diameter())):
            if PUBLISHED[0] < size <= PUBLISHED[1]:
                fitted[name] = Fit(published(size), misfit(theta, phase, published(size)), size)
    return fitted


def best_hg(theta, phase, steepest: float = 1 - NARROWEST) -> float:
    """g of the single HG lobe with |g| <= steepest that misdirects least of a phase function; arguments as of `fits`."""
    return _Search(theta, phase, steepest).one_hg().g[0]


def hg_draine(theta, phase, steepest: float = 1 - NARROWEST) -> Lobes:
    """The fit hg_draine_g of `fits` alone, for a program that takes |g| <= steepest; arguments as of `fits`."""
    search = _Search(theta, phase, steepest)
    g = float(np.clip(mean_cosine(theta, phase), -steepest, steepest))
    same = Lobes((1.0,), (g,), (0.0,))
    return search.two_draine([same, search.two([same], g)], g)


def matched(theta, phase) -> Lobes | None:
    """Two HG lobes with the first three Legendre moments of a table; None where there are none.

    The n-th Legendre moment of HG is g^n, so weights and g are the two-point Gauss rule of the moments 1, <P1>, <P2>, <P3>.
    In q = 1 - g, whose moments are integrals of small polynomials of v = 1 - cos theta, peaks keep their digits.
    """
    theta, phase = np.asarray(theta, float), np.asarray(phase, float)
    v = 2 * np.sin(theta / 2) ** 2
    middle, half = (v[1:] + v[:-1]) / 2, steps(theta) / 2
    q1 = q2 = q3 = 0.0
    for x, weight in ((-math.sqrt(0.6), 5 / 9), (0.0, 8 / 9), (math.sqrt(0.6), 5 / 9)):  # exact up to the fifth power
        at = middle + x * half
        light = 2 * math.pi * weight * half * ((phase[1:] + phase[:-1]) / 2 + x * (phase[1:] - phase[:-1]) / 2)
        q1 += np.sum(light * at)
        q2 += np.sum(light * (1.5 * at**2 - at))
        q3 += np.sum(light * (2.5 * at**3 - 3 * at**2))
    variance = q2 - q1**2
    if not variance > 1e-12:
        return None
    # the nodes are the zeros of q^2 - b q + c, which is orthogonal to 1 and q
    b = (q3 - q1 * q2) / variance
    c = b * q1 - q2
    root = math.sqrt(max(b * b / 4 - c, 0.0))
    low, high = float(b / 2 - root), float(b / 2 + root)
    if not NARROWEST <= low <= q1 <= high <= 2 - NARROWEST or low == high:
        return None
    weight = float((high - q1) / (high - low))
    return Lobes((weight, 1 - weight), (1 - low, 1 - high), (0.0, 0.0))


class _Search:
    """One table, sampled for the search; the shape of a lobe is atanh g and, for Draine's, log(1 + alpha)."""

    def __init__(self, theta, phase, steepest: float = 1 - NARROWEST):
        self.steepest = math.atanh(steepest)
        self.at, self.solid = quadrature(theta, CELLS)
        self.table = phase_at(theta, phase, self.at)
        self.grid = np.linspace(-self.steepest, self.steepest, 2 * math.ceil(self.steepest / _SCAN) + 1)
        self.rows = np.array([draine(self.at, *self._shape(u)) for u in self.grid])

    def one_hg(self) -> Lobes:
        """The best single HG lobe."""
        return _single(self._shape(_bounded(lambda u: self._misdirected(draine(self.at, *self._shape(u))),
                                            np.linspace(-self.steepest, self.steepest, 4 * len(self.grid) + 1))))

    def one_draine(self, start: Lobes) -> Lobes:
        """The best single lobe of Draine's; the `known` one where it is as good."""
        def loss(point):
            return self._misdirected(draine(self.at, *self._shape(*point)))

        starts = [(loss(point), point) for point in ((u, a) for u in self.grid for a in _ALPHAS)]
        point, least = _refined(loss, starts)
        return _single(self._shape(*point)) if least < self._misdirected(start(self.at)) - GAIN else start

    def two(self, start, g) -> Lobes:
        """The best pair of HG lobes, with the mean cosine g if one is given; never worse than the `known` ones."""
        starts = []
        for i, u in enumerate(self.grid[1:], 1):
            _, loss = self._mixtures(self.rows[i], self.rows[:i], self._shape(u), [self._shape(v) for v in self.grid[:i]], g)
            starts += [(value, (u, v)) for v, value in zip(self.grid, loss.tolist(), strict=False)]
        return self._pair(starts, start, g)

    def two_draine(self, start, g) -> Lobes:
        """The best pair of an HG and a Draine lobe, likewise."""
        starts, coarse = [], self.grid[::2]
        shapes = [self._shape(u) for u in coarse]
        for a in _ALPHAS:
            for u in coarse:
                _, loss = self._mixtures(draine(self.at, *self._shape(u, a)), self.rows[::2], self._shape(u, a), shapes, g)
                starts += [(value, (v, u, a)) for v, value in zip(coarse, loss.tolist(), strict=True)]
        for lobes in start:
            if len(lobes.g) == 2:  # the pair of HG lobes, the second as Draine's, and the first
                u, v = np.arctanh(lobes.g).tolist()
                starts += [(-1.0, (u, v, 0.1)), (-1.0, (v, u, 0.1))]
        return self._pair(starts, start, g)

    def diameter(self) -> float:
        """The diameter (um) whose published parameters misdirect least."""
        low, high = PUBLISHED

        def size(log):
            return round(min(max(math.exp(log), 1.001 * low), high), 4)

        return size(_bounded(lambda log: self._misdirected(published(size(log))(self.at)),
                             np.linspace(math.log(low), math.log(high), 200)))

    def _shape(self, u, a=0.0) -> tuple[float, float]:
        """g and alpha within their bounds."""
        return math.tanh(min(max(u, -self.steepest), self.steepest)), math.expm1(min(max(a, 0.0), _FLATTEST))

    def _misdirected(self, fit):
        """(...,) of fits (..., N)."""
        return 0.5 * np.sum(self.solid * np.abs(fit - self.table), axis=-1)

    def _mixtures(self, first, others, shape, shapes, g):
        """Best weights (J,) of a lobe (N,) beside each of others (J, N), and what they misdirect; infinite where none has g."""
        if g is None:
            weight = self._median(first, others)
        else:
            mean, means = draine_mean_cosine(*shape), np.array([draine_mean_cosine(*candidate) for candidate in shapes])
            difference = mean - means
            weight = np.divide(g - means, difference, out=np.full_like(difference, np.nan), where=difference != 0)
        possible = (weight >= 0) & (weight <= 1)
        loss = self._misdirected(others + np.where(possible, weight, 0.0)[:, None] * (first - others))
        return weight, np.where(possible, loss, np.inf)

    def _median(self, first, others):
        """The weights in [0, 1] that misdirect least: the sum of solid |a - b| |w - (f - b)/(a - b)| is least at the weighted
        median of the ratios."""
        difference = first - others
        ratio = np.divide(self.table - others, difference, out=np.zeros_like(difference), where=difference != 0)
        order = np.argsort(ratio, axis=-1)
        heavy = np.cumsum(np.take_along_axis(self.solid * np.abs(difference), order, -1), axis=-1)
        at = np.argmax(heavy >= 0.5 * heavy[:, -1:], axis=-1)[:, None]
        return np.clip(np.take_along_axis(ratio, np.take_along_axis(order, at, -1), -1)[:, 0], 0.0, 1.0)

    def _pair(self, starts, start, g) -> Lobes:
        """Refines a pair (atanh g, atanh g, log(1 + alpha) of the second)."""
        def mixture(point):
            shapes = self._shape(point[0]), self._shape(*point[1:])
            weight, loss = self._mixtures(draine(self.at, *shapes[0]), draine(self.at, *shapes[1])[None], *shapes[:1], shapes[1:],
                                          g)
            return shapes, float(weight[0]), float(loss[0])

        simpler = min(start, key=lambda lobes: self._misdirected(lobes(self.at)))
        point, loss = _refined(lambda point: min(mixture(point)[2], 2.0), starts)  # 2: above any share, where g is out of reach
        if loss > self._misdirected(simpler(self.at)) - GAIN:
            return simpler
        shapes, weight, _ = mixture(point)
        return Lobes((weight, 1 - weight), *zip(*shapes, strict=True))


_ALPHAS = tuple(math.log1p(alpha) for alpha in (1.0, 4.0, 12.0, LARGEST))


def _single(shape) -> Lobes:
    return Lobes((1.0,), shape[:1], shape[1:])


def _bounded(loss, grid) -> float:
    """Where a function of one variable is least: the best of a grid, refined between its neighbours."""
    from scipy.optimize import minimize_scalar

    best = int(np.argmin([loss(x) for x in grid]))
    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    minimum = minimize_scalar(loss, bounds=bounds, method="bounded", options={"xatol": 1e-10})
    return float(min((minimum.x, grid[best]), key=loss))


def _refined(loss, starts):
    """The least place and value from the best few starts (value, point) that are no neighbours; the winner is started again."""
    from scipy.optimize import minimize

    options = {"xatol": 1e-6, "fatol": 1e-9, "maxiter": 1000}
    chosen: list = []
    for _, point in sorted(starts):
        if len(chosen) < _STARTS and all(max(abs(a - b) for a, b in zip(point, candidate, strict=True)) > 1.5 * _SCAN
                                         for candidate in chosen):
            chosen.append(point)
    best = min((minimize(loss, point, method="Nelder-Mead", options=options) for point in chosen), key=lambda fit: fit.fun)
    best = minimize(loss, best.x, method="Nelder-Mead", options=options)
    return best.x.tolist(), float(best.fun)
