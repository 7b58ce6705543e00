"""docs/index.md leads to every page, and no link of README or docs leads nowhere."""

import re

import pytest

from tests.conftest import ROOT

PAGES = sorted((ROOT / "docs").rglob("*.md"))
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")


def links(path):
    return [(path.parent / target).resolve() for target in LINK.findall(path.read_text()) if "://" not in target]


def test_the_index_leads_to_every_page():
    assert {path.resolve() for path in PAGES} - {(ROOT / "docs" / "index.md").resolve()} <= set(links(ROOT / "docs" / "index.md"))


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda path: path.name)
def test_links_lead_somewhere(page):
    missing = [str(target) for target in links(page) if not target.exists()]
    assert not missing
