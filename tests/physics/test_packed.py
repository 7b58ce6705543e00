"""Random walks among packed grains against exact means, single grains' closed forms, published figures and literal twins.

Statistical tests have fixed seeds and compare within `SIGMAS` standard errors of 32 blocks: a false alarm in 1e-6 a
comparison, 1e-4 for the file, should random numbers be drawn anew.
"""

import itertools
import math
import pickle
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest

from bakery.physics.grains.bvh import Mesh
from bakery.physics.grains.sphere import ball
from bakery.physics.grains.surface import conductor, dielectric, diffuse
from bakery.physics.granular import _packed as kernel
from bakery.physics.granular import packed
from bakery.physics.granular.packed import Grain, walk
from bakery.physics.packing import pack
from bakery.physics.packing.cells import tile_grid
from bakery.physics.packing.instances import rotation_matrix
from bakery.physics.shapes import build as shapes
from tests.conftest import slow
from tests.odds import sigmas
from tests.oracles.instances import instances

SIGMAS = sigmas(32, 1e-6)
GLASS, MATT, MIRROR = dielectric(1.5), diffuse(1.0), conductor(np.inf)


def built(triangles=20_000, **shape):
    mesh = shapes.build(shape, triangles)
    return Mesh(mesh.vertices, mesh.faces)


CUBE = built(type="box", size=[1, 1, 1])
ONE = [[0.0, 0.0, 0.0]], [1.0], [2.5, 2.6, 2.7]


