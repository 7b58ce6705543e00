"""Light samples of lamps through smooth boundaries in the loop of Dr.Jit: a white room, derivatives, and paths without them.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest

import renderers.mitsuba  # noqa: F401  before Dr.Jit: it finds LLVM
from renderers.transport import distances, guides, lamps, passes, samples, scene, solid_angles, wide
from renderers.transport.scene import Scene
from tests.conftest import slow
from tests.odds import ODDS, sigmas
from tests.physics import test_transport as loops
from tests.physics.particles import blocks, same
from tests.physics.test_aggregate import bumpy
from tests.physics.test_translucent import BALL, BLACK, BOUNDARIES, FLOOR, PANEL, SKY, shape

import drjit as dr  # isort: skip  behind renderers.mitsuba, which finds LLVM
import mitsuba as mi  # isort: skip

LAMP = """<shape type="sphere" id="lamp"><point name="center" x="3" y="-4" z="8"/><float name="radius" value="0.6"/>
<emitter type="area"><rgb name="radiance" value="100 100 100"/></emitter></shape>"""
GREY, FORWARD = loops.asset([0.95, 0.9, 0.8], 0.0, (1.0, 1.2, 1.5)), loops.asset([0.95, 0.9, 0.8], 0.8, (0.3, 0.36, 0.45))
CUBE = loops.box((-4, -4, -4), (4, 4, 4))
FACETS = BOUNDARIES[1.4] + '<boolean name="face_normals" value="true"/>'


def widest(monkeypatch, angle):
    """Lamps are drawn up to a solid angle; of others directions are, however wide they are."""
    for name in ("WIDEST", "WIDEST_ALONE", "WIDEST_BEHIND_PANES"):
        monkeypatch.setattr(solid_angles, name, angle)
    monkeypatch.setattr(samples, "_SHARE", 0.0)
    monkeypatch.setattr(samples, "_CONTRAST", 0.0)
    monkeypatch.setattr(samples, "_SUCCESS", 0.0)


@pytest.fixture
def every(monkeypatch):
    """Lamps are drawn however wide they are."""
    widest(monkeypatch, np.inf)


@pytest.fixture
def none(monkeypatch):
    """Lamps are wide, however small they are."""
    widest(monkeypatch, 0.0)


@pytest.fixture
def coarse(monkeypatch):
    """What tells how to draw lamps is known by few rays, in few voxels: light is right by any."""
    for module, name, count in ((solid_angles, "_PLACES", 32), (distances, "_VOXELS", 1 << 12), (guides, "_VOXELS", 64)):
        monkeypatch.setattr(module, name, count)


def without(monkeypatch):
    """No light is drawn through boundaries."""
    monkeypatch.setattr(scene, "samples", lambda *arguments: None)


def white(how, error):
    """Whether what loses no light is 1, by pictures whose mean is known to `error`: by their rows, of which half at least see a
    body and scatter."""
    rows = loops.passes(how, range(8)).mean(axis=(2, 3)).ravel()
    its_error = rows.std(ddof=1) / rows.size**0.5
    assert its_error < error, its_error
    return abs(rows.mean() - 1) < sigmas(rows.size / 2) * its_error


def as_by_chance(tmp_path, monkeypatch, meshes, around, indices):
    """Pictures with drawn lamps are those of paths that meet them by chance, by blocks of the picture and orders."""
    def pictures(numbers, seed):
        how = loops.transport(tmp_path, meshes, around, indices, size=16)
        (part,) = loops.methods.parts(how, "paths", "negative", seed)
        return [part.render(number) for number in numbers]

    drawn = pictures(range(16), 1)
    without(monkeypatch)
    by_chance = pictures(range(40), 0)
    for layer in ("order0", "order1", "order2", "orders"):
        assert same(*(blocks(np.array([one[layer] for one in images]), (2, 2)) for images in (drawn, by_chance))) > ODDS, layer


def counted_twice(monkeypatch):
    """Light that paths meet by chance counts in full as well."""
    monkeypatch.setattr(lamps.Lamps, "_share", lambda self, arrival: 1.0)
    monkeypatch.setattr(wide.Wide, "meets", lambda self, path, emitter, light: light)


def walls():
    """Of a closed room, lamps of radiance 1."""
    turns = [f'x="1" angle="{angle}"' for angle in (0, 90, 180, 270)] + ['y="1" angle="90"', 'y="1" angle="270"']
    return "".join('<shape type="rectangle"><transform name="to_world"><scale value="25"/><translate z="-25"/>'
                   f'<rotate {turn}/></transform>{BLACK}<emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>'
                   for turn in turns)


@pytest.mark.parametrize("counted, space", [slow(True, wide.SPACE), (True, (0.5, 1)), slow(False, wide.SPACE)])
def test_a_white_room_of_wide_lamps(tmp_path, none, coarse, monkeypatch, counted, space):
    """The same where directions are drawn, also where lanes have no room for more scatterings from which they are followed."""
    monkeypatch.setattr(wide, "SPACE", space)
    if not counted:
        counted_twice(monkeypatch)
    how = loops.transport(tmp_path, {"ball": (BALL, loops.asset(1.0, 0.5, (0.9, 0.7, 1.1)))}, walls(), [1.4], size=8)
    view = Scene(how.world, how.bodies, how.colours)
    assert view.lamps.wide and not view.lamps.small
    assert white(how, 0.008 if counted else 0.03) == counted


@pytest.mark.parametrize("counted, scatterings, arrivals", [
    slow(True, lamps.SCATTERINGS, lamps.ARRIVALS), slow(True, (0.5, 1), (0.1, 1)),
    slow(False, lamps.SCATTERINGS, lamps.ARRIVALS)])
def test_a_white_room_of_lamps(tmp_path, every, coarse, monkeypatch, counted, scatterings, arrivals):
    """What loses no light is 1, whatever the wavelengths; not so if light that paths meet by chance counts in full as well.

    Also where lanes have no room for more scatterings, nor for more lamps that paths have met: these are met by chance.
    """
    monkeypatch.setattr(lamps, "SCATTERINGS", scatterings)
    monkeypatch.setattr(lamps, "ARRIVALS", arrivals)
    if not counted:
        counted_twice(monkeypatch)
    lossless = loops.asset(1.0, 0.5, (0.9, 0.7, 1.1, 2.0, 0.8), (0.45, 0.5, 0.55, 0.6, 0.65))
    how = loops.transport(tmp_path, {"ball": (BALL, lossless)}, walls(), [1.4], size=8)
    assert white(how, 0.008) == counted


@pytest.mark.slow
def test_directions_are_drawn_by_their_density(tmp_path, none):
    """Of points in a ball under a panel: shares of bins that are drawn, against the density; chi-square over all bins."""
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, PANEL, [1.4])
    guides = Scene(how.world, how.bodies, how.colours).lamps.wide.guides
    random, n = np.random.default_rng(2), 200_000
    x = mi.Point3f(*(dr.full(mi.Float, value, n) for value in (0.5, -0.4, 3.5)))
    u, v = (mi.Float(column.astype(np.float32)) for column in random.random((2, n)))
    drawn = np.bincount(np.array(guides._bin(guides.drawn(x, u, v))), minlength=128)
    towards = mi.Vector3f(*(mi.Float(row) for row in bin_middles()))
    x = mi.Point3f(0.5, -0.4, 3.5) + dr.zeros(mi.Point3f, 128)
    expected = np.array(guides.density(x, towards, True)) * 4 * np.pi / 128 * n
    assert expected.sum() == pytest.approx(n, rel=1e-4) and not drawn[expected == 0].any()
    some = expected > 10
    # odds of 1e-7: bins + 5.2 standard deviations of chi-square, whose variance is twice the bins
    assert ((drawn - expected)[some] ** 2 / expected[some]).sum() < some.sum() + 5.2 * (2 * some.sum()) ** 0.5 + 14


def bin_middles():
    """Directions (3, 128) in the middle of bins of `guides`."""
    cosine, angle = (np.arange(128) // 16 + 0.5) / 4 - 1, (np.arange(128) % 16 + 0.5) * np.pi / 8
    sine = (1 - cosine**2) ** 0.5
    return np.array([sine * np.cos(angle), sine * np.sin(angle), cosine]).astype(np.float32)


@pytest.mark.slow
def test_solid_angles_are_those_of_neighbouring_walks(tmp_path):
    """Through a smooth boundary: directions from x to where walks to three points of a small triangle end."""
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP, [1.4])
    manifold = Scene(how.world, how.bodies, how.colours).lamps.small._manifold
    random, n, side = np.random.default_rng(0), 4000, 0.02
    x = mi.Point3f(*(mi.Float(row) for row in 2.5 * random.uniform(-1, 1, (3, n))))
    y = mi.Point3f(*(mi.Float(row) for row in np.array([[3.0], [-4.0], [8.0]]) + random.uniform(-1, 1, (3, n))))
    active, bends = dr.full(mi.Bool, True, n), []
    for shift in ((0, 0, 0), (side, 0, 0), (0, side, 0)):
        walk = manifold.walk(x, y + mi.Vector3f(*shift), active)
        active &= walk.ends
        bends.append(manifold.bend(walk.row, walk.uv, x, y + mi.Vector3f(*shift)))
    assert dr.count(active)[0] > 0.98 * n
    towards, one, other = (-bend.inward for bend in bends)
    measured = dr.norm(dr.cross(one - towards, other - towards)) / side**2
    ratio = np.array(measured / bends[0].solid_angle(mi.Normal3f(0, 0, 1)))[np.array(active)]
    # single precision of directions, 1e-7 of 1e-3, and changes of the normal across an edge of a triangle
    assert np.median(abs(ratio - 1)) < 0.005 and np.quantile(abs(ratio - 1), 0.8) < 0.05


@pytest.mark.slow
def test_lamps_are_looked_for_from_below_the_boundary(tmp_path):
    """Points in a ball, up to 0.1 below the half of the boundary that the lamp shines on, are told to be near it, not as far from
    it as the lamp, which voxels outside of the ball see.  A voxel has an edge of 0.25."""
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP, [1.4])
    small = Scene(how.world, how.bodies, how.colours).lamps.small
    random, lamp, n = np.random.default_rng(0), np.array([3.0, -4.0, 8.0]), 4000
    normal = random.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    x = normal * random.uniform(4.85, 4.95, (n, 1))
    towards = lamp - x
    cosine = (normal * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
    x = x[cosine > 0.3].astype(np.float32)
    origin = mi.Point3f(*map(mi.Float, x.T))
    distance = np.array(small._distances.of(origin, mi.UInt32(0), True))
    assert distance.max() < 2
    # within a voxel, too, which in milk is twenty mean free paths wide
    ray = mi.Ray3f(origin, dr.normalize(mi.Point3f(*lamp.tolist()) - origin))
    straight = np.array(how.world.scene.ray_intersect_preliminary(ray, coherent=False).t)
    assert np.median(abs(distance - straight)) < 0.02


@pytest.mark.slow
def test_directions_where_few_walks_end(tmp_path, monkeypatch):
    """Most end on a ball.  Where fewer than are asked for do, directions are drawn for all lights."""
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP + FLOOR, [1.4])
    drawn = Scene(how.world, how.bodies, how.colours).lamps
    assert drawn.small and not drawn.wide and 0.75 < drawn.small.success() <= 1
    monkeypatch.setattr(samples, "_SUCCESS", 1.1)
    drawn = Scene(how.world, how.bodies, how.colours).lamps
    assert drawn.wide and not drawn.small


def test_which_lamps_are_drawn(tmp_path):
    """Small ones in proportion to their light; none that is wide, or that nothing sees, or that has no extent."""
    dim = LAMP.replace('x="3" y="-4"', 'x="-3" y="4"').replace("100 100 100", "50 50 50").replace('"lamp"', '"dim"')
    hidden = LAMP.replace('z="8"', 'z="-9"').replace('"lamp"', '"hidden"')
    wide = PANEL.replace('<scale value="5"/>', '<scale value="90"/>')
    # the cube, which lamps see alike from both sides
    how = loops.transport(tmp_path, {"cube": (CUBE, GREY)}, LAMP + dim + hidden + wide + FLOOR + SKY, [1.4])
    view = Scene(how.world, how.bodies, how.colours, drawn=False)
    (boundary,) = (one for one in view.scene.shapes() if one.id() == "cube")
    shares = {lamp.id(): share for lamp, share in solid_angles.drawn(view, [boundary]).items()}
    assert set(shares) == {"lamp", "dim"} and shares["lamp"] == pytest.approx(2 / 3, abs=0.1)


def test_matched_boundaries_are_left_alone(tmp_path):
    """They take light samples anyhow."""
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP, [1.0])
    assert Scene(how.world, how.bodies, how.colours).lamps is None


@pytest.mark.slow
def test_light_of_lamps_is_theirs(tmp_path):
    """Layers of lights add up to the picture, that of the sampled lamp among them."""
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP + SKY, [1.4], size=8)
    layers = passes.part("paths", how.world, how.bodies, how.colours, 0, by_light=True).render(0)
    lights = [layers[f"light.{name}"] for name in how.world.light_names]
    assert np.allclose(sum(lights), layers[""], rtol=1e-4) and all(light.mean() > 0.01 for light in lights)


@pytest.mark.slow
def test_small_lamps_are_not_noisy(tmp_path, monkeypatch):
    """Variance is less than a tenth of that of paths that meet the lamp by chance, of light of one event and of three and more.
    `benchmarks/lamps.py` finds 0.007 and 0.006; of few passes it is uncertain: rare bright pixels make most of it by chance."""
    def variances():
        how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP, [1.4], size=24)
        (part,) = loops.methods.parts(how, "paths", "negative", 0)
        pictures = [part.render(number) for number in range(8)]
        return [np.var([one[layer] for one in pictures], axis=0, ddof=1).mean() for layer in ("order1", "orders")]

    drawn = variances()
    without(monkeypatch)
    by_chance = variances()
    assert drawn[0] < 0.1 * by_chance[0] and drawn[1] < 0.1 * by_chance[1], (drawn, by_chance)


@pytest.mark.slow
@pytest.mark.parametrize("meshes, indices, boundary", [
    ({"ball": (BALL, GREY)}, [1.4], FACETS),
    ({"bumpy": (bumpy(5.0), FORWARD)}, [1.4], BOUNDARIES[1.4]),
    ({"bumpy": (bumpy(5.0), loops.asset([0.95, 0.9, 0.8], 0.5, (6.0, 7.0, 8.0)))}, [1.4], BOUNDARIES[1.4]),
    ({"cube": (CUBE, GREY)}, [1.4], BOUNDARIES[1.4]),
    ({"outer": ((1.3 * BALL[0], BALL[1]), loops.asset(0.9, 0.0, (5.0, 5.0, 5.0))), "inner": (BALL, GREY)}, [1.0, 1.4],
     BOUNDARIES[1.4]),
    ({"outer": (BALL, GREY), "inner": ((0.5 * BALL[0], BALL[1]), loops.asset(0.9, 0.0))}, [1.4, 1.0], BOUNDARIES[1.4]),
    ({"left": (loops.box((-4, -2, -2), (0, 2, 2)), GREY), "right": (loops.box((0, -2, -2), (4, 2, 2)), FORWARD)}, [1.4, 1.0],
     FACETS),
], ids=["facets", "bumpy", "thin", "cube-shaded", "in-matched", "matched-in", "touching"])
def test_as_paths_that_meet_lamps_by_chance(tmp_path, every, monkeypatch, meshes, indices, boundary):
    """By blocks of the picture and orders, under a panel, beside an obstacle."""
    monkeypatch.setitem(loops.bodies.BOUNDARIES, 1.4, boundary)
    around = PANEL + FLOOR + shape(tmp_path, "obstacle", (0.3 * BALL[0] + [0, 0, 9], BALL[1]), BLACK)
    as_by_chance(tmp_path, monkeypatch, meshes, around, indices)


@pytest.mark.slow
@pytest.mark.parametrize("meshes, boundary", [
    ({"bumpy": (bumpy(5.0), FORWARD)}, BOUNDARIES[1.4]),
    ({"cube": (CUBE, GREY)}, BOUNDARIES[1.4]),
    ({"left": (loops.box((-4, -2, -2), (0, 2, 2)), GREY), "right": (loops.box((0, -2, -2), (4, 2, 2)), FORWARD)}, FACETS),
], ids=["bumpy", "cube-shaded", "touching"])
def test_directions_as_paths_that_meet_lamps_by_chance(tmp_path, none, monkeypatch, meshes, boundary):
    """The same where directions are drawn."""
    monkeypatch.setitem(loops.bodies.BOUNDARIES, 1.4, boundary)
    as_by_chance(tmp_path, monkeypatch, meshes, PANEL + FLOOR, [1.4] * len(meshes))
