"""Pictures of particles: splat against walk, particles against the continuous medium and against spheres, exact sums and limits.

Worlds are one light in closed form (`particles.Sky`, `Lamp`).  Comparisons with chance go wrong once in
1e7 seeds; seeds are fixed.
"""

import math

import numpy as np
import pytest

from bakery import kernels
from bakery.physics.discrete import graininess
from renderers import colour
from renderers.materials.particles import detail, explicit, splat, walk
from tests.conftest import slow
from tests.odds import ODDS, SIGMAS, sigmas
from tests.physics.particles import (
    CUBE,
    THETA,
    Lamp,
    Sky,
    averaged,
    blocks,
    camera,
    classes,
    hashed,
    henyey_greenstein,
    kept,
    of_depth,
    passes,
    same,
)


def grouped(pictures, groups):
    """Means of groups of passes, so that what few pencils bring is nearly normal."""
    return pictures.reshape(groups, -1, *pictures.shape[1:]).mean(axis=1)


# ---- splat and walk


def few(seed=1):
    """Sixty particles of three classes, radii of 0.013 to 0.056 m; areas, angles and albedo differ by wavelength."""
    random = np.random.default_rng(seed)
    extinction = np.array([[0.01, 0.003, 5e-4], [0.0075, 0.004, 1e-3], [0.005, 0.002, 1.5e-3]])
    phase = np.array([[henyey_greenstein(g) for g in row] for row in ((0.6, 0.0, -0.5), (0.5, 0.1, -0.4), (0.4, 0.2, -0.3))])
    kinds = classes([20.0] * 3, extinction, np.array([[1.0, 0.9, 0.8]]), phase)
    return kinds, random.random((60, 3)), random.integers(0, 3, 60)


FAR = ((0.5, -3.0, 0.5), (0.5, 0.5, 0.5), 22)
WORLDS = {
    "sun and sky": (Sky(sun=(1, 1, -1), above=0.3), FAR),
    "light behind": (Sky(sun=(0.1, -1, 0.2)), FAR),
    "lamp inside": (Lamp((0.53, 0.41, 0.6)), FAR),
    "camera inside": (Sky(sun=(1, 1, -1)), ((0.5, 0.3, 0.5), (0.6, 0.9, 0.5), 90)),
}


@pytest.mark.slow
@pytest.mark.parametrize("where", ["sun and sky", *map(slow, ("camera inside", "light behind", "lamp inside"))])
def test_splat_and_walk_are_two_ways_to_one_picture(where):
    """The first order of the same realisation, pixel by pixel: discs larger than pixels, and pixels larger than discs."""
    world, eye = WORLDS[where]
    size = (64, 64) if where == "camera inside" else (128, 128)  # discs nearby take thousands of pencils
    medium, fine, coarse = kept(*few()), camera(size, *eye), camera((8, 8), *eye)
    walked = blocks(passes(walk.one_pass, world, walk.Discs(medium), fine, size, range(12), order=1), (8, 8))
    large = blocks(passes(splat.one_pass, world, medium, fine, size, range(12), order=1), (8, 8))
    small = blocks(grouped(passes(splat.one_pass, world, medium, coarse, (8, 8), range(360), order=1), 12), (8, 8))
    assert same(walked, large) > ODDS and same(walked, small) > ODDS
    assert same(walked, 1.15 * small) < ODDS, "nothing would be seen"


def test_light_in_narrow_peaks_is_found_by_going_on():
    """A sky that is bright everywhere, and particles that send most light on within a degree: places on the sky alone are in that
    peak once in 1e4, with 1e4 times the light; a path that goes on is in it.  The mean is that of walks, by ten thousand pencils
    and more, whose weights the balance heuristic keeps below 1 / FOLLOWED."""
    world, size = Sky(above=1.0, below=1.0), (32, 32)
    kinds, place, kind = few()
    peaked = kinds._replace(phase=np.broadcast_to(henyey_greenstein(0.98), kinds.phase.shape).copy())
    medium, view = kept(peaked, place, kind), camera(size, fov=22)
    walked = passes(walk.one_pass, world, walk.Discs(medium), view, size, range(24), order=1)
    added = passes(splat.one_pass, world, medium, view, size, range(24), order=1)
    assert same(blocks(walked, (4, 4)), blocks(added, (4, 4))) > ODDS
    # as of pencils that bring 4 in a quarter of the cases: three times the square of what they bring
    assert added.var(axis=0, ddof=1).mean() < 4 * walked.var(axis=0, ddof=1).mean()


