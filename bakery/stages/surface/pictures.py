"""Pictures of surfaces: lobes at four incidences, albedo against the angle of incidence, spread."""

from collections.abc import Iterator

import numpy as np

from bakery.draw.axes import legend_beside
from bakery.draw.picture import Picture
from bakery.draw.style import INK, colours
from bakery.stages.surface.view import Surface, view
from bakery.store.tree import Group

INCIDENCES = (0.0, 30.0, 60.0, 80.0)  # degrees
_STEEPEST = 89.0  # degrees that are drawn
_NAMED = 8  # wavelengths in a legend


def pictures(root: Group) -> Iterator[Picture]:
    """Of each thickness: lobes, albedos and spread at all wavelengths; lobes below it where light passes."""
    surface, um = view(root), np.asarray(root["wavelength"].data, float)
    yield from lobes(surface, um, "reflectance", "surface_lobes", "Reflectance")
    if "transmitted" in surface:
        yield from lobes(surface, um, "transmittance", "surface_transmitted", "Transmittance")
    yield from albedos(surface, um)
    if "spread" in surface:
        yield from spreads(surface, um)


def _layers(surface: Surface, values) -> Iterator:
    """Of each thickness the ending of file names, words for titles, and its part (L, ...) of values (L, T, ...)."""
    widths = surface.get("thickness")
    for layer in range(surface.layers):
        thick = "" if widths is None else f", {_in_words(widths[layer])} thick"
        yield f"_{layer}" if layer else "", thick, values[:, layer] if surface.layers > 1 else values


def _in_words(um: float) -> str:
    factor, unit = (1, "µm") if um < 1e3 else (1e3, "mm") if um < 1e6 else (1e6, "m")
    return f"{um / factor:g} {unit}"


def lobes(surface: Surface, um, name: str, file: str, title: str) -> Iterator[Picture]:
    """pi times the BRDF in the plane of incidence, a panel an incidence, a curve a wavelength."""
    signed = np.linspace(-_STEEPEST, _STEEPEST, 179)
    every = np.stack([getattr(surface, name)(np.radians(angle), np.radians(np.abs(signed)), np.where(signed < 0, np.pi, 0.0))
                      for angle in INCIDENCES], axis=-2)
    for ending, thick, values in _layers(surface, every):
        yield _lobes(um, signed, np.moveaxis(values, -2, 0), file + ending, title, thick)


def _lobes(um, signed, values, file: str, title: str, thick: str) -> Picture:
    ink, unit = colours(um), "π × BRDF" if title == "Reflectance" else "π × BTDF"

    def draw(figure):
        panels = figure.subplots(1, len(INCIDENCES), sharex=True, sharey=True)
        for axes, angle, lobe in zip(panels, INCIDENCES, values, strict=True):
            for colour, row, x in zip(ink, lobe, um, strict=True):
                axes.plot(signed, row, color=colour, label=f"{x:g} µm")
            axes.axvline(-angle, color=INK, linewidth=0.8, linestyle=(0, (2, 2)))
            axes.set_title(f"from {angle:g}°")
            axes.set_xticks([-60, 0, 60])
        top, flat = (max(float(lobe.max()) for lobe in part) for part in (values[:-1], values[-1:]))
        panels[0].set(ylim=(0, 1.1 * top if top > 0 else 1.0), ylabel=f"{title} ({unit})")
        if flat > 1.1 * top > 0:
            panels[-1].annotate(f"to {flat:.2g}", (0.7, 0.93), xycoords="axes fraction", ha="right", fontsize=8.5)
        figure.supxlabel("angle of exitance (°); above 0: forward" + thick.replace(",", "; layer"), fontsize=9.5)
        legend_beside(figure, panels[0], _NAMED)

    columns = [("from [deg]", np.repeat(INCIDENCES, len(signed))), ("to [deg]", np.tile(signed, len(INCIDENCES)))]
    columns += [(f"{title.lower()} [1] at {x:g} um", np.concatenate([lobe[k] for lobe in values])) for k, x in enumerate(um)]
    caption = f"{title} in the plane of incidence: pi times the radiance over the irradiance, 1 for a white Lambertian surface.  "
    caption += "Dashed: back to where the light comes from.  Light that a smooth boundary mirrors is left out.  "
    caption += f"The scale is that of the other panels: what goes beyond it from {INCIDENCES[-1]:g}° is cut, its largest value "
    caption += "written."
    return Picture(file, f"Surface: {title.lower()}{thick}", caption, (9.6, 3.2), draw, tuple(columns))


