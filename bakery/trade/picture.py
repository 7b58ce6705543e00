"""The picture of a sweep: true error against time, the front, the knee, the presets."""

import textwrap
from collections.abc import Mapping

import numpy as np

from bakery.draw.axes import plain_decades
from bakery.draw.picture import Picture
from bakery.draw.style import FAINT, INK, NEUTRAL, QUIET
from bakery.grammar.qualities import QUALITIES
from bakery.trade.tables import said

_BOLD, _MARK = NEUTRAL[2], NEUTRAL[1]
_LARGEST = 9  # points, of a marker in the legend


def picture(stage: Mapping) -> Picture:
    """Error against time over the settings of a stage.

    stage : one entry of `stages` of trade.json: `runs`, `front`, `knee`, `presets`, `tolerance`, `reference`, ...
    """
    runs = {i: run for i, run in enumerate(stage["runs"]) if "failed" not in run}
    floor = next(iter(stage["reference"]["floor"].values()))
    at = list(runs)
    seconds = np.array([runs[i]["seconds"] for i in at])
    error = np.array([next(iter(runs[i]["errors"].values())) for i in at])
    # what lies below the floor, 0 among it, is drawn at the floor: where it really lies is not known
    height = np.maximum(error, floor if floor > 0 else 0.3 * min(error[error > 0], default=stage["tolerance"]))
    shown = dict(zip(at, zip(seconds, height, strict=True), strict=True))

    def draw(figure):
        axes = figure.subplots()
        axes.set(xscale="log", yscale="log", xlabel="time of one core (s)", ylabel=f"true {stage['errors'][0]}")
        others = [i for i in at if i not in stage["front"]]
        for i in at:
            colour = FAINT if i in others else QUIET
            axes.plot((runs[i]["least"], runs[i]["largest"]), (shown[i][1],) * 2, color=colour, linewidth=1.0, zorder=2)
        axes.plot(*_columns(shown, others), "o", color=QUIET, alpha=0.35, markersize=4.5, markeredgewidth=0, zorder=3,
                  label=f"{len(others)} other setting{'s' * (len(others) != 1)}")
        axes.plot(*_columns(shown, stage["front"]), "o-", color=_BOLD, linewidth=2.2, markersize=7, zorder=5, label="front")
        for name, preset in stage["presets"].items():
            if preset["run"] in shown:
                marker = QUALITIES[name].marker if name in QUALITIES else "P"
                position = "on" if preset["dominated_by"] is None else "off"
                axes.plot(*shown[preset["run"]], marker, color="none", markeredgecolor=INK, markeredgewidth=1.4,
                          markersize=15, zorder=6, label=f"{name} ({position} the front)")
        if stage["start"] not in [preset["run"] for preset in stage["presets"].values()]:
            axes.plot(*shown[stage["start"]], "P", color=INK, markersize=10, zorder=6, label="as it stands")
        if stage["knee"] is not None:
            axes.plot(*shown[stage["knee"]], "o", color="none", markeredgecolor=_MARK, markeredgewidth=2.2, markersize=22,
                      zorder=4, label="knee")
        axes.axhline(stage["tolerance"], color=INK, linewidth=1.0, linestyle=(0, (5, 3)), zorder=1,
                     label=f"tolerance requested, {100 * stage['tolerance']:.3g} %")
        _limits(axes, seconds, np.append(height, stage["tolerance"]))
        if floor > axes.get_ylim()[0]:
            axes.axhspan(axes.get_ylim()[0], floor, color=FAINT, alpha=0.6, linewidth=0, zorder=0,
                         label="below: not distinguished")
        _numbers(axes, [shown[i] for i in stage["front"]])
        axes.set_title(f"{stage['stage']}: error against time")
        handles, labels = axes.get_legend_handles_labels()
        handles = [_small(handle) for handle in handles]
        for number, i in enumerate(stage["front"], 1):
            handles.append(_digit(number))
            labels.append("\n".join(textwrap.wrap(said(runs[i]["setting"]), 34)))
        small = len(labels) + sum(label.count("\n") for label in labels) > 22
        figure.legend(handles, labels, loc="outside right upper", labelspacing=0.6 if small else 1.0, fontsize=7 if small else 9)

    named = [said(runs[i]["setting"]) for i in at]
    return Picture(stage["stage"], f"Error against time of {stage['stage']}", "Each point is a setting; on the line none is both "
                   "faster and more accurate.", (10.6, 5.6), draw,
                   (("setting", np.array(named, dtype=object)), ("seconds [s]", seconds), ("true error", error)))


def _small(handle):
    """A handle of the legend whose marker, as large as among the points, would touch those of the lines above and below."""
    from matplotlib.lines import Line2D

    if not isinstance(handle, Line2D) or handle.get_markersize() <= _LARGEST:
        return handle
    small = Line2D([], [])
    small.update_from(handle)
    small.set_markersize(_LARGEST)
    return small


def _digit(number: int):
    """The number of a point of the front, as a handle of the legend: labels at the points would cover each other."""
    from matplotlib.lines import Line2D

    return Line2D([], [], linestyle="none", marker=f"${number}$", markersize=6 if number < 10 else 9, color=_BOLD)


def _columns(shown: Mapping, indices) -> tuple[list, list]:
    return [shown[i][0] for i in indices], [shown[i][1] for i in indices]


def _limits(axes, seconds, error) -> None:
    for set_limits, values, axis in ((axes.set_xlim, seconds, axes.xaxis), (axes.set_ylim, error, axes.yaxis)):
        low, high = np.log10(values.min()), np.log10(values.max())
        margin = max(0.08 * (high - low), 0.12)
        set_limits(10 ** (low - margin), 10 ** (high + margin))
        plain_decades(axis)


def _numbers(axes, points) -> None:
    """Numbers of the front's points, above and to the right: a front falls to the right, so they stay clear of its line."""
    for number, point in enumerate(points, 1):
        axes.annotate(str(number), point, xytext=(7, 7), textcoords="offset points", fontsize=9.5, fontweight="bold", color=_BOLD,
                      zorder=7)
