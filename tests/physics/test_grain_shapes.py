"""Exemplar grains: meshes against closed forms, integral geometry and other people's programs; files good and bad."""

import sys
import tracemalloc
from itertools import combinations
from math import gamma, pi
from types import SimpleNamespace

import manifold3d
import numpy as np
import pymeshlab
import pytest
import trimesh

from bakery.errors import UsageError
from bakery.physics.grains import bvh, scatterometer
from bakery.physics.grains.surface import dielectric
from bakery.physics.shapes import build as shapes
from bakery.physics.shapes import files, implicit, limits, mending, quality, radial, repair, rods
from bakery.physics.shapes.bounding import minimum_sphere, onto_unit_sphere
from bakery.physics.shapes.implicit import marched, surface
from bakery.physics.shapes.noise import directions, fractal_noise, gradient_noise, stream
from bakery.physics.shapes.quality import tree
from bakery.physics.shapes.simplify import simplified
from tests.conftest import slow
from tests.grain_examples import EXAMPLES
from tests.odds import sigmas

SIGMAS = sigmas(32)  # some 40 comparisons of figures of 32 blocks: 4e-6 a suite


def closed(vertices, faces):
    """Each directed edge once, with its opposite: manifold3d takes nothing else."""
    mesh = manifold3d.Mesh64(np.array(vertices, float, order="C"), np.array(faces, np.uint64, order="C"))
    return manifold3d.Manifold(mesh).status() == manifold3d.Error.NoError


