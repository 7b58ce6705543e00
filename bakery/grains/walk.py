"""One ray after another through the bounding sphere of a grain, until it leaves: `trace`.

This is the seam for other tracers: whatever fills `Paths` from entries and a seed can stand in for `Walker`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from bakery.grains.bvh import Mesh, nearest, normal, scratch
from bakery.grains.surface import DIELECTRIC, DIFFUSE, Surface, at_dielectric, disk, facet, fresnel_conductor, shadowing

MISSED, LEFT, ABSORBED, CONTRADICTED, CUT = range(5)
EVENTS_MAX = 100_000  # meetings with the surface after which a path is cut; what it carried is recorded as lost
_FAINT = 0.05  # weight below which a path goes on only by chance
_AHEAD = 1.0 / 128  # how far outside of the bounding sphere a ray starts: a grain may touch the sphere


@dataclass(frozen=True)
class Paths:
    """What became of n rays.

    Attributes
    ----------
    status : (n,) MISSED the grain, LEFT the sphere after a hit, ABSORBED (by the surface or by roulette), CONTRADICTED (inside
        where the surface says outside, or the reverse: a mesh that is not closed, or rounding), CUT after `EVENTS_MAX` hits
    start, leave : (n, 3) R, on the bounding sphere;  leave is undefined unless the ray missed or left
    incoming, outgoing : (n, 3) unit directions of travel
    inside : (n,) R, length of the way inside the grain
    weight : (n, C) 1, per channel; of a path that was cut, what it carried; 0 for ABSORBED and CONTRADICTED, 1 for MISSED
    events : (n,) meetings with the surface
    """

    status: np.ndarray
    start: np.ndarray
    leave: np.ndarray
    incoming: np.ndarray
    outgoing: np.ndarray
    inside: np.ndarray
    weight: np.ndarray
    events: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def philox(c0, c1, c2, c3, k0, k1):
    """Four random words of a counter and a key, all in 0 ... 2^32 - 1 (as uint64): Philox4x32-10 of Salmon et al. 2011."""
    low = np.uint64(0xFFFFFFFF)
    half = np.uint64(32)
    for _ in range(10):
        p0, p1 = np.uint64(0xD2511F53) * c0, np.uint64(0xCD9E8D57) * c2
        c0, c1, c2, c3 = (p1 >> half) ^ c1 ^ k0, p1 & low, (p0 >> half) ^ c3 ^ k1, p0 & low
        k0, k1 = (k0 + np.uint64(0x9E3779B9)) & low, (k1 + np.uint64(0xBB67AE85)) & low
    return c0, c1, c2, c3


@njit(cache=True, nogil=True, error_model="numpy")
def _uniform(stream, pool):
    """Next number in (0, 1) of the path's stream: (key, key, path, replicate, numbers drawn)."""
    at = stream[4] & np.uint64(3)
    if at == 0:
        a, b, c, d = philox(stream[2] & np.uint64(0xFFFFFFFF), stream[2] >> np.uint64(32), stream[3],
                            (stream[4] >> np.uint64(2)) & np.uint64(0xFFFFFFFF), stream[0], stream[1])
        pool[0], pool[1] = (a + 0.5) * 2.0**-32, (b + 0.5) * 2.0**-32
        pool[2], pool[3] = (c + 0.5) * 2.0**-32, (d + 0.5) * 2.0**-32
    stream[4] += np.uint64(1)
    return pool[at]


@njit(cache=True, nogil=True, error_model="numpy")
def _frame(x, y, z):
    """Two unit vectors that make a right-handed frame with (x, y, z) (Duff et al. 2017)."""
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return 1.0 + sign * x * x * a, sign * b, -sign * x, b, sign + y * y * a, -y


