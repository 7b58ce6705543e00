"""The key `size` of suspended spheres: what a distribution of radii declares, as recipes write it."""

# no annotations from __future__: pydantic would have to compile each of them again, some 3 ms in all
import math
from functools import partial, reduce
from operator import or_
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, Tag, create_model

from bakery.grammar import tables, units
from bakery.grammar.fields import GeometricDeviation, Length, Path, Share, number, one_of, word
from bakery.grammar.section import Section, given, pick
from bakery.grammar.text import Mapping, Node, Sequence, mappings, owner
from bakery.grammar.values import Index, Values
from bakery.physics.sizes import MIXTURE, Part, laws, share_between, tails
from bakery.physics.sizes.law import BINS, COLUMNS, DEVIATION, FRACTION, LENGTH, NUMBER, Law

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
          NUMBER: number, COLUMNS: lambda **_: Path, BINS: lambda **_: Path}


def _section(law: type[Law]) -> type[Section]:
    """The keys of a law's size."""
    optional = {name for names in law.choices().values() if len(names) > 1 for name in names}
    keys = {}
    for name, key in law.keys.items():
        kind = _KINDS[key.kind](**key.bounds)
        of = (kind | None, Field(None, description=key.words)) if name in optional else (kind, Field(description=key.words))
        keys[name] = of
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


# ---- what holds between the keys


def check_size(checker: "Checker", size: Mapping, host: Index | None, low: float | None = None,
               high: float | None = None) -> bool:
    """One distribution; `low` and `high` are the cuts of the mixture that it is part of.  Whether they leave any of it."""
    smallest, largest = (checker.value(size, name) for name in ("min", "max"))
    if smallest is not None and largest is not None and smallest >= largest:
        checker.report(size["max"], f"found max {largest:g} um, not above min {smallest:g} um", "expected min below max")
        return True
    for name in ("radius", "effective_radius", "min", "max"):
        if checker.value(size, name) is not None:
            words = name.replace("_", " ")
            _size_parameter(checker, size[name], f"{words} of {checker.value(size, name):g} um", checker.value(size, name), host)
    distribution = checker.value(size, "distribution")
    law = laws().get(distribution)
    cuts = tuple(nearer((v for v in pair if v is not None), default=None)
                 for nearer, pair in ((max, (low, smallest)), (min, (high, largest))))
    remains = True
    if distribution == MIXTURE:
        of = size.get("of")
        parts = list(mappings(*of)) if isinstance(of, Sequence) else []
        remains = any([check_size(checker, part, host, *cuts) for part in parts]) or not parts
        if parts and len(parts) == len(of):
            checker.shares(of, "share", parts, None)
    elif law is not None:
        remains = _check_law(checker, size, law, host, cuts)
    if not remains and low is None and high is None:  # else the mixture may hold more
        bounds = " to ".join("…" if v is None else f"{v:g}" for v in cuts)
        checker.report_section(size.get("min", size.get("max", size)), f"found no particle between min and max ({bounds} um)",
                               "expected an interval with some of the distribution")
    return remains


def _check_law(checker: "Checker", size: Mapping, law: type[Law], host: Index | None, cuts: tuple) -> bool:
    """Whether the cuts leave any of it, but for files, which say so themselves."""
    for names in law.choices().values():
        _one_given(checker, size, law, names)
    for name, key in law.keys.items():
        if key.kind == COLUMNS:
            _size_table(checker, size, name, host, *cuts)
        elif key.kind == BINS:
            _histogram(checker, size, name, host, *cuts)
    if any(key.kind in (COLUMNS, BINS) for key in law.keys.values()):
        return True
    remains = _remains(checker, size, law, *cuts)
    if remains and cuts[1] is None:
        _tail(checker, size, law, host, cuts[0])
    return remains


def _remains(checker: "Checker", size: Mapping, law: type[Law], low: float | None, high: float | None) -> bool:
    """Whether a law has particles between the cuts; True where that is not known."""
    low, high = low or 0.0, math.inf if high is None else high
    middle = next((radius for name in ("radius", "effective_radius") if (radius := checker.value(size, name)) is not None), None)
    if middle is None:
        return low < high
    whole = None if low <= middle <= high else _law_of(checker, size, law)
    return whole is None or share_between(whole, low, high) > 0


def _law_of(checker: "Checker", size: Mapping, law: type[Law]) -> Law | None:
    """The law itself; None where a value is missing or wrong."""
    values = {name: checker.value(size, name) for name in law.keys}
    chosen = [next((name for name in names if name in size), names[0]) for names in law.choices().values()]
    return None if any(values[name] is None for name in chosen) else law.of(SimpleNamespace(**values))


