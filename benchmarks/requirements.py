"""Bakes that shipped scenes ask for against bakes of their whole recipes: processor time, and the difference of the pictures.

    python benchmarks/requirements.py [SCENE…] [--pictures] [--samples N] [--width W]

Time is that of one core, kernels compiled before (each planned bake runs twice, the second counts).  With --pictures each scene
is rendered from both assets with the same random numbers; given are root mean square differences of luminance, over its mean,
pixel by pixel and of means over blocks of 8 x 8 pixels, each with what noise alone would make if random numbers were independent.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from importlib import import_module
from pathlib import Path

import numpy as np

from bakery.run import execute, prepare
from bakery.run.cache import Cache
from bakery.run.ensure import asked
from renderers import colour, requirements
from renderers import scene as scenes

FOLDER = Path(__file__).resolve().parents[1]
SCENES, RECIPES = FOLDER / "assets" / "scenes", FOLDER / "recipes"
BLOCK = 8


def recipes_of(scene) -> list[Path]:
    """Recipe of each body; of a built asset the shipped one of its name."""
    named = [body if body.asset or body.recipe else scene.values for body in scene.bodies]
    return [(scene.file(one.recipe) if one.recipe else RECIPES / f"{Path(one.asset).stem}.yaml").resolve() for one in named]


def bake(recipe, output, settings, stages):
    """Seconds of one core, and of the planning."""
    begin = time.process_time()
    plan = prepare(recipe, output, settings=settings, stages=stages, force=True, jobs=1)
    begin, planned = time.process_time(), time.process_time() - begin
    baked = execute(plan, jobs=1)
    for miss in baked.missed:
        print(f"    {miss}")
    return time.process_time() - begin, planned


def both(scene, recipe, folder):
    """Paths of the planned and of the whole asset; seconds of the requirements, of the planned bake and of the whole one."""
    needs = scene.rules.NEEDS

    def everything(values, medium):
        return requirements.Required(tuple(requirements.Need(stage, True, "") for stage in needs))

    cache = Cache(Path(folder) / "requirements")
    begin = time.process_time()
    wanted = asked(recipe, {}, lambda values, medium: requirements.of_scene(scene, values, medium), cache)
    asking = time.process_time() - begin
    for remark in wanted.remarks:
        print(f"    {remark}")
    whole = asked(recipe, {}, everything, cache)
    paths = [Path(folder) / f"{recipe.stem}_{kind}.h5" for kind in ("planned", "whole")]
    bake(recipe, paths[0], wanted.settings, wanted.stages)
    small = bake(recipe, paths[0], wanted.settings, wanted.stages)[0]
    own = tuple(dict.fromkeys([*whole.stages]))
    return *paths, asking, small, bake(recipe, paths[1], whole.settings, () if not whole.added else own)[0]


def rendered(scene, assets, path, samples, size):
    """Linear luminance (H, W) and its standard error."""
    from tests.exr import layers

    values = scene.values.model_copy(update={
        "stop": scene.values.stop.model_copy(update={"noise": 1e-6, "samples": samples, "time": None}),
        "film": scene.values.film.model_copy(update=size)})
    if hasattr(values, "picture"):
        values = values.model_copy(update={"picture": values.picture.model_copy(update={"samples": samples})})
    scene = dataclasses.replace(scene, values=values, asset=assets[0], assets=tuple(assets))
    import_module(scene.renderer).render(scene, path, seed=1)
    found = layers(path)
    luminance = np.stack([found[c] for c in "RGB"], axis=-1) @ colour.LUMINANCE
    noise = np.stack([found[f"noise.{c}"] for c in "RGB"], axis=-1) @ colour.LUMINANCE if "noise.R" in found else 0 * luminance
    return luminance, noise


def compared(scene, planned, whole, folder, samples, width):
    """Differences, per cent."""
    size = {"width": width, "height": width} if "film" not in scene.rules.UNUSED else {}
    if size:
        world = requirements.About(scene, None, None, bodies=[0]).world
        size["height"] = max(1, round(width * world.size[0] / world.size[1]))
    (a, ea), (b, eb) = (rendered(scene, assets, Path(folder) / f"{scene.values.name}_{kind}.exr", samples, size)
                        for kind, assets in (("planned", planned), ("whole", whole)))
    mean = b.mean()
    out = {"mean": a.mean() / mean - 1}
    for name, n in (("pixels", 1), ("blocks", BLOCK)):
        difference, noise = _blocks(a - b, n), np.sqrt(_blocks(ea**2 + eb**2, n)) / n
        out[name] = np.sqrt(np.mean(difference**2)) / mean
        out[f"noise of {name}"] = np.sqrt(np.mean(noise**2)) / mean
    return {name: 100 * float(value) for name, value in out.items()}


def _blocks(image, n):
    height, width = (side // n * n for side in image.shape)
    return image[:height, :width].reshape(height // n, n, width // n, n).mean(axis=(1, 3))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", help="names of shipped scenes; all of them if none")
    parser.add_argument("--pictures", action="store_true")
    parser.add_argument("--samples", type=int, default=32)
    parser.add_argument("--width", type=int, default=128)
    options = parser.parse_args()
    names = options.scenes or sorted(path.stem for path in SCENES.glob("*.yaml"))
    ratios = []
    print("| scene | asking, s | planned, s | whole, s | ratio |\n|---|---|---|---|---|")
    for name in names:
        scene = scenes.load(SCENES / f"{name}.yaml", assets=False)
        with tempfile.TemporaryDirectory(prefix="bakery-requirements-") as folder:
            recipes = recipes_of(scene)
            done = {recipe: both(scene, recipe, folder) for recipe in dict.fromkeys(recipes)}
            asking, planned, whole = (sum(one[i] for one in done.values()) for i in (2, 3, 4))
            ratios.append(planned / whole)
            print(f"| {name} | {asking:.2f} | {planned:.2f} | {whole:.2f} | {planned / whole:.2f} |", flush=True)
            if options.pictures:
                assets = ([done[one][i] for one in recipes] for i in (0, 1))
                found = compared(scene, *assets, folder, options.samples, options.width)
                print("    " + ", ".join(f"{key} {value:.2g} %" for key, value in found.items()), flush=True)
    print(f"median ratio {np.median(ratios):.2f}")


if __name__ == "__main__":
    main()
