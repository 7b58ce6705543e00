"""Particle data of Eradiate."""

from __future__ import annotations

from bakery.export.declaration import Exporter, Job, Written
from bakery.export.formats.disort import MOMENTS
from bakery.export.formats.solvers import NETCDF, moments, named, of_grains


def write(job: Job) -> Written:
    from bakery.export.netcdf import eradiate

    medium = named(job).ascending()
    series = moments(job, medium)
    lines = [f"{len(medium.wavelength)} wavelengths, {len(medium.medium.theta)} angles and {series.moments.shape[1]} moments; "
             "polarisation is left out.",
             "Eradiate goes linearly between the wavelengths; its optical thickness is the layer's, of this file only the "
             "extinction's change with the wavelength counts.", *of_grains(medium)]
    losses = [{"wavelength": um, "cut": cut} for um, cut in zip(series.wavelength.tolist(), series.cut.tolist(), strict=True)]
    return Written({f"{job.stem}.nc": eradiate(medium, series.moments)}, losses, lines)


EXPORTER = Exporter(
    "eradiate", "particle data, Aer-Core v2 (.nc)", "Eradiate 1.2", ("medium",),
    "coefficients, phase function and its moments at each wavelength", "polarisation; errors", write, (MOMENTS,),
    kinds={".nc": NETCDF})
