"""Which ways to render a scene there are, by what the methods of its entries declare."""

from types import SimpleNamespace

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.materials.bodies import declared as bodies
from renderers.materials.grains import material
from renderers.materials.grains.declared import methods
from renderers.scene import candidates, meshes


def entry(kind, method="auto", recipe="a.yaml", **more):
    return SimpleNamespace(**{"kind": kind, "method": method, "asset": None, "recipe": recipe, "fraction": None, "mixture": None}
                           | more)


def offered(*materials):
    return candidates.of(SimpleNamespace(renderer="renderers.mixed", values=SimpleNamespace(materials=list(materials))))


def test_each_material_and_all_of_them_may_be_media():
    air, drops, beads, wax = entry("medium"), entry("particles"), entry("grains"), entry("body")
    first, wide, every, *alone = offered(air, drops, beads, wax)
    assert first.methods == ("paths", "particles", "ept", "paths") and first.exact and not first.replaced
    assert every.methods == ("paths", "continuous", "vpt", "paths") and every.replaced == (1, 2) and not every.exact
    assert [one.methods[1:3] for one in alone] == [("continuous", "ept"), ("particles", "vpt")]
    assert wide.methods == ("paths", "particles", "ept+wide", "paths") and not (wide.exact or wide.media) and wide.eligible
    assert every.name == "materials[1] by continuous; materials[2] by vpt"
    assert [one.stated(0.1) for one in (first, wide, every, *alone)] == [0.0, 0.02, 0.264, 0.0, 0.264]  # of grains as measured


def test_small_lamps_may_be_wider_in_grains():
    """In all grains whose method is open, unless none of them shows a small lamp."""
    listed = offered(entry("grains"), entry("grains", "ept", "b.yaml"), entry("grains", recipe="c.yaml"), entry("medium"))
    wide = listed[1]
    assert wide.methods == ("ept+wide", "ept", "ept+wide", "paths") and wide.stated(0.1) == pytest.approx(0.02 * 2**0.5)

    def grains(kind):
        surface = {"type": kind, "roughness": 0}
        return SimpleNamespace(grains=SimpleNamespace(exemplars={"a": SimpleNamespace(surface=surface)}))

    assets = [grains("diffuse"), grains("dielectric"), grains("dielectric"), None]
    lamp, panel, bulb = (SimpleNamespace(small_share=share, without_extent=False, noise_by_chance=noise)
                         for share, noise in ((0.1, 3.0), (0.01, 3.0), (0.1, 40.0)))
    sun = SimpleNamespace(small_share=0.9, without_extent=True)
    assert not wide.lacks(assets, lamp) and not wide.lacks(assets, sun)
    assert wide.lacks(assets[:2] + [assets[0], None], lamp) == wide.lacks(assets, panel) != ""
    # smooth grains beside others were rendered as if no sun shone; matt ones, and those by hand, are as they are
    assert "without extent" in listed[0].lacks(assets, sun) and not listed[0].lacks(assets, lamp)
    assert "hardly a path" in listed[0].lacks(assets, bulb) and not wide.lacks(assets, bulb)
    assert not listed[0].lacks([assets[0], assets[1], assets[0], None], sun)


def test_few_of_many_are_tried():
    """Entries of the same recipe have one method; no more than six combinations, the most promising first."""
    materials = [entry("particles", recipe=f"{name}.yaml") for name in "aabcde"]
    listed = offered(*materials)
    assert len(listed) == candidates.MOST and [one.replaced for one in listed[:3]] == [(), (0, 1, 2, 3, 4, 5), (0, 1)]


def test_what_is_named_is_kept():
    assert offered(entry("medium"), entry("body"), entry("particles", "particles")) == ()
    assert [one.methods for one in offered(entry("grains", fraction="a grid"), entry("medium"))] == [
        ("ept", "paths"), ("ept+wide", "paths")], "no medium knows of the grid"
    listed = offered(entry("particles"), entry("grains", "ept"))
    assert [one.methods for one in listed] == [("particles", "ept"), ("continuous", "ept")]
    asked, reference, other = offered(entry("particles"), entry("grains", "vpt"))
    assert asked.methods == ("particles", "vpt") and asked.eligible and not asked.exact
    assert asked.replaced == () and asked.media == (1,)
    assert reference.methods == ("particles", "ept") and reference.exact and not reference.eligible
    assert other.methods == ("continuous", "vpt") and other.replaced == (0,) and other.media == (0, 1)


@pytest.mark.parametrize("distance, deviation", [(1.0, 1.0), (1000.0, 0.002)])
def test_grains_that_can_be_told_apart_deviate_from_their_medium(monkeypatch, distance, deviation):
    """Of 2 mm, in a pixel of 1 mrad: 2 pixels wide, and 0.002."""
    vertices = np.array([[distance, 0, 0], [distance + 1, 0, 0], [distance + 1, 1, 0], [distance + 1, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    monkeypatch.setattr(meshes, "of_entry", lambda scene, number: (vertices, faces))
    monkeypatch.setattr(material, "largest_of", lambda asset: 1e-3)
    camera = Camera(np.zeros(3), np.ones(3), np.array([0, 1e-3, 0]), np.array([0, 0, 1e-3]))
    assert methods()["vpt"].deviation(None, 0, None, SimpleNamespace(camera=camera)) == pytest.approx(deviation)


@pytest.mark.parametrize("points, index, stages, slow", [(True, 1.5, ["multiple"], True), (False, 1.5, ["multiple"], False),
                                                         (True, 1.0, ["multiple"], False), (True, 1.5, ["medium"], False)])
def test_paths_in_bodies_take_long(points, index, stages, slow):
    """For light of points that a boundary refracts; without tables nothing stands in."""
    scene = SimpleNamespace(values=SimpleNamespace(materials=[SimpleNamespace(where=SimpleNamespace(shape="ball"))]))
    shapes = [SimpleNamespace(name="ball", index=index), SimpleNamespace(name="pane", index=1.5)]
    world = SimpleNamespace(without_extent=points, shapes=lambda: shapes)
    assert bool(bodies.methods()["paths"].slow(scene, [SimpleNamespace(stages=stages)], world)) == slow
