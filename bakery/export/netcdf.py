"""NetCDF 3 files (64-bit offsets), which every NetCDF library reads, and a medium in them: CF, Eradiate, libRadtran."""

import io
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from bakery.export.medium import Scattering
from bakery.export.named import Named

_LENGTH_OF_TEXT = "length_of_{}"
_MIE = np.int32(20110916)  # what `mie` of libRadtran 2.0.2 calls its format; uvspec takes a file without as one of one wavelength
EXPANDED = {"alpha1": "4 pi s11", "alpha2": "4 pi s22", "alpha3": "4 pi s33", "alpha4": "4 pi s44", "beta1": "4 pi s12",
            "beta2": "4 pi s34"}


class Variable(NamedTuple):
    """Numbers, or words, over dimensions."""

    dimensions: tuple[str, ...]
    values: np.ndarray
    attributes: Mapping[str, str | float] = {}


def netcdf(variables: Mapping[str, Variable], attributes: Mapping[str, str | np.int32]) -> bytes:
    """A file of variables; the dimensions are those of their arrays."""
    from scipy.io import netcdf_file

    buffer = io.BytesIO()
    file = netcdf_file(buffer, "w", version=2)
    for name, text in attributes.items():
        setattr(file, name, text)
    for name, (dimensions, values, notes) in variables.items():
        values = np.asarray(values)
        if values.dtype.kind == "U":  # the characters are one more dimension
            values = np.array([list(word.ljust(int(values.dtype.itemsize / 4))) for word in values.tolist()], "S1")
            dimensions = (*dimensions, _LENGTH_OF_TEXT.format(name))
            notes = {**notes, "_Encoding": "utf-8"}
        elif values.dtype.kind in "iub":
            values = values.astype(np.int32)
        for dimension, size in zip(dimensions, values.shape, strict=True):
            if dimension not in file.dimensions:
                file.createDimension(dimension, size)
        variable = file.createVariable(name, values.dtype.newbyteorder(">"), dimensions)
        variable[:] = values
        for key, value in notes.items():
            setattr(variable, key, value)
    file.flush()
    content = buffer.getvalue()
    file.close()
    return content


def cf(named: Named) -> bytes:
    """The medium by the CF conventions; standard names where there are any that do not speak of an atmosphere's aerosol."""
    medium, axes = named.medium, ("wavelength", "scattering_angle")
    sigma_a = medium.sigma_t - medium.sigma_s

    def over_wavelength(values, words: str, units: str = "m-1", error: str = "") -> Variable:
        attributes = {"long_name": words, "units": units}
        return Variable(("wavelength",), values, attributes | ({"ancillary_variables": error} if error else {}))

    variables = {
        "wavelength": Variable(("wavelength",), named.wavelength, {
            "standard_name": "radiation_wavelength", "long_name": "wavelength in vacuum", "units": "um"}),
        "scattering_angle": Variable(("scattering_angle",), np.degrees(medium.theta), {
            "long_name": "angle between the directions of travel, 0 forward", "units": "degree",
            "comment": "the phase function is linear in its cosine between the angles"}),
        "extinction_coefficient": over_wavelength(medium.sigma_t, "extinction coefficient"),
        "scattering_coefficient": over_wavelength(medium.sigma_s, "scattering coefficient"),
        "absorption_coefficient": over_wavelength(sigma_a, "absorption coefficient", error="absorption_coefficient_error"
                                                  if "sigma_a" in named.errors else ""),
        "single_scattering_albedo": over_wavelength(medium.albedo, "single-scattering albedo", "1"),
        "asymmetry_factor": over_wavelength(_mean_cosine(medium), "mean cosine of the scattering angle", "1"),
        "phase_function": Variable(axes, medium.phase, {
            "long_name": "phase function", "units": "sr-1", "comment": "the integral over the sphere is 1"}
            | ({"ancillary_variables": "phase_function_error"} if "phase" in named.errors else {})),
    }
    if "sigma_a" in named.errors:
        variables["absorption_coefficient_error"] = over_wavelength(
            named.errors["sigma_a"], "change of the absorption coefficient when the nodes over sizes are halved")
    if "phase" in named.errors:
        variables["phase_function_error"] = Variable(axes, named.errors["phase"], {
            "long_name": "estimated error of the phase function", "units": "sr-1"})
    variables |= _matrix(named)
    attributes = {"Conventions": "CF-1.11",
            "comment": f"asset's tolerance {named.tolerance:g}, reached {named.achieved:.3g}: {named.measure}"}
    return netcdf(variables, attributes | named.attributes)


