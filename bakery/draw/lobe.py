"""Polar diagrams of scattered light on plain axes: matplotlib's polar ones, with a tick for every circle, take twice as long."""

from collections.abc import Sequence

import numpy as np

from bakery.draw.axes import power
from bakery.draw.style import FAINT, INK, QUIET

INNER = 0.13  # radius of the inner circle; the outer one's is 1
_DECADES_AT = np.radians(112)
_BESIDE = 1.045  # where what stands beside the outer circle begins


def polar(axes, theta, value, limits: tuple[float, float], inks: Sequence, labels: Sequence[str], note: str = "") -> None:
    """Curves around a particle, with their mirror images; light travels to the right, the radius is logarithmic.

    theta : (A,) rad, from 0 (forward, to the right) to pi
    value : (L, A) >= 0; what lies beyond the limits is drawn on them
    limits : log10 of the inner and of the outer circle
    inks, labels : of each curve
    note : what stands beside the outer circle straight on
    """
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    low, high = limits
    axes.set_axis_off()
    axes.set(xlim=(-1.26, 1.26), ylim=(-1.15, 1.15), aspect="equal")
    decades = np.arange(low, high + 1)
    rings = [Path.circle(radius=radius_of(decade, low, high)) for decade in decades]
    degrees = np.arange(0, 360, 45)
    across, up = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    rays = [Path(np.outer((INNER, 1.0), direction)) for direction in zip(across, up, strict=True)]
    axes.add_patch(PathPatch(Path.make_compound_path(*rings, *rays), fill=False, edgecolor=FAINT, linewidth=0.7, zorder=1))
    axes.add_patch(PathPatch(rings[0], fill=False, edgecolor=QUIET, linewidth=0.8, zorder=1.5))
    theta, value = each_degree(theta, value)
    around = np.concatenate([theta, 2 * np.pi - theta[::-1]])
    for row, ink, label in zip(value, inks, labels, strict=True):
        radius = radius_of(np.log10(np.clip(row, 10**low, 10**high)), low, high)
        radius = np.concatenate([radius, radius[::-1]])
        axes.plot(radius * np.cos(around), radius * np.sin(around), color=ink, label=label, linewidth=1.3)

    words = [(_BESIDE * x, _BESIDE * y, f"{min(a, 360 - a)}°", INK, 9.5, ("left", "center", "right")[1 - round(x)],
              ("bottom", "center", "top")[1 - round(y)]) for a, x, y in zip(degrees, across, up, strict=True)]
    for decade in decades:
        radius = radius_of(decade, low, high) + 0.04  # beyond its circle
        words.append((radius * np.cos(_DECADES_AT), radius * np.sin(_DECADES_AT), power(decade), QUIET, 8, "center", "center"))
    words += [(-1.26, -1.1, "light →", INK, 9, "left", "bottom"), (_BESIDE, -0.08, note, QUIET, 8, "left", "top")]
    for x, y, text, ink, size, beside, height in words:
        # within the limits of the axes, so the layout need not measure it
        axes.text(x, y, text, color=ink, fontsize=size, ha=beside, va=height, parse_math=False).set_in_layout(False)


def each_degree(theta, value):
    """A table (L, A) at its angles and at every degree between them, linear in their cosine: few angles make chords of an arc."""
    every = np.union1d(theta, np.radians(np.arange(np.degrees(theta[0]) // 1 + 1, 180)))
    return every, np.array([np.interp(-np.cos(every), -np.cos(theta), row) for row in value])


def radius_of(exponent, low: float, high: float):
    """Where 10 to an exponent is drawn between the circles of 10 to `low` and to `high`."""
    return INNER + (1 - INNER) * (exponent - low) / (high - low)
