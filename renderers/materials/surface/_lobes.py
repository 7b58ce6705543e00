"""Lobes of a baked layer inside compiled loops: values, and directions drawn by the cells of `renderers.mitsuba.layers`.

What `renderers.mitsuba.layer_samples` does in Dr.Jit, of layers without a boundary that let nothing through.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, surface_reflectance
from bakery.system.compiled import njit
from renderers.transport.wavefront import to_rgb, uniform

_LEAST = 1e-6  # cosine, below which directions count as grazing


class Lobes(NamedTuple):
    """How a layer sends light on.

    table : `asset.surface.table()`'s
    below_mu, below_phi, density : as of `renderers.mitsuba.layers.Cells`, reflected light alone
    square : (C + 1,) squares of the cosines at the sides of cells;  phi : (C + 1,) rad
    """

    table: tuple
    below_mu: np.ndarray
    below_phi: np.ndarray
    density: np.ndarray
    square: np.ndarray
    phi: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _cell(mu, count):
    """Of a cosine, `renderers.mitsuba.layers.cosine`'s inverse."""
    return min(int((1.0 - math.sqrt(max(1.0 - math.sqrt(mu), 0.0))) * count), count - 1)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _drawn(below, u):
    """Cell of a number in a cumulative table (C + 1,), C a power of two, and its share of it."""
    cell, half = 0, (len(below) - 1) >> 1
    while half:
        if below[cell + half] <= u:
            cell += half
        half >>= 1
    return cell, min(max((u - below[cell]) / max(below[cell + 1] - below[cell], 1e-300), 0.0), 1.0)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _density(lobes, mu0, mu, cos_phi):
    """1/sr over the cosine mu, with which a direction is drawn."""
    count, half = len(lobes.phi) - 1, 0.5 * min(max(cos_phi, -1.0), 1.0)
    turn = 0.5 * (1.0 + math.sqrt(0.5 - half) - math.sqrt(0.5 + half))
    return lobes.density[_cell(mu0, count), _cell(mu, count), min(int(turn * count), count - 1)]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _along(d, n, ahead):
    """Cosine of the direction that a ray along d (3,) comes from; ahead (3,) becomes its unit part along the surface."""
    down = d[0] * n[0] + d[1] * n[1] + d[2] * n[2]
    for k in range(3):
        ahead[k] = d[k] - down * n[k]
    across = math.sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1] + ahead[2] * ahead[2])
    if across < 1e-9:  # any will do
        x, y, z = abs(n[0]), abs(n[1]), abs(n[2])
        axis = 0 if x <= y and x <= z else 1 if y <= z else 2
        for k in range(3):
            ahead[k] = (1.0 if k == axis else 0.0) - n[axis] * n[k]
        across = math.sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1] + ahead[2] * ahead[2])
    for k in range(3):
        ahead[k] /= across
    return min(max(-down, _LEAST), 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def next_event(lobes, colours, walk, normal, sample, passed, added, begin, end):
    """What light samples send by way of a surface: added (n, 3) linear sRGB.

    walk : any record with direction (n, 3) and throughput (n, L);  normal : (n, 3) outward
    sample : `renderers.mitsuba.shading.LightSample`;  passed : (n, L) share of its light that gets there
    """
    lobes, walk, sample = lent(lobes), lent(walk), lent(sample)
    radiance, towards, table = sample.radiance, sample.direction, lobes.table
    ahead, values = np.empty(3), np.empty(walk.throughput.shape[1])
    for i in range(begin, end):
        added[i] = 0.0
        x, y, z, n = towards[i, 0], towards[i, 1], towards[i, 2], normal[i]
        mu = x * n[0] + y * n[1] + z * n[2]
        if mu <= 0.0 or not (radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0):
            continue
        mu, mu0 = min(max(mu, _LEAST), 1.0), _along(walk.direction[i], n, ahead)
        sine = math.sqrt(max(1.0 - mu * mu, 0.0))
        cos_phi = (x * ahead[0] + y * ahead[1] + z * ahead[2]) / sine if sine > 1e-9 else 0.0
        cos_phi = min(max(cos_phi, -1.0), 1.0)
        share = mu / math.pi
        if not sample.delta[i]:
            share *= sample.density[i] / (sample.density[i] + _density(lobes, mu0, mu, cos_phi) * mu)
        for w in range(len(values)):
            value = surface_reflectance(table, w, mu, mu0, cos_phi) if passed[i, w] > 0.0 else 0.0
            values[w] = walk.throughput[i, w] * passed[i, w] * share * value
        to_rgb(colours, values, radiance[i], added[i])


@njit(cache=True, nogil=True, error_model="numpy")
def scatter(lobes, walk, normal, begin, end):
    """Turns paths at a surface: directions, densities and throughputs of `walk`, whose `states` are random streams."""
    lobes, walk = lent(lobes), lent(walk)
    ahead, count = np.empty(3), len(lobes.phi) - 1
    for i in range(begin, end):
        n, d = normal[i], walk.direction[i]
        mu0 = _along(d, n, ahead)
        row = _cell(mu0, count)
        j, share = _drawn(lobes.below_mu[row], uniform(walk.states, i))
        square = lobes.square[j] + share * (lobes.square[j + 1] - lobes.square[j])
        k, share = _drawn(lobes.below_phi[row, j], uniform(walk.states, i))
        phi = lobes.phi[k] + share * (lobes.phi[k + 1] - lobes.phi[k])
        cos_phi, sine_phi = math.cos(phi), math.sin(phi) if uniform(walk.states, i) < 0.5 else -math.sin(phi)
        mu, sine = max(math.sqrt(max(square, 0.0)), _LEAST), math.sqrt(max(1.0 - square, 0.0))
        over = lobes.density[row, j, k]
        for w in range(walk.throughput.shape[1]):
            walk.throughput[i, w] *= surface_reflectance(lobes.table, w, mu, mu0, cos_phi) / (math.pi * over)
        ax, ay, az = ahead
        bx, by, bz = n[1] * az - n[2] * ay, n[2] * ax - n[0] * az, n[0] * ay - n[1] * ax
        d[0] = sine * (cos_phi * ax + sine_phi * bx) + mu * n[0]
        d[1] = sine * (cos_phi * ay + sine_phi * by) + mu * n[1]
        d[2] = sine * (cos_phi * az + sine_phi * bz) + mu * n[2]
        walk.density[i], walk.single[i] = over * mu, False
