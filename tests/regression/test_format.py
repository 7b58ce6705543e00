"""Readers find datasets by their names and units: who renames one, or takes it out, raises the version of the asset format.

`make test PYTEST="tests/regression --update format"` adds new datasets to `format.json`, which lists those of each version of the
format, and begins the list of a raised version.
"""

import json
from collections import Counter

from bakery.stages import all_stages
from bakery.store.container import VERSION
from tests.conftest import ROOT

LIST = ROOT / "tests" / "regression" / "format.json"
PAGE = ROOT / "docs" / "asset-format.md"
RAISE = "raise VERSION in bakery/store/container.py, say it in docs/asset-format.md, then --update format"


def declared() -> list[str]:
    """Path in the asset, and units, of every dataset that a stage may write; what two stages of one name write stands twice."""
    return sorted(f"{stage.name}/{output.path}, {output.units}" for stage in all_stages() for output in stage.outputs)


def gone(known: list[str], now: list[str]) -> list[str]:
    """What readers of the known datasets would not find any more."""
    return sorted((Counter(known) - Counter(now)).elements())


def test_names_of_datasets_belong_to_a_version_of_the_format(request):
    lists, now = json.loads(LIST.read_text()), declared()
    known = lists.get(str(VERSION), [])
    assert not gone(known, now), f"gone, renamed, or in other units: {'; '.join(gone(known, now))}: {RAISE}"
    if request.config.getoption("--update") in ("format", "all"):
        LIST.write_text(json.dumps(lists | {str(VERSION): now}, indent=1) + "\n")
        return
    assert not gone(now, known), f"new in format {VERSION}: {'; '.join(gone(now, known))}: --update format"


def test_the_page_is_of_this_version():
    page = PAGE.read_text(encoding="utf-8")
    assert page.startswith(f"# Asset format {VERSION}\n") and f"bakery-asset {VERSION} sha256:" in page
    assert f"\n{VERSION}. " in page.split("## Versions of the format")[1]
    assert list(json.loads(LIST.read_text())) == [str(number) for number in range(1, VERSION + 1)]


def test_a_renamed_dataset_is_seen():
    now = declared()
    assert len(now) > 300 and not gone(now, [*now, "medium/new, 1"]), "what is new breaks no reader"
    for other in ("medium/extinction, 1/m", "medium/sigma_t, 1/mm"):
        # of one of the two stages that write a medium
        changed = list(now)
        changed[changed.index("medium/sigma_t, 1/m")] = other
        assert gone(now, changed) == ["medium/sigma_t, 1/m"] and gone(changed, now) == [other]
