"""`bake query ASSET PATH [key=value …]`: one baked value, or one looked up; `bakery.asset.ask` finds it."""

import math

import click

from bakery.cli import offers
from bakery.cli.options import at_option, json_option, opened, print_json
from bakery.errors import UsageError

_BEYOND = 3  # digits of a figure from the first one of its error on


@click.command(name="query", short_help="print baked values, or values between them")
@click.argument("asset", type=click.Path(), metavar="ASSET")
@click.argument("path", metavar="PATH", shell_complete=offers.datasets)
@click.argument("arguments", nargs=-1, metavar="[key=value …]")
@at_option
@json_option
def command(asset, path, arguments, coordinates, as_json):
    """Print the value at PATH of ASSET, such as medium/sigma_t, or interpolate it at arguments with units.

    \b
    bake query fog.h5 medium/sigma_t wavelength=0.55um
    bake query fog.h5 medium/phase wavelength=0.55um theta=10deg
    bake query fog.h5 medium/phase "theta=[0, 90, 180] deg"
    bake query fog.h5 optics length=100m
    bake query fog.h5 medium/moments orders=64
    bake query milk.h5 multiple/point rho=1 z=2 theta=30deg
    bake query clouds.h5 medium/g --at radius=5um
    """
    from bakery.asset.ask import ask
    from bakery.stages.declaration import Answer
    from bakery.stages.optics.quantity_table import QuantityTable

    asked = opened(asset, coordinates)
    values = dict(_argument(word) for word in arguments)
    if len(values) < len(arguments):
        raise UsageError("the same argument twice; give each once")
    answer = ask(asked, path, values)
    if isinstance(answer, Answer):
        (_print_json if as_json else _print)(answer, _stage_of(asked.tree, answer))
    elif isinstance(answer, QuantityTable):
        _show_table(answer, as_json)
    else:
        _print_plain(path.strip("/"), answer, as_json)


def _show_table(quantities, as_json: bool) -> None:
    from bakery.system.terminal import clean, say, table

    if as_json:
        print_json(quantities.as_dict())
        return
    for block in quantities.rows(lambda value, error: _rounded(value, error if error > 0 else 0.0) if value is not error
                                 else f"{error:.2g}"):
        for line in table(block, right=range(2, len(block[0]))):
            say(line)
    for remark in quantities.remarks():
        say(f"# {clean(remark)}")


def _argument(word: str) -> tuple[str, str]:
    """`theta=10deg` as ("theta", "10deg")."""
    from bakery.asset.ask import ARGUMENTS

    key, equals, text = word.partition("=")
    if not equals:
        raise UsageError(f'found "{word}"; {ARGUMENTS}')
    return key, text


def _stage_of(root, answer) -> dict | None:
    """What the stage behind figures says of itself (`summary.stage`): where they have no error of their own, or where it misses.

    An error of exactly 0 is none: the figure follows from a formula, and how far that is from the truth is known to the stage.
    """
    from bakery.asset.summary import stage
    from bakery.stages.coordinates import COORDINATES

    name = answer.path.partition("/")[0]
    attributes = getattr(root.members[name], "attributes", {})
    coordinate = answer.path.rpartition("/")[2] in COORDINATES.values()  # where figures are, and itself known
    if coordinate or "achieved_error" not in attributes or answer.values.dtype.kind != "f":
        return None
    summary = stage(root, name)
    return summary if answer.error is None or not (answer.error > 0).any() or summary["missed"] else None


def _print_plain(path: str, value, as_json: bool) -> None:
    from bakery.asset.summary import number
    from bakery.system.terminal import clean, say, say_all

    if as_json:
        print_json({"path": path, "value": number(value)})
    elif isinstance(value, str) and "\n" in value:
        say_all(value)
    else:
        say(clean(value))


def _print_json(answer, stage) -> None:
    import numpy as np

    def plain(array):
        finite = np.where(np.isfinite(array), array, None) if array.dtype.kind == "f" else array
        return finite.tolist()

    print_json({
        "path": answer.path, "units": answer.units, "value": plain(answer.values),
        "axes": [{"name": name, "units": unit, "values": plain(at)} for name, unit, at in answer.axes],
        "error": None if answer.error is None else plain(answer.error),
        **{f"stage_{key}": stage and stage[key] for key in ("tolerance", "missed")},
        "stage_error": stage and stage["achieved_error"], "error_measure": stage["error_measure"] if stage else "",
        "methods": [dict(values) for remark in answer.remarks for values in remark.values],
        "remarks": [remark.text for remark in answer.remarks]})


def _print(answer, stage) -> None:
    from bakery.system.terminal import clean, say, table

    unit = "" if answer.units == "1" else f" {clean(answer.units)}"
    share = stage["achieved_error"] if stage is not None else None

    def figure(value, error=None):
        return _rounded(value, error or (share or 0.0) * abs(value)) if answer.values.dtype.kind == "f" else _digits(value)

    if answer.values.ndim == 0:
        error = f" +- {float(answer.error):.2g}" if answer.error is not None and answer.error > 0 else ""
        say(f"{figure(answer.values[()], answer.error)}{error}{unit}")
    else:
        for line in table(answer.rows(_digits, figure), right=range(answer.values.ndim + 64)):
            say(line)
    for remark in answer.remarks:
        say(f"# {clean(remark.text)}")
    if stage is not None and stage["missed"]:
        say(f"# MISSED by stage {stage['group']}: {clean(stage['missed'])}; the error is the {clean(stage['error_measure'])}")
    elif stage is not None:
        say(f"# error of the stage {stage['achieved_error']:.2g}: {clean(stage['error_measure'])}")


def _rounded(value, error) -> str:
    """A figure to two digits beyond the first one of its error: more say nothing of it; `--json` keeps all."""
    digits = _digits(value)
    if not (math.isfinite(value) and math.isfinite(error) and error > 0):
        return digits
    figures = max(math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) if value else 0, 0) + _BEYOND
    return digits if figures > 16 else f"{float(value):.{figures}g}"


def _digits(value) -> str:
    """As many digits as distinguish a float from its neighbours; texts as a terminal may show them."""
    from bakery.system.terminal import clean

    return clean(value.item() if hasattr(value, "item") else value)