def test_shares_are_the_whole():
    """Passes that take a share of the particles each, pixel by pixel: the light has one direction, so nothing is drawn."""
    world, size, medium = Sky(sun=(1, 1, -1)), (24, 24), hashed(of_depth(0.5, 3000))
    view = camera(size, fov=22)
    everywhere = np.full(size, np.inf)
    whole, shared = (np.array([splat.one_pass(world, (medium, splat.Plan(shares)), view, *size, number, 0, discrete=everywhere,
                                              lights=2)[0][1] for number in range(shares)]) for shares in (1, 5))
    assert np.allclose(shared.mean(axis=0), whole[0], rtol=1e-9, atol=1e-12) and (shared.sum(axis=(1, 2, 3)) > 0).all()


@pytest.mark.slow
class OneOfThree(Lamp):
    """Of three lamps in one place, each with a third of the light, one is drawn, and two are dark."""

    extended = False

    def lights(self, point, random, *, hidden=True):
        sample = super().lights(point, random, hidden=hidden)
        return sample._replace(radiance=sample.radiance * (3.0 * (random[:, 0] < 1 / 3))[:, None])


def test_passes_share_out_the_lights():
    """Each particle has its lamp in 5 or 6 of 16 passes.  By chance alone the mean of these would vary as a 16th of one pass."""
    world, size, medium = OneOfThree((0.5, -3.0, 1.5)), (8, 8), hashed(of_depth(0.1, 300))
    pictures = np.array([passes(splat.one_pass, world, medium, camera(size, fov=22), size, range(16), seed=seed, order=1)[..., 0]
                         for seed in range(12)])
    of_one, of_mean = pictures[:, 0].var(axis=0, ddof=1).mean(), pictures.mean(axis=1).var(axis=0, ddof=1).mean()
    assert of_mean < of_one / 60


def test_a_camera_on_a_particle():
    """Its disc is in no pencil's way; from a hair behind it, it is all that is seen."""
    kinds, place, kind = few()
    place = place.astype(np.float32).astype(float)  # as they are kept
    size, world, medium, found = (32, 32), Sky(sun=(1, 1, -1)), kept(kinds, place, kind), []
    target = np.array([0.5, 0.5, 0.55])
    for eye in (place[7], place[7] - 1e-9 * (target - place[7])):
        view = camera(size, eye, target, 80)
        walked = blocks(passes(walk.one_pass, world, walk.Discs(medium), view, size, range(12), order=1), (4, 4))
        added = blocks(grouped(passes(splat.one_pass, world, medium, view, size, range(48), order=1), 12), (4, 4))
        assert same(walked, added) > ODDS
        found.append(added.mean())
    assert 0 < 3 * found[0] < found[1]


def test_what_splat_takes_the_walk_leaves_out():
    world, size, medium = Sky(sun=(1, 1, -1), above=0.3), (48, 48), kept(*few())
    view = camera(size, fov=22)
    whole = passes(walk.one_pass, world, walk.Discs(medium), view, size, range(24))
    parts = passes(walk.one_pass, world, walk.Discs(medium, splatted=True), view, size, range(100, 124)) \
        + passes(splat.one_pass, world, medium, view, size, range(24))
    assert same(blocks(whole, (4, 4)), blocks(parts, (4, 4))) > ODDS
    taken = passes(walk.one_pass, world, walk.Discs(medium, splatted=True), view, size, range(2), order=1)
    assert not taken.any()


# ---- particles and the continuous medium

SIDE, DEPTH = 16, 0.02  # pixels; optical depth of the cube: discs small enough to get one pencil, like points


def along(view, size, function):
    """Integrals over the way of camera rays through the cube, of function(points (n, 3), way in the cube (n,)), (H, W)."""
    height, width = size
    node, weight = np.polynomial.legendre.leggauss(12)
    out = np.zeros(size)
    fine = view.rays(height, width).reshape(-1, 3)
    near = ((0 - view.origin[1]) / fine[:, 1]), ((1 - view.origin[1]) / fine[:, 1])
    for x, w in zip(node, weight):
        s = near[0] + (x + 1) / 2 * (near[1] - near[0])
        out += (w / 2 * (near[1] - near[0]) * function(view.origin + s[:, None] * fine, s - near[0])).reshape(size)
    return out


