"""`bake verify ASSET…`: integrity and physics."""

from __future__ import annotations

import os

import click

from bakery.cli.options import json_option, print_json
from bakery.errors import UsageError


@click.command(name="verify", short_help="check an asset's integrity and physics")
@click.argument("assets", nargs=-1, required=True, type=click.Path(), metavar="ASSET…")
@json_option
def command(assets, as_json):
    """Check every byte (checksums) and the physics (normalisation, energy, ranges) of each ASSET.

    Exit status 1 if a rule is broken, 2 if a file is missing.
    """
    from bakery.verify import verify

    missing = [asset for asset in assets if not os.path.exists(asset)]
    if missing:
        raise UsageError("\n".join(f"{asset}: there is no such file; the path of a baked asset would do" for asset in missing))
    found = []
    for asset in assets:
        found.append((asset, verify(asset)))
        if not as_json:
            _print(*found[-1])
    if as_json:
        print_json([{"file": asset, "ok": not broken, "broken": broken} for asset, broken in found])
    return int(any(broken for _, broken in found))


def _print(asset: str, broken: list[str]) -> None:
    from bakery.report.text import clean, say

    if broken:
        say(f"broken  {clean(asset)}")
        for rule in broken:
            say(f"        {clean(rule)}")
        return
    say(f"ok      {clean(asset)}  checksums, format and physics hold")
