"""Draws the narrow beams of an asset beside counted photons and other models: python benchmarks/beam_pictures.py ASSET [-o DIR]

Kernels in false colour, along the radius, and their errors, each as PNG with its data as CSV; 1 to 3 s a wavelength.
All is light that goes on forward, which every kernel knows.  Lengths are mean free paths.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bakery.draw.picture import Picture
from bakery.draw.style import FAINT, INK, QUIET, colours
from bakery.physics.beam import named, photons, single
from bakery.stages.beam.view import kernels_of
from bakery.store.tree import Group
from benchmarks.sizes import sized
from tests.oracles import beam as oracle

_FARTHEST, _CELLS, _EVERY = 5.0, 50, 5  # mfp; planes, and rings, of a map; every fifth plane is one of errors
_PHOTONS = sized(100_000, 3200)
_HELD = 0.95  # of the forward light at the last plane within the rings
_MOST = 8  # wavelengths whose errors are drawn
_SEED = 11
_DECADES = 3  # of the colour scale
_LEAST = 0.1  # percent, errors below are drawn there
_SURE = 0.15  # relative standard error above which a point is left out
# kernel -> its name in words, colour, line
SHOWN = {"best": ("transport", "#1f77a4", "-"), "small_angle_absorbing": ("small-angle, absorption", "#2f8f5b", "-"),
         "erf": ("error function", "#b3541e", "-"), "path_integral": ("path integral", "#8a4fbf", (0, (5, 2))),
         "elek": ("Elek et al., approximate", "#c2378a", (0, (2, 1.5))), "single": ("scattered once", QUIET, (0, (1, 1.2)))}
_MAPS = ("best", "erf", "small_angle_absorbing", "path_integral", "elek")


@dataclass(frozen=True)
class Shown:
    """One wavelength: its kernels and what photons counted, on planes and rings."""

    um: float
    kernels: named.Kernels
    counted: photons.Counted

    def label(self, name: str) -> str:
        return "small-angle model" if name == "best" and not self.kernels.transport else SHOWN[name][0]

    def rings(self, name: str, measure: str = "fluence") -> np.ndarray:
        """(D, R) mfp^-2: a kernel's forward light averaged over the rings, as fluence or as flux."""
        depth, edges = self.counted.depth, self.counted.edges
        if name == "best":
            return self.kernels.rings(depth, edges, "forward" if measure == "fluence" else "flux")
        if name == "single":
            which = ("fluence", "flux").index(measure)
            albedo, line = self.kernels.albedo, self.kernels.line
            return named.ring_averages(lambda z, r: single.single(albedo, line, z, r)[0][which], depth, edges)
        return self.kernels.rings(depth, edges, name)


