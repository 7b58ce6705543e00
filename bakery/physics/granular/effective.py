"""The continuous medium that stands for packed grains: statistics of grains and a packing become sigma_t.

Light flies from grain to grain and is teleported from where it enters a bounding sphere to where it leaves.  Equations 1 to 4
are those of Meng et al. 2015 (ACM Trans. Graph. 34, 49); formulas and what they leave out: docs/effective-medium.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

_NAMES = ("hit_probability", "lambda_delta", "albedo", "lambda_s", "mean_square", "g", "forward_delta", "phase")


@dataclass(frozen=True)
class Means:
    """What packed grains need of a grain's statistics, as in `scatterometer.Statistics`; L channels, A angles or bins."""

    hit_probability: float  # share of the rays through the bounding sphere that hit
    lambda_delta: float  # mean chord of those that miss
    albedo: np.ndarray  # (L,) share of the light of hits that leaves; of it:
    # lambda_s, mean_square: (L,) mean displacement along the incoming direction, mean squared distance, from entry to exit
    lambda_s: np.ndarray
    mean_square: np.ndarray
    # g, forward_delta: (L,) mean cosine, unscattered (delta) share
    g: np.ndarray
    forward_delta: np.ndarray
    phase: np.ndarray | None = None  # (L, A) 1/sr, of what is deflected, or None
    # standard errors by name, of the same shapes; a figure that is not there is exact
    errors: dict[str, float | np.ndarray] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, statistics) -> Means:
        """From `scatterometer.Statistics` or a `sphere.Ball`."""
        return cls(**{name: getattr(statistics, name) for name in _NAMES},
                   errors={name: statistics.errors[name] for name in _NAMES if name in statistics.errors})

    def figure(self, name):
        """Value and standard error."""
        value, error = getattr(self, name), self.errors.get(name, 0.0)
        return np.asarray(value, float), np.broadcast_to(np.asarray(error, float), np.shape(value))


def mixed(parts: Sequence[Means], weights=(1.0,), radii=None) -> Means:
    """Statistics of one grain of a mixture: which one a ray meets is chance.

    parts : K of the same channels and angles; lengths in units of each one's bounding radius.  Several sizes of a grain that
        absorbs are several parts: its absorption over a radius differs
    weights : (K,) shares of the number of grains, >= 0; their sum does not matter
    radii : (K,) bounding radii, any unit, which the lengths of the result have; all 1 by default

    Returns Means, 0 for means over no light at all, and an even phase function then.

    A ray meets part k in proportion to its number and cross section, w_k R_k^2.  Means are over the light that they belong to:
    the albedo over hits, lambda_s and g over light that leaves, the phase function over light that leaves changed.

    Errors: to first order in them.  Different parts have been measured apart.  In one part a mean over hits is uncorrelated with
    the share of hits, and a mean over light that leaves nearly so with the share that leaves, so they add in quadrature.
    """
    weights = np.asarray(weights, float)
    radii = np.ones(len(parts)) if radii is None else np.asarray(radii, float)
    if not parts or weights.shape != (len(parts),) or radii.shape != (len(parts),):
        raise ValueError(f"{len(parts)} parts with {weights.size} weights and {radii.size} radii: as many of each are needed")
    if not (np.all(weights >= 0) and 0 < np.sum(weights) < np.inf):
        raise ValueError(f"weights {weights.tolist()}: numbers >= 0 with a positive sum are needed")
    if not np.all((radii > 0) & np.isfinite(radii)):
        raise ValueError(f"radii {radii.tolist()}: positive lengths are needed")
    meets = weights * (radii / radii.max()) ** 2
    meets = (meets / np.sum(meets))[:, None]

    def figures(name, power=0):
        """Values and errors (K, ...) of a figure that is a length to a power."""
        pairs = [part.figure(name) for part in parts]
        values, errors = (np.stack([np.atleast_1d(x) for x in column]) for column in zip(*pairs))
        scale = (radii**power).reshape(-1, *[1] * (values.ndim - 1))
        return values * scale, errors * scale

    beta = figures("hit_probability")
    alpha, forward = figures("albedo"), figures("forward_delta")
    hits, missed = (meets * beta[0], meets * beta[1]), (meets * (1 - beta[0]), meets * beta[1])
    light = _times(hits, alpha)
    changed = _times(light, (1 - forward[0], forward[1]))
    over = {"hit_probability": ((meets, 0.0), beta), "lambda_delta": (missed, figures("lambda_delta", 1)),
            "albedo": (hits, alpha), "lambda_s": (light, figures("lambda_s", 1)),
            "mean_square": (light, figures("mean_square", 2)), "g": (light, figures("g")), "forward_delta": (light, forward)}
    values, errors = {}, {}
    for name, (weight, x) in over.items():
        values[name], errors[name] = _average(weight, x)
    for name in ("hit_probability", "lambda_delta"):
        values[name], errors[name] = float(values[name][0]), float(errors[name][0])
    if all(part.phase is not None for part in parts):
        values["phase"], errors["phase"] = _average(tuple(x[..., None] for x in changed), figures("phase"))
        dark = np.sum(changed[0], axis=0) == 0
        values["phase"] = np.where(dark[:, None], 1 / (4 * math.pi), values["phase"])
    return Means(**values, errors=errors)


