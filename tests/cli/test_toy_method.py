"""A method of a renderer is a file and one line in a table: scenes, lists, compare, trade, plan, budget and pictures have it."""

from __future__ import annotations

import importlib
import json

import pytest

from bakery.errors import RecipeError
from renderers import scene
from renderers.materials.bodies.declaration import DIFFUSED, FEW, GATHERED, JOINED
from renderers.materials.particles import declared
from renderers.materials.particles import scene as rules
from renderers.scene import budget, entries
from tests.cli.test_render_discrete import RECIPE, SCENE, XML
from tests.conftest import ROOT

SMALL = SCENE.replace("width: 80, height: 64", "width: 20, height: 16").replace("method: particles", "method: toy")


@pytest.fixture(autouse=True)
def _listed(monkeypatch):
    """The line, and what is derived from the table when a module is imported."""
    with monkeypatch.context() as patch:
        patch.setattr(declared, "METHODS", (*declared.METHODS, "tests.toy.method:METHOD"))
        declared.methods.cache_clear()
        importlib.reload(rules)
        yield
    declared.methods.cache_clear()
    importlib.reload(rules)


@pytest.fixture
def place(tmp_path):
    for name, text in (("drops.yaml", RECIPE.replace("METHOD", "method: procedural")), ("lamp.xml", XML), ("s.yaml", SMALL)):
        (tmp_path / name).write_text(text)
    return tmp_path


def test_scenes_and_lists_have_it(call, place):
    (place / "drops.h5").touch()
    out = call("compare", "--list")[1]
    assert out.split("grains, auto")[0].endswith(
        "particles, toy: a toy of the tests\n  brings: walks in the medium, for the tests\n"
        "  leaves out: toys leave out all else\n  error: up to 1.2 % is stated (at a tolerance of 5 %)\n  takes: footprint\n")
    assert "toy" in entries.methods("particles") and {"toy", "toy:footprint=2"} <= set(rules.POINTS)
    assert "toy" not in rules.EXACT + rules.KEPT
    loaded = scene.load(place / "s.yaml", {"materials[0].footprint": "2", "tolerance": "10%"})
    assert budget.of(loaded).approximations == 0.025
    for settings, words in (({"method": "toys"}, "query, explicit or toy, the methods of particles"),
                            ({"materials[0].peak": "keep"}, "found peak, which method toy does not use"),
                            ({"method": "auto", "materials[0].footprint": "1"}, "expected it with method: query or toy")):
        with pytest.raises(RecipeError, match=words):
            scene.load(place / "s.yaml", settings)


@pytest.mark.slow
def test_plan_and_pictures_have_it(call, place):
    status, out, err = call("plan", place / "drops.yaml", "--scene", place / "s.yaml", "--json")
    assert status == 0 and "method toy reads their sum" in out, err
    assert call(place / "drops.yaml", "-o", place / "drops.h5", "--quiet")[0] == 0
    status, out, err = call("compare", place / "s.yaml", "--methods", "continuous,toy:footprint=2", "--json", "--quiet")
    assert status in (0, 3), err
    _, toy = json.loads(out)["methods"]
    assert (toy["method"], toy["exact"], toy["kept"]) == ("toy", False, False)
    assert {"toys leave out all else", "a toy with a tolerance of 0.0125"} <= set(toy["reasons"])
    means = [json.loads(call("render", place / "s.yaml", "--set", f"method={method}", "--json")[1])["mean"]
             for method in ("toy", "continuous")]
    assert means[0] == means[1] and min(means[0]) > 0  # of the same passes and random numbers


def test_docs_name_every_method():
    """Each stands in a table of docs/scenes.md, and in that of its kind."""
    scenes = (ROOT / "docs" / "scenes.md").read_text()
    for kind, page in (("particles", "discrete"), ("grains", "granular"), ("body", "translucent")):
        rows = (ROOT / "docs" / f"{page}.md").read_text()
        for name, method in entries.declared(kind).items():
            assert name == "toy" or f"| `{name}` " in rows and f"`{name}`" in scenes, name
            assert set(method.candidates) <= entries.declared(kind).keys()
            assert set(getattr(method, "parts", ())) <= {FEW, GATHERED, DIFFUSED, JOINED}  # kinds of passes that there are
