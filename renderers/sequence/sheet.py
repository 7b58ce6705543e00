"""A contact sheet: thumbnails of frames with their numbers, in rows."""

import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bakery.store.put import put
from renderers import colour

MOST = 400  # thumbnails; of more frames some are left out, evenly
_SHEET, _WIDE = 2400, 320  # pixels, of the sheet and of a thumbnail, at most
_LEAST = 48  # pixels: smaller pictures are shown larger, by whole numbers
_LABEL, _GAP, _DPI = 16, 6, 100
_SHAPE = 1.5  # of the sheet, width over height
_DARK, _LIGHT = "#202020", "#d0d0d0"


def write(path: Path, pictures: Sequence[Path], numbers: Sequence[int]) -> str:
    """Writes the sheet of PNG pictures of one size; its path.  Raises as `bakery.store.put.put`."""
    positions = np.unique(np.linspace(0, len(pictures) - 1, min(MOST, len(pictures))).round().astype(int))
    first = _display(pictures[positions[0]])
    columns, size = _grid(len(positions), first.shape[:2])
    thumbnails = [_resized(_display(pictures[k]), size) for k in positions]
    return str(put(path, _drawn(thumbnails, [numbers[k] for k in positions], columns)))


def _grid(count: int, size: tuple[int, int]) -> tuple[int, tuple[int, int]]:
    """Columns, and (height, width) of a thumbnail."""
    height, width = size
    columns = min(count, math.ceil(math.sqrt(count * _SHAPE * height / width)))
    across = min(_WIDE, (_SHEET - _GAP) // columns - _GAP, width * max(1, math.ceil(_LEAST / width)))
    return columns, (max(1, round(height * across / width)), across)


def _display(path: Path):
    """(H, W, 3) display values, 0 to 1."""
    from renderers.mitsuba import bitmaps

    channels, _ = bitmaps.read(path)
    return np.stack([channels[name] for name in "RGB"], axis=-1) / 255.0


def _resized(picture, size):
    """A picture of another size: means of linear light where it is smaller, the nearest pixels where it is larger."""
    from PIL import Image

    channels = (Image.fromarray(channel) for channel in np.moveaxis(colour.decode(picture).astype(np.float32), -1, 0))
    return colour.encode(np.stack([channel.resize(size[::-1], Image.Resampling.BOX) for channel in channels], axis=-1))


def _drawn(thumbnails, numbers: Sequence[int], columns: int) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height, width = thumbnails[0].shape[:2]
    rows, across, down = math.ceil(len(numbers) / columns), width + _GAP, height + _LABEL + _GAP
    size = columns * across + _GAP, rows * down + _GAP
    figure = Figure((size[0] / _DPI, size[1] / _DPI), dpi=_DPI, facecolor=_DARK)
    FigureCanvasAgg(figure)
    for position, (picture, number) in enumerate(zip(thumbnails, numbers)):
        x, top = _GAP + position % columns * across, _GAP + position // columns * down
        figure.figimage(picture, x, size[1] - top - height, origin="upper")
        figure.text((x + width / 2) / size[0], 1 - (top + height + _LABEL / 2) / size[1], str(number), color=_LIGHT,
                    fontsize=8, ha="center", va="center")
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_DPI, facecolor=_DARK, metadata={"Software": None})
    return stream.getvalue()
