"""The pictures of an asset: what each shows, and the numbers behind it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bakery.draw.style import FAINT, INK, NEUTRAL, QUIET, colours, look, saved
from bakery.physics.medium.phase import evaluate
from bakery.stages.optics import methods
from bakery.store.tree import Dataset, Group
from bakery.system.terminal import clean


@dataclass(frozen=True)
class Picture:
    """One figure.

    Attributes
    ----------
    name : end of the file name
    title, caption : what is seen, in words
    size : inches
    draw : takes an empty matplotlib Figure
    columns : (heading with unit, values (N,)) of the data shown
    """

    name: str
    title: str
    caption: str
    size: tuple[float, float]
    draw: Callable
    columns: tuple[tuple[str, np.ndarray], ...]


def drawn(picture: Picture, forms: Sequence[str] = ("png", "svg"), of: str = "") -> dict[str, bytes]:
    """A picture in each form; the same bytes on every run with the same packages.  `of` (the asset) stands above it."""
    from matplotlib.figure import Figure

    with look(picture.name):
        wide, high = picture.size
        figure = Figure(figsize=(wide, high + _HEAD if of else high))
        if of:
            head, body = figure.subfigures(2, 1, height_ratios=(_HEAD, high))
            head.text(0.08 / wide, 0.45, of, va="center", color=QUIET, fontsize=8.5, parse_math=False)
        picture.draw(body if of else figure)
        return {form: saved(figure, form) for form in forms}


def title_of(root: Group) -> str:
    """What stands above every picture of an asset: its name and the beginning of its content hash."""
    name, content = (str(root.attributes.get(key) or "") for key in ("name", "content_hash"))
    return "  ·  ".join(filter(None, (clean(name), content[:12])))


def pictures(root: Group) -> Iterator[Picture]:
    """Every picture that the content of an asset allows."""
    packing = root.members.get("packing")
    if isinstance(packing, Group):
        from bakery.stages.packing import pictures as tiles

        yield from tiles.pictures(packing)
    medium = root.members.get("medium")
    wavelength = root.members.get("wavelength")
    if not isinstance(wavelength, Dataset):
        return
    um = wavelength.data
    packed = root.members.get("grains")
    if isinstance(packed, Group):
        from bakery.stages.grains import pictures as grains

        yield from grains.pictures(packed, um)
    if isinstance(medium, Group) and {"sigma_t", "sigma_t_mean_flight"} <= medium.members.keys():
        from bakery.stages.effective.pictures import extinction

        yield extinction(medium, um)
    if isinstance(medium, Group) and {"theta", "phase"} <= medium.members.keys():
        yield phase_function(medium, um, methods.remarks(root, "medium/phase"))
        yield lobe(medium, um)
        if {"s11", "s12"} <= medium.members.keys():
            yield polarisation(medium, um)
    if isinstance(medium, Group) and {"sigma_t", "albedo", "g"} <= medium.members.keys() and um.size > 1:
        yield coefficients(medium, um)
    if isinstance(root.members.get("multiple"), Group):
        from bakery.stages.multiple import pictures as multiple

        yield from multiple.pictures(root)
    if isinstance(root.members.get("beam"), Group):
        from bakery.stages.beam import pictures as beam

        yield from beam.pictures(root)
    optics = root.members.get("optics")
    for name, component in (optics.members if isinstance(optics, Group) else {}).items():
        if isinstance(component, Group) and {"radius", "weight", "extinction"} <= component.members.keys() \
                and component["radius"].data.size > 2:
            yield cross_sections(name, component, um)


def phase_function(medium: Group, um, remarks: Sequence[str] = (), prefix: str = "", of: str = "") -> Picture:
    """Phase functions on a logarithmic scale: all angles, and the forward peak on a logarithmic angle.

    `remarks` (where rays took part, what the curves leave out) stand below the axes; `prefix` goes before the picture's name,
    `of` behind its title.
    """
    theta, phase = np.degrees(medium["theta"].data), medium["phase"].data
    stated = medium.members.get("phase_error")
    error = stated.data if stated else phase * float(medium.attributes.get("achieved_error", 0.0))
    largest = float(np.max(np.divide(error, phase, out=np.zeros_like(phase), where=phase > 0)))

    left = _start_of_zoom(theta, phase)
    near = np.union1d(np.geomspace(left, 30, 300), theta[(theta > left) & (theta < 30)])

    def draw(figure):
        wide, zoom = figure.subplots(1, 2, width_ratios=(1.7, 1), sharey=True)
        for axes, at in ((wide, theta), (zoom, near)):
            rows, bands = (evaluate(medium["theta"].data, values, np.minimum(np.radians(at), np.pi)) for values in (phase, error))
            for row, band, colour, label in zip(rows, bands, colours(um), _labels(um), strict=True):
                row = _positive(row)
                if largest > _SEEN:
                    axes.fill_between(at, np.maximum(row - band, 1e-3 * row), row + band, color=colour, alpha=0.22, linewidth=0)
                axes.plot(at, row, color=colour, label=label)
        wide.set(yscale="log", xlim=(0, 180), xlabel="scattering angle θ (°), 0 = forward", ylabel="phase function (1/sr)")
        if largest > _SEEN:  # the curves, not the error of an angle where next to nothing was found, say what is shown
            wide.set_ylim(0.4 * phase[phase > 0].min(), 2.5 * phase.max())
        wide.set_xticks(range(0, 181, 30))
        wide.axhline(1 / (4 * np.pi), color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
        wide.annotate("isotropic", (0.5, 1 / (4 * np.pi)), xycoords=("axes fraction", "data"), xytext=(0, 3),
                      textcoords="offset points", ha="center", va="bottom", color=QUIET, fontsize=8.5)
        wide.set_title("All angles")
        zoom.set(xscale="log", xlim=(left, 30), xlabel="θ (°), logarithmic")
        zoom.set_title("Forward peak")
        _plain_decades(zoom.xaxis)
        _legend_beside(figure, wide)
        if remarks:
            figure.supxlabel("\n".join(remarks), x=0.01, ha="left", fontsize=8.5, color=QUIET)

    band = f"  Largest error: {100 * largest:.2g} %" + (", the band." if largest > _SEEN else ", less than a line is wide.")
    return Picture(f"{prefix}phase", f"Phase function{of}", "Light scattered by the angle between the directions of travel; "
                   f"2π times the integral over cos θ is 1.{band}{_sentences(remarks)}", (10.4, 4.3 + 0.2 * len(remarks)), draw,
                   _by_angle(medium, um, "phase at {:g} um [1/sr]", phase))


def lobe(medium: Group, um, prefix: str = "", of: str = "") -> Picture:
    """The phase function as a polar diagram whose radius is logarithmic.

    The forward peak is cut where it would press all else into the middle, and small values end on an inner circle.
    """
    theta, phase = medium["theta"].data, medium["phase"].data
    beside = phase[:, theta >= min(_BESIDE, theta[-1])]
    top = float(np.ceil(np.log10(beside.max())))
    bottom = np.floor(np.log10(max(np.percentile(beside[beside > 0], 0.5), 10 ** (top - _LOBE_DECADES))))
    bottom = float(min(bottom, top - 1))
    cut = phase.max() > 10**top

    def draw(figure):
        axes = figure.add_subplot(projection="polar")
        for row, colour, label in zip(phase, colours(um), _labels(um), strict=True):
            radius = np.log10(np.clip(row, 10**bottom, 10**top))
            axes.plot(np.concatenate([theta, 2 * np.pi - theta[::-1]]), np.concatenate([radius, radius[::-1]]), color=colour,
                      label=label, linewidth=1.3)
        decades = np.arange(bottom, top + 1)
        axes.set_rlim(bottom, top)
        axes.set_rorigin(bottom - _HOLE * (top - bottom))
        axes.set_rgrids(decades, [_power(d) for d in decades], angle=112, color=QUIET, fontsize=8)
        axes.set_thetagrids(range(0, 360, 30), [f"{min(a, 360 - a)}°" for a in range(0, 360, 30)])
        axes.spines["polar"].set_color(FAINT)
        axes.spines["inner"].set_color(QUIET)
        axes.annotate("light", (0.17, 0.06), xytext=(0.0, 0.06), xycoords="axes fraction", va="center", fontsize=9,
                      arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.2, "shrinkA": 4})
        if cut:
            axes.annotate(f"peak cut, to {phase.max():.2g}", (0, top), xytext=(-6, 5), textcoords="offset points", ha="right",
                          fontsize=8, color=QUIET, annotation_clip=False)
        axes.set_title("Phase function (1/sr), logarithmic radius", pad=16)
        _legend_beside(figure, axes)

    said = "The same phase function around the particle; light travels to the right, 0° is forward."
    said += f"  The inner circle stands for {10**bottom:g} and less" + (
        f", the outer one for {10**top:g} and more: the forward peak rises to {phase.max():.2g}." if cut else ".")
    return Picture(f"{prefix}lobe", f"Lobe{of}", said, (6.4, 5.2), draw,
                   _by_angle(medium, um, "phase at {:g} um [1/sr]", phase))


def polarisation(medium: Group, um) -> Picture:
    """Degree of linear polarisation of light that was unpolarised before a single scattering."""
    theta = medium["theta"].data
    s11, s12 = medium["s11"].data, medium["s12"].data
    degree = -np.divide(s12, s11, out=np.zeros_like(s12), where=s11 > 0)

    def draw(figure):
        axes = figure.subplots()
        axes.axhline(0, color=QUIET, linewidth=0.8)
        for row, colour, label in zip(degree, colours(um), _labels(um), strict=True):
            axes.plot(np.degrees(theta), 100 * row, color=colour, label=label)
        axes.set(xlim=(0, 180), ylim=(-104 if (degree < -0.05).any() else -10, 104), xlabel="scattering angle θ (°)",
                 ylabel="degree of linear polarisation (%)")
        axes.set_xticks(range(0, 181, 30))
        axes.set_title("Above 0: across the scattering plane; below: in it")
        _legend_beside(figure, axes)

    return Picture("polarisation", "Polarisation", "-s12 / s11 for a single scattering of unpolarised light.", (7.2, 4.0), draw,
                   _by_angle(medium, um, "-s12/s11 at {:g} um [1]", degree))


def coefficients(medium: Group, um) -> Picture:
    """Extinction, scattering and absorption, albedo and mean cosine against wavelength."""
    order = np.argsort(um)
    names = [name for name in ("sigma_t", "sigma_s", "sigma_a") if name in medium.members]
    said = {"sigma_t": "extinction σt", "sigma_s": "scattering σs", "sigma_a": "absorption σa"}
    style = {"sigma_t": "-", "sigma_s": (0, (5, 2.5)), "sigma_a": "-"}

    absorbed = medium.members.get("sigma_a")  # 1 - albedo has lost its digits where little is absorbed
    lost = (absorbed.data / medium["sigma_t"].data if absorbed else 1 - medium["albedo"].data)[order]
    absorbs = bool((lost > 0).any())

    def draw(figure):
        first, *others = figure.subplots(1, 2 + absorbs, width_ratios=(1.25, *[1] * (1 + absorbs)))
        for name, ink in zip(names, NEUTRAL, strict=False):
            values = medium[name].data[order]
            if (values > 0).any():
                first.plot(um[order], _positive(values), color=ink, linestyle=style[name], marker="o", markersize=4,
                           label=said[name])
        _positive_axis(first, np.concatenate([medium[name].data for name in names]))
        first.set_title("Coefficients (1/m)")
        first.legend(loc="best")
        if absorbs:
            others[0].plot(um[order], _positive(lost), color=INK, marker="o", markersize=4)
            _positive_axis(others[0], lost)
            others[0].set_title("1 − albedo")
        others[-1].plot(um[order], medium["g"].data[order], color=INK, marker="o", markersize=4)
        others[-1].set_title("Mean cosine g")
        _plain_numbers(others[-1])
        for axes in (first, *others):
            _wavelength_axis(axes, um[order])

    shown = [*names, "albedo", "g"]
    columns = [(f"{name} [{medium[name].units}]", medium[name].data[order]) for name in shown]
    said_of_zeros = "zeros are left out." if absorbs else "nothing is absorbed."
    return Picture("coefficients", "Coefficients", f"Of the medium, against the wavelength in vacuum; {said_of_zeros}",
                   (9.6 if absorbs else 7.0, 3.4), draw, (("wavelength [um]", um[order]), *columns))


def cross_sections(name: str, component: Group, um) -> Picture:
    """Efficiencies against radius, and which radii the particles and their extinction belong to."""
    order = np.argsort(component["radius"].data, kind="stable")
    radius, weight = component["radius"].data[order], component["weight"].data[order]
    extinction = component["extinction"].data[:, order]
    absorption = component["absorption"].data[:, order] if "absorption" in component.members else np.zeros_like(extinction)
    disk = np.pi * radius**2
    found = methods.boundaries(name, component, um) if "method" in component.members else []

    def draw(figure):
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1.25, 1.25, 1))
        for ext, absorbed, colour, label in zip(extinction, absorption, colours(um), _labels(um), strict=True):
            top.plot(radius, _positive(ext), color=colour, label=label, linewidth=1.2)
            middle.plot(radius, ext / disk, color=colour, linewidth=0.9)
            if (absorbed > 1e-6 * ext).any():
                top.plot(radius, _positive(absorbed), color=colour, linestyle=(0, (3, 2)), linewidth=1.0)
            if (absorbed > 0.01 * ext).any():
                middle.plot(radius, absorbed / disk, color=colour, linestyle=(0, (3, 2)), linewidth=1.0)
        top.plot(radius, disk, color=QUIET, linewidth=0.9, linestyle=":", label="πr²")
        top.set(yscale="log", ylabel="µm²")
        top.set_title(f"{name}: cross sections (full: extinction, dashed: absorption)")
        _legend_beside(figure, top)
        if (extinction > disk).any():
            middle.axhline(2, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)))  # the limit of large spheres
        else:
            middle.set_yscale("log")
        middle.set_title("Efficiencies: cross section over πr²")
        number = _density(radius, weight)
        share = _density(radius, weight * extinction.mean(axis=0))
        for (at, value), ink, label in ((number, NEUTRAL[0], "number of particles"), (share, NEUTRAL[1], "their extinction")):
            bottom.fill_between(at, value / value.max(), step="mid", color=ink, alpha=0.14, linewidth=0)
            bottom.plot(at, value / value.max(), drawstyle="steps-mid", color=ink, linewidth=1.2, label=label)
        bottom.set(xscale="log", xlabel="radius (µm)", ylim=(0, None), ylabel="relative to the maximum")
        bottom.set_title("Size distribution per ln r")
        bottom.legend(loc="best")
        bottom.set_xlim(radius[0], radius[-1])
        _plain_decades(bottom.xaxis)
        _mark_rays((top, middle, bottom), found, um)

    columns = [("radius [um]", radius), ("weight [1]", weight)]
    for x, ext, absorbed in zip(um, extinction, absorption, strict=True):
        columns += [(f"extinction at {x:g} um [um^2]", ext), (f"absorption at {x:g} um [um^2]", absorbed)]
    remarks = [methods.sentence(found, len(found) < len(um)) + ", cross sections are the series' own"] if found else []
    return Picture(f"{name}_cross_sections", f"Cross sections of {name}", "Of single particles against their radius, and how the "
                   f"particles and what they take out of a beam are spread over the radii.{_sentences(remarks)}",
                   (9.2, 8.0), draw, tuple(columns))


def _mark_rays(panels, found: Sequence[methods.Boundary], um) -> None:
    """A line where rays take over from the series, in the colour of its wavelength."""
    if not found:
        return
    ink = dict(zip(um.tolist(), colours(um), strict=True))
    for axes in panels:
        for boundary in found:
            axes.axvline(boundary.radius, color=ink[boundary.wavelength], linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=1)
    low, high = np.log(panels[0].get_xlim())
    radii = [boundary.radius for boundary in found]
    right = np.log(min(radii)) - low > high - np.log(max(radii))  # the words stand where there is more room
    text = f"{found[0].below} left of the dots, rays right" if found[0].below else "rays from the dots on"
    panels[0].annotate(text, (min(radii) if right else max(radii), 0.97), xycoords=("data", "axes fraction"),
                       xytext=(-4 if right else 4, 0), textcoords="offset points", ha="right" if right else "left", va="top",
                       color=QUIET, fontsize=8.5)


def _by_angle(medium: Group, um, heading: str, rows) -> tuple:
    """Columns of a picture over the scattering angle: one a wavelength."""
    return (("theta [rad]", medium["theta"].data), *((heading.format(x), row) for x, row in zip(um, rows, strict=True)))


def _sentences(remarks: Sequence[str]) -> str:
    return "".join(f"  {remark}." for remark in remarks)


_WAVELENGTH = "wavelength"
_HEAD = 0.24  # inches above a picture for the asset's name
_BESIDE = np.radians(2)  # a lobe shows what lies beyond, a narrower forward peak is cut
_LOBE_DECADES, _HOLE = 5, 0.15  # most decades of a lobe; its inner circle, in shares of what is outside of it
_LITTLE = 10.0  # ratio of the largest to the smallest below which an axis is linear
_SEEN = 0.02  # a relative error below this is thinner than a line on a scale of decades


def _labels(um) -> list[str]:
    return [f"{x:g} µm" for x in um]


def _legend_beside(figure, axes) -> None:
    """One line a wavelength, beside the axes: inside, eight of them would cover the curves."""
    figure.legend(*axes.get_legend_handles_labels(), title=_WAVELENGTH, title_fontsize=9, loc="outside right upper")


def _power(exponent: float) -> str:
    return f"$10^{{{int(exponent)}}}$"


def _positive(row):
    """A logarithmic axis has no zero: gaps instead."""
    return np.where(row > 0, row, np.nan)


def _start_of_zoom(theta, phase) -> float:
    """An angle (degrees) inside the plateau of the sharpest peak: a fifth of where it has fallen to a half, in whole decades."""
    halves = [theta[np.argmax(row < 0.5 * row[0])] for row in phase if (row < 0.5 * row[0]).any()]
    sharpest = min(halves, default=30.0)
    return float(10 ** np.floor(np.log10(min(max(sharpest / 5, 1e-5), 1.0))))


def _density(radius, weight, bins: int = 70):
    """Share per ln r in equal steps of ln r, from nodes and weights of a quadrature.

    Half of a node's weight lies below it and half above; the cumulative curve in between is linear, so the nodes' spacing does
    not show.
    """
    at = np.log(radius)
    edges = np.linspace(at[0], at[-1], bins + 1)
    below = np.interp(edges, at, np.cumsum(weight) - 0.5 * weight)
    return np.exp(0.5 * (edges[1:] + edges[:-1])), np.diff(below) / np.diff(edges)


def _wavelength_axis(axes, um) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.set_xlabel("wavelength (µm)")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlim(um[0] - 0.06 * np.ptp(um), um[-1] + 0.06 * np.ptp(um))


def _plain_decades(axis) -> None:
    """Ticks of a logarithmic axis as 0.1, 0.2, 0.5, 1, ...; decades only where those would crowd."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 300 * low else (1,), numticks=30))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _positive_axis(axes, values) -> None:
    """A logarithmic axis for positive values, a linear one where they differ by so little that it would have next to no ticks."""
    values = values[values > 0]
    if values.size and values.max() > _LITTLE * values.min():
        axes.set_yscale("log")
    else:
        _plain_numbers(axes)


def _plain_numbers(axes) -> None:
    axes.ticklabel_format(axis="y", useOffset=False)