def _one_given(checker: "Checker", size: Mapping, law: type[Law], names: tuple[str, ...]) -> None:
    """One of the keys that may stand for each other."""
    present = given(size, *names) if len(names) > 1 else names
    if not present:
        words = law.keys[names[0]].words
        checker.problems.append(owner(size).problem(
            "missing", f"expected {names[0]}: {words[:1].lower()}{words[1:].rstrip('.')}; or {one_of(names[1:])}",
            key=f"{size.place.key}.{names[0]}"))
    elif len(present) > 1 and len(names) > 1:
        checker.report_section(size.get(present[1], size), f"found {present[1]} beside {present[0]}", "expected only one of them")


def _tail(checker: "Checker", size: Mapping, law: type[Law], host: Index | None, low: float | None) -> None:
    """The largest spheres of a distribution without `max` that count at the recipe's tolerance."""
    tolerance = checker.values.get("tolerance", 0.01)
    whole = _law_of(checker, size, law) if law.widened_by else None
    if whole is None or whole.discrete or tolerance is None or host is None or checker.wavelength is None:
        return
    width = next(name for name in law.choices()[law.widened_by] if name in size)
    k = 2 * math.pi * host.n / np.array(checker.wavelength)
    if max(checker.value(size, name) or 0.0 for name in ("radius", "effective_radius")) * k.max() > LARGEST:
        return  # said of the radius
    largest = tails(Part(whole, 1.0, low or 0.0), k, tolerance)[1]
    if largest * k.max() > LARGEST:
        cut = math.floor(LARGEST / k.max())
        checker.report(size[width],
                       f"found a tail in which radii up to {largest:.3g} um (size parameter {largest * k.max():.3g}) count at a "
                       f"tolerance of {tolerance:g}",
                       f"expected size parameters up to {LARGEST:g}; a cut (max: {cut} um) or a smaller {width} would do")


def _histogram(checker: "Checker", size: Mapping, key: str, host: Index | None, low: float | None, high: float | None) -> None:
    counted = checker.bins(size.get(key))
    if counted is None:
        return
    used = np.flatnonzero(counted.amount > 0)
    first, last = counted.edge[used[0]], counted.edge[used[-1] + 1]
    if low is not None and last <= low or high is not None and first >= high:
        checker.report(size[key], f"found bins from {first:g} to {last:g} um, all outside of min and max", "expected an overlap")
    for value in (first, last if high is None else min(last, high)):
        _size_parameter(checker, size[key], f"edge of {value:g} um in the histogram", float(value), host)


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
        checker.report(size[key], f"found densities from {first:g} to {last:g} um, all outside of min and max",
                       "expected an overlap")
    for value in (radius[radius > 0][0], last if high is None else min(last, high)):
        _size_parameter(checker, size[key], f"radius of {value:g} um in the table", float(value), host)


def _size_parameter(checker: "Checker", node: Node, noun: str, radius: float, host: Index | None) -> None:
    if host is None or checker.wavelength is None:
        return
    scale = 2 * math.pi * host.n / np.array(checker.wavelength)
    low, high = radius * float(scale.min()), radius * float(scale.max())  # Python's floats overflow in silence
    if low < SMALLEST or high > LARGEST:
        x, least, most = (low if low < SMALLEST else high), SMALLEST / scale.min(), LARGEST / scale.max()
        checker.report(node, f"found a {noun}, size parameter {x:.3g}",
                       f"expected size parameters {SMALLEST:g} to {LARGEST:g}, here {least:.3g} to {most:.3g} um")


def largest(checker: "Checker", size: Mapping):
    """Radii (um) of which none of a distribution is larger, or that it names where it has no end."""
    if (most := checker.value(size, "max")) is not None:
        yield most
        return
    yield from (radius for name in ("radius", "effective_radius") if (radius := checker.value(size, name)) is not None)
    columns = checker.found.get(f"{size.place.key}.file")
    if columns is not None:
        yield float(columns[0][-1])
    of = size.get("of")
    for part in mappings(*of) if isinstance(of, Sequence) else ():
        yield from largest(checker, part)


# ---- values


def sizes(size: Values) -> SimpleNamespace:
    """A size as `bakery.physics.sizes.population` takes it: lengths in um; without a cut `min` and `max` are None."""
    keys = {"min": None, "max": None} | vars(size)
    return SimpleNamespace(**keys | {"of": tuple((part.share, sizes(part)) for part in keys.get("of", ()))})
