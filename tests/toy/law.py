"""A small size distribution: all radii up to the largest are equally frequent."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bakery.physics.sizes.law import NUMBER, Key, Law


@dataclass(frozen=True)
class Uniform(Law):
    """dn/dr is constant from `smallest` times the radius to the radius."""

    name, words = "uniform", "All radii up to the largest are equally frequent."
    keys: ClassVar = {"radius": Key("Largest radius."), "smallest": Key("Over the largest.", NUMBER, {"above": 0, "below": 1})}

    radius: float
    smallest: float

    def density(self, r):
        low, high = self.reach()
        return np.where((r >= low) & (r <= high), 1 / (high - low), 0.0)

    def moment(self, power, lower=0.0, upper=np.inf):
        low, high = self.reach()
        a, b = max(low, lower), min(high, upper)
        return (b ** (power + 1) - a ** (power + 1)) / ((power + 1) * (high - low)) if a < b else 0.0

    def reach(self):
        return self.smallest * self.radius, self.radius
