"""The directional dipole, and its sums over places where light comes in."""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import lent
from bakery.system.compiled import njit
from renderers.transport.wavefront import uniform

TOGETHER = 64  # lines of sight, near each other, that draw places by one guess
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
def gather(dipole, beams, normal, picks, lines, facing, brought, begin, end):
    """Radiance inside of a body, against lines of sight where they come into it, of groups begin to end.

    beams : `Beams`, of light that comes in;  normal : (N, 3) outward, there
    picks : drawn for each line of sight
    lines : `_walk.Walk`, `TOGETHER` of them a group, near each other;  facing : (n, 3) outward, where they come in
    brought : (n, L) becomes W/m^2 sr
    """
    dipole, beams, lines = lent(dipole), lent(beams), lent(lines)
    n, waves = beams.power.shape
    total, whole_power, x = np.empty(n), 0.0, np.empty(3)
    for b in range(n):
        for w in range(waves):
            whole_power += beams.power[b, w]
    for g in range(begin, end):
        first, last = g * TOGETHER, min((g + 1) * TOGETHER, lines.far.size)
        whole = _guess(dipole, beams, normal, lines, facing, (first, last), total)
        even, before = _EVEN * whole / whole_power, 0.0
        for b in range(n):
            for w in range(waves):
                before += beams.power[b, w]
            total[b] += even * before
        for i in range(first, last):
            for w in range(waves):
                brought[i, w] = 0.0
            if not whole > 0.0:
                continue
            for pick in range(picks):
                u = (pick + uniform(lines.states, i)) / picks * total[n - 1]
                b = min(np.searchsorted(total, u, side="right"), n - 1)
                chance = (total[b] - (total[b - 1] if b > 0 else 0.0)) / total[n - 1] * picks
                for k in range(3):
                    x[k] = lines.origin[i, k] - beams.origin[b, k]
                for w in range(waves):
                    brought[i, w] += beams.power[b, w] * dipole.exit[w] / chance * dipole_exitance(
                        dipole, w, x, normal[b], beams.direction[b], facing[i], 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _guess(dipole, beams, normal, lines, facing, group, total):
    """Makes total (N,) what beams send to the middle of a group (first, last) of lines of sight, cumulated; all of it."""
    n, waves = beams.power.shape
    middle, mean, x = np.zeros(3), np.zeros(3), np.empty(3)
    many, spread, whole = group[1] - group[0], 0.0, 0.0
    for k in range(3):
        for i in range(group[0], group[1]):
            middle[k] += lines.origin[i, k] / many
            mean[k] += facing[i, k] / many
        for i in range(group[0], group[1]):
            spread += (lines.origin[i, k] - middle[k]) ** 2 / many
    for b in range(n):
        for k in range(3):
            x[k] = middle[k] - beams.origin[b, k]
        for w in range(waves):
            whole += beams.power[b, w] * dipole_exitance(dipole, w, x, normal[b], beams.direction[b], mean, math.sqrt(spread))
        total[b] = whole
    return whole
