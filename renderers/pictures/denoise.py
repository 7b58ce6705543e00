"""Pictures without their noise, by Intel Open Image Denoise (package `mitsuba-oidn`), held to the noise that was measured.

The network takes differences of neighbouring pixels for noise where colour, normal and distance of what they show do not explain
them.  What it makes of a pixel is then held to what the scatter of the passes allows: lamps, whose light is known, stay as they
are, and with more samples the picture goes to the one without a filter, and not to the network's.
"""

import dataclasses
import importlib.metadata
from functools import cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from renderers import colour
from renderers.pictures import chroma, guided
from renderers.scene.budget import percent

PACKAGE, EXTRA = "mitsuba-oidn", 'pip install ".[denoise]" in the folder of bakery\'s sources'
PREFIX = "denoised."  # of the channels of the EXR
TEXT = "bakery_denoised"  # attribute of both files
_COARSE = ("draft", "preview")  # qualities whose pictures have their noise taken out unless a scene says otherwise
_ALLOWED = 2.0  # standard errors by which the filter may move a value
_ALONE = 4.0  # times as many where no neighbour is off with it
_NOISY = 0.05  # of the brightest value near: noise from which on rare light may have been missed; lamps have less
_NEAR = 5  # pixels: side of the square whose mean a value may be
_AROUND = 9  # pixels: side of the square over which the scatter of few passes is averaged
_WIDER = 25  # pixels: side of the square whose mean a value may be too, however few of the pixels near it any path has reached


class Features(NamedTuple):
    """What pixels show of a scene, whatever its light.

    albedo : (H, W, 3) 0 to 1
    normal : (H, W, 3) in the scene's axes, turned to the camera; a mean over the pixel, shorter than 1 at edges
    distance : (H, W) m, inf where there is nothing
    detail : (H, W), share of the pixel in which parts of the picture count that are kept from the filter; None: all of it
    grain, width : (H, W) m, radius of the grain whose surface normal and distance are of, 0 where there is none, and its width in
        pixels; None: they are not those of the detail
    """

    albedo: np.ndarray
    normal: np.ndarray
    distance: np.ndarray
    detail: np.ndarray | None = None
    grain: np.ndarray | None = None
    width: np.ndarray | None = None

    def channels(self) -> dict[str, np.ndarray]:
        """Of the EXR, by name."""
        layers = {f"albedo.{name}": self.albedo[..., i] for i, name in enumerate("RGB")}
        layers |= {f"normal.{name}": self.normal[..., i] for i, name in enumerate("XYZ")}
        return layers | {"distance.Z": self.distance}


class Denoised(NamedTuple):
    """A picture without its noise.

    rgb : (H, W, 3) linear sRGB, 0 or more
    channels : (H, W) of the EXR by name
    text : attributes of the files
    figures : `filter` and its version; `features`, names of the layers that it saw; `apart`, parts of the picture that it did
        not; `grains`, whether those are filtered grain by grain; `mean_change`, of the mean luminance, relative
    """

    rgb: np.ndarray
    channels: dict[str, np.ndarray]
    text: dict[str, str]
    figures: dict


def fault() -> str:
    """Why the package cannot be used; "" where it can."""
    try:
        import mitsuba_oidn  # noqa: F401
    except ImportError as error:  # it is not there, or what it needs
        return str(error).splitlines()[0]
    return ""


def refuse_absent(scene) -> None:
    """Raises UsageError where a scene says `denoise: yes` and the package is not there: before any work, not after it."""
    if getattr(scene.values, "denoise", "no") == "yes" and (why := fault()):
        raise scene.wrong("denoise", f"found yes, which takes the package {PACKAGE} ({why}); use {EXTRA}, or denoise: auto")


def without(scene):
    """The same `renderers.scene.Scene` for a picture whose noise is looked at."""
    if not hasattr(scene.values, "denoise"):
        return scene
    return dataclasses.replace(scene, values=scene.values.model_copy(update={"denoise": "no"}))


