"""Kernels of a narrow beam against photons: python benchmarks/beam.py [--photons N] [--layers | --pictures]

Root mean square error of 2 pi r Psi over ten planes (0.5 to 5 mfp) and fifty rings (to 5 mfp), relative, less the photons' noise:
forward light as flux | as fluence.  Then layers of unequal density against photons, in space and in the small-angle model, and
what a look-up and a table cost.  `--layers` does only these; `--pictures` draws errors over albedo and spread.
"""

import math
import sys
import time

import numpy as np

from bakery.physics.beam import build, kernels, moments, named, photons, small_angle, table
from bakery.physics.medium import analytic
from benchmarks.sizes import docs, sized
from tests.oracles import beam as oracle

DEPTH, EDGES = np.arange(1, 11) / 2, np.linspace(0, 5, 51)
ALBEDOS = sized((0.1, 0.5, 0.9, 1.0), (0.9,))
SPREADS = sized((3, 10, 20, 30, 45, 60, 90), (30,))  # degrees, sqrt(4 B)
HG = sized((0.8, 0.9, 0.95), (0.8,))
# densities of four layers of 1 mfp
STACKS = sized(((1, 1, 1, 1), (2, 0, 0, 2), (0, 0, 3, 0), (3, 0.5, 0.2, 0.1), (0.1, 0.2, 0.5, 3)), ((2, 0, 0, 2),))
# least error of any kernel before transport, by spread in degrees and albedo: flux, fluence, percent
BEST_KNOWN = {(30, 0.1): (5, 6), (30, 0.5): (6, 8), (30, 0.9): (14, 13), (10, 0.9): (2, 3), (20, 0.9): (6, 8),
              (45, 0.9): (25, 18), (60, 0.9): (31, 21)}
DRAWN = {"transport": ("#1f77a4", "-"), "small-angle, absorption": ("#2f8f5b", "-"), "small-angle": ("#2f8f5b", (0, (1, 1.2))),
         "erf": ("#b3541e", "-"), "single": ("#5d6875", (0, (1, 1.2))), "path integral": ("#8a4fbf", (0, (5, 2))),
         "Elek": ("#c2378a", (0, (2, 1.5)))}
WORDS = {"erf": "error function, corrected", "single": "scattered once", "Elek": "Elek et al., approximate",
         "small-angle": "small-angle model", "small-angle, absorption": "small-angle model, absorption"}


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
    return named.ring_averages(kernel, DEPTH, EDGES)


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
            return kernels.erf_kernel(*kernels.erf_parameters(M0, constant / 1.5 * oracle.printed_mean_square(z, albedo, B)), r)
        return of(kernel)

    def absorbed(z, r, M0, q):
        weight, shrink = moments.absorbed(z, albedo, loss, B)
        return kernels.erf_kernel(*kernels.erf_parameters(M0 * weight, q * shrink), r)

    def erf(z, r, M0, q):
        return kernels.erf_kernel(*kernels.erf_parameters(M0, q), r)

    return {"single": of(lambda z, r, M0, q: oracle.single_kernel(z, albedo, z, B, r)),
            "printed M2, 3/2": printed(1.5), "printed M2, 3": printed(3.0), "erf": of(erf), "erf, absorption": of(absorbed),
            "single + Gaussian": of(lambda z, r, M0, q: oracle.single_and_gaussian(z, albedo, loss, B, r)),
            "path integral": of(lambda z, r, M0, q: kernels.path_integral(z, albedo, loss, B, M0, r)),
            "Elek": of(lambda z, r, M0, q: kernels.elek(z, albedo, B, M0, r)),
            "Gaussian": of(lambda z, r, M0, q: kernels.gaussian_kernel(M0, q, r))}


def compare(theta, phase, albedo, count, B=None, of=None, everything=True):
    """Errors (flux, fluence) of every kernel, and the noise of the photons."""
    counted = oracle.count(albedo, theta, phase, DEPTH, EDGES, count, back=False)
    everything = oracle.count(albedo, theta, phase, DEPTH, EDGES, count) if everything else None
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
        if everything is not None:
            whole = photons.rms(tables["fluence"].rings(DEPTH, EDGES), everything, "fluence")[0]
            result["transport, all directions"] = math.nan, whole
    for name, (flux, fluence) in averages.items():
        result[name] = photons.rms(flux, counted, "flux")[0], photons.rms(fluence, counted, "fluence")[0]
    return result, photons.rms(counted.flux, counted, "flux")[1], photons.rms(counted.fluence, counted, "fluence")[1]


