"""Compiling of kernels: what a machine has yet to compile, and for how long it does so while a stage runs.

A machine compiles a kernel when it meets it first, and keeps it on disk.  That may take longer than the work itself, so neither
the speed that is remembered nor the time that is left counts it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bakery
from bakery.system import sources

# seconds of one core of an Intel Xeon to compile the kernels of a module, those that it calls in others apart:
# benchmarks/plans.py --compiling, three quarters of what it says where two cores have ten processes
SECONDS = {
    "beam.photons": 1.3, "beam.single": 0.68, "beam.table": 0.83, "beam.transport": 2.0,
    "discrete._places": 0.5, "discrete.region": 3.7,
    "goa._asymptotic": 2.2, "goa._edge": 6.6, "goa._field": 5.8, "goa._rays": 10.0, "goa._solve": 1.7, "goa._special": 1.4,
    "goa._surface": 1.7,
    "granular._goniometer": 8.0, "granular._packed": 4.6, "shapes._triangles": 2.9, "grains._walk": 8.2, "grains.balls": 1.7,
    "grains.bvh": 6.4,
    "grains.grid": 1.9, "grains.points": 2.0, "grains.scatterometer": 0.42, "shapes.simplify": 6.1, "grains.sphere": 3.4,
    "grains.surface": 1.0,
    "mie.coated": 5.9, "mie.kernels": 8.2,
    "multiple._kernels": 2.4, "multiple._plane": 2.9, "multiple._tally": 4.5, "multiple.basis": 0.71, "multiple.locate": 0.21,
    "multiple.legendre": 0.33, "multiple.lookup": 0.4, "multiple.sums": 1.8, "multiple.point": 1.2,
    "packing.cells": 1.2, "packing._chords": 1.4, "packing._kernels": 9.8, "packing.instances": 0.33,
    "surfaces._spread": 2.4,
}


def expected(modules: Iterable[str]) -> float:
    """Seconds that compiling is going to take of kernels in `modules` (`mie.kernels`), 0 where this machine has them all."""
    return sum(SECONDS[module] for module in missing(modules))


def missing(modules: Iterable[str]) -> list[str]:
    """Those of some modules of whose kernels this machine has none compiled."""
    return [module for module in modules if not _compiled(module)]


def _compiled(module: str) -> bool:
    """Whether kernels of a module, as it and what it imports stand, were compiled on this machine."""
    return sources.kept(Path(bakery.__file__).parent / "physics" / (module.replace(".", "/") + ".py"), "*")


class Clock:
    """Seconds that went into compiling; `tell` is called when it begins and ends.

    numba compiles under a lock of the process: one kernel at a time, and within it those that it calls.
    """

    def __init__(self, tell: Callable[[bool], None]):
        self.seconds, self._tell, self._depth, self._began = 0.0, tell, 0, 0.0

    def begin(self) -> None:
        self._depth += 1
        if self._depth == 1:
            self._began = time.monotonic()
            self._tell(True)

    def end(self) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.monotonic() - self._began
            self._tell(False)


@contextmanager
def watched(modules: Iterable[str], tell: Callable[[bool], None]) -> Iterator[Clock]:
    """A clock of what is compiled inside of the `with`, in this process; `modules` are those whose kernels run there."""
    clock = Clock(tell)
    if not modules:
        yield clock  # nothing to see, and numba takes long to import
        return
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, _event):
            clock.begin()

        def on_end(self, _event):
            clock.end()

    with event.install_listener("numba:compile", Listener()):
        yield clock