def albedos(surface: Surface, um) -> Iterator[Picture]:
    """Plane albedo over the angle of incidence."""
    theta = np.append(np.linspace(0, 89, 90), 89.9)
    for ending, thick, values in _layers(surface, surface.albedo(np.radians(theta))):
        yield _albedos(um, theta, values, ending, thick)


def _albedos(um, theta, values, ending: str, thick: str) -> Picture:
    ink = colours(um)

    def draw(figure):
        axes = figure.subplots()
        for colour, row, x in zip(ink, values, um, strict=True):
            axes.plot(theta, row, color=colour, label=f"{x:g} µm")
        axes.set(xlim=(0, 90), ylim=(0, 1.02), xlabel="angle of incidence (°)", ylabel="albedo")
        axes.set_title(f"Albedo{thick}")
        legend_beside(figure, axes, _NAMED)

    columns = (("theta_in [deg]", theta), *((f"albedo [1] at {x:g} um", row) for x, row in zip(um, values, strict=True)))
    caption = "Share of the light from an angle that comes back, mirrored light included."
    return Picture(f"surface_albedo{ending}", f"Surface: albedo{thick}", caption, (6.0, 3.6), draw, columns)


def spreads(surface: Surface, um) -> Iterator[Picture]:
    """Share of the light that comes out within a distance, and the nearest profile of Burley and Christensen."""
    from bakery.physics.surfaces.spread import profile_within

    edges, profile = surface["spread_radius"], np.maximum(surface["profile"], 1e-30)
    # distances of each thickness, in a row: (T, R)
    radii = np.geomspace(np.maximum(edges[..., 0].min(axis=0), 1e-9), np.maximum(edges[..., -1].max(axis=0), 1e-8), 241, axis=-1)
    for layer, (ending, thick, values) in enumerate(_layers(surface, surface.spread_within(radii))):
        if not edges[:, layer].any():  # no layer
            continue
        radius, values = radii[layer], values[:, layer]
        fits = np.stack([profile_within(radius, d) if d > 1e-30 else 0 * radius for d in profile[:, layer]])
        # the table goes on where nothing more comes out
        growing = radius[(values < 0.999 * values[:, -1:]).any(axis=0)]
        seen = radius <= 2 * (growing[-1] if growing.size else radius[-1])
        yield _spreads(um, radius[seen], values[:, seen], fits[:, seen], ending, thick)


def _spreads(um, radius, values, fits, ending: str, thick: str) -> Picture:
    ink = colours(um)

    def draw(figure):
        axes = figure.subplots()
        for colour, row, fit, x in zip(ink, values, fits, um, strict=True):
            axes.plot(radius, row, color=colour, label=f"{x:g} µm")
            axes.plot(radius, fit, color=colour, linewidth=0.8, linestyle=(0, (2, 2)))
        axes.set(xscale="log", ylim=(0, 1.02), xlabel="distance (µm)", ylabel="share of the light", title=f"Spread{thick}")
        legend_beside(figure, axes, _NAMED)

    columns = [("distance [um]", radius), *((f"share [1] at {x:g} um", row) for x, row in zip(um, values, strict=True)),
               *((f"profile [1] at {x:g} um", row) for x, row in zip(um, fits, strict=True))]
    caption = "Light that comes out within a distance of where it went in, of what comes out.  Dashed: the nearest profile of "
    caption += "Burley and Christensen."
    return Picture(f"surface_spread{ending}", f"Surface: spread{thick}", caption, (6.0, 3.6), draw, tuple(columns))