def accuracy(count):
    rows = [(f"{spread}, {albedo:g}", *gaussian(spread), albedo) for spread in SPREADS for albedo in ALBEDOS]
    names = None
    print("Percent, forward light, flux | fluence\n")
    for label, theta, phase, B, albedo in rows:
        result, *noise = compare(theta, phase, albedo, count, B, oracle.gaussian(B))
        names = names or _head("spread, albedo", result)
        _row(label, result, noise)
    print()
    names = None
    for g in HG:
        theta, phase = henyey_greenstein(g)
        for albedo in sized((0.5, 0.9), (0.9,)):
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
    """Layers in the small-angle model, by its own photons: the exact kernel and the homogeneous one with the same moments."""
    B, albedo, edges = math.radians(30) ** 2 / 4, 0.9, np.linspace(0, 4, 5)
    z, ratio = table.grid(8, math.sqrt(B))
    kernel = small_angle.homogeneous(oracle.gaussian(B), albedo, z, ratio)
    homogeneous = table.Table(z, ratio, kernel * z[:, None] ** 2 * ratio)
    print("\nSmall-angle photons (nothing absorbed), spread 30 degrees, four layers of 1 mfp: percent\n")
    print("| density | exact | homogeneous, stretched | noise |\n|---|---|---|---|")
    for density in STACKS:
        density = np.array(density, float)
        S = moments.layered_levers(edges, albedo * density)
        value, error, _, _ = oracle.count_small_angle(
            S[0][-1], lambda random, n: np.sqrt(-4 * B * np.log1p(-random.random(n))), edges, density, 4.0, EDGES, count)
        tau = density.sum()
        exact = behind(lambda r, d=density: small_angle.layered(oracle.gaussian(B), albedo, edges, d, r.ravel()).reshape(r.shape))
        stretched = behind(lambda r, S=S, tau=tau: homogeneous.stretched(tau, math.sqrt(3 * S[1][-1] / S[0][-1]), r))
        r = (EDGES[1:] + EDGES[:-1]) / 2
        whole = np.sum((r * value) ** 2)
        noise = math.sqrt(np.sum((r * error) ** 2) / whole)
        found = [math.sqrt(max(np.sum((r * (one * math.exp((1 - albedo) * tau) - value)) ** 2) / whole - noise**2, 0.0))
                 for one in (exact, stretched)]
        print("| " + ", ".join(f"{x:g}" for x in density) + " | " + " | ".join(f"{100 * x:.1f}" for x in (*found, noise)) + " |")


def behind(kernel):
    """Averages of kernel(r) over the rings, (R,)."""
    return named.ring_averages(lambda z, r: kernel(r), [0.0], EDGES)[0]


def stacks(count):
    """Layers in space: photons through four layers of 1 mfp, planes at the ends of those that scattered light reaches."""
    print("\nPhotons in space, four layers of 1 mfp, the last going on, planes at the ends of layers: percent, forward light\n")
    print("| medium, albedo, density | layered | transport, stretched | small-angle, exact | small-angle, stretched | noise |")
    print("|---|---|---|---|---|---|")
    media = [(f"{spread} degrees", *gaussian(spread)[:2]) for spread in sized((10, 30, 60), ())]
    media += [("g = 0.8", *henyey_greenstein(0.8))]
    for label, theta, phase in media:
        medium = build.prepare(theta, phase)
        for albedo in sized((0.5, 0.9, 1.0), (0.9,)):
            tables = build.transport_tables(medium, albedo, 8.0) | {"small_angle": build.small_angle_table(medium, albedo, 8.0)}
            kernel = named.Kernels(albedo, theta, phase, medium.planar.B, True, tables.__getitem__)
            for density in STACKS:
                planes = np.arange(1.0, 5.0)[np.cumsum(density) > 0]
                counted = oracle.count(albedo, theta, phase, planes, EDGES, count, back=False, layers=(np.arange(4.0), density))
                found = {}
                for measure, name in (("flux", "flux"), ("fluence", "forward")):
                    rows = [[], [], [], []]
                    for z in planes.astype(int):
                        stack = np.ones(z), density[:z]
                        edges = np.arange(z + 1.0)
                        S = moments.layered_levers(edges, np.array(density[:z], float))
                        alike = S[0][-1], math.sqrt(3 * S[1][-1] / S[0][-1])
                        for row, of in zip(rows, (
                                lambda r, stack=stack, name=name: kernel.layered(*stack, r, name),
                                lambda r, alike=alike, name=name: tables[name].stretched(*alike, r),
                                lambda r, stack=stack: kernel.layered(*stack, r, "small_angle"),
                                lambda r, alike=alike: tables["small_angle"].stretched(*alike, r)), strict=True):
                            row.append(behind(of))
                    found[measure] = [photons.rms(row, counted, measure)[0] for row in rows] + [
                        photons.rms(counted.flux, counted, measure)[1]]
                _row(f"{label}, {albedo:g}, " + " ".join(f"{x:g}" for x in density),
                     dict(enumerate(zip(found["flux"][:-1], found["fluence"][:-1], strict=True))),
                     (found["flux"][-1], found["fluence"][-1]))


