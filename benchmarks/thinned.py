"""A dense tile of which a part of the spheres is left out, against tiles that are packed less densely.

    python benchmarks/thinned.py                     some two minutes

Some spheres of a tile of fraction 0.6 are kept, whichever, as where `fraction` in a scene is less; beside it a tile packed at
that fraction.  First table, of spheres alone: <z^2>/(2 <z>^2) of the chords between them, 1 where flights are exponential; the
share of straight lines that meet no sphere on a way of 2, 5 and 10 radii, which begins anywhere.

Second table, of grains: sigma_t R by Eq. 4, exact in the mean for both, and what random walks of light make of it: how far light
spreads in the tile, as sigma_t over that of Eq. 4.  The medium of a body takes the factor at 0.6 at all fractions.
"""

import numpy as np
from numba import njit

from bakery import kernels, rng
from bakery.physics.grains import surface
from bakery.physics.granular import packed
from bakery.physics.packing import pack
from bakery.physics.shapes.build import build
from benchmarks.sizes import sized

DENSE, COUNT = 0.6, sized(1000, 100)
FRACTIONS = sized((0.6, 0.45, 0.3, 0.15), (0.6, 0.3))
WAYS = 2.0, 5.0, 10.0
LINES = sized(400_000, 1000)
# of recipes/sand.yaml
ROCK = {"type": "rock", "seed": 3, "axes": [1, 0.8, 0.65], "corners": 45, "sharpness": 24, "roughness": 0.05}


@njit(nogil=True, error_model="numpy")
def ways(aggregate, start, direction, limit, met, free):
    """From points of a tile (n, 3) along directions (n, 3) to the next sphere, 0 within one, at most `limit`: free (n,)."""
    o, d, to, left, none = np.empty(3), np.empty(3), np.empty(3), np.zeros(4, np.int64), np.empty(4, np.int64)
    room = kernels.aggregate_scratch()
    grid = aggregate.cell, aggregate.m, aggregate.start, aggregate.image, aggregate.owner
    left[0] = -1
    for n in range(len(start)):
        for k in range(3):
            o[k], d[k] = start[n, k], direction[n, k]
        if kernels.enclosing_sphere(aggregate, o, none, room):
            free[n] = 0.0
            continue
        free[n] = kernels.flight_to_sphere(o, d, left, grid, limit, met, to)


def free_ways(tile):
    """Free ways from anywhere in a tile."""
    random = rng.generator(1, "packing.chords", 0)
    edge = float(tile[2].max())
    around = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]) * 40 * edge - 10 * edge  # a tetrahedron around the tile
    aggregate = kernels.aggregate(*tile, around, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    start, direction = random.random((LINES, 3)) * tile[2], random.normal(size=(LINES, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    free = np.empty(LINES)
    ways(aggregate, start, direction, 1e4, np.empty(4, np.int64), free)
    return free


def thinned(tile, share, seed):
    keep = rng.generator(seed, "packing.chords", 1).permutation(len(tile[1]))[: round(share * len(tile[1]))]
    return tile[0][keep], tile[1][keep], tile[2]


def tiles():
    """Fraction, words, tile."""
    made = {f: pack(f, np.ones(COUNT), seed=1, schedule="preview") for f in FRACTIONS}
    made = {f: (one.centers, one.radii, one.cell) for f, one in made.items()}
    for f in FRACTIONS:
        yield f, "packed", made[f]
        if f < DENSE:
            yield f, "some left out", thinned(made[DENSE], f / DENSE, 2)


def main():
    rock = build(ROCK, sized(1300, 320))
    grains = {"glass ball": packed.Grain(surface.dielectric(1.5)), "matt ball": packed.Grain(surface.diffuse(1.0)),
              "quartz rock": packed.Grain(surface.dielectric(1.54), kernels.Mesh(rock.vertices, rock.faces))}
    print("| fraction | | <z^2>/(2 <z>^2) | free for 2 R | 5 R | 10 R |\n|---|---|---|---|---|---|")
    rows = []
    for f, how, tile in tiles():
        free = free_ways(tile)
        void = free[free > 0]
        # a point lies on a chord as often as that is long: the mean way to its end is <z^2>/(2 <z>)
        moment, left = void.mean() / (4 / 3 * (1 - f) / f), [f"{np.mean(free > way):.4f}" for way in WAYS]
        print("|", " | ".join([str(f), how, f"{moment:.3f}", *left]), "|", flush=True)
        for name, grain in grains.items():
            walks = packed.walk(tile, [grain], seed=1, tolerance=sized(0.005, 0.2), hits=sized(1 << 22, 1 << 14))
            factor = np.sqrt(walks.mean_square_rte / walks.mean_square_displacement)
            rows.append((name, f, how, factor, walks.achieved_error * factor))
    print("\n| grain | fraction | | sigma_t of the walk over that of Eq. 4 |\n|---|---|---|---|")
    for name, f, how, factor, error in sorted(rows, key=lambda row: (row[0], -row[1], row[2])):
        print(f"| {name} | {f} | {how} | {factor:.3f} ± {error:.3f} |")


if __name__ == "__main__":
    main()
