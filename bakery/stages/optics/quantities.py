"""The optical quantities of an asset in one table: what `bake query ASSET optics` and `asset.optics.table()` give.

Those of the medium as a whole come from the group `medium`, so that any asset with one has them; those of particles need the
group `optics`.
What an asset cannot say stands in the table with the reason.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from bakery.errors import UsageError
from bakery.grammar.units import METRES, WAVELENGTH, Quantity, Wrong, parse
from bakery.physics.medium import quantities as figures
from bakery.physics.medium import spectral
from bakery.physics.medium.phase import phase_at
from bakery.stages.coordinates import stated_error, wavelengths
from bakery.stages.declaration import Query, lists_of
from bakery.stages.medium.between import at_wavelengths, can
from bakery.stages.optics.composition import MASS_DENSITY, components
from bakery.stages.optics.quantity_table import PAIRS, SCALAR, Figure, QuantityTable
from bakery.store.tree import Group

PATH = "optics"
LENGTH = Quantity("length", "lengths", "m", {**METRES.powers, "km": 3}, "m")  # of a path
_MEDIUM = (("extinction", "sigma_t", "extinction coefficient"), ("scattering", "sigma_s", "scattering coefficient"),
           ("absorption", "sigma_a", "absorption coefficient"),
           ("single_scattering_albedo", "albedo", "scattering over extinction"),
           ("asymmetry", "g", "mean cosine of the scattering angle"))
_COEFFICIENTS = ("sigma_t", "sigma_s", "sigma_a", "albedo")
_NO_S22 = ("needs the matrix element s22, which the asset does not hold: it is known of spheres alone (s22 = s11), so an asset "
           "baked from particles would do")
_NO_S12 = "needs the matrix element s12, which the asset does not hold; particles with phase: {polarized: true} would do"


def table(root: Group, length=None, density=None, wavelength=None) -> QuantityTable:
    """The table of an asset's tree.

    length : m, or text with its unit: the path of which the optical depth is wanted
    density : kg/m^3, or text with its unit, of components of which the recipe states none
    wavelength : um, one or several, or text: instead of the baked ones, also between them

    Raises UsageError : an asset without a medium, values that have no meaning
    """
    medium = root.members.get("medium")
    if not can(medium):
        raise UsageError(f"{PATH}: the asset holds no medium of which optical quantities are known; a recipe with particles, "
                         "medium or grains would do")
    length, density = _number(length, LENGTH, "length", 0.0), _number(density, MASS_DENSITY, "density", None)
    stored = root["wavelength"].data
    um = stored if wavelength is None else np.atleast_1d(wavelengths(wavelength, stored))
    if wavelength is not None:
        medium = at_wavelengths(medium, stored, um)
    rows = [*(Figure(name, medium[member].units, words, medium[member].data, _error(medium, member))
              for name, member, words in _MEDIUM),
            *_backwards(medium, PATH in root.members), *_exponents(medium, um),
            *_of_paths(medium, length), *_of_particles(root, spectral.places(stored, um), density)]
    return QuantityTable(PATH, um, tuple(rows))


def _number(value, quantity: Quantity, name: str, least) -> float | None:
    """A number in the unit of a quantity, also of text; UsageError where it is none, or not above 0 (not below `least`)."""
    if value is None:
        return None
    try:
        number = parse(value, quantity) if isinstance(value, str) else float(value)
    except Wrong as wrong:
        raise UsageError(f"{name}: {wrong.found}; {wrong.expected}") from None
    except (TypeError, ValueError):
        raise UsageError(f"{name}: found {value}; expected one number in {quantity.base}, or text with its unit") from None
    if not np.isfinite(number) or number < 0 or number == 0 and least is None:
        raise UsageError(f"{name}: found {number:g} {quantity.base}; expected a number above 0")
    return number


def _error(medium: Group, name: str) -> np.ndarray:
    """What is stated of a figure, else what its stage has reached; absolute.

    Coefficients that a recipe gives are exact.  The albedo follows from two coefficients: at 1 it has the error of what is
    absorbed alone.
    """
    stated, reached = stated_error(medium, name), float(medium.attributes.get("achieved_error", 0.0))
    if stated is not None:
        return stated
    value = np.abs(medium[name].data)
    if name not in _COEFFICIENTS:
        return reached * value
    if "phase_bias" in medium.members and "sigma_a_bias" not in medium.members:
        return 0 * value
    if name == "albedo" and "sigma_a_bias" in medium.members:
        return figures.albedo_error(value, medium["sigma_t"].data, reached, medium["sigma_a_bias"].data)
    return reached * value


def _backwards(medium: Group, spheres: bool) -> Iterator[Figure]:
    phase, off = medium["phase"].data[:, -1], _error(medium, "phase")[:, -1]
    sigma_s, albedo = medium["sigma_s"].data, medium["albedo"].data
    relative = figures.ratio(off, phase)
    beta = sigma_s * phase
    yield Figure("backscatter", "1/(m sr)", "scattering coefficient times phase function straight back", beta,
                 sigma_s * off + phase * _error(medium, "sigma_s"))
    lidar = figures.ratio(1.0, albedo * phase)
    yield Figure("lidar_ratio", "sr", "extinction over back-scatter", lidar,
                 lidar * (relative + figures.ratio(_error(medium, "albedo"), albedo)), _gaps(lidar, "nothing is scattered back"))
    words = "of linearly polarised light straight back, (s11 - s22) / (s11 + s22)"
    if spheres:
        value = figures.linear_depolarisation(phase, phase)
        yield Figure("depolarisation_ratio", "1", words, value, 0 * value, _gaps(value, "nothing is scattered back"))
    else:
        yield Figure("depolarisation_ratio", "1", words, missing=_NO_S22)
    words = "of unpolarised light at 90 degrees, (s11 + s12) / (s11 - s12)"
    if "s12" not in medium.members:
        yield Figure("depolarisation_ratio_90", "1", words, missing=_NO_S12)
        return
    theta = medium["theta"].data
    s11, s12, error = (phase_at(theta, values, np.pi / 2) for values in
                       (medium["phase"].data, medium["s12"].data, _error(medium, "phase")))
    value = figures.natural_depolarisation(s11, s12)
    # both elements are off by at most the error of phase: of the quotient that is (1 + value) error / across, twice
    yield Figure("depolarisation_ratio_90", "1", words, value, 2 * (1 + value) * figures.ratio(error, s11 - s12))


def _exponents(medium: Group, um: np.ndarray) -> Iterator[Figure]:
    order = np.argsort(um, kind="stable")
    for name, member in (("extinction", "sigma_t"), ("scattering", "sigma_s"), ("absorption", "sigma_a")):
        title, words = f"angstrom_exponent_{name}", f"-d ln({name}) / d ln(wavelength) between neighbouring wavelengths"
        if len(np.unique(um)) < max(len(um), 2):
            yield Figure(title, "1", words, over=PAIRS, missing="needs two different wavelengths")
            continue
        value, error = figures.angstrom_exponent(um[order], medium[member].data[order], _error(medium, member)[order])
        yield Figure(title, "1", words, value, error, _gaps(value, f"no power law where the {name} is 0"), over=PAIRS)


def _of_paths(medium: Group, length: float | None) -> Iterator[Figure]:
    sigma_t, error = medium["sigma_t"].data, _error(medium, "sigma_t")
    if length is None:
        yield Figure("optical_depth", "1", "extinction times the length of a path", missing="needs a length, such as length=100m")
    else:
        of = f"of a path of {length:g} m"
        yield Figure("optical_depth", "1", of, length * sigma_t, length * error)
        yield Figure("transmittance", "1", of, np.exp(-length * sigma_t), np.exp(-length * sigma_t) * np.expm1(length * error))
    for name, contrast, words in (("visibility", figures.CONTRAST, "at which a black object has 2 % contrast (Koschmieder)"),
                                  ("meteorological_range", figures.CONTRAST_WMO, "at which it has 5 % (WMO)")):
        value = figures.visual_range(sigma_t, contrast)
        yield Figure(name, "m", words, value, value * figures.ratio(error, sigma_t), _gaps(value, "nothing is extinguished"))


def _of_particles(root: Group, at: spectral.Places, density: float | None) -> Iterator[Figure]:
    titles = (("effective_radius", "um", "mean of r^3 over mean of r^2"), ("effective_variance", "1", "of that, weighted by r^2"))
    efficiency = ("mass_extinction_efficiency", "m^2/g", "extinction of the particles over their mass")
    optics = root.members.get(PATH)
    if not isinstance(optics, Group):
        for title in (*titles, efficiency):
            yield Figure(*title, over=SCALAR, missing="needs particles, which the asset is not made of")
        return
    parts, missing = components(root, optics)
    if missing:
        for title in (*titles, efficiency):
            yield Figure(*title, over=SCALAR, missing=missing)
        return
    radius, share = (np.concatenate([part[name] for part in parts]) for name in ("radius", "share"))
    volume = sum(part["fraction"] * part["volume"] for part in parts)
    values, errors = _sizes(parts, radius, share, volume)
    for title, value, error in zip(titles, values, errors, strict=True):
        yield Figure(*title, np.array([value]), np.array([error]), over=SCALAR)
    unknown = [part["name"] for part in parts if part["density"] is None and density is None]
    if unknown:
        yield Figure(*efficiency, missing=f"the recipe states no density of {', '.join(unknown)}; density=1.8g/cm^3 would do")
        return
    mass = sum(part["fraction"] * part["volume"] * (part["density"] or density) for part in parts)
    extinction = sum(part["fraction"] * spectral.interpolated(at, part["extinction"]) for part in parts)
    value = figures.mass_efficiency(extinction, mass)
    yield Figure(*efficiency, value, value * float(optics.attributes.get("achieved_error", 0.0)))


def _sizes(parts, radius, share, volume):
    """Effective radius and variance with their errors; halving of nodes component by component."""
    if len(parts) == 1:
        return figures.effective_sizes(radius, share, volume)
    values, _ = figures.effective_sizes(radius, share, volume)
    # each component's own error, weighted as it counts for the second and third moments: at most the largest of them
    errors = [figures.effective_sizes(part["radius"], part["share"] / part["fraction"], part["volume"]) for part in parts
              if part["fraction"] > 0]
    relative = [max((error[i] / (1 if i else value[0]) for value, error in errors), default=0.0) for i in (0, 1)]
    return values, np.array([relative[0] * values[0], relative[1] * (1 + values[1])])


def _gaps(values, words: str) -> str:
    return words if np.isnan(values).any() else ""


def answered(asset, path: str, arguments: Mapping) -> QuantityTable:
    """What `bake query ASSET optics` prints; UsageError of arguments that have no effect, or are lists where one is wanted."""
    lists_of(path, arguments, ARGUMENTS, may=("wavelength",))
    return table(asset.tree, **arguments)


ARGUMENTS = {"length": LENGTH, "density": MASS_DENSITY, "wavelength": WAVELENGTH}
QUERIES = (Query(PATH, ARGUMENTS, "length=100m, density=1.8g/cm^3, wavelength=0.55um", answered, bare=True),)
