"""The strip below a preview: what the medium is, in numbers, and its phase function."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np

from renderers import colour

_LETTER, _LINE = 11.0, 14.5  # pixels: size of letters and distance of lines, the least that is legible; wide strips scale them up
_SMALLEST, _FULL = 320, 576  # pixels of width: of the least strip with letters of that size, and from which on they scale
_LINES = 11.5  # above the curves
_CURVES, _LEAST = 0.24, 115  # height of the curves in widths, and the least in pixels
_BACKGROUND, _TEXT, _DIM, _GRID = "#15171b", "#e8e8e6", "#9a9da3", "#33373e"
_GRAINS = ("#f0c05a", "#6cc3f0", "#f08a7a", "#8fd694", "#c9a2f2", "#e0dfd5")  # one a component


def length(metres) -> str:
    """Three figures with the unit that fits: 34.4 m, 0.75 mm, 40900 km."""
    if metres >= 999.5e3:
        return f"{float(f'{metres / 1e3:.3g}'):.0f} km"
    for unit, size in (("km", 1e3), ("m", 1.0), ("mm", 1e-3), ("um", 1e-6)):
        if metres >= 0.9995 * size:
            return f"{metres / size:.3g} {unit}"
    return f"{metres / 1e-9:.3g} nm"


def strip(asset, tables, width, words=()):
    """Draws the strip.

    Parameters
    ----------
    asset : opened asset, or anything with `wavelength` and `medium`
    tables : Tables of the same asset
    width : pixels
    words : lines for the foot of the text

    Returns
    -------
    display : (H, width, 3) 0 to 1, sRGB encoded; H depends on the width only
    """
    def paint(page):
        _text(page, asset, words)
        colours = _line_colours(asset.wavelength)
        first = int(forward_delta(asset) > 0)  # the peak of unscattered light would press everything else against the axis
        theta, value = 2 * np.arcsin(np.sqrt(tables.s[first:])), tables.value[:, first:]
        _polar(page, theta, value, colours)
        _plot(page, 0.52, theta, value, colours)

    return _drawn(width, paint)


def grain_strip(asset, grains, width, words=()):
    """Draws the strip of exemplar grains: their statistics and phase functions.

    Parameters
    ----------
    asset : opened asset with `grains`
    grains : of `renderers.preview.grains`, in the order of the rows
    width, words : as in `strip`

    Returns
    -------
    display : as `strip`
    """
    k_middle = middle(asset)
    theta = np.asarray(asset.grains["theta"], float)

    def paint(page):
        page.text(0.025, 0, "grains", _TEXT, bold=True)
        narrow = page.width < _FULL  # fewer columns
        shown, colours = _spread(len(asset.wavelength), 1 if narrow else 3, k_middle), _line_colours(asset.wavelength)
        page.text(0.45, 0, "albedo at", _DIM)
        heads = ["share", "hits", *[f"{asset.wavelength[k]:.3f}" for k in shown], "g", "path", "delta"][narrow:]
        lefts = np.linspace(0.22, 0.83 if narrow else 0.88, len(heads))
        for x, word in zip(lefts, heads):
            page.text(x, 1, word, _DIM)
        for line, grain in enumerate(grains):
            part, tint = asset.grains[grain.name], _GRAINS[line % len(_GRAINS)]
            page.text(0.025, 2 + line, grain.name.replace("_", " ")[:round(0.19 * page.width / (0.6 * page.letter))], tint)
            row = [(f"{100 * grain.share:.3g} %", _TEXT), (_at(part, "hit_probability", 0, ".3f"), _TEXT)]
            row += [(_close(float(np.ravel(part["albedo"])[k])) if "albedo" in part else "", colours[k]) for k in shown]
            row += [(word, _TEXT) for word in (_at(part, "g", k_middle, ".3f"), _at(part, "lambda_s", k_middle, ".2f", " R"),
                                               _delta(part, k_middle))]
            for x, (word, strip) in zip(lefts, row[narrow:]):
                page.text(x, 2 + line, word, strip)
        page.foot(words)
        rows = [np.atleast_2d(asset.grains[grain.name]["phase"])[k_middle] for grain in grains]
        _plot(page, 0.13, theta, np.array(rows), _GRAINS)

    return _drawn(width, paint)


def forward_delta(asset) -> float:
    """Largest unscattered (delta) share of light in packed grains, which stands in the medium's table as a peak at angle 0."""
    return float(np.max(asset.medium["forward_delta"])) if "forward_delta" in asset.medium else 0.0


