"""Fig. 13: the best Henyey-Greenstein lobe against the real phase function, in several norms."""

import numpy as np
from scipy.optimize import minimize_scalar

from . import measures as of

M = 1.31  # the paper's scene is ice
RADII = (5.0, 100.0, 1000.0)
CUT = 1.0  # degrees: light that an eye cannot tell from unscattered light, for "without the peak"


def lobe(g, theta):
    """1/sr."""
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * np.cos(theta)) ** 1.5)


def real(radius):
    """theta, phase function (1/sr, integral 1) by Mie, log-normal."""
    x, weight = of.log_normal(radius)
    theta = of.sphere_grid(x.max())
    light = of.exact(M, x, weight, theta)
    return theta, light / np.sum(light * of.solid_angle(theta))


NORMS = {
    "same g": None,
    "least L1": lambda f, h, solid: np.sum(abs(f - h) * solid),
    "least rms log10": lambda f, h, solid: np.sum(np.log10(f / h) ** 2 * solid),
    "least squares": lambda f, h, solid: np.sum((f - h) ** 2 * solid),
}


def fits(theta, phase):
    """{norm: (g, L1, rms log10 over solid angle)} of the best lobe in each norm."""
    solid = of.solid_angle(theta)
    phase = phase / np.sum(phase * solid)
    rows = {}
    for name, norm in NORMS.items():
        if norm is None:
            g = float(np.sum(phase * np.cos(theta) * solid))
        else:
            tries = 1 - np.geomspace(1e-5, 1, 200)
            cost = [norm(phase, lobe(v, theta), solid) for v in tries]
            at = int(np.argmin(cost))
            low, high = tries[min(at + 1, tries.size - 1)], tries[max(at - 1, 0)]
            g = float(minimize_scalar(lambda v: norm(phase, lobe(v, theta), solid), bounds=(low, high), method="bounded").x)
        found = lobe(g, theta)
        log = np.sqrt(np.sum(np.log10(phase / found) ** 2 * solid) / np.sum(solid))
        rows[name] = (g, float(np.sum(abs(phase - found) * solid)), float(log))
    return rows


def without_peak(theta, phase):
    far = theta > np.deg2rad(CUT)
    return theta[far], phase[far]


def measure():
    rows, curves = {}, {}
    for radius in RADII:
        curves[radius] = real(radius)
        rows[f"{radius:g} µm"] = fits(*curves[radius])
    rows[f"1000 µm, beyond {CUT:g}°"] = fits(*without_peak(*curves[1000.0]))
    return dict(rows=rows, curves=curves)


def tables(numbers):
    body = [[name, *(f"{g:.4f}: {of.short(a)} / {of.short(b)}" for g, a, b in row.values())]
            for name, row in numbers["rows"].items()]
    return {"fig13": of.table(["ice, log-normal; g: L1 / rms log10", *NORMS], body)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(10.4, 3.6))
    style = dict(zip(NORMS, (("#c99a06", "-"), ("#c2410c", "-"), ("#2a7fba", "-"), ("#b23a6f", ":"))))
    cases = [("5 µm", *numbers["curves"][5.0]), ("1000 µm", *numbers["curves"][1000.0]),
             (f"1000 µm, beyond {CUT:g}°", *without_peak(*numbers["curves"][1000.0]))]
    for panel, (name, theta, phase) in zip(axes, cases):
        phase = phase / np.sum(phase * of.solid_angle(theta))
        panel.loglog(np.rad2deg(theta), phase, color=of.INK, label="Lorenz-Mie", lw=1.8)
        for norm, (g, _, _) in numbers["rows"][name].items():
            colour, line = style[norm]
            panel.loglog(np.rad2deg(theta), lobe(g, theta), line, color=colour, label=f"{norm}, g = {g:.4g}", lw=1.2)
        panel.set(xlabel="scattering angle, degrees", title=f"Ice, {name}", ylim=(phase.min() / 8, phase.max() * 4))
        panel.legend(fontsize=7, loc="lower left")
    axes[0].set_ylabel("phase function, 1/sr")
    return figure
