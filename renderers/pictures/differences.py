"""How two pictures of one scene differ: the error beneath their noise, the bias of the mean, and what a person sees of it."""

from dataclasses import dataclass
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from bakery.errors import UsageError
from renderers import colour
from renderers.mitsuba import bitmaps
from renderers.pictures import images, progressive, signed

FLIP = "flip-evaluator"  # distribution
PIXELS_PER_DEGREE = 67.0  # a display of 0.7 m and 3840 pixels, seen from 0.7 m: what FLIP takes unless told
_BLOCK = 16  # pixels: errors of neighbours belong together
_SURE = 2.0  # standard errors


@dataclass(frozen=True)
class Picture:
    """A picture with its noise.

    name : of the method, or of the file
    rgb : (H, W, 3) linear sRGB
    variance : (H, W) of the luminance, None where it is not known
    mean_error : standard error of the picture's mean luminance, None where it is not known
    """

    name: str
    rgb: np.ndarray
    variance: np.ndarray | None
    mean_error: float | None

    @property
    def luminance(self) -> np.ndarray:
        """(H, W)."""
        return self.rgb @ colour.LUMINANCE


class Difference(NamedTuple):
    """Of a picture from a reference, all but `map` relative to the mean luminance of the reference.

    map : (H, W) difference of luminance over the reference's mean luminance, positive where the picture is brighter
    rms : root mean square of it
    noise : root mean square of the noise in it, of both pictures; None where that of neither is known
    error : root mean square beneath the noise, 0 where less is there than the noise alone has
    most : upper bound of `error`, two standard errors of its square above it
    resolved : whether `error` stands out of the noise by two standard errors of its square
    bias : of the mean
    bias_error : its standard error; None where that of neither picture is known
    left_in : names of the pictures whose noise is not known and is left in `error`
    """

    map: np.ndarray
    rms: float
    noise: float | None
    error: float
    most: float
    resolved: bool
    bias: float
    bias_error: float | None
    left_in: tuple[str, ...]


def read(path, name) -> Picture:
    """A picture from an EXR file: R, G and B, or the estimate that they are without what is below 0, and the noise where a
    renderer of scenes wrote it.

    Raises UsageError where the file is no picture, or holds no colours.
    """
    channels, text = bitmaps.read(path)
    if not {"R", "G", "B"} <= channels.keys():
        raise UsageError(f"{path}: holds no channels R, G and B, only {', '.join(channels)}; use another picture")
    estimate = signed.estimate_of(channels)  # means over many pixels and pictures: what noise takes away belongs to them
    rgb = np.stack([channels[f"{estimate}{c}"] for c in "RGB"], axis=-1).astype(float)
    if not np.isfinite(rgb).all():
        raise UsageError(f"{path}: holds values that are no numbers; use another picture")
    noise, error = channels.get(f"{estimate}noise.Y"), progressive.error_of_mean(text)
    return Picture(name, rgb, None if noise is None else noise.astype(float) ** 2, None if error is None else float(error[3]))


def between(picture: Picture, reference: Picture) -> Difference | None:
    """How a picture differs from a reference whose noise is independent; None where the reference is black.

    The mean squared difference is that of the expected pictures plus the variances of both.  Its standard error is taken from
    blocks of 16 x 16 pixels, so differences that vary over the picture widen it.
    """
    level = float(reference.luminance.mean())
    if level <= 0:
        return None
    shift = (picture.luminance - reference.luminance) / level
    variances = [shown.variance / level**2 for shown in (picture, reference) if shown.variance is not None]
    variance = sum(variances, np.zeros(shift.shape))
    excess = shift**2 - variance
    square, deviation = float(excess.mean()), _standard_error(excess)
    ratio = float(picture.luminance.mean()) / level
    errors = [scale * shown.mean_error / level for shown, scale in ((picture, 1.0), (reference, ratio))
              if shown.mean_error is not None]
    return Difference(
        map=shift, rms=float(np.sqrt(np.mean(shift**2))), noise=float(np.sqrt(variance.mean())) if variances else None,
        error=max(square, 0.0) ** 0.5, most=(max(square, 0.0) + _SURE * deviation) ** 0.5, resolved=square > _SURE * deviation,
        bias=ratio - 1, bias_error=float(np.linalg.norm(errors)) if errors else None,
        left_in=tuple(shown.name for shown in (picture, reference) if shown.variance is None))


