"""Stages whose error and time are known, for the tests of `bake trade`: by name, so that a worker's process finds them too."""

import os
import signal
import time
from dataclasses import replace

import numpy as np

from bakery.errors import StageError
from bakery.stages.declaration import Cost, Knob, Result, Stage
from bakery.store.tree import Dataset, Group

RECIPE = """\
bakery: 1
name: drops
wavelengths: [0.55]
tolerance: 5%
seed: 10
particles:
  host: air
  number_density: 1e8 /m^3
  components:
    - {name: droplets, material: water, size: {distribution: lognormal, radius: 0.5 um, sigma: 1.2, min: 0.1 um, max: 3 um}}
"""


class Clock:
    """Seconds that pass only when a stage says so."""

    def __init__(self):
        self.now, self.factor = 0.0, lambda: 1.0

    def __call__(self) -> float:
        return self.now


CLOCK = Clock()


def seconds(tolerance: float, orders: int, seed: int) -> float:
    """The law of time of the stage `law`."""
    return 0.002 * orders * seed**0.5 / tolerance


def error(tolerance: float, orders: int, seed: int) -> float:
    """The law of its error."""
    return max(0.3 * tolerance, 0.4 * 10.0**-orders) + 0.1 / seed


def _passes(inputs, context) -> Result:
    CLOCK.now += seconds(**inputs) * CLOCK.factor()
    if inputs["orders"] == 2 and inputs["seed"] == 1:
        raise StageError("law: two orders and one node do not go together")
    return Result({"value": Dataset(np.array([1 + error(**inputs)]), "1", "1 and its error")}, 2 * error(**inputs))


def _values(recipe, upstream) -> dict:
    return {"tolerance": recipe.tolerance, "orders": recipe.phase.orders, "seed": recipe.seed}


def _difference(found: Group, reference: Group) -> dict:
    far = abs(float(found["value"].data[0] - reference["value"].data[0]))
    return {"error": far, "half": far / 2}


def _free(recipe) -> Cost:
    return Cost(seconds(recipe.tolerance, recipe.phase.orders, recipe.seed), 1.0, 1.0, "a law")


LAW = Stage(
    "law", 1, "a law", ("tolerance", "phase.orders", "phase.polarized", "seed", "wavelengths"), (),
    lambda recipe: recipe.particles is not None, (), "relative", _free, _values, _passes, lambda group: (),
    (Knob("tolerance", "tolerance", 0.01, "tolerance", ("30%", "20%", "10%", "5%", "3%")),
     Knob("orders", "phase.orders", 3, "orders", ("1", "2", "3")),
     Knob("nodes", "seed", 0, "stands for a number of nodes", ("1", "10", "100")),
     Knob("polarized", "phase.polarized", False, "does nothing here", ("false", "true"))),
    _difference, {"phase.orders": "5", "seed": "10000"})


def law() -> tuple[Stage, ...]:
    return (LAW,)


def newer() -> tuple[Stage, ...]:
    return (replace(LAW, version=2),)


UPSTREAM = []  # tolerances at which the next stage was given its upstream


def _after(recipe, upstream) -> dict:
    UPSTREAM.append(float(upstream["law"]["value"].data[0]))
    return _values(recipe, upstream)


def chain() -> tuple[Stage, ...]:
    """The same law after another stage."""
    return (replace(LAW, knobs=()), replace(LAW, name="after", needs=("law",), inputs=_after))


# ---- in a process of its own, on a real clock


def _works(inputs, context) -> Result:
    if inputs["orders"] == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    size = {1: 8, 10: 64}.get(inputs["seed"], 16)
    until = time.process_time() + 2e-5 / inputs["tolerance"]
    held = np.ones(size << 17)  # so many MiB
    while time.process_time() < until:
        context.report(0.5)
    return Result({"value": Dataset(np.array([held[0] + inputs["tolerance"] / 3]), "1", "1 and its error")}, inputs["tolerance"])


WORKING = replace(
    LAW, compute=_works, cost=lambda recipe: Cost(2e-5 / recipe.tolerance, 1.0, 1.0, "a law"), reference={},
    knobs=(replace(LAW.knobs[0], values=("30%", "10%")), replace(LAW.knobs[1], values=("2", "3")),
           replace(LAW.knobs[2], values=("1", "10"))))


def working() -> tuple[Stage, ...]:
    return (WORKING,)


def slow() -> tuple[Stage, ...]:
    def wait(inputs, context):
        time.sleep(0.05)
        return _works({**inputs, "orders": 3}, context)

    return (replace(WORKING, compute=wait),)


# ---- the real one


def optics() -> tuple[Stage, ...]:
    from bakery.stages import measures
    from bakery.stages.optics.stage import STAGE

    return (replace(STAGE, knobs=(Knob("tolerance", "tolerance", 0.01, "tolerance", ("30%",)),), reference={},
                    measures=measures.optics),)
