"""A film of frames, by `ffmpeg` where that is on the path."""

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from bakery.errors import BakeryError
from bakery.store import scratch
from bakery.store.put import put

# H.264 has half as many colours as pixels along each edge: to an odd edge a black row or column is added.  The matrix of BT.709
# is told and used: left to themselves ffmpeg takes that of BT.601, and players the other
_CODED = ["-vf", "scale=out_color_matrix=bt709:out_range=tv,pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", "libx264", "-pix_fmt",
          "yuv420p", "-crf", "16", "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1",
          "-color_range", "tv", "-movflags", "+faststart"]
_ABSENT = "no film: ffmpeg is not on the path; install it (apt install ffmpeg, brew install ffmpeg), and the same call makes one"


def program() -> str | None:
    """Path of ffmpeg."""
    return shutil.which("ffmpeg")


def write(path: Path, pictures: Sequence[Path], rate: float) -> tuple[str | None, list[str]]:
    """Makes an MP4 film (H.264, yuv420p) of PNG pictures; its path, or None and a sentence that says why there is none."""
    coder = program()
    if coder is None:
        return None, [_ABSENT]
    call = [coder, "-hide_banner", "-loglevel", "error", "-nostdin", "-y", "-f", "image2pipe", "-c:v", "png", "-framerate",
            f"{rate:.15g}", "-i", "pipe:0", *_CODED, "-fflags", "+bitexact", "-flags:v", "+bitexact"]
    with scratch.folder("frames") as folder:
        coded = folder / path.name
        try:
            _code([*call, str(coded)], pictures)
            put(path, coded.read_bytes())
        except (BakeryError, OSError, RuntimeError) as error:
            return None, [f"no film: {path}: cannot be written: {error}"]
    return str(path), []


def _code(call: Sequence[str], pictures: Sequence[Path]) -> None:
    """Hands pictures to ffmpeg one after the other: their numbers may have gaps.  Raises RuntimeError with what it says."""
    with subprocess.Popen(call, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        try:
            for picture in pictures:
                process.stdin.write(picture.read_bytes())
        except BrokenPipeError:
            pass  # it has ended, and says why
        _, message = process.communicate()
    if process.returncode:
        lines = message.decode(errors="replace").strip().splitlines() or ["no reason given"]
        raise RuntimeError(f"ffmpeg ended with status {process.returncode}: {lines[-1]}")
