"""The strip below a preview: what the medium is, in numbers, and its phase function."""

import textwrap

import numpy as np

from renderers import colour

_LETTER, _LINE, _LINES = 11.0, 14.5, 11.5  # pixels: size of letters, distance of lines; lines above the curves
_SMALLEST, _FULL = 320, 576  # pixels of width: narrower strips are drawn larger and shrunk; wider ones have larger letters
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
    """The strip of a medium: (H, width, 3) 0 to 1, sRGB encoded; H depends on the width only.

    asset : opened asset, or anything with `wavelength` and `medium`;  tables : `Tables` of the same
    width : pixels;  words : lines for the foot
    """
    medium, colours = asset.medium, _line_colours(asset.wavelength)
    rows = [("um", "albedo", "g", "mean free path")]
    rows += [(f"{asset.wavelength[k]:.3f}", _albedo(medium.albedo[k]), f"{medium.g[k]:.3f}",
              length(1 / medium.sigma_t[k]) if medium.sigma_t[k] > 0 else "none") for k in _spread(len(asset.wavelength), 4)]
    first = int(forward_delta(asset) > 0)  # the peak of unscattered light would press everything else against the axis
    theta, value = 2 * np.arcsin(np.sqrt(tables.s[first:])), tables.value[:, first:]
    shown = [_DIM, *(colours[k] for k in _spread(len(asset.wavelength), 4))]

    return _drawn(width, str(getattr(asset, "name", "medium")), zip(rows, shown, strict=True), words,
                  lambda *area: _polar(*area, theta, value, colours))


def grain_strip(asset, grains, width, words=()):
    """The strip of exemplar grains, as `strip`: their statistics and phase functions.

    asset : opened asset with `grains`;  grains : of `renderers.preview.grains`, in the order of the rows
    """
    k_middle, narrow = middle(asset), width < _FULL  # fewer columns
    shown = _spread(len(asset.wavelength), 1 if narrow else 3, k_middle)
    rows = [["", "share", "hits", *(f"{asset.wavelength[k]:.3f}" for k in shown), "g", "path", "delta"]]
    for grain in grains:
        part = asset.grains[grain.name]
        rows.append([grain.name.replace("_", " ")[:8 if narrow else 14], f"{100 * grain.share:.3g} %",
                     _at(part, "hit_probability", 0, ".3f"),
                     *(_close(float(np.ravel(part["albedo"])[k])) if "albedo" in part else "" for k in shown),
                     _at(part, "g", k_middle, ".3f"), _at(part, "lambda_s", k_middle, ".2f", " R"), _delta(part, k_middle)])
    rows = [row[:1] + row[2:] if narrow else row for row in rows]
    inks = [_DIM, *(_GRAINS[line % len(_GRAINS)] for line in range(len(grains)))]
    theta = np.asarray(asset.grains["theta"], float)
    value = np.array([np.atleast_2d(asset.grains[grain.name]["phase"])[k_middle] for grain in grains])
    return _drawn(width, "grains (albedo at a wavelength in um)", zip(rows, inks, strict=True), words,
                  lambda *area: _plot(*area, theta, value, _GRAINS))


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


def _albedo(value):
    return "1" if value == 1 else f"1 - {1 - value:.1e}" if value > 0.9995 else f"{value:.4f}"


def _spread(count, most, only=0):
    """Which of `count` wavelengths are shown; `only` one of them where there is room for no more."""
    if most == 1:
        return [only]
    return list(range(count)) if count <= most else sorted({round(k * (count - 1) / (most - 1)) for k in range(most)})


def _line_colours(wavelength):
    """Each wavelength's own hue, made bright enough for the dark ground."""
    if len(wavelength) == 1:
        return np.array([[0.9, 0.9, 0.88]])
    hue = colour.srgb_matrix(wavelength).T if colour.rgb_order(wavelength) is not None else colour.hue(wavelength)
    hue = hue / np.maximum(hue.max(axis=1, keepdims=True), 1e-9)
    return 0.25 + 0.75 * colour.encode(0.08 + 0.92 * hue)


