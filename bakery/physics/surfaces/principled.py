"""A baked surface as what nearly every program has: a rough diffuse base under a dielectric boundary, and what that loses.

OpenPBR and Blender's Principled BSDF layer both: light that the boundary reflects is taken from the base by the direction that
is looked from.  The base is Oren and Nayar's model in the form that keeps energy.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from bakery.physics.surfaces import fresnel, rough
from bakery.physics.surfaces.nodes import nodes

ANGLES = (0.0, 60.0, 80.0)  # degrees from which the error of the brightness in even light is told
_DIRECTIONS, _AZIMUTHS = 32, 24
_ROUGHNESSES = np.linspace(0, 1, 21)
_ONE, _TWO = 0.5 - 2 / (3 * math.pi), 2 / 3 - 28 / (15 * math.pi)


class Principled(NamedTuple):
    """A fit."""

    colour: np.ndarray  # (3,) linear, of the base: light from all sides is reflected as much as by the surface, unless `clipped`
    diffuse_roughness: float  # of the base, 0 (Lambert) to 1
    # index, roughness: of the boundary over that of the air, 1: none; alpha of its facets (GGX)
    index: float
    roughness: float
    misdirected: np.ndarray  # (3,) share of the light from all sides that goes to another direction; mirrored light is left out
    brightness_error: np.ndarray  # (3, A) of the same light, in light from all sides, as it is seen from `ANGLES`; relative
    albedo_error: np.ndarray  # (3, A) of the same in light from `ANGLES`, to all sides
    clipped: float  # largest share of the light from all sides that a base of colour 1 lacks


def diffuse(mu, mu0, phi, colour, roughness: float):
    """pi times the BRDF of the base; phi as of `asset.surface.reflectance`.

    Fujii's improved form of Oren and Nayar 1994, and light that its facets send on several times by its albedo.
    Source: Portsmouth, Kutz and Hill, EON: A Practical Energy-Preserving Rough Diffuse BRDF, J. Comput. Graph. Tech. 2025.
    """
    across = -np.sqrt((1 - mu * mu) * (1 - mu0 * mu0)) * np.cos(phi)
    lobe = np.where(across > 0, across / np.maximum(mu, mu0), across)
    scale = 1 / (1 + _ONE * roughness)
    mean = scale * (1 + _TWO * roughness)
    several = (1 - _once(mu, roughness)) * (1 - _once(mu0, roughness)) / max(1 - mean, 1e-9) * mean
    return colour * scale * (1 + roughness * lobe) + colour**2 * several / (1 - colour * (1 - mean))


def _once(mu, roughness: float):
    """Albedo of a white base whose facets send light on once."""
    sine = np.sqrt(1 - mu * mu)
    G = sine * (np.arccos(mu) - sine * mu) + 2 / 3 * (sine / mu * (1 - sine**3) - sine)
    return (1 + roughness / math.pi * G) / (1 + _ONE * roughness)


class Sampled:
    """What comes out of a layer, in red, green and blue, at pairs of directions of light from all sides.

    Facets of a rough boundary are the same in every fit: only what comes out below them is sampled.
    """

    def __init__(self, reflectance, index: float, roughness: float, bands):
        """Arguments as of `principled`."""
        directions = nodes(_DIRECTIONS)
        self.mu, self.flux = directions.mu, directions.flux
        self._reflectance, self._bands, self.index, self.roughness = reflectance, bands, index, roughness
        self._facets = roughness > 0 and index != 1
        self._mirrored = rough.facets(directions, directions, index, roughness, 1).mirrored if self._facets else None
        self.values, self.passed = self.seen_from(self.mu)

    def at(self, cosines):
        """Cosines of exitance, as given, and incidence, and azimuths, (K, N, A) each; N are `mu`."""
        return np.meshgrid(cosines, self.mu, math.pi * (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS, indexing="ij")

    def seen_from(self, cosines):
        """At cosines of exitance (K,), pi times the BRDF (3, K, N, A), and the share of light that passes the boundary (K,)."""
        mu, mu0, phi = at = [part.ravel() for part in self.at(cosines)]
        out = self._reflectance(np.arccos(mu0), np.arccos(mu), phi)
        if self._facets:
            out = out - rough.reflected(*at, self.index, self.roughness)
            mirrored = np.interp(cosines, self.mu, self._mirrored)
        else:
            mirrored = fresnel.reflected(cosines, self.index)
        return (self._bands @ out).reshape(3, len(cosines), _DIRECTIONS, _AZIMUTHS), 1 - mirrored

    def bright(self, values):
        """Of pairs (..., K, N, A), what is seen in light from all sides (..., K)."""
        return values.mean(axis=-1) @ self.flux

    def share(self, values):
        """Of pairs (..., N, N, A), the share of the light from all sides (...)."""
        return self.bright(values) @ self.flux

    def misdirected(self, off):
        """Of differences (3, N, N, A), the share (3,) of the light that goes to another direction."""
        return 0.5 * self.share(np.abs(off)) / np.maximum(self.share(self.values), 1e-30)

    def errors_from(self, off):
        """Of the same, relative errors (3, A) of what is seen from `ANGLES` in light from all sides, and of the albedo in light
        from them.  They differ where what a boundary mirrors is taken from the base by the direction of view alone.
        """
        at = np.array([np.argmin(np.abs(self.mu - math.cos(math.radians(angle)))) for angle in ANGLES])
        # where a critical angle leaves no light there is nothing to be relative to but what is seen elsewhere
        least = 1e-3 * self.share(self.values)[:, None] + 1e-30
        return tuple(self.bright(error)[:, at] / np.maximum(self.bright(values)[:, at], least) for error, values in
                     ((off, self.values), (off.swapaxes(1, 2), self.values.swapaxes(1, 2))))


def principled(reflectance, index: float, roughness: float, bands) -> Principled:
    """The fit of a layer.

    reflectance : function of theta_in, theta_out, phi (Q,) to (L, Q), pi times the BRDF, as `asset.surface.reflectance`
    index, roughness : of its boundary
    bands : (3, L) 1, red, green and blue as means over the wavelengths; rows add up to 1
    """
    return fitted(Sampled(reflectance, index, roughness, bands))


def fitted(layer: Sampled) -> Principled:
    """The fit of a layer that is sampled already."""
    at, passed = layer.at(layer.mu), layer.passed[:, None, None]

    def base(colour, facets):
        return passed * diffuse(*at, colour, facets)

    def best(facets):
        colours = np.array([_colour(lambda colour: layer.share(base(colour, facets)), light)
                            for light in layer.share(layer.values)])
        return colours, np.stack([base(colour, facets) for colour in colours]) - layer.values

    facets = min(_ROUGHNESSES, key=lambda value: layer.share(np.abs(best(value)[1])).sum())
    colours, off = best(facets)
    lacking = -layer.share(off)[colours == 1]
    return Principled(colours, float(facets), layer.index, layer.roughness, layer.misdirected(off), *layer.errors_from(off),
                      float(lacking.max(initial=0.0)))


def _colour(share, wanted: float) -> float:
    """Of a base that sends back a share of the light from all sides; 1 where none is bright enough."""
    if share(1.0) <= wanted:
        return 1.0
    return brentq(lambda colour: share(colour) - wanted, 0.0, 1.0, xtol=1e-6)