@cache
def tile(fraction, count, ratio=1):
    """`count` equal spheres; with a ratio, a twentieth of them that many times as large as the rest."""
    radii = np.ones(count)
    radii[: count // 20] = ratio
    made = pack(fraction, radii, seed=1, schedule="draft")
    assert made.reached
    return made.centers, made.radii, made.cell


@cache
def walked(fraction, grain, tolerance=0.01, count=500):
    return walk(tile(fraction, count), [{"ball": Grain(GLASS), "cube": Grain(GLASS, CUBE), "matt": Grain(MATT)}[grain]], seed=2,
                tolerance=tolerance)


def near(found, name, exact, spread=0.0):
    away = abs(getattr(found, name) - exact) / np.hypot(found.errors[name], spread)
    assert away < SIGMAS, f"{name}: {getattr(found, name)} instead of {exact}, {away} standard errors"


# ---- what is exact

@pytest.mark.parametrize("fraction", [0.3, 0.63])
def test_balls_of_glass_keep_the_exact_means(fraction):
    """Mean flight of Eq. 1, the closed form of the ball, reciprocity; every sphere is hit."""
    found, one = walked(fraction, "ball"), ball(GLASS)
    assert found.reached and found.achieved_error <= 0.01 and found.reason == "" and found.given_up == 0
    chord = 4 / 3 * (1 - fraction) / fraction
    assert abs(found.void_chord_exact / chord - 1) < 1e-9
    assert found.hit_probability == 1
    for name in ("void_chord", "flight"):
        near(found, name, chord)
    near(found, "lambda_t", chord + one.lambda_s[0])
    for name, exact in (("lambda_s", one.lambda_s[0]), ("lambda_o", one.lambda_s[0]), ("mean_square", one.mean_square[0]),
                        ("g", one.g[0])):
        near(found, name, exact)
    near(found, "mean_square_rte", 2 * (chord + one.lambda_s[0]) ** 2 / (1 - one.g[0]))


def test_cubes_of_glass_keep_the_exact_means():
    """Cauchy's 2/pi of the spheres are hit; Eq. 3; statistics of the single cube as measured elsewhere, with their errors."""
    found = walked(0.63, "cube")
    beta, passed = 2 / np.pi, 0.84897
    flight = 4 / 3 * 0.37 / 0.63 / beta + passed * (1 - beta) / beta
    near(found, "void_chord", 4 / 3 * 0.37 / 0.63)
    near(found, "hit_probability", beta)
    near(found, "flight", flight, 1e-4)
    near(found, "lambda_s", 1.38850, 2.2e-4)
    near(found, "lambda_o", 1.38850, 2.2e-4)
    near(found, "g", 0.43807, 2.6e-4)
    near(found, "mean_square", 3.0468, 6e-4)
    near(found, "lambda_t", 3.1043, 4e-4)


def test_spheres_of_several_sizes_and_a_mixture():
    """Ratio 10: means are weighted by cross section; half of the grains are cubes, which 2/pi of the rays hit."""
    centers, radii, cell = tile(0.6, 400, 10)
    found = walk((centers, radii, cell), [Grain(GLASS), Grain(GLASS, CUBE)], [1.0, 1.0], seed=5, tolerance=0.02)
    near(found, "void_chord", 4 / 3 * np.sum(radii**3) / np.sum(radii**2) * 0.4 / 0.6)
    beta = 0.5 + 1 / np.pi
    near(found, "hit_probability", beta)
    share = 0.5 / beta  # of the hits on balls
    size = np.sum(radii**3) / np.sum(radii**2)
    near(found, "lambda_s", size * (share * 1.42435480 + (1 - share) * 1.38850), 2.2e-4 * size)
    near(found, "g", share * 0.65008941 + (1 - share) * 0.43807, 2.6e-4)


def test_long_flights_have_the_exact_mean():
    near(walk(tile(0.001, 1000), [Grain(GLASS)], seed=1, tolerance=0.03), "void_chord", 4 / 3 * 999)


# ---- how far light gets

@pytest.mark.parametrize("fraction, grain, published", [(0.3, "ball", 120.3), (0.63, "ball", 33.34), (0.63, "cube", 37.88)])
def test_mean_square_displacement_is_the_published_one(fraction, grain, published):
    """Brute force in packings of 4000, good to 1 %; light spreads farther than Eq. 4 says."""
    found = walked(fraction, grain)
    M = found.mean_square_displacement
    near(found, "mean_square_displacement", published, 0.01 * published)
    assert M / found.mean_square_rte > 1 + {0.3: -0.02, 0.63: 0.04}[fraction]
    assert abs(found.drift) < SIGMAS * found.drift_error


def test_matt_balls_keep_light_back():
    """Opaque grains send light to and fro between neighbours: M is a quarter to a third below Eq. 4."""
    found = walked(0.63, "matt")
    near(found, "g", -4 / 9)
    assert 2 / 3 - 0.05 < found.mean_square_displacement / found.mean_square_rte < 3 / 4 + 0.05
    assert found.correlation > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("surface", [GLASS, slow(MATT)], ids=["glass", "matt"])
def test_rare_hits_know_nothing_of_each_other(surface):
    """The stage takes Eq. 4 to be right to the hit probability where that is below its tolerance; here it is 0.08.

    sqrt(M) is known to 0.9 %, and off by 2.2 (glass) and 0.1 % (matt) of itself: six and eight errors from what would fail.
    """
    found = walk(tile(0.6, 200), [Grain(surface, built(type="ellipsoid", axes=[1, 0.1, 0.1], triangles=1300))], seed=1,
                 tolerance=1e-3, hits=1 << 17)
    assert found.hit_probability == pytest.approx(0.0785, rel=0.02) and found.achieved_error < 0.02
    assert abs(math.sqrt(found.mean_square_displacement / found.mean_square_rte) - 1) < found.hit_probability


def test_errors_are_as_large_as_they_say():
    """Spread of z over 16 seeds, of figures known exactly and of M around its mean: chi^2 of 15, odds of 1e-4 each."""
    results = [walk(tile(0.63, 500), [Grain(GLASS)], seed=seed, tolerance=0.03) for seed in range(16)]
    for name in ("void_chord", "lambda_s", "g", "lambda_t", "mean_square_displacement"):
        value, error = (np.array([getattr(found, name + end) for found in results]) for end in ("", "_error"))
        chi = np.sum(((value - value.mean()) / error) ** 2)
        assert 3.0 < chi < 50.0, f"{name}: {chi}"


def test_nearly_matched_grains_take_longer_windows():
    found = walk(tile(0.3, 500), [Grain(dielectric(1.1))], seed=1, tolerance=0.05)
    assert found.reached and found.length > 512 and found.window >= 4 * found.mean_square_displacement / found.by_window[0] / 2
    assert 0.9 < found.mean_square_displacement / found.mean_square_tele < 1.2
    few = walk(tile(0.3, 500), [Grain(dielectric(1.1))], seed=1, tolerance=0.05, hits=100_000)
    assert few.window == 32 and not few.reached and "windows of 32 hits" in few.reason and few.hits > 60_000
    near(few, "mean_square_displacement", found.mean_square_displacement)
    assert few.mean_square_displacement_error > 0.1 * few.mean_square_displacement
    fewer = walk(tile(0.3, 500), [Grain(dielectric(1.02))], seed=1, tolerance=0.05, hits=100_000)
    assert fewer.achieved_error == np.inf and "keeps its direction" in fewer.reason


def test_light_that_is_hardly_turned_is_not_walked():
    """Where no walk is long enough the first one ends it: 64 walks of 512 hits."""
    found = walk(tile(0.3, 500), [Grain(dielectric(1.002))], seed=1, tolerance=0.05)
    assert found.achieved_error == np.inf and "keeps its direction" in found.reason and found.hits == 32 * 2 * 512


# ---- light without an end

def test_grains_of_the_hosts_index_have_no_mean_square_displacement():
    found = walk(tile(0.3, 500), [Grain(dielectric(1.0)), Grain(dielectric(1.0), CUBE)], seed=1, tolerance=0.01)
    assert found.mean_square_displacement == found.errors["mean_square_displacement"] == np.inf and not found.reached
    assert "index" in found.reason and abs(found.g - 1) < 1e-12
    assert found.mean_square_rte == np.inf
    near(found, "void_chord", found.void_chord_exact)


def test_a_tile_of_one_sphere_lets_light_through_for_ever():
    """The mean flight is exact all the same."""
    found = walk(ONE, [Grain(GLASS)], seed=1, tolerance=0.01)
    assert found.mean_square_displacement == np.inf and not found.reached and "planes (0, 0, 1)" in found.reason
    near(found, "void_chord", found.void_chord_exact)


def test_open_planes_are_found():
    """Face-centred cubic: layers (0, 0, 1) are half an edge apart, layers (1, 1, 1) an edge over the root of 3, others less."""
    centers = np.array([[0.0, 0, 0], [0, 1.5, 1.5], [1.5, 0, 1.5], [1.5, 1.5, 0]])
    for radius, planes in ((0.74, (0, 0, 1)), (0.76, (1, -1, -1)), (0.86, (1, -1, -1)), (0.87, None), (1.06, None)):
        assert packed.open_planes(centers, np.full(4, radius), np.full(3, 3.0)) == planes
        shifted = np.mod(centers + [0.1, 2.3, 1.7], 3.0)
        assert packed.open_planes(shifted, np.full(4, radius), np.full(3, 3.0)) == planes


# ---- literal twins

def nearest_sphere(centers, radii, cell, o, d, left, reach=2):
    """Sphere, copy, distance and entry point of the first sphere on a ray, over all images within some copies of the tile."""
    best = np.inf, None
    base = np.floor(o / cell).astype(int)
    for shift in itertools.product(range(-reach, reach + 1), repeat=3):
        copy = base + shift
        for s, (center, radius) in enumerate(zip(centers, radii)):
            if (s, *copy) == left:
                continue
            to = center + copy * cell - o
            along = to @ d
            inside = radius**2 - (to - along * d) @ (to - along * d)
            if along > 0 and inside > 0 and along - np.sqrt(inside) < best[0]:
                best = along - np.sqrt(inside), (s, *copy)
    return best


@pytest.mark.parametrize("which", ["one", slow("few"), "sizes"])
def test_flights_are_those_of_a_search_over_all_images(which):
    centers, radii, cell = {"one": ONE, "few": tile(0.45, 12), "sizes": tile(0.5, 20, 3)}[which]
    centers, radii, cell = np.asarray(centers, float), np.asarray(radii, float), np.asarray(cell, float)
    m = np.array([2, 3, 1])
    grid = (cell, m, *tile_grid(centers, radii, cell, m))
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(40):
        s, copy = rng.integers(len(radii)), rng.integers(-5, 5, 3)
        n, d = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        d = d if d @ n > 0 else -d
        o, left = centers[s] + radii[s] * n, np.array([s, *copy])
        met, to = np.full(4, -1), np.zeros(3)
        z = kernel.flight_to_sphere(o, d, left, grid, 1e9, met, to)
        distance, image = nearest_sphere(centers, radii, cell, o + copy * cell, d, tuple(left))
        if distance < cell.min():  # farther on the search is not complete
            found += 1
            assert abs(z - distance) < 1e-12 and tuple(met) == image
            assert np.allclose(to, centers[met[0]] + (met[1:] - copy) * cell - o, atol=1e-12)
    assert found > 10


def test_a_walk_between_mirrors_is_that_of_a_literal_twin():
    """Six hits between mirror balls from the same start: nothing is drawn, so sums agree to rounding, blown up by the balls."""
    centers, radii, cell = tile(0.45, 12)
    scene = packed._checked((centers, radii, cell), [Grain(MIRROR)], None, 7, 0.1, 100)
    length = 6
    sums = kernel.walks(*scene.arrays, np.uint64(3), 11, 1, length, 0)
    periodic, _, key = scene.arrays
    draws = kernel.Draws(np.zeros(5, np.uint64), np.empty(4))
    draws.stream[:4] = *key, 11, 3
    met, n, d = np.empty(4, np.int64), np.empty(3), np.empty(3)
    kernel._enter(periodic.area, met, n, d, draws)
    here, start = tuple(met - [0, *met[1:]]), met[1:].copy()
    d, total, squares, cosines, place = d - 2 * (d @ n) * n, 0.0, 0.0, 0.0, [np.zeros(3)]
    for _ in range(length):
        o = centers[here[0]] + np.array(here[1:]) * cell + radii[here[0]] * n
        z, here = nearest_sphere(centers, radii, cell, o, d, here)
        n = (o + z * d - centers[here[0]] - np.array(here[1:]) * cell) / radii[here[0]]
        out = d - 2 * (d @ n) * n
        total, squares, cosines = total + z, squares + z * z, cosines + d @ out
        place.append(place[-1] + z * d)
        d = out
    assert abs(start).max() > 1000  # walks start far apart
    assert sums[kernel.HITS] == sums[kernel.ENTRIES] == sums[kernel.EVENTS] == length
    assert np.allclose(sums[[kernel.FLIGHT, kernel.FLIGHT2, kernel.COSINE]], [total, squares, cosines], rtol=1e-8)
    steps = np.diff(place, axis=0)
    assert np.isclose(sums[kernel.SUMS], np.mean(np.sum(steps**2, axis=1)), rtol=1e-8)


def test_a_grain_is_met_as_its_hash_turns_it():
    """A mirror cube turned in the world against the kernel's ray turned into the cube's frame; which of two types it is, too."""
    seed, weights = 9, [1.0, 2.0]
    scene = packed._checked(ONE, [Grain(GLASS), Grain(MIRROR, CUBE)], weights, seed, 0.1, 100)
    room, draws, row = kernel.mesh_scratch(), kernel.Draws(np.zeros(5, np.uint64), np.empty(4)), np.zeros(kernel.SUMS)
    rng, seen = np.random.default_rng(1), [0, 0, 0]
    for copy in rng.integers(-(10**12), 10**12, (60, 3)):
        which, q = instances(seed, copy, 0, weights)
        n, d = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        d = d if d @ n < 0 else -d
        ray = np.empty(6)
        state, _ = kernel.meet(np.array([0, *copy]), n, d, scene.arrays[1], draws, room, ray, row)
        if which == 0:
            seen[2] += 1
            assert state == kernel.LEFT
            continue
        turned = np.array(rotation_matrix(*q)).reshape(3, 3)
        world = Mesh(CUBE.vertices @ turned.T, CUBE.faces)
        face, t = world.first_hit((n - 0.01 * d)[None], d[None])
        seen[int(face[0] >= 0)] += 1
        assert (state == kernel.LEFT) == (face[0] >= 0)
        if face[0] < 0:
            assert np.allclose(ray, [*(n - 2 * (n @ d) * d), *d], atol=1e-12)
            continue
        a, b, c = world.vertices[world.faces[face[0]]]
        normal = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
        out, at = d - 2 * (d @ normal) * normal, n + (t[0] - 0.01) * d
        along = at @ out
        assert np.allclose(ray, [*(at + (np.sqrt(along**2 + 1 - at @ at) - along) * out), *out], atol=1e-9)
    assert min(seen) > 5


# ---- light that is lost, and bounds

def test_what_is_lost_is_drawn_again_and_counted():
    """Rough glass; a matt white ring whose surface light may meet three times; a ball that light enters but never leaves."""
    rough = walk(tile(0.3, 500), [Grain(dielectric(1.5, 0.3), CUBE), Grain(dielectric(1.5, 0.5))], seed=1, tolerance=0.03)
    assert rough.reached and 0.1 < rough.lost < 3 and rough.given_up == rough.cut == 0
    near(rough, "void_chord", rough.void_chord_exact)
    u, v = np.meshgrid(*(2 * np.pi * np.arange(n) / n for n in (24, 16)), indexing="ij")
    radius = 0.7 + 0.3 * np.cos(v)
    vertices = np.stack([radius * np.cos(u), radius * np.sin(u), 0.3 * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(24), np.arange(16), indexing="ij")
    a, b, c, d = i * 16 + j, (i + 1) % 24 * 16 + j, (i + 1) % 24 * 16 + (j + 1) % 16, i * 16 + (j + 1) % 16
    ring = Grain(MATT, Mesh(vertices, np.concatenate([np.stack([p.ravel() for p in t], -1) for t in ((a, b, c), (a, c, d))])))
    free, cut = (walk(tile(0.3, 500), [ring], seed=1, tolerance=0.03, depth=depth) for depth in (100_000, 3))
    assert free.cut == 0 and 1e-3 < cut.cut < 2e-2 and cut.events < free.events
    only_reflected = walk(tile(0.3, 500), [Grain(GLASS)], seed=1, tolerance=0.1, depth=1)
    assert abs(only_reflected.lambda_s) < 1e-12 and only_reflected.mean_square < 1e-12 and only_reflected.cut > 5
    trap = walk(tile(0.3, 500), [Grain(dielectric(1.0))], seed=1, tolerance=0.1, depth=1)
    assert trap.given_up == 1 and trap.hits == 0 and not trap.reached


def test_hits_are_bounded():
    told = []
    found = walk(tile(0.63, 500), [Grain(GLASS)], seed=1, tolerance=1e-4, hits=100_000, report=lambda *state: told.append(state))
    assert not found.reached and 60_000 < found.hits <= 100_000 and "error of sqrt(M)" in found.reason
    assert len(told) >= 2 and told[-1][1] == found.achieved_error and 0 < told[-1][0] < 1


def test_any_number_of_threads_gives_the_same_bytes():
    """Also where tasks are pickled on their way, as to other processes; another seed gives others."""
    grains = [Grain(GLASS), Grain(GLASS, CUBE)]

    def sent(function, tasks):
        return [pickle.loads(pickle.dumps(function))(*pickle.loads(pickle.dumps(task))) for task in tasks]

    with ThreadPoolExecutor(2) as threads:
        results = [walk(tile(0.63, 500), grains, seed=seed, tolerance=0.05, map=each) for seed, each in (
            (1, None), (1, lambda function, tasks: list(threads.map(lambda task: function(*task), tasks))), (1, sent), (2, None))]
    bytes_of = [pickle.dumps([getattr(found, name) for name in found.errors] + list(found.errors.values())) for found in results]
    assert bytes_of[0] == bytes_of[1] == bytes_of[2] != bytes_of[3]


@pytest.mark.parametrize("change, said", [
    (dict(radii=[1.5]), "its own image"), (dict(centers=[[0, 0]]), "are needed"), (dict(cell=[4, 4, np.nan]), "finite"),
    (dict(centers=[[0, 0, 0], [1, 1, 1]], radii=[1, 1]), "overlap"), (dict(grains=[]), "at least one"),
    (dict(grains=[GLASS]), "a surface and a mesh"), (dict(grains=[Grain(GLASS, None, 1.5)]), "radius 1.5"),
    (dict(weights=[1, 1]), "2 weights"), (dict(seed=-1), "seed"), (dict(tolerance=0), "tolerance"), (dict(depth=0), "depth")])
def test_what_is_refused(change, said):
    given = dict(zip(("centers", "radii", "cell"), ONE), grains=[Grain(GLASS)], weights=None, seed=0, tolerance=0.1) | change
    with pytest.raises(ValueError, match=said):
        walk((given.pop("centers"), given.pop("radii"), given.pop("cell")), given.pop("grains"), given.pop("weights"), **given)
