"""The site: no warning when it is made, no dead link in it, no page wider than a phone."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from urllib.parse import unquote, urldefrag

import pytest

import bakery.kernels
from tests.browser import CHROMIUM, Page
from tests.conftest import ROOT

PHONE = 390  # pixels
WIDTH = "document.documentElement.scrollWidth"
SAMPLE = ["README", "docs/index", "docs/cli", "docs/asset-format", "docs/gallery", "docs/translucent-claims", "docs/tutorial/fog",
          "docs/how-to/own-renderer", "docs/how-to/clouds", "docs/api/kernels", "docs/api/assets"]


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
    for name in ("furo", "myst_nb"):
        pytest.importorskip(name, reason=f"{name} is not installed: pip install '.[docs]'")
    pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install '.[mitsuba,llvm]'")
    made(tmp_path)
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


def no_link_is_dead(site):
    pages = {path: Links(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    dead, seen = [], 0
    for path, links in pages.items():
        for link in links.to:
            place, fragment = urldefrag(link)
            if ":" in place:
                continue  # the net's
            target = (path.parent / unquote(place)).resolve() if place else path
            seen += 1
            if not target.is_file() or (fragment and target in pages and unquote(fragment) not in pages[target].ids):
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
    with Page(site / "README.html", PHONE, 844, dark) as page:  # a table that did not scroll by itself would be seen
        page.value("document.querySelector('.table-wrapper').style.overflow = 'visible'")
        assert page.value(WIDTH) > PHONE


def test_the_kernels_page_has_all():
    named = re.findall(r"^\.\. auto\w+:: (\w+)$", (ROOT / "docs/api/kernels.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(named) == sorted(bakery.kernels.__all__)
