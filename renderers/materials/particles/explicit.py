"""Path tracing of the spheres themselves: reflection and refraction of rays, no waves; for comparison.

Light is refracted and reflected at the true surface, so no light without extent can be connected to a sphere: paths find lights
by chance, as those of any path tracer among spheres of glass do.  All wavelengths take one path, with the index at the middle
one; absorption is each wavelength's own.
"""

import math

import numpy as np

from bakery.kernels import Pencil, first_disc, fresnel, lent, mesh_scratch
from bakery.system.compiled import njit
from renderers.threads import run
from renderers.transport import wavefront

_REFLECTIONS = 1000  # inside one sphere; total reflection has no end


class Spheres:
    """How spheres stop and turn rays.

    medium : `Medium` whose discs have the spheres' radii;  later : m, inf
    index : (K,) of each class, relative to the host, at the middle wavelength
    absorption : (K, L) 1/m, inside of the spheres
    """

    later, eye, squares = np.inf, None, None

    def __init__(self, medium, index, absorption):
        self.medium, self.index, self.absorption = medium, index, absorption

    def collide(self, paths, far):
        """As `walk.Discs.collide`; `point` is the centre of the sphere."""
        n = paths.count
        kind, distance, point = np.empty(n, np.int64), np.empty(n), np.empty((n, 3))
        run(_meet, n, self.medium.discs, paths, far, kind, distance, point)
        return kind, distance, point

    def scattered(self, world, paths, kind, point, sums):
        """As `walk.Discs.scattered`; no light is sampled here."""
        n = paths.count
        run(_pass, n, self.medium.discs.largest, self.index, self.absorption, kind, point, paths)
        return paths._replace(density=np.zeros(n), single=np.ones(n, bool), splatted=np.zeros(n, bool))


@njit(cache=True, nogil=True, error_model="numpy")
def _meet(discs, paths, far, kind, distance, point, begin, end):
    discs, scratch = lent(discs), mesh_scratch()
    origin, direction = paths.origin, paths.direction
    for i in range(begin, end):
        # a sphere that the ray has just left lies behind it: the foot of its centre counts no more
        pencil = Pencil((origin[i, 0], origin[i, 1], origin[i, 2]), (direction[i, 0], direction[i, 1], direction[i, 2]), 0.0,
                        far[i], (np.nan, np.nan, np.nan))
        kind[i], distance[i], _, point[i, 0], point[i, 1], point[i, 2] = first_disc(
            discs, pencil, scratch)


@njit(cache=True, nogil=True, error_model="numpy")
def _pass(square, index, absorption, kind, point, paths, begin, end):
    """Paths meet a sphere, are reflected or go through it; they become those that leave."""
    origin, direction, weight, states = paths.origin, paths.direction, paths.throughput, paths.states
    for i in range(begin, end):
        r, eta = math.sqrt(square[kind[i]]), index[kind[i]]
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        cx, cy, cz = origin[i, 0] - point[i, 0], origin[i, 1] - point[i, 1], origin[i, 2] - point[i, 2]
        along = cx * dx + cy * dy + cz * dz
        px, py, pz = cx - along * dx, cy - along * dy, cz - along * dz
        half = math.sqrt(max(r * r - px * px - py * py - pz * pz, 0.0))
        # unit normal where the ray enters
        nx, ny, nz = (px - half * dx) / r, (py - half * dy) / r, (pz - half * dz) / r
        cosine = min(half / r, 1.0)
        chance, inner = fresnel(cosine, eta)
        if wavefront.uniform(states, i) < chance:
            dx, dy, dz = dx + 2 * cosine * nx, dy + 2 * cosine * ny, dz + 2 * cosine * nz
        else:
            # refracted; all chords have the same length and the same angle of incidence
            a, b = 1 / eta, cosine / eta - inner
            dx, dy, dz = a * dx + b * nx, a * dy + b * ny, a * dz + b * nz
            chord, chords = 2 * r * inner, 0
            while chords < _REFLECTIONS:
                chords += 1
                nx, ny, nz = nx + chord / r * dx, ny + chord / r * dy, nz + chord / r * dz
                if wavefront.uniform(states, i) >= chance:
                    break
                dx, dy, dz = dx - 2 * inner * nx, dy - 2 * inner * ny, dz - 2 * inner * nz
            for w in range(weight.shape[1]):
                weight[i, w] *= math.exp(-absorption[kind[i], w] * chord * chords)
            a, b = eta, cosine - eta * inner
            dx, dy, dz = a * dx + b * nx, a * dy + b * ny, a * dz + b * nz
        norm = 1 / math.sqrt(dx * dx + dy * dy + dz * dz)
        direction[i, 0], direction[i, 1], direction[i, 2] = dx * norm, dy * norm, dz * norm
        origin[i, 0], origin[i, 1], origin[i, 2] = point[i, 0] + r * nx, point[i, 1] + r * ny, point[i, 2] + r * nz
