"""Pictures and the table of a medium: phase functions, polarisation, coefficients."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from bakery.draw.axes import (
    labels,
    legend_beside,
    plain_decades,
    plain_numbers,
    positive,
    positive_axis,
    sentences,
    wavelength_axis,
)
from bakery.draw.lobe import polar
from bakery.draw.picture import Picture
from bakery.draw.style import INK, NEUTRAL, QUIET, colours
from bakery.draw.table import Table
from bakery.physics.medium.phase import phase_at
from bakery.stages.coordinates import BIAS, ERROR, stated_error
from bakery.stages.optics import methods
from bakery.store.tree import Dataset, Group

_BESIDE = np.radians(2)  # a lobe shows what lies beyond, a narrower forward peak is cut
_LOBE_DECADES = 5  # most decades of a lobe
MOST_COLUMNS = 11  # of a table, side by side
_SEEN = 0.02  # a relative error below this is thinner than a line on a scale of decades


def pictures(root: Group) -> Iterator[Picture]:
    """Every picture that the group `medium` allows."""
    medium, um = root["medium"], root["wavelength"].data
    yield phase_function(medium, um, [remark.text for remark in methods.remarks(root, "medium/phase", ("L", "A"), {})])
    yield lobe(medium, um)
    if {"s11", "s12"} <= medium.members.keys():
        yield polarisation(medium, um)
    if um.size > 1:
        yield coefficients(medium, um)


def tables(root: Group, axes: Callable[[str], tuple[str, ...]]) -> Iterator[Table]:
    """Every value a wavelength, one row a wavelength."""
    medium, um = root["medium"], root["wavelength"].data
    columns = {name: member for name, member in medium.members.items()
               if isinstance(member, Dataset) and axes(f"medium/{name}") == ("L",)}
    errors = {name: error for name in columns if (error := stated_error(medium, name)) is not None}
    columns = {name: member for name, member in columns.items() if name not in {n + end for n in errors for end in (ERROR, BIAS)}}
    units = [f" ({member.units})" if member.units != "1" else "" for member in columns.values()]
    rows = [[name + unit, *(_with_error(x, errors[name][i] if name in errors else 0.0) for i, x in enumerate(member.data))]
            for (name, member), unit in zip(columns.items(), units, strict=True)]
    if len(columns) > MOST_COLUMNS:  # what would be too wide stands below each other
        yield Table("Medium", ("", *(f"{x:g} um" for x in um)), rows, words=1)
        return
    turned = [[f"{x:g}", *(row[1 + i] for row in rows)] for i, x in enumerate(um)]
    yield Table("Medium", ("wavelength (um)", *(row[0] for row in rows)), turned)


def _with_error(value, error) -> str:
    return f"{value:.6g}" + (f" ± {error:.2g}" if error > 0 else "")


def phase_function(medium: Group, um, remarks: Sequence[str] = ()) -> Picture:
    """Phase functions on a logarithmic scale: all angles, and the forward peak on a logarithmic angle.

    `remarks` (where rays took part) stand below the axes.
    """
    theta, phase, error = _curves(medium)
    largest = _largest(phase, error)
    start = _start_of_zoom(np.degrees(theta), phase)
    near = np.union1d(np.geomspace(start, 30, 300), np.degrees(theta[(theta > np.radians(start)) & (theta < np.radians(30))]))

    def draw(figure):
        all_angles, zoom = figure.subplots(1, 2, width_ratios=(1.7, 1), sharey=True)
        over_angles(all_angles, medium, um)
        for row, band, colour in zip(*(phase_at(theta, values, np.radians(near)) for values in (phase, error)), colours(um),
                                     strict=True):
            _curve(zoom, near, row, band if largest > _SEEN else None, colour)
        all_angles.set_title("All angles")
        zoom.set(xscale="log", xlim=(start, 30), xlabel="θ (°), logarithmic")
        zoom.set_title("Forward peak")
        plain_decades(zoom.xaxis)
        legend_beside(figure, all_angles)
        if remarks:
            figure.supxlabel("\n".join(remarks), x=0.01, ha="left", fontsize=8.5, color=QUIET)

    return Picture("phase", "Phase function", "Light scattered by the angle between the directions of travel; "
                   f"2π times the integral over cos θ is 1.{band_of(medium)}{sentences(remarks)}",
                   (10.4, 4.3 + 0.2 * len(remarks)), draw, by_angle(medium, um, "phase at {:g} um [1/sr]", phase))


def over_angles(axes, medium: Group, um) -> None:
    """The phase functions over all angles, with their errors as bands where these are wider than a line."""
    theta, phase, error = _curves(medium)
    largest = _largest(phase, error)
    for row, band, colour, label in zip(phase, error, colours(um), labels(um), strict=True):
        _curve(axes, np.degrees(theta), row, band if largest > _SEEN else None, colour, label)
    axes.set(yscale="log", xlim=(0, 180), xlabel="scattering angle θ (°), 0 = forward", ylabel="phase function (1/sr)")
    if largest > _SEEN:  # the curves, not the error of an angle where next to nothing was found, say what is shown
        axes.set_ylim(0.4 * phase[phase > 0].min(), 2.5 * phase.max())
    axes.set_xticks(range(0, 181, 30))
    axes.axhline(1 / (4 * np.pi), color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
    axes.annotate("isotropic", (0.5, 1 / (4 * np.pi)), xycoords=("axes fraction", "data"), xytext=(0, 3),
                  textcoords="offset points", ha="center", va="bottom", color=QUIET, fontsize=8.5)


def band_of(medium: Group) -> str:
    """How large the error of the phase functions is, and whether it is drawn."""
    _, phase, error = _curves(medium)
    largest = _largest(phase, error)
    return f"  Largest error: {100 * largest:.2g} %" + (", the band." if largest > _SEEN else ", less than a line is wide.")


def _curves(medium: Group):
    """theta (A,) rad, phase functions and their errors, (L, A)."""
    phase, stated = medium["phase"].data, stated_error(medium, "phase")
    error = phase * float(medium.attributes.get("achieved_error", 0.0)) if stated is None else stated
    return medium["theta"].data, phase, error


def _largest(phase, error) -> float:
    return float(np.max(np.divide(error, phase, out=np.zeros_like(phase), where=phase > 0)))


def _curve(axes, at, row, band, colour, label=None) -> None:
    row = positive(row)
    if band is not None:
        axes.fill_between(at, np.maximum(row - band, 1e-3 * row), row + band, color=colour, alpha=0.22, linewidth=0)
    axes.plot(at, row, color=colour, label=label)


def lobe(medium: Group, um) -> Picture:
    """The phase function as a polar diagram whose radius is logarithmic.

    The forward peak is cut where it would press all else into the middle, and small values end on an inner circle.
    """
    bottom, top, cut = _limits(medium)

    def draw(figure):
        axes = figure.subplots()
        around(axes, medium, um)
        axes.set_title("Phase function (1/sr), logarithmic radius")
        legend_beside(figure, axes)

    caption = "The same phase function around the particle; light travels to the right, 0° is straight on."
    caption += f"  The inner circle stands for {10**bottom:g} and less" + (
        f", the outer one for {10**top:g} and more: the forward peak rises to {medium['phase'].data.max():.3g}." if cut else ".")
    return Picture("lobe", "Lobe", caption, (6.4, 5.2), draw,
                   by_angle(medium, um, "phase at {:g} um [1/sr]", medium["phase"].data))


def around(axes, medium: Group, um) -> None:
    """The phase functions as lobes; light travels to the right."""
    theta, phase = medium["theta"].data, medium["phase"].data
    bottom, top, cut = _limits(medium)
    polar(axes, theta, phase, (bottom, top), colours(um), labels(um), f"peak cut,\nto {phase.max():.3g}" if cut else "")


def _limits(medium: Group) -> tuple[float, float, bool]:
    """log10 of the inner and the outer circle of a lobe, and whether the forward peak goes beyond."""
    theta, phase = medium["theta"].data, medium["phase"].data
    beside = phase[:, theta >= min(_BESIDE, theta[-1])]
    top = float(np.ceil(np.log10(beside.max())))
    bottom = np.floor(np.log10(max(np.percentile(beside[beside > 0], 0.5), 10 ** (top - _LOBE_DECADES))))
    return float(min(bottom, top - 1)), top, bool(phase.max() > 10**top)


def polarisation(medium: Group, um) -> Picture:
    """Degree of linear polarisation of light that was unpolarised before a single scattering."""
    theta = medium["theta"].data
    s11, s12 = medium["s11"].data, medium["s12"].data
    degree = -np.divide(s12, s11, out=np.zeros_like(s12), where=s11 > 0)

    def draw(figure):
        axes = figure.subplots()
        axes.axhline(0, color=QUIET, linewidth=0.8)
        for row, colour, label in zip(degree, colours(um), labels(um), strict=True):
            axes.plot(np.degrees(theta), 100 * row, color=colour, label=label)
        axes.set(xlim=(0, 180), ylim=(-104 if (degree < -0.05).any() else -10, 104), xlabel="scattering angle θ (°)",
                 ylabel="degree of linear polarisation (%)")
        axes.set_xticks(range(0, 181, 30))
        axes.set_title("Above 0: across the scattering plane; below: in it")
        legend_beside(figure, axes)

    return Picture("polarisation", "Polarisation", "-s12 / s11 for a single scattering of unpolarised light.", (7.2, 4.0), draw,
                   by_angle(medium, um, "-s12/s11 at {:g} um [1]", degree))


def coefficients(medium: Group, um) -> Picture:
    """Extinction, scattering and absorption, albedo and mean cosine against wavelength."""
    order = np.argsort(um)
    titles = {"sigma_t": "extinction σt", "sigma_s": "scattering σs", "sigma_a": "absorption σa"}
    style = {"sigma_t": "-", "sigma_s": (0, (5, 2.5)), "sigma_a": "-"}

    lost = (medium["sigma_a"].data / medium["sigma_t"].data)[order]  # 1 - albedo has lost its digits where little is absorbed
    absorbs = bool((lost > 0).any())

    def draw(figure):
        first, *others = figure.subplots(1, 2 + absorbs, width_ratios=(1.25, *[1] * (1 + absorbs)))
        for name, ink in zip(titles, NEUTRAL, strict=False):
            values = medium[name].data[order]
            if (values > 0).any():
                first.plot(um[order], positive(values), color=ink, linestyle=style[name], marker="o", markersize=4,
                           label=titles[name])
        positive_axis(first, np.concatenate([medium[name].data for name in titles]))
        first.set_title("Coefficients (1/m)")
        first.legend(loc="best")
        if absorbs:
            others[0].plot(um[order], positive(lost), color=INK, marker="o", markersize=4)
            positive_axis(others[0], lost)
            others[0].set_title("1 − albedo")
        others[-1].plot(um[order], medium["g"].data[order], color=INK, marker="o", markersize=4)
        others[-1].set_title("Mean cosine g")
        plain_numbers(others[-1])
        for axes in (first, *others):
            wavelength_axis(axes, um[order])

    shown = [*titles, "albedo", "g"]
    columns = [(f"{name} [{medium[name].units}]", medium[name].data[order]) for name in shown]
    said_of_zeros = "zeros are left out." if absorbs else "nothing is absorbed."
    return Picture("coefficients", "Coefficients", f"Of the medium, against the wavelength in vacuum; {said_of_zeros}",
                   (9.6 if absorbs else 7.0, 3.4), draw, (("wavelength [um]", um[order]), *columns))


def by_angle(medium: Group, um, heading: str, rows) -> tuple:
    """Columns of a picture over the scattering angle: one a wavelength."""
    return (("theta [rad]", medium["theta"].data), *((heading.format(x), row) for x, row in zip(um, rows, strict=True)))


def _start_of_zoom(theta, phase) -> float:
    """An angle (degrees) inside the plateau of the sharpest peak: a fifth of where it has fallen to a half, in whole decades."""
    halves = [theta[np.argmax(row < 0.5 * row[0])] for row in phase if (row < 0.5 * row[0]).any()]
    sharpest = min(halves, default=30.0)
    return float(10 ** np.floor(np.log10(min(max(sharpest / 5, 1e-5), 1.0))))
