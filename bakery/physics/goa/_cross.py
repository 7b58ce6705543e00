"""The ray integral of absorption."""

import numpy as np

from bakery.system.compiled import njit

STRICT = dict(cache=True, nogil=True, error_model="numpy")


@njit(**STRICT)
def _lost(m, x, sin2, cos, bubble):
    """Share of a ray that is absorbed, mean of both polarisations; in total reflection, what is not reflected."""
    square = m * m - sin2
    w = np.sqrt(square)
    n, k = m.real, m.imag
    total = bubble and sin2 > n * n
    depth = 50.0 if total else 4.0 * x * k * np.sqrt(max(1.0 - sin2 / (n * n), 0.0))
    if not bubble and k > 0.0:  # the true bending: N sin tt = sin ti, N the effective index
        real = w.real * w.real
        depth = 4.0 * x * w.imag * real / (real + sin2)
    absorptance = -np.expm1(-depth)
    mm = m * m
    # 1 - |r|^2 from its own digits
    through1 = 4.0 * cos * w.real / abs(cos + w) ** 2
    through2 = 4.0 * cos * (mm * np.conj(w)).real / abs(mm * cos + w) ** 2
    absorbed = 0.0
    for through in (through1, through2):
        if through > 0.0 and absorptance > 0.0:
            absorbed += through * absorptance / (through + (1.0 - through) * absorptance)
    return 0.5 * absorbed


@njit(**STRICT)
def absorption_block(m, x, nodes, weights, q):
    """q (R,) of the spheres m, x (R,) by Gauss-Legendre nodes in the angle of incidence."""
    for r in range(x.shape[0]):
        q[r] = 0.0
        if np.isinf(m[r].real) or m[r].imag == 0.0:
            continue
        bubble = m[r].real < 1.0
        split = np.arcsin(m[r].real) if bubble else 0.5 * np.pi
        for part in range(2 if bubble else 1):
            low, high = (split, 0.5 * np.pi) if part == 1 else (0.0, split)
            half = 0.5 * (high - low)
            for i in range(nodes.shape[0]):
                t = low + half * (1.0 + nodes[i])
                s = np.sin(t)
                q[r] += weights[i] * half * np.sin(2.0 * t) * _lost(m[r], x[r], s * s, np.cos(t), bubble)
