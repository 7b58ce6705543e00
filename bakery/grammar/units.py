"""Numbers and their units: a closed table.

Lengths become micrometres, coefficients 1/m, number densities 1/m^3, angles radians, fractions pure numbers.  Every unit but the
degree is a power of ten, so the exponent is added to the number's text and rounded once: `0.5 mm` and `500 um` are the same
float.
"""

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from bakery.errors import UsageError
from bakery.grammar.text import closest, show

NUMBER = re.compile(r"([-+]?)(\d+\.?\d*|\.\d+)(?:[eE]([-+]?\d+))?", re.ASCII)
MAX_DIGITS = 400
_COMPLEX = re.compile(rf"({NUMBER.pattern})\s*[-+]\s*(?P<k>{NUMBER.pattern})?\s*[ij]", re.ASCII)
_LIST = re.compile(r"\[(.*)\]\s*(\S.*)?", re.DOTALL)


class Wrong(Exception):
    """A text that does not say a value: what was found, what would do, and where in the text (offset)."""

    def __init__(self, found: str, expected: str, offset: int = 0):
        super().__init__(found, expected)
        self.found, self.expected, self.offset = found, expected, offset


@contextmanager
def naming(subject: str) -> Iterator[None]:
    """A text that does not say a value, inside of the `with`, as UsageError after a name: of an option, an argument, a file."""
    try:
        yield
    except Wrong as wrong:
        raise UsageError(f"{subject}: {wrong.found}; {wrong.expected}") from None


@dataclass(frozen=True)
class Quantity:
    """A kind of value: its units as powers of ten of the `base`, and whether a number without unit is one too."""

    name: str
    plural: str
    base: str
    powers: Mapping[str, int]
    suggested: str
    bare: bool = False
    degrees: bool = False

    @property
    def one(self) -> str:
        return f"{'an' if self.name[0] in 'aeiou' else 'a'} {self.name}"

    @property
    def units(self) -> str:
        return ", ".join(self.powers)

    @property
    def takes(self) -> str:
        return f"{self.plural} take {self.units}" + (" or no unit" if self.bare else "")


LENGTH = Quantity("length", "lengths", "um", {"nm": -3, "um": 0, "mm": 3, "cm": 4, "m": 6}, "um")
WAVELENGTH = Quantity("wavelength", "wavelengths", "um", {"nm": -3, "um": 0, "mm": 3}, "um", bare=True)
DENSITY = Quantity("number density", "number densities", "/m^3", {"/m^3": 0, "/cm^3": 6, "/mm^3": 9, "/um^3": 18}, "/m^3")
COEFFICIENT = Quantity("coefficient", "coefficients", "/m", {"/m": 0, "/cm": 2, "/mm": 3, "/um": 6}, "/mm")
_MASS = {"ng/m^3": -12, "ug/m^3": -9, "mg/m^3": -6, "g/m^3": -3, "kg/m^3": 0, "g/cm^3": 3}
MASS_CONCENTRATION = Quantity("mass concentration", "mass concentrations", "kg/m^3", _MASS, "ug/m^3")
MASS_DENSITY = Quantity("density", "densities", "kg/m^3", _MASS, "g/cm^3")
VOLUME_CONCENTRATION = Quantity("volume concentration", "volume concentrations", "m^3/m^3",
                                {"um^3/cm^3": -12, "mm^3/m^3": -9, "cm^3/m^3": -6, "m^3/m^3": 0}, "um^3/cm^3")
ANGLE = Quantity("angle", "angles", "rad", {"deg": 0, "rad": 0}, "deg", degrees=True)
FRACTION = Quantity("fraction", "fractions", "1", {"%": -2}, "%", bare=True)
NUMBER_ONLY = Quantity("number", "numbers", "1", {}, "", bare=True)

METRES = Quantity("length", "lengths", "m", {unit: power - 6 for unit, power in LENGTH.powers.items()}, "um")
SI = (METRES, DENSITY, COEFFICIENT, ANGLE, FRACTION, MASS_CONCENTRATION, VOLUME_CONCENTRATION)  # no unit belongs to two of them


def quantity_of(text: str) -> Quantity:
    """Which of `SI` the unit of a text belongs to, a fraction where it has none; raises `Wrong`."""
    match = NUMBER.match(text.strip())
    unit = text.strip()[match.end():].strip() if match else ""
    for quantity in SI:
        if match and (_canonical(unit) in quantity.powers if unit else quantity.bare):
            return quantity
    units = ", ".join(quantity.units for quantity in SI)
    raise Wrong(f"found {show(text)}" if text.strip() else "found nothing",
                f"expected a number, alone or with one of the units {units}")


