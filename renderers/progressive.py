"""Pictures from passes: until the noise, the samples or the time is reached, and on from where an earlier render stopped.

A renderer is the sum of its parts; a part is one kind of pass with a number of passes of its own, such as direct light and walks.

    estimate = Estimate([Part("direct", direct, samples=4), Part("walk", walk)], identity)
    estimate.resume(job.pair[1])          # on --resume
    estimate.run(stop, progress)
    return estimate.finish(job, method="particles")
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bakery.errors import Interrupted, UsageError
from renderers import colour, reached, signed
from renderers.budget import percent
from renderers.means import LEAST, Mean, student, tiled
from renderers.mitsuba import bitmaps
from renderers.running import SHARED, rgb_layers

# Passes before which the scatter of a part is not relied upon: noise that pixels share has one number a pass for all of them,
# and of few the smallest would stop the picture
TRUSTED, _TRUSTED_SHARED = 4, 8
_DARK = 32  # passes that have to be black for a picture to be so: chance may find a lamp late
# Of the time: every part gets it, also one that found nothing yet and hence seems to be without noise.
_SHARE = 0.05
_MOST = 1 << 53  # passes; no file of ours says more
_STATE = "bakery_passes"  # attribute of the EXR
_ANEW = "without --resume it is rendered from the beginning"


@dataclass(frozen=True)
class Stop:
    """Whichever comes first; None never comes.

    Attributes
    ----------
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
        """What a scene asks for: the noise of its `renderers.budget.Split`, by its `measure`, and its `stop`, for `draft`,
        `preview` or `final`.

        Raises UsageError where there is no such quality.
        """
        coarser = reached.coarser(quality)
        return cls(coarser * split.noise, reached.limit(time, quality), samples and max(1, round(samples / coarser**2)),
                   measure == "pixels")


class Part(NamedTuple):
    """One kind of pass.

    Attributes
    ----------
    name : of the part, distinct from the names of layers
    render : function of the pass (0, 1, ...), on which alone its random numbers depend; gives layers (H, W, 3) of linear sRGB by
        name, of which "" is the picture.  An interruption waits for its end: some seconds at most
    samples : a pixel and pass
    """

    name: str
    render: Callable[[int], dict[str, np.ndarray]]
    samples: int = 1


