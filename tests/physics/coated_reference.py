"""Coated spheres by the textbook's closed form in as many digits as it takes: what `coated_reference.json` holds.

    python -m tests.physics.coated_reference      writes it again (minutes)

Source: Bohren & Huffman 1983, eqs. 8.2 and 4.61 to 4.77, with mpmath.
"""

import json
import math
from pathlib import Path

import mpmath as mp

FILE = Path(__file__).with_suffix(".json")
ANGLES = (0.0, 0.02, 0.7, 1.5707963, 2.4, 3.1)
# core, shell, size parameters of core and whole
CASES = [
    ("1.59+0.66j", "1.409+0.1747j", 2 * math.pi * 0.171 / 3, 2 * math.pi * 6.265 / 3),  # the example of the textbook's appendix B
    ("1.5+0j", "1.33+0j", 1e-4, 2e-4), ("1.95+0.79j", "1.43+1e-8j", 0.01, 0.1), ("1.95+0.79j", "1.43+1e-8j", 0.3, 0.6),
    ("0.055+3.42j", "1.5+0j", 0.8, 1.0), ("1.5+0j", "0.055+3.42j", 0.8, 1.0), ("1.33+0j", "1.5+1j", 2.0, 10.0),
    ("1.95+0.79j", "1.33+1e-9j", 3.0, 10.0), ("1.0+0j", "1.33+0j", 9.0, 10.0), ("1.53+0.008j", "1.33+0j", 1e-3, 10.0),
    ("1.33+0j", "1.3300001+0j", 5.0, 10.0), ("1.0003+0j", "1.001+1e-6j", 40.0, 50.0), ("1.33+1e-9j", "1.5+0.1j", 99.9, 100.0),
    ("1.95+0.79j", "1.33+1e-9j", 30.0, 100.0), ("2+1j", "1.5+0.3j", 60.0, 100.0), ("0.75+0j", "1.33+0j", 50.0, 100.0),
    ("1.5+0.1j", "1.33+0.003j", 200.0, 400.0), ("1.95+0.79j", "1.33+1e-8j", 900.0, 1000.0), ("1.33+0j", "1.5+1j", 990.0, 1000.0),
    ("1.5+0j", "1.33+0j", 999.0, 1000.0), ("3+4j", "2+2j", 500.0, 1000.0), ("1.5+1e-4j", "1.33+1e-5j", 4900.0, 5000.0),
]


def _waves(z, count):
    """psi_n and chi_n of n = 0 .. count, with the signs of `bakery.physics.mie.series`."""
    psi, chi = [mp.sin(z), mp.sin(z) / z - mp.cos(z)], [mp.cos(z), mp.cos(z) / z + mp.sin(z)]
    for n in range(1, count):
        for f in (psi, chi):
            f.append((2 * n + 1) / z * f[n] - f[n - 1])
    return psi, chi


def _digits(z, count):
    """Digits that psi loses when it goes upward."""
    size = abs(z)
    rise = sum(math.log10(max(1.0, 2 * n / size)) for n in range(1, count)) if size < 2 * count else 0.0
    return int(2 * rise + 2 * abs(complex(z).imag) / 2.3) + 60


def coated(core, shell, x, y, angles=ANGLES):
    """q_ext, q_sca, q_abs, q_back, g, and (S1, S2) at the angles."""
    count = math.ceil(y + 7.5 * y ** (1 / 3)) + 3
    with mp.workdps(max(_digits(complex(m) * r, count) for m, r in ((core, x), (shell, x), (shell, y), (1, y)))):
        m1, m2, x, y = mp.mpc(core), mp.mpc(shell), mp.mpf(x), mp.mpf(y)
        inner, near, far, out = _waves(m1 * x, count), _waves(m2 * x, count), _waves(m2 * y, count), _waves(y, count)

        def slope(f, z, n):
            return f[n - 1] - n / z * f[n]

        a, b = [], []
        for n in range(1, count):
            p, dp = inner[0][n], slope(inner[0], m1 * x, n)
            (p1, dp1), (c1, dc1) = ((f[n], slope(f, m2 * x, n)) for f in near)
            (p2, dp2), (c2, dc2) = ((f[n], slope(f, m2 * y, n)) for f in far)
            (p3, dp3), (c3, dc3) = ((f[n], slope(f, y, n)) for f in out)
            x3, dx3 = p3 - 1j * c3, dp3 - 1j * dc3
            for of, top, bottom in ((a, m2 * p1 * dp - m1 * dp1 * p, m2 * c1 * dp - m1 * dc1 * p),
                                    (b, m2 * p * dp1 - m1 * p1 * dp, m2 * dc1 * p - m1 * dp * c1)):
                t = top / bottom
                u, du = p2 - t * c2, dp2 - t * dc2
                of.append((p3 * du - m2 * dp3 * u) / (x3 * du - m2 * dx3 * u) if of is a
                          else (m2 * p3 * du - dp3 * u) / (m2 * x3 * du - dx3 * u))
        return _sums(a, b, y, angles)


def _sums(a, b, y, angles):
    """Efficiencies and amplitudes of coefficients."""
    terms = list(enumerate(zip(a, b), 1))
    q_ext = 2 / y**2 * mp.fsum((2 * n + 1) * mp.re(p + q) for n, (p, q) in terms)
    q_sca = 2 / y**2 * mp.fsum((2 * n + 1) * (abs(p) ** 2 + abs(q) ** 2) for n, (p, q) in terms)
    back = mp.fsum((2 * n + 1) * (-1) ** n * (p - q) for n, (p, q) in terms)
    g = mp.fsum(mp.mpf(2 * n + 1) / (n * (n + 1)) * mp.re(p * mp.conj(q)) for n, (p, q) in terms)
    g += mp.fsum(mp.mpf(n * (n + 2)) / (n + 1) * mp.re(p * mp.conj(r) + q * mp.conj(s))
                 for (n, (p, q)), (_, (r, s)) in zip(terms, terms[1:]))
    amplitudes = []
    for theta in angles:
        mu, s1, s2 = mp.cos(mp.mpf(theta)), mp.mpf(0), mp.mpf(0)
        before, pi = mp.mpf(0), mp.mpf(1)
        for n, (p, q) in terms:
            tau = n * mu * pi - (n + 1) * before
            weight = mp.mpf(2 * n + 1) / (n * (n + 1))
            s1, s2 = s1 + weight * (p * pi + q * tau), s2 + weight * (p * tau + q * pi)
            before, pi = pi, ((2 * n + 1) * mu * pi - (n + 1) * before) / n
        amplitudes.append((s1, s2))
    return q_ext, q_sca, q_ext - q_sca, abs(back) ** 2 / y**2, 4 / (y**2 * q_sca) * g, amplitudes


def main() -> None:
    """Writes the file."""
    out = []
    for core, shell, x, y in CASES:
        *figures, amplitudes = coated(complex(core), complex(shell), x, y)
        out.append({"core": core, "shell": shell, "x": x, "y": y,
                    **{name: mp.nstr(value, 20) for name, value in zip(("q_ext", "q_sca", "q_abs", "q_back", "g"), figures)},
                    "amplitudes": [[mp.nstr(part, 20) for s in pair for part in (mp.re(s), mp.im(s))] for pair in amplitudes]})
        print(core, shell, x, y, flush=True)
    FILE.write_text(json.dumps({"angles": ANGLES, "cases": out}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
