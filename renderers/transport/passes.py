"""Pictures by paths of the loop: its passes, as `renderers.progressive` takes them."""

from __future__ import annotations

from functools import cache, partial

import drjit as dr
import numpy as np

from bakery.kernels import stream_key
from renderers.progressive import Part
from renderers.transport import loop
from renderers.transport.scene import Scene
from renderers.wavefront import ORDERS

LAYERS = ("order0", "order1", "order2", "orders")
_PATHS = 1 << 20  # of a pass, at most, where a pixel has several: one to three seconds of a core
_SAMPLES = 16  # a pixel and pass, at most: the noise of small pictures is known from several passes
_TOGETHER = 4  # paths of a lane, one after the other: a sixth faster than one


def part(name, world, bodies, colours, around_camera, seed) -> Part:
    """Passes of paths; parameters but for the name and the seed are those of `Scene`."""
    height, width = world.size
    samples = 1 << max(0, min(_SAMPLES, _PATHS // (height * width)).bit_length() - 1)
    scene = cache(lambda: Scene(world, bodies, colours, around_camera))  # with the first pass
    return Part(name, partial(_rendered, scene, (height, width), samples, seed), samples)


def _rendered(scene, size, samples, seed, number):
    """Layers of a pass."""
    word, together = int(stream_key(seed, "render.paths", number)), min(samples, _TOGETHER)
    sums = loop.trace(scene(), (word & 0xFFFFFFFF, word >> 32), size[0] * size[1], samples // together, together)
    dr.eval(sums)  # all of them by one kernel
    light = np.array([np.asarray(channel) for channel in sums]).reshape(ORDERS, 3, *size, -1)
    by_order = np.moveaxis(light.sum(axis=-1, dtype=float) / samples, 1, -1)
    return {"": by_order.sum(axis=0)} | dict(zip(LAYERS, by_order))
