"""Particles, grains, bodies and media in one scene: a white room stays white, and Mitsuba's integrators see the same where all
is continuous.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

from bakery import kernels
from renderers.materials.bodies.bodies import solid_shape
from renderers.materials.grains import material, paths, transport
from renderers.materials.particles import walk
from renderers.mitsuba.world import World
from renderers.mixed import build, passes
from renderers.mixed.build import Material
from renderers.mixed.contents import Body
from renderers.transport import places, regions, waves
from renderers.transport.paths import Colours
from renderers.transport.scattering import of_asset
from tests.odds import sigmas
from tests.physics.particles import hashed, henyey_greenstein, of_depth
from tests.physics.test_aggregate import tile
from tests.physics.test_granular_render import GLASS, MATT, STONE, Kind, grains, through
from tests.physics.test_translucent import BOUNDARIES, FLOOR, PANEL, SKY, shape
from tests.physics.test_transport import asset, box
from tests.physics.test_transport_media import BALL, DENSITY, cube, glass_in_fog, matched_in_a_box, on_a_grid, pictures, sensor

COLOURS = Colours(np.eye(3), np.eye(3))
WHITE = [1.0] * 3
WALLS = cube((-9, -9, -9), (9, 9, 9), '<boolean name="flip_normals" value="true"/><bsdf type="diffuse"><rgb name="reflectance" '
             'value="0.3 0.3 0.3"/></bsdf><emitter type="area"><rgb name="radiance" value="0.7 0.7 0.7"/></emitter>', "walls")


def moved(mesh, scale, shift):
    return scale * mesh[0] + np.array(shift, float), mesh[1]


def scatterer(albedo, g, free_path):
    return of_asset(asset(albedo, g, free_path))


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
    filled = solid_shape(world.shapes(), name, None, lambda key, message: ValueError(message))
    inside = scatterer(albedo, g, free_path)
    return build.material_of(Body(name, filled.vertices, filled.faces, inside, filled.index == 1.0, filled))


def averages(world, materials, numbers):
    part = passes.part("paths", build.scene_of(world, materials, COLOURS), 0)
    return np.array([part.render(number)[""] for number in numbers])


def white(pictures, most):
    """By rows of pictures, all of which scatter."""
    rows = pictures.mean(axis=(2, 3)).ravel()
    error = rows.std(ddof=1) / rows.size**0.5
    assert error < most and abs(rows.mean() - 1) < sigmas(rows.size) * error


def test_everything_in_a_white_room(tmp_path):
    """Nothing absorbs: particles in fog, around grains, around and beside bodies, a grid, all of which overlap."""
    glass, matched = moved(BALL, 0.6, (-3, 0, 0)), moved(BALL, 0.5, (3, 0, 0))
    scene = sensor("0, -8, 1", size=20) + WALLS + shape(tmp_path, "glass", glass, BOUNDARIES[1.4]) \
        + shape(tmp_path, "matched", matched, BOUNDARIES[1.0])
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{scene}</scene>')
    world = World(tmp_path / "scene.xml")
    white(averages(world, [
        medium(places.EVERYWHERE, WHITE, 0.3, (9.0, 7.0, 5.0)),
        particles((-4, -4, -2), (4, 4, 2), 0.4),
        stones(moved(BALL, 0.5, (0, 0, 1.5))),
        medium(places.box((-4, -2, 2), (4, 2, 5)), WHITE, 0.8, (0.5,) * 3, kernels.region_grid((-4, -2, 2), (4, 2, 5), DENSITY)),
        body(world, "glass", WHITE, 0.0, (1.0, 1.5, 2.0)),
        body(world, "matched", WHITE, 0.5, (0.7,) * 3)], range(3)), 0.008)


@pytest.mark.slow
def test_a_white_slab_thinner_than_mitsubas_rays_leap(tmp_path):
    """0.2 mm of glass 6 m wide; 0.86 where rays go on 0.36 mm beside its faces."""
    scene = sensor("0, -16, 3", size=8) + SKY + shape(
        tmp_path, "slab", box((-3, -1e-4, -3), (3, 1e-4, 3)), BOUNDARIES[1.4] + '<boolean name="face_normals" value="true"/>')
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{scene}</scene>')
    world = World(tmp_path / "scene.xml")
    white(averages(world, [body(world, "slab", WHITE, 0.3, (1e-4,) * 3)], range(8)), 0.01)


# ---- the same as other renderers where they can render it


def compared(ours, theirs, most=0.01):
    """Means by colour of passes, within chance, and both known to a share."""
    means, errors = zip(*((found.mean(axis=(0, 1, 2)), found.mean(axis=(1, 2)).std(axis=0, ddof=1) / len(found)**0.5)
                          for found in (ours, theirs)))
    error = np.hypot(*errors)
    assert np.all(error < most * means[1])
    assert np.all(abs(means[0] - means[1]) < sigmas(min(len(ours), len(theirs)), comparisons=3) * error)


@pytest.mark.slow
@pytest.mark.parametrize("scene, most", [(matched_in_a_box, 0.01), (glass_in_fog, 0.05), (on_a_grid, 0.01)])
def test_media_and_bodies_as_the_loop_of_dr_jit(tmp_path, scene, most):
    """Which is held against Mitsuba's volpathmis in test_transport_media."""
    xml, entries, *_ = scene(tmp_path)
    theirs = pictures(tmp_path, xml, entries, range(64))
    world = World(tmp_path / "scene.xml")
    filled = [build.material_of(entry) if isinstance(entry, regions.Medium) else of_body(world, entry) for entry in entries]
    compared(averages(world, filled, range(32)), theirs, most)


