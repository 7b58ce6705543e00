"""Fig. 20: time against the number of particles, to equal noise."""

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

COUNTS = sized((30_000, 100_000, 1_000_000), (1000, 3000))
RADIUS = sized(50.0, 500.0)  # um
METHODS = ("particles", "explicit", "query")
PASSES = sized({"walk": 48, "splat": 2}, {"walk": 24, "splat": 2})
NOISE = 0.01


def cost(parts):
    """Processor time (s) to `NOISE` where each part has the passes that make the sum cheapest (Lagrange)."""
    return sum((seconds * variance) ** 0.5 for seconds, variance in parts.values()) ** 2 / NOISE**2


def measure():
    found = {}
    for count in COUNTS:
        made = stand.asset(stand.single(RADIUS), count)
        for method in METHODS:
            found[count, method] = stand.parts(made, method, PASSES)
    return found


def tables(numbers):
    body = []
    for count in COUNTS:
        of_all = {method: cost(numbers[count, method]) for method in METHODS}
        single = cost({"splat": numbers[count, "particles"]["splat"]})
        body.append([f"{count:,}", of.short(single), *(of.short(of_all[method]) for method in METHODS),
                     of.short(of_all["particles"] / of_all["explicit"]),
                     *(of.short(of_all[method] / of_all["query"]) if of_all["query"] else "-" for method in METHODS[:2])])
    head = ["particles", "splats alone, s", *(f"{method}, s" for method in METHODS), "particles over explicit",
            "particles over query", "explicit over query"]
    return {"fig20": of.table(head, body)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5, 3))
    for method, line in zip(METHODS, ("o-", "s--", "^:")):
        axes.loglog(COUNTS, [cost(numbers[count, method]) for count in COUNTS], line, color=of.INK, label=method)
    axes.set(xlabel="particles", ylabel="s", title=f"Processor time to 1 % noise, {stand.PIXELS} x {stand.PIXELS} pixels")
    axes.legend(fontsize=8)
    return figure