def _canonical(unit: str) -> str:
    """One spelling of a unit: micro signs to u, `1/m` and `m^-1` to `/m`, no blanks."""
    unit = re.sub(r"^(\S+)\s+(c?m)\^-3$", r"\1/\2^3", unit)  # ug m^-3
    unit = re.sub(r"\s+", "", unit).replace("\N{MICRO SIGN}", "u").replace("\N{GREEK SMALL LETTER MU}", "u")
    unit = unit.replace("\N{SUPERSCRIPT THREE}", "^3").replace("\N{DEGREE SIGN}", "deg")
    unit = re.sub(r"^1/", "/", unit)
    unit = re.sub(r"^([a-z]+)\^-([13])$", lambda m: f"/{m[1]}" + ("" if m[2] == "1" else "^3"), unit)
    return unit


def parse(text: str, quantity: Quantity) -> float:
    """The value of `5 um` in the quantity's base unit; raises `Wrong`."""
    text = text.strip()
    match = NUMBER.match(text)
    if not match:
        raise Wrong(f"found {show(text)}" if text else "found nothing", f"expected {example(quantity)}")
    sign, digits, exponent = match.groups()
    unit = text[match.end() :].strip()
    if len(match.group()) > MAX_DIGITS:
        raise Wrong(f"found a number of {len(match.group()):,} characters", f"expected at most {MAX_DIGITS}")
    canonical = _canonical(unit)
    if not unit and not quantity.bare:
        raise Wrong(f"found {show(text)}, which has no unit", f"{quantity.takes} ({text} {_likely(text, quantity)}?)")
    if unit and canonical not in quantity.powers:
        raise _wrong_unit(text, match.group(), unit, canonical, quantity)
    power = quantity.powers.get(canonical, 0)
    value = float(f"{sign}{digits}e{int(exponent or 0) + power}")
    if not math.isfinite(value):
        raise Wrong(f"found {show(text)}, which is beyond the range of numbers", "expected a finite number")
    return math.radians(value) if quantity.degrees and canonical == "deg" else value


def _likely(text: str, quantity: Quantity) -> str:
    """The unit that a number without one may have: few particles are those of a cm^3."""
    return "/cm^3" if quantity is DENSITY and float(text) < 1e6 else quantity.suggested


def _wrong_unit(text: str, number: str, unit: str, canonical: str, quantity: Quantity) -> Wrong:
    if index := _COMPLEX.fullmatch(text):
        return Wrong(f"found {show(text)}, a complex number",
                     f"expected real ones: n: {index[1]}, k: {index['k'] or '1'} is n + ik")
    if not quantity.powers:
        return Wrong(f"found {show(text)}", "expected a number without unit")
    near = closest(canonical, quantity.powers, 0.7)
    hint = f" ({number} {near}?)" if near else ""
    return Wrong(f"found {show(text)}; {show(unit)} is no unit of {quantity.name}", quantity.takes + hint)


def example(quantity: Quantity) -> str:
    """What such a value looks like, in words."""
    if quantity is FRACTION:
        return "a fraction such as 0.01 or 1%"
    return quantity.one + (f" such as 5 {quantity.suggested}" if quantity.suggested else "")


def parse_list(text: str, quantity: Quantity) -> tuple[float, ...]:
    """The values of `[0.84, 0.75, 0.68] mm`, one unit for all; raises `Wrong` with the place of the bad entry."""
    match = _LIST.fullmatch(text.strip())
    if not match:
        raise Wrong(f"found {show(text)}", f"expected {example(quantity)} or a list")
    unit, values, offset = match.group(2) or "", [], 1 + len(text) - len(text.lstrip())
    for item in match.group(1).split(","):
        bare = item.strip()
        at = offset + len(item) - len(item.lstrip())
        if not NUMBER.fullmatch(bare):
            raise Wrong(
                f"found {show(bare)} in a list with one unit" if bare else "found an empty place in the list",
                f"expected numbers, as in [1, 2, 3] {unit or quantity.suggested}",
                at,
            )
        try:
            values.append(parse(f"{bare} {unit}", quantity))
        except Wrong as wrong:
            wrong.offset = at
            raise
        offset += len(item) + 1
    return tuple(values)


def parse_any(text: str, quantity: Quantity) -> float | tuple[float, ...]:
    """The value of a text, or the values of a list with a unit behind it; raises `Wrong`."""
    return (parse_list if is_list(text) else parse)(text, quantity)


def is_list(text: str) -> bool:
    """Whether the text is a list with a unit behind it."""
    return text.lstrip().startswith("[")


def asked(option: str, text: str, quantity: Quantity, accepted: tuple[float, float], expected: str) -> float:
    """The value of an option above the first of what is accepted, up to the second; UsageError, with what is expected, if not."""
    with naming(option):
        value = parse(text, quantity)
    if not accepted[0] < value <= accepted[1]:
        raise UsageError(f'{option}: found "{text}"; expected {expected}')
    return value
