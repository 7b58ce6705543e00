"""Bakes that shipped scenes ask for against bakes of their whole recipes: processor time, and the difference of the pictures.

    python benchmarks/requirements.py [SCENE…] [--pictures] [--finer 10] [--samples N] [--width W] [--block B]

Time is that of one core, kernels compiled before (each planned bake runs twice, the second counts).  With --pictures each scene
is rendered from the planned asset and from one whose tolerances are so many times finer, with four seeds
(`benchmarks/planned.py`); means over B x B pixels count as pixels.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from bakery.plan.asked import Asked
from bakery.run import execute
from bakery.run.bake import planned as plan_of
from bakery.run.cache import Cache
from benchmarks import planned
from benchmarks.sizes import sized
from renderers import scene as scenes
from renderers.scene import requirements

FOLDER = Path(__file__).resolve().parents[1]
SCENES, RECIPES = FOLDER / "assets" / "scenes", FOLDER / "recipes"


def bake(recipe, output, settings, stages):
    """Seconds of one core, and of the planning."""
    begin = time.process_time()
    plan = plan_of(recipe, output, asked=Asked(settings, tuple(stages)), force=True, jobs=1)
    begin, planned = time.process_time(), time.process_time() - begin
    baked = execute(plan, jobs=1)
    for miss in baked.missed:
        print(f"    {miss}")
    return time.process_time() - begin, planned


def both(scene, recipe, folder):
    """Seconds of the requirements, of the planned bake and of the whole one."""
    cache = Cache(Path(folder) / "requirements")
    begin = time.process_time()
    wanted, _ = planned.wanted(scene, recipe, cache)
    asking = time.process_time() - begin
    for remark in wanted.remarks:
        print(f"    {remark}")
    whole = planned.whole(scene, recipe, cache)
    paths = [Path(folder) / f"{recipe.stem}_{kind}.h5" for kind in ("small", "large")]
    bake(recipe, paths[0], wanted.settings, wanted.stages)
    small = bake(recipe, paths[0], wanted.settings, wanted.stages)[0]
    own = tuple(dict.fromkeys([*whole.stages]))
    return asking, small, bake(recipe, paths[1], whole.settings, () if not whole.added else own)[0]


def pictures(scene, recipes, folder, options) -> planned.Difference:
    """Difference of the pictures from planned assets and from finer ones."""
    assets = {}
    for recipe in dict.fromkeys(recipes):
        plans = planned.plans(scene, recipe, folder, times=options.finer, jobs=1)
        assets[recipe] = [execute(plan, jobs=1).output for plan in plans[:2]]
    size = None
    if "film" not in scene.rules.UNUSED:
        height, width = requirements.About(scene, None, None, bodies=[0]).world.size
        height = max(1, round(options.width * height / width / options.block)) * options.block
        size = (height, options.width // options.block * options.block)
    return planned.compared(scene, *([assets[one][i] for one in recipes] for i in (0, 1)), folder, samples=options.samples,
                            seeds=planned.SEEDS if size else 1, size=size, block=options.block if size else 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", help="names of shipped scenes; all of them if none")
    parser.add_argument("--pictures", action="store_true")
    parser.add_argument("--finer", type=float, default=sized(planned.FINER, 2),
                        help="times that tolerances are finer, with --pictures")
    parser.add_argument("--samples", type=int, default=sized(8, 1), help="a pixel and seed")
    parser.add_argument("--width", type=int, default=sized(32, 8))
    parser.add_argument("--block", type=int, default=4)
    options = parser.parse_args()
    names = options.scenes or sized(sorted(path.stem for path in SCENES.glob("*.yaml")), ["candle"])
    ratios = []
    print("| scene | asking, s | planned, s | whole, s | ratio |\n|---|---|---|---|---|")
    for name in names:
        scene = scenes.load(SCENES / f"{name}.yaml", assets=False)
        with tempfile.TemporaryDirectory(prefix="bakery-requirements-") as folder:
            recipes = planned.recipes_of(scene, RECIPES)
            done = {recipe: both(scene, recipe, folder) for recipe in dict.fromkeys(recipes)}
            asking, small, whole = (sum(one[i] for one in done.values()) for i in (0, 1, 2))
            ratios.append(small / whole)
            print(f"| {name} | {asking:.2f} | {small:.2f} | {whole:.2f} | {small / whole:.2f} |", flush=True)
            if options.pictures:
                found = pictures(scene, recipes, folder, options)
                print("    " + ", ".join(f"{key} {100 * value:.2g} %" for key, value in found._asdict().items())
                      + f"; beyond noise {100 * found.excess:.2g} %", flush=True)
    print(f"median ratio {np.median(ratios):.2f}")


if __name__ == "__main__":
    main()
