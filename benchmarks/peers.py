"""Timing of several programs in turn, so that a busy machine slows all of them alike."""

import time
from statistics import median


def interleaved(jobs, rounds=5):
    """Median seconds of each job {name: function}, one call each in turn, after one call to warm up."""
    for job in jobs.values():
        job()
    seconds = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            seconds[name].append(time.perf_counter() - start)
    return {name: median(values) for name, values in seconds.items()}


def processor_seconds(jobs, rounds=5):
    """Least processor seconds of each job, all its threads together: what a shared machine can still measure.

    Jobs take turns; a turn is up to five calls, as many as take less than 50 ms.
    """
    for job in jobs.values():
        job()
    least = dict.fromkeys(jobs, float("inf"))
    for _ in range(rounds):
        for name, job in jobs.items():
            turn = time.process_time()
            for _ in range(5):
                start = time.process_time()
                job()
                end = time.process_time()
                least[name] = min(least[name], end - start)
                if end - turn > 0.05:
                    break
    return least


def optional(name):
    """A peer's module, or None with a word about how to get it."""
    try:
        return __import__(name)
    except ImportError as error:
        print(f"{name} is not here ({error}): pip install -r benchmarks/requirements.txt; its rows are left out")
        return None
