"""Loops of paths inside a body: flights and scatterings up to its boundary."""

from __future__ import annotations

import math

import numpy as np

from bakery.kernels import lent, mesh_scratch
from bakery.system.compiled import njit
from renderers.materials.bodies._geometry import clearance, first
from renderers.materials.bodies._shells import jump, largest
from renderers.transport.scattering import flight, flown, left, mean_phase, scattered
from renderers.transport.wavefront import roulette, to_rgb, uniform

CONTACT, EVENT, DEAD = range(3)  # how far a path has come: to a surface; to an event that waits for a light sample; it has ended


@njit(cache=True, nogil=True, error_model="numpy")
def advance(geometry, medium, shells, most, waits, origin, direction, weight, states, far, triangle, start, drawn, density,
            single, events, bounces, status, alive, begin, end):
    """Takes paths begin to end through a body, up to a surface.

    Parameters
    ----------
    medium : `Scatterer`;  shells : `_shells.Shells`, through which paths jump that have room for them
    most : events since the last surface, after which a path goes straight to the next, with what the medium leaves of it
    waits : whether a path stops at each event
    origin, direction : (n, 3) m, unit; become those of the last flight
    weight : (n, L);  states : (n,) random streams
    far, triangle : (n,) distance (m) and place of the triangle ahead, far nan where not known; become those of the surface met
    start : (n,) becomes -1 where a path has scattered: it starts on no triangle any more
    drawn, density : (n, 3) m, (n,) 1/sr, where directions were drawn, and how likely
    single : (n,) bool, whether light samples cannot take the place of the direction
    events, bounces : (n,) since the last surface, and altogether
    status : (n,) becomes CONTACT, EVENT or DEAD
    alive : (n,) bool, room
    """
    geometry, medium, shells = lent(geometry), lent(medium), lent(shells)
    scratch, values, radii = mesh_scratch(), np.empty(weight.shape[1]), len(shells.radii)
    for i in range(begin, end):
        status[i] = -1
        while status[i] < 0:
            straight = events[i] >= most
            at = largest(shells.radii, radii, clearance(geometry, origin, i)) if radii > 0 and not straight else -1
            if at >= 0:
                jumped = jump(shells, at, origin, direction, weight, states, i)
                start[i], far[i] = -1, np.nan
                events[i] += jumped
                bounces[i] += jumped
                # the event that drew the direction took no light sample
                single[i] |= jumped > 0
                roulette(weight, states, bounces, alive, i, i + 1)
                if not alive[i]:
                    status[i] = DEAD
                    break
                continue
            t = np.inf if straight else flight(medium, weight, states, i)
            # flights that end sooner than any triangle may be need no search among them
            if math.isnan(far[i]) and not t < clearance(geometry, origin, i):
                triangle[i], far[i] = first(geometry, origin, direction, i, start[i], scratch)
            if straight:
                left(medium, weight, i, far[i])
                status[i] = CONTACT if far[i] < np.inf else DEAD
                break
            if not math.isnan(far[i]) and not t < far[i]:
                flown(medium, weight, i, far[i], False)
                status[i] = CONTACT if far[i] < np.inf else DEAD
                break
            flown(medium, weight, i, t, True)
            for k in range(3):
                origin[i, k] += t * direction[i, k]
            events[i] += 1
            bounces[i] += 1
            start[i], far[i] = -1, np.nan
            if waits:
                status[i] = EVENT
                break
            turn(medium, origin, direction, weight, states, i, drawn, density, values)
            single[i] = True  # no light was sampled
            roulette(weight, states, bounces, alive, i, i + 1)
            if not alive[i]:
                status[i] = DEAD
                break


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def turn(medium, origin, direction, weight, states, i, drawn, density, values):
    direction[i, 0], direction[i, 1], direction[i, 2], density[i] = scattered(
        medium, 0, direction[i, 0], direction[i, 1], direction[i, 2], weight, states, i, values)
    for k in range(3):
        drawn[i, k] = origin[i, k]


@njit(cache=True, nogil=True, error_model="numpy")
def scatter(medium, origin, direction, weight, states, drawn, density, single, bounces, alive, begin, end):
    """Turns paths at their events; alive (n,) becomes whether they go on."""
    medium = lent(medium)
    values = np.empty(weight.shape[1])
    for i in range(begin, end):
        turn(medium, origin, direction, weight, states, i, drawn, density, values)
        single[i] = False
        roulette(weight, states, bounces, alive, i, i + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def lit(medium, colours, sigma, inside, seen, direction, weight, towards, radiance, sampled, delta, added, begin, end):
    """What light samples send by way of events: added (n, 3), linear sRGB.

    sigma : (bodies, L) 1/m;  inside : (n, bodies) m, in each body up to the light, inf where it is hidden;  seen : (n,) bool
    towards, radiance, sampled, delta : direction, radiance, density and delta of `LightSample`
    """
    medium = lent(medium)
    waves = weight.shape[1]
    values, share = np.empty(waves), np.empty(waves)
    for i in range(begin, end):
        added[i] = 0.0
        if not seen[i] or not (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
            continue
        cosine = 0.0
        for k in range(3):
            cosine += direction[i, k] * towards[i, k]
        mean = mean_phase(medium, 0, weight, i, min(max(1 - cosine, 0.0), 2.0), values)
        weighted = 1.0 if delta[i] else sampled[i] / (sampled[i] + mean)
        for w in range(waves):
            deep = 0.0
            for body in range(len(sigma)):
                if inside[i, body] > 0.0:
                    deep += sigma[body, w] * inside[i, body]
            share[w] = weight[i, w] * medium.albedo[w] * values[w] * weighted * math.exp(-deep)
        to_rgb(colours, share, radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def straight(medium, weight, far, begin, end):
    """Weights (n, L) after ways of lengths far (n,) m without an event."""
    medium = lent(medium)
    for i in range(begin, end):
        left(medium, weight, i, far[i])


@njit(cache=True, nogil=True, error_model="numpy")
def inside(medium, origin, direction, weight, states, start, events, order, bounces, far, begin, end):
    """Puts paths to an event before lengths far (n,) m, and changes their weights by how likely there is one."""
    medium = lent(medium)
    waves = weight.shape[1]
    for i in range(begin, end):
        total = 0.0
        for w in range(waves):
            total += weight[i, w]
        chosen, wavelength = uniform(states, i) * total, waves - 1
        for w in range(waves):
            chosen -= weight[i, w]
            if chosen < 0.0:
                wavelength = w
                break
        sigma = medium.sigma_t[wavelength]
        t = min(-math.log1p(uniform(states, i) * math.expm1(-sigma * far[i])) / sigma, far[i])
        density = 0.0
        for w in range(waves):
            sigma = medium.sigma_t[w]
            density += weight[i, w] * sigma * math.exp(-sigma * t) / -math.expm1(-sigma * far[i])
        for w in range(waves):
            sigma = medium.sigma_t[w]
            weight[i, w] *= sigma * math.exp(-sigma * t) * total / density if density > 0.0 else 0.0
        for k in range(3):
            origin[i, k] += t * direction[i, k]
        start[i] = -1
        events[i] += 1
        order[i] += 1
        bounces[i] += 1
