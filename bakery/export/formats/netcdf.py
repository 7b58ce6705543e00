"""A medium by the CF conventions."""

from bakery.export.declaration import Exporter, Job, Written, delta_taken_out
from bakery.export.formats.solvers import NETCDF, named, of_polarisation


def write(job: Job) -> Written:
    from bakery.export.netcdf import cf

    medium = named(job)
    lines = [f"{len(medium.wavelength)} wavelengths and {len(medium.medium.theta)} angles, every digit of coefficients and "
             "phase function; tables of other stages are left out (`--to csv` has all).",
             of_polarisation(medium, "s12, s33 and s34 at every angle, and expansion coefficients in generalised spherical "
                             "functions to the asset's tolerance") + ".", *delta_taken_out(medium.medium.delta.max())]
    return Written({f"{job.stem}.nc": cf(medium)}, [], lines)


EXPORTER = Exporter(
    "netcdf", "coefficients and phase function by the CF conventions (.nc)", "xarray, netCDF4, ncdump", ("medium",),
    "coefficients, phase function and their errors at each wavelength; of polarised ones s12, s33, s34 and expansion "
    "coefficients",
    "tables of other stages; provenance", write,
    kinds={".nc": NETCDF})