def _standard_error(values):
    """Of the mean of (H, W), from sums over blocks."""
    block = max(1, min(_BLOCK, min(values.shape) // 4))
    starts = [np.arange(0, size, block) for size in values.shape]
    sums, counts = (np.add.reduceat(np.add.reduceat(array, starts[0], axis=0), starts[1], axis=1)
                    for array in (values, np.ones(values.shape)))
    apart = sums - values.mean() * counts
    return float(np.sqrt(apart.size / max(apart.size - 1, 1) * np.sum(apart**2))) / values.size


def flip_missing() -> str:
    """Why FLIP cannot be measured; "" where it can."""
    if find_spec("flip_evaluator"):
        return ""
    return f'FLIP was not measured: {FLIP} is not installed; `pip install ".[compare]"` in the folder of the sources brings it'


def flip(shown, reference) -> tuple[float, np.ndarray]:
    """Mean and map (H, W), 0 to 1, of what a person sees of the difference of two pictures that are shown in turn.

    shown, reference : (H, W, 3) display values, 0 to 1, seen at 67 pixels a degree

    Source: Andersson et al., Proc. ACM Comput. Graph. Interact. Tech. 3(2), 2020 (LDR-FLIP), by its authors' package.
    """
    import flip_evaluator

    pair = [np.ascontiguousarray(picture, dtype=np.float32) for picture in (reference, shown)]
    per_pixel, mean, _ = flip_evaluator.evaluate(*pair, "LDR", applyMagma=False, parameters={"ppd": PIXELS_PER_DEGREE})
    return float(mean), np.array(per_pixel, dtype=float).reshape(shown.shape[:2] + (-1,))[..., 0]


@dataclass(frozen=True)
class Compared:
    """A picture beside the reference.

    name : of the picture
    display : (H, W, 3) display values, 0 to 1
    difference : from the reference; None of the reference itself, and where it is black
    flip, flip_map : mean, and (H, W); None of the reference itself, and where FLIP is not installed
    """

    name: str
    display: np.ndarray
    difference: Difference | None = None
    flip: float | None = None
    flip_map: np.ndarray | None = None


def compared(pictures, reference, display, *, with_flip: bool = True) -> list[Compared]:
    """Each picture beside the reference, which is one of them, or another.

    pictures : list of `Picture`
    reference : `Picture`
    display : dict, `display` of the scene: how pictures are shown
    with_flip : whether FLIP is measured, where it is installed
    """
    with_flip, listed = with_flip and not flip_missing(), []
    background = images.shown(reference.rgb, **display)[0]
    for picture in pictures:
        shown = background if picture is reference else images.shown(picture.rgb, **display)[0]
        if picture is reference:
            listed.append(Compared(picture.name, shown))
            continue
        seen = flip(shown, background) if with_flip else (None, None)
        listed.append(Compared(picture.name, shown, between(picture, reference), *seen))
    return listed


def same_size(picture: Picture, reference: Picture, path) -> None:
    """UsageError where the reference, from a file or of a method, has another size than a picture."""
    if picture.rgb.shape != reference.rgb.shape:
        (height, width), (other_high, other_wide) = picture.rgb.shape[:2], reference.rgb.shape[:2]
        raise UsageError(f"{path}: has {other_wide} x {other_high} pixels, and {picture.name} {width} x {height}; use a "
                         "reference of that size, or film: {width: …, height: …} of the scene")
