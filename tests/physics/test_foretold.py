"""Noise that pilots foretell of pictures, against that of the pictures."""

from __future__ import annotations

import pytest

from renderers import choice
from renderers.choice import trial
from renderers.mitsuba.world import World
from renderers.pictures.engine import Passes, Stop
from renderers.scene import assets, load
from tests.conftest import MILK, ROOT

SIDE = 128  # pixels, of the picture


@pytest.mark.slow
@pytest.mark.parametrize("method, passes, within", [("paths", 2, 1.4), ("metropolis", 2, 1.7)])
def test_noise_of_milk_in_a_glass(tmp_path, method, passes, within):
    """By pilots of two passes and 64 x 64 pixels: two standard errors of what they tell and more."""
    recipe = tmp_path / "milk.yaml"
    recipe.write_text(MILK.format(name="milk", g=0.75))
    scene = assets.baked(load(ROOT / "assets/scenes/glass_of_milk.yaml", {
        "film.width": str(SIDE), "film.height": str(SIDE), "materials[0].method": method, "materials[0].recipe": str(recipe)}))
    world, opened = World.of(scene), choice.Opened.of(scene)
    with world.as_it_is():
        tried = trial.of(lambda small, seed: scene.prepare(opened, small, seed), world, None, 32)
    (cost,) = tried.costs
    assert tried.passes == 2 and cost.samples == 16 and cost.chains == (method == "metropolis")
    picture = Passes(scene.prepare(opened, world, 1).parts)
    picture.run(Stop(samples=passes * picture.parts[0].samples))
    foretold = (cost.of_pixel(SIDE**2, tried.pixels, passes) * cost.samples / picture.samples) ** 0.5
    assert foretold / within < picture.noise < within * foretold
