"""`bakery.kernels`: a kernel compiled outside of bakery calls the look-ups and gets the values that `bakery.open` gives."""

import importlib
import math
import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

import bakery
from bakery import kernels
from bakery.errors import UsageError
from bakery.physics.packing.instances import rotation_matrix
from bakery.system import llvm
from tests.conftest import slow
from tests.oracles.instances import instances


def test_all_is_documented():
    missing = [name for name in kernels.__all__ if not (getattr(kernels, name).__doc__ or "").strip()]
    assert not missing
    table = kernels.__doc__
    assert not [name for name in kernels.__all__ if f"`{name}`" not in table and f"`{name} " not in table
                and f"`{name}(" not in table]


# ---- a toy renderer's loops


@njit
def gathered(points, segments, length, rho, z, out):
    for n in range(len(out)):
        out[n, 0] = kernels.point_source(points, rho[n], z[n], 0.6, 0.0, 0.8)
        out[n, 1] = kernels.segment_source(points, segments, length, rho[n], z[n], 0.6, 0.0, 0.8)
        axis, eye, view = (0.0, 0.0, 1.0), (rho[n], 0.0, z[n]), (-0.6, 0.0, -0.8)
        out[n, 2] = kernels.point_source_seen(points, (0.0, 0.0, 0.0), axis, eye, view, np.inf)
        out[n, 3] = kernels.segment_source_seen(points, segments, length, (0.0, 0.0, 0.0), axis, eye, view, np.inf)


@njit
def scattered(v, steps, f, cdf, xi, out):
    for n in range(len(xi)):
        drop = kernels.phase_sample(v, steps, f, cdf, xi[n])
        out[n, 0], out[n, 1] = drop, kernels.phase_value(v, steps, f, drop)
        out[n, 2:] = kernels.turned_direction(0.0, 0.6, 0.8, drop, 6.0 * xi[n])


@njit
def placed(seed, tile, sphere, shares, out):
    for n in range(len(sphere)):
        t, quaternion = kernels.instance(seed, tile[n, 0], tile[n, 1], tile[n, 2], sphere[n], shares)
        out[n, 0] = t
        out[n, 1:] = kernels.rotation_matrix(*quaternion)


@njit
def met(centers, radii, cell, m, o, d, distance, spheres):
    start, image, owner = kernels.tile_grid(centers, radii, cell, m)
    grid = cell, m, start, image, owner
    left, sphere, to = np.array([-1, 0, 0, 0]), np.zeros(4, np.int64), np.zeros(3)
    for n in range(len(o)):
        distance[n] = kernels.flight_to_sphere(o[n], d[n], left, grid, np.inf, sphere, to)
        spheres[n] = sphere


@pytest.fixture(scope="module")
def milk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kernels")
    recipe = folder / "milk.yaml"
    recipe.write_text("bakery: 1\nname: milk\nwavelengths: [0.55] um\ntolerance: 10%\n"
                      "medium: {albedo: 0.9, mean_free_path: 1 mm, phase: {type: hg, g: 0.5}}\nmultiple_scattering: {}\n")
    return bakery.open(bakery.bake(recipe, folder / "milk.h5"))


@pytest.mark.slow
def test_tables_of_multiple_scattering(milk):
    rho, z = np.array([0.3, 1.0, 4.0]), np.array([-1.0, 0.5, 3.0])
    theta = math.acos(0.8)
    (points, segments, stretch), = milk.multiple.segment.tables()
    assert stretch == 1
    found = np.empty((3, 4))
    gathered(points, segments, 3.3, rho, z, found)
    assert np.allclose(found[:, 0], milk.multiple.point(rho, z, theta, 0.0)[0], rtol=1e-12)
    assert np.allclose(found[:, 1], milk.multiple.segment(rho, z, theta, 0.0, length=3.3)[0], rtol=1e-12)
    source, axis, view = np.zeros(3), np.array([0, 0, 1.0]), np.array([-0.6, 0, -0.8])
    eye = np.column_stack([rho, 0 * rho, z])
    assert np.allclose(found[:, 2], milk.multiple.point_to_segment(source, axis, eye, view, np.inf)[0], rtol=1e-12)
    assert np.allclose(found[:, 3], milk.multiple.segment_to_segment(source, axis, 3.3, eye, view, np.inf)[0], rtol=1e-12)


