"""What a golden file keeps of an asset, and when an asset agrees with it.

Of each dataset that a stage declares: its values, or of long ones mean, root mean square and projections on random weights, and
beside Monte Carlo figures the same of their standard errors.  So a stage is watched by its declaration alone, and whatever value
of it moves is seen: the projections see values in another order, which keep mean and root mean square.
"""

import hashlib
import json
import math
import platform
import re
from collections.abc import Mapping

import numba
import numpy as np

from bakery.stages.conform import stages_of
from bakery.stages.coordinates import ERROR
from bakery.store.tree import Dataset, Group, is_text

WHOLE = 8  # datasets up to this size are kept as they are
PROJECTIONS = 2  # a change that one set of weights does not see (they are continuous, so chance alone makes none), the other does
# On one kind of processor the values agree to the last bit; between kinds NumPy's exp and log differ there, and that reaches
# sums of 1e4 terms as some 1e-12.  1e-6 leaves room for that and still sees any change of method.
TOLERANCE = 1e-6
# A normal figure moves by six standard errors of the difference once in 5e8, so one of the some hundred figures of a case does
# once in 5e6.  Errors of a long dataset count as fully correlated, which leaves more room, not less.
STANDARD_ERRORS = 6.0
APART = {"medium/phase"}  # of packed grains: the error of its forward peak stands in `forward_delta_error`


def arithmetic() -> str:
    """A fingerprint of what decides the last bits on this machine: elementary functions, NumPy, the compiler of the kernels."""
    x = np.linspace(0.01, 20.0, 4096)
    values = [getattr(np, name)(x).tobytes() for name in ("exp", "log", "sin", "cos", "arctan")]
    values += [np.array([getattr(math, name)(v) for v in x]).tobytes() for name in ("exp", "log", "sin", "cos", "atan")]
    versions = f"{np.__version__} {numba.__version__} {platform.machine()}"
    return hashlib.sha256(versions.encode() + b"".join(values)).hexdigest()[:16]


def inputs(recipe) -> str:
    """A fingerprint of a recipe's values and files: where it moved, values may move without a raised version."""
    said = [sorted((key, repr(value)) for key, value in recipe.leaves.items()), sorted(file.sha256 for file in recipe.files)]
    return hashlib.sha256(repr(said).encode()).hexdigest()[:16]


def kept(root: Group, recipe, origin: str) -> dict:
    """What the golden file of an asset holds."""
    stages = {stage.name: {"version": int(root.members[stage.name].attributes["stage_version"]), "needs": list(stage.needs),
                           "values": dict(_figures(stage.name, root.members[stage.name]))} for stage in stages_of(root)}
    return {"origin": origin, "arithmetic": arithmetic(), "inputs": inputs(recipe), "stages": stages}


def _figures(name: str, group: Group):
    for path, member in group.walk():
        if is_text(member):
            yield path, {"text": hashlib.sha256(member.data.tobytes()).hexdigest()[:16]}
        elif isinstance(member, Dataset):
            figure = {"shape": list(member.data.shape), "numbers": numbers(member.data)}
            head, _, last = path.rpartition("/")
            error = (group[head] if head else group).members.get(last + ERROR) if f"{name}/{path}" not in APART else None
            yield path, figure | ({} if error is None else {"errors": _errors(error.data)})


def numbers(data: np.ndarray) -> list[float]:
    """The values, or mean, root mean square and projections."""
    values = np.asarray(data, float).ravel()
    if values.size <= WHOLE:
        return values.tolist()
    projections = (np.mean(_weights(key, values.size) * values) for key in range(PROJECTIONS))
    return [float(values.mean()), float(np.sqrt(np.mean(values**2))), *map(float, projections)]


def _errors(data: np.ndarray) -> list[float]:
    """Standard errors of `numbers` at most: of values whose errors are fully correlated, and whose weights are 1."""
    errors = np.asarray(data, float).ravel()
    if errors.size <= WHOLE:
        return errors.tolist()
    mean = float(errors.mean())
    return [mean, float(np.sqrt(np.mean(errors**2))), *[mean] * PROJECTIONS]