def chosen(values, quality, shared) -> tuple[bool, list[str]]:
    """Whether the noise of a picture is to be taken out, and what is to be said of it.

    values : of the scene
    quality : its name, None: final
    shared : sentence, why pixels share their noise; "" where they do not
    """
    wish = getattr(values, "denoise", "no")
    if wish == "no" or wish == "auto" and quality not in _COARSE:
        return False, []
    if why := fault():
        return False, [f"the noise is not taken out: that takes the package {PACKAGE} ({why}); use {EXTRA}"]
    if wish == "auto" and shared:
        return False, [f"the noise is not taken out: {shared} (denoise: yes does so all the same)"]
    return True, [f"the filter leaves blotches of the noise: {shared}"] if shared else []


def denoised(parts, apart=(), features=None, widened=MappingProxyType({}), quick=False) -> Denoised:
    """A picture without its noise.

    parts : by name, what adds up to the picture: pairs of (H, W, 3) linear sRGB and of its variance (H, W, 4), that of luminance
        last, None where that is not known
    apart : names of those that the network does not see, as it would take their detail for noise: grains, whose surfaces the
        features are of, are filtered by `renderers.pictures.guided`, others stay as they are
    features : `Features`, or None
    widened : by name, factor of the standard errors within which the network may move values, as few passes tell them
    quick : whether a smaller network does: a fifth of the time of the other's, and a FLIP error of drafts that is larger by 0.001

    What the filter sees has a mean of 1: it loses light below 1e-8.  It computes on the processor, also where there is a GPU, so
    that the same picture gives the same bytes.
    """
    rgb = sum(image for image, _ in parts.values())
    detail = None if features is None else features.detail
    if detail is not None and not detail.any():  # no grain is as wide as a pixel: the network sees all parts anyway
        apart, detail = (), None
    guides = features is not None and features.grain is not None
    kept = [guided.smoothed(*part, features) if guides else part[0] for name, part in parts.items() if name in apart]
    allowed = {name: (image, None if variance is None else widened.get(name, 1.0) ** 2 * variance)
               for name, (image, variance) in parts.items()}
    smoothed = [part for name, part in allowed.items() if name not in apart]
    whole = np.maximum(sum(kept) + (_cleared(smoothed, features, quick) if smoothed else 0.0), 0.0)
    if kept and detail is not None:
        share = detail[..., None]
        whole = share * whole + (1 - share) * _cleared(list(allowed.values()), features, quick)
    before, after = (float(np.mean(np.maximum(image, 0.0) @ colour.LUMINANCE)) for image in (rgb, whole))
    denoiser = f"Open Image Denoise {_version()}"
    figures = {"filter": denoiser, "features": [] if features is None else ["albedo", "normal"], "apart": list(apart),
               "grains": bool(kept) and guides, "mean_change": after / before - 1 if before > 0 else 0.0}
    channels = {f"{PREFIX}{name}": whole[..., i] for i, name in enumerate("RGB")}
    return Denoised(whole, channels | ({} if features is None else features.channels()), {TEXT: denoiser}, figures)


def sentence(figures) -> str:
    """What is said of a picture without its noise; figures : of `Denoised`."""
    change = percent(abs(figures["mean_change"]))
    changes = f"takes {change} of its light away" if figures["mean_change"] < 0 else f"adds {change} to its light"
    shown = f"the PNG has its noise taken out ({figures['filter']}), which {changes}"
    if figures["apart"]:
        filtered = "filtered grain by grain" if figures["grains"] else "not filtered"
        shown += f"; grains and particles, whose detail looks like noise, are {filtered} where they are seen"
    return f"{shown}; noise is that of R, G and B of the EXR, which are not filtered, and not the error of what is shown"


def _version():
    import mitsuba_oidn

    return f"{mitsuba_oidn.oidn_version()} ({PACKAGE} {importlib.metadata.version(PACKAGE)})"


