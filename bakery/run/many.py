"""Many recipes at once: worker processes that live as long as the bake, and share the processors over recipes and stages.

Each process bakes one recipe at a time, on threads that are lent to it: one each while there are recipes for all, more where
recipes are few, so that the last ones have the whole machine.  Recipes that need the same stage, or kernels that have yet to be
compiled, follow each other: the second one finds them in the cache while others are baked meanwhile.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import connection
from pathlib import Path

import bakery
from bakery.errors import BakeryError
from bakery.plan import RUN
from bakery.run import SHARE_OF_MEMORY, Baked, compiling
from bakery.run.bake import executed
from bakery.run.board import EACH, Board
from bakery.run.cache import Cache
from bakery.run.dask import NoCluster, cluster
from bakery.run.messages import ClusterLost
from bakery.run.progress import Progress
from bakery.run.wire import Wire
from bakery.system import resources
from bakery.system.memory import free_memory

SHORT = 3.0  # seconds in all up to which processes would take longer to start than to work
_UNWIND = 1.5  # seconds that workers have to remove their part files in
# one thread each for libraries that would take all processors in every process
_SINGLE = {name: "1" for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")}


@dataclass(frozen=True)
class Outcome:
    """How the bake of one recipe ended: with what it did, or with what went wrong."""

    index: int  # of the recipe
    baked: Baked | None  # None where it failed
    # message, status: of the failure; the exit status is 0 where there is none
    message: str = ""
    status: int = 0


def bake_all(names: Sequence[str], plans: Sequence, *, jobs: int | None = None, cache: Cache | None = None,
             address: str | None = None, keep_going: bool = False, progress: Progress | None = None) -> Iterator[Outcome]:
    """Bake several recipes; each as if it was baked alone, to the same values.

    Parameters
    ----------
    plans : theirs, from `bakery.run.bake.planned`
    jobs : threads of all recipes together; with `address` recipes at once
    address : of a Dask scheduler whose workers run the blocks
    keep_going : start recipes also after one has failed

    Yields
    ------
    outcome : as recipes end.  Recipes that were not started have none: those after a failure, or after the loss of the cluster

    Raises
    ------
    UsageError : there is no such cluster
    """
    progress, cache = progress or Progress(), cache or Cache()
    workers = min(resources.jobs(jobs), len(plans))
    if workers == 1 or sum(EACH + plan.seconds * plan.write for plan in plans) < SHORT:
        ends = _one_by_one(plans, jobs, cache, address, Board(progress, names, plans, 1))
    else:
        board = Board(progress, names, plans, workers)
        if address:
            with cluster(address, lambda text: board.say(0, text)):
                pass  # a wrong address is one message, and not one from each process
        ends = _Bakery(plans, resources.jobs(jobs), cache, address, board).run()
    try:
        yield from _until_failure(ends, keep_going)
    finally:
        ends.close()
        progress.end()


def _until_failure(ends, keep_going: bool) -> Iterator[Outcome]:
    """Pass outcomes on; after a failure ask for those of recipes that run, and no others."""
    stop = None
    while True:
        try:
            outcome, final = ends.send(stop)
        except StopIteration:
            return
        stop = stop or final or (outcome.baked is None and not keep_going) or None
        yield outcome


def _one_by_one(plans: Sequence, jobs, cache: Cache, address, board: Board):
    for index, plan in enumerate(plans):
        final = False
        try:
            baked = executed(plan, cache=cache, jobs=jobs, address=address, progress=board.part(index))
            outcome = Outcome(index, baked)
        except BakeryError as error:
            outcome, final = Outcome(index, None, str(error), error.exit_status), isinstance(error, (ClusterLost, NoCluster))
        board.ended(index, outcome.baked is None)
        if (yield outcome, final):
            return


class _Worker:
    """The parent's end of a worker process."""

    def __init__(self, *settings):
        ours, theirs = connection.Pipe()
        roots = [str(Path(bakery.__file__).resolve().parents[1]), os.environ.get("PYTHONPATH", "")]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "bakery.run.worker", str(theirs.fileno())], pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            env={**_SINGLE, **os.environ, "PYTHONPATH": os.pathsep.join(filter(None, roots))})
        theirs.close()
        self._wire, self._threads = Wire(ours), 1
        self.connection = ours
        self.index, self.part = None, None
        self._send(*settings)

    def _send(self, *message) -> None:
        try:
            self._wire.send(*message)
        except OSError:
            pass  # it has died: what it does not say shows it

    def bake(self, index: int, plan, part: Progress) -> None:
        self.index, self.part = index, part
        self._send("bake", plan)

    def lend(self, threads: int) -> None:
        if threads != self._threads:
            self._threads = threads
            self._send("lend", threads)

    def hear(self) -> tuple[Outcome, bool] | None:
        """Take one message: an outcome with whether it is the last that can be had, or None."""
        try:
            kind, *values = self._wire.receive()
        except (EOFError, OSError):
            return Outcome(self.index, None, self._how_it_died(), 3), False
        if kind == "tell":
            getattr(self.part, values[0])(*values[1])
            return None
        return (Outcome(self.index, *values), False) if kind == "baked" else (Outcome(self.index, None, *values[:2]), values[2])

    def _how_it_died(self) -> str:
        status = self.process.wait()
        if status > 0:
            raise RuntimeError("a worker process ended by an exception, printed above")
        if status == -signal.SIGKILL:
            return "its process was killed: most likely it ran out of memory; fewer --jobs, or see `bake plan`"
        return f"its process died of signal {-status}"


