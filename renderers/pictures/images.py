"""Pictures as arrays and files: tone curve, noise filter, and where they may be written.

A picture is (H, W, 3) linear sRGB, float, 1 = white of the display before exposure.
"""

import os
import struct
import tempfile
import zlib
from pathlib import Path

import numpy as np

from bakery.errors import UsageError
from bakery.system.memory import free_memory
from renderers import colour

TONE_CURVE = "luminance L -> L (1 + L / white^2) / (1 + L) after exposure, colour ratios kept, then the sRGB curve"
_RGB = 2  # colour type of a PNG


# bytes a pixel of all that rendering holds at once, with its layers, those of each kind of pass and their scatter; measured at
# 0.5 million pixels: 470 (grains), 860 (translucent bodies), 970 (particles).  The number of passes does not matter
_BYTES = 1000.0


def refuse_too_large(where, height, width):
    """Raises UsageError where a picture needs more memory than is free: now, not when the system runs out of it minutes later.

    where : what says so, for the message
    """
    needed, free = _BYTES * height * width, free_memory()
    if free is not None and needed > free:
        raise UsageError(f"{where}: found {width} x {height} pixels, which need some {needed / 1e9:.3g} GB of memory; "
                         f"{free / 1e9:.3g} GB are free, enough for {free / _BYTES / 1e6:.3g} million pixels")


def tone_map(rgb, exposure=1.0, white=4.0):
    """Linear radiance to sRGB display values, 0 to 1, by Reinhard's curve on luminance (SIGGRAPH 2002, eq. 4).

    `white` is the luminance, after exposure, that becomes the display's white.
    """
    rgb = np.maximum(rgb, 0.0) * exposure
    luminance = rgb @ colour.LUMINANCE
    white = max(white, 1e-100)  # whose square is no 0; all light is white long before
    curve = (1 + luminance / white**2) / (1 + luminance)
    return colour.encode(rgb * curve[..., None])


def shown(rgb, curve="none", exposure=1.0, white=4.0):
    """Display values (H, W, 3), 0 to 1, by a tone curve (`none`, or `reinhard` with its `white`), and what was done in words."""
    if curve == "none":
        return colour.encode(np.clip(rgb * exposure, 0, 1)), "none after exposure, then the sRGB curve"
    return tone_map(rgb, exposure, white), TONE_CURVE


def eight_bits(display):
    """Display values, 0 to 1, as bytes."""
    return np.round(255 * np.clip(display, 0, 1)).astype(np.uint8)


def png(pixels, level: int = 6) -> bytes:
    """Bytes (H, W, 3) as PNG (ISO 15948); `level` is zlib's: 0 packs nothing, in 3 ms a million pixels where 1 takes 70."""
    height, width, _ = pixels.shape
    rows = np.zeros((height, 1 + 3 * width), np.uint8)  # no filter: noise gains nothing by one
    rows[:, 1:] = pixels.reshape(height, 3 * width)
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", width, height, 8, _RGB, 0, 0, 0)), (b"IDAT", zlib.compress(rows, level)),
              (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks)


def relative_noise(mean, error):
    """Root mean square of the luminance of an error over the mean luminance of a picture `mean`, (H, W, 3) both."""
    return float(np.sqrt(np.mean((error @ colour.LUMINANCE) ** 2)) / max(np.mean(mean @ colour.LUMINANCE), 1e-30))


