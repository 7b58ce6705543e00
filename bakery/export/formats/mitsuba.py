"""A medium for stock Mitsuba 3, and a baked surface for it and for bakery's plugin."""

import math
from pathlib import Path

from bakery.export.declaration import Exporter, Job, Option, Written, delta_taken_out
from bakery.export.formats.surfaces import TENSOR, Addition, Layer, table_of, with_surfaces
from bakery.store.outputs import FileKind, begins_as_text

EACH = Option("--each-wavelength", "one file a wavelength, instead of one in colour with a mean table.")


def write(job: Job) -> Written:
    from bakery.export.mitsuba import fragments
    from bakery.system.terminal import table

    asset, stem, by_wavelength = job.asset, job.stem, job.settings.get(EACH.name, False)
    parts = fragments(asset.tree, job.medium_name, job.colour.band_matrix(asset.wavelength), by_wavelength)
    lines: list = []
    for part in parts:
        head = [("  lost against the asset", "mean error", "largest error", "error of g", "forward peak cut")]
        rows = [("  by the regular grid", *_loss(part.resampling))]
        rows += [(f"  by that and one table, at {um:g} um", *_loss(loss)) for um, loss in part.colour.items()]
        lines.append([f"  phase function: {part.values} values over cos theta", *table(head + rows)])
    lines += delta_taken_out(max(part.delta for part in parts), "sigma_t")
    if any(part.peak for part in parts):
        largest = max(parts, key=lambda part: part.peak)
        lines.append(f"forward peak: up to {100 * largest.peak:.3g} % of the scattered light is deflected by less than "
                     f"{math.degrees(largest.within):.3g} deg, which no table of this length resolves; it counts as "
                     "unscattered, and sigma_t is smaller by it.  The errors above are of the rest.")
    lines += ["mean error: |difference| over the sphere; half of it is the share of the light that goes to another angle.",
              "forward peak cut: of the angles where the phase function is above half of its forward value."]
    useless = [f"{stem}{part.name}.xml: nearly useless: {part.useless()}" for part in parts if part.useless()]
    files = {f"{stem}{part.name}.xml": part.xml for part in parts}
    if not by_wavelength:
        useless += job.unreached_bands(next(iter(files)))
    return with_surfaces(job, Written(files, [part.as_dict() for part in parts], lines, useless), _surface)


def _surface(job: Job, layer: Layer) -> Addition:
    """The table, the fragment that has it, and one for the plugin."""
    from bakery.export.measured import BLEND, SHARP, mitsuba_text, plugin_text, tensor_file

    table, loss, lines = table_of(job, layer)
    scale = 1 / (1 - BLEND) if layer.mirrors else 1.0
    file, asset = f"{layer.name}.bsdf", Path(job.asset.path).name
    if layer.mirrors:
        lines.append(f"mirrored light: by a conductor of the same index and roughness {SHARP} beside it, which "
                     "sends it up to half a degree astray; the table is for this fragment alone")
    lines.append(f"{layer.name}_plugin.xml loses nothing: it names the asset for bakery's plugin")
    return Addition({f"{layer.name}.xml": mitsuba_text(layer.name, file, layer.index if layer.mirrors else 1.0, layer.free),
                     file: tensor_file(table, f"{layer.name}, baked", scale),
                     f"{layer.name}_plugin.xml": plugin_text(layer.name, asset, layer.number)}, loss, lines)


def _loss(loss) -> tuple[str, ...]:
    return (f"{200 * loss.misdirected:.2g} %", f"{100 * loss.largest:.2g} % at {math.degrees(loss.largest_at):.3g} deg",
            f"{loss.g:+.1e}", f"{100 * loss.peak:.2g} % of {math.degrees(loss.peak_angle):.3g} deg")


EXPORTER = Exporter(
    "mitsuba", "a medium and a baked surface for stock Mitsuba 3 (XML)", "Mitsuba 3, stock", ("medium",),
    "coefficients in RGB, one table of the phase function for all wavelengths (`--each-wavelength`: one each); "
    "of a baked surface the BRDF",
    "differences of the phase function between wavelengths; of narrow forward peaks the deflection; light that passes a surface",
    write, (EACH,),
    kinds={".xml": FileKind("Mitsuba scene", begins_as_text(r"<scene\b")), ".bsdf": TENSOR})
