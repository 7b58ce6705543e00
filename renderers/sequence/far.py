"""A frame on a worker of a cluster, which need not see the files of the scene: they come with the task, as bytes."""

from __future__ import annotations

import atexit
import dataclasses
import hashlib
import os
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from bakery.errors import BakeryError

_UNTIL_THE_END = ExitStack()  # folders of scenes
atexit.register(_UNTIL_THE_END.close)
_FOLDERS: dict[str, str] = {}  # hash of the files that frames share -> folder that holds them
_ONE_AT_A_TIME = threading.Lock()  # Mitsuba's variant is that of the process


class Task(NamedTuple):
    """A frame that is to be rendered.

    Attributes
    ----------
    number, path, settings : of the frame, of its scene where that was read, and what was set by hand
    options : as the renderer takes them
    handed : what `renderers.scene.Scene` has besides: assets, share, mark, choice
    versions : of libraries that decide the bytes, where the picture goes
    before : EXR of an unfinished render to go on with, or None
    """

    number: int
    path: str
    settings: dict[str, str]
    options: dict
    handed: dict
    versions: dict[str, str]
    before: bytes | None


class Answer(NamedTuple):
    """A frame that was rendered, or why it was not.

    Attributes
    ----------
    pictures : bytes (PNG, EXR)
    figures : of the renderer's report
    resumed : whether `before` was gone on with
    seconds : that it took
    fault, status : message and exit status where it could not be; "" and 0
    """

    pictures: tuple[bytes, bytes] | None
    figures: dict
    resumed: bool = False
    seconds: float = 0.0
    fault: str = ""
    status: int = 0


def bundles(frames) -> tuple[dict[str, bytes], list[dict[str, bytes]]]:
    """Absolute path -> content, of the files that all frames are made of, and of those of each frame besides."""
    needed = [dict.fromkeys(_absolute(file) for file in (*frame.scene.inputs, *frame.scene.assets)) for frame in frames]
    common = [file for file in needed[0] if all(file in files for files in needed)]
    content = {file: Path(file).read_bytes() for file in dict.fromkeys(file for files in needed for file in files)
               if Path(file).is_file()}
    return ({file: content[file] for file in common if file in content},
            [{file: content[file] for file in files if file in content and file not in common} for files in needed])


def rendered(common: Mapping[str, bytes], besides: Mapping[str, bytes], task: Task) -> Answer:
    """Renders a frame in a worker."""
    from renderers.sequence.prepared import versions

    if (theirs := versions()) != task.versions:
        unlike = ", ".join(f"{name} {theirs[name] or 'missing'} instead of {wanted or 'none'}"
                           for name, wanted in task.versions.items() if theirs[name] != wanted)
        return Answer(None, {}, fault=f"a worker has {unlike}; equal versions give equal pictures: install the same there",
                      status=2)
    with _ONE_AT_A_TIME, tempfile.TemporaryDirectory(prefix="bakery-frame-") as output:
        folder = _unpacked(common)
        _write(folder, besides)
        began = time.monotonic()
        try:
            report, resumed = _drawn(folder, task, Path(output, "frame.png"))
        except BakeryError as error:
            return Answer(None, {}, fault=str(error).replace(folder, ""), status=error.exit_status)
        pictures = tuple(Path(output, f"frame.{kind}").read_bytes() for kind in ("png", "exr"))
        return Answer(pictures, report, resumed, time.monotonic() - began)


def _drawn(folder, task, picture):
    from renderers import scene
    from renderers.sequence import kept
    from renderers.sequence.frame import drawn

    handed, files = task.handed, [Path(_below(folder, _absolute(path))) for path in task.handed["assets"]]
    shot = scene.load(_below(folder, _absolute(task.path)), task.settings, assets=False, frame=task.number)
    shot = dataclasses.replace(shot, assets=tuple(files), asset=files[0], share=handed["share"], mark=handed["mark"],
                               choice=handed["choice"])
    if task.before is not None:
        picture.with_suffix(".exr").write_bytes(task.before)
    report, resumed = drawn(shot, picture, task.options, task.before is not None)
    return {name: report[name] for name in kept.FIGURES}, resumed


def _unpacked(common: Mapping[str, bytes]) -> str:
    """The folder that holds the files that frames share, written once a process."""
    digest = hashlib.sha256()
    for path, content in common.items():
        digest.update(path.encode("utf-8", "surrogateescape") + b"\0" + hashlib.sha256(content).digest())
    if digest.hexdigest() not in _FOLDERS:
        folder = _UNTIL_THE_END.enter_context(tempfile.TemporaryDirectory(prefix="bakery-frames-"))
        _write(folder, common)
        _FOLDERS[digest.hexdigest()] = folder
    return _FOLDERS[digest.hexdigest()]


def _write(folder: str, files: Mapping[str, bytes]) -> None:
    for path, content in files.items():
        file = Path(_below(folder, path))
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)


def _absolute(path) -> str:
    return os.path.abspath(path)


def _below(folder: str, path: str) -> str:
    """An absolute path, below a folder."""
    return os.path.join(folder, os.path.relpath(path, os.path.splitdrive(path)[0] + os.sep))


