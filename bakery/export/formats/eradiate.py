"""Particle data of Eradiate."""

from bakery.export.declaration import Exporter, Job, Written, delta_taken_out
from bakery.export.formats.disort import MOMENTS
from bakery.export.formats.solvers import NETCDF, moments, named, of_polarisation


def write(job: Job) -> Written:
    from bakery.export.netcdf import eradiate

    medium = named(job).ascending()
    series = moments(job, medium)
    lines = [f"{len(medium.wavelength)} wavelengths, {len(medium.medium.theta)} angles and {series.moments.shape[1]} moments.",
             of_polarisation(medium, "the elements 12, 33 and 34 at every angle; Eradiate takes the data as those of spheres",
                             "the format has moments of 11 alone, so expansion coefficients are left out") + ".",
             "Eradiate goes linearly between the wavelengths; its optical thickness is the layer's, of this file only the "
             "extinction's change with the wavelength counts.", *delta_taken_out(medium.medium.delta.max())]
    losses = [{"wavelength": um, "cut": cut} for um, cut in zip(series.wavelength.tolist(), series.cut.tolist(), strict=True)]
    # not NAME.nc, as `--to netcdf` writes: both into one folder, the second would replace the first
    return Written({f"{job.stem}_eradiate.nc": eradiate(medium, series.moments)}, losses, lines)


EXPORTER = Exporter(
    "eradiate", "particle data, Aer-Core v2 (.nc)", "Eradiate 1.2", ("medium",),
    "coefficients, phase function and its moments at each wavelength; of polarised ones s12, s33, s34",
    "expansion coefficients of s12, s33, s34; errors", write, (MOMENTS,),
    kinds={".nc": NETCDF})
