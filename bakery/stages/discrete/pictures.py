"""Pictures of separate particles: a slab of them, their sizes and counts beside the law, and how grainy they look."""

import math
from collections.abc import Iterator

import numpy as np

from bakery.draw.axes import plain_decades, positive_axis
from bakery.draw.picture import Picture
from bakery.draw.style import FAINT, INK, NEUTRAL, QUIET
from bakery.stages.discrete.view import classes_of
from bakery.store.tree import Group

_SHOWN = 1600  # particles of a slab, about
_COVER = 0.12  # of the picture that their discs cover, enlarged where they are smaller
_FIELD, _PIXELS = math.radians(40), 640  # the camera for which grains are predicted
_ANGLES = (10, 90, 170)  # degrees
_MARKS = ("o", "s", "D", "v")


def pictures(root: Group) -> Iterator[Picture]:
    """What is stored of the realisation, and what follows from its classes."""
    group = root["discrete"]
    if "position" in group.members and group["position"].data.size:
        yield slab(group)
        yield sizes(group)
        if {"cell_dispersion", "cell_dispersion_error", "cell_edge", "cell_count", "cell_count_law"} <= group.members.keys():
            yield counts(group)
    if float(group["number_density"].data[0]) > 0:
        yield grains(group, root["wavelength"].data)


def slab(group: Group) -> Picture:
    """The particles of a layer across the shortest edge, with their sizes."""
    position, radius, component = (group[name].data for name in ("position", "radius", "component"))
    box, names = group["box"].data, classes_of(group).names
    depth = 2 - int(np.argmin(box[::-1]))
    across, up = (axis for axis in range(3) if axis != depth)
    half = min(0.5, 0.5 * _SHOWN / len(position)) * box[depth]
    middle = float(np.median(position[:, depth][:10**6])) if "density" in group.members else 0.5 * box[depth]
    inside = np.flatnonzero(np.abs(position[:, depth] - middle) <= half)
    centre, size, kind = position[inside].astype(float), radius[inside] * 1e-6, component[inside]
    scale, unit = _unit(box[[across, up]].max())
    area = np.pi * float(np.sum(size**2)) / (box[across] * box[up])
    factor = max(1.0, math.sqrt(_COVER / area)) if area > 0 else 1.0
    order = np.argsort(-size, kind="stable")

    def draw(figure):
        from matplotlib.collections import EllipseCollection

        axes = figure.subplots()
        axes.set(xlim=(0, box[across] * scale), ylim=(0, box[up] * scale), aspect="equal",
                 xlabel=f"{'xyz'[across]} ({unit})", ylabel=f"{'xyz'[up]} ({unit})")
        width = 2 * factor * size[order] * scale
        colours = np.array([_colour(c) for c in range(len(names))])[kind[order].astype(int)]
        axes.add_collection(EllipseCollection(width, width, np.zeros(len(width)), units="x", facecolors=colours, alpha=0.75,
                                              linewidths=0, offsets=centre[order][:, [across, up]] * scale,
                                              offset_transform=axes.transData))
        for c, name in enumerate(names[:12]):
            axes.plot([], [], "o", color=_colour(c), alpha=0.75, linestyle="none", label=name)
        axes.grid(False)
        axes.set_title(f"{len(inside):,} of {len(position):,} particles")
        if len(names) > 1:
            figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper")

    thick = 2 * half * scale
    caption = (f"Particles whose centres lie in a layer {thick:.3g} {unit} thick across {'xyz'[depth]}, "
               + ("in their true sizes." if factor == 1 else f"their radii drawn {factor:.3g} times as large as they are."))
    high = 5.6 * min(1.6, max(0.35, box[up] / box[across]))
    columns = tuple((f"{name} [m]", centre[:, axis]) for axis, name in enumerate("xyz"))
    return Picture("discrete_slab", "A layer of the realisation", caption, (6.4 + (len(names) > 1), high), draw,
                   (*columns, ("radius [um]", 1e6 * size), ("component", kind)))


def sizes(group: Group) -> Picture:
    """How many particles each class has, beside what the law expects."""
    classes = classes_of(group)
    total = len(group["position"].data)
    number = np.zeros(len(classes.radius))
    for c in range(len(classes.names)):
        chosen = np.flatnonzero(classes.component == c)
        held, count = np.unique(group["radius"].data[group["component"].data == c], return_counts=True)
        number[chosen[np.searchsorted(classes.radius[chosen].astype(np.float32), held)]] = count
    law = total * classes.share
    mean, area = (float(np.sum(number * value) / total) for value in (classes.radius, np.pi * classes.radius**2))

    def draw(figure):
        axes = figure.subplots()
        for c, name in enumerate(classes.names[:12]):
            chosen = classes.component == c
            axes.errorbar(classes.radius[chosen], law[chosen], np.sqrt(law[chosen] * (1 - classes.share[chosen])),
                          fmt="none", ecolor=FAINT, elinewidth=5, zorder=1)
            axes.plot(classes.radius[chosen], law[chosen], "-", color=_colour(c), linewidth=1.2, zorder=2)
            axes.plot(classes.radius[chosen], np.where(number[chosen] > 0, number[chosen], np.nan), _MARKS[c % len(_MARKS)],
                      color=_colour(c), markersize=4.5, label=name, zorder=3)
        axes.set(xlabel="radius of the class (µm)", ylabel="particles")
        positive_axis(axes, law)
        if axes.get_yscale() == "log":
            axes.set_ylim(max(0.5, 0.5 * law.min()), 3 * law.max())
        if classes.radius.max() > 1.5 * classes.radius.min():
            axes.set_xscale("log")
            plain_decades(axes.xaxis)
        axes.set_title("Particles of each class")
        if len(classes.names) > 1:
            axes.legend()

    caption = (f"Marks: particles that are there, mean radius {mean:.4g} µm, mean cross section {area:.4g} µm².  Lines: what the "
               "law of sizes expects; grey: one standard deviation.")
    return Picture("discrete_sizes", "Sizes of the particles", caption, (6.0, 4.0), draw,
                   (("radius [um]", classes.radius), ("component", classes.component), ("particles", number), ("expected", law)))


