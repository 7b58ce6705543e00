"""`bake trade RECIPE` or `SCENE`: error against time over the knobs of every stage, or over the methods of a scene."""

import click

from bakery.cli import offers
from bakery.cli.options import for_scenes, overwrite_option, print_json, recipe_options, seed_of, settings_of, told_options
from bakery.errors import Interrupted, UsageError
from bakery.scenes import is_scene


@click.command(
    name="trade",
    short_help="measure error against time, of a recipe's settings or a scene's methods",
    epilog="Exit status: 0 done; 2 wrong usage, recipe or scene; 3 a stage failed; 130 interrupted.",
)
@click.argument("source", type=click.Path(), metavar="RECIPE|SCENE")
@click.option("-o", "--output", type=click.Path(), metavar="DIR or FILE.html",
              help="Folder of a recipe's results; page of a scene, or the folder for it.  Default: RECIPE.trade, NAME_trade.html "
                   "beside the scene.")
@recipe_options
@click.option("--methods", metavar="A,B,C", shell_complete=offers.scene_methods,
              help="For a scene: methods to measure, in place of all; written as for `bake compare`.")
@click.option("--measure", metavar="NAME",
              help="For a recipe: error to rank settings by, such as phase_pointwise.  Default: the stage's first.")
@click.option("--budget", type=float, default=5.0, show_default=True, metavar="MINUTES", help="Time that the runs may take.")
@overwrite_option
@told_options
def command(source, output, asked, methods, measure, budget, overwrite, told):
    """Measure true error against time: over settings of each stage of a RECIPE, or over the methods of a SCENE and their
    settings.

    Prints which settings are worth their time, and which meets the tolerance first.  For a recipe, DIR gets trade.csv, trade.json
    and a picture for each stage; for a scene, the page gets the pictures and differences of the best methods.  Finished runs are
    kept: the same call continues where it stopped.
    """
    from bakery.run.progress import choose
    from bakery.system.terminal import say

    scene = is_scene(source)
    if not scene and source.lower().endswith(".xml"):
        raise UsageError(f'found "{source}", which is no scene (.yaml); those of Mitsuba have no methods to measure')
    refused = {"stage": asked.stage, "scene": asked.scenes, "quality": asked.quality, "measure": measure} \
        if scene else {"methods": methods}
    for name, value in refused.items():
        if value:
            raise UsageError(f"--{name}: {source} is a {'scene' if scene else 'recipe'}, which has none; leave it out")
    values = settings_of(None, asked.tolerance, None if scene else asked.seed, asked.settings)
    progress = choose(told.quiet)
    try:
        if scene:
            value, lines = _of_scene(source, output, methods, values, seed_of(asked.seed), budget=budget, progress=progress,
                                     verbose=told.verbose, overwrite=overwrite)
        else:
            value, lines = _of_recipe(source, output, values, asked, measure=measure, budget=budget, progress=progress,
                                      verbose=told.verbose, overwrite=overwrite)
    except KeyboardInterrupt:
        raise Interrupted("interrupted; finished runs are kept, and the same call continues") from None
    finally:
        progress.close()
    if told.as_json:
        print_json(value)
        return
    for line in lines:
        say(line)


def _of_recipe(recipe, output, values, asked, *, progress, **options_of_trade):
    """What `--json` prints, and the lines for people."""
    from bakery.trade import trade
    from bakery.trade.tables import report

    wanted = for_scenes(recipe, values, asked.scenes, asked.stage, None, progress)
    result = trade(recipe, output, stages=wanted.stages, quality=asked.quality, settings=wanted.settings, progress=progress,
                   **options_of_trade)
    value, files = result.as_dict(), [str(file) for file in result.files]
    return value | {"files": files}, [*(line for sweep in value["stages"] for line in report(sweep, recipe)), *files]


def _of_scene(source, output, methods, values, seed, *, progress, verbose, **options_of_trade):
    """The same of a scene."""
    from bakery.cli.methods import lines
    from bakery.cli.trade_scene import report
    from bakery.scenes.trade import trade

    traded = trade(source, output, methods, values, seed, progress=progress, **options_of_trade)
    for line in lines(traded) if verbose else ():
        progress.say(line)
    return traded, [*report(traded), traded["page"]]