class Estimate:
    """A picture that is being rendered.

    Attributes
    ----------
    parts, means : tuple of `Part`, and `Mean` by their names
    stopped_by : `noise`, `samples`, `time`, `interruption`, or None before `run`
    """

    def __init__(self, parts, identity):
        """
        Parameters
        ----------
        parts : of the picture
        identity : dict of texts and numbers by name, what the passes depend on: fingerprints of scene and asset, method, size,
            seed; not what stops them
        """
        self.parts, self.identity = tuple(parts), dict(identity)
        self.means = {part.name: Mean() for part in self.parts}
        self.stopped_by, self._unreached = None, ()
        self._signal = 0

    @property
    def rgb(self):
        """(H, W, 3) linear sRGB."""
        return self._layer("")

    @property
    def variance(self):
        """(H, W, 4), of `rgb` and its luminance; None before the second pass of each part."""
        variances = [mean.variance for mean in self.means.values()]
        return None if any(one is None for one in variances) else sum(variances)

    @property
    def noise(self):
        """Root mean square standard error of the luminance over its mean; None before the second pass of each part."""
        variance = self.variance
        if variance is None:
            return None
        # measured, as most noise is that of all channels together: `images.relative_noise` takes them as independent
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

        Noise that pixels share is in it, which few passes tell badly: times `renderers.means.student`.
        """
        return self._of_few({name: mean.spread[3] for name, mean in self.means.items()})

    @property
    def noise_region(self):
        """The same of the mean luminance of regions, the tiles of `renderers.means.tiled`; their root mean square."""
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
        return min(part.samples * self.means[part.name].count for part in self.parts)

    def run(self, stop, progress=None):
        """Renders passes until `stop`, or until SIGINT or SIGTERM; the same signal again ends the process at once.

        Parameters
        ----------
        stop : `Stop`
        progress : function of (fraction 0 to 1, noise or None), or None

        Notes
        -----
        The next pass is one of the part that takes most variance away a second.  So the numbers of passes depend on the machine,
        unless samples alone stop them.
        """
        begin = time.monotonic()
        with _interruptions() as arrived:
            while True:
                spent = time.monotonic() - begin
                part, noise = self._next(stop), self._noise_to_reach(stop)
                self.stopped_by = "interruption" if arrived else self._over(stop, part, noise, spent)
                if progress:
                    progress(1.0 if self.stopped_by else self._fraction(stop, noise, spent), noise)
                if self.stopped_by:
                    self._unreached = self._what_missed(stop)
                    break
                start, mean = time.monotonic(), self.means[part.name]
                mean.add(part.render(mean.count), time.monotonic() - start)
        self._signal = arrived[0] if arrived else 0

    def _next(self, stop):
        """The part whose pass is next; None where all have their samples."""
        means = [self.means[part.name] for part in self.parts]
        left = [(mean, part) for mean, part in zip(means, self.parts)
                if mean.count < LEAST or stop.samples is None or mean.count * part.samples < stop.samples]
        unknown = [(mean, part) for mean, part in left if mean.count < LEAST or math.isinf(mean.seconds)]
        if unknown or not left:
            return min(unknown, key=lambda one: one[0].count, default=(None, None))[1]
        spent = sum(mean.count * mean.expected for mean in means)
        behind = [(mean, part) for mean, part in left if mean.count * mean.expected < _SHARE * spent]
        return max(behind or left, key=lambda one: one[0].gain())[1]

    def _over(self, stop, part, noise, spent):
        """What stops the passes before one of `part`; None if nothing does."""
        passes = min(mean.count for mean in self.means.values())
        if part is None:
            return "samples"
        shared = noise is not None and self.noise_region > SHARED * self.noise
        trusted = _DARK if not np.any(self.rgb) else _TRUSTED_SHARED if shared else TRUSTED
        if passes >= trusted and stop.noise is not None and noise <= stop.noise:
            return "noise"
        if passes >= LEAST and stop.time is not None and spent + self.means[part.name].expected > stop.time:
            return "time"
        return None

    def _what_missed(self, stop):
        """Sentences of `renderers.reached.unreached`."""
        noise = self.pixel_noise if stop.pixels else self.noise
        regions = 0.0 if noise is None else max(self.noise_region, self.noise_mean)
        return reached.unreached(self.stopped_by, stop.noise, noise, stop.pixels, regions)

    def _fraction(self, stop, noise, spent):
        shares = [0.0]
        shares += [(stop.noise / noise) ** 2] if stop.noise is not None and noise else []
        shares += [spent / stop.time] if stop.time else []
        shares += [self.samples / stop.samples] if stop.samples else []
        return min(max(shares), 0.99)

    def _layer(self, name):
        return sum(mean.layers[name] for mean in self.means.values() if name in mean.layers)

    def layers(self) -> dict[str, np.ndarray]:
        """Channels (H, W) of the EXR besides R, G and B: noise and layers, and those of each part where there are several."""
        names = dict.fromkeys(name for mean in self.means.values() for name in mean.layers)
        channels = _channels("", {name: self._layer(name) for name in names}, self.variance)
        for name, mean in self.means.items():
            channels |= _channels(self._prefix(name), mean.layers, mean.variance)
        return {name: image for name, image in channels.items() if name not in ("R", "G", "B")}

    def _prefix(self, part):
        """Of a part's channels; those of a single part are the picture's."""
        return f"{part}." if len(self.parts) > 1 else ""

    def finish(self, job, *, layers=None, reasons=(), **more) -> dict:
        """Writes the pictures with all that `resume` needs, and reports.

        Parameters
        ----------
        job : `renderers.running.Render`
        layers : further channels (H, W) by name
        reasons, more : as `Render.finish` takes them; a `noise` of None among them where the scatter of passes does not tell it

        Returns
        -------
        report : of `Render.finish`, with `noise_mean`, `noise_region`, `pixel_noise`, `passes` by part, `stopped_by`,
            `mean_error`, standard error of `mean` by the scatter of passes, None where a part has one pass, and `below_zero`, the
            figures of `renderers.signed.Clipped` or None (`mean` is that of the estimate); `parts` by name: `samples` (of a
            pass), `passes`, `noise` (its share of the picture's, in squares), `seconds` (of the quickest pass) and
            `concentration` (of its variance in few pixels: 1 in one, 1/sqrt(N) where N have the same)

        Raises
        ------
        Interrupted : the passes were interrupted, and the picture of those that are over is written, if every part has one
        """
        if not all(mean.count for mean in self.means.values()):
            raise self._interrupted("before there was a picture; nothing was written")
        kept = {name: {"passes": mean.count, "layers": list(mean.layers), "lost": mean.lost, "spread": mean.spread.tolist(),
                       "regions": np.array(mean.regions, float).tolist()} for name, mean in self.means.items()}
        error = _error_of_mean(kept)
        lost = sum(mean.lost for mean in self.means.values())
        channels = self.layers() | (layers or {})
        picture = signed.clipped(self.rgb, {name: image for name, image in channels.items() if name.startswith("noise.")})
        reasons = [*reasons] + [f"{lost} values of pixels were no numbers and count as dark"] * (lost > 0)
        reasons += picture.reasons
        report = job.finish(picture.rgb, layers=channels | picture.layers,
                            text={_STATE: json.dumps({"identity": self.identity, "parts": kept})}, samples=self.samples,
                            noise=more.pop("noise", self.noise), noise_mean=more.pop("noise_mean", self.noise_mean),
                            noise_region=more.pop("noise_region", self.noise_region), pixel_noise=self.pixel_noise,
                            mean=self.rgb.mean(axis=(0, 1)).tolist(), below_zero=picture.figures,
                            passes={name: mean.count for name, mean in self.means.items()},
                            parts={part.name: self._part(part, self.means[part.name]) for part in self.parts},
                            mean_error=None if error is None else error[:3].tolist(), stopped_by=self.stopped_by,
                            reasons=reasons, unreached=self._unreached, **more)
        if self._signal:
            noise = "" if self.noise is None else f", noise {percent(self.noise)}"
            raise self._interrupted(f"after {self.samples} samples a pixel{noise}; the picture so far is in "
                                    f"{', '.join(report['files'])}, and --resume goes on with it")
        return report

    def _part(self, part, mean) -> dict:
        """What a part adds to noise and time, for the report."""
        level, variance = max(np.mean(self.rgb @ colour.LUMINANCE), 1e-30), mean.variance
        spots = np.zeros((1, 1)) if variance is None else variance[..., 3]
        return {"samples": part.samples, "passes": mean.count, "seconds": mean.expected,
                "noise": float(np.sqrt(np.mean(spots)) / level),
                "concentration": float(np.linalg.norm(spots) / max(np.sum(spots), 1e-300))}

    def _interrupted(self, what):
        error = Interrupted(f"interrupted {what}")
        error.exit_status = 128 + self._signal
        return error

    def resume(self, path):
        """Goes on with the passes behind the picture in an EXR file, as if there had been no break but for rounding to 32 bits.

        Raises UsageError where the file is not there, or holds another picture or none.
        """
        path = Path(path)
        if not path.is_file():
            raise UsageError(f"{path}: there is no picture to go on with; {_ANEW}")
        channels, text = bitmaps.read(path)
        try:
            other = self._restore(channels, json.loads(text[_STATE]))
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError):
            raise UsageError(f"{path}: holds no passes to go on with; {_ANEW}") from None
        if other:
            raise UsageError(f"{path}: is a picture of something else (other {', '.join(other)}); {_ANEW}")

    def _restore(self, channels, state):
        """Takes the means from a picture, unless what it says of itself differs: the names of what does."""
        stored, own = ({"parts": list(parts)} | identity for parts, identity in
                         ((state["parts"], state["identity"]), (self.means, self.identity)))
        other = sorted(key for key in stored.keys() | own.keys() if stored.get(key) != own.get(key))
        for name, mean in self.means.items() if not other else ():
            prefix, part = self._prefix(name), state["parts"][name]
            whole = prefix or signed.estimate_of(channels)
            mean.count, mean.lost, mean.spread = int(part["passes"]), int(part["lost"]), _spread(part)
            if not (0 < mean.count < _MOST and mean.lost >= 0):
                raise ValueError("numbers of passes that nobody renders")
            mean.layers = {layer: _image(channels, _joined(prefix, layer) or whole) for layer in part["layers"]}
            if mean.count >= LEAST:
                mean.square = _image(channels, f"{whole}noise.", "RGBY").astype(float) ** 2 * (mean.count * (mean.count - 1))
            mean.regions = _squares(part["regions"], tiled(mean.layers[""][..., 0]).shape)
            size = stored.get("size", list(mean.layers[""].shape[:2]))
            for image in (*mean.layers.values(), *([mean.square] if mean.count >= LEAST else [])):
                if list(image.shape[:2]) != size or not np.isfinite(image).all():
                    raise ValueError("layers that no passes leave")
        return other


def error_of_mean(text) -> np.ndarray | None:
    """Standard errors (4,) of a picture's mean R, G, B and luminance, by the scatter of its passes; None where it does not say.

    text : dict, attributes of its EXR
    """
    try:
        return _error_of_mean(json.loads(text[_STATE])["parts"])
    except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError):
        return None  # another program's, or an earlier version's


def _error_of_mean(parts):
    variances = [_spread(part) / (part["passes"] * (part["passes"] - 1)) for part in parts.values()
                 if part["passes"] >= LEAST]
    return np.sqrt(sum(variances)) if len(variances) == len(parts) else None


def _spread(part):
    """`Mean.spread` as a file has it."""
    return _squares(part["spread"], (4,))


def _squares(values, shape):
    """Sums of squares as a file has them; ValueError where they cannot be that."""
    squares = np.array(values, float)
    if squares.shape != shape or not (np.isfinite(squares) & (squares >= 0)).all():
        raise ValueError("found no squares")
    return squares


def fingerprint(*what) -> str:
    """Sixteen hexadecimal digits of what is in texts, numbers, lists, dicts, and files, for which paths stand."""
    digest = hashlib.sha256()
    for one in what:
        content = one.read_bytes() if isinstance(one, Path) else json.dumps(one, sort_keys=True).encode()
        digest.update(hashlib.sha256(content).digest())
    return digest.hexdigest()[:16]


def made_of(scene):
    """What passes of a scene depend on, for a fingerprint: its values but for what stops them, shows or names the picture, and
    its files but for the assets.

    Returns a tuple of a dict and of paths.
    """
    values = scene.values
    apart = {scene.path, *(scene.file(name) for one in scene.materials for name in (one.asset, one.recipe) if name)}
    # no warnings: they are about tuples in place of lists
    told = values.model_dump(mode="json", exclude={"stop", "display", "name", "description"}, warnings=False)
    return told, *(one for one in scene.inputs if one not in apart)


def _channels(prefix, layers, variance):
    """Channels of layers by name, and of the standard error where it is known."""
    channels = {} if variance is None else {f"{prefix}noise.{name}": np.sqrt(variance[..., i]).astype(np.float32)
                                            for i, name in enumerate("RGBY")}
    for name, image in layers.items():
        channels |= rgb_layers(_joined(prefix, name), image)
    return channels


def _joined(prefix, layer):
    return f"{prefix}{layer}." if layer else prefix


def _image(channels, prefix, names="RGB"):
    return np.stack([channels[f"{prefix}{name}"] for name in names], axis=-1)


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
