"""Commands that take longer than a moment say that they are at work."""

import pytest

from bakery.cli import TELLING, status_of
from bakery.run.progress import Lines


@pytest.mark.parametrize("command", ["verify", "inspect", "plot", "report"])
def test_a_command_on_an_asset_names_itself_while_it_lasts(command, monkeypatch, capsys):
    told = []
    monkeypatch.setattr(Lines, "begin", lambda self, text: told.append(text))
    monkeypatch.setattr(Lines, "close", lambda self: told.append("closed"))
    assert status_of([command, "missing.h5"]) != 0
    assert told == [f"bake {command}", "closed"] and command not in TELLING


def test_a_bake_says_what_it_does_besides_the_stages(tmp_path, monkeypatch, capsys):
    told = []
    monkeypatch.setenv("BAKERY_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Lines, "begin", lambda self, text: told.append(text))
    (tmp_path / "milk.yaml").write_text(
        "bakery: 1\nname: milk\nwavelengths: [0.55]\ntolerance: 10%\nmedium: {albedo: 0.9, mean_free_path: 1 mm, "
        "phase: {type: hg, g: 0.5}}\n")
    assert status_of(["milk.yaml"]) == 0
    assert told == ["reading milk.yaml", "planning milk.yaml", "reading milk.h5", "starting workers",
                    "reading medium from the cache", "writing medium to the cache", "writing milk.h5"]
