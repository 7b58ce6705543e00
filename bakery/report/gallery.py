"""One HTML page of pictures with their names and what they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from bakery.report.html import document, image, paragraph, section


@dataclass(frozen=True)
class Entry:
    """One picture.

    Attributes
    ----------
    name : what stands below it
    text : a sentence, or ""
    place : path of the file that it was made of
    command : what makes it
    picture : PNG or JPEG; b"" where there is none yet
    """

    name: str
    text: str
    place: str
    command: str
    picture: bytes


def page(title: str, lead: str, sections: Mapping[str, Sequence[Entry]]) -> str:
    """The whole page, UTF-8; sections by their headings, those without entries are left out."""
    parts = [f"<h1>{escape(title)}</h1>\n", paragraph(lead, "lead")]
    for heading, entries in sections.items():
        figures = "".join(map(_figure, entries))
        parts += section(heading, [f'<div class="grid">\n{figures}</div>\n'] if figures else [])
    return document(title, parts, broad=True)


def _figure(entry: Entry) -> str:
    shown = image(entry.picture, entry.name) if entry.picture else (
        f'<div class="empty">No picture yet: <code>{escape(entry.command)}</code> renders one.</div>')
    text = f"{escape(entry.text)}<br>\n" if entry.text else ""
    return (f"<figure>{shown}<figcaption><strong>{escape(entry.name)}</strong> {text}<code>{escape(entry.place)}</code>"
            "</figcaption></figure>\n")
