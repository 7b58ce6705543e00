"""Walks through a glass grain against the same walk through trimesh and embreex: python benchmarks/scatterometer.py

Both trace the same grain with the same physics on one core, in turn; ratios of the least CPU time over the rounds.  The peer's
walk is a wavefront in NumPy around trimesh's calls: `intersects_id` with locations, what one would write first, and
`intersects_first` with the distance from the plane of the triangle that it names, the fastest of them.  With --accuracy:
figures of a cube and of balls, and what rough surfaces lose.
"""

import sys
import time
from itertools import product
from pathlib import Path
from statistics import median

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np  # noqa: E402
from peers import optional  # noqa: E402

from bakery.physics.grains.bvh import Mesh  # noqa: E402
from bakery.physics.grains.grid import laid  # noqa: E402
from bakery.physics.grains.points import points, scrambled  # noqa: E402
from bakery.physics.grains.scatterometer import FIGURES, measure  # noqa: E402
from bakery.physics.grains.sphere import ball  # noqa: E402
from bakery.physics.grains.surface import conductor, dielectric, diffuse  # noqa: E402
from bakery.physics.grains.walk import LEFT, Walker  # noqa: E402
from benchmarks.sizes import sized  # noqa: E402

WALKS, ROUNDS, INDEX = sized((1_000_000, 3, 1.5), (1000, 1, 1.5))


