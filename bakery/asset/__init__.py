"""Assets and families as Python sees them: `bakery.open(path)`, the only interface through which renderers see one.

Every group has its datasets as attributes (`asset.medium.sigma_t`) and, exactly as stored, as items (`asset.medium["phase"]`).  A
tabulated phase function is an attribute that can be called with angles.
"""

from __future__ import annotations

import os

from bakery.asset.family import Family
from bakery.asset.single import Asset, read_checked
from bakery.family.tree import is_family

__all__ = ["Asset", "Family", "open", "read_checked"]


def open(path: str | os.PathLike) -> Asset | Family:
    """An asset, or a family of assets, read whole and checked.

    Parameters
    ----------
    path : of the asset file; it is closed on return, and later changes to it have no effect

    Raises
    ------
    AssetError : missing, damaged, foreign, of another format version, or not what its stages declare; the text says which and
        what to do
    StoreError : the system would not read it

    Examples
    --------
    >>> asset = bakery.open("fog.h5")
    >>> asset.medium.phase(np.radians([0, 90, 180])).shape      # (L, 3) 1/sr
    (3, 3)
    """
    root = read_checked(path)
    return (Family if is_family(root) else Asset)(root, os.fspath(path))
