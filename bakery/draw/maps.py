"""Numbers of pixels as colours: differences with a sign, and shares."""

import io

import numpy as np

# ColorBrewer's red and blue as matplotlib has them: white where there is no difference
SIGNED, SHARE = "RdBu_r", "magma"
_STEPS = (1.0, 2.0, 5.0, 10.0)


def coloured(values, low: float, high: float, colours: str) -> bytes:
    """A map (H, W) from `low` to `high`, what lies outside at the ends, as PNG; `colours` is `SIGNED` or `SHARE`."""
    from matplotlib import colormaps
    from PIL import Image

    index = np.round(255 * np.clip((np.asarray(values) - low) / (high - low), 0, 1)).astype(np.uint8)
    image = Image.frombytes("P", index.shape[::-1], index.tobytes())
    image.putpalette(np.round(255 * colormaps[colours](np.arange(256))[:, :3]).astype(np.uint8).tobytes())
    return _png(image)


def picture(bytes_of) -> bytes:
    """Display values (H, W, 3) as bytes, as PNG."""
    from PIL import Image

    return _png(Image.fromarray(np.ascontiguousarray(bytes_of, dtype=np.uint8)))


def scale(colours: str) -> bytes:
    """The colours from low to high, as PNG."""
    return coloured(np.linspace(0, 1, 256)[None], 0.0, 1.0, colours)


def limit(maps) -> float:
    """1, 2 or 5 times a power of ten that 99 % of the values of all maps stay within; 1e-3 where they are all 0."""
    largest = max((float(np.quantile(np.abs(values), 0.99)) for values in maps), default=0.0)
    if largest <= 0:
        return 1e-3
    decade = 10.0 ** np.floor(np.log10(largest))
    return float(next(step for step in _STEPS if largest <= step * decade * (1 + 1e-9)) * decade)


def _png(image) -> bytes:
    out = io.BytesIO()
    image.save(out, "PNG", optimize=True)
    return out.getvalue()
