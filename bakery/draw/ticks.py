"""Powers of ten beside logarithmic axes in plain letters, 10⁻³."""

import re

import numpy as np
from matplotlib.ticker import AutoLocator, LogFormatterSciNotation, MaxNLocator, NullLocator

from bakery.draw.axes import power

_FORMULA = re.compile(r"\$\\mathdefault\{(-?)(?:(\d+)\\times)?10\^\{(-?\d+)\}\}\$")

_INTERVALS = 5  # of a linear axis, at most


class Powers(LogFormatterSciNotation):
    """What matplotlib writes as formulas, whose setting is a sixth of the time of a picture."""

    def __call__(self, x, pos=None):
        text = super().__call__(x, pos)
        formula = _FORMULA.fullmatch(text)
        if formula is None:
            return text
        sign, factor, exponent = formula.groups()
        return sign + (f"{factor}×" if factor else "") + power(exponent)


def thin_out(figure) -> None:
    """Fewer ticks, of which each costs a picture as much as two lines of text: locators and formatters of a figure's own stay.

    Linear axes have six, where matplotlib takes up to ten.  Logarithmic ones write their powers as `Powers`, and show no ticks
    without numbers where two powers are written.
    """
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            major, minor = axis.get_major_formatter(), axis.get_minor_formatter()
            if type(major) is LogFormatterSciNotation:
                axis.set_major_formatter(Powers(labelOnlyBase=major.labelOnlyBase))
            if type(minor) is LogFormatterSciNotation:
                axis.set_minor_formatter(Powers(labelOnlyBase=minor.labelOnlyBase))
            if type(axis.get_major_locator()) is AutoLocator:
                axis.set_major_locator(MaxNLocator(_INTERVALS, steps=(1, 2, 2.5, 5, 10)))
            if axis.get_scale() == "log":
                low, high = np.log10(sorted(axis.get_view_interval()))
                if np.floor(high) > np.ceil(low):  # at least two powers of ten are written
                    axis.set_minor_locator(NullLocator())
