"""Diffuse light in a column of fog: P1, the two-stream method, in closed form.

With one albedo and one phase function everywhere the equations have constant coefficients over optical depth, whatever the
density does along the column.  So nothing is solved on a lattice: where a point lies in its column, in optical depths, gives
the light there.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.system.compiled import njit

_LARGEST_G = 1 - 1e-9  # at 1 nothing is deflected and D is infinite
DEEPEST = 1e8  # optical depth; more is dark
THIN = 1e-6  # optical depth of a slab below which what it scatters goes with it; 1e-10 is lost to rounding here


def moments(phase):
    """What delta scaling needs of a phase function: mean cosines g (C,), and shares (C,) in the forward peak, the second Legendre
    moments, between 0 and g.

    phase : theta (A,) rad -> (C, A) 1/sr

    Raises ValueError where an integral over the sphere is not 1, to 2 %.
    """
    edges = np.union1d(np.geomspace(1e-6, np.pi, 120), np.linspace(0, np.pi, 181))
    x, w = np.polynomial.legendre.leggauss(4)
    theta = (0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * x).ravel()
    weight = (0.5 * np.diff(edges)[:, None] * w).ravel() * 2 * np.pi * np.sin(theta) * np.asarray(phase(theta), float)
    integral, g, second = (np.sum(weight * P, axis=-1) for P in (1, np.cos(theta), 1.5 * np.cos(theta) ** 2 - 0.5))
    if (np.abs(integral - 1) > 0.02).any():
        raise ValueError(f"the integral of a phase function over the sphere is 1, not {integral}")
    return g, np.clip(second, 0, np.minimum(np.maximum(g, 0), 1 - 1e-9))


def slab(albedo, g, peak, tau):
    """Shares of a beam that a slab scatters on, and back; a plane behind it takes all that arrives.  P1 with delta scaling.

    albedo, g, peak : 1, see `moments`;  tau : 1, optical depth of the slab, >= 0; arguments broadcast

    Returns
    -------
    passed, reflected : 1; the direct light e^-tau is not among them.  All three make 1 at albedo 1, to rounding.  `passed` is
        within 3 % of what photons bring (Gaussian phase function of 30 degrees, Henyey-Greenstein g = 0.85; albedo 0.9 and 1,
        optical depths 0.1 to 10), 11 % too low at albedo 0.5 and depth 10, where it is 1e-3
    crossing : 1, what goes forward through the plane if the medium goes on behind it: `passed`, and light that comes again
    """
    arrays = np.broadcast_arrays(*(np.asarray(a, float) for a in (albedo, g, peak, tau)))
    out = np.empty((3, *arrays[0].shape))
    _fill_slabs(*(np.array(a).ravel() for a in arrays), *out.reshape(3, -1))  # copies: numba takes no read-only views
    return tuple(out)


@njit(cache=True, nogil=True, error_model="numpy")
def scaled(albedo, g, peak):
    """Delta scaling: albedo and g of what remains where a share `peak` of what is scattered counts as unscattered, and the factor
    for optical depths (Joseph, Wiscombe & Weinman, J. Atmos. Sci. 33, 2452, 1976).

    albedo, g, peak : 1, numbers or arrays; the second Legendre moment of the phase function serves well as the peak, 0 to below 1
    """
    factor = 1 - albedo * peak
    return albedo * (1 - peak) / factor, (g - peak) / (1 - peak), factor


@njit(cache=True, nogil=True, error_model="numpy")
def _mean(x):
    """Mean of e^-y over 0 < y < x."""
    return -math.expm1(-x) / x if x > 1e-12 else 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _between(k, a, tau):
    """(e^{-k tau} - e^{-a tau})/(a - k), also where a = k."""
    return tau * math.exp(-min(k, a) * tau) * _mean(abs(a - k) * tau)


@njit(cache=True, nogil=True, error_model="numpy")
def column(albedo, g, tau, total, mu, irradiance):
    """Fluence and net flux of scattered light in a column that parallel light enters, both without that light itself.

    albedo, g : 1, 0 to 1;  mean cosine, -1 to 1
    tau, total : 1, optical depths along the column, 0 at the lit face: of the place, >= 0, and of the whole
    mu, irradiance : 1, cosine between the column and the parallel light, 0 to 1;  of that at the lit face, across its direction

    Returns fluence phi, in the unit of the irradiance, and the flux, positive away from the lit face.

    Source: -(D phi')' + (1 - albedo) phi = albedo E e^{-tau/mu} - (3 D albedo g mu E e^{-tau/mu})', D = 1/(3 (1 - albedo g)),
    with Marshak's conditions phi/4 + flux/2 = 0 at tau = 0, phi/4 - flux/2 = 0 at the other face.  Energy is kept to rounding.
    Against photons at normal incidence (albedo, g, tau = 0.9, 0.5, 2; 0.99, 0.8, 5; 0.9, 0, 1) reflectance and transmittance are
    1 to 11 % off; phase functions with a peak should be scaled first (`scaled`), which leaves 1 to 5 %.
    """
    g = min(g, _LARGEST_G)
    D = 1 / (3 * (1 - albedo * g))
    k = math.sqrt(max(1 - albedo, 0.0) / D)
    phi = flux = incident = leaving = 0.0
    if irradiance > 0 and mu > 0:
        # a particular solution that is 0 at the lit face; 1/a = mu taken out by hand, as D is large where g is near 1
        a = 1 / mu
        share = albedo * irradiance / (a + k)
        gain, slope = share * (1 / D + 3 * g), share * (1 - 3 * D * g * mu * k)
        back = share * (1 + 3 * D * g) * k
        G = _between(k, a, tau)
        phi, flux = gain * G, back * G - slope * math.exp(-a * tau)
        incident = -slope
        G = _between(k, a, total)
        leaving = gain * G / 4 - (back * G - slope * math.exp(-a * total)) / 2
    # what must enter through the faces for nothing to come in, in waves that leave by the other face; all times 2 e^{-k total}
    b0, b1 = -incident / 2, -leaving
    x, y = total - tau, tau
    decay, decay_back = math.exp(-2 * k * x), math.exp(-2 * k * y)
    falling, rising = math.exp(-k * y), math.exp(-k * x)
    cosh0, sinh0 = falling * (1 + decay), falling * 2 * x * _mean(2 * k * x)  # cosh k(total - tau), sinh/k
    cosh1, sinh1 = rising * (1 + decay_back), rising * 2 * y * _mean(2 * k * y)
    end = math.exp(-2 * k * total)
    s = 2 * total * _mean(2 * k * total)
    N = D * (1 + end) + s * (0.25 + (D * k) ** 2)
    phi += (b0 * (2 * D * cosh0 + sinh0) + b1 * (2 * D * cosh1 + sinh1)) / N
    flux += D * (b0 * (2 * D * k * k * sinh0 + cosh0) - b1 * (2 * D * k * k * sinh1 + cosh1)) / N
    return phi, flux


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_slabs(albedo, g, peak, tau, passed, reflected, crossing):
    for n in range(len(passed)):
        depth = min(max(tau[n], THIN), DEEPEST)
        reduced, asymmetry, factor = scaled(albedo[n], g[n], peak[n])
        phi, flux = column(reduced, asymmetry, depth * factor, depth * factor, 1.0, 1.0)
        # what the peak has scattered is nearly parallel still
        forward = -math.exp(-depth * factor) * math.expm1(depth * (factor - 1))
        thin = min(tau[n] / depth, 1.0)
        passed[n] = thin * (forward + phi / 4 + flux / 2)
        phi, flux = column(reduced, asymmetry, 0.0, depth * factor, 1.0, 1.0)
        reflected[n] = thin * (phi / 4 - flux / 2)
        phi, flux = column(reduced, asymmetry, depth * factor, DEEPEST, 1.0, 1.0)
        crossing[n] = thin * (forward + phi / 4 + flux / 2)


@njit(cache=True, nogil=True, error_model="numpy")
def henyey_greenstein(g, cosine):
    """1/sr."""
    return (1 - g * g) / (4 * math.pi * max((1 - g) ** 2 + 2 * g * (1 - cosine), 1e-300) ** 1.5)


class Medium(NamedTuple):
    """sigma_t : (C,) 1/m;  albedo, g : (C,) 1;  peak : (C,) 1, see `scaled`"""

    sigma_t: np.ndarray
    albedo: np.ndarray
    g: np.ndarray
    peak: np.ndarray


class Parallel(NamedTuple):
    """mu : 1;  irradiance : (C,);  diffuse : whether light that was scattered before is added"""

    mu: float
    irradiance: np.ndarray
    diffuse: bool


@njit(cache=True, nogil=True, error_model="numpy")
def source(before, behind, single, turn, cosine, medium, sun, out):
    """Adds to `out` what a collision sends towards the camera, radiance a unit of optical depth.

    before, behind : (M,) m, density integrated along the column to its lit face, to its other face
    single : (M, C) phase function towards the camera times irradiance
    turn, cosine : (M,) 1, of the angle between the parallel light and the direction to the camera, between the
        column and that direction
    medium : `Medium`;  sun : `Parallel`;  out : (M, C)

    Light in the peak has met m events of mean cosine q = (1 + g)/2, their number as Poisson gives it (one or more); it is
    scattered on by a Henyey-Greenstein function with the mean cosine that results.  Without that the sun's surroundings are up
    to 8 times too bright (g = 0.9, optical depth 10), with it within 10 %.
    """
    sigma_t, albedo, g, peak = medium
    mu, irradiance, diffuse = sun
    for c in range(len(albedo)):
        albedo_left, g_left, factor = scaled(albedo[c], g[c], peak[c])
        q = (1 + g[c]) / 2
        for i in range(len(before)):
            true = min(before[i] * sigma_t[c], DEEPEST)
            light = single[i, c] * math.exp(-true / mu)
            if diffuse:
                tau = true * factor
                phi, flux = column(albedo_left, g_left, tau, tau + min(behind[i] * sigma_t[c], DEEPEST) * factor, mu,
                                   irradiance[c])
                # P1 is linear in the direction and may fall below 0 where light is nearly parallel
                light += max(phi + 3 * g[c] * cosine[i] * flux, 0.0) / (4 * math.pi)
                m = albedo[c] * peak[c] * true / mu
                if m > 0 and irradiance[c] > 0:
                    spread = math.exp(-m * (1 - q)) * q * _mean(m * q) / _mean(m)
                    light += irradiance[c] * math.exp(-tau / mu) * m * _mean(m) * henyey_greenstein(g[c] * spread, turn[i])
            out[i, c] += albedo[c] * light