def closed_form(view, size, depth=DEPTH, host=0.0):
    """Mean of single scattering by the isotropic cube that a lamp lights from above, and its variance times N (Campbell).

    host : 1/m, what absorbs between the particles
    """
    def seen(point, way):
        return np.exp(-(depth + host) * (way + 1 - point[:, 2]))

    angle = view.angle(*size) ** 2
    mean = depth / (4 * math.pi) * along(view, size, seen)
    square = along(view, size, lambda point, way: seen(point, way) / ((point - view.origin) ** 2).sum(axis=1))
    return mean, (depth / (4 * math.pi)) ** 2 * square / angle


def realisations(number, count):
    """Pictures (count, H, W) of single scattering, each of another realisation of `number` particles."""
    view, world = camera((SIDE, SIDE), fov=13), Sky(sun=(0, 0, -1))
    made = [passes(splat.one_pass, world, hashed(of_depth(DEPTH, number), seed=seed), view, (SIDE, SIDE), [0], order=1)[0, ..., 0]
            for seed in range(count)]
    return np.array(made)


def held_against_campbell(numbers):
    """Mean and variance over realisations for each number of particles, slope of the error; `numbers` by number."""
    view = camera((SIDE, SIDE), fov=13)
    mean, square = closed_form(view, (SIDE, SIDE))
    slopes = []
    for number, count in numbers.items():
        pictures = realisations(number, count)
        predicted = square / number
        # of all pixels together: means in closed form on both sides
        error = math.sqrt(predicted.sum() / count) / SIDE**2
        assert abs(pictures.mean() - mean.mean()) < SIGMAS * error
        pixels = ((pictures - mean) ** 2 / predicted).ravel()
        # fourth moment of a Poisson sum of so many equal terms
        fourth = 2 + 1 / (number / SIDE**2 * 0.5)
        error = math.sqrt(fourth / len(pixels))
        assert abs(pixels.mean() - 1) < SIGMAS * error + 0.01, number  # 1 %: shadows, edges of pixels
        slopes.append((math.log(number), 0.5 * math.log(pixels.mean() / number), error / 2))
    x, y, error = np.array(slopes).T
    w = (x - x.mean()) / ((x - x.mean()) ** 2).sum()
    assert abs(w @ y + 0.5) < SIGMAS * math.sqrt((w**2) @ error**2) + 0.002
    relative = graininess.relative_variance(1.0, 1.0, 1e4, DEPTH, 3.0, 4.0, float(np.median(view.angle(SIDE, SIDE) ** 2)))
    assert relative == pytest.approx(np.median(square / mean**2) / 1e4, rel=0.05)  # light weakened by 1 %


@pytest.mark.slow
def test_mean_and_graininess_of_a_pixel_are_campbell_s():
    """From 1e2 to 1e5 particles; error against their number with slope -1/2."""
    held_against_campbell({100: 200, 1000: 40, 10_000: 12, 100_000: 3})


@pytest.mark.soak
def test_mean_and_graininess_of_a_pixel_are_campbell_s_for_many():
    held_against_campbell({10_000: 100, 100_000: 30, 1_000_000: 10, 10_000_000: 4})


def test_the_host_absorbs():
    """Between particles, on the way to them and from them, and where there is none."""
    size, host, kinds = (SIDE, SIDE), np.array([0.7]), of_depth(DEPTH, 10_000, host=0.7)
    view, lamp = camera(size, fov=13), Sky(sun=(0, 0, -1))
    expected = closed_form(view, size, DEPTH, host[0])[0].mean()
    for how, count in ((splat, 12), (walk, 24)):
        made = []
        for seed in range(count):
            medium = hashed(kinds, seed=seed)
            what = medium if how is splat else walk.Discs(medium, 0.0)
            far = np.inf if how is splat else 0.0
            made.append(passes(how.one_pass, lamp, what, view, size, [seed], order=1, discrete=far).mean())
        mean, error = averaged(made)
        assert error < 0.15 * expected and abs(mean - expected) < sigmas(count) * error
        assert how is walk or error < 0.03 * expected
    unscattered = passes(walk.one_pass, Sky(above=1.0, below=1.0), walk.Discs(hashed(of_depth(1e-6, 50, host=0.7))), view, size,
                         range(4)).mean(axis=(0, 3))
    assert np.allclose(unscattered, np.exp(-0.7 * along(view, size, lambda point, way: np.ones(len(point)))), rtol=0.02)


