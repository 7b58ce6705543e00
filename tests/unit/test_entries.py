"""Entries of `materials`: of which kind each is, which renderer they are for, what is told where something does not fit."""

import h5py
import pytest

from bakery.errors import RecipeError
from bakery.grammar.section import Section
from bakery.recipe import schema
from renderers import scene
from renderers.pictures import comparison

HEAD = "bakery_scene: 2\nname: s\nscene: {mitsuba: s.xml}\nmaterials:\n"
BOX = "where: {box: {lo: [0, 0, 0] m, hi: [1, 1, 1] m}}"
MESH = "where: {mesh: a.ply}"


@pytest.fixture
def load(tmp_path):
    (tmp_path / "s.xml").write_text("<scene version='3.0.0'/>")
    (tmp_path / "a.ply").touch()
    for name, groups in (("drops", ["discrete", "medium"]), ("sand", ["grains", "packing", "medium"]), ("milk", ["medium"]),
                         ("both", ["discrete", "grains"])):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            for group in groups:
                file.create_group(group)
    for name, section in (("rain", "discrete: {}"), ("salt", "grains: {}"), ("haze", "medium: {}")):
        (tmp_path / f"{name}.yaml").write_text(f"bakery: 1\n{section}\n")

    def loaded(*entries, settings=None, more=""):
        (tmp_path / "s.yaml").write_text(more + HEAD + "".join(f"  - {{{one}}}\n" for one in entries))
        return scene.load(tmp_path / "s.yaml", settings)

    return loaded


def problems(load, *entries, **options):
    with pytest.raises(RecipeError) as raised:
        load(*entries, **options)
    return raised.value.problems


def fault(load, *entries, **options):
    return "\n".join(map(str, problems(load, *entries, **options)))


@pytest.mark.parametrize("entry, kind, section", [
    (f"{BOX}, asset: drops.h5", "particles", "discrete"),
    (f"{BOX}, recipe: rain.yaml", "particles", "discrete"),
    ("asset: drops.h5", "particles", "discrete"),  # only particles have a place of their own
    (f"{MESH}, asset: sand.h5", "grains", "granular"),
    (f"{MESH}, recipe: salt.yaml", "grains", "granular"),
    (f"{MESH}, asset: drops.h5", "particles", "discrete"),
    (f"{MESH}, asset: both.h5, as: grains", "grains", "granular"),
    ("where: {shape: a}, recipe: haze.yaml", "body", "translucent"),
])
def test_the_kind_follows_from_place_and_asset(load, entry, kind, section):
    found = load(entry)
    assert found.values.materials[0].kind == kind and found.section == section
    assert found.renderer == f"renderers.materials.{kind.replace('body', 'bodies')}"


@pytest.mark.parametrize("more", ["method: paths", "method: vpt", "velocity: [1, 0, 0] m/s", "widen: 1 deg"])
def test_a_file_that_is_missing_is_all_that_is_wrong(load, more):
    """Without it nobody knows of which kind the entry is: what fits one of them is no mistake."""
    (problem,) = problems(load, f"{MESH}, recipe: gone.yaml, {more}")
    assert problem.key == "materials[0].recipe" and "there is no such file" in problem.found
    assert len(problems(load, f"{MESH}, recipe: gone.yaml, method: dipole")) == 2  # which is that of no kind in a mesh


@pytest.mark.parametrize("name, said", [
    ('""', 'found ""; expected a path'), ("[1, 2]", "found a list; expected the name of a file"), ("{a: 1}", "keys with values"),
    (".", "a folder or a device"), ("x" * 300, "expected a path relative to"), ("a/" + "x" * 300 + ".h5", "expected a path"),
])
@pytest.mark.parametrize("key", ["asset", "recipe"])
def test_a_name_that_no_file_can_have_is_one_message(load, tmp_path, monkeypatch, key, name, said):
    """In the folder of the scene, whose own name is then empty."""
    load(f"{MESH}, asset: sand.h5")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.yaml").write_text(f"{HEAD}  - {{{MESH}, {key}: {name}}}\n")
    with pytest.raises(RecipeError) as raised:
        scene.load("s.yaml")
    assert any(problem.key == f"materials[0].{key}" and said in str(problem) for problem in raised.value.problems)


@pytest.mark.parametrize("kinds, methods, name", [
    (["particles"], ["auto"], "discrete"), (["particles"] * 2, ["auto"] * 2, "mixed"),
    (["grains"] * 3, ["ept"] * 3, "granular"), (["grains"] * 2, ["ept", "vpt"], "mixed"),
    (["body"] * 2, ["paths"] * 2, "translucent"), (["medium"], ["auto"], "mixed"),
    (["body", "medium"], ["paths"] * 2, "mixed"), (["body"] * 2, ["surface"] * 2, "mixed"),
    (["particles", "grains", "body"], ["auto"] * 3, "mixed"),
])
def test_one_place_says_which_renderer_it_is(kinds, methods, name):
    assert scene.renderer_of(kinds, methods) == name


def test_one_method_for_all(load):
    """Of the file for entries that say none; of the command line for all."""
    one, two = f"{MESH}, asset: sand.h5", f"{MESH}, asset: sand.h5, method: ept"
    methods = [entry.method for entry in load(one, two, more="method: ept\n").values.materials]
    assert methods == ["ept", "ept"]
    found = load(one, two, settings={"method": "vpt"})
    assert [entry.method for entry in found.values.materials] == ["vpt", "vpt"] and found.values.method == "vpt"
    assert load(one, settings={"materials[0].method": "teleport"}).values.method == "teleport"
    assert fault(load, two, settings={"method": "paths"}).startswith('--set method: method: found "paths"')


