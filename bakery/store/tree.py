"""The shape of what is stored: groups of datasets, in memory, before any file.

Stages return these, the store writes and reads them, hashes are taken over them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

Attribute = str | int | float | bool


@dataclass(frozen=True)
class Dataset:
    """An array with its unit (`"1"` for pure numbers) and a one-line description.

    `choices` names the values of an integer array that stands for an enumeration, in order from 0.
    """

    data: np.ndarray
    units: str
    description: str
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Group:
    """Named members with attributes; the order of members is the order in the file."""

    members: dict[str, Dataset | Group] = field(default_factory=dict)
    attributes: dict[str, Attribute] = field(default_factory=dict)

    @property
    def groups(self) -> dict[str, Group]:
        """The members that are groups, by name."""
        return {name: member for name, member in self.members.items() if isinstance(member, Group)}

    @property
    def datasets(self) -> dict[str, Dataset]:
        """The members that are datasets, by name."""
        return {name: member for name, member in self.members.items() if isinstance(member, Dataset)}

    def walk(self, prefix: str = "") -> Iterator[tuple[str, Dataset | Group]]:
        """Every member below this group with its path, parents first."""
        for name, member in self.members.items():
            path = f"{prefix}{name}"
            yield path, member
            if isinstance(member, Group):
                yield from member.walk(path + "/")

    def __getitem__(self, path: str) -> Dataset | Group:
        """The member at a path such as `droplets/radius`; KeyError where there is none."""
        head, _, below = path.partition("/")
        member = self.members[head]
        if not below:
            return member
        if isinstance(member, Dataset):
            raise KeyError(path)
        return member[below]


TEXT = "utf-8"  # the `units` of a dataset that holds text as bytes


def text(string: str, description: str) -> Dataset:
    """Text as a dataset of its UTF-8 bytes: chunked and covered by checksums, as HDF5's own strings are not."""
    return Dataset(np.frombuffer(string.encode(), np.uint8), TEXT, description)


def is_text(member: Dataset | Group) -> bool:
    """Whether this is a dataset that `text` made."""
    return isinstance(member, Dataset) and member.units == TEXT and member.data.dtype == np.uint8 and member.data.ndim == 1


def read_text(dataset: Dataset) -> str:
    """The string that `text` stored; UnicodeDecodeError where the bytes are none."""
    return dataset.data.tobytes().decode()
