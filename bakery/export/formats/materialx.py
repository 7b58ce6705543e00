"""OpenPBR surfaces around a medium, as MaterialX."""

from bakery.export.declaration import Exporter, Job, Written
from bakery.export.formats.lobes import WITHIN, written
from bakery.export.formats.surfaces import Addition, Layer, fit_of, sampled, with_surfaces
from bakery.store.outputs import FileKind, begins_as_text


def write(job: Job) -> Written:
    from bakery.export.one_lobe import one_lobe
    from bakery.export.openpbr import materialx_text, surfaces

    bands = job.colour.band_matrix(job.asset.wavelength)
    medium = written(job, one_lobe, "mtlx",
                     lambda medium: materialx_text(job.medium_name, surfaces(medium, bands), medium.remarks()))
    return with_surfaces(job, medium, _surface)


def _surface(job: Job, layer: Layer) -> Addition:
    from bakery.export.openpbr import baked_surface, materialx_surface

    fit, loss, lines = fit_of(sampled(job, layer), layer)
    return Addition({f"{layer.name}.mtlx": materialx_surface(layer.name, baked_surface(fit), lines)}, loss, lines)


EXPORTER = Exporter(
    "materialx", "OpenPBR surfaces around the medium, and of a baked surface (.mtlx)", "programs with MaterialX and OpenPBR",
    ("medium",),
    "coefficients in RGB, one g; of a baked surface a fit",
    "the phase function but for g; g's change with wavelength; spectra; absorption below 1e-7 of sigma_t; a surface's "
    "lobes", write, (WITHIN,),
    kinds={".mtlx": FileKind("MaterialX document", begins_as_text(r"<materialx\b"))})
