"""Statistics of balls, in closed form or by walks."""

import numpy as np

from bakery.physics.grains.balls import BallWalker
from bakery.physics.grains.scatterometer import EDGES, Statistics, measure
from bakery.physics.grains.sphere import Ball, ball
from bakery.physics.grains.surface import DIELECTRIC, Surface
from bakery.physics.grains.walk import EVENTS_MAX


def statistics(surface: Surface, mu=0.0, *, radius=1.0, edges=EDGES, events_max=EVENTS_MAX, **options) -> Ball | Statistics:
    """Statistics of a ball: in closed form where there is one, else by a walk with the `options` of `scatterometer.measure`.

    Closed forms: smooth opaque balls, smooth dielectric ones that fill the bounding sphere.
    """
    if surface.roughness == 0 and (surface.kind != DIELECTRIC or radius == 1):
        return ball(surface, mu, edges, radius)
    mu = np.atleast_1d(np.asarray(mu, float))
    mu = np.ascontiguousarray(np.broadcast_to(mu, max(mu.size, surface.channels.shape[1])))
    return measure(None, surface, mu, edges=edges, tracer=BallWalker(surface, mu, radius, events_max), **options)
