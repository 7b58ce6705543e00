"""What a ray does at the surface of a grain: smooth or rough dielectric, diffuse, smooth or rough conductor.

Microfacets have the GGX distribution and are sampled among those that the ray sees (Heitz & d'Eon 2014), with one scattering a
meeting: light that would meet a second facet is lost, as in other renderers' single-scattering models; how much is measured in
docs/scatterometer.md.
Kernels take local directions: z is the outward normal, wi and wo point away from the surface.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.shapes import limits
from bakery.system.compiled import njit

DIELECTRIC, DIFFUSE, CONDUCTOR = 0, 1, 2


@dataclass(frozen=True)
class Surface:
    """What the kernels need of a surface.  Made by `dielectric`, `diffuse` and `conductor`."""

    kind: int  # DIELECTRIC, DIFFUSE or CONDUCTOR
    index: float  # of a dielectric, relative to the host
    roughness: float  # GGX's alpha, 0 for smooth
    channels: np.ndarray  # (2, C) rows of n and k (conductor) or of the reflectance and zeros (diffuse); C = 1 for a dielectric


def dielectric(index, roughness=0.0) -> Surface:
    """Glass, ice, salt: index relative to the host, 0.2 to 5; light that enters is absorbed on its path by the interior."""
    index, roughness = _number("index", index, *limits.INDEX), _rough(roughness)
    return Surface(DIELECTRIC, index, roughness if index != 1 else 0.0, np.zeros((2, 1)))  # no facet is seen at index 1


def diffuse(reflectance) -> Surface:
    """Opaque and Lambertian: reflectance (C,) or a number, 0 to 1."""
    reflectance = np.atleast_1d(np.asarray(reflectance, float))
    if reflectance.ndim != 1 or not np.all((reflectance >= 0) & (reflectance <= 1)):
        raise ValueError(f"reflectance {reflectance.tolist()}: numbers from 0 to 1 are needed, one a wavelength")
    return Surface(DIFFUSE, 1.0, 0.0, np.stack([reflectance, np.zeros_like(reflectance)]))


def conductor(index, roughness=0.0) -> Surface:
    """Opaque and shiny: complex index n + ik, k >= 0, (C,) or a number, relative to the host; infinite: a perfect mirror."""
    index = np.atleast_1d(np.asarray(index, complex))
    perfect = np.isinf(index.real) | np.isinf(index.imag)
    if index.ndim != 1 or np.any(np.isnan(index)) or not np.all((index.real >= 0) & (index.imag >= 0)) or np.any(index == 0):
        raise ValueError(f"index {index.tolist()}: complex numbers n + ik with n, k >= 0 are needed, one a wavelength")
    return Surface(CONDUCTOR, 1.0, _rough(roughness), np.stack([np.where(perfect, np.inf, index.real), index.imag]))


def lossless(kind, index=None, roughness=0.0) -> Surface:
    """A surface of the same kind ("dielectric" of real index, "diffuse", "conductor") at which nothing is absorbed."""
    if kind == "dielectric":
        return dielectric(index, roughness)
    return diffuse(1.0) if kind == "diffuse" else conductor(complex(np.inf, 0), roughness)


def _number(name, value, least, most):
    value = float(value)
    if not least <= value <= most:
        raise ValueError(f"{name} {value:g}: {least:g} to {most:g} are possible")
    return value


def _rough(roughness):
    return 0.0 if roughness == 0 else _number("roughness", roughness, limits.ALPHA_MIN, 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def fresnel(cosine, eta):
    """Unpolarised reflectance of a dielectric and the cosine of refraction; cosine >= 0, eta = index beyond / index before."""
    if eta == 1.0:
        return 0.0, cosine
    square = 1.0 - (1.0 - cosine * cosine) / (eta * eta)
    if square <= 0.0:
        return 1.0, 0.0
    beyond = math.sqrt(square)
    s = (cosine - eta * beyond) / (cosine + eta * beyond)
    p = (eta * cosine - beyond) / (eta * cosine + beyond)
    return 0.5 * (s * s + p * p), beyond


@njit(cache=True, nogil=True, error_model="numpy")
def fresnel_conductor(cosine, n, k):
    """Unpolarised reflectance of a conductor n + ik; 1 where n is infinite."""
    if n == np.inf:
        return 1.0
    c2 = cosine * cosine
    s2 = 1.0 - c2
    t0 = n * n - k * k - s2
    a2b2 = math.sqrt(t0 * t0 + 4.0 * n * n * k * k)
    a = math.sqrt(max(0.5 * (a2b2 + t0), 0.0))
    rs = (a2b2 + c2 - 2.0 * a * cosine) / (a2b2 + c2 + 2.0 * a * cosine)
    rp = rs * (a2b2 * c2 + s2 * s2 - 2.0 * a * cosine * s2) / (a2b2 * c2 + s2 * s2 + 2.0 * a * cosine * s2)
    return 0.5 * (rs + rp)


@njit(cache=True, nogil=True, error_model="numpy")
def shadowing(x, y, z, mx, my, mz, alpha):
    """Smith's G1: share of the facets with normal m that direction (x, y, z) sees; 0 from their back."""
    if (x * mx + y * my + z * mz) * z <= 0.0:
        return 0.0
    across = alpha * alpha * (x * x + y * y)
    return 1.0 if across == 0.0 else 2.0 / (1.0 + math.sqrt(1.0 + across / (z * z)))


