"""What radii the particles have: number densities over the radius, their cuts, mixtures and exact moments.

Every law is normalised to one particle over its whole range, `dn/dr` in 1/um.  A `Population` is what a recipe describes:
laws with shares by number, each between a lower and an upper radius, renormalised after the cut.
"""

import math
from dataclasses import dataclass

from bakery.physics.sizes.law import Law

LAWS = (
    "bakery.physics.sizes.single:Single",
    "bakery.physics.sizes.lognormal:Lognormal",
    "bakery.physics.sizes.gamma:Gamma",
    "bakery.physics.sizes.junge:Junge",
    "bakery.physics.sizes.histogram:Histogram",
    "bakery.physics.sizes.table:Table",
)
MIXTURE = "mixture"  # of laws: `of`, each with its `share`
_NOTHING = 1e-30  # share of a law between min and max below which nothing is said to be left


def laws() -> dict[str, type[Law]]:
    """Every declared law by its name."""
    from importlib import import_module

    places = (entry.partition(":") for entry in LAWS)
    return {law.name: law for law in (getattr(import_module(module), name) for module, _, name in places)}


@dataclass(frozen=True)
class Part:
    """One law between two radii (um) with its `share` of the number of particles."""

    law: Law
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
        return all(part.law.discrete for part in self.parts)

    def cumulative(self, r):
        """Share of the particles with radius <= r (um)."""
        return math.fsum(part.share * (part.moment(0, upper=r) if r > part.lower or part.law.discrete else 0.0)
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

    Raises ValueError : nothing is left between `min` and `max`, or a parameter is out of its range
    """
    pieces = _parts(size)
    total = math.fsum(weight for weight, *_ in pieces)
    return Population(tuple(Part(law, weight / total, low, high) for weight, law, low, high in pieces))


def _parts(size):
    """[(share, law, lower, upper)], shares adding up to 1 within this size."""
    low = 0.0 if size.min is None else float(size.min)
    high = math.inf if size.max is None else float(size.max)
    if size.distribution == MIXTURE:
        uncut = []
        for share, inner in size.of:
            pieces = _parts(inner)
            total = math.fsum(weight for weight, *_ in pieces)
            uncut += [(share * weight / total, *shape) for weight, *shape in pieces]
    else:
        uncut = [(1.0, _law(size), 0.0, math.inf)]
    cut = []
    for weight, law, lower, upper in uncut:
        before = law.moment(0, lower, upper)
        lower, upper = max(lower, low), min(upper, high)
        kept = share_between(law, lower, upper)
        if weight > 0 and kept:
            cut.append((weight * kept / before, law, lower, upper))
    if not cut:
        raise ValueError(f"no particle has a radius between min = {low:g} um and max = {high:g} um; a wider interval would do"
                         + (", or distribution: single" if low == high else ""))
    return cut


def share_between(law, lower, upper):
    """Share of a law's particles between two radii (um); 0 where it is too small to be computed."""
    near, far = law.reach()
    if lower > upper or not law.discrete and (lower >= far or upper <= near):
        return 0.0
    share = law.moment(0, lower, upper)
    return share if share > _NOTHING else 0.0


def _law(size):
    by_name = laws()
    if size.distribution not in by_name:
        raise ValueError(f"unknown size distribution {size.distribution!r}")
    return by_name[size.distribution].of(size)
