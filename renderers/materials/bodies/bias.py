"""How far pictures of bodies are off, as their passes measure it."""

import numpy as np

from renderers import colour
from renderers.pictures.means import tiled

# layers: what sharing over half the distance changes, by passes of even and of odd number; what beams of lights without extent
# do that are half as wide; and beams and points of method `beams`, by such passes, too
CLOSER, SHARPER = ("closer_even", "closer_odd"), "sharper"
TURNS = "sharper_even", "sharper_odd"
_LIKELY = 1.64  # standard errors, which 19 of 20 stay below


def of_picture(means, rgb, missing) -> float | None:
    """Error of sharing between pixels and of spreading beams and points, relative to the picture's mean: root mean square of what
    half the distance changes, and a third more, as spreading goes with the square of the distance (sharing with its third power
    or so).  Its own noise counts, but for what `of_turns` knows of it, so it is an upper bound.  To that comes light that is left
    out.  None where there is neither.

    means : of passes, of each part (`renderers.pictures.progressive.Mean`);  rgb : (H, W, 3), the picture
    missing : (3,) linear sRGB, what the light that is left out would add to the mean
    """
    changes = [mean.layers[SHARPER] for mean in means if SHARPER in mean.layers]
    bright = float((rgb @ colour.LUMINANCE).mean())
    if not bright > 0:
        return None
    square = sum(np.mean((change @ colour.LUMINANCE) ** 2) for change in changes)
    square += sum(of_turns(mean, turns) for mean in means for turns in (CLOSER, TURNS) if mean.layers.keys() & set(turns))
    # where no pixels share, nothing is known of the error
    return (4 / 3 * float(np.sqrt(square)) + float(missing @ colour.LUMINANCE)) / bright or None


def of_turns(mean, turns=TURNS) -> float:
    """Mean square, at most, of what half the width of beams and points changes, or half the distance of sharing.

    Passes of even and of odd number have independent noise, so their product has none in the mean; its own error is known from
    tiles of the picture, and counts.  Of a single pass the noise cannot be told from it, and counts whole.
    """
    turns, odd = [mean.layers[name].astype(float) @ colour.LUMINANCE for name in turns if name in mean.layers], mean.count // 2
    if len(turns) < 2:
        return float(np.mean(turns[0] ** 2))
    # a layer that a pass lacks is black in it
    product = turns[0] * turns[1] * mean.count**2 / (odd * (mean.count - odd))
    tiles = tiled(product)
    error = tiles.std(ddof=1) / np.sqrt(tiles.size) if tiles.size > 1 else abs(product).mean()
    return max(float(product.mean() + _LIKELY * error), 0.0)
