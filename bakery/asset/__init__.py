"""Assets and families as Python sees them: `bakery.open(path)`, the only interface through which renderers see one.

Every group has its datasets as attributes (`asset.medium.sigma_t`) and, exactly as stored, as items (`asset.medium["phase"]`).  A
tabulated phase function is an attribute that can be called with angles.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from bakery.asset.family import Family
from bakery.asset.single import Asset, read_checked
from bakery.family.tree import is_family

if TYPE_CHECKING:
    import xarray

    from bakery.stages.members import Members

__all__ = ["Asset", "Family", "from_xarray", "open", "read_checked"]


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


def from_xarray(arrays: xarray.DataTree | xarray.Dataset, path: str | os.PathLike | None = None, *,
                overwrite: bool = False) -> Asset | Family | Members:
    """An asset, or one group, from xarray's labelled arrays as `to_xarray` returns them, also through a NetCDF file.

    Parameters
    ----------
    arrays : a tree of a whole asset or family, or the dataset of one group
    path : of a file to write the asset to; without one it is in memory only
    overwrite : also replace a file there that is no asset

    Returns
    -------
    asset : checked like by `bakery.open`; for a dataset its arrays, with units and errors

    Raises
    ------
    AssetError : the tree is no asset, or deviates from its stages' declarations
    UsageError : `path` cannot be written, or is given with the dataset of a single group

    Examples
    --------
    >>> bakery.from_xarray(xarray.open_datatree("fog.nc")).medium.g                                 # doctest: +SKIP
    """
    from bakery.asset import labelled
    from bakery.asset.single import checked
    from bakery.errors import UsageError
    from bakery.stages.members import Members

    if not hasattr(arrays, "children"):
        if path is not None:
            raise UsageError("from_xarray: found a path beside the dataset of one group; expected the tree of a whole asset")
        return Members(labelled.group_of(arrays), str(arrays.attrs.get(labelled.STORED, "")))
    root = checked("the tree", labelled.root_of(arrays))
    if path is not None:
        labelled.write_asset(root, path, overwrite)
        root = read_checked(path)
    return (Family if is_family(root) else Asset)(root, "" if path is None else os.fspath(path))
