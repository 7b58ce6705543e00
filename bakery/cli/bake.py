"""`bake RECIPE…`: bake each recipe into one asset."""

from __future__ import annotations

import os

import click

from bakery.cli.options import (
    for_scenes,
    json_option,
    overwrite_option,
    print_json,
    print_paths,
    quiet_option,
    recipe_options,
    settings_of,
    sweep_option,
    verbose_option,
)
from bakery.errors import RecipeError, UsageError


@click.command(
    name="bake",
    short_help="bake recipes into assets",
    epilog="Exit status: 0 done; 2 wrong usage or recipe; 3 a stage failed or misses its tolerance; 130 interrupted.",
)
@click.argument("recipes", nargs=-1, required=True, type=click.Path(), metavar="RECIPE…")
@click.option("-o", "--output", type=click.Path(), metavar="FILE or DIR/",
              help="Asset to write; DIR/ puts NAME.h5 into a folder.")
@recipe_options
@sweep_option
@click.option("--jobs", "-j", type=click.IntRange(1), metavar="N", help="Threads; all processors by default (or BAKERY_JOBS).")
@click.option("--cluster", metavar="ADDRESS", help="Run the blocks on a Dask scheduler at this address.")
@click.option("--force", is_flag=True, help="Compute every stage again, whatever is known.")
@click.option("--dry-run", is_flag=True, help="Print the plan and stop.")
@click.option("--depfile", type=click.Path(), metavar="FILE",
              help="Write the files that the asset depends on, in Make's syntax.")
@overwrite_option
@json_option
@quiet_option
@verbose_option
def command(recipes, output, stage, scenes, quality, tolerance, seed, settings, sweeps, jobs, cluster, force, dry_run, depfile,
            overwrite, as_json, quiet, verbose):
    """Bake each RECIPE into one asset, NAME.h5 unless -o says otherwise; a recipe that sweeps keys into a family of them.

    Stages whose inputs did not change are reused, from the asset that stands or from the cache.  Prints the path of each asset,
    and nothing else, on standard output.
    """
    from pathlib import Path

    from bakery.run import files_of
    from bakery.run.bake import executed, planned
    from bakery.run.cache import Cache
    from bakery.run.progress import Named, choose
    from bakery.store.outputs import ASSET, DEPFILE, check_outputs

    if len(recipes) > 1 and output and not output.endswith("/"):
        raise UsageError(f'-o: found "{output}" for {len(recipes)} recipes; write DIR/ to put each NAME.h5 into a folder')
    if len(recipes) > 1 and depfile:
        raise UsageError(f"--depfile: names one asset, but there are {len(recipes)} recipes; one call a recipe would do")
    progress = choose(quiet or dry_run)
    try:
        cache = Cache(say=progress.say)
        plans, problems = [], []
        values = settings_of(quality, tolerance, seed, settings, sweeps)
        for recipe in recipes:
            try:
                wanted = for_scenes(recipe, values, scenes, stage, cache, progress)
                plans.append(planned(recipe, output, stages=wanted.stages, settings=wanted.settings, force=force, cache=cache,
                                     jobs=jobs, overwrite=overwrite, progress=progress, needs=wanted.needs))
            except RecipeError as error:
                problems += error.problems
        if problems:
            raise RecipeError(problems)
        targets = [os.path.realpath(plan.output) for plan in plans]
        for i, target in enumerate(targets):
            if target in targets[:i]:
                raise UsageError(f"{recipes[targets.index(target)]} and {recipes[i]} would both become {plans[i].output}; "
                                 "give each its own name or bake them apart")
        check_outputs([(plan.output, ASSET) for plan in plans] + ([(depfile, DEPFILE)] if depfile else []),
                      [file for plan in plans for file in files_of(plan.recipe)] + list(scenes), overwrite)
        if dry_run:
            from bakery.cli.plan import show

            show(plans, as_json, verbose)
            return
        reports = []
        for recipe, plan in zip(recipes, plans, strict=True):
            reporter = Named(progress, recipe) if len(plans) > 1 else progress
            baked = executed(plan, cache=cache, jobs=jobs, address=cluster, progress=reporter)
            if depfile:
                from bakery.run import depfile as rules

                rules.write(Path(depfile), str(plan.output), [str(file) for file in baked.files])
            if verbose:
                for step in baked.steps:
                    reporter.say(f"{step['stage']}: {step['source']} ({'; '.join(step['why'])})")
            reports.append(baked.as_dict())
            if not as_json:
                print_paths([baked.output])
                if not baked.written:
                    reporter.say(f"{baked.output} is up to date")
            for miss in baked.missed:
                click.echo(f"{baked.output}: {miss}", err=True)
        if as_json:
            print_json(reports)
        return 3 if any(report["missed"] for report in reports) else 0
    finally:
        progress.close()