@njit(cache=True, nogil=True, error_model="numpy")
def _enter(u, start, incoming):
    """Isotropic uniform chord of the unit sphere from four uniform numbers; returns its half length."""
    z = 1.0 - 2.0 * u[0]
    across, phi = 2.0 * math.sqrt(u[0] * (1.0 - u[0])), 2.0 * math.pi * u[1]
    x, y = across * math.cos(phi), across * math.sin(phi)
    sx, sy, sz, tx, ty, tz = _frame(x, y, z)
    p, q = disk(u[2], u[3])
    half = math.sqrt(max(1.0 - p * p - q * q, 0.0))
    incoming[0], incoming[1], incoming[2] = x, y, z
    start[0] = p * sx + q * tx - half * x
    start[1] = p * sy + q * ty - half * y
    start[2] = p * sz + q * tz - half * z
    return half


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(nodes, children, blocks, kind, index, roughness, channels, mu, events_max, uniform, first, replicate, key0, key1,
          status, start, leave, incoming, outgoing, inside, weight, events):
    """Fill the records of `Paths` for the rays `uniform` (n, 4); path i draws from the stream (first + i, replicate)."""
    room, pool, stream = scratch(), np.empty(4), np.zeros(5, np.uint64)
    stream[0], stream[1], stream[3] = key0, key1, replicate
    number = weight.shape[1]
    carried, least = np.empty(number), np.min(mu)
    for i in range(len(uniform)):
        stream[2], stream[4] = np.uint64(first + i), np.uint64(0)
        half = _enter(uniform[i], start[i], incoming[i])
        dx, dy, dz = incoming[i]
        ox, oy, oz = start[i, 0] - _AHEAD * dx, start[i, 1] - _AHEAD * dy, start[i, 2] - _AHEAD * dz
        within, place, way, count, factor = False, -1, 0.0, 0, 1.0
        state = MISSED
        carried[:] = 1.0
        while True:
            place, t = nearest(nodes, children, blocks, ox, oy, oz, dx, dy, dz, place, room)
            if place < 0:
                if within:
                    state = CONTRADICTED
                elif count:
                    state = LEFT
                break
            ox, oy, oz = ox + t * dx, oy + t * dy, oz + t * dz
            nx, ny, nz = normal(blocks, place)
            z = -(dx * nx + dy * ny + dz * nz)
            if (z < 0.0) != within or z == 0.0:
                state = CONTRADICTED
                count += 1
                break
            if within:
                way += t
            if count == events_max:
                state = CUT
                break
            count += 1
            sx, sy, sz, tx, ty, tz = _frame(nx, ny, nz)
            x, y = -(dx * sx + dy * sy + dz * sz), -(dx * tx + dy * ty + dz * tz)
            if kind == DIELECTRIC:
                u, v, w = _uniform(stream, pool), 0.0, 0.0
                if roughness > 0.0:
                    v, w = _uniform(stream, pool), _uniform(stream, pool)
                x, y, z, through = at_dielectric(x, y, z, index, roughness, u, v, w)
                factor *= through
                within = z < 0.0
            elif kind == DIFFUSE:
                x, y = disk(_uniform(stream, pool), _uniform(stream, pool))
                z = math.sqrt(max(1.0 - x * x - y * y, 0.0))
                for c in range(number):
                    carried[c] *= channels[0, c]
            else:
                mx, my, mz = 0.0, 0.0, 1.0
                if roughness > 0.0:
                    mx, my, mz = facet(x, y, z, roughness, _uniform(stream, pool), _uniform(stream, pool))
                cosine = x * mx + y * my + z * mz
                x, y, z = 2.0 * cosine * mx - x, 2.0 * cosine * my - y, 2.0 * cosine * mz - z
                if z <= 0.0:
                    factor = 0.0
                elif roughness > 0.0:
                    factor *= shadowing(x, y, z, mx, my, mz, roughness)
                for c in range(number):
                    carried[c] *= fresnel_conductor(min(cosine, 1.0), channels[0, c], channels[1, c])
            dx, dy, dz = x * sx + y * tx + z * nx, x * sy + y * ty + z * ny, x * sz + y * tz + z * nz
            over = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)  # keeps rounding from growing over many reflections
            dx, dy, dz = dx * over, dy * over, dz * over
            strongest = factor if kind == DIELECTRIC else factor * np.max(carried)
            if least > 0.0:
                strongest *= math.exp(-least * way)
            if strongest < _FAINT:
                if _uniform(stream, pool) * _FAINT >= strongest:
                    state = ABSORBED
                    break
                factor *= _FAINT / strongest
        status[i], events[i], inside[i] = state, count, way
        outgoing[i, 0], outgoing[i, 1], outgoing[i, 2] = dx, dy, dz
        if state == MISSED:
            for k in range(3):
                leave[i, k] = start[i, k] + 2.0 * half * incoming[i, k]
        else:
            along = ox * dx + oy * dy + oz * dz
            rest = max(1.0 - (ox * ox + oy * oy + oz * oz), 0.0)
            t = math.sqrt(along * along + rest) - along
            leave[i, 0], leave[i, 1], leave[i, 2] = ox + t * dx, oy + t * dy, oz + t * dz
        for c in range(number):
            if state in (ABSORBED, CONTRADICTED):
                weight[i, c] = 0.0
            elif state == MISSED:
                weight[i, c] = 1.0
            else:
                weight[i, c] = factor * carried[c] * math.exp(-mu[c] * way)


@dataclass(frozen=True)
class Walker:
    """Traces rays against a mesh in numba, on any machine.

    Attributes
    ----------
    mesh : of the grain
    surface : of the grain; its channels are one or as many as mu's
    mu : (C,) 1/R, absorption coefficient of the interior
    """

    mesh: Mesh
    surface: Surface
    mu: np.ndarray

    def trace(self, uniform, first, replicate, key) -> Paths:
        """Follow the rays of `uniform` (n, 4), numbers in [0, 1): direction (2), place on the disc across it (2).

        first, replicate : path i draws its random numbers from the stream (first + i, replicate) of the key (two words of 32
        bits), whatever else is traced.
        """
        count, channels = len(uniform), len(self.mu)
        paths = Paths(np.empty(count, np.int8), *(np.empty((count, 3)) for _ in range(4)), np.empty(count),
                      np.empty((count, channels)), np.empty(count, np.int64))
        surface = self.surface
        nodes, children, blocks, _ = self.mesh.tree
        _walk(nodes, children, blocks, surface.kind, surface.index, surface.roughness,
              np.ascontiguousarray(np.broadcast_to(surface.channels, (2, channels))), self.mu, EVENTS_MAX, uniform, first,
              np.uint64(replicate), np.uint64(key[0]), np.uint64(key[1]), paths.status, paths.start, paths.leave, paths.incoming,
              paths.outgoing, paths.inside, paths.weight, paths.events)
        return paths
