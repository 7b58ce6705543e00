"""Balls in their bounding sphere, in closed form: dielectric of all orders with absorption, conductor, Lambertian.

Deterministic quadrature; a tessellated ball does not tend to these figures (its facets let light into modes that a smooth ball
keeps shut), so spheres are never walked.  Lengths in units of the bounding radius.
"""

import math
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from bakery.physics.grains.surface import DIELECTRIC, DIFFUSE, Surface, fresnel_conductor
from bakery.system.compiled import njit

NODES = 600
_RAYS = 1 << 14  # intervals of incidence for the phase function
_FAINT = 1e-8  # of the light: so much may be left where the phase function stops to follow reflections


@dataclass(frozen=True)
class Ball:
    """Statistics of a ball, named as in `scatterometer.Statistics`, whose figures they are; errors are those of quadrature.

    `errors` holds "phase", the largest difference to half as many rays; the rest is good to 1e-10.
    """

    hit_probability: float
    lambda_delta: float
    chord: float
    albedo: np.ndarray
    lambda_s: np.ndarray
    lambda_o: np.ndarray
    mean_square: np.ndarray
    g: np.ndarray
    forward_delta: np.ndarray
    inner_path: np.ndarray
    phase: np.ndarray
    edges: np.ndarray
    errors: dict[str, np.ndarray] = field(repr=False)


def ball(surface: Surface, mu=0.0, edges=None, radius=1.0, polarised=False) -> Ball:
    """Exact scattering statistics of a ball centred in the unit bounding sphere.

    surface : smooth, from `bakery.physics.grains.surface`
    mu : (C,) or a number, 1/R, absorption coefficient of a dielectric's interior
    edges : (B + 1,) rad of the bins of the phase function, 0 to pi; one degree by default
    radius : of the ball, up to 1; 1 for a dielectric
    polarised : whether light keeps its polarisation from one meeting with the surface to the next; walks mix it at each

    Raises ValueError : a rough surface, or a dielectric that does not fill the sphere

    Checked against mpmath for index 0.5 to 2.42 and mu 0 to 100.  Sums over orders: geometric series of Fresnel's coefficients,
    each order with its turned angle (van de Hulst 1957, section 12.2).

    >>> from bakery.physics.grains.surface import dielectric
    >>> glass = ball(dielectric(1.5))
    >>> round(float(glass.lambda_s[0]), 8), round(float(glass.g[0]), 8)
    (1.4243548, 0.65008941)
    """
    if surface.roughness > 0:
        raise ValueError("a rough ball has no closed form: walk through a mesh")
    if not 0 < radius <= 1:
        raise ValueError(f"radius {radius:g}: more than 0 and up to 1 (the bounding sphere) is possible")
    mu = np.atleast_1d(np.asarray(mu, float))
    if mu.ndim != 1 or not np.all((mu >= 0) & np.isfinite(mu)):
        raise ValueError(f"mu {mu.tolist()}: absorption coefficients >= 0 in 1/R are needed, one a channel")
    edges = np.linspace(0, np.pi, 181) if edges is None else np.ascontiguousarray(edges, float)
    if surface.kind == DIELECTRIC:
        if radius != 1:
            raise ValueError(f"radius {radius:g}: the closed form of a dielectric ball fills its bounding sphere (radius 1)")
        return _dielectric(surface.index, mu, edges, polarised)
    return _opaque(surface, edges, radius)


@cache
def _legendre():
    return np.polynomial.legendre.leggauss(NODES)


def _gauss(*cuts):
    """Nodes and weights on [cuts[0], cuts[-1]], Gauss-Legendre in each piece after squaring away a root at its lower end."""
    x, w = _legendre()
    t, w = 0.5 * (x + 1), 0.5 * w
    return (np.concatenate([a + (b - a) * t**2 for a, b in zip(cuts, cuts[1:])]),
            np.concatenate([(b - a) * 2 * t * w for a, b in zip(cuts, cuts[1:])]))


