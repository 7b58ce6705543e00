"""How far pictures of bodies are off, as their passes measure it."""

from __future__ import annotations

import numpy as np

from renderers import colour

# layers: what sharing over half the distance changes, and beams of lights without extent that are half as wide
CLOSER, SHARPER = "closer", "sharper"


def of_picture(means, rgb, missing) -> float | None:
    """Error of sharing between pixels and of spreading beams that `chains` follows, relative to the picture's mean: root mean
    square of what half the distance changes, and a third more, as both go with the square of the distance.  Its own noise counts,
    so it is an upper bound.  To that comes light that is left out.  None where there is neither.

    means : of passes, of each part (`renderers.pictures.progressive.Mean`);  rgb : (H, W, 3), the picture
    missing : (3,) linear sRGB, what the light that is left out would add to the mean
    """
    changes = [mean.layers[name] for mean in means for name in (CLOSER, SHARPER) if name in mean.layers]
    bright = float((rgb @ colour.LUMINANCE).mean())
    if not bright > 0:
        return None
    spread = 4 / 3 * float(np.sqrt(sum(np.mean((change @ colour.LUMINANCE) ** 2) for change in changes)))
    # where no pixels share, nothing is known of the error
    return (spread + float(missing @ colour.LUMINANCE)) / bright or None
