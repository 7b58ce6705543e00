"""Colours of a matt base and of a wide glossy lobe by the angle of view, for programs whose lobes have fixed shapes.

Such a program (Cycles) scales its lobes by the direction that is looked from.  Two curves over its angle bring the brightness in
even light at every angle, and the lobe, GGX without Fresnel, brings the light that goes forward.
"""

from typing import NamedTuple

import numpy as np

from bakery.physics.surfaces.principled import Sampled

ALPHAS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0)  # of the lobe; the best is taken
COSINES = np.linspace(0, 1, 24)**2  # stops, denser where it grazes; colour ramps of Blender have at most 32
_SEEN_FROM = np.maximum(COSINES, 0.002)
_SHARES = np.linspace(0, 1, 41)


class ByView(NamedTuple):
    """Two curves, linear over the cosine between stops, and their error, which has the measures of `principled.Principled`."""

    cosine: np.ndarray  # (K,) stops, ascending
    # (3, K) linear colours, 0 to 1, of the base, which is under the boundary, and of the lobe beside it
    base: np.ndarray
    lobe: np.ndarray
    alpha: float  # of the lobe
    misdirected: np.ndarray  # (3,)
    brightness_error: np.ndarray  # (3, A)
    albedo_error: np.ndarray  # (3, A)

    def better_than(self, fit) -> bool:
        """Whether a tenth less light of each colour is misdirected than by a `Principled`, and errors at angles are less."""
        return bool(np.all(self.misdirected < 0.9 * fit.misdirected)) and \
            np.linalg.norm([self.brightness_error, self.albedo_error]) < np.linalg.norm([fit.brightness_error, fit.albedo_error])


def lobe(mu, mu0, phi, alpha: float):
    """pi times the BRDF of facets that reflect all light once (GGX); phi as of `asset.surface.reflectance`.

    Source: Walter et al. 2007, with Smith's shadowing of both directions by the height of a facet, as Cycles has it.
    """
    squared = alpha * alpha
    cosine = mu * mu0 - np.sqrt((1 - mu * mu) * (1 - mu0 * mu0)) * np.cos(phi)
    half = (mu + mu0)**2 / (2 + 2 * cosine)
    shadowed = sum(a * np.sqrt(squared + (1 - squared) * b * b) for a, b in ((mu, mu0), (mu0, mu)))
    return squared / (1 + half * (squared - 1))**2 / (2 * shadowed)


def by_view(layer: Sampled) -> ByView:
    """The curves of a layer and the best lobe.

    At each stop the brightness in even light is the layer's, unless colours of 1 are too dark for it, and the lobe's share of it
    is the one that misdirects least.
    """
    values, passed = layer.seen_from(_SEEN_FROM)
    albedo = layer.bright(values)

    def curves(alpha):
        shape = lobe(*layer.at(_SEEN_FROM), alpha)
        bright = layer.bright(shape)
        least, share = np.full(albedo.shape, np.inf), np.zeros(albedo.shape)
        for part in _SHARES:
            mixture = (1 - part) + part * shape / bright[:, None, None]
            off = layer.bright(np.abs(albedo[:, :, None, None] * mixture - values))
            # a colour above 1 is the last choice
            off += 9 * (np.maximum(albedo * (1 - part) - passed, 0) + np.maximum(albedo * part - bright, 0))
            share, least = np.where(off < least, part, share), np.minimum(off, least)
        base = np.clip(albedo * (1 - share) / np.maximum(passed, 1e-9), 0, 1)
        return base, np.clip(albedo * share / bright, 0, 1)

    def judged(alpha):
        colours = curves(alpha)
        base, glossy = (np.stack([np.interp(layer.mu, COSINES, row) for row in rows])[:, :, None, None] for rows in colours)
        off = base * layer.passed[:, None, None] + glossy * lobe(*layer.at(layer.mu), alpha) - layer.values
        return ByView(COSINES, *colours, alpha, layer.misdirected(off), *layer.errors_from(off))

    return min((judged(alpha) for alpha in ALPHAS), key=lambda candidate: candidate.misdirected.sum())
