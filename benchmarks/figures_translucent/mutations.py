"""Figs. 30, 31, Table 2: error of chains of paths against mutations and against time, beside paths and tables."""

import numpy as np

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

SCENES = sized(("bumpy_ball", "candle", "head"), ("bumpy_ball",))
METHODS = "paths", "metropolis", "vrl+tables"
SECONDS, ROUNDS = 24.0, sized(2, 1)  # of processor time, of each method
MUTATIONS = 1000  # a pixel
LIGHT = stand.ALL, stand.SCATTERED, stand.LATER


def measure(size, share):
    """By scene and method: findings of the layers of `LIGHT`, paths a pixel, seconds."""
    numbers = {"size": size, "share": share}
    for scene in SCENES:
        how = stand.shipped(scene, size)
        runs = {method: stand.Run(how, method) for method in METHODS}
        stand.together(runs, dict.fromkeys(runs, share * SECONDS), ROUNDS)
        numbers[scene] = {method: ([run.found(light) for light in LIGHT], min(one.samples * one.count for one in run.parts),
                                   sum(one.seconds for one in run.parts)) for method, run in runs.items()}
        print(scene, flush=True)
    return numbers


def tables(numbers):
    body, pixels = [], numbers["size"] ** 2
    for scene in SCENES:
        reference = numbers[scene]["paths"][0]
        for method, (found, samples, seconds) in numbers[scene].items():
            counted = method != "vrl+tables"
            error = found[0].noise * np.sqrt(samples / MUTATIONS)
            body.append([scene, f"`{method}`", *("1" if method == "paths" else stand.over(*stand.ratio(one, other))
                                                 for one, other in zip(found[::2], reference[::2])),
                         stand.of_seconds(samples * pixels / seconds) if counted else "", f"{100 * error:.2g}" if counted else "",
                         *(stand.of_seconds(one.seconds) for one in found), stand.of_seconds(_of_regions(found[0], seconds))])
    head = ["scene", "method", "all light over `paths`", "three and more events over `paths`", "paths or mutations a second",
            f"noise after {MUTATIONS} a pixel, %", "noise 1 % after, s", "of what scatters", "of three and more events",
            "of 8 x 8 blocks: noise 1 % after, s"]
    return {"fig30": of.table(head, body) + "\n\n" + stand.conditions(numbers["size"]) + f" {SECONDS * numbers['share']:g} "
            "processor seconds each."}


def _of_regions(found, seconds):
    """Processor seconds until the standard error of the means of blocks is 1 % of the picture's mean, root mean square."""
    weight = found.pixels / found.pixels.sum()
    return seconds * float(weight @ found.square) / (0.01 * found.total) ** 2