def _cleared(parts, features, quick):
    """(H, W, 3), the sum of pairs of a picture and its variance, without its noise."""
    seen = np.maximum(sum(image for image, _ in parts), 0.0)
    level = float(np.mean(seen @ colour.LUMINANCE))
    if not level > 0:
        return seen
    filtered, variances = level * _filtered(seen / level, features, quick), [variance for _, variance in parts]
    variance = None if any(variance is None for variance in variances) else sum(variances)
    if variance is not None and features is not None and np.isfinite(filtered).all():
        filtered = chroma.evened(np.maximum(filtered, 0.0), seen, variance, features)
    return _held(seen, filtered, None if variance is None else variance[..., :3])


def _filtered(picture, features, quick):
    """The filter's picture (H, W, 3); picture : of mean 1.

    Layers are filtered before, each by itself, as the manual of Open Image Denoise advises: noise of theirs, where few rays tell
    fine meshes, edges and grains, would be taken for detail of the picture.
    """
    import mitsuba_oidn

    best, fast = mitsuba_oidn.Quality.High, mitsuba_oidn.Quality.Fast

    def clear(image, quality=fast if quick else best, **options):
        return np.array(mitsuba_oidn.denoise(_single(image), device=_processor(), quality=quality, **options), float)

    if features is None:
        return clear(picture, hdr=True)
    layers = features.albedo, (1 + features.normal) / 2
    albedo, half = (_single(clear(layer, fast)) for layer in layers)
    return clear(picture, hdr=True, albedo=albedo, normal=2 * half - 1, clean_aux=True)


@cache
def _processor():
    import mitsuba_oidn

    return mitsuba_oidn.Device(mitsuba_oidn.DeviceType.CPU)


def _single(image):
    return np.ascontiguousarray(image, np.float32)


def _held(seen, filtered, variance):
    """The filter's picture where it is what a mean can be, else as near to that.

    A mean lies between the least and the most of what is near, and no further from the picture than its noise allows: that of the
    pixel or of its neighbourhood, as a peak makes value and variance large together, and what no path has reached has neither.
    Where light is found so seldom that all pixels near miss it, mean and noise of a wider neighbourhood would do: bounds of 0
    left black specks in bodies that few paths through their glass light up, and those of the pixels near left dark squares in a
    snowball beside a bulb, where one pixel in ten had met it.  The wider mean has dark ground in it, too, so the mean of those
    around counts as well, as far as their noise tells it: else notches were left.  Not so where pixels have little noise, as
    flames beside wax.
    """
    from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

    near = (_NEAR, _NEAR, 1)
    lowest, highest = minimum_filter(seen, near, mode="nearest"), maximum_filter(seen, near, mode="nearest")
    if variance is not None:
        around, wider = (_AROUND, _AROUND, 1), (_WIDER, _WIDER, 1)
        usual, further = (np.maximum(uniform_filter(variance, side, mode="nearest"), 0.0) for side in (around, wider))
        noisy = usual >= (_NOISY * maximum_filter(seen, around, mode="nearest")) ** 2  # black pixels are, too
        mean = uniform_filter(seen, around, mode="nearest") + _ALLOWED / _AROUND * np.sqrt(usual)
        highest = np.where(noisy, np.maximum(highest, mean), highest)
        usual = np.where(noisy, np.maximum(usual, further), usual)
        allowed = _ALLOWED * np.sqrt(np.maximum(variance, usual))
        level = uniform_filter(seen, wider, mode="nearest")
        lowest, highest = np.minimum(lowest, level), np.maximum(highest, level)
        allowed = np.where(_isolated(seen - filtered, allowed), _ALONE * allowed, allowed)
        lowest, highest = np.maximum(lowest, seen - allowed), np.minimum(highest, seen + allowed)
    return np.clip(np.where(np.isfinite(filtered), filtered, seen), lowest, highest)


def _isolated(difference, allowed):
    """Where pixels are off by more than what is allowed and less than two of their eight neighbours are, in the same direction.

    A lamp, a line or a texture is off in several; rare bright samples, of which two passes may find one each, in single pixels.
    """
    from scipy.ndimage import uniform_filter

    isolated = np.zeros(difference.shape, bool)
    for beyond in (difference > allowed, difference < -allowed):
        together = np.rint(9 * uniform_filter(beyond.astype(float), (3, 3, 1), mode="constant"))
        isolated |= beyond & (together < 3)
    return isolated
