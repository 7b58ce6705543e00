"""`bake plan SCENE`: the bakes that are due, and seconds, noise and memory of the picture, from a pilot."""

import math

from bakery.errors import UsageError
from bakery.system.terminal import say, warned


def refused(scene, options) -> None:
    """UsageError for an option of `bake plan` that has no meaning for scenes; options : name -> value."""
    for name, value in options.items():
        if value:
            raise UsageError(f"{name}: is for recipes, and {scene} is a scene; use --set KEY=VALUE for its values")


def planned(path, output, settings, quality, seed, overwrite, progress):
    """The plan of a scene's render, and where its pictures go.

    Raises BakeryError : what the render would raise before its first pass
    """
    from bakery.scenes.plan import plan
    from bakery.store.outputs import named
    from renderers import scene
    from renderers.pictures import images

    loaded = scene.load(path, settings)
    pair = images.output_pair(named(output, loaded.picture), loaded.inputs, overwrite)
    with warned(progress.say):
        return plan(loaded, quality=quality, seed=seed, progress=progress), pair


def as_dict(plan, pair) -> dict:
    """What `--json` prints of a scene."""
    forecast = plan.forecast
    return {"scene": str(plan.scene.path), "files": [str(path) for path in pair],
            "bakes": [{"asset": str(bake.asset), "due": bake.due, "plan": bake.plan and bake.plan.as_dict()}
                      for bake in plan.bakes],
            "render": forecast and forecast._asdict() | {"size": list(forecast.size), "missed": list(forecast.missed),
                                                         "remarks": list(forecast.remarks),
                                                         "choice": list(forecast.choice)},
            "seconds": plan.seconds, "memory": plan.memory}


def show(plan, pair) -> None:
    """Print it for people."""
    from bakery.system.memory import free_memory
    from bakery.system.resources import duration, in_words

    say(f"{plan.scene.path} -> {', '.join(map(str, pair))}")
    for bake in plan.bakes:
        if bake.due:
            say(f"  bake   {bake.plan.recipe.path} -> {bake.asset}: {duration(bake.seconds)}, "
                f"{in_words(bake.plan.memory)} memory, {in_words(bake.plan.file)} file")
        else:
            say(f"  reuse  {bake.asset}")
    if plan.forecast is None:
        say(f"  render {plan.scene.section}: unknown, because a pilot would have to bake that first")
    else:
        _show_forecast(plan)
    unknown = " and the picture" if plan.forecast is None else ""
    say(f"  in all {duration(plan.seconds)}{unknown}, {in_words(plan.memory)} memory")
    free = free_memory()
    if free is not None and plan.memory > free:
        say(f"  that is more than the {in_words(free)} of free memory: use a smaller film")


def _show_forecast(plan) -> None:
    from bakery.system.resources import duration, in_words
    from renderers.scene.budget import percent

    forecast, pilot = plan.forecast, plan.forecast.pilot
    wanted = f" of {percent(forecast.wanted)}" if forecast.wanted else ""
    noise = f", noise {percent(forecast.noise)}{wanted}" if forecast.noise is not None else ""
    ended = f", ended by {forecast.stopped_by}" if forecast.stopped_by else ""
    width, height = forecast.size
    say(f"  render {plan.scene.section} by {forecast.method}, {width} x {height}: {duration(forecast.seconds)}, "
        f"{in_words(forecast.memory)} memory{noise}{ended}")
    for line in forecast.choice:
        say(f"         {line}")
    samples = f", {pilot['samples']} samples a pixel" if pilot["samples"] is not None else ""
    scatter = f", noise {percent(pilot['noise'])}" if pilot["noise"] is not None else ""
    spread = f"; {_known(forecast)}" if forecast.spread else ""
    say(f"         pilot: {pilot['size'][0]} x {pilot['size'][1]}{samples} in {duration(pilot['seconds'])}{scatter}{spread}")
    for line in forecast.missed:
        say(f"         would be missed: {line}")
    for line in forecast.remarks:
        say(f"         expected: {line}")


def _known(forecast) -> str:
    """What the pilot leaves open by two standard errors: seconds to a noise, or noise where something else ends the passes."""
    if forecast.stopped_by == "noise":
        return f"it may take {math.exp(2 * forecast.spread):.2g} times as long"
    return f"it may have {math.exp(forecast.spread):.2g} times the noise"
