"""Figs. 30, 31, Table 2: error of chains of paths against mutations and against time, beside paths and tables."""

from __future__ import annotations

import numpy as np

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized
from benchmarks.transport import WAX

from . import stand

BALLS = {"ball of wax": 1.0, "ball of wax, glass": 1.4}  # of so many mean free paths in radius, by refractive index
RADIUS = 8
SCENES = sized((*BALLS, "bumpy_ball", "candle", "head"), ("bumpy_ball",))
METHODS = "paths", "metropolis", "vrl+tables", "metropolis+tables", "metropolis+tables, none"
SECONDS, ROUNDS = 24.0, sized(2, 1)  # of processor time, of each method
MUTATIONS = 1000  # a pixel
LIGHT = stand.ALL, stand.SCATTERED, stand.LATER


def measure(size, share):
    """By scene and method: findings of the layers of `LIGHT`, paths or mutations a pixel and their seconds, seconds in all."""
    numbers = {"size": size, "share": share}
    for scene in SCENES:
        how = _ball(BALLS[scene], size) if scene in BALLS else stand.shipped(scene, size)
        runs = {method: stand.Run(how, method) for method in METHODS}
        stand.together(runs, dict.fromkeys(runs, share * SECONDS), ROUNDS)
        numbers[scene] = {method: ([run.found(light) for light in LIGHT], _counted(run, size**2),
                                   sum(one.seconds for one in run.parts)) for method, run in runs.items()}
        print(scene, flush=True)
    return numbers


def tables(numbers):
    body, pixels = [], numbers["size"] ** 2
    for scene in SCENES:
        reference = numbers[scene]["paths"][0]
        for method, (found, (samples, spent), seconds) in numbers[scene].items():
            error = found[0].noise * np.sqrt(samples / MUTATIONS) if method in METHODS[:2] else None
            chains = numbers[scene]["metropolis"][0]
            body.append([scene, f"`{method}`", *("1" if method == "paths" else stand.over(*stand.ratio(one, other))
                                                 for one, other in zip(found[::2], reference[::2])),
                         stand.of_seconds(samples * pixels / spent) if samples else "", f"{100 * error:.2g}" if error else "",
                         *(stand.of_seconds(one.seconds) for one in found), stand.of_seconds(_of_regions(found[0], seconds)),
                         f"{np.sqrt(found[-1].seconds / chains[-1].seconds):.2g}"])
    head = ["scene", "method", "all light over `paths`", "three and more events over `paths`", "paths or mutations a second",
            f"noise after {MUTATIONS} a pixel, %", "noise 1 % after, s", "of what scatters", "of three and more events",
            "of 8 x 8 blocks: noise 1 % after, s", "error of three and more events over `metropolis`, equal time"]
    return {"fig30": of.table(head, body) + "\n\n" + stand.conditions(numbers["size"]) + f" {SECONDS * numbers['share']:g} "
            "processor seconds each."}


def _ball(index, size):
    """A ball of wax under a panel."""
    albedo, free_path, g = WAX
    how = stand.ball(stand.medium(albedo, g), index, size, stand.PANEL)
    return stand.thicker(how, RADIUS * free_path[1] / np.array(free_path))


def _counted(run, pixels):
    """Paths or mutations a pixel, and seconds that they took; None where neither is counted."""
    (*_, last) = run.parts
    if getattr(last.render, "count", None):
        return last.render.count / (1 + 1 / last.count) / pixels, last.seconds  # less the pass that compiles
    counted = len(run.parts) == 1
    return last.samples * last.count if counted else None, last.seconds


def _of_regions(found, seconds):
    """Processor seconds until the standard error of the means of blocks is 1 % of the picture's mean, root mean square."""
    weight = found.pixels / found.pixels.sum()
    return seconds * float(weight @ found.square) / (0.01 * found.total) ** 2
