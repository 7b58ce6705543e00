"""A distribution counted in bins, as instruments give it."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bakery.physics.sizes.junge import power_integral
from bakery.physics.sizes.law import BINS, Key, Law


@dataclass(frozen=True)
class Histogram(Law):
    """In each bin what was counted is spread evenly over ln r; nothing outside.

    `edge` (B + 1,) um, ascending; `amount` (B,) >= 0 in any unit, of a bin, that of r^`power` (0: number, 2: surface, 3: volume):
    dn/dlnr ~ r^-power within a bin.
    """

    name, words = "histogram", "Numbers, surfaces or volumes in the bins of a CSV file."
    keys: ClassVar = {"file": Key("CSV file of bins: centres or edges, and dN, dN/dlnr, dV … (docs/recipes.md).", BINS)}

    edge: tuple[float, ...]
    amount: tuple[float, ...]
    power: float = 0.0

    @classmethod
    def of(cls, size):
        edge, amount, power = size.file
        return cls(tuple(map(float, edge)), tuple(map(float, amount)), float(power))

    def __post_init__(self):
        e, a = np.asarray(self.edge, float), np.asarray(self.amount, float)
        if len(a) < 1 or len(e) != len(a) + 1 or not (np.diff(e) > 0).all() or not e[0] > 0 or not (a >= 0).all():
            raise ValueError("a histogram needs ascending edges above 0, and an amount >= 0 in each bin")
        # dn/dlnr = c r^-power; relative to each bin's lower edge, where powers of small radii would overflow
        whole = np.array([power_integral(-self.power, 1.0, ratio) for ratio in e[1:] / e[:-1]])
        number = a / np.log(e[1:] / e[:-1]) * whole
        number *= (e[:-1] / e[-1]) ** -self.power if self.power else 1.0
        total = math.fsum(number)
        if not 0 < total < math.inf:
            raise ValueError("a histogram needs a bin that is not empty")
        object.__setattr__(self, "_e", e)
        object.__setattr__(self, "_share", number / total)
        object.__setattr__(self, "_whole", whole)

    @property
    def bends(self):
        return self.edge

    def density(self, r):
        """dn/dr, 1/um, at r (R,) um; at an edge that of the bin above it."""
        r = np.asarray(r, float)
        e, i = self._e, np.clip(np.searchsorted(self._e, r, side="right") - 1, 0, len(self.amount) - 1)
        value = self._share[i] / self._whole[i] * (r / e[i]) ** -self.power / r
        return np.where((r >= e[0]) & (r <= e[-1]), value, 0.0)

    def moment(self, power, lower=0.0, upper=math.inf):
        """Integral of r^power dn from `lower` to `upper`, um^power; exact."""
        parts = []
        for a, b, share, whole in zip(self.edge, self.edge[1:], self._share.tolist(), self._whole.tolist()):
            low, high = max(a, lower), min(b, upper)
            if share > 0 and low < high:
                parts.append(share * a**power * power_integral(power - self.power, low / a, high / a) / whole)
        return math.fsum(parts)

    def reach(self):
        used = np.flatnonzero(self._share > 0)
        return self.edge[used[0]], self.edge[used[-1] + 1]
