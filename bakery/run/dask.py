"""Blocks on a Dask cluster: which workers get some, what they share sent once, a line for each thing that goes wrong.

Only workers that have been asked for their versions get blocks: each message names those that may run it.
"""

import logging
import pickle
import re
import time
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress

from bakery.errors import StageError, UsageError
from bakery.run.executors import library_versions
from bakery.run.messages import LOOK, RESUME, ClusterLost, Map, run

HERE = 0.03  # seconds of blocks that are done here sooner than a message comes back
_LARGE = 20_000  # bytes of shared arguments from which on they travel apart from the blocks
_KEPT = 8  # shared arguments that the workers keep
_ANSWER = "30s"  # for a scheduler to answer, for its workers to appear
_LOGGERS = "distributed", "distributed.client", "distributed.gc", "tornado", "tornado.application"
_REMEDY = "install the same there and start it again"


class NoCluster(UsageError):
    """There is no such cluster, or it has no worker that may run blocks: no bake can use it."""


class Cluster(Executor):
    """Runs blocks on those workers of a Dask scheduler that have the versions of this process.

    Parameters
    ----------
    client : distributed.Client
    say : takes remarks on workers

    Attributes
    ----------
    threads : of each worker that gets blocks, by address
    """

    def __init__(self, client, say: Callable[[str], None] = lambda text: None):
        self._client, self.say = client, say
        self._executor = client.get_executor(pure=False)  # its futures fetch values while this thread sends more
        self.threads: dict[str, int] = {}
        self.refused: dict[str, str] = {}  # address -> why
        self._shared, self._pace, self._looked = OrderedDict(), {}, -1e9

    def map(self, function: Callable, *columns) -> list:
        """`[function(*task) for task in zip(*columns)]`.

        Raises
        ------
        StageError : a block ended its workers
        ClusterLost : the scheduler is gone, or no worker is left
        """
        tasks = list(zip(*columns, strict=True))
        # a function's blocks may differ much, but stages map the same ones again and again
        if len(tasks) * self._pace.get(_name(function), 1.0) < HERE:
            started = time.monotonic()
            values = [function(*task) for task in tasks]
            self.noted(function, len(tasks), time.monotonic() - started)
            return values
        with self._told():
            return Map(self, function, tasks).values()

    def arriving(self, function: Callable, *columns) -> Iterator[tuple[int, object]]:
        """Position and value of each `function(*task)` as they come back from workers; columns and errors as of `map`."""
        with self._told():
            yield from Map(self, function, list(zip(*columns, strict=True))).arriving()

    def noted(self, function: Callable, blocks: int, seconds: float) -> None:
        """Remember how long blocks of a function take."""
        before = self._pace.get(_name(function), seconds / max(blocks, 1))
        self._pace[_name(function)] = 0.5 * (before + seconds / max(blocks, 1))

    def pace(self, function: Callable) -> float | None:
        """Seconds of one of a function's blocks; None where that is not known."""
        return self._pace.get(_name(function))

    def look(self) -> None:
        """Learn, now and then, which workers there are."""
        if self._client.status != "running":
            raise CancelledError
        if time.monotonic() - self._looked < LOOK:
            return
        try:
            present = self._client.nthreads()
            new = sorted(present.keys() - self.threads.keys() - self.refused.keys())
            told = self._client.run(library_versions, workers=new, on_error="return") if new else {}
        except OSError as error:
            raise CancelledError from error
        self._looked = time.monotonic()
        lost = sorted(self.threads.keys() - present.keys())
        for address in lost:
            self.say(f"cluster: worker {address} is gone; what it had is done again")
        for address in sorted(told):
            if not isinstance(told[address], OSError):  # it has died since it was listed
                self._judge(address, told[address], present[address])
        self.threads = {address: count for address, count in self.threads.items() if address in present}
        if lost or new:
            self._shared.clear()  # it was for the workers of that time

    def _judge(self, address: str, theirs, threads: int) -> None:
        """Let a worker have blocks, or refuse it."""
        reason = _unlike(theirs, library_versions())
        if reason:
            self.refused[address] = reason
            self.say(f"cluster: worker {address} gets no blocks: {reason}; {_REMEDY}")
        else:
            self.threads[address] = threads

    def sent(self, common: bytes, key: str):
        """What stands for the shared arguments in a message: themselves, or a task that unpacks them, once a worker.

        A task and not scattered data: the scheduler can have it done again where the worker that did it has died.
        """
        if len(common) < _LARGE:
            return common
        if key not in self._shared:
            self._shared[key] = self._client.submit(pickle.loads, common, pure=False, workers=list(self.threads))
            while len(self._shared) > _KEPT:
                self._shared.popitem(last=False)
        self._shared.move_to_end(key)
        return self._shared[key]

    def send(self, workers: Iterable[str], *arguments) -> Future:
        """The future of a message, which one of some workers runs."""
        return self._executor.submit(run, *arguments, workers=list(workers))

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
            raise ClusterLost(f"the scheduler of the cluster is gone; {RESUME}") from error


