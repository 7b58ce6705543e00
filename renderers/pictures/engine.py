"""The engine of passes: sums of parts, which part is next, what stops them, and interruptions.

A picture is the sum of its parts; a part is one kind of pass with a number of passes of its own, such as direct light and walks.
"""

import math
import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from renderers import colour
from renderers.pictures import reached, refusals
from renderers.pictures.means import LEAST, Mean, student

# Passes before which the scatter of a part is not relied upon: noise that pixels share has one number a pass for all of them,
# and of few the smallest would stop the picture
TRUSTED, _TRUSTED_SHARED = 4, 8
_DARK = 32  # passes that have to be black for a picture to be so: chance may find a lamp late
# Of the time: every part gets it, also one that found nothing yet and hence seems to be without noise.
_SHARE = 0.05
_SECONDS = 16.0  # of passes: shorter renders have smaller ones
ORDERS = ("order0", "order1", "order2", "orders")  # layers: light that was scattered so often; three times and more


def layers_of(by_order, by_light=(), lights=()):
    """Layers of a pass by name: "", the picture, and its parts by order (4, H, W, 3) and by lights of some names."""
    return {"": by_order.sum(axis=0)} | dict(zip(ORDERS, by_order)) | {
        f"light.{name}": image for name, image in zip(lights, by_light)}


@dataclass(frozen=True)
class Stop:
    """Whichever comes first; None never comes.

    noise : root mean square standard error of the luminance over its mean; the means of regions keep it too
    time : s, after which no pass ends that was begun before, but for the first two of each part
    samples : a pixel, in each part
    pixels : the noise is that of pixels, `Estimate.pixel_noise`
    """

    noise: float | None = None
    time: float | None = None
    samples: int | None = None
    pixels: bool = False

    @classmethod
    def of(cls, split, measure="picture", *, time=None, samples=None, quality=None):
        """What a scene asks for: the noise of its `renderers.scene.budget.Split`, by its `measure`, and its `stop`, for `draft`,
        `preview` or `final`.

        Raises UsageError where there is no such quality.
        """
        coarser = reached.coarser(quality)
        return cls(coarser * split.noise, reached.limit(time, quality), samples and max(1, round(samples / coarser**2)),
                   measure == "pixels")


class Part(NamedTuple):
    """One kind of pass.

    name : of the part, distinct from the names of layers
    render : function of the pass (0, 1, ...), on which alone its random numbers depend; gives layers (H, W, 3) of linear sRGB by
        name, of which "" is the picture.  An interruption waits for its end: some seconds at most
    samples : a pixel and pass
    fewer : function of a number of samples, which gives the same part by passes of that many; None: they cannot be smaller
    steps : of a chain of samples that go one from the other; 1: each is by itself.  Of chains there are as many as go with the
        pixels, so that what pixels of a pass share goes down with them, as what they share of beams and the like does not
    fewest : samples that `fewer` takes; below 1 a pass has only some of its longest paths, by chance, and the fewer the less
    noisier : function of a number of passes: variance of the last of them over that of the first; None: all are alike
    """

    name: str
    render: Callable[[int], dict[str, np.ndarray]]
    samples: int = 1
    fewer: Callable[[int], "Part"] | None = None
    steps: int = 1
    fewest: float = 1
    noisier: Callable[[float], float] | None = None


def by_samples(name, render, samples) -> Part:
    """A part of passes of so many samples a pixel, or fewer;  render : function of samples and the number of a pass"""
    return Part(name, partial(render, samples), samples, partial(by_samples, name, render))


def in_time(parts, seconds) -> tuple[Part, ...]:
    """Parts whose passes are as much smaller as a render is shorter than some seconds.

    Two passes of each have to end however short the time is, and a pass takes seconds.  What a scene asks for decides, and no
    clock: the passes of a picture are the same on every machine.

    seconds : of all passes; None: as many as it takes
    """
    return tuple(part.fewer(samples) if samples else part for part, samples in zip(parts, _samples(parts, seconds), strict=True))


def shares(parts, seconds) -> dict[str, float]:
    """Of parts by name, what `fewer` of passes of so short a render is given, as `in_time` has it; 1: they have all paths."""
    return {part.name: min(samples or 1, 1) for part, samples in zip(parts, _samples(parts, seconds), strict=True)}


def _samples(parts, seconds):
    """What `in_time` asks of parts; None: they stay as they are."""
    short = seconds is not None and seconds < _SECONDS
    return [_power_of_two(max(part.samples * seconds / _SECONDS, part.fewest)) if short and part.fewer else None
            for part in parts]


def _power_of_two(samples):
    """The largest one that is not above; a whole number from 1 on."""
    power = 2.0 ** math.floor(math.log2(samples))
    return int(power) if power >= 1 else power


