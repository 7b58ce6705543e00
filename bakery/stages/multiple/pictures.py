"""Pictures of the tables of multiple scattering: the plane of the source with its quadtree, and the errors that the bake stated.

Lengths are mean free paths of the medium that was solved, so without a peak that counts as not scattered (`multiple/extinction`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bakery.draw.axes import rows_of_errors
from bakery.draw.picture import Picture
from bakery.draw.style import INK, NEUTRAL, QUIET
from bakery.physics.multiple import frame, locate, lookup
from bakery.physics.multiple.kinds import KINDS
from bakery.stages.multiple.view import tables_of
from bakery.store.tree import Group

if TYPE_CHECKING:
    from bakery.physics.multiple import table

_PIXELS = 96  # of the plane's height
_DIRECTIONS = (24, 11)  # rings and half meridians that an integral sums: at worst 1 % off, 0.1 % as a rule
_STATED = {"error": "table", "error_with_solver": "table and solver", "error_worst": "table, worst position"}


@dataclass(frozen=True)
class Shown:
    """One kind of source at the wavelength that is drawn."""

    kind: str
    um: float
    table: table.Table
    albedo: float

    @cached_property
    def ready(self) -> lookup.Ready:
        return lookup.ready(self.table)

    @property
    def middle(self) -> float:
        """z of the middle of the source."""
        return self.table.length / 2

    @property
    def words(self) -> str:
        source = "point source" if self.kind == "point" else f"segment of {self.table.length:g} mfp"
        return f"{source}, {self.um:g} µm, albedo {self.albedo:.4g}"

    def integral(self, rho, z):
        """The integral of the table's own source over directions, mfp^-3."""
        rho, z = np.broadcast_arrays(rho, z)
        polar, azimuth = frame.polar(np.linspace(0, 1, _DIRECTIONS[0])), np.linspace(0, np.pi, _DIRECTIONS[1])
        lobes = lookup.lobes(self.ready, rho.ravel(), z.ravel(), polar, azimuth)
        return np.tensordot(lobes, frame.solid_angles(_DIRECTIONS), 2).reshape(rho.shape)

    def in_plane(self, rho, z, turn):
        """The source at positions (N,) into directions (T,) in the plane of source and position, mfp^-3 sr^-1, (N, T).

        turn : rad, from +z towards growing rho
        """
        values = []
        for across, along in zip(rho, z, strict=True):
            polar = (np.arctan2(across, along) - turn + np.pi) % (2 * np.pi) - np.pi
            (lobes,) = lookup.lobes(self.ready, np.array([across]), np.array([along]), np.abs(polar), np.array([0.0, np.pi]))
            values.append(np.where(polar >= 0, *lobes.T))  # at azimuth 0 of a position's frame is +z
        return np.array(values)


