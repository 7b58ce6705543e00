"""Powers of ten beside logarithmic axes in plain letters, 10⁻³."""

from __future__ import annotations

import re

from matplotlib.ticker import LogFormatterSciNotation, NullLocator

from bakery.draw.axes import power

_DECADES = 30.0  # ratio of the ends above which at least one power of ten and its neighbours have room
_FORMULA = re.compile(r"\$\\mathdefault\{(-?)(?:(\d+)\\times)?10\^\{(-?\d+)\}\}\$")


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
    """Has the logarithmic axes of a figure write their powers as `Powers`, and show no ticks without a number over some decades.

    Formatters of a figure's own stay.  A tick costs a picture as much as a line of text.
    """
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            major, minor = axis.get_major_formatter(), axis.get_minor_formatter()
            if type(major) is LogFormatterSciNotation:
                axis.set_major_formatter(Powers(labelOnlyBase=major.labelOnlyBase))
            if type(minor) is LogFormatterSciNotation:
                axis.set_minor_formatter(Powers(labelOnlyBase=minor.labelOnlyBase))
            low, high = sorted(axis.get_view_interval())
            if axis.get_scale() == "log" and high > _DECADES * low:
                axis.set_minor_locator(NullLocator())
