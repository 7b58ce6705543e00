"""The log-normal law.

Source: moments from its definition.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bakery.physics.sizes.law import DEVIATION, FRACTION, NARROW, Key, Law, positive
from bakery.physics.sizes.single import Single


@dataclass(frozen=True)
class Lognormal(Law):
    """Normal in ln r: `radius` (um) is the median (= geometric mean), `sigma` > 1 the geometric standard deviation."""

    name, words, widened_by = "lognormal", "ln r is normally distributed.", "sigma"
    keys: ClassVar = {"radius": Key("Geometric mean (= median) radius by number."),
                      "sigma": Key("Geometric standard deviation, above 1.", DEVIATION),
                      "effective_radius": Key("Effective radius <r^3>/<r^2>, without cuts.", instead_of="radius"),
                      # that of sigma = 10 is 199.7
                      "effective_variance": Key("Effective variance, without cuts; exp((ln sigma)^2) - 1.", FRACTION,
                                                {"least": 1e-6, "most": 199}, "sigma")}

    radius: float
    sigma: float

    @classmethod
    def of(cls, size):
        radius, sigma, effective_radius, effective_variance = (getattr(size, name, None) for name in cls.keys)
        if sigma is None:
            sigma = math.exp(math.sqrt(math.log1p(effective_variance)))
        if not 1 <= sigma <= 100:
            raise ValueError(f"sigma {sigma:g}; a geometric standard deviation lies between 1 and 100")
        if radius is None:
            radius = effective_radius * math.exp(-2.5 * math.log(sigma) ** 2)
        return cls(positive(radius), sigma) if math.log(sigma) > NARROW else Single(positive(radius))

    def density(self, r):
        """dn/dr, 1/um, at r (R,) um."""
        width = math.log(self.sigma)
        t = np.log(r / self.radius) / width
        return np.exp(-0.5 * t * t) / (math.sqrt(2 * math.pi) * width * r)

    def moment(self, power, lower=0.0, upper=math.inf):
        """Integral of r^power dn from `lower` to `upper`, um^power; exact."""
        from scipy import special  # recipes are read without it

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
