"""Packed tiles against spheropack, and our own rate against the number of spheres: python benchmarks/packing.py

Both programs end at exactly the fraction; in turn on one core, medians over the rounds, with what was reached beside it: reduced
pressure and bond order tell whether speed was bought with order.  With --jamming: where each schedule and several sizes jam.
"""

import sys
import time
from pathlib import Path
from statistics import median

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np  # noqa: E402
from peers import optional  # noqa: E402

from bakery.physics.packing import SCHEDULES, _events, dynamics, pack, predicted, structure  # noqa: E402
from bakery.physics.packing.ceiling import limit  # noqa: E402
from bakery.physics.packing.radii import lognormal, species  # noqa: E402
from benchmarks.sizes import sized  # noqa: E402

ROUNDS = sized(3, 1)
JOBS = (("to 0.63", 0.63, 0.02, 1.0, "preview"), ("to 0.64", 0.64, 0.01, 1.0, "final"),
        ("log-normal, sigma 0.3, to 0.63", 0.63, 0.02, np.exp(0.3), "preview"))


def timed(function, *arguments, **options):
    start = time.perf_counter()
    return function(*arguments, **options), time.perf_counter() - start


def figures(tile, seconds, order):
    """Seconds, collisions, pressure, bond order, smallest gap of either program's tile."""
    collisions, pressure, gap = ((tile.collisions, tile.pressure, tile.gap) if hasattr(tile, "collisions") else
                                 (tile.n_collisions, tile.reduced_pressure, tile.min_gap))
    return seconds, collisions / len(tile.radii), pressure, order, gap


def against_the_peer(peer):
    print("| job | N | spheropack, s | ours, s | ratio | predicted, s | collisions a sphere, theirs / ours | Z | Q6 | "
          "smallest gap |\n|" + "---|" * 10)
    pack(0.6, np.ones(50), seed=0)  # compiles
    for name, fraction, growth, sigma, schedule in JOBS:
        for count in sized((1000, 4000), (60,)):
            radii = lognormal(sigma, count) if sigma > 1 else np.ones(count)
            theirs, ours = [(np.nan,) * 5], []
            for seed in range(ROUNDS):
                if peer:
                    tile, seconds = timed(peer.pack, radii=radii, density=fraction, growth_rate=growth, seed=seed)
                    assert tile.status == "target"
                    edges = np.array(tile.container.lengths, float)
                    theirs.append(figures(tile, seconds, structure.bond_order(tile.positions, tile.radii, edges).q6))
                tile, seconds = timed(pack, fraction, radii, seed=seed, schedule=schedule)
                assert tile.reached
                ours.append(figures(tile, seconds, tile.order))
            them, us = ([median(column) for column in zip(*rows)] for rows in (theirs[1:] or theirs, ours))
            guess = predicted(fraction, count, np.std(radii) / np.mean(radii), schedule)
            print(f"| {name} | {count} | {them[0]:.2f} | {us[0]:.3f} | {us[0] / them[0]:.2f} | {guess:.2f} | "
                  f"{them[1]:.0f} / {us[1]:.0f} | {them[2]:.0f} / {us[2]:.0f} | {them[3]:.3f} / {us[3]:.3f} | "
                  f"{them[4]:.1g} / {us[4]:.1g} |", flush=True)


def rate(fractions=(0.5, 0.6), counts=sized((100, 1000, 10_000, 100_000), (100,)), pieces=sized(30, 2),
         events=sized(40_000, 1000)):
    """Best and median time of a collision over short pieces, all numbers of spheres in turn."""
    print("\n| fraction | N | ns a collision, best | median | collisions/s | events/s |\n|---|---|---|---|---|---|")
    for fraction in fractions:
        boxes = []
        for count in counts:
            cell = np.full(3, (4 * np.pi / 3 * count / fraction) ** (1 / 3))
            spheres = dynamics.Spheres(np.ones(count), cell, np.random.default_rng(1), lambda spheres: None)
            spheres.place(0.28)
            spheres.grow(fraction, 0.5, 1e9)
            spheres.rest(2)
            spheres.clock[_events.RATE] = 0.0
            _events.predict_all(spheres.state)
            boxes.append((spheres, []))
        for _ in range(pieces):
            for spheres, seconds in boxes:
                before = spheres.collisions
                start = time.perf_counter()
                _events.run(spheres.state, np.inf, 1 << 60, events)
                spent = time.perf_counter() - start
                seconds.append((spent / (spheres.collisions - before), spent / events))
        for spheres, seconds in boxes:
            each = [s[0] for s in seconds]
            print(f"| {fraction} | {spheres.count} | {min(each) * 1e9:.0f} | {median(each) * 1e9:.0f} | {1 / median(each):.3g} | "
                  f"{1 / median(s[1] for s in seconds):.3g} |", flush=True)


def jamming(count=sized(1000, 150), seeds=sized(3, 1)):
    """Fraction at infinite pressure, from f/(1 - 3/Z) at Z >= 3000, of the schedules and of sizes grown with `final`."""

    def jam(radii, growth, fraction, seed):
        radii = np.sort(radii)[::-1] / radii.mean()
        cell = np.full(3, (4 * np.pi / 3 * np.sum(radii**3) / fraction) ** (1 / 3))
        spheres = dynamics.Spheres(radii, cell, np.random.default_rng(seed), lambda spheres: None)
        spheres.place(0.28)
        for until, speed in growth:
            if not spheres.grow(min(until, fraction), speed, 3000):
                break
        return spheres.fraction / (1 - 3 / spheres.pressure)

    print("| schedule | jams at |\n|---|---|")
    plans = {name: plan.growth for name, plan in SCHEDULES.items()} | {f"uniform {rate}": ((1.0, rate),) for rate in (0.02, 0.01)}
    for name, growth in plans.items():
        print(f"| {name} | {np.mean([jam(np.ones(count), growth, 0.67, seed) for seed in range(seeds)]):.4f} |", flush=True)
    print("\n| sizes | N | limit | jams at |\n|---|---|---|---|")
    sizes = {f"log-normal {s}": lognormal(s, count) for s in (1.2, 1.35, 1.6)} | {
        "1 : 1.4, half each": species([0.5, 0.5], [1, 1.4], count), "1 : 2, 11 %": species([8 / 9, 1 / 9], [1, 2], count),
        "1 : 3, 3.6 %": species([0.964, 0.036], [1, 3], 2 * count), "1 : 5, 1 %": species([0.99, 0.01], [1, 5], 3 * count),
        "1 : 10, 0.2 %": species([0.998, 0.002], [1, 10], 4 * count)}
    for name, radii in sizes.items():
        top = limit(radii)
        growth = tuple((until * top / 0.64, speed) for until, speed in SCHEDULES["final"].growth)
        print(f"| {name} | {radii.size} | {top:.3f} | {jam(radii, growth, top + 0.03, 0):.3f} |", flush=True)


if __name__ == "__main__":
    if "--jamming" in sys.argv:
        jamming()
        sys.exit()
    against_the_peer(optional("spheropack"))
    rate()
