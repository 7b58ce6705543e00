"""A plane layer of a medium under a rough boundary, solved at nodes, and looked up at any angles.

What facets of the boundary reflect once is exact at every angle.  Light that comes out of the medium is smooth, and nothing is
taken out of it: facets turn light once more where it enters and where it leaves.
"""

from dataclasses import dataclass

import numpy as np

from bakery.physics.surfaces import rough
from bakery.physics.surfaces.adding import below, of_order
from bakery.physics.surfaces.cut import Cut, cut
from bakery.physics.surfaces.deep import ITERATED
from bakery.physics.surfaces.facets import boundaries, grids
from bakery.physics.surfaces.nodes import Nodes, interpolation, nodes
from bakery.physics.surfaces.slab import Slab, layers

_LEAST_NODES, _SPARE_NODES = 32, 8
_NEGLIGIBLE = 1e-3  # of the tolerance


@dataclass(frozen=True)
class Covered:
    """Reflection of a slab under facets: radiance out = (1 / pi) int R mu0 L0 dmu0 dphi; the BRDF is R / pi."""

    slab: Slab
    nodes: Nodes
    cuts: tuple[Cut, ...]  # of all layers, from the top
    reflected: np.ndarray  # (M, N, N) Fourier orders of all but what facets reflect once; odd ones over both sines
    albedo: np.ndarray  # (N,) share of light from the nodes' directions that comes back

    @property
    def cut(self) -> Cut:
        """Of the uppermost layer."""
        return self.cuts[0]

    @property
    def mirrored(self) -> np.ndarray:
        """Facets leave nothing that is mirrored."""
        return np.zeros_like(self.albedo)

    @property
    def passed(self) -> np.ndarray:
        return np.zeros_like(self.albedo)

    @property
    def spherical_albedo(self) -> float:
        return float(self.nodes.flux @ self.albedo)

    def reflection(self, mu, mu0, phi):
        """R at cosines in air above 0 and azimuths (0: forward).  Arguments broadcast."""
        mu, mu0, phi = np.broadcast_arrays(*(np.asarray(value, float) for value in (mu, mu0, phi)))
        if not (((mu > 0) & (mu <= 1)).all() and ((mu0 > 0) & (mu0 <= 1)).all()):
            raise ValueError("cosines of directions lie above 0 and do not exceed 1")
        (out, row), (into, column) = (np.unique(cosine, return_inverse=True) for cosine in (mu, mu0))
        out, into = (interpolation(self.nodes.at, np.sqrt(cosine)) for cosine in (out, into))
        result = rough.reflected(mu, mu0, phi, self.slab.index, self.slab.roughness)
        sines = np.sqrt((1 - mu * mu) * (1 - mu0 * mu0))
        for m, order in enumerate(self.reflected):
            term = np.einsum("...i,...i->...", (out @ order)[row.reshape(mu.shape)], into[column.reshape(mu.shape)])
            result += (2.0 if m else 1.0) * term * np.cos(m * phi) * (sines if m % 2 else 1.0)
        return result

    def factor(self, mu, mu0, side: int):
        """What the sum of Fourier orders counts by."""
        return np.ones(np.broadcast_shapes(np.shape(mu), np.shape(mu0)))

    def transmission(self, mu, mu0, phi):
        """0: under the layer is a base, or more of it."""
        return np.zeros(np.broadcast_shapes(*map(np.shape, (mu, mu0, phi))))


def covered(slab: Slab, moments, count: int, tolerance: float = 1e-6) -> Covered:
    """The slab with a given number of Legendre moments; arguments are those of `solution.solve`.

    Raises ValueError : air below
    """
    parts, bottom = layers(slab)
    cuts = tuple(cut(row, part.albedo, count) for row, part in zip(moments if slab.under else [moments], parts, strict=True))
    leaving = max(_LEAST_NODES, count + _SPARE_NODES)
    nets, air = grids(parts, bottom, leaving), nodes(leaving)
    shared, facets = [net.directions() for net in nets], boundaries(parts, nets, count)
    on_top = facets[0]
    root, missed = np.sqrt(air.flux), [np.zeros(len(net.mu(part.index))) for net, part in zip(shared, parts, strict=True)]
    sines = np.sqrt((1 - air.mu) * (1 + air.mu))
    orders, largest, small = [], [], 0
    for order in range(count):
        accuracy = ITERATED * tolerance * largest[0] if order else 0.0
        _, media = of_order(shared, parts, cuts, missed, order, accuracy)
        mirrored, scattered, _ = below(shared, parts, media, (bottom, facets), order)
        out = on_top.over(scattered + np.diag(mirrored), order)
        if order == 0:
            albedo = (out + on_top.above[0]) @ root / root
        share = root * sines if order % 2 else root
        orders.append(0.5 * (out + out.T) / np.outer(share, share))
        largest.append(float(np.abs(orders[-1]).max()))
        small = small + 1 if largest[-1] <= _NEGLIGIBLE * tolerance * largest[0] else 0
        if small == 2:
            break
    return Covered(slab, air, cuts, np.stack(orders), albedo)
