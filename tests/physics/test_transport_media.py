"""Media without a boundary in the loop of Dr.Jit: a white room, closed forms, and Mitsuba's own integrators in the same scenes.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from bakery.errors import UsageError
from bakery.physics.shapes.radial import icosphere
from renderers.mitsuba import shading, variants
from renderers.mitsuba.world import World
from renderers.transport import passes
from renderers.transport.regions import Box, Everywhere, Grid, Medium, Mesh, Regions, boundary
from renderers.transport.scattering import of_asset
from renderers.transport.voxels import Voxels
from tests.odds import ODDS, sigmas
from tests.physics.particles import blocks, same
from tests.physics.test_translucent import BOUNDARIES, FLOOR, PANEL, SENSOR, SKY, shape
from tests.physics.test_transport import POINT, asset, box

import drjit as dr  # isort: skip  behind renderers.mitsuba, which finds LLVM
import mitsuba as mi  # isort: skip

BALL = tuple(part * side for part, side in zip(icosphere(320), (3, 1)))
RGB = SimpleNamespace(to_rgb=np.eye(3), to_waves=np.eye(3))
LOW, HIGH = (-8.0, -8.0, -5.9), (8.0, 8.0, 6.0)
FOG = ([0.95, 0.9, 0.8], 0.5, (12.0, 16.0, 25.0))  # albedo, g, free paths
SKIN = ([0.9, 0.8, 0.5], 0.3, (1.0, 1.25, 1.7))
DENSITY = np.random.default_rng(1).random((5, 6, 7)) ** 2


def medium(region, albedo, g, free_path):
    return Medium(region, of_asset(asset(albedo, g, free_path)))


def body(name, mesh, index, albedo, g, free_path):
    return SimpleNamespace(name=name, vertices=mesh[0].astype(np.float32).astype(float), faces=mesh[1],
                           medium=of_asset(asset(albedo, g, free_path)), matched=index == 1.0)


def sensor(origin="0, -19, 5", inside="", size=16):
    return SENSOR.replace("SIZE", str(size)).replace("ORIGIN", origin).replace("</sensor>", f"{inside}</sensor>")


def pictures(folder, scene, entries, numbers=range(16), layer="", **more):
    """Passes of the loop over surfaces and lights, XML."""
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{scene}</scene>')
    part = passes.part("paths", World(folder / "scene.xml"), entries, RGB, 0, **more)
    return np.array([part.render(number)[layer] for number in numbers])


def cube(low, high, inside, name="cube"):
    low, high = np.array(low), np.array(high)
    (x, y, z), (u, v, w) = (high - low) / 2, (high + low) / 2
    return (f'<shape type="cube" id="{name}"><transform name="to_world"><scale x="{x}" y="{y}" z="{z}"/>'
            f'<translate x="{u}" y="{v}" z="{w}"/></transform>{inside}</shape>')


def test_a_white_room(tmp_path):
    """Radiance 1 through all that is lossless: fog everywhere, a box, a mesh and a grid that overlap, two bodies."""
    walls = cube((-9, -9, -9), (9, 9, 9), '<boolean name="flip_normals" value="true"/><bsdf type="diffuse"><rgb name='
                 '"reflectance" value="0.3 0.3 0.3"/></bsdf><emitter type="area"><rgb name="radiance" value="0.7 0.7 0.7"/>'
                 '</emitter>')
    moved = [(BALL[0] * 0.6 + shift, BALL[1]) for shift in ((-3, 0, 0), (3, 0, 0), (0, 0, 2))]
    scene = sensor("0, -8, 1", size=8) + walls + shape(tmp_path, "glass", moved[0], BOUNDARIES[1.4]) \
        + shape(tmp_path, "matched", moved[1], BOUNDARIES[1.0])
    white = [1.0] * 3
    entries = [medium(Everywhere(), white, 0.3, (9.0, 7.0, 5.0)),
               medium(Box((-4, -4, -9), (4, 4, 0)), white, -0.3, (3.0, 2.0, 4.0)),
               medium(Mesh(*moved[2]), white, 0.0, (1.0, 2.0, 1.5)),
               medium(Grid((-4, -2, 0), (4, 2, 5), DENSITY), white, 0.8, (0.5,) * 3),
               body("glass", moved[0], 1.4, white, 0.0, (1.0, 1.5, 2.0)), body("matched", moved[1], 1.0, white, 0.5, (0.7,) * 3)]
    found = pictures(tmp_path, scene, entries, range(24)).mean(axis=(1, 2, 3))
    error = found.std(ddof=1) / 24**0.5
    assert error < 0.004 and abs(found.mean() - 1) < sigmas(24) * error


def test_a_white_sky_over_a_medium_that_reaches_further_than_surfaces(tmp_path):
    """Radiance 1 from inside of a lossless box 8 m wide, whose only surface is a white ball of 4 cm."""
    scene = sensor("0, -2, 0", size=8) + '<shape type="sphere"><point name="center" x="1" y="-0.4" z="0"/><float name="radius" ' \
        'value="0.02"/><bsdf type="diffuse"><rgb name="reflectance" value="1 1 1"/></bsdf></shape>' \
        '<emitter type="constant"><rgb name="radiance" value="1 1 1"/></emitter>'
    found = pictures(tmp_path, scene, [medium(Box((-4, -4, -4), (4, 4, 4)), [1.0] * 3, 0.0, (1.0,) * 3)]).mean(axis=(1, 2, 3))
    error = found.std(ddof=1) / 16**0.5
    assert error < 0.005 and abs(found.mean() - 1) < sigmas(16) * error


@pytest.mark.slow
def test_a_white_slab_thinner_than_mitsubas_rays_leap(tmp_path):
    """0.2 mm of glass 6 m wide that loses nothing is 1 in a white sky; 0.71 where rays go on 0.36 mm beside its faces."""
    mesh, glass = box((-3, -1e-4, -3), (3, 1e-4, 3)), BOUNDARIES[1.4] + '<boolean name="face_normals" value="true"/>'
    scene = sensor("0, -16, 3", size=4) + SKY + shape(tmp_path, "slab", mesh, glass)
    rendered = pictures(tmp_path, scene, [body("slab", mesh, 1.4, [1.0] * 3, 0.3, (1e-3,) * 3)]).mean(axis=(1, 2, 3))
    error = rendered.std(ddof=1) / 16**0.5
    assert error < 0.01 and abs(rendered.mean() - 1) < sigmas(16) * error


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (3.0, 5.0, 1.0), (900.0, 1100.0, 70.0)])
def test_rays_that_go_on_from_glass(tmp_path, monkeypatch, place):
    """Beside a ball of many triangles: none outward meets it again, and of those inward, some of which graze it, nearly all leave
    it next; beside by a twentieth of that, some in 10,000 do not."""
    ball = icosphere(5120)
    ball = ball[0] + np.array(place), ball[1]
    glass = BOUNDARIES[1.4] + '<boolean name="face_normals" value="true"/>'
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{sensor()}{shape(tmp_path, "ball", ball, glass)}</scene>')
    scene = World(tmp_path / "scene.xml").scene
    random = mi.PCG32(1 << 16)
    u, v = (mi.Point2f(random.next_float32(), random.next_float32()) for _ in range(2))
    surface = scene.ray_intersect(mi.Ray3f(mi.Point3f(*place) + 2 * mi.warp.square_to_uniform_sphere(u),
                                           -mi.warp.square_to_uniform_sphere(u)))
    outward = surface.to_world(mi.warp.square_to_cosine_hemisphere(v))

    def wrong():
        out, into = (scene.ray_intersect(mi.Ray3f(shading.beside(surface, way, shading.reaches(scene)), way), surface.is_valid())
                     for way in (outward, -outward))
        inside = surface.is_valid() & (~into.is_valid() | (dr.dot(into.n, -outward) < 0))
        return np.count_nonzero(out.is_valid()), np.count_nonzero(inside)

    outside, inside = wrong()
    assert np.count_nonzero(surface.is_valid()) > 65_000 and outside == 0 and inside <= 3
    monkeypatch.setattr(shading, "_BESIDE", 1e-7)
    assert min(wrong()) > 3


@pytest.mark.parametrize("turned", [1, -1])
def test_columns_of_a_grid(turned):
    """Against fine sums of the same trilinear density; and a flight that is given a column ends where that is passed."""
    variants.activate("rgb")
    low, high = np.array((-1.0, 0.0, 2.0)), np.array((1.0, 3.0, 5.0))
    voxels = Voxels({1: Grid(low, high, DENSITY)}, 2, 1.0)
    start, end = np.array((-0.95, 0.1, 2.05))[:, None], np.array([(0.9, 2.9, 4.9), (-0.95, 0.1, 4.0), (0.3, 0.1, 2.05)]).T
    start, end = (start + 0 * end, end)[::turned]
    length = np.linalg.norm(end - start, axis=0)
    ray = mi.Ray3f(mi.Point3f(start), mi.Vector3f((end - start) / length))
    rays = dr.zeros(mi.Float, 3), mi.Float(length), mi.UInt32(1, 1, 1)
    active = dr.full(mi.Bool, True, 3)
    _, column = voxels.march(ray, *rays, dr.full(mi.Float, dr.inf, 3), active)

    def fine(reach, steps=200_000):
        share = (np.arange(steps) + 0.5) / steps * (reach / length)[:, None]
        points = start[:, :, None] + (end - start)[:, :, None] * share
        count = np.array(DENSITY.shape)[:, None, None]
        place = np.clip((points - low[:, None, None]) / (high - low)[:, None, None] * count - 0.5, 0, count - 1)
        return map_coordinates(DENSITY, place, order=1, mode="nearest").mean(axis=1) * reach

    assert np.allclose(column, fine(length), rtol=2e-5)
    stop, passed = voxels.march(ray, *rays, 0.4 * column, active)
    assert np.allclose(passed, 0.4 * np.array(column)) and np.all(np.array(stop) < length)
    assert np.allclose(fine(np.array(stop)), 0.4 * np.array(column), rtol=1e-4)


def test_regions_on_rays():
    """In which regions rays begin on a common face of two boxes, and where they come to the next boundary."""
    variants.activate("rgb")
    regions = Regions([(1, Box((0, 0, 0), (1, 1, 1))), (2, Mesh(*box((1, 0, 0), (2, 1, 1)))), (4, Everywhere())], 1.0)
    ray = mi.Ray3f(mi.Point3f([-1.0, 1.0, 1.0, 1.5], 0.5, 0.4), mi.Vector3f([1.0, 1.0, -1.0, 0.0], 0, [0.0, 0.0, 0.0, 1.0]))
    inside, end = regions.around(ray, dr.zeros(mi.Float, 4), dr.full(mi.Bool, True, 4))
    assert list(inside) == [4, 6, 5, 6] and np.allclose(end, [1.0, 1.0, 1.0, 0.6], atol=1e-5)


def test_fog_that_stands_on_the_floor(tmp_path):
    """A face of its box lies in the floor: what it leaves of the floor's light, seen and lit from above."""
    lamp = ('<emitter type="directional"><vector name="direction" x="0" y="0" z="-1"/><rgb name="irradiance" value="3 3 3"/>'
            '</emitter>')
    view = sensor("0, 0, 30", size=4).replace('up="0, 0, 1"', 'up="0, 1, 0"').replace('"34"', '"1"')
    dark = medium(Box((-20, -20, -6), (20, 20, 4)), 0.0, 0.0, (20.0, 10.0, 5.0))
    clear, dimmed = (pictures(tmp_path, view + FLOOR + lamp, entries, range(8)).mean(axis=(0, 1, 2))
                     for entries in ([dark._replace(region=Box((90, 90, 90), (91, 91, 91)))], [dark]))
    error = np.exp(-10 / np.array((20.0, 10.0, 5.0))) ** 0.5 / (8 * 16 * 16) ** 0.5  # of counts of paths that get through
    assert np.all(abs(dimmed / clear * np.exp(20 / np.array((20.0, 10.0, 5.0))) - 1) < sigmas() * np.exp(0.5) * 5 * error)


