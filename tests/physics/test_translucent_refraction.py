"""Light of a point through a refracting boundary: what is found from inside against what comes in from outside.

The same energy twice: irradiance at points spread evenly in a body, and light that comes in at points spread evenly on its
boundary.  Fixed seeds; they compare within 5 standard errors: a false alarm in 6e-7, should random numbers be drawn anew.
"""

import numpy as np
import pytest

from bakery import kernels
from renderers.materials.bodies import _refraction, refraction, setup, shells, surfaces, transport
from renderers.materials.bodies.bodies import Body, laid_out
from renderers.materials.bodies.paths import starting
from renderers.mitsuba import variants
from renderers.mitsuba.world import World
from renderers.transport import wavefront
from renderers.transport.paths import Colours
from renderers.transport.scattering import scatterer
from tests.conftest import ROOT

SIGMA, INDEX = 100.0, 1.5


POINT = {"type": "point", "position": [90.0, -60.0, 110.0], "intensity": {"type": "rgb", "value": 1.0}}
SUN = {"type": "directional", "direction": [0.3, 0.5, -1.0], "irradiance": {"type": "rgb", "value": 1.0}}


def lit(shape, lamp=POINT):
    """Transport in a body in the light of a point, or of a sun."""
    variants.activate("rgb", None)
    import mitsuba as mi

    world = World(mi.load_dict({
        "type": "scene", "ball": {**shape, "bsdf": {"type": "dielectric", "int_ior": INDEX, "ext_ior": 1.0}},
        "lamp": lamp}), 1e-3)
    (found,) = world.shapes()
    medium = scatterer([SIGMA], [0.9], np.array([0, np.pi]), np.full((1, 2), 1 / (4 * np.pi)))
    bodies, geometry = laid_out(world, [Body("ball", *kernels.solid(found.vertices, found.faces), found.index, found.smooth,
                                             medium, [], False, shells.none(1))], None)
    colours = Colours(np.ones((3, 1)), np.full((1, 3), 1 / 3))
    return setup.Transport(world, bodies, geometry, colours, [refraction.bent(world, bodies[0], [found])])


def from_inside(how, count):
    """Integral over the body of irradiance, W m, and its standard error."""
    body, (bent,) = how.bodies[0], how.bent[0]
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    points, states = low + (high - low) * np.random.default_rng(1).random((count, 3)), np.empty(count, np.uint64)
    wavefront.begin_streams(kernels.stream_key(0, "render.translucent", 0), 0, states)
    paths = starting(points, np.tile([0.0, 0, 1], (count, 1)), 1, states, np.arange(count))
    paths = paths.of(surfaces.located(how.geometry, paths) == 0)
    place, _, within, share = refraction.joined(how, 0, bent, paths)
    sample = how.world.from_light(bent.number, place)
    away = sample.direction.astype(float)
    seen = transport.transmittance(how, place + how.off * away, away, sample.distance, share > 0)[:, 0] > 0
    values = share * sample.radiance[:, 0] * np.exp(-SIGMA * within) * seen * np.prod(high - low)
    return values.sum() / count, np.sqrt((values**2).sum()) / count


def from_outside(how, count):
    """The same, of light that comes in at points on the boundary, by the normals of its triangles."""
    body, random = how.bodies[0], np.random.default_rng(2)
    a, b, c = (body.vertices[body.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1) / 2
    at = random.choice(len(area), count, p=area / area.sum())
    root, v = np.sqrt(random.random((count, 1))), random.random((count, 1))
    points = a[at] + root * (1 - v) * (b[at] - a[at]) + root * v * (c[at] - a[at])
    normal = normal[at] / (2 * area[at])[:, None]
    sample = how.world.from_light(0, points)
    away = sample.direction.astype(float)
    cosine = np.einsum("nk,nk->n", away, normal)
    seen = transport.transmittance(how, points + 2 * how.off * away, away, sample.distance, cosine > 0)[:, 0] > 0
    beyond = np.sqrt(1 - (1 - cosine**2) / INDEX**2)
    way = -away / INDEX + (cosine / INDEX - beyond)[:, None] * normal
    reflected = np.array([kernels.fresnel(max(one, 0.0), INDEX)[0] for one in cosine])
    paths = starting(points + how.off * way, way, 1, np.zeros(count, np.uint64), np.arange(count))
    far = np.where(surfaces.located(how.geometry, paths) == 0, paths.far, 0.0)
    values = np.where(seen, (1 - reflected) * cosine * sample.radiance[:, 0] * -np.expm1(-SIGMA * far) / SIGMA, 0) * area.sum()
    return values.mean(), values.std() / np.sqrt(count)


BUMPY = {"type": "ply", "filename": str(ROOT / "assets/scenes/bumpy_ball.ply"), "face_normals": True}
CUBE = {"type": "cube"}


@pytest.mark.slow
@pytest.mark.parametrize("shape", [BUMPY, CUBE], ids=["bumpy", "cube"])
def test_no_way_of_light_through_a_boundary_is_lost(shape):
    import mitsuba as mi

    variants.activate("rgb", None)
    if shape is CUBE:
        matrix = mi.ScalarTransform4f().translate([0, 0, 38]).rotate([0, 0, 1], 20).scale(25)
        shape = {**shape, "to_world": matrix}
    how = lit(shape)
    inside, its_error = from_inside(how, 200_000)
    outside, error = from_outside(how, 200_000)
    assert abs(inside - outside) < 5 * np.hypot(its_error, error)
    assert np.hypot(its_error, error) < 0.01 * outside


def test_a_sun_from_any_direction_gets_in():
    """Its direction has the digits of single precision, and Newton's method ended nowhere: bodies of glass were black in it."""
    variants.activate("rgb", None)
    import mitsuba as mi

    how = lit({**CUBE, "to_world": mi.ScalarTransform4f().scale(25)}, SUN)
    inside, its_error = from_inside(how, 20_000)
    outside, error = from_outside(how, 20_000)
    assert abs(inside - outside) < 5 * np.hypot(its_error, error) and np.hypot(its_error, error) < 0.05 * outside


def test_a_front_of_light_is_near_a_point_where_it_passes_it():
    """Points in fronts of light of triangles that are as wide, and whose light parts as widely, as of coarse meshes, and points
    beside them from which Newton's method begins."""
    random, count = np.random.default_rng(3), 300
    corners, ahead = random.normal(size=(count, 3, 3)), [0.0, 0, 1] + 0.2 * random.normal(size=(count, 3, 3))
    ahead /= np.linalg.norm(ahead, axis=2, keepdims=True)
    wide = np.stack([np.linalg.norm(rows - rows.mean(axis=1, keepdims=True), axis=2).max(axis=1) for rows in (corners, ahead)], 1)
    front = _refraction.Front(corners, corners, ahead, wide, np.zeros(3), False, INDEX)
    margin, narrow = _refraction._OUTSIDE, 0
    for f in range(count):
        u, v = random.dirichlet(np.ones(3))[:2] * (1 + 3 * margin) - margin
        s = random.uniform(0, 20)
        y = np.array([1 - u - v, u, v]) @ (corners[f] + s * ahead[f])
        begins, ends = _refraction._near(front, f, tuple(y), 20.0)
        roots = np.full(3, np.nan)
        many = _refraction._distances(front, f, tuple(y), 20.0, np.empty(4), np.empty(4), roots)
        assert begins <= s <= ends
        assert np.min(np.abs(roots[:many] - s)) <= (ends - begins) / 2**_refraction._HALVINGS
        narrow += ends - begins < 15
    assert narrow > 50, "nothing would be left out"
