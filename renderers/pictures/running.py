"""One render of a scene, from its file to its pictures and its report: what all renderers of scenes do alike.

A renderer begins a `Render`, makes a picture of linear radiance out of `scene.values` and `asset`, and finishes it.
"""

import json
import time

from renderers import scene
from renderers.mitsuba import bitmaps
from renderers.pictures import denoise, images, reached
from renderers.progress import share
from renderers.scene import assets
from renderers.scene.budget import percent

FRAME = "bakery_frame"  # attribute of the pictures of a finished frame of a sequence


def refuse_too_large(scene) -> None:
    """Raises UsageError where a scene's film takes more memory than is free."""
    film = scene.values.film
    if film.height:
        images.refuse_too_large(f"{scene.places.get('film.width', scene.path)}: film", film.height, film.width)


class Render:
    """A scene that is being rendered.

    scene : `renderers.scene.Scene`
    assets : of the scene's materials, opened; those of several may be the same
    asset : the first of them
    pair : paths (PNG, EXR) of the pictures
    quality : name, or None: final
    seconds : dict, of each part that was said to be over, and `total`
    """

    def __init__(self, path, output=None, *, overrides=None, quality=None, overwrite=False, progress=None):
        """
        Parameters
        ----------
        path : of a scene, or what `renderers.scene.load` made of it
        output : `X.png` or `X.exr`; beside the scene, by its name, if None
        overrides : dotted key -> value as text, of a path
        quality : draft, preview or final: what is asked of the picture, see `renderers.pictures.reached`; final if None
        overwrite : replace also files that are no such pictures; never one that the scene reads
        progress : function of (fraction 0 to 1, noise or None), or None

        Raises
        ------
        RecipeError : with every problem of the scene, or of its recipe
        UsageError, AssetError : the pictures cannot be written there, the asset is no asset
        StageError, StoreError : its recipe cannot be baked
        """
        self._begin = self._last = time.monotonic()
        self._progress, self.quality = progress, quality
        self.seconds = {}
        self.scene = path if isinstance(path, scene.Scene) else scene.load(path, overrides)
        refuse_too_large(self.scene)
        denoise.refuse_absent(self.scene)
        self.pair = images.output_pair(output or self.scene.picture, self.scene.inputs, overwrite)
        self.scene = assets.baked(self.scene)
        self.assets = assets.opened(self.scene)
        self.asset = self.assets[0]

    def part_over(self, name):
        """The time since the last part was over is that of `name`."""
        now = time.monotonic()
        self.seconds[name], self._last = now - self._last, now
        self.seconds["total"] = now - self._begin

    def progress(self, begin, end):
        """The progress of a part that takes the whole from `begin` to `end`; None where nobody asks."""
        return share(self._progress, begin, end)

    def finish(self, rgb, *, method, layers=None, text=None, samples=None, noise=None, bias=None, reasons=(), denoised=None,
               **more) -> dict:
        """Writes the pictures, the PNG as the scene's `display` says, and reports.

        Parameters
        ----------
        rgb : (H, W, 3) linear sRGB
        method : which of the renderer's methods made it
        layers : dict of (H, W) by name, what the EXR holds besides R, G and B
        text : dict of str by name, kept in both files, or None
        samples : a pixel
        noise, bias : 1, relative to the mean; None where the method has none, or states none
        reasons : texts, why this method, and what is left out
        denoised : `renderers.pictures.denoise.Denoised`, which the PNG shows and the EXR holds besides; None where there is none
        more : what this renderer says besides; `unreached`, sentences of `renderers.pictures.reached.unreached`, of which the
            scene's values and quality decide what they are; `materials`, where methods mix; `choice`, what pilots showed of
            candidates

        Returns
        -------
        report : dict with `renderer` (its section), `method`, `scene`, `asset`, `files`, `size`, `mean` (linear, a channel),
            `samples`, `noise`, `bias`, `measure` (what its tolerance is of), `materials` (of each entry
            `kind`, `method`, `bias`, `reasons`, `pilot`), `denoised` (whether the PNG has its noise taken out), `denoising` (how:
            `renderers.pictures.denoise.Denoised.figures`, or None), `reasons`, `missed` (sentences: what was asked for and not
            reached, [] where all was), `tone_curve`, `overrides`, `seconds` (of each part), and `more`
        """
        missed, remarks = reached.verdict(self.scene.values, self.quality, more.pop("unreached", ()), bias)
        reasons = [*reasons, *remarks]
        layers, text, shown, pilots = layers or {}, text or {}, rgb, more.pop("choice", None)
        if denoised is not None:
            layers, text, shown = layers | denoised.channels, text | denoised.text, denoised.rgb
        display, words = images.shown(shown, **dict(self.scene.values.display))
        if self.scene.mark and more.get("stopped_by") != "interruption":
            # what it was made of, and of its report what no clock decides
            text = text | {FRAME: json.dumps({"mark": self.scene.mark, "method": method, "samples": samples, "noise": noise,
                                              "missed": list(missed), "denoised": denoised is not None})}
        bitmaps.write(self.pair, display, rgb_layers("", rgb) | layers, text)
        self.part_over("write")
        if self._progress:
            self._progress(1.0)
        return {"renderer": self.scene.section, "method": method, "scene": str(self.scene.path),
                "asset": ", ".join(dict.fromkeys(asset.path for asset in self.assets)),
                "files": [str(path) for path in self.pair], "size": [rgb.shape[1], rgb.shape[0]],
                "mean": [float(channel) for channel in rgb.mean(axis=(0, 1))], "samples": samples, "noise": noise, "bias": bias,
                "measure": self.scene.values.measure, "denoised": denoised is not None,
                "denoising": None if denoised is None else denoised.figures,
                "materials": [{"kind": entry.kind, "method": method, "bias": bias, "reasons": reasons, "pilot": pilots}
                              for entry in getattr(self.scene.values, "materials", ())],
                "reasons": reasons, "missed": list(missed), "tone_curve": words,
                "overrides": dict(self.scene.overrides), "seconds": self.seconds} | more


