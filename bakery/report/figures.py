"""The pictures of an asset: those of each of its stages."""

from __future__ import annotations

from collections.abc import Iterator

from bakery.draw.picture import Picture
from bakery.stages.conform import stages_of
from bakery.store.tree import Group
from bakery.system.terminal import clean


def title_of(root: Group) -> str:
    """What stands above every picture of an asset: its name and the beginning of its content hash."""
    name, content = (str(root.attributes.get(key) or "") for key in ("name", "content_hash"))
    return "  ·  ".join(filter(None, (clean(name), content[:12])))


def pictures(root: Group) -> Iterator[Picture]:
    """Every picture that the content of an asset allows, those of what is rendered first."""
    for stage in sorted(stages_of(root), key=lambda stage: not stage.rendered):
        yield from stage.pictures(root)
