"""Size distributions of spheres: moments, cuts, and quadrature nodes that refine level by level."""

from __future__ import annotations

from bakery.physics.sizes.distributions import Gamma, Lognormal, Population, Single, Table, population
from bakery.physics.sizes.nodes import Nodes, tails

__all__ = ["Gamma", "Lognormal", "Nodes", "Population", "Single", "Table", "population", "tails"]
