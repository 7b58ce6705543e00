"""Loops of `tally`: photons that are followed and sorted, means of the phase function over bins, sums folded into lobes."""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.lent import lent
from bakery.physics.medium.kernels import phase_sample, phase_value, turned_direction
from bakery.physics.multiple.frame import CORE
from bakery.physics.multiple.kinds import POINT
from bakery.system.compiled import njit

BOXES = 64  # of u = arsinh(r / CORE) up to the extent
_LOW, _HIGH = 0.25, 4.0  # of the weight that belongs to a distance
_STACK = 256  # photons of one history that wait
_CLOSE = 1.0  # mfp: flights that stay farther from the source get no second point


class Boxes(NamedTuple):
    """Sums (N, B, B, M) and (N, B) of N boxes of distance; edges of the bins of direction, 1 - cos; where boxes end (mfp),
    and the decay of light (1/mfp)."""

    edges: np.ndarray
    extent: float
    k0: float
    sums: np.ndarray
    marginal: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def means(v_nodes, steps, f, angles, edges, turns, wide_edges, out):
    M, J, B = out.shape
    out[:] = 0.0
    ring = np.empty(turns)
    cosines = np.empty((M, turns))
    for i in range(turns):
        for m in range(M):
            cosines[m, i] = math.cos(m * math.pi * (i + 0.5) / turns)
    for b in range(B):
        # finer than the phase function turns
        parts = 4 + int((edges[b + 1] - edges[b]) / wide_edges)
        top, bottom = math.cos(edges[b]), math.cos(edges[b + 1])
        for part in range(parts):
            c = top + (bottom - top) * (part + 0.5) / parts
            s = math.sqrt(max(1 - c * c, 0.0))
            for j in range(J):
                cj, sj = math.cos(angles[j]), math.sin(angles[j])
                for i in range(turns):
                    v = min(max(1 - c * cj - s * sj * cosines[1, i] if M > 1
                                else 1 - c * cj - s * sj * math.cos(math.pi * (i + 0.5) / turns), 0.0), 2.0)
                    ring[i] = phase_value(v_nodes, steps, f, v)
                for m in range(M):
                    total = 0.0
                    row = cosines[m]
                    for i in range(turns):
                        total += ring[i] * row[i]
                    out[m, j, b] += total / (turns * parts)


@njit(cache=True, nogil=True, error_model="numpy")
def fold(sums, first, last, turns, out):
    """out (J, A, C) += turns (M, C) first (M, J, B) sums (M, B, B) last (M, A, B)."""
    M, J, B = first.shape
    A, C = out.shape[1], out.shape[2]
    of = np.empty(B)
    for m in range(M):
        for j in range(J):
            of[:] = 0.0
            for b in range(B):
                share = first[m, j, b]
                row = sums[m, b]
                for d in range(B):
                    of[d] += share * row[d]
            for a in range(A):
                total = 0.0
                row = last[m, a]
                for d in range(B):
                    total += of[d] * row[d]
                for c in range(C):
                    out[j, a, c] += total * turns[m, c]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _add(px, py, pz, ux, uy, uz, weight, spread, boxes):
    """Add light that arrives at p along u; spread : boxes an arsinh of distance."""
    edges, k0, sums, marginal = boxes.edges, boxes.k0, boxes.sums, boxes.marginal
    r = math.sqrt(px * px + py * py + pz * pz)
    s = r / CORE[POINT]
    s = math.log(s + math.sqrt(s * s + 1)) * spread
    if not s < len(marginal) - 0.5 or r <= 0:
        return
    box = int(s + 0.5)
    # over r^2 times the width of the box, which is half as wide at the source
    weight *= math.exp(k0 * r) * spread / (r * math.sqrt(r * r + CORE[POINT] ** 2))
    if box == 0:
        weight *= 2
    if len(edges) == 2:
        sums[box, 0, 0, 0] += weight
        marginal[box, 0] += weight
        return
    mu = min(max(pz / r, -1.0), 1.0)
    nu = min(max((px * ux + py * uy + pz * uz) / r, -1.0), 1.0)
    b = min(max(np.searchsorted(edges, 1 - mu, side="right") - 1, 0), len(edges) - 2)
    d = min(max(np.searchsorted(edges, 1 - nu, side="right") - 1, 0), len(edges) - 2)
    square = (1 - mu * mu) * (1 - nu * nu)
    turn = min(max((uz - mu * nu) / math.sqrt(square), -1.0), 1.0) if square > 1e-28 else 1.0
    marginal[box, b] += weight
    row = sums[box, b, d]
    before, now = turn, 1.0
    for m in range(len(row)):
        row[m] += weight * now
        before, now = now, 2 * turn * now - before


