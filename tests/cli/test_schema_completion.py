"""`bake schema` and `bake completion`: what editors and shells are given."""

import json
import os
import shutil
import subprocess
import sys

import pytest
from click.shell_completion import BashComplete

from bakery.cli import COMMANDS, cli
from bakery.grammar.qualities import QUALITIES
from bakery.store.write import write
from tests.conftest import ROOT
from tests.samples import small_asset


def test_schema_knows_the_sections_of_recipes(call):
    status, out, err = call("schema")
    schema = json.loads(out)
    assert status == 0 and not err and "json-schema.org" in schema["$schema"]
    assert {"bakery", "name", "wavelengths", "seed", "tolerance", "particles", "medium", "phase"} <= schema["properties"].keys()


def test_the_shipped_schema_is_the_printed_one(call):
    (shipped,) = (ROOT / "assets" / "schemas").glob("*.json")
    assert json.loads(shipped.read_text()) == json.loads(call("schema")[1])


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_scripts_are_what_the_shell_takes(call, shell, tmp_path):
    status, out, _ = call("completion", shell)
    assert status == 0 and "_BAKE_COMPLETE" in out
    if shutil.which(shell):
        (tmp_path / "script").write_text(out)
        subprocess.run([shell, "-n", str(tmp_path / "script")], check=True)


def test_an_unknown_shell(call):
    status, out, err = call("completion", "tcsh")
    assert status == 2 and not out and "bash" in err


def complete(*words: str) -> list[str]:
    """What bash is offered for the last word."""
    done = subprocess.run([sys.executable, "-m", "bakery"], capture_output=True, text=True, check=False, env=os.environ | {
        "PYTHONPATH": str(ROOT), "_BAKE_COMPLETE": "bash_complete", "COMP_WORDS": " ".join(words),
        "COMP_CWORD": str(len(words) - 1)})
    assert not done.stderr
    return [line.partition(",")[2] for line in done.stdout.splitlines() if line]


def test_commands_and_options_are_completed():
    assert complete("bake", "p") == [name for name in COMMANDS if name.startswith("p")]
    assert "--each-wavelength" in complete("bake", "export", "--e")


def test_values_are_completed(tmp_path, capfd):
    """Formats, qualities, stages, what is in an asset; nothing, and no complaint, where there is no asset to look into."""
    def complete(*words):
        offered = BashComplete(cli, {}, "bake", "_BAKE_COMPLETE").get_completions(list(words[1:-1]), words[-1])
        return [each.value for each in offered]

    write(tmp_path / "a.h5", small_asset())
    assert complete("bake", "export", str(tmp_path / "a.h5"), "--to", "c") == ["csv"]
    assert complete("bake", "render", "--quality", "") == complete("bake", "fog.yaml", "--quality", "") == list(QUALITIES)
    assert complete("bake", "fog.yaml", "--stage", "m") == ["medium", "multiple"]
    assert complete("bake", "query", str(tmp_path / "a.h5"), "medium/s") == [
        "medium/sigma_t", "medium/sigma_s", "medium/sigma_a", "medium/sigma_t_reduced", "medium/sigma_tr"]
    assert complete("bake", "inspect", str(tmp_path / "a.h5"), "op")[:2] == ["optics", "optics/theta"]
    (tmp_path / "notes.h5").write_text("not an asset")
    assert complete("bake", "query", str(tmp_path / "notes.h5"), "") == complete("bake", "query", "none.h5", "m") == []
    assert capfd.readouterr() == ("", "")
