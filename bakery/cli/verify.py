"""`bake verify ASSET…`: integrity and physics."""

import os

import click

from bakery.cli.options import json_option, print_json
from bakery.errors import StoreError


@click.command(name="verify", short_help="check an asset's integrity and physics")
@click.argument("assets", nargs=-1, required=True, type=click.Path(), metavar="ASSET…")
@json_option
def command(assets, as_json):
    """Check every byte (checksums) and the physics (normalisation, energy, ranges) of each ASSET.

    All assets are checked, whatever the result of others.  Exit status 1 if a rule is broken, 2 if a file is missing, 3 if the
    system cannot read one; the largest of them.
    """
    verdicts = []
    for asset in assets:
        verdicts.append((asset, *_verdict(asset)))
        if not as_json:
            _print(*verdicts[-1][:3])
    if as_json:
        print_json([{"file": asset, "ok": not broken, "broken": broken} for asset, _, broken, _ in verdicts])
    return max(status for *_, status in verdicts)


def _verdict(asset: str) -> tuple[str, list[str], int]:
    """A word, what is wrong, and the exit status that this asset alone would give."""
    from bakery.asset.verify import verify

    if not os.path.exists(asset):
        return "missing", ["there is no such file; expected the path of a baked asset"], 2
    try:
        broken = verify(asset)
    except StoreError as error:
        return "unread", [str(error).removeprefix(f"{asset}: ")], error.exit_status
    return ("broken", broken, 1) if broken else ("ok", [], 0)


def _print(asset: str, word: str, broken: list[str]) -> None:
    from bakery.system.terminal import clean, say

    if broken:
        say(f"{word:<7} {clean(asset)}")
        for rule in broken:
            say(f"        {clean(rule)}")
        return
    say(f"ok      {clean(asset)}  checksums, format and physics hold")
