"""Error against time of several methods, each a curve of what it would reach."""

from collections.abc import Mapping

from bakery.draw.axes import plain_decades
from bakery.draw.picture import Picture
from bakery.draw.style import INK

_COLOURS = ("#1f5fbf", "#b3541e", "#2c8a4b", "#8a4fbf", "#c0272d", "#0f8a94", "#7a6a00", "#5d6875")
_DASHES = ("-", (0, (6, 2)), (0, (2, 2)), (0, (6, 2, 1, 2)))


def picture(curves: Mapping[str, tuple], measured: Mapping[str, tuple], knee: tuple | None) -> Picture:
    """Error against time, both logarithmic.

    curves : by name seconds (T,), error (T,) and its upper bound (T,), relative
    measured : by name seconds and error of the picture that was rendered
    knee : seconds and error of the knee of the front, or None
    """

    def draw(figure):
        axes = figure.subplots()
        axes.set(xscale="log", yscale="log", xlabel="time (s)", ylabel="error (%)")
        for i, (name, (seconds, error, most)) in enumerate(curves.items()):
            colour, dash = _COLOURS[i % len(_COLOURS)], _DASHES[i // len(_COLOURS) % len(_DASHES)]
            axes.fill_between(seconds, 100 * error, 100 * most, color=colour, alpha=0.15, linewidth=0)
            axes.plot(seconds, 100 * error, color=colour, linestyle=dash, linewidth=2, label=name)
            axes.plot(measured[name][0], 100 * measured[name][1], "o", color=colour, markeredgecolor=INK, markersize=7)
        if knee is not None:
            axes.plot(knee[0], 100 * knee[1], "o", color="none", markeredgecolor=INK, markeredgewidth=1.6, markersize=17,
                      label="knee")
        for axis in (axes.xaxis, axes.yaxis):
            plain_decades(axis)
        figure.legend(loc="outside right upper")

    columns = [(f"{name}: {label}", values) for name, curve in curves.items()
               for label, values in zip(("time [s]", "error", "at most"), curve)]
    caption = ("Of all cores together, without compiling: measured at the dot, on from there as noise goes, with the root of "
               "time; bands reach up to the error that noise may hide.")
    return Picture("times", "Error against time", caption, (9.0, 4.4), draw, tuple(columns))