def figures_of(vertices, faces):
    """What trimesh measures: genus is that of all bodies together, `sharpest` the smallest angle of a triangle."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return SimpleNamespace(volume=mesh.volume, area=mesh.area, bodies=mesh.body_count, sharpest=mesh.face_angles.min(),
                           genus=mesh.body_count - mesh.euler_number // 2)


def measure(vertices, faces):
    """Straight lines through a mesh, as light goes where the index is 1; `unbalanced`: share that leaves without entering."""
    light = scatterometer.measure(bvh.Mesh(vertices, faces), dielectric(1.0), seed=1, tolerance=0.5, paths_max=1 << 18)
    beta, inner = light.hit_probability, light.inner_path[0]
    return SimpleNamespace(
        hit_probability=beta, hit_probability_error=light.hit_probability_error, unbalanced=light.contradicted,
        lambda_delta=light.lambda_delta, lambda_delta_error=light.lambda_delta_error, inner_length=beta * inner,
        inner_length_error=np.hypot(light.hit_probability_error * inner, beta * light.inner_path_error[0]))


def parts(grain):
    return np.array(grain.vertices), np.array(grain.faces)


@pytest.fixture(scope="module")
def rock():
    return shapes.rock(seed=1, triangles=1280)


# ---- bounding sphere


def brute_force(points):
    """Radius of the smallest sphere: the best of all spheres through two, three or four points."""
    best = np.inf
    for size in (2, 3, 4):
        for chosen in combinations(points, size):
            edge = np.array(chosen[1:]) - chosen[0]
            half, rank = 0.5 * (edge**2).sum(axis=1), np.linalg.matrix_rank(edge)
            if rank == size - 1:
                centre = chosen[0] + np.linalg.pinv(edge) @ half
                best = min(best, np.sqrt(((points - centre) ** 2).sum(axis=1).max()))
    return best


@pytest.mark.parametrize("kind", ["random", "flat", "line", "grid", "sphere", "nearly flat"])
def test_minimum_sphere_against_brute_force(kind):
    rng = np.random.default_rng(5)
    for number in (2, 3, 4, 5, 9):
        points = rng.normal(size=(number, 3))
        points = {"random": points, "flat": points * [1, 1, 0], "line": points[:, :1] * [1.0, 2, 3], "grid": np.round(points),
                  "sphere": radial.unit(points), "nearly flat": points * [1, 1, 1e-9]}[kind]
        if np.ptp(points, axis=0).max() == 0:
            continue
        # pinv leaves 1e-10 where points are nearly dependent
        assert minimum_sphere(points)[1] == pytest.approx(brute_force(points), rel=1e-9 if kind == "nearly flat" else 1e-12)


def test_minimum_sphere_known():
    cube = np.array(list(np.ndindex(2, 2, 2)), float) * 2 + 5
    centre, radius = minimum_sphere(np.concatenate([cube, cube]))
    assert np.allclose(centre, 6, atol=1e-14) and radius == pytest.approx(3**0.5, rel=1e-15)
    assert minimum_sphere([[1.0, 2, 3]])[1] == 0
    ball = radial.icosphere(20_000)[0]
    assert minimum_sphere(1e6 * ball + 7)[1] == pytest.approx(1e6, rel=1e-12)


def test_sphere_of_a_scaled_mesh_is_the_unit_sphere():
    for scale in (1e-9, 1.0, 1e12):
        scaled, centre, radius = onto_unit_sphere(np.random.default_rng(1).normal(size=(5000, 3)) * scale + 3 * scale)
        norm = np.sqrt((scaled**2).sum(axis=1))
        assert norm.max() <= 1 and norm.max() > 1 - 1e-12
        back, size = minimum_sphere(scaled)
        assert abs(size - 1) < 1e-12 and np.abs(back).max() < 1e-12


# ---- shapes


@pytest.mark.parametrize("triangles", [20, 80, 1280, 5000])
def test_icosphere(triangles):
    vertices, faces = radial.icosphere(triangles)
    n = round((triangles / 20) ** 0.5)
    assert len(faces) == 20 * n**2 and len(vertices) == 10 * n**2 + 2 and closed(vertices, faces)
    assert len(np.unique(np.round(vertices, 9), axis=0)) == len(vertices)
    figures = figures_of(vertices, faces)
    assert figures.genus == 0 and figures.sharpest > 0.6
    # inscribed: what is lacking falls with the number of triangles
    assert 7 < (1 - figures.volume / (4 / 3 * pi)) * len(faces) < 11.2


def test_box_is_exact():
    grain = shapes.box((3, 2, 1))
    scale = (0.25 * 14) ** 0.5
    assert grain.volume == pytest.approx(6 / scale**3, rel=1e-14) and grain.area == pytest.approx(22 / scale**2, rel=1e-14)
    assert closed(*parts(grain)) and len(grain.faces) == 12


def test_ellipsoid_volume_and_area():
    a, c = 1.0, 0.5
    e = (1 - (c / a) ** 2) ** 0.5
    area = 2 * pi * a**2 * (1 + (1 - e**2) / e * np.arctanh(e))  # oblate
    errors = []
    for triangles in (1280, 5120, 20480):
        grain = shapes.ellipsoid((a, a, c), triangles)
        errors.append((grain.volume / (4 / 3 * pi * a * a * c) - 1, grain.area / area - 1))
    errors = np.abs(errors)
    assert errors[0].max() < 0.011 and (errors[:-1] / errors[1:] > 3.8).all()  # second order in the edge


@pytest.mark.parametrize("exponents", [(1.0, 1.0), (0.3, 0.3), (0.5, 1.5), (2.0, 2.0), (3.0, 1.0), (0.1, 0.1)])
def test_superellipsoid_volume(exponents):
    def beta(x, y):
        return gamma(x) * gamma(y) / gamma(x + y)

    e, f = exponents
    axes = np.array([1.0, 0.7, 0.5])
    exact = 2 * axes.prod() * e * f * beta(e / 2 + 1, e) * beta(f / 2, f / 2)  # Barr 1981
    grain = shapes.superellipsoid(axes, exponents, 81_920)
    vertices, _ = parts(grain)
    # the scale: the surface in the direction of the first axis, where there is a vertex within a degree, or the corner of a box
    x, y, z = np.abs(vertices / axes).T
    size = ((x ** (2 / f) + y ** (2 / f)) ** (f / e) + z ** (2 / e)) ** (e / 2)
    assert np.ptp(size) < 1e-9 * size.max()
    assert grain.volume / size.mean() ** 3 == pytest.approx(exact, rel=4e-3)
    assert closed(*parts(grain))


@pytest.mark.parametrize("name", [slow(name) if name in ("glass beads", "snow") else name for name in EXAMPLES])
def test_examples_are_sound(name):
    grain = shapes.build(EXAMPLES[name], 1300)
    vertices, faces = parts(grain)
    figures = figures_of(vertices, faces)
    assert closed(vertices, faces) and figures.bodies == 1 and figures.volume > 0.2 and figures.sharpest > 0.005
    assert 1200 <= len(faces) <= 1310
    assert abs(minimum_sphere(vertices)[1] - 1) < 1e-12 and (vertices**2).sum(axis=1).max() <= 1
    box = tree(vertices, faces)
    assert len(quality.self_crossings(box)) == 0
    lines = measure(vertices, faces)
    assert lines.unbalanced == 0
    assert abs(lines.inner_length - figures.volume / pi) < SIGMAS * lines.inner_length_error
    assert lines.hit_probability - SIGMAS * lines.hit_probability_error < figures.area / (4 * pi)
    assert mending.mended(vertices, faces)[2] == ()


@pytest.mark.slow
@pytest.mark.parametrize("shape", [
    {"type": "rock", "axes": (1, 0.01, 0.01)}, {"type": "rock", "corners": 8, "axes": (1, 1, 0.02), "sharpness": np.inf},
    {"type": "rock", "roughness": 0.3}, {"type": "crystal", "habit": "octahedron"}, {"type": "crystal", "axes": (100, 1, 1)},
    {"type": "crystal", "habit": "prism", "axes": (1, 1, 0.1), "sharpness": np.inf, "roughness": 0},
    {"type": "crystal", "habit": "sucrose", "chips": 30, "depth": 0.6}, {"type": "superellipsoid", "exponents": 0.1},
    {"type": "superellipsoid", "exponents": (0.1, 4)}, {"type": "ellipsoid", "axes": (1e4, 1, 1)},
    {"type": "box", "size": (1e4, 1, 1e4)}, {"type": "aggregate", "bodies": 64, "smallest": 0.3},
    slow({"type": "aggregate", "arrangement": "star", "bodies": 12, "smallest": 0.3, "length": 8}),
])
def test_extremes_are_sound(shape):
    grain = shapes.build(shape, 2000)
    assert closed(*parts(grain)) and grain.volume > 0 and abs(minimum_sphere(grain.vertices)[1] - 1) < 1e-12
    box = tree(*parts(grain))
    assert len(quality.self_crossings(box)) == 0
    lines = measure(*parts(grain))
    assert lines.unbalanced == 0 and abs(lines.inner_length - grain.volume / pi) < SIGMAS * lines.inner_length_error + 1e-12


@pytest.mark.parametrize("name", ["sand", "snow"])
def test_same_numbers_same_bytes(name):
    first, second = (shapes.build(EXAMPLES[name], 500) for _ in range(2))
    other = shapes.build({**EXAMPLES[name], "seed": 99}, 500)
    assert first.vertices.tobytes() == second.vertices.tobytes() and first.faces.tobytes() == second.faces.tobytes()
    assert first.vertices.tobytes() != other.vertices.tobytes()


@pytest.mark.slow
def test_levels_of_detail_agree():
    for name in ("sand", "salt", "flour"):
        coarse, middle = (shapes.build(EXAMPLES[name], shapes.LEVELS[level]) for level in ("coarse", "middle"))
        assert coarse.volume == pytest.approx(middle.volume, rel=0.02) and coarse.area == pytest.approx(middle.area, rel=0.035)
    middle, fine = (shapes.build(EXAMPLES["salt"], shapes.LEVELS[level]) for level in ("middle", "fine"))
    assert middle.volume == pytest.approx(fine.volume, rel=0.002) and middle.area == pytest.approx(fine.area, rel=0.005)


def test_a_sphere_says_that_it_is_one():
    ball = shapes.build({"type": "sphere"}, 320)
    assert ball.analytic == "sphere" and ball.volume == 4 / 3 * pi and ball.area == 4 * pi
    assert quality.volume(ball.vertices, ball.faces) < 0.97 * ball.volume
    assert shapes.build({"type": "ellipsoid"}, 320).analytic is None


@pytest.mark.parametrize("shape, words", [
    ({"type": "cylinder"}, "shapes are sphere, box"),
    ({"type": "box", "axes": [1, 1, 1]}, "a box has no 'axes'; it takes size"),
    ({"type": "box", "size": [1, 0, 1]}, "three numbers above 0"),
    ({"type": "ellipsoid", "axes": [1, 1e-5, 1]}, "factor of 10,000"),
    ({"type": "ellipsoid", "axes": [1, np.nan, 1]}, "three numbers"),
    ({"type": "superellipsoid", "exponents": 9}, "0.1 to 4"),
    ({"type": "rock", "roughness": 2}, "roughness is 0 to 0.3"),
    ({"type": "rock", "corners": 3}, "from 8 to 300"),
    ({"type": "rock", "sharpness": 1}, "4 or more"),
    ({"type": "crystal", "habit": "quasi"}, "habits are cube"),
    ({"type": "aggregate", "bodies": 0}, "from 1 to 64"),
    ({"type": "aggregate", "bodies": 20, "smallest": 0.05, "length": 10, "arrangement": "star", "blend": 0}, "blend is 0.01"),
    ({"type": "mesh", "kind": "ply"}, "content of a file"),
])
def test_wrong_shapes(shape, words):
    with pytest.raises(ValueError, match=words):
        shapes.build(shape, 500)


def test_an_aggregate_that_is_none(monkeypatch):
    """Two balls that do not touch; and one too small for any grid."""
    apart = np.array([[0.0, 0, 0], [3, 0, 0]]), np.zeros((2, 3)), np.array([1.0, 1.0])
    monkeypatch.setattr(rods, "_placed", lambda *_: apart)
    with pytest.raises(ValueError, match="falls into 2 pieces"):
        shapes.aggregate(triangles=500)
    monkeypatch.setattr(rods, "_placed", lambda *_: (*apart[:2], np.array([1.0, 0.001])))
    with pytest.raises(ValueError, match="too small to be resolved"):
        shapes.aggregate(triangles=500)


@pytest.mark.slow
@pytest.mark.parametrize("shape, wanted", [
    ({"bodies": 6, "smallest": 0.6}, 1300), ({"bodies": 6, "smallest": 0.1, "length": 3}, 1300), ({"bodies": 64}, 20_000),
    ({"bodies": 12, "arrangement": "star", "length": 5, "smallest": 0.3}, 5000),
])
def test_the_work_of_an_aggregate_is_known_before(shape, wanted, monkeypatch):
    """Triangles that are marched, within a factor of 1.8: what a plan's time goes by."""
    tries = []

    def counted(*arguments):
        vertices, faces = marched(*arguments)
        tries.append(len(faces))
        return vertices, faces

    monkeypatch.setattr(implicit, "marched", counted)
    shape = {"seed": 1, "arrangement": "cluster", "length": 0.0, "overlap": 0.35, "smallest": 0.6, "blend": 0.05} | shape
    grown = rods.grown(**shape)
    surface(grown.distance, *grown.box, wanted, grown.detail)
    assert grown.triangles(wanted) == (pytest.approx(sum(tries), rel=0.8), pytest.approx(tries[-1], rel=0.8))
    assert sum(tries) < 1.8 * grown.triangles(wanted)[0]


