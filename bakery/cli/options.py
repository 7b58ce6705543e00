"""Options that several commands share."""

import json
import math
import os
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import NamedTuple

import click

from bakery.cli import offers
from bakery.errors import UsageError
from bakery.grammar.qualities import QUALITIES
from bakery.system.terminal import remark, write


class FiniteRange(click.FloatRange):
    """A number in a range; unlike click's own it takes no nan, which compares false with every bound, and no infinity."""

    def convert(self, value, param, ctx):
        number = super().convert(value, param, ctx)
        return number if math.isfinite(number) else self.fail(f"{value!r} is not a finite number.", param, ctx)


class Listing(click.Command):
    """A command with an option `--list`, which is answered before others are read, and yet finds `context.meta["json"]`."""

    def parse_args(self, ctx, args):
        ctx.meta["json"] = "--json" in args
        return super().parse_args(ctx, args)


json_option = click.option("--json", "as_json", is_flag=True, help="Print the report as JSON.")
quiet_option = click.option("--quiet", "-q", is_flag=True, help="Print no progress, errors only.")
overwrite_option = click.option("--overwrite", is_flag=True,
                                help="Replace what is at the output path, even another kind of file or another recipe's.")
sweep_option = click.option("--sweep", "sweeps", multiple=True, metavar="KEY=VALUES",
                            help="Bake a family over values of a key, such as 'KEY=[2, 4, 8] um'; repeatable.")
at_option = click.option("--at", "coordinates", multiple=True, metavar="AXIS=VALUE",
                         help="For a family: interpolate the asset at this value, such as radius=5um; once for each axis.")
SEED = click.IntRange(0, 2**53)  # as recipes take it
verbose_option = click.option("--verbose", "-v", is_flag=True, help="Print reasons and details on standard error.")


def gathered(name: str, record: type, *options):
    """A decorator that gives a command several options as one record, whose fields have their names."""
    def decorate(command):
        @wraps(command)
        def called(**given):
            gathered_here = record(*(given.pop(field) for field in record._fields))
            return command(**given, **{name: gathered_here})

        for option in reversed(options):
            called = option(called)
        return called
    return decorate


class OfRecipe(NamedTuple):
    """Which stages of a recipe, for which scenes, and the values of it that are overridden."""

    stage: tuple[str, ...]
    scenes: tuple[str, ...]
    quality: str | None
    tolerance: str | None
    seed: str | None
    settings: tuple[str, ...]


class Told(NamedTuple):
    """For whom a command prints, and how much it says."""

    as_json: bool
    quiet: bool
    verbose: bool