def _matrix(named: Named) -> dict[str, Variable]:
    """Elements of the scattering matrix beside the phase function, and its expansion coefficients; nothing of scalar media."""
    from bakery.physics.moments import expansion_coefficients, legendre_series

    medium = named.medium
    if medium.matrix is None:
        return {}
    source = "of spheres, Bohren & Huffman 1983, eq. 4.77, time factor exp(-i w t), in the scale of the phase function"
    variables = {f"scattering_matrix_{name}": Variable(("wavelength", "scattering_angle"), medium.matrix[:, i], {
        "long_name": f"element {name} of the scattering matrix", "units": "sr-1", "comment": source})
        for i, name in enumerate(("12", "33", "34"))}
    series = legendre_series(medium.theta, medium.phase, named.tolerance)
    last = series.moments.shape[-1] - 1
    expansion = expansion_coefficients(medium.theta, medium.phase, *np.moveaxis(medium.matrix, 1, 0), last)
    variables["order"] = Variable(("order",), np.arange(last + 1), {"long_name": "order l of the expansion", "units": "1"})
    for name, element in EXPANDED.items():
        variables[f"expansion_{name}"] = Variable(("wavelength", "order"), getattr(expansion, name), {
            "long_name": f"expansion coefficient {name} in generalised spherical functions, of {element}", "units": "1",
            "comment": "Hovenier & van der Mee 1983; with the factor 2 l + 1"})
    variables["expansion_cut"] = Variable(("wavelength",), series.cut, {
        "long_name": "integral over the sphere of |phase function - its series|", "units": "1"})
    return variables


def _mean_cosine(medium: Scattering) -> np.ndarray:
    from bakery.physics.medium.phase import mean_cosine

    return mean_cosine(medium.theta, medium.phase)


def eradiate(named: Named, moments) -> bytes:
    """The medium as Eradiate's particle data, format Aer-Core v2.

    named : by ascending wavelength
    moments : (L, N + 1) Legendre moments without the factor 2 l + 1
    """
    medium = named.medium
    count, angles = len(named.wavelength), len(medium.theta)
    mu, theta = np.cos(medium.theta)[::-1], np.degrees(medium.theta)[::-1]
    by_angle, matrix = ("w", "iangle"), _elements(medium)
    variables = {
        "w": Variable(("w",), 1e3 * named.wavelength, {
            "standard_name": "wavelength", "long_name": "wavelength", "units": "nm"}),
        "phamat": Variable(("phamat",), np.array(["11", "12", "33", "34"][:len(matrix)]), {
            "standard_name": "component", "long_name": "phase matrix component"}),
        "mu": Variable(by_angle, np.tile(mu, (count, 1)), {
            "standard_name": "cos_scattering_angle", "long_name": "scattering angle cosine", "units": "dimensionless"}),
        "theta": Variable(by_angle, np.tile(theta, (count, 1)), {
            "standard_name": "scattering_angle", "long_name": "scattering angle", "units": "deg"}),
        "ext": Variable(("w",), 1e3 * medium.sigma_t, {
            "standard_name": "extinction_coefficient", "long_name": "extinction coefficient", "units": "km^-1"}),
        "ssa": Variable(("w",), medium.albedo, {
            "standard_name": "single_scattering_albedo", "long_name": "single-scattering albedo", "units": "dimensionless"}),
        "phase": Variable(("phamat", *by_angle), 4 * math.pi * matrix[:, :, ::-1], {
            "standard_name": "phase_matrix", "long_name": "phase matrix", "units": "1/sr", "coordinates": "mu theta",
            "comment": "integral normalized to 2"}),
        "nangles": Variable(("w",), np.full(count, angles), {
            "standard_name": "n_angular_samples", "long_name": "number of angular samples"}),
        "nmom": Variable(("w",), np.full(count, moments.shape[1]), {
            "standard_name": "n_legendre_polys", "long_name": "number of Legendre polynomials"}),
        "pmom": Variable(("w", "imom"), (2 * np.arange(moments.shape[1]) + 1) * moments, {
            "standard_name": "legendre_polys", "long_name": "Legendre polynomials",
            "comment": "p11 component only; including factor 2l+1"}),
    }
    return netcdf(variables, {"format": "Aer-Core v2", "particle_shape": "spherical"} | named.attributes)


