"""Grains without their noise, each by itself: means over pixels that show the same side of the same grain.

A network takes differences between grains for noise.  Here pixels are averaged with those near that see a surface turned the
same way at the same distance (a joint bilateral filter, Petschnigg et al. 2004), so that grains keep their own brightness.  Of
what is left of the picture then as much is added again as gives the least expected error by Stein's estimate (1981), for which
the scatter of the passes is enough: next to nothing where that is noise, all of it in a picture without noise.
"""

import numpy as np

from renderers.threads import run

_REACH = 5  # pixels, at most, of the disc of neighbours: it is as wide as two grains
_TURNED = 0.3  # of unit normals: difference at which a neighbour counts exp(-1/2)
_AROUND = 9  # pixels: side of the square over which noise and what is left are told
_ROWS = 64  # of the picture at a time


def smoothed(image, variance, features):
    """(H, W, 3), a picture of grains without its noise.

    image, variance : (H, W, 3) linear sRGB, and (H, W, 4) its variance and that of its luminance; None where that is not known
    features : `renderers.pictures.denoise.Features` with `grain` and `width`
    """
    means, weight = _means(image, features)
    if variance is None:
        return means
    from scipy.ndimage import uniform_filter

    residual = image - means
    # E[noise of the picture times what is left of it], as the pixel is a part of its own mean
    common = uniform_filter(np.sum(variance[..., :3], axis=-1) * (1 - weight), _AROUND, mode="nearest")
    square = uniform_filter(np.sum(residual**2, axis=-1), _AROUND, mode="nearest")
    noise = np.where(square > 0, np.minimum(common / np.where(square > 0, square, 1.0), 1.0), 0.0)
    return means + (1 - noise)[..., None] * residual


def _means(image, features):
    """Means (H, W, 3) of the pixels around, and the weight (H, W) that a pixel itself has in its own."""
    height, width = image.shape[:2]
    edge = ((_REACH, _REACH), (_REACH, _REACH), (0, 0))
    # neighbours are views of one padded array: normals, distance, share of grains, picture
    distance = np.where(np.isfinite(features.distance), features.distance, 0.0)
    seen = (features.detail > 0) & (features.grain > 0)
    stacked = np.dstack([features.normal / _TURNED, distance, seen, image])
    padded = np.pad(stacked, edge).astype(np.float32)
    scale = (1 / np.maximum(features.grain, 1e-12)).astype(np.float32)
    reach = np.where(seen, np.clip(np.round(features.width), 1, _REACH), 0).astype(np.float32)
    sums, weights = np.empty((height, width, 3)), np.empty((height, width))
    run(_add_rows, height, padded, scale, reach, sums, weights, block=_ROWS)
    means = np.where(seen[..., None], sums / weights[..., None], image)
    return means, np.where(seen, 1 / weights, 1.0)


def _add_rows(padded, scale, reach, whole, weight_of_all, top, end):
    """Sums of the picture and of weights for the rows from top to end."""
    rows = slice(top, end)
    scale, reach = scale[rows], reach[rows]
    height, width = scale.shape
    middle = padded[top + _REACH:top + _REACH + height, _REACH:_REACH + width]
    sums, weights = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32)
    furthest = int(reach.max())
    for down in range(-furthest, furthest + 1):
        for right in range(-furthest, furthest + 1):
            if down**2 + right**2 > furthest**2 + 1:
                continue
            row = top + _REACH + down
            near = padded[row:row + height, _REACH + right:_REACH + right + width]
            turned = near[..., :3] - middle[..., :3]
            apart = (near[..., 3] - middle[..., 3]) * scale
            likeness = np.exp(-0.5 * (np.einsum("ijk,ijk->ij", turned, turned) + apart * apart))
            weight = near[..., 4] * (reach**2 + 1 >= down**2 + right**2) * likeness
            weights += weight
            sums += weight[..., None] * near[..., 5:]
    whole[rows], weight_of_all[rows] = sums, np.maximum(weights, 1e-30)
