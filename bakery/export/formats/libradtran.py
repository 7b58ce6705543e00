"""Optical properties for libRadtran: a table as its `mie` tool writes it, and the text of a layer."""

import numpy as np

from bakery.errors import UsageError
from bakery.export.declaration import Exporter, Job, Written, delta_taken_out
from bakery.export.formats.disort import MOMENTS
from bakery.export.formats.hg import water_in_air
from bakery.export.formats.solvers import NETCDF, moments, named, of_polarisation, quantity
from bakery.store.outputs import FileKind, begins_as_text
from bakery.store.tree import Dataset, Group

MASS = quantity("--mass-concentration", "mass of the particles per volume, such as 0.3g/m^3; by default their volume times "
                "--density.", "MASS", "MASS_CONCENTRATION")
DENSITY = quantity("--density", "density of the particles, such as 2.6g/cm^3; by default 1 g/cm^3 for water in air.",
                   "DENSITY", "MASS_DENSITY")
RADIUS = quantity("--effective-radius", "effective radius, such as 10um; by default that of the asset's component, if it has "
                  "one.", "LENGTH", "LENGTH")


def write(job: Job) -> Written:
    from bakery.export.netcdf import explicit, libradtran

    medium = named(job).ascending()
    radius, mass, density = _particles(job, medium)
    series = moments(job, medium)
    lines = [[f"{len(medium.wavelength)} wavelengths, effective radius {radius:.4g} um: the asset's own extinction at "
              f"{1e3 * mass:.4g} g/m^3 in a wc_file.",
              "for `wc_properties FILE interpolate`, or ic_, profile_.",
              of_polarisation(medium, "the elements 12, 33 and 34 at every angle, and their Legendre moments",
                              "the format has none in generalised spherical functions") + "."],
             [f"a layer for `aerosol_file explicit`: extinction in 1/km, {series.moments.shape[1]} moments without the factor "
              "2 l + 1; the phase function beyond them, and polarisation, are left out."],
             *delta_taken_out(medium.medium.delta.max())]
    losses = [{"wavelength": um, "moments": series.moments.shape[1], "cut": cut}
              for um, cut in zip(series.wavelength.tolist(), series.cut.tolist(), strict=True)]
    files = {f"{job.stem}.mie.cdf": libradtran(medium, series.moments, 1e3 * mass, radius, 1e-3 * density),
             f"{job.stem}.layer": explicit(medium, series.moments)}
    return Written(files, losses, lines)


def _particles(job: Job, medium) -> tuple[float, float, float]:
    """Effective radius (um), mass concentration (kg/m^3) and density (kg/m^3)."""
    asked = {option: job.settings.get(option.name) for option in (RADIUS, MASS, DENSITY)}
    component = _only_component(job.asset.tree)
    radius, mass, density = asked.values()
    if density is None and water_in_air(job.asset.recipe):
        density = 1000.0
    volume = None
    if component is not None:
        weight, nodes = component["weight"].data, component["radius"].data
        radius = float(weight @ nodes**3 / (weight @ nodes**2)) if radius is None else radius
        # as many as the asset's scattering takes; um^3 and um^2 to m
        first = int(np.argsort(job.asset.wavelength)[0])
        number = medium.medium.sigma_s[0] / (1e-12 * component["mean_scattering"].data[first])
        volume = number * 1e-18 * float(component["mean_volume"].data[0])
    if radius is None:
        raise UsageError(f"{job.asset.name}: has not one kind of particles, whose effective radius libradtran needs; "
                         "give --effective-radius 10um")
    if mass is None:
        if volume is None or density is None:
            first = "--density 2.6g/cm^3 or " if volume is not None else ""
            raise UsageError(f"{job.asset.name}: holds no mass of particles, by which libradtran scales extinction; give {first}"
                             "--mass-concentration 0.3g/m^3")
        mass = volume * density
    return radius, mass, density or (mass / volume if volume else 1000.0)


def _only_component(root: Group) -> Group | None:
    """The particles of an asset that has one kind of them."""
    optics = root.members.get("optics")
    groups = list(optics.groups.values()) if isinstance(optics, Group) else []
    needed = ("radius", "weight", "mean_scattering", "mean_volume")
    fits = len(groups) == 1 and all(isinstance(groups[0].members.get(name), Dataset) for name in needed)
    return groups[0] if fits and (groups[0]["mean_scattering"].data > 0).all() else None


EXPORTER = Exporter(
    "libradtran", "optical properties as its mie tool writes them (.mie.cdf), and the text of a layer", "libRadtran 2",
    ("medium",), "coefficients, phase function and its moments at each wavelength; of polarised ones s12, s33, s34",
    "expansion coefficients in generalised spherical functions; errors; sizes but for the effective radius", write,
    (MASS, DENSITY, RADIUS, MOMENTS),
    kinds={".cdf": NETCDF, ".layer": FileKind("libRadtran layer", begins_as_text(r"\A\d+\.\d+ \S+ \d\.\d+ 1\.0+e\+00"))})
