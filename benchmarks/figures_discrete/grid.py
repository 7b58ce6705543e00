"""Fig. 17: time against the resolution of the grid, for discs."""

import time

import numpy as np
from numba import njit

from bakery import kernels
from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

COUNT, RAYS, DEPTH = sized((200_000, 20_000, 0.5), (2000, 100, 0.5))  # as many particles as the paper
PER_CELL = sized((0.03, 0.1, 0.3, 1.0, 1.5, 3.0, 10.0), (0.3, 1.0, 3.0))
SIGMAS = (1.02, 4.0)  # of a log-normal distribution


@njit(nogil=True, error_model="numpy")
def _all(discs, origin, direction):
    """Pencils through the whole cube, from disc to disc; how many they meet."""
    room, met = kernels.mesh_scratch(), 0
    for i in range(len(origin)):
        t = 0.0
        while True:
            pencil = kernels.Pencil((origin[i, 0], origin[i, 1], origin[i, 2]),
                                    (direction[i, 0], direction[i, 1], direction[i, 2]), t, 2.0, (np.nan, np.nan, np.nan))
            kind, t, _, _, _, _ = kernels.first_disc(discs, pencil, room)
            if kind == kernels.NO_DISC:
                break
            met += 1
    return met


def radii(sigma, random):
    """Twelve classes of a log-normal distribution, and a class for each particle."""
    values = np.exp(np.log(sigma) * random.standard_normal(COUNT))
    values = np.minimum(values, 20.0)
    edges = np.quantile(values, np.linspace(0, 1, 13)) if sigma < 1.1 else np.geomspace(values.min(), values.max() * 1.001, 13)
    kind = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, 11)
    middle = np.sqrt(edges[1:] * edges[:-1])
    area = np.mean(middle[kind] ** 2)
    return np.sqrt(DEPTH / (COUNT * np.pi * area)) * middle, kind


def measure():
    random = np.random.default_rng(1)
    place, origin = random.random((COUNT, 3)), np.column_stack([np.full(RAYS, -0.01), random.random((RAYS, 2))])
    direction = np.column_stack([np.ones(RAYS), random.uniform(-0.3, 0.3, (RAYS, 2))])
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    region, rows = kernels.region_box(np.zeros(3), np.ones(3)), {}
    for sigma in SIGMAS:
        radius, kind = radii(sigma, random)
        extinction = np.pi * radius[None, :] ** 2
        order = kernels.disc_order(extinction)
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order))
        for per in PER_CELL:
            discs = kernels.stored_discs(region, extinction[:, order], place, rank[kind], per_cell=per)
            met, best = _all(discs, origin[:10], direction[:10]), np.inf
            for _ in range(3):
                begin = time.process_time()
                met = _all(discs, origin, direction)
                best = min(best, time.process_time() - begin)
            rows[sigma, per] = (1e6 * best / RAYS, met / RAYS, tuple(discs.cells[-1].tolist()), len(discs.reach))
    return rows


def tables(numbers):
    body = [[f"{per:g}", *(of.short(numbers[sigma, per][0]) for sigma in SIGMAS)] for per in PER_CELL]
    head = ["particles a cell", *(f"us a pencil, sigma = {sigma:g}" for sigma in SIGMAS)]
    lattices = ", ".join(f"{numbers[sigma, 1.0][3]} for sigma = {sigma:g}" for sigma in SIGMAS)
    return {"fig17": of.table(head, body) + f"\n\nLattices of cells, by size: {lattices}."}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5, 3))
    for sigma, line in zip(SIGMAS, ("o-", "s--")):
        axes.loglog(PER_CELL, [numbers[sigma, per][0] for per in PER_CELL], line, color=of.INK, label=f"sigma = {sigma:g}")
    axes.set(xlabel="particles a cell", ylabel="us a pencil", title="Pencils through 200,000 discs")
    axes.legend(fontsize=8)
    return figure
