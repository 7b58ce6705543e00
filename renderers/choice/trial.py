"""Pilots of methods: a few passes of two small pictures of a scene, and what they say of the picture that is asked for.

A pass costs a fixed time and a time for each pixel, which two sizes tell apart.  Variance times time of pixels is that of the
picture, but for paths so bright that few passes do not come upon one (`renderers.choice.tails`).  Noise that pixels share is told
from their own by the means of regions; that of chains goes down with the number of pixels, that of beams does not.  Light is
compared by regions and by orders of scattering, each with its standard error.
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Container, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from bakery.errors import Interrupted
from renderers import colour
from renderers.choice import tails
from renderers.choice.tails import Tail
from renderers.mitsuba import variants
from renderers.pictures import engine
from renderers.pictures.engine import Passes, Stop
from renderers.pictures.means import LEAST, tiled

TINY, SMALL = 24**2, 64**2  # pixels of the two pictures
ORDERS = ("", *engine.ORDERS)  # layers that are compared; "" is the picture
LAMP = "light."  # layers of light from each lamp, by this and its name
_SEED = 0x9170  # of all pilots: no seed of a picture decides how it is made
_BLACK = 1e-6  # of the light that others have found; less counts as that
_COMPILES, _LAUNCHES = 1 << 30, 0.05  # a pass that is not counted; s that a pass takes at most without paths
_SEVERAL = 4  # samples of a pixel in a pass, that tell what a path takes where one of each does not
# Share of a pass's time that may go with the pixels where two sizes take as long, such as splats of the particles in a box
_CLOCK = 0.1
# Times the seconds of a pilot that two passes may take.  At three, pilots through grains took 2.5 % of a minute each, and knew
# noise no better: it is told by the number of pixels
_PATIENCE = 1.0


class Cost(NamedTuple):
    """One kind of pass of the larger pilot.

    Attributes
    ----------
    fixed, by_pixel : processor seconds of a pass, and of each of its pixels
    samples : of a pixel, in a pass
    pixel : variance of a pixel by a pass over the squared mean of the picture, mean over pixels
    region : the same of what the means of regions have beyond that of independent pixels
    spread : standard error of the logarithm of `pixel` as it is in the picture
    grows : power of the number of pixels with which `pixel` grows: 0, or up to 1 of light that comes from places smaller than a
        pixel, such as particles
    tail : of what `pixel` is the mean of; None: it is the same however many passes there are
    chains : whether `region` is of chains, of which there are as many as go with the pixels
    noisier : as `engine.Part`, over what it is of the passes of the pilot
    """

    fixed: float
    by_pixel: float
    samples: int
    pixel: float
    region: float
    spread: float
    grows: float = 0.0
    tail: Tail | None = None
    chains: bool = False
    noisier: Callable[[float], float] | None = None

    def seconds(self, pixels: int) -> float:
        """Of a pass of so many pixels."""
        return self.fixed + self.by_pixel * pixels

    def of_pixel(self, pixels: int, of_pilot: int, passes: float) -> float:
        """`pixel` of a picture of so many passes and pixels, by a pilot of so many."""
        pixel = self.pixel if self.tail is None else max(self.pixel, self.tail.variance(pixels * passes))
        return pixel * max(pixels / of_pilot, 1.0) ** self.grows * (self.noisier(passes) if self.noisier else 1.0)

    def of_region(self, pixels: int, of_pilot: int) -> float:
        """`region` of a picture."""
        return self.region * min(of_pilot / pixels, 1.0) if self.chains else self.region

    def passes(self, pixels: int, noise: float | None, limit: float | None) -> float:
        """How many a picture has about: two and more, until it has that noise or its time is over."""
        ends = [self.pixel / noise**2] if noise else []
        ends += [limit / max(self.seconds(pixels), 1e-9)] if limit is not None else []
        return max(min(ends, default=LEAST), LEAST)


class Light(NamedTuple):
    """Means (rows, columns) of the luminance over regions, and their variances."""

    mean: np.ndarray
    variance: np.ndarray


class Trial(NamedTuple):
    """What a pilot showed.

    Attributes
    ----------
    setup : processor seconds before the passes
    costs : of each kind of pass
    light : by layer, of `ORDERS` and of lamps
    pixels, passes : of the larger picture, and of the kind that has fewest
    seconds : of the clock, that the pilot took but for compiling
    clock : seconds of it to one of processors, in passes
    processor : seconds of processors that the pilot took but for compiling
    """

    setup: float
    costs: tuple[Cost, ...]
    light: dict[str, Light]
    pixels: int
    passes: int
    seconds: float
    clock: float = 1.0
    processor: float = 0.0

    @property
    def level(self) -> float:
        """Mean luminance."""
        return float(self.light[""].mean.mean())

    @property
    def spread(self) -> float:
        """Standard error of the logarithm of the seconds to a noise."""
        roots = np.sqrt([cost.pixel * (cost.fixed + cost.by_pixel * self.pixels) for cost in self.costs])
        return float(np.linalg.norm(roots * [cost.spread for cost in self.costs])) / max(float(roots.sum()), 1e-300)

    def _kinds(self, pixels: int, missing: float, noise: float | None, limit: float | None) -> list[dict]:
        """Of a picture of so many pixels, its passes of each kind as those of the pilot: `samples` of a pixel; `fixed` and
        `pixels`, processor seconds of a pass, and of all of its pixels; `pixel`, `region` and `spread` as those of `Cost`.

        missing : light, over that of the picture, that others have found and this has not: it counts as if the next pass brought
            it, in one pixel
        noise, limit : and seconds of the clock that end its passes: the more there are, the brighter the brightest paths; None:
            they do not
        """
        ends, unseen = limit and limit / self.clock, missing**2 * self.passes / len(self.costs)
        return [{"samples": cost.samples, "fixed": cost.fixed, "pixels": cost.by_pixel * pixels,
                 "pixel": cost.of_pixel(pixels, self.pixels, cost.passes(pixels, noise, ends)) + unseen * self.pixels,
                 "region": cost.of_region(pixels, self.pixels) + unseen, "spread": cost.spread} for cost in self.costs]

    def rate(self, pixels: int, missing: float = 0.0, noise: float | None = None, limit: float | None = None) -> float:
        """Processor seconds of passes, times noise^2, of the same picture, its kinds of passes shared out best."""
        kinds = self._kinds(pixels, missing, noise, limit)
        return max(sum(math.sqrt(kind[name] * (kind["fixed"] + kind["pixels"])) for kind in kinds)
                   for name in ("pixel", "region")) ** 2

    def summary(self, pixels: int, stop: Stop, missing: float = 0.0) -> dict:
        """What is foretold of a picture, for JSON: `clock`, seconds of it to one of processors; `missing`; `passes` by kind."""
        return {"clock": self.clock, "missing": missing, "passes": self._kinds(pixels, missing, stop.noise, stop.time)}

    def of_samples(self, pixels: int, samples: int) -> float:
        """Processor seconds of passes with so many samples a pixel."""
        return sum(cost.seconds(pixels) * max(samples / cost.samples, float(LEAST)) for cost in self.costs)


class Bias(NamedTuple):
    """How the light of a pilot differs from another's, over the mean luminance of that.

    Attributes
    ----------
    size, error : root mean square over the regions beneath the noise, and what two standard errors of it may add
    resolved : whether it stands out of the noise by three standard errors
    by_order : layer -> difference of its mean, and its standard error
    """

    size: float
    error: float
    resolved: bool
    by_order: dict[str, tuple[float, float]]


NO_BIAS = Bias(0.0, 0.0, False, {})  # of a method without an error of its own


def shrunk(first: int, second: int, pixels: int) -> tuple[int, int]:
    """Sides of a picture of the same shape with so many pixels, or of this one where it has fewer."""
    shrink = min(1.0, math.sqrt(pixels / (first * second)))
    return max(2, round(shrink * first)), max(2, round(shrink * second))


def smaller(world, pixels: int):
    """A world with the same view on a film of at most so many pixels."""
    height, width = world.size
    size, reduced = shrunk(height, width, pixels), copy.copy(world)
    reduced.camera, reduced.size = world.camera.refitted(height, width, *size), size
    reduced.whole, reduced.coarser = world, math.sqrt(height * width / (size[0] * size[1]))
    return reduced


def of(prepare: Callable, world, seconds: float | None, samples: int | None = None,
       shares: Mapping[str, float] = MappingProxyType({}), most: float = math.inf) -> Trial | None:
    """The pilot of a method; None where it would take longer than `most`.

    Parameters
    ----------
    prepare : (world, seed) -> what has `parts`, as `renderers.pictures.passes.Method`
    world : of the picture
    seconds : of the passes of both sizes, but for two of each kind that there have to be; what compiles comes to that
    samples : a pixel, after which they end, so that no clock decides how many
    shares : of parts by name, the share of their longest paths that the picture's passes have (`engine.shares`); others have all
    most : seconds of the clock; after those of the smaller picture it is known that those of the larger one take as long at least

    Raises
    ------
    BakeryError : the scene cannot be rendered so, or the pilot was interrupted
    """
    def parts_of(smaller_world, seed):
        return tuple(part.fewer(shares[part.name]) if shares.get(part.name, 1) < 1 else part
                     for part in prepare(smaller_world, seed).parts)

    tiny, middle = smaller(world, TINY), smaller(world, SMALL)
    parts = parts_of(tiny, _SEED)
    share, spent = _share(parts, world, seconds)
    small = _Run(lambda *_: parts, tiny, Stop(time=seconds and 0.3 * seconds, samples=samples), share)
    if small.clock + LEAST * small.pace * sum(map(small.of_pass, small.passes.parts)) > most:
        return None
    large = _Run(parts_of, middle, Stop(time=seconds and 0.7 * seconds, samples=samples), share)
    level = max(float(large.light[""].mean.mean()), 1e-100)
    costs = tuple(_cost(part, small, large, level, world.size[0] * world.size[1]) for part in large.passes.parts)
    passes = min(mean.count for mean in large.passes.means.values())
    return Trial(large.setup, costs, large.light, large.pixels, passes, small.clock + large.clock, large.pace,
                 spent + small.processor + large.processor)


def _cost(part, small, large, level, pixels) -> Cost:
    """Of a kind of pass, by its two pictures, for one of so many pixels whose mean luminance is `level`."""
    second = large.of_pass(part)
    by_pixel = _by_pixel(small.of_pass(part), second, small.pixels, large.pixels)
    mean = large.passes.means[part.name]
    tail, spread = tails.of_passes(large.luminance(part) / level, pixels * mean.count)
    coarse, of_coarse = tails.of_passes(small.luminance(part) / level)
    pixel, regions = tail.variance(), mean.regions / (mean.count - 1) / level**2
    shared = max(float(np.mean(regions)) - float(np.mean(mean.square[..., 3])) / (mean.count - 1) / level**2
                 * regions.size / large.pixels, 0.0)
    # without the largest squares: of rare bright paths more are seen among more samples, and none by chance among few
    grows = _growth(tail.dim / max(coarse.variance(), 1e-300), math.hypot(spread, of_coarse), large.pixels / small.pixels)
    return Cost(max(second - by_pixel * large.pixels, 0.0), by_pixel, part.samples, pixel, shared, spread, grows, tail,
                part.steps > 1, part.noisier and (lambda passes: part.noisier(passes) / part.noisier(mean.count)))


def _by_pixel(first, second, fewer, pixels) -> float:
    """Seconds of a pass that go with the pixels, of one: from passes over fewer and over `pixels` that take first and second."""
    if pixels == fewer:
        return second / pixels
    return max(second - first, _CLOCK * second) / (pixels - fewer)


def _share(parts, world, seconds) -> tuple[float, float]:
    """Compiles parts of the smaller picture; of their samples a share with which two passes of the larger one take no more than
    some times the seconds of a pilot (a path in a medium that hardly absorbs takes milliseconds), and the processor seconds of
    the passes that tell it."""
    needed = spent = 0.0
    for part in parts:
        single = part.fewer(1) if _many(part) else part
        single.render(_COMPILES)
        if part.fewer:
            of_sample, took = _of_sample(part, single, world)
            needed, spent = needed + part.samples * of_sample * LEAST * SMALL / TINY, spent + took
    return 1.0 if not seconds or needed <= _PATIENCE * seconds else _PATIENCE * seconds / needed, spent


def _many(part) -> bool:
    """Whether a pass may have fewer samples: one of a single sample has a share of its paths already, or all of them."""
    return part.fewer is not None and part.samples > 1


def _of_sample(part, single, world) -> tuple[float, float]:
    """Processor seconds that a sample of all pixels takes in a pass, but for what a pass takes without; and those of the passes
    that tell it."""
    spent = variants.clock(world.variant)

    def took(passes):
        begin = spent()
        passes.render(_COMPILES + 1)
        return spent() - begin

    alone = took(single)
    if alone > _LAUNCHES * part.steps or part.samples < _SEVERAL:
        return max(alone - _LAUNCHES * part.steps, 0.0), alone
    several = took(part.fewer(_SEVERAL))
    return max(several - alone, 0.0) / (_SEVERAL - 1), alone + several


def _growth(times, spread, pixels) -> float:
    """`Cost.grows` where so many times the pixels have so many times the variance, as far as that is sure."""
    if not times > 0 or pixels <= 1:
        return 0.0
    return float(np.clip((math.log(times) - 2 * spread) / math.log(pixels), 0.0, 1.0))


class _Run:
    """Passes of one small picture."""

    def __init__(self, prepare, world, stop, share=1.0):
        self.pixels, spent = world.size[0] * world.size[1], variants.clock(world.variant)
        clock, begin = spent(), time.monotonic()
        parts = prepare(world, _SEED)
        self.setup, self.clock = spent() - clock, time.monotonic() - begin
        if share < 1:
            parts = tuple(part.fewer(max(1, int(share * part.samples))) if _many(part) else part for part in parts)
        begin = time.monotonic()
        self._regions, self._luminance, self._seconds = ({part.name: [] for part in parts} for _ in range(3))
        self.passes = Passes([part._replace(render=self._noted(part, spent)) for part in parts])
        self.passes.run(stop)
        self.clock += time.monotonic() - begin
        if self.passes.signal:
            raise Interrupted("interrupted before there was a picture; nothing was written").ending(128 + self.passes.signal)
        every = dict.fromkeys([*ORDERS, *(layer for passes in self._regions.values() for layer in passes[0])])
        self.light = {layer: self._light(layer) for layer in every}

    def of_pass(self, part) -> float:
        """Processor seconds of a pass: of the quickest, as the first one of a size also traces what the others go by, and a busy
        machine takes longer for some.  Of two passes the later one alone had seconds of a pixel wrong by two to four times."""
        return min(self._seconds[part.name])

    @property
    def processor(self) -> float:
        """Seconds of processors, with the preparation; the first pass, in which a machine compiles, counts as later ones."""
        return self.setup + sum(self.passes.means[part.name].count * self.of_pass(part) for part in self.passes.parts)

    @property
    def pace(self) -> float:
        """Seconds of the clock to one of processors, in passes."""
        return self.passes.spent / max(sum(map(sum, self._seconds.values())), 1e-9)

    def luminance(self, part):
        """(n, H, W) of the passes."""
        return np.array(self._luminance[part.name])

    def _noted(self, part, spent):
        def render(number):
            begin = spent()
            layers = part.render(number)
            self._seconds[part.name].append(spent() - begin)
            self._luminance[part.name].append(np.nan_to_num(np.asarray(layers[""], float) @ colour.LUMINANCE, posinf=0, neginf=0))
            self._regions[part.name].append({name: tiled(np.asarray(image, float) @ colour.LUMINANCE) for name, image
                                             in layers.items() if name in ORDERS or name.startswith(LAMP)})
            return layers

        return render

    def _light(self, layer):
        black = np.zeros_like(next(iter(self._regions.values()))[0][""])
        by_part = [np.array([regions.get(layer, black) for regions in passes]) for passes in self._regions.values()]
        return Light(sum(part.mean(axis=0) for part in by_part), sum(part.var(axis=0, ddof=1) / len(part) for part in by_part))


def missing(trial: Trial, others: Mapping[str, Trial], exact: Container[str]) -> float:
    """Light, over its own, that a pilot lacks by three standard errors of what one of some others has found: of all light where
    that is without an error; of a lamp, and of what has scattered, only what is found less than half of, as others may be off.
    Lamps are compared where both have layers of them.

    others : by the names of their methods;  exact : names of those without an error
    """
    lacks = [0.0]
    for name, reference in others.items():
        scattered = [layer for layer in ORDERS[2:] if layer in reference.light]
        lamps = list(filter(_of_lamp, reference.light)) if any(map(_of_lamp, trial.light)) else []
        whole = [[""]] if name in exact else []
        for layers, share in [*((each, 1.0) for each in whole),
                              *(([layer], 0.5) for layer in lamps), (scattered, 0.5)]:
            (mean, error), (reference_mean, reference_error) = _mean(trial, layers), _mean(reference, layers)
            if share * reference_mean - mean > 3 * math.hypot(error, reference_error):
                lacks.append((reference_mean - mean) / max(trial.level, _BLACK * reference.level))
    return max(lacks)


def _of_lamp(layer):
    return layer.startswith(LAMP)


def _mean(trial, layers):
    """Of the light of layers together, and its standard error."""
    lights = [trial.light[layer] for layer in layers if layer in trial.light]
    return (sum(float(light.mean.mean()) for light in lights),
            math.sqrt(sum(float(light.variance.sum()) / light.mean.size**2 for light in lights)))


def bias(trial: Trial, reference: Trial) -> Bias:
    """How much the light of a pilot is off, by one of a method without an error.

    Notes
    -----
    The mean squared difference of regions less its variance; the standard error of that is known from the scatter over regions.
    """
    level = max(reference.level, 1e-100)
    picture, expected = trial.light[""], reference.light[""]
    variance = (picture.variance + expected.variance) / level**2
    excess = ((picture.mean - expected.mean) / level) ** 2 - variance
    # of few regions the scatter may be small by chance: no less than that of normal noise alone
    scatter = max(float(excess.std()), math.sqrt(2) * float(variance.mean()))
    square, deviation = float(excess.mean()), scatter / math.sqrt(excess.size)
    size = math.sqrt(max(square, 0.0))
    by_order = {}
    for layer in ORDERS[1:]:
        layered, expected_layered = trial.light[layer], reference.light[layer]
        by_order[layer] = (float((layered.mean - expected_layered.mean).mean()) / level,
                           math.sqrt(layered.variance.sum() + expected_layered.variance.sum()) / layered.mean.size / level)
    return Bias(size, math.sqrt(max(square, 0.0) + 2 * deviation) - size, square > 3 * deviation, by_order)