def test_wrong_number_of_triangles():
    with pytest.raises(ValueError, match="from 20 to 2,000,000"):
        shapes.build({"type": "sphere"}, 3_000_000)


# ---- straight lines


@pytest.mark.parametrize("shape", [
    {"type": "box"}, {"type": "box", "size": [1, 1, 0.01]}, {"type": "ellipsoid", "axes": [1, 0.01, 0.01]},
    {"type": "ellipsoid", "axes": [1, 0.7, 0.3]}, {"type": "superellipsoid", "exponents": 2},
])
def test_convex_grains_obey_cauchy(shape):
    grain = shapes.build(shape, 1280)
    lines = measure(*parts(grain))
    assert lines.unbalanced == 0
    assert abs(lines.hit_probability - grain.area / (4 * pi)) < SIGMAS * lines.hit_probability_error
    assert abs(lines.inner_length - grain.volume / pi) < SIGMAS * lines.inner_length_error


def test_error_bars_can_fail():
    """A mesh that lacks one triangle in 20 is told from a whole one, by both identities."""
    vertices, faces = parts(shapes.ellipsoid((1, 1, 1), 1280))
    lines = measure(vertices, faces[len(faces) // 20:])
    assert lines.unbalanced > 0
    assert abs(lines.inner_length - quality.volume(vertices, faces) / pi) > SIGMAS * lines.inner_length_error


def torus(n=48, m=24, r=0.3):
    u, v = np.meshgrid(np.arange(n) * 2 * pi / n, np.arange(m) * 2 * pi / m, indexing="ij")
    points = np.stack([(1 + r * np.cos(v)) * np.cos(u), (1 + r * np.cos(v)) * np.sin(u), r * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a, b, c, d = (((i + s) % n * m + (j + t) % m).ravel() for s, t in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def test_a_grain_with_a_hole():
    vertices, faces, notes = mending.mended(*torus())
    figures = figures_of(vertices, faces)
    assert notes == () and figures.genus == 1 and figures.bodies == 1
    assert figures.volume == pytest.approx(2 * pi**2 * 0.3**2, rel=0.02)
    scaled, _, radius = onto_unit_sphere(vertices)
    assert radius == pytest.approx(1.3, rel=1e-12)
    lines = measure(scaled, faces)
    assert abs(lines.inner_length - quality.volume(scaled, faces) / pi) < SIGMAS * lines.inner_length_error
    # straight through the hole: not convex
    assert lines.hit_probability + SIGMAS * lines.hit_probability_error < quality.area(scaled, faces) / (4 * pi)


def test_what_lies_in_what():
    """A ball in the hole of a ring, one in its tube, and one in that; however they are wound."""
    vertices, faces = torus()
    ball, sides = radial.icosphere(80)
    bodies = [(vertices, faces), (0.5 * ball, sides), (0.2 * ball + [1, 0, 0], sides), (0.1 * ball + [1, 0, 0], sides[:, ::-1])]
    start = np.cumsum([0] + [len(v) for v, _ in bodies])
    body = np.repeat(np.arange(4), [len(f) for _, f in bodies])
    whole = np.concatenate([v for v, _ in bodies]), np.concatenate([f + n for (_, f), n in zip(bodies, start, strict=False)])
    assert quality.around(*whole, body).tolist() == [0, 0, 1, 2]
    found = mending.mended(*whole)
    volumes = [abs(quality.volume(*each)) for each in bodies]
    assert quality.volume(*found[:2]) == pytest.approx(volumes[0] + volumes[1] - volumes[2] + volumes[3])
    assert found[2] == ("1 of 4 bodies lie inside another: taken as cavities", "2 of 4 bodies turned inside out")


# ---- bodies given by a function


def test_marched_torus():
    def function(p):
        return np.hypot(np.hypot(p[:, 0], p[:, 1]) - 0.7, p[:, 2]) - 0.25

    exact = 2 * pi**2 * 0.7 * 0.25**2
    low, high = np.full(3, -1.1), np.full(3, 1.1)
    vertices, faces = marched(function, low, high, 0.07)
    figures = figures_of(vertices, faces)
    assert closed(vertices, faces) and figures.genus == 1 and figures.sharpest > 0.02
    assert np.abs(function(vertices)).max() < 1e-7
    assert len(quality.self_crossings(tree(vertices, faces))) == 0
    finer = quality.volume(*marched(function, low, high, 0.035))
    assert 0 < exact - finer < 0.3 * (exact - figures.volume) < 0.003 * exact  # second order
    assert 8000 < len(surface(function, low, high, 3000)[1]) < 40_000
    with pytest.raises(ValueError, match="leaves its box"):
        marched(function, low / 2, high / 2, 0.1)
    with pytest.raises(ValueError, match="fills none"):
        marched(lambda p: np.ones(len(p)), low, high, 0.1)


def test_a_rough_function_still_gives_a_closed_surface():
    """White noise between grid points: whatever the signs, two triangles to an edge and no crossings."""
    rng = np.random.default_rng(3)
    vertices, faces = marched(lambda p: np.where((np.abs(p) < 0.9).all(axis=1), rng.normal(size=len(p)), 1.0),
                              np.full(3, -1.0), np.full(3, 1.0), 0.2)
    assert len(faces) > 2000 and closed(vertices, faces)


# ---- noise


def test_noise():
    points = np.random.default_rng(2).random((20_000, 3)) * 50
    value = gradient_noise(points, stream(4, 0))
    assert np.abs(value).max() < 1 and abs(value.mean()) < 0.02 and 0.17 < value.std() < 0.21
    assert (gradient_noise(np.array([[3.0, 7, 250], [0, 0, 0]]), stream(4, 0)) == 0).all()  # zero on the lattice
    step = 1e-6  # continuous across cells
    at = np.array([[1.0, 0.3, 0.4]])
    assert abs(gradient_noise(at - step, stream(4, 0)) - gradient_noise(at + step, stream(4, 0)))[0] < 1e-5
    assert (value == gradient_noise(points, stream(4, 0))).all() and (value != gradient_noise(points, stream(5, 0))).any()
    assert np.abs(fractal_noise(points, stream(4, 0))).max() < 2
    ways = directions(stream(1, 0), 100_000)
    assert np.abs(ways.mean(axis=0)).max() < SIGMAS / np.sqrt(3e5)
    assert np.abs((ways[:, :, None] * ways[:, None]).mean(axis=0) - np.eye(3) / 3).max() < SIGMAS * 0.3 / np.sqrt(1e5)


# ---- fewer triangles


def test_simplified_keeps_shape_and_topology():
    vertices, faces, _ = mending.mended(*torus(120, 60))
    for target in (4000, 1000):
        v, f = simplified(vertices, faces, target)
        figures = figures_of(v, f)
        assert len(f) == target and closed(v, f) and figures.genus == 1
        # inscribed triangles lose volume; so many of them cannot do better than this share
        assert figures.volume == pytest.approx(quality.volume(vertices, faces), rel=30 / target)
        assert figures.area == pytest.approx(quality.area(vertices, faces), rel=30 / target)
        assert len(quality.self_crossings(tree(v, f))) == 0


def test_simplified_box_stays_a_box():
    cube = shapes.box()
    v, f = parts(cube)
    for _ in range(3):  # each triangle into four
        corner = v[f]
        middle = 0.5 * (corner + np.roll(corner, -1, axis=1))
        new = np.concatenate([np.stack([corner[:, k], middle[:, k], middle[:, k - 1]], 1) for k in range(3)] + [middle])
        v, f, _ = mending.mended(new.reshape(-1, 3), np.arange(3 * len(new)).reshape(-1, 3))
    assert len(f) == 12 * 64
    v, f = simplified(v, f, 12)
    assert len(f) == 12 and quality.volume(v, f) == pytest.approx(cube.volume, rel=1e-6)


def test_nothing_to_take_away():
    v, f = simplified(*parts(shapes.box()), 100)
    assert len(f) == 12
    v, f = simplified(*parts(shapes.box()), 4)
    assert len(f) == 4 and quality.volume(v, f) > 0


# ---- what is mended


def exported(grain, kind):
    mesh = trimesh.Trimesh(grain.vertices, grain.faces, process=False)
    if kind.endswith(" text"):
        data = trimesh.exchange.ply.export_ply(mesh, encoding="ascii") if kind[:3] == "ply" else \
            trimesh.exchange.stl.export_stl_ascii(mesh)
    else:
        data = mesh.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


@pytest.mark.parametrize("kind", ["ply", "ply text", "obj", "stl", "stl text", "off"])
def test_files_of_other_programs(rock, kind):
    again = shapes.mesh(exported(rock, kind), kind[:3], 20_000)
    assert len(again.faces) == len(rock.faces) and len(again.vertices) == len(rock.vertices)
    assert again.volume == pytest.approx(rock.volume, rel=1e-6)  # float32 in some of them
    lower = shapes.mesh(exported(rock, kind), kind[:3], 400)
    assert len(lower.faces) == 400 and lower.volume == pytest.approx(rock.volume, rel=0.02)


def test_pymeshlab_writes_what_we_read(rock, tmp_path):
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(np.array(rock.vertices), np.array(rock.faces)))
    for kind in files.KINDS:
        path = tmp_path / f"rock.{kind}"
        meshes.save_current_mesh(str(path))
        assert shapes.mesh(path.read_bytes(), kind).volume == pytest.approx(rock.volume, rel=1e-5)


def damaged(rock):
    v, f = parts(rock)
    some = (np.arange(len(f)) % 5 == 0)[:, None]
    soup = v[f].reshape(-1, 3)
    yield "nothing", v, f, ()
    yield "turned", v, np.where(some, f[:, ::-1], f), ("256 triangles wound against",)
    yield "inside out", v, f[:, ::-1], ("turned inside out",)
    yield "soup", soup, np.arange(len(soup)).reshape(-1, 3), ("3,198 vertices merged",)
    yield "twice", v, np.concatenate([f, f[:5]]), ("5 triangles removed",)
    yield "two sides", v, np.concatenate([f, f[:, ::-1]]), ("1,280 triangles removed",)
    yield "lines", v, np.concatenate([f, [[1, 1, 2], [3, 4, 3]]]), ("2 triangles with two equal corners",)
    yield "spare points", np.concatenate([v, [[5.0, 5, 5]]]), f, ("1 vertex without",)


def test_mended(rock):
    for name, v, f, told in damaged(rock):
        vertices, faces, notes = mending.mended(v, f)
        assert len(notes) == len(told) and all(map(str.startswith, notes, told)), (name, notes)
        assert closed(vertices, faces) and len(faces) == len(rock.faces), name
        assert quality.volume(vertices, faces) == pytest.approx(rock.volume, rel=1e-9), name


def torn(rock):
    """What needs judgement: with the message that refuses it, the volume and the triangles that it has when it is repaired."""
    v, f = parts(rock)
    soup = v[f].reshape(-1, 3)
    whole = rock.volume, len(f)
    shaken = soup + 1e-11 * np.random.default_rng(0).normal(size=soup.shape)
    yield ("shaken soup", shaken, np.arange(len(soup)).reshape(-1, 3), whole,
           "not closed: face 0 alone has the edge of the vertices 0 and 1 .*3,839 more edges")
    yield "missing one", v, np.delete(f, 100, 0), whole, "not closed: face 64 alone has .*2 more edges"
    around = np.isin(f, [50]).any(axis=1)
    yield "missing six", v, f[~around], (rock.volume, len(f) - 2), "not closed.*5 more edges"
    box = shapes.box()
    corner, sides = parts(box)
    a, b, c = sides[0].tolist()  # a side divided for one of its two triangles only, with a flat triangle in the gap
    yield ("corner on a side", np.concatenate([corner, [0.5 * (corner[a] + corner[b])]]),
           np.concatenate([sides[1:], [[a, 8, c], [8, b, c], [a, b, 8]]]), (box.volume, 14), "face 13 at .* has no area")


def test_pymeshlab_repairs_what_is_refused(rock):
    for name, v, f, (volume, count), words in torn(rock):
        with pytest.raises(mending.Unsound, match=words):
            mending.mended(v, f)
        *found, told = repair.repaired(v, f)
        vertices, faces, _ = mending.mended(*found)
        assert told[0].startswith(f"repaired by pymeshlab: {len(v):,} vertices and {len(f):,} triangles became"), name
        assert closed(vertices, faces) and len(faces) == count, name
        assert quality.volume(vertices, faces) == pytest.approx(volume, rel=1e-9 if name != "missing six" else 1e-3), name


def test_pymeshlab_leaves_a_sound_mesh_alone(rock):
    vertices, faces, told = repair.repaired(rock.vertices * 1e-5 + 3, rock.faces)
    assert told == () and (faces == rock.faces).all()
    assert np.abs(vertices - (rock.vertices * 1e-5 + 3)).max() < 1e-14


def test_what_pymeshlab_cannot_repair(rock):
    v, f = parts(rock)
    with pytest.raises(ValueError, match="its holes take more than 10% of the surface"):
        repair.repaired(v, f[v[f].mean(axis=1)[:, 0] > 0])
    box = shapes.box()  # two boxes that share a wall
    apart = np.concatenate([box.vertices, box.vertices + [2 * box.vertices[:, 0].max(), 0, 0]])
    with pytest.raises(ValueError, match="its holes take more than 10%"):
        repair.repaired(apart, np.concatenate([box.faces, box.faces + 8]))
    with pytest.raises(ValueError, match="pymeshlab cannot repair it: Failed to apply filter"):
        repair.repaired(np.eye(3), [[0, 0, 1], [1, 1, 2]])
    with pytest.raises(ValueError, match="no triangle"):
        repair.repaired(np.zeros((0, 3)), np.zeros((0, 3), int))
    with pytest.raises(ValueError, match="vertex 7 is"):
        repair.repaired(np.where(np.arange(len(v))[:, None] == 7, np.nan, v), f)


def test_a_recipe_asks_for_the_repair(rock, monkeypatch):
    v, f = parts(rock)
    data = trimesh.Trimesh(v, np.delete(f, 100, 0), process=False).export(file_type="ply")
    with pytest.raises(ValueError, match="not closed: face .*; `repair: pymeshlab` may mend it"):
        shapes.build({"type": "mesh", "data": data, "kind": "ply"})
    grain = shapes.build({"type": "mesh", "data": data, "kind": "ply", "repair": "pymeshlab"})
    assert len(grain.faces) == len(f) and closed(*parts(grain)) and "1,279 triangles became 642 and 1,280" in grain.notes[0]
    with pytest.raises(ValueError, match="pymeshlab did not mend it"):
        shapes.build({"type": "mesh", "data": mesh_text(*moebius()), "kind": "off", "repair": "pymeshlab"})
    with pytest.raises(ValueError, match="repair is pymeshlab; found 'magic'"):
        shapes.build({"type": "mesh", "data": data, "kind": "ply", "repair": "magic"})
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    with pytest.raises(UsageError, match=r"repair: pymeshlab: .* pip install \"\.\[repair\]\""):
        shapes.build({"type": "mesh", "data": data, "kind": "ply", "repair": "pymeshlab"})


def mesh_text(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False).export(file_type="off").encode()


def test_bodies_and_cavities(rock):
    v, f = parts(rock)
    n = len(v)
    both = np.concatenate([f, f + n])
    vertices, faces, notes = mending.mended(np.concatenate([v, v + 3]), both[:, ::-1])
    assert quality.volume(vertices, faces) == pytest.approx(2 * rock.volume) and notes == ("2 of 2 bodies turned inside out",)
    vertices, faces, notes = mending.mended(np.concatenate([v, 0.5 * v]), both)
    assert quality.volume(vertices, faces) == pytest.approx(7 / 8 * rock.volume)
    assert notes[0] == "1 of 2 bodies lie inside another: taken as cavities"
    end = v[v[:, 0].argmax()]
    touching = np.concatenate([v - end, end - v])  # two that meet in one vertex: each is wound for itself
    vertices, faces, notes = mending.mended(touching, both)
    assert quality.volume(vertices, faces) == pytest.approx(2 * rock.volume)
    assert notes == ("1 vertex merged with others", "1 of 2 bodies turned inside out")


def moebius(k=64):
    t = np.linspace(0, 2 * pi, k, endpoint=False)
    strip = np.stack([np.stack([np.cos(t) * (1 + s * np.cos(t / 2)), np.sin(t) * (1 + s * np.cos(t / 2)), s * np.sin(t / 2)], 1)
                      for s in (-0.3, 0.3)], 1).reshape(-1, 3)
    i = np.arange(k)
    a, b, c, d = 2 * i, 2 * i + 1, 2 * ((i + 1) % k), 2 * ((i + 1) % k) + 1
    c[-1], d[-1] = 1, 0
    return strip, np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])


def klein(n=24, m=12):
    """A torus that comes back turned over: closed, and without an inside."""
    vertices, _ = torus(n, m)
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")

    def at(s, t):
        row, column = i + s, j + t
        return (row % n * m + np.where(row == n, -column, column) % m).ravel()

    a, b, c, d = at(0, 0), at(1, 0), at(1, 1), at(0, 1)
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def refused(rock):
    v, f = parts(rock)
    box = shapes.box()
    n = len(v)
    yield v, f[v[f].mean(axis=1)[:, 0] > 0], r"not closed: face 0 alone .* vertices 18 and 4 at \(.*47 more edges"
    yield np.concatenate([v, v + 0.3]), np.concatenate([f, f + n]), r"crosses itself: face \d+ and face \d+ near \("
    crossed = np.concatenate([box.vertices * [1, 0.5, 0.5], box.vertices * [0.5, 1, 0.4]])
    yield crossed, np.concatenate([box.faces, box.faces + 8]), "crosses itself"
    yield np.where(np.arange(n)[:, None] == 7, np.nan, v), f, r"vertex 7 is \(nan"
    yield np.where(np.arange(n)[:, None] == 9, np.inf, v), f, "vertex 9 is"
    yield v, np.where(f == 7, 99_999, f), r"face \d+ names the vertices .*only 642 \(0 to 641\) \(and \d+ more places\)"
    yield v, np.where(f == 7, -1, f), r"face \d+ names"
    yield (*moebius(), "not closed: face 0")
    yield (*klein(), "no inside and outside.*face")
    yield (np.concatenate([v, [[2.0, 2, 2]]]), np.concatenate([f, [[*f[0, :2], n]]]),
           r"3 triangles \(faces 0, \d+, 1280\) meet at the edge of the vertices")
    yield np.eye(4, 3)[:3], [[0, 1, 2]], "not closed"
    yield [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]], [[0, 1, 2], [0, 2, 3], [1, 0, 3], [1, 3, 2]], "crosses itself|no volume"
    yield np.zeros((4, 3)), [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], "all vertices lie within 0 of"
    yield np.eye(4, 3) * [1, 1, 1e-11], [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], "encloses no volume|has no area"
    yield np.zeros((0, 3)), np.zeros((0, 3), int), "no triangle"


def test_refused_with_its_place(rock):
    for v, f, words in refused(rock):
        with pytest.raises(ValueError, match=words):
            mending.mended(v, f)


def test_four_triangles():
    vertices, faces, notes = mending.mended(np.eye(4, 3), [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    assert notes == () and quality.volume(vertices, faces) == pytest.approx(1 / 6)
    grain = shapes.mesh(b"OFF 4 4 0\n1 0 0\n0 1 0\n0 0 1\n0 0 0\n3 0 1 2\n3 0 3 1\n3 1 3 2\n3 2 3 0\n", "off")
    lines = measure(*parts(grain))
    assert abs(lines.hit_probability - grain.area / (4 * pi)) < SIGMAS * lines.hit_probability_error


def test_self_crossings_against_pymeshlab():
    """Random balls pushed into each other: the same set of triangles as another program finds."""
    v, f = radial.icosphere(320)
    rng = np.random.default_rng(8)
    for _ in range(4):
        vertices = np.concatenate([v, 0.7 * v + rng.normal(size=3) * 0.5, v * [1, 0.2, 0.2] + rng.normal(size=3) * 0.3])
        faces = np.concatenate([f, f + len(v), f + 2 * len(v)])
        ours = np.zeros(len(faces), bool)
        ours[quality.self_crossings(tree(vertices, faces), 100_000).ravel()] = True
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
        meshes.compute_selection_by_self_intersections_per_face()
        theirs = meshes.current_mesh().face_selection_array()
        assert ours.sum() > 20 and (ours == theirs).all()


def test_volume_and_area_against_trimesh(rock):
    mesh = trimesh.Trimesh(rock.vertices, rock.faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1
    assert rock.volume == pytest.approx(mesh.volume, rel=1e-12) and rock.area == pytest.approx(mesh.area, rel=1e-12)
    lines = measure(rock.vertices, rock.faces)
    assert lines.hit_probability - SIGMAS * lines.hit_probability_error < mesh.convex_hull.area / (4 * pi)


# ---- bad files

PLY = b"ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n" \
      b"element face %d\nproperty list uchar int vertex_indices\nend_header\n"


@pytest.mark.parametrize("kind, data, words", [
    ("ply", b"", "empty"),
    ("ply", b"\x00\xff" * 500, "begins with the line ply"),
    ("ply", b"ply\nformat ascii 1.0\n", "no end_header"),
    ("ply", b"ply\nformat morse 1.0\nend_header\n", "line 2.*format morse"),
    ("ply", PLY % (b"ascii", 10**12, 4), "1,000,000,000,000 vertex.*only 0 follow|at least"),
    ("ply", PLY % (b"binary_little_endian", 4, 10**12) + bytes(100), "at least"),
    ("ply", PLY % (b"binary_little_endian", 3, 1) + bytes(36) + b"\x03" + bytes(4), "8 bytes before the end of face 0"),
    ("ply", PLY % (b"binary_little_endian", 3, 1) + bytes(36) + b"\xff" + bytes(12), "bytes before the end of face 0"),
    ("ply", PLY % (b"ascii", 1, 1) + b"0 0 zero\n3 0 0 0\n", "line 10: three numbers"),
    ("ply", PLY % (b"ascii", 1, 1) + b"0 0 0\n3 0 0\n", "line 11: face 0: 3 entries expected, found 2"),
    ("ply", PLY % (b"ascii", 1, 1) + b"0 0 0\n9 0 0\n", "line 11"),
    ("ply", PLY % (b"ascii", 1, 0) + b"0 0 0\n", "no triangles"),
    ("ply", b"ply\nformat ascii 1.0\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n", "no element vertex"),
    ("off", b"OFF\n1000000000 1 0\n0 0 0\n", "header tells of 1,000,000,000"),
    ("off", b"OFF\n-3 1 0\n", "line 2"),
    ("off", b"4OFF\n1 1 1\n", "line 1.*three dimensions"),
    ("off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1\n3 0 1 2\n", "line 5: three numbers"),
    ("off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "line 6: a polygon of 3 corners that names 2"),
    ("off", b"OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "ends after line 6, before polygon 1 of 2"),
    ("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "line 4: no vertex has the index 0"),
    ("obj", b"v 0 0 0\nf -1 -2 1\n", "line 2: no vertex has the index -2"),
    ("obj", b"v 0 0 0\nf 1 2\n", "line 2: a polygon of 2 corners"),
    ("obj", b"v 0 0 0\nf 1 2 99999999999\n", "line 2: no vertex"),
    ("obj", b"v 0 0 0\nf 1 2 x\n", "line 2: whole numbers"),
    ("obj", b"hello\n", "no line begins with v"),
    ("obj", b"v 0 0 0\nf" + b" 1" * 2000 + b"\n", "2000 corners"),
    ("obj", b"x" * 200_000, "longer than 64 kB"),
    ("stl", b"solid x\nfacet\nvertex 0 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n", "line 5: a triangle of 2"),
    ("stl", b"solid x\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nvertex 1 0 0\nendloop\nendfacet\n", "without endsolid"),
    ("stl", b"solid x\nendsolid x\n", "no triangles"),
    ("stl", bytes(80) + b"\xff\xff\xff\x7f" + bytes(50), "2,147,483,647 triangles"),
    ("stl", bytes(80) + b"\x02\0\0\0" + bytes(50), "take 184 bytes; the file has 134"),
    ("stl", b"junk", "no header"),
    ("dae", b"<xml/>", "ply, obj, stl or off files, not 'dae'"),
])
def test_bad_files(kind, data, words):
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=words):
            shapes.mesh(data, kind)
        assert tracemalloc.get_traced_memory()[1] < 4_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("kind", ["ply", "ply text", "obj", "stl", "stl text", "off"])
def test_damaged_files_end_in_one_error_or_a_grain(rock, kind):
    """Cut short, with bytes changed, zeroed or doubled: a ValueError or a sound mesh, nothing else."""
    small = shapes.rock(seed=1, triangles=80)
    whole = exported(small, kind)
    rng = np.random.default_rng(11)
    errors = 0
    for trial in range(150):
        asked = {"repair": "pymeshlab"} if trial % 8 > 3 else {}
        data = bytearray(whole)
        at = int(rng.integers(len(data)))
        match trial % 4:
            case 0:
                del data[at:]
            case 1:
                data[at:at + 4] = rng.bytes(4)
            case 2:
                data[at] ^= 1 << int(rng.integers(8))
            case 3:
                data[at:at] = data[at // 2:at]
        try:
            grain = shapes.mesh(bytes(data), kind[:3], **asked)
        except ValueError as error:
            errors += 1
            assert 10 < len(str(error)) < 400
        else:
            assert closed(*parts(grain)) and grain.volume > 0
    assert errors > 40


def test_a_large_file_is_refused_before_it_is_read():
    with pytest.raises(ValueError, match="MiB"):
        files.triangles(bytes(files.BYTES + 1), "stl")


@pytest.mark.soak
def test_two_million_triangles():
    grain = shapes.ellipsoid((1, 0.8, 0.6), 2_000_000)
    assert len(grain.faces) == 1_997_120
    vertices, faces, notes = mending.mended(grain.vertices, grain.faces)
    assert notes == () and grain.volume == pytest.approx(4 / 3 * pi * 0.48, rel=1e-5)
    lower = shapes.level(grain, 200_000)
    assert len(lower.faces) == 200_000 and lower.volume == pytest.approx(grain.volume, rel=1e-4)


@pytest.mark.parametrize("shape, within", [
    ({"type": "box", "size": [1, 0.3, 2]}, 1e-12), ({"type": "ellipsoid", "axes": [1, 1, 1e-4]}, 0.012),
    ({"type": "ellipsoid", "axes": [3, 0.1, 0.05]}, 0.012)])
def test_shares_hit_are_those_of_the_mesh(shape, within):
    """Cauchy: a quarter of a convex body's surface is its mean projection, of which the unit sphere's is pi."""
    assert limits.share_hit(shape) == pytest.approx(shapes.build(shape).area / (4 * pi), rel=within)
