"""Threads of the matrix library.

On matrices of a hundred rows threads of OpenBLAS gain nothing and wait for each other in loops: on a busy machine two took nine
times as long as one.  They may also change the last bits.  A bake has threads of its own, whose blocks need one each.
"""

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from threading import Lock

_ASKED = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")  # a user who sets these decides
_lock, _bakes, _before = Lock(), 0, []


@contextmanager
def one_thread() -> Iterator[None]:
    """One thread of the OpenBLAS that NumPy and SciPy bring along, until the last of those who ask for it is done.

    Nothing changes where the environment names a number, or where NumPy is built with another library.
    """
    global _bakes, _before
    with _lock:
        if not _bakes:
            _before = [] if any(map(os.environ.get, _ASKED)) else [(put, get()) for get, put in _libraries()]
            for put, _ in _before:
                put(1)
        _bakes += 1
    try:
        yield
    finally:
        with _lock:
            _bakes -= 1
            if not _bakes:
                for put, count in _before:
                    put(count)


def threads() -> list[int]:
    """Of NumPy's and SciPy's OpenBLAS, as set now."""
    return [get() for get, _ in _libraries()]


@cache
def _libraries() -> list[tuple]:
    """How many threads each OpenBLAS has, and how to set it.  SciPy's is loaded, lest it comes later with threads of its own."""
    calls = []
    for package in ("numpy", "scipy"):
        home = Path(find_spec(package).origin).parent
        files = [*home.parent.glob(f"{package}.libs/*openblas*"), *home.glob(".dylibs/*openblas*")]
        for file, (prefix, suffix) in product(files, product(("scipy_", ""), ("64_", ""))):
            library = ctypes.CDLL(str(file))
            if hasattr(library, f"{prefix}openblas_set_num_threads{suffix}"):
                calls.append(tuple(getattr(library, f"{prefix}openblas_{act}_num_threads{suffix}") for act in ("get", "set")))
    return calls
