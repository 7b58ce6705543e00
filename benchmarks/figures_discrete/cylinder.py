"""Fig. 16: what the cross section of the query cylinder does to the picture."""

import numpy as np

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

SHARES = (0.1, 0.2, 0.5, 1.0, 3.0, 10.0, 30.0)
COUNT, DEPTH = sized(20_000, 500), 0.5


def measure():
    made = stand.asset(stand.single(stand.radius_of(COUNT, DEPTH)), COUNT)
    grains, smooth = stand.picture(made, "particles", 8), stand.picture(made, "continuous", 32)
    rows, images = {}, {"discs": grains.single}
    for share in SHARES:
        found = stand.picture(made, "query", 24, footprint=share)
        ours = found.single
        like = float(np.corrcoef(ours.ravel(), grains.single.ravel())[0, 1]) if ours.std() > 0 else 0.0
        rows[share] = (ours.mean() / smooth.single.mean(), found.report["noise"] / stand.PIXELS, like, found.cost / grains.cost)
        images[share] = ours
    return {"rows": rows, "images": images, "discs": grains.single.mean() / smooth.single.mean()}


def tables(numbers):
    head = ["k", "single scattering over the continuous medium's", "its standard error",
            "correlation with the pixels of the discs",
            "time to equal noise over the discs'"]
    body = [[f"{share:g}", *map(of.short, row)] for share, row in numbers["rows"].items()]
    return {"fig16": of.table(head, [*body, ["discs", f"{numbers['discs']:.3f}", "", 1, 1]])}


def draw(numbers):
    import matplotlib.pyplot as plt

    shown = ("discs", 0.1, 0.5, 3.0)
    figure, axes = plt.subplots(1, 5, figsize=(10, 2.4), width_ratios=[1, 1, 1, 1, 1.5], layout="constrained")
    white = 4 * numbers["images"]["discs"].mean()
    for name, ax in zip(shown, axes):
        ax.imshow(np.clip(numbers["images"][name] / white, 0, 1) ** 0.45, cmap="gray", vmin=0, vmax=1)
        ax.set(xticks=[], yticks=[], title=name if isinstance(name, str) else f"k = {name:g}")
    axes[-1].loglog(SHARES, [numbers["rows"][share][0] for share in SHARES], "o-", color=of.INK)
    axes[-1].axhline(1, color=of.INK, lw=0.8)
    axes[-1].set(xlabel="k", title="mean over continuous")
    return figure
