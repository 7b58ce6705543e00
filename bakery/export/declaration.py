"""What a format declares: read by `bake export`, its help and messages, the table of docs/export.md and tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bakery.store.outputs import FileKind

if TYPE_CHECKING:
    from bakery.asset import Asset


@dataclass(frozen=True)
class Option:
    """An option of `bake export` that some formats take; formats that share one declare the same object."""

    flag: str  # such as "--each-wavelength"
    words: str  # for its help
    metavar: str = ""  # of its value; "" where it has none, and is given or not
    parse: Callable[[str], Any] = str  # text of the value -> value; UsageError where it is none

    @property
    def name(self) -> str:
        """Of its value among `Job.settings`."""
        return self.flag.removeprefix("--").replace("-", "_")


class Job(NamedTuple):
    """What is exported."""

    asset: Asset
    colour: Any  # `renderers.colour`, or what has its `band_matrix`, `rgb_order` and `BANDS`
    settings: Mapping[str, Any]  # values of the options that were given, by `Option.name`

    @property
    def stem(self) -> str:
        """Of the names of files."""
        return Path(self.asset.path).stem

    @property
    def medium_name(self) -> str:
        """What the medium is called in a file: as the asset and its file, as several assets of one recipe stand in one scene."""
        return self.stem if self.stem.startswith(self.asset.name) else f"{self.asset.name}_{self.stem}"

    def unreached_bands(self, file: str) -> list[str]:
        """Warnings of a file in colour about bands that the asset's wavelengths do not reach."""
        from bakery.export.bands import beyond

        bands = dict(zip(("red", "green", "blue"), self.colour.BANDS, strict=True))
        return [f"{file}: {line}" for line in beyond(self.asset.wavelength, bands)]


class Written(NamedTuple):
    """What an exporter made of an asset."""

    files: Mapping[str, str | bytes]  # name -> content
    losses: Sequence[Mapping[str, Any]]  # what is lost, for machines
    lines: Sequence[str | list[str]]  # the same for people; a list among them belongs to the file of the same number
    warnings: Sequence[str] = ()  # what makes a file nearly useless, first of all


def delta_taken_out(share: float, of: str = "coefficients") -> list[str]:
    """What is said of a medium whose forward delta, at most such a share of the scattered light, is taken out; nothing of 0."""
    if not share > 0:
        return []
    return [f"unscattered (delta) transmission of grains, up to {100 * share:.3g} % of what they scatter, is taken out of {of} "
            "and phase function: the same medium."]


@dataclass(frozen=True)
class Exporter:
    """A format."""

    name: str  # as `--to` takes it
    words: str  # what it writes
    program: str  # that reads it
    takes: tuple[str, ...]  # stages of which an asset holds at least one
    # holds, loses: of the asset
    holds: str
    loses: str
    write: Callable[[Job], Written]
    options: tuple[Option, ...] = ()  # that it takes
    # of its files, by their ending, where `bakery.store.outputs` does not know them: only such a file is replaced
    kinds: Mapping[str, FileKind] = field(default_factory=dict)
