"""Figs. 32, 33: candles with a black ball, and with air, inside, where the paper's method is too bright.

Unlit, in a white sky: paths find the flame so rarely that they are no reference.
"""

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

SCENES = {"candle": "massive", "candle_ball": "black ball inside (fig. 32)"}
SCENES |= sized({"candle_hollow": "hollow (fig. 33)"}, {})
UNLIT = [(r'<shape type="ply" id="flame">.*?</shape>', ""), ("0.055, 0.05, 0.055", "1, 1, 1")]
COLOURS = 256
SECONDS = {"paths": 80.0, "vrl+tables": 25.0, "vrl+tables, mirrored": 12.0, "vrl+tables, none": 12.0}


def measure(size, share):
    """By scene and method: light of three and more events."""
    numbers = {"size": size, "share": share}
    for scene in SCENES:
        how = stand.shipped(scene, size, UNLIT)
        runs = {method: stand.Run(how, method) for method in SECONDS}
        stand.together(runs, {method: share * seconds for method, seconds in SECONDS.items()})
        numbers[scene] = {method: run.found(stand.LATER) for method, run in runs.items()}
    return numbers


def tables(numbers):
    body = []
    for scene, name in SCENES.items():
        by = numbers[scene]
        reference = by["paths"]
        body.append([name, f"{100 * reference.error / reference.total:.1f}",
                     *(stand.over(*stand.ratio(by[method], reference)) for method in list(SECONDS)[1:]),
                     *(stand.of_seconds(by[method].seconds) for method in list(SECONDS)[:2])])
    head = ["candle", "error of `paths`, %", *(f"`{method}` over it" for method in list(SECONDS)[1:]),
            *(f"`{method}`: noise 1 % after, s" for method in list(SECONDS)[:2])]
    return {"fig32": of.table(head, body) + "\n\n" + stand.conditions(numbers["size"], SECONDS, numbers["share"])}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(SCENES), len(SECONDS), figsize=(7, 5.6), layout="constrained")
    for (scene, name), row in zip(SCENES.items(), axes):
        by = numbers[scene]
        for method, ax in zip(SECONDS, row):
            ax.imshow(stand.shown(by[method].image, 4 * by["paths"].total))
            ax.set(xticks=[], yticks=[])
            ax.grid(False)
        row[0].set_ylabel(name, fontsize=7)
    for method, ax in zip(SECONDS, axes[0]):
        ax.set_title(method.replace(", ", ",\n"), fontsize=8)
    return figure
