"""The strip below a preview: what the medium is, in numbers, and its phase function."""

from __future__ import annotations

import numpy as np

from renderers import colour

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
    display : (H, width, 3) 0 to 1, sRGB encoded; H is 0.27 of the width
    """
    def paint(figure):
        _text(figure, asset, words)
        colours = _line_colours(asset.wavelength)
        first = int(straight(asset) > 0)  # the peak of unchanged light would press everything else against the axis
        theta, value = 2 * np.arcsin(np.sqrt(tables.s[first:])), tables.value[:, first:]
        _polar(figure, theta, value, colours)
        _plot(figure, (0.725, 0.22, 0.255, 0.68), theta, value, colours)

    return _drawn(width, paint)


def grain_strip(asset, grains, width, words=()):
    """Draws the strip of exemplar grains: their statistics and phase functions.

    Parameters
    ----------
    asset : opened asset with `grains`
    grains : of `renderers.mitsuba.grains`, in the order of the rows
    width, words : as in `strip`

    Returns
    -------
    display : as `strip`
    """
    k_middle = middle(asset)
    theta = np.asarray(asset.grains["theta"], float)

    def paint(figure):
        figure.text(0.025, 0.90, "grains", color=_TEXT, fontsize=11, weight="bold", va="top")
        shown, colours = _spread(len(asset.wavelength), 3), _line_colours(asset.wavelength)
        lefts = (0.025, 0.190, 0.250, 0.315, 0.395, 0.475, 0.560, 0.612, 0.685)
        figure.text(lefts[3], 0.815, "albedo at", color=_DIM, fontsize=6.0, va="top")
        heads = ["", "share", "hits", *[f"{asset.wavelength[k]:.3f} um" for k in shown], *[""] * (3 - len(shown)), "g", "way",
                 "straight"]
        for left, word in zip(lefts, heads):
            figure.text(left, 0.725, word, color=_DIM, fontsize=6.0, va="top")
        for line, grain in enumerate(grains):
            part, y = asset.grains[grain.name], 0.725 - 0.092 * (line + 1)
            tint = _GRAINS[line % len(_GRAINS)]
            figure.text(0.025, y, grain.name.replace("_", " ")[:18], color=tint, fontsize=6.4, va="top", parse_math=False)
            row = [f"{100 * grain.share:.3g} %", _at(part, "hit_probability", 0, ".3f"), *["" for _ in range(3)],
                   _at(part, "g", k_middle, ".3f"), _at(part, "lambda_s", k_middle, ".2f", " R"), _unchanged(part, k_middle)]
            tints = [_TEXT] * len(row)
            for i, k in enumerate(shown):
                row[2 + i], tints[2 + i] = _close(float(np.ravel(part["albedo"])[k])) if "albedo" in part else "", colours[k]
            for left, word, one in zip(lefts[1:], row, tints):
                figure.text(left, y, word, color=one, fontsize=6.2, va="top")
        for line, word in enumerate(reversed(words)):
            figure.text(0.025, 0.06 + 0.075 * line, word, color=_DIM, fontsize=5.4, va="bottom", parse_math=False)
        rows = [np.atleast_2d(asset.grains[grain.name]["phase"])[k_middle] for grain in grains]
        _plot(figure, (0.800, 0.22, 0.190, 0.68), theta, np.array(rows), _GRAINS)

    return _drawn(width, paint)


def straight(asset) -> float:
    """Largest share of light that packed grains leave unchanged, which stands in the medium's table as a peak at angle 0."""
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
    return "1" if value == 1 else f"{value:.{6 if value > 0.9995 else 4}f}"


def _unchanged(part, k):
    share = float(np.ravel(part["forward_delta"])[k]) if "forward_delta" in part else 0.0
    return f"{100 * share:.3g} %" if share > 0 else "none"


def _drawn(width, paint):
    """A strip as an array (0.27 width, width, 3), painted on a dark figure 6.4 inches wide."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height = round(0.27 * width)
    times = -(-320 // width)  # letters have a least size: small strips are drawn large and shrunk
    figure = Figure(figsize=(6.4, 6.4 * height / width), dpi=times * width / 6.4, facecolor=_BACKGROUND)
    canvas = FigureCanvasAgg(figure)
    paint(figure)
    canvas.draw()
    drawn = np.asarray(canvas.buffer_rgba())[..., :3] / 255.0
    # Matplotlib may round the size down by a pixel.
    missing = [(0, max(0, times * size - drawn_size)) for size, drawn_size in zip((height, width), drawn.shape)]
    drawn = np.pad(drawn, [*missing, (0, 0)], mode="edge")
    return drawn[:times * height, :times * width].reshape(height, times, width, times, 3).mean(axis=(1, 3))


def _line_colours(wavelength):
    """Each wavelength's own hue, made bright enough for the dark ground."""
    if len(wavelength) == 1:
        return np.array([[0.9, 0.9, 0.88]])
    hue = colour.srgb_matrix(wavelength).T if colour.rgb_order(wavelength) is not None else colour.hue(wavelength)
    hue = hue / np.maximum(hue.max(axis=1, keepdims=True), 1e-9)
    return 0.25 + 0.75 * colour.encode(0.08 + 0.92 * hue)


