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
# benchmarks/plans.py --compiling, three quarters of what it says where two cores have ten to twenty processes; `discrete` and
# `simplify` were measured earlier, and are taken to have shrunk as the others since
SECONDS = {
    "beam.photons": 0.88, "beam.single": 0.52, "beam.table": 0.56, "beam.transport": 1.7,
    "discrete._places": 0.28, "discrete.region": 2.0,
    "goa._asymptotic": 0.92, "goa._edge": 2.9, "goa._field": 2.9, "goa._rays": 3.1, "goa._solve": 0.61, "goa._special": 0.58,
    "goa._surface": 0.63,
    "granular._goniometer": 3.8, "granular._packed": 2.9, "shapes._triangles": 1.7, "grains._walk": 5.2, "grains.balls": 3.1,
    "grains.bvh": 2.7,
    "grains.grid": 1.5, "grains.points": 0.34, "grains.scatterometer": 0.41, "shapes.simplify": 3.4, "grains.sphere": 2.6,
    "grains.surface": 0.47,
    "mie.angular": 1.4, "mie.coated": 3.7, "mie.coefficients": 2.1,
    "multiple._kernels": 2.6, "multiple._plane": 3.8, "multiple._products": 4.3, "multiple._tally": 5.6, "multiple.basis": 0.42,
    "multiple.locate": 0.37, "multiple.legendre": 0.39, "multiple.lookup": 0.23, "multiple.sums": 0.83, "multiple.point": 1.0,
    "packing.cells": 1.0, "packing._chords": 0.99, "packing._events": 2.1, "packing._lists": 1.5, "packing._queue": 0.5,
    "packing.instances": 0.16,
    "surfaces._spread": 1.1, "surfaces.orders": 0.3,
}


def expected(modules: Iterable[str]) -> float:
    """Seconds that compiling is going to take of kernels in `modules` (`mie.angular`), 0 where this machine has them all."""
    return sum(SECONDS[module] for module in missing(modules))


def missing(modules: Iterable[str]) -> list[str]:
    """Those of some modules of whose kernels this machine has none compiled."""
    physics = Path(bakery.__file__).parent / "physics"
    return [module for module in modules if not sources.kept(physics / (module.replace(".", "/") + ".py"), "*")]


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