@pytest.mark.parametrize("number", [1000, slow(10_000)])
def test_all_orders_are_the_continuous_medium_s(number):
    """Optical depth 2, mean over 16 realisations; a disc of two pencils near their corner counts twice: n rho^3 is allowed."""
    size, world, kinds = (24, 24), Sky(sun=(0.3, 0.2, -1)), of_depth(2.0, number, phase=henyey_greenstein(0.5))
    view, found = camera(size, fov=13), []
    for later, depth in ((np.inf, np.inf), (0.0, 0.0)):
        by_order = []
        for seed in range(16):
            medium = walk.Discs(hashed(kinds, seed=seed), later)
            own = seed + 100 * (later > 0)
            orders, _ = walk.one_pass(world, medium, view, *size, 0, own, discrete=np.full(size, depth), lights=2)
            by_order.append(orders[1:, ..., 0].mean(axis=(1, 2)))
        found.append(averaged(by_order))
    (mean, error), (expected, other) = found
    finite = number * math.sqrt(2.0 / number / math.pi) ** 3
    assert np.all(np.hypot(error, other) < 0.09 * expected)
    assert np.all(np.abs(mean - expected) < sigmas(16) * np.hypot(error, other) + finite * expected)


# ---- level of detail


@pytest.mark.slow
def test_level_of_detail_keeps_mean_and_tolerance():
    """Particles nearer than the predicted depths, and beyond them the continuous medium: what is lost deviates as was allowed."""
    size, world, tolerance, kinds = (24, 24), Sky(sun=(0, 0, -1)), 0.2, of_depth(0.05, 60_000)
    view = camera(size, (0.5, -0.3, 0.5), (0.5, 0.5, 0.5), 30)
    world.camera = view
    depth = detail.depths(world, hashed(kinds), view, *size, tolerance, 0)
    assert np.all((depth > 0.4) & (depth < 0.9))
    lost, kept_mean = [], []
    for seed in range(12):
        medium = hashed(kinds, seed=seed)
        near = passes(splat.one_pass, world, medium, view, size, [0], order=1, discrete=depth)[0, ..., 0]
        whole = passes(splat.one_pass, world, medium, view, size, [0], order=1)[0, ..., 0]
        rest = walk.Discs(medium, 0.0, True)
        far = passes(walk.one_pass, world, rest, view, size, range(4), order=1, discrete=depth, seed=seed)
        lost.append(whole - near)
        kept_mean.append((near + far.mean(axis=0)[..., 0]).mean())
    lost = np.array(lost)
    mean, _ = closed_form(view, size, 0.05)
    deviation = np.sqrt(lost.var(axis=0, ddof=1).mean()) / mean.mean()
    # 12 x 576 pixels: their deviation is known to 1.3 %
    assert 0.5 * tolerance < deviation < 1.08 * tolerance
    average, error = averaged(kept_mean)
    assert error < 0.03 * mean.mean()
    assert abs(average - mean.mean()) < sigmas(12) * error
    assert not detail.depths(world, hashed(kinds), view, *size, 10.0, 0).any()
    assert np.isinf(detail.depths(world, hashed(kinds), view, *size, 1e-4, 0)).all()


# ---- spheres


