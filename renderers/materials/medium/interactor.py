"""Continuous media: homogeneous, or with a density on a grid."""

import math
from typing import NamedTuple

import numpy as np

from bakery import kernels
from bakery.kernels import lent, mesh_scratch
from bakery.system.compiled import njit
from renderers.mitsuba.shading import FAR
from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.paths import ELSEWHERE, ENDED, EVENT, REACHED, UNKNOWN, Flying
from renderers.transport.scattering import (
    Scatterer,
    collision,
    dimmed,
    flight,
    flown,
    mean_cosines,
    next_event,
    of_one_component,
    ray_of,
    turn,
    turned,
)
from renderers.transport.wavefront import uniform

_EVERYWHERE = kernels.region_box(np.zeros(3), np.ones(3))  # in place of a grid; nobody reads it
# Depth around a scene from which on no light samples are drawn: 6e-6 of the light comes so far.  In fog that absorbs nothing a
# path may come back after 100,000 scatterings, and a step of all materials takes milliseconds however few paths are left
_OUTSKIRTS = 12
_LONG = 100_000  # scatterings from which on paths end as in `wavefront.goes_on`


class Medium:
    """A continuous medium.

    scatterer : `renderers.transport.scattering.Scatterer`;  colours : to_rgb (3, L), to_waves (L, 3)
    density : `bakery.kernels.Region` of relative densities, 0 to 1, of a medium whose sigma_t is that at 1; None: 1 everywhere
    sampled : whether light samples reach its events
    extent : middle (3,) m and radius m of the scene, of a medium without end; None of another
    """

    solid, walks = False, False

    def __init__(self, scatterer: Scatterer, colours, density=None, sampled=True, extent=None):
        self.scatterer, self.colours, self.sampled, self._extent = scatterer, colours, sampled, extent
        self._density = density or _EVERYWHERE
        self._decay = _decay(scatterer)
        self._most = float(np.max(scatterer.sigma_t)) if density is not None else 0.0
        clearest = float(np.min(scatterer.sigma_t))
        self._outskirts = _OUTSKIRTS / clearest if clearest > 0.0 else math.inf

    def light_chance(self, share):
        """Of a light sample at an event, where a share of them is wanted."""
        return share if self.sampled else 0.0

    def advance(self, paths, stop):
        status = np.empty(paths.count, np.int64)
        run(fly, paths.count, self.scatterer, self._density, self._most, paths.part(Flying), stop, status)
        paths.left_out[status == EVENT] = np.nan
        if self._extent:
            self._end_far_out(paths, status)
            self._wander(paths, status)
        return status, ()

    def _end_far_out(self, paths, status):
        """Roulette of paths at events of a medium without end, by their throughput times the share of light that comes back from
        out there: by diffusion exp(-k (r - R)) R/r.  Changes the throughput, and the status to ENDED."""
        middle, radius = self._extent
        far = np.linalg.norm(paths.origin - middle, axis=1)
        at = np.flatnonzero((status == EVENT) & (far > radius))
        chance = np.minimum(1.0, paths.throughput[at].max(axis=1) * np.exp(self._decay * (radius - far[at])) * radius / far[at])
        numbers = wavefront.uniforms(paths.states, 1, at)
        paths.throughput[at] /= np.maximum(chance, 1e-300)[:, None]
        status[at[numbers[:, 0] >= chance]] = ENDED

    def _wander(self, paths, status):
        """Takes paths at events so far out that light samples bring nothing back to its outskirts: where they come in, their
        status is ELSEWHERE, and they find all lights by themselves; else it is ENDED."""
        middle, radius = self._extent
        out = Outside(np.asarray(middle, float), radius, radius + self._outskirts, self._decay)
        run(wander, paths.count, self.scatterer, out, paths.part(Flying), status)
        back = np.flatnonzero(status == ELSEWHERE)
        paths.drawn[back], paths.far[back] = paths.origin[back], np.nan
        paths.single[back], paths.shaded[back] = True, True
        paths.grains[back], paths.triangle[back], paths.sphere[back] = -1, -1, UNKNOWN

    def transmittance(self, states, origin, direction, distance, left_out, share):
        ways = states, origin, direction, distance
        run(transmit, len(share), self.scatterer, self._density, self._most, ways, share)

    def next_event(self, paths, event, sample, passed, clear, added):
        points = of_one_component(paths.count)
        run(next_event, paths.count, self.scatterer, self.colours, paths.part(Flying), points, sample, passed, added)

    def scatter(self, paths, event):
        run(turn, paths.count, self.scatterer, paths.part(Flying))