def pictures(root: Group) -> Iterator:
    """Maps and sections at the middle one of the wavelengths that scatter, errors at all of them (eight at most)."""
    medium, group = root.members.get("medium"), root["beam"]
    if not isinstance(medium, Group) or not {"theta", "phase", "albedo"} <= medium.members.keys() \
            or not {"depth", "ratio", "model", "gaussian_b", *named.TABLES} <= group.members.keys():
        return
    um = root["wavelength"].data
    sets = kernels_of(group, medium)
    lit = [int(k) for k in np.argsort(um, kind="stable") if sets[k].albedo > 0]
    if not lit:
        return
    middle = lit[len(lit) // 2]
    chosen = sorted({lit[round(i)] for i in np.linspace(0, len(lit) - 1, min(len(lit), _MOST))} | {middle}, key=lit.index)
    shown = counted(float(um[middle]), sets[middle], _CELLS)
    yield maps(shown)
    yield sections(shown)
    yield errors([shown if k == middle else counted(float(um[k]), sets[k], _CELLS // _EVERY) for k in chosen], shown.um)


def counted(um: float, kernels: named.Kernels, planes: int) -> Shown:
    """Follows photons through a number of planes to 5 mfp, or as deep as the tables go, and rings that hold most of the light."""
    deepest = min(_FARTHEST, float(kernels.table("forward").depth[-1]))
    table = kernels.table("forward")
    radius = deepest * np.geomspace(1e-5, 1, 400)
    within = table.within(deepest, radius)
    reach = float(np.interp(_HELD, within / within[-1], radius))
    reach = deepest if reach > deepest / 2 else reach
    found = oracle.count(kernels.albedo, kernels.theta, kernels.phase, deepest * np.arange(1, planes + 1) / planes,
                          np.linspace(0, reach, _CELLS + 1), _PHOTONS, seed=_SEED, back=False)
    return Shown(um, kernels, found)


def maps(shown: Shown):
    """2 pi r Psi over depth and distance from the axis: photons, and kernels in the same colours."""
    at = shown.counted
    ring = 2 * np.pi * at.radius
    seen = {"photons": ring * at.fluence} | {name: ring * shown.rings(name) for name in _MAPS}
    top = float(np.percentile(seen["photons"], 99.7))
    error = {name: photons.rms(value / ring, at, "fluence")[0] for name, value in seen.items() if name != "photons"}
    step = at.depth[1] - at.depth[0]

    def draw(figure):
        from matplotlib.colors import LogNorm

        norm = LogNorm(top / 10**_DECADES, top, clip=True)
        panels = figure.subplots(2, 3, sharex=True, sharey=True)
        for axes, (name, value) in zip(panels.flat, seen.items(), strict=True):
            shade = axes.imshow(np.concatenate([value.T[::-1], value.T]), norm=norm, cmap="inferno", aspect="auto",
                                interpolation="nearest", origin="lower",
                                extent=(step / 2, at.depth[-1] + step / 2, -at.edges[-1], at.edges[-1]))
            axes.set_title("photons" if name == "photons" else f"{shown.label(name)}: {_percent(error[name])} %")
            axes.grid(False)
        for axes in panels[-1]:
            axes.set_xlabel("depth z (mfp)")
        for axes in panels[:, 0]:
            axes.set_ylabel("r (mfp)")
            axes.yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
        figure.colorbar(shade, ax=panels, shrink=0.85, pad=0.015, label="2π r Ψ (1/mfp)", extend="both")
        figure.suptitle(f"Spread of a narrow beam: {_words(shown)}", x=0.01, ha="left", fontsize=10.5, fontweight="bold")

    noise = 100 * photons.rms(at.fluence, at, "fluence")[1]
    said = (f"Scattered light that goes on forward, in rings around a beam of power 1 that enters at the left: "
            f"{_number(at.photons)} photons counted ({noise:.2g} % noise), and kernels in the same colours.  Percent: root mean "
            "square difference from the photons over the map, less their noise.")
    heads = ["z [mfp]", "r [mfp]", "photons [1/mfp]", "photons standard error [1/mfp]"]
    z, r = np.meshgrid(at.depth, at.radius, indexing="ij")
    columns = [z, r, seen["photons"], ring * at.fluence_error] + [seen[name] for name in seen if name != "photons"]
    heads += [f"{shown.label(name)} [1/mfp]" for name in seen if name != "photons"]
    return Picture("beam_photons_maps", "Narrow beam: kernels beside photons", said, (11.4, 5.8), draw,
                   tuple((head, column.ravel()) for head, column in zip(heads, columns, strict=True)))


def sections(shown: Shown):
    """2 pi r Psi against r at three depths, with counted photons."""
    at, names = shown.counted, list(SHOWN)
    ring = 2 * np.pi * at.radius
    rows = [len(at.depth) // 5 - 1, len(at.depth) // 2 - 1, len(at.depth) - 1]
    curves = {name: ring * shown.rings(name) for name in names}
    value, error = ring * at.fluence, ring * at.fluence_error

    def draw(figure):
        panels = figure.subplots(1, 3, sharex=True)
        for axes, i in zip(panels, rows, strict=True):
            for name in names:
                axes.plot(at.radius, curves[name][i], color=SHOWN[name][1], linestyle=SHOWN[name][2],
                          linewidth=2.2 if name == "best" else 1.3, label=shown.label(name))
            sure = error[i] < _SURE * value[i]
            axes.errorbar(at.radius[sure], value[i][sure], yerr=error[i][sure], fmt="o", color=INK, markersize=2.6,
                          elinewidth=0.9, capsize=1.5, linestyle="none", label="photons")
            low = value[i][sure].min() if sure.any() else curves["best"][i].max() / 1e3
            axes.set(yscale="log", xlabel="r (mfp)", xlim=(0, at.edges[-1]),
                     ylim=(0.5 * low, 2 * max(curve[i].max() for curve in curves.values())))
            axes.set_title(f"depth {at.depth[i]:.3g} mfp")
        panels[0].set_ylabel("2π r Ψ (1/mfp)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
        figure.suptitle(f"Kernels (lines) and photons (points): {_words(shown)}", x=0.01, ha="left", fontsize=10.5,
                        fontweight="bold")

    said = ("Scattered light that goes on forward, per distance from the axis, at three depths; "
            f"{_number(at.photons)} photons with standard errors, both averaged over the same rings.  Points whose standard "
            f"error is above {100 * _SURE:g} % are left out.")
    columns = [("z [mfp]", np.repeat(at.depth[rows], at.radius.size)), ("r [mfp]", np.tile(at.radius, len(rows))),
               ("photons [1/mfp]", value[rows].ravel()), ("photons standard error [1/mfp]", error[rows].ravel())]
    columns += [(f"{shown.label(name)} [1/mfp]", curves[name][rows].ravel()) for name in names]
    return Picture("beam_photons_sections", "Narrow beam along the radius", said, (11.4, 4.6), draw, tuple(columns))


def errors(all_shown: list[Shown], drawn: float):
    """Root mean square difference from photons: of each plane at one wavelength, and over all planes at each."""
    every = [(one.um, name, measure, *_planes(one, name, measure)[1])
             for one in all_shown for name in SHOWN for measure in ("fluence", "flux")]
    names = {name: " or ".join(dict.fromkeys(one.label(name) for one in all_shown)) for name in SHOWN}
    shown = next(one for one in all_shown if one.um == drawn)
    over = {name: _planes(shown, name, "fluence")[0] for name in SHOWN}
    depth = _errors(shown).depth
    ink = dict(zip((one.um for one in all_shown), colours([one.um for one in all_shown]), strict=True))
    noise = float(np.mean([row[-1] for row in every]))

    def draw(figure):
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.25))
        for name, rows in over.items():
            left.plot(depth, np.maximum(100 * rows[:, 0], _LEAST), color=SHOWN[name][1], linestyle=SHOWN[name][2], marker="o",
                      markersize=3.2, linewidth=2.2 if name == "best" else 1.3, label=shown.label(name))
        left.fill_between(depth, _LEAST, 100 * over["best"][:, 1], color=FAINT, label="noise of the photons", zorder=0)
        left.set(yscale="log", xlabel="depth z (mfp)", ylabel="error, forward fluence (%)", xlim=(0, None), ylim=(_LEAST, None))
        left.set_title(f"Each plane, {drawn:g} µm")
        right.axvspan(_LEAST, 100 * noise, color=FAINT, zorder=0)
        lines = {name: -i for i, name in enumerate(names)}
        count = len(all_shown)
        spread = {one.um: 0.5 * (i - (count - 1) / 2) / max(count - 1, 1) for i, one in enumerate(all_shown)}
        for um, name, measure, error, _ in every:
            right.plot(max(100 * error, _LEAST), lines[name] - spread[um], marker="o" if measure == "fluence" else "D",
                       color=ink[um], markerfacecolor=ink[um] if measure == "fluence" else "none", markersize=5.5,
                       linestyle="none", clip_on=False)
        for um, colour in ink.items():
            right.plot([], [], "o", color=colour, label=f"{um:g} µm")
        right.plot([], [], "o", color=INK, label="fluence")
        right.plot([], [], "D", color=INK, markerfacecolor="white", label="flux")
        right.set(xscale="log", xlim=(_LEAST, None), ylim=(0.6 - len(names), 0.6), xlabel="error, all planes (%)")
        right.set_yticks(list(lines.values()), list(names.values()))
        right.set_title("All planes, each wavelength")
        for axis in (left.yaxis, right.xaxis):
            axis.set_major_formatter(lambda value, _: f"{value:g}")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=3)
        figure.legend(*right.get_legend_handles_labels(), loc="outside lower right", ncols=min(len(ink) + 2, 5))
        figure.suptitle("Errors of kernels against photons", x=0.01, ha="left", fontsize=10.5, fontweight="bold")

    said = (f"Root mean square difference of 2π r Ψ from {_number(shown.counted.photons)} photons a wavelength over ten planes "
            f"and {_CELLS} rings, relative, less the photons' noise (grey; what lies in it may be 0).  Light that goes on "
            f"forward: as fluence, and as power through a surface across the beam (flux).  Below {_LEAST:g} % drawn there.")
    columns = (("wavelength [um]", np.array([row[0] for row in every])), ("kernel", [names[row[1]] for row in every]),
               ("measure", [row[2] for row in every]), ("error [1]", np.array([row[3] for row in every])),
               ("noise [1]", np.array([row[4] for row in every])))
    return Picture("beam_photons_errors", "Narrow beam: errors of kernels", said, (11.4, 5.0), draw, columns)


def _errors(one: Shown) -> photons.Counted:
    """What was counted on the ten planes of errors."""
    at, every = one.counted, max(len(one.counted.depth) * _EVERY // _CELLS, 1)
    keep = slice(every - 1, None, every)
    return photons.Counted(at.depth[keep], at.edges, at.flux[keep], at.flux_error[keep], at.fluence[keep], at.fluence_error[keep],
                           at.photons)


def _planes(one: Shown, name: str, measure: str):
    """Errors and noise (10, 2) of single planes, and of all together."""
    at = _errors(one)
    every = len(one.counted.depth) // len(at.depth)
    value = one.rings(name, measure)[every - 1::every]
    alone = [photons.rms(value[i:i + 1], photons.Counted(at.depth[i:i + 1], at.edges, *(
        whole[i:i + 1] for whole in (at.flux, at.flux_error, at.fluence, at.fluence_error)), at.photons), measure)
        for i in range(len(at.depth))]
    return np.array(alone), photons.rms(value, at, measure)


def _words(shown: Shown) -> str:
    return f"{shown.um:g} µm, albedo {shown.kernels.albedo:.4g}"


def _percent(share: float) -> str:
    return f"{100 * share:.2g}" if share < 0.995 else f"{100 * share:.0f}"


def _number(count: int) -> str:
    return f"{count:,}".replace(",", " ")


if __name__ == "__main__":
    from benchmarks.drawing import main

    main(__doc__, pictures)
