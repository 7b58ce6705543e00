"""Pictures from passes: until the noise, the samples or the time is reached, and on from where an earlier render stopped.

A renderer is the sum of its parts; a part is one kind of pass with a number of passes of its own, such as direct light and walks.

    estimate = Estimate([Part("direct", direct, samples=4), Part("walk", walk)], identity)
    estimate.resume(job.pair[1])          # on --resume
    estimate.run(stop, progress)
    return estimate.finish(job, method="particles")
"""

import hashlib
import json
from pathlib import Path

import numpy as np

from bakery.errors import Interrupted, UsageError
from renderers import colour
from renderers.mitsuba import bitmaps
from renderers.pictures import signed
from renderers.pictures.engine import Part, Passes, Stop
from renderers.pictures.means import LEAST, tiled
from renderers.pictures.running import rgb_layers
from renderers.scene.budget import percent

__all__ = ["Estimate", "Part", "Stop", "error_of_mean", "fingerprint", "made_of"]

_MOST = 1 << 53  # passes; no file of ours says more
_STATE = "bakery_passes"  # attribute of the EXR
_ANEW = "without --resume it is rendered from the beginning"


class Estimate(Passes):
    """Passes whose picture is written to a file, and resumed from it.

    identity : dict of texts and numbers by name, what the passes depend on: fingerprints of scene and asset, method, size,
        seed; not what stops them
    """

    def __init__(self, parts, identity):
        super().__init__(parts)
        self.identity = dict(identity)

    def layers(self) -> dict[str, np.ndarray]:
        """Channels (H, W) of the EXR besides R, G and B: noise and layers, and those of each part where there are several."""
        names = dict.fromkeys(name for mean in self.means.values() for name in mean.layers)
        channels = _channels("", {name: self.layer(name) for name in names}, self.variance)
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
        job : `renderers.pictures.running.Render`
        layers : further channels (H, W) by name
        reasons, text, more : as `Render.finish` takes them; a `noise` of None where the scatter of passes does not tell it;
            `unlit`, sentences of why it does not, which are a miss where a noise was asked for

        Returns
        -------
        report : of `Render.finish`, with `noise_mean`, `noise_region`, `pixel_noise`, `passes` by part, `stopped_by`, `stopped`
            (whether somebody asked for that), `mean_error`, standard error of `mean` by the scatter of passes, None where a part
            has one pass, and `below_zero`, the figures of `renderers.pictures.signed.Clipped` or None (`mean` is that of the
            estimate); `parts` by name: `samples` (of a pass), `passes`, `noise` (its share of the picture's, in squares),
            `seconds` (of the quickest pass) and `concentration` (of its variance in few pixels: 1 in one, 1/sqrt(N) where N have
            the same)

        Raises
        ------
        Interrupted : the passes were interrupted, and the picture of those that are over is written, if every part has one
        """
        if not all(mean.count for mean in self.means.values()):
            raise self._interrupted("before there was a picture; nothing was written")
        kept = {name: {"passes": mean.count, "samples": mean.samples, "layers": list(mean.layers), "lost": mean.lost,
                       "spread": mean.spread.tolist(), "regions": np.array(mean.regions, float).tolist()}
                for name, mean in self.means.items()}
        error = _error_of_mean(kept)
        lost = sum(mean.lost for mean in self.means.values())
        channels = self.layers() | (layers or {})
        picture = signed.clipped(self.rgb, {name: image for name, image in channels.items() if name.startswith("noise.")})
        reasons = [*reasons] + [f"{lost} values of pixels were no numbers and count as dark"] * (lost > 0)
        reasons += [f"stopped on request, after {self.samples} samples a pixel"] * (self.stopped_by == "request")
        reasons += picture.reasons
        report = job.finish(picture.rgb, layers=channels | picture.layers,
                            text=more.pop("text", {}) | {_STATE: json.dumps({"identity": self.identity, "parts": kept})},
                            samples=self.samples,
                            noise=more.pop("noise", self.noise), noise_mean=more.pop("noise_mean", self.noise_mean),
                            noise_region=more.pop("noise_region", self.noise_region), pixel_noise=self.pixel_noise,
                            mean=self.rgb.mean(axis=(0, 1)).tolist(), below_zero=picture.figures,
                            passes={name: mean.count for name, mean in self.means.items()},
                            parts={part.name: self._part(part, self.means[part.name]) for part in self.parts},
                            mean_error=None if error is None else error[:3].tolist(), stopped_by=self.stopped_by,
                            stopped=self.stopped_by == "request",
                            reasons=reasons, unreached=[*self.unreached, *more.pop("unlit", ())], **more)
        if self.signal:
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

    def _interrupted(self, message):
        return Interrupted(f"interrupted {message}").ending(128 + self.signal)

    def resume(self, path):
        """Goes on with the passes behind the picture in an EXR file, as if there had been no break but for rounding to 32 bits.

        Raises UsageError where the file is not there, or holds another picture or none.
        """
        path = Path(path)
        if not path.is_file():
            raise UsageError(f"{path}: there is no picture to go on with; {_ANEW}")
        channels, text = bitmaps.read(path)
        try:
            differing = self._restore(channels, json.loads(text[_STATE]))
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError):
            raise UsageError(f"{path}: holds no passes to go on with; {_ANEW}") from None
        if differing:
            raise UsageError(f"{path}: is a picture of something else (other {', '.join(differing)}); {_ANEW}")

    def _restore(self, channels, state):
        """Takes the means from a picture, unless what it says of itself differs: the names of what does."""
        stored, expected = ({"parts": list(parts)} | identity for parts, identity in
                         ((state["parts"], state["identity"]), (self.means, self.identity)))
        differing = sorted(key for key in stored.keys() | expected.keys() if stored.get(key) != expected.get(key))
        of_pass = {part.name: part.samples for part in self.parts}
        for name, mean in self.means.items() if not differing else ():
            prefix, part = self._prefix(name), state["parts"][name]
            whole = prefix or signed.estimate_of(channels)
            mean.count, mean.lost, mean.spread = int(part["passes"]), int(part["lost"]), _spread(part)
            # files of before passes had several sizes do not say
            mean.resumed, mean.samples = mean.count, int(part.get("samples", mean.count * of_pass[name]))
            if not (0 < mean.count < _MOST and mean.lost >= 0 and mean.count <= mean.samples < _MOST):
                raise ValueError("numbers of passes that nobody renders")
            mean.layers = {layer: _image(channels, _joined(prefix, layer) or whole) for layer in part["layers"]}
            if mean.count >= LEAST:
                mean.square = _image(channels, f"{whole}noise.", "RGBY").astype(float) ** 2 * (mean.count * (mean.count - 1))
            mean.regions = _squares(part["regions"], tiled(mean.layers[""][..., 0]).shape)
            size = stored.get("size", list(mean.layers[""].shape[:2]))
            for image in (*mean.layers.values(), *([mean.square] if mean.count >= LEAST else [])):
                if list(image.shape[:2]) != size or not np.isfinite(image).all():
                    raise ValueError("layers that no passes leave")
        return differing


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
    for part in what:
        content = part.read_bytes() if isinstance(part, Path) else json.dumps(part, sort_keys=True).encode()
        digest.update(hashlib.sha256(content).digest())
    return digest.hexdigest()[:16]


def made_of(scene):
    """What passes of a scene depend on, for a fingerprint: its values but for what stops them, shows or names the picture, and
    its files but for the assets.

    Returns a tuple of a dict and of paths.
    """
    values = scene.values
    apart = {scene.path, *(scene.file(name) for entry in scene.materials for name in (entry.asset, entry.recipe) if name)}
    # no warnings: they are about tuples in place of lists
    told = values.model_dump(mode="json", exclude={"stop", "display", "denoise", "name", "description", "frames"}, warnings=False)
    if told.get("scene") and told["scene"]["parameters"] is None:
        del told["scene"]["parameters"]  # pictures of scenes without any are gone on with, also those of earlier versions
    return told, *(file for file in scene.inputs if file not in apart)


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