recipe_options = gathered(
    "asked", OfRecipe,
    click.option("--stage", multiple=True, metavar="NAME", shell_complete=offers.stages,
                 help="Only this stage and the stages it needs; repeatable."),
    click.option("--scene", "scenes", type=click.Path(), multiple=True, metavar="FILE",
                 help="Bake only what this scene needs; repeatable: what any of the scenes needs."),
    click.option("--quality", metavar="|".join(QUALITIES), shell_complete=offers.qualities,
                 help="draft: a tolerance of 10 % for the light as a whole; preview: 3 %; final: the recipe as it is."),
    click.option("--tolerance", metavar="X", help="Relative error allowed in each baked quantity, such as 2%."),
    click.option("--seed", metavar="N", help="Seed of all random numbers."),
    click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override one recipe value; repeatable."))
told_options = gathered("told", Told, json_option, quiet_option, verbose_option)


def seed_of(text: str | None) -> int | None:
    """The seed of a scene's picture, where an option of recipes gives it as text."""
    # as many digits as the largest has: of thousands Python makes no number
    if text is not None and not (text.isdecimal() and len(text) <= len(str(SEED.max)) and int(text) <= SEED.max):
        raise UsageError(f'--seed: found "{text}"; expected a whole number from 0 to 2^53')
    return None if text is None else int(text)


def settings_of(quality, tolerance, seed, settings, sweeps=()) -> dict[str, str]:
    """The recipe values that the options override; `sweeps` stand below the key `sweep`."""
    from bakery.run import overrides

    values = dict(_pair("--set", setting, 'particles.number_density="2e8 /m^3"') for setting in settings)
    for key, value in _once("--sweep", sweeps, "'particles.components.droplets.size.radius=[2, 4, 8] um'").items():
        below = f"sweep.{key}"
        if below in values:
            raise UsageError(f'--sweep: found "{key}={value}", and --set "{below}={values[below]}"; give each once')
        values[below] = value
    return overrides(quality, tolerance, seed, values)


def _pair(option: str, text: str, example: str) -> tuple[str, str]:
    """`KEY=VALUE` as (key, value)."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise UsageError(f'{option}: found "{text}"; expected KEY=VALUE, such as {option} {example}')
    return key.strip(), value


def _once(option: str, texts, example: str) -> dict[str, str]:
    """Pairs of a repeatable option, each key given once."""
    given = {}
    for text in texts:
        key, value = _pair(option, text, example)
        if key in given:
            raise UsageError(f'{option}: found "{key}={given[key]}" and "{key}={value}"; give each once')
        given[key] = value
    return given


def opened(asset: str, coordinates):
    """What `bakery.open` gives for a file, of a family the asset at a place, where one is named: `AXIS=VALUE` each."""
    import bakery

    asset_or_family = bakery.open(asset)
    if not coordinates:
        return asset_or_family
    if not isinstance(asset_or_family, bakery.Family):
        raise UsageError(f"--at: {asset} is one asset, not a family; leave the option out")
    return asset_or_family.at(**_once("--at", coordinates, "radius=5um"))


def one_asset(asset: str, coordinates):
    """The same where a family as a whole will not do."""
    import bakery
    from bakery.family.members import counted

    asset_at_place = opened(asset, coordinates)
    if isinstance(asset_at_place, bakery.Family):
        axes = " ".join(f"--at {name}=…" for name in asset_at_place.axes)
        assets = counted([member.reason for member in asset_at_place.members])
        raise UsageError(f"{asset}: is a family of {assets}; {axes} interpolates one asset, and "
                         f"{asset_at_place.members[0].path.parent}/ holds the members")
    return asset_at_place


def file_of(asset, folder: str) -> str:
    """The file of an asset, for what reads files: one between the members of a family is put into a folder.

    So is a link to one whose name is no UTF-8, which Mitsuba does not open.
    """
    if hasattr(asset, "save"):
        return str(asset.save(Path(folder, Path(asset.path).name)))
    path = os.path.abspath(asset.path)
    try:
        path.encode()
    except UnicodeEncodeError:
        link = Path(folder, "asset.h5")
        link.symlink_to(path)
        return str(link)
    return asset.path


def for_scenes(recipe, settings: dict[str, str], scenes, stages, cache, progress):
    """What to bake of a recipe for some scenes, `bakery.plan.asked.Asked`: their stages and knobs; what options say wins."""
    from bakery.plan.asked import Asked
    from bakery.run.ensure import asked, told

    if not scenes:
        return Asked(settings, tuple(stages))
    from renderers.scene import requirements

    wanted = asked(recipe, settings, lambda *about: requirements.of(scenes, *about), cache, progress,
                   " and ".join(scenes))
    for line in told(recipe, wanted, " and ".join(scenes)):
        remark(line)
    return replace(wanted, stages=tuple(stages)) if stages else wanted


MISSED = 3  # exit status of a bake or a picture that is written and misses what was asked for


def status_of_missed(file, missed) -> int:
    """Say on standard error what a file misses, a line each, also where all else is quiet, and give the exit status."""
    for line in missed:
        remark(f"{file}: {line}")
    return MISSED if missed else 0


def print_paths(paths) -> None:
    """What a command wrote, on standard output: one path a line and nothing else, for `$(bake fog.yaml)`."""
    write("".join(f"{path}\n" for path in paths))


def print_json(value) -> None:
    """One JSON document on standard output; NaN is not JSON, so it is refused rather than printed."""
    write(json.dumps(value, indent=2, allow_nan=False) + "\n")
