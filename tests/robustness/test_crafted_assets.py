"""Assets made by other hands, checksums right: each command says in one line what is wrong, `verify` finds it.

The fuzzer of `fuzz_assets.py` found most of these; a handful of its assets run here, ten minutes of them in `make fuzz`.
"""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import bakery
from bakery.asset.verify import _broken, verify
from bakery.errors import AssetError
from bakery.stages import all_stages
from bakery.stages.conform import declared, faults, stages_of
from bakery.store.hashes import seal
from bakery.store.read import read
from bakery.store.tree import Dataset, Group, text
from bakery.store.write import write
from tests.conftest import ROOT, slow
from tests.robustness import fuzz_assets
from tests.samples import small_asset, with_member

TINY = {
    "tile": "bakery: 1\nname: tile\ntolerance: 10%\npacking: {fraction: 0.3, count: 30}\n",
    "haze": """\
bakery: 1
name: haze
wavelengths: [0.61, 0.465]
tolerance: 10%
medium: {albedo: [0.9, 0.5], mean_free_path: 1 mm, phase: {type: isotropic}}
multiple_scattering: {sources: [point], extent: 4, tolerance: 10%}
beam: {depth: 2, photons: 5000, tolerance: 30%}
surface: {thickness: "[0, 1] mm"}
""",
    "shot": """\
bakery: 1
name: shot
wavelengths: [0.61, 0.465]
tolerance: 10%
grains:
  radius: 0.25 mm
  components:
    - {name: ball, shape: {type: sphere}, surface: {type: diffuse, reflectance: 0.5}}
packing: {fraction: 0.3, count: 30}
effective_medium: {walks: 10000}
""",
    "drops": """\
bakery: 1
name: drops
wavelengths: [0.61, 0.465]
tolerance: 10%
particles:
  number_density: 1e9 /m^3
  components:
    - {name: water, material: water, size: {distribution: single, radius: 1 um}}
discrete: {count: 1000, box: [1 cm, 1 cm, 1 cm], method: stored}
""",
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Baked trees that hold every stage between them, and an asset by hand."""
    folder = tmp_path_factory.mktemp("sound")
    os.environ["BAKERY_CACHE"] = str(folder / "cache")
    found = {"fog": seal(small_asset())}
    for name, recipe in TINY.items():
        (folder / f"{name}.yaml").write_text(recipe)
        found[name] = read(bakery.bake(folder / f"{name}.yaml", folder / f"{name}.h5"))
    return found


def test_what_is_baked_is_what_is_declared(sound):
    """Every declared dataset of every stage stands in one of the assets, and all keep to their declarations."""
    held: set = set()
    for name, root in sound.items():
        assert faults(root) == [], name
        held |= {stage for stage in root.members if stage != "provenance"}
    assert held >= {stage.name for stage in all_stages()}


# ---- crafted ones


def with_data(root: Group, path: str, data) -> Group:
    return with_member(root, path, replace(root[path], data=np.ascontiguousarray(data)))


def changed(path: str, change):
    """What puts `change(values)` in the place of a dataset's values."""
    return lambda root: with_data(root, path, change(root[path].data))


def with_attributes(root: Group, path: str, **attributes) -> Group:
    return with_member(root, path, replace(root[path], attributes=root[path].attributes | attributes))


def far_corners(factor: int):
    return changed("multiple/point/w0/corner", lambda corner: corner.astype(np.int32) * factor)


def without(path: str):
    return lambda root: with_member(root, path, None)


two_ranks = changed("medium/sigma_s", lambda sigma_s: np.stack([sigma_s] * 3))
unknown_method = changed("optics/droplets/method", lambda method: np.full_like(method, 9))


CRAFTED = {
    "one place": ("tile", changed("packing/centers", np.ones_like),
                  "packing: centers: two spheres overlap, 30 centres lie where one has room"),
    "corners": ("haze", far_corners(128), "multiple: point/w0: corner goes to"),
    "two ranks": ("fog", two_ranks, "medium/sigma_s: its shape is (3, 2), not (L,)"),
    "method": ("fog", unknown_method, "optics/droplets/method: holds 9, above 2"),
    "one vertex": ("shot", changed("grains/ball/faces", np.zeros_like), "grains: ball: face 0 names a vertex twice"),
}
MORE = {
    "about one place": ("tile", changed("packing/centers", lambda at: 1 + 1e-3 * np.arange(90.0).reshape(30, 3)),
                        "packing: centers: two spheres overlap"),
    "small cell": ("tile", changed("packing/cell", lambda cell: 1e-6 * np.ones(3)),
                   "packing: a sphere that overlaps its own images"),
    "no error of pairs": ("tile", without("packing/pair_correlation/g_error"),
                          "packing/pair_correlation/g_error: missing beside pair_correlation"),
    "farther corners": ("haze", far_corners(2048), "multiple: point/w0: corner goes to"),
    "corners of other cells": ("haze", far_corners(2), "multiple: point/w0: corner is for cells of 1/"),
    "faces of nothing": ("shot", changed("grains/ball/faces", lambda faces: 10**6 + faces), "grains/ball/faces: holds 1"),
    "numbers for words": ("fog", lambda root: with_attributes(root, "medium", tolerance="small"),
                          "medium: attribute `tolerance` is missing or not float"),
    "no phase": ("fog", without("medium/phase"), "medium/phase: missing"),
    "small integers": ("fog", changed("medium/phase", lambda phase: phase.astype(np.int8)), "medium/phase: its type is int8"),
    "other angles": ("fog", changed("medium/theta", lambda theta: theta[:-1]), "medium/theta: its shape is ("),
    "beyond numbers": ("fog", changed("medium/sigma_t", lambda sigma_t: 1e200 * np.ones(2)),
                       "medium/sigma_t: holds 1e+200, above 1e+100"),
    "group for dataset": ("fog", lambda root: with_member(root, "medium/g", Group({"g": root["medium/g"]})),
                          "medium/g: a group, where a dataset belongs"),
    "deep json": ("shot", lambda root: with_member(root, "grains/ball/surface", text("[" * 100_000, "surface")),
                  "grains: ball: surface is no JSON object"),
    "no table": ("haze", without("multiple/point/w1"), "multiple: point/w1: node_bounds, "),
    "depths in disorder": ("haze", changed("beam/depth", lambda depth: depth[::-1]), "beam: depth or ratio do not ascend"),
    "many wavelengths": ("fog", changed("wavelength", lambda um: np.linspace(0.4, 0.7, 5000)),
                         "wavelength: missing, or not an array (L,) in um of up to 4096 numbers"),
    "one wavelength twice": ("fog", changed("wavelength", lambda um: np.full_like(um, 0.5)),
                             "wavelength: holds one of them twice"),
    "seconds in words": ("haze", lambda root: with_attributes(root, "provenance/beam", seconds="many"),
                         "provenance/beam: attribute `seconds` is missing or not float"),
}


@pytest.mark.parametrize(("of", "craft", "words"), [
    pytest.param(*crafted, id=name, marks=[pytest.mark.slow] if crafted[0] in ("haze", "shot") else [])
    for name, crafted in CRAFTED.items()])
def test_every_command_says_it_in_a_line(call, sound, tmp_path, of, craft, words):
    path, whole = tmp_path / "crafted.h5", tmp_path / "whole.h5"
    write(path, craft(sound[of]))
    write(whole, sound[of])
    assert any(line.startswith(words) for line in _broken(str(path)))
    for args in (("inspect", path), ("inspect", path, "--json"), ("plot", path), ("report", path, "--no-render"),
                 ("query", path, "wavelength"),
                 ("export", path, "--to", "csv"), ("export", path, "--to", "mitsuba"), ("export", path, "--to", "hg"),
                 ("export", path, "--to", "ply"), ("diff", path, whole), ("diff", whole, path), ("render", path)):
        status, out, err = call(*args)
        assert status == 2 and err.count("\n") == 1 and f"{path}: " in err and words in err, (args, err)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["crafted.h5", "whole.h5"]


def swapped(path: str):
    return changed(path, lambda data: np.concatenate([data[:, :3], data[:, 4:2:-1], data[:, 5:]], axis=1))


# as declared, and yet impossible
IMPOSSIBLE = {
    "tiny sigma": ("fog", changed("medium/sigma_t", lambda sigma_t: 1e-300 * np.ones(2)),
                   "medium: sigma_t is not sigma_s + sigma_a"),
    "no sigma": ("fog", changed("medium/sigma_s", np.zeros_like), "medium: sigma_t is not sigma_s + sigma_a"),
    "nothing to normalise": ("fog", changed("medium/phase", np.zeros_like), "medium: phase integrates to 1 with an error of 1"),
    "cdf in disorder": ("fog", swapped("medium/cdf"), "medium: cdf does not rise from 0 to 1"),
    "no decay": ("haze", changed("multiple/k0", np.zeros_like), "multiple: k0 is not the decay of diffuse light"),
    "more forward than there is": ("haze", changed("beam/fluence", lambda fluence: 0.5 * fluence),
                                   "beam: forward exceeds fluence"),
    "moment": ("haze", changed("beam/m2", lambda m2: 2 * m2), "beam: beta^2 is not 3/2 m2 / m0"),
    "teleport": ("shot", changed("grains/ball/lambda_s", np.ones_like),
                 "grains: ball: lambda_s is longer than the root of mean_square"),
    "decay beyond extinction": ("haze", changed("multiple/k0", lambda k0: 0 * k0 + 2),
                                "multiple: k0 is not the decay of diffuse light"),
}


@pytest.mark.parametrize(("of", "craft", "words"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_impossible_values_are_shown(call, sound, tmp_path, of, craft, words):
    path = tmp_path / "crafted.h5"
    write(path, craft(sound[of]))
    assert any(line.startswith(words) for line in _broken(str(path)))
    status, out, err = call("inspect", path)
    assert (status, err) == (0, "") and f"\nBROKEN: {words}" in out
    assert any(rule.startswith(words) for rule in json.loads(call("inspect", path, "--json")[1])["broken"])


@pytest.mark.parametrize(("name", "words"), [
    ("tiny sigma", "medium/sigma_s: is not albedo times sigma_t"), ("no sigma", "medium/sigma_s: is not albedo times sigma_t"),
    ("nothing to normalise", "medium/phase: does not integrate to 1"), ("cdf in disorder", "medium/cdf: does not rise from 0")])
def test_impossible_media_are_not_exported(call, sound, tmp_path, name, words):
    of, craft, _ = IMPOSSIBLE[name]
    path = tmp_path / "crafted.h5"
    write(path, craft(sound[of]))
    for target in ("csv", "mitsuba", "hg", "netcdf"):
        status, out, err = call("export", path, "--to", target)
        assert (status, out, err.count("\n")) == (2, "", 1) and err.startswith(f"{path}: {words}"), (target, err)
    assert [file.name for file in tmp_path.iterdir()] == ["crafted.h5"]


@pytest.mark.parametrize(("of", "craft", "words"), (CRAFTED | MORE).values(), ids=CRAFTED | MORE)
def test_opening_says_it_in_a_line(sound, tmp_path, of, craft, words):
    path = tmp_path / "crafted.h5"
    write(path, craft(sound[of]))
    with pytest.raises(AssetError) as caught:
        bakery.open(path)
    assert str(caught.value).startswith(f"{path}: damaged, or not written by bakery: {words}") and "\n" not in str(caught.value)


@pytest.mark.usefixtures("verified_here")
def test_verify_names_it_to_the_user(call, sound, tmp_path):
    """Through the child process, and with more than one fault."""
    write(tmp_path / "x.h5", without("medium/phase")(two_ranks(sound["fog"])))
    found = verify(tmp_path / "x.h5")
    assert [line.split(":")[0] for line in found] == ["medium/sigma_s", "medium/phase", "medium/phase_bias"]
    with pytest.raises(AssetError, match=r"medium/sigma_s.* and 1 more; `bake verify`"):
        bakery.open(tmp_path / "x.h5")


@pytest.mark.usefixtures("verified_here")
def test_what_no_stage_declares_is_let_pass(sound, tmp_path):
    """Later versions may add datasets and groups."""
    root = with_member(sound["fog"], "medium/colour", Dataset(np.array([np.nan]), "1", "not known here"))
    root = with_member(root, "shards", Group({"x": Dataset(np.zeros((2, 2), complex), "m", "places")}))
    write(tmp_path / "x.h5", root)
    assert bakery.open(tmp_path / "x.h5").shards.x.shape == (2, 2)
    assert any(line.startswith("medium/colour: not finite") for line in verify(tmp_path / "x.h5"))


def test_opening_imports_no_physics(sound, tmp_path):
    write(tmp_path / "x.h5", sound["haze"])
    script = f"import sys, bakery; bakery.open({str(tmp_path / 'x.h5')!r}); print({{'numba', 'scipy'}} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True,
                          text=True, check=True)
    assert done.stdout == "set()\n"


def test_letters_are_one_length():
    """The rules of shapes themselves: a letter is learnt once, L and A for the whole asset, others a group or component."""
    root = seal(small_asset())
    longer = np.append(root["optics/droplets/radius"].data, 70.0)
    (fault,) = [line for line in declared(with_data(root, "optics/droplets/weight", np.full(61, 1 / 61))) if "weight" in line]
    assert fault == "optics/droplets/weight: its shape is (61,), not (R,) with R = 60"
    found = declared(with_data(root, "optics/droplets/radius", longer))
    assert found and all("R = 61" in line for line in found)
    assert declared(root) == []


def test_members_that_come_together_are_asked_for(sound):
    """Of all that a stage declares to come together each member is named where it alone is missing."""
    asked_for = set()
    for root in (sound[name] for name in ("tile", "haze", "drops")):
        for stage in stages_of(root):
            there = {path for path, member in root[stage.name].walk() if isinstance(member, Dataset)}
            held = [path for paths in stage.together for path in paths if path in there]
            for path in held:
                fault = declared(with_member(root, f"{stage.name}/{path}", None))[0]
                assert fault.startswith(f"{stage.name}/{path}: missing beside"), fault
            asked_for |= {f"{stage.name}/{path}" for path in held}
    assert asked_for >= {"packing/pair_correlation/g", "surface/depth", "surface/spread", "discrete/radius",
                         "discrete/cell_edge"}


def test_a_group_is_checked_without_what_it_was_made_of(sound):
    """Readers of `discrete` and `surface` ask for these members, whether or not the groups upstream are there."""
    for of, upstream, path in (("haze", "medium", "surface/cosine"), ("drops", "optics", "discrete/box")):
        root = with_member(sound[of], upstream, None)
        assert declared(root) == []
        assert declared(with_member(root, path, None))[0] == f"{path}: missing"


def test_several_layers_have_thicknesses(sound):
    """Without `thickness` and `depth` a layer is infinite, and only one can be."""
    root = with_member(with_member(sound["haze"], "surface/thickness", None), "surface/depth", None)
    assert declared(root) == ["surface: thickness missing, of which there are several"]


def test_rough_boundaries_have_a_base(sound):
    """Solutions of layers over air are of smooth boundaries only."""
    surface, words = sound["haze"]["surface"], ["surface: base missing under a rough boundary"]
    rough = with_data(with_data(sound["haze"], "surface/roughness", np.full(1, 0.3)), "surface/index", np.full(1, 1.3))
    assert declared(rough) == words
    base = Dataset(np.full(2, 0.5), "1", "albedo of the base")
    assert declared(with_member(rough, "surface/base", base)) == []
    assert declared(with_data(rough, "surface/index", surface["index"].data)) == []


# ---- the fuzzer


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 1, slow(2), slow(3)])
def test_fuzzed(sound, tmp_path, number):
    whole = {}
    for name, root in sound.items():
        whole[name] = tmp_path / f"{name}.h5"
        write(whole[name], root)
    with fuzz_assets.sketched():
        said, failed = fuzz_assets.one(number, whole, tmp_path)
    assert not failed, said


def test_the_fuzzer_finds_what_is_planted(sound, tmp_path, monkeypatch):
    """Without the check at opening it meets tracebacks again."""
    from bakery.stages import conform

    write(tmp_path / "x.h5", unknown_method(sound["fog"]))
    assert fuzz_assets.ran(["inspect", str(tmp_path / "x.h5")]) == (2, "")
    monkeypatch.setattr(conform, "check", lambda path, root: None)
    status, fault = fuzz_assets.ran(["inspect", str(tmp_path / "x.h5")])
    assert status == -1 and "ValueError" in fault


@pytest.mark.soak
def test_every_member_may_be_missing():
    """To every command and renderer: it works, or says in one line what is missing."""
    done = subprocess.run([sys.executable, "-m", "tests.robustness.fuzz_assets", "--members"], cwd=ROOT, capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.soak
def test_fuzzed_for_long(tmp_path):
    done = subprocess.run([sys.executable, "-m", "tests.robustness.fuzz_assets", "--seconds", "3000", "--seed", "1"], cwd=ROOT,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
