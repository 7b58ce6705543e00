"""The pictures of an asset, those of each of its stages, and drawings in a page."""

from collections.abc import Iterator
from html import escape

from bakery.draw.files import as_jpeg
from bakery.draw.picture import Picture, drawn
from bakery.family.pictures import pictures as family_pictures
from bakery.family.tree import is_family
from bakery.report.html import image
from bakery.stages.conform import stages_of
from bakery.store.tree import Group
from bakery.system.terminal import clean

HEAVY = 150_000  # bytes of a drawing from which on shades may be lossy: a page is to stay below 2 MB


def title_of(root: Group) -> str:
    """What stands above every picture of an asset: its name and the beginning of its content hash."""
    name, content = (str(root.attributes.get(key) or "") for key in ("name", "content_hash"))
    return "  ·  ".join(filter(None, (clean(name), content[:12])))


def pictures(root: Group) -> Iterator[Picture]:
    """Every picture that the content of an asset or a family allows, those of what is rendered first."""
    if is_family(root):
        yield from family_pictures(root)
    for stage in sorted(stages_of(root), key=lambda stage: not stage.rendered):
        yield from stage.pictures(root)


def drawing(picture: Picture, of: str = "") -> str:
    """A picture in a page, with its title and caption; `of` stands above it."""
    # as an image, not inline: ids of several drawings cannot meet, and an image runs no script; as whichever form is smaller
    forms = drawn(picture, of=of)
    data = min(forms.values(), key=len)
    if len(data) > HEAVY:
        data = min(data, as_jpeg(forms["png"]), key=len)
    return (f'<figure class="drawing"><div>{image(data, f"{picture.title}. {picture.caption}")}</div><figcaption>'
            f"<strong>{escape(picture.title)}.</strong> {escape(picture.caption)}</figcaption></figure>\n")
