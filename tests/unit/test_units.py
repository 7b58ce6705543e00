"""Numbers with units: one closed table, one rounding."""

import math

import pytest

from bakery.grammar import units
from bakery.grammar.units import (
    ANGLE,
    COEFFICIENT,
    DENSITY,
    FRACTION,
    LENGTH,
    MASS_CONCENTRATION,
    MASS_DENSITY,
    NUMBER_ONLY,
    VOLUME_CONCENTRATION,
    WAVELENGTH,
    Wrong,
)


@pytest.mark.parametrize(
    "text, quantity, value",
    [
        ("5 um", LENGTH, 5.0),
        ("5um", LENGTH, 5.0),
        (" 5  um ", LENGTH, 5.0),
        ("5 µm", LENGTH, 5.0),
        ("5 μm", LENGTH, 5.0),
        ("0.5 mm", LENGTH, 500.0),
        ("2.5e-3 m", LENGTH, 2500.0),
        ("60 nm", LENGTH, 0.06),
        (".5 cm", LENGTH, 5000.0),
        ("+5. um", LENGTH, 5.0),
        ("1e8 /m^3", DENSITY, 1e8),
        ("100 /cm^3", DENSITY, 1e8),
        ("100 cm^-3", DENSITY, 1e8),
        ("100 1/cm^3", DENSITY, 1e8),
        ("100 /cm³", DENSITY, 1e8),
        ("1 /um^3", DENSITY, 1e18),
        ("35 ug/m^3", MASS_CONCENTRATION, 35e-9),
        ("35 µg/m³", MASS_CONCENTRATION, 35e-9),
        ("35 ug m^-3", MASS_CONCENTRATION, 35e-9),
        ("1.77 g/cm^3", MASS_DENSITY, 1770.0),
        ("12 um^3/cm^3", VOLUME_CONCENTRATION, 12e-12),
        ("12 um^3 cm^-3", VOLUME_CONCENTRATION, 12e-12),
        ("2.1 /mm", COEFFICIENT, 2100.0),
        ("2.1 mm^-1", COEFFICIENT, 2100.0),
        ("1/m", COEFFICIENT, 1.0),
        ("30 deg", ANGLE, math.pi / 6),
        ("30°", ANGLE, math.pi / 6),
        ("0.5 rad", ANGLE, 0.5),
        ("1%", FRACTION, 0.01),
        ("0.3 %", FRACTION, 0.003),
        ("0.01", FRACTION, 0.01),
        ("0.55", WAVELENGTH, 0.55),
        ("550 nm", WAVELENGTH, 0.55),
        ("-1.5e2", NUMBER_ONLY, -150.0),
    ],
)
def test_values(text, quantity, value):
    assert units.parse(text, quantity) == value


@pytest.mark.parametrize("text", ["0.1", "0.3", "0.7", "1.1", "123.456", "5e-7", "9.007199254740993e15"])
def test_the_unit_does_not_change_the_value(text):
    # 0.3 mm and 300 um differ in the last bit where a factor 1000 is multiplied in; here the text is rounded once
    number, thousand = float(text), f"{text.partition('e')[0]}e{int(text.partition('e')[2] or 0) - 3}"
    assert units.parse(f"{text} um", LENGTH) == number
    assert units.parse(f"{thousand} mm", LENGTH) == number


@pytest.mark.parametrize(
    "text, quantity, found, expected",
    [
        ("5", LENGTH, 'found "5", which has no unit', "lengths take nm, um, mm, cm, m (5 um?)"),
        ("1e8", DENSITY, 'found "1e8", which has no unit', "number densities take /m^3, /cm^3, /mm^3, /um^3 (1e8 /m^3?)"),
        ("5 umm", LENGTH, 'found "5 umm"; "umm" is no unit of length', "lengths take nm, um, mm, cm, m (5 um?)"),
        ("5 deg", LENGTH, 'found "5 deg"; "deg" is no unit of length', "lengths take nm, um, mm, cm, m"),
        ("3 um", NUMBER_ONLY, 'found "3 um"', "expected a number without unit"),
        ("five", LENGTH, 'found "five"', "expected a length such as 5 um"),
        ("", LENGTH, "found nothing", "expected a length such as 5 um"),
        ("nan", FRACTION, 'found "nan"', "expected a fraction such as 0.01 or 1%"),
        ("1_000", NUMBER_ONLY, 'found "1_000"', "expected a number without unit"),
        ("0x10", NUMBER_ONLY, 'found "0x10"', "expected a number without unit"),
        ("٣ um", LENGTH, 'found "٣ um"', "expected a length such as 5 um"),
        ("1e400", NUMBER_ONLY, 'found "1e400", which is beyond the range of numbers', "expected a finite number"),
        ("1e308 m", LENGTH, 'found "1e308 m", which is beyond the range of numbers', "expected a finite number"),
        ("1" * 5000, NUMBER_ONLY, "found a number of 5,000 characters", "expected at most 400"),
    ],
)
def test_messages(text, quantity, found, expected):
    with pytest.raises(Wrong) as wrong:
        units.parse(text, quantity)
    assert (wrong.value.found, wrong.value.expected) == (found, expected)


def test_lists():
    assert units.parse_list("[0.84, 0.75, 0.68] mm", LENGTH) == (840.0, 750.0, 680.0)
    assert units.parse_list("[0.1,0.2]/mm", COEFFICIENT) == (100.0, 200.0)
    assert units.parse_list("[10, 20] %", FRACTION) == (0.1, 0.2)


@pytest.mark.parametrize(
    "text, found, offset",
    [
        ("[0.84, 0.75 mm, 0.68] mm", 'found "0.75 mm" in a list with one unit', 7),
        ("[1, , 2] mm", "found an empty place in the list", 4),
        ("[1, 2] mum", 'found "1 mum"; "mum" is no unit of length', 1),
        ("[1, 2]", 'found "1", which has no unit', 1),
    ],
)
def test_list_messages_name_the_place(text, found, offset):
    with pytest.raises(Wrong) as wrong:
        units.parse_list(text, LENGTH)
    assert (wrong.value.found, wrong.value.offset) == (found, offset)
