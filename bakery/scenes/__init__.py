"""Scenes as commands take them: what a render would do, several methods side by side, error against time.

Rendering is the renderers'; plans, curves and pages are bakery's.  Here the two meet, and nothing is parsed or printed.
"""

from __future__ import annotations

import re

from bakery.errors import BakeryError


def is_scene(source) -> bool:
    """Whether a file says that it is a scene; what is wrong with it is found later."""
    from bakery.grammar import files, text

    content = ""
    try:
        content = text.decode(files.read_recipe(source), source)
        root = text.parse(text.Source(source, content)).root
    except BakeryError:
        return re.search(r"^[\"']?bakery_scene[\"']?\s*:", content, re.MULTILINE) is not None
    return isinstance(root, text.Mapping) and "bakery_scene" in root