def rgb_layers(prefix, image):
    """Channels of a layer by name: `order1.` gives `order1.R`, `order1.G`, `order1.B`."""
    return {f"{prefix}{name}": image[..., i] for i, name in enumerate("RGB")}


def describe(report, more=None) -> list[str]:
    """Lines for people; `more` takes the place of those about method, samples, noise, bias and reasons."""
    parts = ", ".join(f"{name} {spent:.1f} s" for name, spent in report["seconds"].items() if name != "total")
    return [f"pictures: {', '.join(report['files'])}", *(_made(report) if more is None else more),
            f"time: {report['seconds']['total']:.1f} s ({parts})"]


def _made(report):
    facts = [f"method: {report['method']}"]
    facts += [f"{report['samples']} samples a pixel"] if report["samples"] is not None else []
    facts += [f"noise {percent(report['noise'])}{_of_pixels(report)}{_of_means(report)}"] if report["noise"] is not None else []
    facts += [f"bias {percent(report['bias'])}"] if report["bias"] is not None else []
    return ["; ".join(facts), *report["reasons"]]


def _of_means(report):
    """The noise of the picture's mean, and that of regions where pixels share much of theirs."""
    if report.get("noise_mean") is None:
        return ""
    shared = report["noise_region"] > reached.SHARED * report["noise"]
    regions = f", of the means of regions {percent(report['noise_region'])} as pixels share it" if shared else ""
    return f"{regions}, of the picture's mean {percent(report['noise_mean'])}"


def _of_pixels(report):
    """The noise that stopped the passes, where it was that of pixels."""
    noise = report.get("pixel_noise") if report.get("measure") == "pixels" else None
    return "" if noise is None else f", of 99 of 100 pixels {percent(noise)} at most"
