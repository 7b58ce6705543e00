"""Steps that all wavefronts share: what paths meet at surfaces of the scene, roulette, sums of light.

Paths are any record with the fields that `renderers.transport.paths.Paths` and others have in common: origin, direction,
throughput, states, pixel, order, bounces, density, single.
"""

import numpy as np

from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.paths import Colours


class Sums:
    """Light that a pass has brought, linear sRGB.

    by_order : (ORDERS, pixels, 3);  by_light : (lights, pixels, 3)
    """

    def __init__(self, pixels, lights):
        self.by_order, self.by_light = np.zeros((wavefront.ORDERS, pixels, 3)), np.zeros((lights, pixels, 3))

    def add(self, paths, light, added):
        """What paths bring, added (n, 3), from lights (n,)."""
        wavefront.accumulate(added, paths.order, light, paths.pixel, self.by_order, self.by_light)


def met(world, paths, *drawn, columns=6):
    """What paths meet at surfaces, a `renderers.mitsuba.world.Shading`, and numbers (n, columns) of which that has used five.

    drawn : (n, 3) m, where their directions were drawn, if not at their origins
    """
    numbers = np.empty((paths.count, columns))
    wavefront.draw(paths.states, numbers)
    return world.shade(paths.origin, paths.direction, numbers, paths.density, paths.single, *drawn), numbers


def add_light(colours, throughput, order, radiance, light, paths, sums):
    """Adds radiance (n, 3) that paths have met of lights (n,); throughput (n, L), order (n,) : below 0 it does not count."""
    added = np.empty((paths.count, 3))
    wavefront.emitted(_alone(colours), throughput, order, radiance, added)
    sums.add(paths, light, added)


def reflected(colours, paths, shading, hit):
    """Turns paths, those of hit (n,), at the surfaces that they have met."""
    run(wavefront.reflect, paths.count, _alone(colours), paths.throughput, shading.weight[hit])
    paths.origin[:], paths.direction[:] = shading.origin[hit], shading.direction[hit]
    paths.density[:], paths.single[:] = shading.density[hit], shading.delta[hit]


def _alone(colours) -> Colours:
    """Colours without what else a record has: kernels are compiled for each type of record, and the longer the more it has."""
    return Colours(colours.to_rgb, colours.to_waves)


def survivors(paths):
    """Paths that roulette leaves."""
    alive = np.empty(paths.count, bool)
    run(wavefront.roulette, paths.count, paths.throughput, paths.states, paths.bounces, alive)
    return paths.of(alive)


def thinned(paths, most):
    """Without some of the paths of more bounces than `most`, as `renderers.transport.loop.roulette`."""
    far = np.flatnonzero(paths.bounces > most)
    if not len(far):
        return paths
    numbers, states, goes = np.empty((len(far), 1)), paths.states[far], np.ones(paths.count, bool)
    wavefront.draw(states, numbers)
    paths.states[far] = states
    chance = 1 - 1 / paths.bounces[far]
    paths.throughput[far] /= chance[:, None]
    goes[far] = numbers[:, 0] < chance
    return paths.of(goes)
