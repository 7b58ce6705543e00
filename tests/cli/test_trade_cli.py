"""`bake trade` as a user calls it."""

import csv
import json
import os
import signal
import subprocess
import sys
import time

import pytest

import bakery.trade
from bakery.trade import times
from tests.conftest import ROOT
from tests.traded import RECIPE


@pytest.fixture
def recipe(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    (tmp_path / "drops.yaml").write_text(RECIPE)
    return tmp_path / "drops.yaml"


@pytest.mark.slow
def test_a_real_recipe(call, recipe, tmp_path, monkeypatch):
    """The optics of small drops, in the worker's process: true errors below the claimed, all files, a second call that reuses."""
    monkeypatch.setattr(bakery.trade, "STAGES", "tests.traded:optics")
    monkeypatch.setattr(times, "least_repeats", lambda seconds: 2)
    monkeypatch.setattr(times, "MOST", 2)  # how sure of its times it is, is not looked at here
    status, out, err = call("trade", "drops.yaml", "--verbose")
    assert status == 0, err
    for words in ("error of ", "5 %", "bake drops.yaml", "draft (tolerance=10%): ", "final (as it stands): "):
        assert words in out
    assert "optics: as it stands: " in err and "converged values" in err
    folder = tmp_path / "drops.trade"
    assert {file.name for file in folder.iterdir()} == {"trade.csv", "trade.json", "optics.png", "runs", "reference"}
    assert (folder / "optics.png").read_bytes().startswith(b"\x89PNG")
    (stage,) = json.loads((folder / "trade.json").read_text())["stages"]
    assert stage["complete"] and stage["errors"][:2] == ["error", "phase"]
    for run in stage["runs"]:
        # the stage claims the largest relative error at any angle, the integrated one cannot be larger; each counts against
        # values that are converged within what they claim
        claimed = run["achieved_error"] + stage["reference"]["achieved"]
        assert 0 < run["errors"]["phase"] <= claimed and 0 < run["errors"]["phase_pointwise"] <= claimed
        assert run["repeats"] == 2 and run["seconds"] > 0
    by_setting = {run["setting"].get("tolerance"): run["errors"]["phase_pointwise"] for run in stage["runs"]}
    assert by_setting["30%"] > by_setting[None]
    with open(folder / "trade.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["true phase"]) for row in rows] == [run["errors"]["phase"] for run in stage["runs"]]
    assert [row["preset"] for row in rows][:3] == ["final", "draft", "preview"]
    status, out, _ = call("trade", "drops.yaml", "--json")
    (again,) = json.loads(out)["stages"]
    assert status == 0 and again["reused"] == len(stage["runs"])
    assert [run["errors"] for run in again["runs"]] == [run["errors"] for run in stage["runs"]]


def test_wrong_calls(call, recipe, milk, tmp_path):
    for args, said in (((milk,), "none of its stages (medium) has knobs that trade time for accuracy"),
                       (("drops.yaml", "--stage", "fog"), '--stage: found "fog"; this recipe has the stages'),
                       (("drops.yaml", "--stage", "medium"), "medium has no knobs that trade time for accuracy"),
                       (("drops.yaml", "--budget", "0"), "--budget: found 0; expected a number of minutes above 0"),
                       (("drops.yaml", "--quality", "best"), '--quality: found "best"; expected draft, preview, final'),
                       (("drops.yaml", "--set", "tolerance"), "expected KEY=VALUE"),
                       (("drops.yaml", "--set", "tolerance=200%"), "tolerance"),
                       (("drops.yaml", "--budget", "1e-5"), "use --budget "),
                       (("drops.yaml", "-o", "drops.yaml"), "found a file where a folder should be"),
                       (("missing.yaml",), "missing.yaml")):
        status, out, err = call("trade", *args)
        assert status == 2 and said in err and not out, (args, err)
    assert not (tmp_path / "drops.trade").exists()


@pytest.mark.slow
def test_an_interrupt_leaves_what_is_finished(recipe, tmp_path):
    """Ctrl-C goes to the command and its worker alike; nothing half written stays, and the next call takes up what is there."""
    code = ("import bakery.trade, sys\nbakery.trade.STAGES = 'tests.traded:slow'\nfrom bakery.cli import main\n"
            "main(['trade', 'drops.yaml', '-o', 'out'])")
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               start_new_session=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
    runs, until = tmp_path / "out" / "runs", time.monotonic() + 60
    while time.monotonic() < until and not list(runs.glob("*.json")) and process.poll() is None:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130 and not out
    assert "interrupted; finished runs are kept, and the same call continues" in err and "Traceback" not in err
    files = list(runs.iterdir())
    assert files and all(json.loads(file.read_text())["run"]["seconds"] for file in files)
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"runs", "reference"}
    with pytest.raises(ProcessLookupError):
        for _ in range(100):  # the worker ends with the command
            os.killpg(process.pid, 0)
            time.sleep(0.1)
