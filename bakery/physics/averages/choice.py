"""From which size on rays stand for series: decided by the measured error of rays, and by whether they save time.

The metric is what matters to a renderer: the integrated difference of the size-averaged phase functions, over the integral (twice
the share of light that goes elsewhere).  Cross sections always come from series, which without angles cost next to nothing.
The error is measured on sample spheres drawn evenly from the distribution's own nodes.  Errors of single spheres partly
cancel in an average; fewer samples cancel less, so the figure errs on the safe side.  No clock takes part: the choice depends on
the recipe alone.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bakery.physics.averages.predicted import angular_seconds
from bakery.physics.averages.spheres import Channel, Rays, features_of
from bakery.physics.medium import grid, phase

LOWEST = 30.0  # size parameter below which rays are never taken: their windows of exact waves hold most of the series there
SAMPLES, _FEWEST_SAMPLES = 128, 8  # spheres
COMPARING = 1.2  # seconds, as predicted, that comparisons of all channels may take: a plan waits for them
WORTH = 0.2  # share of the angular work that rays have to save to be worth an approximation
TYPICAL_ANGLES = 300  # that share the coefficients of a sphere in one pass: they decide from which size on rays save time
_MOST_ANGLES = 2000
_NEIGHBOURS = 2  # sample angles on either side that share their largest difference


@dataclass(frozen=True)
class Choice:
    """Where rays are taken for one component at one wavelength, and what that costs in accuracy."""

    switch: float  # size parameter from which rays are taken; inf: nowhere
    error: float  # 1, integrated difference of the averaged phase functions, over its integral
    saved: float  # share of the angular work that rays save, as predicted
    # theta, difference: (A,) rad, 1/sr; the largest difference of the normalised phase functions near each sample angle
    theta: np.ndarray
    difference: np.ndarray
    why: str  # in words

    @property
    def taken(self) -> bool:
        return math.isfinite(self.switch)


NONE = np.empty(0)


def at_once(function: Callable, *arguments):
    """The `remember` that remembers nothing."""
    return function(*arguments)


def choose(channels: Sequence[Channel], tolerance: float, rays: Rays, remember: Callable = at_once) -> list[Choice]:
    """The choice for each channel.

    channels : components at wavelengths
    tolerance : largest integrated difference that `auto` accepts
    rays : `method` "mie" (never), "goa" (from `switch`, or x = 30, whatever the error, which is measured all the same) or "auto"
        (the smallest size parameter from which the error stays within the tolerance and rays cost less than series)
    remember : `remember(function, *arguments)` -> `function(*arguments)`, a Choice, now or as it was found for equal arguments
    """
    return [_choose(channel, tolerance, rays, COMPARING / len(channels), remember) for channel in channels]


def _choose(channel: Channel, tolerance: float, rays: Rays, seconds: float, remember: Callable) -> Choice:
    if rays.method == "mie":
        return _never("phase.method is mie")
    if channel.coated:
        return _never("coated spheres go by series")
    largest = channel.k * channel.nodes.span()[1]
    lowest = max(LOWEST, rays.switch or LOWEST)
    if largest < lowest:
        return _never(f"all size parameters are below {lowest:.4g}")
    if rays.method == "auto":
        pays = _crossing(channel.m, rays)
        if largest < pays:
            return _never(f"all size parameters are below {pays:.4g}, from which on rays save time")
        lowest = max(lowest, pays)
    radius, weight = _samples(channel, SAMPLES)
    if rays.method == "auto" and _saved(channel.m, channel.k * radius, lowest, rays) < WORTH:
        return _never(f"rays would save less than {100 * WORTH:g} % of the time, whatever their error")
    features = tuple(features_of(channel))
    needed = float(np.sum(angular_seconds(channel.m, channel.k * radius, len(_angles(channel.m, features)))))
    if needed > seconds:
        radius, weight = _samples(channel, max(_FEWEST_SAMPLES, int(SAMPLES * seconds / needed)))
    return remember(_measured, channel.m, tuple((channel.k * radius).tolist()), tuple(weight.tolist()), features, lowest,
                    tolerance if rays.method == "auto" else math.inf, rays)


def _never(why) -> Choice:
    return Choice(math.inf, 0.0, 0.0, NONE, NONE, why)


def _crossing(m: complex, rays: Rays) -> float:
    """Size parameter from which rays cost less than series."""
    x = np.geomspace(LOWEST, 2e6, 200)
    pays = angular_seconds(m, x, TYPICAL_ANGLES, rays=rays) < angular_seconds(m, x, TYPICAL_ANGLES)
    return float(x[np.argmax(pays)]) if pays.any() else math.inf


def _samples(channel: Channel, count: int):
    """Radii and weights of at most `count` spheres: the middle node of runs of equal number, with the weight of the run."""
    radius, weight = channel.nodes.whole(min(2, channel.nodes.levels - 1))
    used = np.flatnonzero(weight > 0)
    runs = np.array_split(used, min(count, len(used)))
    return np.array([radius[run[len(run) // 2]] for run in runs]), np.array([math.fsum(weight[run]) for run in runs])


@lru_cache(maxsize=64)
def _measured(m, x, weight, features, lowest, allowed, rays) -> Choice:
    """The choice by comparison with series; kept, because plan and bake ask for the same."""
    from bakery.physics.goa import intensity_block as by_rays
    from bakery.physics.mie import in_threads
    from bakery.physics.mie.angular import intensity_block as by_series

    x, weight = np.array(x), np.array(weight)
    large = np.flatnonzero(x >= lowest)
    if not len(large):
        return _never(f"hardly any size parameter is above {lowest:.4g}")
    theta = _angles(m, features)
    series, unit_weight = np.zeros((len(x), len(theta))), np.ones(1)
    by_ray = np.zeros_like(series)
    # a plan waits for it; the largest spheres, which take longest, begin
    in_threads(lambda i: by_series(complex(m), x[i : i + 1], unit_weight, theta, series[i]), np.argsort(-x))
    in_threads(lambda i: by_rays(complex(m), x[i : i + 1], unit_weight, theta, by_ray[i], rays.orders, **rays.options),
               large[::-1])
    exact, _ = phase.normalised(theta, weight @ series)
    # from above: the average with rays for all samples from i on
    change = np.cumsum((weight[:, None] * (by_ray - series))[large][::-1], axis=0)[::-1]
    hybrid, _ = phase.normalised(theta, np.maximum(weight @ series + change, 0.0))
    error = 2 * math.pi * np.sum(phase.areas(theta) * np.abs(hybrid - exact), axis=-1)
    good = error <= allowed
    # the smallest size from which the error stays within what is allowed
    first = len(good) - int(np.argmin(good[::-1])) if not good.all() else 0
    if first == len(good):
        return _never(f"rays would be off by {error.min():.2g} at best where they save time (x from {x[large[0]]:.4g}), "
                      f"more than the tolerance of {allowed:.2g}")
    # half-way to the next smaller sample, so that the switch depends smoothly on the sizes; never below the bound
    start = large[first]
    switch = lowest if start == 0 or x[start - 1] < lowest else math.sqrt(x[start] * x[start - 1])
    saved = _saved(m, x, switch, rays)
    if math.isfinite(allowed) and saved < WORTH:
        where = f" with the spheres for which they are good enough (off by {error[0]:.2g} with all)" if first else ""
        return _never(f"rays would save less than {100 * WORTH:g} % of the time{where}")
    index = np.arange(len(exact))
    difference = grid.largest(np.abs(hybrid[first] - exact), np.maximum(index - _NEIGHBOURS, 0),
                              np.minimum(index + _NEIGHBOURS + 1, len(index)))
    return Choice(float(switch), float(error[first]), saved, theta, difference,
                  f"rays from x = {switch:.4g}: off by {error[first]:.2g}, saves {100 * saved:.0f} % of the angular work")


def _saved(m, x, switch, rays) -> float:
    """Share of the angular work that rays save; nodes are as dense as the samples."""
    series = angular_seconds(m, x, TYPICAL_ANGLES)
    mixed = np.where(x >= switch, angular_seconds(m, x, TYPICAL_ANGLES, rays=rays), series)
    return float(1 - np.sum(mixed) / np.sum(series))


def _angles(m, features):
    """Sample angles: dense at 0, pi and the rainbows; ripples of equal spheres are not resolved, they average out."""
    bows = [(angle, x ** (-2 / 3)) for x, _ in features if x > 20 for angle in grid.bows(m.real)]
    theta = grid.start([(x, math.inf) for x, _ in features], bows)
    # a sample in each cell at a fixed irregular place: equal steps could fall in with the ripples
    inner = theta[:-1] + np.diff(theta) * (0.25 + 0.5 * np.modf(np.arange(len(theta) - 1) * 0.6180339887498949)[0])
    theta = np.union1d(theta, inner)
    if len(theta) > _MOST_ANGLES:
        theta = theta[np.linspace(0, len(theta) - 1, _MOST_ANGLES).astype(int)]
    return theta
