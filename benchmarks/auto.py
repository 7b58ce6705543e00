"""What `auto` costs in a minute beside each method that it may take: pilots, and a choice that is not the cheapest.

    python -m benchmarks.auto [SCENE …] [--minute 60] [--cores 2] [--seconds 5] [--bakes]

Nothing is rendered for a minute: what a picture of equal noise takes by `auto` over a fixed method is the ratio of what both take
to a noise, and the share of the minute that choosing takes beside it.  The choice is made anew, twice, with `stop.time` of a
minute; the second one counts, as kernels are compiled then.  Then all candidates render films of 64 x 64 pixels in turns for some
processor seconds each: variance times time, of several kinds of passes as they are shared out best.  A row a candidate; `auto
over it`: what `auto` takes over what that takes, choosing included.  --bakes: processor seconds of the bakes that a cache without
this scene takes, with `auto` and with each candidate.  Rough: variances of few passes are known to some 10 %.
"""

import argparse
import math
import os
import tempfile
import time
from pathlib import Path
from unittest import mock

import numpy as np

from bakery.errors import BakeryError
from benchmarks.requirements import SCENES
from benchmarks.sizes import sized
from renderers import choice, colour
from renderers.choice import remembered, surfaces, trial
from renderers.mitsuba.world import World
from renderers.scene import assets, candidates, load

DEFAULT = ["glass_of_milk", "candle", "sand_castle", "lamp_in_dust", "bubbles_in_light", "winter_evening"]


def chosen(scene, cores):
    """The choice, and processor seconds that it takes once kernels are compiled; by the clock of a machine whose processors, so
    many, do nothing else and are always busy."""
    with mock.patch.object(remembered, "get", lambda *_: None), mock.patch.object(remembered, "put", lambda *_: None), \
            mock.patch("time.monotonic", lambda: time.process_time() / cores):
        for _ in range(2):
            opened, world = choice.Opened.of(scene), World.of(scene)
            begin = time.process_time()
            taken = choice.chosen(opened, world)
            spent = time.process_time() - begin
    return taken, spent


class Engine:
    """Passes of a candidate on a small film, kind by kind."""

    def __init__(self, scene, opened, world, candidate):
        self._world, asked = world, candidates.by_methods(scene, candidate.methods)
        with world.as_it_is():
            self._parts = asked.prepare(opened._replace(scene=asked), world, 7).parts
        self._luminance = {part.name: [] for part in self._parts}
        self._seconds = {part.name: [] for part in self._parts}
        self.spent = 0.0

    def go(self):
        for part in self._parts:
            begin = time.process_time()
            with self._world.as_it_is():
                layers = part.render(len(self._luminance[part.name]))
            self._seconds[part.name].append(time.process_time() - begin)
            self._luminance[part.name].append(np.asarray(layers[""], float) @ colour.LUMINANCE)
            self.spent += self._seconds[part.name][-1] if len(self._seconds[part.name]) > 1 else 0.0

    def measured(self):
        """Processor seconds times relative variance, and the mean."""
        level = sum(np.mean(images) for images in self._luminance.values())
        roots = (math.sqrt(np.var(images, axis=0, ddof=1).mean() * np.median(self._seconds[name][1:]))
                 for name, images in self._luminance.items())
        return (sum(roots) / level) ** 2, level


def rates(scene, seconds, without=()):
    """Name of each candidate that can render the scene -> `Engine.measured`."""
    opened, world = choice.Opened.of(scene), World.of(scene)
    offered, lacks = surfaces.beside(opened, world, candidates.of(scene))
    offered = [candidate for candidate in offered if candidate.name not in lacks and not candidate.lacks(opened.assets, world)]
    small = trial.smaller(world, trial.SMALL)
    engines = {}
    for candidate in offered:
        try:
            engines[candidate.name] = Engine(scene, opened, small, candidate)
        except BakeryError:  # tables that are not baked: no candidate
            continue
    while slow := [engine for engine in engines.values() if engine.spent < seconds]:
        for engine in slow:
            engine.go()
    return {name: engine.measured() for name, engine in engines.items()}


def bakes(path, settings):
    """Processor seconds of what a scene bakes into an empty cache."""
    with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, {"BAKERY_CACHE": folder}):
        begin = time.process_time()
        assets.baked(load(path, settings))
        return time.process_time() - begin


def rows(path, options):
    settings = {"stop.time": f"{options.minute} s"}
    scene = assets.baked(load(path, settings))
    taken, spent = chosen(scene, options.cores)
    share = spent / (options.minute * options.cores)
    measured = rates(scene, options.seconds)
    own = measured[taken.method][0] / (1 - share)
    for name, (rate, level) in measured.items():
        baked = f" {bakes(path, settings | {'method': name}):.1f} |" if options.bakes and " " not in name else ""
        print(f"| {path.stem} | {name}{' *' if name == taken.method else ''} | {rate:.3g} | {level:.4g} | {100 * share:.1f} % | "
              f"{own / rate:.2f} |{baked}", flush=True)
    if options.bakes:
        print(f"    with auto baking takes {bakes(path, settings):.1f} s")
    print(f"    {taken.sentence}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", help="names, or files NAME.yaml")
    parser.add_argument("--minute", type=float, default=60.0, help="s of the clock that a picture is given")
    parser.add_argument("--cores", type=float, default=2.0, help="processor seconds in a second")
    parser.add_argument("--seconds", type=float, default=sized(5.0, 0.1), help="of a processor, for each candidate")
    parser.add_argument("--bakes", action="store_true")
    options = parser.parse_args()
    print("| scene | candidate (* taken) | variance x time | mean | choosing, of a minute | auto over it |")
    print("|---|---|---|---|---|---|")
    for name in options.scenes or sized(DEFAULT, ["candle"]):
        rows(Path(name).resolve() if name.endswith(".yaml") else SCENES / f"{name}.yaml", options)


if __name__ == "__main__":
    main()
