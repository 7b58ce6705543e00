"""Grains as shapes of a Mitsuba scene: the light of the wavefronts by order and by light, and a room that stays white.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

from bakery import kernels
from renderers.choice import trial
from renderers.materials.grains import bundles, methods, paths, shapes, transport
from renderers.materials.grains.listed import listed
from renderers.mitsuba.world import World
from tests.conftest import slow
from tests.odds import SIGMAS
from tests.oracles.instances import instances
from tests.physics.test_aggregate import bumpy, tile
from tests.physics.test_aggregate import listed as reference
from tests.physics.test_granular_medium import agree
from tests.physics.test_granular_render import COLOURS, GLASS, MATT, ROOM, SCENE, STEEL, STEELY, STONE, Kind, grains, place

import drjit as dr  # isort: skip  behind renderers.mitsuba, which finds LLVM
import mitsuba as mi  # isort: skip

BODY, PASSES = bumpy(4.0), 12


def test_every_grain_is_listed():
    """Those of the plain list, each with the type and the rotation of the hash."""
    spheres = tile(0.5, 40)
    packed = grains([Kind(GLASS), Kind(MATT, STONE)], BODY, spheres, weights=[0.3, 0.7])
    sphere, centre, radius = reference(*spheres, *BODY)
    kind, _ = instances(int(packed.seed), sphere[:, 1:], sphere[:, 0], np.diff(packed.shares, prepend=0.0))
    found = listed(packed)
    order, expected = np.lexsort(found.centre.round(6).T), np.lexsort(centre.round(6).T)
    assert len(centre) > 20 and np.allclose(found.centre[order], centre[expected])
    assert np.array_equal(found.kind[order], kind[expected]) and np.allclose(found.radius[order], radius[expected])
    assert np.allclose(found.turn @ found.turn.transpose(0, 2, 1), np.eye(3))


@pytest.mark.slow
def test_the_loop_is_the_wavefronts(tmp_path, monkeypatch):
    """By order and by light: clear, matt and rough balls and stones that absorb, of two bodies, with a floor through them;
    through the pixels of a pilot, which are bundles of the picture's."""
    (tmp_path / "scene.xml").write_text(SCENE.replace("MORE", ""))
    world = bundles.as_close(trial.smaller(World(tmp_path / "scene.xml", size=(36, 48)), 9 * 12))
    assert world.size == (9, 12) and world.corners.max() > 40
    vertices, faces = bumpy(2.5)
    kinds = [Kind(GLASS, STONE), Kind(kernels.diffuse([0.9, 0.6, 0.2]), STONE), Kind(STEELY, radius=0.8), Kind(GLASS),
             Kind(kernels.dielectric(1.5, 0.4), STONE)]
    meshes = [(vertices + side * np.array([abs(vertices[:, 0]).max(), 0, 0]), faces) for side in (-1, 1)]
    bodies = [grains(kinds, mesh, tile(0.5, 40), absorption=0.2) for mesh in meshes]
    everywhere = [np.ones(body.aggregate.voxels.shape, np.uint8) for body in bodies]
    explicit = tuple(paths.Explicit(body, occupied, COLOURS) for body, occupied in zip(bodies, everywhere))
    scene = transport.Transport(tuple(transport.Body(grain, None, 1.0) for grain in explicit), COLOURS)
    part = methods.part(world, scene, "ept", 0)
    assert part.samples == 64, "by shapes"
    monkeypatch.setattr(shapes, "fit", lambda *scene: False)
    fewest = [methods.part(world, scene, "ept", 0, meetings=number).fewest for number in (9_000, 10_000)]
    assert fewest == [1, 1 / 16], "a pass of a million grains"
    monkeypatch.undo()
    loop = [part.render(number) for number in range(PASSES)]
    sums = [transport.one_pass(world, scene, world.camera, (9, 12), number, 0, corners=world.corners, samples=64)
            for number in range(PASSES)]
    agree(loop, sums, world.light_names, 0.01)


@pytest.mark.parametrize("eye", [slow((0.0, -15.0, 3.0)), (0.2, 0.1, 0.3)], ids=["outside", "in a grain"])
def test_a_white_room(tmp_path, eye):
    """Walls that emit 0.8 and reflect 0.2: radiance 1 everywhere, with all kinds of grains, also from inside of glass."""
    (tmp_path / "room.xml").write_text(ROOM)
    view = {"origin": eye, "target": (0.1, 2.0, 0.0), "up": (0.0, 0.0, 1.0), "fov": 50.0}
    world = World(tmp_path / "room.xml", view=view, size=(16, 16))
    kinds = [Kind(GLASS), Kind(MATT, STONE), Kind(STEEL), Kind(GLASS, STONE)]
    how = transport.Transport((transport.Body(place(grains(kinds, bumpy(6.0), tile(0.5, 40)), world), None, 1.0),), COLOURS)
    assert shapes.fit(world, [how.bodies[0].grains])
    part = methods.part(world, how, "ept", 0)
    means = np.array([part.render(number)[""].mean() for number in range(16)])
    error = means.std(ddof=1) / 4
    assert error < 1.5e-3 and abs(means.mean() - 1) < SIGMAS * error


