"""What each correction of `bakery.goa` buys, by its switches."""

import numpy as np

from bakery import goa
from benchmarks.sizes import sized

from . import measures as of

SWITCHES = {
    "floors + taper": of.PLAIN,
    "rainbow alone": dict(rainbow=True, axis=False, edge=None),
    "axis alone": dict(rainbow=False, axis=True, edge=None),
    "edge alone": dict(rainbow=False, axis=False, edge="narrow"),
    "rainbow + axis": dict(edge=None),
    "all, narrow edge": dict(edge="narrow"),
    "all, wide edge": dict(edge="wide"),
}
COLOUR = dict(zip(SWITCHES, ("#c99a06", "#c2410c", "#8a8f98", "#4fb0ae", "#2a7fba", "#2b8a4b", "#7b4fb5")))
RADII = (10.0, 100.0, 1000.0)
ALONG = sized((2.0, 5.0, 10.0, 30.0, 100.0, 300.0, 1000.0), (10.0, 100.0, 1000.0))


def errors(m, radius):
    """{switches: (rms log10, L1)} of a log-normal average; six orders."""
    x, weight = of.log_normal(radius, nodes=71)
    by_switches, out, solid = {}, np.empty(of.THETA.size), np.sin(of.THETA)
    exact = of.exact(m, x, weight, of.THETA)
    for name, options in SWITCHES.items():
        goa.intensity_block(m, x, weight, of.THETA, out, 6, **options)
        by_switches[name] = float(of.rms_log10(out, exact)), float(np.sum(abs(out - exact) * solid) / np.sum(exact * solid))
    return by_switches


def measure():
    cells = [(name, radius) for name in of.INDICES for radius in ALONG]
    return dict(zip(cells, of.together(lambda name, radius: errors(of.INDICES[name], radius), cells)))


def tables(numbers):
    columns = [which for which in SWITCHES if "alone" not in which]  # those are in the picture
    body = [[name, f"{radius:g}", *(" / ".join(map(of.short, numbers[name, radius][which])) for which in columns)]
            for name in of.SHOWN for radius in RADII]
    return {"corrections": of.table(["", "radius, µm", *columns], body)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(9.2, 6.2), sharex=True, sharey=True)
    for panel, name in zip(axes.flat, of.INDICES):
        for which in SWITCHES:
            alone = "alone" in which  # drawn over the wide lines that they mostly coincide with
            panel.loglog(ALONG, [numbers[name, radius][which][0] for radius in ALONG], "o--" if alone else "o-", ms=3,
                         label=which, color=COLOUR[which], lw=1.2 if alone or "all" in which else 3, zorder=3 if alone else 2)
        panel.set(title=f"{name.capitalize()}, index {of.INDICES[name]}")
        panel.set_xticks([2, 10, 100, 1000], ["2", "10", "100", "1000"])
    for panel in axes[1]:
        panel.set_xlabel("median radius, µm")
    for panel in axes[:, 0]:
        panel.set_ylabel("rms log10 of intensity")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncol=4)
    return figure
