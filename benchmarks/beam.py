"""Kernels of a narrow beam against photons: python benchmarks/beam.py [--photons N]

Root mean square error of 2 pi r Psi over ten planes (0.5 to 5 mfp) and fifty rings (to 5 mfp), relative, less the photons' noise:
forward light as flux | as fluence.  Then what a look-up and a table cost, and the small-angle kernel against its own photons.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bakery.beam import build, kernels, moments, photons, planar, small_angle, table
from bakery.medium import analytic

DEPTH, EDGES = np.arange(1, 11) / 2, np.linspace(0, 5, 51)
ALBEDOS = (0.1, 0.5, 0.9, 1.0)
SPREADS = (3, 10, 20, 30, 45, 60, 90)  # degrees, sqrt(4 B)
HG = (0.8, 0.9, 0.95)
POINTS = 8  # of a ring, by Gauss's rule in the square root of r, for closed forms


def gaussian(degrees):
    """Table of exp(-theta^2/4B), 4 B the square of the spread, and B."""
    spread = math.radians(degrees)
    theta, values, _, _ = analytic.tabulated("gaussian", 1e-3, 1, spread=spread / math.sqrt(2))
    return theta, values[0], spread**2 / 4


def henyey_greenstein(g):
    theta, values, _, _ = analytic.tabulated("hg", 1e-3, 1, g=[g])
    return theta, values[0]


def rings(kernel):
    """Averages of kernel(depth, r) over the rings, (D, R)."""
    x, w = np.polynomial.legendre.leggauss(POINTS)
    # r = q^2: the first ring holds 1/r, and all of a narrow beam
    q = np.sqrt(EDGES)
    at = (q[:-1, None] + q[1:, None] + np.diff(q)[:, None] * x) / 2
    weight = w * np.diff(q)[:, None] / 2 * 2 * at * 2 * math.pi * at**2 / (math.pi * np.diff(EDGES**2))[:, None]
    return np.sum(kernel(DEPTH[:, None, None], at**2) * weight, axis=-1)


def closed_forms(albedo, B):
    """The kernels that have a formula, by name: functions of depth and r."""
    loss = 1 - albedo

    def of(function):
        def kernel(z, r):
            S = moments.levers(z, albedo)
            M0 = moments.moments(*S, loss * z, B)[0]
            return function(z, r, M0, moments.mean_square(S[0], S[1], B))
        return kernel

    def printed(constant):
        def kernel(z, r, M0, q):
            return kernels.erf_kernel(*kernels.erf_parameters(M0, constant / 1.5 * kernels.printed_mean_square(z, albedo, B)), r)
        return of(kernel)

    def absorbed(z, r, M0, q):
        weight, shrink = moments.absorbed(z, albedo, loss, B)
        return kernels.erf_kernel(*kernels.erf_parameters(M0 * weight, q * shrink), r)

    def erf(z, r, M0, q):
        return kernels.erf_kernel(*kernels.erf_parameters(M0, q), r)

    return {"single": of(lambda z, r, M0, q: kernels.single_kernel(z, albedo, z, B, r)),
            "printed M2, 3/2": printed(1.5), "printed M2, 3": printed(3.0), "erf": of(erf), "erf, absorption": of(absorbed),
            "single + Gaussian": of(lambda z, r, M0, q: kernels.single_and_gaussian(z, albedo, loss, B, r)),
            "path integral": of(lambda z, r, M0, q: kernels.path_integral(z, albedo, loss, B, M0, r)),
            "Elek": of(lambda z, r, M0, q: kernels.elek(z, albedo, B, M0, r)),
            "Gaussian": of(lambda z, r, M0, q: kernels.gaussian_kernel(M0, q, r))}


def compare(theta, phase, albedo, count, B=None, of=None):
    """Errors (flux, fluence) of every kernel, and the noise of the photons."""
    counted = photons.count(albedo, theta, phase, DEPTH, EDGES, count, back=False)
    everything = photons.count(albedo, theta, phase, DEPTH, EDGES, count)
    medium = build.prepare(theta, phase)
    of = of or medium.planar
    B = of.B if B is None else B
    z, ratio = table.grid(DEPTH[-1], of.width)
    averages = {name: (kernel, kernel) for name, kernel in
                ((name, rings(kernel)) for name, kernel in closed_forms(albedo, B).items())}
    for name, absorb in (("small-angle", False), ("small-angle, absorption", True)):
        made = table.Table(z, ratio, small_angle.homogeneous(of, albedo, z, ratio, absorb) * z[:, None] ** 2 * ratio)
        averages[name] = (made.rings(DEPTH, EDGES),) * 2
    result = {}
    if medium.moments is not None:
        tables = build.transport_tables(medium, albedo, DEPTH[-1])
        averages["transport"] = tables["flux"].rings(DEPTH, EDGES), tables["forward"].rings(DEPTH, EDGES)
        result["transport, all directions"] = (math.nan, photons.rms(tables["fluence"].rings(DEPTH, EDGES), everything,
                                                                     "fluence")[0])
    for name, (flux, fluence) in averages.items():
        result[name] = photons.rms(flux, counted, "flux")[0], photons.rms(fluence, counted, "fluence")[0]
    return result, photons.rms(counted.flux, counted, "flux")[1], photons.rms(counted.fluence, counted, "fluence")[1]


def accuracy(count):
    rows = [(f"{spread}, {albedo:g}", *gaussian(spread), albedo) for spread in SPREADS for albedo in ALBEDOS]
    names = None
    print("Percent, forward light, flux | fluence\n")
    for label, theta, phase, B, albedo in rows:
        result, *noise = compare(theta, phase, albedo, count, B, planar.gaussian(B))
        names = names or _head("spread, albedo", result)
        _row(label, result, noise)
    print()
    names = None
    for g in HG:
        theta, phase = henyey_greenstein(g)
        for albedo in (0.5, 0.9):
            result, *noise = compare(theta, phase, albedo, count)
            names = names or _head("g, albedo", result)
            _row(f"{g:g}, {albedo:g}", result, noise)


def _head(first, result):
    print(f"| {first} | " + " | ".join(result) + " | noise |\n|" + "---|" * (len(result) + 2))
    return True


def _row(label, result, noise):
    def cell(pair):
        return " / ".join("-" if math.isnan(x) else f"{100 * x:.1f}" for x in pair)
    print(f"| {label} | " + " | ".join(cell(pair) for pair in result.values()) + f" | {cell(noise)} |", flush=True)


def layers(count):
    """Layers of unequal density: the exact small-angle kernel and the homogeneous one with its moments, by photons."""
    B, albedo, edges = math.radians(30) ** 2 / 4, 0.9, np.linspace(0, 4, 5)
    z, ratio = table.grid(8, math.sqrt(B))
    kernel = small_angle.homogeneous(planar.gaussian(B), albedo, z, ratio)
    homogeneous = table.Table(z, ratio, kernel * z[:, None] ** 2 * ratio)
    x, w = np.polynomial.legendre.leggauss(POINTS)
    q = np.sqrt(EDGES)
    at = (q[:-1, None] + q[1:, None] + np.diff(q)[:, None] * x) / 2
    weight = w * np.diff(q)[:, None] / 2 * 2 * at * 2 * math.pi * at**2 / (math.pi * np.diff(EDGES**2))[:, None]
    print("\nSmall-angle photons (nothing absorbed), spread 30 degrees, four layers of 1 mfp: percent\n")
    print("| density | exact | homogeneous, stretched | noise |\n|---|---|---|---|")
    for density in ((1, 1, 1, 1), (2, 0, 0, 2), (0, 0, 3, 0), (3, 0.5, 0.2, 0.1), (0.1, 0.2, 0.5, 3)):
        density = np.array(density, float)
        S = moments.layered_levers(edges, albedo * density)
        value, error, _, _ = photons.count_small_angle(
            S[0][-1], lambda random, n: np.sqrt(-4 * B * np.log1p(-random.random(n))), edges, density, 4.0, EDGES, count)
        tau = density.sum()
        exact = small_angle.layered(planar.gaussian(B), albedo, edges, density, (at**2).ravel()).reshape(at.shape)
        stretched = homogeneous.stretched(tau, math.sqrt(3 * S[1][-1] / S[0][-1]), at**2)
        r = (EDGES[1:] + EDGES[:-1]) / 2
        whole = np.sum((r * value) ** 2)
        noise = math.sqrt(np.sum((r * error) ** 2) / whole)
        found = [math.sqrt(max(np.sum((r * (np.sum(one * weight, axis=1) * math.exp((1 - albedo) * tau) - value)) ** 2) / whole
                               - noise**2, 0.0)) for one in (exact, stretched)]
        print("| " + ", ".join(f"{x:g}" for x in density) + " | " + " | ".join(f"{100 * x:.1f}" for x in (*found, noise)) + " |")


def speed(repeats=5):
    theta, phase, B = gaussian(30)
    medium = build.prepare(theta, phase)
    tables = build.transport_tables(medium, 0.9, 32)
    rng = np.random.default_rng(0)
    z, r = rng.uniform(0.01, 32, 1_000_000), rng.uniform(0.001, 10, 1_000_000)
    jobs = {"look-up of a value, ns": lambda: tables["flux"].kernel(z, r),
            "error-function kernel in NumPy, ns": lambda: kernels.erf_kernel(0.3, z, r)}
    print("\n| job | one core |\n|---|---|")
    for name, job in jobs.items():
        best = min(_seconds(job) for _ in range(repeats))
        print(f"| {name} | {best * 1e9 / len(z):.0f} |")
    for name, job in (("three tables by transport to 32 mfp, ms", lambda: build.transport_tables(medium, 0.9, 32)),
                      ("small-angle table to 32 mfp, ms", lambda: build.small_angle_table(medium, 0.9, 32)),
                      ("preparing a phase function, ms", lambda: build.prepare(theta, phase))):
        print(f"| {name} | {min(_seconds(job) for _ in range(repeats)) * 1e3:.0f} |")


def _seconds(job):
    start = time.process_time()
    job()
    return time.process_time() - start


if __name__ == "__main__":
    count = int(sys.argv[sys.argv.index("--photons") + 1]) if "--photons" in sys.argv else 200_000
    accuracy(count)
    layers(count)
    speed()
