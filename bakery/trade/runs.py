"""One measured setting, and the file that keeps it.

The file's name is a hash over everything that the figures depend on: the stage's inputs and version, the converged values that
errors are held against, the baseline, and the machine with its libraries.  A run that is asked for again is read, one whose
recipe changed is made anew.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path

import bakery

FORMAT = 1
MOST = 1e15  # seconds, bytes, relative errors: no run has shown that much


@dataclass(frozen=True)
class Run:
    """A setting and what its repeats showed."""

    # stage, input_hash: what was computed
    stage: str
    input_hash: str
    setting: Mapping[str, str]  # recipe key -> text, what differs from the recipe as it stands
    seconds: tuple[float, ...] = ()  # of one core (processor time), one a repeat
    wall: tuple[float, ...] = ()  # seconds on the wall's clock, one a repeat
    baseline: tuple[float, ...] = ()  # seconds of the baseline around each repeat
    memory: float = 0.0  # bytes, peak above the loaded process
    errors: Mapping[str, float] = field(default_factory=dict)  # true errors by name, the ranking one first
    achieved: float = 0.0  # the error that the stage claims, in its own measure
    content: str = ""  # hash of the values
    failed: str = ""  # why there are no figures; empty if there are

    @property
    def ratios(self) -> list[float]:
        """Seconds relative to the baseline."""
        return [seconds / base for seconds, base in zip(self.seconds, self.baseline, strict=True)]

    @property
    def error(self) -> float:
        """The true error that ranks."""
        return next(iter(self.errors.values()))

    def with_repeat(self, repeat: Mapping) -> Run:
        """The same with one more repeat, as the worker reports it."""
        values = {name: (*getattr(self, name), float(repeat[name])) for name in ("seconds", "wall", "baseline")}
        if not self.seconds:
            values |= {name: repeat[name] for name in ("memory", "errors", "achieved", "content")}
        return replace(self, **values)


class Store:
    """The runs of one folder, one JSON file each, written whole as soon as a repeat is done."""

    def __init__(self, folder: Path):
        self.folder = folder

    def path(self, stage: str, *inputs: str) -> Path:
        """Where the run with these inputs is kept."""
        parts = json.dumps([FORMAT, stage, *inputs, machine()], sort_keys=True)
        return self.folder / f"{stage}-{hashlib.sha256(parts.encode()).hexdigest()[:32]}.json"

    def load(self, path: Path, stage: str, input_hash: str) -> Run | None:
        """The run, or None where there is none, or none that is whole."""
        try:
            record = json.loads(path.read_text())
            run = Run(**{name: tuple(value) if isinstance(value, list) else value for name, value in record["run"].items()})
            complete = ((run.stage, run.input_hash) == (stage, input_hash)
                        and len(run.seconds) == len(run.baseline) == len(run.wall))
            possible = (all(0 < value < MOST for value in (*run.seconds, *run.wall, *run.baseline))
                        and all(0 <= value < MOST for value in (run.memory, run.achieved, *run.errors.values())))
            return run if complete and possible and (run.failed or (run.seconds and run.errors)) else None
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
            return None

    def save(self, path: Path, run: Run) -> None:
        """Write the run; what stood there stays whole until then."""
        from bakery.store.put import put

        put(path, json.dumps({"format": FORMAT, "run": asdict(run), "machine": machine()}, indent=1, allow_nan=False) + "\n")


@cache
def machine() -> dict[str, str]:
    """What times depend on besides the recipe."""
    from bakery.run.executors import library_versions

    return {"processor": _processor(), "cores": str(os.cpu_count() or 1)} | library_versions() | {"bakery": bakery.__version__}


def _processor() -> str:
    import platform

    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
