"""The parent's end of the worker: starts it, sends calls, ends it, and reports its failures."""

import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import bakery
from bakery.errors import StageError


class OutOfTime(Exception):
    """A run took longer than it was given."""


class Died(StageError):
    """The worker's process died: for lack of memory, say, of which there may be more another time."""


class Worker:
    """`trade.worker.Bench` in a process of its own, which is started at the first call and again after a failure.

    share : receives the share done of a run, 0 to 1
    """

    def __init__(self, share: Callable[[float], None] = lambda share: None, **arguments):
        self._arguments, self._share, self._process = arguments, share, None

    def keep(self, setting: Mapping[str, str], expected: str, limit: float | None = None) -> dict:
        return self._ask(limit, do="keep", setting=dict(setting), expected=expected)

    def compare(self, found: str, reference: str, limit: float | None = None) -> dict[str, float]:
        return self._ask(limit, do="compare", found=found, reference=reference)

    def run(self, setting: Mapping[str, str], expected: str, reference: str | None, limit: float | None = None) -> dict:
        return self._ask(limit, do="run", setting=dict(setting), expected=expected, reference=reference)

    def close(self) -> None:
        """End the process, whatever it does."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process.stdin.close()
            self._process.stdout.close()
            self._process = None

    def _start(self) -> None:
        roots = [str(Path(bakery.__file__).resolve().parents[1]), os.environ.get("PYTHONPATH", "")]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "bakery.trade.worker"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, roots))})
        self._tail = b""
        self._send(self._arguments)

    def _send(self, message: dict) -> None:
        try:
            self._process.stdin.write(json.dumps(message).encode() + b"\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # it has died; the missing answer shows it

    def _ask(self, limit: float | None, **call):
        if self._process is None:
            self._start()
        self._send(call)
        until = None if limit is None else time.monotonic() + limit
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            while True:
                seconds_left = None if until is None else max(until - time.monotonic(), 0.0)
                if not selector.select(seconds_left):
                    self.close()
                    raise OutOfTime
                data = os.read(self._process.stdout.fileno(), 1 << 16)
                if not data:
                    raise Died(self._how_it_died())
                *lines, self._tail = (self._tail + data).split(b"\n")
                for line in lines:
                    answer = json.loads(line)
                    if "share" in answer:
                        self._share(answer["share"])
                    elif "failed" in answer:
                        raise StageError(answer["failed"])
                    else:
                        return answer["found"]

    def _how_it_died(self) -> str:
        status = self._process.wait()
        self.close()
        if status == -signal.SIGKILL:
            return "its process was killed: most likely it ran out of memory"
        if status < 0:
            return f"its process died of signal {-status}"
        raise RuntimeError("the worker of bake trade ended by an exception, printed above")
