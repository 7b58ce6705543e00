"""How figures look, and how they become the same bytes on every run."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

# um and sRGB: hues of the spectrum, darkened until they stand out on white; deep reds, which look alike, darken on towards brown.
_SPECTRUM = (
    (0.405, (0.45, 0.13, 0.60)), (0.455, (0.13, 0.30, 0.74)), (0.505, (0.03, 0.58, 0.66)), (0.555, (0.16, 0.57, 0.22)),
    (0.58, (0.72, 0.58, 0.02)), (0.605, (0.88, 0.36, 0.08)), (0.655, (0.76, 0.08, 0.17)), (0.705, (0.48, 0.05, 0.20)),
    (0.755, (0.25, 0.13, 0.10)),
)
_VISIBLE = (0.38, 0.78)  # um
INK, QUIET, FAINT = "#1c2530", "#5d6875", "#dfe3e8"
NEUTRAL = ("#1c2530", "#8a4fbf", "#b3541e")  # curves that belong to no wavelength

_LOOK = {
    "figure.facecolor": "white", "figure.dpi": 100, "savefig.dpi": 128, "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans", "font.size": 9.5, "axes.titlesize": 10.5, "axes.titleweight": "bold",
    "axes.titlelocation": "left", "axes.titlepad": 9,
    "axes.titley": 1.0,  # else matplotlib looks for what may stand in the way, which takes an eighth of a picture
    "axes.labelcolor": INK, "axes.titlecolor": INK, "text.color": INK,
    "axes.edgecolor": QUIET, "axes.linewidth": 0.8, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "grid.color": FAINT, "grid.linewidth": 0.7, "axes.axisbelow": True, "xtick.color": QUIET, "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK, "lines.linewidth": 1.5, "lines.solid_joinstyle": "round", "legend.frameon": False,
    "lines.color": INK,  # else each line, ticks included, looks up the first colour of a cycle
    "legend.fontsize": 9, "path.simplify_threshold": 0.2, "svg.fonttype": "path",
}


def colours(wavelength) -> list[tuple[float, float, float]]:
    """One colour a wavelength (um), close to what the eye sees of it; outside the visible, hues by position in the list."""
    wavelength = np.asarray(wavelength, float)
    at = np.array([um for um, _ in _SPECTRUM])
    rgb = np.array([colour for _, colour in _SPECTRUM])
    inside = (wavelength >= _VISIBLE[0]) & (wavelength <= _VISIBLE[1])
    if not inside.all() and wavelength.size > 1:
        low, high = np.log(wavelength.min()), np.log(wavelength.max())
        wavelength = at[0] + np.ptp(at) * (np.log(wavelength) - low) / max(high - low, 1e-9)
    return [tuple(float(np.interp(um, at, rgb[:, i])) for i in range(3)) for um in wavelength]


@contextmanager
def look(name: str) -> Iterator[None]:
    """Settings under which a figure is made and saved; independent of the user's own, ids of the SVG derived from `name`."""
    from matplotlib import style

    with style.context(["default", _LOOK, {"svg.hashsalt": name}]):
        yield


def saved(figure, forms: Sequence[str]) -> dict[str, bytes]:
    """The figure as `png`, `svg` or both without date and version; letters of an SVG are outlines, so it needs no fonts."""
    import io

    from bakery.draw.ticks import thin_out

    thin_out(figure)
    files = {}
    for form in forms:
        out = io.BytesIO()
        figure.savefig(out, format=form, metadata={"svg": {"Date": None, "Creator": None}, "png": {"Software": None}}[form])
        figure.set_layout_engine("none")  # both forms have the layout of the first
        files[form] = out.getvalue()
    return files
