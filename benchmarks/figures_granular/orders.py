"""A ball of grains under the sky by orders of scattering: what the arrangement does, and what scattering at points does."""

import math

import numpy as np

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized
from renderers.camera import Camera
from renderers.materials.grains import material, medium, paths, transport
from renderers.materials.grains.teleport import Teleports
from renderers.transport.paths import Colours
from tests.physics.particles import Sky
from tests.physics.test_granular_render import through

from . import stand

GRAINS = {"glass beads": "glass_beads", "copper shot": "copper_shot", "flour": "flour"}
GRAINS = dict(list(GRAINS.items())[::sized(1, 2)])
METHODS = ("ept", "teleport", "teleport, exponential", "vpt")
ORDERS = {"one grain": slice(1, 2), "two": slice(2, 3), "three and more": slice(3, 4), "all": slice(0, 4)}
RADIUS, PIXELS = sized((20.0, 48), (5.0, 8))  # of the ball, in grains; of a picture of its middle
PASSES, PACKINGS = sized((6, 8), (2, 2))  # of each picture; places of the tile's copies that the ball is cut out of


def measure(passes=PASSES, packings=PACKINGS):
    """By grains and method: red radiances (packings, orders) of the ball's middle, under a sky of radiance 1."""
    return {name: _measured(stand.asset(stand.ROOT / "recipes" / f"{recipe}.yaml"), passes, packings)
            for name, recipe in GRAINS.items()}


def _measured(asset, passes, packings):
    found = {method: [] for method in METHODS}
    unit = stand.unit(asset)
    for number in range(packings):
        middle = 97.3 * unit * np.array([number, number**2 % 7, number**3 % 5], float)
        grains = material.grains_of(asset, *stand.ball(middle, RADIUS * unit))
        around = np.zeros((0, 0, 0), np.uint8), Colours.of(asset.wavelength)
        how = (paths.Explicit(grains, *around), Teleports(grains, *around), Teleports(grains, *around, exponential=True),
               medium.Continuous(material.medium_of(asset, grains)[0], *around))
        view = Camera.looking(middle - [0, 20 * RADIUS * unit, 0], middle, (0, 0, 1), 2 * math.atan(0.5 / 20), PIXELS, PIXELS)
        for method, one in zip(METHODS, how):
            sums = [transport.one_pass(Sky(above=1), through(one), view, (PIXELS, PIXELS), n, number) for n in range(passes)]
            found[method].append(np.mean([brought.by_order for brought in sums], axis=(0, 2))[:, 0])
    return {method: np.array(values) for method, values in found.items()}


def tables(numbers):
    body = []
    for name, by in numbers.items():
        for order, chosen in ORDERS.items():
            values = {method: found[:, chosen].sum(axis=1) for method, found in by.items()}
            body.append([name, order, f"{values['ept'].mean():.4f}",
                         *(_over(values[method], values["ept"]) for method in METHODS[1:])])
    return {"orders": of.table(["grains", "met", "`ept`: radiance", *(f"`{method}` over it" for method in METHODS[1:])], body)}


def _over(values, others):
    """Ratio of two independent means, and its standard error."""
    (a, b), (x, y) = ((one.mean(), one.std(ddof=1) / math.sqrt(len(one))) for one in (values, others))
    return f"{a / x:.3f} ± {a / x * math.hypot(b / a, y / x):.3f}"


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(numbers), figsize=(9, 2.6), layout="constrained")
    for (name, by), ax in zip(numbers.items(), axes):
        for k, method in enumerate(METHODS):
            height = [by[method][:, chosen].sum(axis=1).mean() for chosen in ORDERS.values()]
            ax.bar(np.arange(len(ORDERS)) + 0.2 * k, height, 0.2, label=method)
        ax.set(xticks=np.arange(len(ORDERS)) + 0.3, xticklabels=ORDERS, title=name)
        ax.tick_params(axis="x", labelsize=7)
    axes[0].set_ylabel("radiance")
    axes[-1].legend(fontsize=7)
    return figure