def pictures(count):
    """Errors over albedo at a spread of 30 degrees, and over spread at albedo 0.9, into docs/pictures."""
    from matplotlib.figure import Figure

    from bakery.draw.style import INK, look, saved

    albedos = sized((0.05, *np.arange(1, 10) / 10, 0.95, 1.0), (0.5, 0.9))
    spreads = sized((0.5, 1, 2, 3, 5, 10, 15, 20, 30, 45, 60, 75, 90), (10, 30))
    for name, values, label, known in (
            ("beam_albedo", albedos, "albedo", {albedo: found for (spread, albedo), found in BEST_KNOWN.items() if spread == 30}),
            ("beam_spread", spreads, "spread of the phase function (degrees)",
             {spread: found for (spread, albedo), found in BEST_KNOWN.items() if albedo == 0.9})):
        rows = []
        for value in values:
            spread, albedo = (30, value) if name == "beam_albedo" else (value, 0.9)
            theta, phase, B = gaussian(spread)
            rows.append(compare(theta, phase, float(albedo), count, B, oracle.gaussian(B), everything=False))
        behind = [(label, value) for value, (result, *_) in zip(values, rows, strict=True) for k in (0, 1)
                  for other in ("erf", "path integral") if "transport" in result and result["transport"][k] >= result[other][k]]
        print(f"{name}: transport is " + (f"not ahead at {behind}" if behind else "ahead of error function and path integral"))
        with look(name):
            figure = Figure(figsize=(10.4, 4.6))
            panels = figure.subplots(1, 2, sharex=True, sharey=True)
            for k, (axes, title) in enumerate(zip(panels, ("Power through a surface (flux)", "Forward fluence"), strict=True)):
                for kernel, (ink, line) in DRAWN.items():
                    at = [(value, 100 * result[kernel][k]) for value, (result, *_) in zip(values, rows, strict=True)
                          if kernel in result]
                    axes.plot(*np.maximum(at, (0, 0.1)).T, color=ink, linestyle=line, marker="o", markersize=3,
                              linewidth=2.4 if kernel == "transport" else 1.4, label=WORDS.get(kernel, kernel))
                axes.plot(list(known), [found[k] for found in known.values()], "*", color=INK, markersize=9, linestyle="none",
                          label="best kernel before transport")
                axes.fill_between(values, 0.1, [100 * noise[k] for _, *noise in rows], color="#dfe3e8", zorder=0,
                                  label="noise of the photons")
                axes.set(yscale="log", ylim=(0.1, 300), xlabel=label)
                if name == "beam_spread":
                    axes.set(xscale="log")
                    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
                axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
                axes.set_title(title)
            panels[0].set_ylabel("error against photons (%)")
            figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
            said = "spread 30°" if name == "beam_albedo" else "albedo 0.9"
            figure.suptitle(f"Kernels of narrow beams to 5 mean free paths, {said}", x=0.01, ha="left", fontsize=10.5,
                            fontweight="bold")
            path = docs() / "pictures" / f"{name}.png"
            path.write_bytes(saved(figure, ("png",))["png"])
        print(path)


def speed(repeats=sized(5, 1), count=sized(1_000_000, 1000)):
    theta, phase, B = gaussian(30)
    medium = build.prepare(theta, phase)
    tables = build.transport_tables(medium, 0.9, 32)
    rng = np.random.default_rng(0)
    z, r = rng.uniform(0.01, 32, count), rng.uniform(0.001, 10, count)
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
    count = int(sys.argv[sys.argv.index("--photons") + 1]) if "--photons" in sys.argv else sized(200_000, 3200)
    if "--pictures" in sys.argv:
        pictures(count)
        sys.exit()
    if "--layers" not in sys.argv:
        accuracy(count)
    stacks(count)
    layers(count)
    if "--layers" not in sys.argv:
        speed()
