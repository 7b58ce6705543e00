"""Pictures of single scattering: cross sections against the radius, and where rays stood in for the series."""

from collections.abc import Iterator, Sequence

import numpy as np

from bakery.draw.axes import labels, legend_beside, plain_decades, positive, sentences
from bakery.draw.picture import Picture
from bakery.draw.style import NEUTRAL, QUIET, colours
from bakery.stages.optics import methods
from bakery.store.tree import Group


def pictures(root: Group) -> Iterator[Picture]:
    """Cross sections of each component that has several radii."""
    for name, component in root["optics"].members.items():
        if isinstance(component, Group) and component["radius"].data.size > 2:
            yield cross_sections(name, component, root["wavelength"].data)


def cross_sections(name: str, component: Group, um) -> Picture:
    """Efficiencies against radius, and which radii the particles and their extinction belong to."""
    order = np.argsort(component["radius"].data, kind="stable")
    radius, weight = component["radius"].data[order], component["weight"].data[order]
    extinction = component["extinction"].data[:, order]
    absorption = component["absorption"].data[:, order]
    disk = np.pi * radius**2
    curves = methods.boundaries(name, component, um)

    def draw(figure):
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1.25, 1.25, 1))
        for ext, absorbed, colour, label in zip(extinction, absorption, colours(um), labels(um), strict=True):
            top.plot(radius, positive(ext), color=colour, label=label, linewidth=1.2)
            middle.plot(radius, ext / disk, color=colour, linewidth=0.9)
            if (absorbed > 1e-6 * ext).any():
                top.plot(radius, positive(absorbed), color=colour, linestyle=(0, (3, 2)), linewidth=1.0)
            if (absorbed > 0.01 * ext).any():
                middle.plot(radius, absorbed / disk, color=colour, linestyle=(0, (3, 2)), linewidth=1.0)
        top.plot(radius, disk, color=QUIET, linewidth=0.9, linestyle=":", label="πr²")
        top.set(yscale="log", ylabel="µm²")
        top.set_title(f"{name}: cross sections (full: extinction, dashed: absorption)")
        legend_beside(figure, top)
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
        plain_decades(bottom.xaxis)
        _mark_rays((top, middle, bottom), curves, um)

    columns = [("radius [um]", radius), ("weight [1]", weight)]
    for x, ext, absorbed in zip(um, extinction, absorption, strict=True):
        columns += [(f"extinction at {x:g} um [um^2]", ext), (f"absorption at {x:g} um [um^2]", absorbed)]
    remarks = [methods.sentence(curves, len(curves) < len(um)) + ", cross sections are the series' own"] if curves else []
    return Picture(f"{name}_cross_sections", f"Cross sections of {name}", "Of single particles against their radius, and how the "
                   f"particles and what they take out of a beam are spread over the radii.{sentences(remarks)}",
                   (9.2, 8.0), draw, tuple(columns))


def _mark_rays(panels, curves: Sequence[methods.Boundary], um) -> None:
    """A line where rays take over from the series, in the colour of its wavelength."""
    if not curves:
        return
    ink = dict(zip(um.tolist(), colours(um), strict=True))
    for axes in panels:
        for boundary in curves:
            axes.axvline(boundary.radius, color=ink[boundary.wavelength], linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=1)
    low, high = np.log(panels[0].get_xlim())
    radii = [boundary.radius for boundary in curves]
    right = np.log(min(radii)) - low > high - np.log(max(radii))  # the words stand where there is more room
    text = f"{curves[0].below} left of the dots, rays right" if curves[0].below else "rays from the dots on"
    panels[0].annotate(text, (min(radii) if right else max(radii), 0.97), xycoords=("data", "axes fraction"),
                       xytext=(-4 if right else 4, 0), textcoords="offset points", ha="right" if right else "left", va="top",
                       color=QUIET, fontsize=8.5)


def _density(radius, weight, bins: int = 70):
    """Share per ln r in equal steps of ln r, from nodes and weights of a quadrature.

    Half of a node's weight lies below it and half above; the cumulative curve in between is linear, so the nodes' spacing does
    not show.
    """
    at = np.log(radius)
    edges = np.linspace(at[0], at[-1], bins + 1)
    below = np.interp(edges, at, np.cumsum(weight) - 0.5 * weight)
    return np.exp(0.5 * (edges[1:] + edges[:-1])), np.diff(below) / np.diff(edges)
