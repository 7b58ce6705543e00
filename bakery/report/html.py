"""What pages are made of: one document without outside resources, sections, tables, images inside of it."""

import base64
import hashlib
from collections.abc import Iterable, Sequence
from functools import cache
from html import escape
from pathlib import Path

LONG = 30  # characters of a cell that gets a width of its own


def document(title: str, parts: Iterable[str], *, broad: bool = False, script: str = "", style: str = "",
             asks: bool = False) -> str:
    """A whole page, UTF-8: light or dark as the reader's system is, from the width of a phone on.

    parts : HTML, in which every text is escaped
    broad : for pictures side by side, not for text
    script, style : names of files beside this one; the style comes on top of that of all pages
    asks : the script may ask the server that the page came from, and no other

    The policy keeps the page from fetching or running anything but this script, should a text ever slip through unescaped.
    """
    code = _file(script) if script else ""
    allowed = f"; script-src 'sha256-{base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()}'" if code else ""
    allowed += "; connect-src 'self'" if asks else ""
    return "".join([
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<meta http-equiv="Content-Security-Policy" '
        f"content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'{allowed}\">\n"
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{_file('page.css')}{_file(style) if style else ''}</style>\n</head>\n",
        '<body class="broad">\n' if broad else "<body>\n", *parts,
        f"<script>{code}</script>\n" if code else "", "</body>\n</html>\n"])


@cache
def _file(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


def section(title: str, parts: Iterable[str]) -> list[str]:
    """Parts under a heading; nothing where there are none."""
    parts = [part for part in parts if part]
    return [f"<h2>{escape(title)}</h2>\n", *parts] if parts else []


def paragraph(text: str, kind: str = "") -> str:
    """A text; kinds: `what` (what the page is about), `lead`, `missed`."""
    return f'<p class="{kind}">{escape(text)}</p>\n' if kind else f"<p>{escape(text)}</p>\n"


def image(data: bytes, words: str, key: str = "") -> str:
    """An image inside of the page: PNG, JPEG or SVG; `words` for those who do not see it, `key`: its id, if it has one."""
    named = f' id="{key}"' if key else ""
    kind = "png" if data.startswith(b"\x89PNG") else "jpeg" if data.startswith(b"\xff\xd8") else "svg+xml"
    return f'<img alt="{escape(words)}" src="data:image/{kind};base64,{base64.b64encode(data).decode()}"{named}>'


def table(header: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = (), hashes: Sequence[int] = ()) -> str:
    """A table of texts that scrolls within the page; columns of numbers are aligned, those of hashes do not break."""
    kinds = {**dict.fromkeys(numbers, "n"), **dict.fromkeys(hashes, "hash")}
    lines = ["<tr>" + "".join(f"<th{_class(kinds.get(i, ''), '')}>{escape(cell)}</th>" for i, cell in enumerate(header)) + "</tr>"
             ] if header else []
    lines += ["<tr>" + "".join(f"<td{_class(kinds.get(i, ''), cell)}>{escape(cell)}</td>" for i, cell in enumerate(row)) + "</tr>"
              for row in rows]
    return '<div class="wide" tabindex="0"><table>\n' + "\n".join(lines) + "\n</table></div>\n"


def _class(kind: str, cell: str) -> str:
    """Of a cell: numbers, hashes, long texts (which would become towers of words on a phone), errors above the tolerance."""
    words = [kind] * bool(kind) + ["long"] * (len(cell) > LONG and not kind)
    words += ["missed"] * (kind == "n" and cell.endswith("missed"))
    return f' class="{" ".join(words)}"' if words else ""
