"""Light that comes to a particle from near where it is seen from: what hides the particle hides it from both.

Where different particles hide two ways the means over realisations of what gets through multiply, exp(-tau) exp(-tau').  A disc
that lies across both counts once: exp(-tau) exp(-tau') exp(integral of n A) gets through, where A is the area in which two discs
of a size overlap whose middles are as far apart as the ways are.  Of traced discs this comes by itself; light in the continuous
medium, and of splats that are hidden by chance, is multiplied by the last factor.  It is near 1 unless a lamp is beside the
camera: ways that part by an angle g overlap for a length of 2 r / g.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, mesh_scratch, relative_density
from bakery.system.compiled import njit
from renderers.materials.particles._transport import through_box
from renderers.threads import run

_LITTLE = 1e-3  # optical depth of both ways together below which nothing is computed
_DISTANCES, _QUANTILES = 128, 64
_NODE, _WEIGHT = np.polynomial.legendre.leggauss(8)
_NODE, _WEIGHT = (_NODE + 1) / 2, _WEIGHT / 2


class Overlap(NamedTuple):
    """Discs that lie across two ways.

    reach : m, distance of two ways from which on no disc lies across both
    shared : (L, D) 1/m, extinction that two ways share, by the root of their distance over `reach`, evenly from 0 to 1
    aside : (Q,) m, evenly spaced quantiles of how far from its middle a particle is met that scatters
    """

    reach: float
    shared: np.ndarray
    aside: np.ndarray


def overlap_of(density, extinction, scattering) -> Overlap:
    """Of classes of particles: density (K,) 1/m^3, extinction and scattering (L, K) m^2."""
    radius = np.sqrt(extinction / math.pi)
    reach = 2 * float(radius.max(initial=0.0))
    distance = reach * np.linspace(0, 1, _DISTANCES) ** 2
    apart = np.clip(distance / np.maximum(2 * radius[..., None], 1e-300), 0.0, 1.0)
    lens = 2 * radius[..., None] ** 2 * (np.arccos(apart) - apart * np.sqrt(1 - apart**2))
    weight, square = density * scattering.mean(axis=0), (radius**2).mean(axis=0)
    # quantiles: the share that is met nearer than each distance, of places even over discs
    near = np.linspace(0, reach / 2, 4 * _QUANTILES)
    share = (weight * np.minimum(near[:, None] ** 2 / np.maximum(square, 1e-300), 1.0)).sum(axis=1)
    aside = np.interp(np.linspace(0, 1, _QUANTILES), share / max(share[-1], 1e-300), near)
    return Overlap(reach, np.ascontiguousarray(np.einsum("k,lkd->ld", density, lens)), aside)


def factors(medium, eye, seen, towards, distance, aside):
    """By which light is to be multiplied that reaches what is seen from a place, where means of both ways are taken, (n, L).

    medium : `renderers.materials.particles.medium.Medium`
    eye : (3,) m;  seen : (n, 3) m, where pencils from there end
    towards, distance : (n, 3) unit, (n,) m, of the light, from the middle of what it reaches
    aside : (n, 3) m, of that middle from `seen`
    """
    factor = np.ones((len(seen), len(medium.sigma_t)))
    back = eye - seen
    length = np.sqrt((back**2).sum(axis=1))
    angle = np.sqrt(((back / np.maximum(length, 1e-300)[:, None] - towards) ** 2).sum(axis=1))
    longest = np.minimum(np.minimum(length, distance), 3 * medium.overlap.reach / np.maximum(angle, 1e-300))
    near = np.flatnonzero(medium.sigma_t.max(initial=0.0) * medium.others * longest > _LITTLE)
    if len(near):
        computed = np.ones((len(near), factor.shape[1]))
        haze = medium.discs.region, medium.overlap, medium.others
        run(_factors, len(near), haze, np.asarray(eye, float), seen[near], seen[near] + aside[near],
            np.ascontiguousarray(towards[near], float), np.asarray(distance[near], float), computed)
        factor[near] = computed
    return factor


def of_continuum(medium, eye, seen, towards, distance, numbers):
    """`factors` of places where the continuous medium scatters: each stands for a particle that is met somewhere on its disc,
    which numbers (n, 2), uniform, decide; towards and distance are from `seen`."""
    back = eye - seen
    back /= np.maximum(np.sqrt((back**2).sum(axis=1)), 1e-300)[:, None]
    steep = np.where(np.abs(back[:, :1]) < 0.5, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(back, steep)
    across /= np.sqrt((across**2).sum(axis=1))[:, None]
    turn = 2 * math.pi * numbers[:, 1:]
    far = np.interp(numbers[:, 0], np.linspace(0, 1, len(medium.overlap.aside)), medium.overlap.aside)
    aside = far[:, None] * (np.cos(turn) * across + np.sin(turn) * np.cross(back, across))
    # the light reaches the middle of the particle
    towards = distance[:, None] * towards - aside
    distance = np.sqrt((towards**2).sum(axis=1))
    return factors(medium, eye, seen, towards / distance[:, None], distance, aside)


@njit(cache=True, nogil=True, error_model="numpy")
def _factors(haze, eye, seen, middle, towards, distance, factor, begin, end):
    """haze : region, overlap and others of a `renderers.materials.particles.medium.Medium`"""
    region, overlap, others = lent(haze)
    scratch, depth = mesh_scratch(), np.empty(factor.shape[1])
    for i in range(begin, end):
        _shared_depth(region, overlap, (eye, seen[i], middle[i], towards[i], distance[i]), depth, scratch)
        for w in range(factor.shape[1]):
            factor[i, w] = math.exp(others * depth[w])


@njit(cache=True, nogil=True, error_model="numpy")
def _shared_depth(region, overlap, ways, depth, scratch):
    """Integral of n A, (L,), along a way from `middle` to a light and another from `seen` to the eye."""
    eye, seen, middle, towards, distance = ways
    depth[:] = 0.0
    square, product, growth, length = 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        length += (eye[axis] - seen[axis]) ** 2
    length = math.sqrt(length)
    for axis in range(3):
        apart, parting = seen[axis] - middle[axis], (eye[axis] - seen[axis]) / length - towards[axis]
        square += apart * apart
        product += apart * parting
        growth += parting * parting
    # squared distance of the two ways: square + 2 product s + growth s^2
    ray = middle[0], middle[1], middle[2], towards[0], towards[1], towards[2]
    begin, end = through_box(region, ray, 0.0, min(length, distance))
    reach, nearest = overlap.reach, begin
    if growth > 0:
        nearest = -product / growth
        half = reach * reach - square + product * product / growth
        half = math.sqrt(half / growth) if half > 0 else 0.0
        begin, end = max(begin, nearest - half), min(end, nearest + half)
    if not begin < end or growth <= 0 and square >= reach * reach:
        return
    nearest = min(max(nearest, begin), end)
    last = overlap.shared.shape[1] - 1
    for limit in (begin, end):
        # nodes closer together where the ways are
        for node in range(len(_NODE)):
            s = nearest + (limit - nearest) * _NODE[node] ** 2
            weight = abs(limit - nearest) * 2 * _NODE[node] * _WEIGHT[node]
            if region.kind != 0:
                weight *= relative_density(region, middle[0] + s * towards[0], middle[1] + s * towards[1],
                                           middle[2] + s * towards[2], scratch)
            away = math.sqrt(max(square + 2 * product * s + growth * s * s, 0.0))
            position = math.sqrt(min(away / reach, 1.0)) * last
            low = min(int(position), last - 1)
            for w in range(len(depth)):
                at, after = overlap.shared[w, low], overlap.shared[w, low + 1]
                depth[w] += weight * (at + (position - low) * (after - at))
