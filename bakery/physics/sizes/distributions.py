"""What radii the particles have: number densities over the radius, their cuts, mixtures and exact moments.

Every law is normalised to one particle over its whole range, `dn/dr` in 1/um.  A `Population` is what a recipe describes:
laws with shares by number, each between a lower and an upper radius, renormalised after the cut.

Sources: Hansen & Travis 1974, Space Sci. Rev. 16, 527 (gamma law); moments of the log-normal law from its definition.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

_MONODISPERSE = 1e-9  # relative width below which sizes cannot be distinguished: phases change by < 1e-3 even at x = 1e6
_NOTHING = 1e-30  # share of a law between min and max below which nothing is said to be left
_GAUSS, _GAUSS_WEIGHT = np.polynomial.legendre.leggauss(5)  # exact to degree 9


@dataclass(frozen=True)
class Single:
    """All particles have the same `radius` (um)."""

    radius: float

    def moment(self, power, lower=0.0, upper=math.inf):
        return self.radius**power if lower <= self.radius <= upper else 0.0

    def reach(self):
        return self.radius, self.radius


@dataclass(frozen=True)
class Lognormal:
    """Normal in ln r: `radius` (um) is the median (= geometric mean), `sigma` > 1 the geometric standard deviation."""

    radius: float
    sigma: float

    def density(self, r):
        """dn/dr, 1/um, at r (R,) um."""
        width = math.log(self.sigma)
        t = np.log(r / self.radius) / width
        return np.exp(-0.5 * t * t) / (math.sqrt(2 * math.pi) * width * r)

    def moment(self, power, lower=0.0, upper=math.inf):
        """Integral of r^power dn from `lower` to `upper`, um^power; exact."""
        width = math.log(self.sigma)
        a, b = ((math.log(r / self.radius) / width if 0 < r < math.inf else math.copysign(math.inf, r - 1)) - power * width
                for r in (lower, upper))
        # in the upper tail both values of the normal integral round to 1: take it from the other side
        share = special.ndtr(-a) - special.ndtr(-b) if a > 0 else special.ndtr(b) - special.ndtr(a)
        return self.radius**power * math.exp(0.5 * (power * width) ** 2) * float(share)

    def reach(self):
        """Radii outside which neither the number nor the r^6-weighted density is visible to double precision."""
        width = math.log(self.sigma)
        return self.radius * math.exp(-9 * width), self.radius * math.exp(6 * width**2 + 9 * width)


@dataclass(frozen=True)
class Gamma:
    """n(r) ~ r^((1-3b)/b) exp(-r/(a b)): effective `radius` a (um), effective `variance` 0 < b < 1/2.

    From b = 1/3 on the density no longer vanishes at r = 0; at b >= 1/2 it cannot be normalised.
    """

    radius: float
    variance: float

    @property
    def shape(self):
        return (1 - 2 * self.variance) / self.variance

    @property
    def scale(self):
        return self.radius * self.variance

    def density(self, r):
        """dn/dr, 1/um, at r (R,) um."""
        k = self.shape
        y = np.asarray(r) / (k * self.scale)
        # relative to y = 1, where k (ln y - y + 1) vanishes: no difference of large numbers at small variance
        log_peak = k * math.log(k) - k - math.lgamma(k) if k < 1e6 else 0.5 * math.log(k / (2 * math.pi)) - 1 / (12 * k)
        log_y = np.where(y < 0.5, np.log(y), np.log1p(np.maximum(y - 1, -0.5)))
        return np.exp(k * (log_y - (y - 1)) + log_peak) / r

    def moment(self, power, lower=0.0, upper=math.inf):
        """Integral of r^power dn from `lower` to `upper`, um^power; exact."""
        k = self.shape
        complete = self.scale**power * math.prod(k + j for j in range(int(power)))
        if power != int(power):
            complete = self.scale**power * math.exp(math.lgamma(k + power) - math.lgamma(k))
        a, b = lower / self.scale, upper / self.scale
        p = k + power
        # each from the side where it is small
        if a > p:
            share = special.gammaincc(p, a) - special.gammaincc(p, b)
        else:
            share = special.gammainc(p, b) - special.gammainc(p, a)
        return complete * float(share)

    def reach(self):
        """Radii outside which neither the number nor the r^6-weighted density is visible to double precision."""
        low = max(float(special.gammaincinv(self.shape, 1e-18)), 1e-300)
        return low * self.scale, float(special.gammainccinv(self.shape + 6, 1e-18)) * self.scale


@dataclass(frozen=True)
class Table:
    """Piecewise linear in r between the rows of a table (linear in r, not in ln r), zero outside it.

    `radius` (um, ascending) and `value` (dn/dr in any unit, >= 0) are tuples of at least two entries.
    """

    radius: tuple[float, ...]
    value: tuple[float, ...]

    def __post_init__(self):
        r, v = np.asarray(self.radius, float), np.asarray(self.value, float)
        if len(r) < 2 or len(r) != len(v) or not (np.diff(r) > 0).all() or r[0] < 0 or not (v >= 0).all():
            raise ValueError("a size table needs two or more ascending radii >= 0 with densities >= 0")
        area = float(np.sum((v[1:] + v[:-1]) / 2 * np.diff(r)))
        if not 0 < area < math.inf:
            raise ValueError("a size table needs a density that is not zero everywhere")
        object.__setattr__(self, "_r", r)
        object.__setattr__(self, "_n", v / area)

    def density(self, r):
        """dn/dr, 1/um, at r (R,) um; at the table's ends the value from inside."""
        return np.interp(r, self._r, self._n, left=0.0, right=0.0)

    def moment(self, power, lower=0.0, upper=math.inf):
        """Integral of r^power dn from `lower` to `upper`, um^power; exact for whole powers up to 8."""
        lower, upper = max(lower, self._r[0]), min(upper, self._r[-1])
        if lower >= upper:
            return 0.0
        inside = self._r[(self._r > lower) & (self._r < upper)]
        edge = np.concatenate([[lower], inside, [upper]])
        half, middle = np.diff(edge)[:, None] / 2, (edge[1:] + edge[:-1])[:, None] / 2
        r = middle + half * _GAUSS
        return float(np.sum(half * _GAUSS_WEIGHT * self.density(r) * r**power))

    def reach(self):
        used = np.flatnonzero(self._n > 0)
        low = self._r[max(used[0] - 1, 0)]
        # ln r is the variable of integration: a table that starts at r = 0 is entered a billionth above it
        return max(low, 1e-9 * self._r[-1]), self._r[min(used[-1] + 1, len(self._r) - 1)]