def mixed_of_sizes(values, errors, weights, radii, shares, lossless=False) -> Means:
    """`mixed` of grains that all come in the same sizes.

    values, errors : (K,) of each grain, name as in `Means` -> (S, ...) over its sizes
    weights : (K,) shares of the number of grains
    radii, shares : (S,) bounding radii, which the lengths of the result have the unit of; shares of the number
    lossless : whether the grains absorb nothing, whatever their albedo
    """
    parts, numbers, sizes = [], [], []
    for weight, value, error in zip(weights, values, errors):
        for s, (radius, share) in enumerate(zip(radii, shares)):
            figures, off = {name: x[s] for name, x in value.items()}, {name: x[s] for name, x in error.items()}
            for name in ("hit_probability", "lambda_delta"):
                figures[name], off[name] = float(figures[name][0]), float(off[name][0])
            if lossless:
                figures["albedo"], off["albedo"] = np.ones_like(figures["g"]), np.zeros_like(figures["g"])
            parts.append(Means(**figures, errors=off))
            numbers.append(weight * share)
            sizes.append(radius)
    return mixed(parts, numbers, sizes)


def _times(a, b):
    """Product of two quantities with errors, independent."""
    return a[0] * b[0], np.hypot(a[0] * b[1], a[1] * b[0])


def _average(weight, x):
    """Mean over the first axis of x, both with errors, all independent; 0 for 0/0."""
    (w, dw), (x, dx) = weight, x
    whole = np.sum(w, axis=0)
    safe = np.where(whole == 0, 1.0, whole)
    mean = np.sum(w * x, axis=0) / safe
    error = np.sqrt(np.sum((w * dx) ** 2 + (dw * (x - mean)) ** 2, axis=0)) / safe
    return mean, np.where(whole == 0, 0.0, error)


def void_chord(fraction, radii=(1.0,), shares=None):
    """Mean free path between bounding spheres, (4/3) <R^3>/<R^2> (1 - f)/f, in the unit of the radii (Eq. 1 for equal ones).

    fraction : of the volume in bounding spheres, more than 0, less than 1
    radii, shares : (S,) and how many of the spheres have each, by number; equal shares by default

    Exact for every packing of disjoint spheres, and for scattered light as long as grains do not absorb: Eqs 1 to 3 hold for the
    means, their exponential laws are approximations.
    """
    radii = np.asarray(radii, float)
    shares = np.ones_like(radii) if shares is None else np.asarray(shares, float)
    if not 0 < fraction < 1:
        raise ValueError(f"fraction {fraction:g}: more than 0 and less than 1 is possible")
    if shares.shape != radii.shape or not np.all((shares >= 0) & (radii > 0)) or not np.sum(shares) > 0:
        raise ValueError(f"radii {radii.tolist()} with shares {shares.tolist()}: as many shares >= 0 as radii > 0 are needed")
    return float(4 / 3 * np.sum(shares * radii**3) / np.sum(shares * radii**2) * (1 - fraction) / fraction)


def flight(hit_probability, lambda_delta, void_chord):
    """Mean path from leaving a sphere after a hit to entering the sphere of the next hit, Eq. 3; infinite where nothing is hit.

    hit_probability, lambda_delta : as in `Means`, in one unit of length with
    void_chord : mean chord between spheres

    n misses precede a hit with probability beta (1 - beta)^n (Eq. 2): <n> = (1 - beta)/beta.  The flight is a chord between
    spheres and n times a missed one and another between spheres.
    """
    beta = np.asarray(hit_probability, float)
    with np.errstate(divide="ignore"):
        misses = np.where(beta > 0, (1 - beta) / np.where(beta > 0, beta, 1.0), np.inf)
    return void_chord + misses * (void_chord + lambda_delta)


def step(mean, square, lambda_s, mean_square, g, albedo=1.0):
    """M (1 - albedo g), M the mean square displacement per hit of light that goes by `flight` and is teleported by grains.

    mean, square : of the flight
    lambda_s, mean_square, g, albedo : as in `Means`, one unit of length

    Light from a point is absorbed at a mean squared distance <r^2> = M/(1 - albedo); without absorption M is the growth of <r^2>
    a hit.  With independent steps and lambda_s the same along both directions (reciprocity), the sum over all pairs of steps is

        M = z_2 + a (2 z_1 lambda_s + <T^2>) + 2 a (z_1 + a lambda_s) (z_1 g + lambda_s)/(1 - a g),    a the albedo.

    In a medium of mean free path l it is 2 l^2/(1 - a g).  For an exponential flight M is
    2 (z_1 + a lambda_s)^2/(1 - a g) + a <T^2>: the albedo in Eq. 4 is in its place.
    """
    a = np.asarray(albedo, float)
    diagonal = square + a * (2 * mean * lambda_s + mean_square)
    return (1 - a * g) * diagonal + 2 * a * (mean + a * lambda_s) * (mean * g + lambda_s)


