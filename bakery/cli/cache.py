"""`bake cache info|prune|clear`: the cache of finished stages.

What machines share is looked at, never tidied: others may need what this one does not.
"""

import sys

import click

from bakery.cli.options import FiniteRange, json_option, print_json
from bakery.errors import StoreError, UsageError
from bakery.system.terminal import clean, remark, say

_NAMED = 4  # files that do not belong to the cache, by name


@click.group(name="cache", short_help="show or clean up the cache of finished stages")
def command():
    """Show or clean up the cache of finished stages (BAKERY_CACHE, else the user's cache folder).

    If BAKERY_CACHE names a folder on a network disk or an object store, that is a shared cache, used together with the user's
    local cache folder.
    """


@command.command(short_help="show where the cache is and what it holds")
@json_option
def info(as_json):
    """Show where the cache is and what it holds, shared entries included."""
    from bakery.run.cache import Cache
    from bakery.run.entries import SCENES

    cache = Cache()
    held = cache.held()
    # of an entry its stage, or `scenes` of a whole asset that a scene asked for
    counted = _counted((SCENES if path.parent.name == SCENES else path.name.rpartition("-")[0], size)
                       for path, size, _ in held.entries) | {"others": len(held.others)}
    shared = {} if cache.shared is None else {"shared": {"address": cache.shared.address, **_answered(cache.shared)}}
    if as_json:
        print_json({"folder": str(cache.where), **counted, **shared})
        return
    _show(str(cache.where), counted)
    if shared:
        address = shared["shared"].pop("address")
        _show(f"shared: {address}", shared["shared"])


def _answered(shared) -> dict:
    """What a shared cache holds, or what is wrong with it."""
    try:
        return _counted((name.rpartition("-")[0], size) for name, size in shared.entries())
    except StoreError as error:
        return {"problem": str(error).removeprefix(f"{shared.address}: ")}


def _counted(entries) -> dict:
    stages: dict[str, list[int]] = {}
    for kind, size in entries:
        stages.setdefault(kind, []).append(size)
    return {"entries": sum(map(len, stages.values())), "bytes": sum(map(sum, stages.values())),
            "stages": {name: {"entries": len(sizes), "bytes": sum(sizes)} for name, sizes in sorted(stages.items())}}


def _entries(count: int) -> str:
    return f"{count} entr{'y' if count == 1 else 'ies'}"


def _show(folder: str, held: dict) -> None:
    from bakery.system.resources import in_words

    if "problem" in held:
        say(f"{folder}: {held['problem']}")
        return
    say(f"{folder}: {_entries(held['entries'])}, {in_words(held['bytes'])}")
    for name, stage in held["stages"].items():
        say(f"  {clean(name):<8} {_entries(stage['entries'])}, {in_words(stage['bytes'])}")
    if held.get("others"):
        say(f"  besides  {held['others']} file{'' if held['others'] == 1 else 's'} or folders that do not belong to the cache")


@command.command(short_help="remove the least recently used entries")
@click.option("--max-size", metavar="SIZE", default="1GB", show_default=True,
              help="Keep the most recently used entries up to this size (kB, MB, GB).")
@click.option("--max-age", metavar="DAYS", type=FiniteRange(0), help="Remove entries not used for this many days.")
@json_option
def prune(max_size, max_age, as_json):
    """Remove the least recently used entries, and damaged ones; on this machine only."""
    from bakery.run.cache import Cache

    cache = Cache()
    _tell(cache, cache.prune(_bytes(max_size), None if max_age is None else 86400 * max_age), as_json)


@command.command(short_help="remove all entries on this machine")
@click.option("--yes", "-y", is_flag=True, help="Do not ask if the folder holds other files.")
@json_option
def clear(yes, as_json):
    """Remove every entry on this machine and nothing else; asks first if the folder holds other files."""
    from bakery.run.cache import Cache

    cache = Cache()
    if not yes:
        _ask(cache.where, cache.held())
    _tell(cache, cache.clear(), as_json)


def _ask(folder, held) -> None:
    """Ask whether to go on in a folder that is not the cache's alone; UsageError where nobody can answer, or the answer is no."""
    count = len(held.entries) + len(held.bad)
    if not held.others or not count:
        return
    named = ", ".join(clean(path.name) for path in held.others[:_NAMED])
    unnamed = f" and {len(held.others) - _NAMED} more" if len(held.others) > _NAMED else ""
    message = f"{folder}: holds besides {_entries(count)} also {named}{unnamed}, which do not belong to the cache and would stay"
    if not sys.stdin.isatty():
        raise UsageError(f"{message}; --yes removes the entries without a question")
    if not click.confirm(f"{message}. Remove the entries?", err=True):
        raise UsageError("nothing is removed")


def _tell(cache, removed, as_json: bool) -> None:
    if cache.shared:
        remark(f"{cache.where} was cleaned up; {cache.shared.address} is shared and unchanged")
    if as_json:
        print_json({"removed": [path.name for path in removed]})
    else:
        say(f"{_entries(len(removed))} removed")


def _bytes(text: str) -> float:
    import re

    match = re.fullmatch(r"\s*([0-9.]+)\s*(B|kB|MB|GB)\s*", text)
    try:
        return float(match[1]) * {"B": 1, "kB": 1e3, "MB": 1e6, "GB": 1e9}[match[2]]
    except (TypeError, ValueError):
        raise UsageError(f'--max-size: found "{text}"; expected a number with B, kB, MB or GB (500MB)') from None