@contextmanager
def cluster(address: str, say: Callable[[str], None] = lambda text: None) -> Iterator[Cluster]:
    """The workers of a Dask scheduler, which run the same bakery and the same libraries; its own messages are kept quiet.

    `say` takes remarks on workers: those that are refused for their versions, that die, that are slow.  Raises NoCluster.
    """
    check_address(address)
    try:
        import distributed  # noqa: F401  # before `_quiet`, which needs its loggers
    except ImportError:
        raise NoCluster('--cluster needs Dask: pip install ".[cluster]" in the folder of bakery\'s sources') from None
    with _quiet(), _client(address) as client:
        yield _connected(client, say)


def check_address(address: str) -> None:
    """UsageError for what is no address of a Dask scheduler, before anything is asked there."""
    # tcp:8786 is half an address, and no host of that name
    match = re.fullmatch(r"(?:(?:tcp|tls)://|(?!(?:tcp|tls):))[^\s/]+:(\d{1,5})", address)
    if not match or not 0 < int(match[1]) < 65536:
        raise UsageError(f'--cluster: found "{address}"; expected the address of a Dask scheduler, such as tcp://host:8786')


def _client(address: str):
    """A `distributed.Client` that is connected."""
    from distributed import Client
    from distributed.security import Security

    # made in two steps, to be held where the second fails: left to itself, a half-made one waits for a minute to be collected
    client = Client.__new__(Client)
    try:
        if address.startswith("tls://") and Security().get_connection_args("client")["ssl_context"] is None:
            raise NoCluster(f'--cluster: found "{address}", but Dask has no certificates for it; its options '
                            "distributed.comm.tls.ca-file and .client.cert name them (docs/clusters.md)")
        client.__init__(address, timeout=_ANSWER, set_as_default=False)
    except BaseException as error:
        with suppress(Exception):
            client.close(timeout=1)
        client.status = "closed"
        if isinstance(error, NoCluster) or not isinstance(error, Exception):
            raise
        raise NoCluster(f'--cluster: found "{address}", where no Dask scheduler answers ({error})') from None
    return client


def _connected(client, say) -> Cluster:
    """A cluster that has workers to run blocks on."""
    try:
        client.wait_for_workers(1, timeout=_ANSWER)
    except TimeoutError:
        raise NoCluster(f"--cluster: the scheduler at {client.scheduler.address} has no workers") from None
    cluster = Cluster(client, say)
    cluster.look()
    if cluster.refused and not cluster.threads:
        address, reason = next(iter(cluster.refused.items()))
        raise NoCluster(f"--cluster: worker {address} gets no blocks: {reason}; equal versions give equal values: {_REMEDY}")
    return cluster


def _unlike(theirs, ours: dict[str, str]) -> str:
    """How the versions of a worker differ from those here; empty where they do not."""
    if isinstance(theirs, Exception):
        return f"it does not tell its versions ({type(theirs).__name__}: {theirs})"
    differences = [f"{name} {theirs.get(name, 'missing')} instead of {version}" for name, version in ours.items()
             if theirs.get(name) != version]
    return f"it has {', '.join(differences)}" if differences else ""


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


def _name(function: Callable) -> str:
    return getattr(function, "__name__", "")
