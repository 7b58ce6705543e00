"""Pictures of explicit grains: a white room stays white, and Mitsuba's path tracer sees the same among the same grains.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

from bakery import kernels
from bakery.physics.packing.instances import rotation_matrix
from bakery.store import ply
from renderers.materials.grains import material, medium, paths, transport
from renderers.materials.grains._grains import Grains
from renderers.mitsuba.world import World
from renderers.transport.paths import Colours
from tests.conftest import slow
from tests.odds import ODDS, SIGMAS
from tests.oracles.instances import instances
from tests.physics.particles import Sky, blocks, camera, same
from tests.physics.test_aggregate import CUBE, bumpy, listed, tile

GLASS, MATT, STEEL = kernels.dielectric(1.5), kernels.diffuse(1.0), kernels.conductor(complex(np.inf, 0))
STONE = bumpy(0.75)  # a grain


class Kind:
    """A type of grain: a ball, or a mesh."""

    def __init__(self, surface, mesh=None, radius=1.0):
        self.surface, self.mesh, self.radius = surface, None if mesh is None else kernels.Mesh(*mesh), radius


def grains(kinds, mesh, spheres=None, unit=1.0, waves=3, absorption=0.0, weights=None):
    """`Grains` in a mesh in units; of each type the surface's own channels, and one absorption (1/unit) for all."""
    channels = np.array([np.broadcast_to(kind.surface.channels, (2, waves)) for kind in kinds])
    aggregate = kernels.aggregate(*(spheres or tile()), *mesh)
    return Grains(aggregate, unit, np.uint64(3),
                  kernels.cumulated_shares(weights or np.ones(len(kinds))), kernels.exemplars(kinds), channels,
                  np.full((len(kinds), waves), absorption), material.seldom(aggregate, 0.4))


COLOURS = Colours(np.eye(3), np.eye(3))  # three wavelengths that are R, G and B
NOTHING = np.zeros((0, 0, 0), np.uint8)


def place(found, world=None):
    """The way of light among explicit grains."""
    around = NOTHING if world is None else material.occupied_by(world, found.aggregate, found.unit)
    return paths.Explicit(found, around, COLOURS)


def through(way):
    """How light goes through one body, by its grains or its medium alone; as it is, if that is said already."""
    if isinstance(way, transport.Transport):
        return way
    if isinstance(way, medium.Continuous):
        return transport.Transport((transport.Body(None, way, 1.0),), COLOURS, transport.MEDIUM)
    return transport.Transport((transport.Body(way, None, 1.0),), COLOURS)


def passes(world, where, view, size, numbers):
    """Pictures (passes, H, W, 3)."""
    return np.array([transport.one_pass(world, through(where), view, size, number, 0).by_order.sum(axis=0).reshape(*size, 3)
                     for number in numbers])


ALL_AROUND = camera((24, 24), (0.0, -40.0, 3.0), (0.0, 0.0, 0.0), 34)


@pytest.mark.parametrize("kind", [Kind(GLASS), Kind(GLASS, STONE), Kind(STEEL, STONE), Kind(STEEL, radius=0.7),
                                  Kind(kernels.dielectric(1.0), STONE)], ids=["glass", "stones", "steel", "beads", "air"])
def test_nothing_is_lost_at_smooth_grains(kind):
    """In light from everywhere each single path brings 1, however often it was reflected."""
    found = passes(Sky(above=1, below=1), place(grains([kind], bumpy(9.0))), ALL_AROUND, (24, 24), [0])
    assert np.allclose(found, 1.0, rtol=1e-12)


def test_matt_white_grains_in_light_from_everywhere():
    """Each pixel's mean is 1: light samples and directions of the path together count all light once."""
    where = place(grains([Kind(MATT), Kind(MATT, STONE), Kind(GLASS, STONE)], bumpy(6.0), tile(0.3, 40)))
    found = passes(Sky(above=1, below=1), where, camera((8, 8), (0.0, -25.0, 3.0), (0.0, 0.0, 0.0), 34), (8, 8), range(200))
    mean, error = found.mean(), found.mean(axis=(1, 2, 3)).std(ddof=1) / np.sqrt(200)
    assert error < 2e-3 and abs(mean - 1) < SIGMAS * error


def test_absorption_takes_what_the_way_through_says():
    """Balls of the host's index only absorb: Beer and Lambert along straight lines, for each wavelength."""
    found = grains([Kind(kernels.dielectric(1.0))], bumpy(6.0))
    found.absorption[:] = [[0.0, 0.1, 0.5]]
    view = camera((16, 16), (0.0, -40.0, 3.0), (0.0, 0.0, 0.0), 12)
    picture = passes(Sky(above=1, below=1), place(found), view, (16, 16), range(3))
    assert np.allclose(picture[..., 0], 1)
    assert np.allclose(picture[..., 2], picture[..., 1] ** 5) and picture.min() < 0.05


