"""Balls walked on the exact sphere against closed forms, quadrature over facets, a literal twin and fine meshes.

Statistical tests have fixed seeds and compare within `SIGMAS` standard errors of 32 blocks: a false alarm in 1e-6 a
comparison, 3e-4 for the file (300 comparisons), should random numbers be drawn anew.
"""

import pickle

import numpy as np
import pytest

from bakery.physics.grains import walk
from bakery.physics.grains.balls import BallWalker
from bakery.physics.grains.points import points, scrambled
from bakery.physics.grains.scatterometer import Statistics, measure
from bakery.physics.grains.sphere import Ball, ball
from bakery.physics.grains.surface import conductor, dielectric, diffuse, fresnel, fresnel_conductor
from tests.conftest import slow
from tests.odds import sigmas
from tests.oracles.balls import statistics

SIGMAS = sigmas(32, 1e-6)
KEY = (1, 2)
FIGURES = ("hit_probability", "lambda_delta", "chord", "albedo", "lambda_s", "lambda_o", "mean_square", "g")
EDGES = np.linspace(0, np.pi, 19)


def uniform(count, seed=3):
    return points(*scrambled(np.random.default_rng(seed)), 0, count)


def walked(surface, mu=0.0, radius=1.0, seed=1, **options):
    mu = np.broadcast_to(np.atleast_1d(np.asarray(mu, float)), max(np.size(mu), surface.channels.shape[1])).copy()
    options = {"tolerance": 4e-3, "asked": ("g", "lambda_s"), "edges": EDGES} | options
    return measure(None, surface, mu, seed=seed, tracer=BallWalker(surface, mu, radius), **options)


def score(found, exact, name):
    """Standard errors between two measurements, or from a closed form."""
    value, error = np.ravel(getattr(found, name)), np.ravel(found.errors[name])
    error = np.hypot(error, np.ravel(exact.errors.get(name, 0.0)))
    away = value - np.ravel(getattr(exact, name))
    assert np.all(np.abs(away[error < 1e-12]) < 1e-9), name
    return away[error >= 1e-12] / error[error >= 1e-12]


CASES = [(dielectric(1.5), [0.0, 0.5], 1.0), (dielectric(1.31), [0.0, 0.5], 1.0), (dielectric(2.42), [0.0, 0.5], 1.0),
         (dielectric(0.75), [0.0, 0.5], 1.0), (dielectric(1.0), [0.0, 0.7], 1.0), (conductor(np.inf), 0.0, 1.0),
         (conductor([0.2 + 3.9j, 1.5 + 0.1j]), 0.0, 0.5), (diffuse([0.3, 1.0]), 0.0, 0.8)]


@pytest.mark.slow
@pytest.mark.parametrize("surface, mu, radius", CASES,
                         ids=["1.5", "ice", "diamond", "bubble", "matched", "mirror", "metal", "white"])
def test_smooth_balls_have_their_closed_form(surface, mu, radius):
    exact = ball(surface, mu, EDGES, radius)
    names = FIGURES + (("inner_path",) if surface.kind == 0 else ())
    found = walked(surface, mu, radius)
    assert found.contradicted == 0 and np.all(found.lost == 0)
    assert np.all(np.abs(np.concatenate([score(found, exact, name) for name in names])) < SIGMAS)
    # a tenth of the error of a bin of ten degrees is the closed form's
    assert np.all(np.abs(score(found, exact, "phase")) < SIGMAS)
    runs = [walked(surface, mu, radius, seed, tolerance=1.0) for seed in range(8)]
    scores = np.concatenate([score(run, exact, name) for run in runs for name in ("albedo", "lambda_s", "mean_square", "g")])
    assert scores.size == 0 or np.mean(scores**2) < 2.5  # 31/29 if the errors are true; figures of one run go together


