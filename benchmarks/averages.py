"""Averages over size distributions: our time against a plain loop over lxmie, and claimed errors against true ones.

    python -m benchmarks.averages            both tables
    python -m benchmarks.averages --rates    the rates that predictions use (bakery/physics/averages/predicted.py)
    python -m benchmarks.averages --model    predicted against actual work and angles
    python -m benchmarks.averages --whole    shipped recipes: tolerances for the light as a whole, rays beside series

True errors are against averages over several times as many nodes at unrelated radii, with tails a hundred times less cut.
"""

import math
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from bakery.errors import StageError
from bakery.physics.averages import Aim, Component, averages, batches, cross, expected
from bakery.physics.averages import spheres as kinds
from bakery.physics.medium import phase
from bakery.physics.sizes import Nodes, population
from bakery.recipe import load
from bakery.run.executors import Context
from bakery.stages import measures
from bakery.stages.optics import stage as optics
from bakery.store.tree import Group
from benchmarks.peers import optional
from benchmarks.sizes import sized

RGB = (0.610, 0.550, 0.465)


def size(distribution, **given):
    return SimpleNamespace(**(dict(distribution=distribution, radius=None, sigma=None,
                           variance=None, min=None, max=None, file=None, of=()) | given))


def lognormal(radius, sigma, low=None, high=None):
    return size("lognormal", radius=radius, sigma=sigma, min=low, max=high)


# name: size, m relative to the host, host, wavelengths (the indices of
# the recipes that ship, taken as constant), doublings for the truth
CASES = {
    "fog": (lognormal(5.0, 1.5, 0.1, 60.0), 1.333 + 2e-9j, 1.0, RGB, 11),
    "cirrus": (size("gamma", radius=40.0, variance=0.1, min=1.0, max=200.0), 1.31 + 3e-9j, 1.0, RGB[:1], 8),
    "blowing snow": (size("mixture", of=((0.995, lognormal(10.0, 1.4)), (0.005, lognormal(80.0, 1.3))), min=1.0, max=250.0),
                     1.31 + 3e-9j, 1.0, RGB[:1], 7),
    "dust": (lognormal(0.5, 2.2, 0.02, 5.0), 1.53 + 0.0055j, 1.0, RGB, 9),
    "soot": (lognormal(0.1, 1.6), 1.8 + 0.7j, 1.0, RGB, 8),
    "bubbles": (lognormal(30.0, 1.6, 5.0, 300.0), 0.75, 1.333, RGB[:1], 6),
    "haze": (lognormal(0.02, 1.3, 0.005, 0.06), 1.45, 1.0, RGB, 8),
    "narrow": (lognormal(5.0, 1.1), 1.333, 1.0, RGB, 11),
    "very narrow": (lognormal(20.0, 1.01), 1.333, 1.0, RGB[:1], 10),
    "gamma": (size("gamma", radius=10.0, variance=0.1), 1.333, 1.0, RGB, 11),
}
MORE = {
    "one size, x 27": (size("single", radius=2.0),
                      1.333, 1.0, RGB, 0),
    "one size, x 1000": (size("single", radius=90.0),
                        1.333, 1.0, RGB[: 1],
                        0),
    "glass": (lognormal(10.0, 1.5),
             1.5 +1e-7j, 1.0, RGB[: 1],
             0),
    "small": (lognormal(0.3, 1.5),
             1.4, 1.0, RGB, 0),
    "black": (lognormal(20.0, 1.5),
             1.5 +0.1j, 1.0, RGB[: 1],
             0),
    "n = 2.5": (size("gamma", radius=3.0, variance=0.1),
               2.5, 1.0, RGB[: 1],
               0),}

CHOSEN, REPEATS = sized(tuple(CASES), ("haze",)), sized(5, 1)


def ours(case, tolerance, threads=None, report=lambda seconds, error: None):
    s, m, host, wavelength, _ = case
    way = (lambda f, tasks: [f(*t) for t in tasks]
           ) if threads is None else lambda f, tasks: list(threads.map(lambda t: f(*t), tasks))
    component = Component("spheres", np.full(len(wavelength), m, complex), population(s))
    return averages([component], wavelength, np.full(len(wavelength), host), Aim(tolerance), map=way, report=report)


