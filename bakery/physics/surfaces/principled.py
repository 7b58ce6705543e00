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


def principled(reflectance, index: float, roughness: float, bands) -> Principled:
    """The fit of a layer.

    reflectance : function of theta_in, theta_out, phi (Q,) to (L, Q), pi times the BRDF, as `asset.surface.reflectance`
    index, roughness : of its boundary
    bands : (3, L) 1, red, green and blue as means over the wavelengths; rows add up to 1

    Facets of a rough boundary are the same in both: only what comes out of the layer is compared.
    """
    directions = nodes(_DIRECTIONS)
    cosines = directions.mu
    phi = math.pi * (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS
    mu, mu0, phi = (part.ravel() for part in np.meshgrid(cosines, cosines, phi, indexing="ij"))
    out = reflectance(np.arccos(mu0), np.arccos(mu), phi)
    if roughness > 0 and index != 1:
        out = out - rough.reflected(mu, mu0, phi, index, roughness)
        mirrored = rough.facets(directions, directions, index, roughness, 1).mirrored
    else:
        mirrored = fresnel.reflected(cosines, index)
    shape = 3, _DIRECTIONS, _DIRECTIONS, _AZIMUTHS
    wanted, flux = (bands @ out).reshape(shape), directions.flux
    layered = (1 - mirrored)[:, None, None]

    def base(colour, facets):
        return layered * diffuse(mu, mu0, phi, colour, facets).reshape(shape[1:])

    def share(values):
        return float(flux @ values.mean(axis=2) @ flux)

    def fitted(facets):
        colours = np.array([_colour(lambda colour: share(base(colour, facets)), share(part)) for part in wanted])
        off = np.stack([base(colour, facets) for colour in colours]) - wanted
        return colours, off, np.array([0.5 * share(np.abs(part)) for part in off])

    facets = min(_ROUGHNESSES, key=lambda value: fitted(value)[2].sum())
    colours, off, misdirected = fitted(facets)
    light = np.array([share(part) for part in wanted])
    seen = [np.einsum("j,bijk->bi", flux, part) / _AZIMUTHS for part in (off, wanted)]
    at = np.array([np.argmin(np.abs(cosines - math.cos(math.radians(angle)))) for angle in ANGLES])
    # where a critical angle leaves no light there is nothing to be relative to but what is seen elsewhere
    relative = seen[0][:, at] / np.maximum(seen[1][:, at], 1e-3 * light[:, None] + 1e-30)
    return Principled(colours, float(facets), index, roughness, misdirected / np.maximum(light, 1e-30), relative,
                      float(max((-share(part) for part, colour in zip(off, colours, strict=True) if colour == 1), default=0.0)))


def _colour(share, wanted: float) -> float:
    """Of a base that sends back a share of the light from all sides; 1 where none is bright enough."""
    if share(1.0) <= wanted:
        return 1.0
    return brentq(lambda colour: share(colour) - wanted, 0.0, 1.0, xtol=1e-6)
