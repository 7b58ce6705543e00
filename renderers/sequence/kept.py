"""Frames that are there: both pictures whole, and made of what the frame is made of."""

from __future__ import annotations

import json

from bakery.errors import UsageError
from renderers.mitsuba import bitmaps
from renderers.pictures.running import FRAME

FIGURES = "method", "samples", "noise", "denoised", "missed"


def row(frame) -> dict | None:
    """Of the report, by what the pictures of a frame say of themselves; None where they have to be rendered.

    frame : `renderers.sequence.prepared.Frame`
    """
    stories = [_story(path) for path in reversed(frame.pair)]
    if any(story is None or story.get("mark") != frame.scene.mark for story in stories):
        return None
    try:
        return of(frame, {name: stories[0][name] for name in FIGURES}, "kept", 0.0)
    except KeyError:
        return None


def of(frame, report, status: str, seconds: float) -> dict:
    """Of the report; report : of the renderer."""
    return {"frame": frame.number, "status": status, "files": [str(path) for path in frame.pair],
            **{name: report[name] for name in FIGURES}, "seconds": seconds}


def _story(path) -> dict | None:
    """What a picture says of the frame that it is; None where it is not there, not whole, or says nothing."""
    try:
        # Mitsuba puts quotes around texts of PNG files
        story = json.loads(bitmaps.read(path)[1][FRAME].strip('"')) if path.is_file() else None
    except (UsageError, KeyError, ValueError, TypeError, RecursionError):
        return None
    return story if isinstance(story, dict) else None
