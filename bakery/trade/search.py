"""Which setting to run next: each knob alone, then combinations near the front, until none can move it for a requested tolerance.

The second part is a Pareto local search (L. Paquete, M. Chiarandini and T. Stützle, Lecture Notes in Economics and Mathematical
Systems 535, 177 (2004)): neighbours of settings on the front are tried.  Here a neighbour is left out when even a hopeful guess,
from what the same step did elsewhere, does not beat the cheapest setting known for any requested tolerance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bakery.trade.front import Point, cheapest, front

Setting = tuple[int, ...]  # one index into each ladder

USELESS = 3.0  # times the largest tolerance requested: errors beyond that end a row of ever cheaper values
ENOUGH = 1 / 3  # of the smallest tolerance requested: errors below that end a row of ever dearer values
HOPE = 0.8  # a combination may be faster, and more accurate, than its parts say by this factor
GAIN = 0.97  # time relative to the best known above which nothing is gained


@dataclass(frozen=True)
class Ladder:
    """The values of a knob from cheap to dear; `start` is where the recipe stands.

    `switch`: its values are words (`mie`, `goa`, `auto`), so it may bring other knobs to life.
    """

    key: str
    texts: tuple[str, ...]
    start: int
    switch: bool = False


@dataclass(frozen=True)
class Seen:
    """What is known of a setting; `content` shows whether two settings gave the very same values."""

    seconds: float
    error: float
    content: str


def start_of(ladders: Sequence[Ladder]) -> Setting:
    """The recipe as it stands."""
    return tuple(ladder.start for ladder in ladders)


def proposals(ladders: Sequence[Ladder], first: Sequence[Setting], tolerances: Sequence[float],
              seen: Mapping[Setting, Seen | None], floor: float = 0.0) -> list[Setting]:
    """Settings to run, the most informative first; empty when no further run can change what is recommended.

    first : settings that have to be known in any case
    tolerances : tolerances for which the cheapest setting is wanted
    seen : what has been run; None for a setting that failed
    floor : error below which settings cannot be distinguished
    """
    missing = [setting for setting in dict.fromkeys((start_of(ladders), *first)) if setting not in seen]
    if missing:
        return missing
    if seen[start_of(ladders)] is None:
        return []
    alone = [setting for k in range(len(ladders)) for setting in _row(ladders, k, tolerances, seen)]
    if alone:
        return list(dict.fromkeys(alone))
    dearest = tuple(len(ladder.texts) - 1 for ladder in ladders)
    unmet = not any(result and result.error <= min(tolerances) for result in seen.values())
    # where each knob hides behind another that is as poor, no single step helps: all at once does
    return _neighbours(ladders, tolerances, seen, floor) or [dearest] * (unmet and dearest not in seen)


def inert(ladders: Sequence[Ladder], k: int, seen: Mapping[Setting, Seen | None]) -> bool:
    """Whether the knob at its far end gave the very values that the recipe has as it stands."""
    start, end = start_of(ladders), _end(ladders, k)
    return end != start and all(seen.get(setting) for setting in (start, end)) and seen[end].content == seen[start].content


def _moved(setting: Setting, k: int, i: int) -> Setting:
    return setting[:k] + (i,) + setting[k + 1 :]


def _end(ladders, k: int) -> Setting:
    return _moved(start_of(ladders), k, 0 if ladders[k].start > 0 else len(ladders[k].texts) - 1)


def _row(ladders, k: int, tolerances, seen) -> list[Setting]:
    """What is still to run of one knob alone: its far end first, since a knob without effect needs no more."""
    start, end = start_of(ladders), _end(ladders, k)
    if end not in seen:
        return [end]
    if inert(ladders, k, seen):
        return []
    at = ladders[k].start
    cheaper = (range(at - 1, -1, -1), lambda error: error > USELESS * max(tolerances))
    dearer = (range(at + 1, len(ladders[k].texts)), lambda error: error < ENOUGH * min(tolerances))
    todo = []
    for indices, last in (cheaper, dearer):
        before = seen[start]
        if indices is dearer[0] and last(before.error):
            continue
        for i in indices:
            setting = _moved(start, k, i)
            if setting not in seen:
                todo.append(setting)
                break  # what it shows decides on the next
            if seen[setting] is not None and last(seen[setting].error):
                break
            if i < at and all(_worse(seen[candidate], before) for candidate in (setting, end)):
                break  # not cheap at all, neither here nor at the far end
    return todo


def _worse(result: Seen | None, start: Seen) -> bool:
    """Whether a setting failed, or is slower than where the recipe stands and gains nothing by it."""
    return result is None or (result.seconds > 1.2 * start.seconds and result.error > 0.9 * start.error)


def _neighbours(ladders, tolerances, seen, floor: float) -> list[Setting]:
    completed = {setting: result for setting, result in seen.items() if result is not None}
    settings = list(completed)
    points = [Point(completed[s].seconds, completed[s].error) for s in settings]
    best = {}
    for tolerance in tolerances:
        i = cheapest(points, tolerance)
        best[tolerance] = float("inf") if i is None else points[i].seconds
    gains: dict[Setting, float] = {}
    for j in front(points, floor):
        for k, ladder in enumerate(ladders):
            for i in (settings[j][k] - 1, settings[j][k] + 1):
                setting = _moved(settings[j], k, i)
                if not 0 <= i < len(ladder.texts) or setting in seen:
                    continue
                guess = _guess(ladders, settings[j], k, i, completed)
                if guess is None:
                    continue
                gain = max((best[tolerance] / guess.seconds for tolerance in tolerances if guess.error <= tolerance), default=0.0)
                if gain * GAIN > 1:
                    gains[setting] = max(gain, gains.get(setting, 0.0))
    return sorted(gains, key=lambda setting: (-gains[setting], setting))


def _guess(ladders, setting: Setting, k: int, i: int, completed: Mapping[Setting, Seen]) -> Point | None:
    """A hopeful guess of one step from a known setting; None where the step is known to do nothing."""
    current = completed[setting]
    pairs = [(a, _moved(a, k, i)) for a in completed if a[k] == setting[k] and _moved(a, k, i) in completed]
    alike = [(a, b) for a, b in pairs if not _switched(ladders, a, setting)]
    if any(completed[a].content == completed[b].content for a, b in alike):
        return None
    if not pairs and inert(ladders, k, completed) and not _switched(ladders, start_of(ladders), setting):
        return None
    changes = [(completed[a], completed[b]) for a, b in pairs if completed[a].content != completed[b].content]
    if not changes:
        return Point(0.5 * current.seconds, HOPE * current.error) if i < setting[k] else Point(current.seconds, 0.0)
    # an error that the step adds elsewhere may hide behind a larger one here; one that it removes goes in proportion at best
    error = min(max(current.error, after.error) if after.error > before.error
                else current.error * after.error / max(before.error, 1e-300) for before, after in changes)
    return Point(HOPE * current.seconds * min(after.seconds / before.seconds for before, after in changes), HOPE * error)


def _switched(ladders, a: Setting, b: Setting) -> bool:
    """Whether a switch stands elsewhere: only then can a knob that did nothing at one setting do something at the other."""
    return any(ladder.switch and x != y for ladder, x, y in zip(ladders, a, b, strict=True))
