"""Pictures from the asset that a scene asks for beside pictures from the whole recipe, ten times finer.

Both are rendered with the same random numbers, so that noise cancels as far as paths are the same, and with several seeds: what
the differences scatter by is the noise that is left.
"""

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np

import bakery
from bakery.plan.asked import Asked
from bakery.recipe import load
from bakery.run.bake import planned
from bakery.run.ensure import asked
from renderers import colour
from renderers.scene import requirements

FINER = 10
# Standard errors that a pixel may differ by beside the tolerance.  With four seeds and variances averaged over 3 x 3 pixels, 27
# degrees of freedom, noise of a normal law is beyond them once in 7e9 pixels, in 7,000 pixels of all tests once in 1e6
SIGMAS, SEEDS = 10, 4
# Photons of these stages measure an error and change no table (renderers/fog/requirements.py)
_MEASURES = ("beam.tolerance",)


def recipes_of(scene, folder) -> list[Path]:
    """Recipe of each body; of an asset the one of its name in a folder."""
    named = scene.materials
    return [(scene.file(one.recipe) if one.recipe else Path(folder) / f"{Path(one.asset).stem}.yaml").resolve() for one in named]


def wanted(scene, recipe, cache=None) -> Asked:
    """What a scene asks for of a recipe, and the share of the tolerance's square by which it does."""
    shares = []

    def require(*about):
        found = requirements.of_scene(scene, *about)
        shares.append(found.share)
        return found

    return asked(recipe, {}, require, cache), shares[0]


def whole(scene, recipe, cache=None) -> Asked:
    """All stages that the renderer may read, with the recipe's knobs."""
    needs = tuple(requirements.Need(stage, True, "") for stage in scene.rules.NEEDS)
    return asked(recipe, {}, lambda *about: requirements.Required(needs), cache)


def finer(recipe, settings, needs, times=FINER) -> dict[str, str]:
    """Settings of the whole recipe with each tolerance so many times finer than a scene asks for, or as the recipe has it."""
    leaves = load(recipe, dict(settings)).leaves
    found = dict(settings)
    for knob in (knob for need in needs if need.needed for knob in need.knobs):
        if knob.larger or isinstance(knob.value, str) or knob.key in _MEASURES:
            continue
        own = leaves.get(knob.key)
        found[knob.key] = f"{min(knob.value / times, own if isinstance(own, (int, float)) else knob.value):g}"
    return found


class Plans(NamedTuple):
    """Of the planned asset and of the full one (`bakery.run.prepare`), and the tables' share (`renderers.scene.budget`)."""

    planned: object
    full: object
    share: float


def plans(scene, recipe, folder, *, times=FINER, cache=None, **options) -> Plans:
    """Plans of both assets of a recipe, to be written to a folder."""
    (asks, share), full = wanted(scene, recipe, cache), whole(scene, recipe, cache)
    asked_for = {"planned": Asked(asks.settings, asks.stages),
                 "full": Asked(finer(recipe, full.settings, asks.needs, times), full.stages)}
    return Plans(*(planned(recipe, Path(folder) / f"{Path(recipe).stem}_{kind}.h5", asked=wanted, force=True, cache=cache,
                           **options) for kind, wanted in asked_for.items()), share)


class Difference(NamedTuple):
    """How two pictures differ, all over the mean of the second one.

    Attributes
    ----------
    mean : of the means
    rms : root mean square over pixels, noise included
    noise : the part of noise in it: standard errors of the pixels, from the scatter over seeds
    pixel : largest over pixels, over the larger of the pixel and the mean, noise included
    sure : the same with `SIGMAS` standard errors taken away; below 0 where all may be noise
    """

    mean: float
    rms: float
    noise: float
    pixel: float
    sure: float

    @property
    def excess(self) -> float:
        """Root mean square without the part of noise, 0 where that is all."""
        return max(self.rms**2 - self.noise**2, 0.0) ** 0.5


def compared(scene, planned, full, folder, *, samples, seeds=SEEDS, size=None, block=1) -> Difference:
    """Difference of pictures from two lists of assets, of the bodies each.

    samples : a pixel and seed;  size : (height, width), None: as the picture is;  block : means over so many pixels squared count
    """
    bands = any(len(bakery.open(asset).wavelength) > 3 for asset in full)
    pairs = [[_luminance(scene, assets, Path(folder) / f"{kind}_{seed}.exr", samples, size, seed, bands)
              for kind, assets in (("planned", planned), ("full", full))] for seed in range(1, seeds + 1)]
    a, b = np.array(pairs, float).swapaxes(0, 1)
    return difference(*(picture.reshape(seeds, size[0] // block, block, size[1] // block, block).mean(axis=(2, 4))
                        for picture in (a, b))) if block > 1 else difference(a, b)


def difference(a, b) -> Difference:
    """a, b : (K, H, W) luminance of K seeds, the same ones in both."""
    mean, change = b.mean(), (a - b)
    scale = np.maximum(b.mean(axis=0), mean)
    middle, variance = change.mean(axis=0), change.var(axis=0, ddof=1) / len(a) if len(a) > 1 else 0 * change[0]
    error = np.sqrt(_around(variance)) / scale
    off = np.abs(middle) / scale
    found = (a.mean() / mean - 1, np.sqrt(np.mean(middle**2)) / mean, np.sqrt(np.mean(variance)) / mean, off.max(),
             (off - SIGMAS * error).max())
    return Difference(*map(float, found))


def _around(image):
    """Means over 3 x 3 pixels."""
    wide = np.pad(image, 1, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(wide, (3, 3)).mean(axis=(2, 3))


def _luminance(scene, assets, path, samples, size, seed, bands):
    # Red, green and blue hold the colours of lamps exactly, eight wavelengths to 2.7 % (`colour.spread_matrix`): lamps of
    # lamp_in_dust are 1.9 % brighter by them, which is no error of the asset of three
    from tests.exr import layers

    values = scene.values.model_copy(update={"stop": scene.values.stop.model_copy(update={
        "noise": 1e-9, "samples": samples, "time": None})})
    if hasattr(values, "picture"):
        values = values.model_copy(update={"picture": values.picture.model_copy(update={"samples": samples})})
    if size is not None:
        film = {"height": size[0], "width": size[1]} | ({"wavelengths": "rgb"} if scene.section == "discrete" and bands else {})
        values = values.model_copy(update={"film": values.film.model_copy(update=film)})
    scene.drawn_by.render(dataclasses.replace(scene, values=values, asset=assets[0], assets=tuple(assets)), path,
                                         seed=seed)
    found = layers(path)
    return np.stack([found[c] for c in "RGB"], axis=-1).astype(float) @ colour.LUMINANCE