@pytest.mark.slow
def test_light_samples_may_be_seldom():
    """Matt and rough grains in the sun: how often lights are sampled makes no difference to the mean."""
    rough = kernels.conductor(complex(np.inf, 0), 0.5), kernels.dielectric(1.5, 0.5)
    kinds = [Kind(kernels.diffuse(0.9)), Kind(rough[0], STONE), Kind(rough[1])]
    view, found = camera((16, 16), (0.0, -25.0, 3.0), (0.0, 0.0, 0.0), 22), []
    for chance in (1.0, 0.3):
        where = grains(kinds, bumpy(6.0), tile(0.4, 40))
        where.chance[:] = chance
        found.append(blocks(passes(Sky((1, 1, -1), above=0.5), place(where), view, (16, 16), range(200, 300)), (4, 4)))
    often, seldom = (one.reshape(10, 10, 4, 4).mean(axis=1) for one in found)
    assert same(often, seldom) > ODDS and same(often, 1.2 * seldom) < ODDS


def test_orders_are_grains():
    """The order counts a grain once, however often light meets its surface."""
    alone = np.array([[0.5, 0.5, 0.5]]), np.ones(1), np.full(3, 2.5)
    one = grains([Kind(GLASS)], (0.2 * CUBE[0] + 0.4, CUBE[1]), alone)
    view = camera((16, 16), (0.5, -20.0, 0.5), (0.5, 0.5, 0.5), 5)
    sums = transport.one_pass(Sky(above=1, below=1), through(place(one)), view, (16, 16), 0, 0)
    by_order, by_light = sums.by_order, sums.by_light
    assert np.all(by_order[2:] == 0) and np.allclose(by_order.sum(axis=0), 1) and np.allclose(by_light.sum(axis=0), 1)
    assert by_order[1].mean() == pytest.approx(np.pi / (2 * 20.5 * np.tan(np.radians(2.5))) ** 2, rel=0.1)


def test_the_same_bytes_whatever_threads(monkeypatch):
    from renderers import threads

    where = place(grains([Kind(GLASS, STONE), Kind(MATT)], bumpy(6.0)))
    view = camera((80, 64), (0.0, -25.0, 3.0), (0.0, 0.0, 0.0), 34)
    found = passes(Sky((0, 1, -1), above=1), where, view, (80, 64), [5])
    monkeypatch.setattr(threads, "_pool", lambda: threads.ThreadPoolExecutor(1))
    assert np.array_equal(found, passes(Sky((0, 1, -1), above=1), where, view, (80, 64), [5]))


# ---- scenes of Mitsuba

ROOM = """<scene version="3.0.0"><sensor type="perspective"/>
<shape type="cube"><transform name="to_world"><scale value="20"/></transform>
<boolean name="flip_normals" value="true"/><bsdf type="diffuse"><rgb name="reflectance" value="0.2 0.2 0.2"/></bsdf>
<emitter type="area"><rgb name="radiance" value="0.8 0.8 0.8"/></emitter></shape></scene>"""


@pytest.mark.parametrize("eye", [slow((0.0, -15.0, 3.0)), (0.2, 0.1, 0.3)], ids=["outside", "in a grain"])
def test_a_white_room(tmp_path, eye):
    """Walls that emit 0.8 and reflect 0.2: radiance 1 everywhere, with all kinds of grains."""
    (tmp_path / "room.xml").write_text(ROOM)
    world = World(tmp_path / "room.xml")
    kinds = [Kind(GLASS), Kind(MATT, STONE), Kind(STEEL), Kind(GLASS, STONE)]
    where = place(grains(kinds, bumpy(6.0), tile(0.5, 40)), world)
    found = passes(world, where, camera((64, 64), eye, (0.1, 2.0, 0.0), 50), (64, 64), range(16))
    error = found.mean(axis=(1, 2, 3)).std(ddof=1) / 4
    assert error < 1.5e-3 and abs(found.mean() - 1) < SIGMAS * error


def test_a_surface_in_a_grain(tmp_path):
    """A lamp cuts a ball in half, which absorbs light on its way through the other half."""
    (tmp_path / "lamp.xml").write_text("""<scene version="3.0.0"><sensor type="perspective"/><shape type="rectangle">
        <emitter type="area"><rgb name="radiance" value="1 1 1"/></emitter></shape></scene>""")
    alone = np.array([[0.0, 0.0, 0.0]]), np.ones(1), np.full(3, 2.5)
    world = World(tmp_path / "lamp.xml")
    where = place(grains([Kind(kernels.dielectric(1.0))], (0.2 * CUBE[0] - 0.1, CUBE[1]), alone, absorption=1.0), world)
    found = passes(world, where, camera((4, 4), (0.0, 0.0, 9.0), (0.0, 0.0, 0.0), 0.1, (0, 1, 0)), (4, 4), [0])
    assert np.allclose(found, np.exp(-1), rtol=1e-3)


