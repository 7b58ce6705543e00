"""`bake export ASSET --to FORMAT`: exports an asset to other software and reports the losses."""

from pathlib import Path

import click

from bakery.cli import offers
from bakery.cli.options import Listing, at_option, json_option, one_asset, overwrite_option, print_json, print_paths
from bakery.errors import AssetError, UsageError
from bakery.stages import sections_in_words
from bakery.system.terminal import remark


class _Export(Listing):
    """The command with the options that formats declare."""

    def get_params(self, ctx):
        from bakery.export.formats import exporters

        formats = exporters()
        to = click.Option(["--to", "target"], required=True, metavar="FORMAT",
                          shell_complete=offers.among({name: exporter.words for name, exporter in formats.items()}),
                          help="; ".join(f"{name}: {exporter.words}" for name, exporter in formats.items()))
        asset, *others = super().get_params(ctx)
        every = click.Option(["--list"], is_flag=True, is_eager=True, expose_value=False, callback=_print_formats,
                             help="Print what each format needs, holds and loses, and its options.")
        return [asset, to, every, *(self._option(option, names) for option, names in _options(formats).items()), *others]

    @staticmethod
    def _option(option, names):
        return click.Option([option.flag], is_flag=not option.metavar, metavar=option.metavar or None,
                            help=f"{', '.join(names)}: {option.words}")


def _print_formats(context, _parameter, asked) -> None:
    """Every format's declaration, and no more."""
    from bakery.export.formats import exporters
    from bakery.system.terminal import say

    if not asked or context.resilient_parsing:
        return
    if context.meta["json"]:
        keys = ("name", "words", "program", "takes", "holds", "loses")
        print_json([{key: getattr(exporter, key) for key in keys} | {"options": {o.flag: o.words for o in exporter.options}}
                    for exporter in exporters().values()])
        context.exit()
    for exporter in exporters().values():
        say(f"{exporter.name}: {exporter.words}")
        say(f"  for: {exporter.program}")
        say(f"  takes: {'stage ' + ' or '.join(exporter.takes) if exporter.takes else 'any asset'}")
        say(f"  holds: {exporter.holds}")
        say(f"  loses: {exporter.loses}")
        for option in exporter.options:
            say(f"  {' '.join(filter(None, (option.flag, option.metavar)))}: {option.words}")
    context.exit()


def _options(formats) -> dict:
    """Option -> names of the formats that take it."""
    return {option: [exporter.name for exporter in formats.values() if option in exporter.options]
            for exporter in formats.values() for option in exporter.options}


@click.command(name="export", cls=_Export, short_help="write an asset for other software")
@click.argument("asset", type=click.Path(), metavar="ASSET")
@click.option("-o", "--output", type=click.Path(), metavar="DIR",
              help="Folder of the files.  Default: NAME-FORMAT beside the asset.")
@at_option
@overwrite_option
@json_option
def command(asset, target, output, coordinates, overwrite, as_json, **given):
    """Write ASSET for other software.

    Prints the paths of the files on standard output, and what was lost on standard error, severe losses first.
    """
    from bakery.draw.files import folder_filled
    from bakery.export.declaration import Job
    from bakery.store.outputs import by_suffix, check_outputs
    from bakery.store.put import put_all
    from renderers import colour

    exporter, settings = _asked(target, given)
    job = Job(one_asset(asset, coordinates), colour, settings)
    _check(job.asset, exporter)
    written = exporter.write(job)
    for warning in written.warnings:
        remark(f"warning: {warning}")
    with folder_filled(Path(output) if output else Path(job.asset.path).with_name(f"{job.stem}-{target}")) as folder:
        check_outputs(by_suffix((folder / name for name in written.files), exporter.kinds), [asset], overwrite)
        paths = [str(path) for path in put_all({folder / name: content for name, content in written.files.items()})]
    if as_json:
        print_json({"files": paths, "warnings": list(written.warnings), "lost": list(written.losses)})
        return
    _print(paths, written.lines)


def _check(asset, exporter):
    """AssetError where an asset holds nothing of what a format takes, or a medium that cannot be."""
    from bakery.export.medium import impossible

    if "medium" in asset.stages and (faults := list(impossible(asset.tree["medium"]))):
        raise AssetError(f"{asset.path}: {faults[0]}; `bake verify` says what else is wrong, a new bake mends it")
    if not exporter.takes or any(stage in asset.stages for stage in exporter.takes):
        return
    stages = " or ".join(f"`{stage}`" for stage in exporter.takes)
    raise AssetError(f"{asset.name}: holds no stage {stages}, which {exporter.name} takes; bake it from a recipe with "
                     + sections_in_words(*exporter.takes))


def _asked(target, given):
    """The exporter, and the values of its options; UsageError where there is none of that name, or it does not take an option."""
    from bakery.export.formats import exporters

    formats = exporters()
    if target not in formats:
        from bakery.grammar.text import nearest

        raise UsageError(f'--to: found "{target}", which is no export format; expected {", ".join(formats)}'
                         f"{nearest(target, formats)}; `bake export --list` says what each holds")
    settings = {}
    for option, names in _options(formats).items():
        value = given[option.name]
        if value is None or value is False:
            continue
        if target not in names:
            raise UsageError(f"{option.flag}: has no effect on {target}; it is for {', '.join(names)}")
        settings[option.name] = option.parse(value) if option.metavar else True
    return formats[target], settings


def _print(paths, lines) -> None:
    """Paths; on standard error what belongs to each file, where `lines` is a list of such lists, and what belongs to all."""
    print_paths(paths)
    per_file = [line for line in lines if isinstance(line, list)]
    for path, about in zip(paths, per_file):
        remark(path)
        for line in about:
            remark(line)
    for line in lines:
        if not isinstance(line, list):
            remark(line)