def middle(asset) -> int:
    """Position of the wavelength next to 0.55 um."""
    return int(np.argmin(np.abs(np.asarray(asset.wavelength) - 0.55)))


def _at(part, name, k, form, unit=""):
    values = np.ravel(part[name]) if name in part else ()
    if not len(values):
        return ""
    digits = int(form[1])
    return f"{round(float(values[min(k, len(values) - 1)]), digits) + 0.0:{form}}{unit}"  # no -0.00


def _close(value):
    if not 0.9995 < value < 1:
        return "1" if value == 1 else f"{value:.4f}"
    figure, exponent = f"{1 - value:.0e}".split("e")
    return f"1-{figure}e{int(exponent)}"  # no wider than four decimals: columns are narrow


def _delta(part, k):
    share = float(np.ravel(part["forward_delta"])[k]) if "forward_delta" in part else 0.0
    return f"{100 * share:.3g} %" if share > 0 else "none"


@dataclass(frozen=True)
class _Page:
    """An empty strip: lines of text, below them room for curves.  Sizes in pixels, places from left and top."""

    figure: object
    width: int
    height: int

    @property
    def letter(self) -> float:
        return _LETTER * _scale(self.width)

    def text(self, x, line, word, tint, bold=False):
        """One line: `x` as a share of the width, `line` counted from 0."""
        y = (line + 0.9) * _LINE * _scale(self.width)
        self.figure.text(x, 1 - y / self.height, word, color=tint, fontsize=self.points((1.3 if bold else 1) * self.letter),
                         weight="bold" if bold else "normal", va="center", parse_math=False)

    def foot(self, words):
        """The last lines above the curves, each as many as it needs."""
        letters = int(0.95 * self.width / (0.57 * self.letter))
        lines = [line for word in words for line in textwrap.wrap(word, letters)]
        for i, line in enumerate(lines):
            self.text(0.025, _LINES - 0.5 - len(lines) + i, line, _DIM)

    def axes(self, x, width, below=0.0):
        """Axes over the room for curves: `x` and `width` as shares of the width, `below` pixels free."""
        high = _curves(self.width)
        return self.figure.add_axes((x, (below + 4) / self.height, width, (high - below - 10) / self.height),
                                    facecolor=_BACKGROUND)

    def points(self, pixels) -> float:
        return pixels * 6.4 * 72 / self.width


def _scale(width) -> float:
    return max(1.0, width / _FULL)


def _curves(width) -> float:
    return max(_CURVES * width, _LEAST)


def _drawn(width, paint):
    """A strip as an array (H, width, 3), painted on a dark figure 6.4 inches wide."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    times = -(-_SMALLEST // width)  # smaller strips are shrunk: no letter is legible there
    high = round((_LINES * _LINE * _scale(times * width) + _curves(times * width)) / times)
    width, height = times * width, times * high
    figure = Figure(figsize=(6.4, 6.4 * height / width), dpi=width / 6.4, facecolor=_BACKGROUND)
    canvas = FigureCanvasAgg(figure)
    paint(_Page(figure, width, height))
    canvas.draw()
    drawn = np.asarray(canvas.buffer_rgba())[..., :3] / 255.0
    # Matplotlib may round the size down by a pixel.
    missing = [(0, max(0, size - drawn_size)) for size, drawn_size in zip((height, width), drawn.shape)]
    drawn = np.pad(drawn, [*missing, (0, 0)], mode="edge")[:height, :width]
    return drawn.reshape(high, times, width // times, times, 3).mean(axis=(1, 3))


def _line_colours(wavelength):
    """Each wavelength's own hue, made bright enough for the dark ground."""
    if len(wavelength) == 1:
        return np.array([[0.9, 0.9, 0.88]])
    hue = colour.srgb_matrix(wavelength).T if colour.rgb_order(wavelength) is not None else colour.hue(wavelength)
    hue = hue / np.maximum(hue.max(axis=1, keepdims=True), 1e-9)
    return 0.25 + 0.75 * colour.encode(0.08 + 0.92 * hue)


