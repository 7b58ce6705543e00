"""Eq. 13: absorption as a linear law."""

import numpy as np

from bakery import goa, mie
from benchmarks.sizes import sized

from . import measures as of
from . import printed

DEPTHS = (0.01, 0.1, 1.0, 3.0, 10.0, 100.0)  # 4 x k: optical depth of a diameter
CASES = ((1.33, 100.0), (1.33, 1000.0), (1.5, 1000.0), (0.75, 1000.0))
ALONG = np.geomspace(0.01, 100, sized(17, 3))


def ratios(n, x, depth):
    """(eq. 13, sum of all rays) over Mie: ratios of means within 10 % of x."""
    sizes, k = x * np.linspace(0.9, 1.1, 21), depth / (4 * x)
    exact = np.mean(mie.absorption(complex(n, k), sizes))
    return float(np.mean(printed.absorption(n, k, sizes)) / exact), float(np.mean(goa.absorption(complex(n, k), sizes)) / exact)


def exceeds_sphere(n):
    """Depth 4xk from which eq. 13 absorbs more light than meets the sphere; at twice that it exceeds the extinction of rays."""
    return float(1.0 / printed.absorption(n, 0.25, 1.0))


def measure():
    return dict(rows={case: [ratios(*case, depth) for depth in DEPTHS] for case in CASES},
                curves={n: [ratios(n, 1000.0, depth) for depth in ALONG] for n in (1.33, 1.5, 0.75)},
                beyond={name: exceeds_sphere(m) for name, m in of.INDICES.items()})


def tables(numbers):
    body = [[n, f"{x:g}", *(f"{of.short(a)} / {b:.3f}" for a, b in row)] for (n, x), row in numbers["rows"].items()]
    text = of.table(["index", "x", *(f"4xk = {depth:g}" for depth in DEPTHS)], body)
    return {"absorption": text + "\n\nEq. 13 absorbs more light than meets the sphere from 4xk = " + ", ".join(
        f"{of.short(value)} ({name})" for name, value in numbers["beyond"].items()) + "."}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.8, 3.5))
    for n, name in ((1.33, "water"), (1.5, "glass"), (0.75, "bubbles")):
        linear, rays = np.array(numbers["curves"][n]).T
        axes.loglog(ALONG, linear, "--", color=of.OF_INDEX[name], label=f"{name}, linear law (eq. 13)")
        axes.loglog(ALONG, rays, color=of.OF_INDEX[name], label=f"{name}, all rays summed")
    axes.axhline(1, color=of.INK, lw=0.8)
    axes.set(xlabel="optical depth of a diameter, 4 x k", ylabel="absorption / Lorenz-Mie",
             title="Absorption at size parameter 1000")
    axes.set_yticks([1, 2, 5, 10, 50], ["1", "2", "5", "10", "50"])
    axes.legend(fontsize=8)
    return figure
