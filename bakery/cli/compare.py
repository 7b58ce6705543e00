"""`bake compare SCENE --methods a,b,c`: one scene by several methods, beside one another on one page."""

from pathlib import Path
from typing import NamedTuple

import click

from bakery.cli import offers
from bakery.cli.options import (
    SEED,
    Listing,
    gathered,
    json_option,
    overwrite_option,
    print_json,
    print_paths,
    quiet_option,
    settings_of,
    status_of_missed,
)
from bakery.errors import Interrupted, UsageError
from bakery.grammar import qualities
from bakery.system.terminal import say


def _print_methods(context, _parameter, asked) -> None:
    """What methods declare, and no more."""
    if asked and not context.resilient_parsing:
        from bakery.cli.methods import declarations, declared_lines

        if context.meta["json"]:
            print_json(list(declarations()))
            context.exit()
        for line in declared_lines():
            say(line)
        context.exit()


class _Pictures(NamedTuple):
    """What is asked of the pictures, by each method."""

    seconds: str | None
    noise: str | None
    quality: str | None
    variant: str | None
    seed: int | None
    settings: tuple[str, ...]
    resume: bool
    force: bool


@click.command(name="compare", cls=Listing, short_help="render a scene with several methods and compare them")
@click.argument("source", type=click.Path(), metavar="SCENE")
@click.option("--methods", required=True, metavar="A,B,C", shell_complete=offers.scene_methods,
              help="Methods to compare (--list names them); METHOD:KEY=VALUE also sets a key of the material.")
@click.option("--list", is_flag=True, is_eager=True, expose_value=False, callback=_print_methods,
              help="Print the methods of each kind of material: which light each brings and leaves out, its error, its keys.")
@click.option("--reference", metavar="METHOD|FILE.exr", help="Reference for the others.  [default: the first method]")
@click.option("-o", "--output", type=click.Path(), metavar="FILE.html or DIR/",
              help="The page; its pictures go into a folder of the same name.  Default: NAME_compare.html beside the scene.")
@gathered(
    "asked", _Pictures,
    click.option("--time", "seconds", metavar="TIME",
                 help="Stop each method after this time, such as 60s, in place of the scene's stop.time."),
    click.option("--noise", metavar="X", help="Stop each method at this noise, such as 2%, in place of the scene's stop.noise."),
    click.option("--quality", metavar="|".join(qualities.QUALITIES), shell_complete=offers.qualities,
                 help="draft: 4 times the noise that the scene asks for; preview: twice.  [default: final, as the scene asks]"),
    click.option("--variant", metavar="NAME", help="Mitsuba variant, such as llvm_ad_rgb.  [default: the best that runs here]"),
    click.option("--seed", type=SEED, metavar="N",
                 help="Seed of the random numbers; each method gets others from it.  [default: 0]"),
    click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override one value of the scene; repeatable."),
    click.option("--resume", is_flag=True, help="Also add samples to pictures that an earlier call finished."),
    click.option("--force", is_flag=True, help="Render every method again."))
@overwrite_option
@json_option
@quiet_option
def command(source, methods, reference, output, asked, overwrite, as_json, quiet):
    """Render SCENE (.yaml) with several methods and write one page: the pictures with a slider between any two, signed
    differences from the reference, errors beneath the noise, FLIP, error against time, and what each method leaves out.

    Existing pictures are not rendered again, and interrupted ones continue.  Prints the paths of the page and of the pictures.
    Exit status 3 if a method misses the noise or tolerance that the scene asks for.
    """
    from bakery.cli.methods import lines
    from bakery.run.progress import choose
    from bakery.scenes import compare

    if Path(source).suffix.lower() not in (".yaml", ".yml"):
        raise UsageError(f'found "{source}", which is no scene (.yaml); only scenes have methods to compare')
    if asked.resume and asked.force:
        raise UsageError("--resume continues existing pictures, --force starts again; use one of them")
    qualities.quality(asked.quality)
    stop = [f"stop.{key}={value}" for key, value in (("time", asked.seconds), ("noise", asked.noise)) if value is not None]
    values = settings_of(None, None, None, [*asked.settings, *stop])
    jobs, page, file = compare.planned(source, methods, reference, output, values, asked.seed, asked.resume, overwrite)
    progress = choose(quiet)
    try:
        summary = compare.compared(jobs, page, reference or jobs[0].name, file, progress, quality=asked.quality,
                                   variant=asked.variant, resume=asked.resume, force=asked.force, overwrite=overwrite)
    except KeyboardInterrupt:
        raise Interrupted("interrupted; finished pictures are kept, and the same call continues") from None
    finally:
        progress.close()
    missed = max(status_of_missed(method["files"][0], method["missed"]) for method in summary["methods"])
    if as_json:
        print_json(summary)
        return missed
    print_paths([summary["page"], *(path for method in summary["methods"] for path in method["files"])])
    trade = summary["trade"] or {"advice": [], "others": []}
    for line in [*lines(summary), *trade["advice"], *trade["others"], *summary["remarks"]]:
        progress.say(line)
    return missed
