"""A distribution whose particles have all grown: by a factor, by a shell, or both."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bakery.physics.sizes.distributions import Part, Population
from bakery.physics.sizes.law import Key, Law
from bakery.physics.sizes.single import Single


@dataclass(frozen=True)
class Moved(Law):
    """The law of `factor` r + `shift` (um) where r has the law `of_dry`; factor > 0, shift >= 0."""

    name, words = "moved", "Radii that have grown."
    keys: ClassVar[dict[str, Key]] = {}

    of_dry: Law
    factor: float
    shift: float

    @property
    def bends(self):
        return tuple(self.factor * r + self.shift for r in self.of_dry.bends)

    def before(self, r):
        """The radius (um) from which r grew."""
        return (r - self.shift) / self.factor

    def density(self, r):
        """dn/dr, 1/um, at r (R,) um."""
        r = self.before(np.asarray(r, float))
        if self.of_dry.bends:
            # a limit of the law, mapped there and back, is off by its last bit
            low, high = self.of_dry.bends[0], self.of_dry.bends[-1]
            r = np.where(np.abs(r - low) < 1e-12 * low, low, np.where(np.abs(r - high) < 1e-12 * high, high, r))
        inside = r > 0
        return np.where(inside, self.of_dry.density(np.where(inside, r, 1.0)), 0.0) / self.factor

    def moment(self, power, lower=0.0, upper=math.inf):
        """Integral of r^power dn from `lower` to `upper`, um^power; with a shift of whole powers only."""
        lower, upper = max(self.before(lower), 0.0), self.before(upper)
        if upper <= lower:
            return 0.0
        if self.shift == 0:
            return self.factor**power * self.of_dry.moment(power, lower, upper)
        if power != int(power) or power < 0:
            raise ValueError(f"power {power:g}; moments of shifted radii are known of whole powers from 0 on")
        return math.fsum(math.comb(int(power), j) * self.shift ** (power - j) * self.factor**j
                         * self.of_dry.moment(j, lower, upper) for j in range(int(power) + 1))

    def reach(self):
        """Radii outside which neither the number nor the r^6-weighted density is visible to double precision."""
        low, high = self.of_dry.reach()
        return self.factor * low + self.shift, self.factor * high + self.shift


def moved(population: Population, factor: float, shift: float = 0.0) -> Population:
    """The population in which every radius has become factor r + shift (um)."""
    if factor == 1 and shift == 0:
        return population
    return Population(tuple(_part(part, factor, shift) for part in population.parts))


def _part(part: Part, factor, shift) -> Part:
    if part.law.discrete:
        return Part(Single(factor * part.law.radius + shift), part.share)
    lower = factor * part.lower + shift if part.lower > 0 else 0.0
    return Part(Moved(part.law, factor, shift), part.share, lower, factor * part.upper + shift)
