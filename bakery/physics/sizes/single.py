"""Particles of one size."""

import math
from dataclasses import dataclass
from typing import ClassVar

from bakery.physics.sizes.law import Key, Law


@dataclass(frozen=True)
class Single(Law):
    """All particles have the same `radius` (um)."""

    name, words, cut, discrete = "single", "All particles have one radius.", False, True
    keys: ClassVar = {"radius": Key("Radius, such as 5 um.")}

    radius: float

    def moment(self, power, lower=0.0, upper=math.inf):
        return self.radius**power if lower <= self.radius <= upper else 0.0

    def reach(self):
        return self.radius, self.radius
