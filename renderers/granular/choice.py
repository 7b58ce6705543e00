"""What `auto` is for a scene: paths from grain to grain alone, or paths that go on in the medium where that is as good.

A point of the medium is no grain: it has no size, and opaque grains or those that absorb send back another share of the light
that met one or two of them (docs/granular.md).  Of clear grains the difference is measured in the scene itself, before the
picture.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery import kernels
from renderers import colour, wavefront
from renderers.budget import percent
from renderers.granular import transport
from renderers.granular.bundles import EDGE
from renderers.granular.declaration import ROOM

# Albedo of grains from which on their medium is tried; glass balls of 0.96 are 1 % too dark in it under a sky, of 0.8 7 %
_CLEAR = 0.95
_ACROSS, _DOWN = 8, 6  # parts of the film; each pass has one bundle of pixels in each of them
_ROUNDS = (8, 16, 32)  # passes after which is looked whether they suffice
_SURE = 2.0  # standard errors that are added to a difference before it is held against the room
_KNOWN = 0.1  # relative error of the light by explicit grains up to which it can be compared with
_FAINT = 0.1  # of the brightest colour; darker ones count as that
_FIRST = 1 << 30  # number of the first pass
_SAMPLES = 1024  # of lights, for their radiances
_WRONG = "auto is ept here: in the medium, light that met one or two grains is wrong where they are opaque or absorb"


class Choice(NamedTuple):
    """What was chosen.

    switches : whether paths go on in the medium
    bias, error : of that, relative to the light that met grains, in the colour where it is largest; None where it is not known
    reasons : sentences
    """

    switches: bool
    bias: float | None = None
    error: float | None = None
    reasons: tuple[str, ...] = ()

    @property
    def approximations(self) -> float | None:
        """What the picture's tolerance has to make room for; None where that is not known."""
        if not self.switches:
            return 0.0
        return None if self.bias is None else self.bias + _SURE * self.error


class Difference(NamedTuple):
    """Light that met grains and goes on in the medium, less that among explicit grains, over it.

    bias, error : of the colour where it is largest, without sign, and its standard error
    explicit_error : relative standard error of the light among explicit grains
    paths : by each way
    """

    bias: float
    error: float
    explicit_error: float
    paths: int


def chosen(world, assets, meshes, in_medium, tolerance) -> Choice:
    """What `auto` is.

    Parameters
    ----------
    world, assets, meshes : as those of `methods.of`
    in_medium : `Transport` whose paths go on in the medium
    tolerance : of the picture
    """
    some_smooth = any(map(_smooth, assets))
    if some_smooth and world.without_extent:
        return Choice(True, reasons=("how far the picture is off is not known: explicit grains cannot show the light of lamps "
                                     "without extent, and what one smooth grain reflects of it is missing",))
    allowance = ROOM * tolerance if all(map(clear, assets)) else None
    if allowance is None and not some_smooth:  # light samples reach them: explicit paths find all lamps
        return Choice(False, reasons=(_WRONG,))
    radiance = _radiances(world, np.concatenate([vertices for vertices, _ in meshes])) if some_smooth else None
    return judged(difference(world, in_medium, allowance, radiance), allowance)


def judged(measured: Difference, allowance: float | None) -> Choice:
    """The choice by a measured difference that may take so much room; None of grains that are not clear."""
    if not measured.explicit_error <= _KNOWN:
        return Choice(True, reasons=(f"how far the picture is off is not known: {measured.paths:,} paths from grain to grain "
                                     "found too little of the light to compare it with",))
    if allowance is None:
        return Choice(False, reasons=(_WRONG,))
    words = f"by {percent(measured.bias)} +- {percent(measured.error)} ({measured.paths:,} paths of each)"
    if _within(measured, allowance):
        sentence = f"light in the medium differs from that among explicit grains {words}"
        return Choice(True, measured.bias, measured.error, (sentence,))
    return Choice(False, reasons=("auto is ept here: light in the medium would differ from that among explicit grains "
                                  f"{words}, and there is room for {percent(allowance)}, two standard errors included",))


def _within(measured, allowance):
    return measured.bias + _SURE * measured.error <= allowance


def clear(asset) -> bool:
    """Whether grains of an asset let light through, and hardly absorb it."""
    return all(surface["type"] == "dielectric" for surface in _surfaces(asset)) and min(map(_albedo, _groups(asset))) >= _CLEAR


def _smooth(asset):
    """Whether an asset has grains that light samples do not reach."""
    return any(surface["type"] != "diffuse" and surface["roughness"] == 0 for surface in _surfaces(asset))


def _surfaces(asset):
    return [exemplar.surface for exemplar in asset.grains.exemplars.values()]


