"""A picture from the asset that a scene asks for is that of the whole recipe ten times finer, and the asset costs less.

Both are rendered with the same random numbers, with four seeds.  Held to the tolerance are the root mean square over the picture,
beside three times the square of the noise that is left, and each pixel, beside ten standard errors (`benchmarks/planned.py`: by
chance once in 1e6 of all tests together).
"""

import re

import numpy as np
import pytest

from bakery.run import execute
from benchmarks import planned
from renderers import scene
from renderers.scene import budget
from tests import adversarial
from tests.conftest import ROOT

SCENES = ROOT / "assets" / "scenes"
# (height, width), samples a pixel and seed, pixels squared whose means count
_BODY, _HEAP = ((24, 32), 2, 4), ((24, 32), 8, 4)
SHIPPED = {
    "beads_in_box": ((16, 16), 16, 4), "bust": _BODY, "candle": _BODY, "candle_ball": _BODY, "candle_hollow": _BODY,
    "cube_of_beads": _HEAP, "head": _BODY, "layers_of_sand": _HEAP, "soap_and_lamp": _BODY,
    "square_emitter": (None, 16, 1),
}
# of several materials: of each recipe they need what its kind needs alone (tests/cli/test_render_mixed.py)
OF_SEVERAL = {"beach", "winter_evening"}
OF_SURFACES = {"painted_head", "field_of_snow"}  # no scene decides anything of a surface
NOISE = 3  # times the variance of the noise that may be in a difference: of 48 equal pixels and four seeds once in 4e6 (F test)


def measured():
    """Scenes of the table in docs/measurements/requirements.md: tolerance, differences of mean and pixels, those beyond noise."""
    text = (ROOT / "docs" / "measurements" / "requirements.md").read_text()
    rows = re.findall(r"^\| (\w+), ([\d.]+) %[^|]*\| (-?[\d.]+) %[^|]*\| ([\d.]+)[^|]*\| ([\d.]+) %", text, re.MULTILINE)
    return {name: tuple(map(float, values)) for name, *values in rows}


def test_every_shipped_scene_is_compared():
    """Here, or by `python benchmarks/requirements.py --pictures`, whose table says that it loses less than its tolerance."""
    found = measured()
    assert {path.stem for path in SCENES.glob("*.yaml")} == SHIPPED.keys() | found.keys() | OF_SEVERAL | OF_SURFACES
    assert all(excess <= tolerance for tolerance, _, _, excess in found.values())


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    """Assets, planned and full, of a scene's bodies, and whether the planned ones cost less; those of one recipe are shared."""
    done = {}

    def of(read, folder):
        found = []
        for recipe in planned.recipes_of(read, folder):
            plans = planned.plans(read, recipe, tmp_path_factory.mktemp("assets"))
            key = (recipe, *(one.steps[-1].input_hash for one in plans[:2]))
            if key not in done:
                done[key] = [execute(plan).output for plan in plans[:2]], plans
            found.append(done[key])
        return found

    return of


def held(read, baked, folder, recipes, **how):
    """What has to hold of a scene."""
    assets = baked(read, recipes)
    for _, plans in assets:
        assert cost(plans.planned) <= cost(plans.full)
    found = planned.compared(read, *zip(*(one for one, _ in assets), strict=True), folder, **how)
    tolerance = read.values.tolerance or budget.DEFAULT
    assert found.noise < tolerance, found
    tables = budget.of(read, max(plans.share for _, plans in assets)).tables
    assert found.rms**2 <= tables**2 + NOISE * found.noise**2, found
    assert found.sure <= tolerance, found
    return assets, found


def cost(plan):
    """Seconds by the models alone: those of a plan follow what bakes took here, beside other work too."""
    return sum(step.stage.cost(plan.recipe).seconds for step in plan.steps)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_lose_nothing(name, baked, tmp_path):
    size, samples, block = SHIPPED[name]
    read = scene.load(SCENES / f"{name}.yaml", assets=False)
    held(read, baked, tmp_path, ROOT / "recipes", size=size, samples=samples, block=block,
         seeds=1 if size is None else planned.SEEDS)


@pytest.mark.slow
@pytest.mark.parametrize("name", adversarial.CASES)
def test_hard_scenes_lose_nothing(name, baked, tmp_path):
    case = adversarial.CASES[name]
    read = scene.load(adversarial.write(case, tmp_path), assets=False)
    filtered = "film" in read.rules.UNUSED  # by the fog: without noise
    assets, _ = held(read, baked, tmp_path, tmp_path, samples=case.samples, size=None if filtered else case.size,
                     seeds=1 if filtered else planned.SEEDS, block=case.block)
    assert cost(assets[0][1].planned) < 0.9 * cost(assets[0][1].full)


def test_differences_beneath_noise():
    """What both pictures share is no difference; what one of them has is; noise that they do not share is noise."""
    rng = np.random.default_rng(1)
    a = 1 + rng.random((4, 12, 16))
    assert planned.difference(a, a) == (0.0,) * 5
    b = a.copy()
    b[:, 3, 4] *= 1.2
    found = planned.difference(a, b)
    assert 0.05 < found.sure < found.pixel == pytest.approx(0.2 / 1.2, rel=0.01) and found.noise < 0.01
    found = planned.difference(a, a[:, ::-1])
    assert found.sure < 0 and found.rms < 1.5 * found.noise
