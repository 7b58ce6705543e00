"""Nodes of the layers of a stack: media between which boundaries are smooth share them, facets stand between the nodes of two."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from bakery.physics.surfaces import rough
from bakery.physics.surfaces.shared import Directions, directions
from bakery.physics.surfaces.slab import Reflector, Slab, facets_on, free


class Grid(NamedTuple):
    """Of media between which boundaries are smooth: arguments of `shared.directions`."""

    count: int
    indices: tuple[float, ...]
    refracted: bool = False

    def directions(self) -> Directions:
        return directions(*self)


def grids(parts: Sequence[Slab], bottom: Reflector | float | None, count: int) -> list[Grid]:
    """Of each layer, the nodes that it shares with those up to the next facets."""
    edges = [0, *(k for k in range(1, len(parts)) if facets_on(parts, k)), len(parts)]
    result = []
    for begin, end in zip(edges, edges[1:]):
        over_air = end == len(parts) and (free(parts[0]) or isinstance(bottom, Reflector))
        from_air = begin == 0 and not facets_on(parts, 0)
        indices = {part.index for part in parts[begin:end]} | ({1.0} if over_air or from_air else set())
        result += (end - begin) * [Grid(count, tuple(sorted(indices)), from_air and parts[0].index != 1)]
    return result


@lru_cache(maxsize=16)  # the same for all wavelengths and depths, of each number of moments (at most 28 MB)
def facets_between(above: Grid, index: float, below: Grid, index_below: float, roughness: float, orders: int) -> rough.Facets:
    """A rough boundary between the media of two indices."""
    sides = above.directions().side(index), below.directions().side(index_below)
    return rough.facets(*sides, index_below / index, roughness, orders)


def boundaries(parts: Sequence[Slab], nets: Sequence[Grid], orders: int) -> list[rough.Facets | None]:
    """Of each layer, the facets on top of it; None where there are none."""
    above = [(Grid(nets[0].count, (1.0,)), 1.0), *((net, part.index) for net, part in zip(nets, parts, strict=True))]
    return [facets_between(*above[k], nets[k], part.index, part.roughness, orders) if facets_on(parts, k) else None
            for k, part in enumerate(parts)]
