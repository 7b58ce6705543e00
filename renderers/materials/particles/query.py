"""The query cylinder and the query sphere of Guo et al. 2022 (sections 5.2 to 5.5), as printed; for comparison.

A ray is a cylinder of radius r_c; every particle that touches it attenuates by its whole cross section over the cylinder's
(Eq. 18).  Distances are drawn from the mean medium; the particles in a sphere of radius r_c about the point scatter (Eq. 24), and
where it holds none, nothing does (the printed delta function is light that goes on, which the transmittance has counted).  So the
mean over realisations is not the continuous medium's: docs/discrete.md measures by how much.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.kernels import (
    NO_DISC,
    Particles,
    Pencil,
    disc_cells,
    discs_of_cell,
    first_disc,
    mesh_scratch,
    phase_sample,
    phase_value,
    turned_direction,
)
from bakery.system.compiled import njit
from renderers.materials.particles import _transport
from renderers.threads import run
from renderers.transport import wavefront
from renderers.transport.scattering import ray_of

_IN_SPHERE = 4096  # particles of one query at most
# on average: 8 standard deviations below that.  Time goes with their square, as a ray looks for each of its particles anew: dust
# in 12 pixels of 10 degrees takes 0.7 s a pass with 580 in a query, and minutes with 18,000
MOST = 3600


class Cylinder(NamedTuple):
    """extinction, scattering : (K, L) m^2, of the classes;  radius : m, r_c"""

    extinction: np.ndarray
    scattering: np.ndarray
    radius: float


class Query:
    """How the paper's queries attenuate and scatter.

    medium : `Medium` whose discs have radii r_p + r_c
    cylinder : `Cylinder`
    later : m, 0: between surfaces and lights the mean medium attenuates
    """

    later, eye, squares = 0.0, None, None

    def __init__(self, medium, extinction, scattering, radius):
        self.medium, self.cylinder = medium, Cylinder(extinction, scattering, float(radius))

    def collide(self, paths, far):
        """A distance from the mean medium; weights hold Eq. 18 over the density of that choice."""
        n = paths.count
        kind, distance, point = np.empty(n, np.int64), np.empty(n), np.empty((n, 3))
        run(_distance, n, self.medium, self.cylinder, paths, far, kind, distance, point)
        return kind, distance, point

    def scattered(self, world, paths, kind, point, sums):
        """Scattering by the particles of the query sphere, and light from a lamp by way of them."""
        n = paths.count
        sample = world.lights(point, wavefront.uniforms(paths.states, 3))
        run(_scatter, n, self.medium, self.cylinder, point, paths, sample, sums.by_order, sums.by_light)
        return paths._replace(origin=point, left_out=np.full((n, 3), np.nan), single=np.zeros(n, bool),
                              splatted=np.zeros(n, bool))


@njit(cache=True, nogil=True, error_model="numpy")
def _transmittance(medium, cylinder, ray, far, passed, mesh_room):
    """Eq. 18: exp(-sum of C_ext / A) over the particles that touch the cylinder."""
    ox, oy, oz, dx, dy, dz = ray
    passed[:] = 0.0
    t = 0.0
    while True:
        pencil = Pencil((ox, oy, oz), (dx, dy, dz), t, far, (np.nan, np.nan, np.nan))
        kind, t, _, _, _, _ = first_disc(medium.discs, pencil, mesh_room)
        if kind == NO_DISC:
            break
        for w in range(len(passed)):
            passed[w] += cylinder.extinction[kind, w]
    for w in range(len(passed)):
        passed[w] = math.exp(-passed[w] / (math.pi * cylinder.radius * cylinder.radius))


@njit(cache=True, nogil=True, error_model="numpy")
def _distance(medium, cylinder, paths, far, kind, distance, point, begin, end):
    weight = paths.throughput
    mesh_room, passed = mesh_scratch(), np.empty(weight.shape[1])
    region, most = medium.discs.region, medium.sigma_t.max()
    for i in range(begin, end):
        ray = ray_of(paths.origin, paths.direction, i)
        near, leave = _transport.through_box(region, ray, 0.0, far[i])
        t = near - math.log1p(-wavefront.uniform(paths.states, i)) / most if most > 0 else np.inf
        if near < leave and t < leave:
            chance, kind[i], distance[i] = most * math.exp(-most * (t - near)), 0, t
        else:
            t, kind[i], distance[i] = far[i], NO_DISC, far[i]
            chance = math.exp(-most * (leave - near)) if near < leave else 1.0
        for k in range(3):
            point[i, k] = ray[k] + distance[i] * ray[3 + k]
        _transmittance(medium, cylinder, ray, t, passed, mesh_room)
        for w in range(len(passed)):
            weight[i, w] *= passed[w] / chance


@njit(cache=True, nogil=True, error_model="numpy")
def _in_sphere(medium, radius, centre, kinds, scratch):
    """Classes of the particles in the query sphere, into kinds; how many."""
    discs, n = medium.discs, 0
    x, y, z = centre
    points, kind, identity, mesh_room = scratch
    particles = Particles(points, kind, identity)
    for level in range(len(discs.reach)):
        bounds, low, high = disc_cells(discs, level), np.empty(3, np.int64), np.empty(3, np.int64)
        for axis, at in enumerate((x, y, z)):
            q = at - discs.region.lo[axis] - discs.shift[level, axis]
            low[axis] = max(bounds[axis], math.floor((q - radius) / discs.step[level, axis]))
            high[axis] = min(bounds[3 + axis], math.floor((q + radius) / discs.step[level, axis]))
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                for k in range(low[2], high[2] + 1):
                    next_place = np.int64(0)  # of this type from the start: numba would compile the callee for literals too
                    while next_place >= 0:
                        filled, next_place = discs_of_cell(discs, level, (i, j, k), next_place, particles, np.int64(0), mesh_room)
                        for p in range(filled):
                            u, v, w = points[p, 0] - x, points[p, 1] - y, points[p, 2] - z
                            if u * u + v * v + w * w < radius * radius and n < len(kinds):
                                kinds[n] = kind[p]
                                n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _value(medium, scattering, kinds, n, v, values):
    """Eq. 24 without its volume, (L,) m^2/sr."""
    values[:] = 0.0
    for p in range(n):
        for w in range(len(values)):
            values[w] += scattering[kinds[p], w] * phase_value(medium.v, medium.steps, medium.phase[kinds[p], w], v)


@njit(cache=True, nogil=True, error_model="numpy")
def _scatter(medium, cylinder, point, paths, sample, by_order, by_light, begin, end):
    direction, weight, states, density = paths.direction, paths.throughput, paths.states, paths.density
    towards, radiance, scattering, radius = sample.direction, sample.radiance, cylinder.scattering, cylinder.radius
    mesh_room, waves = mesh_scratch(), weight.shape[1]
    values, passed, added = np.empty(waves), np.empty(waves), np.empty(3)
    kinds = np.empty(_IN_SPHERE, np.int64)
    scratch = np.empty((64, 3)), np.empty(64, np.int64), np.empty(64, np.uint64), mesh_room
    volume = 4 / 3 * math.pi * radius**3
    for i in range(begin, end):
        x, y, z = point[i, 0], point[i, 1], point[i, 2]
        n = _in_sphere(medium, radius, (x, y, z), kinds, scratch)
        total = 0.0
        for p in range(n):
            total += scattering[kinds[p], 0]
        density[i] = 0.0
        if not total > 0:
            weight[i] = 0.0
            continue
        lx, ly, lz = np.float64(towards[i, 0]), np.float64(towards[i, 1]), np.float64(towards[i, 2])
        if radiance[i, 0] > 0 or radiance[i, 1] > 0 or radiance[i, 2] > 0:
            u, v, w = lx - direction[i, 0], ly - direction[i, 1], lz - direction[i, 2]
            _value(medium, scattering, kinds, n, min(0.5 * (u * u + v * v + w * w), 2.0), values)
            balance = 1.0 if sample.delta[i] else sample.density[i] / (sample.density[i] + values[0] / total)
            _transmittance(medium, cylinder, (x, y, z, lx, ly, lz), sample.distance[i], passed, mesh_room)
            _transport.absorbed(medium, (x, y, z, lx, ly, lz), sample.distance[i], passed)
            for w in range(waves):
                values[w] *= weight[i, w] * passed[w] * balance / volume
            wavefront.to_rgb(medium, values, radiance[i], added)
            wavefront.add(added, min(paths.order[i], wavefront.ORDERS - 1), sample.light[i], paths.pixel[i], by_order, by_light)
        chosen, drawn = wavefront.uniform(states, i) * total, 0
        while drawn < n - 1 and chosen >= scattering[kinds[drawn], 0]:
            chosen -= scattering[kinds[drawn], 0]
            drawn += 1
        v = phase_sample(medium.v, medium.steps, medium.phase[kinds[drawn], 0], medium.cdf[kinds[drawn], 0],
                         wavefront.uniform(states, i))
        _value(medium, scattering, kinds, n, v, values)
        density[i] = values[0] / total
        for w in range(waves):
            weight[i, w] *= values[w] / (volume * density[i]) if density[i] > 0 else 0.0
        direction[i, 0], direction[i, 1], direction[i, 2] = turned_direction(
            direction[i, 0], direction[i, 1], direction[i, 2], v, 2 * math.pi * wavefront.uniform(states, i))
