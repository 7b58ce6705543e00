"""Draws an asset's tables of multiple scattering beside photons and the solver: python benchmarks/multiple_pictures.py ASSET

The table along three lines against photons, and its error over the plane, each as PNG with its data as CSV (-o DIR); up to 30 s.
Lengths are mean free paths of the medium that was solved, so without a peak that counts as not scattered (`multiple/extinction`).
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bakery.draw.picture import Picture
from bakery.draw.style import FAINT, INK, NEUTRAL, QUIET
from bakery.physics.multiple import build, choice, frame, lookup, table
from bakery.physics.multiple.kinds import KINDS
from bakery.stages.multiple.pictures import Shown as Drawn
from bakery.stages.multiple.view import tables_of
from bakery.store.tree import Dataset, Group
from benchmarks.sizes import sized
from tests.oracles import photons

_LEAST_STEP, _RATIO = 0.05, 1.5  # edge of the first cell of photons, mfp, and from one to the next
_REACH = 30.0  # mfp that photons are counted to
# of photons: scattering events in all, fewest and most of them
_EVENTS, _FEWEST, _MOST = sized((8e6, 4096, 150_000), (1e4, 1024, 1024))
_RIM = 40.0  # times the outermost cell: where photons are dropped if nothing is absorbed
_SHIFT = 3  # cells from 45 degrees to the lines ahead and behind
_LOST = 0.15  # relative standard error of photons above which a point says nothing
# positions of the error map; where more orders were solved
_MAP, _FEW, _DEAR = sized(((25, 37), (15, 23), 64), ((5, 7), (5, 7), 64))
_NEAR = 0.05  # mfp from the ends of the source, nearer than which the tables count errors in proportion
_ORDERS = 128  # most that a recipe may ask for
_SEED = 7


@dataclass(frozen=True)
class Shown(Drawn):
    """One kind of source at the wavelength that is drawn, and the medium that it was made for."""

    medium: Group
    row: int
    peak: float
    effect: float
    phase: np.ndarray
    orders: int | None

    @cached_property
    def laid_out(self) -> lookup.Ready:
        return lookup.ready(self.table)

    def value(self, rho, z, theta, phi):
        """The table's own source into a direction, mfp^-3 sr^-1."""
        return lookup.point(self.laid_out, rho, z, theta, phi)

    @cached_property
    def solved(self):
        """The solution that the table was made from, once more."""
        straight = self.medium.members.get("forward_delta")
        straight = float(straight.data[self.row]) if isinstance(straight, Dataset) else 0.0
        medium = choice.Medium(float(self.medium["albedo"].data[self.row]), self.medium["theta"].data,
                               self.medium["phase"].data[self.row], straight)
        return choice.solved(medium, self.orders).solution


