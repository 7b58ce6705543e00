"""`bake cache info|prune|clear`: the cache of finished stages."""

from __future__ import annotations

import click

from bakery.cli.options import json_option, print_json
from bakery.errors import UsageError
from bakery.system.terminal import say


@click.group(name="cache", short_help="look at and tidy the cache of finished stages")
def command():
    """Look at and tidy the cache of finished stages (BAKERY_CACHE, else the user's cache folder)."""


@command.command()
@json_option
def info(as_json):
    """Where the cache is and what it holds."""
    from bakery.run.cache import Cache
    from bakery.system.resources import in_words

    cache = Cache()
    entries = cache.entries()
    size = sum(entry[1] for entry in entries)
    by_stage: dict[str, list[int]] = {}
    for path, bytes_, _ in entries:
        by_stage.setdefault(path.name.rsplit("-", 1)[0], []).append(bytes_)
    if as_json:
        print_json({"folder": str(cache.where), "entries": len(entries), "bytes": size,
                    "stages": {name: {"entries": len(sizes), "bytes": sum(sizes)} for name, sizes in by_stage.items()}})
        return
    say(f"{cache.where}: {len(entries)} entries, {in_words(size)}")
    for name, sizes in sorted(by_stage.items()):
        say(f"  {name:<8} {len(sizes)} entries, {in_words(sum(sizes))}")


@command.command()
@click.option("--max-size", metavar="SIZE", default="1GB", show_default=True,
              help="Keep the last used up to this size (kB, MB, GB).")
@click.option("--max-age", metavar="DAYS", type=click.FloatRange(0), help="Remove what was not used for so many days.")
@json_option
def prune(max_size, max_age, as_json):
    """Remove the entries that were not used for longest, and what was set aside as damaged."""
    from bakery.run.cache import Cache

    _tell(Cache().prune(_bytes(max_size), None if max_age is None else 86400 * max_age), as_json)


@command.command()
@json_option
def clear(as_json):
    """Remove every entry."""
    from bakery.run.cache import Cache

    _tell(Cache().clear(), as_json)


def _tell(removed, as_json: bool) -> None:
    if as_json:
        print_json({"removed": [path.name for path in removed]})
    else:
        say(f"{len(removed)} entries removed")


def _bytes(text: str) -> float:
    import re

    match = re.fullmatch(r"\s*([0-9.]+)\s*(B|kB|MB|GB)\s*", text)
    try:
        return float(match[1]) * {"B": 1, "kB": 1e3, "MB": 1e6, "GB": 1e9}[match[2]]
    except (TypeError, ValueError):
        raise UsageError(f'--max-size: found "{text}"; a number with B, kB, MB or GB would do (500MB)') from None
