"""What the figures share: assets of their grains, and packings without an end."""

import tempfile
from functools import cache
from pathlib import Path

import numpy as np

import bakery
from bakery.physics.shapes.radial import icosphere
from benchmarks.sizes import sized
from renderers.materials.grains import material

ROOT = Path(__file__).resolve().parents[2]
BALLS = """bakery: 1
name: balls
wavelengths: [0.55]
tolerance: 1%
grains:
  radius: 1 mm
  components: [{name: ball, shape: {type: sphere}, surface: {type: dielectric, material: {n: 1.5, k: 0}}}]
packing: {fraction: 0.63, count: 1000}
effective_medium: {sigma_t: random_walk}
"""
_LARGE = 2000.0  # radii, of a ball that no walk leaves


@cache
def folder() -> Path:
    """Where assets and pictures go."""
    made = Path(tempfile.gettempdir()) / "figures_granular"
    made.mkdir(exist_ok=True)
    return made


def asset(recipe, **settings):
    """An asset, baked: `recipe` is the text of one, or the path of a shipped one; settings as `bakery.bake` takes them."""
    if not isinstance(recipe, Path):
        text, recipe = recipe, folder() / "own.yaml"
        recipe.write_text(text)
    made = folder() / f"{recipe.stem}.h5"
    bakery.bake(recipe, output=made, settings=sized({}, {"tolerance": "20%", "packing.count": "100"}) | settings)
    return bakery.open(made)


def endless(found):
    """The grains of an asset in a large ball about the origin, without absorption."""
    grains = material.grains_of(found, *ball(np.zeros(3), _LARGE * unit(found)))
    return grains._replace(absorption=np.zeros_like(grains.absorption))


def unit(found):
    """Mean radius of an asset's grains, m."""
    return material._unit(found, material._tile(found))


def ball(middle, radius):
    """Vertices and triangles of a ball."""
    vertices, faces = icosphere(1280)
    return middle + radius * vertices, faces