def inside_of(kind, albedo, g, free_path, extinction=None):
    """XML of a medium of Mitsuba."""
    sigma = 1 / np.array(free_path)
    values = ", ".join(map(repr, map(float, sigma / sigma.max())))
    extinction = extinction or f'<rgb name="sigma_t" value="{values}"/>'
    albedo = ", ".join(map(repr, albedo))
    albedo = f'<volume name="albedo" type="constvolume"><rgb name="value" value="{albedo}"/></volume>'
    type_ = "heterogeneous" if "volume" in extinction else "homogeneous"
    return (f'<medium type="{type_}" name="{kind}">{extinction}{albedo}<float name="scale" value="{float(sigma.max())!r}"/>'
            f'<phase type="hg"><float name="g" value="{g}"/></phase></medium>')


def reference(folder, scene, samples, passes=8):
    """Pictures by `volpathmis`, with roulette where light is worth nothing any more."""
    file = folder / "reference.xml"
    integrator = ('<integrator type="volpathmis"><integer name="max_depth" value="-1"/><integer name="rr_depth" value="1000"/>'
                  '</integrator>')
    file.write_text(f'<scene version="3.0.0">{integrator}{scene}</scene>')
    loaded = mi.load_file(str(file), optimize=False)
    return np.array([np.array(mi.render(loaded, spp=samples, seed=number), float)[..., :3] for number in range(passes)])


