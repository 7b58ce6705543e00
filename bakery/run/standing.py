"""The asset that stands where a bake would write: what it holds, what it was made from, and whether it may be replaced."""

import json
import os
from collections.abc import Mapping
from pathlib import Path

from bakery.errors import AssetError, StoreError, UsageError
from bakery.plan.suffice import Held
from bakery.store.outputs import same_file
from bakery.store.tree import Group, read_text

FROM = "recipe_from"  # attribute of the provenance: the recipe's place as seen from the asset's folder


def asset_at(path: Path) -> Group | None:
    """The intact asset at a path, or None: a damaged one is replaced, not read."""
    from bakery.stages import conform
    from bakery.store.read import read

    if not path.is_file():
        return None
    try:
        root = read(path)
        conform.check(os.fspath(path), root)
        return root
    except (AssetError, StoreError, OSError):
        return None


def held(root: Group) -> dict[str, Held]:
    """The stages of an asset; without parts where other hands made it."""
    return {name: Held(_parts(root, name), group.attributes["input_hash"], float(group.attributes.get("achieved_error", 0.0)))
            for name, group in root.groups.items() if "input_hash" in group.attributes}


def _parts(root: Group, name: str) -> Mapping:
    try:
        parts = json.loads(read_text(root[f"provenance/{name}/inputs"]))
    except (KeyError, ValueError, RecursionError):
        return {}
    return parts if isinstance(parts, dict) else {}


def is_of(root: Group, recipe) -> bool:
    """Whether an asset holds the very text of a recipe."""
    return root.attributes.get("name") == recipe.name and read_text(root["recipe"]) == recipe.text


def stage_of(root: Group | None, name: str, key: str) -> tuple[Group, Group] | None:
    """A stage of an asset and its provenance, if it is the one wanted."""
    group = root.members.get(name) if root else None
    if not isinstance(group, Group) or group.attributes.get("input_hash") != key:
        return None
    try:
        return group, root[f"provenance/{name}"]
    except KeyError:
        return None


# ---- which recipe it was made from


def seen_from(asset: Path, recipe: Path) -> str:
    """A recipe's path from the folder of an asset, by which it is found again where both were moved together."""
    try:
        return os.path.relpath(os.path.realpath(recipe), os.path.dirname(os.path.realpath(asset)))
    except ValueError:  # another drive
        return os.path.realpath(recipe)


def check_recipe(target: Path, root: Group, recipe) -> None:
    """UsageError where the asset, or the family, that stands at a path was made from another recipe: it is nothing to bake over.

    The same recipe is one of the same file name that was edited since, or moved.  Where the file that the asset was made from is
    still there and is another one, the name is a coincidence.
    """
    provenance = root.members.get("provenance")
    made_from = provenance.attributes.get("recipe_path") if isinstance(provenance, Group) else None
    if not isinstance(made_from, str) or is_of(root, recipe):
        return
    seen = provenance.attributes.get(FROM)
    origin = target.resolve().parent / seen if isinstance(seen, str) else None
    if os.path.basename(made_from) != recipe.path.name or origin and origin.is_file() and not same_file(origin, recipe.path):
        raise UsageError(f"{target}: holds the asset of another recipe, {origin or made_from}, so it is not replaced; "
                         "name another output, or give --overwrite")
