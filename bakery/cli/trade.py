"""`bake trade RECIPE`: error against time over the knobs of every stage."""

from __future__ import annotations

import click

from bakery.cli.options import (
    for_scenes,
    json_option,
    overwrite_option,
    print_json,
    quiet_option,
    recipe_options,
    settings_of,
    verbose_option,
)
from bakery.errors import Interrupted


@click.command(
    name="trade",
    short_help="measure error against time over the knobs of every stage",
    epilog="Exit status: 0 done; 2 wrong usage or recipe; 3 a stage failed; 130 interrupted.",
)
@click.argument("recipe", type=click.Path(), metavar="RECIPE")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Folder of the results.  Default: NAME.trade.")
@recipe_options
@click.option("--measure", metavar="NAME", help="Error that ranks the settings.  Default: the stage's first.")
@click.option("--budget", type=float, default=5.0, show_default=True, metavar="MINUTES", help="Time that the runs may take.")
@overwrite_option
@json_option
@quiet_option
@verbose_option
def command(recipe, output, stage, scenes, quality, tolerance, seed, settings, measure, budget, overwrite, as_json, quiet,
            verbose):
    """Measure true error against time over the knobs of each stage of RECIPE.

    Prints the settings that are worth their time, the cheapest one for the requested tolerance, and where draft, preview and
    final lie.  DIR gets trade.csv, trade.json and a picture a stage.  Finished runs are kept there: the same call goes on where
    it stopped.
    """
    from bakery.run.progress import choose
    from bakery.system.terminal import say
    from bakery.trade import trade
    from bakery.trade.tables import report

    progress = choose(quiet)
    try:
        wanted = for_scenes(recipe, settings_of(None, tolerance, seed, settings), scenes, stage, None, progress)
        result = trade(recipe, output, stages=wanted.stages, quality=quality, settings=wanted.settings, measure=measure,
                       budget=budget, progress=progress, verbose=verbose, overwrite=overwrite)
    except KeyboardInterrupt:
        raise Interrupted("interrupted; finished runs are kept, the same call goes on") from None
    finally:
        progress.close()
    if as_json:
        print_json(result.as_dict() | {"files": [str(file) for file in result.files]})
        return
    for sweep in result.as_dict()["stages"]:
        for line in report(sweep, recipe):
            say(line)
    for file in result.files:
        say(str(file))
