"""One HTML page about an asset: no script, no link to anywhere, every text from the asset escaped."""

from functools import partial
from html import escape

from bakery.asset.axes import axes
from bakery.asset.summary import describe
from bakery.report.figures import drawing, pictures, title_of
from bakery.report.html import document, image, paragraph, section, table
from bakery.stages.conform import stages_of
from bakery.store.tree import Dataset, Group, read_text


def page(root: Group, description: str = "", picture: bytes = b"", source: str = "ASSET") -> str:
    """The whole page, UTF-8.

    description : the recipe's, or none
    picture : a rendered picture of the asset (PNG or JPEG), or none
    source : the asset's file, for what is said of it
    """
    summary = describe(root)
    name = str(summary["name"])
    lead = f"Bakery asset, format {summary['format_version']}, baked by bakery {summary['bakery_version']}"
    parts = [f"<h1>{escape(name)}</h1>\n", paragraph(description, "what") if description else ""]
    parts += [paragraph(lead, "lead"), *(paragraph(f"Broken: {rule}.", "missed") for rule in summary["broken"]),
              *(f'<p class="missed"><strong>Tolerance missed.</strong> {escape(stage["group"])}: {escape(stage["missed"])} '
                f'({escape(str(stage["error_measure"]))}).</p>\n' for stage in summary["stages"] if stage["missed"])]
    stages = stages_of(root)
    parts.append(_rendered(picture, name, source) if any(stage.rendered for stage in stages) else "")
    for stage in reversed(stages):  # what renderers take first, then what it came from
        for told in stage.tables(root, partial(axes, root)):
            rows = table(told.header, told.rows, numbers=range(told.words, len(told.header)))
            parts += section(told.title, [rows, paragraph(told.note) if told.note else ""])
    figures = [drawing(picture, title_of(root)) for picture in pictures(root)]
    parts += section("Pictures", figures)
    parts += section("Stages", [_stages(summary), *(paragraph(f"{key} {text}.") for key, text in summary["explained"].items())])
    parts += section("Content", [_datasets(summary)])
    recipe = root.members.get("recipe")
    if isinstance(recipe, Dataset):
        parts += section("Recipe", [f"<pre>{escape(read_text(recipe))}</pre>\n"])
    parts += section("Provenance", [table((), [(key, str(value)) for key, value in summary["provenance"].items()])])
    return document(name, parts)


def _rendered(picture: bytes, name: str, source: str) -> str:
    """The preview, or how to get it."""
    if not picture:
        return (f'<p class="lead">No rendered picture: <code>bake render {escape(source)}</code> makes one, a new report takes '
                "it.</p>\n")
    return (f"<figure>{image(picture, f'{name}, rendered')}<figcaption>Rendered: the standard preview of "
            "<code>bake render</code>.</figcaption></figure>\n")


def _stages(summary: dict) -> str:
    header = ("stage", "error", "allowed", "measure", "time", "memory", "input_hash", "content_hash")
    rows = [(f"{stage['group']} {stage['stage_version']}", _short(stage["achieved_error"]) + " missed" * bool(stage["missed"]),
             _short(stage["tolerance"]), str(stage["error_measure"]), _in(stage["seconds"], 1, "s"),
             _in(stage["peak_memory"], 1e6, "MB"),
             str(stage["input_hash"])[:16], str(stage["content_hash"])[:16]) for stage in summary["stages"]]
    notes = "".join(paragraph(f"{stage['group']}: {note}") for stage in summary["stages"] for note in stage["notes"])
    return table(header, rows, numbers=(1, 2, 4, 5), hashes=(6, 7)) + notes if rows else ""


def _datasets(summary: dict) -> str:
    header = ("dataset", "shape", "from", "to", "unit", "what it is")
    rows = [(row["path"], " x ".join(map(str, row["shape"])), _short(row["minimum"]), _short(row["maximum"]),
             "" if row["units"] == "1" else row["units"], row["description"]) for row in summary["datasets"]]
    return table(header, rows, numbers=(1, 2, 3))


def _short(value) -> str:
    return "" if value is None else f"{value:.5g}"


def _in(value: float | None, unit: float, name: str) -> str:
    return "" if value is None else f"{value / unit:.3g} {name}"
