"""docs/asset-format.md and the stages' declarations agree, and every declared shape is enforced."""

import re
import runpy
from dataclasses import replace

import numpy as np
import pytest

from bakery.stages import all_stages, conform
from bakery.store.tree import TEXT, Dataset, Group
from tests.conftest import ROOT

TABLES = runpy.run_path(str(ROOT / "docs" / "asset_tables.py"))
PAGE = (ROOT / "docs" / "asset-format.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| (`.+?) \| (\(.*?\)) \| (.+?) \| (.+) \|$", re.MULTILINE)
STAGES = [stage for i, stage in enumerate(all_stages()) if stage.outputs not in [s.outputs for s in all_stages()[:i]]]


def test_the_page_is_current():
    assert TABLES["current"](PAGE) == PAGE, "`make docs` brings the page up to date"


def spelt_out(name):
    """Paths that a name of the page stands for."""
    if name.startswith("[TILE/]"):
        return [name.removeprefix("[TILE/]"), name.replace("[TILE/]", "TILE/")]
    return [name.replace("SOURCE/", source) for source in ("point/", "segment/")] if name.startswith("SOURCE/") else [name]


def test_the_page_and_the_declarations_hold_the_same():
    """Read back as a reader of the page would: a row, some datasets, each perhaps with its standard error."""
    shown = set()
    group = ""
    for line in PAGE.splitlines():
        if line.startswith("<!-- datasets: "):
            group = line.split()[2]
        elif line == "<!-- end -->":
            group = ""
        elif group and (row := ROW.match(line)):
            paths, shape, units, _ = row.groups()
            for name, error in re.findall(r"`([^`]+)`( ±)?", paths):
                for path in spelt_out(name):
                    shown |= {(group, path + end, shape, units) for end in ("", "_error")[:1 + bool(error)]}
    declared = {(stage.name, output.path, output.shape,
                 f"enum: {', '.join(output.choices)}" if output.choices else output.units.replace(TEXT, "text"))
                for stage in all_stages() for output in stage.outputs}
    assert shown == declared


def test_a_page_that_lacks_a_table_or_has_another_is_refused():
    for page in (PAGE.replace("<!-- datasets: beam -->\n", ""), PAGE + "<!-- datasets: other -->\n<!-- end -->\n"):
        with pytest.raises(ValueError, match=r"beam|other"):
            TABLES["current"](page)
    moved = PAGE.replace("| `depth` | (D,) |", "| `depth` | (D, 2) |")
    assert moved != PAGE and TABLES["current"](moved) == PAGE


def group_of(stage, lengths) -> Group:
    """A group with every dataset that a stage declares, of the declared shapes, wherever they stand."""
    root = Group()
    for output in stage.outputs:
        group = root
        *above, name = [part.lower() + "s" if part.isupper() else part for part in output.path.split("/")]
        for part in above:
            group = group.members.setdefault(part, Group())
        shape = [int(number) if number else lengths[letter] + int((sign or "+") + (more or "0"))
                 for letter, sign, more, number in conform._TERM.findall(output.shape)] if output.units != TEXT else [2]
        kind = np.uint8 if output.units == TEXT or output.choices else np.int64 if output.whole else float
        group.members[name] = Dataset(np.zeros(shape, kind), output.units, output.description, output.choices)
    return root


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: f"{stage.name}-{'-'.join(stage.needs)}")
def test_every_declared_shape_is_enforced(stage):
    """A dataset with another number of axes, and one whose axis is longer than elsewhere in the group, are named."""
    lengths = {letter: 3 + i % 3 for i, letter in enumerate("ABCDFGHJKLMNOPQRSTUVXYZ")}
    group = group_of(stage, lengths)

    def faults(group):
        return list(conform._outputs(stage.name, group, stage.outputs, {"L": lengths["L"]}))

    assert not faults(group)
    for output in stage.outputs:
        path = "/".join(part.lower() + "s" if part.isupper() else part for part in output.path.split("/"))
        above, _, name = path.rpartition("/")
        members = (group[above] if above else group).members
        good = members[name]
        members[name] = replace(good, data=np.zeros((1, 2, 3, 4, 5), good.data.dtype))
        assert any(fault.startswith(f"{stage.name}/{path}: ") for fault in faults(group)), f"{path}: any number of axes passes"
        if "L" in output.shape:
            axis = [term[0] for term in conform._TERM.findall(output.shape)].index("L")
            members[name] = replace(good, data=np.repeat(good.data, 2, axis=axis))
            assert faults(group), f"{path}: another number of wavelengths passes"
        members[name] = good
