"""What the machine has, and what an address limit (`ulimit -v`) leaves of it."""

import os
import sys
from pathlib import Path

try:
    import resource
except ImportError:  # Windows: no such limits
    resource = None

# Bytes of address space that a library takes while it loads and works, and more for each thread of its BLAS beyond the first.
# Measured: numpy 85 MB and 40 a thread, scipy the same again, llvmlite with kernels compiled 420 MB, Mitsuba 230 MB
TAKEN = {"numpy": (100e6, 40e6), "scipy": (100e6, 40e6), "matplotlib": (80e6, 0.0), "llvmlite": (580e6, 0.0),
         "mitsuba": (480e6, 0.0)}
# what libraries say where there is no more
_SAID = ("failed to map segment", "cannot allocate memory", "can't start new thread", "could not find/load shared object file")


def free_memory() -> float | None:
    """Bytes that a new allocation can have, or None where the system does not say."""
    address_space = address_space_left()
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                available = float(line.split()[1]) * 1024
                return available if address_space is None else min(available, address_space)
    except OSError:
        pass
    return address_space


def give_back() -> None:
    """Hand freed memory back to the system, where its C library keeps some (glibc: 30 MB after a bake of 500 wavelengths)."""
    import ctypes

    try:
        ctypes.CDLL(None).malloc_trim(0)
    except (AttributeError, OSError, TypeError):  # another library, or Windows
        pass


def address_space_left() -> float | None:
    """Bytes that a limit of the process leaves; None where there is none."""
    limit = resource.RLIM_INFINITY if resource is None else resource.getrlimit(resource.RLIMIT_AS)[0]
    if resource is None or limit == resource.RLIM_INFINITY:
        return None
    try:
        return limit - float(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return float(limit)


def exhausted(error: BaseException) -> bool:
    """Whether an error is what a library makes of too little memory."""
    return isinstance(error, MemoryError) or any(words in str(error).lower() for words in _SAID)


class _Refuse:
    """Stands before Python's finders of modules."""

    def find_spec(self, name, path=None, target=None):
        if name in TAKEN:
            base, per_thread = TAKEN[name]
            needed, available = base + per_thread * (_threads() - 1), address_space_left()
            if available < needed:
                raise MemoryError(f"{name} takes {needed / 1e6:.0f} MB of address space, {available / 1e6:.0f} MB are left "
                                  "of the limit (ulimit -v)")


def _threads() -> int:
    """Of OpenBLAS."""
    asked = [os.environ.get(name, "") for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")]
    return next((int(text) for text in asked if text.isdecimal() and 0 < int(text) < 1024), os.cpu_count() or 1)


def refuse_what_does_not_fit() -> None:
    """Where there is an address limit, make the import of a library that does not fit a MemoryError.

    By themselves such libraries end the process, or loop for ever, in C: OpenBLAS, LLVM and Mitsuba were seen to.
    """
    if address_space_left() is not None:
        sys.meta_path.insert(0, _Refuse())
