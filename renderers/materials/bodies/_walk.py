"""Loops of paths inside a body: flights and scatterings up to its boundary."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, mesh_scratch
from bakery.system.compiled import njit
from renderers.materials.bodies._geometry import clearance, first
from renderers.materials.bodies._shells import Shells, jump, largest
from renderers.transport.scattering import flight, flown, left, turned, wavelength
from renderers.transport.wavefront import goes_on, uniform

# how far a path has come: to a surface; to an event that waits for a light sample; it has ended; it goes on
CONTACT, EVENT, DEAD, ON = range(4)


class Walk(NamedTuple):
    """What loops through bodies read and change of n `Paths`."""

    origin: np.ndarray
    direction: np.ndarray
    throughput: np.ndarray
    states: np.ndarray
    pixel: np.ndarray
    order: np.ndarray
    bounces: np.ndarray
    density: np.ndarray
    single: np.ndarray
    drawn: np.ndarray
    far: np.ndarray
    triangle: np.ndarray
    start: np.ndarray
    events: np.ndarray
    scattered: np.ndarray


class Limits(NamedTuple):
    """How a path goes through a body.

    shells : `Shells`, through which paths jump that have room for them
    most : events since the last surface, after which a path goes straight to the next, with what the medium leaves of it
    waits : whether a path stops at each event
    """

    shells: Shells
    most: int
    waits: bool


@njit(cache=True, nogil=True, error_model="numpy")
def advance(geometry, medium, limits, paths, status, begin, end):
    """Takes paths begin to end through a body, up to a surface: status (n,) becomes CONTACT, EVENT or DEAD.

    medium : `Scatterer`;  limits : `Limits`
    paths : `Walk`, `far` nan where not known; becomes the distance to the surface met
    """
    geometry, medium, limits, paths = lent(geometry), lent(medium), lent(limits), lent(paths)
    scratch, values = mesh_scratch(), np.empty(paths.throughput.shape[1])
    for i in range(begin, end):
        status[i] = ON
        while status[i] == ON:
            status[i] = step(geometry, medium, limits, paths, i, scratch, values)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def step(geometry, medium, limits, paths, i, scratch, values):
    """Takes path i to its next event, or to the surface ahead: CONTACT, EVENT, DEAD or ON.  values : (L,) numbers to work on"""
    straight, radii = paths.events[i] >= limits.most, limits.shells.radii
    at = largest(radii, len(radii), clearance(geometry, paths.origin, i)) if len(radii) > 0 and not straight else -1
    if at >= 0:
        jumped = jump(limits.shells, at, paths, i)
        _count(paths, i, jumped)
        # the event that drew the direction took no light sample
        paths.single[i] |= jumped > 0
        return ON if goes_on(paths.throughput, paths.states, paths.bounces, i) else DEAD
    t = np.inf if straight else flight(medium, paths.throughput, paths.states, i)
    # flights that end sooner than any triangle may be need no search among them
    if math.isnan(paths.far[i]) and not t < clearance(geometry, paths.origin, i):
        paths.triangle[i], paths.far[i] = first(geometry, paths.origin, paths.direction, i, paths.start[i], scratch)
    far = paths.far[i]
    if straight:
        left(medium, paths.throughput, i, far)
        return CONTACT if far < np.inf else DEAD
    if not math.isnan(far) and not t < far:
        flown(medium, paths.throughput, i, far, False)
        return CONTACT if far < np.inf else DEAD
    flown(medium, paths.throughput, i, t, True)
    for k in range(3):
        paths.origin[i, k] += t * paths.direction[i, k]
    _count(paths, i, 1)
    if limits.waits:
        return EVENT
    turned(medium, paths, i, values)
    paths.single[i] = True  # no light was sampled
    return ON if goes_on(paths.throughput, paths.states, paths.bounces, i) else DEAD


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _count(paths, i, events):
    """Counts events of path i, which is where no triangle is known ahead any more."""
    paths.start[i], paths.far[i] = -1, np.nan
    paths.events[i] += events
    paths.order[i] += events
    paths.bounces[i] += events
    paths.scattered[i] |= events > 0


@njit(cache=True, nogil=True, error_model="numpy")
def straight(medium, paths, begin, end):
    """Paths at the surface ahead, without an event on the way: what the medium leaves of their throughput."""
    medium, paths = lent(medium), lent(paths)
    for i in range(begin, end):
        left(medium, paths.throughput, i, paths.far[i])


@njit(cache=True, nogil=True, error_model="numpy")
def inside(medium, paths, begin, end):
    """Puts paths to an event before the surface ahead, and changes their throughput by how likely there is one."""
    medium, paths = lent(medium), lent(paths)
    weight, far, waves = paths.throughput, paths.far, paths.throughput.shape[1]
    for i in range(begin, end):
        chosen, total = wavelength(weight, paths.states, i)
        sigma = medium.sigma_t[chosen]
        t = min(-math.log1p(uniform(paths.states, i) * math.expm1(-sigma * far[i])) / sigma, far[i])
        density = 0.0
        for w in range(waves):
            sigma = medium.sigma_t[w]
            density += weight[i, w] * sigma * math.exp(-sigma * t) / -math.expm1(-sigma * far[i])
        for w in range(waves):
            sigma = medium.sigma_t[w]
            weight[i, w] *= sigma * math.exp(-sigma * t) * total / density if density > 0.0 else 0.0
        for k in range(3):
            paths.origin[i, k] += t * paths.direction[i, k]
        _count(paths, i, 1)
