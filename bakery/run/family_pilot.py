"""How many places a family will take: its refinement in advance, with media of one wavelength.

What decides where points are needed is how fast phase functions change along an axis, which one wavelength shows as well as all:
for recipes/clouds.yaml 27 points and 69 places, as the bake takes them, in a tenth of its time.
"""

import math
import time
from dataclasses import replace

from bakery.errors import RecipeError, StageError
from bakery.family.axes import points, settings
from bakery.family.refine import refined
from bakery.family.tree import optics_of
from bakery.plan import Plan, chosen
from bakery.run.executors import Context
from bakery.run.family_plan import Expected, FamilyPlan
from bakery.run.progress import Progress
from bakery.store.tree import Group

PATIENCE = 10.0  # seconds of the processor, after which a pilot ends with what it knows


class _Enough(Exception):
    """The pilot has taken its time."""


def foretold(plan: Plan | FamilyPlan, progress: Progress) -> Plan | FamilyPlan:
    """The plan of a family with what its refinement is expected to take; as it is where that is no question, where not even the
    first places would be over in `PATIENCE`, where kernels would have to be compiled, and where no point can be baked."""
    if not isinstance(plan, FamilyPlan) or not plan.write or not plan.middles or _first(plan) > PATIENCE:
        return plan
    pilot, sweep = _Pilot(plan), plan.recipe.sweep
    with progress.during("pilot of the places between points"):
        try:
            result = refined(sweep.axes, pilot.medium, sweep.tolerance, plan.recipe.measure == "integrated", lambda _: None)
        except _Enough:
            return replace(plan, expected=Expected(plan.points, max(len(pilot.media), plan.points + plan.middles), False))
        except StageError:
            return plan
    return replace(plan, expected=Expected(math.prod(map(len, result.values)), len(pilot.media), True))


def _first(plan: FamilyPlan) -> float:
    """Seconds that the pilot takes for points and middles of the recipe; infinite where it would compile."""
    of_medium = [stage.name for stage in chosen(plan.samples[0].recipe, ("medium",))]
    costs = [step.cost for sample in plan.samples for step in sample.steps if step.stage.name in of_medium]
    if any(cost.compiling for cost in costs):
        return math.inf
    per_place = sum(cost.seconds for cost in costs) / len(plan.samples) / len(plan.recipe.wavelength)
    return per_place * (plan.points + plan.middles)


class _Pilot:
    """Media of places at the middle one of the wavelengths; at all where the recipe gives values for each.

    media : by place, None where there is none
    """

    def __init__(self, plan: FamilyPlan):
        self._plan, self.media, self._begin = plan, {}, time.process_time()
        self._given = list(points([axis.first.values for axis in plan.recipe.sweep.axes]))
        wavelength = plan.recipe.wavelength
        self._settings = {"wavelengths": f"[{wavelength[len(wavelength) // 2]!r}]"}
        try:
            self._recipe(self._given[0])
        except RecipeError:
            self._settings = {}

    def _recipe(self, point):
        from bakery.recipe import load

        plan = self._plan
        return load(plan.recipe.path, plan.options["kept"] | settings(plan.recipe.sweep.axes, point) | self._settings)

    def medium(self, point):
        """As `refined` takes it.

        Raises StageError where none of the points that the recipe gives has a medium
        """
        if point not in self.media:
            if time.process_time() - self._begin > PATIENCE:
                raise _Enough
            try:
                self.media[point] = self._computed(self._recipe(point))
            except (RecipeError, StageError):
                self.media[point] = None
                if all(given in self.media and self.media[given] is None for given in self._given):
                    raise StageError("no point has a medium") from None
        return self.media[point]

    def _computed(self, recipe):
        groups = {}
        for stage in chosen(recipe, ("medium",)):
            result = stage.compute(stage.inputs(recipe, groups), Context(stage.tolerance(recipe), recipe.seed))
            groups[stage.name] = Group(result.members)
        return optics_of(groups["medium"])
