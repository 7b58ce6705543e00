"""Size distributions of spheres: moments, cuts, and quadrature nodes that refine level by level."""

from bakery.physics.sizes.distributions import MIXTURE, Part, Population, laws, population, share_between
from bakery.physics.sizes.gamma import Gamma
from bakery.physics.sizes.histogram import Histogram
from bakery.physics.sizes.junge import Junge
from bakery.physics.sizes.lognormal import Lognormal
from bakery.physics.sizes.moved import moved
from bakery.physics.sizes.nodes import Nodes, tails
from bakery.physics.sizes.single import Single
from bakery.physics.sizes.table import Table

__all__ = ["MIXTURE", "Gamma", "Histogram", "Junge", "Lognormal", "Nodes", "Part", "Population", "Single", "Table", "laws",
           "moved", "population", "share_between", "tails"]
