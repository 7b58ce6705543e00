"""Time to unit variance of the methods on shipped scenes (table 2; figs. 1, 7, 12, 13), and how bright they are."""

from types import SimpleNamespace

import numpy as np

from benchmarks.figures_goa import measures as of
from benchmarks.granular_render import measured
from benchmarks.sizes import sized

SCENES = sized(("spices", "sand_castle", "snowman", "snowman_small", "cube_of_beads"), ("cube_of_beads",))
METHODS = ("ept", "ept+vpt", "ept+vpt+da", "auto")
LAMPS = (1.0, 0.05)  # widths of the scenes' lamps, over what they are
SECONDS, WIDTH = sized((12.0, 160), (0.0, 8))  # of processor time for each number; of the picture, pixels


def measure(scenes=SCENES, seconds=SECONDS):
    """By scene, lamp and method: light that met grains, its error, seconds to unit variance."""
    options = SimpleNamespace(seconds=seconds, width=WIDTH)
    return {(scene, lamp): {method: measured(scene, method, SimpleNamespace(**vars(options), lamp=lamp)) for method in METHODS}
            for scene in scenes for lamp in LAMPS}


def tables(numbers):
    gains, light = [], []
    for (scene, lamp), by in numbers.items():
        own, error, spent = by["ept"]
        gains.append([scene, f"{lamp:g}", f"{spent:.3g}", *(f"{spent / by[method][2]:.3g}" for method in METHODS[1:])])
        if lamp == 1:
            light.append([scene, f"{100 * error / own:.1f}", *(f"{100 * (by[method][0] / own - 1):+.1f} ± "
                                                              f"{100 * np.hypot(error, by[method][1]) / own:.1f}"
                                                              for method in METHODS[1:])])
    named = [f"`{method}`" for method in METHODS[1:]]
    return {"table2": of.table(["scene", "width of its lamps", "`ept`, s", *(f"{name}: times quicker" for name in named)], gains),
            "table2_light": of.table(["scene", "`ept`: error, %", *(f"{name}, % more" for name in named)], light)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(10, 3), layout="constrained")
    for k, method in enumerate(METHODS[1:]):
        ax.bar(np.arange(len(numbers)) + 0.25 * k, [by["ept"][2] / by[method][2] for by in numbers.values()], 0.25, label=method)
    ax.axhline(1, color="0.5", linewidth=0.8)
    ax.set(yscale="log", ylabel="times quicker than ept", xticks=np.arange(len(numbers)) + 0.25,
           xticklabels=["\n".join([*scene.split("_"), f"lamps {lamp:g}"]) for scene, lamp in numbers])
    ax.tick_params(axis="x", labelsize=7)
    ax.legend(fontsize=7)
    return figure
