"""What averages over sizes will take: angles, nodes, seconds, memory and file, from the recipe's figures alone.

Seconds are operation counts times rates.  The counts were fitted to runs of 16 varied distributions at tolerances of 3, 1 and
0.3 % (docs/averages.md gives the spread); the rates hold for one core of the machine named below.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bakery.physics.averages.spheres import Aim, Channel, Rays, features_of, terms

# seconds on one core of an AMD EPYC (Zen 5, AVX-512): benchmarks/averages.py --rates
CROSS = 2e-9  # per term of a sphere's series, cross sections only
COEFFICIENT = 11e-9  # per term, where angles follow
COATED = 120e-9  # per term of a coated sphere's series, with and without angles: benchmarks/coated.py
INTENSITY = 0.13e-9  # per term and angle
MUELLER = 0.15e-9
# rays: per angle and sphere, a + b orders^2 and the edge's windows (of bubbles the second one, times sqrt(x)); per sphere, the
# coefficients of these windows, a + b x^(1/3) (sqrt(x)); and once per angle for any number of spheres, tracing
RAY, RAY_ORDERS, EDGE, CRITICAL, TRACE, TRACE_ORDERS = 15e-9, 3.3e-9, 50e-9, 3e-9, 25e-9, 9e-9
START, START_EDGE, START_CRITICAL = 2e-6, 0.19e-6, 0.3e-6
LOADING = 0.25  # seconds, same machine
FIRST_LEVEL = 2  # level before which nothing has converged: steps in size parameter of ~1
HELD = 64 * 2**20  # bytes of block results held at a time
_DAMPED, _RIPPLES, _RESONANT, _PASSES, _WHOLE, _ROUNDS = 3.5, 5.0, 400.0, 4.0, 16.0, 2.5  # fitted


@dataclass(frozen=True)
class Prediction:
    """What averages are expected to take: seconds of one core, bytes of memory, bytes stored, number of angles, of spheres."""

    seconds: float
    memory: float
    file: float
    angles: int
    spheres: int


def angular_seconds(m, x, angles: int, per_angle: float = INTENSITY, rays: Rays | None = None, coefficient: float = COEFFICIENT):
    """Seconds of one core for amplitudes at `angles` angles of each sphere x (R,), by series, or by rays (traced already)."""
    x = np.asarray(x, float)
    if rays is None:
        return terms(x) * (coefficient + per_angle * angles)
    bubble = m.real < 1
    seconds = np.full(x.shape, (RAY + RAY_ORDERS * rays.orders**2) * angles)
    if rays.edge is not None:
        # small or soft spheres take the series of coefficients from n = 1 on (bakery.goa._asymptotic.reach)
        from_first = (x < 430) | (abs(m - 1) < np.maximum(0.02, 10 * x ** (-2 / 3)))
        start = START + START_EDGE * np.cbrt(x) + bubble * START_CRITICAL * np.sqrt(x)
        seconds += np.where(from_first, terms(x) * COEFFICIENT, start) + (EDGE + bubble * CRITICAL * np.sqrt(x)) * angles
    return seconds


def trace_seconds(angles: int, rays: Rays) -> float:
    """Seconds of one core to trace the rays of any number of spheres."""
    return (TRACE + TRACE_ORDERS * rays.orders**2) * angles


def predict(channels: Sequence[Channel], choices, aim: Aim) -> Prediction:
    """Predicted work of `averages` for its channels and choices; fitted to 30 varied runs (docs/averages.md)."""
    tolerance, polarized, integrated, _, angles, rays, *_ = aim
    count = angles or predicted_angles([f for c in channels for f in features_of(c)], tolerance)
    per_angle = MUELLER if polarized else INTENSITY
    computed = (2 if angles else 2.3) * count  # an angle between neighbours is computed for each that is kept
    seconds, spheres, rows = 0.02 + 0.003 * len(channels), 0, 0
    for channel, choice in zip(channels, choices):
        cross, coefficient = (COATED, COATED) if channel.coated else (CROSS, COEFFICIENT)

        def sums(radius, passes, shown, channel=channel, choice=choice, coefficient=coefficient):
            x = channel.k * radius
            if not choice.taken:
                return float(np.sum(terms(x))) * (coefficient * passes + per_angle * shown)
            large = x >= choice.switch
            seconds = float(np.sum(terms(x[~large]))) * (coefficient * passes + per_angle * shown)
            if large.any():
                without = float(np.sum(angular_seconds(channel.m, x[large], 0, rays=rays)))
                seconds += without * (passes - 1) + float(np.sum(angular_seconds(channel.m, x[large], shown, rays=rays)))
            return seconds

        fixed = channel.nodes.fixed()[0]
        if len(fixed):
            seconds += float(np.sum(terms(channel.k * fixed))) * cross + sums(fixed, 5, computed)
            spheres += len(fixed)
            rows += len(fixed)
        if channel.nodes.refinable:
            first = channel.nodes.fresh(0)[0]
            # the integral of rays is not known: what tables by rays miss counts twice
            most, last = _doublings(channel, tolerance / 2 if integrated and choice.taken else tolerance, integrated)
            seconds += float(np.sum(terms(channel.k * first))) * last * cross
            seconds += sums(first, last * (_ROUNDS if integrated else _PASSES), most * computed)
            spheres += int(len(first) * last)
            rows += len(first) * 2**FIRST_LEVEL
        if choice.taken:
            seconds += _PASSES * trace_seconds(computed, rays)
    elements = 4 if polarized else 1
    memory = 8 * count * len(channels) * (8 * elements + 20) + 2 * HELD + 100 * spheres
    file = 8 * (len(channels) * count * (elements + 1) + 4 * rows)
    return Prediction(seconds, memory, file, int(count), spheres)


def _doublings(channel, tolerance, integrated=False):
    """Nodes that most angles take, and that the last one takes, over the nodes of the first level.

    Spheres that absorb, and bubbles, are smooth once the ripples are resolved; in others resonances decide, and nodes go like
    the square root of the size parameter and nearly like 1/tolerance.
    """
    if channel.nodes.counted:
        return 2.0**FIRST_LEVEL, 2.0**FIRST_LEVEL
    fine, absorption, last = 0.01 / tolerance, 4 * channel.m.imag, 2.0 ** (channel.nodes.levels - 1)
    if integrated:  # resonances hardly count in the whole, and not at all in spheres that absorb
        damped = 1 + 5 * absorption * min((x for x, _ in features_of(channel)), default=0.0)
        most = min(2.0**FIRST_LEVEL * max(1.0, _WHOLE * fine**1.25 / damped), last)
        return most, most
    most, resonant = 2.0**FIRST_LEVEL * max(1.0, fine) ** 0.6, False
    for (x, width), first in zip(features_of(channel)[len(channel.nodes.fixed()[0]) :], channel.nodes.first):
        if channel.m.real > 1:
            need = _RESONANT * math.sqrt(x) * fine**0.8 / (1 + 5 * absorption * x) * min(1.0, width / 0.05) / first
            most, resonant = max(most, need), resonant or need > most
    return min(most, last), min(4 * most * (fine if resonant else 1.0), last)


def predicted_angles(features, tolerance):
    """Angles that a tolerance takes, from (size parameter, relative width) of each distribution."""
    fine = math.sqrt(0.01 / tolerance)
    smooth = 180 + 60 * fine * math.log10(max(1.0, *(x for x, _ in features)))
    ripples = 0.0
    for x, width in features:
        if x > 1:
            reach = min(math.pi, _DAMPED / (x * max(width, 1e-300)))
            ripples = max(ripples, _RIPPLES * x * reach * fine)
    return smooth + ripples
