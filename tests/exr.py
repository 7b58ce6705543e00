"""Pictures of tests: reading and writing them by Mitsuba, which is loaded when the first one is."""

import numpy as np


def library():
    from renderers.mitsuba import bitmaps

    return bitmaps.library()


def layers(path):
    """Channels of a picture by name, (H, W) each."""
    bitmap = library().Bitmap(str(path))
    values = np.array(bitmap)
    return {part.name: values[..., i] for i, part in enumerate(bitmap.struct_())}