def filtered(halves, variance, features=None, radius=7, patch=2, strength=0.7, contrast=0.1):
    """Non-local means of two independent half renders: the halves, filtered; their mean is the picture, their difference measures
    the noise that is left.

    Each half is averaged with weights that the other half gives, so a noise peak cannot vouch for itself.  Two pixels count as
    equal as far as the luminance of their patches differs by no more than noise, and their features hardly at all. Biased: detail
    below the noise is smoothed away.  Source: Rousselle, Knaus and Zwicker, ACM Trans. Graph. 31(6), 2012, eqs. 5-8, on
    luminance; features as in Rousselle, Manzi and Zwicker, Comput. Graph. Forum 32(7), 2013.

    halves : pair of (H, W, 3)
    variance : (H, W, 3), of one half's pixel values
    features : (H, W, F) or None, known without noise: edges that the filter must keep
    radius, patch : pixels; search window and compared patch are 2 radius + 1 and 2 patch + 1 wide
    strength : 1, differences up to this many standard deviations count as none
    contrast : 1, difference of a feature that keeps pixels apart
    """
    from scipy.ndimage import uniform_filter

    height, width = halves[0].shape[:2]
    variance = variance @ colour.LUMINANCE**2
    # A peak that only one pass found makes picture and variance large together; its neighbours say what is usual.
    variance = uniform_filter(variance, 9) + 1e-8
    guides = [half @ colour.LUMINANCE for half in halves]
    features = np.zeros((height, width, 0)) if features is None else features
    # On an edge itself hardly any pixel is like another: there the slope is what may differ.
    slope = sum(((np.roll(features, -1, axis) - np.roll(features, 1, axis)) / 2) ** 2 for axis in (0, 1))
    tolerance = np.moveaxis(1 / (contrast**2 + slope), -1, 0).astype(np.float32)
    halves, guides, variance, features = ([np.asarray(image, dtype=np.float32) for image in images]
                                          for images in (halves, guides, [variance], np.moveaxis(features, -1, 0)))
    padded = [[np.pad(image, [(radius, radius)] * 2 + [(0, 0)] * (image.ndim - 2), mode="symmetric") for image in images]
              for images in (halves, guides, variance, features)]
    variance = variance[0]
    sums = [np.zeros_like(half) for half in halves]
    weights = [np.zeros_like(variance) for _ in halves]
    for dy in range(2 * radius + 1):
        for dx in range(2 * radius + 1):
            others, other_guides, (other_variance,), other_features = (
                [image[dy:dy + height, dx:dx + width] for image in images] for images in padded)
            apart = sum(((a - b) ** 2 * scale for a, b, scale in zip(features, other_features, tolerance)), np.float32(0.0))
            allowed = variance + np.minimum(variance, other_variance)
            scale = 1 / (strength**2 * (variance + other_variance))
            for k in (0, 1):
                distance = ((guides[1 - k] - other_guides[1 - k]) ** 2 - allowed) * scale
                weight = np.exp(-np.maximum(uniform_filter(distance, 2 * patch + 1, mode="nearest"), 0) - apart)
                sums[k] += weight[..., None] * others[k]
                weights[k] += weight
    return tuple((total / weight[..., None]).astype(float) for total, weight in zip(sums, weights))


def refuse_name(path):
    """Raises UsageError where Mitsuba, which takes names in UTF-8 alone, cannot open or write a file."""
    try:
        os.path.abspath(path).encode()
    except UnicodeEncodeError:
        raise UsageError(f"{path}: a name that is no UTF-8, which Mitsuba cannot open; use another name") from None


def output_pair(output, inputs=(), overwrite=False):
    """Paths (PNG, EXR) beside each other for `X.png` or `X.exr`.

    Raises UsageError where they cannot be written, where one is a file of `inputs`, and, but for `overwrite`, where what stands
    there is no such picture.
    """
    from bakery.store.outputs import by_suffix, check_outputs

    output = Path(output)
    if output.suffix.lower() not in (".png", ".exr"):
        raise UsageError(f"{output}: a picture's name ends in .png or .exr (both are written, beside each other)")
    refuse_name(output)
    pair = output.with_suffix(".png"), output.with_suffix(".exr")
    if not output.parent.is_dir():
        raise UsageError(f"{output}: there is no folder {output.parent}; make it first")
    try:
        with tempfile.TemporaryFile(dir=output.parent):
            pass
    except OSError as error:
        raise UsageError(f"{output}: cannot write in {output.parent}: {error.strerror}") from None
    check_outputs(by_suffix(pair), inputs, overwrite)
    return pair
