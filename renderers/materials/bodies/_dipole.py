"""The directional dipole, and its sums over places where light comes in."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent, mesh_scratch, triangle_normal
from bakery.system.compiled import njit
from renderers.materials.bodies._geometry import first
from renderers.transport.wavefront import uniform

_BACK = 1e-4  # of the size of all bodies, from where a ray looks back at the boundary
_EVEN = 0.1  # share of the beams that is drawn by their power alone


class Dipole(NamedTuple):
    """Diffusion in a body, each (L,).

    d : m, diffusion coefficient;  decay : 1/m, effective transport coefficient;  sigma_t : 1/m
    beyond : m, from the boundary to the mirror in which virtual sources are
    end : m, extrapolation length of a boundary that reflects nothing
    c_phi, c_e : of the exitance by fluence and by flux
    exit : 1/sr, radiance inside, as lines of sight see it through the boundary, over exitance
    """

    d: np.ndarray
    decay: np.ndarray
    sigma_t: np.ndarray
    beyond: np.ndarray
    end: np.ndarray
    c_phi: np.ndarray
    c_e: np.ndarray
    exit: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _exitance(dipole, w, xw, xn, wn, r):
    """Exitance (1/m^2) of a source of unit power at distance r; products of the way x from it, its direction and the normal."""
    d, s = dipole.d[w], dipole.decay[w] * r
    flux = (1 + s + 3 * d * (3 * (1 + s) + s * s) / (r * r) * xw) * xn - 3 * d * (1 + s) * wn
    return math.exp(-s) / (4 * math.pi * r**3) * (dipole.c_phi[w] * (r * r / d + 3 * (1 + s) * xw) + dipole.c_e[w] * flux)


@njit(cache=True, nogil=True, error_model="numpy")
def dipole_exitance(dipole, w, x, ni, entering, no, soft):
    """Exitance (1/m^2) at a place x (3,) m from where light of unit power comes in along `entering` (3,), unit.

    ni, no : (3,) outward normals there and here;  soft : m, by which distances count as larger

    Never below 0, as in all implementations of it.  Source: Frisvad, Hachisuka and Kjeldsen, Directional dipole model for
    subsurface scattering, ACM Trans. Graph. 34 (2014).
    """
    square = xw = xn = wn = along = 0.0
    for k in range(3):
        square += x[k] * x[k]
        xw += x[k] * entering[k]
        xn += x[k] * no[k]
        wn += entering[k] * no[k]
        along += x[k] * ni[k]
    # the mirror contains the way from source to place: cross(x, cross(ni, x)), unit
    across = math.sqrt(max(square - along * along, 0.0)) * math.sqrt(square)
    m0, m1, m2 = ni[0], ni[1], ni[2]
    if across > 1e-12 * square:
        m0, m1, m2 = (square * m0 - along * x[0]) / across, (square * m1 - along * x[1]) / across, (
            square * m2 - along * x[2]) / across
    wm = entering[0] * m0 + entering[1] * m1 + entering[2] * m2
    mn, xm = no[0] * m0 + no[1] * m1 + no[2] * m2, x[0] * m0 + x[1] * m1 + x[2] * m2
    d, end, height = dipole.d[w], dipole.end[w], 2 * dipole.beyond[w]
    if wn < 0.0:
        slant = math.sqrt(max(square - xw * xw, 0.0) / (square + end * end))
        real = square - d * wn * (-d * wn + 2 * end * slant)
    else:
        real = square + 1 / (3 * dipole.sigma_t[w]) ** 2
    virtual = square - 2 * height * xm + height * height
    exitance = _exitance(dipole, w, xw, xn, wn, math.sqrt(real + soft * soft)) - _exitance(
        dipole, w, xw - 2 * wm * xm - height * (wm - 2 * wm), xn - height * mn, wn - 2 * wm * mn,
        math.sqrt(virtual + soft * soft))
    return max(exitance, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def boundary_normals(geometry, origin, direction, normal, begin, end):
    """Outward normals (n, 3) of the boundary where rays, origin (n, 3) m, direction (n, 3), have come into a body."""
    geometry = lent(geometry)
    p, d, scratch = np.empty((1, 3)), np.empty((1, 3)), mesh_scratch()
    for i in range(begin, end):
        for k in range(3):
            p[0, k], d[0, k] = origin[i, k] + _BACK * geometry.scale * direction[i, k], -direction[i, k]
        triangle, _ = first(geometry, p, d, 0, np.int64(-1), scratch)
        normal[i, 0], normal[i, 1], normal[i, 2] = triangle_normal(geometry.blocks, triangle) if triangle >= 0 else (
            d[0, 0], d[0, 1], d[0, 2])


@njit(cache=True, nogil=True, error_model="numpy")
def gather(dipole, origin, direction, power, normal, picks, around, here, facing, states, brought, begin, end):
    """Radiance inside of a body, against lines of sight where they come into it, of groups begin to end.

    origin, direction, normal : (N, 3) m, unit, outward, of light that comes in;  power : (N, L) W
    picks : drawn for each line of sight
    around : (G + 1,) where groups begin;  here, facing : (n, 3) m, outward, where lines of sight come in
    states : (n,) uint64, random numbers;  brought : (n, L) becomes W/m^2 sr
    """
    n, waves = power.shape
    total, whole_power = np.empty(n), 0.0
    middle, mean, x = np.empty(3), np.empty(3), np.empty(3)
    for b in range(n):
        for w in range(waves):
            whole_power += power[b, w]
    for g in range(begin, end):
        many, spread = around[g + 1] - around[g], 0.0
        for k in range(3):
            middle[k], mean[k] = 0.0, 0.0
            for i in range(around[g], around[g + 1]):
                middle[k] += here[i, k] / many
                mean[k] += facing[i, k] / many
            for i in range(around[g], around[g + 1]):
                spread += (here[i, k] - middle[k]) ** 2 / many
        whole = 0.0
        for b in range(n):
            for k in range(3):
                x[k] = middle[k] - origin[b, k]
            for w in range(waves):
                whole += power[b, w] * dipole_exitance(dipole, w, x, normal[b], direction[b], mean, math.sqrt(spread))
            total[b] = whole
        even, before = _EVEN * whole / whole_power, 0.0
        for b in range(n):
            for w in range(waves):
                before += power[b, w]
            total[b] += even * before
        for i in range(around[g], around[g + 1]):
            for w in range(waves):
                brought[i, w] = 0.0
            if not whole > 0.0:
                continue
            for pick in range(picks):
                u = (pick + uniform(states, i)) / picks * total[n - 1]
                b = min(np.searchsorted(total, u, side="right"), n - 1)
                chance = (total[b] - (total[b - 1] if b > 0 else 0.0)) / total[n - 1] * picks
                for k in range(3):
                    x[k] = here[i, k] - origin[b, k]
                for w in range(waves):
                    brought[i, w] += power[b, w] * dipole.exit[w] / chance * dipole_exitance(
                        dipole, w, x, normal[b], direction[b], facing[i], 0.0)