@pytest.mark.slow
def test_fog_around_a_lamp_far_from_all_else(tmp_path):
    """A bulb without extent, alone with its glow: as the loop of Dr.Jit sees it; roulette ended all paths out there."""
    xml = sensor(size=8) + POINT
    theirs = pictures(tmp_path, xml, [regions.Medium(regions.Everywhere(), scatterer([0.9, 0.6, 0.3], 0.4, (9.0, 6.0, 4.0)))])
    # many passes, as light close to the lamp has no bound: one of the first 48 has 37 times their median
    fog = medium(places.EVERYWHERE, [0.9, 0.6, 0.3], 0.4, (9.0, 6.0, 4.0))
    ours = averages(World(tmp_path / "scene.xml"), [fog], range(480))
    compared(ours, theirs, 0.15)


def of_body(world, entry):
    (found,) = (one for one in world.shapes() if one.name == entry.name)
    return build.material_of(Body(entry.name, entry.vertices, entry.faces, entry.medium, entry.matched,
                                  found._replace(vertices=entry.vertices, faces=entry.faces)))


def lit(folder):
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{sensor("0, -8, 1", size=48)}{FLOOR}{PANEL}</scene>')
    return World(folder / "scene.xml")


@pytest.mark.slow
def test_particles_as_their_own_renderer(tmp_path):
    world, alone = lit(tmp_path), particles((-4, -4, -4), (4, 4, 4), 0.4, albedo=0.8)
    theirs = [walk.one_pass(world, walk.Discs(alone.content), world.camera, 48, 48, number, 1, discrete=np.full((48, 48), np.inf),
                            lights=1)[0].sum(axis=0) for number in range(16)]
    compared(averages(world, [alone], range(4)), np.array(theirs), 0.02)


@pytest.mark.slow
def test_grains_as_their_own_renderer(tmp_path):
    world, alone = lit(tmp_path), stones(BALL)
    around = material.occupied_by(world, alone.content.aggregate, alone.content.unit)
    alike = through(paths.Explicit(alone.content, around, COLOURS))
    theirs = [transport.one_pass(world, alike, world.camera, (48, 48), number, 1).by_order.sum(axis=0).reshape(48, 48, 3)
              for number in range(16)]
    compared(averages(world, [alone], range(16)), np.array(theirs), 0.02)


# ---- small lamps in smooth grains, seen as discs


def sparkling(folder, light, walls=30.0):
    """Balls of glass before a lamp, between black walls."""
    black = cube((-walls,) * 3, (walls,) * 3, '<boolean name="flip_normals" value="true"/><bsdf type="diffuse"><rgb name='
                 '"reflectance" value="0 0 0"/></bsdf>', "walls")
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{sensor("0, -8, 1", size=24) + black + light}</scene>')
    return World(folder / "scene.xml")


