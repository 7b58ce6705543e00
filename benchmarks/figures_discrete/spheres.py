"""Figs. 10 and 12: particles with wave optics against spheres of glass that rays are traced through."""

import numpy as np

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

DEPTH = 0.3
COUNTS = sized((500, 5000, 50_000), (500, 1000, 2000))  # 1 mm and less
APART = "5 deg"  # within which a peak counts as diffraction


def measure():
    rows, images = {}, {}
    for count in COUNTS:
        made = stand.asset(stand.single(stand.radius_of(count, DEPTH)), count)
        for lamp in (stand.SIDE, stand.BEHIND):
            traced = stand.picture(made, "explicit", 128, lamp)
            kept, without = (stand.picture(made, "particles", 8, lamp, peak=peak) for peak in ("keep", APART))
            means = [found.single.mean() for found in (kept, without, traced)]
            coarse = [stand.blocks(found.single, 4).ravel() for found in (without, traced)]
            rows[count, lamp] = (stand.radius_of(count, DEPTH), means[0] / means[2], means[1] / means[2],
                                 float(np.corrcoef(*coarse)[0, 1]), traced.report["noise"] / stand.PIXELS)
            images[count, lamp] = (traced.all, without.all, kept.all)
    return {"rows": rows, "images": images}


def tables(numbers):
    head = ["particles", "radius, um", "lamp", "all over traced", "without the peak over traced", "correlation of 4 x 4 pixels",
            "standard error of the traced mean"]
    body = [[f"{count:,}", f"{radius:.3g}", lamp, f"{kept:.3f}", f"{without:.3f}", f"{like:.2f}", f"{100 * noise:.2g} %"]
            for (count, lamp), (radius, kept, without, like, noise) in numbers["rows"].items()]
    return {"fig10": of.table(head, body)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(6, 4.3), layout="constrained")
    for row, count in zip(axes, (COUNTS[0], COUNTS[-1])):
        shown = numbers["images"][count, stand.SIDE]
        for ax, image, name in zip(row, shown, ("spheres, traced", "discs, no diffraction", "discs")):
            ax.imshow((image / (4 * shown[2].mean())).clip(0, 1) ** 0.45, cmap="gray", vmin=0, vmax=1)
            ax.set(xticks=[], yticks=[], title=name)
        row[0].set_ylabel(f"N = {count:,}")
    return figure
