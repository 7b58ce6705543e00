"""Where blocks run: threads of this process, or whatever speaks `concurrent.futures`.

Kernels release the interpreter's lock, so threads use every processor without copying arrays; a cluster joins by its executor.
Values do not depend on the choice: blocks are fixed by a stage's inputs and come back in order.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, ThreadPoolExecutor
from contextlib import contextmanager

import bakery
from bakery.errors import StageError, UsageError


class Context:
    """What a running stage may ask of its surroundings (see `stages.declaration.Context`).

    Parameters
    ----------
    tolerance : error that the stage has to reach
    seed : of the recipe
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
        futures = [self._executor.submit(function, *task) for task in tasks]
        try:
            return [future.result() for future in futures]
        except BrokenExecutor as error:
            raise StageError(f"a worker died ({error or 'no reason given'}); its memory may not have sufficed: "
                             "fewer --jobs, or see `bake plan`") from error
        finally:
            for future in futures:
                future.cancel()

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


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """The executor of a Dask cluster whose workers run the same bakery and the same libraries."""
    try:
        from distributed import Client
    except ImportError:
        raise UsageError('--cluster needs Dask: pip install ".[cluster]" in the folder of bakery\'s sources') from None
    if not re.fullmatch(r"([a-z]+://)?[^\s/]+:\d{1,5}", address):
        raise UsageError(f'--cluster: found "{address}"; the address of a Dask scheduler would do, such as tcp://host:8786')
    try:
        client = Client(address, timeout="10s", set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(f'--cluster: found "{address}", where no Dask scheduler answers ({error})') from None
    with client:
        ours = library_versions()
        for worker, theirs in client.run(library_versions).items():
            if theirs != ours:
                raise UsageError(f"--cluster: worker {worker} has {theirs}, here are {ours}; equal versions give equal values")
        yield client.get_executor()


def library_versions() -> dict[str, str]:
    """Versions of what decides the values of a block."""
    from importlib.metadata import version

    return {"bakery": bakery.__version__} | {name: version(name) for name in ("numba", "numpy", "scipy")}
