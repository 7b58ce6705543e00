"""What a bake says while it works: a bar on a terminal, else a line a stage and one a minute."""

from __future__ import annotations

import sys
import time

from bakery.run.resources import duration


class Progress:
    """Says nothing; the base of the others and what `--quiet` uses."""

    def stage(self, name: str, title: str, tolerance: float, seconds: float) -> None:
        """A stage starts; `seconds` is what the plan expects of it."""

    def update(self, fraction: float, error: float | None = None, state: str = "") -> None:
        """Share done, 0 to 1, the error so far where one is known, the state of the work in the stage's own words."""

    def done(self, name: str, text: str) -> None:
        """A stage has ended."""

    def say(self, text: str) -> None:
        """A remark."""

    def close(self) -> None:
        """The bake has ended, well or not."""


class _State:
    """How far a stage is, in words.  Between two estimates the last error stays."""

    def __init__(self, tolerance: float = 0.0):
        self._tolerance, self._error, self._started = tolerance, None, time.monotonic()

    def words(self, fraction: float, error: float | None, state: str) -> str:
        self._error = self._error if error is None else error
        spent = time.monotonic() - self._started
        left = f", {duration(spent / fraction - spent)} left" if fraction > 0.05 else ""
        allowed = f" of {self._tolerance:.2g}" if self._tolerance else ""
        reached = "" if self._error is None else f", error {self._error:.2g}{allowed}"
        return f"{100 * fraction:.0f} %{reached}{state and ', ' + state}{left}"


class Lines(Progress):
    """One line a stage and one a minute, for logs."""

    def __init__(self, stream=None, every: float = 60.0):
        self._stream = stream or sys.stderr
        self._every = every
        self._name, self._state, self._last = "", _State(), 0.0

    def say(self, text):
        try:
            print(text, file=self._stream, flush=True)
        except (OSError, ValueError):
            pass  # nobody listens any more; the bake goes on

    def stage(self, name, title, tolerance, seconds):
        self._name, self._state, self._last = name, _State(tolerance), time.monotonic()

    def update(self, fraction, error=None, state=""):
        if time.monotonic() - self._last >= self._every:
            self._last = time.monotonic()
            self.say(f"{self._name}: {self._state.words(fraction, error, state)}")

    def done(self, name, text):
        self.say(f"{name}: {text}")


class Bar(Progress):
    """A live bar on a terminal."""

    def __init__(self):
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn
        from rich.progress import Progress as RichProgress

        self._console = Console(stderr=True)
        columns = TextColumn("{task.description:>10}"), BarColumn(bar_width=30), TextColumn("{task.fields[state]}")
        self._bar = RichProgress(*columns, console=self._console, transient=True)
        self._bar.start()
        self._task, self._state = None, _State()

    def stage(self, name, title, tolerance, seconds):
        self._state = _State(tolerance)
        self._task = self._bar.add_task(name, total=1.0, state=f"about {duration(seconds)}" if seconds else "")

    def update(self, fraction, error=None, state=""):
        if self._task is not None:
            self._bar.update(self._task, completed=fraction, state=self._state.words(fraction, error, state))

    def done(self, name, text):
        if self._task is not None:
            self._bar.remove_task(self._task)
            self._task = None
        self.say(f"{name}: {text}")

    def say(self, text):
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def close(self):
        self._bar.stop()


class Named(Progress):
    """Another's words with a name before them: which of several recipes they are about."""

    def __init__(self, other: Progress, name: str):
        self._other, self._name = other, name

    def stage(self, name, *expected):
        self._other.stage(f"{self._name}: {name}", *expected)

    def update(self, *state):
        self._other.update(*state)

    def done(self, name, text):
        self._other.done(f"{self._name}: {name}", text)

    def say(self, text):
        self._other.say(f"{self._name}: {text}")


def choose(quiet: bool = False) -> Progress:
    """The kind that fits standard error."""
    if quiet:
        return Progress()
    try:
        terminal = sys.stderr.isatty()
    except ValueError:
        return Progress()  # closed
    return Bar() if terminal else Lines()
