"""What a stage depends on, by name, and the hash over it.

The parts of a stage's input are the recipe's leaves that match its `reads`, the digests of the data files that those keys name,
the stage's own version and the input hashes of the stages upstream.  The hash names the stage's cache entry; the parts say,
key by key, why a stage has to run again.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from functools import cache

from bakery.stages.declaration import Stage


@cache
def _pattern(reads: str) -> re.Pattern:
    text = re.escape(reads).replace(r"\[\*\]", r"\[\d+\]").replace(r"\*", r"[^.\[\]]+")
    return re.compile(text + r"(?![^.\[])")  # the key itself or anything below it


def reads_key(stage: Stage, key: str) -> bool:
    """Whether the stage's values depend on a recipe key (`*` stands for one name, `[*]` for one index)."""
    return any(_pattern(pattern).match(key) for pattern in stage.reads)


def parts(stage: Stage, recipe, upstream: Mapping[str, str]) -> dict[str, str | int | float | bool]:
    """Everything that the stage's values depend on: name of the part -> value or digest."""
    inputs = {f"stage {stage.name}": f"version {stage.version}"}
    inputs |= {f"upstream {name}": upstream[name] for name in stage.needs}
    inputs |= {key: leaf for key, leaf in recipe.leaves.items() if reads_key(stage, key)}
    inputs |= {f"file {file.path.name} ({file.key})": file.sha256 for file in recipe.files if reads_key(stage, file.key)}
    return inputs


def input_hash(inputs: Mapping[str, str | int | float | bool]) -> str:
    """SHA-256 over the parts; the order in which a recipe names its keys does not matter."""
    # json writes the shortest digits that give the same float back, so equal values have equal text
    return hashlib.sha256(json.dumps(inputs, sort_keys=True, allow_nan=False).encode()).hexdigest()


def differences(old: Mapping, new: Mapping) -> list[str]:
    """Why the input changed, in words, one sentence a part."""
    sentences = []
    for name in sorted(set(old) | set(new)):
        before, after = old.get(name), new.get(name)
        if before == after:
            continue
        if name.startswith("upstream "):
            sentences.append(f"{name.removeprefix('upstream ')} runs again")
        elif name.startswith("file "):
            sentences.append(f"{name} " + ("changed" if before and after else "is new" if after else "is gone"))
        elif name.startswith("stage "):
            sentences.append(f"stage {before or 'is new'} -> {after}" if before else f"{name} is new")
        elif before is None:
            sentences.append(f"{name} is new ({_short(after)})")
        elif after is None:
            sentences.append(f"{name} is gone (was {_short(before)})")
        else:
            sentences.append(f"{name}: {_short(before)} -> {_short(after)}")
    return sentences


def _short(value) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)
