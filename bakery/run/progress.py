"""What a bake says while it works: a bar on a terminal, else a line for what takes longer than a moment and one a minute."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from bakery.system.resources import duration

FIRST = 1.5  # seconds after which something that goes on is named: nobody is left without a word for 2 s
EVERY = 60.0
EARLY = 0.05  # share done up to which a first word means that the work begins
PRIOR = 0.1  # share of the work that the plan's word counts for in the time that is left


class Progress:
    """Says nothing; the base of the others and what `--quiet` uses."""

    def stage(self, name: str, title: str, tolerance: float, seconds: float) -> None:
        """A stage starts; `seconds` is what the plan expects of it, compiling apart."""

    def update(self, fraction: float, error: float | None = None, state: str = "") -> None:
        """Share done, 0 to 1, the error so far where one is known, the state of the work in the stage's own words."""

    def compiling(self, active: bool) -> None:
        """Kernels are being compiled, or no more; called from any thread."""

    def done(self, name: str, text: str) -> None:
        """A stage has ended."""

    def begin(self, text: str) -> None:
        """Something besides the stages starts, such as "checking fog.h5"."""

    def end(self) -> None:
        """It has ended."""

    @contextmanager
    def during(self, text: str) -> Iterator[None]:
        """`begin` and `end` around the body of a `with`."""
        self.begin(text)
        try:
            yield
        finally:
            self.end()

    def say(self, text: str) -> None:
        """A remark."""

    def close(self) -> None:
        """The bake has ended, well or not."""


class State:
    """How far a stage is, in words.  Between two estimates the last error stays, and the time left is counted down.

    tolerance : error allowed, 0 for none
    planned : seconds that the plan expects, compiling apart; 0 where there is no plan
    clock : seconds, monotonic
    """

    def __init__(self, tolerance: float = 0.0, planned: float = 0.0, clock=time.monotonic):
        self._tolerance, self._planned, self._clock = tolerance, planned, clock
        self._fraction, self._error, self._state = 0.0, None, ""
        self._first = 0.0, 0.0  # seconds and share done from which the work counts: what comes before is loading
        self._started, self._updated = clock(), 0.0  # a time, and seconds of work
        self._compiled, self._compiling = 0.0, None  # seconds, and since when

    def update(self, fraction: float, error: float | None, state: str) -> None:
        self._updated = self._worked()
        if not self._fraction and fraction < EARLY:
            self._first = self._updated, fraction
        self._fraction, self._state = fraction, state
        self._error = self._error if error is None else error

    def compiling(self, active: bool) -> None:
        if active:
            self._compiling = self._clock()
        elif self._compiling is not None:
            self._compiled += self._clock() - self._compiling
            self._compiling = None

    def _worked(self) -> float:
        """Seconds spent, compiling apart."""
        since = self._compiling
        return (self._clock() if since is None else since) - self._started - self._compiled

    def left(self) -> float | None:
        """Seconds that are left; None where neither the plan nor the progress so far gives an estimate."""
        share = PRIOR if self._planned else 0.0
        if not self._fraction - self._first[1] + share:
            return None
        # what was done speaks for the rest, and the plan until enough is done
        rate = (self._updated - self._first[0] + share * self._planned) / (self._fraction - self._first[1] + share)
        seconds = (1 - self._fraction) * rate - (self._worked() - self._updated)
        return seconds if seconds > 0 else None

    def words(self) -> str:
        since = self._compiling
        if since is not None:
            return f"compiling kernels, once ({duration(self._compiled + self._clock() - since)})"
        seconds = self.left()
        remaining = "" if seconds is None else f"about {duration(seconds)}" if not self._fraction else f"{duration(seconds)} left"
        allowed = f" of {self._tolerance:.2g}" if self._tolerance else ""
        error = "" if self._error is None else f"error {self._error:.2g}{allowed}"
        share = f"{100 * self._fraction:.0f} %" if self._fraction else ""
        return ", ".join(word for word in (share, error, self._state, remaining) if word) or f"{duration(self._worked())} so far"