@njit(nogil=True, error_model="numpy", forceinline=True)
def _from_rim(stream, nx, ny, nz, rim, g):
    """Where light diffuses back to the rim from a point towards n, rim / g from the source, and its direction.

    Places have the density of Poisson's kernel, directions inwards that of the cosine.
    """
    x = (1 - g * g) / (1 - g + 2 * g * stream.random())
    qx, qy, qz = turned_direction(nx, ny, nz, min(max((2 * g - 1 - g * g + x * x) / (2 * g), 0.0), 2.0),
                                  2 * math.pi * stream.random())
    ux, uy, uz = turned_direction(-qx, -qy, -qz, 1 - math.sqrt(stream.random()), 2 * math.pi * stream.random())
    return rim * qx, rim * qy, rim * qz, ux, uy, uz


@njit(nogil=True, error_model="numpy", forceinline=True)
def _split(waiting, count, wanted, photon):
    """A photon in several of about the wanted weight: the weight of each, and how many wait when the others do."""
    copies = min(int(photon[6] / wanted), _STACK - count + 1)
    photon[6] /= copies
    for _copy in range(copies - 1):
        waiting[count] = photon
        count += 1
    return photon[6], count


@njit(cache=True, nogil=True, error_model="numpy")
def follow(stream, photons, albedo, table, boxes, rim, reached):
    """Every path starts along +z after its first event; flights after the second event arrive where they count.

    table : from `phase_layout`;  rim : beyond twice that far light comes back from it;  reached : see there
    """
    v_nodes, steps, f, cdf = table
    boxes, k0, extent = lent(boxes), boxes.k0, boxes.extent
    spread = BOXES / math.asinh(extent / CORE[POINT])
    waiting = np.empty((_STACK, 8))
    flights = 0
    for _ in range(photons):
        waiting[0] = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1 / albedo, 1.0])  # 1 after the second
        count = 1
        while count > 0:
            count -= 1
            px, py, pz, ux, uy, uz, weight, event = waiting[count]
            while True:
                flights += 1
                square = px * px + py * py + pz * pz
                ahead = -(px * ux + py * uy + pz * uz)  # to the point closest to the source
                close = math.sqrt(max(square - ahead * ahead, 1e-24))
                # a flight that counts and comes close: a second point, by the angle seen from the source
                twice = event > 1 and (close if ahead > 0 else math.sqrt(square)) < _CLOSE
                start = math.atan2(-ahead, close)
                span = math.pi / 2 - start
                if twice:
                    t = ahead + close * math.tan(start + span * stream.random())
                    if t > 0:
                        density = close / (span * (close * close + (t - ahead) ** 2))
                        decayed = math.exp(-t)
                        _add(px + t * ux, py + t * uy, pz + t * uz, ux, uy, uz, weight * decayed / (decayed + density),
                             spread, boxes)
                t = -math.log1p(-stream.random())
                px, py, pz = px + t * ux, py + t * uy, pz + t * uz
                if event > 1:
                    share = 1.0
                    if twice:
                        decayed = math.exp(-t)
                        share = decayed / (decayed + close / (span * (close * close + (t - ahead) ** 2)))
                    _add(px, py, pz, ux, uy, uz, weight * share, spread, boxes)
                event = 2.0
                r = math.sqrt(px * px + py * py + pz * pz)
                if r > 2 * rim:
                    weight *= reached / r * math.exp(-k0 * (r - reached))
                    px, py, pz, ux, uy, uz = _from_rim(stream, px / r, py / r, pz / r, rim, rim / r)
                    r = rim
                else:
                    weight *= albedo
                    v = phase_sample(v_nodes, steps, f, cdf, stream.random())
                    ux, uy, uz = turned_direction(ux, uy, uz, v, 2 * math.pi * stream.random())
                if weight <= 0:
                    break
                wanted = (1 + r) ** 2 * math.exp(-k0 * r if r < extent else -k0 * (2 * extent - r))
                if weight < _LOW * wanted:
                    if stream.random() * wanted >= weight:
                        break
                    weight = wanted
                elif weight > _HIGH * wanted and count < _STACK:
                    weight, count = _split(waiting, count, wanted, np.array([px, py, pz, ux, uy, uz, weight, event]))
    return flights