def pictures(root: Group) -> Iterator:
    """The pictures of each kind of source, at the middle one of the wavelengths at which anything is scattered."""
    group, medium = root["multiple"], root["medium"]
    um = group["wavelength"].data
    for kind in KINDS:
        if kind not in group.members:
            continue
        tables = tables_of(group, kind)
        lit = [k for k in np.argsort(um, kind="stable") if not tables[k].empty]
        if not lit:
            continue
        k = int(lit[len(lit) // 2])
        shown = Shown(kind, float(um[k]), tables[k], float(group["albedo"].data[k]), medium, k, float(group["peak"].data[k]),
                      float(group["peak_effect"].data[k]), group["phase"].data[k], _orders(root))
        yield sections(shown)
        if "photons" not in group[f"{kind}/w{k}"].members:  # the solver may not reach what was left to photons
            yield error_map(shown)


def _orders(root: Group) -> int | None:
    """The recipe's `orders`, as the stage recorded it; None: as many as it takes, or nothing that a recipe could say."""
    try:
        said = json.loads(bytes(root["provenance/multiple/inputs"].data))["multiple_scattering.orders"]
    except (KeyError, ValueError, TypeError, RecursionError):
        return None
    return said if isinstance(said, int) and 2 <= said <= _ORDERS else None


# ---- photons


def sections(shown: Shown):
    """The table along three lines from the middle of the source, against photons that know nothing of it."""
    edges, at, tally, names = *_counted(shown), ("mean over directions", "away from the source", "towards the source")
    z = shown.middle + np.concatenate([-edges[::-1], edges])
    curves, columns = [], []
    for line, (title, rings, slabs, angle) in enumerate(at["lines"]):
        r = np.hypot(np.sqrt(edges[rings] * edges[rings + 1]), at["away"][slabs])
        chosen = slice(2 * line, 2 * line + 2)
        exact = np.column_stack([_averaged(shown, edges[n:n + 2], z[k:k + 2], at["directions"][chosen])
                                 for n, k in zip(rings, slabs, strict=True)])
        found, error = (np.column_stack([whole[rings, slabs] / (4 * np.pi), each[rings, slabs][:, chosen]]).T
                        for whole, each in ((tally.total, tally.value), (tally.total_error, tally.error)))
        curves.append((title, r, exact, np.where(_sure(found, error, exact), found, np.nan), error))
        columns.append((np.full(r.size, np.degrees(angle)), r, *(row[k] for k in range(3) for row in (exact, found, error))))
    stated = 100 * shown.table.error_with_solver

    def draw(figure):
        lowest, highest = (bound([bound(exact) for _, _, exact, *_ in curves]) for bound in (np.min, np.max))
        panels = figure.subplots(2, 3, sharex=True, sharey="row", height_ratios=(1.9, 1))
        for (axes, below), (title, r, exact, found, error) in zip(panels.T, curves, strict=True):
            band = below.axhspan(-stated, stated, color=QUIET, alpha=0.4, linewidth=0, zorder=1)
            below.axhline(0, color=QUIET, linewidth=0.8, zorder=1)
            for k, (name, ink, mark) in enumerate(zip(names, NEUTRAL, ("o", "s", "^"), strict=True)):
                axes.plot(r, exact[k], color=ink, linewidth=1.3, label=name)
                style = {"fmt": mark, "color": ink, "markersize": 3.4, "elinewidth": 1.0, "capsize": 1.8, "linestyle": "none"}
                axes.errorbar(r, found[k], yerr=error[k], **style)
                below.errorbar(r * 1.05 ** (k - 1), 100 * (found[k] / exact[k] - 1), yerr=100 * error[k] / exact[k], **style)
            for each in (axes, below):
                end = each.axvline(shown.table.extent, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
            axes.set(xscale="log", yscale="log", ylim=(0.4 * lowest, 2.5 * highest))
            axes.set_title(title)
            below.set_xlabel("distance from the middle of the source (mfp)" if shown.kind == "segment" else "distance (mfp)")
        panels[0, 0].set_ylabel("source (mfp⁻³ sr⁻¹)")
        panels[1, 0].set_ylabel("photons over table − 1 (%)")
        panels[0, 0].set_xlim(0.9 * min(r.min() for _, r, *_ in curves), 1.1 * max(r.max() for _, r, *_ in curves))
        spread = np.concatenate([(np.abs(found / exact - 1) + error / exact).ravel() for *_, exact, found, error in curves])
        high = 100 * np.nanpercentile(spread, 92) if np.isfinite(spread).any() else 10.0
        panels[1, 0].set_ylim(-max(high, 2.5 * stated), max(high, 2.5 * stated))
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend([*handles, band, end], [*labels, f"stated error, {_short(stated)} %", "end of the table"],
                      loc="outside lower center", ncols=5)
        figure.suptitle(f"Table (lines) and photons (points): {shown.words}", x=0.01, ha="left", fontsize=10.5, fontweight="bold")

    number = f"{tally.photons:,}".replace(",", " ")
    said = [f"Lines: the table; points: {number} photons followed through the medium, with standard errors; both averaged over "
            f"the same ring cells.  Grey band: the error that the table states, {_short(stated)} %.  That is an error of whole "
            "lobes: their dim directions may be off by more.  Points whose standard error is above "
            f"{100 * _LOST:g} % are left out; where few photons carry most of the light (towards the source, peaked phase "
            "functions) the rest lie low and their bars are short."]
    said += [at["remark"]] if at["remark"] else []
    if tally.bias > 2e-3:
        said.append(f"Photons are dropped far outside; up to {100 * tally.bias:.1g} % are missing in the outermost cells.")
    heads = ["angle from +z [deg]", "distance [mfp]",
             *(f"{name} {end} [mfp^-3 sr^-1]" for name in names for end in ("table", "photons", "photons standard error"))]
    return Picture(f"multiple_{shown.kind}_sections", f"Multiple scattering against photons, {shown.kind} source",
                   "  ".join(said), (11.4, 6.2), draw,
                   tuple((head, np.concatenate(parts)) for head, parts in zip(heads, zip(*columns, strict=True), strict=True)))


def _sure(found, error, exact):
    """Where photons say something, (3, N); a few of them have too small errors, so those of all directions are to be enough."""
    sure = error < _LOST * np.minimum(found, exact)
    return sure & sure[0]


def _averaged(shown: Shown, rho, z, directions):
    """What a tally estimates in one cell: the mean over directions, and the values into two of them."""
    mean = photons.cell_averages(lambda at_rho, at_z, *_: shown.integral(at_rho, at_z) / (4 * np.pi), rho, z, np.zeros((1, 2)))
    return np.concatenate([mean[0, 0], photons.cell_averages(shown.value, rho, z, directions)[0, 0]])


def _counted(shown: Shown):
    """Edges of the cells (both rho and distance along z), what they are used for, and what photons found in them."""
    albedo, theta, phase, remark = _followed(shown)
    reach = min(1.5 * shown.table.extent, _REACH if albedo < 0.9999 else 5.0)
    edges = _LEAST_STEP * _RATIO ** np.arange(max(int(np.log(reach / _LEAST_STEP) / np.log(_RATIO)) + 1, _SHIFT + 4))
    count = len(edges) - 1
    rings, angle = np.arange(count - _SHIFT), np.arctan(_RATIO ** -_SHIFT)
    lines = [(f"Ahead, {np.degrees(angle):.0f}° from the axis", rings, count + 1 + rings + _SHIFT, angle),
             ("Sideways, 90°", np.arange(count), np.full(count, count), np.pi / 2),
             (f"Behind, {np.degrees(np.pi - angle):.0f}°", rings, count - 1 - rings - _SHIFT, np.pi - angle)]
    middles = np.sqrt(edges[1:] * edges[:-1])
    at = {"lines": lines, "remark": remark, "away": np.concatenate([-middles[::-1], [0.0], middles]),
          "directions": np.array([d for *_, a in lines for d in ((a, 0.0), (np.pi - a, np.pi))])}
    g = 2 * np.pi * np.trapezoid(phase * np.cos(theta) * np.sin(theta), theta)
    rim = _RIM * edges[-1] if albedo > 1 - 1e-6 else None
    events = 1 / max(1 - albedo, 1e-9)  # of a photon; with a rim as many as it takes to diffuse there
    events = min(events, rim**2 * (1 - g) / 2) if rim else events
    number = int(np.clip(_EVENTS / events, _FEWEST, _MOST))
    z = shown.middle + np.concatenate([-edges[::-1], edges])
    tally = photons.trace(albedo, theta, phase, edges, z, at["directions"], number, seed=_SEED, rim=rim,
                          length=shown.table.length if shown.kind == "segment" else None)
    return edges, at, tally


def _followed(shown: Shown):
    """Albedo and phase function that photons are to follow, and what to say of them."""
    remark = "" if shown.peak < 1e-9 else (
        f"Photons follow the tables' phase function, without the forward peak ({shown.peak:.2g} of the scattered light): between "
        f"events they go straight on, which changes lobes by {100 * shown.effect:.2g} %.")
    return shown.albedo, shown.medium["theta"].data, shown.phase, remark


# ---- error


def error_map(shown: Shown):
    """Lobes of the table against the solver's own between the corners."""
    made, solved = shown.table, shown.solved.medium
    count = _MAP if solved.order <= _DEAR else _FEW
    u, v = (np.linspace(0, 1, n + 1) for n in count)
    middle_u, middle_v = np.meshgrid((u[1:] + u[:-1]) / 2, (v[1:] + v[:-1]) / 2, indexing="ij")
    rho, z = frame.position(made.kind, made.length, made.extent, middle_u.ravel(), middle_v.ravel())
    error = 100 * build.errors(made, solved, rho, z).reshape(count)
    ends = np.minimum(np.hypot(rho, z), np.hypot(rho, z - made.length))
    fine = np.linspace(0, 1, 400)
    angle, reached = _at(made, 0.9, v)[1], _at(made, fine, 0.5)[0]
    steps = np.geomspace(0.999 * ends.min(), 1.001 * ends.max(), 19)
    bins = np.digitize(ends, steps)
    filled = [bins == k for k in range(1, len(steps)) if (bins == k).any()]
    running = np.array([(np.exp(np.log(ends[these]).mean()), np.sqrt((error.ravel()[these] ** 2).mean())) for these in filled])
    stated, worst = 100 * made.error, 100 * made.worst
    name = "distance (mfp)" if shown.kind == "point" else "semi-minor axis of ellipses about the ends (mfp)"

    def draw(figure):
        from matplotlib.colors import LogNorm

        left, right = figure.subplots(1, 2, width_ratios=(1.25, 1))
        wide = float(np.clip(np.exp(np.percentile(np.abs(np.log(np.maximum(error, 1e-9) / stated)), 98)), 4, 300))
        shade = left.pcolormesh(u[:, None] * np.cos(angle), u[:, None] * np.sin(angle), error, cmap="RdBu_r", rasterized=True,
                                norm=LogNorm(stated / wide, wide * stated))
        turn = np.linspace(0, np.pi, 200)
        for tick in [*(t for t in (0.001, 0.01, 0.1, 1.0, 10.0) if 0.15 < np.interp(t, reached, fine) < 0.88), made.extent]:
            radius = float(np.interp(tick, reached, fine))
            left.plot(radius * np.cos(turn), radius * np.sin(turn), color=INK, alpha=0.35, linewidth=0.6)
            for side in (-1, 1):
                left.annotate(f"{tick:.3g}", (side * radius, 0), (0, -4), textcoords="offset points", ha="center", va="top",
                              fontsize=8.5)
        left.annotate(f"{name}, spaced as in the table", (0.5, 0), (0, -18), va="top",
                      ha="center", xycoords="axes fraction", textcoords="offset points", fontsize=9).set_in_layout(False)
        left.set(aspect="equal", xlim=(-1.02, 1.02), ylim=(0, 1.02))
        left.set_axis_off()
        left.set_title("Over the plane")
        bar = figure.colorbar(shade, ax=left, orientation="horizontal", shrink=0.8, pad=0.1, aspect=36,
                              label=f"error of the lobe (%); white: the stated {_short(stated)} %")
        ticks = [x for x in (0.001, 0.01, 0.1, 1.0, 10.0, 100.0) if stated / wide <= x <= wide * stated]
        bar.set_ticks(ticks, labels=[f"{x:g}" for x in ticks])
        bar.minorticks_off()
        near = ends < _NEAR
        for these, alpha in ((near, 0.2), (~near, 0.45)):
            right.plot(ends[these], error.ravel()[these], ".", color=NEUTRAL[1], markersize=4, markeredgewidth=0, alpha=alpha,
                       label="one place" if alpha > 0.2 else None)
        right.plot(*running.T, color=INK, label="root mean square")
        right.axhline(stated, color=NEUTRAL[2], linewidth=1.2, linestyle=(0, (5, 2.5)), label=f"stated: {_short(stated)} %")
        right.axhline(worst, color=NEUTRAL[2], linewidth=1.2, linestyle=":", label=f"stated worst: {_short(worst)} %")
        right.axvspan(0.5 * ends.min(), _NEAR, color=FAINT, alpha=0.6, linewidth=0, zorder=0)
        right.set(xscale="log", yscale="log", xlim=(0.8 * ends.min(), 1.25 * ends.max()), ylabel="error of the lobe (%)",
                  xlabel="distance (mfp)" if shown.kind == "point" else "distance from the nearer end of the segment (mfp)")
        right.set_title("Over the distance")
        figure.legend(*right.get_legend_handles_labels(), loc="outside lower right", ncols=4, markerscale=2.5)
        figure.suptitle(f"Table against the solver: {shown.words}", x=0.01, ha="left", fontsize=10.5, fontweight="bold")

    said = (f"Lobes of the table against those of the solver at {error.size} places between the corners: root mean square over "
            f"directions, relative.  Light enters towards the right.  The table states {_short(stated)} %, "
            f"{_short(100 * made.error_with_solver)} % with what the solver adds; in that, errors nearer than {_NEAR:g} mfp to "
            "an end of the source (shaded) count in proportion to the distance.")
    said += f"  Only {error.size} places, as {solved.order} orders are dear." if count == _FEW else ""
    return Picture(f"multiple_{shown.kind}_error", f"Error of the table, {shown.kind} source", said, (11.4, 4.9), draw,
                   (("z [mfp]", z), ("rho [mfp]", rho), ("error [%]", error.ravel())))


def _short(percent: float) -> str:
    return f"{percent:.2g}" if percent < 100 else f"{percent:.0f}"


def _at(made: table.Table, u, v):
    """Distance (r, or the semi-minor axis b) and angle from +z (of the position, or nu) of places in the square."""
    rho, z = frame.position(made.kind, made.length, made.extent, *np.broadcast_arrays(u, v))
    first, second = np.hypot(rho, z), np.hypot(rho, z - made.length)
    if not made.length:
        return first, np.arctan2(rho, z)
    return np.sqrt((first + second + made.length) * (first + second - made.length)) / 2, \
        np.arccos(np.clip((first - second) / made.length, -1, 1))


if __name__ == "__main__":
    from benchmarks.drawing import main

    main(__doc__, pictures)
