"""What the machine has and what a stage used: processors, memory, disk."""

import os
import resource
import sys
from pathlib import Path

from bakery.errors import UsageError


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def jobs(count: int | None = None) -> int:
    """Number of workers: the option, else the environment's BAKERY_JOBS, else every processor."""
    text = os.environ.get("BAKERY_JOBS", "")
    if count is None and text:
        if not text.isdigit() or int(text) < 1:
            raise UsageError(f'BAKERY_JOBS: found "{text}"; expected a whole number from 1')
        count = int(text)
    return count or processors()


def reset_peak() -> None:
    """Start a new peak; without Linux's /proc the peak is that of the whole process."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        pass


def peak_memory() -> float:
    """Peak resident memory in bytes since `reset_peak`."""
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) * 1024
    except OSError:
        pass
    unit = 1 if sys.platform == "darwin" else 1024
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * unit


def resident_memory() -> float:
    """Resident memory in bytes now (0 where the system does not say)."""
    try:
        return float(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0.0


def in_words(size: float) -> str:
    """A number of bytes as people write it."""
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"


def duration(seconds: float) -> str:
    """A time as people say it."""
    if seconds < 1:
        return f"{1000 * seconds:.0f} ms"
    if seconds < 90:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
