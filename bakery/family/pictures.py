"""Pictures of a family: its figures and its phase functions over each of its axes."""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from bakery.draw.axes import labels, legend_beside, plain_decades, plain_numbers, positive_axis
from bakery.draw.picture import Picture
from bakery.draw.style import QUIET, colours
from bakery.family.axes import Axis, in_words
from bakery.family.tree import axes_of, error_of, tables_of
from bakery.physics.medium import phase
from bakery.physics.medium.between import Tables, hole, interpolated
from bakery.stages.conform import FAMILY
from bakery.store.tree import Group

_BETWEEN = 8  # places that are drawn from a point to the next
_CURVES = 7  # phase functions of a picture
_GREEN = 0.55  # um; phase functions are drawn at the wavelength that is nearest


class _Line(NamedTuple):
    """Figures along an axis: values as shown (P,), which are points, figures (P, L), not a number where a point failed."""

    values: np.ndarray
    point: np.ndarray
    figures: dict[str, np.ndarray]


def pictures(root: Group) -> Iterator[Picture]:
    """Two pictures for each axis with more than one point; on the other axes at the point in the middle."""
    family, um = root[FAMILY], root["wavelength"].data
    axes, tables = axes_of(family), tables_of(family)
    middle = [axis.first.values[len(axis.first.values) // 2] for axis in axes]
    for i, axis in enumerate(axes):
        if len(axis.first.values) > 1:
            others = [(crossed, value) for j, (crossed, value) in enumerate(zip(axes, middle, strict=True)) if j != i]
            at = f"  At {in_words(*zip(*others, strict=True))}." if others else ""
            yield _figures(i, axes, middle, tables, family, um, at)
            yield _phases(i, axes, middle, tables, um, at)


def _figures(i: int, axes, middle, tables: Tables, family: Group, um, at: str) -> Picture:
    axis, line = axes[i], _along(i, axes, middle, tables, str(family.attributes["method"]))
    name, error = axis.first.name, error_of(family[f"axes/{axis.first.name}"])

    def draw(figure):
        *panels, last = figure.subplots(2, 2, sharex=True).ravel()
        titles = {"sigma_t": "Extinction σt (1/m)", "absorbed": "1 − albedo", "g": "Mean cosine g"}
        for panel, (figure_name, title) in zip(panels, titles.items(), strict=True):
            for row, colour, wavelength in zip(line.figures[figure_name].T, colours(um), labels(um), strict=True):
                panel.plot(line.values, row, color=colour, label=wavelength)
                panel.plot(line.values[line.point], row[line.point], "o", color=colour, markersize=3)
            panel.set_title(title)
            (plain_numbers if figure_name == "g" else partial(positive_axis, values=line.figures[figure_name]))(panel)
        _errors(last, axis, error, float(family.attributes["tolerance"]))
        for panel in (panels[-1], last):
            unit = _unit(axis).replace("um", "µm")
            panel.set_xlabel(name + (f" ({unit})" if unit != "1" else ""))
        legend_beside(figure, panels[0])

    columns = [(f"{name} [{_unit(axis)}]", line.values), ("point", line.point.astype(int))]
    columns += [(f"{figure_name} at {x:g} um", rows[:, k])
                for figure_name, rows in line.figures.items() for k, x in enumerate(um)]
    caption = f"Dots are members, lines what is between them.  Errors of several axes add up.{at}"
    return Picture(name, f"Figures over {name}", caption, (9.2, 6.2), draw, tuple(columns))


def _errors(panel, axis: Axis, error, tolerance: float) -> None:
    """The error half-way between points, where it is known."""
    scaled = np.array([axis.first.scaled(value) for value in axis.first.values])
    middles = [_scale(axis) * axis.first.unscaled(value) for value in (scaled[1:] + scaled[:-1]) / 2]
    if error is not None:
        panel.plot(middles, error, ".-", color=QUIET)
        panel.axhline(tolerance, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)))
        panel.annotate("tolerance", (0.5, tolerance), xycoords=("axes fraction", "data"), xytext=(0, 3),
                       textcoords="offset points", ha="center", va="bottom", color=QUIET, fontsize=8.5)
        panel.set_ylim(0, 1.25 * max(error[np.isfinite(error)].max(initial=0.0), tolerance))
    remark = ": not measured" if error is None else "" if np.isfinite(error).any() else ": not known"
    panel.set_title(f"Error between members{remark}")
    low, high = (_scale(axis) * axis.first.values[end] for end in (0, -1))
    if axis.first.logarithmic:
        margin = (high / low) ** 0.04
        panel.set_xlim(low / margin, high * margin)
        panel.set_xscale("log")
        plain_decades(panel.xaxis)
    else:
        panel.set_xlim(low - 0.04 * (high - low), high + 0.04 * (high - low))