def matched_in_a_box(folder):
    entries = [medium(Box(LOW, HIGH), *FOG), body("ball", BALL, 1.0, *SKIN)]
    around = sensor() + PANEL + FLOOR + SKY
    ball = BOUNDARIES[1.0] + inside_of("interior", *SKIN) + inside_of("exterior", *FOG)
    return around + shape(folder, "ball", BALL, BOUNDARIES[1.0]), entries, \
        around + shape(folder, "other", BALL, ball) + cube(LOW, HIGH, BOUNDARIES[1.0] + inside_of("interior", *FOG)), 512


def glass_in_fog(folder):
    entries = [medium(Everywhere(), *FOG), body("ball", BALL, 1.4, *SKIN)]
    around, eye = PANEL + FLOOR + POINT, "0, -10, 2"
    ball = BOUNDARIES[1.4] + inside_of("interior", *SKIN) + inside_of("exterior", *FOG)
    return sensor(eye) + around + shape(folder, "ball", BALL, BOUNDARIES[1.4]), entries, \
        sensor(eye, inside_of("medium", *FOG)) + around + shape(folder, "other", BALL, ball), 16


def on_a_grid(folder):
    """The camera, too, is in it."""
    fog = FOG[0], FOG[1], (2.0, 2.0, 2.0)
    mi.VolumeGrid(np.ascontiguousarray(DENSITY.T, np.float32)[..., None]).write(str(folder / "density.vol"))
    size = np.array(HIGH) - LOW
    volume = ('<volume name="sigma_t" type="gridvolume"><string name="filename" value="density.vol"/><transform name="to_world">'
              f'<scale x="{size[0]}" y="{size[1]}" z="{size[2]}"/><translate x="{LOW[0]}" y="{LOW[1]}" z="{LOW[2]}"/>'
              '</transform></volume>')
    fogged, around, eye = inside_of("interior", *fog, volume), PANEL + FLOOR + SKY, "0, -7, 2"
    return sensor(eye) + around, [medium(Grid(LOW, HIGH, DENSITY), *fog)], \
        sensor(eye, fogged.replace("interior", "medium")) + around + cube(LOW, HIGH, BOUNDARIES[1.0] + fogged), 64


