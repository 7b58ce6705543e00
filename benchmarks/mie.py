"""Lorenz-Mie against its peers: python benchmarks/mie.py

Ratios of processor time, ours over theirs, all threads together, the least of calls in turn on this machine, and the accuracy of
each on the same reference cases.
"""

import json
import os
import sys
from pathlib import Path

os.environ.setdefault("MIEPYTHON_USE_JIT", "1")  # read when miepython is imported
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np  # noqa: E402
from peers import optional, processor_seconds  # noqa: E402

from bakery.physics.mie import amplitudes, efficiencies  # noqa: E402
from benchmarks.sizes import sized  # noqa: E402


def row(job, peer, seconds, reach, limit):
    ours, theirs = seconds["bakery"], seconds[peer]
    print(f"| {job} | {peer} | {theirs * 1e3:.1f} | {ours * 1e3:.2f} | {ours / theirs:.4f} | {reach} | {limit} |", flush=True)


def speed(miepython, lxmie):
    print("| job | peer | peer, ms | bakery, ms | ratio | reach | limit |\n|---|---|---|---|---|---|---|")
    x = np.linspace(0.1, 1000, sized(10_000, 20))
    jobs = {"bakery": lambda: efficiencies(1.33, x)}
    if miepython:
        jobs["miepython"] = lambda: miepython.efficiencies_mx(1.33, x)
        row("efficiencies, 10,000 x in 0.1..1000, m = 1.33", "miepython", processor_seconds(jobs, sized(15, 1)), 0.5, 0.03)
    if not lxmie:
        return
    radii, theta = np.linspace(1, 1000, sized(100, 2)), np.linspace(0, np.pi, sized(1000, 10))
    n, k, x_list, mu = [1.33] * radii.size, [0.0] * radii.size, list(radii), list(np.cos(theta))
    row("S1, S2 at 1000 angles, 100 radii, x 1..1000", "lxmie", processor_seconds({
        "bakery": lambda: amplitudes(1.33, radii, theta),
        "lxmie": lambda: lxmie.mie_amplitudes(n, k, x_list, mu)}, sized(10, 1)), 0.08, 0.01)
    theta = np.linspace(0, np.pi, 1801)
    mu = list(np.cos(theta))
    for size, rounds in sized(((20_000.0, 8), (200_000.0, 4)), ((2000.0, 1),)):
        row(f"S1, S2 at 1801 angles, x = {size:,.0f}", "lxmie", processor_seconds({
            "bakery": lambda size=size: amplitudes(1.33, size, theta),
            "lxmie": lambda size=size: lxmie.mie_amplitudes(1.33, 0.0, size, mu)}, rounds), 0.05, 0.005)


def accuracy(miepython, lxmie):
    """Relative errors of the reference cases: q_ext, g, and the worst of S1, S2 over its local maximum."""
    reference = json.loads((HERE.parent / "tests" / "physics" / "mie_reference.json").read_text())
    mu = reference["cos_theta"]
    print("\n| x | m | program | q_ext | g | q_back | S1, S2 |\n|---|---|---|---|---|---|---|")
    for case in reference["cases"]:
        x, m = float(case["x"]), complex(*map(float, case["m"]))
        s1, s2 = (np.array([complex(float(a), float(b)) for a, b in case[key]]) for key in ("S1", "S2"))
        local = np.maximum(abs(s1), abs(s2))

        def show(name, q_ext, g, q_back, one, two):
            errors = [abs(q_ext / float(case["Qext"]) - 1), abs(g / float(case["g"]) - 1)]
            errors.append(abs(q_back / float(case["Qback"]) - 1) if q_back is not None else np.nan)
            errors.append(max(np.max(abs(one - s1) / local), np.max(abs(two - s2) / local)) if one is not None else np.nan)
            print(f"| {x:g} | {m:g} | {name} | " + " | ".join("-" if np.isnan(e) else f"{e:.0e}" for e in errors) + " |")

        q_ext, _, q_back, g = efficiencies(m, x)
        show("bakery", q_ext, g, q_back, *amplitudes(m, x, np.arccos(mu)))
        if miepython:
            q_ext, _, q_back, g = miepython.efficiencies_mx(m.conjugate(), x)
            show("miepython", q_ext, g, q_back, None, None)
        if lxmie:
            result, one, two = lxmie.mie_amplitudes(m.real, m.imag, x, mu)
            show("lxmie", result.q_ext, result.asymmetry_parameter, None, np.conj(one), np.conj(two))


if __name__ == "__main__":
    peers = optional("miepython"), optional("lxmie")
    speed(*peers)
    accuracy(*peers)