def _refracted(c, index):
    """Cosine of refraction and Fresnel's two reflectances; total reflection: 0 and 1."""
    beyond = np.sqrt(np.maximum((index - 1) * (index + 1) + c * c, 0.0)) / index  # no 1 - sin^2: holds at grazing, index near 1
    s, p = ((c - index * beyond) / (c + index * beyond)) ** 2, ((index * c - beyond) / (index * c + beyond)) ** 2
    return beyond, s, p


def _dielectric(index, mu, edges, polarised):
    contrast = abs(index - 1) * (index + 1)
    knee = math.sqrt(contrast) if index < 1 else min(math.sqrt(contrast), 0.7)  # total reflection up to here if index < 1
    c, w = _gauss(*([0.0, knee, min(4 * knee, 0.5 * (1 + knee)), 1.0] if knee else [0.0, 1.0]))
    w = 2 * c * w
    beyond, *reflectances = _refracted(c, index)
    a, b = np.arccos(c), np.arccos(beyond)
    turn = 2 * np.arcsin(np.clip(beyond, 0, 1))  # delta = pi - 2 b
    absorbed = np.exp(-2 * mu[:, None] * beyond)
    rows = np.zeros((5, len(mu)))
    for F in reflectances if polarised else [0.5 * (reflectances[0] + reflectances[1])]:
        inward = np.where(F < 1, (1 - F) ** 2, 0.0)
        back = np.exp(-1j * turn)
        series = inward * absorbed / np.where(inward > 0, 1 - F * absorbed, 1.0)
        phased = inward * absorbed / np.where(inward > 0, 1 - F * absorbed * back, 1.0)
        rows += np.stack([
            (F + series) @ w, (-F * (2 * c * c - 1) + (np.exp(-2j * (a - b)) * phased).real) @ w,
            (series * c + (np.exp(1j * (np.pi - a - turn)) * phased).real) @ w, (2 * series - 2 * (back * phased).real) @ w,
            (2 * beyond * series / np.where(inward > 0, 1 - F * absorbed, 1.0)) @ w]) / (2 if polarised else 1)
    albedo, g, lambda_s, square, inner = rows
    safe = np.where(albedo > 0, albedo, 1.0)
    if index == 1:
        phase, error = np.full((len(mu), len(edges) - 1), 1 / (4 * np.pi)), np.zeros((len(mu), len(edges) - 1))
    else:
        fine, coarse = (_histogram(index, mu, edges, polarised, rays) for rays in (_RAYS, _RAYS // 2))
        phase, error = fine, np.abs(fine - coarse)
    forward = np.full(len(mu), float(index == 1))
    lambda_s = lambda_s / safe
    return Ball(1.0, 0.0, 4 / 3, albedo, lambda_s, lambda_s, square / safe, g / safe, forward, inner / safe, phase, edges,
                {"phase": error})


def _histogram(index, mu, edges, polarised, rays):
    """Phase function (C, B) of a dielectric ball, means over the bins, 1/sr, normalised."""
    # cosine of incidence at ends and middles of intervals: even in the angle at the axis, dense at grazing
    c = np.maximum(np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 2 * rays + 1) ** 2), 1e-300)
    beyond, s, p = _refracted(c, index)
    a, b, turn = np.arccos(c), np.arccos(np.clip(beyond, 0, 1)), 2 * np.arcsin(np.clip(beyond, 0, 1))
    share = np.diff(c[::2] ** 2)  # of the disc
    out = np.zeros((len(mu), len(edges) - 1))
    for F in (s, p) if polarised else [0.5 * (s + p)]:
        absorbed = np.exp(-2 * mu[:, None] * beyond[1::2])
        _deposit(np.pi - 2 * a[::2], 2 * (a - b)[::2], turn[::2], F[1::2], absorbed, share, edges, out)
    return out / (out.sum(1, keepdims=True) * 2 * np.pi * -np.diff(np.cos(edges)))


