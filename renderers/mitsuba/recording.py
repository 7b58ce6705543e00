"""What recordings of Dr.Jit's (`drjit.freeze`) need of Mitsuba's scenes."""

import gc
from contextlib import contextmanager

import mitsuba as mi


def pointers(scene) -> list:
    """A surface, what it does with light, and a light of a scene that has them: by their kinds, as inputs of a recording, Dr.Jit
    knows to look for all that there are, also in other scenes."""
    shapes = [shape for shape in scene.shapes() if shape.bsdf() is not None]
    kinds = (mi.ShapePtr(shapes[0]), mi.BSDFPtr(shapes[0].bsdf())) if shapes else ()
    return [*kinds, *map(mi.EmitterPtr, scene.emitters()[:1])]


@contextmanager
def undisturbed():
    """While Dr.Jit may record: a scene that Python's collector takes away meanwhile would end the process
    (`RecordThreadState::enqueue_host_func(): this function cannot be recorded`)."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()
