"""Figs. 27, 30, 31: error against time of all methods, on the bumpy ball and the candle."""

import numpy as np

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

SCENES = sized(("bumpy_ball", "candle"), ("bumpy_ball",))
REFERENCE, SECONDS, ROUNDS = 150.0, 16.0, sized(4, 1)  # of `paths`, which is the reference, and of each other method
AFTER = 60.0  # s
COLOURS = 256


def measure(size, share):
    """By scene: findings of all light and of three and more events by method, and (seconds, noise) after each round."""
    numbers = {"size": size, "share": share}
    for scene in SCENES:
        how = stand.shipped(scene, size)
        runs = {method: stand.Run(how, method) for method in stand.every_method()}
        traces = {method: [] for method in runs}
        for number in range(1, ROUNDS + 1):
            for method, run in runs.items():
                run.go_on(share * (REFERENCE if method == "paths" else SECONDS) * number / ROUNDS)
                traces[method].append((sum(part.seconds for part in run.parts), run.found().noise))
        numbers[scene] = {method: (run.found(), run.found(stand.LATER), traces[method]) for method, run in runs.items()}
    return numbers


def tables(numbers):
    found = {}
    for scene in SCENES:
        by, body = numbers[scene], []
        reference, later, _ = by["paths"]
        for method, (all_light, own_later, _) in by.items():
            bias = (0.0, 0.0, 0.0) if method == "paths" else stand.bias(all_light, reference)
            error = np.hypot(0.01 * np.sqrt(all_light.seconds / AFTER), bias[0])
            crossing = stand.of_seconds(reference.seconds * (0.01 / bias[0]) ** 2) if bias[1] > 0 else ""
            if method.startswith("beams+tables,"):  # as with `vrl+tables`, within noise
                continue
            body.append([f"`{method}`", *(("1", "1", "0", stand.of_seconds(all_light.seconds), f"{100 * error:.1f}", "")
                                          if method == "paths" else
                                          (stand.over(*stand.ratio(all_light, reference)),
                                           stand.over(*stand.ratio(own_later, later)), stand.of_bias(*bias),
                                           stand.of_seconds(all_light.seconds), f"{100 * error:.1f}", crossing))])
        head = ["method", "all light over `paths`", "three and more events over `paths`", "bias, %", "noise 1 % after, s",
                f"error after {AFTER:.0f} s, %", "`paths` better after, s"]
        found[f"fig27_{scene}"] = of.table(head, body) + (
            f"\n\nThe reference is the `paths` of this run, {REFERENCE * numbers['share']:g} s: noise of a pixel "
            f"{100 * reference.noise:.1f} %, of the mean {100 * reference.error / reference.total:.1f} %. The others: "
            f"{SECONDS * numbers['share']:g} s each, in turns; {stand.conditions(numbers['size'])}")
    return found


def draw(numbers):
    import matplotlib.pyplot as plt

    methods = list(numbers[SCENES[0]])
    figure = plt.figure(figsize=(9, 6.4), layout="constrained")
    curves, pictures = figure.subfigures(2, 1, height_ratios=(3, 2.6))
    t = np.geomspace(1, 1e6, 60)
    for scene, ax in zip(SCENES, curves.subplots(1, 2, sharey=True)):
        reference = numbers[scene]["paths"][0]
        for k, method in enumerate(methods):
            found, _, trace = numbers[scene][method]
            colour = f"C{k}" if k < 10 else "black"
            value, least, _ = stand.bias(found, reference) if method != "paths" else (0.0, 0.0, 0.0)
            ax.plot(t, np.hypot(np.sqrt(found.seconds / t), 100 * value * (least > 0)), color=colour, label=method,
                    linestyle="--" if ", " in method else "-")
            ax.plot(*np.transpose([(spent, 100 * noise) for spent, noise in trace]), ".", color=colour)
        ax.set(xscale="log", yscale="log", xlabel="processor time, s", title=scene)
    ax.legend(fontsize=6)
    curves.axes[0].set_ylabel("error, %")
    axes = pictures.subplots(len(SCENES), len(methods), squeeze=False)
    for scene, row in zip(SCENES, axes):
        white = 3 * numbers[scene]["paths"][0].total
        for method, ax in zip(methods, row):
            ax.imshow(stand.shown(numbers[scene][method][0].image, white))
            ax.set(xticks=[], yticks=[])
            ax.grid(False)
    for method, ax in zip(methods, axes[0]):
        ax.set_title(method.replace("+", "+\n").replace(", ", ",\n"), fontsize=7)
    return figure
