"""Light of narrow beams counted photon by photon, and closed forms that the bakery does not use.

Closed forms take what `bakery.physics.beam.moments` gives and a distance r > 0 from the axis (mfp), and return mfp^-2.
"""

import math

import numpy as np
from scipy import special

from bakery import rng
from bakery.physics.beam.kernels import G, gaussian_kernel
from bakery.physics.beam.photons import BLOCKS, Counted, Counting
from bakery.physics.beam.planar import Planar


def count(albedo, theta, phase, depth, edges, photons, *, seed=0, stream=0, first=1, last=None, back=True, threads=1,
          layers=((0.0,), (1.0,))) -> Counted:
    """Follows photons of a narrow beam.

    Parameters
    ----------
    albedo : 0 to 1
    theta, phase : (A,) rad, 1/sr, linear in cos theta, normalised
    depth : (D,) mfp, of the planes, ascending, > 0
    edges : (R + 1,) mfp, ascending from >= 0
    photons : number
    back : whether light that goes back through a plane counts too
    threads : the values do not depend on it
    seed, stream : whole numbers >= 0; the same ones give the same values
    first, last : numbers of scattering events of the light that counts (None: any more)
    layers : begins (N,) ascending from 0, density (N,) >= 0; the last one never ends.  Lengths are mean free paths at density 1

    Notes
    -----
    Every flight adds to each plane ahead what would reach it: the expected value of the crossing, with less noise than the
    crossing itself.  `_GRAZING` biases the fluence by the change of radiance within 0.6 degrees of the plane, well below 0.1 %.
    A photon is dropped where it is more than 20 mfp beyond the last plane, or 20 from the axis beyond the last ring
    (with albedo 1 and wide rings that is a bias; it is below 1e-3 for depths and rings up to 5 mfp).
    """
    counting = Counting(albedo, theta, phase, depth, edges, (seed, stream), (first, last), layers)
    counting.follow(photons, threads)
    return counting.counted(back)


def count_small_angle(scatterings, sample, escaping, density, depth, edges, photons, *, seed=0):
    """The small-angle model by brute force: planar angles that add up, depth as the length of all paths; nothing is absorbed.

    Parameters
    ----------
    scatterings : mean number of scattering events (a Poisson variable)
    sample : (random generator, n) -> (n,) planar scattering angles
    left, density : (N + 1,) edges of layers from 0 to `depth`, (N,) share of the density in each, any scale
    depth : of the plane
    edges : (R + 1,) of the rings
    photons : number, in `BLOCKS` blocks

    Returns
    -------
    value, error : (R,) share of the beam that is scattered and lands in each ring, over its area
    moments, moments_error : (3,) of M0, M2, M4
    """
    escaping, density, edges = np.asarray(escaping, float), np.asarray(density, float), np.asarray(edges, float)
    cumulative = np.concatenate([[0.0], np.cumsum(density * np.diff(escaping))])
    per_block = -(-int(photons) // BLOCKS)
    rings, moments = np.empty((BLOCKS, len(edges) - 1)), np.empty((BLOCKS, 3))
    for index in range(BLOCKS):
        stream = rng.generator(seed, "beam.small_angle", index)
        events = stream.poisson(scatterings, per_block)
        photon = np.repeat(np.arange(per_block), events)
        at = np.interp(stream.random(len(photon)) * cumulative[-1], cumulative, escaping)
        lever = sample(stream, len(photon)) * (depth - at)
        turn = 2 * math.pi * stream.random(len(photon))
        x, y = (np.bincount(photon, lever * f(turn), per_block) for f in (np.cos, np.sin))
        r2 = (x * x + y * y)[events > 0]
        rings[index] = np.histogram(np.sqrt(r2), edges)[0] / per_block
        moments[index] = len(r2) / per_block, r2.sum() / per_block, (r2 * r2).sum() / per_block
    rings /= math.pi * np.diff(edges**2)
    root = math.sqrt(BLOCKS)
    return rings.mean(0), rings.std(0, ddof=1) / root, moments.mean(0), moments.std(0, ddof=1) / root


def single_kernel(depth, sigma_s, tau, B, r):
    """Light scattered once by a Gaussian phase function at small angles: sigma_s e^-tau/(2 sqrt(pi B) r) G(r/(z sqrt(2 B)))."""
    B = np.asarray(B, float)
    return sigma_s * np.exp(-np.asarray(tau, float)) / (2 * np.sqrt(math.pi * B) * r) * G(r / (depth * np.sqrt(2 * B)))


def single_and_gaussian(depth, sigma_s, sigma_a, B, r):
    """Single scattering as it is, all that is left of M0 and M2 as a Gaussian; homogeneous medium."""
    depth, S = np.asarray(depth, float), np.asarray(sigma_s * np.asarray(depth, float))
    transmitted, single = np.exp(-sigma_a * depth), S * np.exp(-S)
    weight = np.where(S < 1e-3, S * S / 2 * (1 - 2 * S / 3), -np.expm1(-S) - single)
    # 4 B S_2 less what single scattering has of it, 4/3 B z^2 S (1 - e^-S)
    square = 4 / 3 * B * depth**2 * S * -np.expm1(-S)
    q = np.divide(square, weight, out=np.ones_like(square), where=weight > 0)
    return single_kernel(depth, sigma_s, (sigma_s + sigma_a) * depth, B, r) + transmitted * gaussian_kernel(weight, q, r)


def printed_mean_square(depth, sigma_s, B):
    """M2/M0 as eq. 26 of Shinya et al. 2016 has it, for comparison; 1.3 to 2.9 times too large.  Homogeneous, without absorption.

    4 B z^2 (e^-S (1 - 2/S^2) + 2/S^2 - 2/S + S)/(1 - e^-S), S = sigma_s z.
    """
    depth = np.asarray(depth, float)
    S = np.asarray(sigma_s * depth, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        whole = np.exp(-S) * (1 - 2 / S**2) + 2 / S**2 - 2 / S + S
    # three leading orders cancel
    series = S / 3 * (1 + S * (5 / 4 - S * (9 / 20 - S * 7 / 60)))
    return 4 * B * depth**2 * np.where(S < 0.01, series, whole) / np.where(S > 0, -np.expm1(-S), 1.0)


def gaussian(B) -> Planar:
    """p = e^(-s^2/4B)/(4 pi B), mean square angle 4 B; P = e^(-B q^2)."""
    root = math.sqrt(B)

    def mean(q):
        x = root * np.asarray(q, float)
        return np.where(x < 1e-4, 1 - x * x / 3, 0.5 * math.sqrt(math.pi) * special.erf(x) / np.where(x > 0, x, 1.0))

    return Planar(mean, lambda t: special.erfc(np.asarray(t) / (2 * root)) / (4 * root * math.sqrt(math.pi)), root)


def henyey_greenstein(g) -> Planar:
    """p = c/(2 pi) (c^2 + s^2)^(-3/2) with c = (1 - g)/sqrt(g), 0 < g < 1; P = e^(-c q): the tail never ends."""
    if not 0 < g < 1:
        raise ValueError(f"the small-angle model of Henyey-Greenstein needs 0 < g < 1, not {g}")
    c = (1 - g) / math.sqrt(g)

    def mean(q):
        x = c * np.asarray(q, float)
        return np.where(x < 1e-8, 1 - x / 2, -np.expm1(-x) / np.where(x > 0, x, 1.0))

    def beyond(t):
        far = np.hypot(c, t)
        return c / (2 * math.pi * far * (far + t))

    return Planar(mean, beyond, c)