def of_rays(index, absorbed=0.0, number=400_000):
    """Albedo and phase function (A,) 1/sr at `THETA` of a sphere by geometrical optics, unpolarised, without diffraction.

    absorbed : absorption coefficient times radius.  Rays by Snell's and Fresnel's laws, deviations summed up (van de Hulst 12.2)
    """
    b = np.sqrt((np.arange(number) + 0.5) / number)
    i, r = np.arcsin(b), np.arcsin(b / index)
    s = (np.cos(i) - index * np.cos(r)) / (np.cos(i) + index * np.cos(r))
    p = (index * np.cos(i) - np.cos(r)) / (index * np.cos(i) + np.cos(r))
    reflected, passed = (s**2 + p**2) / 2, np.exp(-2 * absorbed * np.cos(r))
    turns, powers = [2 * i - math.pi], [reflected]
    power = (1 - reflected) ** 2 * passed
    for order in range(40):
        turns.append(2 * (i - r) + order * (math.pi - 2 * r))
        powers.append(power.copy())
        power *= reflected * passed
    cosine, power = np.cos(np.concatenate(turns)), np.concatenate(powers) / number
    edges = np.cos(THETA[::-1])
    held, _ = np.histogram(cosine, edges, weights=power)
    density = (held / (2 * math.pi * np.diff(edges)))[::-1]  # between the nodes
    at = np.concatenate([[density[0]], (density[1:] + density[:-1]) / 2, [density[-1]]])
    return power.sum(), at / kernels.phase_integral(THETA, at)


def spheres(kinds, radius, index, absorption, seed=1, place=None):
    medium = hashed(kinds, seed=seed) if place is None else kept(kinds, place, np.zeros(len(place), int))
    return medium, explicit.Spheres(medium, np.array([index]), np.array([[absorption]]))


@pytest.mark.parametrize("absorbed", [slow(0.0), slow(0.3)])
def test_a_sphere_is_its_phase_function(absorbed):
    """One sphere before a sky of which half is white: rays through it, and its disc with the albedo and angles of such rays."""
    radius, size = 0.1, (32, 32)
    albedo, phase = of_rays(1.5, absorbed)
    kinds = classes(1.0, math.pi * radius**2, albedo, phase)
    medium, balls = spheres(kinds, radius, 1.5, absorbed / radius, place=np.array([[0.5, 0.5, 0.5]]))
    for sky, target in ((Sky(above=1.0), (0.5, 0.5, 0.5)), (Sky(below=1.0), (0.5, 0.5, 0.9))):
        view = camera(size, (0.5, -4.5, 0.5 + 2 * (target[2] - 0.5)), (0.5, 0.5, 0.5), 2.7)
        found = [averaged(passes(walk.one_pass, sky, method, view, size, range(12), order=1).mean(axis=(1, 2, 3)))
                 for method in (balls, walk.Discs(medium))]
        (rays, one), (disc, other) = found
        assert max(one, other) < 0.015 * rays
        # 0.3 %: the disc is seen in perspective
        assert abs(rays - disc) < sigmas(12) * math.hypot(one, other) + 0.003 * rays


@pytest.mark.slow
def test_spheres_are_particles_without_diffraction():
    """Optical depth 1, 3,000 spheres of index 1.33; light leaves a sphere beside its centre: 2 % are allowed."""
    radius, size = math.sqrt(1 / 3000 / math.pi), (32, 32)
    _, phase = of_rays(1.33)
    kinds = of_depth(1.0, 3000, phase=phase)
    view, sky, difference, level = camera(size, fov=13), Sky(above=1.0), [], []
    for seed in range(16):
        medium, balls = spheres(kinds, radius, 1.33, 0.0, seed)
        ours, theirs = (walk.one_pass(sky, method, view, *size, 0, seed, discrete=np.full(size, np.inf), lights=2)[0][1:]
                        .mean(axis=(1, 2, 3)) for method in (walk.Discs(medium), balls))
        difference.append(ours - theirs)
        level.append(theirs)
    mean, error = averaged(difference)
    level = np.mean(level, axis=0)
    assert np.all(error < [0.03, 0.05, 0.08] * level)
    assert np.all(np.abs(mean) < sigmas(16) * error + 0.02 * level)


# ---- sums that are exact


def test_a_ring_of_cameras_reads_the_phase_function():
    """One small particle: the sum of radiance times solid angle times distance^2 is C_s f."""
    g, size = 0.7, (5, 5)
    kinds = classes(1.0, 1e-10, 0.5, henyey_greenstein(g))
    medium, world = kept(kinds, np.array([[0.4, 0.5, 0.6]]), np.zeros(1, int)), Sky(sun=(1, 0, 0))
    for angle in np.linspace(0, math.pi, 13):
        eye = np.array([0.4, 0.5, 0.6]) + 2 * np.array([math.cos(angle), math.sin(angle), 0])
        view = camera(size, eye, (0.4, 0.5, 0.6), 1)
        radiance = passes(splat.one_pass, world, medium, view, size, range(3), order=1).mean(axis=0)[..., 0]
        found = (radiance * view.angle(*size) ** 2).sum() * 4 / 0.5e-10
        assert found == pytest.approx((1 - g * g) / (4 * math.pi) / (1 + g * g - 2 * g * math.cos(angle)) ** 1.5, rel=1e-3)