@njit(cache=True, nogil=True, error_model="numpy")
def _deposit(reflected, refracted, turn, F, absorbed, share, edges, out):
    """Add light to bins of theta: an interval of incidence spreads it evenly over the angles between those of its ends."""
    faint, light = _FAINT / len(share), np.empty(len(out))
    for i in range(len(share)):
        light[:] = F[i] * share[i]
        _spread(reflected[i], reflected[i + 1], light, edges, out)
        for c in range(len(out)):
            light[c] = (1.0 - F[i]) ** 2 * absorbed[c, i] * share[i]
        p = 0
        while np.max(light) > faint * (1.0 - F[i]):  # what is left is less than the share of this interval in _FAINT
            _spread(refracted[i] + p * turn[i], refracted[i + 1] + p * turn[i + 1], light, edges, out)
            for c in range(len(out)):
                light[c] *= F[i] * absorbed[c, i]
            p += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _spread(x, y, light, edges, out):
    """Light (C,) spread evenly over turned angles between x and y, folded into 0 ... pi, onto rows of bins (C, B)."""
    x, y = min(x, y), max(x, y)
    narrow = y - x < 1e-15
    over = 1.0 if narrow else 1.0 / (y - x)
    bins = out.shape[1]
    for fold in range(math.floor(x / math.pi), math.floor(y / math.pi) + 1):
        low, high = max(x - fold * math.pi, 0.0), min(y - fold * math.pi, math.pi)
        if fold % 2:
            low, high = math.pi - high, math.pi - low
        k = min(max(np.searchsorted(edges, low, "right") - 1, 0), bins - 1)
        if narrow:
            out[:, k] += light
            break
        while k < bins and edges[k] < high:
            part = over * max(min(high, edges[k + 1]) - max(low, edges[k]), 0.0)
            for c in range(len(light)):
                out[c, k] += light[c] * part
            k += 1


def _opaque(surface, edges, radius):
    """Lambertian ball or conductor: one reflection; r is the way between the two spheres for a ray at cosine c to the normal."""
    a, h = radius, math.sqrt((1 - radius) * (1 + radius))
    c, w = _gauss(0.0, min(0.7, max(h / a, 1e-3)), 1.0)
    w = 2 * c * w
    r = h * h / (np.sqrt(a * a * c * c + h * h) + a * c)
    solid = 2 * np.pi * -np.diff(np.cos(edges))
    if surface.kind == DIFFUSE:  # both cosines independent, and cos theta = -(product) on average over the azimuth
        albedo, light = surface.channels[0].copy(), 1.0
        tilted = float((r * c) @ w)
        lambda_s, square, g = r @ w - (2 / 3) * tilted, 2 * (r * r) @ w - 2 * tilted**2, -4 / 9
        phase = np.diff((4 / (3 * np.pi)) * (edges / 2 + edges * np.cos(2 * edges) / 4 - 3 * np.sin(2 * edges) / 8)) / solid
    else:  # cos theta = 1 - 2 c^2, so that 2 c dc is uniform on the sphere of directions
        F = _reflectance(surface.channels, c)
        albedo = F @ w
        light = np.where(albedo > 0, albedo, 1.0)
        s2 = (1 - c) * (1 + c)
        lambda_s, square, g = F @ (w * 2 * r * s2) / light, F @ (w * 4 * r * r * s2) / light, F @ (w * (1 - 2 * c * c)) / light
        x, v = np.polynomial.legendre.leggauss(8)
        middle, half = 0.5 * (np.cos(edges[1:]) + np.cos(edges[:-1])), -0.5 * np.diff(np.cos(edges))
        cosine = np.sqrt(np.maximum(0.5 * (1 - middle[:, None] - half[:, None] * x), 0.0))
        phase = _reflectance(surface.channels, cosine) @ v / (8 * np.pi * light[:, None])
        phase[albedo == 0] = 1 / (4 * np.pi)
    like = np.ones_like(albedo)
    lambda_s, square, g = lambda_s * like, square * like, g * like
    phase = phase * like[:, None]
    return Ball(a * a, (4 / 3) * h, (4 / 3) * (1 - h**3) / a**2, albedo, lambda_s, lambda_s, square, g, 0 * like, 0 * like, phase,
                edges, {"phase": np.zeros_like(phase)})


def _reflectance(channels, cosine):
    """Fresnel's mean reflectance (C, ...) of conductors (2, C) at cosines (...)."""
    return np.stack([np.reshape([fresnel_conductor(x, n, k) for x in np.ravel(cosine)], np.shape(cosine)) for n, k in channels.T])
