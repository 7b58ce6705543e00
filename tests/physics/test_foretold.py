"""Noise that pilots foretell of pictures, against that of the pictures: milk in a glass, 128 x 128.

By pilots of 64 x 64 pixels, two standard errors of what they tell and more.
"""

import pytest

from renderers import choice
from renderers.choice import pilot, trial
from renderers.mitsuba.world import World
from renderers.pictures.engine import Passes, Stop
from renderers.scene import assets, load
from tests.conftest import MILK, ROOT

SIDE = 128  # pixels, of the picture


@pytest.fixture
def prepared(tmp_path):
    """A function of a method: the scene, its world, and what prepares it for one."""

    def of(method):
        recipe = tmp_path / "milk.yaml"
        # darker than milk: paths are shorter
        recipe.write_text(MILK.format(name="milk", g=0.75).replace("[0.9998, 0.9995, 0.998]", "[0.99, 0.98, 0.95]"))
        scene = assets.baked(load(ROOT / "assets/scenes/glass_of_milk.yaml", {
            "film.width": str(SIDE), "film.height": str(SIDE), "stop": "{samples: 32}", "materials[0].method": method,
            "materials[0].recipe": str(recipe)}))
        opened = choice.Opened.of(scene)
        return scene, World.of(scene), lambda world, seed: scene.prepare(opened, world, seed)

    return of


def rendered(prepare, world):
    picture = Passes(prepare(world, 1).parts)
    picture.run(Stop(samples=32))
    return picture


@pytest.mark.slow
def test_paths_by_the_plan_of_a_scene(prepared, monkeypatch):
    monkeypatch.setattr(pilot, "SECONDS", 0.5)
    scene, world, prepare = prepared("paths")
    forecast = pilot.forecast(scene)
    picture = rendered(prepare, world)
    assert forecast.stopped_by == "samples" and forecast.size == (SIDE, SIDE) and 0 < forecast.spread < 0.6
    assert forecast.noise / 1.5 < picture.noise < 1.5 * forecast.noise


@pytest.mark.slow
def test_chains(prepared):
    """A picture of them may have a chain that stays at a path so bright that its pixel has half of the variance."""
    _, world, prepare = prepared("metropolis")
    with world.as_it_is():
        tried = trial.of(prepare, world, None, 32)
    (cost,) = tried.costs
    picture = rendered(prepare, world)
    assert tried.passes == 2 and cost.samples == 16 and cost.chains
    foretold = (cost.of_pixel(SIDE**2, tried.pixels, 2) * cost.samples / picture.samples) ** 0.5
    assert foretold / 1.8 < picture.noise < 1.8 * foretold
