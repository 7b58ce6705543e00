"""Pictures of packed tiles: the spheres themselves, their pair correlation, the chords between them."""

from collections.abc import Iterator

import numpy as np

from bakery.draw.picture import Picture
from bakery.draw.style import FAINT, INK, NEUTRAL, QUIET
from bakery.draw.view import looking_from
from bakery.stages.packing.view import tiles
from bakery.store.tree import Group

EQUAL = 1e-9  # relative spread below which radii count as equal
_SAND, _PALE = np.array([0.80, 0.33, 0.06]), np.array([0.68, 0.74, 0.82])
_SMALL, _LARGE = np.array([0.04, 0.30, 0.42]), np.array([0.85, 0.36, 0.07])


def pictures(root: Group) -> Iterator:
    """Every picture of a `packing` group: three of a tile, three of all tiles of a dictionary together."""
    packed = list(tiles(root["packing"]).values())
    if len(packed) == 1:
        yield spheres(packed[0])
        if "pair_correlation" in packed[0].members:
            yield pair_correlation(packed[0])
        yield chord_length(packed[0])
    elif packed:
        yield from dictionary(packed)


def rendered(centers, radii, cell, pixels: int = 640) -> tuple[np.ndarray, tuple[float, float, float, float], np.ndarray]:
    """The tile from a corner, with three of its periodic images behind it.

    Parameters
    ----------
    centers : (N, 3), radii : (N,), cell : (3,)
    pixels : width of the image

    Returns
    -------
    image : (H, W, 4) uint8, sRGB and coverage, first row on top
    extent : left, right, bottom, top in the plane of the view, same unit as the cell
    corners : (8, 2) corners of the cell in that plane, the nearest one last
    """
    from bakery.draw import spheres as drawing

    centers, radii, cell = (np.asarray(a, float) for a in (centers, radii, cell))
    shifts = np.array([(0, 0, 0), (-1, 0, 0), (0, -1, 0), (-1, -1, 0)]) * cell
    view = looking_from(np.array([1.0, 0.72, 0.62]))
    seen, radius = (np.mod(centers, cell) + shifts[:, None]).reshape(-1, 3) @ view.T, np.tile(radii, 4)
    colour = np.concatenate([_colours(radii), np.tile(0.9 * _PALE + 0.1 * _colours(radii), (3, 1))])
    low, high = (seen[:, :2] - radius[:, None]).min(0), (seen[:, :2] + radius[:, None]).max(0)
    margin = 0.02 * (high - low).max()
    low, high = low - margin, high + margin
    pixel = (high[0] - low[0]) / pixels
    height = int(np.ceil((high[1] - low[1]) / pixel))
    image = drawing.rendered(seen, radius, colour, low, pixel, pixels, height)
    box = np.array(np.meshgrid(*[(0, 1)] * 3, indexing="ij")).reshape(3, -1).T * cell
    return image, (low[0], high[0], low[1], low[1] + height * pixel), (box @ view.T)[:, :2]


def spheres(tile: Group):
    """The tile as it would look in the light of sun and sky."""
    centers, radii, fraction = tile["centers"].data, tile["radii"].data, _fraction(tile)

    def draw(figure):
        axes = figure.add_subplot()
        _show(axes, tile, 640)
        axes.set_title(f"{_kind(radii).capitalize()}, fraction {fraction:.4g}")

    return Picture("tile", "Tile", f"In colour {_kind(radii)}, filling {100 * fraction:.4g} % of the cell whose edges are "
                   "drawn; behind it, pale, three of its periodic images.",
                   (7.4, 6.0), draw, (*((f"{axis} [mean radius]", centers[:, k]) for k, axis in enumerate("xyz")),
                                      ("radius [mean radius]", radii)))


def pair_correlation(tile: Group):
    """g2 with its error."""
    group, fraction = tile["pair_correlation"], _fraction(tile)
    columns = [(heading, group[name].data) for heading, name in
               (("r [mean radius]", "r"), ("g [1]", "g"), ("standard error of g [1]", "g_error"))]

    def draw(figure):
        axes = figure.subplots()
        _draw_g2(axes, tile)
        axes.set(xlabel="distance of centres (mean radii)", ylabel="g₂")
        axes.set_title(f"Pair correlation at fraction {fraction:.4g}")
        axes.legend(loc="upper right")

    return Picture("pair_correlation", "Pair correlation", "Density of centres around a sphere's centre over the mean "
                   "density, on a square-root axis; the band is what other tiles of the kind would differ by.",
                   (7.6, 4.2), draw, tuple(columns))


