"""One HTML page about an asset: no script, no link to anywhere, every text from the asset escaped."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from functools import partial
from html import escape

from bakery.asset.axes import axes
from bakery.asset.summary import describe
from bakery.draw.files import as_jpeg
from bakery.draw.picture import drawn
from bakery.draw.table import Table
from bakery.report.figures import pictures, title_of
from bakery.stages.conform import stages_of
from bakery.store.tree import Dataset, Group, read_text

HEAVY = 150_000  # bytes of a drawing from which on shades may be lossy: a page is to stay below 2 MB
LONG = 30  # characters of a cell that gets a width of its own
# The policy keeps the page from fetching or running anything, should a text ever slip through unescaped.
_HEAD = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
body {{ font: 16px/1.5 system-ui, sans-serif; color: #1c2530; max-width: 62rem; margin: 2.5rem auto; padding: 0 1.2rem; }}
h1 {{ font-size: 1.9rem; margin: 0; overflow-wrap: anywhere; }}
h2 {{ font-size: 1.25rem; margin: 2.6rem 0 .8rem; border-bottom: 1px solid #dfe3e8; padding-bottom: .3rem; }}
p {{ overflow-wrap: anywhere; }}
p.what {{ font-size: 1.15rem; margin: .5rem 0 0; }}
p.lead, figcaption {{ color: #5d6875; }}
p.missed {{ background: #fdf0e6; border-left: .3rem solid #b3541e; padding: .5rem .8rem; }}
td.missed {{ color: #b3541e; font-weight: 600; }}
figure {{ margin: 1.4rem 0 2.2rem; }}
figure img {{ max-width: 100%; height: auto; }}
figcaption {{ font-size: .9rem; }}
.wide {{ overflow: auto; max-height: 36rem; }}
table {{ border-collapse: collapse; font-size: .88rem; }}
th, td {{ text-align: left; vertical-align: top; padding: .28rem .9rem .28rem 0; border-bottom: 1px solid #eef0f3; }}
th {{ font-weight: 600; white-space: nowrap; position: sticky; top: 0; background: #fff; }}
td.n {{ text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }}
td.long {{ min-width: 16rem; }}
td.hash, pre {{ font-family: ui-monospace, monospace; font-size: .82rem; }}
td.hash {{ white-space: nowrap; }}
pre {{ background: #f5f6f8; padding: 1rem; overflow-x: auto; }}
@media (max-width: 40rem) {{
body {{ margin: 1rem auto; padding: 0 .8rem; }}
figure.drawing div {{ overflow-x: auto; }}
figure.drawing img {{ max-width: none; width: 40rem; }}
}}
</style>
</head>
<body>
"""


def page(root: Group, description: str = "", picture: bytes = b"", source: str = "ASSET") -> str:
    """The whole page, UTF-8.

    Parameters
    ----------
    description : the recipe's, or none
    picture : a rendered picture of the asset (PNG or JPEG), or none
    source : the asset's file, for what is said of it
    """
    summary = describe(root)
    name = str(summary["name"])
    lead = f"Bakery asset, format {summary['format_version']}, baked by bakery {summary['bakery_version']}"
    parts = [_HEAD.format(title=escape(name)), f"<h1>{escape(name)}</h1>\n"]
    if description:
        parts.append(f'<p class="what">{escape(description)}</p>\n')
    parts += [f'<p class="lead">{escape(lead)}</p>\n', *(_missed(stage) for stage in summary["stages"] if stage["missed"])]
    stages = stages_of(root)
    parts.append(_rendered(picture, name, source) if any(stage.rendered for stage in stages) else "")
    for stage in reversed(stages):  # what renderers take first, then what it came from
        for table in stage.tables(root, partial(axes, root)):
            parts += _section(table.title, _told(table))
    figures = [_figure(picture, title_of(root)) for picture in pictures(root)]
    parts += _section("Pictures", figures)
    parts += _section("Stages", [_stages(summary), *(f"<p>{escape(key)} {escape(text)}.</p>\n"
                                                     for key, text in summary["explained"].items())])
    parts += _section("Content", [_datasets(summary)])
    recipe = root.members.get("recipe")
    if isinstance(recipe, Dataset):
        parts += _section("Recipe", [f"<pre>{escape(read_text(recipe))}</pre>\n"])
    parts += _section("Provenance", [_table((), [(key, str(value)) for key, value in summary["provenance"].items()])])
    return "".join([*parts, "</body>\n</html>\n"])


