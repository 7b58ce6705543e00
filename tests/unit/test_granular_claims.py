"""What docs/granular-claims.md is filled by."""

from __future__ import annotations

import re

from benchmarks.figures_granular.__main__ import CLAIMS
from tests.conftest import ROOT


def test_each_claim_has_its_place_and_its_picture():
    page = (ROOT / "docs" / "granular-claims.md").read_text(encoding="utf-8")
    assert {name.split("_")[0] for name in re.findall(r"<!-- numbers: (\w+) -->", page)} == set(CLAIMS)
    assert all(f"pictures/{picture}" in page for _, picture in CLAIMS.values())