@pytest.mark.slow
@pytest.mark.parametrize("scene", [matched_in_a_box, glass_in_fog, on_a_grid])
def test_as_the_integrator_of_mitsuba(tmp_path, scene):
    """Means within 2 standard errors (with these seeds), and the picture in blocks by chance."""
    ours, entries, theirs, samples = scene(tmp_path)
    ours, theirs = pictures(tmp_path, ours, entries, range(100)), reference(tmp_path, theirs, samples)
    assert same(blocks(ours, (2, 2)), blocks(theirs, (2, 2))) > ODDS
    means = [found.mean(axis=(1, 2)) for found in (ours, theirs)]
    error = np.hypot(*(found.std(axis=0, ddof=1) / len(found) ** 0.5 for found in means))
    assert np.all(abs(means[0].mean(axis=0) - means[1].mean(axis=0)) < 2 * error)


@pytest.mark.slow
def test_light_by_lights(tmp_path):
    around, entries = sensor(size=8) + PANEL + FLOOR + SKY, [medium(Box(LOW, HIGH), *FOG)]
    whole = pictures(tmp_path, around, entries, [0])
    parts = [pictures(tmp_path, around, entries, [0], f"light.{name}", by_light=True)
             for name in ("panel", "ConstantBackgroundEmitter")]
    assert np.allclose(sum(parts), whole, rtol=1e-4, atol=1e-6)
    alone = pictures(tmp_path, sensor(size=8) + PANEL + FLOOR, entries, range(8)).mean(axis=(1, 2, 3))
    lit = pictures(tmp_path, around, entries, range(8), "light.panel", by_light=True).mean(axis=(1, 2, 3))
    assert abs(alone.mean() - lit.mean()) < sigmas(8) * np.hypot(alone.std(ddof=1), lit.std(ddof=1)) / 8**0.5


def test_where_light_first_scatters(tmp_path):
    """Entries as the caller numbers them: a ball of glass in a box, and beyond both nothing."""
    entries = [medium(Box((-20, -5, -20), (20, 5, 0)), 0.5, 0.0, (0.1,) * 3), body("ball", BALL, 1.4, 0.5, 0.0, (0.01,) * 3)]
    ball = shape(tmp_path, "ball", BALL, BOUNDARIES[1.4])
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{sensor(size=9)}{SKY}{ball}</scene>')
    number = passes.materials(World(tmp_path / "scene.xml"), entries, RGB, 0)
    assert number[0].tolist() == [-1] * 9 and number[8].tolist() == [0] * 9 and number[3, 4] == 1


def test_on_a_graphics_card_a_second_scene_is_refused(monkeypatch):
    """There a kernel traces rays through one scene: those through the boundary of a medium would miss it, without an error."""
    monkeypatch.setattr(variants, "on_gpu", lambda variant: True)
    with pytest.raises(UsageError, match="one scene at a time.*llvm_ad_rgb"):
        boundary(np.eye(3), [[0, 1, 2]], 1.0)
