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
    """An option of `bake export` that some formats take; formats that share one declare the same object.

    Attributes
    ----------
    flag : such as "--each-wavelength"
    words : for its help
    metavar : of its value; "" where it has none, and is given or not
    parse : text of the value -> value; UsageError where it is none
    """

    flag: str
    words: str
    metavar: str = ""
    parse: Callable[[str], Any] = str

    @property
    def name(self) -> str:
        """Of its value among `Job.settings`."""
        return self.flag.removeprefix("--").replace("-", "_")


class Job(NamedTuple):
    """What is exported.

    Attributes
    ----------
    asset : opened
    colour : `renderers.colour`, or what has its `band_matrix`, `rgb_order` and `BANDS`
    settings : values of the options that were given, by `Option.name`
    """

    asset: Asset
    colour: Any
    settings: Mapping[str, Any]

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
    """What an exporter made of an asset.

    Attributes
    ----------
    files : name -> content
    losses : what is lost, for machines
    lines : the same for people; a list among them belongs to the file of the same number
    warnings : what makes a file nearly useless, first of all
    """

    files: Mapping[str, str | bytes]
    losses: Sequence[Mapping[str, Any]]
    lines: Sequence[str | list[str]]
    warnings: Sequence[str] = ()


@dataclass(frozen=True)
class Exporter:
    """A format.

    Attributes
    ----------
    name : as `--to` takes it
    words : what it writes
    program : that reads it
    takes : stages of which an asset holds at least one
    holds, loses : of the asset
    write : Job -> Written
    options : that it takes
    kinds : of its files, by their ending, where `bakery.store.outputs` does not know them: only such a file is replaced
    """

    name: str
    words: str
    program: str
    takes: tuple[str, ...]
    holds: str
    loses: str
    write: Callable[[Job], Written]
    options: tuple[Option, ...] = ()
    kinds: Mapping[str, FileKind] = field(default_factory=dict)
