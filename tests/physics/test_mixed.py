"""Particles, grains, bodies and media in one scene: a white room stays white, and Mitsuba's integrators see the same where all
is continuous.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

from __future__ import annotations

import numpy as np

from bakery import kernels
from renderers.granular.paths import Colours
from renderers.mitsuba.world import World
from renderers.mixed import build, passes
from renderers.mixed.build import Material
from renderers.mixed.contents import Body
from renderers.translucent.bodies import solid_shape, untabled
from renderers.transport import places
from tests.odds import sigmas
from tests.physics.particles import hashed, henyey_greenstein, of_depth
from tests.physics.test_aggregate import tile
from tests.physics.test_granular_render import GLASS, MATT, STONE, Kind, grains
from tests.physics.test_translucent import BOUNDARIES, shape
from tests.physics.test_transport import asset
from tests.physics.test_transport_media import BALL, DENSITY, cube, sensor

COLOURS = Colours(np.eye(3), np.eye(3))
WHITE = [1.0] * 3
WALLS = cube((-9, -9, -9), (9, 9, 9), '<boolean name="flip_normals" value="true"/><bsdf type="diffuse"><rgb name="reflectance" '
             'value="0.3 0.3 0.3"/></bsdf><emitter type="area"><rgb name="radiance" value="0.7 0.7 0.7"/></emitter>', "walls")


def moved(mesh, scale, shift):
    return scale * mesh[0] + np.array(shift, float), mesh[1]


def scatterer(albedo, g, free_path):
    return untabled(asset(albedo, g, free_path))


def medium(region, albedo, g, free_path, density=None):
    return Material(region, scatterer(albedo, g, free_path), density=density)


def particles(lo, hi, optical_depth, albedo=1.0, number=2000, g=0.6, waves=3):
    """Particles in a box: optical depth a metre."""
    volume = float(np.prod(np.subtract(hi, lo)))
    kinds = of_depth(optical_depth, number, volume, waves=waves, albedo=albedo, phase=henyey_greenstein(g))
    return Material(places.box(lo, hi), hashed(kinds, kernels.region_box(lo, hi)), "particles")


def stones(mesh, kinds=(GLASS, MATT), radius=0.4):
    """Grains in a mesh, m."""
    packed = grains([Kind(kinds[0]), Kind(kinds[-1], STONE)], (mesh[0] / radius, mesh[1]), tile(0.5, 40), unit=radius)
    return Material(places.mesh(*mesh, solid=True), packed, "grains")


def body(world, name, albedo, g, free_path):
    filled, inside = solid_shape(world.shapes(), name, None, lambda key, message: ValueError(message)), scatterer(albedo, g, free_path)
    return build.material_of(Body(name, filled.vertices, filled.faces, inside, filled.index == 1.0, filled))


def averages(world, materials, numbers):
    part = passes.part("paths", build.scene_of(world, materials, COLOURS), 0)
    return np.array([part.render(number)[""] for number in numbers])


def white(pictures, most=0.004):
    found = pictures.mean(axis=(1, 2, 3))
    error = found.std(ddof=1) / len(found)**0.5
    assert error < most and abs(found.mean() - 1) < sigmas(len(found)) * error


def test_everything_in_a_white_room(tmp_path):
    """Nothing absorbs: particles in fog, around grains, around and beside bodies, a grid, all of which overlap."""
    glass, matched = moved(BALL, 0.6, (-3, 0, 0)), moved(BALL, 0.5, (3, 0, 0))
    scene = sensor("0, -8, 1", size=16) + WALLS + shape(tmp_path, "glass", glass, BOUNDARIES[1.4]) \
        + shape(tmp_path, "matched", matched, BOUNDARIES[1.0])
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{scene}</scene>')
    world = World(tmp_path / "scene.xml")
    white(averages(world, [
        medium(places.EVERYWHERE, WHITE, 0.3, (9.0, 7.0, 5.0)),
        particles((-4, -4, -2), (4, 4, 2), 0.4),
        stones(moved(BALL, 0.5, (0, 0, 1.5))),
        medium(places.box((-4, -2, 2), (4, 2, 5)), WHITE, 0.8, (0.5,) * 3, kernels.region_grid((-4, -2, 2), (4, 2, 5), DENSITY)),
        body(world, "glass", WHITE, 0.0, (1.0, 1.5, 2.0)),
        body(world, "matched", WHITE, 0.5, (0.7,) * 3)], range(16)))
