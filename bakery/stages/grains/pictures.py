"""Pictures of packed grains: the exemplars, how each scatters, and the statistics of its walks."""

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from bakery.draw.axes import labels, legend_beside, sentences
from bakery.draw.picture import Picture
from bakery.draw.style import FAINT, INK, QUIET, colours
from bakery.draw.table import Table
from bakery.physics.medium.phase import phase_integral
from bakery.stages.grains.outputs import SCALARS
from bakery.stages.grains.rules import OF_SURFACES
from bakery.stages.grains.view import Exemplar, exemplar
from bakery.stages.medium.pictures import around, band_of, by_angle, over_angles
from bakery.store.tree import Dataset, Group

# figure -> symbol, what it is in a few words, range that its column shows (None: from 0 to what is found)
FIGURES = {
    "hit_probability": ("β", "hit probability", (0.0, 1.0)),
    "lambda_delta": ("λδ (R)", "chord of misses", (0.0, 2.0)),
    "albedo": ("α", "albedo", (0.0, 1.0)),
    "lambda_s": ("λs (R)", "displacement along the ray", (0.0, 2.0)),
    "mean_square": ("⟨T²⟩ (R²)", "mean square displacement", (0.0, 4.0)),
    "g": ("g", "mean cosine", (-1.0, 1.0)),
    "forward_delta": ("δ", "delta share", (0.0, 1.0)),
    "inner_path": ("L (R)", "path inside", None),
}
SURFACES = {"dielectric": "dielectric", "diffuse": "diffuse", "conductor": "metal"}
_TINT = {"dielectric": (0.55, 0.66, 0.74), "diffuse": (0.66, 0.47, 0.30), "conductor": (0.50, 0.50, 0.53)}
_GLOSS = {"dielectric": 0.55, "diffuse": 0.0, "conductor": 0.9}
_GAP = 0.16  # between columns of the statistics, of their width
_EXACT = 1e-9  # an error below this has no digits to show


def pictures(root: Group) -> Iterator:
    """Every picture of a `grains` group: the grains, their statistics, phase functions, figures by size."""
    grains, um = root["grains"], root["wavelength"].data
    components = grains.groups
    yield shapes({name: exemplar(part) for name, part in components.items()}, components, grains)
    yield statistics(components, um)
    yield scattering(components, grains["theta"], um)
    sized = {name: part["by_radius"] for name, part in components.items() if "by_radius" in part.members}
    if sized:
        yield by_radius(sized, grains["radius"].data, um)


