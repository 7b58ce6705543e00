"""An exporter is a file and one line in a list: with them it is found in help, completion, messages and docs."""

import json
import re

import pytest

from bakery.export import formats
from bakery.store.write import write
from tests.conftest import ROOT
from tests.samples import small_asset


@pytest.fixture(autouse=True)
def _listed(monkeypatch):
    monkeypatch.setattr(formats, "EXPORTERS", (*formats.EXPORTERS, "tests.toy.exporter:EXPORTER"))
    formats.exporters.cache_clear()
    yield
    formats.exporters.cache_clear()


def test_every_command_has_it(call, tmp_path):
    write(tmp_path / "a.h5", small_asset())
    out = " ".join(call("export", "--help")[1].split())
    assert "note: the albedo in a line of text" in out and "--digits N note: of each number." in out
    status, out, err = call("export", "--list")
    assert status == 0 and not err and out.endswith(
        "note: the albedo in a line of text\n  for: people\n  takes: stage medium\n  holds: the albedo\n  loses: all else\n"
        "  --digits N: of each number.\n")
    listed = json.loads(call("export", "--list", "--json")[1])[-1]
    assert (listed["name"], listed["takes"], listed["options"]) == ("note", ["medium"], {"--digits": "of each number."})
    status, out, err = call("export", tmp_path / "a.h5", "--to", "note", "--digits", "2", "--json")
    assert status == 0 and json.loads(out) == {"files": [str(tmp_path / "a-note" / "a.note")], "lost": [{"digits": 2}],
                                               "warnings": ["a note is no medium"]}
    assert "warning: a note is no medium" in err
    assert "all but the albedo is lost" in call("export", tmp_path / "a.h5", "--to", "note")[2]
    for arguments, words in ((("csv", "--digits", "2"), "--digits: has no effect on csv; it is for note"),
                             (("note", "--digits", "few"), '--digits: found "few"; expected a number'),
                             (("none",), "xyz, note (note?); `bake export --list` says what each holds"),
                             (("note", "--each-wavelength"), "has no effect on note; it is for mitsuba")):
        status, out, err = call("export", tmp_path / "a.h5", "--to", *arguments)
        assert status == 2 and not out and words in err


def test_docs_say_what_formats_declare():
    page = (ROOT / "docs" / "export.md").read_text()
    rows = {match[1]: match[2] for match in re.finditer(r"^\| \[?`(\w+)`[^|]*\| (.*) \|$", page, re.MULTILINE)}
    known = {name: one for name, one in formats.exporters().items() if name != "note"}
    assert known.keys() == rows.keys()
    for name, exporter in known.items():
        assert rows[name].startswith(f"{exporter.program} | {exporter.holds} | {exporter.loses} | ")
    assert f"Formats: {', '.join(known)}." in (ROOT / "docs" / "cli.md").read_text()
