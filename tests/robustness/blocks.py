"""Blocks for clusters of tests: they run in worker processes, which import them by name."""

import os
import signal
from pathlib import Path


def scaled(table, factor):
    """A sum that tells whether table and factor came over whole, and whether kernels would find the table writable."""
    return float(table.sum()) * factor, table.flags.writeable


def killed_once(mark, number):
    """Ends its worker the first time that block 0 runs."""
    if number == 0 and not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def deadly(number):
    """Ends every worker."""
    os.kill(os.getpid(), signal.SIGKILL)


def beheaded(scheduler):
    """Ends the scheduler that waits for the block's value."""
    os.kill(scheduler, signal.SIGKILL)


def refused(number):
    """A file that a block does not find is the block's own fault."""
    raise FileNotFoundError(f"block {number}")
