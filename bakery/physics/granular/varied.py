"""The medium of grains whose packing fraction and mixing ratios vary from place to place.

Eq. 4 of Meng et al. 2015 at a fraction f, for shares s_c of the number of grains, all of the same sizes:

    sigma_t = sum s_c beta_c / (void (1 - f)/f + sum s_c along_c),    along = (1 - beta) lambda_delta + beta albedo lambda_s

where void (1 - f)/f is the mean chord between spheres, exact whatever their arrangement.  Component c scatters in proportion to
s_c beta_c, with its own albedo and phase function.  The asset's sigma_t differs from Eq. 4 by a factor, which the order of dense
spheres makes: 1 + excess.  Where spheres are left out it is 1 + share excess, within 3.3 % (`python benchmarks/thinned.py`).
"""

from typing import NamedTuple

import numpy as np

from bakery.physics.granular.effective import mixed_of_sizes
from bakery.physics.granular.field import Field, between, uniform_field, value
from bakery.physics.medium.phase import with_delta
from bakery.system.compiled import njit


class Component(NamedTuple):
    """One kind of grain in a medium; lengths in one unit.

    hit_probability : beta
    along : (L,) of the formula above
    albedo : (L,);  phase : (L, A) 1/sr
    """

    hit_probability: float
    along: np.ndarray
    albedo: np.ndarray
    phase: np.ndarray


class Varied(NamedTuple):
    """Extinction of C components at L wavelengths that varies in space; lengths in the unit of a mesh.

    share : `Field` of the share of the spheres that is there;  mixture : of cumulated shares of components; empty: one component
    fraction : where all spheres are there
    void : mean chord between spheres over (1 - f)/f
    hits, along : (C, L) beta, and what of the mean path is in grains
    excess : (L,) of the extinction where all spheres are there
    most : upper bound of the extinction; 0: nothing varies, and this is not used
    """

    share: Field
    mixture: Field
    fraction: float
    void: float
    hits: np.ndarray
    along: np.ndarray
    excess: np.ndarray
    most: float


def unvaried_medium() -> Varied:
    """Of a homogeneous medium."""
    return Varied(uniform_field(), uniform_field(), 0.0, 0.0, np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1), 0.0)


def medium_component(theta, figures, radii, shares) -> Component:
    """A component of the grains' statistics.

    Parameters
    ----------
    theta : (A,) rad
    figures : name as in `effective.Means` -> (S, ...) over its sizes
    radii, shares : (S,) bounding radii, in whose unit lengths are; shares of the number
    """
    mixed = mixed_of_sizes([figures], [{name: np.zeros_like(x) for name, x in figures.items()}], [1.0], radii, shares)
    beta, albedo = mixed.hit_probability, np.clip(mixed.albedo, 0.0, 1.0)
    return Component(beta, (1 - beta) * mixed.lambda_delta + beta * albedo * mixed.lambda_s, albedo,
                     with_delta(theta, mixed.phase, mixed.forward_delta))


def whole_medium(hit_probability, sigma_t_mean_flight, void_chord, albedo, phase) -> Component:
    """All grains of a medium as one component, from sigma_t by Eq. 4 (L,) and the mean chord between its spheres."""
    return Component(hit_probability, hit_probability / sigma_t_mean_flight - void_chord, albedo, phase)


def extinction_at_fraction(void, fraction, hits, along, shares=(1.0,)):
    """sigma_t (L,) of the formula above at a fraction, 0 to 1; hits, along (C, L), shares (C,)."""
    shares = np.asarray(shares, float)
    return fraction * (shares @ hits) / (void * (1 - fraction) + fraction * (shares @ along))


def varied_medium(share, mixture, fraction, void, hits, along, excess) -> Varied:
    """Parameters as those of `Varied`."""
    densest = float(share.values.max()) if share.values.size else 1.0
    # more grains are more extinction; of mixtures, a quotient of two means, one component alone has the most
    most = np.maximum(1.0, 1.0 + densest * excess) * [extinction_at_fraction(void, fraction * densest, hits, along, single)
                                                      for single in np.eye(len(hits))]
    return Varied(share, mixture, fraction, void, hits, along, excess, float(most.max()))


@njit(cache=True, nogil=True, error_model="numpy")
def extinctions_at(varied, x, y, z, out):
    """Extinction of each component at a point: found (C, L), in the inverse unit of length."""
    hits, along, present = varied.hits, varied.along, 1.0
    count, waves = hits.shape
    if varied.share.values.size > 0:
        present = value(varied.share, between(varied.share, x, y, z), 0)
    fraction = varied.fraction * present
    where, before = between(varied.mixture, x, y, z) if count > 1 else (0, 0, 0, 0.0, 0.0, 0.0), 0.0
    for c in range(count):
        upto = value(varied.mixture, where, c) if c < count - 1 else 1.0
        for w in range(waves):
            out[c, w] = fraction * (upto - before)
        before = upto
    for w in range(waves):
        path = varied.void * (1.0 - fraction)
        for c in range(count):
            path += out[c, w] * along[c, w]
        for c in range(count):
            out[c, w] *= hits[c, w] * (1.0 + present * varied.excess[w]) / path
