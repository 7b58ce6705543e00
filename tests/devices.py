"""What Mitsuba's compiled variants run on here: the processor by LLVM, and a graphics card where there is one.

Tests of the code that runs on both take the argument `device` (`@on_each_device`) or a variant of `jit`.
"""

import pytest

from renderers.mitsuba import variants

_NAMES = variants.choose().names
CARD = any(name.startswith("cuda") for name in _NAMES)
needs_llvm = pytest.mark.skipif(not any(name.startswith("llvm") for name in _NAMES), reason="no LLVM that Dr.Jit can use")


def jit(suffix: str) -> list:
    """The compiled variants of this machine whose names end so (`ad_rgb`), as parameters of a test."""
    return [pytest.param(f"llvm_{suffix}", marks=needs_llvm)] + [f"cuda_{suffix}"] * CARD


on_each_device = pytest.mark.parametrize("device", [pytest.param("llvm", marks=needs_llvm)] + ["cuda"] * CARD)
