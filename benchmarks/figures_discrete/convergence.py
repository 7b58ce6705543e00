"""Figs. 14 and 15: with more particles of the same optical depth the picture becomes the continuous medium's."""

import numpy as np

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

COUNTS = sized((100, 1000, 10_000, 100_000, 1_000_000), (100, 300, 1000, 3000))
DEPTH = 0.5
SHOWN = sized((100, 10_000, 1_000_000), (100, 1000, 3000))


def measure():
    rows, images = {}, {}
    for count in COUNTS:
        made = stand.asset(stand.single(stand.radius_of(count, DEPTH)), count)
        smooth = stand.picture(made, "continuous", 32)
        grains = stand.picture(made, "particles", 2 if count == COUNTS[-1] else 8)
        error = smooth.single.std() / smooth.single.mean() / stand.PIXELS
        rows[count] = (stand.radius_of(count, DEPTH), float(grains.single.mean() / smooth.single.mean()), error,
                       stand.graininess(grains.single, 8), stand.graininess(grains.single))
        images[count] = grains.all
        images["continuous"] = smooth.all
    # at the ends a particle is as large as a block, and the light samples of two passes show
    counts, off = np.log(COUNTS[1:-1]), np.log([rows[count][3] for count in COUNTS[1:-1]])
    return {"rows": rows, "images": images, "slope": float(np.polyfit(counts, off, 1)[0])}


def tables(numbers):
    body = [[f"{count:,}", f"{radius:.3g}", f"{mean:.3f}", f"{error:.3f}", of.short(off), of.short(grainy)]
            for count, (radius, mean, error, off, grainy) in numbers["rows"].items()]
    head = ["particles", "radius, um", "single scattering over the continuous medium's", "standard error of the latter",
            "deviation of 8 x 8 pixels", "of a pixel"]
    text = of.table(head, body)
    return {"fig14": f"{text}\n\nThe deviation falls as N to the {numbers['slope']:.2f} from 1,000 to 100,000 particles."}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 5, figsize=(10, 2.4), width_ratios=[1, 1, 1, 1, 1.5], layout="constrained")
    white = 2.5 * numbers["images"]["continuous"].mean()
    for name, ax in zip([*SHOWN, "continuous"], axes):
        ax.imshow(np.clip(numbers["images"][name] / white, 0, 1) ** 0.45, cmap="gray", vmin=0, vmax=1)
        ax.set(xticks=[], yticks=[], title=name if isinstance(name, str) else f"N = {name:,}")
    rows = numbers["rows"]
    axes[-1].loglog(COUNTS, [rows[count][3] for count in COUNTS], "o-", color=of.INK)
    axes[-1].loglog(COUNTS, [rows[1000][3] * (1000 / count) ** 0.5 for count in COUNTS], ":", color=of.INK, label="N to the -1/2")
    axes[-1].set(xlabel="particles", title="deviation of 8 x 8 pixels")
    axes[-1].legend(fontsize=8)
    return figure
