"""Balls of any surface by a walk on the exact sphere: rough ones, which have no closed form, and any for checks.

`BallWalker` stands in for `walk.Walker` (`scatterometer.measure(…, tracer=…)`).  No facets: those of a mesh let light into modes
that a ball keeps shut.
"""

import math
from dataclasses import dataclass

import numpy as np

from bakery.physics.grains.sampling import FAINT, coat, enter, next_uniform, stream, surface_frame, uniforms_of_meeting
from bakery.physics.grains.surface import DIELECTRIC, Surface, at_surface, surface_share
from bakery.physics.grains.walk import ABSORBED, CUT, EVENTS_MAX, LEFT, MISSED, Paths
from bakery.system.compiled import njit

_GRAZING = 1e-12  # least cosine to the normal on entry: a ray that only touches is reflected


@njit(nogil=True, error_model="numpy", forceinline=True)
def _meet(coat, x, y, z, stream, pool, carried):
    """New unit direction for wi = (x, y, z) and share left of all light; what each channel carries is multiplied by its own."""
    u, v, w = uniforms_of_meeting(coat.kind, coat.roughness, stream, pool)
    x, y, z, through, cosine = at_surface(coat.kind, coat.index, coat.roughness, x, y, z, u, v, w)
    for c in range(len(carried)):
        carried[c] *= surface_share(coat.kind, coat.channels, c, cosine)
    over = 1.0 / math.sqrt(x * x + y * y + z * z)
    return x * over, y * over, z * over, through


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(radius, coat, events_max, uniform, numbers, paths):
    """Fill `Paths` for the rays `uniform` (n, 4); numbers: `sampling.Stream`."""
    kind, mu = coat.kind, coat.mu
    first, replicate, key0, key1 = numbers
    status, start, leave, incoming, outgoing, inside, weight, events = paths
    pool, stream = np.empty(4), np.zeros(5, np.uint64)
    stream[0], stream[1], stream[3] = key0, key1, replicate
    carried, least = np.empty(weight.shape[1]), np.min(mu)
    beside = (1.0 - radius) * (1.0 + radius)
    for i in range(len(uniform)):
        stream[2], stream[4] = np.uint64(first + i), np.uint64(0)
        half = enter(uniform[i], start[i], incoming[i])
        dx, dy, dz = incoming[i]
        outgoing[i] = incoming[i]
        status[i], events[i], inside[i] = MISSED, 0, 0.0
        leave[i] = start[i] + 2.0 * half * incoming[i]
        weight[i, :] = 1.0
        depth = half * half - beside
        if depth < 0.0:
            continue
        depth = math.sqrt(depth)
        ox, oy, oz = start[i, 0] + (half - depth) * dx, start[i, 1] + (half - depth) * dy, start[i, 2] + (half - depth) * dz
        z = max(depth / radius, _GRAZING)  # not from the place: keeps its digits at grazing
        path_inside, count, factor, state = 0.0, 0, 1.0, LEFT
        carried[:] = 1.0
        while True:
            over = 1.0 / math.sqrt(ox * ox + oy * oy + oz * oz)
            nx, ny, nz = ox * over, oy * over, oz * over
            if count == events_max:
                state = CUT
                break
            count += 1
            sx, sy, sz, tx, ty, tz = surface_frame(nx, ny, nz)
            x, y = -(dx * sx + dy * sy + dz * sz), -(dx * tx + dy * ty + dz * tz)
            x, y, z, through = _meet(coat, x, y, z, stream, pool, carried)
            factor *= through
            dx, dy, dz = x * sx + y * tx + z * nx, x * sy + y * ty + z * ny, x * sz + y * tz + z * nz
            ox, oy, oz = radius * nx, radius * ny, radius * nz
            strongest = factor if kind == DIELECTRIC else factor * np.max(carried)
            if least > 0.0:
                strongest *= math.exp(-least * path_inside)
            if strongest < FAINT:
                if next_uniform(stream, pool) * FAINT >= strongest:
                    state = ABSORBED
                    break
                factor *= FAINT / strongest
            if z >= 0.0:  # out: a ball is not met twice
                break
            chord = -2.0 * radius * z
            path_inside += chord
            ox, oy, oz = ox + chord * dx, oy + chord * dy, oz + chord * dz
            # the chord meets the far side as it left the near one: z stays, now of a wi inside
        status[i], events[i], inside[i] = state, count, path_inside
        outgoing[i, 0], outgoing[i, 1], outgoing[i, 2] = dx, dy, dz
        along = ox * dx + oy * dy + oz * dz
        t = math.sqrt(along * along + beside) - along if along >= 0.0 else 0.0
        leave[i, 0], leave[i, 1], leave[i, 2] = ox + t * dx, oy + t * dy, oz + t * dz
        for c in range(weight.shape[1]):
            weight[i, c] = 0.0 if state == ABSORBED else factor * carried[c] * math.exp(-mu[c] * path_inside)


@dataclass(frozen=True)
class BallWalker:
    """Traces rays against a ball in the middle of its bounding sphere."""

    surface: Surface  # of the ball; its channels are one or as many as mu's
    mu: np.ndarray  # (C,) 1/R, absorption coefficient of the interior
    radius: float = 1.0  # R, of the ball, up to 1
    events_max: int = EVENTS_MAX  # meetings with the surface after which a path is cut

    def __post_init__(self):
        if not 0 < self.radius <= 1:
            raise ValueError(f"radius {self.radius:g}: more than 0 and up to 1 (the bounding sphere) is possible")

    def trace(self, uniform, first, replicate, key) -> Paths:
        """As `walk.Walker.trace`."""
        paths = Paths.empty(len(uniform), len(self.mu))
        _walk(float(self.radius), coat(self.surface, self.mu), self.events_max, uniform, stream(first, replicate, key), paths)
        return paths
