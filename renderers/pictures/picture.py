"""A picture while its passes go on: its layers, its noise, and what people see of them."""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from renderers import colour
from renderers.pictures import images
from renderers.scene.budget import percent

PICTURE, DENOISED, NOISE = "picture", "denoised", "noise"  # names of what is shown besides the layers of passes
# what is said of a layer: by its name, or by how that begins
WORDS = {PICTURE: "as the PNG shows it",
         DENOISED: "without its noise; while passes go on the filter sees no albedo and no normals",
         "order0": "light that no material scattered", "order1": "light scattered once", "order2": "light scattered twice",
         "orders": "light scattered three times or more", "light.": "light from this light alone",
         "first": "which material scattered the light of a pixel first: red, green and blue are shares of three of them"}
# colours of the map of noise at 0, 1/4, ... 1: those of matplotlib's magma, as bytes
_COLOURS = np.array([(0, 0, 4), (81, 18, 124), (183, 55, 121), (252, 137, 97), (252, 253, 191)], float)
_STEPS = (1.0, 2.0, 5.0, 10.0)


class Picture:
    """A picture that later passes do not change; notebooks show it.

    Attributes
    ----------
    passes : `renderers.pictures.engine.Passes` as they were
    display : what the scene says of tone curve and exposure, arguments of `renderers.pictures.images.shown`
    method : its name
    seconds : of the passes so far
    seconds_left : until noise, samples or time end the passes; None if unknown
    denoised : (H, W, 3) linear sRGB, the picture without its noise, or None
    report : of the render whose last picture this is, which is written; None of those before
    """

    def __init__(self, passes, display: Mapping, method: str, *, seconds_left=None, denoised=None, report=None):
        self.passes, self.display, self.method = passes, dict(display), method
        self.seconds_left, self.denoised, self.report = seconds_left, denoised, report

    @property
    def seconds(self) -> float:
        return self.passes.spent

    @cached_property
    def rgb(self) -> np.ndarray:
        """(H, W, 3) linear sRGB; 0 where the estimate is below."""
        return np.maximum(self.passes.rgb, 0.0)

    @cached_property
    def layers(self) -> dict[str, np.ndarray]:
        """(H, W, 3) linear sRGB by name, as in the EXR: orders, lights, and what else the passes tell."""
        names = dict.fromkeys(name for mean in self.passes.means.values() for name in mean.layers if name)
        return {name: self.passes.layer(name) for name in names}

    @cached_property
    def error(self) -> np.ndarray | None:
        """(H, W, 4), standard errors of R, G, B and luminance; None before the second pass of each kind."""
        variance = self.passes.variance
        return None if variance is None else np.sqrt(variance)

    @cached_property
    def noise(self) -> float | None:
        """Root mean square standard error of the luminance over its mean; None before the second pass of each kind."""
        return self.passes.noise

    @property
    def samples(self) -> int:
        """A pixel."""
        return self.passes.samples

    @property
    def size(self) -> tuple[int, int]:
        """Pixels (width, height)."""
        return self.rgb.shape[1], self.rgb.shape[0]

    @cached_property
    def figures(self) -> dict[str, float | None]:
        """`noise`, `noise_region` and `noise_mean`, as the report has them."""
        return {"noise": self.noise, "noise_region": self.passes.noise_region, "noise_mean": self.passes.noise_mean}

    # ---- what people see

    def names(self) -> list[str]:
        """Of what `bytes_of` shows; the picture comes first."""
        shown = [name for mean in self.passes.means.values() for name in mean.layers if words_of(name)]
        return [PICTURE, *[DENOISED] * (self.denoised is not None), NOISE, *dict.fromkeys(shown)]

    def linear(self, name: str = PICTURE) -> np.ndarray:
        """(H, W, 3) linear values of what is shown; of the noise standard errors, nan where they are not known."""
        if name == NOISE:
            return np.full_like(self.rgb, np.nan) if self.error is None else self.error[..., :3]
        return self.rgb if name == PICTURE else self.denoised if name == DENOISED else self.layers[name]

    @cached_property
    def relative_error(self) -> np.ndarray:
        """(H, W), standard error of the luminance over the larger of it and the picture's mean; 0 where it is not known."""
        if self.error is None:
            return np.zeros(self.rgb.shape[:2])
        level = self.rgb @ colour.LUMINANCE
        return self.error[..., 3] / np.maximum(level, max(float(level.mean()), 1e-30))

    @cached_property
    def largest_error(self) -> float:
        """Relative error at the bright end of the map of noise: 1, 2 or 5 times a power of ten that 99 of 100 pixels keep."""
        largest = max(float(np.quantile(self.relative_error, 0.99)), 1e-6)
        decade = 10.0 ** np.floor(np.log10(largest))
        return float(next(step for step in _STEPS if largest <= step * decade * (1 + 1e-9)) * decade)

    def bytes_of(self, name: str = PICTURE) -> np.ndarray:
        """(H, W, 3) bytes: the picture as the PNG has it, layers by the same tone curve, shares as they are, noise by colours."""
        if name == NOISE:
            places = np.clip(self.relative_error / self.largest_error, 0, 1)
            steps = np.linspace(0, 1, len(_COLOURS))
            table = np.stack([np.interp(np.linspace(0, 1, 256), steps, _COLOURS[:, i]) for i in range(3)], axis=-1)
            return np.round(table).astype(np.uint8)[images.eight_bits(places)]
        if name.startswith("first"):
            return images.eight_bits(colour.encode(self.layers[name]))
        return images.eight_bits(images.shown(self.linear(name), **self.display)[0])

    def png(self, name: str = PICTURE, level: int = 6) -> bytes:
        """The same as PNG; `level` as `renderers.pictures.images.png` takes it."""
        return images.png(self.bytes_of(name), level)

    def _repr_png_(self) -> bytes:
        return self.png()

    def __repr__(self) -> str:
        width, height = self.size
        words = [f"{width} x {height}", self.method, f"{self.samples} samples a pixel"]
        words += [] if self.noise is None else [f"noise {percent(self.noise)}"]
        words += [f"{self.seconds:.1f} s"]
        words += ["written"] if self.report else [] if self.seconds_left is None else [f"{self.seconds_left:.0f} s left"]
        return f"<Picture {', '.join(words)}>"


def words_of(name: str) -> str:
    """What is said of a layer; "" of those that only programs read."""
    return WORDS.get(name) or next((WORDS[family] for family in ("light.", "first") if name.startswith(family)), "")
