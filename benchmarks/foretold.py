"""Noise that pilots of a method foretell of a scene, over that which many passes show; and variance times time of the method.

    python benchmarks/foretold.py SCENE.yaml METHOD… [--seconds 15] [--passes 2]

Passes of a picture of 64 x 64 pixels are kept for so many processor seconds of each method.  Pilots are groups of some of them,
one after the other; they foretell the variance among as many squares as all passes have, which is that which these show.
"""

import argparse
import time

import numpy as np

from benchmarks.requirements import SCENES
from benchmarks.sizes import sized
from renderers import choice, colour
from renderers.choice import tails, trial
from renderers.mitsuba.world import World
from renderers.scene import assets, candidates, load

_LEAST = 4  # passes that are kept of each kind, the first of which compiles


def recorded(part, seconds):
    """Luminance (n, H, W) of passes of a part, and processor seconds of one."""
    luminance, took = [], []
    while len(took) < _LEAST or sum(took[1:]) < seconds:
        begin = time.process_time()
        layers = part.render(len(took))
        took.append(time.process_time() - begin)
        luminance.append(np.asarray(layers[""], float) @ colour.LUMINANCE)
    return np.array(luminance), float(np.median(took[1:]))


def foretold(luminance, passes):
    """Of each pilot of so many passes: foretold over shown variance, and standard error of its logarithm."""
    pilots = [tails.of_passes(luminance[i:i + passes], luminance.size) for i in range(0, len(luminance) - passes + 1, passes)]
    shown = luminance.var(axis=0, ddof=1).mean()
    return np.array([(tail.variance(luminance.size) / shown, spread) for tail, spread in pilots]).T


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default=str(SCENES / "lamp_in_dust.yaml"))
    parser.add_argument("methods", nargs="*", default=["particles+continuous"])
    parser.add_argument("--seconds", type=float, default=sized(15.0, 0.1))
    parser.add_argument("--passes", type=int, default=2)
    options = parser.parse_args()
    scene = assets.baked(load(options.scene))
    opened, small = choice.Opened.of(scene), trial.smaller(World.of(scene), trial.SMALL)
    print("| method | part | passes | mean | variance | s a pass | variance x time | foretold over shown: 10, 50, 90 of 100 | "
          "covered |")
    print("|---|---|---|---|---|---|---|---|---|")
    for method in options.methods:
        asked = candidates.by_methods(scene, [method] * len(scene.values.materials))
        with small.as_it_is():
            parts = asked.prepare(opened._replace(scene=asked), small, 7).parts
            passes = {part.name: recorded(part, options.seconds / len(parts)) for part in parts}
        level = sum(luminance.mean() for luminance, _ in passes.values())
        for name, (luminance, seconds) in passes.items():
            variance = luminance.var(axis=0, ddof=1).mean() / level**2
            ratio, spread = foretold(luminance, options.passes)
            print(f"| {method} | {name} | {len(luminance)} | {luminance.mean():.4g} | {variance:.4g} | {seconds:.3g} | "
                  f"{variance * seconds:.3g} | {', '.join(f'{x:.2g}' for x in np.quantile(ratio, [0.1, 0.5, 0.9]))} | "
                  f"{100 * np.mean(ratio * np.exp(2 * spread) > 1):.0f} % |", flush=True)


if __name__ == "__main__":
    main()
