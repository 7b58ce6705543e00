"""A process that bakes recipes of a larger bake, one after another: `python -m bakery.run.worker FD`.

It lives as long as the bake, so libraries and compiled kernels are loaded once.  Its threads are lent to it: the bake takes them
away and gives more as other recipes begin and end.
"""

import os
import signal
import sys
import threading
from concurrent.futures import Executor
from contextlib import ExitStack
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue

from bakery.errors import BakeryError
from bakery.run.bake import executed
from bakery.run.cache import Cache
from bakery.run.dask import NoCluster, cluster
from bakery.run.executors import Lent
from bakery.run.messages import ClusterLost
from bakery.run.wire import Sent, Wire
from bakery.system.memory import refuse_what_does_not_fit
from bakery.system.signals import Terminated, raise_when_asked

TERMINATED = 143
_UNWIND = 1.5  # seconds to remove part files in, once the bake itself is gone


class _Baker:
    """Bakes plans on threads of this process, or on a cluster, to which it connects once."""

    def __init__(self, wire: Wire, where: str, workers: int, address: str | None):
        self._wire, self._where, self._workers, self._address = wire, Path(where), workers, address
        self.lent, self._remote = Lent(workers), ExitStack()
        self._far = None

    def bake(self, plan) -> None:
        told = Sent(self._wire)
        try:
            baked = executed(plan, cache=Cache(self._where, say=told.say), jobs=self._workers, executor=self._executor(told),
                             progress=told)
        except BakeryError as error:
            lost = isinstance(error, (ClusterLost, NoCluster))
            if lost:
                self.close()
            self._wire.send("failed", str(error), error.exit_status, lost)
        except MemoryError:
            self._wire.send("failed", "out of memory; fewer --jobs, or see `bake plan`", 3, False)
        else:
            self._wire.send("baked", baked)

    def _executor(self, told: Sent) -> Executor:
        if self._address is None:
            return self.lent
        if self._far is None:
            self._far = self._remote.enter_context(cluster(self._address))
        self._far.say = told.say
        return self._far

    def close(self) -> None:
        """Leave the cluster."""
        self._far = None
        self._remote.close()


def _listen(wire: Wire, plans: SimpleQueue, baker: _Baker) -> None:
    """Take messages while the main thread bakes; end the process when the bake is gone."""
    try:
        while True:
            kind, value = wire.receive()
            if kind == "lend":
                baker.lent.lend(value)
            else:
                plans.put(value)
    except (EOFError, OSError):
        os.kill(os.getpid(), signal.SIGTERM)
        threading.Event().wait(_UNWIND)
        os._exit(TERMINATED)


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal interrupts all of its processes; the bake itself ends this one
    raise_when_asked({signal.SIGTERM: Terminated})
    refuse_what_does_not_fit()
    try:
        wire = Wire(Connection(int(sys.argv[1])))
        baker, plans = _Baker(wire, *wire.receive()), SimpleQueue()
        threading.Thread(target=_listen, args=(wire, plans, baker), daemon=True).start()
        while True:
            baker.bake(plans.get())
    except (Terminated, EOFError, BrokenPipeError):
        os._exit(TERMINATED)  # threads may be inside a kernel; what they compute is not wanted any more


if __name__ == "__main__":
    main()
