"""Henyey-Greenstein and Draine lobes for renderers without tables: parameters, coefficients, and what each fit gets wrong."""

import json
import math
from dataclasses import asdict, dataclass

import numpy as np

from bakery.draw.files import csv_text
from bakery.export.fits import LABELS, lobe_fits
from bakery.export.medium import medium_of, scattering_of
from bakery.physics.medium.lobe_fits import Fit, fits
from bakery.physics.medium.lobes import Misfit
from bakery.store.tree import Group

USELESS = 0.3  # of the light to another angle, and
OFF = 10.0  # ratio of fit and table at some angle: what is said first of a fit
COEFFICIENTS = ("sigma_t", "sigma_s", "sigma_a", "albedo", "g")
MEANING = {
    "p": "sum of weight * (1 - g^2) / (4 pi (1 + g^2 - 2 g mu)^1.5) * (1 + alpha mu^2) / (1 + alpha (1 + 2 g^2) / 3) in 1/sr; "
         "mu = cosine of the angle between the directions of travel, 1 = forward; alpha = 0 is Henyey-Greenstein",
    "sigma_t, sigma_s, sigma_a": "1/m", "wavelength": "um, in vacuum", "angles": "rad", "diameter": "um, of water droplets",
    "coefficients": "of packed grains: light that leaves a grain in its old direction counts as not scattered, the same medium",
    "misdirected": "share of the scattered light that the fit sends to another angle than the table",
    "g (of an error)": "mean cosine of the fit less that of the table",
    "log_sphere, log_angle": "root mean square of log10(fit / table) over the sphere, over the angle",
    "factor, factor_at": "the ratio fit / table that is furthest from 1, and its angle",
    "peak, peak_table": "share of the light within peak_angle, where the table has fallen to half of its forward value",
    "mitsuba": "for mitsuba.load_dict, where the lobes are Henyey-Greenstein's",
}


@dataclass(frozen=True)
class Row:
    """The fits at one wavelength: um, coefficients by name (1/m, 1), fits by name in the order of tables."""

    wavelength: float
    coefficients: dict[str, float]
    fits: dict[str, Fit]


def lobe_rows(root: Group, name: str, diameter: float | None = None) -> list[Row]:
    """The fits of an asset's medium, one row a wavelength.

    diameter : um, where the medium is water droplets in air: adds the published parametrisation

    Raises AssetError : there is no medium
    """
    from bakery.physics.medium.phase import mean_cosine

    medium = medium_of(root, name)
    scattering = scattering_of(medium)
    theta, phase = scattering.theta, scattering.phase
    coefficients = {key: medium[key].data for key in COEFFICIENTS}
    if scattering.delta.any():  # the fits are of the light without the forward delta; coefficients that go with it
        coefficients |= {"sigma_t": scattering.sigma_t, "sigma_s": scattering.sigma_s, "albedo": scattering.albedo,
                         "g": mean_cosine(theta, phase)}
    rows = []
    for i, um in enumerate(root["wavelength"].data):
        mixtures = fits(theta, phase[i], diameter)
        rows.append(Row(float(um), {key: float(coefficients[key][i]) for key in COEFFICIENTS},
                        {key: mixtures[key] for key in LABELS if key in mixtures}))
    return rows


def droplet_diameter(root: Group) -> float | None:
    """Geometric mean diameter of an asset's only component, um; None where there are others, or no sizes.

    Of the usual means this is the one that the published parametrisation fits best: docs/lobes.md.
    """
    optics = root.members.get("optics")
    components = list(optics.groups.values()) if isinstance(optics, Group) else []
    if len(components) != 1 or not {"radius", "weight"} <= components[0].members.keys():
        return None
    return float(2 * np.exp(np.sum(components[0]["weight"].data * np.log(components[0]["radius"].data))))


def hg_files(root: Group, name: str, rows: list[Row]) -> dict[str, str | bytes]:
    """File names (without the asset's) and contents: all as JSON, a table as CSV, a picture at about 0.55 um."""
    from bakery.draw.picture import drawn
    from bakery.report.figures import title_of

    middle = int(np.argmin([abs(row.wavelength - 0.55) for row in rows]))
    medium = scattering_of(root["medium"])
    picture = lobe_fits(rows[middle].wavelength, medium.theta, medium.phase[middle], rows[middle].fits)
    return {"lobes.json": _json(root, name, rows), "lobes.csv": _csv(rows),
            "lobes.png": drawn(picture, ("png",), title_of(root))["png"]}


