"""Blocks on a Dask cluster: a few messages a call, what all blocks share sent once, one line when the cluster fails."""

from __future__ import annotations

import hashlib
import logging
import pickle
import re
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager

from bakery.errors import StageError, UsageError
from bakery.run.executors import library_versions

# messages a thread of the cluster and call: blocks of grains take 9 ms, a message takes scheduler and client about as long
_PIECES = 4
_LARGE = 20_000  # bytes of shared arguments from which on they travel apart from the blocks
_KEPT = 8  # shared arguments that the workers keep
_LOOK, _PATIENCE = 2.0, 30.0  # seconds between looks at a cluster that is silent, and without any worker before we give up
_ANSWER = "10s"  # for a scheduler to answer, for its workers to appear
_LOGGERS = "distributed", "distributed.client", "distributed.gc", "tornado", "tornado.application"
_KEPT_STAGES = "finished stages are in the cache"


class Cluster(Executor):
    """Runs blocks on the workers of a Dask scheduler.

    Parameters
    ----------
    client : distributed.Client
    """

    def __init__(self, client):
        self._client = client
        self._executor = client.get_executor(pure=False)
        self._shared = OrderedDict()

    def submit(self, function, /, *arguments, **named) -> Future:
        """One call by itself."""
        return self._executor.submit(function, *arguments, **named)

    def map(self, function: Callable, *columns) -> list:
        """`[function(*task) for task in zip(*columns)]`.

        Raises
        ------
        StageError : the scheduler is gone, or no worker is left, or a block ended its workers
        """
        tasks = list(zip(*columns, strict=True))
        if not tasks:
            return []
        with self._told():
            number = min(len(tasks), _PIECES * max(1, sum(self._client.nthreads().values())))
            common, tasks = _divided(tasks)
            common = self._sent(pickle.dumps((function, common), protocol=5))
            # every number-th block: neighbours often take alike, and one message should not get all the long ones
            futures = [self._executor.submit(_run, common, pickle.dumps(tasks[k::number], protocol=5)) for k in range(number)]
            values = [None] * len(tasks)
            try:
                for k, future in enumerate(futures):
                    values[k::number] = self._result(future)
            finally:
                for future in futures:
                    future.cancel()
        return values

    def _sent(self, common: bytes):
        """What stands for the shared arguments in a message: themselves, or a task that unpacks them, once a worker.

        A task and not scattered data: the scheduler can have it done again where the worker that did it has died.
        """
        if len(common) < _LARGE:
            return common
        key = "shared-" + hashlib.sha256(common).hexdigest()
        if key not in self._shared:
            self._shared[key] = self._client.submit(pickle.loads, common, key=key)
            while len(self._shared) > _KEPT:
                self._shared.popitem(last=False)
        self._shared.move_to_end(key)
        return self._shared[key]

    def _result(self, future: Future):
        """Of a message, with a look now and then at whether anybody is working on it."""
        idle = 0.0
        while True:
            try:
                return future.result(timeout=_LOOK)
            except TimeoutError:
                if future.done():
                    raise  # of the block itself
            if self._client.status != "running":
                raise CancelledError
            idle = 0.0 if self._client.nthreads() else idle + _LOOK
            if idle >= _PATIENCE:
                raise StageError(f"the cluster has had no worker for {_PATIENCE:g} s; {_KEPT_STAGES}")

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Failures of the cluster in the words of the bake; those of a block pass."""
        from distributed import KilledWorker

        try:
            yield
        except KilledWorker as error:
            raise StageError(f"{error.allowed_failures + 1} workers died on the same block; their memory may not suffice: "
                             "fewer threads a worker, or see `bake plan`") from error
        except (CancelledError, OSError) as error:
            if isinstance(error, OSError) and self._client.status == "running":
                raise
            raise StageError(f"the scheduler of the cluster is gone; {_KEPT_STAGES}") from error


@contextmanager
def cluster(address: str) -> Iterator[Cluster]:
    """The workers of a Dask scheduler, which run the same bakery and the same libraries; its own messages are kept quiet."""
    try:
        from distributed import Client
    except ImportError:
        raise UsageError('--cluster needs Dask: pip install ".[cluster]" in the folder of bakery\'s sources') from None
    if not re.fullmatch(r"([a-z]+://)?[^\s/]+:\d{1,5}", address):
        raise UsageError(f'--cluster: found "{address}"; the address of a Dask scheduler would do, such as tcp://host:8786')
    with _quiet():
        try:
            client = Client(address, timeout=_ANSWER, set_as_default=False)
        except (OSError, ValueError) as error:
            raise UsageError(f'--cluster: found "{address}", where no Dask scheduler answers ({error})') from None
        with client:
            _check_workers(client)
            yield Cluster(client)


def _check_workers(client) -> None:
    try:
        client.wait_for_workers(1, timeout=_ANSWER)
    except TimeoutError:
        raise UsageError(f"--cluster: the scheduler at {client.scheduler.address} has no workers") from None
    ours = library_versions()
    for worker, theirs in client.run(library_versions, on_error="return").items():
        if isinstance(theirs, OSError):
            continue  # it has died since it was listed: blocks go to the others, or to the one that is started in its place
        if isinstance(theirs, Exception):
            raise UsageError(f"--cluster: worker {worker} does not tell its versions ({type(theirs).__name__}: {theirs})")
        if theirs != ours:
            raise UsageError(f"--cluster: worker {worker} has {theirs}, here are {ours}; equal versions give equal values")


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask's log and warnings stay off standard error: what matters of them is reported by `Cluster`."""
    handlers = {handler for name in _LOGGERS for handler in logging.getLogger(name).handlers}
    for handler in handlers:
        handler.addFilter(_nothing)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="distributed")
            yield
    finally:
        for handler in handlers:
            handler.removeFilter(_nothing)


def _nothing(record: logging.LogRecord) -> bool:
    return False


def _divided(tasks: list[tuple]) -> tuple[dict, list[tuple]]:
    """Arguments that are one object in all tasks, by place, and the others of each task."""
    common = {k: first for k, first in enumerate(tasks[0]) if all(task[k] is first for task in tasks)}
    return common, [tuple(value for k, value in enumerate(task) if k not in common) for task in tasks]


def _run(common, tasks: bytes) -> list:
    """Values of a message's blocks; runs in a worker."""
    # unpacked here and not by Dask: its arrays are read-only, and kernels would be compiled anew for such
    function, common = pickle.loads(common) if isinstance(common, bytes) else common
    values = []
    for task in pickle.loads(tasks):
        rest = iter(task)
        values.append(function(*(common[k] if k in common else next(rest) for k in range(len(common) + len(task)))))
    return values
