"""Lamps behind panes, and samples of a pixel in strata: white rooms, derivatives, and paths without either.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

from functools import partial

import numpy as np
import pytest

from renderers.mitsuba import variants  # before Dr.Jit: it finds LLVM
from renderers.transport import lamps, loop, passes, strata
from renderers.transport.scene import Scene
from tests.physics import test_transport as loops
from tests.physics.test_translucent import BALL, BLACK, FLOOR, PANEL, shape
from tests.physics.test_transport_lamps import (  # noqa: F401
    FORWARD,
    GREY,
    LAMP,
    as_by_chance,
    coarse,
    counted_twice,
    every,
    none,
    walls,
    white,
)

import drjit as dr  # isort: skip  behind renderers.mitsuba, which finds LLVM
import mitsuba as mi  # isort: skip


def glass(index, outside=1.0):
    return (f'<bsdf type="dielectric"><float name="int_ior" value="{index}"/><float name="ext_ior" value="{outside}"/></bsdf>')


WALL = glass(1.5)
IN_GLASS = glass(1.35, 1.5)
SHELL = 1.15 * BALL[0], BALL[1]
PANE = loops.box((-9, -9, 6.4), (9, 9, 6.9))
FLAT = WALL + '<boolean name="face_normals" value="true"/>'


@pytest.fixture
def of_milk(monkeypatch):
    """The body's boundary is one of milk in glass."""
    monkeypatch.setitem(loops.bodies.BOUNDARIES, 1.4, IN_GLASS)


def panes(tmp_path, meshes):
    return "".join(shape(tmp_path, name, mesh, FLAT if mesh is PANE else WALL) for name, mesh in meshes.items())


@pytest.mark.slow
@pytest.mark.parametrize("counted", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_ball_in_glass_in_a_white_room_of_lamps(tmp_path, every, coarse, of_milk, monkeypatch, counted):  # noqa: F811
    """What loses no light is 1, also where lanes have no room for more scatterings, nor for more lamps that paths have met; not
    so if light that paths meet by chance counts in full as well."""
    if counted:
        monkeypatch.setattr(lamps, "SCATTERINGS", (0.5, 1))
        monkeypatch.setattr(lamps, "ARRIVALS", (0.1, 1))
    else:
        counted_twice(monkeypatch)
    lossless = loops.asset(1.0, 0.5, (0.9, 0.7, 1.1))
    how = loops.transport(tmp_path, {"ball": (BALL, lossless)}, walls() + panes(tmp_path, {"shell": SHELL}), [1.4], size=8)
    assert white(how, 0.007) == counted


@pytest.mark.parametrize("meshes, boundary, around", [
    pytest.param({"shell": SHELL}, IN_GLASS, 1.5, marks=pytest.mark.slow, id="in-glass"),
    pytest.param({"pane": PANE}, glass(1.4), 1.0, marks=pytest.mark.slow, id="behind-a-pane")])
def test_solid_angles_are_those_of_neighbouring_refractions(tmp_path, coarse, monkeypatch, meshes, boundary, around):  # noqa: F811
    """Directions from x to where walks to three points of a small triangle end; and the guess of the index around the body."""
    monkeypatch.setitem(loops.bodies.BOUNDARIES, 1.4, boundary)
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP + panes(tmp_path, meshes), [1.4])
    sampled = Scene(how.world, how.bodies, how.colours).lamps.small
    assert np.max(sampled._manifold._around) == pytest.approx(around)
    random, n, side = np.random.default_rng(0), 4000, 0.02
    x = mi.Point3f(*(mi.Float(row) for row in 2.5 * random.uniform(-1, 1, (3, n))))
    y = mi.Point3f(*(mi.Float(row) for row in np.array([[3.0], [-4.0], [8.0]]) + random.uniform(-1, 1, (3, n))))
    active, walks = dr.full(mi.Bool, True, n), []
    for shift in ((0, 0, 0), (side, 0, 0), (0, side, 0)):
        walks.append(sampled._refractions.walk(x, y + mi.Vector3f(*shift), active))
        active &= walks[-1].ends
    assert dr.count(active)[0] > 0.95 * n
    towards, one, other = (walk.towards for walk in walks)
    measured = dr.norm(dr.cross(one - towards, other - towards)) / side**2
    ratio = np.array(measured / walks[0].solid_angle(mi.Normal3f(0, 0, 1)))[np.array(active)]
    # single precision of directions, 1e-7 of 1e-3, and changes of the normal across an edge of a triangle
    assert np.median(abs(ratio - 1)) < 0.01 and np.quantile(abs(ratio - 1), 0.8) < 0.05


