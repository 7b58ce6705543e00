"""A medium of somebody's file of optical properties: keys of recipes, and the group's arrays."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING

from bakery.grammar import netcdf, optical_files
from bakery.grammar.optical_files import HUMIDITY, MASS, RADIUS, OpticalProperties
from bakery.grammar.text import Mapping, show
from bakery.grammar.units import Wrong
from bakery.stages.declaration import Result, datasets

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

KEYS = (MASS, RADIUS, HUMIDITY)  # beside `file` alone
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
        properties = optical_files.read(data)
    except Wrong as wrong:
        checker.report(node, f"{wrong.found} in {show(name)}", wrong.expected)
        return
    checker.files.append(file)
    checker.found[node.place.key] = properties
    _amount(checker, section, properties)
    _second_axis(checker, section, properties)
    wavelength = checker.wavelength or ()
    low, high = properties.wavelength[0] * (1 - _SAME), properties.wavelength[-1] * (1 + _SAME)
    outside = [um for um in wavelength if not low <= um <= high]
    if outside:
        shown = ", ".join(f"{um:g}" for um in outside[:8])
        checker.report(node, f"found the wavelength{'s' * (len(outside) > 1)} {shown} um, for which {show(name)} has no data",
                       f"expected {properties.wavelength[0]:g} to {properties.wavelength[-1]:g} um")


def _amount(checker: Checker, section: Mapping, properties: OpticalProperties) -> None:
    if properties.per and MASS not in section:
        checker.report_section(section, f"found no {MASS}", "expected the mass of the particles in a volume, such as 0.3 g/m^3: "
                               "the file holds extinction per mass")
    elif MASS in section and not properties.per:
        checker.report_section(section[MASS], f"found a {MASS}",
                               "expected none: the file holds coefficients, not extinction per mass")


def _second_axis(checker: Checker, section: Mapping, properties: OpticalProperties) -> None:
    """The value on the file's second axis."""
    for key in (RADIUS, HUMIDITY):
        if key in section and key != properties.axis:
            checker.report_section(section[key], f"found {key}", f"expected {properties.axis or 'none'}: the file "
                                   + (f"has values over {properties.axis}" if properties.axis else "has no such values"))
    if not properties.axis:
        return
    name, unit, scale = _NAMES[properties.axis]
    shown = f"{scale * properties.values[0]:g} to {scale * properties.values[-1]:g} {unit}"
    if properties.axis not in section:
        if properties.values.size > 1:
            checker.report_section(section, f"found no {properties.axis}", f"expected one of the file's, {shown}")
        return
    value = checker.value(section, properties.axis)
    if value is not None and not properties.values[0] * (1 - _SAME) <= value <= properties.values[-1] * (1 + _SAME):
        checker.report(section[properties.axis], f"found a {name} of {scale * value:g} {unit}",
                       f"expected {shown}, which the file has")


def given(medium) -> bool:
    """Whether a recipe's section names a file of optical properties."""
    return vars(medium).get("file") is not None


def inputs(recipe) -> dict:
    """What `compute` takes."""
    medium = recipe.medium
    properties = medium.file
    value = getattr(medium, properties.axis) if properties.axis else None
    amount = getattr(medium, properties.per) if properties.per else 1.0
    return {"file": properties._asdict() | {"rows": [[tuple(row) for row in rows] for rows in properties.rows]},
            "wavelength": [float(um) for um in recipe.wavelength], "amount": amount,
            "value": float(properties.values[0]) if value is None else value}


def compute(inputs: dict, context, outputs, members_of) -> Result:
    """The group `medium` at the recipe's wavelengths.

    outputs : of the stage;  members_of : function that makes its datasets
    """
    from bakery.physics.medium.interpolated import Tabulated, between
    from bakery.physics.medium.phase import phase_integral

    properties = SimpleNamespace(**inputs["file"])
    theta, phase = ([[row[i] for row in rows] for rows in properties.rows] for i in (0, 1))
    extinction = inputs["amount"] * properties.extinction
    table = Tabulated(properties.wavelength, properties.values, extinction, properties.albedo, theta, phase)
    medium = between(table, inputs["wavelength"], inputs["value"])
    context.report(1.0, medium.error)
    notes = []
    if properties.integral:
        off = max(abs(phase_integral(*row) / (2 * math.pi * properties.integral) - 1) for rows in properties.rows for row in rows)
        if off > _OFF:
            notes.append(f"the integrals of the file's phase functions are off by up to {100 * off:.2g} %, and are scaled: a "
                         "forward peak between two of its angles may be missing")
    members = members_of(medium.sigma_s, medium.sigma_a, medium.theta, medium.phase[:, None])
    missed = (f"between the file's wavelengths and other values the medium is known to {medium.error:.2g} only; wavelengths that "
              "it holds would do",) if medium.error > context.tolerance else ()
    return Result(members | datasets(outputs, {"phase_bias": medium.bias}), medium.error, tuple(notes), missed)


def angles(recipe) -> int:
    """About as many as the group will have."""
    properties = recipe.medium.file
    return sum(max(row[0].size for row in rows) for rows in properties.rows[:4 * len(recipe.wavelength)])
