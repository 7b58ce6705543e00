"""A tree as the bytes of an HDF5 file, in memory or in a file: the same tree gives the same bytes.

The 1.10 file format has checksums on its metadata and fletcher32 covers chunks, while contiguous or scalar datasets and
variable-length strings have none: so every dataset is chunked and every string has a fixed length.
"""

import hashlib
import io
import os
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO

import numpy as np

from bakery.store.container import LIMITS, NAME, USER_BLOCK, user_block, user_block_of
from bakery.store.tree import Attribute, Dataset, Group

CHUNK = 1 << 20  # bytes; a whole number of rows up to this size goes into one chunk
_DEFLATE_LEVEL = 4
# Unpacking costs more time than reading: worth it from a third less on.  Measured on the first bytes of each dataset; on a
# MB of each that takes a fifth of the time of a bake of 500 wavelengths.
_PAYS, _SAMPLE = 0.67, 1 << 18
_KNOWN = 256  # samples whose answer is remembered: a stage goes into the cache, and then into its asset
_pays: dict[tuple[bytes, int], bool] = {}


def image(root: Group) -> bytes:
    """The bytes of the asset file, user block included, of a tree that `hashes.seal` has put in order.

    Raises ValueError : a name, type or attribute that the format does not allow (an error of the caller)
    """
    buffer = io.BytesIO()
    _pack(buffer, root)
    with buffer.getbuffer() as data:
        data[:USER_BLOCK] = user_block(data[USER_BLOCK:])
    return buffer.getvalue()  # no copy, as long as the buffer lives no longer


@contextmanager
def packed(root: Group, folder: str | os.PathLike) -> Iterator[BinaryIO]:
    """The bytes that `image` gives, in a file without a name in a folder: large tables are in memory once, not twice, and not at
    all once the caller has let go of the root.

    Raises
    ------
    ValueError : as `image`
    OSError : the system refused
    """
    with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
        target = _Unfailing(file)
        try:
            _pack(target, root)
        finally:
            if target.failure:
                raise target.failure
        del root  # of which the file is read back
        block = user_block_of(file)
        file.seek(0)
        file.write(block)
        yield file


class _Unfailing(io.RawIOBase):
    """A file that takes all that is written to it, and says afterwards what failed first: HDF5 ends the process where a write of
    an object in Python fails (h5py 3.16: a segmentation fault while it closes the file)."""

    def __init__(self, file: BinaryIO):
        self._file, self.failure = file, None

    def readable(self) -> bool:
        return True

    writable = seekable = readable

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def readinto(self, buffer) -> int:
        return self._file.readinto(buffer)

    def write(self, data) -> int:
        data = memoryview(data).cast("B")
        at = 0
        while at < len(data) and not self.failure:
            try:
                at += self._file.write(data[at:])
            except OSError as error:
                self.failure = error
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        try:
            return self._file.truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            return size or 0


def _pack(target: BinaryIO, root: Group) -> None:
    import h5py

    with h5py.File(target, "w", libver="v110", userblock_size=USER_BLOCK, track_order=True) as file:
        _fill(file, root, "", 1)


def _fill(target, group: Group, path: str, depth: int) -> None:
    if depth > LIMITS.depth:
        raise ValueError(f"{path}: deeper than {LIMITS.depth} groups")
    _set_attributes(target, group.attributes, path)
    for name, member in group.members.items():
        child = f"{path}{name}"
        if not NAME.fullmatch(name):
            raise ValueError(f"{child!r}: a name is a letter and up to 63 letters, digits, _ or -")
        if isinstance(member, Group):
            _fill(target.create_group(name, track_order=True), member, child + "/", depth + 1)
        else:
            _add_dataset(target, name, member, child)


def _add_dataset(target, name: str, dataset: Dataset, path: str) -> None:
    import h5py

    data = dataset.data
    dtype = data.dtype
    if dataset.choices:
        if dtype.kind not in "iu" or not all(NAME.fullmatch(choice) for choice in dataset.choices):
            raise ValueError(f"{path}: choices are names for the values of an integer array")
        dtype = h5py.enum_dtype({choice: i for i, choice in enumerate(dataset.choices)}, basetype=dtype)
    packing = {"shuffle": True, "compression": "gzip", "compression_opts": _DEFLATE_LEVEL} if _deflate_pays(data) else {}
    # An axis of length 0 must be declared extensible: HDF5 has no chunk that fits into it otherwise.
    maxshape = tuple(n or None for n in data.shape) if data.size == 0 else None
    created = target.create_dataset(name, shape=data.shape, dtype=dtype, chunks=chunk_shape(data.shape, data.itemsize),
                                    maxshape=maxshape, fletcher32=True, **packing)
    if data.size:
        created[...] = data
    _set_attributes(created, {"units": dataset.units, "description": dataset.description}, path)


def chunk_shape(shape: tuple[int, ...], itemsize: int) -> tuple[int, ...]:
    """The whole array up to `CHUNK` bytes; beyond that full rows of the last axes, cut along the first axis that needs it.

    Parts are alike: HDF5 stores the last one whole, and rows beyond the end would take room.
    """
    chunk = [max(n, 1) for n in shape]
    for axis in range(len(chunk)):
        row_bytes = itemsize * int(np.prod(chunk[axis + 1:], dtype=np.int64))
        parts = -(-chunk[axis] // max(1, CHUNK // row_bytes))
        chunk[axis] = -(-chunk[axis] // parts)
        if row_bytes <= CHUNK:
            break
    return tuple(chunk)


def _deflate_pays(data: np.ndarray) -> bool:
    sample = np.ascontiguousarray(data.reshape(-1)[:_SAMPLE // data.itemsize])
    if sample.nbytes < 512:
        return False
    sample = sample.view(np.uint8).reshape(-1, data.itemsize)
    key = hashlib.sha256(sample).digest(), data.itemsize  # 20 times as fast as packing
    if key not in _pays:
        shuffled = sample.T.tobytes()
        if len(_pays) >= _KNOWN:
            _pays.clear()
        _pays[key] = len(zlib.compress(shuffled, _DEFLATE_LEVEL)) < _PAYS * len(shuffled)
    return _pays[key]


def _set_attributes(target, attributes: dict[str, Attribute], path: str) -> None:
    import h5py

    for name, value in attributes.items():
        if not NAME.fullmatch(name):
            raise ValueError(f"{path}: attribute {name!r}: not a name")
        if isinstance(value, str):
            data = value.encode()
            if b"\0" in data or len(data) > LIMITS.attribute_bytes:
                raise ValueError(f"{path}: attribute {name!r}: text without NUL up to {LIMITS.attribute_bytes} bytes; "
                                 "longer text is a dataset")
            # HDF5 has no string of length 0; one NUL reads back as the empty string.
            target.attrs.create(name, data, dtype=h5py.string_dtype("utf-8", max(len(data), 1)))
        elif isinstance(value, bool | np.bool_):
            target.attrs.create(name, np.bool_(value))
        elif isinstance(value, int | np.integer):
            target.attrs.create(name, int(value), dtype="<i8")
        elif isinstance(value, float | np.floating):
            target.attrs.create(name, float(value), dtype="<f8")
        else:
            raise ValueError(f"{path}: attribute {name!r}: {type(value).__name__} is not stored; use text, int, float or bool")
