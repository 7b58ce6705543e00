"""One HTML page about pictures of one scene by several methods, beside one another."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import floor, log10
from pathlib import Path

from bakery.draw import maps
from bakery.draw.picture import Picture
from bakery.report.figures import drawing
from bakery.report.html import document, image, paragraph, section, table

SMALL = 320  # pixels: narrower pictures are enlarged as squares
_SAID = (
    "error: root mean square difference of the luminance of linear radiance from the reference, over the reference's mean, "
    "with the noise of both pictures taken off; < where it does not stand out of the noise by two standard errors: it is at most "
    "so much.",
    "bias: difference of the means of the luminance, with one standard error by the scatter of the passes.",
    "noise: root mean square standard error of the luminance over its mean.",
    "to the tolerance: time of all cores together until the error, noise and what lies beneath it, is below it, with its "
    "standard error.",
    "time: by the clock, without the compiling of kernels, which a machine does once; to 1 % noise: that time, as noise goes "
    "with the root of it; processor: time of all cores together, also without compiling.")
_FLIP = "FLIP: what a person sees of the difference of the pictures as they are shown, 0 to 1, at 67 pixels a degree."


@dataclass(frozen=True)
class Shown:
    """What is shown of a method."""

    name: str  # of the method, or of the reference's file
    picture: bytes  # PNG
    difference: bytes = b""  # PNG of the signed map, or b""
    flip: bytes = b""  # PNG of the map, or b""


def page(summary: Mapping, shown: Sequence[Shown], limit: float, times: Picture | None = None, title: str = "") -> str:
    """The whole page, UTF-8.

    summary : what `bake compare --json` prints
    shown : in the order of the page
    limit : relative difference at the ends of the signed maps' colours
    times : drawing of error against time, where noise is known
    title : what the page is about; how many methods it compares unless given
    """
    methods = {method["name"]: method for method in summary["methods"]}
    width, high = summary["size"]
    assets = ", ".join(Path(asset).name for asset in summary["asset"].split(", "))
    lead = f"{summary['renderer']}, {assets}, {width} x {high} pixels. Reference: {summary['reference']}."
    if summary["overrides"]:
        lead += " Set: " + ", ".join(f"{key}={value}" for key, value in summary["overrides"].items()) + "."
    images = [(f"p{i}", method.name, method.picture) for i, method in enumerate(shown)]
    images += [(f"d{i}", f"{method.name}: difference", method.difference) for i, method in enumerate(shown) if method.difference]
    images += [(f"f{i}", f"{method.name}: FLIP", method.flip) for i, method in enumerate(shown) if method.flip]
    captions = {method.name: _caption(methods.get(method.name), method.name == summary["reference"]) for method in shown}
    cell = "grid small" if width < SMALL else "grid"

    def grid(kind):
        return f'<div class="{cell}">\n' + "".join(
            _figure(key, name, data, captions.get(name, "")) for key, name, data in images if key[0] == kind) + "</div>\n"

    parts = [f"<h1>{escape(summary['name'])}: {escape(title) or f'{len(methods)} methods'}</h1>\n",
             paragraph(summary["description"], "what") if summary["description"] else "", paragraph(lead, "lead"),
             *(paragraph(remark, "missed") for remark in summary["remarks"]),
             paragraph(summary["trade"]["advice"][-1], "what") if title and summary["trade"] else "",
             _slider([(key, name) for key, name, _ in images], shown, summary["reference"], width, high),
             *section("Pictures", [grid("p")]),
             *section("Figures", [_figures(summary), *map(paragraph, _SAID), paragraph(summary["flip"] or _FLIP)])]
    if times is not None:
        sentences = [*summary["trade"]["advice"], *summary["trade"]["others"]]
        parts += section("Error against time", [*map(paragraph, sentences), drawing(times)])
    if any(method.difference for method in shown):
        sentences = paragraph("Luminance, relative to the reference's mean; red where the picture is brighter. Noise is not "
                              "taken off: it is what changes from pixel to pixel.")
        scale = _scale(maps.SIGNED, f"−{100 * limit:g} %", f"+{100 * limit:g} %")
        parts += section("Signed difference from the reference", [scale, sentences, grid("d")])
    if any(method.flip for method in shown):
        parts += section("FLIP", [_scale(maps.SHARE, "0", "1"), grid("f")])
    parts += section("Time", [_times(summary)])
    parts += section("What the methods say", [_reasons(summary)])
    return document(f"{summary['name']}: {title or 'methods compared'}", parts, broad=True, script="slider.js")


def difference_text(method: Mapping) -> tuple[str, str]:
    """Error and bias of a method in words, "" where there are none."""
    difference = method["difference"]
    if difference is None:
        return "", ""
    error = _share(difference["error"]) if difference["resolved"] or not difference["most"] else f"< {_share(difference['most'])}"
    bias, deviation = 100 * difference["bias"], 100 * (difference["bias_error"] or 0.0)
    digits = max(0, 1 - floor(log10(deviation or abs(bias) or 1.0)))
    return error, f"{bias:+.{digits}f}".replace("-", "−") + (f" ± {deviation:.{digits}f} %" if deviation else " %")


def until_text(trade: Mapping | None, name: str) -> str:
    """When a method meets the tolerance, in words; "" where that is not said."""
    seconds = trade["until"].get(name) if trade else None
    return "" if seconds is None else f"{_seconds(seconds)} ± {100 * trade['spread'][name]:.0f} %"


def _share(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.2g} %" if value < 1 else f"{100 * value:.0f} %"


def _seconds(value: float | None) -> str:
    """Three digits, in the unit that suits."""
    if value is None:
        return ""
    unit, name = (1, "s") if value < 120 else (60, "min") if value < 7200 else (3600, "h")
    return f"{value / unit:.3g} {name}" if value / unit < 1000 else f"{value / unit:.0f} {name}"


def _caption(method: Mapping | None, is_reference: bool) -> str:
    parts = ["reference"] if is_reference else []
    if method is not None:
        parts += [f"{method['samples']} samples"] if method["samples"] is not None else []
        parts += [f"noise {_share(method['noise'])}"] if method["noise"] is not None else []
        parts.append(_seconds(method["seconds"]["total"] - method["compiling"]))
    return ", ".join(parts)


def _figure(key: str, name: str, data: bytes, caption: str) -> str:
    caption = f"<strong>{escape(name)}</strong> {escape(caption)}"
    return f'<figure>{image(data, name, key)}<figcaption>{caption}</figcaption></figure>\n'


def _slider(choices, shown, reference: str, width: int, high: int) -> str:
    """Hidden until the script runs: without it the pictures stand side by side."""
    others = [method.name for method in shown if method.name != reference]

    def select(words, chosen):
        options = "".join(f'<option value="{key}"{" selected" * (name == chosen)}>{escape(name)}</option>'
                          for key, name in choices)
        return f"<label>{words} <select>{options}</select></label>"

    small = " small" if width < SMALL else ""
    return (f'<section id="slider" aria-label="Two pictures over each other" hidden>\n<div class="choose">'
            f'{select("Left", reference)}{select("Right", others[0] if others else reference)}</div>\n'
            f'<div class="view{small}" style="aspect-ratio: {width} / {high}"><img alt=""><img alt="" class="over">'
            '<span class="edge"></span><span class="name left"></span><span class="name right"></span></div>\n'
            '<input class="move" type="range" min="0" max="100" value="50" step="0.5" aria-label="Edge between left and right">\n'
            "</section>\n")


def _scale(colours: str, low: str, high: str) -> str:
    return f'<div class="scale"><span>{low}</span>{image(maps.scale(colours), "scale of colours")}<span>{high}</span></div>\n'


def _figures(summary: Mapping) -> str:
    trade = summary["trade"]
    header = ["method", f"to {100 * trade['tolerance']:.3g} %" if trade else "",
              "error", "bias", "FLIP", "stated bias", "noise", "samples", "time", "to 1 % noise", "processor"]
    rows = []
    for method in summary["methods"]:
        error, bias = difference_text(method)
        time = method["seconds"]["total"] - method["compiling"]
        ran = f" ({method['method']})" if method["method"] != method["name"].partition(":")[0] else ""
        rows.append([method["name"] + ran, until_text(trade, method["name"]),
                     "reference" if method["name"] == summary["reference"] else error, bias,
                     "" if method["flip"] is None else f"{method['flip']:.3f}", _share(method["stated_bias"]),
                     _share(method["noise"]),
                     "" if method["samples"] is None else str(method["samples"]), _seconds(time),
                     "" if method["noise"] is None else _seconds(time * (method["noise"] / 0.01) ** 2),
                     _seconds(method["processor"])])
    used = [i for i in range(len(header)) if i == 0 or any(row[i] for row in rows)]
    return table([header[i] for i in used], [[row[i] for i in used] for row in rows], numbers=range(1, len(used)))


def _times(summary: Mapping) -> str:
    names = list(dict.fromkeys(name for method in summary["methods"] for name in method["seconds"] if name != "total"))
    rows = [[method["name"], *(_seconds(method["seconds"].get(name)) for name in names), _seconds(method["seconds"]["total"]),
             _seconds(method["compiling"])] for method in summary["methods"]]
    return table(["method", *names, "in all", "of it compiling"], rows, numbers=range(1, len(names) + 3))


def _reasons(summary: Mapping) -> str:
    sentences = {method["name"]: [*method["reasons"], *(f"Missed: {line}" for line in method.get("missed", ()))]
                 for method in summary["methods"]}
    items = [f"<dt><strong>{escape(name)}</strong></dt>\n" + "".join(f"<dd>{escape(line)}</dd>\n" for line in lines)
             for name, lines in sentences.items() if lines]
    return f"<dl>\n{''.join(items)}</dl>\n" if items else ""
