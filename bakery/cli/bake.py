"""`bake RECIPE…`: bake each recipe into one asset."""

import os
from typing import NamedTuple

import click

from bakery.cli.options import (
    for_scenes,
    gathered,
    overwrite_option,
    print_json,
    print_paths,
    recipe_options,
    settings_of,
    status_of_missed,
    sweep_option,
    told_options,
)
from bakery.errors import BakeryError, RecipeError, UsageError
from bakery.system.terminal import remark


class Run(NamedTuple):
    """Where and how far a bake runs."""

    jobs: int | None
    cluster: str | None
    force: bool
    keep_going: bool
    dry_run: bool


@click.command(
    name="bake",
    short_help="bake recipes into assets",
    epilog="Exit status: 0 done; 2 wrong usage or recipe; 3 a stage failed or misses its tolerance; 130 interrupted.",
)
@click.argument("recipes", nargs=-1, required=True, type=click.Path(), metavar="RECIPE…")
@click.option("-o", "--output", type=click.Path(), metavar="FILE or DIR/",
              help="Asset to write; DIR/ puts RECIPE.h5 into a folder.")
@recipe_options
@sweep_option
@gathered(
    "run", Run,
    click.option("--jobs", "-j", type=click.IntRange(1), metavar="N",
                 help="Threads for all recipes together; by default BAKERY_JOBS, or all processors."),
    click.option("--cluster", metavar="ADDRESS", help="Run the blocks on a Dask scheduler at this address."),
    click.option("--force", is_flag=True, help="Compute every stage again."),
    click.option("--keep-going", "-k", is_flag=True,
                 help="If one recipe, or one point of a sweep, is wrong or fails, bake the others."),
    click.option("--dry-run", is_flag=True, help="Print the plan and stop."))
@click.option("--depfile", type=click.Path(), metavar="FILE",
              help="Write the files that the asset depends on, in Make's syntax.")
@overwrite_option
@told_options
def command(recipes, output, asked, sweeps, run, depfile, overwrite, told):
    """Bake each RECIPE into one asset, named after the recipe's file (fog.yaml: fog.h5) unless -o is given.  A recipe that sweeps
    keys becomes a family of assets.

    Stages whose inputs did not change are reused, from the existing asset or from the cache.  Standard output gets the path of
    each asset and nothing else.  Several recipes share the processors; failed ones are listed at the end.
    """
    from bakery.run import files_of
    from bakery.run.bake import planned
    from bakery.run.cache import Cache
    from bakery.run.dask import check_address
    from bakery.run.progress import choose
    from bakery.store.outputs import ASSET, DEPFILE, check_outputs

    if len(recipes) > 1 and output and not output.endswith("/"):
        raise UsageError(f'-o: found "{output}" for {len(recipes)} recipes; write DIR/ to put each asset into a folder')
    if len(recipes) > 1 and depfile:
        raise UsageError(f"--depfile: names one asset, but there are {len(recipes)} recipes; use one call for each")
    if run.cluster is not None:
        check_address(run.cluster)
    progress = choose(told.quiet or run.dry_run)
    try:
        cache = Cache(say=progress.say)
        plans, problems, failures = {}, [], {}
        values = settings_of(asked.quality, asked.tolerance, asked.seed, asked.settings, sweeps)
        for index, recipe in enumerate(recipes):
            try:
                wanted = for_scenes(recipe, values, asked.scenes, asked.stage, cache, progress)
                plans[index] = planned(recipe, output, asked=wanted, keep_going=run.keep_going, force=run.force, cache=cache,
                                       jobs=run.jobs, overwrite=overwrite, progress=progress)
            except RecipeError as error:
                problems += error.problems
                failures[index] = str(error), error.exit_status
            except BakeryError as error:
                if not run.keep_going:
                    raise
                failures[index] = str(error), error.exit_status
        if problems and not run.keep_going:
            raise RecipeError(problems)
        _check_apart(recipes, plans)
        check_outputs([(plan.output, ASSET) for plan in plans.values()] + ([(depfile, DEPFILE)] if depfile else []),
                      [file for plan in plans.values() for file in (*files_of(plan.recipe), *plan.read)], overwrite)
        if run.dry_run:
            from bakery.cli.plan import show
            from bakery.run.family_pilot import foretold

            show([foretold(plan, progress) for plan in plans.values()], told.as_json, told.verbose)
            return _tell(recipes, failures, {}, run.keep_going) if failures else 0
        where = {"jobs": run.jobs, "cache": cache, "address": run.cluster, "progress": progress}
        return _baked(recipes, plans, failures, where, run.keep_going, depfile, told)
    finally:
        progress.close()


