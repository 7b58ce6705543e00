"""Assets laid out for the renderer of grains: which tile, which units, which voxels hold surfaces of the scene."""

from types import SimpleNamespace

import numpy as np
import pytest

from bakery import kernels
from bakery.physics.granular import sizes
from bakery.physics.granular.effective import void_chord
from bakery.physics.packing.law import Law
from bakery.physics.packing.radii import lognormal
from renderers import scene
from renderers.materials.grains import material
from tests.conftest import ROOT
from tests.physics.test_aggregate import CUBE, bumpy, tile


def group(**members):
    """Members of an asset's group: by name and as attributes."""

    class Members(dict):
        __getattr__ = dict.__getitem__

    return Members(members)


def packed(fraction):
    return group(centers=np.full((1, 3), 1.0), radii=np.ones(1), cell=np.full(3, 4.0), fraction=np.array([fraction]))


@pytest.mark.parametrize("wished, chosen, wider", [(0.5, 0.5, 1.0), (0.4, 0.5, 1.25), (0.55, 0.6, 0.6 / 0.55), (0.7, 0.6, 1.0)])
def test_the_tile_of_a_dictionary(wished, chosen, wider):
    """The least dense one that is dense enough, widened; the densest where none is."""
    asset = SimpleNamespace(packing=group(f50=packed(0.5), f60=packed(0.6), f10=packed(0.1)),
                            medium=group(fraction=np.array([wished])))
    centers, radii, cell, fraction = material._tile(asset)
    assert fraction == chosen
    assert np.allclose(cell, 4 * wider ** (1 / 3)) and np.allclose(centers, wider ** (1 / 3)) and np.all(radii == 1)
    asset.medium["tile_fraction"] = np.array([0.6])  # a choice that was stored holds
    assert material._tile(asset).fraction == 0.6
    asset.packing = packed(chosen)
    assert np.allclose(material._tile(asset).cell, cell)


def test_the_unit_is_the_mean_radius():
    """Of spheres of a law, though radii that stand for it in `grains` have a mean of 1.16."""
    law = Law("lognormal", sigma=2.0)
    radii, shares = sizes.classes(law)
    tile = packed(0.5) | {"radii": lognormal(law.sigma, 500)}
    asset = SimpleNamespace(packing=tile, grains=group(radius=3e-4 * radii, radius_share=shares),
                            medium=group(fraction=np.array([0.4]), void_chord=np.array([void_chord(0.4, 3e-4 * tile["radii"])])))
    assert material._unit(asset, material._tile(asset)) == pytest.approx(3e-4, rel=1e-12)


def test_voxels_with_surfaces():
    """Triangles exactly, boxes whole, nothing where there is nothing; in m of a world against the aggregate's unit."""
    aggregate = kernels.aggregate(*tile(), *bumpy(20.0))
    low, edge, count = aggregate.low, aggregate.edge, np.array(aggregate.voxels.shape)

    def occupied(triangles, boxes):
        return material.occupied_by(SimpleNamespace(extents=lambda within: (0.01 * np.array(triangles).reshape(-1, 3, 3),
                                                                            0.01 * np.array(boxes).reshape(-1, 2, 3))),
                                    aggregate, 0.01)

    middle = low + (count // 2 + 0.5) * edge
    floor = middle + 100 * np.array([[-1.0, -1.0, 0], [1.0, -1.0, 0], [0.0, 2.0, 0]])
    found = occupied(floor, [])
    assert found[:, :, count[2] // 2].all() and found.sum() == count[0] * count[1]
    found = occupied([], [middle - 0.6 * edge, middle + 0.6 * edge])
    assert found.sum() == 27 and np.all(found[tuple(count // 2)] == 1)
    assert occupied([], []).size == 0 and occupied(CUBE[0][:3] + 1e4, [CUBE[0][0] + 1e4, CUBE[0][7] + 1e4]).size == 0


def test_light_samples_are_seldom_far_inside():
    found = kernels.aggregate(*tile(), *bumpy(60.0))
    chance = material.seldom(found, 0.4)
    assert chance.max() == 1 and chance.min() == pytest.approx(1 / 64) and np.all(chance[found.voxels & 3 < 2] == 1)


SHIPPED = sorted(path for path in (ROOT / "assets/scenes").glob("*.yaml")
                 if path.read_text().count("where:") == path.read_text().count("where: {mesh") > 0)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_scenes(path):
    """Meshes, which grains fill, are closed; lengths are those of things on a table or a lawn."""
    for vertices, faces in material.meshes_of(scene.load(path)):
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        assert np.sum(a * np.cross(b, c)) > 0 and 1e-3 < np.ptp(vertices, axis=0).max() < 2
