"""A checked recipe: what the rest of bakery sees.  Immutable; arrays are read-only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bakery.errors import Problem, UsageError
from bakery.family.axes import Sweep
from bakery.grammar.files import DataFile
from bakery.grammar.values import Values


@dataclass(frozen=True)
class Recipe:
    """A recipe whose values are all checked; see docs/architecture.md.

    Every section that a stage declares is an attribute: its `Values`, or None where the recipe does without it.
    """

    path: Path
    name: str
    description: str
    text: str
    seed: int
    tolerance: float
    measure: str
    wavelength: tuple[float, ...]  # (L,) um, in vacuum
    sections: Mapping[str, Values | None]  # name -> values of the section, or None
    # every value, defaults included: dotted key -> text, number or truth in base units
    leaves: Mapping[str, str | int | float | bool]
    files: tuple[DataFile, ...]  # every file that was read
    places: Mapping[str, str] = field(repr=False)  # dotted key -> where it stands
    warnings: tuple[Problem, ...] = ()  # what is legal and probably not meant
    sweep: Sweep | None = None  # what is swept; all else is then of its first point.  None where there is one point

    def __getattr__(self, name: str):
        if not name.startswith("_") and name in self.__dict__.get("sections", ()):
            return self.sections[name]
        raise AttributeError(f"a recipe has no {name!r}")

    def unswept(self) -> Recipe:
        """Itself; UsageError where it has several points, for what knows of one only."""
        if self.sweep is not None:
            raise UsageError(f"{self.path}: sweeps {' and '.join(self.sweep.where)}, so it bakes a family, but a single asset is "
                             "needed here: save one from it (`at(…).save(…)`), or use `--set sweep=none`, its own values")
        return self

    def where(self, key: str) -> str:
        """`recipes/fog.yaml:12`, where a key stands; of a default, where the nearest key above it stands."""
        while key and key not in self.places:
            cut = max(key.rfind("."), key.rfind("["))
            key = key[:cut] if cut > 0 else ""
        return self.places.get(key, str(self.path))
