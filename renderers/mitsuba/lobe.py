"""The strip below a preview: what the medium is, in numbers, and its phase function."""

from __future__ import annotations

import numpy as np

from renderers import colour

_BACKGROUND, _TEXT, _DIM, _GRID = "#15171b", "#e8e8e6", "#9a9da3", "#33373e"


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
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height = round(0.27 * width)
    times = -(-320 // width)  # letters have a least size: small strips are drawn large and shrunk
    figure = Figure(figsize=(6.4, 6.4 * height / width), dpi=times * width / 6.4, facecolor=_BACKGROUND)
    canvas = FigureCanvasAgg(figure)
    _text(figure, asset, words)
    colours = _line_colours(asset.wavelength)
    theta = 2 * np.arcsin(np.sqrt(tables.s))
    _polar(figure, theta, tables.value, colours)
    _plot(figure, theta, tables.value, colours)
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
    bottom = np.floor(np.log10(max(value[:, theta > 0.01].min(), 1e-6 * isotropic)))
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


def _plot(figure, theta, value, colours):
    axes = figure.add_axes((0.725, 0.22, 0.255, 0.68), facecolor=_BACKGROUND)
    for row, tint in zip(value, colours):
        axes.semilogy(np.degrees(theta), np.maximum(row, 1e-300), color=tint, lw=0.8)
    axes.axhline(1 / (4 * np.pi), color=_DIM, lw=0.5, ls=":")
    low, high = value.min(), value.max()
    axes.set(xlim=(0, 180), ylim=(max(low, 1e-10 * high) / 1.6, high * 1.6), xticks=(0, 45, 90, 135, 180))
    axes.set_xlabel("scattering angle (degrees)", color=_DIM, fontsize=5.6, labelpad=1)
    axes.set_ylabel("phase function (1/sr)", color=_DIM, fontsize=5.6, labelpad=1)
    axes.tick_params(colors=_DIM, labelsize=5.4, width=0.4, length=2, pad=1.5, which="both")
    axes.minorticks_off()
    axes.grid(color=_GRID, lw=0.4)
    for spine in axes.spines.values():
        spine.set_color(_GRID)