@dataclass(frozen=True)
class Effective:
    """The medium; lengths in the unit of what it is made from."""

    # void_chord, lambda_beta: mean paths to the next sphere (Eq. 1) and to the next hit (Eq. 3); infinite if nothing is hit
    void_chord: float
    lambda_beta: float
    flight_square: float  # mean square of the path to the next hit
    # lambda_t, sigma_t: (L,) lambda_beta + albedo lambda_s (Eq. 4) and its inverse
    lambda_t: np.ndarray
    sigma_t: np.ndarray
    # (L,) with which light spreads as far as by flights and teleportation, sqrt(2/((1 - albedo g) m_tele)); that of Eq. 4 where
    # albedo g = 1: such light is never deflected, and only its mean free path is left to match
    sigma_t_second_moment: np.ndarray
    # m_rte, m_tele: (L,) mean square displacement per hit (`step`) of the medium with sigma_t and by flights and teleportation;
    # infinite at albedo g = 1
    m_rte: np.ndarray
    m_tele: np.ndarray
    errors: dict[str, float | np.ndarray] = field(repr=False)  # bounds of the standard errors by name


_FIGURES = ("lambda_beta", "flight_square", "lambda_t", "sigma_t", "sigma_t_second_moment", "m_rte", "m_tele")


def effective(means: Means, void_chord: float) -> Effective:
    """The medium that stands for packed grains, between which light has exponential flights, as in Eq. 4.

    means : of one grain, or of a mixture (`mixed`)
    void_chord : mean chord between bounding spheres, in the unit of the means; without error

    lambda_beta and lambda_t are exact means where nothing is absorbed, and positive for any grain up to a fraction of 0.8.  What
    sigma_t leaves out and how much that is: docs/effective-medium.md.  For light that survives, replace the albedo by 1.

    Errors are the sums of what each figure's standard error changes: figures of one grain err together in unknown ways, and this
    bound covers any.  Infinite where a hit probability cannot be distinguished from 0.

    >>> from bakery.physics.grains import sphere, surface
    >>> glass = Means.of(sphere.ball(surface.dielectric(1.5)))
    >>> round(float(effective(glass, void_chord(0.63)).sigma_t[0]), 6)
    0.453017
    """
    if not (void_chord > 0 and math.isfinite(void_chord)):
        raise ValueError(f"mean chord {void_chord:g} between spheres: a positive length is needed")
    inputs = {name: means.figure(name) for name in ("hit_probability", "lambda_delta", "albedo", "lambda_s", "mean_square", "g")}
    limits = {"hit_probability": (0, 1), "albedo": (0, 1), "g": (-1, 1)}
    figures = {name: value for name, (value, _) in inputs.items()}
    values = _figures(void_chord, **figures)
    errors = [0.0 * value for value in map(np.nan_to_num, values)]
    for name, (value, error) in inputs.items():
        if np.any(error > 0):
            least, most = limits.get(name, (-math.inf, math.inf))
            low, high = (_figures(void_chord, **figures | {name: np.clip(value + e, least, most)}) for e in (-error, error))
            moved = (np.maximum(_distance(a, at), _distance(b, at)) for at, a, b in zip(values, low, high))
            errors = [total + added for total, added in zip(errors, moved)]
    values, errors = ({name: float(x) if x.ndim == 0 else x for name, x in zip(_FIGURES, column)} for column in (values, errors))
    return Effective(void_chord=float(void_chord), **values, errors=errors)


def _distance(a, b):
    """|a - b|, 0 for two infinities."""
    with np.errstate(invalid="ignore"):
        return np.where(a == b, 0.0, np.abs(a - b))


def _figures(void_chord, hit_probability, lambda_delta, albedo, lambda_s, mean_square, g):
    """The values of `_FIGURES`, in their order."""
    mean = flight(hit_probability, lambda_delta, void_chord)
    square = 2 * mean**2
    lambda_t = mean + albedo * lambda_s
    reduced = np.maximum(1 - albedo * g, 0.0)  # a measured g may be 1 and a rounding more
    if np.isinf(mean):
        nothing, for_ever = np.zeros_like(lambda_t), np.full_like(lambda_t, np.inf)
        return mean, square, lambda_t, nothing, nothing, for_ever, for_ever
    squared_step = np.maximum(step(mean, square, lambda_s, mean_square, g, albedo), 0.0)  # 0: light that only goes back and forth
    with np.errstate(divide="ignore"):
        return (mean, square, lambda_t, 1 / lambda_t, np.sqrt(2 / squared_step), 2 * lambda_t**2 / reduced,
                np.where(reduced > 0, squared_step / np.where(reduced > 0, reduced, 1.0), np.inf))
