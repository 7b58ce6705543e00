"""The gamma law of Hansen and Travis.

Source: Hansen & Travis 1974, Space Sci. Rev. 16, 527.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bakery.physics.sizes.law import FRACTION, NARROW, Key, Law, positive
from bakery.physics.sizes.single import Single


@dataclass(frozen=True)
class Gamma(Law):
    """n(r) ~ r^((1-3b)/b) exp(-r/(a b)): effective `radius` a (um), effective `variance` 0 < b < 1/2.

    From b = 1/3 on the density no longer vanishes at r = 0; at b >= 1/2 it cannot be normalised.
    """

    name, words, widened_by = "gamma", "Gamma distribution of Hansen and Travis.", "variance"
    keys: ClassVar = {"radius": Key("Effective radius <r^3>/<r^2>."),
                      "variance": Key("Effective variance, below 1/3.", FRACTION, {"least": 1e-6, "below": 1 / 3}),
                      "effective_radius": Key("The same as radius.", instead_of="radius"),
                      "effective_variance": Key("The same as variance.", FRACTION, {"least": 1e-6, "below": 1 / 3}, "variance")}

    radius: float
    variance: float

    @classmethod
    def of(cls, size):
        radius, variance, effective_radius, effective_variance = (getattr(size, name, None) for name in cls.keys)
        radius = positive(effective_radius if radius is None else radius)
        variance = effective_variance if variance is None else variance
        if not 0 <= variance < 0.5:
            raise ValueError(f"variance {variance:g}; a gamma distribution can be normalised for 0 to below 0.5")
        return cls(radius, variance) if math.sqrt(variance) > NARROW else Single(radius)

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
        from scipy import special  # recipes are read without it

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
        from scipy import special  # as above

        low = max(float(special.gammaincinv(self.shape, 1e-18)), 1e-300)
        return low * self.scale, float(special.gammainccinv(self.shape + 6, 1e-18)) * self.scale
