"""Multiple scattering: seconds for both tables of five materials, and errors: python benchmarks/multiple.py

Processor seconds of one core, as the machine may be shared; published wall times are of 40 cores (Wang, Ge & Holzschuch 2020).
With --photons: what photons cost for the error that they reach.
"""

import math
import sys
import time

import numpy as np

from bakery.physics.medium import analytic
from bakery.physics.multiple import fourier, legendre, point, segment, solution
from benchmarks.sizes import sized
from tests.oracles import photons

# name, albedo of three colours, g, published seconds (segment + point)
MATERIALS = (("B.S.", (0.955, 0.677, 0.457), 0.9, 20), ("wax", (0.980, 0.962, 0.750), 0.8, 30),
             ("milk", (0.999, 0.999, 0.999), 0.7, 30), ("skin", (0.958, 0.838, 0.678), 0.0, 17),
             ("marble", (0.999, 0.998, 0.997), 0.0, 30))
LENGTH = 2.0
# albedo, g, length of the segment
COUNTED = sized(((0.9, 0.0, None), (0.9, 0.7, None), (0.95, 0.9, None), (0.5, -0.5, None), (0.9, 0.7, 2.0), (0.8, 0.3, 0.5)),
                ((0.9, 0.0, None), (0.8, 0.3, 0.5)))
NODES, ANGLES, LOBE = sized((81, 49, (64, 25)), (5, 5, (8, 5)))


def nodes():
    """Places of the nodes of both tables: (r, angle) and (rho, z), 81 x 49 each; directions of a lobe."""
    angle = math.pi * np.linspace(0, 1, ANGLES) ** 1.3
    r, a = (x.ravel() for x in np.meshgrid(np.geomspace(0.05, 45, NODES), angle, indexing="ij"))
    mu = 0.05 * np.sinh(np.linspace(0.02, math.asinh(math.acosh(45) / 0.05), NODES))
    m, n = (x.ravel() for x in np.meshgrid(mu, angle, indexing="ij"))
    beside = LENGTH / 2 * np.sinh(m) * np.sin(n), LENGTH / 2 * (1 + np.cosh(m) * np.cos(n))
    return (r, a), beside, (math.pi * np.linspace(0, 1, LOBE[0]) ** 2, np.linspace(0, math.pi, LOBE[1]))


def seconds(function, *arguments, **options):
    start = time.process_time()
    return function(*arguments, **options), time.process_time() - start


def tables(repeats=sized(3, 1)):
    at, beside, directions = nodes()
    print(f"Lobes of {LOBE[0]} x {LOBE[1]} directions at {NODES} x {ANGLES} nodes of both tables, one core, processor seconds a "
          f"colour (best of {repeats})\n")
    print("| material | g | orders | solve | point table | segment table | three colours | on 2 cores | published, 40 cores | "
          "smallest value |")
    print("|" + "---|" * 10)
    for name, albedos, g, published in sized(MATERIALS, MATERIALS[3:]):
        p = legendre.henyey_greenstein(g, 150)
        order = legendre.order_needed(p, solution.TOLERANCE)
        best = np.full(3, np.inf)
        for albedo in (albedos[:1] * repeats):
            medium, solving = seconds(fourier.propagator, albedo, p[:order + 1])

            def of_point():
                return point.lobes(point.coefficients(medium, *at), order, *directions)

            def of_segment():
                axis = segment.local_axis(*beside, LENGTH)
                return point.lobes(segment.coefficients(medium, *beside, LENGTH, axis), order, *directions)

            (lobes, first), (others, second) = seconds(of_point), seconds(of_segment)
            best = np.minimum(best, [solving, first, second])
            smallest = min(lobes.min(), others.min())
        whole = 3 * best.sum()
        print(f"| {name} | {g:g} | {order} | " + " | ".join(f"{x:.2f}" for x in best)
              + f" | {whole:.2f} | {whole / 2:.2f} | {published} | {smallest:.1e} |", flush=True)


def errors():
    """Against twice the orders: root mean square over directions, relative to the lobe."""
    print("\n| albedo | g | orders | true error at r = 0.1, in front .. behind (0.2, 1.6, 3 rad) | r = 1 | r = 5 | "
          "estimate at r = 1 |\n|" + "---|" * 7)
    angle = np.array([0.2, 1.6, 3.0])
    for albedo, g in sized(((0.99, 0.3), (0.95, 0.7), (0.97, 0.8), (0.93, 0.9), (0.9, -0.8)), ((0.99, 0.3),)):
        solved = solution.solve(albedo, legendre.henyey_greenstein(g, 150))
        order = solved.medium.order
        better = fourier.propagator(albedo, legendre.henyey_greenstein(g, min(2 * order, 120)))
        twice = np.concatenate([np.where(np.arange(l + 1) == 0, 1.0, 2.0) for l in range(better.order + 1)])
        cells = []
        for r in (0.1, 1.0, 5.0):
            exact, fine = (point.coefficients(medium, r, angle) for medium in (better, solved.medium))
            off = exact.copy()
            off[:, :fine.shape[1]] -= fine
            cells.append(np.sqrt((twice * off**2).sum(1) / (twice * exact**2).sum(1)))
        cells.append(solved.error(1.0, angle))
        texts = (", ".join(f"{x:.0e}" for x in cell) for cell in cells)
        print(f"| {albedo} | {g} | {order} | " + " | ".join(texts) + " |", flush=True)


def by_photons(count=sized(200_000, 3200)):
    rho, z = np.array([0.3, 1.0, 2.0, 4.0, 8.0]), np.array([-4.0, -1.0, 0.5, 1.5, 3.0, 6.0, 10.0])
    directions = np.radians([[0, 0], [45, 0], [90, 0], [90, 180], [180, 0], [60, 90]])
    print(f"\n| source | albedo | g | {count} photons, s | median error of a cell and direction | mean square deviation from the "
          "solver, in standard errors | largest |\n|" + "---|" * 7)
    for albedo, g, length in COUNTED:
        theta, table, _, _ = analytic.tabulated("isotropic" if g == 0 else "hg", 1e-4, 1, g=[g])
        p = legendre.moments(theta, table[0], 100)
        medium = fourier.propagator(albedo, p[:max(legendre.order_needed(p) or 0, 1) + 1])
        tally, spent = seconds(photons.trace, albedo, theta, table[0], rho, z, directions, count, length=length, seed=1)

        def source(*places):
            return point.value(medium, *places) if length is None else segment.value(medium, *places, length)

        mean = photons.cell_averages(source, rho, z, directions, points=24 if abs(g) > 0.8 else 5)
        good = tally.error < 0.1 * tally.value
        off = ((tally.value - mean) / tally.error)[good]
        kind = "point" if length is None else f"segment {length:g}"
        print(f"| {kind} | {albedo} | {g} | {spent:.1f} | "
              f"{np.median((tally.error / tally.value)[good]):.3f} | {np.mean(off**2):.2f} | "
              f"{np.abs(off).max():.1f} |", flush=True)


if __name__ == "__main__":
    small = fourier.propagator(0.5, legendre.henyey_greenstein(0.1, 2))  # compiles
    point.lobes(segment.coefficients(small, [1.0], [1.0], 1.0, [0.0]), 2, [0.0], [0.0])
    tables()
    errors()
    if "--photons" in sys.argv:
        by_photons()
