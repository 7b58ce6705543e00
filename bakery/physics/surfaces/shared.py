"""Directions that several media share: nodes go by n sin(theta), which refraction by smooth boundaries keeps.

Nodes of light that a medium is too thin for (total reflection) come last.  Between two indices they are dense at the larger one,
where its medium grazes; what light does there is a polynomial of its own, as it has kinks at the critical angles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bakery.physics.surfaces import fresnel
from bakery.physics.surfaces.nodes import POWER, Nodes, grazing

_FEWEST = 8


class Side(NamedTuple):
    """Directions in one medium, as `rough.facets` takes them: cosines (K,), shares of the flux, and the nodes they belong to."""

    mu: np.ndarray
    flux: np.ndarray
    directions: Directions
    index: float

    def spans(self, mu):
        """Of cosines (Q,) in the medium, as `Directions.spans`."""
        return self.directions.spans(self.index, mu)


@dataclass(frozen=True)
class Directions:
    """Nodes that media of several indices share."""

    ends: tuple[float, ...]  # indices between which nodes lie, ascending from 0
    above: np.ndarray  # (K,) squared index at which the medium grazes that is next to the node
    cosine: np.ndarray  # (K,) times that index, its cosine there
    etendue: np.ndarray  # (K,) d(n^2 sin^2), share of a hemisphere of air
    at: np.ndarray  # (K,) coordinate between the ends, 0 to 1
    refracted: bool  # whether the first ones are dense nowhere, as light from air into a medium of a larger index is

    def mu(self, index: float):
        """Cosines in a medium, of those nodes that it has."""
        keep = self.above <= index * index
        return np.sqrt(index * index - self.above[keep] + self.cosine[keep] ** 2) / index

    def flux(self, index: float):
        """Shares of the flux of isotropic light in a medium."""
        return self.etendue[self.above <= index * index] / index**2

    def side(self, index: float) -> Side:
        """In one medium."""
        return Side(self.mu(index), self.flux(index), self, index)

    def top(self, index: float) -> Nodes:
        """In the medium under a smooth boundary to air."""
        mu, outside = self.mu(index), self.above == 1
        air = self.cosine[outside]
        mirrored = np.concatenate([fresnel.reflected(air, index), np.ones(len(mu) - len(air))])
        return Nodes(mu, self.flux(index), air, mirrored, self.at[outside], index)

    def spans(self, index: float, mu) -> Iterator[tuple]:
        """Of cosines (Q,) in a medium, those between each two indices (q of them), their nodes (k), coordinates (k,) and (q,).

        What is at them is the nodes' polynomial over the coordinates (`nodes.interpolation`).
        """
        above, pending = self.above[self.above <= index * index], np.arange(len(mu))
        for low, high in zip(self.ends, self.ends[1:]):
            squares = (high - index) * (high + index) + (index * mu[pending]) ** 2  # of the cosine in a medium of index `high`
            columns, within = np.flatnonzero(above == high * high), squares >= 0
            coordinate = np.minimum(np.sqrt(squares[within]) / (high * _limit(low, high)), 1.0)
            if low > 0 or not self.refracted:
                coordinate **= 1 / POWER
            yield pending[within], slice(columns[0], columns[-1] + 1), self.at[columns], coordinate
            pending = pending[~within]
            if high == index:
                return
        raise ValueError(f"no medium of index {index:g} has these nodes")


def _limit(low: float, high: float) -> float:
    """Cosine in a medium of index `high` below which light is totally reflected by one of index `low`."""
    return math.sqrt((1 - low / high) * (1 + low / high))


def directions(count: int, indices: Sequence[float], refracted: bool = False) -> Directions:
    """Nodes of media, `count` of them up to the lowest index.

    indices : of the media, and 1 where light of them goes to air or comes from there through smooth boundaries
    refracted : whether the uppermost medium has a smooth boundary to air, and an index above 1; all indices are 1 or more then
    """
    ends, parts = (0.0, *sorted(set(indices))), []
    for low, high in zip(ends, ends[1:]):
        limit = _limit(low, high)
        if low == 0 and refracted:
            x, weight = np.polynomial.legendre.leggauss(count)
            mu = at = 0.5 * (1 + x)
            weight = 0.5 * weight
        else:
            mu, weight, at = grazing(count if low == 0 else max(_FEWEST, math.ceil(count * limit)), limit)
        parts.append((np.full(len(mu), high * high), high * mu, 2 * mu * weight * high * high, at))
    return Directions(ends, *(np.concatenate(column) for column in zip(*parts, strict=True)), refracted)
