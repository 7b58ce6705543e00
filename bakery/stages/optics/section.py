"""Recipe sections `particles` and `phase`: suspended spheres, and options of their single scattering."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
import math
from functools import partial, reduce
from operator import or_
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, Tag, create_model

from bakery.grammar import tables, units
from bakery.grammar.fields import AUTO, ComponentName, Flag, GeometricDeviation, Length, Path, Share, number, whole, word
from bakery.grammar.section import HostOf, MaterialOf, Section, given, pick
from bakery.grammar.text import Mapping, Node, Sequence, mappings
from bakery.grammar.units import DENSITY
from bakery.grammar.values import Index, Values
from bakery.physics.sizes import MIXTURE, Part, laws, tails
from bakery.physics.sizes.law import COLUMNS, DEVIATION, FRACTION, LENGTH, NUMBER, Law
from bakery.stages.declaration import RecipeSection

if TYPE_CHECKING:
    from bakery.recipe.checker import Checker

SMALLEST, LARGEST = 1e-8, 1e6  # size parameters that Lorenz-Mie sums cover


class _Cut(Section):
    min: Length | None = Field(None, description="Smallest radius: the density is cut there and renormalised.")
    max: Length | None = Field(None, description="Largest radius: the density is cut there and renormalised.")


class _Part(Section):
    share: Share = Field(description="Share of the particle number; shares add up to 1.")


# what a key's value is -> its kind in a recipe
_KINDS = {LENGTH: lambda **_: Length, DEVIATION: lambda **_: GeometricDeviation, FRACTION: partial(number, units.FRACTION),
          NUMBER: number, COLUMNS: lambda **_: Path}


def _section(law: type[Law]) -> type[Section]:
    """The keys of a law's size."""
    keys = {name: (_KINDS[key.kind](**key.bounds), Field(description=key.words)) for name, key in law.keys.items()}
    return create_model(f"{law.name.capitalize()}Size", __base__=_Cut if law.cut else Section, __module__=__name__,
                        distribution=(word(law.name), Field(description=law.words)), **keys)


def _one_of(sections: dict[str, type[Section]]):
    """The size that its distribution names."""
    kinds = [Annotated[section, Tag(name)] for name, section in sections.items()]
    return Annotated[reduce(or_, kinds), pick("distribution", tuple(sections))]


_SIZES = {name: _section(law) for name, law in laws().items()}
_PARTS = {name: create_model(f"{name.capitalize()}Part", __base__=(_Part, section), __module__=__name__)
          for name, section in _SIZES.items()}


class MixtureSize(_Cut):
    distribution: word(MIXTURE) = Field(description="Sum of several distributions.")
    of: list[_one_of(_PARTS)] = Field(min_length=1, max_length=256, description="The distributions, each with its share.")


Size = _one_of(_SIZES | {MIXTURE: MixtureSize})


class Component(Section):
    name: ComponentName = Field(description="Name of the group in the asset.")
    material: MaterialOf = Field(description="A material of assets/materials, {n, k}, or {file}.")
    fraction: Share = Field(1.0, description="Share of the particle number; the shares of all components add up to 1.")
    size: Size = Field(description="Distribution of the radii.")


class Particles(Section):
    """Suspended spheres."""

    host: HostOf = Field("air", description="What the spheres float in: a material, {n}, or {file}.")
    number_density: number(DENSITY, above=0, most=1e30) | None = Field(None, description="Spheres per volume, such as 1e8 /m^3.")
    volume_fraction: number(units.FRACTION, above=0, below=1) | None = Field(
        None, description="Volume of the spheres per volume."
    )
    components: list[Component] = Field(min_length=1, max_length=256, description="The kinds of particles.")


class SingleScattering(Section):
    """Options of the single-scattering stage."""

    method: word("auto", "mie", "goa") = Field(
        "auto", description="How spheres are computed: series (mie), rays for the large ones (goa), or rays where they are "
        "measured to be good enough and save time (auto)."
    )
    orders: whole(0, 50) = Field(3, description="Rays: highest number of chords.")
    polarized: Flag = Field(False, description="Also bake the Mueller elements s11, s12, s33, s34.")
    switch: number(least=30, most=1e8, words=AUTO) = Field("auto", description="Size parameter from which method goa takes rays.")
    edge: word("narrow", "wide", "none") = Field("narrow", description="Rays: window of exact waves at the edge of a sphere.")
    rainbow: Flag = Field(True, description="Rays: the uniform formula at rainbows.")
    axis: Flag = Field(True, description="Rays: the uniform formula at 0 and 180 degrees.")
    radii: whole(3, 10**6, words=AUTO) = Field("auto", description="Number of sizes, whatever error they leave.")
    angles: whole(3, 10**6, words=AUTO) = Field("auto", description="Number of angles, whatever error they leave.")


# ---- what holds between the keys


def check_particles(checker: "Checker", section: Mapping) -> None:
    """Amounts, shares, optical constants and sizes of suspended spheres."""
    amounts = given(section, "number_density", "volume_fraction")
    if not amounts:
        checker.report_section(section, "found neither number_density nor volume_fraction", "expected one of them")
    elif len(amounts) == 2:
        second = section.get(amounts[1], section)
        checker.report_section(second, f"found {amounts[1]} beside {amounts[0]}", "expected only one of them")
    host = checker.host(section, "air")
    for part in checker.components(section, "fraction"):
        checker.index(part, "material")
        for size in mappings(part.get("size")):
            _size(checker, size, host)