def _drawn(width, title, rows, words, curves):
    """The strip as an array (H, width, 3).

    rows : (cells, colour) of a table below the title
    words : lines below the table, each as many as it needs
    curves : draws below, takes the figure, the upper right corner of that room, and margins for labels left and below
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    times = -(-_SMALLEST // width)
    across, scale = times * width, max(1.0, times * width / _FULL)
    high = round((_LINES * _LINE * scale + max(_CURVES * across, _LEAST)) / times) * times
    with rc_context({"font.size": 0.72 * _LETTER * scale, "figure.facecolor": _BACKGROUND, "axes.facecolor": _BACKGROUND,
                     "text.color": _DIM, "axes.labelcolor": _DIM, "xtick.color": _DIM, "ytick.color": _DIM,
                     "axes.edgecolor": _GRID, "grid.color": _GRID, "grid.linewidth": 0.4, "lines.linewidth": 0.8 * scale}):
        figure = _page(across, high, scale, title, rows, words)
        curves(figure, (0.965, 1 - (_LINES * _LINE * scale + 4) / high), (44 * scale / across, 30 * scale / high))
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    # the canvas may be rounded down by a pixel
    drawn = np.pad(np.asarray(canvas.buffer_rgba())[..., :3] / 255.0, [(0, 1), (0, 1), (0, 0)], mode="edge")[:high, :across]
    return drawn.reshape(high // times, times, width, times, 3).mean(axis=(1, 3))


def _page(across, high, scale, title, rows, words):
    """A figure with the text at its top, in pixels of 1/100 inch."""
    from matplotlib.figure import Figure

    figure = Figure((across / 100, high / 100), dpi=100)
    cells, inks = zip(*rows, strict=True)
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [(title.replace("_", " "), {"color": _TEXT, "weight": "bold"})]
    lines += [((" " * (1 + (across >= _FULL))).join(map(str.ljust, row, widths)), {"color": ink, "family": "monospace"})
              for row, ink in zip(cells, inks, strict=True)]
    letters = int(0.95 * across / (0.57 * _LETTER * scale))
    foot = [(line, {}) for word in words for line in textwrap.wrap(word, letters)]
    for number, (line, style) in enumerate(lines + foot):
        figure.text(0.025, 1 - (number + 0.9) * _LINE * scale / high, line, va="center", parse_math=False, **style)
    return figure


def _polar(figure, corner, margins, theta, value, colours):
    """The lobe as a figure of revolution, its radius a decade a ring, and beside it the curves over the angle."""
    axes = figure.add_axes((0.02, 0.04, 0.36, corner[1] - 0.04), projection="polar")
    sides = value[:, theta > 0.01]
    bottom = np.floor(np.log10(max(sides[sides > 0].min(), 1e-6 / (4 * np.pi))))
    top = max(np.ceil(np.log10(value.max())), bottom + 2)
    # a table of few angles, such as the two of an isotropic medium, is linear between them in the cosine: arcs, not chords
    every = np.union1d(theta, np.radians(np.arange(np.ceil(np.degrees(theta[0])), 180)))
    for row, ink in zip(value, colours):
        decades = np.log10(np.maximum(np.interp(-np.cos(every), -np.cos(theta), row), 1e-300)).clip(bottom)
        axes.fill(np.r_[every, -every[::-1]], np.r_[decades, decades[::-1]], facecolor=(*ink, 0.1), edgecolor=ink)
    axes.set(ylim=(bottom, top), yticks=np.arange(bottom, top + 1), yticklabels=[], xticks=[])
    axes.annotate("", (np.pi, bottom), (np.pi, 0.5 * (bottom + top)), arrowprops={"arrowstyle": "->", "color": _TEXT, "lw": 0.7})
    figure.text(0.02, 0.04, "a decade\na ring")
    _plot(figure, corner, (0.42 + margins[0], margins[1]), theta, value, colours)


def _plot(figure, corner, margins, theta, value, colours):
    """Phase functions (1/sr) over the angle."""
    from matplotlib.ticker import LogLocator

    axes = figure.add_axes((*margins, corner[0] - margins[0], corner[1] - margins[1]))
    for row, ink in zip(value, colours):
        axes.semilogy(np.degrees(theta), np.maximum(row, 1e-300), color=ink)
    axes.axhline(1 / (4 * np.pi), color=_DIM, ls=":")
    low, high = value[value > 0].min(), value.max()
    axes.set(xlim=(0, 180), ylim=(max(low, 1e-10 * high) / 1.6, high * 1.6), xticks=(0, 45, 90, 135, 180), ylabel="1/sr",
             xlabel="scattering angle (degrees)")
    axes.xaxis.labelpad = axes.yaxis.labelpad = 1
    axes.tick_params(length=2, pad=1.5, which="both")
    axes.yaxis.set_major_locator(LogLocator(numticks=4))  # letters are large for the little room
    axes.minorticks_off()
    axes.grid()
