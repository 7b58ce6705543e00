"""Geometrical optics against our own Lorenz-Mie: python benchmarks/goa.py

Time per sphere at equal angles on one core, measured in turn, with the error of the faster answer beside it.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np  # noqa: E402
from peers import interleaved  # noqa: E402

from bakery import goa  # noqa: E402
from bakery.physics.mie import angular as mie  # noqa: E402
from benchmarks.sizes import sized  # noqa: E402

THETA = np.deg2rad(np.arange(0.25, 180, 0.5))
CORRECTIONS = {"floors + taper": dict(rainbow=False, axis=False, edge=None), "+ CFU + Bessel": dict(edge=None),
               "+ edge": dict(edge="narrow"), "+ wide edge": dict(edge="wide")}
X = sized((500.0, 1000.0, 1500.0, 2000.0, 3000.0, 5000.0, 11424.0, 20000.0), (500.0, 1000.0))
ROUNDS = sized((31, 7), (1, 1))  # of one sphere, of many


def errors(found, exact, theta=THETA):
    """rms of log10, and the integrated difference over the integral."""
    solid = np.sin(theta)
    return np.sqrt(np.mean(np.log10(found / exact) ** 2)), np.sum(abs(found - exact) * solid) / np.sum(exact * solid)


def exact_and_found(m, x, weight, theta, orders, options):
    exact, found = np.empty(theta.size), np.empty(theta.size)
    mie.intensity_block(complex(m), x, weight, theta, exact)
    goa.intensity_block(m, x, weight, theta, found, orders, **options)
    return exact, found


def speed(m=1.33, angles=sized(1801, 91), together=sized(64, 4)):
    theta = np.linspace(0, np.pi, angles)
    inner = theta[1:-1]
    for spheres, orders in ((1, 3), (together, 3), (together, 6)):
        print(f"\nm = {m}, {angles} angles, {orders} orders, narrow edge, "
              + ("one sphere" if spheres == 1 else f"average over {spheres} sizes within 20 %"))
        print("| x | mie, ms a sphere | goa, ms a sphere | ratio | rms log10 | L1 |\n|---|---|---|---|---|---|")
        crossing, last = None, None
        for x in X:
            sizes = np.array([x]) if spheres == 1 else np.linspace(0.8, 1.2, spheres) * x
            weight, out = np.ones(sizes.size), np.empty(theta.size)
            seconds = interleaved({
                "mie": lambda: mie.intensity_block(complex(m), sizes, weight, theta, out),
                "goa": lambda: goa.intensity_block(m, sizes, weight, theta, out, orders)}, ROUNDS[spheres > 1])
            exact, found = exact_and_found(m, sizes, weight, inner, orders, dict(edge="narrow"))
            log, part = errors(found, exact, inner)
            ratio = seconds["goa"] / seconds["mie"]
            if crossing is None and ratio < 1.0:
                crossing = x if last is None else last[0] * (x / last[0]) ** (np.log(last[1]) / np.log(last[1] / ratio))
            last = x, ratio
            print(f"| {x:g} | {seconds['mie'] / spheres * 1e3:.3f} | {seconds['goa'] / spheres * 1e3:.3f} | {ratio:.3f} | "
                  f"{log:.3f} | {part:.3f} |", flush=True)
        print(f"goa is faster from x = {crossing:.0f}" if crossing else "goa is never faster here")


def accuracy(orders=6):
    """rms of log10 / L1 on 360 angles, 0.6 um: mean of five single spheres within 2 %, and log-normal averages, sigma = 1.3."""
    print(f"\n{orders} orders\n| m | radius, um | " + " | ".join(f"single: {name}" for name in CORRECTIONS) + " | "
          + " | ".join(f"log-normal: {name}" for name in CORRECTIONS) + " |\n|" + "---|" * 10)
    y = np.linspace(-3, 3, 71) * np.log(1.3)
    share = np.exp(-0.5 * (y / np.log(1.3)) ** 2)
    for m in (1.33, 1.31, 1.5, 0.75, 1.5 + 0.001j):
        for radius in sized((2.0, 10.0, 100.0, 1000.0), (10.0,)):
            x, cells = 2 * np.pi * radius / 0.6, []
            for options in CORRECTIONS.values():
                each = [errors(*exact_and_found(m, np.array([v]), np.ones(1), THETA, orders, options)[::-1])
                        for v in x * np.linspace(0.98, 1.02, 5)]
                cells.append(np.mean(each, axis=0))
            for options in CORRECTIONS.values():
                cells.append(errors(*exact_and_found(m, x * np.exp(y), share, THETA, orders, options)[::-1]))
            print(f"| {m} | {radius:g} | " + " | ".join(f"{a:.2g} / {b:.2g}" for a, b in cells) + " |", flush=True)


if __name__ == "__main__":
    for call in (mie.intensity_block, goa.intensity_block):  # compile
        call(1.33 + 0j, np.array([50.0, 60.0]), np.ones(2), THETA, np.empty(THETA.size))
    speed()
    accuracy()