@pytest.mark.parametrize(("Float", "vector", "error"), [("Float64", "Array3f64", 1e-5), slow("Float", "Array3f", 1e-3)])
@pytest.mark.parametrize("device", ["llvm", "cuda"])
def test_look_ups_in_kernels_of_drjit(milk, device, Float, vector, error):
    """All four queries against numba's: beside and far from the source, beyond the extent, at the end of a tile, a pencil."""
    llvm.find()
    dr = pytest.importorskip("drjit")
    if device == "llvm" and llvm.fault(tuple(dr.detail.llvm_version())):
        pytest.skip("Dr.Jit has no LLVM that it can use")
    if device == "cuda" and not dr.has_backend(dr.JitBackend.CUDA):
        pytest.skip("no graphics card that CUDA could use")
    (points, segments, _), = milk.multiple.segment.tables()
    random = np.random.default_rng(2)
    source, place = random.normal(size=(2, 12, 3))
    place[:4] = source[:4] + np.array([[0.03, 0, 0.01], [0, 100.0, 3], [0, 0, 0], [0, 0.02, 2]])
    into, out = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in random.normal(size=(2, 12, 3)))
    into[3] = 0, 0, 1
    length, distance = random.uniform(0.2, 5, (2, 12))
    length[3:7] = segments.length, math.inf, 0.0, math.inf
    drjit = importlib.import_module(f"drjit.{device}")
    number = getattr(drjit, Float)
    tables = kernels.drjit_tables(points, segments, number)
    a, b, v, w = (getattr(drjit, vector)(one.T) for one in (source, into, place, out))
    beam, sight = (b, number(length)), (w, number(distance))
    for name, first, last, expected in (
            ("point_to_point", (b,), (w,), milk.multiple.point_to_point(source, into, place, out)),
            ("segment_to_point", beam, (w,), milk.multiple.segment_to_point(source, into, length, place, out)),
            ("point_to_segment", (b,), sight, milk.multiple.point_to_segment(source, into, place, out, distance)),
            ("segment_to_segment", beam, sight, milk.multiple.segment_to_segment(source, into, length, place, out, distance))):
        found = getattr(tables, name)(a, *first, v, *last).numpy()
        assert np.allclose(found, expected[0], rtol=error, atol=0), name


def test_drjit_without_what_it_needs_is_refused(milk, monkeypatch):
    (points, segments, _), = milk.multiple.segment.tables()
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "drjit", None)
        with pytest.raises(UsageError, match="drjit.*pip install"):
            kernels.drjit_tables(points, segments, float)
    pytest.importorskip("drjit")
    with pytest.raises(UsageError, match="float is no type of its arrays"):
        kernels.drjit_tables(points, segments, float)


@pytest.mark.slow
def test_phase_functions(milk):
    layout = kernels.phase_layout(milk.medium.theta, milk.medium["phase"][0])
    xi = (np.arange(20_000) + 0.5) / 20_000  # stratified: the mean of a smooth function to 1e-6 and better
    found = np.empty((len(xi), 5))
    scattered(*layout, xi, found)
    theta = 2 * np.arcsin(np.sqrt(found[:, 0] / 2))
    assert np.allclose(found[:, 1], milk.medium.phase(theta)[0], rtol=1e-9)
    assert abs(np.mean(1 - found[:, 0]) - milk.medium.g[0]) < 1e-6
    assert np.allclose(found[:, 3] * 0.6 + found[:, 4] * 0.8, 1 - found[:, 0], atol=1e-12)


def test_instances_are_those_of_the_bake():
    tile, sphere = np.array([[0, 0, 0], [-1, 0, 5], [7, -3, 2]]), np.array([7, 7, 0])
    kinds, quaternions = instances(1, tile, sphere, [0.7, 0.3])
    found = np.empty((3, 10))
    placed(np.uint64(1), tile, sphere, kernels.cumulated_shares([0.7, 0.3]), found)
    assert np.array_equal(found[:, 0], kinds)
    assert np.allclose(found[:, 1:], [rotation_matrix(*q) for q in quaternions], atol=1e-15)


