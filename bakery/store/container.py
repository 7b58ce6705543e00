"""The container of asset format 1: its constants, its protected user block, its limits.

The first 512 bytes hold one line with the SHA-256 of everything after them, so any damage is found before the HDF5 library
parses a single byte.
"""

import hashlib
import io
import re
from dataclasses import dataclass
from typing import BinaryIO

from bakery.errors import AssetError

FORMAT = "bakery-asset"
VERSION = 1
USER_BLOCK = 512  # the smallest that HDF5 allows
FOREIGN = 1 << 16  # bytes of a file that say what it is, where it is no asset
PIECE = 1 << 20  # bytes of a file that are in memory at once

# Names of groups, datasets, attributes and enumerated values.  HDF5 itself would accept "..".
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}")

SIGNATURE = b"\x89HDF\r\n\x1a\n"
_LINE = re.compile(FORMAT.encode() + rb" (\d{1,9}) sha256:[0-9a-f]{64}\n+")


class Damaged(AssetError):
    """The bytes are not those that were written."""


@dataclass(frozen=True)
class Limits:
    """What a reader accepts; raise one by `read(path, limits=Limits(logical=...))`.

    `slack + ratio * file size` bounds the unpacked size of an asset: a 200 kB file may not unfold into 200 MB, while real tables,
    which deflate packs by a factor below 10, stay far from it.
    """

    objects: int = 100_000
    chunks: int = 100_000
    depth: int = 16
    attributes: int = 64  # of one object
    attribute_bytes: int = 60_000  # of one attribute; HDF5's object headers end at 64 KiB
    logical: int = 64 << 30  # bytes of all datasets
    ratio: int = 64
    slack: int = 64 << 20


LIMITS = Limits()


def user_block(body) -> bytes:
    """The 512 bytes that protect `body`, which is every byte after them."""
    return _block(hashlib.sha256(body).hexdigest())


def user_block_of(file: BinaryIO) -> bytes:
    """The same, of a file that begins with room for it."""
    return _block(_digest(file))


def _block(digest: str) -> bytes:
    return f"{FORMAT} {VERSION} sha256:{digest}".encode().ljust(USER_BLOCK, b"\n")


def opened(data: bytes | BinaryIO) -> BinaryIO:
    """Bytes, or the file that holds them, as a file; bytes are not copied."""
    return io.BytesIO(data) if isinstance(data, bytes) else data


def _digest(data: bytes | BinaryIO) -> str:
    """Of all bytes after the user block."""
    if isinstance(data, bytes):
        return hashlib.sha256(memoryview(data)[USER_BLOCK:]).hexdigest()
    digest = hashlib.sha256()
    data.seek(USER_BLOCK)
    while piece := data.read(PIECE):
        digest.update(piece)
    return digest.hexdigest()


def check_container(path: str, data: bytes | BinaryIO) -> None:
    """Raise unless a file's bytes are an undamaged container of this version; parses no HDF5.  data : also an open file

    Raises
    ------
    Damaged : the digest is another
    AssetError : foreign, or of another format version
    """
    file = opened(data)
    file.seek(0)
    head = file.read(FOREIGN)
    block = head[:USER_BLOCK]
    if not head:
        raise AssetError(f"{path}: the file is empty, not a bakery asset; bake it again with `bake RECIPE`")
    if not block.startswith(FORMAT.encode() + b" "):
        raise AssetError(f"{path}: not a bakery asset: {_what_it_is(head)}")
    line = _LINE.fullmatch(block)
    if line and int(line[1]) > VERSION:
        raise AssetError(f"{path}: written by a newer bakery (asset format {int(line[1])}; this one reads {VERSION}): "
                         "update bakery, or bake again with `bake RECIPE`")
    if line and int(line[1]) < VERSION:
        raise AssetError(f"{path}: asset format {int(line[1])} is no longer read: bake again with `bake RECIPE`")
    if block != _block(_digest(data)):
        raise Damaged(f"{path}: damaged: container: its bytes do not match the SHA-256 in its first line; "
                         "copy it again, or bake again with `bake RECIPE`")


def _what_it_is(data: bytes) -> str:
    """A guess at a foreign file from its first `FOREIGN` bytes, for the message only."""
    head = data[:4096]
    if head.startswith(SIGNATURE):
        netcdf = b"_NCProperties" in data[:FOREIGN]
        return "it is a netCDF file" if netcdf else "it is an HDF5 file without bakery's first line"
    if head.startswith((b"CDF\x01", b"CDF\x02", b"CDF\x05")):
        return "it is a netCDF file"
    if b"\0" not in head:
        try:
            head.decode()
        except UnicodeDecodeError as error:
            if error.start < len(head) - 4:  # not merely a character that the cut split
                return "its first line is missing"
        if re.search(rb"^[\"']?bakery_scene[\"']?\s*:", head, re.MULTILINE):
            return "it is a scene; use `bake render`, or the asset that it names"
        if re.search(rb"^[\"']?bakery[\"']?\s*:", head, re.MULTILINE):
            return "it is a recipe; `bake RECIPE` bakes it into an asset"
        return "it is a text file"
    return "its first line is missing"
