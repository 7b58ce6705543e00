"""Options that several commands share."""

from __future__ import annotations

import json
from dataclasses import replace

import click

from bakery.cli import offers
from bakery.errors import UsageError
from bakery.system.terminal import write

json_option = click.option("--json", "as_json", is_flag=True, help="Print the machine-readable twin of the report.")
quiet_option = click.option("--quiet", "-q", is_flag=True, help="Only errors on standard error.")
overwrite_option = click.option("--overwrite", is_flag=True,
                                help="Replace also a file of another kind that stands where an output goes.")
verbose_option = click.option("--verbose", "-v", is_flag=True, help="Say more on standard error.")


def recipe_options(command):
    """The options that choose stages and override recipe values."""
    for option in reversed((
        click.option("--stage", multiple=True, metavar="NAME", shell_complete=offers.stages,
                     help="Only this stage and what it needs; repeatable."),
        click.option("--scene", "scenes", type=click.Path(), multiple=True, metavar="FILE",
                     help="Bake what this scene needs and nothing else; repeatable: what any of them needs."),
        click.option("--quality", metavar="draft|preview|final", shell_complete=offers.among(offers.QUALITIES),
                     help="10 or 3 % of all light, or the recipe as it stands."),
        click.option("--tolerance", metavar="X", help="Error that each figure should reach, such as 2%."),
        click.option("--seed", metavar="N", help="Seed of every random stream."),
        click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override one recipe value; repeatable."),
    )):
        command = option(command)
    return command


def settings_of(quality, tolerance, seed, settings) -> dict[str, str]:
    """The recipe values that the options override."""
    from bakery.run import overrides

    values = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip():
            raise UsageError(f'--set: found "{setting}"; KEY=VALUE would do, such as --set particles.number_density="2e8 /m^3"')
        values[key.strip()] = value
    return overrides(quality, tolerance, seed, values)


def for_scenes(recipe, settings: dict[str, str], scenes, stages, cache, progress):
    """What to bake of a recipe for some scenes, `bakery.run.ensure.Asked`: their stages and knobs; what options say wins."""
    from bakery.run.ensure import Asked, asked, told

    if not scenes:
        return Asked(settings, tuple(stages), (), ())
    from renderers import requirements

    wanted = asked(recipe, settings, lambda values, medium: requirements.of(scenes, values, medium), cache, progress)
    for line in told(recipe, wanted, " and ".join(scenes)):
        click.echo(line, err=True)
    return replace(wanted, stages=tuple(stages)) if stages else wanted


def print_paths(paths) -> None:
    """What a command wrote, on standard output: one path a line and nothing else, for `$(bake fog.yaml)`."""
    write("".join(f"{path}\n" for path in paths))


def print_json(value) -> None:
    """One JSON document on standard output; NaN is not JSON, so it is refused rather than printed."""
    write(json.dumps(value, indent=2, allow_nan=False) + "\n")