def test_scenes_with_instances_have_wavefronts(tmp_path):
    """The groups of instances are no shapes that another scene could take over."""
    group = """<shape type="shapegroup" id="group"><shape type="cube"/></shape><shape type="instance"><ref id="group"/></shape>"""
    (tmp_path / "room.xml").write_text(ROOM.replace("</scene>", group + "</scene>"))
    world = World(tmp_path / "room.xml", view={"origin": (0.0, -15.0, 3.0), "target": (0.0, 0.0, 0.0), "up": (0.0, 0.0, 1.0),
                                               "fov": 50.0}, size=(4, 4))
    assert not shapes.fit(world, [place(grains([Kind(GLASS)], bumpy(1.0), tile(0.5, 40)), world)])


@pytest.mark.parametrize("surface, mesh, fits", [(MATT, bumpy(24.0), True), (GLASS, bumpy(24.0), False),
                                                 (MATT, (bumpy(4.0)[0] + 1e5, bumpy(4.0)[1]), False)])
def test_which_grains_fit(tmp_path, surface, mesh, fits):
    """Thousands of opaque balls do; clear ones are quicker in wavefronts; those a hundred thousand radii away lack digits."""
    (tmp_path / "scene.xml").write_text(SCENE.replace("MORE", ""))
    packed, world = grains([Kind(surface)], mesh, tile(0.5, 40)), World(tmp_path / "scene.xml")
    assert shapes.fit(world, [paths.Explicit(packed, np.zeros((0, 0, 0), np.uint8), COLOURS)]) == fits
    assert len(listed(packed).radius) > (2048 if mesh[0].max() < 1e3 else 10)


@pytest.mark.parametrize("radius, fits", [(0.03, False), (0.4, True), (20.0, True)])
def test_balls_are_met_where_they_are(tmp_path, radius, fits):
    """60 radii away, by the closed form in double precision.  Mitsuba's own distances are off by up to 0.0035 of a radius of 0.4
    units, and by more of smaller ones: light samples ended behind the lamp's surface; balls of 0.1 units were 5 % too dark."""
    mesh = bumpy(4.0)
    eye = np.array([0.0, -60.0, 5.0]) * radius
    (tmp_path / "scene.xml").write_text(ROOM.replace('"20"', '"2000"'))
    world = World(tmp_path / "scene.xml", view={"origin": tuple(eye), "target": (0.0, 0.0, 0.0), "up": (0.0, 0.0, 1.0),
                                                "fov": 8.0}, size=(4, 4))
    packed = grains([Kind(MATT)], mesh, tile(0.5, 40), unit=radius)
    assert shapes.fit(world, [paths.Explicit(packed, np.zeros((0, 0, 0), np.uint8), COLOURS)]) == fits
    if not fits:
        return
    centre = radius * listed(packed).centre
    towards = centre[np.arange(2048) % len(centre)] + 0.9 * radius * np.random.default_rng(1).uniform(-0.5, 0.5, (2048, 3)) - eye
    towards = (towards / np.linalg.norm(towards, axis=1)[:, None]).astype(np.float32).astype(float)
    ray = mi.Ray3f(mi.Point3f(eye), mi.Vector3f(towards.T))
    scene = shapes.Scene(world, [packed], COLOURS)  # kept while its kernel runs
    hit = scene.reached(ray, dr.zeros(mi.UInt32, len(towards)), dr.full(mi.Bool, True, 2048))
    to, square = centre[None] - eye, np.sum(towards**2, axis=1)[:, None]
    along = np.einsum("rnk,rk->rn", np.broadcast_to(to, (len(towards), *centre.shape)), towards) / square
    miss = np.linalg.norm(to - along[..., None] * towards[:, None], axis=2)
    exact = np.where(miss < 0.99 * radius, along - np.sqrt(np.maximum(radius**2 - miss**2, 0) / square), np.inf).min(axis=1)
    grazed = np.any((miss > 0.99 * radius) & (miss < 1.01 * radius), axis=1)
    off = np.abs(np.array(hit.t) - exact)[~grazed] / radius
    assert np.count_nonzero(~grazed) > 1000 and off.max() < 5e-4


def test_no_grain_is_counted_beside_a_body_of_too_many(tmp_path, monkeypatch):
    """Every grain of the first body would be looked up in vain: the second is 25 times as wide."""
    (tmp_path / "scene.xml").write_text(SCENE.replace("MORE", ""))
    world, packed = World(tmp_path / "scene.xml"), [grains([Kind(MATT)], bumpy(size), tile(0.5, 40)) for size in (6.0, 150.0)]
    bodies = [paths.Explicit(each, np.zeros((0, 0, 0), np.uint8), COLOURS) for each in packed]
    assert shapes.fit(world, bodies[:1])
    monkeypatch.setattr(shapes, "listed", lambda grains: pytest.fail("grains are looked up"))
    assert not shapes.fit(world, bodies)