def _section(title: str, parts: Iterable[str]) -> list[str]:
    parts = [part for part in parts if part]
    return [f"<h2>{escape(title)}</h2>\n", *parts] if parts else []


def _told(table: Table) -> list[str]:
    note = f"<p>{escape(table.note)}</p>\n" if table.note else ""
    return [_table(table.header, table.rows, numbers=range(table.words, len(table.header))), note]


def _missed(stage: dict) -> str:
    return (f'<p class="missed"><strong>Tolerance missed.</strong> {escape(stage["group"])}: {escape(stage["missed"])} '
            f'({escape(str(stage["error_measure"]))}).</p>\n')


def _rendered(picture: bytes, name: str, source: str) -> str:
    """The preview, or how to get it."""
    if not picture:
        return (f'<p class="lead">No rendered picture: <code>bake render {escape(source)}</code> makes one, a new report takes '
                "it.</p>\n")
    data = base64.b64encode(picture).decode()
    return (f'<figure><img alt="{escape(name)}, rendered" src="data:{_kind(picture)};base64,{data}"><figcaption>Rendered: '
            "the standard preview of <code>bake render</code>.</figcaption></figure>\n")


def _kind(image: bytes) -> str:
    return "image/png" if image.startswith(b"\x89PNG") else "image/jpeg" if image.startswith(b"\xff\xd8") else "image/svg+xml"


def _figure(picture, of: str) -> str:
    # as an image, not inline: ids of several drawings cannot meet, and an image runs no script; as whichever form is smaller
    forms = drawn(picture, of=of)
    image = min(forms.values(), key=len)
    if len(image) > HEAVY:
        image = min(image, as_jpeg(forms["png"]), key=len)
    data, caption = base64.b64encode(image).decode(), escape(picture.caption)
    return (f'<figure class="drawing"><div><img alt="{escape(picture.title)}. {caption}" src="data:{_kind(image)};base64,{data}">'
            f"</div><figcaption><strong>{escape(picture.title)}.</strong> {caption}</figcaption></figure>\n")


def _stages(summary: dict) -> str:
    header = ("stage", "error", "allowed", "measure", "time", "memory", "input_hash", "content_hash")
    rows = [(f"{stage['group']} {stage['stage_version']}", _short(stage["achieved_error"]) + " missed" * bool(stage["missed"]),
             _short(stage["tolerance"]), str(stage["error_measure"]), _in(stage["seconds"], 1, "s"),
             _in(stage["peak_memory"], 1e6, "MB"),
             str(stage["input_hash"])[:16], str(stage["content_hash"])[:16]) for stage in summary["stages"]]
    notes = "".join(f"<p>{escape(stage['group'])}: {escape(note)}</p>\n"
                    for stage in summary["stages"] for note in stage["notes"])
    return _table(header, rows, numbers=(1, 2, 4, 5), hashes=(6, 7)) + notes if rows else ""


def _datasets(summary: dict) -> str:
    header = ("dataset", "shape", "from", "to", "unit", "what it is")
    rows = [(row["path"], " x ".join(map(str, row["shape"])), _short(row["minimum"]), _short(row["maximum"]),
             "" if row["units"] == "1" else row["units"], row["description"]) for row in summary["datasets"]]
    return _table(header, rows, numbers=(1, 2, 3))


def _short(value) -> str:
    return "" if value is None else f"{value:.5g}"


def _in(value: float | None, unit: float, name: str) -> str:
    return "" if value is None else f"{value / unit:.3g} {name}"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = (), hashes: Sequence[int] = ()) -> str:
    kinds = {**dict.fromkeys(numbers, "n"), **dict.fromkeys(hashes, "hash")}
    lines = ["<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in header) + "</tr>"] if header else []
    lines += ["<tr>" + "".join(f"<td{_class(kinds.get(i, ''), cell)}>{escape(cell)}</td>" for i, cell in enumerate(row)) + "</tr>"
              for row in rows]
    return '<div class="wide" tabindex="0"><table>\n' + "\n".join(lines) + "\n</table></div>\n"


def _class(kind: str, cell: str) -> str:
    """Of a cell: numbers, hashes, long texts (which would become towers of words on a phone), errors above the tolerance."""
    words = [kind] * bool(kind) + ["long"] * (len(cell) > LONG and not kind)
    words += ["missed"] * (kind == "n" and cell.endswith("missed"))
    return f' class="{" ".join(words)}"' if words else ""
