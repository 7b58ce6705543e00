"""How the blocks of one `map` travel to a cluster and back: in messages of about a second.

Values do not depend on who runs a block: what a lost worker had is done again.
"""

import hashlib
import math
import pickle
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from operator import itemgetter
from queue import Empty, SimpleQueue
from typing import NamedTuple

from bakery.errors import StageError

COST = 0.004  # seconds that a message takes of this process and the scheduler: benchmarks/cluster.py
AIM = 1.0  # seconds of blocks in a message, at most
SPARE = 0.01  # the same a thread of the cluster, so that large ones do not send more than their scheduler takes
AHEAD = 2  # messages a thread that are under way: one that runs and the next one
LOOK, _PATIENCE = 2.0, 30.0  # seconds between looks at the workers, and without any before we give up
_DEATHS = 3  # times that blocks may lose all of the workers that may run them
RESUME = "finished stages are in the cache, and the same call continues from there"


class ClusterLost(StageError):
    """The scheduler is gone, or every worker: no block can be run any more."""


class _Message(NamedTuple):
    """Blocks that are under way together."""

    blocks: list[int]
    allowed: frozenset  # workers that may run it


class Map:
    """The blocks of one call of `map`, on their way.

    function, tasks : `[function(*task) for task in tasks]` is wanted
    """

    def __init__(self, cluster, function: Callable, tasks: list[tuple]):
        self._cluster, self._function = cluster, function
        # arguments that are one object in all tasks, by place, and the others of each task
        self._shared = {k: first for k, first in enumerate(tasks[0]) if all(task[k] is first for task in tasks)}
        self._tasks = [tuple(value for k, value in enumerate(task) if k not in self._shared) for task in tasks]
        self._common = pickle.dumps((function, self._shared), protocol=5)
        self._key = hashlib.sha256(self._common).hexdigest()
        self._waiting, self._under, self._ended = deque(range(len(tasks))), {}, SimpleQueue()
        self._deserted, self._lost = None, Counter()

    def values(self) -> list:
        """Of all blocks, in their order."""
        return [value for _, value in sorted(self.arriving(), key=itemgetter(0))]

    def arriving(self) -> Iterator[tuple[int, object]]:
        """Position and value of each block, as they come back."""
        try:
            while self._waiting or self._under:
                self._cluster.look()
                self._rescue()
                self._fill()
                with suppress(Empty):
                    future = self._ended.get(timeout=LOOK)
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
            message = _Message([self._waiting.popleft() for _ in range(count)], frozenset(self._cluster.threads))
            tasks = pickle.dumps([self._tasks[k] for k in message.blocks], protocol=5)
            future = self._cluster.send(message.allowed, self._cluster.sent(self._common, self._key), tasks)
            self._under[future] = message
            future.add_done_callback(self._ended.put)

    def _take(self, future) -> Iterator[tuple[int, object]]:
        """The values of a message with their positions."""
        values, seconds = future.result()
        self._cluster.noted(self._function, len(values), seconds)
        return zip(self._under.pop(future).blocks, values, strict=True)

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
            self._waiting.extendleft(reversed(message.blocks))
        now = time.monotonic()
        self._deserted = None if present else self._deserted or now
        if self._deserted and now - self._deserted >= _PATIENCE:
            refused = "; ".join(f"{address} {reason}" for address, reason in self._cluster.refused.items())
            raise ClusterLost(f"the cluster has had no worker for {_PATIENCE:g} s" + (f" but {refused}" if refused else "") +
                              f"; {RESUME}")


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


def run(common, tasks: bytes) -> tuple[list, float]:
    """Values of a message's blocks, and the seconds that they took; runs in a worker."""
    # unpacked here and not by Dask: its arrays are read-only, and kernels would be compiled anew for such
    function, common = pickle.loads(common) if isinstance(common, bytes) else common
    values, started = [], time.monotonic()
    for task in pickle.loads(tasks):
        arguments = iter(task)
        values.append(function(*(common[k] if k in common else next(arguments) for k in range(len(common) + len(task)))))
    return values, time.monotonic() - started
