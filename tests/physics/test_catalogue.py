"""The recipes of the catalogue against what their sources say of the same materials; benchmarks/catalogue.py compares."""

import numpy as np
import pytest

from benchmarks import catalogue
from tests.conftest import slow

PUBLISHED = catalogue.published()
QUICK = ("espresso", "skin_1")  # given by coefficients, which bake in a moment


def test_every_recipe_has_figures_and_stands_on_the_page():
    assert {path.stem for path in catalogue.FOLDER.glob("*.yaml")} - {"published"} == PUBLISHED.keys() and len(PUBLISHED) >= 30
    page = catalogue.PAGE.read_text(encoding="utf-8")
    assert not [name for name in PUBLISHED if f"](../recipes/catalogue/{name}.yaml)" not in page]
    for about in PUBLISHED.values():
        assert about["source"] and about["checks"]
        for check in about["checks"]:
            assert check["values"] and ("relative" in check) != ("absolute" in check)
            assert 0 < check.get("relative", check.get("absolute")) <= 0.05


@pytest.mark.parametrize("name", [name if name in QUICK else slow(name) for name in PUBLISHED])
def test_baked_figures_are_the_published_ones(name, tmp_path):
    asset = catalogue.bake(name, tmp_path)
    for one in catalogue.checked(asset, PUBLISHED[name]["checks"]):
        assert np.isfinite(one.off) and one.off <= one.allowed, one


def test_another_number_is_seen(tmp_path):
    asset = catalogue.bake("skin_1", tmp_path)
    checks = [check | {"values": [1.2 * value for value in check["values"]]} for check in PUBLISHED["skin_1"]["checks"]]
    assert all(one.off > one.allowed for one in catalogue.checked(asset, checks))
