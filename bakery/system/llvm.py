"""The LLVM library that Dr.Jit, below Mitsuba, compiles with: where it is looked for, and which versions will do.

Dr.Jit picks its library once, when it is imported; it refuses versions up to 14, and accepts 15 and 16, which abort the process
at the first `dr.minimum` of a kernel.  So the choice is made by number, before anything is compiled.
"""

import os
import sys
from pathlib import Path

MINIMUM = 19  # the oldest version that was tried and works; 17 and 18 were not tried and count as too old
# from a checkout: there is no distribution of ours on the index, and `bakery` there is somebody else's
INSTALL = 'pip install ".[mitsuba,llvm]" in the folder of bakery\'s sources'


def find() -> str | None:
    """Point Dr.Jit to the libLLVM of this Python environment; its path, or None where there is none.

    Does nothing where the user has set DRJIT_LIBLLVM_PATH, and comes too late once drjit is imported.
    """
    if "DRJIT_LIBLLVM_PATH" in os.environ:
        return os.environ["DRJIT_LIBLLVM_PATH"]
    name = {"win32": "LLVM-C.dll", "darwin": "libLLVM.dylib"}.get(sys.platform, "libLLVM.so")
    path = Path(sys.prefix, "lib", name)
    if "drjit" in sys.modules or not path.exists():
        return None
    os.environ["DRJIT_LIBLLVM_PATH"] = str(path)
    return str(path)


def fault(version: tuple[int, ...]) -> str | None:
    """Why the LLVM of this version, from `drjit.detail.llvm_version()`, cannot be used; None where it can."""
    if version[0] < 0:
        return f"no usable LLVM was found; get one by: {INSTALL}"
    if version[0] < MINIMUM:
        return (f"LLVM {'.'.join(map(str, version))} is older than {MINIMUM} (15 and 16 abort the process, 17 and 18 are untried)"
                f"; get one that works by: {INSTALL}")
    return None
