"""Frames of a sequence on the workers of a cluster."""

import time
from collections.abc import Mapping
from typing import NamedTuple

from bakery.store import scratch
from renderers.cluster import files


class Task(NamedTuple):
    """A frame that is to be rendered.

    number, scene : of the frame, and its scene, `renderers.cluster.files.Sent`
    options : as the renderer takes them
    before : EXR of an unfinished render to go on with, or None
    """

    number: int
    scene: files.Sent
    options: dict
    before: bytes | None


class Answer(NamedTuple):
    """A frame that was rendered.

    pictures : bytes (PNG, EXR)
    figures : of the renderer's report
    resumed : whether `before` was gone on with
    seconds : that it took
    """

    pictures: tuple[bytes, bytes]
    figures: dict
    resumed: bool
    seconds: float


def bundles(frames) -> tuple[dict[str, bytes], list[dict[str, bytes]]]:
    """Absolute path -> content, of the files that all frames are made of, and of those of each frame besides."""
    needed = [files.needed(frame.scene) for frame in frames]
    common = [file for file in needed[0] if all(file in others for others in needed)]
    content = files.content(dict.fromkeys(file for of_frame in needed for file in of_frame))
    return ({file: content[file] for file in common if file in content},
            [{file: content[file] for file in of_frame if file in content and file not in common} for of_frame in needed])


def rendered(common: Mapping[str, bytes], besides: Mapping[str, bytes], task: Task) -> Answer:
    """Renders a frame in a worker; raises BakeryError as `renderers.cluster.files.on_worker`, with the number of the frame."""
    from renderers.sequence.frame import FIGURES, drawn

    with files.on_worker(common, task.scene.versions, f"frame {task.number}: ") as folder, scratch.folder("frame") as output:
        files.write(folder, besides)
        began, picture = time.monotonic(), output / "frame.png"
        shot = task.scene.below(folder, task.number)
        if task.before is not None:
            picture.with_suffix(".exr").write_bytes(task.before)
        report, resumed = drawn(shot, picture, task.options, task.before is not None)
        pictures = picture.read_bytes(), picture.with_suffix(".exr").read_bytes()
        return Answer(pictures, {name: report[name] for name in FIGURES}, resumed, time.monotonic() - began)
