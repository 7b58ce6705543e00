"""Recipe section `medium`: a continuous medium given by its coefficients."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, Tag

from bakery.grammar import tables
from bakery.grammar.fields import Length, Path, number, numbers, word
from bakery.grammar.section import Section, given, meant, pick
from bakery.grammar.text import Mapping, mappings, owner
from bakery.grammar.units import ANGLE, COEFFICIENT, FRACTION, LENGTH, MASS_CONCENTRATION
from bakery.grammar.values import Values
from bakery.stages.declaration import RecipeSection
from bakery.stages.medium import of_file

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

STEEPEST = 1 - 1e-9  # largest |g| of a Henyey-Greenstein function: its lobe is narrower than that of any particle above


class HenyeyGreenstein(Section):
    type: word("hg") = Field(description="Henyey-Greenstein.")
    g: numbers(above=-1, below=1) = Field(description="Mean cosine, between -1 and 1; one value, or one a wavelength.")


class Isotropic(Section):
    type: word("isotropic") = Field(description="The same in all directions.")


class Rayleigh(Section):
    type: word("rayleigh") = Field(description="Rayleigh scattering of unpolarised light.")


class Gaussian(Section):
    type: word("gaussian") = Field(description="A Gaussian lobe about the forward direction.")
    spread: number(ANGLE, least=1e-6, most=3.141592653589794) = Field(
        description="Standard deviation of the angle, such as 30 deg."
    )


class PhaseTable(Section):
    type: word("table") = Field(description="From a CSV file.")
    file: Path = Field(description="CSV file with the columns theta_deg (or theta_rad), 0 to 180 degrees, and value (any scale).")


MediumPhase = Annotated[
    Annotated[HenyeyGreenstein, Tag("hg")]
    | Annotated[Isotropic, Tag("isotropic")]
    | Annotated[Rayleigh, Tag("rayleigh")]
    | Annotated[Gaussian, Tag("gaussian")]
    | Annotated[PhaseTable, Tag("table")],
    pick("type", ("hg", "isotropic", "rayleigh", "gaussian", "table")),
]


class Medium(Section):
    """A continuous medium: albedo and mean_free_path, or sigma_s and sigma_a, and phase; or a file."""

    albedo: numbers(FRACTION, least=0, most=1) | None = Field(
        None, description="Single-scattering albedo; one value, or one a wavelength."
    )
    mean_free_path: numbers(LENGTH, above=0) | None = Field(None, description="1/sigma_t, such as [0.84, 0.75, 0.68] mm.")
    sigma_s: numbers(COEFFICIENT, least=0) | None = Field(
        None, description="Scattering coefficient, such as [2.1, 2.3, 2.5] /mm."
    )
    sigma_a: numbers(COEFFICIENT, least=0) | None = Field(None, description="Absorption coefficient.")
    phase: MediumPhase | None = Field(None, description="Phase function.")
    file: Path | None = Field(
        None, description="File with coefficients and phase functions, instead of both: NetCDF of libRadtran (`mie`, OPAC), "
        "Eradiate, or `bake export --to netcdf`.")
    mass_concentration: number(MASS_CONCENTRATION, above=0) | None = Field(
        None, description="With a file that holds extinction per mass: mass of the particles in a volume, such as 0.3 g/m^3.")
    effective_radius: Length | None = Field(None, description="With a file that holds several: the effective radius.")
    humidity: number(FRACTION, least=0, most=1) | None = Field(
        None, description="With a file that holds several: the relative humidity, such as 80%.")


# ---- what holds between the keys


def check(checker: "Checker", section: Mapping) -> None:
    """Which coefficients are given, one or one a wavelength, and the phase function."""
    if "file" in section:
        beside = [name for name in ("albedo", "mean_free_path", "sigma_s", "sigma_a", "phase") if name in section]
        for name in beside:
            checker.report_section(section[name], f"found {name} beside file", "expected only one of them")
        of_file.check(checker, section)
        return
    for name in of_file.KEYS:
        if name in section:
            checker.report_section(section[name], f"found {name} without file",
                                   "expected it with a file of optical properties only")
    if "phase" not in section and "phase" not in meant(section):
        checker.problems.append(owner(section).problem("missing", "expected phase: phase function", key="medium.phase"))
    first, second = given(section, "albedo", "mean_free_path"), given(section, "sigma_s", "sigma_a")
    want = "expected albedo and mean_free_path, or sigma_s and sigma_a"
    if first and second:
        node = section.get(second[0], section)
        checker.report_section(node, f"found {' and '.join(second)} beside {' and '.join(first)}", want)
    elif len(first or second) < 2:
        checker.report_section(
            section, f"found only {(first or second)[0]}" if first or second else "found no coefficients", want
        )
    _, path, s, a = (checker.one_each(section, name) for name in ("albedo", "mean_free_path", "sigma_s", "sigma_a"))
    if s is not None and a is not None and ((s == 0) & (a == 0)).any():
        checker.report_section(section, "found sigma_s and sigma_a that are both 0", "expected a positive sum")
    elif s is not None and a is not None and not all(1e-24 < sum(pair) < 1e15 for pair in zip(s.tolist(), a.tolist())):
        checker.report_section(
            section, "found sigma_s and sigma_a with a sum that no medium has", "expected 1e-24 /m to 1e15 /m"
        )
    if path is not None and not ((path > 1e-9) & (path < 1e30)).all():
        checker.report(section["mean_free_path"], "found a mean free path that no medium has", "expected 1e-15 m to 1e24 m")
    for phase in mappings(section.get("phase")):
        g = checker.one_each(phase, "g")
        if g is not None and np.abs(g).max() > STEEPEST:
            steepest = float(g[np.abs(g).argmax()])
            checker.report(phase["g"], f"found g = {steepest!r}, a lobe too narrow for a table", "expected |g| up to 1 - 1e-9")
        if checker.value(phase, "type") == "table":
            _phase_table(checker, phase)


def _phase_table(checker: "Checker", phase: Mapping) -> None:
    columns = checker.table(phase.get("file"), tables.PHASE)
    if columns is None:
        return
    theta, value = columns
    if not value.max() > 0:
        checker.report(phase["file"], "found a phase function that is zero everywhere", "expected positive values")
    if theta[0] > 1e-9 or abs(theta[-1] - math.pi) > 1e-6:
        ends = " to ".join(f"{math.degrees(v):g}" for v in theta[[0, -1]])
        checker.report(phase["file"], f"found angles from {ends} deg", "expected 0 to 180 deg")
        return
    theta[0], theta[-1] = 0.0, math.pi
    if not theta[-2] < math.pi:
        checker.report(phase["file"], "found two angles of 180 deg", "expected ascending order")


# ---- values


def coefficients(medium: Values) -> tuple[np.ndarray, np.ndarray]:
    """sigma_t (L,) 1/m and albedo (L,), whichever coefficients are given."""
    if medium.mean_free_path is not None:
        return 1e6 / medium.mean_free_path, medium.albedo  # um to 1/m
    sigma_t = medium.sigma_s + medium.sigma_a
    return sigma_t, medium.sigma_s / sigma_t


def phase_keys(phase: Values | None) -> dict:
    """type, g (L,), spread (rad) and table (theta, value) of a phase function; None what its type does not have.

    phase : None where a file holds the medium
    """
    if phase is None:
        return {"type": "file", "g": None, "spread": None, "table": None}
    keys = vars(phase)
    return {"type": phase.type, "g": keys.get("g"), "spread": keys.get("spread"), "table": keys.get("file")}


MEDIUM = RecipeSection("medium", Medium, "A continuous medium given by its coefficients: milk, wax, skin.", check, scatters=True)