@dataclass(frozen=True)
class Part:
    """One law between two radii (um) with its `share` of the number of particles."""

    law: Single | Lognormal | Gamma | Table
    share: float
    lower: float = 0.0
    upper: float = math.inf

    def moment(self, power, upper=math.inf):
        """Mean of r^power over this part's particles up to `upper`, um^power."""
        return self.law.moment(power, self.lower, min(self.upper, upper)) / self.law.moment(0, self.lower, self.upper)


@dataclass(frozen=True)
class Population:
    """The sizes of one component: parts whose shares of the particle number add up to 1."""

    parts: tuple[Part, ...]

    def moment(self, power):
        """Mean of r^power, um^power; exact."""
        return math.fsum(part.share * part.moment(power) for part in self.parts)

    @property
    def mean_volume(self):
        """Mean volume of a particle, um^3."""
        return 4 / 3 * math.pi * self.moment(3)

    @property
    def effective_radius(self):
        """<r^3>/<r^2>, um."""
        return self.moment(3) / self.moment(2)

    @property
    def single(self):
        """Whether all sizes are discrete, so that no quadrature is needed."""
        return all(isinstance(part.law, Single) for part in self.parts)

    def cumulative(self, r):
        """Share of the particles with radius <= r (um)."""
        return math.fsum(part.share * (part.moment(0, upper=r) if r > part.lower or isinstance(part.law, Single) else 0.0)
                         for part in self.parts)

    def quantile(self, q):
        """Smallest radius (um) below which a share q (0 < q < 1) of the particles lies; to 1e-12 relative."""
        reach = [part.law.reach() for part in self.parts]
        low = math.log(min(max(a, part.lower) for (a, _), part in zip(reach, self.parts))) - 1e-9
        high = math.log(max(min(b, part.upper) for (_, b), part in zip(reach, self.parts))) + 1e-9
        while high - low > 1e-12:
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            low, high = (low, middle) if self.cumulative(math.exp(middle)) >= q else (middle, high)
        return math.exp(high)


def population(size) -> Population:
    """The `Population` of a recipe's size (attributes as in docs/architecture.md, `Size`).

    Shares of a mixture count particles.  `min` and `max` cut the density and the rest is renormalised; on a mixture they cut
    the sum, so that the shares of what is left change.

    Raises
    ------
    ValueError : nothing is left between `min` and `max`, or a parameter is out of its range
    """
    pieces = _parts(size)
    total = math.fsum(weight for weight, *_ in pieces)
    return Population(tuple(Part(law, weight / total, low, high) for weight, law, low, high in pieces))


def _parts(size):
    """[(share, law, lower, upper)], shares adding up to 1 within this size."""
    low = 0.0 if size.min is None else float(size.min)
    high = math.inf if size.max is None else float(size.max)
    if size.distribution == "mixture":
        uncut = []
        for share, inner in size.of:
            pieces = _parts(inner)
            total = math.fsum(weight for weight, *_ in pieces)
            uncut += [(share * weight / total, *rest) for weight, *rest in pieces]
    else:
        uncut = [(1.0, _law(size), 0.0, math.inf)]
    cut = []
    for weight, law, lower, upper in uncut:
        before = law.moment(0, lower, upper)
        lower, upper = max(lower, low), min(upper, high)
        left = law.moment(0, lower, upper) if lower <= upper else 0.0
        if weight > 0 and left > _NOTHING:
            cut.append((weight * left / before, law, lower, upper))
    if not cut:
        raise ValueError(f"no particle has a radius between min = {low:g} um and max = {high:g} um; a wider interval would do"
                         + (", or distribution: single" if low == high else ""))
    return cut


def _law(size):
    kind, radius = size.distribution, size.radius
    if kind == "table":
        return Table(tuple(map(float, size.table[0])), tuple(map(float, size.table[1])))
    if not 0 < radius < math.inf:
        raise ValueError(f"radius {radius:g} um; a radius is above 0")
    if kind == "single":
        return Single(radius)
    if kind == "lognormal":
        if not 1 <= size.sigma <= 100:
            raise ValueError(f"sigma {size.sigma:g}; a geometric standard deviation lies between 1 and 100")
        return Lognormal(radius, size.sigma) if math.log(size.sigma) > _MONODISPERSE else Single(radius)
    if kind == "gamma":
        if not 0 <= size.variance < 0.5:
            raise ValueError(f"variance {size.variance:g}; a gamma distribution can be normalised for 0 to below 0.5")
        return Gamma(radius, size.variance) if math.sqrt(size.variance) > _MONODISPERSE else Single(radius)
    raise ValueError(f"unknown size distribution {kind!r}")