def useless(rows: list[Row]) -> list[str]:
    """What is to be said first: fits that misdirect much of the light, and whether the best of all is far off at some angle."""
    worst = {key: max(row.fits[key].misfit.misdirected for row in rows) for key in rows[0].fits}
    poor = {key: share for key, share in worst.items() if share > USELESS}
    best = min(worst, key=worst.get)
    warnings = [f"of little use, up to {100 * max(poor.values()):.2g} % of the light goes to another angle: "
                + "; ".join(LABELS[key] for key in poor)] if poor else []
    off = max((row.fits[best].misfit for row in rows), key=lambda misfit: abs(math.log(misfit.factor)))
    if far_off(off):
        warnings.append(f"even the best, {LABELS[best]}, is {ratio(off)}")
    return warnings


def far_off(misfit: Misfit) -> bool:
    """Whether a fit is out by more than a factor of ten at some angle."""
    return abs(math.log(misfit.factor)) > math.log(OFF)


def ratio(misfit: Misfit) -> str:
    """Where a fit is furthest off, in words."""
    times = f"{misfit.factor:.3g} times too bright" if misfit.factor >= 1 else f"{1 / misfit.factor:.3g} times too dark"
    return f"{times} at {math.degrees(misfit.factor_at):.3g} deg"


def errors(rows: list[Row]) -> list[dict]:
    """What each fit gets wrong, for machines (`--json`)."""
    return [{"wavelength": row.wavelength, "fits": {key: asdict(fit.misfit) for key, fit in row.fits.items()}} for row in rows]


def mitsuba(lobes) -> dict | None:
    """Henyey-Greenstein lobes as a dictionary for `mitsuba.load_dict`; None where one is Draine's."""
    if any(lobes.alpha):
        return None
    plain = [{"type": "hg", "g": g} for g in lobes.g]
    if len(plain) == 1:
        return plain[0]
    return {"type": "blendphase", "weight": lobes.weight[1], "first": plain[0], "second": plain[1]}


def _json(root: Group, name: str, rows: list[Row]) -> str:
    return json.dumps({
        "name": name, "content_hash": str(root.attributes.get("content_hash", "")), "meaning": MEANING,
        "wavelengths": [{
            "wavelength": row.wavelength, **row.coefficients,
            "fits": {key: _fit(fit) for key, fit in row.fits.items()},
        } for row in rows],
    }, indent=2, allow_nan=False) + "\n"


def _fit(fit: Fit) -> dict:
    lobes = fit.lobes
    entry = {"lobes": [dict(zip(("weight", "g", "alpha"), lobe, strict=True))
                       for lobe in zip(lobes.weight, lobes.g, lobes.alpha, strict=True)], "error": asdict(fit.misfit)}
    scene = mitsuba(lobes)
    return entry | ({"diameter": fit.diameter} if fit.diameter else {}) | ({"mitsuba": scene} if scene else {})


def _csv(rows: list[Row]) -> str:
    """One row a wavelength and fit; a single lobe leaves the second empty."""
    flat = [(row, key, fit) for row in rows for key, fit in row.fits.items()]

    def of(lobe: int, field: str) -> list:
        return [getattr(fit.lobes, field)[lobe] if lobe < len(fit.lobes.g) else "" for _, _, fit in flat]

    units = {"sigma_t": "1/m", "sigma_s": "1/m", "sigma_a": "1/m"}
    columns = [("wavelength [um]", [row.wavelength for row, _, _ in flat])]
    columns += [(f"{key} [{units.get(key, '1')}]", [row.coefficients[key] for row, _, _ in flat]) for key in COEFFICIENTS]
    columns += [("fit", [key for _, key, _ in flat]), ("diameter [um]", [fit.diameter or "" for _, _, fit in flat])]
    columns += [(f"{field} {lobe + 1} [1]", of(lobe, field)) for lobe in range(2) for field in ("weight", "g", "alpha")]
    names = {"factor_at": "rad", "peak_angle": "rad"}
    columns += [(f"{'error of g' if key == 'g' else key} [{names.get(key, '1')}]",
                 [getattr(fit.misfit, key) for _, _, fit in flat]) for key in asdict(flat[0][2].misfit)]
    return csv_text(columns)
