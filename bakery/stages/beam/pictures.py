"""Pictures of narrow beams: the baked kernels in false colour, along the radius, and the errors that the bake measured.

Lengths are mean free paths.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bakery.draw.axes import labels, rows_of_errors
from bakery.draw.picture import Picture
from bakery.draw.style import FAINT, INK, colours
from bakery.physics.beam.kinds import MEASURES
from bakery.stages.beam.view import tables_of
from bakery.store.tree import Group

_FARTHEST, _CELLS = 5.0, 50  # mfp; planes, and rings, of a map
_HELD = 0.95  # of the forward light at the last plane within the rings
_DECADES = 3  # of the colour scale
_LEAST = 0.1  # percent, errors below are drawn there
# table -> its name in words, colour, line
SHOWN = {"fluence": ("all directions", INK, "-"), "forward": ("forward, fluence", "#1f77a4", "-"),
         "flux": ("forward, flux", "#b3541e", "-"), "small_angle": ("small-angle model", "#2f8f5b", (0, (5, 2)))}
_MARKS = ("o", "s", "D")


@dataclass(frozen=True)
class Shown:
    """The tables of one wavelength, averaged over rings."""

    um: float  # wavelength
    depth: np.ndarray  # (D,) mfp
    edges: np.ndarray  # (R + 1,) mfp, of the rings
    spread: dict[str, np.ndarray]  # name in `SHOWN` -> (D, R) 2 pi r Psi, 1/mfp
    error: dict[str, float]  # name -> relative root mean square difference from photons, where the bake measured it

    @property
    def radius(self) -> np.ndarray:
        return 0.5 * (self.edges[1:] + self.edges[:-1])


def pictures(root: Group) -> Iterator:
    """Maps and sections at the middle one of the wavelengths that scatter, errors at all of them."""
    group = root["beam"]
    um = root["wavelength"].data
    wavelengths = [int(k) for k in np.argsort(um, kind="stable") if group["forward"].data[k].any()]
    if not wavelengths:
        return
    shown = looked_up(group, um, wavelengths[len(wavelengths) // 2])
    yield maps(shown)
    yield sections(shown)
    yield errors(group, um, wavelengths)


def looked_up(group: Group, um, k: int) -> Shown:
    """The tables at wavelength number k, on planes to 5 mfp, or as deep as they go, and rings that hold most of the light."""
    tables = {name: tables_of(group, name)[k] for name in SHOWN}
    table = tables["forward"]
    deepest = min(_FARTHEST, float(table.depth[-1]))
    radius = deepest * np.geomspace(1e-5, 1, 400)
    within = table.within(deepest, radius)
    reach = float(np.interp(_HELD, within / within[-1], radius))
    edges = np.linspace(0, deepest if reach > deepest / 2 else reach, _CELLS + 1)
    depth = deepest * np.arange(1, _CELLS + 1) / _CELLS
    ring = np.pi * (edges[1:] + edges[:-1])
    error = {name: float(group[f"{name}_rms"].data[k]) for name in SHOWN if f"{name}_rms" in group.members}
    return Shown(float(um[k]), depth, edges, {name: ring * table.rings(depth, edges) for name, table in tables.items()}, error)


def maps(shown: Shown):
    """2 pi r Psi over depth and distance from the axis, of each table in the same colours."""
    top = float(np.percentile(shown.spread["fluence"], 99.7))
    step = shown.depth[1] - shown.depth[0]

    def draw(figure):
        from matplotlib.colors import LogNorm

        norm = LogNorm(top / 10**_DECADES, top, clip=True)
        panels = figure.subplots(2, 2, sharex=True, sharey=True)
        for axes, (name, value) in zip(panels.flat, shown.spread.items(), strict=True):
            shade = axes.imshow(np.concatenate([value.T[::-1], value.T]), norm=norm, cmap="inferno", aspect="auto",
                                interpolation="nearest", origin="lower",
                                extent=(step / 2, shown.depth[-1] + step / 2, -shown.edges[-1], shown.edges[-1]))
            error = f": {_percent(shown.error[name])} %" if name in shown.error else ""
            axes.set_title(SHOWN[name][0].capitalize() + error)
            axes.grid(False)
        for axes in panels[-1]:
            axes.set_xlabel("depth z (mfp)")
        for axes in panels[:, 0]:
            axes.set_ylabel("r (mfp)")
            axes.yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
        figure.colorbar(shade, ax=panels, shrink=0.85, pad=0.015, label="2π r Ψ (1/mfp)", extend="both")
        figure.suptitle(f"Spread of a narrow beam: {shown.um:g} µm", x=0.01, ha="left", fontsize=10.5, fontweight="bold")

    caption = ("Scattered light in rings around a beam of power 1 that enters at the left, from the asset's tables: that of all "
               "directions, that which goes on forward as fluence and as power through a surface across the beam (flux), and the "
               "small-angle model.")
    if shown.error:
        caption += "  Percent: root mean square difference from photons that the bake counted, less their noise."
    z, r = np.meshgrid(shown.depth, shown.radius, indexing="ij")
    columns = (("z [mfp]", z), ("r [mfp]", r), *((f"{SHOWN[name][0]} [1/mfp]", value) for name, value in shown.spread.items()))
    return Picture("beam_maps", "Narrow beam", caption, (8.6, 5.8), draw,
                   tuple((head, column.ravel()) for head, column in columns))


def sections(shown: Shown):
    """2 pi r Psi against r at three depths."""
    rows = [len(shown.depth) // 5 - 1, len(shown.depth) // 2 - 1, len(shown.depth) - 1]
    r = shown.radius

    def draw(figure):
        panels = figure.subplots(1, 3, sharex=True)
        for axes, i in zip(panels, rows, strict=True):
            for name, (label, ink, line) in SHOWN.items():
                axes.plot(r, shown.spread[name][i], color=ink, linestyle=line, linewidth=1.5, label=label)
            top = max(value[i].max() for value in shown.spread.values())
            axes.set(yscale="log", xlabel="r (mfp)", xlim=(0, shown.edges[-1]), ylim=(top / 10**_DECADES, 2 * top))
            axes.set_title(f"depth {shown.depth[i]:.3g} mfp")
        panels[0].set_ylabel("2π r Ψ (1/mfp)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
        figure.suptitle(f"Spread of a narrow beam: {shown.um:g} µm", x=0.01, ha="left", fontsize=10.5, fontweight="bold")

    columns = (("z [mfp]", np.repeat(shown.depth[rows], r.size)), ("r [mfp]", np.tile(r, len(rows))),
               *((f"{SHOWN[name][0]} [1/mfp]", value[rows].ravel()) for name, value in shown.spread.items()))
    return Picture("beam_sections", "Narrow beam along the radius", "Scattered light per distance from the axis at three depths, "
                   "from the asset's tables, averaged over rings.", (9.6, 3.9), draw, columns)


def errors(group: Group, um, wavelengths: list[int]):
    """The errors against photons that the bake stored, at each wavelength."""
    values = {name: tuple(100 * group[f"{name}_{end}"].data[wavelengths] for end in ("rms", "noise")) for name in MEASURES}
    ink = colours(um[wavelengths])

    def draw(figure):
        axes = figure.subplots()
        at = -np.arange(len(wavelengths), dtype=float)
        for name, mark, shift in zip(MEASURES, _MARKS, (0.2, 0.0, -0.2), strict=True):
            error, noise = values[name]
            axes.hlines(at + shift, _LEAST, np.maximum(noise, _LEAST), color=FAINT, linewidth=5, zorder=1)
            axes.scatter(np.maximum(error, _LEAST), at + shift, marker=mark, color=ink, s=28, zorder=3, clip_on=False)
            axes.plot([], [], mark, color=INK, markersize=5, linestyle="none", label=SHOWN[name][0])
        axes.plot([], [], color=FAINT, linewidth=5, label="noise of the photons")
        axes.set_xlim(_LEAST, 2 * max(*(value.max() for pair in values.values() for value in pair), 5 * _LEAST))
        rows_of_errors(figure, axes, labels(um[wavelengths]), "error (%)")

    columns = [("wavelength [um]", um[wavelengths])]
    columns += [(f"{SHOWN[name][0]} {end} [%]", column) for name, pair in values.items()
                for end, column in zip(("error", "noise"), pair, strict=True)]
    return Picture("beam_errors", "Narrow beam: errors", "Root mean square difference of 2π r Ψ from the photons that the bake "
                   f"counted, relative, less their noise (grey; what lies in it may be 0).  Below {_LEAST:g} % drawn there.",
                   (7.0, 1.5 + 0.4 * len(wavelengths)), draw, tuple(columns))


def _percent(share: float) -> str:
    return f"{100 * share:.2g}" if share < 0.995 else f"{100 * share:.0f}"
