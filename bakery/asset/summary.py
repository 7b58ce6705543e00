"""What an asset holds, as plain values: the one description that `inspect`, its `--json` and the page share."""

import math

import numpy as np

from bakery.stages.conform import stages_of
from bakery.stages.coordinates import stated_error
from bakery.store.missed import missed
from bakery.store.tree import Dataset, Group, is_text, read_text

FEW = 8  # so many values are shown themselves, more as a range

EXPLAINED = {
    "input_hash": "names everything that the stage was baked from; where it is equal, the stage need not be baked again",
    "content_hash": "names every value, shape, unit and attribute that is stored; where it is equal, the content is equal",
}


def describe(root: Group, below: str = "") -> dict:
    """An asset, or what lies below a path of it, for people and machines.

    Returns summary : of JSON's types only; `members` (every path, groups too), `datasets` and `stages` in the order of the file;
        `broken` rules of physics, in words; seconds in s, memory and sizes in bytes
    """
    from bakery.asset.verify import physics

    inside = [(path, member) for path, member in root.walk()
              if not below or path == below or path.startswith(below + "/") or below.startswith(path + "/")]
    wanted = {path.partition("/")[0] for path, _ in inside}
    return {
        "name": root.attributes.get("name"),
        "format_version": root.attributes.get("format_version"),
        "bakery_version": root.attributes.get("bakery_version"),
        "content_hash": root.attributes.get("content_hash"),
        "broken": physics(root),
        "stages": [stage(root, name) for name, member in root.members.items() if name in wanted
                   and isinstance(member, Group) and "stage" in member.attributes],
        "members": [path for path, _ in inside],
        "datasets": [dataset(root, path) for path, member in inside if isinstance(member, Dataset)],
        "provenance": {name: number(value) for name, value in _provenance(root).attributes.items()},
        "explained": EXPLAINED,
    }


def stage(root: Group, name: str) -> dict:
    """What a stage says of itself, what it misses, in words or None, and the time and memory that it took."""
    attributes = root.members[name].attributes
    current = {declared.name: declared.version for declared in stages_of(root)}
    cost = _provenance(root).members.get(name)
    spent = cost.attributes if isinstance(cost, Group) else {}
    notes = cost.members.get("notes") if isinstance(cost, Group) else None
    shown = ("stage", "stage_version", "tolerance", "achieved_error", "error_measure", "input_hash", "content_hash")
    return {"group": name} | {key: number(attributes.get(key)) for key in shown} | {
        key: number(spent.get(key)) for key in ("seconds", "peak_memory", "workers", "bakery_version", "finished")
    } | {"current_version": current.get(name), "missed": missed(root).get(name),
         "notes": read_text(notes).splitlines() if isinstance(notes, Dataset) else []}


def dataset(root: Group, path: str) -> dict:
    """Shape, unit, range and size of one array; its largest relative error, standard error and bias together."""
    member = root[path]
    data = member.data
    row = {"path": path, "shape": list(data.shape), "type": str(data.dtype), "units": member.units,
           "description": member.description, "bytes": int(data.nbytes), "minimum": None, "maximum": None, "values": None,
           "largest_relative_error": None}
    if is_text(member):
        row["type"] = "text"
        row["values"] = [first_line(read_text(member))]
    elif member.choices:
        counts = np.bincount(data.reshape(-1).astype(np.int64), minlength=len(member.choices))
        row["type"] = "enum: " + ", ".join(member.choices)
        row["values"] = [f"{int(count)} {choice}" for choice, count in zip(member.choices, counts, strict=True) if count]
    elif data.dtype.kind in "fiu" and data.size:
        row["minimum"], row["maximum"] = number(data.min()), number(data.max())
        if data.size <= FEW:
            row["values"] = [number(value) for value in data.reshape(-1)]
        error = stated_error(root, path)
        if error is not None:
            share = np.abs(error) / np.where(data == 0, np.inf, np.abs(data))
            row["largest_relative_error"] = number(share.max())
    return row


def number(value):
    """A value as JSON knows it; not a number, and infinity, have no form there."""
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def first_line(content: str) -> str:
    lines = content.strip().splitlines() or [""]
    head = lines[0] if len(lines[0]) <= 40 else lines[0][:37] + "..."
    return f"{len(content)} characters in {len(lines)} lines: {head}" if len(lines) > 1 else head


def _provenance(root: Group) -> Group:
    text = root.members.get("provenance")
    return text if isinstance(text, Group) else Group()
