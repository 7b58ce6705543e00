"""What a bake and its worker processes say to each other: messages with plans, results and progress.

A stage goes as its place in the list of stages, which every process of a bakery declares alike.
"""

import copyreg
import threading
import time
from multiprocessing.connection import Connection

from bakery.run.progress import Progress
from bakery.stages import all_stages
from bakery.stages.declaration import Stage

SELDOM = 0.2  # seconds between two words on how far a stage is


def _stage(place: int) -> Stage:
    return all_stages()[place]


copyreg.pickle(Stage, lambda stage: (_stage, (all_stages().index(stage),)))


class Wire:
    """One end of a connection; any thread may send.

    Raises EOFError, OSError : the other end is gone
    """

    def __init__(self, connection: Connection):
        self.connection, self._lock = connection, threading.Lock()

    def send(self, *message) -> None:
        with self._lock:
            self.connection.send(message)

    def receive(self) -> tuple:
        return self.connection.recv()


class Sent(Progress):
    """Progress that is shown at the other end of a wire, `("tell", method, arguments)`."""

    def __init__(self, wire: Wire):
        self._wire, self._last = wire, 0.0

    def stage(self, name, title, tolerance, seconds):
        self._wire.send("tell", "stage", (name, title, tolerance, seconds))

    def update(self, fraction, error=None, state=""):
        now = time.monotonic()
        if now - self._last > SELDOM:
            self._last = now
            self._wire.send("tell", "update", (fraction, error, state))

    def done(self, name, text):
        self._wire.send("tell", "done", (name, text))

    def say(self, text):
        self._wire.send("tell", "say", (text,))
