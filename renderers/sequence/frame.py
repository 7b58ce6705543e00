"""One frame: rendered by the renderer of its scene, or there, both pictures whole and made of what the frame is made of."""

import json

from bakery.errors import UsageError
from renderers.mitsuba import bitmaps
from renderers.pictures.running import FRAME

FIGURES = "method", "samples", "noise", "denoised", "missed"


def drawn(scene, path, options, resume, update=None) -> tuple[dict, bool]:
    """The renderer's report, and whether the EXR that stands was gone on with.

    scene : `renderers.scene.Scene` of the frame
    path : of the picture
    options : as the renderer takes them
    resume : go on with the passes of the EXR, where it holds passes of this picture
    update : takes the fraction done and the noise, or None
    """
    draw = scene.drawn_by.render
    if resume:
        try:
            return draw(scene, path, **options, resume=True, progress=update), True
        except UsageError:
            pass  # a picture of something else, or of no passes: it is rendered anew, which says what else is wrong
    return draw(scene, path, **options, progress=update), False


def kept(frame) -> dict | None:
    """Of the report, by what the pictures of a frame say of themselves; None where they have to be rendered.

    frame : `renderers.sequence.prepared.Frame`
    """
    stories = [_story(path) for path in reversed(frame.pair)]
    if any(story is None or story.get("mark") != frame.scene.mark for story in stories):
        return None
    try:
        return row_of(frame, {name: stories[0][name] for name in FIGURES}, "kept", 0.0)
    except KeyError:
        return None


def row_of(frame, report, status: str, seconds: float) -> dict:
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
