"""Signals that end a process, as exceptions that are raised where nothing swallows them.

Exceptions, not exits: part files are removed on the way out.
"""

import signal
import sys
from types import FrameType

INTERRUPTED, TERMINATED = 130, 143  # statuses
SOON = 0.02  # seconds until what could not be raised is tried again


class Terminated(BaseException):
    """SIGTERM came."""


class _Ending:
    """What was asked for, and has to be raised in the main thread."""

    def __init__(self, exceptions: dict[int, type[BaseException]]):
        self._exceptions, self._due = exceptions, None

    def asked(self, number: int, frame: FrameType | None) -> None:
        # Another signal must not break off the clean-up: a script that is interrupted with its bake ends it as well.
        # The same one a second time ends at once.
        for caught in self._exceptions:
            signal.signal(caught, signal.SIG_DFL if caught == number else _ignored)
        self._due = self._exceptions[number]
        self.raise_it(number, frame)

    def raise_it(self, _number: int, frame: FrameType | None) -> None:
        # Modules catch what goes wrong while they are imported, and extensions written in C clear it: 4 of 240 SIGTERMs were lost
        # there.  Besides, a module that was imported by half fails in whatever runs next.
        if _importing(frame):
            _again()
        else:
            raise self._due

    def raise_what_waits(self) -> None:
        """What was asked for while modules were imported, now that they are."""
        if self._due is not None:
            too_late()
            raise self._due

    def ignored(self, unraisable) -> None:
        """Of an exception that Python could not raise, in a destructor or a callback: ours is raised again."""
        if self._due is not None and isinstance(unraisable.exc_value, self._due):
            _again()
        else:
            sys.__unraisablehook__(unraisable)


def raise_when_asked(exceptions: dict[int, type[BaseException]]) -> _Ending:
    """Make each of these signals an exception; takes SIGALRM and its timer for itself."""
    ending = _Ending(exceptions)
    for number in exceptions:
        signal.signal(number, ending.asked)
    signal.signal(signal.SIGALRM, ending.raise_it)
    sys.unraisablehook = ending.ignored
    return ending


def too_late() -> None:
    """What waits is not raised any more: a timer that runs out while Python shuts down ends the process by SIGALRM."""
    signal.setitimer(signal.ITIMER_REAL, 0)


def ended(ending: BaseException) -> int:
    """Say that a signal ended the call; the status."""
    from bakery.system.terminal import remark

    status, word = (TERMINATED, "terminated") if isinstance(ending, Terminated) else (INTERRUPTED, "interrupted")
    remark(f"{word}; no file is incomplete, and finished stages of a bake are in the cache")
    return status


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _again() -> None:
    signal.setitimer(signal.ITIMER_REAL, SOON)


def _ignored(_number, _frame):
    """In place of SIG_IGN, for which Python complains of a signal that has come already and that it has not handled yet."""
