"""A lamp beside the camera: particles hide what is seen and what is lit together, as discs and as the continuous medium.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import math

import numpy as np
import pytest
from scipy import integrate

from renderers.materials.particles import shadow, splat, walk
from tests.odds import sigmas
from tests.physics.particles import (
    Lamp,
    Sky,
    averaged,
    camera,
    classes,
    hashed,
    henyey_greenstein,
    kept,
    of_depth,
    passes,
)

EYE = (0.5, -3.0, 0.5)
SEEDS = 16


def lens(radius, distance):
    """Area in which two discs of a radius overlap."""
    if distance >= 2 * radius:
        return 0.0
    return 2 * radius**2 * math.acos(distance / 2 / radius) - distance * math.sqrt(radius**2 - distance**2 / 4)


@pytest.mark.parametrize("lamp, aside", [((0.0, -9.0, 0.0), (0.0, 0, 0)), ((0.0, -9.0, 0.0), (0.008, 0, 0.003)),
                                         ((0.05, -6.0, 0.02), (0.008, 0, -0.003)), ((0.3, -9.0, 0.0), (0.0, 0, 0))])
def test_the_depth_that_two_ways_share(lamp, aside):
    """Two classes of discs and a cube of edge 1, against SciPy's quadrature; eight points to each side miss it by 0.5 %."""
    density, radius = np.array([300.0, 30.0]), np.array([0.01, 0.03])
    medium = hashed(classes(density, math.pi * radius[None] ** 2))
    eye, seen = np.array([0.5, -9.0, 0.5]), np.array([[0.5, 0.8, 0.5]])
    middle = seen + aside
    towards = np.add(lamp, [0.5, 0, 0.5]) - middle
    distance = np.linalg.norm(towards, axis=1)
    towards /= distance[:, None]
    found = np.log(shadow.factors(medium, eye, seen, towards, distance, np.array([aside])))[0, 0]
    back = (eye - seen[0]) / np.linalg.norm(eye - seen[0])

    def shared(s):
        apart = np.linalg.norm(seen[0] + s * back - middle[0] - s * towards[0])
        return sum(n * lens(r, apart) for n, r in zip(density, radius))

    leave = (middle[0, 1] - 0) / -towards[0, 1]
    expected = integrate.quad(shared, 0, leave, limit=400)[0]
    assert 0.01 < expected < 0.2 and found == pytest.approx(expected, rel=5e-3)


def single(how, number, lamp, size=(8, 8), depth=1.0, seeds=SEEDS):
    """Single scattering of the cube, lit by a lamp, by realisation: mean and standard error."""
    view, kinds, made = camera(size, EYE, fov=13), of_depth(depth, number), []
    for seed in range(seeds):
        medium = hashed(kinds, seed=seed)
        if how in ("traced", "by chance"):
            what = medium, splat.Plan(1, how == "by chance")
            by_order = [splat.one_pass(Lamp(lamp), what, view, *size, number, seed, discrete=np.full(size, np.inf), lights=1)[0]
                        for number in range(2)]
        else:
            what = walk.Discs(medium, 0.0, True, np.array(EYE) if how == "stands for particles" else None)
            by_order = [walk.one_pass(Lamp(lamp), what, view, *size, 0, seed, discrete=np.zeros(size), lights=1)[0]]
        made.append(np.mean([one[1].mean() for one in by_order]))
    return averaged(made)


def test_light_of_the_camera_comes_back():
    """A fifth more than from the continuous medium; the test below measures it."""
    plain, _ = single("continuous", 10_000, EYE, (48, 48), seeds=4)
    for how, size in (("by chance", (8, 8)), ("stands for particles", (48, 48))):
        assert 1.15 < single(how, 10_000, EYE, size, seeds=4)[0] / plain < 1.3


# the share of single scattering that hiding together adds
@pytest.mark.slow
@pytest.mark.parametrize("aside, more", [(0.0, 0.22), (0.05, 0.16), (0.15, 0.08), (0.5, 0.03)])
def test_a_lamp_beside_the_camera_is_one_number(aside, more):
    """Optical depth 1, 10,000 discs of 5.6 mm: traced, hidden by chance, and as the continuous medium, all the same."""
    lamp = np.add(EYE, (aside, 0, 0))
    plain, _ = single("continuous", 10_000, lamp, (96, 96))
    traced, error = single("traced", 10_000, lamp)
    assert error < 0.005 * traced and abs(traced / plain - 1 - more) < 0.015
    for how, size in (("by chance", (8, 8)), ("stands for particles", (96, 96))):
        mean, other = single(how, 10_000, lamp, size)
        assert other < 0.006 * traced
        # 0.3 %: shares of discs outside of the box, and the continuous medium's own noise in `plain`
        assert abs(mean - traced) < sigmas(SEEDS) * math.hypot(error, other) + 0.003 * traced, how


