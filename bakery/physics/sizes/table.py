"""A tabulated distribution."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bakery.physics.sizes.law import COLUMNS, Key, Law

_GAUSS, _GAUSS_WEIGHT = np.polynomial.legendre.leggauss(5)  # exact to degree 9


@dataclass(frozen=True)
class Table(Law):
    """Piecewise linear in r between the rows of a table (linear in r, not in ln r), zero outside it.

    `radius` (um, ascending) and `value` (dn/dr in any unit, >= 0) are tuples of at least two entries.
    """

    name, words = "table", "Number density from a CSV file."
    keys: ClassVar = {"file": Key("CSV file with the columns radius_um and dn/dr (any scale).", COLUMNS)}

    radius: tuple[float, ...]
    value: tuple[float, ...]

    @classmethod
    def of(cls, size):
        return cls(*(tuple(map(float, column)) for column in size.file))

    @property
    def bends(self):
        return self.radius

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