def chord_length(tile: Group):
    """Chords between spheres against Dixmier's law."""
    group, fraction = tile["chord_length"], _fraction(tile)
    edges, density, error = (group[name].data for name in ("edges", "density", "density_error"))
    mean, law = _exponential(group)
    last = min(edges[-1], 8.5 * mean)

    def draw(figure):
        chords, tail = figure.subplots(1, 2, width_ratios=(1.35, 1))
        chords.fill_between(edges, *(np.append(v, v[-1]) for v in (np.maximum(density - error, 1e-9 / mean), density + error)),
                          step="post", color=NEUTRAL[1], alpha=0.22, linewidth=0)
        chords.stairs(density, edges, baseline=None, color=NEUTRAL[1], linewidth=1.4, label="this tile")
        ends = np.array([0.0, last])
        chords.plot(ends, np.exp(-ends / mean) / mean, color=INK, linewidth=1.1, label="Dixmier: exponential")
        shown = density[(density > 0) & (edges[1:] <= last)]
        chords.set(yscale="log", xlim=(0, last), xlabel="chord (mean radii)", ylabel="probability density",
                 ylim=(0.3 * min(shown.min(), np.exp(-last / mean) / mean), 3 * density.max()))
        chords.set_title(f"Chords between spheres at fraction {fraction:.4g}")
        chords.legend(loc="upper right")
        near = 5 * mean  # further out there is little to see but noise
        tail.axhline(1, color=INK, linewidth=1.1)
        tail.fill_between(edges, *(np.append(v, v[-1]) for v in ((density - error) / law, (density + error) / law)), step="post",
                           color=NEUTRAL[1], alpha=0.22, linewidth=0)
        tail.stairs(density / law, edges, baseline=None, color=NEUTRAL[1], linewidth=1.4)
        tail.axvline(mean, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)))
        tail.annotate(" mean", (mean, 0.02), xycoords=("data", "axes fraction"), color=QUIET, fontsize=8.5)
        tail.set(xlim=(0, near), ylim=(0, 1.15 * float(np.max((density / law)[edges[1:] <= near]))), xlabel="chord (mean radii)")
        tail.set_title("Over Dixmier's law")
        tail.grid(color=FAINT)

    return Picture("chord_length", "Chord lengths", "Lengths between spheres along random straight lines.  Dixmier's law "
                   f"is exponential with the exact mean, {mean:.4g} mean radii.", (9.8, 4.1), draw,
                   (("from [mean radius]", edges[:-1]), ("to [mean radius]", edges[1:]), ("density [1/mean radius]", density),
                    ("standard error of density [1/mean radius]", error), ("Dixmier [1/mean radius]", law)))


