"""`bake diff A B`: where the values of two assets differ."""

import os

import click

from bakery.cli.options import json_option, print_json
from bakery.errors import UsageError


@click.command(name="diff", short_help="compare the values of two assets")
@click.argument("a", type=click.Path(), metavar="A")
@click.argument("b", type=click.Path(), metavar="B")
@click.option("--rtol", default="0", show_default=True, metavar="X",
              help="Largest relative difference allowed, such as 1e-6 or 5%; 0 means equal numbers, as two bakes of one "
                   "recipe have.")
@json_option
def command(a, b, rtol, as_json):
    """Compare the values, shapes and units of two assets, or of two families at all points; provenance and hashes are ignored.

    Exit status 0 if they are equal, 1 if not: the table then names each dataset that differs, and where it differs most.
    """
    from bakery.asset.compare_families import compare_any

    rtol = _fraction(rtol)
    for asset in (a, b):
        if not os.path.exists(asset):
            raise UsageError(f"{asset}: there is no such file; expected the path of a baked asset")
    differences = compare_any(a, b, rtol)
    if as_json:
        print_json({"a": a, "b": b, "rtol": rtol, "equal": not differences, "differences": [_plain(row) for row in differences]})
    else:
        _print(a, b, rtol, differences)
    return int(bool(differences))


def _fraction(text: str) -> float:
    """`0.05` or `5%`."""
    from bakery.grammar.units import FRACTION, Wrong, parse

    try:
        value = parse(text, FRACTION)
    except Wrong:
        value = -1.0
    if value < 0:
        raise UsageError(f'--rtol: found "{text}"; expected a number from 0, such as 1e-6 or 5%')
    return value


def _plain(row) -> dict:
    """A difference in JSON's types: an infinite one is null beside its text."""
    from bakery.asset.summary import number

    return {"path": row.path, "kind": row.kind, "text": row.text, "absolute": number(row.absolute),
            "relative": number(row.relative), "standard_errors": number(row.sigmas)}


def _print(a: str, b: str, rtol: float, differences) -> None:
    from bakery.system.terminal import clean, say, table

    within = f" within {rtol:g}" if rtol else ""
    if not differences:
        say(f"equal{within}: {clean(a)} and {clean(b)}")
        return
    say(f"A = {clean(a)}")
    say(f"B = {clean(b)}")
    rows = [("dataset", "relative", "absolute", "std errors", "what")]
    rows += [(clean(row.path), _short(row.relative), _short(row.absolute), _short(row.sigmas), clean(f"{row.kind}: {row.text}"))
             for row in differences]
    for line in table(rows, right=(1, 2, 3)):
        say(line)


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