class _Bakery:
    """Gives recipes to worker processes, and threads to those that have one."""

    def __init__(self, plans: Sequence, jobs: int, cache: Cache, address: str | None, board: Board):
        self._plans, self._jobs, self._board = plans, jobs, board
        self._settings = str(cache.where), jobs, address
        self._cache = cache
        self._waiting = list(range(len(plans)))
        self._idle: list[_Worker] = []
        self._busy: dict[int, _Worker] = {}
        self._room = SHARE_OF_MEMORY * (free_memory() or float("inf"))

    def run(self):
        """Yields (outcome, whether it is the last that can be had); a true value that is sent ends the starting of recipes."""
        try:
            self._start()
            while self._busy:
                for line in connection.wait([worker.connection for worker in self._busy.values()]):
                    worker = next(worker for worker in self._busy.values() if worker.connection is line)
                    end = worker.hear()
                    if end is None:
                        continue
                    del self._busy[worker.index]
                    if worker.process.poll() is None:
                        self._idle.append(worker)
                    self._board.ended(worker.index, end[0].baked is None)
                    if (yield end):
                        self._waiting.clear()
                    self._start()
        finally:
            self._end()

    def _start(self) -> None:
        """Start what may be, and share out the threads."""
        while len(self._busy) < self._jobs and (index := self._next()) is not None:
            self._idle = [worker for worker in self._idle if worker.process.poll() is None]
            worker = self._idle.pop() if self._idle else _Worker(*self._settings)
            self._waiting.remove(index)
            self._busy[index] = worker
            worker.bake(index, self._plans[index], self._board.part(index))
        for k, worker in enumerate(self._busy.values()):
            worker.lend(self._jobs // len(self._busy) + (k < self._jobs % len(self._busy)))

    def _next(self) -> int | None:
        """The first recipe whose work no other does just now, and whose memory suffices."""
        done = set().union(*(self._work(index) for index in self._busy))
        taken = sum(self._plans[index].memory for index in self._busy)
        for index in self._waiting:
            if not self._busy or (taken + self._plans[index].memory <= self._room and not done & self._work(index)):
                return index
        return None

    def _work(self, index: int) -> set:
        """What a recipe computes that others would find done: stages, kernels."""
        steps = [step for step in getattr(self._plans[index], "steps", ()) if step.action == RUN]
        return ({(step.stage.name, step.input_hash) for step in steps
                 if step.force or not self._cache.has(step.stage.name, step.input_hash)}
                | {module for step in steps for module in compiling.missing(step.cost.kernels)})

    def _end(self) -> None:
        """End all processes: those that bake remove their part files."""
        processes = [worker.process for worker in (*self._idle, *self._busy.values())]
        for process in processes:
            process.terminate()
        until = time.monotonic() + _UNWIND
        for process in processes:
            try:
                process.wait(max(until - time.monotonic(), 0.01))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
