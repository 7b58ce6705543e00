"""What Mitsuba says while it reads a scene, on standard error: its own logger prints on standard output, which is for results."""

import sys
from contextlib import contextmanager
from typing import ClassVar

import mitsuba as mi


class _StandardError(mi.Appender):
    """Plain lines, each once: a render may read its scene several times."""

    written: ClassVar[set[str]] = set()

    def append(self, level, text):
        message = text.split("] ", 1)[-1]  # without the time and the line of Mitsuba's code, or all of it
        if message not in self.written:
            self.written.add(message)
            print(f"Mitsuba: {message}", file=sys.stderr)

    def log_progress(self, *_):
        pass


@contextmanager
def on_standard_error():
    """Around calls of Mitsuba: what its logger has to say goes to standard error, in place of its own appenders."""
    logger = mi.logger()
    appenders = [logger.appender(n) for n in range(logger.appender_count())]
    logger.clear_appenders()
    logger.add_appender(_StandardError())
    try:
        yield
    finally:
        logger.clear_appenders()
        for appender in appenders:
            logger.add_appender(appender)