def _groups(asset):
    return [asset.grains[name] for name in asset.grains.exemplars]


def _albedo(part):
    """The least of a component's, over sizes and wavelengths."""
    return float(np.min((part.by_radius if "by_radius" in part else part)["albedo"]))


# ---- measured


def difference(world, in_medium, allowance, radiance=None) -> Difference:
    """The difference between explicit paths and those that go on in the medium, measured until it is told from `allowance`.

    Parameters
    ----------
    world, in_medium, allowance : as those of `chosen`
    radiance : (lights,), of lights that explicit paths find by chance; None where they sample them

    Notes
    -----
    Both ways have the same random numbers up to the switch, and pixels that lie side by side as in the picture, which decides
    where that is.  The same for all seeds of a picture, so that no seed decides how it is made.
    """
    setups, passes = (in_medium._replace(switch=None), in_medium), []
    for number in range(_ROUNDS[-1]):
        corners = _corners(world.size, number)
        size = len(corners) // EDGE, EDGE
        passes.append([transport.one_pass(world, setup, world.camera, size, _FIRST + number, 0, corners=corners)
                       for setup in setups])
        if number + 1 in _ROUNDS:
            measured = _compared(passes, len(corners), radiance)
            if measured.explicit_error <= _KNOWN and (allowance is None or _within(measured, allowance)
                                                       or measured.bias - _SURE * measured.error > allowance):
                break
    return measured


def _compared(passes, paths, radiance) -> Difference:
    """passes : (n, 2) of `transport.Sums`, of explicit paths and of the others;  paths : of a pass"""
    count = len(passes)
    explicit, switched = np.moveaxis([[sums.by_order[1:].sum(axis=0).mean(axis=0) for sums in pair] for pair in passes], 1, 0)
    level = explicit.mean(axis=0)
    if not level.max() > 0:
        unknown = math.inf if switched.any() else 0.0
        return Difference(unknown, unknown, unknown, count * paths)
    level = np.maximum(level, _FAINT * level.max())
    bias = np.abs((switched - explicit).mean(axis=0)) / level
    worst = int(np.argmax(bias))
    missed = 0.0 if radiance is None else _by_chance(passes, count * paths, radiance) / level[worst]
    error, explicit_error = (math.hypot(float(part.std(axis=0, ddof=1)[worst] / level[worst]) / math.sqrt(count), missed)
                             for part in (switched - explicit, explicit))
    return Difference(float(bias[worst]), error, explicit_error, count * paths)


def _by_chance(passes, paths, radiance):
    """Standard error of light that explicit paths may have missed: N find a mean m of a radiance L by chance to sqrt(L m / N).

    m is what they have not found of each light: where no path has come upon a small lamp, the scatter of the passes cannot tell.
    """
    lights = np.mean([[sums.by_light.mean(axis=1) @ colour.LUMINANCE for sums in pair] for pair in passes], axis=0)
    return float(np.sqrt(np.sum(radiance * np.abs(lights[1] - lights[0])) / paths))


def _radiances(world, vertices):
    """Mean radiance (lights,) by their light, at vertices (V, 3) m of the meshes: luminances."""
    sample = world.lights(vertices[np.arange(_SAMPLES) * len(vertices) // _SAMPLES], _drawn(_ROUNDS[-1], _SAMPLES, 3))
    power = np.where(sample.delta, 0.0, sample.radiance @ colour.LUMINANCE)
    squares, sums = (np.bincount(sample.light[power > 0], weights[power > 0], len(world.light_names))
                     for weights in (power**2 * sample.density, power))
    return squares / np.maximum(sums, 1e-300)


def _corners(size, number):
    """Corners (N, 2) of the pixels of one bundle in each part of a film (height, width): where, is drawn for each pass."""
    rows, columns = (max(side // EDGE, 1) for side in size)
    down, across = min(_DOWN, rows), min(_ACROSS, columns)
    part = np.stack([np.arange(down * across) % across, np.arange(down * across) // across], axis=1)
    bundle = np.floor((part + _drawn(number, len(part), 2)) * (columns, rows) / (across, down)).astype(int)
    y, x = np.divmod(np.arange(EDGE**2), EDGE)
    return (EDGE * bundle[:, None] + np.stack([x, y], axis=1)).reshape(-1, 2)


def _drawn(number, count, columns):
    """Random numbers (count, columns) of a pass."""
    states, drawn = np.empty(count, np.uint64), np.empty((count, columns))
    wavefront.begin_streams(kernels.stream_key(0, "render.pilot", number), 0, states)
    wavefront.draw(states, drawn)
    return drawn
