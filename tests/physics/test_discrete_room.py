"""Particles among Mitsuba's surfaces: a closed room that glows and reflects as much as it lacks, with a ball of glass in it.

Nothing absorbs, so radiance is 1 everywhere, whatever scatters.  Comparisons go wrong once in 1e7 seeds; seeds are fixed.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from bakery import kernels
from bakery.physics.shapes.radial import icosphere
from renderers.materials.particles import continuum, explicit, splat, walk
from renderers.mitsuba.world import World
from tests.conftest import slow
from tests.odds import sigmas
from tests.physics.particles import CUBE, averaged, hashed, henyey_greenstein, of_depth, passes

SIZE, PASSES = (9, 12), 12
ORDERS = "order0", "order1", "order2", "orders"
ROOM = """<scene version="3.0.0">
<shape type="cube"><boolean name="flip_normals" value="true"/>
<transform name="to_world"><scale value="2"/><translate x="0.5" y="0.5" z="0.5"/></transform>
<bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>
<emitter type="area"><rgb name="radiance" value="0.5"/></emitter></shape>
<shape type="sphere"><float name="radius" value="0.25"/><point name="center" x="0.7" y="-0.4" z="0.5"/>
<bsdf type="dielectric"/></shape>
<sensor type="perspective"><float name="fov" value="60"/>
<transform name="to_world"><lookat origin="0.5, -1.2, 0.5" target="0.5, 0.5, 0.5" up="0, 0, 1"/></transform>
<film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="9"/></film></sensor>
</scene>
"""


def room(folder):
    path = folder / "room.xml"
    path.write_text(ROOM)
    return World(path)


class Group(dict):
    """Datasets of an asset."""

    __getattr__ = dict.__getitem__


def picture(world, method, medium, numbers):
    """Passes (P, H, W, 3) of the cube of particles in the room: it fills the view, in part through the ball."""
    view = world.camera
    if method == "splats":
        return passes(walk.one_pass, world, walk.Discs(medium, splatted=True), view, SIZE, numbers) \
            + passes(splat.one_pass, world, medium, view, SIZE, numbers)
    if method == "mixed":  # particles as far as half of the cube, what `auto` does
        return passes(walk.one_pass, world, walk.Discs(medium, 0.0, splatted=True), view, SIZE, numbers, discrete=1.7) \
            + passes(splat.one_pass, world, medium, view, SIZE, numbers, discrete=1.7)
    how = {"particles": walk.Discs(medium), "continuous": walk.Discs(medium, 0.0),
           "explicit": explicit.Spheres(medium, np.array([1.33]), np.zeros((1, 1)))}[method]
    return passes(walk.one_pass, world, how, view, SIZE, numbers, discrete=0.0 if method == "continuous" else np.inf)


@pytest.mark.parametrize("method", [slow("particles"), slow("splats"), "mixed", slow("continuous"), slow("explicit")])
def test_a_white_room_is_white(tmp_path, method):
    medium = hashed(of_depth(2.0, 20_000, phase=henyey_greenstein(0.6)))
    mean, error = averaged(picture(room(tmp_path), method, medium, range(PASSES)).mean(axis=(1, 2, 3)))
    assert error < 0.025
    assert abs(mean - 1) < sigmas(PASSES) * error


@pytest.mark.slow
def test_all_orders_are_those_of_the_continuous_medium(tmp_path):
    """Absorbing particles, of which a part are particles to the eye and a part are not."""
    world = room(tmp_path)
    kinds = of_depth(2.0, 20_000, albedo=0.7, phase=henyey_greenstein(0.6))
    found = {}
    for method in ("mixed", "continuous"):
        found[method] = averaged([picture(world, method, hashed(kinds, seed=seed), [seed])[0].mean() for seed in range(PASSES)])
    (mean, error), (expected, other) = found.values()
    error = np.hypot(error, other)
    assert error < 0.035 * expected and expected < 0.9
    assert abs(mean - expected) < sigmas(PASSES) * error


@pytest.mark.slow
@pytest.mark.parametrize("where, host", [("box", 0.3), slow("grid", 0.0), slow("mesh", 0.0)])
def test_the_loop_is_the_walk_through_the_continuous_medium(tmp_path, where, host):
    """By order and by light: in a host that absorbs light, where more of the particles are in some places, and in a mesh."""
    world, density, (vertices, faces) = room(tmp_path), np.random.default_rng(1).random((3, 4, 5)), icosphere(80)
    ball = Group(mesh_vertices=0.5 * vertices + 0.5, mesh_faces=faces)
    region, group = {"box": (CUBE, Group()), "mesh": (kernels.region_mesh(ball.mesh_vertices, faces), ball),
                     "grid": (kernels.region_grid(np.zeros(3), np.ones(3), density), Group(density=density))}[where]
    medium = hashed(of_depth(4.0, 20_000, albedo=0.9, phase=henyey_greenstein(0.6), host=host), region)
    scene = SimpleNamespace(values=SimpleNamespace(materials=[SimpleNamespace(where=None)]))
    part = continuum.part(SimpleNamespace(world=world, medium=medium, region=region, group=group, scene=scene), 0)
    loop = [part.render(number) for number in range(2 * PASSES)]
    walked = [walk.one_pass(world, walk.Discs(medium, 0.0), world.camera, *SIZE, number, 0, discrete=np.zeros(SIZE), lights=1)
              for number in range(4 * PASSES)]
    (light,) = (f"light.{name}" for name in world.light_names)
    compared = [([layers[name] for layers in loop], [by_order[order] for by_order, _ in walked])
                for order, name in enumerate(ORDERS)]
    compared.append(([layers[light] for layers in loop], [by_light[0] for _, by_light in walked]))
    whole = np.mean([layers[""] for layers in loop])
    for ours, theirs in compared:
        (mean, error), (expected, other) = (averaged(np.mean(pictures, axis=(1, 2, 3))) for pictures in (ours, theirs))
        error = np.hypot(error, other)
        assert error < 0.02 * whole
        assert abs(mean - expected) < sigmas(2 * PASSES, comparisons=len(compared)) * error


def test_a_host_that_absorbs_light_in_the_box_of_a_mesh_is_left_to_the_walk(tmp_path):
    """It absorbs in all of the box, where the medium is in the mesh alone."""
    region = kernels.region_mesh(*icosphere(80))
    medium = hashed(of_depth(4.0, 20_000, host=0.3), region)
    assert continuum.part(SimpleNamespace(medium=medium, region=region), 0) is None
