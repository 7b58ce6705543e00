"""Densities on a regular grid, from the bytes of an HDF5 or NPY file that a recipe names."""

import io
import math

import numpy as np

from bakery.grammar.text import show
from bakery.grammar.units import Wrong

KINDS = ("h5", "hdf5", "npy")
BYTES = 512 << 20  # of a file
MOST = 1 << 27  # values: 512^3
_FILTERS = {"gzip", "lzf", None}


def read(data: bytes, kind: str, dataset: str | None = None) -> np.ndarray:
    """Relative densities (X, Y, Z) float32, the largest 1.

    data : content of the file
    kind : one of `KINDS`
    dataset : its name in an HDF5 file

    Raises Wrong : what was found, and what would do
    """
    try:
        values = _npy(data) if kind == "npy" else _hdf5(data, dataset)
    except (OSError, ValueError, KeyError, RuntimeError, EOFError, TypeError) as error:
        raise Wrong(f"found a file that cannot be read ({str(error).splitlines()[0]})",
                    f"expected a {kind} file of numbers") from None
    wrong = ~np.isfinite(values) | (values < 0)
    if wrong.any():
        at = np.argwhere(wrong)[0]
        raise Wrong(f"found the density {values[tuple(at)]:g} at [{', '.join(map(str, at))}]", "expected numbers of 0 or more")
    if not values.max() > 0:
        raise Wrong("found a density that is zero everywhere", "expected a positive density")
    return (values / values.max()).astype(np.float32)


def _npy(data: bytes) -> np.ndarray:
    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    head = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = head(file)
    check_shape(shape, dtype, MOST)
    return np.load(io.BytesIO(data), allow_pickle=False).astype(np.float64)


def _hdf5(data: bytes, name: str | None) -> np.ndarray:
    import h5py

    if not name:
        raise Wrong("found no dataset", "expected dataset: NAME beside an HDF5 file")
    with h5py.File(io.BytesIO(data), "r") as file:
        return dataset(file, name, MOST)[()].astype(np.float64)


def dataset(file, name: str, most: int):
    """A dataset of an open HDF5 file that holds at most so many densities, in the file itself; `Wrong` where there is none."""
    import h5py

    where = file
    for step in (step for step in name.split("/") if step):
        link = where.get(step, getlink=True) if isinstance(where, h5py.Group) and step in where else None
        if link is None:
            raise Wrong(f"found no dataset {show(name)}", f"expected one that the file holds ({_datasets(file)})")
        if not isinstance(link, h5py.HardLink):
            raise Wrong(f"found {show(name)}, a link to another place", "expected a dataset in the file itself")
        where = where[step]
    if not isinstance(where, h5py.Dataset):
        raise Wrong(f"found {show(name)}, a group", f"expected the name of a dataset ({_datasets(file)})")
    check_shape(where.shape or (), where.dtype, most)
    check_stored(file, where, name, "dataset")
    return where


def check_stored(file, array, name: str, noun: str) -> None:
    """`Wrong` unless a dataset of an open HDF5 file lies in that file, as long as it says; `noun` says what it is."""
    if array.is_virtual or array.external or array.compression not in _FILTERS:
        raise Wrong(f"found {show(name)}, which is not stored in the file itself in a layout that is known here",
                    f"expected a {noun} without filters, or with gzip or lzf")
    # what a bomb of zeros unpacks to, or values never written, which HDF5 makes up; 1100 is the most that deflate can save
    stored = min(array.id.get_storage_size(), file.id.get_filesize())
    if array.size * array.dtype.itemsize > 1100 * stored + (1 << 20):
        raise Wrong(f"found {show(name)} of {array.size:,} values, most of which the file does not hold",
                    f"expected a {noun} that was written whole")


def _datasets(file) -> str:
    import h5py

    names = []
    file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    return ", ".join(names[:20]) + (", ..." if len(names) > 20 else "") if names else "it holds none"


def check_shape(shape, dtype, most: int) -> None:
    """`Wrong` unless an array of this shape and type may hold densities on a grid, of at most so many values."""
    shown = " x ".join(map(str, shape)) or "one number"
    if dtype.kind not in "fiu":
        raise Wrong(f"found values of type {dtype}", "expected real numbers")
    if len(shape) != 3 or min(shape) < 1:
        raise Wrong(f"found {shown}{' values' * bool(shape)}", "expected three axes (x, y, z) with an entry or more")
    if math.prod(shape) > most:
        raise Wrong(f"found {shown} values", f"expected at most {most:,}")
