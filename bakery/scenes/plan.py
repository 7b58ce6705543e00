"""What `bake render SCENE` would bake and take: the bakes that are due, by their plans, and the picture, by a pilot.

Nothing is written beside the scene.  Assets that the pilot needs and that are still to be baked go into the cache, from which the
render takes them.
"""

import dataclasses
from pathlib import Path
from typing import NamedTuple

from bakery.plan import Plan
from bakery.run import execute
from bakery.run.cache import Cache
from bakery.run.ensure import Planned, bake_of, planned
from bakery.run.progress import Progress
from renderers.choice import pilot
from renderers.choice.pilot import Forecast
from renderers.scene import Scene, assets, budget, requirements

PATIENCE = 60.0  # s of bakes, above which there is no pilot


class Bake(NamedTuple):
    """The material of some bodies."""

    asset: Path  # where it is, or goes
    planned: Planned | None = None  # of its recipe; None of an asset that the scene names and that is there
    share: float = budget.HALF  # of the tolerance's square that its tables may take, see `renderers.scene.budget`

    @property
    def plan(self) -> Plan | None:
        """Of the bake; None where the asset is there."""
        return self.planned and self.planned.plan

    @property
    def seconds(self) -> float:
        """Of the bake, compiling included; 0 where none is due."""
        return self.plan.seconds if self.due else 0.0

    @property
    def due(self) -> bool:
        """Whether something is to be baked."""
        return self.plan is not None and self.plan.write


class ScenePlan(NamedTuple):
    """What a render would do."""

    scene: Scene  # `renderers.scene.Scene`
    bakes: tuple[Bake, ...]  # one a material
    forecast: Forecast | None  # of the picture; None where the bakes before a pilot take too long

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

    Raises BakeryError : what the render would raise before its first pass
    """
    progress = progress or Progress()
    cache = Cache(say=progress.say)
    bakes = {}
    for material in scene.materials:
        if (key := (material.asset, material.recipe)) not in bakes:
            bakes[key] = _bake(scene, material, cache, progress)
    if sum(bake.seconds for bake in bakes.values()) > PATIENCE:
        return ScenePlan(scene, tuple(bakes.values()), None)
    files = {key: _file(bake, cache, progress) for key, bake in bakes.items()}
    paths = tuple(files[material.asset, material.recipe] for material in scene.materials)
    ready = dataclasses.replace(scene, asset=paths[0], assets=paths, share=max(bake.share for bake in bakes.values()))
    with progress.during("rendering a pilot"):
        forecast = pilot.forecast(ready, quality=quality, variant=variant, seed=seed)
    return ScenePlan(scene, tuple(bakes.values()), forecast)


def _bake(scene, material, cache, progress) -> Bake:
    recipe, output, candidates = assets.recipe_of(scene, material)
    if recipe is None:
        return Bake(output)
    shares = [0.0]

    def require(*about):
        required = requirements.of_scene(scene, *about)
        shares.append(required.share)
        return required

    due = planned(recipe, require=require, cache=cache, progress=progress, candidates=candidates, output=output,
                  by=str(scene.path))
    return Bake(due.asset, due, max(shares))


def _file(bake: Bake, cache: Cache, progress: Progress) -> Path:
    """The asset of a bake: what stands where none is due, else one in the cache, from which the render takes it."""
    if not bake.due:
        return bake.asset
    plan, kept = bake.plan, bake.planned.kept
    if plan.output.name != kept.name:  # one that the scene names, which only a render writes
        plan = bake_of(bake.planned.asked, kept, True, cache, progress)
    return execute(plan, cache=cache, progress=progress).output