SCENE = """<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="-1"/><integer name="rr_depth" value="100"/></integrator>
<sensor type="perspective"><float name="fov" value="26"/><transform name="to_world">
  <lookat origin="2, -30, 9" target="0, 0, -0.5" up="0, 0, 1"/></transform>
  <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="18"/><rfilter type="box"/></film></sensor>
<shape type="rectangle"><transform name="to_world"><scale value="12"/><translate z="-1.5"/></transform>
  <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.5 0.3"/></bsdf></bsdf></shape>
<shape type="rectangle" id="panel"><transform name="to_world"><scale value="6"/><rotate x="1" angle="180"/>
  <translate x="4" y="-4" z="14"/></transform><emitter type="area"><rgb name="radiance" value="4 4 3"/></emitter></shape>
<emitter type="constant" id="sky"><rgb name="radiance" value="0.3 0.4 0.6"/></emitter>
<bsdf type="dielectric" id="glass"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>
<bsdf type="diffuse" id="matt"><rgb name="reflectance" value="0.9 0.6 0.2"/></bsdf>
<bsdf type="roughconductor" id="steel"><string name="distribution" value="ggx"/><float name="alpha" value="0.3"/>
  <rgb name="eta" value="0.2 0.9 1.1"/><rgb name="k" value="3.9 2.5 2.4"/></bsdf>
<bsdf type="roughdielectric" id="frosted"><string name="distribution" value="ggx"/><float name="alpha" value="0.4"/>
  <float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>
MORE</scene>"""
STEELY = kernels.conductor([0.2 + 3.9j, 0.9 + 2.5j, 1.1 + 2.4j], 0.3)


def explicit(folder, found, kinds, names, mesh):
    """The scene with every grain in it as a shape of its own, or, of meshes, as part of one mesh for each type."""
    met, centre, radius = listed(*(getattr(found.aggregate, name) for name in ("centers", "radii", "cell")), *mesh)
    which, turn = instances(int(found.seed), met[:, 1:], met[:, 0], np.diff(found.shares, prepend=0))
    more = []
    for k, (kind, name) in enumerate(zip(kinds, names)):
        own = np.flatnonzero(which == k)
        if kind.mesh is None:
            more += [f'<shape type="sphere"><point name="center" x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/><float name="radius" '
                     f'value="{r * kind.radius:.9g}"/><ref id="{name}"/></shape>'
                     for (x, y, z), r in zip(centre[own], radius[own])]
        elif own.size:
            corners, faces = kind.mesh.vertices, kind.mesh.faces
            vertices = np.concatenate([radius[n] * corners @ np.array(rotation_matrix(*turn[n])).reshape(3, 3).T + centre[n]
                                       for n in own])
            triangles = np.concatenate([faces + n * len(corners) for n in range(own.size)])
            (folder / f"{k}.ply").write_bytes(ply.mesh(vertices, triangles))
            more += [f'<shape type="ply"><string name="filename" value="{k}.ply"/><boolean name="face_normals" value="true"/>'
                     f'<ref id="{name}"/></shape>']
    (folder / "explicit.xml").write_text(SCENE.replace("MORE", "\n".join(more)))
    return len(met)


CASES = {"glass": ([Kind(GLASS)], ["glass"]), "frosted": ([Kind(kernels.dielectric(1.5, 0.4), STONE)], ["frosted"]),
         "matt stones": ([Kind(kernels.diffuse([0.9, 0.6, 0.2]), STONE)], ["matt"]),
         "mixture": ([Kind(GLASS, STONE), Kind(kernels.diffuse([0.9, 0.6, 0.2])), Kind(STEELY, radius=0.8)],
                     ["glass", "matt", "steel"])}


@pytest.mark.slow
@pytest.mark.parametrize("case", [slow(case) if case in ("frosted", "matt stones", "mixture") else case for case in CASES])
def test_mitsuba_sees_the_same_grains(tmp_path, case):
    """Pixel by pixel, a floor through the lowest grains, lamp and sky: Mitsuba with every grain as a shape."""
    import mitsuba as mi

    kinds, names = CASES[case]
    mesh = bumpy(4.0)
    found = grains(kinds, mesh, tile(0.55, 40))
    assert 20 < explicit(tmp_path, found, kinds, names, mesh) < 200
    (tmp_path / "scene.xml").write_text(SCENE.replace("MORE", ""))
    world = World(tmp_path / "scene.xml", size=(72, 96))
    where = place(found, world)
    assert where.occupied.any()
    ours = passes(world, where, world.camera, (72, 96), range(12))
    scene = mi.load_file(str(tmp_path / "explicit.xml"))
    theirs = np.array([np.array(mi.render(scene, seed=seed, spp=16))[..., :3] for seed in range(12)])
    ours, theirs = (blocks(one, (6, 8)) for one in (ours, theirs))
    noisy = theirs.std(axis=0) > 1e-4  # where there is nothing but sky, they differ by rounding
    assert np.allclose(ours.mean(axis=0)[~noisy], theirs.mean(axis=0)[~noisy], rtol=1e-5)
    ours, theirs = ours[:, noisy], theirs[:, noisy]
    assert same(ours, theirs) > ODDS
    assert same(ours, 1.1 * theirs) < ODDS, "nothing would be seen"