def glinting(world, materials, passes_of, chord=0.8):
    """Means by pass of the light that grains send on."""
    around = build.scene_of(world, materials, COLOURS)._replace(chord=chord)
    return np.array([waves.one_pass(around, (24, 24), number, 0, 64).by_order[1:].sum(axis=0).mean(axis=0) / 64
                     for number in range(passes_of)])


POINT = '<emitter type="point"><point name="position" x="2" y="-3" z="12"/><rgb name="intensity" value="50"/></emitter>'


@pytest.mark.slow
def test_discs_in_grains_beside_others_are_those_of_grains_alone(tmp_path):
    """A bulb in balls of glass, by waves and by the loop of grains, with the same disc."""
    world = sparkling(tmp_path, '<shape type="sphere"><point name="center" x="2" y="-3" z="12"/><float name="radius" '
                                'value="0.1"/><emitter type="area"><rgb name="radiance" value="999"/></emitter></shape>')
    alone = stones(moved(BALL, 0.5, (0, 0, 0)), (GLASS,))
    around = material.occupied_by(world, alone.content.aggregate, alone.content.unit)
    alike = through(paths.Explicit(alone.content, around, COLOURS))._replace(chord=0.8)
    theirs = np.array([transport.one_pass(world, alike, world.camera, (24, 24), number, 1, samples=64).by_order[1:].sum(axis=0)
                       .mean(axis=0) for number in range(12)])
    ours = glinting(world, [alone], 12)
    assert min(ours.mean(), theirs.mean()) > 0
    compared(ours[:, None, None], theirs[:, None, None], 0.05)


@pytest.mark.slow
def test_fog_takes_as_much_of_a_disc_as_of_its_lamp(tmp_path):
    """Black fog of 1 / 25 m: on the 8 m to the grains and the 12 m to the lamp exp(-0.8) are left, whatever is on the 18 m behind
    it; grains are 1.5 m wide, and light by way of several of them goes farther, which is 0.05 of the logarithm."""
    world, alone = sparkling(tmp_path, POINT), stones(moved(BALL, 0.3, (0, 0, 0)), (GLASS,))
    fog = medium(places.EVERYWHERE, [0.0] * 3, 0.0, (25.0,) * 3)
    clear, dimmed = glinting(world, [alone], 12), glinting(world, [alone, fog], 24)
    error = np.hypot(*(found.mean(axis=1).std(ddof=1) / len(found)**0.5 / found.mean() for found in (clear, dimmed)))
    assert error < 0.05
    assert abs(np.log(dimmed.mean() / clear.mean()) + 0.82) < sigmas(12) * error + 0.05


def test_lamps_without_extent_shine_through_bodies_that_refract_nothing(tmp_path):
    """A bulb within a body and behind another, both next to empty, beside particles: 0 and shadows where light samples from the
    floor ended at such boundaries."""
    blind = shape(tmp_path, "around", moved(BALL, 0.5, (2, -3, 12)), BOUNDARIES[1.0]) \
        + shape(tmp_path, "between", moved(BALL, 0.8, (1, -1, 0)), BOUNDARIES[1.0])
    means = []
    for shapes in ("", blind):
        (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{sensor(size=8) + FLOOR + POINT + shapes}</scene>')
        world = World(tmp_path / "scene.xml")
        empty = [body(world, name, [0.0] * 3, 0.0, (1e6,) * 3) for name in ("around", "between") if shapes]
        means.append(averages(world, [particles((-1, -1, 20), (1, 1, 22), 0.1), *empty], range(16)))
    compared(means[1], means[0], 0.005)


def test_the_material_of_a_pixel_that_few_paths_scatter_in():
    """As the loop of continuous media has it: thin fog counts where nothing else scatters."""
    shares = np.array([[[0.0, 0.0], [0.1, 0.0], [0.1, 0.2], [0.6, 0.4]]])
    assert passes.material_layer(shares).tolist() == [[-1, 0, 1, 0]]
