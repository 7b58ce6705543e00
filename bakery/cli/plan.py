"""`bake plan RECIPE|SCENE`: what a bake would run, why, and what it will cost; of a scene what its render will."""

import click

from bakery.cli.options import (
    for_scenes,
    json_option,
    overwrite_option,
    print_json,
    recipe_options,
    seed_of,
    settings_of,
    sweep_option,
    verbose_option,
)
from bakery.system.terminal import remark, say


@click.command(name="plan", short_help="show what a bake or a render would run, why, and what it will cost")
@click.argument("recipes", nargs=-1, required=True, type=click.Path(), metavar="RECIPE|SCENE…")
@click.option("-o", "--output", type=click.Path(), metavar="FILE or DIR/", help="Asset or picture that would be written.")
@recipe_options
@sweep_option
@click.option("--jobs", "-j", type=click.IntRange(1), metavar="N", help="Threads that the bake would use.")
@click.option("--force", is_flag=True, help="Plan to compute every stage again.")
@overwrite_option
@json_option
@verbose_option
def command(recipes, output, asked, sweeps, jobs, force, overwrite, as_json, verbose):
    """Show what `bake RECIPE` would run, why, and what it will cost in time, memory and file size.  Runs nothing.

    For a SCENE: what `bake render SCENE` would bake, and the time, noise and memory of its picture, from a pilot (small pictures
    of few passes).  The pilot may bake into the cache; nothing else is written.
    """
    from bakery.cli import plan_scene
    from bakery.run.bake import planned
    from bakery.run.cache import Cache
    from bakery.run.family_pilot import foretold
    from bakery.run.progress import choose
    from bakery.scenes import is_scene

    values = settings_of(asked.quality, asked.tolerance, asked.seed, asked.settings, sweeps)
    progress = choose()
    try:
        cache, plans = Cache(say=progress.say), []
        for recipe in recipes:
            if is_scene(recipe):
                plan_scene.refused(recipe, {"--stage": asked.stage, "--scene": asked.scenes, "--sweep": sweeps, "--jobs": jobs,
                                            "--force": force})
                plans.append(plan_scene.planned(recipe, output, settings_of(None, asked.tolerance, None, asked.settings),
                                                asked.quality, seed_of(asked.seed), overwrite, progress))
                continue
            wanted = for_scenes(recipe, values, asked.scenes, asked.stage, cache, progress)
            plan = planned(recipe, output, asked=wanted, force=force, cache=cache, jobs=jobs, overwrite=overwrite,
                           progress=progress)
            plans.append(foretold(plan, progress))
    finally:
        progress.close()
    show(plans, as_json, verbose)


def show(plans, as_json: bool, verbose: bool = False) -> None:
    """Print plans, for people or for machines."""
    from bakery.cli import plan_scene

    if as_json:
        print_json([plan_scene.as_dict(*plan) if isinstance(plan, tuple) else plan.as_dict() for plan in plans])
        return
    from bakery.system.resources import duration, in_words

    for plan in plans:
        if isinstance(plan, tuple):
            plan_scene.show(*plan)
            continue
        for warning in plan.recipe.warnings:
            remark(f"warning: {warning}")
        if plan.recipe.sweep is not None:
            _show_family(plan)
            continue
        say(f"{plan.recipe.path} -> {plan.output}" + ("" if plan.write else "   up to date, nothing to do"))
        for line in plan.missed:
            say(f"  missed {line}")
        for step in plan.steps:
            once = f" and {duration(step.cost.compiling)} for compiling kernels, once" if step.cost.compiling else ""
            cost = (f"{duration(step.cost.seconds)}{once}, {in_words(step.cost.memory)} memory, " if step.action == "run" else "")
            say(f"  {step.action:<6} {step.stage.name:<8} {cost}{in_words(step.cost.file)} in the file")
            shown = step.why if verbose else step.why[:6]
            for reason in shown:
                say(f"         because {reason}")
            if len(step.why) > len(shown):
                say(f"         and {len(step.why) - len(shown)} more (--verbose)")
            if plan.needs:
                _say_needs(plan, step.stage)
            for reason in step.cost.remarks:
                say(f"         {reason}")
            if verbose:
                say(f"         input {step.input_hash}")
                say(f"         estimate: {step.cost.basis}")
        for need in plan.needs:
            if not need.needed:
                say(f"  leave  {need.stage:<8} not needed: {need.why}")
        if plan.write:
            say(f"  in all  {duration(plan.seconds)}, {in_words(plan.memory)} memory, {in_words(plan.file)} file")


def _show_family(plan) -> None:
    """What a swept recipe would bake."""
    from bakery.system.resources import duration, in_words

    idle = "" if plan.write else "   up to date, nothing to do"
    say(f"{plan.recipe.path} -> {plan.output}, members in {plan.folder}/{idle}")
    for line in plan.missed:
        say(f"  missed {line}")
    for axis in plan.recipe.sweep.axes:
        for key in axis.keys:
            ends = " to ".join(dict.fromkeys((key.texts[0], key.texts[-1])))
            step = f", in step with {axis.first.name}" if key is not axis.first else ""
            say(f"  axis   {key.name:<8} {_counted(len(key.values), 'value')}, {ends} ({key.key}){step}")
    if not plan.write:
        return
    say(f"  bake   {_counted(plan.points, 'point')}, by the plans of {len(plan.samples)}")
    if plan.middles:
        say(f"         and {_counted(plan.middles, 'place')} between them at least; where interpolation is off by more than "
            f"{plan.recipe.sweep.tolerance:g} they become points")
    expected = plan.expected
    if expected and expected.complete:
        say(f"         {_counted(expected.points, 'point')} of {_counted(expected.places, 'place')} in the end, by a pilot")
    elif expected:
        say(f"         {_counted(expected.places, 'place')} or more in the end, by a pilot that was cut off")
    say(f"  in all  {duration(plan.seconds)}, {in_words(plan.memory)} memory, {in_words(plan.file)} in files"
        + (" before any is added" if plan.middles and not expected else " or more" if expected and not expected.complete else ""))


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'s' * (count != 1)}"


def _say_needs(plan, stage) -> None:
    """Why the scenes need a stage, what of its knobs they decide, and what stays as the recipe has it."""
    need = next((each_need for each_need in plan.needs if each_need.stage == stage.name and each_need.needed), None)
    if need is None:
        users = [step.stage.name for step in plan.steps if stage.name in step.stage.needs]
        say(f"         needed by {' and '.join(users)}")
        return
    say(f"         needed: {need.why}")
    for knob in need.knobs:
        say(f"         {knob.key} {knob.text}: {knob.why}")
    if need.lacking:
        say(f"         out of reach: {need.lacking}")
    if kept := plan.kept(stage):
        say(f"         as the recipe has it: {', '.join(kept)}")
