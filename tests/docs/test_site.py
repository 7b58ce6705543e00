"""The site: no warning when it is made, notebooks run and show pictures, no dead link in it, no page wider than a phone."""

import os
import re
import runpy
import subprocess
import sys
from html import unescape
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit

import pytest

import bakery.kernels
import bakery.physics.goa
from tests.browser import CHROMIUM, Page
from tests.conftest import ROOT

WHOLE = ('mistake.yaml:11: particles.components[0].size.radius: found "5", which has no unit; '
         "lengths take nm, um, mm, cm, m (5 um?)")  # what a command in a notebook prints
PHONE = 390  # pixels
# of the page, and of its text, for which furo has a box that scrolls by itself
WIDTH = "Math.max(...['html', '.content'].map(one => document.querySelector(one).scrollWidth))"
NOTEBOOKS = [path.relative_to(ROOT).with_suffix("") for path in sorted((ROOT / "docs").rglob("*.md"))
             if path.read_text(encoding="utf-8").startswith("---\nfile_format: mystnb\n")]
PICTURE = re.compile(r'class="cell_output(?:(?!class="cell_input).)*?(?:src="[./]*_images/[0-9a-f]{64}\.png|data:image/png)',
                     re.DOTALL)
SAMPLE = ["README", "docs/index", "docs/cli", "docs/asset-format", "docs/gallery", "docs/translucent-claims", "docs/tutorial/fog",
          "docs/how-to/own-renderer", "docs/how-to/clouds", "docs/api/kernels", "docs/api/assets", "genindex"]


class Links(HTMLParser):
    """Places that a page leads to, and those in it that others may lead to."""

    def __init__(self, text):
        super().__init__()
        self.to, self.ids = set(), set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.to |= {values[key] for key in ("href", "src") if values.get(key)}
        self.ids |= {values["id"]} if values.get("id") else set()


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_site(tmp_path):
    """One test, as the site is made once."""
    for name in ("furo", "myst_nb", "xarray"):
        pytest.importorskip(name, reason=f"{name} is not installed: pip install '.[docs]'")
    pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install '.[mitsuba,llvm]'")
    made(tmp_path)
    tutorial = (tmp_path / "html/docs/tutorial/fog.html").read_text(encoding="utf-8")
    assert WHOLE in unescape(tutorial)  # in one piece
    notebooks_show_pictures(tmp_path / "html")
    no_link_is_dead(tmp_path / "html")
    if CHROMIUM is None:
        pytest.skip("the pages are there, and no link is dead; without chromium nobody sees how wide they are")
    for dark in (False, True):
        no_page_scrolls_sideways(tmp_path / "html", dark)


def made(folder):
    """As `make site` does it; notebooks that have run with these sources are taken from build/."""
    done = subprocess.run([sys.executable, "-m", "sphinx", "-W", "--keep-going", "-n", "-q", "-c", "docs/site", "-d",
                           folder / "doctrees", ".", folder / "html"], cwd=ROOT, text=True, capture_output=True,
                          env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode == 0, done.stderr


def notebooks_show_pictures(site):
    """Among what their cells give; sphinx has failed where a cell has."""
    for name in NOTEBOOKS:
        assert PICTURE.search((site / name).with_suffix(".html").read_text(encoding="utf-8")), name


def test_there_are_a_tutorial_and_how_tos():
    assert {name.parent.name for name in NOTEBOOKS} == {"tutorial", "how-to"} and len(NOTEBOOKS) >= 5


def no_link_is_dead(site):
    pages = {path: Links(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    dead, seen = [], 0
    for path, links in pages.items():
        for link in links.to:
            part = urlsplit(link)
            if part.scheme:
                continue  # the net's, and pictures in the page
            target = (path.parent / unquote(part.path)).resolve() if part.path else path
            seen += 1
            if not target.is_file() or (part.fragment and target in pages and unquote(part.fragment) not in pages[target].ids):
                dead.append(f"{path.relative_to(site)}: {link}")
    assert not dead
    assert len(pages) > 50 and seen > 2000


def no_page_scrolls_sideways(site, dark):
    for name in SAMPLE:
        with Page(site / f"{name}.html", PHONE, 844, dark) as page:
            assert page.value(WIDTH) <= PHONE, name
            assert page.value("[...document.images].filter(one => !one.complete).map(one => one.src)") == []
            background = page.value("getComputedStyle(document.body).backgroundColor")
            assert (sum(map(int, re.findall(r"\d+", background)[:3])) < 200) == dark, background
            assert not page.said
    with Page(site / "README.html", PHONE, 844, dark) as page:  # what is too wide would be seen
        page.value("document.querySelector('article').append(Object.assign(document.createElement('pre'), "
                   "{style: 'width: 800px', textContent: 'wide'}))")
        assert page.value(WIDTH) > PHONE


def named(page):
    """What the docstrings are shown of."""
    text = (ROOT / f"docs/api/{page}.md").read_text(encoding="utf-8")
    return sorted(re.findall(r"^\.\. auto\w+:: (\w+)$", text, re.MULTILINE))


def test_public_names_are_on_the_pages():
    assert named("kernels") == sorted(bakery.kernels.__all__)
    assert set(bakery.__all__) - {"mie", "goa"} <= set(named("assets"))
    assert {"efficiencies", *bakery.physics.goa.__all__} <= set(named("physics"))


def test_docstrings_of_the_house_are_read():
    rewritten = runpy.run_path(str(ROOT / "docs/site/docstrings.py"))["rewritten"]
    lines = ["Sum of x_ and `y`.", "", "Parameters", "----------", "x, y : (N,) um, |x| < 1;  n : int", "    more of it", "",
             "Examples", "--------", ">>> 1 + 1", "2"]
    assert rewritten(lines) == [
        r"Sum of x\_ and `y`.", "",
        ".. rubric:: Parameters", "", r"* **x, y** – (N,) um, \|x\| < 1", "* **n** – int", "  more of it", "",
        ".. rubric:: Examples", "", ">>> 1 + 1", "2", ""]


def test_each_page_stands_once_in_the_navigation():
    toctrees = runpy.run_path(str(ROOT / "docs/site/navigation.py"))["toctrees"]
    index = "# All\n## Start\n- [R](../README.md), [a](a.md#b)\n## More\n- [a](a.md), [b](x/b.md), [w](https://w.md)\n"
    groups = re.findall(r":caption: (\w+)\n\n(.*?)\n```", toctrees(index, "README"), re.DOTALL)
    assert groups == [("Start", "/docs/index\n/docs/a"), ("More", "/docs/x/b")]
