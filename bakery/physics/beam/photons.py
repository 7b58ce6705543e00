"""What reaches planes across a beam, by following photons: the reference of every kernel, with standard errors.

The medium fills z >= 0, in layers if wanted; photons enter it at the origin along +z and are gone when they come back to z < 0.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bakery import rng
from bakery.physics.medium.kernels import phase_layout, phase_sample, turned_direction
from bakery.system.compiled import njit

BLOCKS = 32  # random streams, and samples of each mean
# The weight that a photon should have: 1 where it is counted, more by so much a mean free path beyond the last plane or ring, as
# few come back from there (of fog's, 36 of 43 scatterings are there).  Below half of it Russian roulette is played for all of it,
# above three times it the photon goes on as two.  Variance times time, against no such window: 0.33 for fog, 0.4 for isotropic
# scattering that absorbs nothing, 0.6 for g = 0.5 at albedo 0.9; between slopes of 2 and 8 they differ by a tenth.
_SLOPE, _LOW, _HIGH = 3.0, 0.5, 3.0
_TWINS = 64  # that wait at once, at most; a photon is not divided beyond that
_GRAZING = 0.01  # cosine below which 1/cos, whose variance is infinite, is replaced by its mean for a steady radiance, 2/0.01
_GONE = 20.0  # optical depths to the next plane after which a photon that cannot matter any more is given up


@dataclass(frozen=True)
class Counted:
    """Scattered light in rings of planes, with standard errors from `BLOCKS` independent blocks."""

    depth: np.ndarray  # (D,) mfp
    edges: np.ndarray  # (R + 1,) mfp, of the rings
    # flux, flux_error: (D, R) mfp^-2, crossings of the plane, forward and back, over the area of the ring
    flux: np.ndarray
    flux_error: np.ndarray
    # fluence, fluence_error: (D, R) mfp^-2, crossings over the cosine: radiance integrated over directions
    fluence: np.ndarray
    fluence_error: np.ndarray
    photons: int  # followed

    @property
    def radius(self):
        """(R,) mfp, middle of the rings."""
        return (self.edges[1:] + self.edges[:-1]) / 2


class Counting:
    """Photons of a narrow beam, of which more can be followed: n at first and m later are the same ones as n + m at once.

    albedo, theta, phase, depth, edges, layers : as of `count`
    source : its seed and stream
    events : its first and last
    """

    def __init__(self, albedo, theta, phase, depth, edges, source=(0, 0), events=(1, None), layers=((0.0,), (1.0,))):
        self.depth, self.edges = np.asarray(depth, float), np.asarray(edges, float)
        self._albedo, self._table = float(albedo), phase_layout(np.asarray(theta, float), np.asarray(phase, float))
        begins, density = (np.array(column, float) for column in layers)
        if begins[0] != 0 or not (np.diff(begins) > 0).all() or not (density >= 0).all() or len(begins) != len(density):
            raise ValueError("layers begin at 0 and ascend, each with a density of 0 or more")
        begins = np.append(begins, math.inf)
        optical = np.concatenate([[0.0], np.cumsum(density[:-1] * np.diff(begins[:-1]))])
        which = np.searchsorted(begins, self.depth, side="right") - 1
        self._thick = optical[which] + (self.depth - begins[which]) * density[which]
        self._layers, self._events = (begins, density, optical), (events[0], 2**62 if events[1] is None else events[1])
        self._streams = [rng.generator(source[0], "beam.photons", source[1], index) for index in range(BLOCKS)]
        self._sums = np.zeros((BLOCKS, 2, 2, len(self.depth), len(self.edges) - 1))
        self._per_block = 0

    @property
    def photons(self) -> int:
        """Followed so far."""
        return self._per_block * BLOCKS

    def follow(self, photons, threads=1) -> None:
        """Follow more photons, until it is `photons` in all; the values do not depend on the threads."""
        per_block = -(-int(photons) // BLOCKS)
        added, self._per_block = max(per_block - self._per_block, 0), max(per_block, self._per_block)

        def block(index):
            _follow(self._streams[index], added, self._albedo, self._table, self._layers,
                    _Planes(self.depth, self._thick, self.edges, self._sums[index]), self._events)

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(block, range(BLOCKS)))

    def counted(self, back=True) -> Counted:
        """What the photons add up to; `back`: whether light that goes back through a plane counts too."""
        sums = self._sums.sum(axis=1) if back else self._sums[:, 0]
        sums = sums / (self._per_block * math.pi * np.diff(self.edges**2))
        mean, error = sums.mean(axis=0), sums.std(axis=0, ddof=1) / math.sqrt(BLOCKS)
        return Counted(self.depth, self.edges, mean[0], error[0], mean[1], error[1], self.photons)


def rms(estimate, counted: Counted, measure="flux"):
    """Relative root mean square of a kernel against photons, of 2 pi r Psi over all planes and rings.

    Parameters
    ----------
    estimate : (D, R) mfp^-2, at the middles of the rings, or averages over them
    measure : flux | fluence

    Returns
    -------
    error : 1, sqrt(sum (estimate - counted)^2 / sum counted^2), less the noise of the photons in squares (0 where all is noise)
    noise : 1, that noise
    """
    value, sigma = getattr(counted, measure), getattr(counted, measure + "_error")
    r = counted.radius
    whole = np.sum((r * value) ** 2)
    noise = np.sum((r * sigma) ** 2) / whole
    square = np.sum((r * (np.asarray(estimate) - value)) ** 2) / whole - noise
    return math.sqrt(max(square, 0.0)), math.sqrt(noise)


@njit(cache=True, nogil=True, error_model="numpy")
def _flight(z, uz, optical, begins, density):
    """Path length of a photon from z through an optical thickness; infinite if it leaves the medium before."""
    layer, distance = np.searchsorted(begins, z, side="right") - 1, 0.0
    while 0 <= layer < len(density):
        bound = begins[layer + 1] if uz > 0 else begins[layer]
        to_face = (bound - z) / uz if uz != 0 else math.inf
        needed = optical / density[layer] if density[layer] > 0 else math.inf
        if needed < to_face or to_face == math.inf:
            return distance + needed
        distance, z, optical = distance + to_face, bound, optical - to_face * density[layer]
        layer += 1 if uz > 0 else -1
    return math.inf


class _Planes(NamedTuple):
    """Depths of planes in mfp at density 1 and as they are, edges of rings, sums: forward and back; flux and fluence; (D, R)."""

    depth: np.ndarray
    thick: np.ndarray
    edges: np.ndarray
    sums: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _add(rings, position, above, direction, weight):
    """Adds to each plane ahead of a photon what of it would reach it.  above : optical depth of the photon."""
    (depth, thick, edges, sums), (px, py, pz), (ux, uy, uz) = rings, position, direction
    over = 1 / abs(uz) if abs(uz) > _GRAZING else 2 / _GRAZING
    inner, outer, per_ring = edges[0] ** 2, edges[-1] ** 2, (len(edges) - 1) / (edges[-1] - edges[0])
    side = 0 if uz > 0 else 1
    level = np.searchsorted(depth, pz)
    for i in range(level if uz > 0 else 0, len(depth) if uz > 0 else level):
        passed = (thick[i] - above) / uz
        distance = (depth[i] - pz) / uz
        x, y = px + distance * ux, py + distance * uy
        square = x * x + y * y
        if passed > _GONE or not inner <= square < outer:
            continue
        r = math.sqrt(square)
        ring = min(int((r - edges[0]) * per_ring), len(edges) - 2)  # at once where they are equally wide
        while ring > 0 and r < edges[ring]:
            ring -= 1
        while ring < len(edges) - 2 and r >= edges[ring + 1]:
            ring += 1
        reaching = weight * math.exp(-passed)
        sums[side, 0, i, ring] += reaching
        sums[side, 1, i, ring] += reaching * over


@njit(cache=True, nogil=True, error_model="numpy")
def _follow(stream, photons, albedo, table, layers, rings, events):
    """Photons of a block, added to the planes.  events : first and last that count."""
    (v_nodes, steps, f, cdf), (begins, density, optical), (first, last) = table, layers, events
    outer, bottom = rings.edges[-1], rings.thick[-1]
    twins, waiting = np.empty((_TWINS, 9)), 0
    for _ in range(photons):
        px, py, pz = 0.0, 0.0, _flight(0.0, 1.0, -math.log1p(-stream.random()), begins, density)
        ux, uy, uz = 0.0, 0.0, 1.0
        weight, event = 1.0, 0
        while True:
            alive = pz >= 0 and pz < math.inf and px * px + py * py <= (outer + _GONE) ** 2
            if alive:
                layer = np.searchsorted(begins, pz, side="right") - 1
                above = optical[layer] + (pz - begins[layer]) * density[layer]
                alive = above <= bottom + _GONE
            if alive:
                weight *= albedo
                wanted = 1 + _SLOPE * max(math.sqrt(px * px + py * py) - outer, above - bottom, 0.0)
                if weight < _LOW * wanted:
                    alive = stream.random() * wanted < weight
                    weight = wanted
            if alive and weight > _HIGH * wanted and waiting < _TWINS:
                weight *= 0.5
                twins[waiting, :3], twins[waiting, 3:6] = (px, py, pz), (ux, uy, uz)
                twins[waiting, 6:] = weight, float(event), above
                waiting += 1
            if not alive:
                if waiting == 0:
                    break
                waiting -= 1
                px, py, pz, ux, uy, uz = (twins[waiting, 0], twins[waiting, 1], twins[waiting, 2], twins[waiting, 3],
                                          twins[waiting, 4], twins[waiting, 5])
                weight, event, above = twins[waiting, 6], int(twins[waiting, 7]), twins[waiting, 8]
            v = phase_sample(v_nodes, steps, f, cdf, stream.random())
            ux, uy, uz = turned_direction(ux, uy, uz, v, 2 * math.pi * stream.random())
            event += 1
            if event >= first and uz != 0:
                _add(rings, (px, py, pz), above, (ux, uy, uz), weight)
            flight = math.inf if event >= last else _flight(pz, uz, -math.log1p(-stream.random()), begins, density)
            px, py, pz = px + flight * ux, py + flight * uy, pz + flight * uz
