"""Picture files, which Mitsuba reads and writes for all renderers."""

import drjit as dr
import mitsuba as mi
import numpy as np

from bakery.errors import UsageError
from bakery.store.put import put_all
from renderers.pictures import images


def library():
    """Mitsuba in the variant that is set, or in some variant: without one it has no bitmaps."""
    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    if dr.thread_count() < 2:
        dr.set_thread_count(2)  # with one, as on a machine of one core, reading and writing EXR files never ends (3.9.1)
    return mi


def write(pair, display, linear, text=None):
    """Writes a picture as PNG and as EXR of 32 bits, both whole or neither.

    pair : paths (PNG, EXR) of `images.output_pair`
    display : (H, W, 3) display values, 0 to 1
    linear : (H, W, 3) linear sRGB, or a dict of (H, W) by name of the channel
    text : dict of str by name, kept in both files, or None

    Raises StoreError, UsageError: the files cannot be written; what stood there before stands there still.
    """
    mi = library()
    if isinstance(linear, dict):
        height, width = display.shape[:2]
        full = mi.Bitmap(mi.Bitmap.PixelFormat.MultiChannel, mi.Struct.Type.Float32, [width, height], len(linear), list(linear))
        pixels = np.asarray(full)  # the bitmap's own memory
        for i, layer in enumerate(linear.values()):
            pixels[..., i] = layer
    else:
        full = mi.Bitmap(linear.astype(np.float32))
    files, kinds = {}, mi.Bitmap.FileFormat
    for path, bitmap, kind in zip(pair, (mi.Bitmap(images.eight_bits(display)), full), (kinds.PNG, kinds.OpenEXR)):
        for name, value in (text or {}).items():
            bitmap.metadata()[name] = value
        stream = mi.MemoryStream()
        bitmap.write(stream, kind)
        files[path] = stream.raw_buffer()
    put_all(files)


def opened(path):
    """The picture in a file, as Mitsuba has it; UsageError where that is none."""
    try:
        return library().Bitmap(str(path))
    except (RuntimeError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read as a picture ({' '.join(str(error).split())})") from None


def channels_of(bitmap):
    """Channels (H, W) of Mitsuba's picture by name."""
    values = np.array(bitmap)
    values = values[..., None] if values.ndim == 2 else values
    return {part.name: values[..., i] for i, part in enumerate(bitmap.struct_())}


def read(path):
    """Channels (H, W) of a picture by name, and its attributes by name; UsageError where the file is no picture."""
    bitmap = opened(path)
    return channels_of(bitmap), dict(bitmap.metadata())
