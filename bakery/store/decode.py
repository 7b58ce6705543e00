"""The bytes of an HDF5 file as a tree, trusting nothing.

The tree is walked by its links; an object is opened only when its link is a plain one, and its values are read only when its
type, layout and size are allowed.  Chunks are unpacked here, not by the HDF5 library: the room that one may take is known before.
"""

import io
import math
import zlib
from collections.abc import Callable
from typing import BinaryIO

import numpy as np

from bakery.errors import AssetError
from bakery.store.container import LIMITS, NAME, SIGNATURE, USER_BLOCK, Limits, opened
from bakery.store.tree import Attribute, Dataset, Group

_SHUFFLE, _DEFLATE, _FLETCHER32 = 2, 1, 3  # HDF5's numbers
_ATTRIBUTES = ("<i8", "<f8", "|b1")  # and fixed-length strings


def decode(path: str, data: bytes | BinaryIO, limits: Limits = LIMITS,
           on_fault: Callable[[str, str], None] | None = None) -> Group:
    """The tree inside an asset's bytes, or an open file of them, whose container has been checked.

    `on_fault(place, sentence)` is called for each broken member, which is then left out; without it the first one raises
    AssetError.
    """
    import h5py

    def refuse(place: str, sentence: str) -> None:
        raise AssetError(f"{path}: damaged: {place}: {sentence}")

    content = opened(data)
    size = content.seek(0, io.SEEK_END)
    content.seek(USER_BLOCK)
    if content.read(len(SIGNATURE)) != SIGNATURE:
        raise AssetError(f"{path}: damaged: container: no HDF5 begins after the first {USER_BLOCK} bytes")
    try:
        # an object, not a name: no network driver and no other file is within the library's reach
        with h5py.File(content, "r") as file:
            return _Walk(size, limits, on_fault or refuse).root(file)
    except AssetError:
        raise
    except _TooMuch as excess:
        raise AssetError(f"{path}: damaged: container: it holds more than {excess}") from None
    except MemoryError:
        raise AssetError(f"{path}: needs more memory than is available") from None
    except Exception as error:  # h5py turns the library's complaints into many kinds of exception
        raise AssetError(f"{path}: damaged: container: the HDF5 library cannot read it ({_first_line(error)})") from None


class _Fault(Exception):
    """A rule that a member breaks, as one sentence."""


class _TooMuch(Exception):
    """A count beyond the limits: the walk ends here, whatever else there is."""


