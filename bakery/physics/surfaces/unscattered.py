"""Light from air that a stack mirrors, or lets through, without scattering it: in single directions, at any angle.

Smooth boundaries keep n sin(theta), so that each layer takes exp(-depth / mu) and each boundary sends back Fresnel's share, again
and again (the sums are those of `adding` at its nodes).  Facets leave nothing unscattered.
"""

import math
from collections.abc import Sequence

import numpy as np

from bakery.physics.surfaces import fresnel
from bakery.physics.surfaces.cut import Cut
from bakery.physics.surfaces.slab import Reflector, Slab, facets_on, free, layers


def unscattered(slab: Slab, cuts: Sequence[Cut], mu) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shares of light from air at cosines mu (K,) above 0.

    Parameters
    ----------
    slab : the uppermost layer, of an index of 1 or more, under a smooth boundary or none
    cuts : of all layers, from the top

    Returns
    -------
    mirrored : (K,) below the uppermost boundary, whose own share is left out
    passed : (K,) what leaves below into air; 0 where nothing does
    peaks : (K,) optical depth along the light of the peaks that are cut off, which `mirrored` and `passed` hold unscattered
    """
    mu = np.asarray(mu, float)
    parts, bottom = layers(slab)
    mirrored, peaks = np.zeros(len(mu)), np.zeros(len(mu))
    passed = np.full(len(mu), float(free(slab)))
    index = 1.0 if free(slab) or isinstance(bottom, Reflector) else parts[-1].index  # below a layer
    for k, (part, without) in reversed(list(enumerate(zip(parts, cuts, strict=True)))):
        inner = fresnel.inside(mu, part.index)
        if k + 1 < len(parts) and facets_on(parts, k + 1):
            mirrored, index = np.zeros(len(mu)), part.index
        share = fresnel.between(part.index, inner, index, fresnel.inside(mu, index))
        mirrored, passed = share + _through(share, mirrored), passed * (1 - share) / (1 - share * mirrored)
        direct = np.exp(-(part.depth * without.shrinks if part.depth else 0.0) / inner)
        mirrored, passed, index = mirrored * direct**2, passed * direct, part.index
        if part.albedo * without.share and part.depth < math.inf:
            peaks = peaks + part.depth * part.albedo * without.share / inner
    share = fresnel.reflected(mu, index)
    return _through(share, mirrored), passed * (1 - share) / (1 - share * mirrored), peaks


def _through(share, mirrored):
    """What comes back through a boundary that mirrors a share, of what lies under it and mirrors too."""
    return (1 - share) ** 2 * mirrored / (1 - share * mirrored)