@pytest.mark.slow
def test_lamp_and_camera_may_change_places():
    """The irradiance at one of two points from a lamp at the other: all orders, optical depth 1, 12 realisations."""
    a, b, size = (0.4, -0.6, 0.7), (1.5, 0.5, 0.3), (24, 24)
    kinds, sums = of_depth(1.0, 2000, phase=henyey_greenstein(0.6)), []
    for lamp, eye in ((a, b), (b, a)):
        view = camera(size, eye, (0.5, 0.5, 0.5), 110)
        solid = view.angle(*size)[..., None] ** 2
        found = []
        for seed in range(12):
            medium = hashed(kinds, seed=seed)
            whole = passes(walk.one_pass, Lamp(lamp), walk.Discs(medium, splatted=True), view, size, range(4)).mean(axis=0) \
                + passes(splat.one_pass, Lamp(lamp), medium, view, size, [0]).mean(axis=0)
            found.append((whole * solid)[..., 0].sum())
        sums.append(found)
    mean, error = averaged(np.subtract(*sums))
    assert error < 0.04 * np.mean(sums)
    assert abs(mean) < sigmas(12) * error


def white(medium, view, size, method, world=None):
    """Passes of a picture in a white world."""
    world = world or Sky(above=1.0, below=1.0)
    if method == "splat":
        walked = passes(walk.one_pass, world, walk.Discs(medium, splatted=True), view, size, range(16))
        return walked + passes(splat.one_pass, world, medium, view, size, range(16))
    how = {"particles": walk.Discs(medium), "continuous": walk.Discs(medium, 0.0),
           "explicit": explicit.Spheres(medium, np.array([1.5]), np.zeros((1, 1)))}[method]
    return passes(walk.one_pass, world, how, view, size, range(16), discrete=0.0 if method == "continuous" else np.inf)


@pytest.mark.parametrize("depth, number", [(1e-6, 500), (3.0, 500), slow(20.0, 20_000)])
@pytest.mark.parametrize("method", ["splat", "particles", "continuous", "explicit"])
def test_a_white_world_is_white(method, depth, number):
    """Nothing is absorbed, and the sky is 1: so is the picture."""
    size = (12, 12)
    medium = hashed(of_depth(depth, number, phase=henyey_greenstein(0.3)))
    mean, error = averaged(white(medium, camera(size, fov=13), size, method).mean(axis=(1, 2, 3)))
    assert error < 0.05
    # particles that hardly any pencil meets add not more than their depth
    assert abs(mean - 1) < sigmas(16) * error + (1e-5 if depth == 1e-6 else 1e-9)


@pytest.mark.slow
def test_optical_depth_1000():
    """1e11 particles that are nowhere stored, of albedo 0.9: as bright as the continuous medium, each order."""
    size, world, found = (24, 24), Sky(sun=(0.3, 1, -1), above=0.2), []
    view, medium = camera(size, fov=13), hashed(of_depth(1e3, 1e11, albedo=0.9, phase=henyey_greenstein(0.3)))
    for later in (np.inf, 0.0):
        orders = [walk.one_pass(world, walk.Discs(medium, later), view, *size, number, int(later > 0),
                                discrete=np.full(size, later), lights=2)[0][..., 0].mean(axis=(1, 2)) for number in range(12)]
        found.append(averaged(orders))
    (mean, error), (expected, other) = found
    assert mean[0] == expected[0] == 0
    error = np.hypot(error, other)
    assert np.all(error[1:] < 0.08 * expected[1:])
    # n rho^3 = 0.018 is allowed, see above
    assert np.all(np.abs(mean - expected)[1:] < sigmas(12) * error[1:] + 0.018 * expected[1:])