class _Walk:
    """One pass over a file: counts what it meets, so that no file costs more than its limits."""

    def __init__(self, size: int, limits: Limits, on_fault: Callable[[str, str], None]):
        self.limits, self.on_fault = limits, on_fault
        self.size = size
        self.room = min(limits.logical, limits.slack + limits.ratio * size)
        self.objects = self.chunks = 0
        self.seen: set[int] = set()

    def root(self, file) -> Group:
        import h5py

        try:
            self._once(h5py.h5g.open(file.id, b"/"))
            return Group(*self._contents(file, "", 1))
        except _Fault as fault:
            self.on_fault("root", str(fault))
            return Group()

    def _contents(self, group, path: str, depth: int) -> tuple[dict, dict]:
        import h5py

        attributes = self._attributes(group.id)
        count = group.id.get_num_objs()
        if self.objects + count > self.limits.objects:
            raise _TooMuch(f"{self.limits.objects} objects")
        members = {}
        for name in group:
            if isinstance(name, bytes):  # bytes that are no text: a name that NAME refuses
                name = name.decode("utf-8", "replace")
            child = path + (name if NAME.fullmatch(name) else ascii(name))
            try:
                if not NAME.fullmatch(name):
                    raise _Fault("a name is a letter and up to 63 letters, digits, _ or -")
                if group.id.links.get_info(name.encode()).type != h5py.h5l.TYPE_HARD:
                    raise _Fault("a soft or external link; assets hold hard links only")
                members[name] = self._member(group, name, child, depth)
            except _Fault as fault:
                self.on_fault(child, str(fault))
            except _LIBRARY as error:
                self.on_fault(child, f"the HDF5 library cannot read it ({_first_line(error)})")
        return members, attributes

    def _member(self, group, name: str, path: str, depth: int) -> Dataset | Group:
        import h5py

        handle = h5py.h5o.open(group.id, name.encode())
        self._once(handle)
        if isinstance(handle, h5py.h5g.GroupID):
            if depth >= self.limits.depth:
                raise _Fault(f"deeper than {self.limits.depth} groups")
            return Group(*self._contents(h5py.Group(handle), path + "/", depth + 1))
        if isinstance(handle, h5py.h5d.DatasetID):
            return self._dataset(h5py.Dataset(handle))
        raise _Fault("neither a group nor a dataset")

    def _once(self, handle) -> None:
        import h5py

        info = h5py.h5o.get_info(handle)
        self.objects += 1
        if info.rc != 1 or info.addr in self.seen:
            raise _Fault("linked more than once")
        self.seen.add(info.addr)

    def _attributes(self, handle) -> dict[str, Attribute]:
        import h5py

        count = h5py.h5a.get_num_attrs(handle)
        if count > self.limits.attributes:
            raise _Fault(f"{count} attributes; at most {self.limits.attributes} are read")
        attributes = {}
        for i in range(count):
            attribute = h5py.h5a.open(handle, index=i)
            name = attribute.name.decode("utf-8", "replace")
            if not NAME.fullmatch(name):
                raise _Fault(f"attribute {name!a}: not a name")
            attributes[name] = self._attribute(attribute, name)
        return attributes

    def _attribute(self, attribute, name: str) -> Attribute:
        stored = attribute.get_type()
        dtype = _plain_type(stored, f"attribute {name!r}: ")
        supported = dtype.str in _ATTRIBUTES or (dtype.kind == "S" and dtype.itemsize <= self.limits.attribute_bytes)
        if not supported or attribute.shape not in ((), (1,)) or attribute.get_space().get_simple_extent_npoints() != 1:
            raise _Fault(f"attribute {name!r}: not one fixed-length text, int, float or bool")
        value = np.zeros(attribute.shape, dtype)
        attribute.read(value, mtype=stored)
        value = value.reshape(-1)[0]
        if dtype.kind != "S":
            return value.item()
        try:
            return bytes(value).decode()
        except UnicodeDecodeError:
            raise _Fault(f"attribute {name!r}: not UTF-8 text") from None

    def _dataset(self, dataset) -> Dataset:
        import h5py

        dtype = _plain_type(dataset.id.get_type())
        shape = dataset.shape
        if shape is None or shape == ():
            raise _Fault("no shape; the smallest dataset has shape (1,)")
        chunk, packing = _layout(dataset.id.get_create_plist())
        chunks = math.prod(-(-n // c) for n, c in zip(shape, chunk, strict=True))
        logical = chunks * math.prod(chunk) * dtype.itemsize
        if logical > self.room:
            raise _Fault(f"unpacks to {logical} bytes, too much for a file of {self.size}")
        self.room -= logical
        self.chunks += chunks
        if self.chunks > self.limits.chunks:
            raise _TooMuch(f"{self.limits.chunks} chunks")
        if chunks != dataset.id.get_num_chunks():
            raise _Fault("some of its chunks are missing")
        choices = h5py.check_enum_dtype(dtype) or {}
        if sorted(choices.values()) != list(range(len(choices))) or not all(NAME.fullmatch(choice) for choice in choices):
            raise _Fault("an enumeration whose values are not named from 0 on")
        attributes = self._attributes(dataset.id)
        for name, value in attributes.items():
            if name not in ("units", "description") or not isinstance(value, str):
                raise _Fault(f"attribute {name!r}: datasets have the texts `units` and `description`, nothing else")
        data = _unpack(dataset.id, shape, chunk, np.dtype(dtype.str), packing)
        return Dataset(data, attributes.get("units", ""), attributes.get("description", ""),
                       tuple(sorted(choices, key=choices.__getitem__)))


# What h5py raises when the library fails; KeyError and RuntimeError among them.  MemoryError is left to the caller.
_LIBRARY = (OSError, KeyError, RuntimeError, ValueError, TypeError)


def _first_line(error: Exception) -> str:
    text = str(error).strip("'\"")
    return text.splitlines()[0] if text else type(error).__name__


def _plain_type(stored, label: str = "") -> np.dtype:
    """The NumPy type of an HDF5 type that is allowed, looked at before any value is read."""
    import h5py

    if stored.get_class() not in (h5py.h5t.INTEGER, h5py.h5t.FLOAT, h5py.h5t.STRING, h5py.h5t.ENUM, h5py.h5t.COMPOUND,
                                  getattr(h5py.h5t, "COMPLEX", None)):
        raise _Fault(f"{label}a type that assets do not hold")
    if stored.get_class() == h5py.h5t.STRING:
        if stored.is_variable_str():
            raise _Fault(f"{label}a variable-length string")
        return np.dtype(f"S{stored.get_size()}")
    try:
        dtype = stored.dtype
    except TypeError:
        raise _Fault(f"{label}a type that assets do not hold") from None
    # equal: an integer of 17 bits, say, has the NumPy type of 32 but other values
    if dtype.kind not in "fiubc" or dtype.itemsize > (16 if dtype.kind == "c" else 8) \
            or not h5py.h5t.py_create(dtype, logical=True).equal(stored):
        raise _Fault(f"{label}a type that assets do not hold")
    return dtype


def _layout(plist) -> tuple[tuple[int, ...], list[int]]:
    """Chunk shape and filters of a dataset, if it lies in chunks of this file and is packed as the format allows."""
    import h5py

    if plist.get_layout() != h5py.h5d.CHUNKED or plist.get_external_count():
        raise _Fault("not stored in chunks of this file")
    filters = [plist.get_filter(i)[0] for i in range(plist.get_nfilters())]
    if filters != [code for code in (_SHUFFLE, _DEFLATE, _FLETCHER32) if code in filters] or _FLETCHER32 not in filters:
        raise _Fault("its filters are not shuffle, deflate, fletcher32 in this order, the last one always")
    return plist.get_chunk(), filters


def _unpack(handle, shape: tuple[int, ...], chunk: tuple[int, ...], dtype: np.dtype, packing: list[int]) -> np.ndarray:
    """The whole dataset from its chunks."""
    places = []
    if math.prod(shape):
        handle.chunk_iter(places.append)
    if len(places) == 1 and all(n == c for n, c in zip(shape, chunk, strict=True)):
        data = _unpack_chunk(handle, places[0].chunk_offset, chunk, dtype, packing)
    else:
        data = np.empty(shape, dtype)
        for offset in places:
            target = tuple(slice(o, min(o + c, n)) for o, c, n in zip(offset.chunk_offset, chunk, shape, strict=True))
            block = _unpack_chunk(handle, offset.chunk_offset, chunk, dtype, packing)
            data[target] = block[tuple(slice(0, s.stop - s.start) for s in target)]
    data.flags.writeable = False
    return data


def _unpack_chunk(handle, offset: tuple[int, ...], chunk: tuple[int, ...], dtype: np.dtype, packing: list[int]) -> np.ndarray:
    """One chunk.  Fletcher32 is not computed again: the container's SHA-256 has covered these bytes."""
    skipped, raw = handle.read_direct_chunk(offset)
    filters = [number for i, number in enumerate(packing) if not skipped >> i & 1]
    size = math.prod(chunk) * dtype.itemsize
    if _FLETCHER32 in filters:
        raw = memoryview(raw)[:-4]
    if _DEFLATE in filters:
        unpacker = zlib.decompressobj()
        try:
            raw = unpacker.decompress(raw, size + 1)
        except zlib.error as error:
            raise _Fault(f"a chunk cannot be unpacked ({error})") from None
    if len(raw) != size:
        raise _Fault(f"a chunk of {len(raw)} bytes where {size} belong")
    if _SHUFFLE in filters:
        raw = np.ascontiguousarray(np.frombuffer(raw, np.uint8).reshape(dtype.itemsize, -1).T)
    return np.frombuffer(raw, dtype).reshape(chunk)
