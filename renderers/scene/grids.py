"""Grids of densities in files: HDF5, NPY, and the VOL format of Mitsuba."""

import math
import os
import struct
from pathlib import Path

import numpy as np

from bakery.errors import UsageError
from bakery.grammar import grids
from bakery.grammar.units import Wrong
from bakery.system.memory import free_memory

MOST = 1 << 30  # values: 1024^3
_HEAD = struct.Struct("<3sB5i6f")  # VOL: magic, version, encoding, X, Y, Z, channels, box


def read(path, dataset=None):
    """The densities of a file.

    Parameters
    ----------
    path : .h5 or .hdf5, .npy, .vol
    dataset : name in an HDF5 file

    Returns
    -------
    values : (X, Y, Z) float32 or float64, finite and 0 or more; HDF5 and NPY hold them in this order of axes, VOL with x fastest
    lo, hi : (3,) corners of the box that a VOL file gives, else None

    Raises
    ------
    UsageError : not such a file, another shape, too many, something that is no density; the text says which
    """
    path = Path(path)
    readers = {".h5": _hdf5, ".hdf5": _hdf5, ".npy": _npy, ".vol": _vol}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise UsageError(f"{path}: found the ending {path.suffix or 'of no kind'}; expected {', '.join(readers)}")
    try:
        values, *box = reader(path, dataset)
    except Wrong as wrong:
        raise UsageError(f"{path}: {wrong.found}; {wrong.expected}") from None
    except MemoryError:
        raise UsageError(f"{path}: does not fit into memory; use a coarser grid") from None
    except (OSError, ValueError, KeyError, RuntimeError, EOFError, TypeError) as error:
        raise UsageError(f"{path}: cannot be read ({error})") from None
    _check_values(path, values)
    return values, *(box or (None, None))


def placed(scene, key, where, name="grid"):
    """The densities of a scene's grid, `where` of `renderers.scene.common.Grid` at a dotted key, and its box.

    name : of the key of the file

    Returns values (X, Y, Z), lo, hi (3,) m.  Raises UsageError with the key where it cannot be read, or has no box.
    """
    path = scene.file(getattr(where, name))
    if where.dataset and path.suffix.lower() not in (".h5", ".hdf5"):
        raise scene.wrong(f"{key}.dataset", "found a dataset of a file that has none; .h5 and .hdf5 files do")
    try:
        values, lo, hi = read(path, where.dataset)
    except UsageError as fault:
        raise scene.wrong(f"{key}.{name}", fault) from None
    lo, hi = (np.array(requested if requested is not None else stored, float)
              for requested, stored in ((where.lo, lo), (where.hi, hi)))
    if lo.shape != (3,) or hi.shape != (3,):
        raise scene.wrong(f"{key}.{name}", "found no box in the file; expected lo and hi")
    if not np.all(lo < hi):
        raise scene.wrong(f"{key}.{name}", "found a box without volume; expected hi above lo in x, y and z")
    return values, lo, hi


def relative(scene, key, where, kind=None):
    """As `placed`, values, as numbers of a kind, over the largest of them; UsageError where all are 0."""
    values, lo, hi = placed(scene, key, where)
    most = float(np.max(values))
    if not most > 0:
        raise scene.wrong(f"{key}.grid", "found densities that are 0 everywhere; expected a cloud")
    return np.asarray(values, kind) / most, lo, hi


def _hdf5(path, dataset):
    import h5py

    if not dataset:
        raise UsageError(f"{path}: the name of a dataset is missing")
    with h5py.File(path, "r") as file:
        stored = grids.dataset(file, dataset, MOST)
        _check_shape(path, stored.shape, stored.dtype)
        return (_floats(stored[()]),)


def _npy(path, _dataset):
    values = np.load(path, mmap_mode="r", allow_pickle=False)
    _check_shape(path, values.shape, values.dtype)
    return (_floats(values),)


def _vol(path, _dataset):
    with open(path, "rb") as file:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size or head[:3] != b"VOL":
            raise UsageError(f"{path}: found no VOL file; expected one that Mitsuba reads")
        _, version, encoding, x, y, z, channels, *box = _HEAD.unpack(head)
        if (version, encoding, channels) != (3, 1, 1):
            raise UsageError(f"{path}: found version {version}, encoding {encoding}, {channels} channels; "
                             "expected version 3, encoding 1 (float32) and one channel")
        _check_shape(path, (x, y, z), np.dtype(np.float32))
        size = os.fstat(file.fileno()).st_size - _HEAD.size
        if size != 4 * x * y * z:
            raise UsageError(f"{path}: found {size:,} bytes for {x} x {y} x {z} values; expected {4 * x * y * z:,}")
        values = np.fromfile(file, "<f4")
    lo, hi = box[:3], box[3:]
    if not (np.isfinite(box).all() and all(low < high for low, high in zip(lo, hi))):
        raise UsageError(f"{path}: found a box from {lo} to {hi}; expected finite corners, the second above the first")
    return np.ascontiguousarray(values.reshape(z, y, x).T, np.float32), tuple(lo), tuple(hi)


def _floats(values):
    return np.array(values, np.float64 if values.dtype.itemsize > 4 and values.dtype.kind == "f" else np.float32)


def _check_shape(path, shape, dtype):
    grids.check_shape(shape, dtype, MOST)
    needed, free = 2 * dtype.itemsize * math.prod(shape), free_memory()  # as they are read, and as `read` gives them
    if free is not None and needed > free:
        raise UsageError(f"{path}: found {' x '.join(map(str, shape))} values, which take {needed / 1e9:.3g} GB of memory; "
                         f"{free / 1e9:.3g} GB are free")


def _check_values(path, values):
    for plane in range(len(values)):  # a plane at a time: no copies of large grids
        part = values[plane]
        wrong = ~(np.isfinite(part) & (part >= 0))
        if wrong.any():
            y, z = np.argwhere(wrong)[0]
            raise UsageError(f"{path}: found the density {part[y, z]:g} at [{plane}, {y}, {z}]; expected numbers of 0 or more")
