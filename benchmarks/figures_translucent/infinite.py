"""Fig. 19: light of two and more events in an infinite medium, by tables and by the paper's diffusion."""

import numpy as np

from bakery.physics.multiple import legendre, lookup, point, solution
from benchmarks.figures_goa import measures as of

from . import stand

MEDIA = {"g = 0, albedo 0.995 (σs 2, σa 0.01)": (2 / 2.01, 0.0), "g = 0.9, albedo 0.955 (bumpy sphere, red)": (0.955, 0.9)}
ANGLES = {"ahead": 0.02, "aside": np.pi / 2, "behind": np.pi - 0.02}  # rad, of the place from where the light travels to
DISTANCES = np.array([0.3, 1.0, 3.0, 10.0, 20.0])  # mean free paths
DEPTH = 1.0  # of places beside the beam


def measure(size, share):
    """By medium: scattered light (mfp^-3) at DISTANCES by table, exactly and by diffusion, about a point and beside a beam."""
    return {name: _measured(*medium) for name, medium in MEDIA.items()}


def _measured(albedo, g):
    solved = solution.solve(albedo, legendre.henyey_greenstein(g, 400))
    baked, _, _ = stand.medium(albedo, g).multiple.segment.tables()[0]
    rows = {}
    for name, angle in ANGLES.items():
        second = _second(albedo, g, DISTANCES, angle)
        rows[f"point, {name}"] = (second + _integral(baked, DISTANCES * np.sin(angle), DISTANCES * np.cos(angle)),
                                  second + point.integral(solved.medium, DISTANCES, angle), _diffusion(albedo, g, DISTANCES))
    # of a beam that enters at the origin: exp(-s) ds of it collides at s; s - DEPTH = rho sinh x
    x, weight = np.polynomial.legendre.leggauss(200)
    low, high = np.arcsinh(-DEPTH / DISTANCES), np.arcsinh(60 / DISTANCES)
    x = (low + high) / 2 + np.outer(x, (high - low) / 2)
    s = DEPTH + DISTANCES * np.sinh(x)
    weight = np.outer(weight, (high - low) / 2) * DISTANCES * np.cosh(x) * np.exp(-s)
    r, angle = np.hypot(DISTANCES, DEPTH - s), np.arctan2(DISTANCES + 0 * s, DEPTH - s)
    second = _second(albedo, g, r, angle)
    rho = np.broadcast_to(DISTANCES, s.shape)
    rows[f"beam, aside at depth {DEPTH:g}"] = tuple(np.sum(weight * one, axis=0) for one in (
        second + _integral(baked, rho, DEPTH - s), second + point.integral(solved.medium, r, angle), _diffusion(albedo, g, r)))
    return rows


def _second(albedo, g, r, angle):
    """What light scatters at its second event, mfp^-3; its first is at the origin."""
    p = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * np.cos(angle)) ** 1.5)
    return albedo**2 * p * np.exp(-r) / r**2


def _diffusion(albedo, g, r):
    """Eq. 18 with its misprints mended: an isotropic source of the power that is left after the first event."""
    reduced = 1 - albedo * g
    d = 1 / (3 * reduced)
    return albedo**2 * np.exp(-np.sqrt((1 - albedo) / d) * r) / (4 * np.pi * d * r)


def _integral(table, rho, z, count=48):
    """Of a baked table over directions: Gauss-Legendre in the polar angle about the place's own axis."""
    x, weight = np.polynomial.legendre.leggauss(count)
    polar, azimuth = np.pi / 2 * (x + 1), np.pi / 2 * (x + 1)
    values = lookup.lobes(table, np.ravel(rho), np.ravel(z), polar, azimuth)
    solid = np.pi / 2 * weight * np.sin(polar)
    return np.einsum("nij,i,j->n", values.reshape(-1, count, count), solid, np.pi * weight).reshape(np.shape(rho))


def tables(numbers):
    body = []
    for medium, rows in numbers.items():
        shown = {}  # where nothing scatters forward, directions from a point are alike
        for source, (baked, exact, diffusion) in rows.items():
            cells = f"{100 * np.max(abs(baked / exact - 1)):.2f}", *(f"{value:.3g}" for value in diffusion / exact)
            shown.setdefault(cells, []).append(source)
        body += [[medium, sources[0] if len(sources) == 1 else "point", *cells] for cells, sources in shown.items()]
    head = ["medium", "source, place", "table: at most off, %", *(f"{r:g} mfp: diffusion over exact" for r in DISTANCES)]
    return {"fig19": of.table(head, body)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(numbers), figsize=(9, 3.2), layout="constrained")
    for (medium, rows), ax in zip(numbers.items(), axes):
        for k, (source, (baked, exact, diffusion)) in enumerate(rows.items()):
            ax.plot(DISTANCES, exact, color=f"C{k}", label=source)
            ax.plot(DISTANCES, baked, "o", color=f"C{k}")
            ax.plot(DISTANCES, diffusion, "--", color=f"C{k}")
        ax.set(xscale="log", yscale="log", xlabel="mean free paths", title=medium)
    axes[0].set_ylabel("scattered, events 2 and more, mfp⁻³")
    axes[0].legend(fontsize=7, title="lines exact, dots tables, dashes diffusion", title_fontsize=7)
    return figure