def _along(i: int, axes, middle, tables: Tables, method: str) -> _Line:
    """Figures at the points of an axis and between them."""
    axis = axes[i]
    scaled = tables.axes[i]
    steps = [np.linspace(a, b, _BETWEEN, endpoint=False) for a, b in zip(scaled, scaled[1:], strict=False)]
    places = np.concatenate([*steps, scaled[-1:]])
    point = np.arange(len(places)) % _BETWEEN == 0
    coordinates = [fixed.first.scaled(value) for fixed, value in zip(axes, middle, strict=True)]
    rows = []
    for coordinate in places:
        coordinates[i] = coordinate
        rows.append(_row(tables, coordinates, method))
    values = _scale(axis) * np.array([axis.first.unscaled(coordinate) for coordinate in places])
    return _Line(values, point, {name: np.array([row[k] for row in rows]) for k, name in enumerate(("sigma_t", "absorbed", "g"))})


def _row(tables: Tables, coordinates, method: str) -> np.ndarray:
    if hole(tables, coordinates) is not None:
        return np.full((3, tables.sigma_s.shape[-1]), np.nan)
    medium = interpolated(tables, coordinates, method)
    sigma_t = medium.sigma_s + medium.sigma_a
    absorbed = np.divide(medium.sigma_a, sigma_t, out=np.ones_like(sigma_t), where=sigma_t > 0)
    return np.array([sigma_t, absorbed, phase.mean_cosine(medium.theta, medium.elements[:, 0])])


def _phases(i: int, axes, middle, tables: Tables, um, at: str) -> Picture:
    axis, row = axes[i], int(np.argmin(np.abs(um - _GREEN)))
    count = len(axis.first.values)
    chosen = sorted(set(np.linspace(0, count - 1, min(count, _CURVES)).round().astype(int).tolist()))
    index = [len(swept.first.values) // 2 for swept in axes]
    curves = {}
    for k in chosen:
        index[i] = k
        if not tables.missing[tuple(index)]:
            curves[in_words([axis], [axis.first.values[k]])] = tables.phase[(*index, row)]
    degrees = np.degrees(tables.theta)

    def draw(figure):
        from matplotlib import colormaps

        shades = colormaps["viridis"](np.linspace(0.0, 0.85, len(curves)))  # in the order of the axis
        all_angles, near = figure.subplots(1, 2, width_ratios=(1.7, 1), sharey=True)
        for panel in (all_angles, near):
            for (label, curve), colour in zip(curves.items(), shades, strict=True):
                panel.plot(degrees, np.where(curve > 0, curve, np.nan), color=colour, label=label)
        all_angles.set(yscale="log", xlim=(0, 180), xlabel="scattering angle θ (°), 0 = forward", ylabel="phase function (1/sr)")
        all_angles.set_xticks(range(0, 181, 30))
        near.set(xscale="log", xlim=(max(degrees[1], 0.02), 30), xlabel="θ (°), logarithmic")
        plain_decades(near.xaxis)
        figure.legend(*all_angles.get_legend_handles_labels(), fontsize=8.5, loc="outside right upper")

    name = axis.first.name
    columns = [("theta [deg]", degrees), *((f"phase at {label} [1/sr]", curve) for label, curve in curves.items())]
    return Picture(f"{name}_phase", f"Phase functions over {name}", f"Of members, at {um[row]:g} µm.{at}", (10.4, 4.3), draw,
                   tuple(columns))


def _scale(axis: Axis) -> float:
    """Lengths are shown in µm."""
    return 1e6 if axis.first.units == "m" else 1.0


def _unit(axis: Axis) -> str:
    return "um" if axis.first.units == "m" else axis.first.units.replace("/", "1/")
