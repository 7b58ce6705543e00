"""Which variant of Mitsuba this machine can run.  LLVM decides: `bakery.system.llvm`."""

import functools
import importlib.util
import subprocess
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

from bakery.errors import BakeryError, UsageError
from bakery.system.llvm import INSTALL, MINIMUM

# colour -> (what follows cuda_ad_ and llvm_ad_, the scalar twin); there is no scalar_mono, grey goes through scalar_rgb.
_NAMES = {"mono": ("mono", "scalar_rgb"), "rgb": ("rgb", "scalar_rgb"), "spectral": ("spectral", "scalar_spectral"),
          "spectral_polarized": ("spectral_polarized", "scalar_spectral_polarized")}


SEVERAL_SCENES = ("a graphics card traces rays through one scene at a time, and bodies that touch or whose mesh is turned inward,"
                  " and media in a mesh, need several")


class SeveralScenes(UsageError):
    """What a graphics card cannot render."""


class MissingMitsuba(BakeryError, ImportError):
    """The extra `mitsuba` is not installed."""


class Choice(NamedTuple):
    """`names`, best first, go to `mitsuba.set_variant(*names)`; `reason` says in words why."""

    names: tuple[str, ...]
    reason: str


def on_gpu(variant: str) -> bool:
    """Whether a variant runs on a graphics card."""
    return variant.startswith("cuda")


def clock(variant: str) -> Callable[[], float]:
    """Seconds that a variant's work takes: of all processors, or, where these wait for a graphics card, of the clock."""
    return time.monotonic if on_gpu(variant) else time.process_time


def require_mitsuba() -> None:
    """Raises MissingMitsuba, naming the extra, where Mitsuba cannot be imported."""
    if importlib.util.find_spec("mitsuba") is None:
        raise MissingMitsuba(f"Mitsuba 3 is not installed, which renders pictures; get it by: {INSTALL}")


def decide(cuda: bool, llvm: tuple[int, ...], colour: str = "mono") -> Choice:
    """The choice for a machine whose CUDA works or not and whose LLVM has this version ((-1, -1, -1): none usable)."""
    if colour not in _NAMES:
        raise UsageError(f"variants: colour {colour!r}; expected one of {', '.join(_NAMES)}")
    suffix, scalar = _NAMES[colour]
    names, reason = [scalar], ""
    version = ".".join(map(str, llvm))
    if llvm[0] >= MINIMUM:
        names.insert(0, f"llvm_ad_{suffix}")
        reason = f"LLVM {version} works"
    elif llvm[0] < 0:
        reason = ("no usable LLVM (15 or newer) was found, so the scalar variant is used, in which `bakedphase` is slow; "
                  f"get one by: {INSTALL}")
    else:
        reason = (f"LLVM {version} is older than {MINIMUM} (15 and 16 abort while rendering, 17 and 18 are untried), "
                  f"so the scalar variant is used, in which `bakedphase` is slow; get one that works by: {INSTALL}")
    if cuda:
        names.insert(0, f"cuda_ad_{suffix}")
        reason = "a CUDA device works"
    return Choice(tuple(names), reason)


def choose(colour: str = "mono") -> Choice:
    """The best variants of this machine, for `mono`, `rgb`, `spectral` or `spectral_polarized`; never raises, never aborts."""
    import drjit as dr

    return decide(_cuda_works(), tuple(dr.detail.llvm_version()), colour)


def activate(colour: str = "mono", variant: str | None = None) -> tuple[str, str]:
    """Sets the best variant, or the one that the user names, with UsageError where it does not exist or would not work here;
    returns its name and the reason."""
    import drjit as dr
    import mitsuba as mi

    choice = choose(colour)
    if variant is None:
        mi.set_variant(*choice.names)
        return mi.variant(), choice.reason
    if variant not in mi.variants():
        raise UsageError(f"variant {variant!r}: this Mitsuba has {', '.join(mi.variants())}")
    if variant.startswith("llvm") and not any(name.startswith("llvm") for name in choice.names):
        raise UsageError(f"variant {variant!r}: {decide(False, tuple(dr.detail.llvm_version()), colour).reason}")
    try:
        mi.set_variant(variant)
    except ImportError as error:
        raise UsageError(f"variant {variant!r} does not work on this machine: {error}; "
                         f"expected {', '.join(choice.names)}") from None
    return variant, "asked for"


_CUDA_TEST = """
import mitsuba as mi
mi.set_variant("cuda_ad_mono")
scene = mi.load_dict({"type": "scene", "shape": {"type": "sphere"}, "light": {"type": "constant"},
                      "integrator": {"type": "path"}, "sensor": {"type": "perspective", "film": {"type": "hdrfilm",
                      "width": 4, "height": 4}}})
import numpy
assert numpy.isfinite(numpy.array(mi.render(scene, spp=1))).all()
"""


@functools.cache
def _cuda_works() -> bool:
    """A driver can be there and OptiX not: renders 4 x 4 pixels in a child process, which may crash without harm."""
    import drjit as dr

    if not dr.has_backend(dr.JitBackend.CUDA):
        return False
    try:
        return subprocess.run([sys.executable, "-c", _CUDA_TEST], capture_output=True, timeout=120).returncode == 0
    except (OSError, subprocess.SubprocessError):
        return False
