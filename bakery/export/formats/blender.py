"""A script that makes a material for Cycles."""

from bakery.errors import UsageError
from bakery.export.declaration import Exporter, Job, Option, Written
from bakery.export.formats.lobes import WITHIN, written
from bakery.export.formats.surfaces import (
    MIRRORED,
    Addition,
    Layer,
    errors_of,
    errors_told,
    fit_of,
    profile_of,
    sampled,
    with_surfaces,
)
from bakery.store.outputs import FileKind, begins_as_text


def _between(flag: str, low: float, high: float):
    """What reads the value of an option: a number between two others."""
    def parsed(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            raise UsageError(f'{flag}: found "{text}"; expected a number from {low:g} to {high:g}')
        return value
    return parsed


INDEX = Option("--index", "refractive index of the body's surface, such as 1.35 for milk; by default there is no surface.",
               "INDEX", _between("--index", 0.2, 5))
ROUGHNESS = Option("--roughness", "roughness of the surface of --index, alpha of GGX as in Mitsuba; 0 is smooth.", "ALPHA",
                   _between("--roughness", 0, 1))


def write(job: Job) -> Written:
    from bakery.export.blender import blender_text, cycles_medium

    index, roughness = (job.settings.get(option.name) for option in (INDEX, ROUGHNESS))
    if roughness is not None and index is None:
        raise UsageError("--roughness: found without --index, without which there is no surface; use both")
    bands = job.colour.band_matrix(job.asset.wavelength)
    medium = written(job, cycles_medium, "py",
                     lambda medium: blender_text(job.medium_name, medium, bands, index, roughness or 0.0))
    return with_surfaces(job, medium, _surface)


def _surface(job: Job, layer: Layer) -> Addition:
    from bakery.export.blender import surface_text
    from bakery.physics.surfaces.by_view import by_view

    left_out = []
    if layer.index < 1:
        left_out = ["left out: the boundary, as Principled BSDF takes no index below 1"
                    + (f"; {MIRRORED.format(*layer.mirrored())}" if layer.mirrors else "")]
        layer = layer._replace(index=1.0, roughness=0.0)
    samples = sampled(job, layer)
    fit, loss, lines = fit_of(samples, layer)
    lines += left_out
    curves = by_view(samples)
    if curves.better_than(fit):
        loss["by_view"] = errors_of(curves)
        lines.append(f"LOOK_UP = True takes colours of the base and of a glossy lobe by the angle of view: {errors_told(curves)}")
    else:
        curves = None
    widths = None
    if (spread := profile_of(job, layer)) is not None:
        widths, misfit = spread
        loss["profile"], loss["profile_misfit"] = widths.tolist(), misfit
        lines.append("SPREAD = True lets light spread by Burley and Christensen's profile, d " +
                     ", ".join(f"{1e3 * width:.3g}" for width in widths) + f" mm: off by up to {100 * misfit:.2g} % of the light "
                     "within a distance")
    return Addition({f"{layer.name}.py": surface_text(layer.name, fit, lines, widths, curves)}, loss, lines)


EXPORTER = Exporter(
    "blender", "a script that makes a material for Cycles, HG + Draine (.py), and one of a baked surface", "Cycles in Blender 5",
    ("medium",),
    "coefficients in RGB, two lobes (HG + Draine) for all wavelengths; of a baked surface a fit or curves over the angle of view",
    "the phase function's shape beyond the lobes; its change with wavelength; spectra; a surface's lobes", write,
    (WITHIN, INDEX, ROUGHNESS),
    kinds={".py": FileKind("Blender script", begins_as_text(r"\A# A baked (medium|surface) for Cycles "))})
