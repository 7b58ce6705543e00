"""`bake`, `bake plan`, `bake cache` as a user calls them."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from bakery.store.read import read
from tests.conftest import ROOT


def test_bake_writes_and_says_where(call, milk, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = call("milk.yaml")
    assert status == 0 and out == "milk.h5\n", err
    assert "medium: " in err
    status, out, err = call("milk.yaml")
    assert status == 0 and out == "milk.h5\n" and err == "milk.h5 is up to date\n"


def test_where_the_asset_goes(call, milk, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    assert call("bake", milk, "-o", "out/")[1] == "out/milk.h5\n"
    assert call("-o", "x.h5", milk)[1] == "x.h5\n"
    for output, said in (("out", "is a folder"), ("missing/x.h5", "folder does not exist"), ("missing/", "folder does not exist"),
                         ("/dev/null", "pipe or device")):
        status, out, err = call(milk, "-o", output)
        assert status == 2 and said in err and not out, (output, err)


def test_a_link_is_kept_and_its_target_replaced(call, milk, tmp_path):
    (tmp_path / "real.h5").write_bytes(b"bakery-asset 1, and damaged")
    (tmp_path / "link.h5").symlink_to("real.h5")
    assert call(milk, "-o", tmp_path / "link.h5")[0] == 0
    assert (tmp_path / "link.h5").is_symlink() and read(tmp_path / "real.h5").attributes["name"] == "milk"


def test_several_recipes(call, milk, drops, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = call(milk, drops, "-o", "./")
    assert status == 0 and out == "milk.h5\ndrops.h5\n"
    assert [line.split(": ")[:2] for line in err.splitlines()] == [[str(milk), "medium"], [str(drops), "optics"],
                                                                   [str(drops), "medium"]]
    assert call(milk, drops, "-o", "one.h5")[0] == 2
    assert "both become" in call(milk, milk)[2]
    assert call(milk, drops, "--depfile", "d")[0] == 2


def test_only_what_changed_runs_again(call, drops, tmp_path):
    asset = tmp_path / "drops.h5"
    assert call(drops, "-o", asset)[0] == 0
    drops.write_text(drops.read_text().replace("1e8 /m^3", "2e8 /m^3") + "# a remark\n")
    status, out, _ = call("plan", drops, "-o", asset, "--json")
    steps = {step["stage"]: step for step in json.loads(out)[0]["steps"]}
    assert steps["optics"]["action"] == "reuse" and steps["medium"]["action"] == "run"
    assert any("particles.number_density" in why for why in steps["medium"]["why"])
    status, out, _ = call(drops, "-o", asset, "--json")
    did = {step["stage"]: step["source"] for step in json.loads(out)[0]["steps"]}
    assert did == {"optics": "unchanged", "medium": "computed"}
    # a remark alone rewrites the recipe's text, and no stage
    drops.write_text(drops.read_text() + "# another\n")
    status, out, _ = call(drops, "-o", asset, "--json")
    report = json.loads(out)[0]
    assert report["written"] and {step["source"] for step in report["steps"]} == {"unchanged"}


def test_plan_is_what_bake_does(call, drops, tmp_path):
    asset = tmp_path / "drops.h5"
    planned = json.loads(call("plan", drops, "-o", asset, "--json")[1])[0]
    dry = json.loads(call(drops, "-o", asset, "--dry-run", "--json")[1])[0]
    assert not asset.exists()
    # memory and seconds count what this process has loaded and compiled by now
    for plan in (planned, dry):
        for part in (plan, *plan["steps"]):
            assert part.pop("memory") > 0 and part.pop("seconds") > 0
            part.pop("basis", None)
    assert planned == dry
    report = json.loads(call(drops, "-o", asset, "--json")[1])[0]
    assert [s["input_hash"] for s in report["steps"]] == [s["input_hash"] for s in planned["steps"]]
    assert 0.5 < asset.stat().st_size / planned["file"] < 2.0
    text = call("plan", drops, "-o", asset)[1]
    assert "up to date, nothing to do" in text and f"unchanged in {asset}" in text


def test_overrides_are_recorded(call, milk, tmp_path):
    asset = tmp_path / "a.h5"
    status, _, err = call(milk, "-o", asset, "--tolerance", "2%", "--set", "medium.phase.g=0.5", "--seed", "7")
    assert status == 0, err
    root = read(asset)
    recipe = root["recipe"].data.tobytes().decode()
    assert "2%" in recipe and "g: 0.5" in recipe and "seed: 7" in recipe
    assert root["medium"].attributes["tolerance"] == 0.02
    assert call(milk, "-o", asset, "--quality", "draft")[0] == 0
    assert read(asset)["medium"].attributes["tolerance"] == 0.1


@pytest.mark.parametrize(("arguments", "said"), [
    (["--set", "medium.fase.g=0.5"], "phase"),
    (["--set", "novalue"], "KEY=VALUE"),
    (["--quality", "best"], "draft, preview, final"),
    (["--tolerance", "lots"], "lots"),
    (["--stage", "optic"], "medium"),
    (["--scene", "s.xml"], "no such scene"),
    (["--jobs", "0"], "jobs"),
    (["--nonsense"], "nonsense"),
])
def test_wrong_options_are_told(call, milk, tmp_path, arguments, said):
    status, out, err = call(milk, "-o", tmp_path / "a.h5", *arguments)
    assert status == 2 and said in err and not out and not (tmp_path / "a.h5").exists(), err


def test_every_problem_of_every_recipe_at_once(call, milk, tmp_path):
    text = milk.read_text()
    milk.write_text(text.replace("g: 0.7", "g: 1.7").replace("albedo", "albdo"))
    other = tmp_path / "other.yaml"
    other.write_text(text.replace("bakery: 1", "bakery: 7"))
    status, _, err = call(milk, other)
    assert status == 2 and "milk.yaml:" in err and "other.yaml:1" in err and "albedo" in err and "1.7" in err
    assert "Traceback" not in err
    status, out, _ = call("plan", milk, "--json")
    problems = json.loads(out)["problems"]
    assert status == 2 and {"file", "line", "column", "key", "found", "expected"} <= set(problems[0])


def test_first_word(call, tmp_path):
    status, _, err = call("plann")
    assert status == 2 and "did you mean plan?" in err
    assert "did you mean inspect fog.h5?" in call("fog.h5")[2]
    status, _, err = call(tmp_path / "none.yaml")
    assert status == 2 and "none.yaml" in err
    assert call("--help")[0] == 0 and call("bake", "--help")[0] == 0 and call("--version")[1].startswith("bakery ")


@pytest.mark.slow
def test_same_bytes_in_other_surroundings(call, command, drops, tmp_path):
    assert call(drops, "-o", tmp_path / "here.h5")[0] == 0
    extra = {"PYTHONHASHSEED": "7", "LC_ALL": "C", "TZ": "Asia/Tokyo", "PYTHONOPTIMIZE": "1"}
    done = command(drops, "-o", tmp_path / "there.h5", "--force", cwd=tmp_path / "..", env=extra, timeout=240)
    assert done.returncode == 0, done.stderr
    here, there = (read(tmp_path / name).attributes["content_hash"] for name in ("here.h5", "there.h5"))
    assert here == there


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("make") is None, reason="make is the test")
def test_make_rebuilds_only_what_changed(milk, tmp_path):
    (tmp_path / "Makefile").write_text(
        f"milk.h5: milk.yaml\n\t{sys.executable} -m bakery milk.yaml -o milk.h5 --depfile milk.d\n-include milk.d\n")
    (tmp_path / "phase.csv").write_text("theta_deg,value\n0,2\n180,1\n")
    milk.write_text(milk.read_text().replace("{type: hg, g: 0.7}", "{type: table, file: phase.csv}"))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}

    def make():
        return subprocess.run(["make"], cwd=tmp_path, env=environment, check=True, capture_output=True, text=True).stdout

    assert "milk.h5" in make()
    assert "up to date" in make()
    os.utime(milk)  # touched, not changed: one bake that does nothing, then peace
    assert "python" in make()
    assert "is up to date" in make() and "python" not in make()
    assert "phase.csv" in (tmp_path / "milk.d").read_text()


@pytest.mark.slow
def test_files_read_are_files_named(drops, tmp_path):
    """Every file below the recipe's folder or assets/ that a bake opens for reading is in its depfile."""
    code = (
        "import sys, os\n"
        "opened = set()\n"
        "def watch(event, args):\n"
        "    if event == 'open' and isinstance(args[0], (str, bytes)) and not (args[2] or 0) & (os.O_WRONLY | os.O_RDWR):\n"
        "        opened.add(os.path.realpath(os.fsdecode(args[0])))\n"
        "sys.addaudithook(watch)\n"
        "from bakery.cli import status_of\n"
        f"assert status_of([{str(drops)!r}, '-o', {str(tmp_path / 'a.h5')!r}, '--depfile', {str(tmp_path / 'a.d')!r}]) == 0\n"
        f"places = ({str(tmp_path)!r}, {str(ROOT / 'assets')!r})\n"
        "data = [p for p in opened if p.startswith(places) and not p.endswith(('.part', '.h5')) and os.path.isfile(p)]\n"
        "print('\\n'.join(data))\n")
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, text=True,
                          capture_output=True, timeout=240)
    assert done.returncode == 0, done.stderr
    named = {os.path.realpath(tmp_path / line.strip(" \\:")) for line in (tmp_path / "a.d").read_text().splitlines()}
    read_files = [line for line in done.stdout.splitlines() if os.path.isfile(line) and not line.endswith(".d")]
    assert len(read_files) >= 2 and set(read_files) <= named, (read_files, named)