@njit(cache=True, nogil=True, error_model="numpy")
def disk(u, v):
    """Concentric map of the unit square to the unit disk (Shirley & Chiu 1997)."""
    x, y = 2.0 * u - 1.0, 2.0 * v - 1.0
    if x == 0.0 and y == 0.0:
        return 0.0, 0.0
    if abs(x) >= abs(y):
        r, phi = x, 0.25 * math.pi * (y / x)
    else:
        r, phi = y, 0.5 * math.pi - 0.25 * math.pi * (x / y)
    return r * math.cos(phi), r * math.sin(phi)


@njit(cache=True, nogil=True, error_model="numpy")
def facet(x, y, z, alpha, u, v):
    """Normal of a facet that direction (x, y, z), z > 0, sees, from two uniform numbers; z of the normal is positive."""
    sx, sy, sz = alpha * x, alpha * y, z
    over = 1.0 / math.sqrt(sx * sx + sy * sy + sz * sz)
    sx, sy, sz = sx * over, sy * over, sz * over
    sine = math.sqrt(max(1.0 - sz * sz, 0.0))
    cp, sp = 1.0, 0.0
    if sine > 0.0:
        length = math.sqrt(sx * sx + sy * sy)
        if length > 0.0:
            cp, sp = sx / length, sy / length
    p, q = disk(u, v)
    s = 0.5 * (1.0 + sz)
    q = (1.0 - s) * math.sqrt(max(1.0 - p * p, 0.0)) + s * q
    r = math.sqrt(max(1.0 - p * p - q * q, 0.0))
    # the seen half of the unit ball, turned back: slopes of the stretched facet, along and across the ray
    norm = 1.0 / max(sine * q + sz * r, 1e-300)
    along, across = (sz * q - sine * r) * norm, p * norm
    mx, my = -alpha * (cp * along - sp * across), -alpha * (sp * along + cp * across)
    over = 1.0 / math.sqrt(mx * mx + my * my + 1.0)
    return mx * over, my * over, over


@njit(cache=True, nogil=True, error_model="numpy")
def at_dielectric(x, y, z, index, alpha, u, v, w):
    """New direction (x, y, z) and weight for wi = (x, y, z); u decides between the two ways, v and w choose the facet.

    index : of the inside over the outside;  alpha : 0 for smooth.  Energy, not radiance: no factor index^2 on refraction.
    """
    sign = 1.0 if z > 0.0 else -1.0
    eta = index if z > 0.0 else 1.0 / index
    mx, my, mz = 0.0, 0.0, 1.0
    if alpha > 0.0:
        mx, my, mz = facet(sign * x, sign * y, sign * z, alpha, v, w)
    mx, my, mz = sign * mx, sign * my, sign * mz
    cosine = x * mx + y * my + z * mz
    reflectance, beyond = fresnel(max(cosine, 0.0), eta)
    if u < reflectance:
        ox, oy, oz = 2.0 * cosine * mx - x, 2.0 * cosine * my - y, 2.0 * cosine * mz - z
        stays = 1.0
    else:
        scale = cosine / eta - beyond
        ox, oy, oz = scale * mx - x / eta, scale * my - y / eta, scale * mz - z / eta
        stays = -1.0
    weight = 1.0
    if alpha > 0.0:
        weight = shadowing(ox, oy, oz, sign * mx, sign * my, sign * mz, alpha) if stays * oz * z > 0.0 else 0.0
    return ox, oy, oz, weight


