"""Fig. 20: time against the number of particles, to equal noise."""

from __future__ import annotations

from benchmarks.figures_goa import measures as of

from . import stand

COUNTS = (30_000, 100_000, 1_000_000)
RADIUS = 50.0  # um
METHODS = ("particles", "explicit", "query")
SECONDS = 20


def measure():
    found = {}
    for count in COUNTS:
        made = stand.asset(stand.single(RADIUS), count)
        for method in METHODS:
            found[count, method] = stand.picture(made, method, seconds=SECONDS)
    return found


def tables(numbers):
    body = [[f"{count:,}", *(of.short(numbers[count, method].cost) for method in METHODS),
             *(of.short(numbers[count, "particles"].cost / numbers[count, method].cost) for method in ("explicit", "query")),
             of.short(numbers[count, "query"].cost / numbers[count, "explicit"].cost)] for count in COUNTS]
    head = ["particles", *(f"{method}: s to 1 % noise" for method in METHODS), "particles over explicit", "particles over query",
            "query over explicit"]
    return {"fig20": of.table(head, body)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5, 3))
    for method, line in zip(METHODS, ("o-", "s--", "^:")):
        axes.loglog(COUNTS, [numbers[count, method].cost for count in COUNTS], line, color=of.INK, label=method)
    axes.set(xlabel="particles", ylabel="s", title=f"Processor time to 1 % noise, {stand.PIXELS} x {stand.PIXELS} pixels")
    axes.legend(fontsize=8)
    return figure