def _weights(key: int, count: int) -> np.ndarray:
    """Evenly distributed from -1 to 1.  The bits of Philox are the same in every version of NumPy, its generators' numbers need
    not be."""
    return 2.0**-63 * np.random.Philox(key=key).random_raw(count) - 1


def moved(old: Mapping, new: Mapping, exact: bool) -> str:
    """What moved most between the values of a stage, in words; "" where they agree.

    `exact`: each figure to `TOLERANCE`; otherwise those with standard errors within `STANDARD_ERRORS`, and no others: what has no
    error says nothing of another tile, or of other paths.
    """
    if exact and set(old) != set(new):
        return f"{', '.join(sorted(set(old) ^ set(new)))}: only there in one of them"
    worst = max(((_distance(old[path], new[path], exact), path) for path in old if path in new), default=(0.0, ""))
    if worst[0] <= 1:
        return ""
    before, after = ((side[worst[1]].get("numbers") or side[worst[1]]) for side in (old, new))
    return f"{worst[1]}: {before} -> {after}, {worst[0]:.3g} {'tolerances' if exact else 'times the allowed distance'} off"


def _distance(old: Mapping, new: Mapping, exact: bool) -> float:
    """How far two figures are from each other, in what is allowed."""
    if not exact and not ("errors" in old and "errors" in new):
        return 0.0
    if "text" in old or "text" in new:
        return 0.0 if old == new else math.inf
    if exact and old["shape"] != new["shape"] or len(old["numbers"]) != len(new["numbers"]):
        return math.inf
    a, b = np.array(old["numbers"]), np.array(new["numbers"])
    room = np.full(a.shape, TOLERANCE * np.abs(a).max(initial=1e-300))
    if not exact:
        room = np.maximum(room, STANDARD_ERRORS * np.hypot(old["errors"], new["errors"]))
    return float((np.abs(a - b) / room).max(initial=0.0))


def _exact(old: Mapping, new: Mapping, chaotic: bool) -> bool:
    # hard spheres and light between facets are chaotic: one other bit makes another tile and other paths
    return not chaotic or old["arithmetic"] == new["arithmetic"]


def faults(old: Mapping, new: Mapping, chaotic: bool = False) -> list[str]:
    """What has to be mended in the stages before an asset fits its golden file, in words.

    Values move with the recipe, or with a raised version of their stage or of one that it needs; nothing else moves them.
    """
    found: list[str] = []
    raised: set[str] = set()
    for name, stage in new["stages"].items():
        before = old["stages"].get(name)
        if before is None or stage["version"] > before["version"] or raised & set(stage["needs"]):
            raised.add(name)
        elif stage["version"] < before["version"]:
            found.append(f"{name}: its version fell from {before['version']} to {stage['version']}")
        elif old["inputs"] == new["inputs"] and (place := moved(before["values"], stage["values"], _exact(old, new, chaotic))):
            found.append(f"{name}: values moved, and version {stage['version']} stayed: raise the version of the stage ({place})")
    return found


def stale(old: Mapping, new: Mapping, chaotic: bool = False) -> list[str]:
    """Why a golden file without `faults` has to be written again."""
    versions = [{name: stage["version"] for name, stage in side["stages"].items()} for side in (old, new)]
    if versions[0] != versions[1]:
        return [f"stages were {versions[0]}, are {versions[1]}"]
    return [f"the recipe changed, and with it {name}: {place}" for name, stage in new["stages"].items()
            if (place := moved(old["stages"][name]["values"], stage["values"], _exact(old, new, chaotic)))]


def written(golden: Mapping) -> str:
    """The text of a golden file, a line a figure."""
    return re.sub(r"\{[^{}]*\}", lambda figure: " ".join(figure[0].split()), json.dumps(golden, indent=1)) + "\n"
