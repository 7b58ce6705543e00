"""The command line: one file a command; each parses, calls, prints.  `main` is what the program `bake` calls.

The table of commands and what parses are in `bakery.cli.commands`.  They take a tenth of a second to load, in which a signal has
to end as quietly as later on, so that nothing else is loaded here.
"""

import os
import signal
import sys
from importlib import import_module

from bakery.system import signals

_OF_COMMANDS = ("COMMANDS", "TELLING", "cli", "status_of")


def __getattr__(name: str):
    if name in _OF_COMMANDS:
        return getattr(import_module("bakery.cli.commands"), name)
    raise AttributeError(f"module 'bakery.cli' has no attribute {name!r}")


def main(args: list[str] | None = None) -> None:
    """Run the command line and leave with the status that the contract names."""
    ending = signals.raise_when_asked({signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: signals.Terminated})
    try:
        from bakery.cli import commands

        ending.raise_what_waits()
        status = commands.run(args)
    except (KeyboardInterrupt, signals.Terminated) as asked:
        status = signals.ended(asked)
    signals.too_late()
    if status in (signals.INTERRUPTED, signals.TERMINATED):
        os._exit(status)  # threads may be inside a kernel; what they compute is not wanted any more
    sys.exit(status)
