"""Estimates below 0: where they are kept, and the picture without them that people see.

Beams of negative power stand for a boundary, and colours may lie outside of what red, green and blue make: so estimates go below
0.  Clipped at 0 each pixel is nearer to the truth, but noise that is cut on one side makes the mean brighter.
"""

from typing import NamedTuple

import numpy as np

from renderers import colour
from renderers.pictures.running import rgb_layers
from renderers.scene.budget import percent

PREFIX = "signed."  # of the channels of the EXR that hold the estimate and its noise, where it is below 0 anywhere
_ROUNDING = 1e-6  # of the picture's mean: what is less below 0 is clipped without a word


class Clipped(NamedTuple):
    """A picture without values below 0.

    rgb : (H, W, 3)
    layers : channels (H, W) by name: noise, and the estimate as it was where more than rounding was clipped
    figures : `share` of the values that were below 0, `least` of them and `raised`, the change of the luminance's mean, both over
        that mean; None where nothing but rounding was
    reasons : the same in words
    """

    rgb: np.ndarray
    layers: dict[str, np.ndarray]
    figures: dict[str, float] | None
    reasons: list[str]


def clipped(rgb, noise) -> Clipped:
    """What people see of an estimate.

    Where the estimate is below 0 its error is at least that much, whatever the scatter of passes says.

    rgb : (H, W, 3) linear sRGB
    noise : channels `noise.R` to `noise.Y` (H, W), standard errors; {} where they are not known
    """
    shown, level = np.maximum(rgb, 0.0), float(np.mean(rgb @ colour.LUMINANCE))
    if not np.any(rgb < -_ROUNDING * abs(level)):
        return Clipped(shown, noise, None, [])
    change = shown - rgb
    brighter = dict(zip("RGBY", np.moveaxis(np.dstack([change, change @ colour.LUMINANCE]), -1, 0)))
    layers = {name: np.maximum(image, brighter[name[-1]]).astype(image.dtype) for name, image in noise.items()}
    layers |= rgb_layers(PREFIX, rgb) | {PREFIX + name: image for name, image in noise.items()}
    scale = max(level, 1e-30)
    figures = {"share": float(np.mean(change > _ROUNDING * abs(level))), "least": float(rgb.min()) / scale,
               "raised": float(np.mean(brighter["Y"])) / scale}
    return Clipped(shown, layers, figures, [
        f"{percent(figures['share'])} of the values are below 0, down to {figures['least']:.2g} times the picture's mean: the "
        f"picture has 0 there, and its mean is {percent(figures['raised'])} brighter than the estimate's, which layers signed.R "
        "to signed.B hold"])


def estimate_of(channels):
    """Prefix of the channels of an EXR that hold its estimate: "" where it is the picture."""
    return PREFIX if f"{PREFIX}R" in channels else ""
