"""The files of a family's members, held against what the family says of them."""

from collections.abc import Sequence
from pathlib import Path

from bakery.errors import AssetError
from bakery.family.axes import in_words, points
from bakery.family.tree import Member, axes_of, members_of
from bakery.stages.conform import FAMILY, check
from bakery.store.hashes import HASH
from bakery.store.read import read
from bakery.store.tree import Group


def listed(root: Group) -> list[tuple[tuple[float, ...], str, Member]]:
    """Coordinates in SI units, the same in words, and what the family says of each point."""
    axes = axes_of(root.members[FAMILY])
    places = points([axis.first.values for axis in axes])
    return [(index, in_words(axes, index), member)
            for index, member in zip(places, members_of(root.members[FAMILY]), strict=True)]


def counted(reasons: Sequence[str]) -> str:
    """`4 assets (2 points failed)`, from why there is none at each point, or nothing."""
    failed = sum(map(bool, reasons))
    baked = len(reasons) - failed
    return f"{baked} asset{'s' * (baked > 1)}" + (f" ({failed} point{'s' * (failed > 1)} failed)" if failed else "")


def broken(path: Path, root: Group) -> list[str]:
    """Members whose file is missing, damaged or another than it was, in words; `path` is that of the family.

    Raises StoreError where the system would not read one.
    """
    faults = []
    for _, words, member in listed(root):
        if not member.reason and (fault := fault_of(path, member)):
            faults.append(f"member {words}: {fault}; bake the family again with `bake RECIPE`")
    return faults


def fault_of(path: Path, member: Member) -> str:
    """What is wrong with a member's file, or nothing."""
    file = path.parent / member.file
    if Path(member.file).is_absolute() or ".." in Path(member.file).parts:
        return f"{member.file}: leads out of the family's folder"
    try:
        asset = read(file)
        check(str(file), asset)
    except AssetError as error:
        return str(error).partition("; ")[0]
    same = asset.attributes.get(HASH) == member.content_hash
    return "" if same else f"{file}: another asset than the family was made of"
