"""A smooth boundary between air and the medium: where light is refracted to, and how much of it is reflected."""

import math

import numpy as np


def inside(mu, index):
    """Cosine in the medium of light with cosine mu in air; 0 where it is totally reflected (index below 1).

    mu : any shape, 0 to 1
    index : refractive index of the medium over that of the air, or one for each mu
    """
    mu = np.asarray(mu, float)
    if np.all(index == 1):
        return mu.copy()
    return np.sqrt(np.maximum((index - 1) * (index + 1) + mu * mu, 0.0)) / index


def outside(mu, index):
    """Cosine in air of light with cosine mu in the medium; 0 where it is totally reflected (index above 1)."""
    return inside(mu, 1 / index)


def critical(index):
    """Cosines in the medium at and below which light is totally reflected: 0 for an index up to 1."""
    return math.sqrt(max(1 - 1 / index**2, 0.0))


def reflected(mu, index):
    """Unpolarised share of light from air that the boundary reflects, like mu.

    The same share is reflected from inside, for the direction that this one is refracted to.
    """
    mu = np.asarray(mu, float)
    if np.all(index == 1):
        return np.zeros_like(mu)
    within = inside(mu, index)
    # grazing light on an index below 1 has both cosines 0
    across = np.divide(mu - index * within, mu + index * within, out=np.zeros_like(mu), where=mu + index * within > 0)
    along = np.divide(index * mu - within, index * mu + within, out=np.zeros_like(mu), where=index * mu + within > 0)
    return 0.5 * (across**2 + along**2)


def between(index, mu, index_below, mu_below):
    """The same of two media, from their indices over that of the air and the cosines on both sides."""
    if index == index_below:
        return np.zeros_like(mu)
    across = (index * mu - index_below * mu_below) / (index * mu + index_below * mu_below)
    along = (index_below * mu - index * mu_below) / (index_below * mu + index * mu_below)
    return 0.5 * (across**2 + along**2)