def counts(group: Group) -> Picture:
    """Counts of particles in cells beside the Poisson law."""
    edges, seen, law = (group[name].data for name in ("cell_edge", "cell_count", "cell_count_law"))
    value, error = (float(group[name].data[0]) for name in ("cell_dispersion", "cell_dispersion_error"))
    width = edges[1] - edges[0]

    def draw(figure):
        from matplotlib.ticker import MaxNLocator

        axes = figure.subplots()
        middle = edges[:-1] + (width - 1) / 2
        axes.bar(middle, seen, 0.9 * width, color=FAINT, edgecolor=QUIET, linewidth=0.6, label="counted")
        axes.errorbar(middle, law, np.stack([np.minimum(np.sqrt(law), law), np.sqrt(law)]), fmt="o", color=INK, markersize=3.5,
                      linewidth=1, label="Poisson")
        shown = middle[(seen > 0) | (law > 0.5)]
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        axes.set(xlabel="particles in a cell", ylabel="cells", ylim=(0, None),
                 xlim=(shown.min() - 1.5 * width, shown.max() + 1.5 * width))
        axes.set_title("Counts in cells")
        axes.legend()

    caption = (f"Particles in {seen.sum():,.0f} cells, and the Poisson law of their expectations with the deviation that chance "
               f"brings.  Variance over its expectation {value:.4g}, by chance 1 ± {error:.2g}.")
    return Picture("discrete_counts", "Counts of particles", caption, (6.0, 3.8), draw,
                   (("from", edges[:-1]), ("cells", seen), ("expected", law)))


def grains(group: Group, um) -> Picture:
    """Relative deviation of a pixel against the distance of the medium."""
    from bakery.physics.discrete import graininess
    from bakery.physics.medium.phase import phase_at

    classes, density, box = classes_of(group), float(group["number_density"].data[0]), group["box"].data
    k = int(np.argsort(um, kind="stable")[len(um) // 2])
    table = phase_at(classes.theta, classes.phase[k].astype(float), np.radians(_ANGLES))
    mean, square = graininess.mixture_moments(classes.share, classes.scattering[k:k + 1], classes.spread[k:k + 1], table[None])
    deep = float(box.max())
    sigma_t = density * float(group["law_extinction"].data[k]) * 1e-12
    near = deep * np.geomspace(1e-3, 1e3, 121)
    pixel = graininess.pixel_solid_angle(_FIELD, _PIXELS)
    deviation = np.sqrt(graininess.relative_variance(mean[0][:, None], square[0][:, None], density, sigma_t, near, near + deep,
                                                     pixel))
    disc = math.sqrt(float(classes.extinction[k].max()) / math.pi) * 1e-6
    fills = 2 * disc / math.sqrt(pixel)  # m, where the largest disc is as wide as a pixel

    def draw(figure):
        axes = figure.subplots()
        for angle, row, ink in zip(_ANGLES, deviation, NEUTRAL, strict=True):
            axes.plot(near, row, color=ink, label=f"{angle}°")
        axes.axhline(0.01, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)))
        axes.annotate("1 %", (near[0], 0.01), xytext=(3, 3), textcoords="offset points", color=QUIET, fontsize=8.5)
        if near[0] < fills < near[-1]:
            axes.axvspan(near[0], fills, color=FAINT, alpha=0.6, linewidth=0)
        axes.set(xscale="log", yscale="log", xlabel="distance to the medium (m)", ylabel="deviation of a pixel over its mean",
                 xlim=(near[0], near[-1]))
        axes.set_title(f"Graininess: {um[k]:g} µm")
        axes.legend(title="scattering angle")

    caption = (f"Relative standard deviation, over realisations, of a pixel that looks through {deep:.3g} m of the medium "
               f"(optical depth {sigma_t * deep:.3g}), by Campbell's theorem: single scattering of a light from afar that "
               f"arrives unweakened, pixels of {1e3 * math.sqrt(pixel):.3g} mrad (field of view {math.degrees(_FIELD):g}°, "
               f"{_PIXELS} pixels).  Grey: there the largest disc is wider than a pixel, and pixels deviate less than drawn.")
    return Picture("discrete_graininess", "Predicted graininess", caption, (6.4, 4.2), draw,
                   (("distance [m]", near), *((f"deviation at {angle} deg", row) for angle, row in zip(_ANGLES, deviation))))


def _colour(component: int) -> str:
    return (NEUTRAL[0], "#1f77a4", "#b3541e", "#2f8f5b", "#8a4fbf", "#a08a1e")[component % 6]


def _unit(length: float) -> tuple[float, str]:
    """A unit in which a length in m is a handy number."""
    return next((scaled for least, *scaled in ((1.0, 1.0, "m"), (0.01, 100.0, "cm"), (1e-3, 1e3, "mm")) if length >= least),
                [1e6, "µm"])
