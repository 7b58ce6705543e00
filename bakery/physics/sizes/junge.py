"""Junge's power law.

Source: Junge, J. Meteorol. 12, 13 (1955); moments from its definition.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bakery.physics.sizes.law import LENGTH, NUMBER, Key, Law


def power_integral(power, low, high):
    """Integral of r^(power - 1) from `low` to `high` (0 < low <= high), exact also where the power is near 0."""
    span = math.log(high / low)
    return low**power * (math.expm1(power * span) / power if abs(power) * span > 1e-300 else span)


@dataclass(frozen=True)
class Junge(Law):
    """dn/dlnr ~ r^-`exponent` from `min` to `max` (um): without both limits neither number nor volume would be finite."""

    name, words = "junge", "Power law of Junge, dn/dlnr ~ r^-exponent, between min and max."
    keys: ClassVar = {"exponent": Key("Exponent of dn/dlnr; that of dn/dr is larger by 1.", NUMBER, {"least": -10, "most": 20}),
                      "min": Key("Smallest radius.", LENGTH), "max": Key("Largest radius.", LENGTH)}

    exponent: float
    min: float
    max: float

    def __post_init__(self):
        if not 0 < self.min < self.max < math.inf:
            raise ValueError(f"min {self.min:g} um and max {self.max:g} um; a power law lies between two radii above 0")

    @property
    def bends(self):
        return self.min, self.max

    def density(self, r):
        """dn/dr, 1/um, at r (R,) um."""
        r = np.asarray(r, float)
        # relative to min: r^-exponent alone would overflow
        whole = power_integral(-self.exponent, 1.0, self.max / self.min)
        value = (r / self.min) ** -self.exponent / (whole * r)
        return np.where((r >= self.min) & (r <= self.max), value, 0.0)

    def moment(self, power, lower=0.0, upper=math.inf):
        """Integral of r^power dn from `lower` to `upper`, um^power; exact."""
        lower, upper = max(lower, self.min), min(upper, self.max)
        if lower >= upper:
            return 0.0
        whole = power_integral(-self.exponent, 1.0, self.max / self.min)
        return self.min**power * power_integral(power - self.exponent, lower / self.min, upper / self.min) / whole

    def reach(self):
        return self.min, self.max