@pytest.mark.slow
def test_a_wall_in_the_light_of_the_camera():
    """What a surface behind particles sends back, order 0: as the light came, exp(-tau) in place of exp(-2 tau)."""
    size, number, found = (12, 12), 3000, {}
    view = camera(size, EYE, fov=9)

    class Wall(Lamp):
        """A white wall behind the cube, y = 1.2, and the lamp."""

        def shade(self, origin, direction, random, density, delta):
            far = (1.2 - origin[:, 1]) / np.where(direction[:, 1] > 0, direction[:, 1], np.nan)
            hit = np.isfinite(far) & (far > 1e-9)
            plain = super().shade(origin, direction, random, density, delta)
            point = np.where(hit[:, None], origin + np.where(hit, far, 0.0)[:, None] * direction, 0.0)
            light = self.lights(point, random)
            radiance = np.where(hit[:, None], light.radiance, 0).astype(np.float32)
            return plain._replace(hit=hit, point=point, light=light._replace(radiance=radiance), origin=point)

        def trace(self, origin, direction, longest):
            far = (1.2 - origin[:, 1]) / np.where(direction[:, 1] > 0, direction[:, 1], np.nan)
            return np.where(np.isfinite(far) & (far > 1e-9), far, np.inf)

    for how in ("traced", "stands for particles"):
        made = []
        for seed in range(24):
            medium = hashed(of_depth(1.0, number), seed=seed)
            what = walk.Discs(medium, np.inf if how == "traced" else 0.0, True, None if how == "traced" else np.array(EYE))
            depth = np.full(size, np.inf if how == "traced" else 0.0)
            by_order = [walk.one_pass(Wall(EYE), what, view, *size, k, seed, discrete=depth, lights=1)[0] for k in range(4)]
            made.append(np.mean([one[0].mean() for one in by_order]))
        found[how] = averaged(made)
    (traced, error), (mean, other) = found.values()
    assert max(error, other) < 0.03 * traced and abs(mean - traced) < sigmas(24) * math.hypot(error, other)
    wall = np.mean(1 / ((np.array(EYE) - [0.5, 1.2, 0.5]) ** 2).sum())
    assert 0.9 * math.exp(-1) < traced / wall < 1.1 * math.exp(-1)


def test_a_lone_particle_does_not_scatter_in_itself():
    """Lossless, in a sky of 0.5: 0.5, as a particle's surroundings are the others; with its own share of the medium more."""
    size, sky = (12, 12), Sky(above=0.5, below=0.5)
    medium = kept(of_depth(1.0, 1, phase=henyey_greenstein(0.3)), np.array([[0.5, 0.5, 0.5]]), np.zeros(1, int))
    view, means = camera(size, EYE, fov=15), []
    for others in (0.0, 1.0):
        alone = medium._replace(others=others)
        walked = passes(walk.one_pass, sky, walk.Discs(alone, 0.0, True, np.array(EYE)), view, size, range(16))
        whole = walked + passes(splat.one_pass, sky, alone, view, size, range(16))
        means.append(averaged(whole.mean(axis=(1, 2, 3))))
    (mean, error), (more, other) = means
    assert error < 0.004 and abs(mean - 0.5) < sigmas(16) * error
    assert more - 0.5 > sigmas(16) * other


def test_shares_of_a_pass_go_by_the_seed():
    """The same particles of one realisation, of which another seed takes others in its first pass; all passes take all."""
    world, size, medium = Sky(sun=(1, 1, -1)), (24, 24), hashed(of_depth(0.5, 3000))
    view, everywhere = camera(size, fov=22), np.full(size, np.inf)
    plan = splat.Plan(5)
    made = np.array([[splat.one_pass(world, (medium, plan), view, *size, number, seed, discrete=everywhere, lights=2)[0][1]
                      for number in range(5)] for seed in (0, 1)])
    assert np.allclose(made[0].mean(axis=0).mean(), made[1].mean(axis=0).mean(), rtol=0.02)
    lit = (made[:, 0] > 0).all(axis=-1)
    together = np.mean(lit[0] & lit[1]) / np.mean(lit[0])
    assert np.mean(lit, axis=(1, 2)).max() < 0.5 and together < 0.8
