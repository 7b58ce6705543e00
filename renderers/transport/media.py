"""Flights and scatterings in homogeneous media for loops of Dr.Jit, with one throughput a wavelength.

As `renderers.transport.scattering`, whose arithmetic this is in single precision: a flight or a direction is drawn for one
wavelength, chosen by the throughput, and counted for all that might have been chosen (balance heuristic).
"""

import math
from functools import reduce

import drjit as dr
import numpy as np

from renderers.mitsuba.shading import single

import mitsuba as mi  # isort: skip

_PACKET = 4  # entries that one gather fetches together


class Media:
    """Tables of media, which arrays of their numbers look up.

    count : of wavelengths
    """

    def __init__(self, media, unit):
        """
        media : list of `renderers.transport.scattering.Scatterer` of the same wavelengths
        unit : m, length of 1 in the loop
        """
        self.count, nodes = len(media[0].sigma_t), max(len(medium.v) for medium in media)
        # a power of two: kernels of other assets are the same
        self._nodes = 1 << (nodes - 1).bit_length()
        self._sigma_t = _rows(np.array([medium.sigma_t for medium in media]) * unit)
        self._albedo = _rows(np.array([medium.albedo for medium in media]))
        # Behind the last node of shorter tables no number and no angle is found.
        self._v = _column(_padded(medium.v, self._nodes, 4.0) for medium in media)
        self._steps = _column(_padded(medium.steps, self._nodes, 1.0) for medium in media)
        self._cdf = _column(_padded(row, self._nodes, 2.0) for medium in media for row in medium.cdf)
        self._phase = _rows(np.concatenate([np.array([_padded(row, self._nodes, 0.0) for row in medium.phase]).T
                                            for medium in media]))

    def sigma_t(self, medium):
        """Extinction of each wavelength, a unit of length."""
        return self._row(self._sigma_t, medium)

    def albedo(self, medium):
        return self._row(self._albedo, medium)

    def phase(self, medium, v):
        """Phase functions (1/sr) of all wavelengths at angles of 1 - cos theta = v."""
        start = medium * self._nodes
        at = start + self._interval(self._v, start, v)
        share = dr.clip((v - dr.gather(mi.Float, self._v, at)) / dr.gather(mi.Float, self._steps, at), 0, 1)
        return [dr.lerp(a, b, share) for a, b in zip(self._row(self._phase, at), self._row(self._phase, at + 1))]

    def sample(self, medium, wavelength, u):
        """An angle, as v = 1 - cos theta, by the phase function of a wavelength, and all phase functions (1/sr) there."""
        start = medium * self._nodes
        row = (medium * self.count + wavelength) * self._nodes
        node = self._interval(self._cdf, row, u)
        below, at = dr.gather(mi.Float, self._cdf, row + node), start + node
        step = dr.gather(mi.Float, self._steps, at)
        first, last = self._row(self._phase, at), self._row(self._phase, at + 1)
        f, g = chosen(first, wavelength), chosen(last, wavelength)
        # the cumulative distribution is a quadratic between the nodes; its stable root
        c = dr.maximum(u - below, 0) / (2 * math.pi * step)
        root = f + dr.sqrt(dr.maximum(f * f + 2 * (g - f) * c, 0))
        share = dr.clip(dr.select(root > 0, 2 * c / root, 0), 0, 1)
        v = dr.minimum(dr.gather(mi.Float, self._v, at) + share * step, 2)
        return v, [dr.lerp(a, b, share) for a, b in zip(first, last)]

    def _interval(self, table, start, value):
        """Interval of a row of a table, ascending from `start`, in which a value lies."""
        above = dr.binary_search(1, self._nodes - 1, lambda index: dr.gather(mi.Float, table, start + index) <= value)
        return mi.UInt32(above) - 1

    def _row(self, table, index):
        packets = -(-self.count // _PACKET)
        vectors = [dr.gather(mi.Vector4f, table, index * packets + k) for k in range(packets)]
        return [vectors[w // _PACKET][w % _PACKET] for w in range(self.count)]


def flight(throughput, sigma_t, u, v):
    """Length of a flight, by two uniform numbers: u chooses a wavelength, v the length; inf where nothing ends it."""
    sigma = chosen(sigma_t, pick(throughput, u))
    return dr.select(sigma > 0, -dr.log(1 - v) / sigma, dr.inf)


def flown(throughput, sigma_t, distance, scatters, straight=False):
    """Throughput after flights of lengths `distance` that end with a scattering, where one `scatters`, or go on; for sure where
    they are `straight`."""
    passed = [dr.exp(-sigma * distance) * dr.select(scatters, sigma, 1) for sigma in sigma_t]
    density = dot(throughput, passed)
    scale = dr.select(straight, 1, dr.select(density > 0, total(throughput) / density, 0))
    return [weight * factor * scale for weight, factor in zip(throughput, passed)]


def chance(throughput, sigma_t, distance, scatters):
    """Density (1 over a length) of flights that end with a scattering, where one `scatters`, or the chance of going so far."""
    passed = [dr.exp(-sigma * distance) * dr.select(scatters, sigma, 1) for sigma in sigma_t]
    return mean(throughput, passed)


def scattered(media, medium, direction, throughput, u):
    """Directions after a scattering, their densities (1/sr), and the throughput; u : three uniform numbers."""
    weights = product(throughput, media.albedo(medium))
    v, values = media.sample(medium, pick(weights, u[0]), u[1])
    sine, cosine = dr.sincos(2 * math.pi * u[2])
    sine_theta = dr.sqrt(dr.maximum(v * (2 - v), 0))
    turned = mi.Frame3f(direction).to_world(mi.Vector3f(sine_theta * cosine, sine_theta * sine, 1 - v))
    density = mean(weights, values)
    scale = dr.select(density > 0, 1 / density, 0)
    return dr.normalize(turned), density, [weight * value * scale for weight, value in zip(weights, values)]


def mean(weights, values):
    """Mean of values (L,) by weights (L,); 0 where these are 0."""
    whole = total(weights)
    return dr.select(whole > 0, dot(weights, values) / whole, 0)


def pick(weights, u):
    """Number of one of several, drawn by its weight."""
    remaining, number = u * total(weights), mi.UInt32(0)
    for weight in weights[:-1]:
        remaining = remaining - weight
        number += dr.select(remaining >= 0, mi.UInt32(1), mi.UInt32(0))
    return number


def chosen(values, number):
    """One of several, by its number."""
    value = values[0]
    for k in range(1, len(values)):
        value = dr.select(number == k, values[k], value)
    return value


def product(a, b):
    return [x * y for x, y in zip(a, b)]


def dot(a, b):
    summed = a[0] * b[0]
    for x, y in zip(a[1:], b[1:]):
        summed = dr.fma(x, y, summed)
    return summed


def total(values):
    return sum(values[1:], values[0])


def largest(values):
    return reduce(dr.maximum, values)


def _padded(row, length, value):
    return np.concatenate([row, np.full(length - len(row), value)])


def _column(rows):
    return single(np.concatenate(list(rows)))


def _rows(table):
    """A table (n, L), each row in whole packets."""
    table = np.asarray(table)
    padded = np.zeros((len(table), -(-table.shape[1] // _PACKET) * _PACKET), np.float32)
    padded[:, :table.shape[1]] = table
    return single(padded.ravel())