def _text(page, asset, words):
    medium = asset.medium
    page.text(0.025, 0, str(getattr(asset, "name", "medium")).replace("_", " "), _TEXT, bold=True)
    shown = _spread(len(asset.wavelength), 4)
    colours = _line_colours(asset.wavelength)
    rows = [("um", "albedo", "g", "mean free path")]
    for k in shown:
        path = length(1 / medium.sigma_t[k]) if medium.sigma_t[k] > 0 else "none"
        rows.append((f"{asset.wavelength[k]:.3f}", _albedo(medium.albedo[k]), f"{medium.g[k]:.3f}", path))
    for line, row in enumerate(rows):
        tint = _DIM if line == 0 else colours[shown[line - 1]]
        for x, word in zip((0.025, 0.20, 0.48, 0.68), row):
            page.text(x, 1.4 + line, word, tint)
    page.foot(words)


def _albedo(value):
    return "1" if value == 1 else f"1 - {1 - value:.1e}" if value > 0.9995 else f"{value:.4f}"


def _spread(count, most, one=0):
    """Which of `count` wavelengths are shown; `one` of them where there is room for no more."""
    if most == 1:
        return [one]
    return list(range(count)) if count <= most else sorted({round(k * (count - 1) / (most - 1)) for k in range(most)})


def _polar(page, theta, value, colours):
    """The lobe as a figure of revolution: radius grows with the logarithm, a decade a ring."""
    axes = page.axes(0.02, 0.36)
    isotropic = 1 / (4 * np.pi)
    sides = value[:, theta > 0.01]
    bottom = np.floor(np.log10(max(sides[sides > 0].min(), 1e-6 * isotropic)))
    top = max(np.ceil(np.log10(value.max())), bottom + 2)
    ring = np.linspace(0, 2 * np.pi, 200)
    for decade in np.arange(bottom + 1, top + 1):
        radius = (decade - bottom) / (top - bottom)
        axes.plot(radius * np.cos(ring), radius * np.sin(ring), color=_GRID, lw=0.4)
    # a table of few angles, such as the two of an isotropic medium, is linear between them in the cosine: arcs, not chords
    every = np.union1d(theta, np.radians(np.arange(np.ceil(np.degrees(theta[0])), 180)))
    value = np.array([np.interp(-np.cos(every), -np.cos(theta), row) for row in value])
    theta = every
    for row, tint in zip(value, colours):
        radius = np.maximum(np.log10(np.maximum(row, 1e-300)) - bottom, 0.0) / (top - bottom)
        x, y = radius * np.cos(theta), radius * np.sin(theta)
        axes.fill(np.r_[x, x[::-1]], np.r_[y, -y[::-1]], facecolor=tint, alpha=0.10, lw=0)
        axes.plot(np.r_[x, x[::-1]], np.r_[y, -y[::-1]], color=tint, lw=0.8)
    axes.annotate("", (-0.06, 0), (-0.5, 0), arrowprops={"arrowstyle": "->", "color": _TEXT, "lw": 0.7})
    axes.plot([0], [0], ".", color=_TEXT, ms=2)
    axes.text(-1.05, -1.05, "a decade\na ring", color=_DIM, fontsize=page.points(page.letter), va="bottom")
    axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    axes.axis("off")


def _plot(page, x, theta, value, colours):
    """Phase functions (1/sr) over the angle, from `x` to the right edge."""
    size = page.points(page.letter)
    axes = page.axes(x, 0.965 - x, 2.6 * page.letter)
    for row, tint in zip(value, colours):
        axes.semilogy(np.degrees(theta), np.maximum(row, 1e-300), color=tint, lw=page.points(1.3))
    axes.axhline(1 / (4 * np.pi), color=_DIM, lw=page.points(0.8), ls=":")
    low, high = value[value > 0].min(), value.max()
    axes.set(xlim=(0, 180), ylim=(max(low, 1e-10 * high) / 1.6, high * 1.6), xticks=(0, 45, 90, 135, 180))
    axes.set_xlabel("scattering angle (degrees)", color=_DIM, fontsize=size, labelpad=1)
    axes.set_ylabel("1/sr", color=_DIM, fontsize=size, labelpad=1)
    axes.tick_params(colors=_DIM, labelsize=size, width=0.4, length=2, pad=1.5, which="both")
    axes.yaxis.set_major_locator(_few_decades(axes))
    axes.minorticks_off()
    axes.grid(color=_GRID, lw=0.4)
    for spine in axes.spines.values():
        spine.set_color(_GRID)


def _few_decades(axes):
    """At most four ticks: letters are large for the little room."""
    from matplotlib.ticker import LogLocator

    return LogLocator(numticks=4)