class Lines(Progress):
    """For logs: what lasts longer than a moment is named, then once a minute, and each stage when it ends.

    stream : standard error by default
    first, every : seconds until something that goes on is named, and between two lines after that
    """

    def __init__(self, stream=None, first: float | None = None, every: float = EVERY):
        self._stream = sys.stderr if stream is None else stream
        self._first, self._every = FIRST if first is None else first, every
        self._name, self._state, self._told, self._timer = "", State(), False, None
        self._lock = threading.RLock()  # lines come from the stage and from the timer

    def say(self, text):
        try:
            print(text, file=self._stream, flush=True)
        except (OSError, ValueError):
            pass  # nobody listens any more; the bake goes on

    def stage(self, name, title, tolerance, seconds):
        self._start(name, State(tolerance, seconds))

    def begin(self, text):
        self._start(text, State())

    def _start(self, name, state):
        with self._lock:
            self._name, self._state, self._told = name, state, False
            self._wait(self._first)

    def update(self, fraction, error=None, state=""):
        self._state.update(fraction, error, state)

    def compiling(self, active):
        with self._lock:
            self._state.compiling(active)
            if active and not self._told:  # named once a stage, if it lasts
                self._told = True
                self._wait(self._first)

    def end(self):
        with self._lock:
            self._wait(None)

    def done(self, name, text):
        with self._lock:
            self._wait(None)
            self.say(f"{name}: {text}")

    def close(self):
        self.end()

    def _wait(self, seconds: float | None) -> None:
        """Name what goes on after so long; None: not any more."""
        if self._timer:
            self._timer.cancel()
        self._timer = None
        if seconds is not None:
            self._timer = threading.Timer(seconds, self._tell)
            self._timer.daemon = True
            try:
                self._timer.start()
            except RuntimeError:  # no thread to be had: nothing is said in between
                self._timer = None

    def _tell(self):
        with self._lock:
            if self._timer is threading.current_thread():  # else it ended while this waited
                self.say(f"{self._name}: {self._state.words()}")
                self._wait(self._every)


class Bar(Progress):
    """A live bar on a terminal."""

    def __init__(self):
        from rich.console import Console
        from rich.progress import BarColumn, ProgressColumn, TextColumn
        from rich.progress import Progress as RichProgress
        from rich.text import Text

        class Words(ProgressColumn):
            def render(self, task):
                return Text(task.fields["words"]())  # as of now: the display is drawn anew several times a second

        self._console = Console(stderr=True)
        self._bar = RichProgress(TextColumn("{task.description:>10}"), BarColumn(bar_width=30), Words(), console=self._console,
                                 transient=True)
        self._bar.start()
        self._task, self._state = None, State()

    def stage(self, name, title, tolerance, seconds):
        self.end()
        self._state = State(tolerance, seconds)
        self._task = self._bar.add_task(name, total=1.0, words=self._state.words)

    def begin(self, text):
        self.end()
        self._state = State()
        self._task = self._bar.add_task(text, total=None, words=self._state.words)

    def update(self, fraction, error=None, state=""):
        if self._task is not None:
            self._state.update(fraction, error, state)
            self._bar.update(self._task, completed=fraction)

    def compiling(self, active):
        self._state.compiling(active)

    def end(self):
        if self._task is not None:
            self._bar.remove_task(self._task)
            self._task = None

    def done(self, name, text):
        self.end()
        self.say(f"{name}: {text}")

    def say(self, text):
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def close(self):
        self._bar.stop()


def choose(quiet: bool = False) -> Progress:
    """The kind that fits standard error."""
    if quiet or sys.stderr is None:  # None: the process was started without
        return Progress()
    try:
        terminal = sys.stderr.isatty()
    except ValueError:
        return Progress()  # closed
    return Bar() if terminal else Lines()
