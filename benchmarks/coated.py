"""Coated spheres against the textbook's formula with Bessel functions of scipy: python benchmarks/coated.py

The formula is that of Bohren & Huffman 1983, eq. 8.2, its functions taken as they are.  Errors are those against the 20 digits of
`tests/physics/coated_reference.json`; times are processor time, both in turn in one run.
"""

import json
import sys
import time
import warnings
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np  # noqa: E402
from scipy import special  # noqa: E402

from bakery.physics.mie import coated_amplitudes, coated_efficiencies, efficiencies  # noqa: E402
from bakery.physics.mie.coefficients import terms  # noqa: E402
from benchmarks.sizes import sized  # noqa: E402


def _waves(n, z):
    """psi_n, psi_n', chi_n, chi_n' of orders n (N,) at z."""
    out = []
    for function in (special.spherical_jn, lambda n, z: -special.spherical_yn(n, z)):
        f, before = z * function(n, z), z * function(n - 1, z)
        out += [f, before - n / z * f]
    return out


def textbook(core, shell, x, y):
    """q_ext, q_sca, g by the formula as it stands."""
    n = np.arange(1, int(y + 4.05 * y ** (1 / 3) + 2) + 1)
    p, dp, _, _ = _waves(n, core * x)
    p1, dp1, c1, dc1 = _waves(n, shell * x)
    p2, dp2, c2, dc2 = _waves(n, shell * y)
    p3, dp3, c3, dc3 = _waves(n, y)
    z3, dz3 = p3 - 1j * c3, dp3 - 1j * dc3
    a = (shell * p1 * dp - core * dp1 * p) / (shell * c1 * dp - core * dc1 * p)
    b = (shell * p * dp1 - core * p1 * dp) / (shell * dc1 * p - core * dp * c1)
    u, du, v, dv = p2 - a * c2, dp2 - a * dc2, p2 - b * c2, dp2 - b * dc2
    a, b = (p3 * du - shell * dp3 * u) / (z3 * du - shell * dz3 * u), (shell * p3 * dv - dp3 * v) / (shell * z3 * dv - dz3 * v)
    k = 2 * n + 1
    q_sca = 2 / y**2 * np.sum(k * (abs(a) ** 2 + abs(b) ** 2))
    g = np.sum((n * (n + 2) / (n + 1))[:-1] * (a[:-1] * a[1:].conj() + b[:-1] * b[1:].conj()).real)
    g += np.sum(k / (n * (n + 1)) * (a * b.conj()).real)
    return 2 / y**2 * np.sum(k * (a + b).real), q_sca, 4 / (y**2 * q_sca) * g


def accuracy() -> None:
    """A row for each reference case."""
    reference = json.loads((HERE.parent / "tests" / "physics" / "coated_reference.json").read_text())
    theta = np.array(reference["angles"])
    print("| core | shell | x | y | q_ext | q_abs | g | q_back | S1, S2 | textbook: q_ext, g |\n" + 10 * "|---" + "|")
    for case in reference["cases"]:
        at = complex(case["core"]), complex(case["shell"]), case["x"], case["y"]
        there = {name: float(case[name]) for name in ("q_ext", "q_sca", "q_abs", "q_back", "g")}
        ours = dict(zip(("q_ext", "q_sca", "q_abs", "q_back", "g"), coated_efficiencies(*at)))
        errors = {name: abs(ours[name] / there[name] - 1) for name in ("q_ext", "g", "q_back")}
        errors["q_abs"] = abs(ours["q_abs"] / there["q_abs"] - 1) if at[0].imag + at[1].imag else abs(ours["q_abs"])
        exact = np.array(case["amplitudes"], float).view(complex)
        error = np.max(np.max(np.abs(np.stack(coated_amplitudes(*at, theta), 1) - exact), 1) / np.max(np.abs(exact), 1))
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            q_ext, _, g = textbook(*at)
        plain = ", ".join(f"{abs(value / there[name] - 1):.0e}" for name, value in (("q_ext", q_ext), ("g", g)))
        print("| " + " | ".join([case["core"].replace("j", "i"), case["shell"].replace("j", "i"), f"{at[2]:.4g}", f"{at[3]:.5g}"]
                                + [f"{errors[name]:.0e}" for name in ("q_ext", "q_abs", "g", "q_back")]
                                + [f"{error:.0e}", plain]) + " |")


def speed() -> None:
    """Processor time a sphere, in turn."""
    print("\n| y | terms | coated, us | ns a term | homogeneous, us | textbook with scipy, us |\n|---|---|---|---|---|---|")
    core, shell = 1.95 + 0.79j, 1.43 + 1e-8j
    for y in sized((1.0, 10.0, 100.0, 1000.0), (1.0,)):
        count = max(1, int(sized(30_000, 10) / terms(y)))
        every = np.full(count, y)
        jobs = {"coated": lambda every=every: coated_efficiencies(core, shell, 0.5 * every, every),
                "plain": lambda every=every: efficiencies(shell, every),
                "textbook": lambda y=y, count=count: [textbook(core, shell, 0.5 * y, y) for _ in range(max(1, count // 20))]}
        best = dict.fromkeys(jobs, np.inf)
        for _ in range(sized(5, 1)):
            for name, job in jobs.items():
                start = time.process_time()
                job()
                best[name] = min(best[name], time.process_time() - start)
        of = {name: 1e6 * seconds / (max(1, count // 20) if name == "textbook" else count) for name, seconds in best.items()}
        print(f"| {y:g} | {terms(y)} | {of['coated']:.3g} | {1e3 * of['coated'] / terms(y):.0f} | {of['plain']:.3g} | "
              f"{of['textbook']:.3g} |")


if __name__ == "__main__":
    coated_efficiencies(1.5, 1.3, 0.5, 1.0)
    accuracy()
    with np.errstate(all="ignore"):
        speed()
