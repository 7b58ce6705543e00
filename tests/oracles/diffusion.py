"""Closed forms of diffusion for a point source, in an endless medium, a half space or a slab, and the classical approximation.

Index-matched boundaries.  Any unit of length; coefficients are 1 over it.  Arrays broadcast.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.medium import diffusion
from bakery.physics.medium.similarity import reduced

JENSEN = (0.0, 1.0)  # exitance is the net flux
ROBUST = (0.25, 0.5)  # fluence and flux, d'Eon & Irving 2011
PAIRS = 64


@dataclass(frozen=True)
class Diffusion:
    """Parameters of a medium, each of the shape of the coefficients that it was made from.

    Attributes
    ----------
    sigma_t, albedo : reduced extinction and albedo
    sigma_a : absorption
    D : diffusion coefficient; infinite in an empty medium
    sigma_tr : sqrt(sigma_a/D), decay of diffuse light; 0 where nothing is absorbed
    z_b : 2 D, how far outside of a boundary the fluence goes to 0
    strength : of a point source of unit power: diffuse fluence is strength e^(-sigma_tr r)/(4 pi r)
    """

    sigma_t: np.ndarray
    albedo: np.ndarray
    sigma_a: np.ndarray
    D: np.ndarray
    sigma_tr: np.ndarray
    z_b: np.ndarray
    strength: np.ndarray


def classical(sigma_s, sigma_a, g) -> Diffusion:
    """D = 1/(3 sigma_t'), strength alpha'/D: light that has been scattered once is a source of diffuse light.

    Parameters
    ----------
    sigma_s, sigma_a, g : coefficients of the medium, as in `similarity.reduced`
    """
    sigma_t, albedo, sigma_tr = reduced(sigma_s, sigma_a, g)
    with np.errstate(divide="ignore"):
        D = 1 / (3 * sigma_t)
    return Diffusion(sigma_t, albedo, np.broadcast_to(np.asarray(sigma_a, float), sigma_t.shape), D, sigma_tr, 2 * D,
                     3 * albedo * sigma_t)


def improved(sigma_s, sigma_a, g) -> Diffusion:
    """The bakery's: strength alpha'/D."""
    sigma_t, albedo, _ = reduced(sigma_s, sigma_a, g)
    D, sigma_tr = diffusion.improved(sigma_s, sigma_a, g)
    return Diffusion(sigma_t, albedo, np.broadcast_to(np.asarray(sigma_a, float), sigma_t.shape), D, sigma_tr, 2 * D,
                     3 * albedo * sigma_t / (2 - albedo))


def uncollided(medium: Diffusion, r):
    """Fluence that has not been scattered, e^(-sigma_t' r)/(4 pi r^2), of a point source of unit power at distances r."""
    with np.errstate(divide="ignore"):
        return np.exp(-medium.sigma_t * r) / (4 * math.pi * np.square(r))


def fluence(medium: Diffusion, r):
    """Diffuse fluence of a point source of unit power in an infinite medium, at distances r >= 0."""
    with np.errstate(divide="ignore"):
        green = np.exp(-medium.sigma_tr * r) / (4 * math.pi * np.asarray(r, float))
    return medium.strength * np.where(medium.strength > 0, green, 0.0)


def layer(medium: Diffusion, r, z, source, thickness=math.inf, pairs=PAIRS):
    """Diffuse fluence in a half space or slab, and its derivative along the depth.

    Parameters
    ----------
    r, z : distance along the face and depth, 0 <= z <= thickness, of the points
    source : depth of a point source of unit power
    thickness : infinite for a half space, which one pair of mirrors solves exactly
    pairs : n; sources at 2 i (d + 2 z_b) + z_s and, negative, 2 i (d + 2 z_b) - z_s - 2 z_b for i from -n to n

    Returns
    -------
    fluence, slope : 1/length^2 and 1/length^3; infinite and 0 at the source itself

    Notes
    -----
    The fluence is 0 at z = -z_b (in a slab as n grows) and at d + z_b.  With l = d + 2 z_b the pairs left out change it by at
    most strength/(8 pi l n^2) for r well below n l, and e^(-2 sigma_tr n l) times that where there is absorption.  Along the face
    the fluence falls as e^(-pi r/l), at last below that error.
    """
    r, z, source, thickness = (np.asarray(x, float)[..., None] for x in (r, z, source, thickness))
    z_b, sigma_tr = medium.z_b[..., None], medium.sigma_tr[..., None]
    endless = np.isinf(thickness) | np.isinf(z_b)
    period = 2 * (np.where(np.isinf(thickness), 0.0, thickness) + 2 * np.where(np.isinf(z_b), 0.0, z_b))
    i = np.arange(-pairs, pairs + 1) if not np.all(endless) else np.zeros(1)
    present = (~endless | (i == 0)) & (medium.strength[..., None] > 0)
    total = slope = 0.0
    for sign, at in ((1.0, i * period + source), (-1.0, i * period - source - 2 * z_b)):
        dz = z - at
        with np.errstate(all="ignore"):
            d = np.hypot(r, dz)
            term = np.where(present & (d < np.inf), sign * np.exp(-sigma_tr * d) / d, 0.0)
            drop = np.where((term == 0) | (d == 0), 0.0, -term * (sigma_tr + 1 / d) * (dz / d))
        total, slope = total + term, slope + drop
    over = medium.strength / (4 * math.pi)
    return over * np.sum(total, axis=-1), over * np.sum(slope, axis=-1)


def exitance(medium: Diffusion, r, source, thickness=math.inf, pairs=PAIRS, face=0, law=ROBUST):
    """Power that leaves a unit of area through a face at distance r from above a point source: C_phi phi + C_E D dphi/dz inward.

    Parameters
    ----------
    r, source, thickness, pairs : as in `layer`
    face : 0 the one at depth 0, 1 the one at `thickness`
    law : (C_phi, C_E), `ROBUST` or `JENSEN`
    """
    z = thickness if face else 0.0
    value, slope = layer(medium, r, z, source, thickness, pairs)
    flux = np.where(slope == 0, 0.0, (-1 if face else 1) * np.where(np.isinf(medium.D), 0.0, medium.D) * slope)
    return law[0] * value + law[1] * flux