def _elements(medium: Scattering) -> np.ndarray:
    """(1, L, A), the phase function, or (4, L, A) with the elements 12, 33 and 34, as both formats order them."""
    if medium.matrix is None:
        return medium.phase[None]
    return np.concatenate([medium.phase[None], np.moveaxis(medium.matrix, 1, 0)])


def libradtran(named: Named, moments, mass: float, radius: float, density: float) -> bytes:
    """The medium as libRadtran's `mie` tool writes optical properties, for `wc_properties` and the like.

    named : by ascending wavelength
    moments : (L, N + 1) Legendre moments without the factor 2 l + 1
    mass : g/m^3 that the asset's coefficients stand for
    radius : effective, um
    density : of the particles, g/cm^3
    """
    from bakery.physics.moments import legendre_moments

    medium = named.medium
    count = len(named.wavelength)
    over, all_of = ("nlam", "nreff"), ("nlam", "nreff", "nphamat")
    # uvspec of libRadtran 2.0.2 reads angles from 180 degrees down alone
    theta, phase = np.degrees(medium.theta[::-1]), 4 * math.pi * np.moveaxis(_elements(medium), 0, 1)[..., ::-1]
    kinds = phase.shape[1]
    terms = np.zeros((count, kinds, moments.shape[1]))
    terms[:, 0] = (2 * np.arange(moments.shape[1]) + 1) * moments
    if kinds > 1:
        others = legendre_moments(medium.theta, medium.matrix, moments.shape[1] - 1)
        terms[:, 1:] = (2 * np.arange(moments.shape[1]) + 1) * others

    def column(values) -> np.ndarray:
        return np.broadcast_to(np.asarray(values, float).reshape(-1, 1), (count, 1))

    variables = {
        "wavelen": Variable(("nlam",), named.wavelength, {"long_name": "wavelength", "units": "micrometer"}),
        "reff": Variable(("nreff",), np.array([radius]), {"long_name": "effective radius", "units": "micrometer"}),
        "ntheta": Variable(all_of, np.full((count, 1, kinds), theta.size), {
            "long_name": "number of scattering angles", "units": "-"}),
        "theta": Variable((*all_of, "nthetamax"), np.tile(theta, (count, 1, kinds, 1)), {
            "long_name": "theta", "units": "degrees"}),
        "phase": Variable((*all_of, "nthetamax"), phase[:, None], {"long_name": "phase", "units": "-"}),
        "nmom": Variable(all_of, np.full((count, 1, kinds), terms.shape[2]), {
            "long_name": "number of Legendre polynomials", "units": "-"}),
        "pmom": Variable((*all_of, "nmommax"), terms[:, None], {
            "long_name": "Legendre polynomials", "units": "including factor 2*l+1"}),
        # 1/m in 1/km, of a gram in a m^3
        "ext": Variable(over, column(1e3 * medium.sigma_t / mass), {
            "long_name": "extinction coefficient", "units": "km^-1/(g/m^3)"}),
        "ssa": Variable(over, column(medium.albedo), {"long_name": "single scattering albedo", "units": "-"}),
        "gg": Variable(over, column(_mean_cosine(medium)), {"long_name": "Asymmetry factor", "units": "-"}),
        "rho": Variable(over, column(np.full(count, density)), {"long_name": "density of medium", "units": "g/cm^3"}),
    }
    return netcdf(variables, named.attributes | {"version": _MIE})


def explicit(named: Named, moments) -> str:
    """libRadtran's text of a layer: wavelength (nm), extinction (1/km), albedo, Legendre moments without the factor 2 l + 1."""
    medium = named.medium
    rows = zip(1e3 * named.wavelength, 1e3 * medium.sigma_t, medium.albedo, moments, strict=True)
    return "".join(f"{nm:.6f} {sigma:.9e} {albedo:.12f} {' '.join(f'{chi:.8e}' for chi in row)}\n"
                   for nm, sigma, albedo, row in rows)
