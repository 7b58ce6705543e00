"""Axes, legends and sentences that pictures have in common."""

from collections.abc import Sequence

import numpy as np

_WAVELENGTH = "wavelength"
_LITTLE = 10.0  # ratio of the largest to the smallest below which an axis is linear
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def labels(um) -> list[str]:
    return [f"{x:g} µm" for x in um]


def legend_beside(figure, axes, most: int | None = None) -> None:
    """One line a wavelength, beside the axes: inside, eight of them would cover the curves.

    most : lines, evenly from the first to the last; None: all
    """
    handles, names = axes.get_legend_handles_labels()
    shown = np.unique(np.linspace(0, len(names) - 1, min(most or len(names), len(names))).round().astype(int))
    figure.legend([handles[row] for row in shown], [names[row] for row in shown], title=_WAVELENGTH, title_fontsize=9,
                  loc="outside right upper")


def rows_of_errors(figure, axes, names: Sequence[str], unit: str) -> None:
    """One row a name from the top, at 0, -1, ..., along a logarithmic axis; the legend stands beside it."""
    axes.set(xscale="log", ylim=(0.4 - len(names), 0.6), xlabel=unit, title="Errors of the tables")
    axes.set_yticks(-np.arange(len(names)), names)
    plain_decades(axes.xaxis)
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper")


def wavelength_axis(axes, um) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.set_xlabel("wavelength (µm)")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlim(um[0] - 0.06 * np.ptp(um), um[-1] + 0.06 * np.ptp(um))


def plain_decades(axis) -> None:
    """Ticks of a logarithmic axis as 0.1, 0.2, 0.5, 1, ...; decades only where those would crowd."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 300 * low else (1,), numticks=30))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def positive_axis(axes, values) -> None:
    """A logarithmic axis for positive values, a linear one where they differ by so little that it would have next to no ticks."""
    values = values[values > 0]
    if values.size and values.max() > _LITTLE * values.min():
        axes.set_yscale("log")
    else:
        plain_numbers(axes)


def plain_numbers(axes) -> None:
    """Ticks of a linear axis with all that is in their numbers: a factor that they share would stand in the title's place."""
    from matplotlib.ticker import FuncFormatter

    def words(value, _) -> str:
        low, high = axes.yaxis.get_view_interval()
        length, largest = (int(np.floor(np.log10(bound))) for bound in (high - low, max(abs(low), abs(high))))
        value = round(float(value), 3 - length) + 0.0  # what is left of a 0 is no number to be written
        exponent = 0 if -4 < largest < 6 or value == 0 else largest
        return f"{value / 10.0**exponent:.12g}".replace("-", "−") + (f"×{power(exponent)}" if exponent else "")

    axes.yaxis.set_major_formatter(FuncFormatter(words))


def power(exponent: float | str) -> str:
    """10⁻³ in plain letters: formulas take matplotlib many times as long."""
    return "10" + str(int(exponent)).translate(_RAISED)


def positive(row):
    """A logarithmic axis has no zero: gaps instead."""
    return np.where(row > 0, row, np.nan)


def sentences(remarks: Sequence[str]) -> str:
    return "".join(f"  {remark}." for remark in remarks)
