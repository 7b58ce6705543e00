"""Optical properties of a medium from NetCDF files: of libRadtran (its `mie` tool and OPAC), of Eradiate, and of our own export.

| | libRadtran | Eradiate, Aer-Core v2 and v1 | `bake export --to netcdf` |
|---|---|---|---|
| wavelength | wavelen (nlam) | w (w) | wavelength (wavelength) |
| second axis | reff or hum (nreff or nhum) | | |
| extinction | ext, per mass concentration | ext; sigma_t | extinction_coefficient |
| albedo | ssa | ssa; albedo | single_scattering_albedo |
| angles | theta (nlam, nreff, nphamat, nthetamax), ntheta | mu (w, iangle), nangles; mu (mu) | scattering_angle |
| phase function | phase, integral 2 over mu | phase, integral 2 over mu | phase_function, 1/sr |
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.grammar import netcdf
from bakery.grammar.netcdf import Variable
from bakery.grammar.text import show
from bakery.grammar.units import Wrong

_LIBRADTRAN = ("wavelen", "ext", "ssa", "ntheta", "theta", "phase")
_CORE = ("w", "mu", "ext", "ssa", "phase", "nangles")
_V1 = ("w", "mu", "sigma_t", "albedo", "phase", "i", "j")
_OURS = ("wavelength", "scattering_angle", "extinction_coefficient", "single_scattering_albedo", "phase_function")
_WANTED = frozenset((*_LIBRADTRAN, *_CORE, *_V1, *_OURS, "reff", "hum"))
RADIUS, HUMIDITY = "effective_radius", "humidity"
MASS = "mass_concentration"
_LENGTHS = {"micrometer": 1.0, "micrometers": 1.0, "micrometre": 1.0, "micrometres": 1.0, "micron": 1.0, "microns": 1.0,
            "um": 1.0,
            "µm": 1.0, "μm": 1.0, "nm": 1e-3, "nanometer": 1e-3, "nanometers": 1e-3, "nanometre": 1e-3, "nanometres": 1e-3,
            "m": 1e6, "meter": 1e6}
# km^-1 of a gram in a m^3 is a m^2 a kg
_PER_MASS = {"km^-1/(g/m^3)": 1.0, "km-1/(g/m3)": 1.0, "m^2/kg": 1.0, "m2 kg-1": 1.0, "m^2/g": 1e3, "m2 g-1": 1e3}
_PER_LENGTH = {"m-1": 1.0, "1/m": 1.0, "m^-1": 1.0, "1 / m": 1.0, "1 / meter": 1.0, "km-1": 1e-3, "1/km": 1e-3, "km^-1": 1e-3,
               "1 / km": 1e-3, "1 / kilometer": 1e-3}
_ENDS = math.radians(0.05)  # 0 and 180 degrees in single precision, by the cosine


class Row(NamedTuple):
    """A phase function (A,) in any scale at angles (A,) rad, from 0 to pi."""

    theta: np.ndarray
    phase: np.ndarray


class OpticalProperties(NamedTuple):
    """What a file holds."""

    wavelength: np.ndarray  # (W,) um, ascending
    axis: str  # what the second axis is: `RADIUS`, `HUMIDITY` or ""
    values: np.ndarray  # (P,) um or 1, ascending; (1,) where there is no such axis
    extinction: np.ndarray  # (W, P) m^2/kg of the mass in `per`, 1/m where there is none
    albedo: np.ndarray  # (W, P) 1
    rows: tuple[tuple[Row, ...], ...]  # W tuples of P `Row`s
    integral: float  # the integral over cos theta that rows should have
    per: str  # `MASS` where the extinction is that of 1 kg/m^3; "" where it is the medium's own


def read(data: bytes) -> OpticalProperties:
    """The optical properties of a file; raises `Wrong`."""
    variables = netcdf.read(data, _WANTED)
    for names, reader in ((_LIBRADTRAN, _libradtran), (_CORE, _eradiate), (_V1, _eradiate_v1), (_OURS, _ours)):
        if set(names) <= variables.keys():
            try:
                with np.errstate(all="ignore"):
                    return _checked(reader(variables))
            except (ValueError, IndexError, OverflowError) as error:  # shapes that do not fit each other
                raise Wrong(f"found variables that do not fit each other ({show(error)[1:-1]})",
                            f"expected {', '.join(names)}, as their program writes them") from None
    raise Wrong(f"found the variables {', '.join(sorted(variables)) or 'of no kind that is known here'}",
                f"expected those of libRadtran ({', '.join(_LIBRADTRAN)}, and reff or hum), of Eradiate ({', '.join(_CORE)}), or "
                f"of `bake export --to netcdf` ({', '.join(_OURS)})")


def _scaled(variables: dict[str, Variable], name: str, units: dict[str, float], default: str = "") -> np.ndarray:
    variable = variables[name]
    unit = variable.units or default
    if unit not in units:
        raise Wrong(f"found {name} in {show(unit) if unit else 'no unit'}", f"expected one of {', '.join(units)}")
    return variable.values * units[unit]


def _libradtran(variables) -> OpticalProperties:
    axis = next((name for name in ("reff", "hum") if name in variables), None)
    if axis is None:
        raise Wrong("found neither reff nor hum", "expected the effective radii or humidities of a libRadtran file")
    wavelength = _scaled(variables, "wavelen", _LENGTHS, "micrometer")
    values = _scaled(variables, "reff", _LENGTHS, "micrometer") if axis == "reff" else variables["hum"].values / 100
    shape = wavelength.size, values.size
    extinction = _scaled(variables, "ext", _PER_MASS, "km^-1/(g/m^3)").reshape(shape)
    albedo, count = variables["ssa"].values.reshape(shape), variables["ntheta"].values
    theta, phase = variables["theta"].values, variables["phase"].values
    if theta.shape != phase.shape or theta.shape[:2] != shape or count.shape != theta.shape[:3]:
        raise Wrong(f"found theta of {theta.shape} and phase of {phase.shape} beside ntheta of {count.shape}",
                    f"expected {shape[0]} wavelengths by {shape[1]} values of {axis}, elements, angles")
    rows = tuple(tuple(_row(np.radians(theta[i, j, 0, :_number(count[i, j, 0])]), phase[i, j, 0]) for j in range(shape[1]))
                 for i in range(shape[0]))
    return OpticalProperties(wavelength, RADIUS if axis == "reff" else HUMIDITY, values, extinction, albedo, rows, 2.0, MASS)


def _number(value: float) -> int:
    if not 2 <= value <= 1e9:
        raise Wrong(f"found {value:g} angles of a phase function", "expected 2 or more")
    return int(value)


def _eradiate(variables) -> OpticalProperties:
    wavelength, count = _scaled(variables, "w", _LENGTHS), variables["nangles"].values
    mu, phase = variables["mu"].values, variables["phase"].values
    if phase.ndim != 3 or mu.shape != phase.shape[1:]:
        raise Wrong(f"found mu of {mu.shape} and phase of {phase.shape}", "expected (w, iangle) and (phamat, w, iangle)")
    rows = tuple((_row(_angle(mu[i, :_number(count[i])]), phase[0, i]),) for i in range(wavelength.size))
    return _single(wavelength, _scaled(variables, "ext", _PER_LENGTH), variables["ssa"].values, rows, 2.0)


def _eradiate_v1(variables) -> OpticalProperties:
    wavelength, mu, phase = _scaled(variables, "w", _LENGTHS), variables["mu"].values, variables["phase"].values
    if phase.ndim != 4 or phase.shape[:2] != (wavelength.size, mu.size):
        raise Wrong(f"found phase of {phase.shape}", f"expected (w, mu, i, j), {wavelength.size} by {mu.size} by elements")
    rows = tuple((_row(_angle(mu), phase[i, :, 0, 0]),) for i in range(wavelength.size))
    # of this format there are files with an integral of 2 over mu and of 1 over the sphere: the scale is not looked at
    return _single(wavelength, _scaled(variables, "sigma_t", _PER_LENGTH), variables["albedo"].values, rows, 0.0)


def _ours(variables) -> OpticalProperties:
    wavelength, theta = _scaled(variables, "wavelength", _LENGTHS), variables["scattering_angle"].values
    theta = np.radians(theta) if variables["scattering_angle"].units in ("degree", "degrees", "deg") else theta
    rows = tuple((_row(theta, row),) for row in variables["phase_function"].values)
    extinction, albedo = _scaled(variables, "extinction_coefficient", _PER_LENGTH), variables["single_scattering_albedo"].values
    return _single(wavelength, extinction, albedo, rows, 1 / (2 * math.pi))


def _single(wavelength, extinction, albedo, rows, integral: float) -> OpticalProperties:
    """Of a file without a second axis."""
    return OpticalProperties(wavelength, "", np.zeros(1), extinction.reshape(-1, 1), albedo.reshape(-1, 1), rows, integral, "")


def _angle(mu) -> np.ndarray:
    return np.arccos(np.clip(mu, -1.0, 1.0))


def _row(theta, phase) -> Row:
    """Angles in ascending order, from 0 to pi, each once."""
    phase = np.asarray(phase, float)[:len(theta)]
    theta, first = np.unique(theta, return_index=True)
    phase = phase[first]
    if not (np.isfinite(theta).all() and np.isfinite(phase).all() and (phase >= 0).all()):
        raise Wrong("found a phase function that is not finite, or below 0", "expected numbers of 0 or more")
    if theta.size < 2 or theta[0] > _ENDS or abs(theta[-1] - math.pi) > _ENDS:
        ends = f"{math.degrees(theta[0]):g} to {math.degrees(theta[-1]):g} deg" if theta.size else "none"
        raise Wrong(f"found angles from {ends}", "expected 0 to 180 deg")
    theta[0], theta[-1] = 0.0, math.pi
    return Row(theta, phase)


def _checked(properties: OpticalProperties) -> OpticalProperties:
    """In ascending order, and within what a medium has."""
    if any(scale.ndim != 1 or not scale.size for scale in (properties.wavelength, properties.values)):
        raise Wrong("found no wavelength", "expected one or more")
    if len(properties.rows) != properties.wavelength.size or properties.extinction.shape != properties.albedo.shape \
            or len(properties.extinction) != properties.wavelength.size:
        raise Wrong(f"found {properties.wavelength.size} wavelengths, {len(properties.extinction)} extinctions and "
                    f"{len(properties.rows)} phase functions", "expected as many of each")
    first, second = np.argsort(properties.wavelength), np.argsort(properties.values)
    wavelength, values = properties.wavelength[first], properties.values[second]
    for name, ordered in (("wavelength", wavelength), (properties.axis, values)):
        if not np.isfinite(ordered).all() or (np.diff(ordered) <= 0).any() or name == "wavelength" and not ordered[0] > 0:
            raise Wrong(f"found values of {name} that are not finite and distinct", "expected each once")
    extinction, albedo = properties.extinction[first][:, second], properties.albedo[first][:, second]
    if not (np.isfinite(extinction) & (extinction >= 0)).all() or not extinction.max() > 0:
        raise Wrong("found an extinction that is not finite, below 0, or 0 everywhere", "expected numbers of 0 or more")
    if not ((albedo >= 0) & (albedo <= 1 + 1e-6)).all():
        raise Wrong(f"found the single-scattering albedo {albedo.flat[np.argmax(~((albedo >= 0) & (albedo <= 1 + 1e-6)))]:g}",
                    "expected 0 to 1")
    rows = tuple(tuple(properties.rows[i][j] for j in second) for i in first)
    for theta, phase in (row for several in rows for row in several):
        if not phase.max() > 0:
            raise Wrong("found a phase function that is 0 everywhere", "expected positive values")
        integral = float(np.sum((phase[1:] + phase[:-1]) / 2 * -np.diff(np.cos(theta))))
        if properties.integral and not 0.5 * properties.integral < integral < 2 * properties.integral:
            raise Wrong(f"found a phase function whose integral over cos theta is {integral:.4g}",
                        f"expected {properties.integral:.4g}: is it this format, and are there enough angles for its peak?")
    return properties._replace(wavelength=wavelength, values=values, extinction=extinction, albedo=np.minimum(albedo, 1.0),
                               rows=rows)