def _size(checker: "Checker", size: Mapping, host: Index | None, low: float | None = None, high: float | None = None) -> None:
    """One distribution; `low` and `high` are the cuts of the mixture that it is part of."""
    smallest, largest, radius = (checker.value(size, name) for name in ("min", "max", "radius"))
    if smallest is not None and largest is not None and smallest >= largest:
        checker.report(size["max"], f"found max {largest:g} um, not above min {smallest:g} um", "expected min below max")
        return
    for name in ("radius", "min", "max"):
        if checker.value(size, name) is not None:
            _size_parameter(checker, size[name], f"{name} of {checker.value(size, name):g} um", checker.value(size, name), host)
    distribution = checker.value(size, "distribution")
    law = laws().get(distribution)
    inner_low = max((v for v in (low, smallest) if v is not None), default=None)
    inner_high = min((v for v in (high, largest) if v is not None), default=None)
    if distribution == MIXTURE:
        of = size.get("of")
        parts = list(mappings(*of)) if isinstance(of, Sequence) else []
        for part in parts:
            _size(checker, part, host, inner_low, inner_high)
        if parts and len(parts) == len(of):
            checker.shares(of, "share", parts, None)
        return
    columns = [name for name, key in law.keys.items() if key.kind == COLUMNS] if law else []
    for name in columns:
        _size_table(checker, size, name, host, inner_low, inner_high)
    if columns or law is None:
        return
    if radius is not None and (
        inner_low is not None and radius < inner_low or inner_high is not None and radius > inner_high
    ):
        bounds = " to ".join("…" if v is None else f"{v:g}" for v in (inner_low, inner_high))
        checker.report(
            size["radius"],
            f"found a radius of {radius:g} um outside of min and max ({bounds} um)",
            "expected it between them",
        )
    elif inner_high is None:
        _tail(checker, size, law, host)


def _tail(checker: "Checker", size: Mapping, law: type[Law], host: Index | None) -> None:
    """The largest spheres of a distribution without `max` that count at the recipe's tolerance."""
    width, tolerance = law.widened_by, checker.values.get("tolerance", 0.01)
    values = {name: checker.value(size, name) for name in law.keys}
    if not width or None in values.values() or tolerance is None or host is None or checker.wavelength is None:
        return
    k = 2 * math.pi * host.n / np.array(checker.wavelength)
    if values.get("radius", 0.0) * k.max() > LARGEST:
        return  # said of the radius
    largest = tails(Part(law(**values), 1.0), k, tolerance)[1]
    if largest * k.max() > LARGEST:
        cut = math.floor(LARGEST / k.max())
        checker.report(
            size[width],
            f"found a tail in which radii up to {largest:.3g} um (size parameter {largest * k.max():.3g}) count at a "
            f"tolerance of {tolerance:g}",
            f"expected size parameters up to {LARGEST:g}; a cut (max: {cut} um) or a smaller {width} would do",
        )


def _size_table(checker: "Checker", size: Mapping, key: str, host: Index | None, low: float | None, high: float | None) -> None:
    columns = checker.table(size.get(key), tables.SIZES)
    if columns is None:
        return
    radius, density = columns
    if not density.max() > 0:
        checker.report(size[key], "found a density that is zero everywhere", "expected a positive density")
        return
    used = np.flatnonzero(density > 0)
    first, last = radius[max(used[0] - 1, 0)], radius[min(used[-1] + 1, len(radius) - 1)]
    if low is not None and last <= low or high is not None and first >= high:
        checker.report(
            size[key], f"found densities from {first:g} to {last:g} um, all outside of min and max", "expected an overlap"
        )
    for value in (radius[radius > 0][0], last if high is None else min(last, high)):
        _size_parameter(checker, size[key], f"radius of {value:g} um in the table", float(value), host)


def _size_parameter(checker: "Checker", node: Node, noun: str, radius: float, host: Index | None) -> None:
    if host is None or checker.wavelength is None:
        return
    scale = 2 * math.pi * host.n / np.array(checker.wavelength)
    low, high = radius * float(scale.min()), radius * float(scale.max())  # Python's floats overflow in silence
    if low < SMALLEST or high > LARGEST:
        x, least, most = (low if low < SMALLEST else high), SMALLEST / scale.min(), LARGEST / scale.max()
        checker.report(
            node,
            f"found a {noun}, size parameter {x:.3g}",
            f"expected size parameters {SMALLEST:g} to {LARGEST:g}, here {least:.3g} to {most:.3g} um",
        )


def check_phase(checker: "Checker", section: Mapping) -> None:
    """Options of single scattering stand beside particles, and a switch to rays beside rays."""
    beside = [name for name in checker.scattering if name in checker.tree]
    if beside and "particles" not in beside:
        checker.report_section(section, f"found options of single scattering beside {beside[0]}",
                               "expected them with particles only" + (" (medium.phase?)" if "medium" in beside else ""))
    if checker.value(section, "switch") not in ("auto", None) and checker.value(section, "method") != "goa":
        checker.report(section["switch"], "found a size parameter for the switch to rays with another method than goa",
                       "expected method: goa beside it, or switch: auto")


# ---- values


def sizes(size: Values) -> SimpleNamespace:
    """A size as `bakery.physics.sizes.population` takes it: lengths in um; without a cut `min` and `max` are None."""
    keys = {"min": None, "max": None} | vars(size)
    return SimpleNamespace(**keys | {"of": tuple((part.share, sizes(part)) for part in keys.get("of", ()))})


PARTICLES = RecipeSection("particles", Particles, "Suspended spheres: fog, dust, bubbles.", check_particles, scatters=True)
PHASE = RecipeSection("phase", SingleScattering, "Options of the single-scattering stage.", check_phase, beside="particles")