def dictionary(packed: list[Group]) -> Iterator:
    """A sheet of all tiles, their pair correlations and their chords, one colour a fraction."""
    from matplotlib import colormaps

    fractions = np.array([_fraction(tile) for tile in packed])
    colours = colormaps["viridis"](0.9 * (1 - np.arange(len(packed)) / max(len(packed) - 1, 1)))
    across = min(len(packed), max(3, round(np.sqrt(1.5 * len(packed)))))
    down = -(-len(packed) // across)

    def sheet(figure):
        panels = np.atleast_1d(figure.subplots(down, across)).ravel()
        for axes, tile in zip(panels, packed, strict=False):
            _show(axes, tile, 320)
            axes.set_title(f"{_fraction(tile):.4g}")
        for axes in panels[len(packed):]:
            axes.set_axis_off()

    names = ("fraction", "contacts_per_sphere", "contacts_per_sphere_error", "rattlers", "bond_order", "bond_order_random",
             "bond_order_local", "smallest_gap")
    yield Picture("tiles", "Tiles", "Each tile in colour; behind it, pale, three of its periodic images.",
                  (3.4 * across, 0.4 + 2.7 * down), sheet,
                  tuple((f"{name} [1]", np.array([tile[name].data[0] for tile in packed])) for name in names))

    correlated = [tile for tile in packed if "pair_correlation" in tile.members]

    def multiples(figure):
        panels = np.atleast_1d(figure.subplots(down, across)).ravel()
        for axes, tile in zip(panels, correlated, strict=False):
            _draw_g2(axes, tile)
            axes.set_title(f"{_fraction(tile):.4g}")
        for axes in panels[len(correlated):]:
            axes.set_axis_off()
        panels[0].legend(loc="upper right")
        figure.supxlabel("distance of centres (mean radii)", fontsize=9.5)
        figure.supylabel("g₂", fontsize=9.5)

    if correlated:
        yield Picture("pair_correlation", "Pair correlation", "Density of centres around a sphere's centre over the mean "
                      "density, on a square-root axis.",
                      (2.9 * across, 0.6 + 2.1 * down), multiples, _long(correlated, "pair_correlation", ("g", "g_error")))

    def over_law(figure):
        axes = figure.subplots()
        axes.axhline(1, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
        for tile, f, colour in zip(packed, fractions, colours, strict=True):
            edges, density = tile["chord_length/edges"].data, tile["chord_length/density"].data
            mean, law = _exponential(tile["chord_length"])
            axes.plot(0.5 * (edges[1:] + edges[:-1]) / mean, density / law, color=colour, linewidth=1.3, label=f"{f:.4g}")
        axes.set(xlim=(0, 5), ylim=(0, None), xlabel="chord over its mean", ylabel="density over Dixmier's law")
        axes.set_title("Chords between spheres")
        figure.legend(*axes.get_legend_handles_labels(), title="fraction", title_fontsize=9, loc="outside right upper")

    yield Picture("chord_length", "Chord lengths", "Lengths between spheres along random straight lines, over Dixmier's law, "
                  "which is exponential with the exact mean.", (7.8, 4.4), over_law,
                  _long(packed, "chord_length", ("density", "density_error")))


def _draw_g2(axes, tile: Group) -> None:
    """g2 with its error."""
    group = tile["pair_correlation"]
    edges, g, error = (group[name].data for name in ("edges", "g", "g_error"))
    axes.axhline(1, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
    axes.fill_between(edges, *(np.append(v, v[-1]) for v in (g - error, g + error)), step="post", color=NEUTRAL[1], alpha=0.22,
                      linewidth=0, label="± standard error")
    axes.stairs(g, edges, baseline=None, color=NEUTRAL[1], linewidth=1.4, label="this tile")
    # square roots: spheres in contact are many times as frequent as any other distance, and all of it is to be seen
    axes.set_yscale("function", functions=(lambda x: np.sqrt(np.maximum(x, 0)), np.square))
    axes.set(xlim=(edges[0], edges[-1]), ylim=(0, 1.08 * float((g + error).max())))


def _exponential(chords: Group) -> tuple[float, np.ndarray]:
    """The exact mean that the bake stored, and the density in each bin of the exponential law with it: Dixmier's."""
    mean, edges = float(chords["mean_exact"].data[0]), chords["edges"].data
    return mean, (np.exp(-edges[:-1] / mean) - np.exp(-edges[1:] / mean)) / np.diff(edges)


def _long(tiles, group: str, names) -> tuple:
    """Columns of all tiles below each other."""
    sizes = [tile[f"{group}/{names[0]}"].data.size for tile in tiles]
    edges = [tile[f"{group}/edges"].data for tile in tiles]
    return (("fraction [1]", np.repeat([_fraction(tile) for tile in tiles], sizes)),
            ("from [mean radius]", np.concatenate([e[:-1] for e in edges])),
            ("to [mean radius]", np.concatenate([e[1:] for e in edges])),
            *((f"{name} [1]", np.concatenate([tile[f"{group}/{name}"].data for tile in tiles])) for name in names))


def _show(axes, tile: Group, pixels: int) -> None:
    """The rendered tile with the edges of its cell that can be seen."""
    image, extent, corners = rendered(*(tile[name].data for name in ("centers", "radii", "cell")), pixels)
    axes.imshow(image, extent=extent, interpolation="antialiased", zorder=1)
    for a, b in ((7, 6), (7, 5), (7, 3), (6, 4), (6, 2), (5, 4), (5, 1), (3, 2), (3, 1)):
        axes.plot(*corners[[a, b]].T, color=INK, linewidth=0.9, alpha=0.75, zorder=2)
    axes.set_axis_off()


def _fraction(tile: Group) -> float:
    return float(tile["fraction"].data[0])


def _equal(radii) -> bool:
    return bool(np.ptp(radii) <= EQUAL * np.max(radii))


def _kind(radii) -> str:
    if len(radii) == 1:
        return "one sphere"
    sizes = "equal spheres" if _equal(radii) else f"spheres of {radii.min():.2g} to {radii.max():.2g} times the mean radius"
    return f"{len(radii):,} {sizes}"


def _colours(radii) -> np.ndarray:
    """One linear colour a sphere: shades of sand for equal ones, else by radius."""
    golden = np.modf(0.618033988749895 * np.arange(len(radii)))[0][:, None]
    if _equal(radii):
        return _SAND * (0.80 + 0.35 * golden) + np.array([0.02, 0.03, 0.06]) * golden
    log = np.log(radii)
    at = ((log - log.min()) / np.ptp(log))[:, None]
    return ((1 - at) * _SMALL + at * _LARGE) * (0.88 + 0.2 * golden)
