"""Pages of claims: each claim that is measured again has its table and its picture there, and each place its claim."""

import re
from importlib import import_module

import pytest

from benchmarks.claims import filled
from tests.conftest import ROOT

# what is measured -> pages that it fills
PAGES = {"goa": ("goa-claims",), "discrete": ("discrete-claims",), "granular": ("granular-claims",),
         "translucent": ("translucent-claims", "measurements/translucent")}


@pytest.mark.parametrize("subject", PAGES)
def test_each_claim_has_its_place_and_its_picture(subject):
    claims = import_module(f"benchmarks.figures_{subject}.__main__").CLAIMS
    page = "".join((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in PAGES[subject])
    places = re.findall(r"<!-- numbers: (\S+) -->\n(.*?)<!-- end -->", page, re.DOTALL)
    assert len({name for name, _ in places}) == len(places) and all("| " in text for _, text in places)
    assert {re.split("[_-]", name)[0] for name, _ in places} == set(claims)
    for picture in (picture for _, picture in claims.values() if picture):
        assert f"pictures/{picture}" in page and (ROOT / "docs" / "pictures" / picture).stat().st_size < 200_000


def test_places_are_filled():
    assert "new\ntable" in filled("<!-- numbers: a -->\nold\n<!-- end -->", {"a": "new\ntable"})
    with pytest.raises(SystemExit, match="one '<!-- numbers: b -->'"):
        filled("<!-- numbers: a -->\nold\n<!-- end -->", {"b": ""})
