"""Hues without the spots that a network leaves of coloured noise: means over pixels that see the same surface.

Few samples are coloured noise where wavelengths scatter differently, and a network makes spots some ten pixels wide of it, which
the eye sees long before it sees those of luminance.  Hues of a picture change slowly where albedo, normal, distance and
luminance do, so they are averaged over pixels alike in these (a joint bilateral filter, Petschnigg et al. 2004), and luminance is
left as it is.  It counts because of light of which the others tell nothing: by those alone, lamps in haze lost the colour of
their glow (FLIP of a street 0.050, with luminance 0.043).

Of what the picture's own hues differ from that, as much comes back as the scatter of the passes does not explain (the shrinkage
of James and Stein): next to nothing with few samples, all of it with many.
"""

import numpy as np

from renderers import colour

_REACH = 24  # pixels: radius of the disc over which hues are averaged, some times as wide as a network's spots
_STEP = 6  # pixels between the places of the disc: what the network leaves is smooth over these
_AROUND = 9  # pixels: side of the squares whose hues are compared with noise
_WIDER = 33  # pixels: side of the square over which both are averaged, so that noise seldom looks like more
# differences at which a pixel counts exp(-1/2)
_UNLIKE = {"albedo": 0.1, "normal": 0.5, "log distance": 0.1, "log luminance": 0.2}
_ELSEWHERE = 1e4  # beyond the picture: like nothing in it
_TINY = 1e-30
_DARK = 1e-3  # of the mean luminance: darker pixels are alike


def evened(filtered, seen, variance, features):
    """(H, W, 3), a filtered picture with its luminance and hues of the pixels around.

    filtered : (H, W, 3) linear sRGB, >= 0, what a network made of `seen`
    seen, variance : (H, W, 3) the picture, (H, W, 4) its variance and that of its luminance
    features : `renderers.pictures.denoise.Features`
    """
    hues = _means(filtered, features)
    hues /= np.maximum(hues @ colour.LUMINANCE, _TINY)[..., None]
    luminance = (filtered @ colour.LUMINANCE)[..., None]
    return luminance * hues + _told(seen, variance, hues) * (filtered - luminance * hues)


def _told(seen, variance, hues):
    """(H, W, 1), which share of the difference of a picture's hues from others is none of its noise."""
    from scipy.ndimage import uniform_filter

    def around(values, side=_AROUND):
        return uniform_filter(values, (side, side, 1), mode="nearest")

    difference = around(seen - (seen @ colour.LUMINANCE)[..., None] * hues)
    noise = _of_hues(np.maximum(around(variance), 0.0), hues) / _AROUND**2  # running sums end a little below 0
    square, noise = (around(np.sum(values, axis=-1, keepdims=True), _WIDER) for values in (difference**2, noise))
    return 1 - np.minimum(noise / np.maximum(square, _TINY), 1.0)


def _of_hues(variance, hues):
    """Variance (H, W, 3) of colours less luminance times hue.

    Colours share paths, so their noise has much in common: how much, the variance of luminance tells, as if any two shared it.
    """
    weighted = colour.LUMINANCE * np.sqrt(variance[..., :3])
    alone, together = np.sum(weighted**2, axis=-1), np.sum(weighted, axis=-1)
    shared = np.clip((variance[..., 3] - alone) / np.maximum(together**2 - alone, _TINY), 0.0, 1.0)[..., None]
    with_luminance = np.sqrt(variance[..., :3]) * (weighted + shared * (together[..., None] - weighted))
    return np.maximum(variance[..., :3] + hues**2 * variance[..., 3:] - 2 * hues * with_luminance, 0.0)


def _means(picture, features):
    """Means (H, W, 3) over the disc around, weighted by how alike pixels are in what they see."""
    height, width = picture.shape[:2]
    distance = np.where(np.isfinite(features.distance) & (features.distance > 0), features.distance, 1.0)
    luminance = picture @ colour.LUMINANCE
    luminance = np.maximum(luminance, max(_DARK * luminance.mean(), _TINY))
    seen = np.dstack([features.albedo / _UNLIKE["albedo"], features.normal / _UNLIKE["normal"],
                      np.log(distance) / _UNLIKE["log distance"], np.log(luminance) / _UNLIKE["log luminance"]])
    planes = np.ascontiguousarray(np.moveaxis(np.dstack([seen, picture]), -1, 0), np.float32)
    padded = np.pad(planes, ((0, 0), (_REACH, _REACH), (_REACH, _REACH)), constant_values=_ELSEWHERE)
    alike, sums, weights = planes[:-3], np.zeros((3, height, width), np.float32), np.zeros((height, width), np.float32)
    steps = range(-_REACH, _REACH + 1, _STEP)
    for down, right in ((y, x) for y in steps for x in steps if x * x + y * y <= _REACH**2):
        near = padded[:, _REACH + down:_REACH + down + height, _REACH + right:_REACH + right + width]
        unlike = np.zeros((height, width), np.float32)
        for first, second in zip(alike, near):
            unlike += (first - second) ** 2
        weight = np.exp(-0.5 * unlike)
        sums += weight * near[-3:]
        weights += weight
    return np.moveaxis(sums / weights, 0, -1).astype(float)
