"""A medium for pbrt-v4, and a baked surface as a measured BRDF."""

from bakery.export.declaration import Exporter, Job, Written
from bakery.export.formats.lobes import WITHIN, written
from bakery.export.formats.surfaces import MIRRORED, TENSOR, Addition, Layer, table_of, with_surfaces
from bakery.store.outputs import FileKind, begins_as_text


def write(job: Job) -> Written:
    from bakery.export.one_lobe import one_lobe
    from bakery.export.pbrt import pbrt_text

    medium = written(job, one_lobe, "pbrt", lambda medium: pbrt_text(job.medium_name, medium), spectra=True)
    return with_surfaces(job, medium, _surface)


def _surface(job: Job, layer: Layer) -> Addition:
    """The table, and the material that has it."""
    from bakery.export.measured import pbrt_text, tensor_file

    table, loss, lines = table_of(job, layer)
    if layer.mirrors:
        loss["mirrored"] = [0.01 * percent for percent in layer.mirrored()]
        lines.append(f"left out: {MIRRORED.format(*layer.mirrored())}")
    file = f"{layer.name}.bsdf"
    return Addition({f"{layer.name}.pbrt": pbrt_text(layer.name, file), file: tensor_file(table, f"{layer.name}, baked")},
                    loss, lines)


EXPORTER = Exporter(
    "pbrt", "a medium and a baked surface for pbrt-v4", "pbrt-v4", ("medium",),
    "spectra of sigma_a and sigma_s, one g; of a baked surface the BRDF",
    "the phase function but for g; g's change with wavelength; light that passes a surface, and what a smooth one mirrors",
    write, (WITHIN,),
    kinds={".pbrt": FileKind("pbrt file", begins_as_text(r"^MakeNamed(Medium|Material) ")), ".bsdf": TENSOR})
