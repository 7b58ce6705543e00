"""A stage is its folder and one line in a list: with them it is found in every command."""

import json
import os

import numpy as np
import pytest

import bakery
import bakery.stages
from bakery.errors import RecipeError
from bakery.recipe import load, schema
from tests.conftest import ROOT

RECIPE = """\
bakery: 1
name: hall
wavelengths: [0.6, 0.5]
tolerance: {tolerance}
echo: {{reflected: 0.5}}
"""
PLACE = "tests.toy.stage:STAGE"


@pytest.fixture(scope="module", autouse=True)
def _house():
    """The toy is in the list, in this process and in those that it starts."""
    def forget():
        for known in (bakery.stages.all_stages, schema.sections, schema.recipe_file):
            known.cache_clear()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bakery.stages, "STAGES", (*bakery.stages.STAGES, PLACE))
        patch.setenv("PYTHONPATH", os.pathsep.join(map(str, (ROOT / "tests" / "toy" / "start", ROOT))))
        forget()
        yield
    forget()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """hall.yaml, and hall.h5 baked of it."""
    folder = tmp_path_factory.mktemp("hall")
    (folder / "hall.yaml").write_text(RECIPE.format(tolerance="1%"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        bakery.bake(folder / "hall.yaml", folder / "hall.h5")
    return folder


@pytest.fixture
def hall(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


def test_recipe_and_its_schema(hall, call):
    recipe = load("hall.yaml")
    assert recipe.echo.reflected == 0.5 and recipe.echo.terms is None and recipe.leaves["echo.terms"] == "auto"
    with pytest.raises(RecipeError, match="bad luck"):
        load("hall.yaml", {"echo.terms": "13"})
    status, out, _ = call("schema")
    assert status == 0 and "echo" in json.loads(out)["properties"] and "wall of the toy" in out


def test_plan_and_bake(hall, call):
    status, out, err = call("plan", "hall.yaml", "--json")
    assert status == 0, err
    (plan,) = json.loads(out)
    assert [step["stage"] for step in plan["steps"]] == ["echo"]
    assert call("bake", "hall.yaml", "--quality", "draft", "-o", "other.h5")[0] == 0


def test_open(hall):
    asset = bakery.open("hall.h5")
    assert list(asset.stages) == ["echo"]
    np.testing.assert_allclose(asset.echo.loudness, 1 / (1 - np.array([0.5 / 1.2, 0.5])), rtol=0.01)
    np.testing.assert_array_equal(asset.echo.louder(2.0), 2 * np.asarray(asset.echo.loudness))
    assert "echo  error" in repr(asset)
    with pytest.raises(bakery.AssetError, match="a section `beam` and bake it again"):
        asset.beam  # noqa: B018
    with pytest.raises(AttributeError, match="no attribute 'ech'"):
        asset.ech  # noqa: B018


def test_inspect_and_query(hall, call):
    status, out, _ = call("inspect", "hall.h5")
    assert status == 0 and "stage echo, version 1" in out and "sum of all echoes" in out
    status, out, _ = call("query", "hall.h5", "echo/loudness", "wavelength=0.5um", "--json")
    found = json.loads(out)
    assert status == 0 and found["axes"] == [] and found["remarks"] == ["echoes of a toy"] and found["methods"] == [{"walls": 2}]
    status, out, _ = call("query", "hall.h5", "echo", "times=3", "--json")
    assert status == 0 and json.loads(out)["value"][1] == pytest.approx(3 * found["value"])
    status, _, err = call("query", "hall.h5", "echo/loudness", "volume=3")
    assert status != 0 and "of echo times=2" in err


def test_pictures_page_and_tables(hall, call, tmp_path):
    assert call("plot", "hall.h5", "-o", tmp_path)[0] == 0
    assert {path.name for path in tmp_path.iterdir()} == {f"hall_echo.{form}" for form in ("png", "svg", "csv")}
    assert call("report", "hall.h5", "-o", tmp_path / "hall.html")[0] == 0
    page = (tmp_path / "hall.html").read_text()
    assert all(words in page for words in ("<h2>Echoes</h2>", "Heard twice.", "Echoes heard", "echo/loudness"))
    assert "No rendered picture" not in page  # no renderer knows what to do with an echo
    assert call("export", "hall.h5", "--to", "csv", "-o", tmp_path)[0] == 0
    assert (tmp_path / "hall_echo.txt").read_text() == "heard\n" and not list(tmp_path.glob("*echo_by*"))


def test_verify_and_diff(hall, call, tmp_path):
    from bakery.asset.verify import contract, physics
    from bakery.store.read import read
    from bakery.store.tree import Dataset

    status, out, _ = call("verify", "hall.h5")
    assert status == 0, out
    root = read("hall.h5")
    root["echo"].members["loudness"] = Dataset(np.array([0.5, 2.0]), "1", "sum")
    assert physics(root) == ["echo: loudness below that of the first sound"]
    root["echo"].members["loudness"] = Dataset(np.array([1.5]), "1", "sum")
    assert any("echo/loudness" in fault for fault in contract(root))
    assert call("bake", "hall.yaml", "--set", "echo.terms=2", "-o", tmp_path / "two.h5")[0] in (0, 3)
    status, out, _ = call("diff", "hall.h5", tmp_path / "two.h5")
    assert status == 1 and "echo/loudness" in out


@pytest.mark.slow
def test_trade(hall, call):
    status, out, err = call("trade", "hall.yaml", "-o", "traded")
    assert status == 0, err
    (stage,) = json.loads((hall / "traded" / "trade.json").read_text())["stages"]
    assert stage["stage"] == "echo" and stage["complete"]
    errors = {run["setting"].get("echo.terms"): run["errors"]["error"] for run in stage["runs"]}
    assert errors["1"] == pytest.approx(0.5, abs=0.01) and errors["1"] > errors["4"] > errors[None]
