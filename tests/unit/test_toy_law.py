"""A size distribution is a class and one line in a list: recipes, schema, messages and the optics of a bake know it then."""

import subprocess
import sys

import pytest

from bakery.physics.sizes import laws
from tests.conftest import ROOT

RECIPE = """\
bakery: 1
name: sand
wavelengths: [0.6]
tolerance: 10%
particles:
  number_density: 1e8 /m^3
  components:
    - {name: grains, material: silica, size: {distribution: uniform, radius: 2 um, smallest: 0.5}}
"""
SCRIPT = """\
from bakery.physics.sizes import distributions
distributions.LAWS += ("tests.toy.law:Uniform",)
import numpy as np
import pytest
from bakery.errors import RecipeError
from bakery.recipe import json_schema, load
from bakery.stages import all_stages
from bakery.stages.optics.size_keys import sizes
from bakery.physics.sizes import population

component, = load("sand.yaml").particles.components
assert (component.size.distribution, component.size.radius, component.size.smallest) == ("uniform", 2.0, 0.5)
mean = population(sizes(component.size))
assert abs(mean.moment(1) - 1.5) < 1e-12 and not mean.single
keys = json_schema()["$defs"]
assert keys["UniformSize"]["properties"]["smallest"]["description"] == "Over the largest."
assert keys["UniformSize"]["required"] == ["distribution", "radius", "smallest"] and "share" in keys["UniformPart"]["properties"]
for change, words in ((("smallest: 0.5", "smallest: 2"), "smallest"),
                      (("smallest: 0.5", "min: 5 um, smallest: 0.5"), "min and max"),
                      (("uniform", "even"), "single, lognormal, gamma, junge, histogram, table, uniform or mixture")):
    open("wrong.yaml", "w").write(open("sand.yaml").read().replace(*change))
    with pytest.raises(RecipeError, match=words):
        load("wrong.yaml")
import bakery
asset = bakery.open(bakery.bake("sand.yaml", "sand.h5", stages=["optics"]))
radius, weight = asset.optics["grains"].radius, asset.optics["grains"].weight
assert abs(np.sum(radius * weight) - 1.5) < 1e-3 and radius.min() >= 1.0 and radius.max() <= 2.0
"""


def test_everything_knows_it(tmp_path, monkeypatch):
    (tmp_path / "sand.yaml").write_text(RECIPE)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("BAKERY_CACHE", str(tmp_path / "cache"))
    done = subprocess.run([sys.executable, "-c", SCRIPT], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", ["recipes", "averages"])
def test_docs_name_every_law(page):
    rows = [line for line in (ROOT / "docs" / f"{page}.md").read_text().splitlines() if line.startswith("| ")]
    for law in laws().values():
        row = next((row for row in rows if row.startswith((f"| {law.name} |", f"| `{law.name}` |"))), "")
        assert row and (page == "averages" or all(f"`{name}`" in row for name in law.keys))
