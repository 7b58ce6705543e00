"""The page of a render that goes on: it asks its server for news, and needs none once the render is over."""

from html import escape

from bakery.report.html import document

# buttons over the picture: name, sign, words
_ZOOM = (("out", "−", "smaller (−)"), ("in", "+", "larger (+)"), ("fit", "Fit", "the whole picture (0)"),
         ("pixels", "1:1", "a pixel of the picture is one of the screen (1)"))
_FIGURES = (("noise", "Noise"), ("samples", "Samples a pixel"), ("spent", "Time so far"), ("remaining", "Time left"),
            ("method", "Method"), ("size", "Pixels"))


def page(name: str, source: str) -> str:
    """The whole page, UTF-8."""
    zoom = "".join(f'<button type="button" data-zoom="{key}" title="{words}" aria-label="{words}">{sign}</button>'
                   for key, sign, words in _ZOOM)
    rows = "".join(f'<div><dt>{words}</dt><dd id="{key}">–</dd></div>' for key, words in _FIGURES)
    return document(f"{name}: rendering", [
        f'<header><h1>{escape(name)}</h1><p class="lead">{escape(source)}</p></header>\n',
        '<main id="live">\n<section class="stage" aria-label="Picture">\n'
        '<div id="layers" role="radiogroup" aria-label="Layer"></div>\n'
        '<div class="frame"><div id="view" tabindex="0" role="img" aria-label="The picture so far; arrows move it, + and − '
        'change its size"><canvas width="1" height="1"></canvas><span id="pixel" hidden></span>'
        '<p id="empty">Preparing the scene</p></div>'
        f'<div class="zoom"><output id="scale"></output>{zoom}</div></div>\n'
        '<p id="words"></p><p id="readout">Point at a pixel to read its values.</p>\n</section>\n'
        '<aside aria-label="Figures">\n<p id="phase" role="status">connecting</p>\n'
        '<div class="done" role="progressbar" aria-label="Share done" aria-valuemin="0" aria-valuemax="100"><span></span></div>\n'
        f'<dl>{rows}</dl>\n<svg id="course" viewBox="0 0 300 120" role="img" aria-label="Noise over time" hidden></svg>\n'
        '<button type="button" id="stop" title="The passes end, and the picture so far is written whole">Stop and keep '
        'the picture</button>\n<p id="text" hidden></p>\n<ul id="missed" class="missed" hidden></ul>\n'
        '<details id="why" hidden><summary>Why this method</summary><ul id="reasons"></ul></details>\n</aside>\n</main>\n',
        "<noscript><p>The page needs its script, which it carries itself.</p></noscript>\n",
    ], broad=True, script="live.js", style="live.css", asks=True)
