"""A medium of somebody's file of optical properties: keys of recipes, and the group's arrays."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

from bakery.grammar import netcdf, optical_files
from bakery.grammar.optical_files import HUMIDITY, RADIUS, OpticalProperties
from bakery.grammar.text import Mapping, show
from bakery.grammar.units import Wrong
from bakery.stages.declaration import Result, datasets

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

KEYS = ("mass_concentration", RADIUS, HUMIDITY)  # beside `file` alone
_NAMES = {RADIUS: ("effective radius", "um", 1.0), HUMIDITY: ("relative humidity", "%", 100.0)}
_SAME = 1e-6  # of a wavelength: files hold them in single precision
_OFF = 0.01  # of the integral of a phase function: told beyond


def check(checker: Checker, section: Mapping) -> None:
    """The file, and that it holds what the keys beside it ask for."""
    node = section["file"]
    name = checker.value(section, "file")
    if name is None:
        return
    try:
        data, file = checker.folder.read(node.place.key, name, netcdf.BYTES, "file")
    except Wrong as wrong:
        checker.report(node, wrong.found, wrong.expected)
        return
    try:
        found = optical_files.read(data)
    except Wrong as wrong:
        checker.report(node, f"{wrong.found} in {show(name)}", wrong.expected)
        return
    checker.files.append(file)
    checker.found[node.place.key] = found
    _amount(checker, section, found)
    _place(checker, section, found)
    wavelength = checker.wavelength or ()
    low, high = found.wavelength[0] * (1 - _SAME), found.wavelength[-1] * (1 + _SAME)
    outside = [um for um in wavelength if not low <= um <= high]
    if outside:
        shown = ", ".join(f"{um:g}" for um in outside[:8])
        checker.report(node, f"found the wavelength{'s' * (len(outside) > 1)} {shown} um, for which {show(name)} has no data",
                       f"expected {found.wavelength[0]:g} to {found.wavelength[-1]:g} um")


def _amount(checker: Checker, section: Mapping, found: OpticalProperties) -> None:
    if found.per_mass and "mass_concentration" not in section:
        checker.report_section(section, "found no mass_concentration", "expected the mass of the particles in a volume, such as "
                               "0.3 g/m^3: the file holds extinction per mass")
    elif not found.per_mass and "mass_concentration" in section:
        checker.report_section(section["mass_concentration"], "found a mass_concentration",
                               "expected none: the file holds coefficients, not extinction per mass")


def _place(checker: Checker, section: Mapping, found: OpticalProperties) -> None:
    """The value on the file's second axis."""
    for key in (RADIUS, HUMIDITY):
        if key in section and key != found.axis:
            checker.report_section(section[key], f"found {key}", f"expected {'none' if not found.axis else found.axis}: the file "
                                   + (f"has values over {found.axis}" if found.axis else "has no such values"))
    if not found.axis:
        return
    name, unit, scale = _NAMES[found.axis]
    shown = f"{scale * found.values[0]:g} to {scale * found.values[-1]:g} {unit}"
    if found.axis not in section:
        if found.values.size > 1:
            checker.report_section(section, f"found no {found.axis}", f"expected one of the file's, {shown}")
        return
    value = checker.value(section, found.axis)
    if value is not None and not found.values[0] * (1 - _SAME) <= value <= found.values[-1] * (1 + _SAME):
        checker.report(section[found.axis], f"found a {name} of {scale * value:g} {unit}",
                       f"expected {shown}, which the file has")


def given(medium) -> bool:
    """Whether a recipe's section names a file of optical properties."""
    return vars(medium).get("file") is not None


def inputs(recipe) -> dict:
    """What `compute` takes."""
    medium = recipe.medium
    found = medium.file
    value = getattr(medium, found.axis) if found.axis else None
    mass = 1.0 if medium.mass_concentration is None else medium.mass_concentration
    return {"file": found._asdict() | {"rows": [[tuple(row) for row in rows] for rows in found.rows]},
            "wavelength": [float(um) for um in recipe.wavelength], "value": float(found.values[0]) if value is None else value,
            "mass": mass}


def compute(inputs: dict, context, outputs, members_of) -> Result:
    """The group `medium` at the recipe's wavelengths.

    outputs : of the stage;  members_of : function that makes its datasets
    """
    from bakery.physics.medium.interpolated import Tabulated, between
    from bakery.physics.medium.phase import phase_integral

    found = SimpleNamespace(**inputs["file"])
    table = Tabulated(found.wavelength, found.values, inputs["mass"] * found.extinction, found.albedo,
                      [[row[0] for row in rows] for rows in found.rows], [[row[1] for row in rows] for rows in found.rows])
    medium = between(table, inputs["wavelength"], inputs["value"])
    context.report(1.0, medium.error)
    notes = []
    if found.integral:
        off = max(abs(phase_integral(*row) / (6.283185307179586 * found.integral) - 1) for rows in found.rows for row in rows)
        if off > _OFF:
            notes.append(f"the integrals of the file's phase functions are off by up to {100 * off:.2g} %, and are scaled: a "
                         "forward peak between two of its angles may be missing")
    members = members_of(medium.sigma_s, medium.sigma_a, medium.theta, medium.phase[:, None])
    missed = (f"between the file's wavelengths and other values the medium is known to {medium.error:.2g} only; wavelengths that "
              "it holds would do",) if medium.error > context.tolerance else ()
    return Result(members | datasets(outputs, {"phase_bias": medium.bias}), medium.error, tuple(notes), missed)


def angles(recipe) -> int:
    """About as many as the group will have."""
    found = recipe.medium.file
    return sum(max(row[0].size for row in rows) for rows in found.rows[:4 * len(recipe.wavelength)])
