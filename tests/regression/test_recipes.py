"""Golden values of the shipped recipes and of a small case a stage, and the rule that values move only with a raised version.

`make test PYTEST="tests/regression --update fog"` rewrites a case (or `--update all`).  Values that moved are only rewritten when
the version of their stage was raised, or the recipe changed; the changelog says why.
"""

import copy
import json
import math
import re

import numpy as np
import pytest

import bakery
from bakery.asset import read_checked
from bakery.asset.verify import _broken
from bakery.recipe import load
from bakery.stages import all_stages
from tests.conftest import ROOT, slow
from tests.regression import golden

HERE = ROOT / "tests" / "regression"
FOLDER = HERE / "golden"
# Optics and media of the shipped recipes; what packs is too long for here, and has small cases of its own.
SHIPPED = {path.stem: path for path in sorted((ROOT / "recipes").glob("*.yaml")) if "\npacking:" not in path.read_text()}
SMALL = {path.stem: path for path in sorted((HERE / "cases").glob("*.yaml"))}
CASES = SHIPPED | SMALL
# of the shipped ones those whose values are kept: every key and word of the others occurs in one of them, and so do spheres from
# 0.02 um to 1 mm
KEPT = {"blowing_snow_particles", "bubbles", "bumpy_sphere", "clouds", "coated_soot", "drizzle", "dust", "emitter", "fog",
        "glass_beads_particles", "marble", "milk", "stairs_particles", "white_paint"} | set(SMALL)
CHAOTIC = {"tile", "grains"}
EXAMPLES = {"fog", "cirrus", "blowing_snow", "drizzle", "dust", "soot", "bubbles", "haze", "milk", "wax"}


def swept(path) -> bool:
    return any(line.startswith("sweep:") for line in path.read_text(encoding="utf-8").splitlines())


def baked(case: str, path, **settings) -> dict:
    """What a case's golden file would hold."""
    if case in SHIPPED:
        settings |= {"quality": "draft", "stages": ["medium"], "settings": {"sweep": "none"} if swept(CASES[case]) else {}}
    bakery.bake(CASES[case], output=path, **settings)
    origin = f"bake {CASES[case].relative_to(ROOT)}" + " --quality draft --stage medium" * (case in SHIPPED)
    return golden.kept(read_checked(path), load(CASES[case]), origin)


def held(case: str) -> dict:
    return json.loads((FOLDER / f"{case}.json").read_text())


# the recipes of the scenes of particles take seconds each; motes are of their kind
LONG = {"glass_spheres", "snow_storm", "clouds", "cloud_top", "blowing_snow", "grains", "photons", "drizzle"}
LONG |= {case for case in CASES if case.endswith("_particles")}


@pytest.mark.parametrize("case", [slow(case) if case in LONG else case for case in CASES])
def test_golden_values(case, tmp_path, request):
    new = baked(case, tmp_path / "a.h5")
    if case in SHIPPED:
        assert not _broken(str(tmp_path / "a.h5")), "a shipped recipe's asset breaks the format's rules"
    if case not in KEPT:
        return
    path = FOLDER / f"{case}.json"
    old = held(case) if path.exists() else None
    found = golden.faults(old, new, case in CHAOTIC) if old else []
    assert not found, f"{case}: " + "; ".join(found)
    if request.config.getoption("--update") in (case, "all"):
        path.write_text(golden.written(new))
        return
    assert old, f"no golden values of {case}: --update {case}"
    found = golden.stale(old, new, case in CHAOTIC)
    assert not found, f"{'; '.join(found)}: --update {case}"


def asked(case: str) -> set:
    """Keys of the optics and medium of a recipe, without numbers of items, words with what they say."""
    recipe = load(CASES[case], {"sweep": "none"} if swept(CASES[case]) else {})
    leaves = {(re.sub(r"\[\d+\]", "", key), value) for key, value in recipe.leaves.items()}
    return {(key, value if isinstance(value, str) and not key.endswith((".name", ".file")) else None) for key, value in leaves
            if key.startswith(("particles", "medium", "phase", "measure"))}


def test_every_key_and_every_stage_has_golden_values():
    assert set(SHIPPED) >= EXAMPLES and set(SMALL) >= CHAOTIC and not set(SHIPPED) & set(SMALL)
    assert {path.stem for path in FOLDER.glob("*.json")} == KEPT
    assert {stage for case in KEPT for stage in held(case)["stages"]} == {stage.name for stage in all_stages()}
    watched = set().union(*map(asked, KEPT & set(SHIPPED)))
    assert not {key for case in SHIPPED for key in asked(case) - watched}


