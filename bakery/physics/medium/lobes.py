"""Phase functions of production renderers: mixtures of Henyey-Greenstein and Draine lobes, and how far one is from a table.

Draine's function with alpha = 0 is Henyey and Greenstein's, with alpha = 1 that of Cornette and Shanks, with g = 0 and alpha = 1
Rayleigh's; so every mixture here is one of Draine lobes.  The fits themselves stand in `lobe_fits`.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.medium.phase import mean_cosine, phase_at

FAINT = 1e-9  # 1/sr; smaller values count as this one in ratios: tables hold zeros, and a ratio to them says nothing
PUBLISHED = (0.1, 50.0)  # um, diameters that `published` takes: the branch below is quoted in two versions, so left out
_RATIO = 1.25  # steps of the quadrature towards 0 and pi: two Gauss points a step leave 2e-5 of a lobe
_WIDEST = math.radians(3)
_NEAREST = 1e-10  # rad, where these steps begin: a hundredth of the narrowest lobe of `lobe_fits`
_GAUSS = 0.5 / math.sqrt(3)


@dataclass(frozen=True)
class Lobes:
    """A mixture of Draine lobes, normalised over the sphere."""

    weight: tuple[float, ...]  # (K,) 1, shares of the light, add up to 1
    g: tuple[float, ...]  # (K,) 1, -1 < g < 1
    alpha: tuple[float, ...]  # (K,) 1, >= 0; 0 for Henyey-Greenstein

    def __call__(self, theta):
        """Values at angles (...,) rad, 1/sr."""
        return sum(w * draine(theta, g, a) for w, g, a in zip(self.weight, self.g, self.alpha, strict=True))

    @property
    def mean_cosine(self) -> float:
        """Mean cosine of the mixture, closed form."""
        return sum(w * draine_mean_cosine(g, a) for w, g, a in zip(self.weight, self.g, self.alpha, strict=True))


@dataclass(frozen=True)
class Misfit:
    """What a mixture loses against a table."""

    misdirected: float  # 1, share of the scattered light that goes to another angle: half of the integral of |fit - table|
    g: float  # 1, mean cosine of the fit less that of the table
    # log_sphere, log_angle: 1, root mean square of log10(fit / table), mean over solid angle and over theta
    log_sphere: float
    log_angle: float
    # factor, factor_at: 1, rad: the ratio fit / table that is furthest from 1, and where
    factor: float
    factor_at: float
    # peak, peak_table: 1, share of the fit's, and of the table's, light within peak_angle
    peak: float
    peak_table: float
    peak_angle: float  # rad, where the table has fallen to half of its forward value (pi where it never does)


def draine(theta, g, alpha):
    """Draine's phase function.

    theta : (...,) rad
    g : float, -1 < g < 1; the mean cosine only where alpha = 0
    alpha : float, >= 0

    Returns (...,) 1/sr, integrates to 1 over the sphere

    Source: Draine, Astrophys. J. 598, 1017 (2003).
    """
    a = abs(g)
    # 1 + g^2 - 2 g cos theta, written without cancellation for |g| -> 1
    away = np.sin(0.5 * np.asarray(theta)) ** 2 if g >= 0 else np.cos(0.5 * np.asarray(theta)) ** 2
    below = (1 - a) ** 2 + 4 * a * away
    scale = (1 - a) * (1 + a) / (4 * math.pi * (1 + alpha * (1 + 2 * g * g) / 3))
    return scale * (1 + alpha * (1 - 2 * away) ** 2) / (below * np.sqrt(below))


def draine_mean_cosine(g, alpha):
    """Mean cosine of Draine's function: of HG's moments <cos^2> = (1 + 2 g^2)/3 and <cos^3> = g (3 + 2 g^2)/5.

    Checked against quadrature with 30 digits.
    """
    return g * (1 + alpha * (3 + 2 * g * g) / 5) / (1 + alpha * (1 + 2 * g * g) / 3)


def published(diameter: float) -> Lobes:
    """HG + Draine of water droplets in air by their diameter in um, above 0.1 to 50.

    Raises ValueError : a diameter outside

    Source: Jendersie & d'Eon, "An Approximate Mie Scattering Function for Fog and Cloud Rendering", SIGGRAPH 2023 Talks,
    and the supplement for diameters below 5 um; coefficients as several public renderers quote them alike.
    """
    low, high = PUBLISHED
    if not low < diameter <= high:
        raise ValueError(f"diameters above {low:g} to {high:g} um")
    d, log = diameter, math.log(diameter)
    if d >= 5:
        g_hg = math.exp(-0.0990567 / (d - 1.67154))
        g_d = math.exp(-2.20679 / (d + 3.91029) - 0.428934)
        alpha = math.exp(3.62489 - 8.29288 / (d + 5.52825))
        w = math.exp(-0.599085 / (d - 0.641583) - 0.665888)
    elif d >= 1.5:
        g_hg = 0.0604931 * math.log(log) + 0.940256
        g_d = 0.500411 - 0.081287 / (-2 * log + math.tan(log) + 1.27551)
        alpha = 7.30354 * log + 6.31675
        w = 0.026914 * (log - math.cos(5.68947 * (math.log(log) - 0.0292149))) + 0.376475
    else:
        inner = (log - 0.238604) * (log + 1.00667) / (0.507522 - 0.15677 * log)
        g_hg = 0.862 - 0.143 * log * log
        g_d = 0.379685 * math.cos(1.19692 * math.cos(inner) + 1.37932 * log + 0.0625835) + 0.344213
        alpha = 250.0
        w = 0.146209 * math.cos(3.38707 * log + 2.11193) + 0.316072 + 0.0778917 * log
    return Lobes((1 - w, w), (g_hg, g_d), (0.0, alpha))


def quadrature(theta, most: int | None = None):
    """Angles and weights for integrals over the sphere of a table's difference to lobes of any width.

    Parameters
    ----------
    theta : (A,) rad, the table's angles, ascending from 0 to pi
    most : largest number of the table's cells; where it has more only every n-th angle bounds one

    Returns
    -------
    at : (N,) rad; two Gauss points in each cell between the table's angles and angles in steps of a quarter towards 0 and pi
    solid : (N,) sr, add up to 4 pi
    """
    theta = np.asarray(theta, float)
    every = 1 if most is None else -(-len(theta) // most)
    near = np.geomspace(_NEAREST, math.pi / 2, math.ceil(math.log(math.pi / 2 / _NEAREST) / math.log(_RATIO)))
    even = np.linspace(0, math.pi, round(math.pi / _WIDEST) + 1)
    edges = np.unique(np.concatenate([theta[::every], [math.pi], even, near, math.pi - near]))
    middle, width = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    at = (middle[:, None] + width[:, None] * np.array([-_GAUSS, _GAUSS])).reshape(-1)
    return at, 2 * math.pi * np.sin(at) * np.repeat(width / 2, 2)


def misfit(theta, phase, lobes: Lobes) -> Misfit:
    """How far a mixture is from a table.

    theta, phase : (A,) rad, 1/sr; linear in cos theta, integrates to 1 over the sphere

    Integrals are to about 3e-5: the kink of |fit - table| lies inside of cells.  `factor` looks at the table's own angles.
    """
    theta, phase = np.asarray(theta, float), np.asarray(phase, float)
    at, solid = quadrature(theta)
    table, fit = phase_at(theta, phase, at), lobes(at)
    log = np.log10(np.maximum(fit, FAINT) / np.maximum(table, FAINT))
    angle = solid / (2 * math.pi**2 * np.sin(at))  # d theta / pi
    ratio = np.maximum(lobes(theta), FAINT) / np.maximum(phase, FAINT)
    worst = int(np.argmax(np.abs(np.log(ratio))))
    below = np.flatnonzero(phase < 0.5 * phase[0])
    edge = float(theta[below[0]]) if below.size else math.pi
    inside = at < edge
    return Misfit(
        misdirected=float(0.5 * np.sum(solid * np.abs(fit - table))), g=float(lobes.mean_cosine - mean_cosine(theta, phase)),
        log_sphere=float(np.sqrt(np.sum(solid * log**2) / (4 * math.pi))), log_angle=float(np.sqrt(np.sum(angle * log**2))),
        factor=float(ratio[worst]), factor_at=float(theta[worst]), peak=float(np.sum((solid * fit)[inside])),
        peak_table=float(np.sum((solid * table)[inside])), peak_angle=edge)
