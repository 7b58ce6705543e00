"""Content hashes: what must agree for two assets to hold the same, defined in `docs/asset-format.md`.

The digest of a group is taken over the digests of its members, so the hash of the root is the hash of its stages' hashes.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from bakery.store.container import FORMAT, VERSION
from bakery.store.tree import Dataset, Group

HASH = "content_hash"
STAGE = "stage"  # a group with this attribute is a stage's
UNHASHED = ("provenance",)  # members of the root that may differ between two bakes of the same
_NOTHING: Mapping[str, str] = MappingProxyType({})


def content_hash(member: Dataset | Group, without: tuple[str, ...] = (), digests: Mapping[str, str] = _NOTHING) -> str:
    """SHA-256, in hexadecimal, over names, shapes, types, attributes and bytes of all that a member holds.

    Attributes called `content_hash` and the direct members named in `without` do not enter; the order of members does not matter.
    `digests` holds hashes of direct members that were computed already.
    """
    digest = hashlib.sha256()
    if isinstance(member, Group):
        digest.update(b"group\n")
        _add_attributes(digest, member.attributes)
        for name in sorted(member.members):
            if name not in without:
                digest.update(f"member {name} {digests.get(name) or content_hash(member.members[name])}\n".encode())
        return digest.hexdigest()
    digest.update(b"dataset\n")
    _add_attributes(digest, {"description": member.description, "units": member.units})
    data = np.ascontiguousarray(little_endian(member.data))
    choices = f" enum {','.join(member.choices)}" if member.choices else ""
    shape = "".join(f" {n}" for n in data.shape)
    digest.update(f"data {data.dtype.str}{choices} shape{shape}\n".encode())
    digest.update(data.reshape(-1).view(np.uint8))
    return digest.hexdigest()


def root_hash(root: Group, digests: Mapping[str, str] = _NOTHING) -> str:
    """The hash of a whole asset: everything but its provenance."""
    return content_hash(root, UNHASHED, digests)


def seal(root: Group) -> Group:
    """The same tree as it will be stored: arrays with a shape, little-endian, and every content hash filled in."""
    members, stages = {}, {}
    for name, member in root.members.items():
        member = normalised(member, name)
        if isinstance(member, Group) and STAGE in member.attributes:
            stages[name] = content_hash(member)
            member = replace(member, attributes=member.attributes | {HASH: stages[name]})
        members[name] = member
    fixed = {"format": FORMAT, "format_version": VERSION}
    root = Group(members, fixed | root.attributes | fixed)
    return replace(root, attributes=root.attributes | {HASH: root_hash(root, stages)})


def broken_hashes(root: Group) -> list[str]:
    """What does not agree with its `content_hash`, in words; empty for a sound asset."""
    stages = {name: content_hash(member) for name, member in root.members.items()
              if isinstance(member, Group) and STAGE in member.attributes}
    broken = [f"{name}: its content does not match its content_hash" for name, digest in stages.items()
              if root.members[name].attributes.get(HASH) != digest]
    if not broken and root.attributes.get(HASH) != root_hash(root, stages):
        broken = ["the root (recipe, wavelength or an attribute) does not match its content_hash"]
    return broken


def normalised(member: Dataset | Group, path: str) -> Dataset | Group:
    """A member as the file will hold it: scalars as shape (1,), C order, little-endian, unmasked plain arrays.

    Raises ValueError : an array of objects, of unicode strings or of another type that the format does not know
    """
    if isinstance(member, Group):
        return replace(member, members={name: normalised(inner, f"{path}/{name}") for name, inner in member.members.items()})
    data = np.atleast_1d(np.asarray(member.data))
    if data.dtype.kind not in "fiubcS" or not 0 < data.dtype.itemsize <= 1 << 16 or data.dtype.str[1:] in ("f16", "c32"):
        raise ValueError(f"{path}: type {data.dtype} is not stored; use float, int, bool, complex, bytes or `text`")
    return replace(member, data=np.ascontiguousarray(little_endian(data)))


def little_endian(data: np.ndarray) -> np.ndarray:
    """The same numbers in the byte order of the file."""
    return data.astype(data.dtype.newbyteorder("<"), copy=False)


def _add_attributes(digest, attributes) -> None:
    for name in sorted(attributes):
        if name != HASH:
            kind, value = _attribute_bytes(attributes[name])
            digest.update(f"attribute {name} {kind} {value.hex()}\n".encode())


def _attribute_bytes(value) -> tuple[str, bytes]:
    if isinstance(value, str):
        return "utf-8", value.encode()
    if isinstance(value, bool | np.bool_):
        return "|b1", np.asarray(value).tobytes()
    kind = "<i8" if isinstance(value, int | np.integer) else "<f8"
    return kind, np.asarray(value, kind).tobytes()