def sphere_mesh(n):
    """Icosahedron with each edge cut into n (20 n^2 triangles), on the unit sphere."""
    phi = (1 + 5**0.5) / 2
    v = np.array([(-1, phi, 0), (1, phi, 0), (-1, -phi, 0), (1, -phi, 0), (0, -1, phi), (0, 1, phi), (0, -1, -phi), (0, 1, -phi),
                  (phi, 0, -1), (phi, 0, 1), (-phi, 0, -1), (-phi, 0, 1)])
    f = np.array([(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
                  (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7),
                  (9, 8, 1)])
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    inside = i + j <= n
    number = np.full((n + 1, n + 1), -1)
    number[i[inside], j[inside]] = np.arange(inside.sum())
    i, j = i[inside], j[inside]
    points = np.einsum("kp,fkx->fpx", np.stack([n - i - j, i, j]) / n, v[f])
    up, down = i + j < n, i + j < n - 1
    (a, b), (p, q) = (i[up], j[up]), (i[down], j[down])
    corners = np.concatenate([np.stack([number[a, b], number[a + 1, b], number[a, b + 1]], axis=1),
                              np.stack([number[p + 1, q], number[p + 1, q + 1], number[p, q + 1]], axis=1)])
    faces = (corners[None] + len(i) * np.arange(20)[:, None, None]).reshape(-1, 3)
    _, first, where = np.unique(np.round(points.reshape(-1, 3), 9), axis=0, return_index=True, return_inverse=True)
    points = points.reshape(-1, 3)[first]
    return points / np.linalg.norm(points, axis=1)[:, None], where.reshape(-1)[faces]


def rock(n, seed=0):
    """Bumpy ellipsoid, star-shaped and closed, inside the unit sphere."""
    v, f = sphere_mesh(n)
    rng, radius = np.random.default_rng(seed), np.ones(len(v))
    for octave in range(5):
        for _ in range(4):
            q = rng.normal(size=3)
            radius += 0.08 / 2**octave * np.sin(v @ (q * 1.5 * 2**octave / np.linalg.norm(q)) + rng.uniform(0, 6))
    v = v * radius[:, None] * [1, 0.8, 0.65]
    return v / np.linalg.norm(v, axis=1).max(), f


def needle(n, tilt=0.0):
    """Spheroid 100 : 1, turned by `tilt` about (0, 1, 1)."""
    v, f = sphere_mesh(n)
    v = v * [1, 0.01, 0.01]
    axis, c = np.array([0, 1, 1]) / 2**0.5, np.cos(tilt)
    v = c * v + np.sin(tilt) * np.cross(axis, v) + (1 - c) * (v @ axis)[:, None] * axis
    return v / np.linalg.norm(v, axis=1).max(), f


def aggregate(n, balls=20, seed=0):
    """Balls that do not touch, all in one grain: rays leave and enter again."""
    v, f = sphere_mesh(n)
    rng, centers = np.random.default_rng(seed), np.zeros((0, 3))
    while len(centers) < balls:
        p = rng.uniform(-1, 1, 3)
        if np.linalg.norm(p) < 0.75 and np.all(np.linalg.norm(centers - p, axis=1) > 0.42):
            centers = np.vstack([centers, p])
    return (0.2 * v + centers[:, None]).reshape(-1, 3), (f + len(v) * np.arange(balls)[:, None, None]).reshape(-1, 3)


def rays(count):
    """Starts a little outside of the unit sphere, and directions."""
    paths = Walker(Mesh(*rock(1)), diffuse(0.0), np.zeros(1)).trace(
        points(*scrambled(np.random.default_rng(0)), 0, count), 0, 0, (0, 0))
    return paths.start - paths.incoming / 128, paths.incoming


def peer_walk(mesh, start, direction, rng, located):
    """Mean over the rays that hit: meetings, weight-free cosine between the directions; the same physics as ours."""
    o, d = start.copy(), direction.copy()
    alive, inside, met = np.arange(len(o)), np.zeros(len(o), bool), np.zeros(len(o), int)
    normals, anchors, wrong = mesh.face_normals, mesh.triangles[:, 0], 0
    while alive.size:
        if located:
            face, ray, place = mesh.ray.intersects_id(o[alive], d[alive], multiple_hits=False, return_locations=True)
        else:
            face = mesh.ray.intersects_first(o[alive], d[alive])
            ray = np.flatnonzero(face >= 0)
            face = face[ray]
        i = alive[ray]
        n, t = normals[face], d[i]
        cosine = -np.einsum("ij,ij->i", n, t)
        if not located:
            far = np.einsum("ij,ij->i", anchors[face] - o[i], n) / -cosine
            place = o[i] + far[:, None] * t
        good = (cosine < 0) == inside[i]
        wrong += np.count_nonzero(~good)
        i, n, t, cosine, place = i[good], n[good], t[good], cosine[good], place[good]
        met[i] += 1
        eta = np.where(inside[i], 1 / INDEX, INDEX)
        n = np.where(inside[i][:, None], -n, n)
        c = np.abs(cosine)
        square = 1 - (1 - c * c) / (eta * eta)
        b = np.sqrt(np.maximum(square, 0))
        F = np.where(square <= 0, 1.0, 0.5 * (((c - eta * b) / (c + eta * b)) ** 2 + ((eta * c - b) / (eta * c + b)) ** 2))
        back = rng.random(len(i)) < F
        d[i] = np.where(back[:, None], t + 2 * c[:, None] * n, t / eta[:, None] + (c / eta - b)[:, None] * n)
        inside[i] ^= ~back
        o[i] = place + 1e-5 * d[i]  # float32 hits: a start on the triangle itself would meet it again
        alive = i
    hit = met > 0
    return hit.mean(), met[hit].mean(), np.einsum("ij,ij->i", d, direction)[hit].mean(), wrong / len(o)


def cpu(jobs):
    """Least CPU seconds of each job, in turn: on a machine that others load, waiting and evicted caches are not the walk's."""
    spent = {name: [] for name in jobs}
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            begin = time.process_time()
            job()
            spent[name].append(time.process_time() - begin)
    return {name: min(seconds) for name, seconds in spent.items()}


def speed():
    trimesh = optional("trimesh")
    embreex = optional("embreex") if trimesh else None
    start, direction = rays(WALKS)
    uniform = points(*scrambled(np.random.default_rng(0)), 0, WALKS)
    print("| grain | triangles | walk | s | ratio of ours | hits | meetings a hit | g | contradicted |\n|" + "---|" * 9)
    for grain, (vertices, faces) in (("rock", rock(32)), ("rock", rock(100)), ("needle", needle(32)),
                                     ("needle, askew", needle(32, 0.8)), ("20 balls", aggregate(10))):
        mesh = Mesh(vertices, faces)
        walker = Walker(mesh, dielectric(INDEX), np.zeros(1))
        made = {}

        def ours():
            paths = walker.trace(uniform, 0, 0, (1, 2))
            hit = paths.status > 0
            cosine = np.einsum("ij,ij->i", paths.incoming, paths.outgoing)
            made["ours"] = hit.mean(), paths.events[hit].mean(), cosine[paths.status == LEFT].mean(), np.mean(paths.status == 3)

        jobs = {"ours": ours}
        if embreex:
            theirs = trimesh.Trimesh(vertices, faces, process=False)
            assert theirs.face_normals.shape == theirs.triangles[:, 0].shape  # made before the clock starts
            for name, located in (("intersects_id", True), ("intersects_first", False)):
                def peer(name=name, located=located):
                    made[name] = peer_walk(theirs, start, direction, np.random.default_rng(1), located)
                jobs[name] = peer
        seconds = cpu(jobs)
        for name in jobs:
            hits, met, g, wrong = made[name]
            print(f"| {grain} | {len(faces)} | {name} | {seconds[name]:.2f} | {seconds['ours'] / seconds[name]:.2f} | "
                  f"{hits:.4f} | {met:.3f} | {g:.4f} | {wrong:.1e} |", flush=True)


def grids():
    print("\n| triangles | grid, s | MB |\n|---|---|---|")
    for n in sized((4, 32, 100, 316), (4,)):
        vertices, faces = rock(n)
        seconds = []
        for _ in range(3):
            begin = time.perf_counter()
            grid = laid(vertices, faces)
            seconds.append(time.perf_counter() - begin)
        print(f"| {len(faces)} | {median(seconds):.3f} | {grid.nbytes / 1e6:.0f} |", flush=True)


def shown(found, name, digits=4):
    """First channel of a figure with its standard error."""
    return f"{np.ravel(getattr(found, name))[0]:.{digits}f} ± {np.ravel(found.errors[name])[0]:.1g}"


def defaults():
    print("\n| grain, tolerance | s, one core | paths | " + " | ".join(FIGURES) + " |\n|" + "---|" * (3 + len(FIGURES)))
    mesh = Mesh(*rock(sized(100, 8)))
    measure(mesh, diffuse(0.0), seed=0, tolerance=1.0)  # lays the grid
    jobs = (("glass", dielectric(1.5), 0.005), ("glass", dielectric(1.5), sized(0.001, 0.005)), ("white", diffuse(1.0), 0.005))
    for name, surface, tolerance in jobs:
        begin = time.perf_counter()
        found = measure(mesh, surface, seed=1, tolerance=tolerance)
        spent = time.perf_counter() - begin
        print(f"| {name}, {tolerance:g} | {spent:.2f} | {found.paths} | " + " | ".join(shown(found, k) for k in FIGURES) + " |",
              flush=True)


def accuracy():
    corners = np.array(list(product((-1, 1), repeat=3))) / np.sqrt(3)
    cube = Mesh(corners, [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6),
                          (0, 6, 4), (1, 5, 7), (1, 7, 3)])
    print("| glass cube | lambda_delta | lambda_s | g | mean_square | inner_path |\n|" + "---|" * 6)
    found = measure(cube, dielectric(1.5), seed=1, tolerance=sized(3e-4, 0.01))
    names = ("lambda_delta", "lambda_s", "g", "mean_square", "inner_path")
    print(f"| {found.paths} paths | " + " | ".join(shown(found, name, 5) for name in names) + " |")
    print("\n| roughness | albedo of a glass cube without absorption | of a mirror cube |\n|---|---|---|")
    for roughness in sized((0.01, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0), (0.1,)):
        a, b = (measure(cube, s, seed=1).albedo[0] for s in (dielectric(1.5, roughness), conductor(np.inf, roughness)))
        print(f"| {roughness} | {a:.3f} | {b:.3f} |")
    exact = ball(dielectric(1.5))
    print("\n| facets of a glass ball | lambda_s | g | inner_path |\n|---|---|---|---|")
    for n in sized((2, 8, 32), (2,)):
        found = measure(Mesh(*sphere_mesh(n)), dielectric(1.5), seed=1, tolerance=0.002)
        print(f"| {20 * n * n} | " + " | ".join(shown(found, name) for name in ("lambda_s", "g", "inner_path")) + " |")
    print(f"| smooth, exact | {exact.lambda_s[0]:.4f} | {exact.g[0]:.4f} | {exact.inner_path[0]:.3f} |")


if __name__ == "__main__":
    if "--accuracy" in sys.argv:
        accuracy()
    else:
        speed()
        grids()
        defaults()
