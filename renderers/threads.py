"""Kernels over ranges of paths or particles, on all processors; and of Dr.Jit's threads as many as work is worth."""

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache

_BLOCK = 4096
_FEW = 4096  # rays that one thread of Dr.Jit's follows as soon as more would
_WORK = 1 << 17  # numbers a thread, some microseconds' work
_AWAKE, _TRIES = 0.01, 5  # s, within which all threads have had their work; how often that is tried


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
    running = [_pool().submit(kernel, *arguments, *job) for job in jobs]
    try:
        for done in running:
            done.result()
    finally:
        for job in running:
            job.cancel()  # what has not begun when one fails, or all are interrupted


def one_of_drjit() -> None:
    """Ends all threads of Dr.Jit's but the one that calls, where that is safe.

    A thread that falls asleep in the very moment when it is told to end is not woken, and the call waits for it for ever
    (nanothread as in Dr.Jit 1.5).  They do so after 20 ms without work, so all of them are given some right before.  Where that
    takes long, on a busy machine, the first may be about to sleep when the last is done: then they stay.
    """
    import drjit as dr

    if (threads := dr.thread_count()) > 1 and (not dr.has_backend(dr.JitBackend.LLVM) or _awake(dr, threads)):
        dr.set_thread_count(1)


def _awake(dr, threads) -> bool:
    """Whether all threads had work a moment ago."""
    for _ in range(_TRIES):
        begin = time.perf_counter()
        dr.eval(dr.arange(dr.llvm.UInt32, threads * _WORK))
        dr.sync_thread()
        if time.perf_counter() - begin < _AWAKE:
            return True
    return False


@contextmanager
def of_drjit() -> Iterator[Callable[[int], None]]:
    """Gives a function that is told how many rays come next: Dr.Jit has one thread for few, and before and after it those it had.

    Its threads wait for work by asking for it again and again: where thousands of short calls follow each other that was two
    fifths of the processor time of a picture, on two processors.
    """
    import drjit as dr

    threads = dr.thread_count()

    def expect(rays: int):
        if rays < _FEW:
            one_of_drjit()
        elif dr.thread_count() != threads:
            dr.set_thread_count(threads)

    try:
        yield expect
    finally:
        expect(_FEW)
