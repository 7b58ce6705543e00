"""What `bake render SCENE` would bake and take: the bakes that are due, by their plans, and the picture, by a pilot.

Nothing is written beside the scene.  Where assets of the pilot are still to be baked, their stages go into the cache, from which
the render takes them.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path
from typing import NamedTuple

from bakery.plan import Plan
from bakery.run import execute, prepare
from bakery.run.cache import Cache
from bakery.run.ensure import Asked, planned
from bakery.run.progress import Progress
from renderers import assets, budget, pilot, requirements
from renderers.pilot import Forecast
from renderers.scene import Scene

PATIENCE = 60.0  # s of bakes, above which there is no pilot


class Bake(NamedTuple):
    """The material of some bodies.

    Attributes
    ----------
    asset : where it is, or goes
    plan : of its bake; None of an asset that the scene names and that is there
    asked : what the scene asks of it, or None
    share : of the tolerance's square that its tables may take, see `renderers.budget`
    """

    asset: Path
    plan: Plan | None = None
    asked: Asked | None = None
    share: float = budget.HALF

    @property
    def seconds(self) -> float:
        """Of the bake, compiling included; 0 where none is due."""
        return self.plan.seconds if self.due else 0.0

    @property
    def due(self) -> bool:
        """Whether something is to be baked."""
        return self.plan is not None and self.plan.write


class ScenePlan(NamedTuple):
    """What a render would do.

    Attributes
    ----------
    scene : `renderers.scene.Scene`
    bakes : one a material
    forecast : of the picture; None where the bakes before a pilot take too long
    """

    scene: Scene
    bakes: tuple[Bake, ...]
    forecast: Forecast | None

    @property
    def seconds(self) -> float:
        """Of the bakes and, where it is known, of the picture."""
        return sum(bake.seconds for bake in self.bakes) + (self.forecast.seconds if self.forecast else 0.0)

    @property
    def memory(self) -> float:
        """Bytes at the peak, of what is known."""
        return max([bake.plan.memory for bake in self.bakes if bake.due]
                   + ([self.forecast.memory] if self.forecast else []), default=0.0)


def plan(scene: Scene, *, quality=None, variant=None, seed=None, progress: Progress | None = None) -> ScenePlan:
    """The plan of a scene; arguments as renderers take them.

    Raises
    ------
    BakeryError : what the render would raise before its first pass
    """
    progress = progress or Progress()
    cache = Cache(say=progress.say)
    bakes = {}
    for material in assets.materials(scene):
        if (key := (material.asset, material.recipe)) not in bakes:
            bakes[key] = _bake(scene, material, cache, progress)
    if sum(bake.seconds for bake in bakes.values()) > PATIENCE:
        return ScenePlan(scene, tuple(bakes.values()), None)
    with tempfile.TemporaryDirectory(prefix="bakery-plan-") as folder:
        files = {key: _file(bake, folder, number, cache, progress) for number, (key, bake) in enumerate(bakes.items())}
        paths = tuple(files[material.asset, material.recipe] for material in assets.materials(scene))
        ready = dataclasses.replace(scene, asset=paths[0], assets=paths, share=max(bake.share for bake in bakes.values()))
        with progress.during("rendering a pilot"):
            forecast = pilot.forecast(ready, quality=quality, variant=variant, seed=seed)
    return ScenePlan(scene, tuple(bakes.values()), forecast)


def _bake(scene, material, cache, progress) -> Bake:
    recipe, output = assets.recipe_of(scene, material)
    if recipe is None:
        return Bake(Path(output))
    shares = [0.0]

    def require(*about):
        required = requirements.of_scene(scene, *about)
        shares.append(required.share)
        return required

    its, asked = planned(recipe, output, require=require, cache=cache, progress=progress, by=str(scene.path))
    return Bake(its.output, its, asked, max(shares))


def _file(bake: Bake, folder: str, number: int, cache: Cache, progress: Progress) -> Path:
    """The asset of a bake: what stands where none is due, else one in a folder."""
    if not bake.due:
        return bake.asset
    due = prepare(bake.plan.recipe.path, Path(folder, f"{number}.h5"), cache=cache, progress=progress, **bake.asked.of_plan)
    return execute(due, cache=cache, progress=progress).output
