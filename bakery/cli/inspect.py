"""`bake inspect ASSET [PATH]`: the tree of an asset, its errors and its provenance."""

import os

import click

from bakery.cli import offers
from bakery.cli.options import json_option, print_json
from bakery.errors import UsageError
from bakery.system.terminal import columns_in_pipes


@click.command(name="inspect", short_help="print the tree of an asset")
@click.argument("asset", type=click.Path(), metavar="ASSET")
@click.argument("path", metavar="[PATH]", default="", shell_complete=offers.members)
@json_option
def command(asset, path, as_json):
    """Print the contents of ASSET (or only those below PATH): names, shapes, ranges with units, bytes, errors, provenance."""
    import bakery
    from bakery.asset.ask import not_found
    from bakery.asset.summary import describe

    opened = bakery.open(asset)
    root = opened.tree
    path = path.strip("/")
    if path and path not in (names := [name for name, _ in root.walk()]):
        raise UsageError(not_found(asset, path, names))
    summary = {"file": asset, "bytes": os.path.getsize(asset)} | describe(root, path)
    family = _family(opened) if isinstance(opened, bakery.Family) and not path else None
    if as_json:
        print_json(summary | ({"family": family} if family else {}))
        return
    with columns_in_pipes():
        if family:
            _print_family(family)
        _print(summary, whole=not path)


def _family(family) -> dict:
    """What a family says of its axes and members, in JSON's types."""
    from bakery.asset.summary import number

    return {"method": family.method, "tolerance": family.tolerance, "achieved_error": family.achieved_error,
            "axes": [{"name": name, "key": axis.key, "units": axis.values.units, "values": axis.values.tolist(),
                      "error": None if axis.error is None else [number(value) for value in axis.error]}
                     for name, axis in family.axes.items()],
            "members": [{"at": dict(member.at), "path": str(member.path), "content_hash": member.content_hash,
                         "reason": member.reason, "there": member.path.is_file()} for member in family.members]}


def _print_family(family: dict) -> None:
    from bakery.family.axes import shown
    from bakery.family.members import counted
    from bakery.system.terminal import clean, say

    members = family["members"]
    error = family["achieved_error"]
    error_text = "not measured" if error is None else f"error {_short(error)} of {_short(family['tolerance'])}"
    say(f"a family of {counted([member['reason'] for member in members])}, {family['method']} between them, {error_text}")
    units = {axis["name"]: axis["units"].removeprefix("1") or "1" for axis in family["axes"]}  # as recipes write them
    for axis in family["axes"]:
        values = [shown(value, units[axis["name"]]) for value in axis["values"]]
        excerpt = values if len(values) <= 8 else [*values[:4], "...", *values[-3:]]
        say(f"  {axis['name']}: {', '.join(excerpt)} ({clean(axis['key'])})")
    for member in members:
        if member["reason"] or not member["there"]:
            at = ", ".join(f"{name} {shown(member['at'][name], unit)}" for name, unit in units.items())
            say(f"  {at}: {clean(member['reason'] or 'its file ' + member['path'] + ' is not there')}")
    say()


def _print(summary: dict, whole: bool) -> None:
    from bakery.system.resources import in_words
    from bakery.system.terminal import clean, plain, say

    say(f"{clean(summary['file'])}: {clean(summary['name'])}, asset format {summary['format_version']}, "
        f"baked by bakery {clean(summary['bakery_version'])}, {in_words(summary['bytes'])}")
    for rule in summary["broken"]:
        say(f"BROKEN: {clean(rule)}")
    for line in _tree(summary, plain()):
        say(line)
    for stage in summary["stages"]:
        say()
        for line in _stage(stage):
            say(line)
    if not whole:
        return
    say()
    for name, sentence in summary["explained"].items():
        say(f"{name} {sentence}.")
    say()
    say("provenance")
    for name, value in summary["provenance"].items():
        say(f"  {name:<16} {clean(value)}")


def _tree(summary: dict, ascii_only: bool) -> list[str]:
    """One line a member: where it hangs, its shape, its values, its size, what it is."""
    from bakery.system.resources import in_words
    from bakery.system.terminal import clean, table

    datasets = {row["path"]: row for row in summary["datasets"]}
    stages = {stage["group"]: f"error {_error(stage['achieved_error'])} of {_short(stage['tolerance'])}"
              + (" MISSED" if stage["missed"] else "") for stage in summary["stages"]}
    last_of = {path.rpartition("/")[0]: path for path in summary["members"]}
    down, last, bar = ("|- ", "`- ", "|  ") if ascii_only else ("├─ ", "└─ ", "│  ")
    rows = []
    for path in summary["members"]:
        above = [path[:i] for i, letter in enumerate(path) if letter == "/"]
        lines = "".join("   " if parent == last_of[parent.rpartition("/")[0]] else bar for parent in above)
        head = lines + (last if path == last_of[path.rpartition("/")[0]] else down) + path.rpartition("/")[2]
        row = datasets.get(path)
        if row is None:
            rows.append((head, "", stages.get(path, ""), "", ""))
            continue
        shape = " x ".join(f"{n}" for n in row["shape"])
        rows.append((head, shape, clean(_values(row)), in_words(row["bytes"]), clean(row["description"])))
    return table(rows, right=(1, 3))


def _values(row: dict) -> str:
    """The values themselves where they are few, else their range; with unit and error."""
    units = "" if row["units"] in ("1", "") or row["type"] == "text" else " " + row["units"]
    error = row["largest_relative_error"]
    error = f" +- {100 * error:.2g} %" if error else ""
    if row["values"] is not None:
        join = ", " if row["type"].startswith("enum") else " "
        return join.join(_short(value) for value in row["values"]) + units + error
    if row["minimum"] is None:
        return row["type"]
    if row["minimum"] == row["maximum"]:
        return f"{_short(row['minimum'])}{units}{error}"
    return f"{_short(row['minimum'])} .. {_short(row['maximum'])}{units}{error}"


def _short(value) -> str:
    return value if isinstance(value, str) else "nan" if value is None else f"{value + 0.0:.6g}"


def _error(value) -> str:
    return "not measured" if value is None else _short(value)


def _stage(stage: dict) -> list[str]:
    from bakery.system.resources import duration, in_words
    from bakery.system.terminal import clean

    cost = [("baked {}", stage["finished"], clean), ("by bakery {}", stage["bakery_version"], clean),
            ("in {}", stage["seconds"], duration), ("peak {}", stage["peak_memory"], in_words),
            ("{} workers", stage["workers"], str)]
    spent = ", ".join(words.format(shown(value)) for words, value, shown in cost if value is not None)
    reached = f"error {_error(stage['achieved_error'])} of {_short(stage['tolerance'])} allowed: {clean(stage['error_measure'])}"
    current = stage["current_version"] or stage["stage_version"]
    outdated = f"; this bakery writes version {current}, `bake RECIPE` bakes it anew" if current != stage["stage_version"] else ""
    lines = [f"stage {clean(stage['group'])}, version {stage['stage_version']}{outdated}", f"  {reached}"]
    lines += [f"  MISSED: {clean(stage['missed'])}"] if stage["missed"] else []
    lines += [f"  {spent}"] if spent else []
    lines += [f"  note: {clean(note)}" for note in stage["notes"]]
    return lines + [f"  input_hash   {clean(stage['input_hash'])}", f"  content_hash {clean(stage['content_hash'])}"]