def shapes(meshes: Mapping[str, Exemplar], parts: Mapping[str, Group], grains: Group):
    """Each component's grain in its bounding sphere, with a scale bar."""
    across = min(len(meshes), max(3, round(math.sqrt(1.4 * len(meshes)))))
    down = -(-len(meshes) // across)
    pixels = 420 if len(meshes) <= 2 else 300
    radius = _radii(grains)

    def draw(figure):
        from matplotlib.patches import Circle

        from bakery.draw.meshes import rendered

        panels = np.atleast_1d(figure.subplots(down, across)).ravel()
        for axes in panels:
            axes.set_axis_off()
        for axes, (name, grain) in zip(panels, meshes.items(), strict=False):
            kind = grain.surface["type"]
            image = rendered(None if grain.ball else grain.vertices, grain.faces, np.array(_TINT[kind]), pixels,
                             _GLOSS[kind] / (1 + 8 * grain.surface.get("roughness", 0.0)))
            axes.imshow(image, extent=(-1.02, 1.02, -1.02, 1.02), interpolation="antialiased", zorder=2)
            axes.add_patch(Circle((0, 0), 1, facecolor=(FAINT, 0.25), edgecolor=QUIET, linewidth=0.8,
                                  linestyle=(0, (4, 3)), zorder=1))
            axes.plot((0, 1), (-1.16, -1.16), color=INK, linewidth=1.6, solid_capstyle="butt")
            for end in (0, 1):
                axes.plot((end, end), (-1.19, -1.13), color=INK, linewidth=1.0)
            axes.text(-0.06, -1.16, f"R = {radius}", ha="right", va="center", fontsize=8.5, color=INK)
            axes.set(xlim=(-1.06, 1.06), ylim=(-1.58, 1.28), aspect="equal")
            axes.text(0, 1.15, f"{name}{_share(parts[name])}", ha="center", va="center", fontsize=10.5, fontweight="bold")
            axes.text(0, -1.28, "\n".join(_described(grain)), ha="center", va="top", fontsize=8.5, color=QUIET)

    rows = [(name, SURFACES[g.surface["type"]], "exact" if g.ball else len(g.faces)) for name, g in meshes.items()]
    names, surfaces, faces = zip(*rows, strict=True)
    return Picture("grains", "Grains", "The exemplar of each component in its bounding sphere (dashed), shaded to show its form; "
                   "`bake render` shows its material.", (max(3.3 * across, 4.4), 4.5 * down), draw,
                   (("component", names), ("surface", surfaces), ("triangles", faces)))


def statistics(parts: Mapping[str, Group], um):
    """A table of dots with errors: one row a component and wavelength, one column a figure."""
    names = _shown(parts)
    ink = colours(um)
    rows = [(name, part, k) for name, part in parts.items() for k in range(len(um))]
    tops = {name: _range(name, parts) for name in names}
    notes = [_effort(name, part) for name, part in parts.items()]
    at = np.array([-(i + 1.0 * list(parts).index(name)) for i, (name, _, _) in enumerate(rows)])

    def draw(figure):
        axes = figure.subplots()
        axes.set_axis_off()
        foot = at[-1] - 0.6
        axes.set(xlim=(0, len(names) + (len(names) - 1) * _GAP), ylim=(foot, 1.2))
        _frames(axes, [tops[name] for name in names], foot, [y + 1.25 for y, (name, _, k) in zip(at, rows) if not k][1:])
        dots = []
        for column, figure_name in enumerate(names):
            symbol, words, _ = FIGURES[figure_name]
            x_left, (low, high) = column * (1 + _GAP), tops[figure_name]
            _write(axes, x_left, 1.2, symbol, (0, 26), fontsize=10, fontweight="bold", va="bottom")
            _write(axes, x_left, 1.2, textwrap.fill(words, 16), (0, 24), fontsize=7.8, color=QUIET, va="top")
            for y, (_, part, k) in zip(at, rows, strict=True):
                value, error = _value(part, figure_name, k)
                common = part[figure_name].data.size == 1 and figure_name in SCALARS  # to all wavelengths
                if k and common:
                    continue
                tint = INK if common else ink[k]
                dots.append((x_left + (value - low) / (high - low), error / (high - low), y, tint))
                _write(axes, x_left + 1, y, concise(value, error), (0, 3.2), fontsize=7.6, color=tint, ha="right", va="bottom")
        position, error, height, tints = zip(*dots, strict=True)
        axes.hlines(height, np.subtract(position, error), np.add(position, error), colors=tints, linewidth=1.1, zorder=3)
        axes.scatter(position, height, s=18, c=tints, linewidths=0, zorder=4, clip_on=False)
        for y, (name, _, k) in zip(at, rows, strict=True):
            if k == 0:
                _write(axes, 0, y + 0.72, name, (-4, 0), fontsize=9.5, fontweight="bold", ha="right", va="center")
            _write(axes, 0, y, f"{um[k]:g} µm", (-4, 0), color=ink[k] if len(um) > 1 else INK, ha="right", va="center")
        if notes:
            figure.supxlabel("\n".join(notes), x=0.01, ha="left", fontsize=8.2, color=QUIET)

    size = max(1.42 * len(names) + 1.2, 5.0), 1.2 + 0.33 * (len(rows) + len(parts)) + 0.16 * len(notes)
    return Picture("walks", "Statistics of the grains", "What happens to a ray that enters the bounding sphere (R its radius); "
                   "digits in brackets are the standard error of the last ones, bars where it is wider than a dot.  "
                   + "  ".join(f"{note}." for note in notes), size, draw, _columns(parts, names, um))


def _frames(axes, ranges: Sequence[tuple[float, float]], foot: float, between: Sequence[float]) -> None:
    """The columns of `statistics`: scales at their feet, lines up from these, and across between components.

    One axes for all: a column with axes of its own would take as long as all that is drawn in it.
    """
    from matplotlib.collections import LineCollection

    lines, scales = [], []
    for column, (low, high) in enumerate(ranges):
        x_left = column * (1 + _GAP)
        lines += [[(x_left + share, foot), (x_left + share, 1.2)] for share in (0.0, 0.5, 1.0)]
        scales += [[(x_left, y), (x_left + 1, y)] for y in (foot, *between)]
        for share, value in ((0.0, low), (1.0, high)):
            _write(axes, x_left + share, foot, f"{value:g}", (0, -4), ha="center", va="top")
    axes.add_collection(LineCollection(lines, colors=FAINT, linewidths=0.7, zorder=1))
    axes.add_collection(LineCollection(scales, colors=QUIET, linewidths=0.8, zorder=2, clip_on=False))


def _write(axes, x: float, y: float, text: str, points: tuple[float, float], **style) -> None:
    """Text at a place of the axes, moved by points."""
    from matplotlib.transforms import ScaledTranslation

    moved = axes.transData + ScaledTranslation(points[0] / 72, points[1] / 72, axes.get_figure(root=False).dpi_scale_trans)
    axes.text(x, y, text, transform=moved, parse_math=False, **style)


def scattering(parts: Mapping[str, Group], theta: Dataset, um) -> Picture:
    """The phase functions of all components, one a row: over the angle with their errors, and as lobes."""
    views = {name: Group({"theta": theta, "phase": part["phase"], "phase_error": part["phase_error"]})
             for name, part in parts.items()}
    notes = [_of_bins(name, part, theta) for name, part in parts.items()]

    def draw(figure):
        rows = figure.subplots(len(views), 2, width_ratios=(1.6, 1), squeeze=False)
        for (whole_range, lobe), (name, view) in zip(rows, views.items(), strict=True):
            over_angles(whole_range, view, um)
            whole_range.set_title(name)
            around(lobe, view, um)
        legend_beside(figure, whole_range)
        if notes:
            figure.supxlabel("\n".join(notes), x=0.01, ha="left", fontsize=8.2, color=QUIET)

    columns = [("theta [rad]", theta.data)]
    for name, view in views.items():
        columns += by_angle(view, um, f"{name} phase at {{:g}} um [1/sr]", view["phase"].data)[1:]
    bands = "".join(f"  {name}:{band_of(view)}" for name, view in views.items())
    return Picture("grain_scattering", "Scattering by the grains", "Phase function of each component over the angle between the "
                   f"directions of travel, and around the grain; light travels to the right.{bands}{sentences(notes)}",
                   (10.4, 3.4 * len(views) + 0.16 * len(notes)), draw, tuple(columns))


def _of_bins(name: str, part: Group, theta: Dataset) -> str:
    """What stands below the phase function of a component: its noise, and the peak that is not drawn."""
    spread, delta = 50 * np.max(phase_integral(theta.data, part["phase_error"].data)), part["forward_delta"].data
    noise = f"{name}: standard errors of the bins together: {spread:.2g} % of the light"
    if not np.max(delta) > 0:
        return noise
    shares = dict.fromkeys(f"{100 * value:.3g} %" for value in delta)
    return f"{noise}; {', '.join(shares)} of the light is unscattered (delta) transmission: that peak at 0° is not drawn"


def by_radius(parts: Mapping[str, Group], radius, um):
    """Albedo, mean cosine and way against the size of the grain, one row a component."""
    names = [name for name in ("albedo", "g", "lambda_s", "forward_delta")
             if any(part[name].data.any() for part in parts.values())]
    ink = colours(um)
    order = np.argsort(radius)

    def draw(figure):
        panels = figure.subplots(len(parts), len(names), sharex=True, squeeze=False)
        for row, (component, part) in zip(panels, parts.items(), strict=True):
            for axes, name in zip(row, names, strict=True):
                for k, label in enumerate(labels(um)):
                    axes.plot(1e3 * radius[order], part[name].data[order, k], color=ink[k], marker="o", markersize=3.5,
                              label=label)
                axes.set_title(f"{component}: {FIGURES[name][1]} {FIGURES[name][0]}")
                axes.ticklabel_format(axis="y", useOffset=False)
        for axes in panels[-1]:
            axes.set_xlabel("radius R (mm)")
        legend_beside(figure, panels[0, 0])

    table = [("radius [m]", radius[order])]
    for component, part in parts.items():
        table += [(f"{component} {name} at {x:g} um", part[name].data[order, k]) for name in names for k, x in enumerate(um)]
    return Picture("grain_sizes", "Grains by size", "The same shape and material at each radius of the recipe: a larger grain "
                   "absorbs more.", (3.0 * len(names) + 1.0, 0.6 + 2.3 * len(parts)), draw, tuple(table))


def concise(value: float, error: float) -> str:
    """A value with its standard error as digits in brackets, 1.3885(22); four digits where the error has none to show."""
    if not math.isfinite(value):
        return "nan"
    if not error > _EXACT:
        return f"{value:.5g}"
    digits = max(0, 1 - math.floor(math.log10(error)))
    last = round(error * 10**digits)
    if last >= 100:  # 0.0996 rounds up to 0.10
        digits, last = max(digits - 1, 0), round(error * 10 ** max(digits - 1, 0))
    if digits == 0:
        return f"{value:.0f}({last})"
    return f"{value:.{digits}f}({last})"


def table(grains: Group, um) -> tuple[list[str], list[list[str]]]:
    """Heading (symbols) and rows of all figures of each component at each wavelength, for pages."""
    parts = grains.groups
    names = _shown(parts)
    head = ["component", "wavelength (um)", *(FIGURES[name][0] for name in names)]
    rows = []
    for component, part in parts.items():
        for k, x in enumerate(um):
            rows.append([component, f"{x:g}", *(concise(*_value(part, name, k)) for name in names)])
    return head, rows


def tables(root: Group, axes) -> Iterator[Table]:
    """The figures of each exemplar grain, one row a wavelength."""
    header, rows = table(root["grains"], root["wavelength"].data)
    if rows:
        yield Table("Grains", header, rows, words=1, note=f"{legend()}.")


def legend() -> str:
    """What the symbols of `table` stand for."""
    entries = ", ".join(f"{symbol.partition(' ')[0]} {words}" for symbol, words, _ in FIGURES.values())
    return f"{entries}; R is the radius of the bounding sphere; digits in brackets are the standard error of the last ones"


def _shown(parts: Mapping[str, Group]) -> list[str]:
    """Delta transmission and paths inside only where there are any."""
    return [name for name in FIGURES if name not in ("forward_delta", "inner_path")
            or any(part[name].data.any() for part in parts.values())]


def _described(grain: Exemplar) -> list[str]:
    """Two lines: what the grain's form is, what its surface is."""
    surface, kind = grain.surface, grain.surface["type"]
    form = "ball, exact" if grain.ball else f"{grain.shape['type']}, {len(grain.faces):,} triangles"
    words = {"dielectric": "index {index}", "diffuse": "reflectance {reflectance}", "conductor": "n {n}, k {k}"}[kind]
    ranges = {key: _span(surface[key]) for key in OF_SURFACES[kind]}
    rough = float(surface.get("roughness", 0.0))
    return [form, f"{SURFACES[kind]}, {words.format(**ranges)}" + (f", roughness {rough:g}" if rough else "")]


def _span(values) -> str:
    low, high = (f"{end(values):.4g}" for end in (min, max))
    return low if low == high else f"{low} to {high}"


def _radii(grains: Group) -> str:
    """The bounding radius in mm or um, or the range of several."""
    radius = np.sort(grains["radius"].data)
    scale, unit = (1e3, "mm") if radius[-1] >= 1e-4 else (1e6, "µm")
    text = f"{scale * radius[0]:.3g}" + (f" to {scale * radius[-1]:.3g}" if radius[-1] > radius[0] * (1 + 1e-9) else "")
    return f"{text} {unit}"


def _share(part: Group) -> str:
    weight = float(part["weight"].data[0])
    return f", {100 * weight:.3g} % of the grains" if weight < 1 else ""


def _effort(name: str, part: Group) -> str:
    """Paths, hits, interactions; shares whose inside and outside did not agree, and that were cut."""
    paths, hits, events, contradicted, lost = (part[key].data[0] for key in ("paths", "hits", "events", "contradicted", "lost"))
    if not paths:
        return f"{name}: in closed form, no paths"
    return (f"{name}: {whole(paths)} paths, {whole(hits)} hits, {events:.3g} surface interactions a hit, {_part(contradicted)} "
            f"inconsistent, {_part(lost)} cut off")


def whole(number) -> str:
    return f"{int(number):,}".replace(",", " ")


def _part(share: float) -> str:
    return "none" if share == 0 else f"{share:.1e}"


def _value(part: Group, name: str, k: int) -> tuple[float, float]:
    """A figure at a wavelength and its standard error."""
    value, error = (part[name + end].data for end in ("", "_error"))
    return float(value[min(k, value.size - 1)]), float(error[min(k, value.size - 1)])


def _range(name: str, parts) -> tuple[float, float]:
    """What a column shows: its natural range, wider where a value lies outside."""
    values = np.concatenate([part[name].data for part in parts.values()])
    low, high = FIGURES[name][2] or (0.0, 1.0)
    found_low, found_high = values.min(), values.max()
    if FIGURES[name][2] is None:
        high = 10.0 ** math.floor(math.log10(max(found_high, 1e-3)))
        high *= next(step for step in (1, 2, 5, 10) if step * high >= found_high)
    return (math.floor(2 * found_low) / 2 if found_low < low else low,
            math.ceil(2 * found_high) / 2 if found_high > high else high)


def _columns(parts, names, um) -> tuple:
    rows = [(name, part, k) for name, part in parts.items() for k in range(len(um))]
    columns = [("component", [name for name, _, _ in rows]), ("wavelength [um]", np.array([um[k] for _, _, k in rows]))]
    for name in names:
        cells = [_value(part, name, k) for _, part, k in rows]
        units = next(part[name].units for part in parts.values())
        columns.append((f"{name} [{units}]", np.array([value for value, _ in cells])))
        columns.append((f"standard error of {name} [{units}]", np.array([error for _, error in cells])))
    return tuple(columns)
