"""The virtual scatterometer against closed forms, identities that hold for every grain, and slow literal twins.

Statistical tests have fixed seeds and compare within `SIGMAS` standard errors of 32 blocks: a false alarm in 1e-6 a
comparison, 3e-4 for the file (300 comparisons, most of them bins), should random numbers be drawn anew.
"""

import itertools
import pickle
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest

from bakery.physics.grains import _rays, points, scatterometer, walk
from bakery.physics.grains.bvh import Mesh
from bakery.physics.grains.scatterometer import CONTRADICTED_MAX, EDGES, LOST_MAX, REPLICATES, measure, ratio
from bakery.physics.grains.sphere import ball
from bakery.physics.grains.surface import at_dielectric, conductor, dielectric, diffuse, facet, fresnel_conductor, shadowing
from tests.conftest import slow
from tests.odds import sigmas

SIGMAS = sigmas(32, 1e-6)
MIRROR = conductor(np.inf)
KEY = (1, 2)


def hull(corners):
    """Triangles of a convex body around the origin, scaled to the unit sphere."""
    from scipy.spatial import ConvexHull

    corners = np.asarray(corners, float)
    corners = corners / np.linalg.norm(corners, axis=1).max()
    faces = ConvexHull(corners).simplices
    a, b, c = (corners[faces[:, k]] for k in range(3))
    turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0
    faces[turned] = faces[turned][:, ::-1]
    return Mesh(corners, faces)


def box(x=1.0, y=1.0, z=1.0):
    return hull(list(itertools.product((-x, x), (-y, y), (-z, z))))


def torus(n=24, m=16, tube=0.3):
    """A ring with a hole: rays leave and enter again."""
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    r = 1 - tube + tube * np.cos(v)
    vertices = np.stack([r * np.cos(u), r * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a, b = i * m + j, (i + 1) % n * m + j
    c, d = (i + 1) % n * m + (j + 1) % m, i * m + (j + 1) % m
    return Mesh(vertices, np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]))


