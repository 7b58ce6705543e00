"""The files of a scene on a worker: sent as bytes, written once a process, and the scene that is read from them there."""

import atexit
import dataclasses
import hashlib
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from bakery.errors import BakeryError
from bakery.store import scratch
from renderers.pictures.versions import versions

_UNTIL_THE_END = ExitStack()  # folders of scenes
atexit.register(_UNTIL_THE_END.close)
_FOLDERS: dict[str, str] = {}  # hash of files -> folder that holds them
_ONE_AT_A_TIME = threading.Lock()  # Mitsuba's variant is that of the process


def needed(scene) -> list[str]:
    """Absolute paths of the files that a scene with its assets is made of."""
    return list(dict.fromkeys(_absolute(file) for file in (*scene.inputs, *scene.assets)))


def content(files) -> dict[str, bytes]:
    """Absolute path -> content of those that are there."""
    return {file: Path(file).read_bytes() for file in files if Path(file).is_file()}


def unpacked(files: Mapping[str, bytes]) -> str:
    """The folder that holds files, by their absolute paths below it; written once a process."""
    digest = hashlib.sha256()
    for path, data in files.items():
        digest.update(path.encode("utf-8", "surrogateescape") + b"\0" + hashlib.sha256(data).digest())
    if digest.hexdigest() not in _FOLDERS:
        folder = str(_UNTIL_THE_END.enter_context(scratch.folder("frames")))
        write(folder, files)
        _FOLDERS[digest.hexdigest()] = folder
    return _FOLDERS[digest.hexdigest()]


def write(folder: str, files: Mapping[str, bytes]) -> None:
    """Writes files below a folder, by their absolute paths."""
    for path, data in files.items():
        file = Path(_below(folder, path))
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)


class Sent(NamedTuple):
    """What workers have to know of a scene, besides its files.

    path, settings : of the scene where it was read, and what was set by hand
    assets, besides : their paths, and what else its file does not say: share of the tolerance, mark, choice of the method
    versions : of libraries that decide the bytes, where the pictures go
    """

    path: str
    settings: dict[str, str]
    assets: list[str]
    besides: dict
    versions: dict[str, str]

    @classmethod
    def of(cls, scene, settings: Mapping[str, str]) -> "Sent":
        """Of a `renderers.scene.Scene`."""
        besides = {"share": scene.share, "mark": scene.mark, "choice": scene.choice}
        return cls(str(scene.path), dict(settings), list(map(str, scene.assets)), besides, versions())

    def below(self, folder: str, frame: int | None = None):
        """The scene that stands below a folder; frame : number of a frame, None: the scene as it stands."""
        from renderers import scene

        assets = tuple(Path(_below(folder, _absolute(asset))) for asset in self.assets)
        shot = scene.load(_below(folder, _absolute(self.path)), self.settings, assets=False, frame=frame)
        return dataclasses.replace(shot, **self.besides, assets=assets, asset=assets[0])


@contextmanager
def on_worker(files: Mapping[str, bytes], wanted: Mapping[str, str], label: str = "") -> Iterator[str]:
    """The folder of `unpacked`, for one piece of work at a time; its faults travel, and name files as the process that asks does.

    wanted : versions of libraries there; label : what faults begin with

    Raises BakeryError where this process has other versions, whose pictures would be others.
    """
    with _ONE_AT_A_TIME:
        folder = unpacked(files)
        try:
            if differing := ", ".join(f"{name} {version or 'missing'} instead of {wanted[name] or 'none'}"
                                      for name, version in versions().items() if version != wanted[name]):
                raise BakeryError(f"a worker has {differing}; equal versions give equal pictures: install the same there")
            yield folder
        except BakeryError as error:
            raise BakeryError(label + str(error).replace(folder, "")).ending(error.exit_status) from None


def _absolute(path) -> str:
    return os.path.abspath(path)


def _below(folder: str, path: str) -> str:
    """An absolute path, below a folder."""
    return os.path.join(folder, os.path.relpath(path, os.path.splitdrive(path)[0] + os.sep))