@pytest.mark.parametrize("entry, said", [
    (f"{MESH}, asset: sand.h5, velocity: [1, 0, 0] m/s",
     "materials[0].velocity: found velocity, which grains do not have; expected it with particles"),
    (f"{BOX}, asset: drops.h5, spread: 2",
     "materials[0].spread: found spread, which particles do not have; expected it with grains"),
    ("where: {shape: a}, asset: milk.h5, fraction: {grid: a.ply}",
     "materials[0].fraction: found fraction, which a body does not have"),
    (f"{BOX}, asset: sand.h5, as: grains", "materials[0].where: found box for grains; expected {mesh: …}"),
    (f"{MESH}, asset: sand.h5, as: particles", "materials[0].as: found particles, but its asset holds grains, a m"),
    ("asset: milk.h5", "materials[0].where: missing; expected where: everywhere, {box: {lo: …, hi: …}}, {mesh: …}"),
    ("recipe: salt.yaml, method: ept", "materials[0].where: missing; expected where: {mesh: …}"),
    ("asset: sand.h5, as: grains", "materials[0].where: missing; expected where: {mesh: …}"),
    (f"{MESH}, asset: sand.h5, as: surface", 'expected particles, grains, medium or body: what fills a shape'),
    (f"{MESH}, asset: sand.h5, method: surface", "the methods of grains: what fills a shape of the scene may be one"),
    (f"{MESH}, asset: sand.h5, method: paths", 'materials[0].method: found "paths"; expected auto, ept, vpt, ept+vpt, '),
    ("where: here, asset: milk.h5", 'materials[0].where: found "here"; expected everywhere, {box:'),
    ("where: {sphere: 1}, asset: milk.h5", "materials[0].where: found keys with values; expected everywhere, {box:"),
    (MESH, "materials[0].asset: missing; expected asset: a baked asset, or recipe"),
    (f"{MESH}, asset: sand.h5, recipe: salt.yaml", "materials[0].recipe: found a recipe beside an asset"),
    ("where: {shape: a}, asset: milk.h5, boundary: 1.4", "found \"1.4\"; expected keys with values: index, tables"),
    (f"{MESH}, asset: sand.h5, widen: 40 deg", 'found "40 deg"; expected an angle at least 0 and at most 30 deg'),
    (f"{MESH}, asset: gone.h5", 'materials[0].asset: found "gone.h5", and there is no such file'),
])
def test_what_does_not_fit_is_told_with_its_key(load, entry, said):
    found = fault(load, entry)
    assert said in found and "s.yaml:5: " in found


def test_what_does_not_fit_together(load):
    """Values that a renderer takes once, shapes that two fill, keys of the former top, kinds that only a later version mixes."""
    sand = f"{MESH}, asset: sand.h5, method: ept+vpt"
    assert "found 3.0, but materials[0] has 2.0" in fault(load, f"{sand}, spread: 2", f"{sand}, spread: 3")
    wax = "where: {shape: a}, asset: milk.h5"
    assert "found \"a\", which is materials[0] already" in fault(load, wax, wax)
    tables = "where: {{shape: {}}}, asset: milk.h5, boundary: {{tables: {}}}"
    found = fault(load, tables.format("a", "none"), tables.format("b", "mirrored"))
    assert "found mirrored, but materials[0] has none" in found
    assert "asset: found asset beside materials" in fault(load, sand, more="asset: sand.h5\n")
    assert fault(load, sand, more="asset: sand.h5\n").count("found") == 1
    assert "at least 1" in fault(load, sand, settings={"materials": "[]"})
    assert 'denoise: found "often"; expected auto, yes or no' in fault(load, sand, more="denoise: often\n")
    assert load(sand).values.denoise == "auto" and load(sand, more="denoise: no\n").values.denoise == "no"


def test_methods_to_compare_set_all_entries(load, tmp_path):
    """A key of entries in each of them; a method beside those that are compared is refused."""
    sand = f"{MESH}, asset: sand.h5, method: ept"
    path = load(sand, sand).path
    ept, vpt = comparison.jobs(path, ["ept", "ept+vpt:spread=1"], tmp_path / "out", {})
    assert [one.method for one in ept.scene.values.materials] == ["ept", "ept"]
    assert [(one.method, one.spread) for one in vpt.scene.values.materials] == [("ept+vpt", 1.0)] * 2
    for key in ("method", "materials[1].method"):
        with pytest.raises(Exception, match="the methods are those of --methods"):
            comparison.jobs(path, ["ept"], tmp_path / "out", {key: "ept"})


def test_sections_that_are_called_alike_have_the_same_keys():
    """pydantic's errors name classes: one of recipes and one of scenes would tell each other's keys."""
    schema.recipe_file()
    sections, more = set(), {Section}
    while more:
        more = {below for section in more for below in section.__subclasses__()} - sections
        sections |= more
    inner = {section for section in sections if section.__name__ not in ("Common", "SceneFile")}  # of whole files
    assert len(inner) > 40
    for section in inner:
        assert Section.named[section.__name__].model_fields.keys() == section.model_fields.keys(), section