def _text(figure, asset, words):
    medium = asset.medium
    name = str(getattr(asset, "name", "medium")).replace("_", " ")
    figure.text(0.025, 0.90, name, color=_TEXT, fontsize=11, weight="bold", va="top", parse_math=False)
    shown = _spread(len(asset.wavelength), 4)
    colours = _line_colours(asset.wavelength)
    rows = [("um", "albedo", "g", "mean free path")]
    for k in shown:
        path = length(1 / medium.sigma_t[k]) if medium.sigma_t[k] > 0 else "none"
        rows.append((f"{asset.wavelength[k]:.3f}", _albedo(medium.albedo[k]), f"{medium.g[k]:.3f}", path))
    for line, row in enumerate(rows):
        tint = _DIM if line == 0 else colours[shown[line - 1]]
        for left, word in zip((0.025, 0.095, 0.205, 0.275), row):
            figure.text(left, 0.725 - 0.098 * line, word, color=tint, fontsize=6.6, va="top")
    for line, word in enumerate(reversed(words)):
        figure.text(0.025, 0.06 + 0.085 * line, word, color=_DIM, fontsize=5.6, va="bottom")


def _albedo(value):
    return "1" if value == 1 else f"1 - {1 - value:.1e}" if value > 0.9995 else f"{value:.4f}"


def _spread(count, most):
    return list(range(count)) if count <= most else sorted({round(k * (count - 1) / (most - 1)) for k in range(most)})


def _polar(figure, theta, value, colours):
    """The lobe as a figure of revolution: radius grows with the logarithm, a decade a ring."""
    axes = figure.add_axes((0.43, 0.06, 0.22, 0.88), facecolor=_BACKGROUND)
    isotropic = 1 / (4 * np.pi)
    sides = value[:, theta > 0.01]
    bottom = np.floor(np.log10(max(sides[sides > 0].min(), 1e-6 * isotropic)))
    top = max(np.ceil(np.log10(value.max())), bottom + 2)
    ring = np.linspace(0, 2 * np.pi, 200)
    for decade in np.arange(bottom + 1, top + 1):
        radius = (decade - bottom) / (top - bottom)
        axes.plot(radius * np.cos(ring), radius * np.sin(ring), color=_GRID, lw=0.4)
    for row, tint in zip(value, colours):
        radius = np.maximum(np.log10(np.maximum(row, 1e-300)) - bottom, 0.0) / (top - bottom)
        x, y = radius * np.cos(theta), radius * np.sin(theta)
        axes.fill(np.r_[x, x[::-1]], np.r_[y, -y[::-1]], facecolor=tint, alpha=0.10, lw=0)
        axes.plot(np.r_[x, x[::-1]], np.r_[y, -y[::-1]], color=tint, lw=0.8)
    axes.annotate("", (-0.06, 0), (-0.5, 0), arrowprops={"arrowstyle": "->", "color": _TEXT, "lw": 0.7})
    axes.plot([0], [0], ".", color=_TEXT, ms=2)
    axes.text(1.02, -1.02, "a decade a ring", color=_DIM, fontsize=5.0, ha="right", va="bottom")
    axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    axes.axis("off")


def _plot(figure, place, theta, value, colours):
    axes = figure.add_axes(place, facecolor=_BACKGROUND)
    for row, tint in zip(value, colours):
        axes.semilogy(np.degrees(theta), np.maximum(row, 1e-300), color=tint, lw=0.8)
    axes.axhline(1 / (4 * np.pi), color=_DIM, lw=0.5, ls=":")
    low, high = value[value > 0].min(), value.max()
    axes.set(xlim=(0, 180), ylim=(max(low, 1e-10 * high) / 1.6, high * 1.6), xticks=(0, 45, 90, 135, 180))
    axes.set_xlabel("scattering angle (degrees)", color=_DIM, fontsize=5.6, labelpad=1)
    axes.set_ylabel("phase function (1/sr)", color=_DIM, fontsize=5.6, labelpad=1)
    axes.tick_params(colors=_DIM, labelsize=5.4, width=0.4, length=2, pad=1.5, which="both")
    axes.minorticks_off()
    axes.grid(color=_GRID, lw=0.4)
    for spine in axes.spines.values():
        spine.set_color(_GRID)
