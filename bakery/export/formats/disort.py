"""Moments for solvers of discrete ordinates."""

import numpy as np

from bakery.errors import UsageError
from bakery.export.declaration import Exporter, Job, Option, Written, delta_taken_out
from bakery.store.outputs import FileKind


def _thicknesses(text: str) -> np.ndarray:
    """`300 m`, or `[0.1, 1] mm`, in m."""
    from bakery.grammar.units import METRES, naming, parse_any

    with naming("--thickness"):
        values = np.atleast_1d(parse_any(text, METRES))
    if not (values >= 0).all():
        raise UsageError(f'--thickness: found "{text}"; expected lengths of 0 or more')
    return values


def _orders(text: str) -> int:
    from bakery.physics.moments import MOST

    if not text.isdecimal() or not 1 <= int(text) <= MOST:
        raise UsageError(f'--moments: found "{text}"; expected the highest order, a whole number from 1 to {MOST}')
    return int(text)


THICKNESS = Option("--thickness", 'thickness of the layer, such as 300m, or several, "[100, 300] m"; adds their optical '
                   "depths to the file.", "LENGTH", _thicknesses)
MOMENTS = Option("--moments", "highest order of the Legendre moments; by default as many as the asset's tolerance needs.", "N",
                 _orders)


def write(job: Job) -> Written:
    from bakery.export.disort import npz, ordinates
    from bakery.export.medium import medium_of, scattering_of
    from bakery.system.terminal import table

    asset = job.asset
    group = medium_of(asset.tree, asset.name)
    medium, tolerance = scattering_of(group), float(group.attributes["tolerance"])
    cloud = ordinates(asset.wavelength, medium, tolerance, job.settings.get(THICKNESS.name), job.settings.get(MOMENTS.name))
    orders = cloud.moments.shape[1] - 1
    rows = [(f"  at {um:g} um", f"{omega:.6g}", f"{chi[1]:.4f}", f"{100 * cut:.2g} %")
            for um, omega, chi, cut in zip(cloud.wavelength.tolist(), cloud.omega, cloud.moments, cloud.cut, strict=True)]
    lines = [f"{orders + 1} Legendre moments a wavelength, chi_l without the factor 2 l + 1",
             *table([("", "albedo", "g", "cut with the others"), *rows]),
             "cut: integral of |phase function - series|, twice the share of scattered light that the series sends elsewhere; "
             "`phase` over `mu` holds all of it."]
    lines += delta_taken_out(medium.delta.max())
    if medium.matrix is not None:
        lines.append("polarisation is left out: the solvers are for scalar light; `--to netcdf` keeps it.")
    file = f"{job.stem}.npz"
    warnings = [f"{file}: {orders + 1} moments leave up to {100 * cloud.cut.max():.2g} % of the light; the forward peak needs "
                "more, or a correction that takes `phase`"] if cloud.cut.max() > max(tolerance, 1e-6) else []
    losses = [{"wavelength": um, "moments": orders + 1, "cut": cut}
              for um, cut in zip(cloud.wavelength.tolist(), cloud.cut.tolist(), strict=True)]
    return Written({file: npz(cloud)}, losses, lines, warnings)


EXPORTER = Exporter(
    "disort", "Legendre moments, albedo and optical depth (.npz)", "PythonicDISORT, nanodisort", ("medium",),
    "coefficients, phase function and its moments at each wavelength", "polarisation; of few moments, what is cut", write,
    (THICKNESS, MOMENTS), kinds={".npz": FileKind("NumPy archive", lambda head: head.startswith(b"PK\x03\x04"))})