def _check_apart(recipes, plans) -> None:
    """UsageError where two recipes would become one asset."""
    targets = {}
    for index, plan in plans.items():
        earlier = targets.setdefault(os.path.realpath(plan.output), index)
        if earlier != index:
            raise UsageError(f"{recipes[earlier]} and {recipes[index]} would both become {plan.output}; "
                             "give each file its own name or bake them apart")


def _baked(recipes, plans, failures, where, keep_going, depfile, told) -> int:
    """Bake, print in the order of the recipes what came of it, and give the exit status; arguments as of the command."""
    from pathlib import Path

    from bakery.run.bake import executed
    from bakery.run.many import Outcome, bake_all

    order, progress = list(plans), where["progress"]
    if len(recipes) == 1 and order:
        outcomes = iter([Outcome(0, executed(plans[0], **where))])
    else:
        outcomes = bake_all([recipes[index] for index in order], list(plans.values()), keep_going=keep_going, **where)
    done, printed, missed = {}, 0, 0
    for outcome in outcomes:
        index = order[outcome.index]
        if outcome.baked is None:
            failures[index] = outcome.message, outcome.status
            continue
        done[index] = outcome.baked
        name = f"{recipes[index]}: " if len(recipes) > 1 else ""
        if depfile:
            from bakery.run import depfile as rules

            rules.write(Path(depfile), str(plans[index].output), [str(file) for file in outcome.baked.files])
        if told.verbose:
            for step in outcome.baked.steps:
                progress.say(f"{name}{step['stage']}: {step['source']} ({'; '.join(step['why'])})")
        if not told.as_json:
            printed = _print_paths(recipes, done, failures, printed)
            if not outcome.baked.written:
                progress.say(f"{name}{outcome.baked.output} is up to date")
        missed = max(missed, status_of_missed(outcome.baked.output, outcome.baked.missed))
    progress.close()
    if told.as_json:
        failed = {index: failures.get(index, ("not started", 0)) for index in range(len(recipes))}
        print_json([done[index].as_dict() if index in done else
                    {"recipe": str(recipe), "failed": failed[index][0], "status": failed[index][1]}
                    for index, recipe in enumerate(recipes)])
    else:
        _print_paths(recipes, done, dict.fromkeys(range(len(recipes))), printed)
    return max(_tell(recipes, failures, done, keep_going), missed)


def _print_paths(recipes, done, failures, printed: int) -> int:
    """Print the assets of the first recipes that have ended; how many of the recipes that makes."""
    while printed < len(recipes) and (printed in done or printed in failures):
        if printed in done:
            print_paths([done[printed].output])
        printed += 1
    return printed


def _tell(recipes, failures, done, keep_going: bool) -> int:
    """Say at the end which recipes failed, and how many were not started; the worst exit status."""
    unstarted = len(recipes) - len(failures) - len(done)
    if failures:
        advice = "" if keep_going else " (--keep-going bakes them)"
        addition = f", {unstarted} not started{advice}" if unstarted else ""
        remark(f"{len(failures)} of {len(recipes)} recipes failed{addition}:")
    for index, (message, _) in sorted(failures.items()):
        named = message if message.startswith(recipes[index]) else f"{recipes[index]}: {message}"
        remark(named)
    return max((status for _, status in failures.values()), default=0)
