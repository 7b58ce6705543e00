"""Kernels over ranges of paths or particles, on all processors."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache

_BLOCK = 4096


@cache
def _pool():
    return ThreadPoolExecutor(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


def run(kernel, n, *arguments, block=_BLOCK):
    """`kernel(*arguments, begin, end)` for ranges that make up 0 to n, of at most `block`; the kernel releases the interpreter's
    lock.

    Ranges do not depend on the number of processors, and each writes to places of its own.
    """
    jobs = [(begin, min(begin + block, n)) for begin in range(0, n, block)]
    if len(jobs) <= 1:
        for job in jobs:
            kernel(*arguments, *job)
        return
    for done in [_pool().submit(kernel, *arguments, *job) for job in jobs]:
        done.result()