def _decay(scatterer):
    """How quickly diffuse light decays with distance, 1/m: of the wavelength that gets farthest."""
    albedo = scatterer.albedo
    diffuse = np.sqrt(3 * (1 - albedo) * (1 - albedo * mean_cosines(scatterer)))
    return float(np.min(scatterer.sigma_t * np.minimum(diffuse, 1.0)))


@njit(cache=True, nogil=True, error_model="numpy")
def fly(medium, density, most, paths, stop, status, begin, end):
    """Takes paths begin to end to their next scattering, or to stop (n,) m; status (n,) becomes EVENT or REACHED.

    density, most : where there is how much of the medium, and its largest extinction; most = 0: as much everywhere
    """
    medium, density, paths = lent(medium), lent(density), lent(paths)
    scratch = mesh_scratch()
    for i in range(begin, end):
        if most > 0.0:
            ray = ray_of(paths.origin, paths.direction, i)
            t = collision(density, medium.sigma_t, 1.0, ray, (0.0, stop[i]), paths.throughput, paths.states, i, scratch)
        else:
            t = flight(medium, paths.throughput, paths.states, i)
            flown(medium, paths.throughput, i, min(t, stop[i], FAR), t < stop[i])
        status[i] = REACHED
        if t < stop[i]:
            status[i] = EVENT
            for k in range(3):
                paths.origin[i, k] += t * paths.direction[i, k]
            paths.order[i] += 1
            paths.bounces[i] += 1


class Outside(NamedTuple):
    """Of a scene in a medium without end: middle (3,) m and radius m of a ball around it, that of its outskirts, and how quickly
    diffuse light decays, 1/m."""

    middle: np.ndarray
    radius: float
    outskirts: float
    decay: float


@njit(cache=True, nogil=True, error_model="numpy")
def wander(medium, out, paths, status, begin, end):
    """Takes paths begin to end at events outside of the outskirts of a scene through all further scatterings there."""
    medium, out, paths = lent(medium), lent(out), lent(paths)
    values = np.empty(paths.throughput.shape[1])
    for i in range(begin, end):
        while status[i] == EVENT:
            square, along = 0.0, 0.0
            for k in range(3):
                square += (paths.origin[i, k] - out.middle[k]) ** 2
            if square <= out.outskirts**2:
                break
            turned(medium, paths, i, values)
            for k in range(3):
                along += (paths.origin[i, k] - out.middle[k]) * paths.direction[i, k]
            chord = along * along - square + out.outskirts**2
            comes_in = -along - math.sqrt(chord) if along < 0.0 and chord > 0.0 else np.inf
            t = flight(medium, paths.throughput, paths.states, i)
            flown(medium, paths.throughput, i, min(t, comes_in, FAR), t < comes_in)
            for k in range(3):
                paths.origin[i, k] += min(t, comes_in, FAR) * paths.direction[i, k]
            if t >= comes_in:
                status[i] = ELSEWHERE
            elif not _goes_on_outside(out, paths, i):
                status[i] = ENDED


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _goes_on_outside(out, paths, i):
    """Whether path i goes on from another event, by `Medium._end_far_out` and `wavefront.goes_on`; changes its throughput."""
    paths.order[i] += 1
    paths.bounces[i] += 1
    square, most = 0.0, 0.0
    for k in range(3):
        square += (paths.origin[i, k] - out.middle[k]) ** 2
    for w in range(paths.throughput.shape[1]):
        most = max(most, paths.throughput[i, w])
    far = math.sqrt(square)
    chance = min(1.0, most * math.exp(out.decay * (out.radius - far)) * out.radius / far)
    if paths.bounces[i] > _LONG:
        chance *= (1.0 - 1.0 / paths.bounces[i]) ** 4
    if uniform(paths.states, i) >= chance:
        return False
    for w in range(paths.throughput.shape[1]):
        paths.throughput[i, w] /= chance
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def transmit(medium, density, most, ways, share, begin, end):
    """Multiplies share (n, L) by what a medium leaves of light on its ways; where it varies, by an estimate of that.

    ways : random streams (n,), origins and unit directions (n, 3) m, lengths (n,) m
    """
    medium, density, ways = lent(medium), lent(density), lent(ways)
    states, origin, direction, distance = ways
    sigma, scratch = medium.sigma_t, mesh_scratch()
    for i in range(begin, end):
        if most == 0.0:
            for w in range(len(sigma)):
                share[i, w] *= math.exp(-sigma[w] * min(distance[i], FAR))
            continue
        dimmed(density, sigma, 1.0, ray_of(origin, direction, i), (0.0, distance[i]), share[i], states, i, scratch)