@pytest.mark.parametrize("asked", [None, "3"])
def test_one_thread_of_matrices_unless_asked_for_more(asked):
    code = ("import os, sys\nfrom bakery.cli import main\nassert 'numpy' not in sys.modules\n"
            "try:\n    main(['--help'])\nfinally:\n    print('threads', os.environ['OPENBLAS_NUM_THREADS'])\n")
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    environment |= {"PYTHONPATH": str(ROOT)} | ({"OPENBLAS_NUM_THREADS": asked} if asked else {})
    done = subprocess.run([sys.executable, "-c", code], env=environment, text=True, capture_output=True, timeout=60)
    assert done.stdout.splitlines()[-1] == f"threads {asked or 1}", done.stderr


def test_python_does_what_the_command_does(drops, tmp_path):
    import bakery

    asset = bakery.bake(drops, output=tmp_path / "a.h5")
    assert asset.path == str(tmp_path / "a.h5") and asset.medium.sigma_t.shape == (1,)
    assert bakery.open(asset).content_hash == asset.content_hash  # it passes for its path


@pytest.mark.slow
def test_assets_of_texts_and_dicts_stand_in_a_folder_that_goes(milk, tmp_path, monkeypatch):
    """Two of one name are two files, nothing is written beside them, and the folder ends with the process."""
    import subprocess
    import sys

    monkeypatch.chdir(tmp_path)
    script = (f"import bakery\ntext = open({str(milk)!r}).read()\n"
              "a, b = bakery.bake(text), bakery.bake(text, settings={'tolerance': '20%'})\n"
              "assert a.path != b.path and bakery.open(a).content_hash == a.content_hash != b.content_hash\n"
              "print(a.path)")
    before = sorted(tmp_path.iterdir())
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert sorted(tmp_path.iterdir()) == before and not os.path.exists(done.stdout.strip())


@pytest.mark.usefixtures("verified_here")
def test_a_missed_tolerance_is_status_3_each_time(call, drops, tmp_path):
    out = tmp_path / "drops.h5"
    for _ in range(2):  # computed, then up to date
        status, said, err = call("bake", drops, "-o", out, "--set", "phase.radii=4")
        assert status == 3 and str(out) in said and "optics: its error is" in err and "phase.radii" in err
    assert "missed optics: its error is" in call("plan", drops, "-o", out, "--set", "phase.radii=4")[1]
    assert call("verify", out)[0] == 0
    assert call("bake", drops, "-o", out)[0] == 0
