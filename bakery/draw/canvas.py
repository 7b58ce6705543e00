"""A figure as PNG and SVG in one pass over what it holds: two passes of matplotlib's would each do all work but the writing.

Agg measures and draws; what it is told to draw is told to the writer of SVG too, in the same pixels.
"""

from __future__ import annotations

import base64
import io
import struct
import zlib
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

_BOTH = ("open_group", "close_group", "draw_path", "draw_markers", "draw_path_collection", "draw_quad_mesh", "draw_image",
         "draw_text")
_POINT = 1 / 72  # inch
_NO_DATE = {"Date": None, "Creator": None}
_QUICK = 1  # zlib's level: the others win a tenth of the bytes for twice the time or more
_RGB, _RGBA, _UP = 2, 6, 2  # of a PNG: what pixels hold, and the filter that writes differences to the row above


class Canvas(FigureCanvasAgg):
    """Canvas of a figure that is drawn once."""

    def __init__(self, figure: Figure, forms: Sequence[str]):
        super().__init__(figure)
        figure.set_dpi(matplotlib.rcParams["savefig.dpi"])
        self._drawing = RendererAgg(*figure.bbox.size, figure.dpi)  # text is measured once for each renderer
        self._svg = _Svg(self._drawing) if "svg" in forms else None

    def get_renderer(self) -> RendererAgg:
        """What the layout measures with, and what `draw` draws with."""
        return self._drawing

    def drawn(self) -> dict[str, bytes]:
        """The figure in each form."""
        self.figure.draw(self._drawing)
        files = {"png": _png(np.asarray(self._drawing.buffer_rgba())[..., :3], self.figure.dpi)}
        return files | {"svg": self._svg.text()} if self._svg else files


class _Svg(RendererSVG):
    """SVG in the pixels of another renderer, which passes on what it is told to draw."""

    def __init__(self, source: RendererAgg):
        self._scale = _POINT * source.dpi  # pixels a point
        self._file = io.StringIO()
        super().__init__(source.width, source.height, self._file, metadata=_NO_DATE)
        for name in _BOTH:
            setattr(source, name, _twice(getattr(source, name), getattr(self, name)))

    def draw_text(self, gc, x, y, s, prop, angle, ismath=False, mtext=None):
        prop = prop.copy()
        prop.set_size(prop.get_size_in_points() * self._scale)
        super().draw_text(gc, x, y, s, prop, angle, ismath, mtext)

    def draw_path(self, gc, path, transform, rgbFace=None):
        super().draw_path(self._scaled(gc), path, transform, rgbFace)

    def draw_markers(self, gc, *args, **kwargs):
        super().draw_markers(self._scaled(gc), *args, **kwargs)

    draw_path_collection = RendererBase.draw_path_collection  # path by path

    def _scaled(self, gc):
        """The context of a line with its width and dashes, which are points, in pixels."""
        scaled, (offset, lengths) = self.new_gc(), gc.get_dashes()
        scaled.copy_properties(gc)
        scaled.set_linewidth(self._scale * gc.get_linewidth())
        if lengths is not None:
            scaled.set_dashes(self._scale * offset, [self._scale * length for length in lengths])
        return scaled

    def draw_image(self, gc, x, y, im, transform=None):
        href = "data:image/png;base64," + base64.b64encode(_png(im[::-1])).decode()
        self.writer.element("image", x=f"{x:g}", y=f"{self.height - y - im.shape[0]:g}", width=f"{im.shape[1]}",
                            height=f"{im.shape[0]}", attrib={"xlink:href": href})

    def points_to_pixels(self, points):
        return points * self._scale

    def text(self) -> bytes:
        """The document, as large on paper as the figure."""
        self.finalize()
        size = 'width="{:g}pt" height="{:g}pt"'
        inner, outer = size.format(self.width, self.height), size.format(self.width / self._scale, self.height / self._scale)
        return self._file.getvalue().replace(inner, outer, 1).encode()


def measure_once(axes) -> None:
    """Has what stands outside of axes (ticks, labels, titles) measured in the first of the two passes of a layout only."""
    for spine in axes.spines.values():
        spine.set_in_layout(False)  # as far out as the ticks, and measured with all of them anew
    if axes.get_aspect() != "auto":
        return  # such axes do not fill their place
    measured, outside = axes.get_tightbbox, []

    def tight(*args, **kwargs):
        if not outside:
            outside.append(measured(*args, **kwargs).extents - axes.bbox.extents)
        return Bbox.from_extents(*(axes.bbox.extents + outside[0]))

    axes.get_tightbbox = tight


def _twice(first, second):
    def both(*args, **kwargs):
        first(*args, **kwargs)
        second(*args, **kwargs)
    return both


def _png(pixels, dpi: float = 72.0) -> bytes:
    """Pixels (H, W, 3 or 4) uint8 as PNG (ISO 15948).  PIL, which tries five filters a row, takes twice as long."""
    height, width, channels = pixels.shape
    rows = pixels.reshape(height, width * channels)
    filtered = np.empty((height, 1 + rows.shape[1]), np.uint8)
    filtered[:, 0] = _UP
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    a_meter = round(dpi / 0.0254)
    head = struct.pack(">IIBBBBB", width, height, 8, _RGB if channels == 3 else _RGBA, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"pHYs", struct.pack(">IIB", a_meter, a_meter, 1)), (b"IDAT", zlib.compress(filtered, _QUICK)),
              (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
                                           for kind, data in chunks)
