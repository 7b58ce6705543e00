"""What walks of all engines share: random numbers of paths, where rays enter, the frame of a surface, what became of a path."""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.grains.surface import CONDUCTOR, DIELECTRIC, disk
from bakery.system.compiled import njit

MISSED, LEFT, ABSORBED, CONTRADICTED, CUT = range(5)
FAINT = 0.05  # weight below which a path goes on only by chance
AHEAD = 1.0 / 128  # how far outside of the bounding sphere a ray starts: a grain may touch the sphere


class Coat(NamedTuple):
    """What a walk takes of a surface and the interior behind it: as in `surface.Surface`, and mu (C,) 1/R."""

    kind: int
    index: float
    roughness: float
    channels: np.ndarray
    mu: np.ndarray


class Stream(NamedTuple):
    """Random numbers of rays: path i draws from the stream (first + i, replicate) of the key."""

    first: int
    replicate: np.uint64
    key0: np.uint64
    key1: np.uint64


def coat(surface, mu) -> Coat:
    """Of a surface whose channels are one or as many as mu's."""
    # copies: a read-only array is another type to numba, and another compilation
    channels = np.array(np.broadcast_to(surface.channels, (2, len(mu))))
    return Coat(surface.kind, float(surface.index), float(surface.roughness), channels, np.array(mu, float))


def stream(first, replicate, key) -> Stream:
    """From whole numbers, and a key of two words of 32 bits."""
    return Stream(first, np.uint64(replicate), np.uint64(key[0]), np.uint64(key[1]))


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
def next_uniform(stream, pool):
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
def uniforms_of_meeting(kind, roughness, stream, pool):
    """The numbers that a meeting with a surface takes (`surface.at_surface`)."""
    u = v = w = 0.0
    if kind != CONDUCTOR or roughness > 0.0:
        u = next_uniform(stream, pool)
        if kind != DIELECTRIC or roughness > 0.0:
            v = next_uniform(stream, pool)
        if kind == DIELECTRIC and roughness > 0.0:
            w = next_uniform(stream, pool)
    return u, v, w


@njit(cache=True, nogil=True, error_model="numpy")
def surface_frame(x, y, z):
    """Two unit vectors that make a right-handed frame with (x, y, z) (Duff et al. 2017)."""
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return 1.0 + sign * x * x * a, sign * b, -sign * x, b, sign + y * y * a, -y


@njit(cache=True, nogil=True, error_model="numpy")
def uniform_chord(u0, u1, u2, u3):
    """Isotropic uniform chord of the unit sphere from four uniform numbers: half length, direction, start."""
    z = 1.0 - 2.0 * u0
    across, phi = 2.0 * math.sqrt(u0 * (1.0 - u0)), 2.0 * math.pi * u1
    x, y = across * math.cos(phi), across * math.sin(phi)
    sx, sy, sz, tx, ty, tz = surface_frame(x, y, z)
    p, q = disk(u2, u3)
    half = math.sqrt(max(1.0 - p * p - q * q, 0.0))
    return half, x, y, z, p * sx + q * tx - half * x, p * sy + q * ty - half * y, p * sz + q * tz - half * z


@njit(cache=True, nogil=True, error_model="numpy")
def enter(u, start, incoming):
    """`uniform_chord` of u (4,), written to start and incoming (3,); returns its half length."""
    half, incoming[0], incoming[1], incoming[2], start[0], start[1], start[2] = uniform_chord(u[0], u[1], u[2], u[3])
    return half


@njit(cache=True, nogil=True, error_model="numpy")
def uniform_number(key0, key1, path, replicate, number):
    """Number `number` (from 0) of a path's stream, as `next_uniform` draws it."""
    a, b, c, d = philox(path & np.uint64(0xFFFFFFFF), path >> np.uint64(32), replicate, np.uint64(number >> 2), key0, key1)
    at = number & 3
    return ((a if at == 0 else b if at == 1 else c if at == 2 else d) + 0.5) * 2.0**-32
