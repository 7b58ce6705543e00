"""Loops of light that walks in a body, and of what it leaves behind at its events."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, mesh_scratch
from bakery.system.compiled import njit
from renderers.materials.bodies._beams import DEEP
from renderers.materials.bodies._geometry import clearance, first
from renderers.materials.bodies._light import MORE, OUTSIDE, OVER, SURFACE, at_boundary
from renderers.materials.bodies._walk import CONTACT, DEAD, step
from renderers.transport.scattering import turned
from renderers.transport.wavefront import goes_on, uniform

EVENTS = 8  # of a walk in one call, at most


class Record(NamedTuple):
    """Events of walks.

    at : (n, EVENTS, 11) place, direction before, direction after, flight (m) from the event before, inf from a surface, and
        length (m) of the way after up to a surface, nan where no beam begins
    before : (n, EVENTS) events before, -1: none
    arrived, turned : (n, EVENTS, L) weights before and after
    status : (n,) as of `_light.Ends`
    """

    at: np.ndarray
    before: np.ndarray
    arrived: np.ndarray
    turned: np.ndarray
    status: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def walk(geometry, medium, boundary, limits, near, paths, record, begin, end):
    """Takes walks begin to end on by up to `EVENTS` events, and notes them.

    medium : `Scatterer`;  boundary : `_light.Boundary`;  limits : `_walk.Limits`, of walks that wait at each event
    near : mean free paths from all surfaces, beyond which some events stand for all
    paths : `_walk.Walk`, `pixel` 1 where beams begin at their events;  record : `Record`, whose arrays are filled
    """
    geometry, medium, limits, paths, record = lent(geometry), lent(medium), lent(limits), lent(paths), lent(record)
    scratch, values = mesh_scratch(), np.empty(paths.throughput.shape[1])
    for i in range(begin, end):
        record.status[i] = MORE
        for m in range(EVENTS):
            record.before[i, m] = -1
        for m in range(EVENTS):
            for k in range(3):
                record.at[i, m, k] = paths.origin[i, k]
            status = step(geometry, medium, limits, paths, i, scratch, values)
            if status == CONTACT:
                if boundary.index == 0.0 or geometry.owner[paths.triangle[i]] != boundary.number:
                    record.status[i] = SURFACE
                    break
                back = at_boundary(geometry, boundary.index, paths, i)
                paths.triangle[i], paths.far[i] = -1, np.nan
                if not back:
                    record.status[i] = OUTSIDE
                    break
                if not goes_on(paths.throughput, paths.states, paths.bounces, i):
                    record.status[i] = OVER
                    break
                continue
            if status == DEAD:
                record.status[i] = OVER
                break
            _note(geometry, medium, paths, i, m, record, near, scratch, values)
            if not goes_on(paths.throughput, paths.states, paths.bounces, i):
                record.status[i] = OVER
                break


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _note(geometry, medium, paths, i, m, record, near, scratch, values):
    """Notes the event that path i has come to, and turns it there."""
    clear, sigma = clearance(geometry, paths.origin, i), np.min(medium.sigma_t)
    # light from there to a surface is less than the square of this, and lines of sight begin at surfaces
    chance = math.exp(min(0.5 * (near - sigma * clear), 0.0))
    noted = chance >= 1.0 or uniform(paths.states, i) < chance
    row, square = record.at[i, m], 0.0
    if noted:
        record.before[i, m] = paths.order[i] - 1
        for k in range(3):
            square += (paths.origin[i, k] - row[k]) ** 2
            row[k], row[3 + k] = paths.origin[i, k], paths.direction[i, k]
        row[9] = math.sqrt(square) if paths.events[i] > 1 else np.inf
        for w in range(len(values)):
            record.arrived[i, m, w] = paths.throughput[i, w] / chance
    turned(medium, paths, i, values)
    row[10] = np.nan
    if noted and paths.pixel[i] == 1:
        row[10] = clear
        if not sigma * clear > DEEP:
            paths.triangle[i], paths.far[i] = first(geometry, paths.origin, paths.direction, i, np.int64(-1), scratch)
            row[10] = paths.far[i]
        for k in range(3):
            row[6 + k] = paths.direction[i, k]
        for w in range(len(values)):
            record.turned[i, m, w] = paths.throughput[i, w] / chance