def pictures(root: Group) -> Iterator:
    """The plane of each kind of source at the middle one of the wavelengths at which anything is scattered; errors of all."""
    group = root["multiple"]
    um = group["wavelength"].data
    kinds = [kind for kind in KINDS if kind in group.members]
    tables = {kind: tables_of(group, kind) for kind in kinds}
    wavelengths = [k for k in np.argsort(um, kind="stable") if not all(tables[kind][k].empty for kind in kinds)]
    if not wavelengths:
        return
    k = int(wavelengths[len(wavelengths) // 2])
    for kind in kinds:
        if not tables[kind][k].empty:
            yield plane(Shown(kind, float(um[k]), tables[kind][k], float(group["albedo"].data[k])))
    yield errors(group, kinds, wavelengths)


# ---- the plane


def plane(shown: Shown):
    """False colour over (z, rho) near and far; cells of the quadtree above the axis, lobes below it."""
    extent, middle = shown.table.extent, shown.middle
    sizes = (min(middle + 2.5, 0.4 * extent), 1.08 * (extent + (middle if extent < 3 * middle else 0)))
    images = [_image(shown, size) for size in sizes]
    bounds = shown.table.node_bounds[shown.table.node_child < 0].astype(float)
    lines = np.concatenate([_edges(shown, bounds[:, [0, 0]], bounds[:, 2:]), _edges(shown, bounds[:, :2], bounds[:, [2, 2]])])
    rim = _edges(shown, np.ones((1, 2)), np.array([[0.0, 1.0]]), 200)[0]
    lobes = [_lobes(shown, size) for size in sizes]
    factor = "r" if shown.kind == "point" else "1/(2 artanh(l/(r₁ + r₂)))"

    def draw(figure):
        from matplotlib.collections import PolyCollection
        from matplotlib.colors import LogNorm
        from matplotlib.patheffects import withStroke

        panels = figure.subplots(1, 2)
        halo = [withStroke(linewidth=2.6, foreground="white")]
        names = ("Around the source", "Whole table")
        for axes, size, (*_, scaled), (places, outlines), name in zip(panels, sizes, images, lobes, names, strict=True):
            norm = LogNorm(max(scaled.min(), 1e-8 * scaled.max()), scaled.max())
            mirrored = np.concatenate([scaled[::-1], scaled])
            shade = axes.imshow(mirrored, extent=(middle - size, middle + size, -size, size), origin="lower", norm=norm,
                                cmap="viridis", interpolation="bilinear", zorder=0)
            seen = lines[(np.abs(lines[:, :, 0] - middle) < size).any(axis=1) & (lines[:, :, 1] < size).any(axis=1)]
            gaps = np.insert(seen, seen.shape[1], np.nan, axis=1).reshape(-1, 2)  # one path: hundreds take ten times as long
            axes.plot(*gaps.T, color="white", linewidth=0.35, alpha=0.75, zorder=2)
            axes.plot(rim[:, 0], rim[:, 1], color="white", linewidth=1.1, zorder=3)
            axes.plot(rim[:, 0], -rim[:, 1], color="white", linewidth=1.1, zorder=3)
            axes.add_collection(PolyCollection(outlines, facecolor="white", alpha=0.88, edgecolor=INK, linewidth=0.7, zorder=4),
                                autolim=False)
            axes.plot(*places, ".", color=INK, markersize=2.6, zorder=5)
            axes.axhline(0, color="white", linewidth=0.5, zorder=3)
            if shown.kind == "point":
                axes.annotate("", (0.16 * size, 0), (0, 0), arrowprops={"arrowstyle": "-|>", "color": "#c8102e", "linewidth": 1.4,
                              "shrinkA": 0, "shrinkB": 0}, zorder=6)
                axes.plot(0, 0, "o", color="#c8102e", markersize=4.5, zorder=6, path_effects=halo)
            else:
                axes.plot((0, shown.table.length), (0, 0), color="#c8102e", linewidth=2.2, zorder=6, path_effects=halo,
                          solid_capstyle="butt")
            axes.set(xlim=(middle - size, middle + size), ylim=(-size, size), aspect="equal", xlabel="z (mfp)", ylabel="ρ (mfp)")
            axes.yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
            axes.set_title(name)
            axes.grid(False)
            figure.colorbar(shade, ax=axes, shrink=0.82, pad=0.02, label=f"integral over directions × {factor} (mfp⁻²)")
        figure.suptitle(f"Third and later events: {shown.words}", x=0.01, ha="left", fontsize=10.5, fontweight="bold")

    caption = ("Colour: light of the third and later scattering events, all directions together, over its singular part.  "
               f"Above the axis the {len(bounds)} cells of the quadtree, below it lobes in this plane, all drawn equally long; "
            f"light enters along +z (red).  Outside the white line, {extent:.3g} mean free paths, the table goes on as diffuse "
            "light does.")
    heads = ("z [mfp]", "rho [mfp]", "integral over directions [mfp^-3]", "over the singular part [mfp^-2]")
    return Picture(f"multiple_{shown.kind}", f"Multiple scattering, {shown.kind} source", caption, (11.4, 4.9), draw,
                   tuple((head, np.concatenate([image[k].ravel() for image in images])) for k, head in enumerate(heads)))


def _image(shown: Shown, size: float):
    """z, rho, the integral over directions, and that over the singular part, (rows, 2 rows): from the axis upwards."""
    at = (np.arange(_PIXELS // 2) + 0.5) / (_PIXELS // 2) * size
    z, rho = np.meshgrid(shown.middle + np.concatenate([-at[::-1], at]), at)
    value = shown.integral(rho, z)
    return z, rho, value, value / locate.measure(shown.table.kind, shown.table.length, rho, z)[1]


def _edges(shown: Shown, u, v, points: int = 4):
    """Curves (N, points, 2) in z, rho of straight lines from u[:, 0], v[:, 0] to u[:, 1], v[:, 1]."""
    share = np.linspace(0, 1, points)
    u, v = (pair[:, :1] + share * (pair[:, 1:] - pair[:, :1]) for pair in (u, v))
    rho, z = frame.position(shown.table.kind, shown.table.length, shown.table.extent, u, v)
    return np.stack([z, rho], axis=-1)


def _lobes(shown: Shown, size: float):
    """Places below the axis, and the outlines of the lobes there in the plane."""
    turn = np.linspace(0, 2 * np.pi, 181)
    places = [(share * size, np.radians(angle)) for share, angles in ((0.32, (25, 90, 155)), (0.75, (12, 45, 78, 102, 135, 168)))
              for angle in angles]
    z, rho = np.array([(shown.middle + away * np.cos(angle), away * np.sin(angle)) for away, angle in places]).T
    values = shown.in_plane(rho, z, turn)
    across = values[:, :-1] + np.roll(values[:, :-1], 90, axis=1)
    radius = 0.21 * size * values / across.max(axis=1, keepdims=True)  # all equally long
    outlines = np.stack([z[:, None] + radius * np.cos(turn), -rho[:, None] - radius * np.sin(turn)], axis=-1)
    return (z, -rho), outlines


# ---- error


def errors(group: Group, kinds: list[str], wavelengths: list[int]):
    """The errors that the tables state, of each kind of source at each wavelength."""
    um = group["wavelength"].data[wavelengths]
    stated = {kind: {name: np.array([100 * float(group[f"{kind}/w{k}"][name].data[0]) for k in wavelengths]) for name in _STATED}
              for kind in kinds}
    rows = [(kind, x) for kind in kinds for x in um]
    values = {name: np.concatenate([stated[kind][name] for kind in kinds]) for name in _STATED}

    def draw(figure):
        axes = figure.subplots()
        at = -np.arange(len(rows), dtype=float)
        axes.hlines(at, values["error"], values["error_worst"], color=QUIET, linewidth=0.8, zorder=1)
        for (name, label), ink, mark in zip(_STATED.items(), NEUTRAL, ("o", "s", "D"), strict=True):
            axes.plot(values[name], at, mark, color=ink, markersize=7 if mark == "s" else 4.5, linestyle="none", label=label,
                      markerfacecolor="none" if mark == "s" else ink)
        shown = np.concatenate([value[value > 0] for value in values.values()])
        if shown.size:
            axes.set_xlim(shown.min() / 1.5, 1.5 * shown.max())
        rows_of_errors(figure, axes, [f"{kind}, {x:g} µm" for kind, x in rows], "error of a lobe (%)")

    return Picture("multiple_errors", "Errors of the tables of multiple scattering", "What the bake found: relative difference "
                   "of a lobe over directions, root mean square over positions between the corners of the table; the same with "
                   "what the solver (or the noise of photons) adds; and that of the worst position.",
                   (7.4, 1.4 + 0.28 * len(rows)), draw,
                   (("source", [kind for kind, _ in rows]), ("wavelength [um]", np.array([x for _, x in rows])),
                    *((f"{name} [%]", value) for name, value in values.items())))
