"""Scenes as commands take them: what a render would do, several methods side by side, error against time.

Rendering is the renderers'; plans, curves and pages are bakery's.  Here the two meet, and nothing is parsed or printed.
"""

import re

from bakery.errors import BakeryError


def is_scene(source) -> bool:
    """Whether a file says that it is a scene; what is wrong with it is found later."""
    from bakery.grammar import files, text

    read = text.Source("", "")
    try:
        read = files.source_of(source)
        root = text.parse(read).root
    except BakeryError:
        return re.search(r"^[\"']?bakery_scene[\"']?\s*:", read.text, re.MULTILINE) is not None
    return isinstance(root, text.Mapping) and "bakery_scene" in root
