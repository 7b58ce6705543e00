"""What the machine has."""

from __future__ import annotations

from pathlib import Path


def free_memory() -> float | None:
    """Bytes that a new allocation can have, or None where the system does not say."""
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return float(line.split()[1]) * 1024
    except OSError:
        pass
    return None