def truth(case, at, which=0):
    s, m, host, wavelength, level = case
    k = 2 * math.pi * host / np.array(wavelength)
    nodes = Nodes(population(s), k, 1e-4)
    nodes.first = [int(1.17 * count) | 1 for count in nodes.first]
    r, w = nodes.whole(level)
    mean = np.sum(w * cross.cross_block(m, k[which] * r)[0] * math.pi * r**2)
    return batches.angular_block(m, k[which] * r, w, at, False)[0] / (k[which] ** 2 * mean)


def speed():
    """Fog, three wavelengths, 1 %: the plain loop takes nodes uniform in ln r, doubled until it meets the tolerance."""
    lxmie = optional("lxmie")
    case = CASES[sized("fog", "haze")]
    s, m, host, wavelength, _ = case
    with ThreadPoolExecutor() as threads:
        ours(case, 0.01, threads)
        seconds = []
        for _ in range(REPEATS):
            start = time.perf_counter()
            theta, found = ours(case, 0.01, threads)
            seconds.append(time.perf_counter() - start)
    own = sorted(seconds)[REPEATS // 2]
    true = truth(case, theta)
    print(f"bakery: {own:.2f} s, {len(theta)} angles, largest true error {np.abs(found[0].elements[0, 0] / true - 1).max():.4f}")
    if not lxmie:
        return
    mu = list(np.cos(theta))
    law = population(s).parts[0].law
    count = 1024
    while True:
        start = time.perf_counter()
        for w in wavelength:
            k = 2 * math.pi / w
            r = np.geomspace(s.min, s.max, count)
            weight = law.density(r) * r
            total, scattering = np.zeros(len(theta)), 0.0
            for a in range(0, count, 64):  # lists of 64 spheres: threads of the peer, bounded memory
                x = list(k * r[a : a + 64])
                efficiency, one, two = lxmie.mie_amplitudes([m.real] * len(x), [m.imag] * len(x), x, mu)
                for j, e in enumerate(efficiency):
                    total += weight[a + j] * (np.abs(one[j]) ** 2 + np.abs(two[j]) ** 2) / 2
                    scattering += weight[a + j] * e.q_sca * math.pi * r[a + j] ** 2
            if w == wavelength[0]:
                error = np.abs(total / (k**2 * scattering) / true - 1).max()
        peer = time.perf_counter() - start
        print(f"lxmie, {count} nodes: {peer:.2f} s, largest true error {error:.4f}, ratio {own / peer:.3f}", flush=True)
        if error <= 0.01 or count >= 16384:
            return
        count *= 2


def errors():
    print("\n| case | tolerance | angles | s, one core | claimed, largest | true, largest | claimed, median | true, median "
          "| above claim |")
    print("|---|---|---|---|---|---|---|---|---|")
    draw = np.random.default_rng(1)
    for name, case in ((name, CASES[name]) for name in CHOSEN):
        for tolerance in (0.01, 0.003) if name in ("fog", "dust", "narrow") else (0.01,):
            start = time.perf_counter()
            theta, found = ours(case, tolerance)
            seconds = time.perf_counter() - start
            between = np.interp(draw.random(300) * (len(theta) - 1), np.arange(len(theta)), theta)
            at = np.unique(np.concatenate([theta[:: max(1, len(theta) // 200)], theta[-20:], between]))
            f, claimed = (phase.phase_at(theta, table, at) for table in (found[0].elements[0, 0], found[0].phase_bias[0]))
            off = np.abs(f / truth(case, at) - 1)
            claimed = claimed / f
            print(f"| {name} | {tolerance:g} | {len(theta)} | {seconds:.2f} | {found[0].error[0]:.4f} | {off.max():.4f} "
                  f"| {np.median(claimed):.4f} | {np.median(off):.4f} | {100 * np.mean(off > claimed):.1f} % |", flush=True)


def model():
    print("| case | tolerance | angles | predicted | s as charged | predicted | s by the clock |\n|---|---|---|---|---|---|---|")
    spread = []
    for tolerance in (0.03, 0.01, 0.003):
        for name, case in sized(CASES | MORE, {"haze": CASES["haze"], "small": MORE["small"]}).items():
            s, m, host, wavelength, _ = case
            component = Component("spheres", np.full(len(wavelength), m, complex), population(s))
            made = expected([component], wavelength, np.full(len(wavelength), host), Aim(tolerance))[0]
            if made.seconds > 30:
                continue
            charged = [0.0]
            start = time.perf_counter()
            try:
                theta, _ = ours(case, tolerance, report=lambda seconds, error: charged.append(seconds))
            except StageError as refusal:
                print(f"| {name} | {tolerance:g} | {refusal} |")
                continue
            seconds = time.perf_counter() - start
            fixed = 0.02 + 0.005 * len(wavelength)
            spread.append((made.angles / len(theta), made.seconds / (charged[-1] + fixed)))
            print(f"| {name} | {tolerance:g} | {len(theta)} | {made.angles} | {charged[-1]:.2f} | {made.seconds:.2f} "
                  f"| {seconds:.2f} |",
     flush=True)
    for what, ratio in zip(("angles", "seconds"), np.log2(np.array(spread)).T):
        print(
    f"{what}: predicted/actual, median {2 ** np.median(ratio):.2f}, from {2 ** ratio.min():.2f} to {2 ** ratio.max():.2f}, "
    f"{100 * np.mean(np.abs(ratio) <= 1):.0f} % of {len(ratio)} within a factor of 2")


def rates():
    print("| x | cross sections, ns a term | with angles: ns a term | ns a term and angle | Mueller |\n|---|---|---|---|---|")
    for x in sized((100.0, 1000.0, 5000.0), (10.0,)):
        spheres = np.linspace(x, 1.2 * x, max(16, int(1e5 / x)))
        count, weight = float(kinds.terms(spheres).sum()), np.ones(len(spheres))

        def best(function):
            times = []
            for _ in range(15):
                start = time.perf_counter()
                function()
                times.append(time.perf_counter() - start)
            return 1e9 * min(times) / count

        few, many = np.linspace(0, math.pi, 64), np.linspace(0, math.pi, 512)
        a, b, c, d = (
    best(f) for f in (
        lambda: cross.cross_block(
            1.33, spheres), lambda: batches.angular_block(
                1.33, spheres, weight, few, False), lambda: batches.angular_block(
                    1.33, spheres, weight, many, False), lambda: batches.angular_block(
                        1.33, spheres, weight, many, True)))
        slope = (c - b) / (512 - 64)
        print(f"| {x:g} | {a:.1f} | {b - 64 * slope:.1f} | {slope:.3f} | {(d - (b - 64 * slope)) / 512:.3f} |")


def whole():
    """Claimed and true errors of integrated tolerances, against series at 1 % (drizzle: 3 %) of every angle."""
    heads = ("recipe", "measure", "tolerance", "method", "CPU s", "claimed", "true, of the light", "true, largest at an angle")
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for name in sized(("fog", "cirrus", "blowing_snow", "dust", "bubbles", "drizzle"), ("haze",)):
        exact, _, _ = baked(name, measure="pointwise", method="mie")
        settings = [("integrated", t, m) for m in ("auto", "mie") for t in ("10%", "3%", "1%")]
        settings += [("pointwise", "3%", m) for m in ("auto", "mie")]
        for measure, tolerance, method in settings:
            group, seconds, claimed = baked(name, measure, method, tolerance)
            true = measures.optics(group, exact)
            print(f"| {name} | {measure} | {tolerance} | {method} | {seconds:.3g} | {claimed:.2g} | {true['phase']:.2g} "
                  f"| {true['phase_pointwise']:.2g} |", flush=True)


def baked(name, measure, method, tolerance=None):
    """Group of `optics`, processor seconds of one core, error as claimed."""
    values = {"measure": measure, "phase.method": method} | ({"tolerance": tolerance} if tolerance else {})
    recipe = load(Path(__file__).resolve().parents[1] / "recipes" / f"{name}.yaml", values)
    start = time.process_time()
    result = optics.STAGE.compute(optics.inputs(recipe, {}), Context(recipe.tolerance, recipe.seed))
    return Group(result.members), time.process_time() - start, result.achieved_error


if __name__ == "__main__":
    if "--whole" in sys.argv:
        whole()
    elif "--rates" in sys.argv:
        rates()
    elif "--model" in sys.argv:
        model()
    else:
        speed()
        errors()