def test_a_flat_medium_is_grey():
    """Eight wavelengths alike: R, G and B are equal to rounding under white light, in every pixel."""
    waves = np.linspace(0.42, 0.68, 8)
    matrices = colour.srgb_matrix(waves), colour.spread_matrix(waves)
    medium = hashed(of_depth(1.0, 300, waves=8, albedo=0.9, phase=henyey_greenstein(0.3)), CUBE, 1, *matrices)
    size, world = (16, 16), Sky(sun=(1, 1, -1), above=0.5)
    view = camera(size, fov=20)
    for picture in (passes(walk.one_pass, world, walk.Discs(medium), view, size, range(4)),
                    passes(splat.one_pass, world, medium, view, size, range(4))):
        assert picture.any()
        assert np.abs(picture - picture.mean(axis=-1, keepdims=True)).max() < 1e-6 * picture.max()


def test_black_particles_before_a_white_sky():
    """Mean over 40 realisations of what gets through: exp(-tau) of each ray's way; nothing is scattered."""
    size, sky, found = (16, 16), Sky(above=1.0, below=1.0), []
    view = camera(size, fov=13)
    for seed in range(40):
        medium, everywhere = hashed(of_depth(1.5, 400, albedo=0.0), seed=seed), np.full(size, np.inf)
        orders, _ = walk.one_pass(sky, walk.Discs(medium), view, *size, 0, seed, discrete=everywhere, lights=2)
        assert not orders[1:].any() and not passes(splat.one_pass, sky, medium, view, size, [0]).any()
        found.append(orders[0].mean())
    mean, error = averaged(found)
    expected = np.exp(-1.5 / view.rays(*size)[..., 1]).mean()
    assert error < 0.04 * expected and abs(mean - expected) < sigmas(40) * error


def test_no_light_no_particle():
    size = (8, 8)
    view, dark = camera(size, fov=20), Sky()
    nobody = kept(of_depth(1.0, 10), np.zeros((0, 3)), np.zeros(0, int))
    for medium in (nobody, hashed(of_depth(1.0, 100))):
        for later in (0.0, np.inf):
            assert not passes(walk.one_pass, dark, walk.Discs(medium, later), view, size, range(2)).any()
        assert not passes(splat.one_pass, dark, medium, view, size, range(2)).any()
    assert not passes(splat.one_pass, Sky(sun=(0, 0, -1)), nobody, view, size, range(2)).any()
    seen = passes(walk.one_pass, Sky(above=1.0, below=1.0), walk.Discs(nobody), view, size, [0])
    assert np.array_equal(seen, np.ones((1, 8, 8, 3)))


# ---- bright lamps


class Bulb(Sky):
    """A lamp of radiance 1000 that is seen within 0.012 rad of +y, before a sky of radiance 1."""

    def _radiance(self, direction):
        return np.repeat(np.where(direction[:, 1] > math.cos(0.012), 1000.0, 1.0)[:, None], 3, axis=1)


@pytest.mark.slow
def test_pixels_that_show_a_lamp_have_a_path_in_each_of_their_squares():
    """Sixteen: of a lamp with particles before it the same light, with less than a sixteenth of the variance, as its rim goes
    through few of the squares; without particles its solid angle, which they tell to some 1 %."""
    size, world = (48, 64), Bulb(above=1)
    view = camera(size)
    squares = walk.squares_of(world, view, *size)
    cosine = view.rays(*size)[..., 1]  # of their middles
    shows = squares.reshape(size) > 1
    assert squares.max() == 4 and shows[cosine > math.cos(0.012)].all() and not shows[cosine < math.cos(0.018)].any()

    def pictures(medium, given, numbers):
        what = walk.Discs(medium)
        what.squares = given
        return passes(walk.one_pass, world, what, view, size, numbers)[..., 0]

    dust = hashed(of_depth(0.5, 5e4))
    single, several = (pictures(dust, given, range(16)) for given in (None, squares))
    assert several.var(axis=0).sum() < single.var(axis=0).sum() / 16
    assert same(single.mean(axis=(1, 2))[:, None], several.mean(axis=(1, 2))[:, None]) > ODDS
    assert np.array_equal(single[:, ~shows], several[:, ~shows])
    (seen,) = pictures(hashed(of_depth(1e-9, 10)), squares, [0])
    of_lamp = ((seen - (seen > 0.5)) * view.angle(*size) ** 2 / 999).sum()
    assert of_lamp == pytest.approx(2 * math.pi * (1 - math.cos(0.012)), rel=0.05)
