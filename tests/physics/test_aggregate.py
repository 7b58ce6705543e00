"""Grains that fill a mesh: voxels, which spheres exist, the first sphere along a ray, all held against explicit lists."""

import itertools
import math

import numpy as np
import pytest

from bakery import kernels
from bakery.physics.granular import voxels
from bakery.physics.packing import pack
from bakery.physics.shapes.radial import icosphere
from bakery.system.compiled import njit

CUBE = np.array(list(itertools.product((0.0, 1.0), repeat=3))), np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7],
    [1, 7, 3]])


def bumpy(size, at=(0.0, 0.0, 0.0)):
    """A ball with dents, neither convex nor along any axis."""
    vertices, faces = icosphere(320)
    radius = 1 + 0.35 * np.sin(3 * vertices[:, 0] + 1) * np.cos(4 * vertices[:, 1]) * np.sin(2 * vertices[:, 2] + 0.5)
    return size * vertices * radius[:, None] + at, faces


def winding(points, vertices, faces):
    """Whether points (n, 3) are inside: solid angles of all triangles added up (Van Oosterom & Strackee 1983)."""
    a, b, c = (vertices[faces[:, k]] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    top = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
    bottom = la * lb * lc + np.einsum("nfi,nfi->nf", a, b) * lc + np.einsum("nfi,nfi->nf", b, c) * la \
        + np.einsum("nfi,nfi->nf", c, a) * lb
    return np.arctan2(top, bottom).sum(axis=1) > math.pi


def tile(fraction=0.6, count=60, seed=1):
    packed = pack(fraction, np.ones(count), (1.0, 1.0, 1.0), seed=seed, schedule="draft")
    return packed.centers, packed.radii, packed.cell


def listed(centers, radii, cell, vertices, faces):
    """Every sphere whose centre is inside: number and copy (K, 4), centre (K, 3), radius (K,)."""
    first, last = np.floor(vertices.min(axis=0) / cell) - 1, np.floor(vertices.max(axis=0) / cell) + 1
    copies = np.array(list(itertools.product(*(np.arange(a, b + 1) for a, b in zip(first, last)))))
    place = (np.mod(centers, cell)[None] + (copies * cell)[:, None]).reshape(-1, 3)
    met = np.concatenate([np.tile(np.arange(len(radii)), len(copies))[:, None], np.repeat(copies, len(radii), axis=0)], axis=1)
    box = np.all((place > vertices.min(axis=0)) & (place < vertices.max(axis=0)), axis=1)
    keep = np.flatnonzero(box)
    keep = keep[winding(place[keep], vertices, faces)] if keep.size else keep
    return met[keep].astype(int), place[keep], radii[met[keep, 0].astype(int)]


@njit
def all_spheres(aggregate, origin, direction, far, count, met, distance):
    """The first spheres along rays, one after the other, each left behind at its exit."""
    aggregate = kernels.lent(aggregate)
    room, left, o, d = kernels.aggregate_scratch(), np.empty(4, np.int64), np.empty(3), np.empty(3)
    for n in range(len(origin)):
        for axis in range(3):
            o[axis], d[axis] = origin[n, axis], direction[n, axis]
        left[:] = -1
        begin = 0.0
        for k in range(count):
            distance[n, k] = kernels.first_sphere(aggregate, o, d, begin, far[n], left, met[n, k], room)
            if distance[n, k] == np.inf:
                break
            along = across = 0.0
            for axis in range(3):
                to = aggregate.centers[met[n, k, 0], axis] + met[n, k, 1 + axis] * aggregate.cell[axis] - o[axis]
                along += to * d[axis]
                across += to * to
            begin = along + math.sqrt(max(aggregate.radii[met[n, k, 0]] ** 2 - across + along * along, 0.0))
            for word in range(4):
                left[word] = met[n, k, word]


def walked(aggregate, origin, direction, far=np.inf, count=64):
    met, distance = np.full((len(origin), count, 4), -9), np.full((len(origin), count), np.inf)
    all_spheres(aggregate, origin, direction, np.broadcast_to(float(far), len(origin)).copy(), count, met, distance)
    return met, distance


def expected(spheres, origin, direction, far=np.inf):
    """For each ray its spheres in order: rows of `listed`, and where they begin."""
    met, place, radius = spheres
    to = place[None] - origin[:, None]
    along = np.einsum("nki,ni->nk", to, direction)
    across = np.sum((to - along[..., None] * direction[:, None]) ** 2, axis=-1)
    inside = radius**2 - across
    begin = along - np.sqrt(np.maximum(inside, 0))
    hit = (inside > 1e-12) & (along > 0) & (begin < far)
    return [(met[row[np.argsort(starts[row])]], np.sort(starts[row])) for row, starts in
            ((np.flatnonzero(h), b) for h, b in zip(hit, begin))]


def rays(vertices, count, seed):
    """Lines through the mesh's surroundings from outside of its box, some of them along an axis."""
    random = np.random.default_rng(seed)
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    direction = random.normal(size=(count, 3))
    direction[: count // 8] = np.eye(3)[random.integers(0, 3, count // 8)] * random.choice([-1, 1], (count // 8, 1))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    through = vertices.mean(axis=0) + 0.4 * size * random.uniform(-1, 1, (count, 3))
    return through - (size + 2) * direction, direction


def check(aggregate, spheres, origin, direction, far=np.inf):
    met, distance = walked(aggregate, origin, direction, far)
    seen = 0
    for n, (names, begin) in enumerate(expected(spheres, origin, direction, far)):
        found = distance[n] < np.inf
        assert np.array_equal(met[n, found], names), (n, origin[n], direction[n])
        assert np.allclose(distance[n, found], np.maximum(begin, 0), rtol=0, atol=1e-9 * (1 + np.abs(origin[n]).max()))
        seen += len(names)
    return seen


# made where they are used: packing compiles its kernels
MESHES = {
    "dented, many tiles": lambda: (bumpy(14.0, (3.0, -5.0, 40.0)), tile(0.6)),
    "dented, thin packing": lambda: (bumpy(9.0), tile(0.05, 20)),
    "dense": lambda: (bumpy(8.0, (-100.0, 20.0, 7.0)), tile(0.63, 200)),
    "tile of one sphere": lambda: (bumpy(6.0), (np.array([[0.3, 0.2, 0.1]]), np.ones(1), np.array([2.4, 2.2, 2.5]))),
    "sizes": lambda: (bumpy(9.0), None),
    "thinner than a grain": lambda: ((CUBE[0] * [15.0, 15.0, 0.3] + [0.1, 0.2, 0.7], CUBE[1]), tile(0.6)),
    "one grain": lambda: ((CUBE[0] * 0.4 + tile(0.6)[0][7] - 0.2, CUBE[1]), tile(0.6)),
    "faces on the walls of voxels": lambda: ((CUBE[0] * 8.0, CUBE[1]), tile(0.5)),
}


@pytest.fixture(scope="module", params=MESHES)
def made(request):
    (vertices, faces), spheres = MESHES[request.param]()
    if spheres is None:
        packed = pack(0.55, np.repeat([1.2, 0.6], [20, 40]), (1.0, 1.2, 0.8), seed=4, schedule="draft")
        spheres = packed.centers, packed.radii, packed.cell
    found = kernels.aggregate(*spheres, vertices, faces)
    return found, listed(*spheres, vertices, faces), vertices


@pytest.mark.slow
def test_spheres_along_rays_are_those_of_a_list(made):
    """From outside, in order, none twice and none missing; and the same ones on the way back."""
    aggregate, spheres, vertices = made
    origin, direction = rays(vertices, 400, 1)
    assert check(aggregate, spheres, origin, direction) > (0 if len(spheres[0]) > 3 else -1)
    far = 2 * (np.linalg.norm(np.ptp(vertices, axis=0)) + 2)
    there, back = walked(aggregate, origin, direction), walked(aggregate, origin + far * direction, -direction)
    for a, p, b, q in zip(*there, *back):
        assert np.array_equal(a[p < np.inf], b[q < np.inf][::-1])


def test_a_ray_ends(made):
    """Spheres that begin beyond the end of a ray are not met."""
    aggregate, spheres, vertices = made
    origin, direction = rays(vertices, 100, 2)
    check(aggregate, spheres, origin, direction, np.linalg.norm(np.ptp(vertices, axis=0)) + 1.7)


@njit
def enclosed(aggregate, points, met):
    room = kernels.aggregate_scratch()
    for n in range(len(points)):
        kernels.enclosing_sphere(aggregate, points[n], met[n], room)


def test_the_sphere_around_a_point(made):
    aggregate, (names, place, radius), vertices = made
    random = np.random.default_rng(3)
    low, high = vertices.min(axis=0) - 1.5, vertices.max(axis=0) + 1.5
    points = low + (high - low) * random.random((2000, 3))
    met = np.full((2000, 4), -9)
    enclosed(aggregate, points, met)
    apart = np.linalg.norm(points[:, None] - place[None], axis=2) < radius if len(place) else np.zeros((2000, 0), bool)
    assert np.array_equal(met[:, 0] >= 0, apart.any(axis=1))
    for n in np.flatnonzero(apart.any(axis=1)):
        assert np.array_equal(met[n], names[np.flatnonzero(apart[n])[0]])


def test_grains_overhang():
    """The highest sphere sticks out of the mesh, and a ray above the mesh meets it."""
    vertices, faces, spheres = CUBE[0] * 8.0, CUBE[1], tile(0.6)
    aggregate, (names, place, radius) = kernels.aggregate(*spheres, vertices, faces), listed(*spheres, vertices, faces)
    top = np.argmax(place[:, 2] + radius)
    assert place[top, 2] + radius[top] > vertices[:, 2].max() + 0.1
    origin = np.array([[place[top, 0] - 60.0, place[top, 1], 0.5 * (place[top, 2] + radius[top] + vertices[:, 2].max())]])
    met, _ = walked(aggregate, origin, np.eye(1, 3))
    assert names[top].tolist() in met[0].tolist()


def test_voxels():
    """Classes by solid angles of corners and middles; partial ones by the distance of the surface, on a fine grid of points."""
    vertices, faces = bumpy(10.0, (0.3, 0.1, -0.2))
    found = kernels.aggregate(*tile(0.6), vertices, faces)
    kinds = found.voxels & voxels.CLASS
    index = np.argwhere(np.ones(kinds.shape, bool))
    points = found.low + (index + np.random.default_rng(5).random(index.shape)) * found.edge
    inside = winding(points, vertices, faces)
    flat = kinds.reshape(-1)
    assert not inside[flat == voxels.OUTSIDE].any() and inside[flat == voxels.INSIDE].all()
    assert {0, 1, 2} == set(flat) and np.all(found.voxels[kinds > 0] & voxels.NEAR)
    share = np.mean(flat == voxels.PARTIAL)  # a surface of about 1300 in voxels of edge 4, with some to spare
    assert share < 2.5 * 1300 * found.edge.mean() / np.prod(np.ptp(vertices, axis=0) + 2)


def test_triangle_and_box_against_points_of_the_triangle():
    """A triangle that has a point in the box meets it; one that a plane separates from it does not."""
    random = np.random.default_rng(6)
    half, met, apart = np.array([0.5, 0.3, 0.8]), 0, 0
    weights = random.dirichlet(np.ones(3), 4000)
    corners = np.array(list(itertools.product((-1, 1), repeat=3))) * half
    for _ in range(400):
        a, b, c = random.normal(size=(3, 3)) * 0.7 + random.normal(size=3) * 0.6
        said = voxels.meets(a, b, c, half)
        points = weights @ np.array([a, b, c])
        if np.any(np.all(np.abs(points) < half, axis=1)):
            met += 1
            assert said
            continue
        # the closest pair of a triangle's and a box's points separates them, where they are apart
        p, q = points[np.argmin(np.linalg.norm(points - np.clip(points, -half, half), axis=1))], None
        q = np.clip(p, -half, half)
        normal = p - q
        if (np.array([a, b, c]) @ normal).min() > (corners @ normal).max():
            apart += 1
            assert not said
    assert met > 50 and apart > 50


def test_a_million_millions_of_grains():
    """1e12 spheres: the same memory, and a ray goes through the ones that a list of its surroundings holds."""
    spheres = tile(0.6)
    side = (1e12 / len(spheres[1])) ** (1 / 3) * spheres[2][0]
    found = kernels.aggregate(*spheres, CUBE[0] * side + 0.3 * side, CUBE[1])
    assert found.voxels.nbytes <= 129**3
    at = np.floor(np.array([1.3, 0.7, 0.9]) * side / spheres[2]) * spheres[2]  # next to the face where x is largest
    near = CUBE[0] * [40.0, 40.0, 40.0] + at - [40.0 - (1.3 * side - at[0]), 20.0, 20.0]
    local = listed(*spheres, near, CUBE[1])
    random = np.random.default_rng(7)
    direction = np.array([-1.0, 0, 0]) + 0.2 * random.normal(size=(50, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    origin = np.array([1.3 * side + 5.0, *(at[1:])]) + random.uniform(-3, 3, (50, 3)) * [0, 1, 1]
    met, distance = walked(found, origin, direction, far=20.0, count=16)
    for n, (names, begin) in enumerate(expected(local, origin, direction, 20.0)):
        assert np.array_equal(met[n][distance[n] < np.inf], names)
        assert np.allclose(distance[n][distance[n] < np.inf], begin, atol=1e-8)


def test_a_mesh_without_any_centre():
    """So small that it lies between the centres: nothing exists, and nothing is wrong."""
    centers, radii, cell = tile(0.6)
    found = kernels.aggregate(centers, radii, cell, CUBE[0] * 0.01 + centers[0] + [1.0, 0, 0], CUBE[1])
    origin, direction = rays(CUBE[0] + centers[0], 100, 8)
    assert np.all(walked(found, origin, direction)[1] == np.inf)