@pytest.mark.slow
def test_spheres_of_a_repeated_tile():
    """Against all spheres of 5 x 5 x 5 copies, one by one."""
    draw = np.random.default_rng(3)
    cell, radii = np.array([3.0, 2.5, 2.0]), np.array([0.4, 0.3, 0.5])
    centers = np.array([[0.5, 0.5, 0.5], [2.0, 1.5, 1.0], [2.9, 0.4, 1.4]])
    o, d = np.tile([1.3, 2.2, 0.4], (200, 1)), draw.normal(size=(200, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    distance, spheres = np.empty(200), np.empty((200, 4), np.int64)
    met(centers, radii, cell, np.array([3, 2, 2]), o, d, distance, spheres)
    copies = np.array(np.meshgrid(*[np.arange(-2, 3)] * 3)).reshape(3, -1).T
    to = (centers[:, None] + copies * cell).reshape(-1, 3) - o[:, None]
    along = np.einsum("nki,ni->nk", to, d)
    inside = np.repeat(radii, len(copies)) ** 2 - (np.sum(to**2, axis=2) - along**2)
    reach = np.where((inside > 0) & (along > 0), along - np.sqrt(np.maximum(inside, 0)), np.inf)
    near = reach.min(axis=1) < 4  # within the copies that were looked at
    assert near.sum() > 20
    assert np.allclose(distance[near], reach.min(axis=1)[near], atol=1e-12)
    assert np.array_equal(spheres[near, 0], reach.argmin(axis=1)[near] // len(copies))


def test_grains_and_their_surfaces():
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / math.sqrt(3)
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = np.array([triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))])
    nodes, children, blocks, _ = kernels.Mesh(corners, faces).tree
    place, distance = kernels.nearest_triangle(nodes, children, blocks, -2.0, 0.1, 0.2, 1.0, 0.0, 0.0, -1, kernels.mesh_scratch())
    assert abs(distance - (2 - 1 / math.sqrt(3))) < 1e-12
    assert np.allclose(kernels.triangle_normal(blocks, place), (-1, 0, 0))
    assert abs(kernels.fresnel(1.0, 1.5)[0] - 0.04) < 1e-15
    assert abs(kernels.fresnel_conductor(1.0, 1.5, 0.0) - 0.04) < 1e-15
    glass = kernels.dielectric(1.5)
    x, y, z, share, _ = kernels.at_surface(glass.kind, glass.index, 0.0, 0.6, 0.0, 0.8, 0.99, 0.0, 0.0)  # 0.99: goes in
    assert np.allclose((x, y, z, share), (-0.4, 0.0, -math.sqrt(1 - 0.16), 1.0))
    white = kernels.diffuse(0.7)
    assert kernels.surface_share(white.kind, white.channels, 0, 1.0) == 0.7


def test_amplitudes_of_spheres():
    theta = np.radians([0.0, 60.0])
    exact, rays = kernels.mie_amplitudes(1.33, 2000.0, theta)[0], kernels.goa_amplitudes(1.33, 2000.0, theta)[0]
    assert abs(abs(rays[0]) / abs(exact[0]) - 1) < 0.01


# ---- uncounted arrays


class Pair(NamedTuple):
    one: np.ndarray
    rest: tuple


@njit
def total(pair):
    return pair.one.sum() + pair.rest[0] * pair.rest[1].sum()


@njit
def totals(pair, count):
    pair = kernels.lent(pair)
    found = 0.0
    for _ in range(count):
        found += total(pair)
    return found


def test_lent_arrays_are_the_same_and_outlive_the_loop():
    """Values, and nobody holds or lets go of an array more often than before."""
    pair = Pair(np.arange(4.0), (2.0, np.ones((2, 3))))
    before = [sys.getrefcount(one) for one in (pair.one, pair.rest[1])]
    assert totals(pair, 1000) == 1000 * 18
    assert [sys.getrefcount(one) for one in (pair.one, pair.rest[1])] == before
    assert np.array_equal(pair.one, np.arange(4.0)) and np.array_equal(pair.rest[1], np.ones((2, 3)))
