"""What the formats share that hold a medium as numbers: what is lost in words, moments, errors."""

import math

import numpy as np

from bakery.export.declaration import Job, Option
from bakery.export.formats.disort import MOMENTS
from bakery.store.outputs import FileKind

NETCDF = FileKind("NetCDF file", lambda head: head.startswith((b"CDF", b"\x89HDF\r\n\x1a\n")))


def named(job: Job):
    """The asset's medium, without its forward delta, and what is said of it in a file."""
    from bakery.export.medium import medium_of, scattering_of
    from bakery.export.named import Named

    asset = job.asset
    group = medium_of(asset.tree, asset.name)
    medium = scattering_of(group)
    errors = {name: group[member].data for name, member in (("sigma_a", "sigma_a_bias"), ("phase", "phase_bias"))
              if member in group.members and not medium.delta.any()}
    told = group.attributes
    return Named(np.asarray(asset.wavelength, float), medium, asset.name, asset.content_hash,
                 str(asset.attributes.get("bakery_version", "")), errors, float(told["tolerance"]),
                 float(told["achieved_error"]), str(told["error_measure"]))


def moments(job: Job, medium):
    """`bakery.export.disort.Ordinates` of a medium that `named` gave."""
    from bakery.export.disort import ordinates

    return ordinates(medium.wavelength, medium.medium, medium.tolerance, None, job.settings.get(MOMENTS.name))


def of_polarisation(medium, kept: str, lost: str = "") -> str:
    """What is said of the elements s12, s33, s34: what of them is in the file, what of them is lost, or that there are none."""
    if medium.medium.matrix is None:
        return ("the asset has no polarisation (particles with `phase: {polarized: true}` would)"
                if not medium.medium.delta.any() else "polarisation is left out")
    return f"polarisation: {kept}" + (f"; {lost}" if lost else "")


def quantity(flag: str, words: str, metavar: str, kind: str) -> Option:
    """An option whose value is a number with a unit, above 0; `kind` is a name in `bakery.grammar.units`."""
    def parsed(text: str) -> float:
        from bakery.grammar import units

        return units.asked(flag, text, getattr(units, kind), (0, math.inf), "a value above 0")

    return Option(flag, words, metavar, parsed)