def rendered_here(part, number):
    """Layers of a pass of a part, and the seconds that it took."""
    start = time.monotonic()
    with refusals.told():
        layers = part.render(number)
    return layers, time.monotonic() - start


class Passes:
    """A picture that is being rendered.

    parts, means : tuple of `Part`, and `Mean` by their names
    stopped_by : `noise`, `samples`, `time`, `request`, `interruption`, or None before `run`
    spent : s, of all calls of `run`
    signal : number of the signal that interrupted it, or 0
    unreached : sentences of `renderers.pictures.reached.unreached`
    """

    def __init__(self, parts):
        self.parts = tuple(parts)
        self.means = {part.name: Mean() for part in self.parts}
        self.stopped_by, self.unreached = None, ()
        self.signal, self.spent = 0, 0.0

    @property
    def rgb(self):
        """(H, W, 3) linear sRGB."""
        return self.layer("")

    @property
    def variance(self):
        """(H, W, 4), of `rgb` and its luminance; None before the second pass of each part."""
        variances = [mean.variance for mean in self.means.values()]
        return None if any(variance_of_part is None for variance_of_part in variances) else sum(variances)

    @property
    def noise(self):
        """Root mean square standard error of the luminance over its mean; None before the second pass of each part."""
        variance = self.variance
        if variance is None:
            return None
        # by the luminance of passes, as most noise is that of all channels together
        return float(np.sqrt(np.mean(variance[..., 3])) / max(np.mean(self.rgb @ colour.LUMINANCE), 1e-30))

    @property
    def pixel_noise(self):
        """Standard error of a pixel's luminance over the larger of it and the picture's mean, which 99 of 100 pixels keep;
        None before the second pass of each part."""
        variance = self.variance
        if variance is None:
            return None
        level = self.rgb @ colour.LUMINANCE
        return float(np.percentile(np.sqrt(variance[..., 3]) / np.maximum(level, max(np.mean(level), 1e-30)), 99))

    @property
    def noise_mean(self):
        """Standard error of the mean luminance over it, by the scatter of the passes' means; None as above.

        Noise that pixels share is in it, which few passes tell badly: times `renderers.pictures.means.student`.  Means of two
        passes may be the same by chance, of a thousand pixels that are not: few passes count as independent pixels at least.
        """
        noise = self._of_few({name: mean.spread[3] for name, mean in self.means.items()})
        trusts_pixels = noise is not None and min(mean.count for mean in self.means.values()) < _TRUSTED_SHARED
        return max(noise, self.noise / math.sqrt(self.rgb[..., 0].size)) if trusts_pixels else noise

    @property
    def noise_region(self):
        """The same of the mean luminance of regions, the tiles of `renderers.pictures.means.tiled`; their root mean square."""
        return self._of_few({name: np.mean(mean.regions) for name, mean in self.means.items()})

    def _of_few(self, squares):
        """Of squared distances of passes by part, `Mean.spread` or the like: standard error over the picture's mean luminance."""
        counts = [mean.count for mean in self.means.values()]
        if min(counts) < LEAST:
            return None
        variances = [square / (count * (count - 1)) for square, count in zip(squares.values(), counts)]
        return float(math.sqrt(sum(variances)) * student(variances, counts) / max(np.mean(self.rgb @ colour.LUMINANCE), 1e-30))

    def _noise_to_reach(self, stop):
        """What has to be as low as the noise that is asked for: that of pixels, and of the means of regions that share it."""
        noise = self.pixel_noise if stop.pixels else self.noise
        return None if noise is None else max(noise, self.noise_region, self.noise_mean)

    @property
    def samples(self):
        """A pixel, in the part that has fewest."""
        return min(self.means[part.name].samples for part in self.parts)

    @property
    def count(self) -> int:
        """Passes, of all parts."""
        return sum(mean.count for mean in self.means.values())

    def run(self, stop, progress=None, observer=None, draw=None):
        """Renders passes until `stop`, or until SIGINT or SIGTERM; the same signal again ends the process at once.

        stop : `Stop`
        progress : function of (fraction 0 to 1, noise or None), or None
        observer : function of the noise so far or None, called before each pass once every part has one; true ends the passes,
            and another call of `run` goes on with them.  None: nobody looks

        The next pass is one of the part that takes most variance away a second.  So the numbers of passes depend on the machine,
        unless samples alone stop them.
        """
        begin = time.monotonic() - self.spent
        with _interruptions() as arrived:
            while True:
                self.spent = time.monotonic() - begin
                part, noise = self._next(stop), self._noise_to_reach(stop)
                asked = observer is not None and self.samples > 0 and observer(noise)
                self.stopped_by = "interruption" if arrived else self._over(stop, part, noise) or ("request" if asked else None)
                if progress:
                    progress(1.0 if self.stopped_by else self._fraction(stop, noise), noise)
                if self.stopped_by:
                    self.unreached = self._what_missed(stop)
                    break
                mean = self.means[part.name]
                mean.add(*(draw or rendered_here)(part, mean.count), part.samples)
        self.signal = arrived[0] if arrived else 0

    def _next(self, stop):
        """The part whose pass is next; None where all have their samples."""
        means = [self.means[part.name] for part in self.parts]
        unfinished = [(mean, part) for mean, part in zip(means, self.parts)
                if mean.count < LEAST or stop.samples is None or mean.samples < stop.samples]
        unknown = [(mean, part) for mean, part in unfinished if mean.count < LEAST or math.isinf(mean.seconds)]
        if unknown or not unfinished:
            return min(unknown, key=lambda candidate: candidate[0].count, default=(None, None))[1]
        spent = sum(mean.count * mean.expected for mean in means)
        behind = [(mean, part) for mean, part in unfinished if mean.count * mean.expected < _SHARE * spent]
        return max(behind or unfinished, key=lambda candidate: candidate[0].gain())[1]

    def _over(self, stop, part, noise):
        """What stops the passes before one of `part`; None if nothing does."""
        passes = min(mean.count for mean in self.means.values())
        if part is None:
            return "samples"
        shared = noise is not None and self.noise_region > reached.SHARED * self.noise
        trusted = _DARK if not np.any(self.rgb) else _TRUSTED_SHARED if shared else TRUSTED
        if passes >= trusted and stop.noise is not None and noise <= stop.noise:
            return "noise"
        if passes >= LEAST and stop.time is not None and self.spent + self.means[part.name].expected > stop.time:
            return "time"
        return None

    def _what_missed(self, stop):
        """Sentences of `renderers.pictures.reached.unreached`."""
        noise = self.pixel_noise if stop.pixels else self.noise
        regions = 0.0 if noise is None else max(self.noise_region, self.noise_mean)
        return reached.unreached(self.stopped_by, stop.noise, noise, stop.pixels, regions)

    def _fraction(self, stop, noise):
        shares = [0.0]
        shares += [(stop.noise / noise) ** 2] if stop.noise is not None and noise else []
        shares += [self.spent / stop.time] if stop.time else []
        shares += [self.samples / stop.samples] if stop.samples else []
        return min(max(shares), 0.99)

    def layer(self, name):
        """(H, W, 3), sum over the parts that have it."""
        return sum(mean.layers[name] for mean in self.means.values() if name in mean.layers)

    def seconds_left(self, stop, noise):
        """Seconds until what comes first ends the passes, at the pace so far; None where nothing tells.

        noise : that has to be as low as the one that is asked for, as `run` gives it
        """
        passes = [(self.means[part.name], part.samples) for part in self.parts]
        work, fresh = (sum(counted(mean) * mean.expected for mean, _ in passes)
                       for counted in (lambda mean: mean.count, lambda mean: mean.count - mean.resumed))
        pace = self.spent / fresh if fresh > 0 else 1.0  # by the clock, over what the quickest passes take
        ends = [] if stop.time is None else [stop.time - self.spent]
        if stop.noise and noise is not None and work > 0:
            ends.append(pace * work * ((noise / stop.noise) ** 2 - 1))
        if stop.samples is not None and work > 0:
            ends.append(pace * sum(max(0, math.ceil((stop.samples - mean.samples) / samples)) * mean.expected
                                   for mean, samples in passes))
        least = pace * sum(max(0, LEAST - mean.count) * mean.expected for mean, _ in passes)
        return max(least, min(ends)) if ends else None

    def so_far(self) -> "Passes":
        """What there is now, as a picture that later passes do not change; no array is copied."""
        still = Passes(part._replace(render=_ended) for part in self.parts)
        still.means = {name: mean.so_far() for name, mean in self.means.items()}
        still.stopped_by, still.spent = self.stopped_by, self.spent
        return still


def _ended(_number):
    raise ValueError("a picture as it was has no further passes")


@contextmanager
def _interruptions():
    """A list that SIGINT and SIGTERM are kept in, where somebody handles them otherwise; the same one again ends the process."""
    arrived, usual = [], {}

    def keep(number, _frame):
        if number in arrived:
            # only now: Python complains of a signal that has come already when its handler is taken away
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        arrived.append(number)

    if threading.current_thread() is threading.main_thread():
        usual = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)
                 if callable(signal.getsignal(number))}
        for number in usual:
            signal.signal(number, keep)
    try:
        yield arrived
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)
