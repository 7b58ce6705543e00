"""How the blocks of one `map` travel to a cluster and back: in messages of about a second.

Values do not depend on who runs a block: what a lost worker had is done again, and what is late by another worker as well.
"""

import hashlib
import math
import pickle
import secrets
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue

from bakery.errors import StageError

COST = 0.004  # seconds that a message takes of this process and the scheduler: benchmarks/cluster.py
AIM = 1.0  # seconds of blocks in a message, at most
SPARE = 0.01  # the same a thread of the cluster, so that large ones do not send more than their scheduler takes
AHEAD = 2  # messages a thread that are under way: one that runs and the next one
LOOK, _PATIENCE = 2.0, 30.0  # seconds between looks at the workers, and without any before we give up
_DEATHS = 3  # times that blocks may lose all of the workers that may run them
_LATE, _TIMES = 10.0, 3.0  # a block is late after so many seconds, and so many times the longest of the others
RESUME = "finished stages are in the cache, and the same call continues from there"


class ClusterLost(StageError):
    """The scheduler is gone, or every worker: no block can be run any more."""


@dataclass
class _Message:
    """Blocks that are under way together."""

    key: str
    blocks: list[int]
    allowed: frozenset  # workers that may run it
    sent: float = field(default_factory=time.monotonic)
    late: str | None = None  # the worker that has the first of two copies
    copied: bool = False


class Map:
    """The blocks of one call of `map`, on their way.

    function, tasks : `[function(*task) for task in tasks]` is wanted
    """

    def __init__(self, cluster, function: Callable, tasks: list[tuple]):
        self._cluster, self._function = cluster, function
        self._shared, self._tasks = _divided(tasks)
        self._common = pickle.dumps((function, self._shared), protocol=5)
        self._key = hashlib.sha256(self._common).hexdigest()
        self._values, self._left = [None] * len(tasks), set(range(len(tasks)))
        self._waiting, self._under, self._ended = deque(range(len(tasks))), {}, SimpleQueue()
        self._longest, self._deserted, self._lost = 0.0, None, Counter()

    def values(self) -> list:
        """Of all blocks, in their order."""
        for position, value in self.arriving():
            self._values[position] = value
        return self._values

    def arriving(self) -> Iterator[tuple[int, object]]:
        """Position and value of each block, as they come back."""
        try:
            while self._left:
                self._cluster.look()
                self._rescue()
                self._fill()
                try:
                    future = self._ended.get(timeout=LOOK)
                except Empty:
                    self._hasten()
                    continue
                if future in self._under:
                    yield from self._take(future)
        finally:
            for future in self._under:
                future.cancel()

    def _fill(self) -> None:
        """Send as many messages as keep the workers busy."""
        threads = sum(self._cluster.threads.values())
        while self._waiting and len(self._under) < AHEAD * threads:
            count = min(together(self._cluster.pace(self._function), len(self._waiting), threads), len(self._waiting))
            self._send([self._waiting.popleft() for _ in range(count)], frozenset(self._cluster.threads))

    def _send(self, blocks: list[int], allowed: frozenset, late: str | None = None) -> None:
        tasks = pickle.dumps([self._tasks[k] for k in blocks], protocol=5)
        key = f"blocks-{secrets.token_hex(16)}"
        future = self._cluster.send(key, sorted(allowed), self._cluster.sent(self._common, self._key), tasks)
        self._under[future] = _Message(key, blocks, allowed, late=late)
        future.add_done_callback(self._ended.put)

    def _take(self, future) -> list[tuple[int, object]]:
        """The values of a message with their positions; none where a copy of it was quicker."""
        message = self._under.pop(future)
        values, seconds = future.result()
        self._cluster.noted(self._function, len(values), seconds)
        self._longest = max(self._longest, seconds / len(values))
        if message.late and self._left.issuperset(message.blocks):
            self._cluster.say(f"cluster: worker {message.late} is slow: another did the same blocks meanwhile, in "
                              f"{time.monotonic() - message.sent:.2g} s")
        new = [(k, value) for k, value in zip(message.blocks, values, strict=True) if k in self._left]
        self._left.difference_update(message.blocks)
        for future in [future for future, task in self._under.items() if task.blocks is message.blocks]:
            del self._under[future]
            future.cancel()
        return new

    def _rescue(self) -> None:
        """Take back messages none of whose workers is there any more; give up where there has been none for long."""
        present = self._cluster.threads.keys()
        for future in [future for future, message in self._under.items() if not message.allowed & present]:
            message = self._under.pop(future)
            future.cancel()
            block = message.blocks[0]
            self._lost[block] += 1
            if self._lost[block] > _DEATHS:
                raise StageError(f"{self._lost[block]} times all workers died on the same block; their memory may not suffice: "
                                 "fewer threads a worker, or see `bake plan`")
            if self._left.issuperset(message.blocks) and not message.copied:
                self._waiting.extendleft(reversed(message.blocks))
        now = time.monotonic()
        self._deserted = None if present else self._deserted or now
        if self._deserted and now - self._deserted >= _PATIENCE:
            refused = "; ".join(f"{address} {reason}" for address, reason in self._cluster.refused.items())
            raise ClusterLost(f"the cluster has had no worker for {_PATIENCE:g} s" + (f" but {refused}" if refused else "") +
                              f"; {RESUME}")

    def _hasten(self) -> None:
        """Give what is late to another worker as well, where all else is done and some have nothing to do."""
        threads = self._cluster.threads
        if self._waiting or not self._longest or len(self._under) >= sum(threads.values()):
            return
        for message in list(self._under.values()):
            allowance = max(_LATE, _TIMES * self._longest * len(message.blocks))
            if message.copied or message.late or time.monotonic() - message.sent < allowance:
                continue
            holder = self._cluster.holder(message.key)
            others = frozenset(threads) - {holder}
            if holder and others:
                message.copied = True
                self._send(message.blocks, others, late=holder)


def together(pace: float | None, remaining: int, threads: int) -> int:
    """Blocks of one message, where so many are left and each takes `pace` seconds.

    Few, so that all workers end together; but n messages take n COST here and their work takes (pace left) / n there, which is
    least in sum where both are alike.
    """
    if pace is None:
        return 1
    work = pace * remaining
    seconds = min(max(AIM, SPARE * threads), max(work / (AHEAD * threads), math.sqrt(work * COST)))
    return max(1, int(seconds / max(pace, 1e-6)))


def _divided(tasks: list[tuple]) -> tuple[dict, list[tuple]]:
    """Arguments that are one object in all tasks, by place, and the others of each task."""
    common = {k: first for k, first in enumerate(tasks[0]) if all(task[k] is first for task in tasks)}
    return common, [tuple(value for k, value in enumerate(task) if k not in common) for task in tasks]


def run(common, tasks: bytes) -> tuple[list, float]:
    """Values of a message's blocks, and the seconds that they took; runs in a worker."""
    # unpacked here and not by Dask: its arrays are read-only, and kernels would be compiled anew for such
    function, common = pickle.loads(common) if isinstance(common, bytes) else common
    values, started = [], time.monotonic()
    for task in pickle.loads(tasks):
        arguments = iter(task)
        values.append(function(*(common[k] if k in common else next(arguments) for k in range(len(common) + len(task)))))
    return values, time.monotonic() - started
