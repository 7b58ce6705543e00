"""Options that several commands share."""

from __future__ import annotations

import json

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
        click.option("--scene", type=click.Path(), metavar="FILE",
                     help="Bake also what this scene needs and the recipe does not ask for."),
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


def with_scene(recipe, settings: dict[str, str], scene) -> dict[str, str]:
    """The settings, and a section with its defaults for every stage that a scene needs and the recipe does not ask for."""
    if scene is None:
        return settings
    from bakery.run.ensure import with_stages
    from renderers.scene import needs

    settings, missing = with_stages(recipe, settings, needs(scene))
    for name in missing:
        click.echo(f"{recipe}: {name}, because {scene} needs it", err=True)
    return settings


def print_paths(paths) -> None:
    """What a command wrote, on standard output: one path a line and nothing else, for `$(bake fog.yaml)`."""
    write("".join(f"{path}\n" for path in paths))


def print_json(value) -> None:
    """One JSON document on standard output; NaN is not JSON, so it is refused rather than printed."""
    write(json.dumps(value, indent=2, allow_nan=False) + "\n")
