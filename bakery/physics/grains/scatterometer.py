"""Scattering statistics of a grain from paths through its bounding sphere, with errors, until a tolerance is met: `measure`.

Rays enter as uniform isotropic radiance does (isotropic uniform chords of the unit sphere).  Definitions and figures:
docs/scatterometer.md.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bakery import rng
from bakery.physics.grains.bvh import Mesh
from bakery.physics.grains.figures import WithErrors, in_order
from bakery.physics.grains.points import points, scrambled
from bakery.physics.grains.surface import Surface
from bakery.physics.grains.walk import ABSORBED, CONTRADICTED, CUT, MISSED, Walker
from bakery.physics.tasks import in_turn
from bakery.system.compiled import njit

REPLICATES = 32
HITS_MIN = 1 << 14
PATHS_MAX = 1 << 28
TOLERANCE_MIN = 1e-6
FORWARD = 1e-6  # rad, within which a direction counts as unscattered
CONTRADICTED_MAX, LOST_MAX = 1e-5, 1e-6  # shares that a sound mesh stays below
EDGES = np.linspace(0.0, np.pi, 181)
FIGURES = ("hit_probability", "lambda_delta", "albedo", "lambda_s", "mean_square", "g")
_FIRST, _BLOCK = 512, 8192  # paths of a replicate at first; most in a block
_SHARE = 0.5 * math.sqrt(2 / math.pi)  # of the integral of the phase function's standard error: light that is expected elsewhere
_FLOOR = 0.01  # albedo below which its error is absolute


@dataclass(frozen=True)
class Statistics(WithErrors):
    """Means over uniform isotropic rays through the bounding sphere; lengths in units of its radius R.

    Every figure X has its standard error as X_error, of the same shape.  C channels (absorption coefficients, colours), B bins.
    """

    hit_probability: float  # share of the rays that meet the grain's surface, even if they leave undeflected
    lambda_delta: float  # mean chord of the rays that do not; 0 if there is none
    chord: float  # mean chord of the bounding sphere along the rays that do
    albedo: np.ndarray  # (C,) share of the light that hits which leaves
    # lambda_s, lambda_o: (C,) mean displacement from entry to exit of the sphere, projected on the incoming and on the outgoing
    # direction, over the light that leaves; signed
    lambda_s: np.ndarray
    lambda_o: np.ndarray
    mean_square: np.ndarray  # (C,) mean squared distance of entry and exit, over the light that leaves
    g: np.ndarray  # (C,) mean cosine between the directions of travel, undeflected rays included
    forward_delta: np.ndarray  # (C,) unscattered (delta) share of the light that leaves (to 1e-6 rad)
    inner_path: np.ndarray  # (C,) mean path length inside the grain, over the light that leaves
    # (C, B) 1/sr, means over bins of theta of what leaves changed, integrating to 1 (uniform where nothing does); its error is at
    # least that of one path in the bin
    phase: np.ndarray
    edges: np.ndarray  # (B + 1,) rad, 0 to pi
    paths: int
    hits: int
    events: float  # mean number of meetings with the surface of a ray that hits
    contradicted: float  # share of the paths ended because inside and outside did not agree; they count nowhere
    lost: np.ndarray  # (C,) share of the light that hits which was still under way when a path was cut; counted as absorbed
    achieved_error: float  # largest error of the asked figures, in the unit of the tolerance
    reached: bool  # whether that met the tolerance
    errors: dict[str, float | np.ndarray] = field(repr=False)


def measure(mesh: Mesh, surface: Surface, mu=0.0, *, seed, stream=0, tolerance=0.005, asked=FIGURES, edges=EDGES,
            paths_max=PATHS_MAX, map: Callable | None = None, report: Callable[[float, float], None] | None = None,
            tracer=None) -> Statistics:
    """Scattering statistics of a grain.

    mesh : closed, inside the unit sphere, which is its bounding sphere
    surface : from `bakery.physics.grains.surface`
    mu : (C,) or a number, 1/R, absorption coefficient of the interior (4 pi k / wavelength, times R), >= 0
    seed, stream : whole numbers >= 0; the same ones give the same bytes, on any number of threads
    tolerance : standard error to be reached: relative for hit_probability and for albedo (of 0.01 where that is less), absolute
        for g, in units of R and R^2 for lambda_delta, lambda_s, mean_square; for "phase", half the integral of its error over the
        sphere, the share of the light that goes to another bin, of which sqrt(2/pi) of the standard errors is to be expected
    asked : names of the figures that must meet it
    edges : (B + 1,) rad, ascending from 0 to pi
    paths_max : after about so many paths it ends, `reached` False
    map : `map(function, tasks)` returns [function(*task) for task in tasks]
    report : called with the share of the work that is done and the error reached so far
    tracer : stands in for `walk.Walker(mesh, surface, mu)`: picklable, with its `trace`

    Raises ValueError : before any work

    Rays enter at scrambled Sobol points in 32 independent replicates; errors come from the spread of the replicates (31 degrees
    of freedom).  At least 2^14 hits; then paths are added, a quarter to as many again, until the errors are met.

    >>> from bakery.physics.grains.bvh import Mesh
    >>> from bakery.physics.grains.surface import dielectric
    >>> from bakery.physics.shapes.build import build
    >>> cube = build({"type": "box", "size": [1, 1, 1]})
    >>> glass = measure(Mesh(cube.vertices, cube.faces), dielectric(1.5), seed=1, tolerance=0.05)
    >>> bool(abs(glass.hit_probability - 2 / np.pi) < 5 * glass.errors["hit_probability"])  # Cauchy: a quarter of the surface
    True
    """
    mu, edges = _checked(surface, mu, tolerance, asked, edges)
    tracer = tracer or Walker(mesh, surface, mu)
    map = map or in_turn
    key = rng.key(seed, "grains.walk", stream)
    sums = np.zeros((REPLICATES, len(mu) + 1, _BINS + len(edges) - 1))
    first, count = 0, _FIRST
    while True:
        parts = [(replicate, start, min(_BLOCK, first + count - start))
                 for replicate in range(REPLICATES) for start in range(first, first + count, _BLOCK)]
        blocks = map(block, [(tracer, edges, (seed, stream), key, part) for part in parts])
        sums += in_order(np.reshape(blocks, (REPLICATES, -1, *sums.shape[1:])))
        first += count
        result = _result(sums, edges, tolerance, asked)
        if report is not None:
            report(min(1.0, (tolerance / max(result.achieved_error, 1e-300)) ** 2), result.achieved_error)
        if (result.hits >= HITS_MIN and result.reached) or first * REPLICATES >= paths_max:
            return result
        count = first * _quarters(result, tolerance) // 4


def _quarters(result, tolerance):
    """How much is added, in quarters of the paths: as errors ask for, if they fall with the root of the paths, 1 to 4."""
    wanted = math.ceil(4 * ((result.achieved_error / tolerance) ** 2 - 1)) if result.hits >= HITS_MIN else 4
    return min(max(wanted, 1), 4)


# Where a block's sums stand in its array of (C + 1, 8 + B): row 0 is common to all channels, bins of theta follow in the others.
_PATHS, _HITS, _MISSED, _CHORD_MISSED, _CHORD_HIT, _EVENTS, _CONTRADICTED = range(7)
_WEIGHT, _INCOMING, _OUTGOING, _SQUARE, _COSINE, _FORWARD, _INSIDE, _LOST = range(8)
_BINS = 8


def block(tracer, edges, names, key, part):
    """Sums (C + 1, 8 + B) of the paths first ... first + count - 1 of a part (replicate, first, count)."""
    (seed, stream), (replicate, first, count) = names, part
    random = rng.generator(seed, "grains.entries", stream, replicate)
    paths = tracer.trace(points(*scrambled(random), first, count), first, replicate, key)
    out = np.zeros((paths.weight.shape[1] + 1, _BINS + len(edges) - 1))
    _tally(paths, edges, out)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _tally(paths, edges, out):
    status, start, leave, incoming, outgoing, inside, weight, events = paths
    for i in range(len(status)):
        state = status[i]
        out[0, _PATHS] += 1
        if state == CONTRADICTED:
            out[0, _CONTRADICTED] += 1
            continue
        chord = -2.0 * (start[i, 0] * incoming[i, 0] + start[i, 1] * incoming[i, 1] + start[i, 2] * incoming[i, 2])
        if state == MISSED:
            out[0, _MISSED] += 1
            out[0, _CHORD_MISSED] += chord
            continue
        out[0, _HITS] += 1
        out[0, _CHORD_HIT] += chord
        out[0, _EVENTS] += events[i]
        if state == ABSORBED:
            continue
        if state == CUT:
            for c in range(weight.shape[1]):
                out[1 + c, _LOST] += weight[i, c]
            continue
        along = across = square = cosine = difference_squared = sum_squared = 0.0
        for k in range(3):
            displacement, a, b = leave[i, k] - start[i, k], incoming[i, k], outgoing[i, k]
            along += displacement * a
            across += displacement * b
            square += displacement * displacement
            cosine += a * b
            difference_squared += (b - a) ** 2
            sum_squared += (b + a) ** 2
        forward = difference_squared <= FORWARD * FORWARD
        theta = 2.0 * math.atan2(math.sqrt(difference_squared), math.sqrt(sum_squared))
        low, high = 0, len(edges) - 1
        while high - low > 1:
            middle = (low + high) // 2
            if theta >= edges[middle]:
                low = middle
            else:
                high = middle
        for c in range(weight.shape[1]):
            w = weight[i, c]
            row = out[1 + c]
            row[_WEIGHT] += w
            row[_INCOMING] += w * along
            row[_OUTGOING] += w * across
            row[_SQUARE] += w * square
            row[_COSINE] += w * cosine
            row[_INSIDE] += w * inside[i]
            if forward:
                row[_FORWARD] += w
            else:
                row[_BINS + low] += w


def _result(sums, edges, tolerance, asked):
    """Ratios and their errors from sums (replicates, C + 1, 8 + B)."""
    common, of = sums[:, 0], sums[:, 1:]
    counted = common[:, _PATHS] - common[:, _CONTRADICTED]
    hits, weight = common[:, _HITS], of[:, :, _WEIGHT]
    bins = of[:, :, _BINS:]
    changed = bins.sum(-1)
    solid = 2 * np.pi * -np.diff(np.cos(edges))
    pairs = {
        "hit_probability": (hits, counted), "lambda_delta": (common[:, _CHORD_MISSED], common[:, _MISSED]),
        "chord": (common[:, _CHORD_HIT], hits), "albedo": (weight, hits[:, None]), "lambda_s": (of[:, :, _INCOMING], weight),
        "lambda_o": (of[:, :, _OUTGOING], weight), "mean_square": (of[:, :, _SQUARE], weight), "g": (of[:, :, _COSINE], weight),
        "forward_delta": (of[:, :, _FORWARD], weight), "inner_path": (of[:, :, _INSIDE], weight),
        "phase": (bins, changed[:, :, None])}
    values, errors = {}, {}
    for name, pair in pairs.items():
        values[name], errors[name] = ratio(*pair)
    dark = changed.sum(0) == 0
    values["phase"] = np.where(dark[:, None], 1 / (4 * np.pi), values["phase"] / solid)
    # no bin is known better than to one path: an empty one would claim to have no error
    normalisation = 1.0 / np.where(dark, 1.0, changed.sum(0))
    errors["phase"] = np.maximum(errors["phase"], np.where(dark, 0.0, normalisation)[:, None]) / solid
    scale = {"hit_probability": max(values["hit_probability"], 1e-300), "albedo": np.maximum(values["albedo"], _FLOOR)}
    reached = 0.0
    for name in asked:
        error = _SHARE * (errors["phase"] * solid).sum(-1) if name == "phase" else errors[name]
        reached = max(reached, float(np.max(error / scale.get(name, 1.0))))
    total = common.sum(0)
    return Statistics(
        **{name: value if np.ndim(value) else float(value) for name, value in values.items()}, edges=edges,
        paths=int(total[_PATHS]), hits=int(total[_HITS]), events=float(total[_EVENTS] / max(total[_HITS], 1)),
        contradicted=float(total[_CONTRADICTED] / total[_PATHS]), lost=of[:, :, _LOST].sum(0) / max(total[_HITS], 1.0),
        achieved_error=reached, reached=bool(reached <= tolerance and total[_HITS] > 0), errors=errors)


def ratio(numerator, denominator):
    """Ratio of the sums over the first axis (replicates) and its standard error by the delta method; 0 for 0/0."""
    count = len(numerator)
    whole = denominator.sum(0)
    safe = np.where(whole == 0, 1.0, whole)
    value = numerator.sum(0) / safe
    residual = numerator - value * denominator
    return value, np.sqrt(np.sum(residual**2, axis=0) * count / (count - 1)) / safe


def _checked(surface, mu, tolerance, asked, edges):
    """mu (C,), C that of the surface's channels too, and edges; ValueError on what cannot be measured."""
    mu, edges = np.atleast_1d(np.asarray(mu, float)), np.ascontiguousarray(edges, float)
    if mu.ndim != 1 or not np.all((mu >= 0) & np.isfinite(mu)):
        raise ValueError(f"mu {mu.tolist()}: absorption coefficients >= 0 in 1/R are needed, one a channel")
    colours = surface.channels.shape[1]
    if colours > 1 and len(mu) not in (1, colours):
        raise ValueError(f"{len(mu)} absorption coefficients for a surface of {colours} channels")
    if edges.ndim != 1 or len(edges) < 2 or edges[0] != 0 or abs(edges[-1] - np.pi) > 1e-12 or np.any(np.diff(edges) <= 0):
        raise ValueError("edges: angles that ascend from 0 to pi are needed")
    if not TOLERANCE_MIN <= tolerance <= 1:
        raise ValueError(f"tolerance {tolerance:g}: 1e-6 to 1 are possible")
    unknown = set(asked) - {*FIGURES, "lambda_o", "forward_delta", "inner_path", "phase"}
    if unknown or not asked:
        raise ValueError(f"asked {sorted(unknown)}: known are {', '.join(FIGURES)}, lambda_o, forward_delta, inner_path, phase")
    return np.ascontiguousarray(np.broadcast_to(mu, max(len(mu), colours))), edges