@pytest.mark.parametrize("case", [slow(case) if case in LONG else case for case in sorted(CHAOTIC)])
def test_other_random_numbers_keep_the_statistics(case, tmp_path):
    """What is compared on a machine with other last bits: another tile and other paths agree, a value that moved does not."""
    old, new = held(case), baked(case, tmp_path / "a.h5", seed=1)
    new["inputs"] = old["inputs"]  # but for the seed
    assert golden.faults(old, new | {"arithmetic": old["arithmetic"]}, chaotic=True)
    new["arithmetic"] = "other"
    assert not golden.faults(old, new, chaotic=True) and not golden.stale(old, new, chaotic=True)
    for name, stage in new["stages"].items():
        path = next(path for path, figure in stage["values"].items() if any(figure.get("errors", ())))
        worse = copy.deepcopy(new)
        figure = worse["stages"][name]["values"][path]
        # 6 of the difference are 8.5 of one; what chance moved the other way is at most as much
        figure["numbers"] = [number + 20 * error for number, error in zip(figure["numbers"], figure["errors"], strict=True)]
        assert path in " ".join(golden.faults(old, worse, chaotic=True))


def changed(kept: dict, stage: str, path: str, factor: float = 1.0, version: int = 0) -> dict:
    """What would be kept if a figure of a stage were another, or its version."""
    other = copy.deepcopy(kept)
    other["stages"][stage]["version"] += version
    figure = other["stages"][stage]["values"][path]
    figure["numbers"] = [factor * number for number in figure["numbers"]]
    return other


def test_values_that_move_ask_for_a_raised_version():
    fog = held("fog")
    assert not golden.faults(fog, fog) and not golden.stale(fog, fog)
    for stage, path in (("optics", "droplets/phase"), ("medium", "sigma_t")):
        (said,) = golden.faults(fog, changed(fog, stage, path, 1 + 3e-6))
        assert said.startswith(f"{stage}: values moved") and "raise the version" in said and f"({path}: " in said
        assert not golden.faults(fog, changed(fog, stage, path, 1 + 3e-7)), "rounding is no change"
    gone = copy.deepcopy(fog)
    del gone["stages"]["medium"]["values"]["cdf"]
    assert "cdf: only there in one of them" in golden.faults(fog, gone)[0]


def test_values_in_another_order_are_seen():
    """Mean and root mean square of such a table are the same; so are those of one that is reversed in one axis."""
    table = np.exp(-np.linspace(0, 9, 300)).reshape(3, 100)
    order = np.random.default_rng(0).permutation(table.size)
    swapped = table.ravel().copy()
    swapped[[7, 8]] = swapped[[8, 7]]
    others = {"reversed": table[:, ::-1], "other wavelengths": table[::-1], "shifted": np.roll(table, 1, axis=1),
              "permuted": table.ravel()[order], "two neighbours": swapped}
    fog, kept = held("fog"), golden.numbers(table)
    assert golden.numbers(table.copy()) == kept == pytest.approx(golden.numbers(table * (1 + 1e-9)), rel=1e-8)
    for name, other in others.items():
        new = golden.numbers(other)
        assert new[:2] == pytest.approx(kept[:2], rel=1e-12), name
        before, after = copy.deepcopy(fog), copy.deepcopy(fog)
        before["stages"]["medium"]["values"]["phase"]["numbers"] = kept
        after["stages"]["medium"]["values"]["phase"]["numbers"] = new
        assert "phase: " in " ".join(golden.faults(before, after)), name


def test_a_raised_version_asks_for_new_values():
    fog = held("fog")
    raised = changed(fog, "optics", "droplets/phase", version=1)
    assert not golden.faults(fog, raised) and "stages were" in golden.stale(fog, raised)[0]
    # of a stage that others need: those may move with it
    assert not golden.faults(fog, changed(raised, "medium", "sigma_t", 1.1))
    assert golden.faults(fog, changed(changed(fog, "medium", "g", version=1), "optics", "droplets/phase", 1.1))
    assert "fell" in golden.faults(fog, changed(fog, "optics", "droplets/phase", version=-1))[0]


def test_a_changed_recipe_asks_for_new_values():
    fog = held("fog")
    other = changed(fog, "medium", "sigma_t", 2.0) | {"inputs": "other"}
    assert not golden.faults(fog, other) and "the recipe changed" in golden.stale(fog, other)[0]
    assert not golden.stale(fog, fog | {"inputs": "other"})


def test_all_that_is_kept_is_finite():
    for case in KEPT:
        assert all(math.isfinite(number) for stage in held(case)["stages"].values() for figure in stage["values"].values()
                   for number in figure.get("numbers", ()))