def test_a_path_is_what_its_literal_twin_walks():
    """Plain Python: where the line meets the sphere by its quadratic, Fresnel's and Snell's formulas, the same random numbers."""
    count, radius = 60, 0.9
    paths = BallWalker(dielectric(1.5), np.array([0.5]), radius).trace(uniform(count), 100, 7, KEY)
    longest = 0
    for i in range(count):
        o, d, inside, way, draws = paths.start[i], paths.incoming[i], False, 0.0, 0
        while True:
            middle, depth = -(o @ d), (o @ d) ** 2 - o @ o + radius**2
            if depth < 0 or middle + np.sqrt(depth) < 1e-7:
                break
            t = middle + (1 if inside else -1) * np.sqrt(depth)
            o = o + t * d
            way += t * inside
            n = o / radius * (-1 if inside else 1)
            words = walk.philox(*(np.uint64(word) for word in (100 + i, 0, 7, draws // 4, *KEY)))
            u = (int(words[draws % 4]) + 0.5) / 2**32
            draws += 1
            ratio, cosine = 1.5 if inside else 1 / 1.5, -(d @ n)
            sine = ratio * np.sqrt(1 - cosine**2)
            F = 1.0
            if sine < 1:
                a, b = np.arcsin(sine / ratio), np.arcsin(sine)
                F = 0.5 * ((np.sin(a - b) / np.sin(a + b)) ** 2 + (np.tan(a - b) / np.tan(a + b)) ** 2)
            if u < F:
                d = d + 2 * cosine * n
            else:
                d = ratio * d + (ratio * cosine - np.sqrt(1 - sine**2)) * n
                inside = not inside
            if not inside:
                break
        longest = max(longest, draws)
        assert draws == paths.events[i] and paths.status[i] == (walk.LEFT if draws else walk.MISSED)
        assert np.allclose(d, paths.outgoing[i], atol=1e-9) and way == pytest.approx(paths.inside[i], abs=1e-9)
        assert np.linalg.norm(paths.leave[i]) == pytest.approx(1, abs=1e-12)
        assert np.allclose(np.cross(paths.leave[i] - o, d), 0, atol=1e-9) and (paths.leave[i] - o) @ d > -1e-9
        assert paths.weight[i, 0] == pytest.approx(np.exp(-0.5 * way))
    assert longest > 3


def reflected(alpha, fresnel_of):
    """Albedo and g of what the outside of a rough ball reflects: quadrature over the facets' normals, one reflection.

    <F G1(i) G1(o) (i.m)/(cos i cos m)> over facets with the density D cos m, and over the disc; Smith's G1 of GGX.
    """
    x, w = np.polynomial.legendre.leggauss(48)
    c, w = 0.25 * (x + 1) ** 2, 0.5 * w * (x + 1)  # cosine of incidence t^2
    xi, phi = (np.arange(200) + 0.5) / 200, np.pi * (np.arange(60) + 0.5) / 60
    tan = alpha * np.sqrt(xi / (1 - xi))
    mz = (1 / np.sqrt(1 + tan**2))[:, None]
    mx = tan[:, None] * mz * np.cos(phi)
    albedo = cosine = 0.0
    for z, weight in zip(c, 2 * c * w):
        im = np.sqrt(1 - z * z) * mx + z * mz
        oz = 2 * im * mz - z
        G = 2 / (1 + np.sqrt(1 + alpha**2 * (1 / z**2 - 1)))
        with np.errstate(all="ignore"):
            seen = (im > 0) & (oz > 0)
            G = np.where(seen, G * 2 / (1 + np.sqrt(1 + alpha**2 * (1 / oz**2 - 1))) * im / (z * mz), 0.0)
        light = G * fresnel_of(np.clip(im, 0, 1))
        albedo += weight * light.mean()
        cosine += weight * (light * (1 - 2 * im**2)).mean()  # -(i.o)
    return albedo, cosine / albedo


def table(function):
    """A function of the cosine, through a fine table that is good to 2e-5."""
    x = np.linspace(0, 1, 2001)
    values = [function(c) for c in x]
    return lambda cosine: np.interp(cosine, x, values)


@pytest.mark.parametrize("alpha", [0.1, slow(0.4), 1.0])
@pytest.mark.parametrize("kind", ["mirror", "metal", "glass"])
def test_rough_balls_reflect_as_facets_do(kind, alpha):
    """Glass that absorbs all that enters has one reflection too."""
    surface, of = {"mirror": (conductor(np.inf, alpha), lambda c: 1.0),
                   "metal": (conductor(1.5 + 2j, alpha), table(lambda x: fresnel_conductor(x, 1.5, 2.0))),
                   "glass": (dielectric(1.5, alpha), table(lambda x: fresnel(x, 1.5)[0]))}[kind]
    found = walked(surface, 1e6 if kind == "glass" else 0.0, tolerance=5e-3, asked=("g",))
    albedo, g = reflected(alpha, of)
    assert abs(found.albedo[0] - albedo) < SIGMAS * np.hypot(found.albedo_error[0], 2e-4 * albedo)
    assert abs(found.g[0] - g) < SIGMAS * np.hypot(found.g_error[0], 2e-4)
    assert found.lambda_s[0] == pytest.approx(0, abs=1e-5) and found.mean_square[0] < 1e-5  # it leaves where it came


def test_roughness_vanishes():
    """Off the smooth ball by less than ten times the roughness."""
    for make, index in ((dielectric, 1.5), (conductor, 1.5 + 2j)):
        exact = ball(make(index), edges=EDGES)
        for alpha in (1e-4, 1e-3, 1e-2):
            found = walked(make(index, alpha))
            for name in ("albedo", "lambda_s", "mean_square", "g"):
                away = abs(getattr(found, name) - getattr(exact, name))[0]
                assert away < SIGMAS * found.errors[name][0] + 10 * alpha, (name, alpha)


def test_fine_meshes_tend_to_the_rough_ball():
    """Roughness opens the modes that facets would: now a mesh of 8000 triangles and the sphere agree, inner path too."""
    from scipy.spatial import ConvexHull

    from bakery.physics.grains.bvh import Mesh

    golden = np.pi * (3 - 5**0.5) * np.arange(4000)
    z = 1 - (2 * np.arange(4000) + 1) / 4000
    corners = np.stack([np.sqrt(1 - z * z) * np.cos(golden), np.sqrt(1 - z * z) * np.sin(golden), z], axis=1)
    faces = ConvexHull(corners).simplices
    a, b, c = (corners[faces[:, k]] for k in range(3))
    turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    faces[turned] = faces[turned][:, ::-1]
    surface = dielectric(1.5, 0.3)
    mesh = measure(Mesh(corners, faces), surface, [0.0, 1.0], seed=2, tolerance=4e-3, asked=("g", "lambda_s"), edges=EDGES)
    found = walked(surface, [0.0, 1.0], tolerance=4e-3)
    for name in ("albedo", "lambda_s", "mean_square", "g", "inner_path"):
        facets = 4e-3  # corners on the sphere, faces up to 6e-4 inside, normals up to 2 degrees off
        away = np.abs(getattr(found, name) - getattr(mesh, name))
        assert np.all(away < facets + SIGMAS * np.hypot(found.errors[name], mesh.errors[name])), name


def test_rough_balls_are_reciprocal():
    """The mean way along both directions is the same, absorption or not."""
    for surface, radius in ((dielectric(1.5, 0.4), 1.0), (dielectric(0.75, 0.2), 0.8), (conductor(1.5 + 1j, 0.5), 0.7)):
        found = walked(surface, [0.0, 0.8] if surface.kind == 0 else 0.0, radius, asked=("lambda_s", "lambda_o"))
        away = np.abs(found.lambda_s - found.lambda_o) / np.hypot(found.lambda_s_error, found.lambda_o_error)
        assert np.all(away < SIGMAS)
        assert found.hit_probability == pytest.approx(radius**2, abs=1e-3)


def test_what_a_cut_path_carried_is_on_record():
    impatient = BallWalker(dielectric(2.42), np.zeros(1), events_max=2)
    found = measure(None, dielectric(2.42), seed=4, tolerance=1.0, tracer=impatient)
    assert found.lost[0] > 0.1 and found.albedo[0] + found.lost[0] == pytest.approx(1, abs=1e-12) and found.events <= 2


def test_paths_do_not_depend_on_their_company():
    tracer = BallWalker(dielectric(1.5, 0.3), np.array([0.2]), 0.9)
    rays = uniform(256)
    whole, part = tracer.trace(rays, 0, 5, KEY), pickle.loads(pickle.dumps(tracer)).trace(rays[100:150], 100, 5, KEY)
    for name in ("status", "start", "leave", "incoming", "outgoing", "inside", "weight", "events"):
        assert np.array_equal(getattr(whole, name)[100:150], getattr(part, name))


def test_rays_that_only_touch():
    """Corners of the square of numbers lie on the rim of the disc; nothing is lost or not a number."""
    rays = np.array([[a, b, c, d] for a in (0.0, 0.5, 1 - 2**-32) for b in (0.0, 0.25) for c in (0.0, 1 - 2**-32, 0.5)
                     for d in (0.0, 0.5, 1 - 2**-32)])
    for surface in (dielectric(1.5), dielectric(0.75), dielectric(1.5, 0.5), diffuse(1.0), conductor(np.inf, 0.2)):
        for radius in (1.0, 1e-3):
            paths = BallWalker(surface, np.zeros(1), radius).trace(rays, 0, 0, KEY)
            for name in ("start", "leave", "incoming", "outgoing", "inside", "weight"):
                assert np.all(np.isfinite(getattr(paths, name)))
            for name in ("start", "leave"):
                good = paths.status != walk.ABSORBED
                assert np.allclose(np.linalg.norm(getattr(paths, name)[good], axis=1), 1, atol=1e-9)
            assert radius < 1 or np.all(paths.status != walk.MISSED)


def test_closed_form_where_there_is_one():
    assert isinstance(statistics(dielectric(1.5), [0.0, 1.0]), Ball) and isinstance(statistics(diffuse(0.5), radius=0.5), Ball)
    rough = statistics(conductor([0.2 + 3.9j, 1.5], 0.3), radius=0.8, seed=1, tolerance=0.01)
    assert isinstance(rough, Statistics) and rough.reached and rough.albedo.shape == (2,)
    smaller = statistics(dielectric(1.5), radius=0.8, seed=1, tolerance=0.01)
    assert isinstance(smaller, Statistics) and smaller.hit_probability == pytest.approx(0.64, abs=0.02)
    with pytest.raises(ValueError, match="radius"):
        statistics(dielectric(1.5, 0.3), radius=1.5, seed=1)
