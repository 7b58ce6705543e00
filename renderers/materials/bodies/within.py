"""Light that begins inside of bodies: of lamps that stand in them."""

from __future__ import annotations

import numpy as np

from bakery.kernels import stream_key
from renderers.materials.bodies import _geometry, transport
from renderers.materials.bodies.paths import Paths
from renderers.transport import wavefront


def emitted(setup, rays, number, seed) -> list[tuple[Paths, np.ndarray]]:
    """Paths on which lamps send light in bodies, and their power (n, L), W; of each lamp that reaches into one.

    setup : `transport.Transport`;  rays : of each lamp
    number, seed : of the pass: its random numbers
    """
    beams, waves = [], len(setup.colours.to_waves)
    boxes = [np.array([body.vertices.min(axis=0), body.vertices.max(axis=0)]) for body in setup.bodies]
    for light in setup.world.lights_in(boxes):
        states, numbers = np.empty(rays, np.uint64), np.empty((rays, 5))
        wavefront.begin_streams(stream_key(seed, "render.lamps", number), light * rays, states)
        wavefront.draw(states, numbers)
        origin, direction, power = setup.world.light_rays(light, numbers)
        paths = Paths.begun(origin + setup.off * direction, direction, np.ones((rays, waves)), states, np.arange(rays))
        inside = transport.located(setup.geometry, paths) != _geometry.OUTSIDE
        beams.append((paths.of(inside), (power @ setup.colours.to_waves.T)[inside] / rays))
    return beams
