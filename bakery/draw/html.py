"""Tables and pictures as notebooks show them: HTML with the notebook's own look; every text is escaped."""

import base64
from collections.abc import Iterable, Sequence
from html import escape


def table(header: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1, title: str = "") -> str:
    """A table of texts under a title; the first `words` columns are set left, the others, numbers, right."""
    def cells(tag: str, row: Sequence[str]) -> str:
        sides = ("left" if i < words else "right" for i in range(len(row)))
        return "<tr>" + "".join(f'<{tag} style="text-align:{side}">{escape(cell)}</{tag}>'
                                for side, cell in zip(sides, row, strict=True)) + "</tr>"

    head = f"<p><strong>{escape(title)}</strong></p>\n" if title else ""
    return f"{head}<table>\n" + "\n".join([cells("th", header), *(cells("td", row) for row in rows)]) + "\n</table>\n"


def figure(png: bytes, words: str, width: float) -> str:
    """A PNG inside of the page, `width` CSS pixels wide where there is room; `words` stand below it."""
    data = base64.b64encode(png).decode()
    return (f'<figure style="margin:0"><img alt="{escape(words)}" src="data:image/png;base64,{data}" '
            f'style="width:{width:.0f}px;max-width:100%"><figcaption>{escape(words)}</figcaption></figure>\n')


def first_picture(pictures: Iterable) -> str:
    """The first of some `bakery.draw.picture.Picture`s, drawn; nothing where there is none."""
    return next((picture._repr_html_() for picture in pictures), "")