@pytest.mark.slow
def test_refractions_follow_the_rays_of_mitsuba(tmp_path, coarse, of_milk):  # noqa: F811
    """A ray from x along the direction at which a walk ends, refracted by Mitsuba's `dielectric` twice, comes to y."""
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, LAMP + panes(tmp_path, {"shell": SHELL}), [1.4])
    view = Scene(how.world, how.bodies, how.colours)
    random, n = np.random.default_rng(1), 2000
    x = mi.Point3f(*(mi.Float(row) for row in 2.5 * random.uniform(-1, 1, (3, n))))
    y = mi.Point3f(*(mi.Float(row) for row in np.array([[3.0], [-4.0], [8.0]]) + random.uniform(-1, 1, (3, n))))
    walk = view.lamps.small._refractions.walk(x, y, dr.full(mi.Bool, True, n))
    ray, squared = mi.Ray3f(x, walk.towards), mi.Float(1)
    for _ in range(2):
        surface = view.scene.ray_intersect(ray)
        sample, weight = surface.bsdf().sample(mi.BSDFContext(), surface, 1 - 2.0**-24, mi.Point2f(0.5))
        ray, squared = surface.spawn_ray(surface.to_world(sample.wo)), squared * weight.x
        squared *= sample.pdf
    ends = np.array(walk.ends)
    assert ends.mean() > 0.95
    missed = np.array(dr.norm(dr.cross(y - ray.o, ray.d)))[ends]
    # of a way of 10: Mitsuba starts rays 1e-3 off surfaces
    assert np.median(missed) < 1e-3 and np.quantile(missed, 0.99) < 0.02
    assert np.allclose(np.array(squared)[ends], np.array(walk.passes())[ends], rtol=0.01)


@pytest.mark.slow
def test_any_number_of_threads(tmp_path, of_milk):
    """Light samples through panes, strata and reflections do not depend on it."""
    around = LAMP + panes(tmp_path, {"shell": SHELL})
    how, threads = loops.transport(tmp_path, {"ball": (BALL, GREY)}, around, [1.4], size=6), dr.thread_count()
    several = loops.passes(how, [0])
    try:
        dr.set_thread_count(1)
        assert np.array_equal(several, loops.passes(how, [0]))
    finally:
        dr.set_thread_count(threads)


def test_samples_of_a_pixel_have_strata_of_their_own():
    """One in each of the pixel and in each of the choices, and all choices alike in each stratum of the pixel."""
    variants.activate()
    pixels, samples = 4096, 16
    path = dr.arange(mi.UInt32, pixels * samples)
    place, choice = strata.Strata.of((3, 5), samples).drawn(path // samples, path % samples, mi.PCG32(pixels * samples), True)
    x, y, choice = (np.array(numbers).reshape(pixels, samples) for numbers in (place.x, place.y, choice))
    number, chosen = np.floor(4 * x) + 4 * np.floor(4 * y), np.floor(16 * choice)
    assert np.array_equal(np.sort(number), np.sort(chosen)) and np.array_equal(np.sort(number)[0], np.arange(16))
    first = chosen[np.arange(pixels), np.argmin(number, axis=1)]  # the choice of the sample in the first stratum of the pixel
    assert np.bincount(first.astype(int), minlength=16).std() < 3 * 16  # 16 of 256 each


@pytest.mark.slow
def test_edges_of_lamps_are_less_noisy(tmp_path):
    """A lamp before a dark sky: of pixels that its edge crosses, samples in strata of 4 x 4 have less than half the variance of
    as many passes of one sample."""
    lamp = LAMP.replace('x="3" y="-4" z="8"', 'x="0" y="-8" z="2"')
    how = loops.transport(tmp_path, {"ball": (BALL, GREY)}, lamp, [1.4], size=12)
    view = Scene(how.world, how.bodies, how.colours)

    def variance(samples):
        part = passes.of_loop("paths", how.world, partial(loop.trace, view), 0, most=samples)
        pictures = np.array([part.render(number)["order0"] for number in range(64)])
        return samples * pictures.var(axis=0, ddof=1).mean()

    assert variance(16) < 0.5 * variance(1)


@pytest.mark.slow
@pytest.mark.parametrize("meshes, boundary, body", [
    ({"shell": SHELL}, IN_GLASS, FORWARD),
    ({"pane": PANE}, glass(1.4), GREY),
    ({"shell": SHELL, "pane": PANE}, IN_GLASS, FORWARD),
], ids=["forward-in-glass", "behind-a-pane", "in-glass-behind-a-pane"])
def test_as_paths_that_meet_lamps_behind_panes_by_chance(tmp_path, every, monkeypatch, meshes, boundary, body):  # noqa: F811
    """By blocks of the picture and orders, under a panel, beside an obstacle."""
    monkeypatch.setitem(loops.bodies.BOUNDARIES, 1.4, boundary)
    around = PANEL + FLOOR + panes(tmp_path, meshes) + shape(tmp_path, "obstacle", (0.3 * BALL[0] + [0, 0, 9], BALL[1]), BLACK)
    as_by_chance(tmp_path, monkeypatch, {"ball": (BALL, body)}, around, [1.4])


@pytest.mark.slow
@pytest.mark.parametrize("meshes, boundary, body", [
    ({"shell": SHELL}, IN_GLASS, FORWARD),
    ({"pane": PANE}, glass(1.4), GREY),
], ids=["forward-in-glass", "behind-a-pane"])
def test_directions_through_panes_as_by_chance(tmp_path, none, monkeypatch, meshes, boundary, body):  # noqa: F811
    """The same where directions are drawn: by way of reflections in the glass, too."""
    monkeypatch.setitem(loops.bodies.BOUNDARIES, 1.4, boundary)
    as_by_chance(tmp_path, monkeypatch, {"ball": (BALL, body)}, PANEL + FLOOR + panes(tmp_path, meshes), [1.4])
