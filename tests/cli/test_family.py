"""Families on the command line."""

import json

import pytest

import bakery
from tests.failing import fails_at
from tests.unit.test_families import LOBES

SWEEP = "medium.mean_free_path=[1, 4] mm"


@pytest.fixture(scope="module")
def lobes(tmp_path_factory):
    """A plain family of three."""
    folder = tmp_path_factory.mktemp("lobes")
    (folder / "lobes.yaml").write_text(LOBES)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        bakery.bake(folder / "lobes.yaml", folder / "lobes.h5", settings={"sweep.refine": "false"})
    return folder / "lobes.h5"


def test_plan_and_bake(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lobes.yaml").write_text(LOBES.replace("[0.0, 0.5, 0.8]", "[0.1, 0.12]"))
    status, out, err = call("plan", "lobes.yaml", "--sweep", SWEEP)
    assert status == 0 and not err
    assert "lobes.yaml -> lobes.h5, members in lobes/" in out and "mean_free_path 2 values, 1 mm to 4 mm" in out
    assert "4 points, by the plans of 4" in out and "4 places between them at least" in out
    assert "4 points of 8 places in the end, by a pilot" in out and "before any is added" not in out
    report = json.loads(call("plan", "lobes.yaml", "--sweep", SWEEP, "--json")[1])[0]
    assert report["points"] == 4 and report["axes"][0]["values"] == [0.001, 0.004] and report["axes"][0]["units"] == "m"
    status, out, err = call("bake", "lobes.yaml", "--sweep", SWEEP, "--depfile", "lobes.d", "-v")
    assert status == 0 and out == "lobes.h5\n" and "cubic between them, error" in err and "written" in err
    assert (tmp_path / "lobes.d").read_text().startswith("lobes.h5: ")
    names = sorted(path.name for path in (tmp_path / "lobes").iterdir())
    assert names == [f"mean_free_path_{path}-g_{g}.h5" for path in ("0.001", "0.004") for g in ("0.1", "0.12")]
    assert call("bake", "lobes.yaml", "--sweep", SWEEP) == (0, "lobes.h5\n", "lobes.h5 is up to date\n")
    family = bakery.open("lobes.h5")
    assert family.at(g=0.11, mean_free_path="2 mm").medium.sigma_t[0] == pytest.approx(500)
    assert family.at(g=0.11, mean_free_path=2e-3).medium.sigma_t[0] == pytest.approx(500)


@pytest.mark.parametrize("options, says", [
    (["--sweep", "medium.phase.g"], "--sweep: found \"medium.phase.g\"; expected KEY=VALUE"),
    (["--sweep", "medium.phase.gg=[0.1, 0.2]"], 'found the unknown key "gg"'),
    (["--set", "multiple_scattering={}", "--sweep", "multiple_scattering.length=[1, 2]"], "changes nothing of the medium"),
    (["-o", "fresh"], "name it fresh.h5"),
    (["--sweep", "medium.albedo=[0.1, 0.2]", "--sweep", "medium.albedo=0.5"],
     '--sweep: found "medium.albedo=[0.1, 0.2]" and "medium.albedo=0.5"; give each once'),
    (["--sweep", "medium.albedo=[0.1, 0.2]", "--set", "sweep.medium.albedo=0.5"],
     '--sweep: found "medium.albedo=[0.1, 0.2]", and --set "sweep.medium.albedo=0.5"; give each once'),
])
def test_wrong_calls(call, lobes, monkeypatch, options, says):
    monkeypatch.chdir(lobes.parent)
    status, out, err = call("plan", "lobes.yaml", *options)
    assert status == 2 and says in err and not out


def test_what_knows_one_asset_says_so(call, lobes, milk):
    for words in (["trade", lobes.with_suffix(".yaml")], ["export", lobes, "--to", "csv"], ["report", lobes]):
        status, out, err = call(*words)
        assert status == 2 and not out and "family" in err
    assert "a single asset is needed" in call("trade", lobes.with_suffix(".yaml"))[2]
    assert "--at g=… interpolates one asset" in call("export", lobes, "--to", "csv")[2]
    assert call("bake", milk, "-o", milk.with_suffix(".h5"))[0] == 0
    assert "is one asset, not a family" in call("query", milk.with_suffix(".h5"), "medium/g", "--at", "g=0.5")[2]


def test_an_asset_is_no_recipe(call, lobes):
    for command in "bake", "plan", "trade":
        status, out, err = call(command, lobes)
        assert status == 2 and not out
        assert err.endswith(f"{lobes}: found an asset; expected a recipe, which is text; `bake inspect` shows what an "
                            "asset holds\n")


def test_query_inspect_and_export_a_place(call, lobes):
    status, out, err = call("query", lobes, "medium/g", "--at", "g=0.5")
    assert status == 0 and float(out.splitlines()[1].split()[1]) == pytest.approx(0.5, abs=1e-3)
    status, out, err = call("query", lobes, "medium/g")
    assert status == 2 and "--at says which" in err
    status, out, err = call("query", lobes, "medium/g", "--at", "g=0.3", "--at", "g=0.2")
    assert status == 2 and err == '--at: found "g=0.3" and "g=0.2"; give each once\n'
    status, out, err = call("inspect", lobes)
    assert status == 0 and "a family of 3 assets, cubic between them, not measured" in out
    assert "g: 0, 0.5, 0.8 (medium.phase.g)" in out
    assert len(json.loads(call("inspect", lobes, "--json")[1])["family"]["members"]) == 3
    status, out, err = call("export", lobes, "--to", "csv", "--at", "g=0.25")
    assert status == 0 and str(lobes.with_name("lobes_g_0.25-csv")) in out


def test_points_that_failed_are_not_counted(call, tmp_path, monkeypatch):
    fails_at(monkeypatch, 0.5, ValueError("no such lobe"))
    (tmp_path / "lobes.yaml").write_text(LOBES.replace("albedo: 0.9\n  mean_free_path: 1 mm", "sigma_s: 1 /mm\n  sigma_a: 1 /m"))
    call("bake", tmp_path / "lobes.yaml", "-o", tmp_path / "lobes.h5", "--set", "sweep.refine=false",
         "--sweep", "medium.sigma_s=[1, 2] /mm")
    out = call("inspect", tmp_path / "lobes.h5")[1]
    assert "a family of 4 assets (2 points failed), " in out and "  g 0.5, sigma_s 1000 /m: phase function hg: no such" in out
    assert "is a family of 4 assets (2 points failed)" in call("export", tmp_path / "lobes.h5", "--to", "csv")[2]


def test_keep_going_bakes_the_points_that_are_not_wrong(call, tmp_path, monkeypatch):
    """And names those that are; without it nothing is baked.  Also where the first value of an axis is the wrong one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lobes.yaml").write_text(LOBES.replace("[0.0, 0.5, 0.8]", "[0.0, 0.5, 1.8]"))
    status, out, err = call("lobes.yaml", "--set", "sweep.refine=false")
    assert (status, out) == (2, "") and 'lobes.yaml:10: medium.phase.g: found "1.8"' in err and not (tmp_path / "lobes").exists()
    status, out, err = call("lobes.yaml", "--set", "sweep.refine=false", "--keep-going")
    assert (status, out) == (3, "lobes.h5\n") and 'point failed: g 1.8: --set medium.phase.g: medium.phase.g: found "1.8"' in err
    assert [bool(member.reason) for member in bakery.open("lobes.h5").members] == [False, False, True]
    words = ("lobes.yaml", "-o", "two.h5", "--set", "sweep.refine=false", "--sweep", "medium.phase.g=[-1.8, 0.1, 0.2]",
             "--sweep", "medium.albedo=[0.5, 0.9]", "-k")
    status, out, err = call(*words)
    assert (status, out) == (3, "two.h5\n") and "point failed: albedo 0.5, g -1.8" in err
    assert [bool(member.reason) for member in bakery.open("two.h5").members] == [True, False, False] * 2
    status, out, err = call("lobes.yaml", "-k", "--sweep", "medium.phase.g=[2, 3]")
    assert (status, out) == (2, "") and 'found "2"' in err and 'found "3"' in err
    status, out, err = call("lobes.yaml", "-k", "--sweep", "medium.phase.g=[0.1, 0.2]", "--set", "medium.albdo=1")
    assert (status, out) == (2, "") and err.count("unknown key") == 1 and "the sweep says" not in err


def test_messages_name_the_swept_value(call, drops):
    """Where another key is blamed: its line shows the recipe's value, not that of the point."""
    status, _, err = call("plan", drops, "--sweep", "particles.components.droplets.size.min=[0.1, 0.2, 5] um")
    assert status == 2 and ("found max 3 um, not above min 5 um, where the sweep says that "
                            "particles.components.droplets.size.min is 5 um; expected min below max") in err


def test_query_names_the_axes_of_a_family(call, tmp_path, monkeypatch):
    monkeypatch.setenv("BAKERY_CACHE", str(tmp_path / "cache"))
    (tmp_path / "lobes.yaml").write_text(LOBES.replace("[0.0, 0.5, 0.8]", "[0.1, 0.5]"))
    settings = {"sweep.medium.mean_free_path": "[1, 4] mm", "sweep.refine": "false"}
    family = bakery.open(bakery.bake(tmp_path / "lobes.yaml", tmp_path / "lobes.h5", settings=settings))
    known = {name: (axis.values.units, axis.values.tolist()) for name, axis in family.axes.items()}
    assert known == {"g": ("1", [0.1, 0.5]), "mean_free_path": ("m", [0.001, 0.004])}
    for path, more in ("sigma_t", ["wavelength"]), ("phase", ["wavelength", "theta"]), ("members/achieved", []):
        axes = family.query(f"family/{path}").axes
        assert [name for name, _, _ in axes] == [*known, *more]
        assert {name: (unit, values.tolist()) for name, unit, values in axes[:2]} == known
    head = call("query", tmp_path / "lobes.h5", "family/sigma_t")[1].splitlines()[0].split("  ")
    assert head[1] == "sigma_t [1/m] at mean_free_path 0.001 m, g 0.1"
    forward = family.query("family/phase", theta=0.0, wavelength="550 nm")
    assert forward.values.shape == (2, 2) and [name for name, _, _ in forward.axes] == list(known)
    status, _, err = call("query", tmp_path / "lobes.h5", "family/sigma_t", "radius=5um")
    assert status == 2 and "radius has no effect on it; wavelength would" in err
    status, _, err = call("query", tmp_path / "lobes.h5", "family/sigma_t", "g=0.3")
    assert status == 2 and "family/sigma_t: g is an axis of the family; --at g=…" in err


@pytest.mark.parametrize(("target", "ending", "says"), [
    ("pbrt", "pbrt", 'MakeNamedMedium "lobes_g_0_{}"'), ("mitsuba", "xml", '<medium type="homogeneous" id="lobes_g_0_{}">'),
    ("materialx", "mtlx", '<surfacematerial name="lobes_g_0_{}_volume"'), ("usd", "usda", 'defaultPrim = "lobes_g_0_{}"'),
    ("blender", "py", 'NAME = "lobes_g_0_{}"'),
])
def test_two_places_stand_in_one_scene(call, lobes, tmp_path, target, ending, says):
    for digits in "25", "3":
        status, out, _ = call("export", lobes, "--to", target, "--at", f"g=0.{digits}", "-o", tmp_path)
        assert status == 0 and out == f"{tmp_path}/lobes_g_0.{digits}.{ending}\n"
        assert says.format(digits) in (tmp_path / f"lobes_g_0.{digits}.{ending}").read_text()


def test_members_and_saved_places_stand_in_one_scene(call, lobes, tmp_path):
    saved = bakery.open(lobes).at(g=0.3).save(tmp_path / "place.h5")
    for asset, name in (lobes.with_suffix("") / "g_0.5.h5", "lobes_g_0_5"), (saved, "lobes_place"):
        assert call("export", asset, "--to", "pbrt", "-o", tmp_path)[0] == 0
        assert f'MakeNamedMedium "{name}"' in (tmp_path / f"{asset.stem}.pbrt").read_text()


def test_query_answers_texts_of_members(call, lobes):
    status, out, _ = call("query", lobes, "family/members/file")
    assert status == 0 and [line.split() for line in out.splitlines()[1:]] == [
        ["0.0", "lobes/g_0.h5"], ["0.5", "lobes/g_0.5.h5"], ["0.8", "lobes/g_0.8.h5"]]
    assert json.loads(call("query", lobes, "family/members/reason", "--json")[1])["value"] == ["", "", ""]


@pytest.mark.usefixtures("verified_here")
def test_verify_names_a_damaged_member(call, tmp_path, lobes):
    import shutil

    shutil.copytree(lobes.parent, tmp_path / "own")
    own = tmp_path / "own" / "lobes.h5"
    (tmp_path / "own" / "lobes" / "g_0.5.h5").write_bytes(b"no asset")
    status, out, err = call("verify", own)
    assert status == 1 and "member g 0.5:" in out and "not a bakery asset" in out and "g 0.8" not in out


def test_plot_and_diff(call, lobes, undrawn, tmp_path):
    status, out, err = call("plot", lobes, "-o", tmp_path)
    assert status == 0 and (tmp_path / "lobes_g.csv").read_text().startswith("g [1],point,sigma_t at 0.55 um")
    assert "lobes_g_phase.png" in out
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(lobes.parent / "cache"))
        bakery.bake(lobes.with_suffix(".yaml"), tmp_path / "one.h5", settings={"sweep.medium.phase.g": "0.5"})
    status, out, err = call("plot", tmp_path / "one.h5", "-o", tmp_path)  # of the only place
    assert status == 0 and "one_g_0.5_phase.png" in out
    assert call("diff", lobes, lobes)[:2] == (0, f"equal: {lobes} and {lobes}\n")
