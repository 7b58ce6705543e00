"""Fig. 19: what the distribution of sizes does to brightness and to graininess."""

import math

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

COUNT = sized(50_000, 1000)
_LOGNORMAL = "{{distribution: lognormal, radius: {:.5g} um, sigma: {:g}, max: 2 mm}}"


def _equal_area(sigma, radius=60.0):
    """um, radius of a log-normal distribution of the same mean area as at sigma = 1."""
    return radius * math.exp(-math.log(sigma) ** 2)


def cases():
    """Name -> (recipe of sizes, number)."""
    found = {f"r = {radius:g} um, sigma = 2": (_LOGNORMAL.format(radius, 2), COUNT) for radius in (15, 30, 60)}
    found |= {f"r = 30 um, sigma = {sigma:g}": (_LOGNORMAL.format(30, sigma), COUNT) for sigma in (1.1, 1.5, 2.5)}
    found |= {f"equal area, sigma = {sigma:g}": (_LOGNORMAL.format(_equal_area(sigma), sigma), COUNT)
              for sigma in (1.1, 1.5, 2.5)}
    large = "{share: 0.002, distribution: lognormal, radius: 400 um, sigma: 1.2}"
    for radius in (30, 60):
        fine = f"{{share: 0.998, distribution: lognormal, radius: {radius} um, sigma: 1.02}}"
        found[f"r = {radius} um and 400 um"] = (f"{{distribution: mixture, of: [{fine}, {large}]}}", COUNT)
    return found


def measure():
    return {name: stand.picture(stand.asset(size, count), "particles", 4) for name, (size, count) in cases().items()}


def tables(numbers):
    body = [[name, of.short(found.report["optical_depth"][-1]), of.short(1e4 * found.single.mean()),
             of.short(stand.graininess(found.single))] for name, found in numbers.items()]
    return {"fig19": of.table(["sizes", "optical depth", "single scattering, mean, 1e-4", "graininess of a pixel"], body)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 6, figsize=(11, 4.4), layout="constrained")
    for ax in axes.ravel():
        ax.set_axis_off()
    white = 4 * max(found.all.mean() for found in numbers.values())
    for (name, found), ax in zip(numbers.items(), axes.ravel()):
        ax.imshow((found.all / white).clip(0, 1) ** 0.45, cmap="gray", vmin=0, vmax=1)
        ax.set_title(name, fontsize=8)
    return figure