CUBE = box()
TETRAHEDRON = hull([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
OCTAHEDRON = hull(np.concatenate([np.eye(3), -np.eye(3)]))
STONE = hull(np.random.default_rng(5).normal(size=(40, 3)) * [1, 0.8, 0.6])


def near(found, name, exact, spread=0.0):
    """Within `SIGMAS` standard errors, those of the exact figure (a measured one) included."""
    value, error = np.ravel(getattr(found, name)), np.ravel(found.errors[name])
    away = np.abs(value - exact) / np.maximum(np.hypot(error, spread), 1e-12)
    assert np.all(away < SIGMAS), f"{name}: {value} instead of {exact}, {away} standard errors"


def sound(found):
    assert found.contradicted < CONTRADICTED_MAX and np.all(found.lost < LOST_MAX)


def uniform(count, seed=3):
    return points.points(*points.scrambled(np.random.default_rng(seed)), 0, count)


# random numbers

def test_philox_is_the_published_one():
    """Known answers of Random123 (Salmon et al. 2011), kat_vectors, philox4x32 with 10 rounds."""
    word = np.uint64
    cases = {(0,) * 6: (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8),
             (0xFFFFFFFF,) * 6: (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD),
             (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344, 0xA4093822, 0x299F31D0):
                 (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1)}
    for given, expected in cases.items():
        assert tuple(int(x) for x in walk.philox(*(word(x) for x in given))) == expected


def test_sobol_points_are_those_of_scipy_and_stay_balanced_when_scrambled():
    from scipy.stats import qmc

    plain = points.points(points.directions(), np.zeros(4, np.uint64), 0, 1024)
    assert np.allclose(plain, qmc.Sobol(4, scramble=False).random(1024), atol=2.0**-31)
    mixed = uniform(1024)
    assert np.array_equal(points.points(*points.scrambled(np.random.default_rng(3)), 512, 512), mixed[512:])
    for d in range(4):  # one point in each of 1024 equal parts
        assert np.array_equal(np.sort((mixed[:, d] * 1024).astype(int)), np.arange(1024))
    assert not np.allclose(mixed, uniform(1024, seed=4))


# rays

def brute_force(mesh, origin, direction):
    """Distance and face of the nearest hit over all triangles (Moeller & Trumbore), a literal twin."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    best = np.full(len(origin), np.inf)
    face = np.full(len(origin), -1)
    for i, (o, d) in enumerate(zip(origin, direction)):
        p = np.cross(d, c - a)
        det = np.einsum("ij,ij->i", p, b - a)
        s = o - a
        q = np.cross(s, b - a)
        with np.errstate(all="ignore"):
            u, v, t = np.einsum("ij,ij->i", p, s) / det, q @ d / det, np.einsum("ij,ij->i", q, c - a) / det
            t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
        if np.min(t) < np.inf:
            face[i], best[i] = int(np.argmin(t)), np.min(t)
    return face, best


@pytest.mark.parametrize("mesh", [CUBE, TETRAHEDRON, torus(), box(1, 0.01, 0.01), box(1, 1, 1e-3)],
                         ids=["cube", "tetrahedron", "hole", "needle", "plate"])
def test_nearest_hits_are_those_of_brute_force(mesh):
    paths = walk.Walker(mesh, diffuse(0.0), np.zeros(1)).trace(uniform(512), 0, 0, KEY)
    origin = np.concatenate([paths.start - 1e-3 * paths.incoming, 0.3 * paths.start])
    direction = np.concatenate([paths.incoming, np.roll(paths.incoming, 1, axis=0)])
    face, distance = mesh.first_hit(origin, direction)
    expected, far = brute_force(mesh, origin, direction)
    assert np.array_equal(face >= 0, expected >= 0)
    assert np.allclose(distance, far, rtol=1e-11)
    assert np.mean(face == expected) > 0.999  # two at one distance: an edge


def test_no_ray_slips_through_edges_and_corners():
    mesh, rng = STONE, np.random.default_rng(1)
    corner = mesh.vertices[mesh.faces.ravel()]
    edge = mesh.vertices[mesh.faces[:, [0, 1, 2]]] + rng.random((len(mesh.faces), 3, 1)) * (
        mesh.vertices[mesh.faces[:, [1, 2, 0]]] - mesh.vertices[mesh.faces[:, [0, 1, 2]]])
    target = np.concatenate([corner, edge.reshape(-1, 3)] * 40)
    origin = 0.05 * rng.normal(size=target.shape)
    direction = target - origin
    length = np.linalg.norm(direction, axis=1)
    face, distance = mesh.first_hit(origin, direction / length[:, None])
    assert np.all(face >= 0)
    assert np.allclose(distance, length, rtol=1e-12)


@pytest.mark.parametrize("mesh", [STONE, torus(), box(1, 0.01, 0.01)], ids=["stone", "hole", "needle"])
def test_leaps_pass_no_triangle_and_cells_list_all_that_reach_into_them(mesh):
    """Points of the surface lie in cells that list their triangle; the cubes that may be leapt over are empty."""
    grid, rng = mesh.grid, np.random.default_rng(2)
    shares = rng.dirichlet((1, 1, 1), (len(mesh.faces), 50))
    points_ = np.einsum("tpc,tck->tpk", shares, mesh.vertices[mesh.faces])
    x, y, z = np.moveaxis(((points_ - grid.low) * grid.scale).astype(int), -1, 0)
    at = (z * grid.count[1] + y) * grid.count[0] + x
    block = grid.blocks.reshape(-1, _rays.BLOCK)
    names = block[:, _rays.NAMES:_rays.NAMES + 32].copy().view(np.int32)
    more = block[:, _rays.MORE:_rays.MORE + 4].copy().view(np.int32)[:, 0]
    for t in range(len(mesh.faces)):
        for cell in set(at[t].tolist()):
            first = grid.first[cell]
            assert t in names[first:first + 1 + more[first]]
    entry = grid.leaps.reshape(2, 2, 2, *grid.count[::-1])
    full = entry[0, 0, 0] >= _rays.FULL
    assert full.any() and np.all(full.reshape(-1)[at.reshape(-1)])
    longest = 0
    for octant in itertools.product((0, 1), repeat=3):  # z, y, x
        flip = tuple(slice(None, None, 1 if up else -1) for up in octant)
        here, leap = full[flip], (entry[octant] % _rays.FULL)[flip]
        for place in rng.integers(0, here.shape, (200, 3)):
            free = leap[tuple(place)]
            cube = here[tuple(slice(p, p + free) for p in place)].copy()
            cube[0, 0, 0] = False  # its own cell is tested before
            assert free >= 1 and not cube.any()
            longest = max(longest, free)
    assert longest > 1


def test_a_path_does_not_depend_on_those_beside_it():
    surface = dielectric(1.5, 0.2)
    walker, u = walk.Walker(STONE, surface, np.array([0.3])), uniform(1000)
    whole = walker.trace(u, 0, 0, KEY)
    parts = [walker.trace(u[a:b], a, 0, KEY) for a, b in ((0, 1), (1, 20), (20, 1000))]
    for name in ("status", "events", "inside", "weight", "outgoing"):
        assert np.array_equal(getattr(whole, name), np.concatenate([getattr(part, name) for part in parts]))


def test_a_mesh_travels_as_its_triangles():
    twin = pickle.loads(pickle.dumps(CUBE))
    assert twin.volume == CUBE.volume and len(pickle.dumps(CUBE)) < 2000
    assert np.isclose(CUBE.volume, (2 / 3**0.5) ** 3) and np.isclose(CUBE.surface, 8)
    assert twin.first_hit(np.zeros((1, 3)), np.eye(3)[:1])[1][0] == pytest.approx(3**-0.5)


# surfaces

def test_microfacets_are_those_of_mitsuba():
    """The same numbers choose the same facet, direction and weight as in its rough dielectric and rough conductor (float32)."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    context, rng = mi.BSDFContext(mi.TransportMode.Importance), np.random.default_rng(3)
    for alpha in (0.05, 0.5):
        glass = mi.load_dict({"type": "roughdielectric", "distribution": "ggx", "alpha": alpha, "int_ior": 1.5, "ext_ior": 1.0})
        metal = mi.load_dict({"type": "roughconductor", "distribution": "ggx", "alpha": alpha,
                              "eta": {"type": "rgb", "value": 0.2}, "k": {"type": "rgb", "value": 3.9}})
        for _ in range(300):
            wi, u = rng.normal(size=3), rng.random(3).astype(np.float32).astype(float)
            hit = mi.SurfaceInteraction3f()
            hit.wi = mi.Vector3f(*(wi / np.linalg.norm(wi)))
            x, y, z = np.array(hit.wi, float)
            sample, weight = glass.sample(context, hit, u[0], [u[1], u[2]])
            *wo, ours = at_dielectric(x, y, z, 1.5, alpha, *u)
            assert ours == pytest.approx(weight[0], abs=1e-4)
            if ours:
                assert np.allclose(wo, np.array(sample.wo, float), atol=1e-4)
            if z > 0.05:
                sample, weight = metal.sample(context, hit, u[0], [u[1], u[2]])
                m = np.array(facet(x, y, z, alpha, u[1], u[2]))
                cosine = m @ (x, y, z)
                wo = 2 * cosine * m - (x, y, z)
                ours = shadowing(*wo, *m, alpha) * fresnel_conductor(cosine, 0.2, 3.9) if wo[2] > 0 else 0.0
                assert ours == pytest.approx(weight[0], abs=2e-4)


def test_fresnel_of_a_conductor_without_absorption_is_a_dielectric():
    from bakery.physics.grains.surface import fresnel

    for cosine in (1.0, 0.7, 0.1, 1e-6):
        assert fresnel_conductor(cosine, 1.5, 0.0) == pytest.approx(fresnel(cosine, 1.5)[0], abs=1e-13)
    assert fresnel_conductor(1.0, 0.2, 3.9) == pytest.approx((0.8**2 + 3.9**2) / (1.2**2 + 3.9**2), abs=1e-14)
    assert fresnel(0.3, 1.0) == (0.0, 0.3) and fresnel(0.3, 0.5) == (1.0, 0.0)


# spheres in closed form

def test_public_numbers_of_balls():
    glass, kept = ball(dielectric(1.5)), ball(dielectric(1.5), polarised=True)
    assert (glass.hit_probability, glass.lambda_delta, glass.chord) == (1, 0, 4 / 3)
    for name, exact in (("albedo", 1), ("lambda_s", 1.42435480), ("g", 0.65008941), ("mean_square", 2.84887315)):
        assert getattr(glass, name)[0] == pytest.approx(exact, abs=6e-9)
    assert glass.inner_path[0] == pytest.approx(4 / 3 * 1.5**2 * (1 - (1 - 1.5**-2) ** 1.5), abs=1e-12)
    assert kept.lambda_s[0] == pytest.approx(1.430313, abs=6e-7) and kept.g[0] == pytest.approx(0.659787, abs=6e-7)
    for theta, exact in ((30, 0.34608), (60, 0.073795), (120, 0.003403)):
        edges = np.radians([0, theta - 0.05, theta + 0.05, 180])
        assert ball(dielectric(1.5), edges=edges).phase[0, 1] == pytest.approx(exact, rel=3e-4)
    for radius, mirror, white in ((0.8, 0.324166667, 0.169264373), (0.5, 0.645643113, 0.346595467)):
        found = ball(MIRROR, radius=radius)
        assert (found.hit_probability, found.lambda_delta) == pytest.approx((radius**2, 4 / 3 * (1 - radius**2) ** 0.5))
        assert found.lambda_s[0] == pytest.approx(mirror, abs=6e-10)
        assert ball(diffuse(1.0), radius=radius).lambda_s[0] == pytest.approx(white, abs=6e-10)
        assert found.g[0] == pytest.approx(0, abs=1e-12) and np.allclose(found.phase, 1 / (4 * np.pi), rtol=1e-12)
    white = ball(diffuse(1.0), edges=np.radians([0, 89.999, 90.001, 179.99, 180]))
    assert white.phase[0, [1, 3]] == pytest.approx([0.0675475, 0.2122066], abs=6e-7) and white.g[0] == -4 / 9
    matched = ball(dielectric(1.0), [0.0, 0.5])
    assert np.allclose([matched.lambda_s[0], matched.mean_square[0], matched.forward_delta[0]], [4 / 3, 2, 1], atol=1e-12)
    assert matched.albedo[1] == pytest.approx(2 * (1 - 2 / np.e), abs=1e-12)


@pytest.mark.parametrize("index, mu", [(0.75, 0.0), (1.0001, 0.01), (2.42, 1.0)])
def test_dielectric_balls_against_sums_in_high_precision(index, mu):
    import mpmath as mp

    with mp.workdps(20):
        n = mp.mpf(index)

        @cache
        def figures(c):
            sine = mp.sqrt(1 - c * c)
            a = mp.acos(c)
            if sine >= n:
                return mp.matrix([1, -mp.cos(2 * a), 0, 0]) * 2 * c
            b = mp.asin(sine / n)
            cb = mp.cos(b)
            F = (((c - n * cb) / (c + n * cb)) ** 2 + ((n * c - cb) / (n * c + cb)) ** 2) / 2
            A, turn = mp.exp(-2 * mu * cb), mp.pi - 2 * b
            P, Q = (1 - F) ** 2 * A / (1 - F * A), (1 - F) ** 2 * A / (1 - F * A * mp.expj(-turn))
            return mp.matrix([F + P, -F * mp.cos(2 * a) + mp.re(mp.expj(-2 * (a - b)) * Q),
                              P * c + mp.re(mp.expj(mp.pi - a - turn) * Q), 2 * P - 2 * mp.re(mp.expj(-turn) * Q)]) * 2 * c

        knee = mp.sqrt(abs(n * n - 1))
        cuts = [mp.mpf(0), knee, 1] if knee < 0.9 else [mp.mpf(0), 1]
        exact = [mp.quad(lambda t: sum(figures(p + (q - p) * t * t)[k] * 2 * t * (q - p) for p, q in zip(cuts, cuts[1:])), [0, 1])
                 for k in range(4)]
    found = ball(dielectric(index), mu, edges=[0, np.pi])
    light = found.albedo[0]
    ours = light, light * found.g[0], light * found.lambda_s[0], light * found.mean_square[0]
    assert np.allclose(ours, [float(x) for x in exact], rtol=0, atol=1e-11)


def test_phase_functions_of_balls_are_normalised_and_have_their_g():
    solid = 2 * np.pi * -np.diff(np.cos(EDGES))
    middle = 0.5 * (np.cos(EDGES[1:]) + np.cos(EDGES[:-1]))
    for surface in (dielectric(1.33), diffuse(0.5), conductor([0.2 + 3.9j, 1.5 + 0.1j])):
        found = ball(surface, [0.0, 1.0] if surface.kind == 0 else 0.0, EDGES)
        assert np.allclose(found.phase @ solid, 1, atol=1e-6)
        assert np.all(found.errors["phase"] <= 5e-4 * found.phase)
        # what bins of one degree blur
        assert np.allclose((found.phase * solid) @ middle, found.g, atol=3e-5)


# walks against closed forms

def test_public_numbers_of_the_cube():
    found = measure(CUBE, dielectric(1.5), seed=1, tolerance=1.5e-3, asked=("lambda_s", "g", "inner_path"))
    sound(found)
    assert found.reached and found.achieved_error <= 1.5e-3 and found.albedo[0] == 1
    near(found, "hit_probability", 2 / np.pi)
    near(found, "lambda_delta", 0.84897, 8e-5)
    near(found, "lambda_s", 1.38850, 2.2e-4)
    near(found, "lambda_o", 1.38850, 2.2e-4)  # reciprocity
    near(found, "g", 0.43807, 2.6e-4)
    near(found, "mean_square", 3.0468, 6e-4)
    near(found, "inner_path", 1.323169, 1e-6)
    beta = found.hit_probability
    assert (1 - beta) * found.lambda_delta + beta * found.chord == pytest.approx(4 / 3, abs=1e-4)  # of points this even
    mirror = measure(CUBE, MIRROR, seed=2, tolerance=1e-3)
    near(mirror, "lambda_s", 0.47407, 9e-5)
    near(mirror, "g", 0.0)


def test_a_fine_ball_is_opaque_as_the_exact_one():
    """Opaque balls of many facets tend to the exact ones: silhouette, way, lambda_s and phase function of radius 0.8."""
    golden = np.pi * (3 - 5**0.5) * np.arange(4000)
    z = 1 - (2 * np.arange(4000) + 1) / 4000
    r = np.sqrt(1 - z * z)
    fine = hull(np.stack([r * np.cos(golden), r * np.sin(golden), z], axis=1))
    fine = Mesh(0.8 * fine.vertices, fine.faces)
    for surface in (MIRROR, diffuse(1.0), conductor(1.5 + 0.5j)):
        found, exact = measure(fine, surface, seed=3, tolerance=1e-3), ball(surface, radius=0.8)
        for name in ("hit_probability", "lambda_delta", "albedo", "lambda_s", "g", "mean_square"):
            near(found, name, getattr(exact, name), 4e-4)  # facets: S/S_ball = 1 - 1e-3 in area, normals 1 degree off
        good = found.phase_error[0] > 0
        assert np.all(np.abs(found.phase - exact.phase)[0, good] < SIGMAS * np.hypot(found.phase_error[0, good], 0.01))


@pytest.mark.parametrize("mesh", [TETRAHEDRON, OCTAHEDRON, STONE, box(1, 0.3, 0.1)],
                         ids=["tetrahedron", "octahedron", "stone", "slab"])
def test_convex_solids_scatter_alike(mesh):
    """Mirrors isotropically, Lambertian ones as the ball; whatever the shape, hits are S/(4 pi) of the rays."""
    edges = np.linspace(0, np.pi, 19)
    for surface in (MIRROR, diffuse(0.7)):
        found, exact = measure(mesh, surface, seed=4, edges=edges, tolerance=4e-3), ball(surface, edges=edges)
        near(found, "hit_probability", mesh.surface / (4 * np.pi))
        near(found, "g", exact.g)
        near(found, "phase", exact.phase[0])
        assert found.albedo[0] == pytest.approx(0.7 if surface is not MIRROR else 1.0, abs=1e-12)


def test_lossless_glass_without_trapped_modes_has_the_path_of_any_body():
    """Mean path inside index^2 4V/S (octahedron and tetrahedron), reciprocity, and of the hits the chord of the convex body."""
    for mesh in (OCTAHEDRON, TETRAHEDRON):
        found = measure(mesh, dielectric(1.5), seed=5, tolerance=4e-3, asked=("lambda_s", "lambda_o", "inner_path"))
        sound(found)
        near(found, "inner_path", 1.5**2 * 4 * mesh.volume / mesh.surface)
        near(found, "lambda_s", found.lambda_o[0], found.lambda_o_error[0])


def test_straight_lines_measure_the_volume_of_a_body_with_a_hole():
    """Index 1: all light passes straight, the mean length inside is V/(pi R^2) a ray, and leaving and entering is one hit."""
    ring = torus()
    found = measure(ring, dielectric(1.0), [0.0, 2.0], seed=6, tolerance=2e-3, asked=("hit_probability", "inner_path"))
    sound(found)
    assert np.all(found.forward_delta == 1) and found.g[0] == 1 and np.all(found.phase == 1 / (4 * np.pi))
    assert found.lambda_s[0] == pytest.approx(found.chord, abs=1e-12)
    beta, ways = found.hit_probability, found.inner_path[0]
    error = np.hypot(found.hit_probability_error * ways, beta * found.inner_path_error[0])
    assert abs(beta * ways - ring.volume / np.pi) < SIGMAS * error
    assert found.events > 2.1 and beta < ring.surface / (4 * np.pi)
    assert np.exp(-2 * found.inner_path[0]) < found.albedo[1] < 1  # Jensen


def test_light_dims_by_beer_and_lambert_on_every_path():
    """Index 1 in a convex body: chords by cutting the line with the half spaces of the faces."""
    paths = walk.Walker(STONE, dielectric(1.0), np.array([0.0, 3.0])).trace(uniform(4096), 0, 0, KEY)
    a, b, c = (STONE.vertices[STONE.faces[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    speed, gap = paths.incoming @ n.T, np.einsum("ij,ij->i", a, n) - paths.start @ n.T
    t = gap / speed
    first, last = np.where(speed < 0, t, -np.inf).max(1), np.where(speed > 0, t, np.inf).min(1)
    chord = np.maximum(last - first, 0)
    met = paths.status == walk.LEFT
    assert np.array_equal(met, chord > 0) and 0.3 < met.mean() < 0.9
    assert np.allclose(paths.inside[met], chord[met], atol=1e-12)
    assert np.allclose(paths.weight[met], np.exp(-np.outer(chord[met], [0, 3])), rtol=1e-11)


def test_a_path_is_what_its_literal_twin_walks():
    """Plain Python, all triangles in turn, Fresnel's and Snell's formulas in vectors, the same random numbers."""
    ring, count = torus(10, 8), 60
    paths = walk.Walker(ring, dielectric(1.5), np.array([0.5])).trace(uniform(count), 100, 7, KEY)
    corners = ring.vertices[ring.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    longest = 0
    for i in range(count):
        o, d, inside, way, draws = paths.start[i] - 0.01 * paths.incoming[i], paths.incoming[i], False, 0.0, 0
        while True:
            (face,), (t,) = brute_force(ring, o[None], d[None])
            if face < 0:
                break
            o, n = o + t * d, normals[face] * (-1 if inside else 1)
            way += t * inside
            words = walk.philox(*(np.uint64(word) for word in (100 + i, 0, 7, draws // 4, *KEY)))
            u = (int(words[draws % 4]) + 0.5) / 2**32
            draws += 1
            ratio_ = 1.5 if inside else 1 / 1.5
            cosine = -(d @ n)
            sine = ratio_ * np.sqrt(1 - cosine**2)
            F = 1.0
            if sine < 1:
                a, b = np.arcsin(sine / ratio_), np.arcsin(sine)
                F = 0.5 * ((np.sin(a - b) / np.sin(a + b)) ** 2 + (np.tan(a - b) / np.tan(a + b)) ** 2)
            if u < F:
                d = d + 2 * cosine * n
            else:
                d = ratio_ * d + (ratio_ * cosine - np.sqrt(1 - sine**2)) * n
                inside = not inside
            o = o + 1e-9 * d
        longest = max(longest, draws)
        assert draws == paths.events[i] and paths.status[i] == (walk.LEFT if draws else walk.MISSED)
        assert np.allclose(d, paths.outgoing[i], atol=1e-6) and way == pytest.approx(paths.inside[i], abs=1e-6)
        assert np.linalg.norm(paths.leave[i]) == pytest.approx(1) and np.allclose(np.cross(paths.leave[i] - o, d), 0, atol=1e-6)
    assert longest > 5


# errors, roulette, extremes

def test_claimed_errors_are_true_ones(monkeypatch):
    """z-scores of exact figures over 40 seeds: mean square 1.07 (31 degrees of freedom) within 5 standard deviations."""
    monkeypatch.setattr(scatterometer, "_FIRST", 64)  # few paths of a replicate: what errors are made of are the replicates
    monkeypatch.setattr(scatterometer, "HITS_MIN", 0)
    scores = []
    for seed in range(40):
        found = measure(CUBE, dielectric(1.5), seed=seed, tolerance=1.0, asked=("g",))
        for name, exact in (("hit_probability", 2 / np.pi), ("inner_path", 1.323169)):
            scores.append(float(np.squeeze((getattr(found, name) - exact) / found.errors[name])))
        found = measure(TETRAHEDRON, MIRROR, seed=seed, tolerance=1.0, asked=("g",))
        scores.append(float(found.g[0] / found.g_error[0]))
    square = np.mean(np.square(scores))
    assert abs(square - 31 / 29) < 5 * np.sqrt(2.3 / len(scores)), square
    assert np.max(np.abs(scores)) < SIGMAS


def test_ratio_of_sums_and_its_error():
    rng = np.random.default_rng(1)
    d = 100 + rng.normal(size=(REPLICATES, 3))
    n = 2 * d
    assert np.allclose(ratio(n, d)[0], 2) and np.all(ratio(n, d)[1] < 1e-13)
    many = rng.normal(5, 1, (REPLICATES, 4000))
    value, error = ratio(many, np.ones((REPLICATES, 4000)))
    assert np.mean(error) == pytest.approx(1 / REPLICATES**0.5, rel=0.02)
    assert np.std(value) == pytest.approx(np.mean(error), rel=0.08)
    assert ratio(np.zeros((4, 1)), np.zeros((4, 1)))[0] == 0


def test_roulette_changes_no_mean():
    """With an absorption-free channel beside it no path ends by chance; alone, faint ones do."""
    patient = measure(CUBE, dielectric(1.5), [0.0, 4.0], seed=8, tolerance=6e-3, asked=("albedo", "g"))
    gambling = measure(CUBE, dielectric(1.5), 4.0, seed=9, tolerance=6e-3, asked=("albedo", "g"))
    assert gambling.events < 0.9 * patient.events
    for name in ("albedo", "g", "lambda_s", "mean_square"):
        near(gambling, name, getattr(patient, name)[1], patient.errors[name][1])


@pytest.mark.parametrize("index", [slow(1.31), 2.42])
@pytest.mark.parametrize("mesh", [box(1, 0.01, 0.01), box(1, 1, 0.01), torus(), TETRAHEDRON],
                         ids=["needle", "plate", "hole", "four triangles"])
def test_extreme_grains_lose_no_light(mesh, index):
    found = measure(mesh, dielectric(index), [0.0, 1e6], seed=10, tolerance=0.04)
    sound(found)
    assert abs(found.albedo[0] - 1) < 1e-6
    assert 0 < found.albedo[1] < 0.6  # opaque: what the outside reflects
    assert np.all(np.isfinite(found.phase)) and np.all(found.phase_error >= 0)
    solid = 2 * np.pi * -np.diff(np.cos(EDGES))
    assert np.allclose(found.phase @ solid, 1, atol=1e-12)


@pytest.mark.soak
def test_two_million_triangles():
    golden = np.pi * (3 - 5**0.5) * np.arange(1_000_000)
    z = 1 - (2 * np.arange(1_000_000) + 1) / 1_000_000
    r = np.sqrt(1 - z * z)
    fine = hull(np.stack([r * np.cos(golden), r * np.sin(golden), z], axis=1))
    assert len(fine.faces) > 1_990_000
    found = measure(fine, dielectric(1.5), seed=11)
    sound(found)
    near(found, "g", ball(dielectric(1.5)).g, 2e-3)


def test_what_a_cut_path_carried_is_on_record():
    impatient = walk.Walker(CUBE, dielectric(1.5), np.zeros(1), events_max=3)
    found = measure(CUBE, dielectric(1.5), seed=12, tolerance=1.0, tracer=impatient)
    assert found.lost[0] > 0.01 and found.albedo[0] + found.lost[0] == pytest.approx(1, abs=1e-12)


def test_a_mesh_that_is_not_closed_shows():
    """A seeded defect: one triangle of the octahedron is missing."""
    found = measure(Mesh(OCTAHEDRON.vertices, OCTAHEDRON.faces[:-1]), dielectric(1.5), seed=13, tolerance=1.0)
    assert found.contradicted > 100 * CONTRADICTED_MAX


def test_rough_surfaces():
    """No roughness is the limit of little; a rough grain loses light to second facets (single scattering) and never gains any."""
    smooth = measure(CUBE, dielectric(1.5), seed=14, tolerance=5e-3)
    fine = measure(CUBE, dielectric(1.5, 1e-4), seed=15, tolerance=5e-3)
    for name in ("lambda_s", "g", "mean_square"):
        near(fine, name, getattr(smooth, name), smooth.errors[name])
    assert fine.albedo[0] > 0.998
    shares = [measure(CUBE, dielectric(1.5, roughness), seed=16, tolerance=5e-3).albedo[0] for roughness in (0.05, 0.2, 0.5)]
    assert 1 > shares[0] > shares[1] > shares[2] > 0.3
    assert measure(CUBE, dielectric(1.0, 0.5), seed=17, tolerance=1.0).forward_delta[0] == 1
    polished, matt = (measure(STONE, conductor(0.2 + 3.9j, r), seed=18, tolerance=5e-3) for r in (0.0, 0.2))
    exact = ball(conductor(0.2 + 3.9j))
    near(polished, "albedo", exact.albedo)
    near(polished, "g", exact.g)
    assert 0.9 * exact.albedo[0] < matt.albedo[0] < exact.albedo[0]


# what callers see

def test_the_same_bytes_from_any_number_of_threads():
    def backwards(function, tasks):
        with ThreadPoolExecutor(3) as pool:
            futures = [pool.submit(function, *task) for task in reversed(tasks)]
            return [future.result() for future in reversed(futures)]

    seen = []
    once, twice = (measure(STONE, dielectric(1.5), [0.0, 1.0], seed=19, tolerance=0.01, map=map_,
                           report=lambda *a: seen.append(a)) for map_ in (None, backwards))
    for name in once.errors:
        assert np.array_equal(getattr(once, name), getattr(twice, name)) and np.array_equal(once.errors[name], twice.errors[name])
    assert seen[-1][0] == 1.0 and seen[-1][1] == once.achieved_error
    other = measure(STONE, dielectric(1.5), [0.0, 1.0], seed=19, stream=1, tolerance=0.01)
    assert not np.array_equal(other.g, once.g)


def test_out_of_reach_is_said():
    found = measure(CUBE, diffuse(0.5), seed=20, tolerance=1e-5, paths_max=1 << 15)
    assert not found.reached and found.achieved_error > 1e-5


@pytest.mark.parametrize("call, word", [
    (lambda: dielectric(7.0), "index 7"), (lambda: dielectric(1.5, 2.0), "roughness 2"),
    (lambda: diffuse([0.5, 1.2]), "reflectance"), (lambda: conductor(-1.0), "n, k >= 0"),
    (lambda: ball(dielectric(1.5), radius=0.5), "radius 0.5"), (lambda: ball(dielectric(1.5, 0.1)), "rough ball"),
    (lambda: ball(diffuse(1.0), radius=2.0), "radius 2"), (lambda: Mesh(CUBE.vertices * 1.1, CUBE.faces), "outside of the"),
    (lambda: Mesh(CUBE.vertices, CUBE.faces[:, ::-1]), "counterclockwise"),
    (lambda: Mesh(CUBE.vertices, CUBE.faces + 1), "there are only 8"),
    (lambda: Mesh(CUBE.vertices, CUBE.faces[:3]), "at least 4"), (lambda: Mesh(CUBE.vertices * np.nan, CUBE.faces), "finite"),
    (lambda: measure(CUBE, MIRROR, -1.0, seed=1), "mu"), (lambda: measure(CUBE, MIRROR, seed=1, tolerance=0.0), "tolerance 0"),
    (lambda: measure(CUBE, MIRROR, seed=1, asked=("x",)), "'x'"),
    (lambda: measure(CUBE, MIRROR, seed=1, edges=[0, 1]), "0 to pi"),
    (lambda: measure(CUBE, diffuse([1, 0.5]), [1.0, 2, 3], seed=1), "3 abs")])
def test_what_cannot_be_measured_is_refused(call, word):
    with pytest.raises(ValueError, match=word):
        call()
