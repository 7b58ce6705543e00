"""One frame, by the renderer of its scene."""

from __future__ import annotations

from importlib import import_module

from bakery.errors import UsageError


def drawn(scene, path, options, resume, update=None) -> tuple[dict, bool]:
    """The renderer's report, and whether the EXR that stands was gone on with.

    Parameters
    ----------
    scene : `renderers.scene.Scene` of the frame
    path : of the picture
    options : as the renderer takes them
    resume : go on with the passes of the EXR, where it holds passes of this picture
    update : takes the fraction done and the noise, or None
    """
    draw = import_module(scene.renderer).render
    if resume:
        try:
            return draw(scene, path, **options, resume=True, progress=update), True
        except UsageError:
            pass  # a picture of something else, or of no passes: it is rendered anew, which says what else is wrong
    return draw(scene, path, **options, progress=update), False
