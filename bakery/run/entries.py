"""What belongs to a cache: a file whose name ends in a hash, and in which stands what has that hash.

Entries are stages, `STAGE-HASH.h5`, where HASH is the stage's input hash; `scenes/` holds whole assets, `NAME-HASH.h5`, where
HASH is that of the recipe's text and of the input hashes of all stages.  `.bad` in place of `.h5` was an entry and is damaged.
Whatever else lies in the folder is somebody else's: it is never read as an entry, counted or removed.
"""

import hashlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from bakery.errors import AssetError, StoreError
from bakery.store.container import FORMAT
from bakery.store.read import parse, read_bytes
from bakery.store.tree import Group, read_text

ENTRY, BAD = ".h5", ".bad"
SCENES, LOCKS = "scenes", "locks"  # folders inside of a cache
SPEED = "speed.json"  # what stages took here, for the next plan
_NAME = re.compile(r"(?P<name>[A-Za-z][A-Za-z0-9_-]{0,63})-(?P<key>[0-9a-f]{64})(?P<suffix>\.h5|\.bad)")
_PART = re.compile(r"\..+\.(part|tmp)", re.DOTALL)
_HEAD = FORMAT.encode() + b" "


class Held(NamedTuple):
    """What a folder holds."""

    # path, size in bytes and time of last use of each entry, stages and assets, oldest first
    entries: list[tuple[Path, int, float]]
    bad: list[Path]  # what was set aside as damaged
    others: list[Path]  # files and folders that do not belong to the cache


def has_form(name: str) -> bool:
    """Whether a file's name is that of an entry, without a look inside."""
    match = _NAME.fullmatch(name)
    return match is not None and match["suffix"] == ENTRY


def is_stage(root: Group) -> bool:
    """Whether a tree is that of a stage's entry, of whatever hash: its name, its group, its provenance and nothing else."""
    name = root.attributes.get("name")
    return set(root.members) == {name, "provenance"} and all(isinstance(member, Group) for member in root.members.values())


def asset_key(name: str, recipe: str, hashes: Mapping[str, str]) -> str:
    """Hash of a whole asset.

    name, recipe : of the recipe; its text with every override applied
    hashes : input hash of each stage
    """
    return hashlib.sha256(json.dumps([name, recipe, dict(sorted(hashes.items()))]).encode()).hexdigest()


def key_of_asset(root: Group) -> str | None:
    """The same of what an asset holds; None where it is no whole asset."""
    try:
        hashes = {name: group.attributes["input_hash"] for name, group in root.members.items()
                  if isinstance(group, Group) and "input_hash" in group.attributes}
        return asset_key(root.attributes["name"], read_text(root["recipe"]), hashes)
    except (KeyError, AttributeError, TypeError, ValueError):
        return None


def is_entry(path: Path) -> bool:
    """Whether a file is an entry, or was one and is damaged: its name alone tells then, with the first bytes of an asset."""
    match = _NAME.fullmatch(path.name)
    if match is None or match["suffix"] != ENTRY or not path.is_file():
        return False
    try:
        data = read_bytes(os.fspath(path))
        root = parse(os.fspath(path), data)
    except (AssetError, StoreError, OSError):
        return _begins_as_one(path)
    if path.parent.name == SCENES:
        return match["key"] == key_of_asset(root)
    return is_stage(root) and root.attributes["name"] == match["name"] \
        and root[match["name"]].attributes.get("input_hash") == match["key"]


def held(folder: Path) -> Held:
    """What a cache's folder holds, and its folder of assets."""
    entries, bad, others = [], [], []
    assets = _listed(folder / SCENES) if _is_plain_folder(folder / SCENES) else []
    for path in (*_listed(folder), *assets):
        if path.parent == folder and (path.name == SPEED or path.name in (SCENES, LOCKS) and _is_plain_folder(path)):
            continue
        if _PART.fullmatch(path.name):  # of a write that goes on, or removed by the next one
            continue
        match = _NAME.fullmatch(path.name)
        if match and match["suffix"] == BAD and path.is_file():
            bad.append(path)
        elif is_entry(path):
            try:
                status = path.stat()
            except OSError:
                continue  # removed meanwhile
            entries.append((path, status.st_size, status.st_mtime))
        else:
            others.append(path)
    return Held(sorted(entries, key=lambda entry: entry[2]), bad, others)


def _begins_as_one(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            return file.read(len(_HEAD)) == _HEAD
    except OSError:
        return False


def _is_plain_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _listed(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []
