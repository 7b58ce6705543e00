"""Where the files of a sequence go."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from bakery.store.outputs import FileKind, by_suffix, check_outputs
from renderers.pictures import images

_FILM = FileKind("film (MP4)", lambda head: head[4:8] == b"ftyp")


def pairs(output, numbers: Sequence[int], inputs: Iterable[Path], overwrite: bool) -> list[tuple[Path, Path]]:
    """Paths (PNG, EXR) of each frame, `X.0001.png` of `X.png`.

    Raises UsageError, as `images.output_pair`; of the film and the contact sheet too.
    """
    pair, inputs = images.output_pair(output, overwrite=True), list(inputs)
    frames = [tuple(path.with_name(f"{path.stem}.{number:04d}{path.suffix}") for path in pair) for number in numbers]
    others = list(beside(output).values()) if len(frames) > 1 else []
    check_outputs(by_suffix([path for pair in frames for path in pair] + others, {".mp4": _FILM}), inputs, overwrite)
    return frames


def beside(output) -> dict[str, Path]:
    """Paths of the film and of the contact sheet."""
    output = Path(output)
    return {"film": output.with_suffix(".mp4"), "sheet": output.with_name(f"{output.stem}.frames.png")}
