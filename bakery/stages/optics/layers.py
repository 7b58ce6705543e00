"""What is around a particle: the keys `coating` and `growth` of a component."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
import math
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from bakery.grammar import tables
from bakery.grammar.fields import Path, number, word
from bakery.grammar.section import MaterialOf, Section, given
from bakery.grammar.text import Mapping, mappings
from bakery.grammar.units import FRACTION, LENGTH
from bakery.grammar.values import Index
from bakery.physics.materials.humidity import growth_factor, tabulated
from bakery.physics.materials.mixing import RULES
from bakery.stages.optics.amounts import DENSITY_KEY, Density
from bakery.stages.optics.size_keys import LARGEST, largest

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

AS_SHELL = "shell"  # of growth: water lies around the particle
_SIZES = ("thickness", "ratio", "volume_share")
MOST_RATIO = 100.0
HUMIDITY = (tables.Column("relative_humidity", {"percent": 0.01, "share": 1.0}, 0.0, named=True),
            tables.Column("growth_factor", {}, 0.0, above=True))
RelativeHumidity = number(FRACTION, least=0, below=1) | None


class Coating(Section):
    """A concentric shell around each particle."""

    material: MaterialOf = Field(description="Material of the shell: a name, {n, k}, {file} or {mixing}.")
    thickness: number(LENGTH, least=0) | None = Field(None, description="Thickness of the shell, the same for all particles.")
    ratio: number(least=1, most=MOST_RATIO) | None = Field(None, description="Total radius over core radius.")
    volume_share: number(FRACTION, least=0, below=1) | None = Field(None, description="Share of the shell in the total volume.")
    density: Density = DENSITY_KEY


class Growth(Section):
    """Water that particles take up from humid air."""

    kappa: number(least=0, most=5) | None = Field(
        None, description="Hygroscopicity of kappa-Koehler theory; 0.61 for ammonium sulphate, 1.1 for sea salt."
    )
    file: Path | None = Field(
        None, description="CSV file with the columns relative_humidity_percent and growth_factor, radius over the dry one."
    )
    material: MaterialOf = Field("water", description="What is taken up.")
    mixing: word(*RULES, AS_SHELL) = Field("volume", description="How the water mixes with the particle; shell: around it.")


def check_layers(checker: "Checker", section: Mapping, parts, host: Index | None) -> None:
    """Coatings, and growth with the humidity that it needs."""
    grows = [part for part in parts if "growth" in part]
    if grows and not given(section, "relative_humidity"):
        checker.report_section(grows[0]["growth"], "found growth without a humidity",
                               "expected particles.relative_humidity, such as 80%")
    if "relative_humidity" in section and not grows:
        checker.report(section["relative_humidity"], "found relative_humidity, and no component that grows",
                       "expected growth: {kappa: …} or {file: …} in a component")
    for part in parts:
        factor, shift = 1.0, 0.0  # of the radii, and what comes on top of them (um)
        for coating in mappings(part.get("coating")):
            _coating(checker, part, coating)
            thickness, ratio, share = (checker.value(coating, name) for name in _SIZES)
            factor, shift = ratio or (1.0 if share is None else (1 - share) ** (-1 / 3)), thickness or 0.0
        for growth in mappings(part.get("growth")):
            factor *= _growth(checker, part, growth, checker.value(section, "relative_humidity"))
        if (factor, shift) != (1.0, 0.0):
            _too_large(checker, part, factor, shift, host)


def _too_large(checker: "Checker", part: Mapping, factor: float, shift: float, host: Index | None) -> None:
    """Whether the largest particles are beyond what the series can do once they have grown."""
    radii = [radius for size in mappings(part.get("size")) for radius in largest(checker, size)]
    if not radii or host is None or checker.wavelength is None:
        return
    x = (factor * max(radii) + shift) * 2 * math.pi * float((host.n / np.array(checker.wavelength)).max())
    if x > LARGEST:
        name = "growth" if "growth" in part else "coating"
        checker.report_section(part[name], f"found a {name} that brings particles to a size parameter of {x:.3g}",
                               f"expected size parameters up to {LARGEST:g}")


def _coating(checker: "Checker", part: Mapping, coating: Mapping) -> None:
    checker.index(coating, "material")
    _only(checker, coating, _SIZES, "no thickness of the shell")
    phase = checker.tree.get("phase")
    if isinstance(phase, Mapping) and checker.value(phase, "method") == "goa":
        checker.report(phase["method"], "found method goa with coated spheres, which rays do not know", "expected mie or auto")
    if "discrete" in checker.tree:
        checker.report_section(part["coating"], "found a coating beside discrete", "expected spheres of one material, which may "
                               "be a mixture ({mixing: …})")


def _growth(checker: "Checker", part: Mapping, growth: Mapping, humidity: float | None) -> float:
    """The factor of the radii, 1 where it is not known."""
    checker.index(growth, "material", "water")
    _only(checker, growth, ("kappa", "file"), "neither kappa nor file")
    shell = checker.value(growth, "mixing") == AS_SHELL
    coated = "coating" in part
    if coated and shell:
        checker.report(growth["mixing"], "found water as a shell around a coating", "expected one that mixes with the coating")
    if coated and isinstance(part["coating"], Mapping) and "thickness" in part["coating"]:
        checker.report_section(part["coating"]["thickness"], "found a thickness of a coating that grows", "expected ratio or "
                               "volume_share: with them all particles grow by one factor")
    if shell and "discrete" in checker.tree:
        checker.report(growth["mixing"], "found a shell of water beside discrete", f"expected {', '.join(RULES)}")
    columns, kappa = checker.table(growth.get("file"), HUMIDITY), checker.value(growth, "kappa")
    if columns is not None:
        return _from_table(checker, growth, columns, humidity)
    factor = 1.0 if kappa is None or humidity is None else growth_factor(kappa, humidity)
    if factor > MOST_RATIO:
        checker.report_section(part["growth"], f"found a growth by a factor of {factor:.3g}",
                               f"expected at most {MOST_RATIO:g}: a smaller relative_humidity or kappa")
        return 1.0
    return factor


def _from_table(checker: "Checker", growth: Mapping, columns, humidity: float | None) -> float:
    reported, (at, factor) = len(checker.problems), columns
    if at[-1] >= 1:
        checker.report(growth["file"], f"found a humidity of {100 * at[-1]:g} % in the table", "expected below 100 %")
    elif at[0] == 0 and abs(factor[0] - 1) > 1e-9:
        checker.report(growth["file"], f"found a growth factor of {factor[0]:g} at humidity 0", "expected 1, the dry particle")
    elif humidity is not None and humidity > at[-1]:
        checker.report(growth["file"], f"found humidities up to {100 * at[-1]:g} %", f"expected them up to the "
                       f"relative_humidity of {100 * humidity:g} %")
    if factor.min() < 1 or factor.max() > MOST_RATIO:
        wrong = factor.min() if factor.min() < 1 else factor.max()
        checker.report(growth["file"], f"found a growth factor of {wrong:g}", f"expected factors of 1 to {MOST_RATIO:g}")
    return 1.0 if humidity is None or len(checker.problems) > reported else tabulated(at, factor, humidity)


def _only(checker: "Checker", section: Mapping, names: tuple[str, ...], missing: str) -> None:
    present = given(section, *names)
    if not present:
        checker.report_section(section, f"found {missing}", f"expected one of {', '.join(names)}")
    elif len(present) > 1:
        checker.report_section(section.get(present[1], section), f"found {present[1]} beside {present[0]}",
                               "expected only one of them")
