"""Golden values of the shipped recipes: a few well chosen figures of each one's medium, baked at draft quality.

`make test PYTEST="tests/regression --update fog"` rewrites a case (or `--update all`).  Values that moved by more than the case's
tolerance are only rewritten when the version of a stage was raised with them; the changelog says why.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import bakery
from tests.conftest import ROOT

# Tiles and grains have none: hard spheres and light between facets are chaotic, one bit of another libm makes another tile and
# other paths.  Their statistics are tested instead (tests/physics/test_structure.py, test_scatterometer.py, test_packed.py), and
# their rules (tests/unit/test_packing_stage.py, test_stage_grains.py).
CASES = sorted(path.stem for path in (ROOT / "recipes").glob("*.yaml") if "\npacking:" not in path.read_text())
FOLDER = ROOT / "tests" / "regression" / "golden"
ANGLES = (0.0, 1.0, 10.0, 60.0, 90.0, 138.0, 175.0, 180.0)  # deg
# On one kind of processor the values agree to the last bit; between kinds NumPy's exp and log differ there, and that reaches
# sums of 1e4 terms as some 1e-12.  1e-6 leaves room for that and still sees any change of method.
TOLERANCE = 1e-6
EXAMPLES = {"fog", "cirrus", "blowing_snow", "drizzle", "dust", "soot", "bubbles", "haze", "milk", "wax"}


def figures(asset) -> dict[str, list[float]]:
    """The values that a case keeps."""
    phase = asset.medium.phase(np.radians(ANGLES))
    found = {name: np.asarray(getattr(asset.medium, name), dtype=float) for name in ("sigma_t", "albedo", "g", "sigma_tr")}
    return {name: values.tolist() for name, values in found.items()} | {"phase": phase.ravel().tolist()}


def worst(old: dict, new: dict) -> tuple[float, str]:
    """Largest relative difference and where it is."""
    place = (0.0, "")
    for name, values in old.items():
        assert len(values) == len(new[name]), f"{name}: {len(values)} values before, {len(new[name])} now"
        for i, (a, b) in enumerate(zip(values, new[name], strict=True)):
            place = max(place, (abs(a - b) / max(abs(a), 1e-300) if a != b else 0.0, f"{name}[{i}]: {a!r} -> {b!r}"))
    return place


def test_every_recipe_ships_with_golden_values():
    assert set(CASES) >= EXAMPLES
    assert {path.stem for path in FOLDER.glob("*.json")} == set(CASES)


@pytest.mark.parametrize("case", CASES)
def test_golden_values(case, tmp_path, request):
    path = bakery.bake(ROOT / "recipes" / f"{case}.yaml", output=tmp_path / "a.h5", quality="draft", stages=["medium"])
    from bakery.asset.verify import verify

    assert not verify(path), "a shipped recipe's asset breaks the format's rules"
    asset = bakery.open(path)
    versions = {name: int(stage["stage_version"]) for name, stage in asset.stages.items()}
    new = {"origin": f"bake recipes/{case}.yaml --quality draft --stage medium", "stages": versions, "tolerance": TOLERANCE,
           "angles_deg": list(ANGLES), "values": figures(asset)}
    assert all(math.isfinite(v) for values in new["values"].values() for v in values)
    golden = FOLDER / f"{case}.json"
    old = json.loads(golden.read_text()) if golden.exists() else None
    update = request.config.getoption("--update")
    if update in (case, "all"):
        if old and old["stages"] == versions and worst(old["values"], new["values"])[0] > old["tolerance"]:
            pytest.fail(f"{case}: values changed ({worst(old['values'], new['values'])[1]}) but no stage version was raised")
        golden.parent.mkdir(exist_ok=True)
        golden.write_text(json.dumps(new, indent=1) + "\n")
        return
    assert old, f"no golden values of {case}: --update {case}"
    distance, place = worst(old["values"], new["values"])
    off = distance / old["tolerance"]
    assert off <= 1, f"{place}: {off:.3g} tolerances off; stages {old['stages']} -> {versions}"
