"""What docs/translucent-claims.md, and a section of docs/measurements/translucent.md, are filled by."""

from __future__ import annotations

import re

from benchmarks.figures_translucent.__main__ import CLAIMS
from tests.conftest import ROOT


def test_each_claim_has_its_place_and_its_picture():
    page, other = ((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
                   for name in ("translucent-claims", "measurements/translucent"))
    assert {name.split("_")[0] for name in re.findall(r"<!-- numbers: (\w+) -->", page + other)} == set(CLAIMS)
    assert all(f"pictures/{picture}" in page for _, picture in CLAIMS.values() if picture)
