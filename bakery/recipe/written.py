"""Recipes that are no files: a text, or a dict of the same keys."""

import json
import os
from collections.abc import Mapping

from bakery.errors import UsageError
from bakery.grammar.files import MAX_BYTES, Written


def as_path(recipe: str | os.PathLike | Mapping) -> str | os.PathLike:
    """What `bakery.bake` takes as a recipe, as a path; UsageError where it is nothing of that kind."""
    if isinstance(recipe, Mapping):
        try:
            # JSON is YAML; a key a line, so that messages name lines
            return _kept(json.dumps(dict(recipe), indent=1, ensure_ascii=False, allow_nan=False, default=_plain))
        except (TypeError, ValueError) as error:
            raise UsageError(f"recipe: expected a dict of texts, numbers, lists and dicts ({error})") from None
    if isinstance(recipe, str) and "\n" in recipe:
        return _kept(recipe)
    if not isinstance(recipe, (str, os.PathLike)):
        raise UsageError(f"recipe: found {type(recipe).__name__}; expected a path, the text of a recipe or a dict")
    return recipe


def _kept(text: str) -> Written:
    return Written.of("<recipe>", text.encode("utf-8", "surrogateescape")[:MAX_BYTES + 1])


def _plain(value):
    """A value that JSON does not know: NumPy's, or a path."""
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"found {type(value).__name__}")
