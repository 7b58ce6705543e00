"""Where blocks run: threads of this process, or whatever speaks `concurrent.futures`.

Kernels release the interpreter's lock, so threads use every processor without copying arrays; a cluster joins by its executor.
Values do not depend on the choice: blocks are fixed by a stage's inputs and come back in order.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Condition

import bakery
from bakery.errors import StageError


class Context:
    """What a running stage may ask of its surroundings (see `stages.declaration.Context`).

    tolerance : error that the stage has to reach
    executor : runs the blocks; None runs them one by one, here
    report : takes the share done and the error so far
    """

    def __init__(self, tolerance: float, seed: int = 0, executor: Executor | None = None,
                 report: Callable[[float, float | None], None] | None = None):
        self.tolerance = tolerance
        self.seed = seed
        self._executor = executor
        self._report = report

    def map(self, function: Callable, tasks: Sequence[tuple]) -> list:
        """`[function(*task) for task in tasks]` on the workers, in the order of the tasks."""
        if self._executor is None:
            return [function(*task) for task in tasks]
        try:
            return list(self._executor.map(function, *zip(*tasks, strict=True)))
        except BrokenExecutor as error:
            raise StageError(f"a worker died ({error or 'no reason given'}); its memory may not have sufficed: "
                             "fewer --jobs, or see `bake plan`") from error

    def report(self, fraction: float, error: float | None = None, state: str = "") -> None:
        """Share of the work that is done, 0 to 1, the error reached so far, the state of the work in the stage's own words."""
        if self._report:
            self._report(fraction, error, state)


@contextmanager
def threads(count: int) -> Iterator[Executor]:
    """Threads of this process.  On the way out of an interrupt the blocks that wait are dropped."""
    executor = ThreadPoolExecutor(count, thread_name_prefix="bake")
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        raise
    executor.shutdown()


class Lent(ThreadPoolExecutor):
    """Threads of this process of which only as many run at once as are lent to it just now.

    most : threads that may be lent, at first one
    """

    def __init__(self, most: int):
        super().__init__(most, thread_name_prefix="bake")
        self._turn, self._lent, self._busy = Condition(), 1, 0

    def lend(self, count: int) -> None:
        """So many threads from now on; blocks that run are not stopped."""
        with self._turn:
            self._lent = count
            self._turn.notify_all()

    def submit(self, function, /, *arguments, **named) -> Future:
        return super().submit(self._run, function, arguments, named)

    def _run(self, function, arguments, named):
        with self._turn:
            self._turn.wait_for(lambda: self._busy < self._lent)
            self._busy += 1
        try:
            return function(*arguments, **named)
        finally:
            with self._turn:
                self._busy -= 1
                self._turn.notify()


def library_versions() -> dict[str, str]:
    """Versions of what decides the values of a block."""
    from importlib.metadata import version
    from platform import python_version_tuple

    versions = {"bakery": bakery.__version__, "python": ".".join(python_version_tuple()[:2])}
    return versions | {name: version(name) for name in ("numba", "numpy", "scipy")}