@njit(cache=True, nogil=True, error_model="numpy")
def at_surface(kind, index, alpha, x, y, z, u, v, w):
    """One meeting with a surface: new direction for wi = (x, y, z), share left of all light, cosine to the facet.

    u, v, w : uniform numbers: a smooth dielectric takes u, a rough one all, a diffuse surface and a rough conductor u and v
    """
    if kind == DIELECTRIC:
        x, y, z, share = at_dielectric(x, y, z, index, alpha, u, v, w)
        return x, y, z, share, 1.0
    if kind == DIFFUSE:
        x, y = disk(u, v)
        return x, y, math.sqrt(max(1.0 - x * x - y * y, 0.0)), 1.0, 1.0
    mx, my, mz = 0.0, 0.0, 1.0
    if alpha > 0.0:
        mx, my, mz = facet(x, y, z, alpha, u, v)
    cosine = x * mx + y * my + z * mz
    x, y, z = 2.0 * cosine * mx - x, 2.0 * cosine * my - y, 2.0 * cosine * mz - z
    share = 1.0
    if z <= 0.0:
        share = 0.0
    elif alpha > 0.0:
        share = shadowing(x, y, z, mx, my, mz, alpha)
    return x, y, z, share, min(cosine, 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def surface_share(kind, channels, c, cosine):
    """Share that is left in channel c besides: reflectance of a diffuse surface, Fresnel's of a conductor."""
    if kind == DIELECTRIC:
        return 1.0
    return channels[0, c] if kind == DIFFUSE else fresnel_conductor(cosine, channels[0, c], channels[1, c])


@njit(cache=True, nogil=True, error_model="numpy")
def surface_density(kind, index, alpha, x, y, z, ox, oy, oz):
    """What `at_surface` makes of a direction (ox, oy, oz) for wi = (x, y, z): its density, 1/sr, share left of all light,
    cosine to the facet.  The density is 0 where it cannot come about, and for smooth surfaces, whose directions have none.

    Source: Walter, Marschner, Li & Torrance, EGSR 2007, eqs. 13, 16 and 17; Heitz & d'Eon 2014, eq. 2.
    """
    if kind == DIFFUSE:
        return max(oz, 0.0) / math.pi, 1.0, 1.0
    if alpha == 0.0 or z == 0.0 or oz == 0.0 or kind == CONDUCTOR and oz < 0.0:
        return 0.0, 0.0, 1.0
    eta = 1.0
    if z * oz > 0.0:
        mx, my, mz = x + ox, y + oy, z + oz
    else:
        eta = index if z > 0.0 else 1.0 / index
        mx, my, mz = -(x + eta * ox), -(y + eta * oy), -(z + eta * oz)
    length = math.sqrt(mx * mx + my * my + mz * mz)
    if length == 0.0:
        return 0.0, 0.0, 1.0
    over = math.copysign(1.0 / length, mz)
    mx, my, mz = mx * over, my * over, mz * over  # on the outer side
    share = shadowing(ox, oy, oz, mx, my, mz, alpha)
    if share == 0.0:
        return 0.0, 0.0, 1.0
    before, after = abs(x * mx + y * my + z * mz), abs(ox * mx + oy * my + oz * mz)
    spread = 1.0 + mz * mz * (alpha * alpha - 1.0)
    density = alpha * alpha / (math.pi * spread * spread) * shadowing(x, y, z, mx, my, mz, alpha) / abs(z)
    if z * oz > 0.0:
        density *= 0.25
    else:
        density *= before * eta * eta * after / (before - eta * after) ** 2
    if kind == DIELECTRIC:
        reflectance, _ = fresnel(before, index if z > 0.0 else 1.0 / index)
        density *= reflectance if z * oz > 0.0 else 1.0 - reflectance
    return density, share, min(before, 1.0)
