"""Eq. 11 names one contribution an order; near the rainbow there are two."""

import numpy as np

from . import measures as of
from . import printed

BOW = 137.48  # degrees: rainbow of p = 2 at 1.33, arccos of sqrt((m^2 - 1)/3)
RADII = (10.0, 100.0, 1000.0)
M = 1.33
HOW = ("one ray", "as printed", "+ edge")
BAND = np.deg2rad(np.arange(BOW - 5, BOW + 5, 0.05))
LIT = np.deg2rad(np.arange(BOW + 0.5, BOW + 8, 0.02))


def second_order_alone(x, one):
    """Mean intensity of the rays p = 2 over sizes, just inside the rainbow (LIT)."""
    second, first = (printed.amplitudes(M, x, LIT, p, one=one, diffraction=None) for p in (2, 1))
    return 0.5 * np.mean(abs(second[0] - first[0]) ** 2 + abs(second[1] - first[1]) ** 2, axis=0)


def kept(radius):
    """Share of the light of the order p = 2 within 8 degrees inside the rainbow that its brightest ray alone carries."""
    x, _ = of.log_normal(radius, 1.02, 41)
    return float(np.sum(second_order_alone(x, True)) / np.sum(second_order_alone(x, False)))


def curves(radius, theta, sigma=1.02):
    x, weight = of.log_normal(radius, sigma, 61)
    result = {"Mie": of.exact(M, x, weight, theta)}
    for how, choice in (("one ray", True), ("as printed", False)):
        s1, s2 = printed.amplitudes(M, x, theta, 3, one=choice)
        result[how] = 0.5 * weight @ (abs(s1) ** 2 + abs(s2) ** 2)
    result["+ edge"] = of.found("+ edge", M, x, weight, theta)
    return result


def measure():
    rows = {}
    for radius in RADII:
        shapes = curves(radius, BAND)
        whole = curves(radius, of.THETA, of.SIGMA)
        rows[radius] = dict(kept=kept(radius), band=[of.rms_log10(shapes[how], shapes["Mie"]) for how in HOW],
                            rms=[of.rms_log10(whole[how], whole["Mie"]) for how in HOW])
    theta = np.deg2rad(np.arange(133, 152, 0.04))
    return dict(rows=rows, theta=theta, curves=curves(100.0, theta))


def tables(numbers):
    body = [[f"{radius:g}", f"{100 * row['kept']:.0f} %", *(of.short(v) for v in row["band"] + row["rms"])]
            for radius, row in numbers["rows"].items()]
    return {"rays": of.table(["radius, µm", "light of p = 2 that one ray keeps",
                              "rms log10 within 5° of the bow: one ray an order", "all rays", "corrected",
                              "whole pattern: one ray an order", "all rays", "corrected"], body)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.4, 3.6))
    degrees, scale = np.rad2deg(numbers["theta"]), np.median(numbers["curves"]["Mie"])
    for how, label, width in (("Mie", "Lorenz-Mie", 2.2), ("as printed", "all rays, as printed", 1.1),
                              ("one ray", "one ray an order", 1.4), ("+ edge", "Airy pair and narrow edge", 1.1)):
        axes.semilogy(degrees, numbers["curves"][how] / scale, color=of.COLOURS[how], label=label, lw=width)
    axes.set(xlabel="scattering angle, degrees", ylabel="intensity, relative", xlim=(133, 152), ylim=(0.02, 30),
             title="First rainbow of water drops, 100 µm (spread 2 %)")
    axes.legend()
    return figure
