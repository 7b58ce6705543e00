"""What was measured of scenes, kept in the cache of bakes by the content that it was measured of."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any

import bakery
from bakery.run.cache import Cache
from bakery.store.tree import Group, read_text, text

_SOURCES = Path(__file__).parents[1], Path(bakery.__file__).parent / "physics"  # folders of what renders


def key_of(*content: Any) -> str:
    """The hash of texts, numbers, lists and dicts."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


@cache
def of_code() -> str:
    """The hash of the sources that render, whatever version they say they are: other code takes other times."""
    digest = hashlib.sha256(bakery.__version__.encode())
    for source in sorted(source for folder in _SOURCES for source in folder.rglob("*.py")):
        digest.update(hashlib.sha256(source.read_bytes()).digest())
    return digest.hexdigest()


def get(kind: str, key: str) -> Any:
    """What is kept; None where nothing is, or nothing that can be read."""
    entry = Cache().get(kind, key)
    try:
        return None if entry is None else json.loads(read_text(entry[0]["json"]))
    except (KeyError, TypeError, ValueError, AttributeError):
        return None


def put(kind: str, key: str, content: Any) -> None:
    """Keeps it, unless the cache cannot be written, of which nobody needs to be told: it is measured again."""
    group = Group({"json": text(json.dumps(content), "what was measured")}, {"input_hash": key})
    Cache().put(kind, key, group, Group())
