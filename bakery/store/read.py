"""An asset file as a tree: read once into memory from one descriptor, its digest checked before HDF5 sees a byte."""

import os
from typing import BinaryIO

from bakery.errors import AssetError, StoreError
from bakery.store.container import FOREIGN, FORMAT, LIMITS, VERSION, Limits, check_container
from bakery.store.decode import decode
from bakery.store.files import FILES, Files, NotRegular
from bakery.store.hashes import broken_hashes
from bakery.store.tree import Group, read_text
from bakery.system.memory import free_memory

__all__ = ["check_format", "decode", "parse", "read", "read_bytes", "read_text"]


def read(path: str | os.PathLike, *, limits: Limits = LIMITS, files: Files = FILES) -> Group:
    """The tree that an asset or a cache entry holds; arrays are read-only.

    Raises
    ------
    AssetError : no such file, foreign, damaged, of another format version, or beyond the limits
    StoreError : the system would not read it (permission, failing disk)
    """
    path = os.fspath(path)
    return parse(path, read_bytes(path, files), limits)


def parse(path: str, data: bytes | BinaryIO, limits: Limits = LIMITS) -> Group:
    """The tree in a file's bytes, or in an open file that nobody else writes to, every check done; AssetError names `path`."""
    check_container(path, data)
    root = decode(path, data, limits)
    check_format(path, root)
    broken = broken_hashes(root)
    if broken:
        raise AssetError(f"{path}: damaged: {broken[0]}; bake again with `bake RECIPE`")
    return root


def read_bytes(path: str, files: Files = FILES) -> bytes:
    """Every byte of a regular file, of one that is no asset the beginning; refuses anything else without waiting."""
    if "://" in path:
        raise AssetError(f"{path}: an asset is read from a file, not from a network address; download it first")
    try:
        return _slurped(path, files)
    except FileNotFoundError:
        raise AssetError(f"{path}: there is no such file; `bake RECIPE` writes one") from None
    except NotRegular:
        raise AssetError(f"{path}: a folder, pipe or device, not a bakery asset") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        raise StoreError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error


def _slurped(path: str, files: Files) -> bytes:
    """What `read_bytes` gives.  No file of some GB is read to find that it is no asset, nor one that memory does not hold."""
    fd = files.open(path)
    try:
        head = files.head(fd, FOREIGN)
        if not head.startswith(FORMAT.encode() + b" "):
            return head
        size, free = files.size(fd), free_memory()
        if free is not None and size > free:
            raise AssetError(f"{path}: holds {size / 1e9:.3g} GB, and {free / 1e9:.3g} GB of memory are free")
        return files.read(fd)
    finally:
        files.close(fd)


def check_format(path: str, root: Group) -> None:
    """AssetError unless the root names this format and version."""
    stored, version = root.attributes.get("format"), root.attributes.get("format_version")
    if stored != FORMAT:
        raise AssetError(f"{path}: damaged: the root's attribute `format` is {stored!r}, not {FORMAT!r}")
    if version != VERSION:
        raise AssetError(f"{path}: damaged: the root's attribute `format_version` is {version!r}, its first line says {VERSION}")
