"""A method of a renderer is a file and one line in a table: scenes, lists, compare, trade, plan, budget and pictures have it."""

import importlib
import json
import re

import pytest

from bakery.errors import RecipeError
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from renderers import scene
from renderers.materials.bodies.declaration import DIFFUSED, FEW, GATHERED, JOINED, MUTATED
from renderers.materials.particles import scene as rules
from renderers.scene import budget, entries
from tests.cli.test_render_discrete import RECIPE, SCENE, XML
from tests.cli.test_render_granular import RECIPE as BEADS
from tests.cli.test_render_granular import SCENE as HEAP
from tests.cli.test_render_granular import XML as HEAP_XML
from tests.conftest import ROOT

SMALL = SCENE.replace("width: 80, height: 64", "width: 20, height: 16").replace("method: particles", "method: toy")


# kind of material -> the package with its methods, and the toy
TOYS = {"particles": ("renderers.materials.particles", "METHOD"), "grains": ("renderers.materials.grains", "OF_GRAINS"),
        "body": ("renderers.materials.bodies", "OF_BODIES"), "medium": ("renderers.mixed", "OF_MEDIA")}


@pytest.fixture(autouse=True)
def _listed(monkeypatch):
    """The line of each, and what is derived from the tables when a module is imported."""
    tables = [importlib.import_module(f"{package}.declared") for package, _ in TOYS.values()]
    derived = [importlib.import_module(f"{entries.PACKAGES[kind]}.scene") for kind in TOYS if kind in entries.PACKAGES]

    def anew():
        for table in tables:
            table.methods.cache_clear()
        for module in derived:
            importlib.reload(module)

    with monkeypatch.context() as patch:
        for table, (_, name) in zip(tables, TOYS.values(), strict=True):
            patch.setattr(table, "METHODS", (*table.METHODS, f"tests.toy.method:{name}"))
        anew()
        yield
    anew()


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


def test_each_kind_has_its_own(call):
    """In lists, in the keys of entries, among what `trade` tries, and in the sentence of what it does not take."""
    out = call("compare", "--list")[1]
    for kind, words in (("grains", "flights by chance, for the tests"), ("body", "paths, for the tests")):
        assert f"{kind}, toy: a toy of the tests\n  brings: {words}\n" in out
    listed = json.loads(call("compare", "--list", "--json")[1])
    assert {method["kind"] for method in listed if method["name"] == "toy"} == {*entries.KINDS}
    for kind, package in entries.PACKAGES.items():
        method, derived = entries.declared(kind)["toy"], importlib.import_module(f"{package}.scene")
        assert method.kind == kind and "toy" in derived.POINTS and ("method", entries.methods(kind)) == derived.CHOICE
        assert ("toy" in derived.EXACT) == method.exact == (kind == "body")
    assert entries.methods("medium") == ("auto", "paths", "toy")


@pytest.mark.slow
def test_grains_are_rendered_by_theirs(call, tmp_path):
    """As by the method whose grains it takes, of the same random numbers; its report says what it leaves out."""
    vertices, faces = icosphere(80)
    (tmp_path / "heap.ply").write_bytes(ply.mesh(6 * vertices, faces))
    for name, text in (("beads.yaml", BEADS), ("lamp.xml", HEAP_XML), ("s.yaml", HEAP)):
        (tmp_path / name).write_text(text)
    assert call(tmp_path / "beads.yaml", "-o", tmp_path / "beads.h5", "--quiet")[0] == 0
    reports = [json.loads(call("render", tmp_path / "s.yaml", "--set", f"materials[0].method={method}", "--json",
                               "--overwrite")[1]) for method in ("toy", "teleport")]
    assert reports[0]["method"] == "toy" and reports[0]["mean"] == reports[1]["mean"] and min(reports[0]["mean"]) > 0


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


def test_the_page_says_where_each_stands():
    """The table of docs/architecture.md: its lists are there, of declarations of the class that it names, and each has a toy."""
    page = (ROOT / "docs" / "architecture.md").read_text()
    rows = re.findall(r"^\| ([\w ]+) \| `([^`]+)`[^|]*\| `(\w+)` in `([^`]+)` \| `([^`]+)` \|", page, re.MULTILINE)
    assert [what for what, *_ in rows] == ["stage", "exporter", "size distribution", "method of a renderer", "renderer"]
    for what, file, name, listed, toy in rows:
        for kind in ("particles", "grains", "bodies") if "/X/" in listed else ("",):
            place = listed.replace("/X/", f"/{kind}/").removesuffix("/__init__.py").removesuffix(".py")
            lines = getattr(importlib.import_module(place.replace("/", ".")), name)
            targets = [*lines.values()] if isinstance(lines, dict) else [line for line in lines if not line.startswith("tests.")]
            folder = file.replace("/X/", f"/{kind}/").partition("NAME")[0]
            assert targets and all(target.replace(".", "/").startswith(folder) for target in targets), (what, targets)
        assert (ROOT / toy).exists() and toy.startswith("tests/toy")
        module = toy.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        assert any(module in path.read_text() for path in (ROOT / "tests").glob("*/test_toy*.py")), toy


def test_docs_name_every_method():
    """Each stands in a table of docs/scenes.md, and in that of its kind."""
    scenes = (ROOT / "docs" / "scenes.md").read_text()
    for kind, page in (("particles", "discrete"), ("grains", "granular"), ("body", "translucent")):
        rows = (ROOT / "docs" / f"{page}.md").read_text()
        for name, method in entries.declared(kind).items():
            assert name == "toy" or f"| `{name}` " in rows and f"`{name}`" in scenes, name
            assert set(method.candidates) <= entries.declared(kind).keys()
            kinds_of_passes = {FEW, GATHERED, DIFFUSED, JOINED, MUTATED}
            assert set(getattr(method, "parts", ())) <= kinds_of_passes
