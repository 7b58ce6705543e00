"""Powers of ten beside logarithmic axes in plain letters, 10⁻³."""

from __future__ import annotations

import re

from matplotlib.ticker import LogFormatterSciNotation

_FORMULA = re.compile(r"\$\\mathdefault\{(-?)(?:(\d+)\\times)?10\^\{(-?\d+)\}\}\$")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Powers(LogFormatterSciNotation):
    """What matplotlib writes as formulas, whose setting is a sixth of the time of a picture."""

    def __call__(self, x, pos=None):
        text = super().__call__(x, pos)
        formula = _FORMULA.fullmatch(text)
        if formula is None:
            return text
        sign, factor, power = formula.groups()
        return sign + (f"{factor}×" if factor else "") + "10" + power.translate(_RAISED)


def plain_powers(figure) -> None:
    """Has the logarithmic axes of a figure write their powers as `Powers`; formatters of its own stay."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            major, minor = axis.get_major_formatter(), axis.get_minor_formatter()
            if type(major) is LogFormatterSciNotation:
                axis.set_major_formatter(Powers(labelOnlyBase=major.labelOnlyBase))
            if type(minor) is LogFormatterSciNotation:
                axis.set_minor_formatter(Powers(labelOnlyBase=minor.labelOnlyBase))
