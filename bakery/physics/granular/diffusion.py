"""Light that diffuses in a medium in a mesh: far from the mesh its fluence at a point is the mean over a sphere around it.

The fluence phi of light that is scattered often obeys phi'' = sigma_tr^2 phi where no light enters.  So

    phi(x) = sigma_tr R / sinh(sigma_tr R) * mean of phi over the sphere of radius R around x

whatever the body's shape, as long as the sphere lies in it (Muller 1956, walks on spheres).  A path that gathers light takes the
step to a point of the sphere in place of the scatterings on its way there.  D and sigma_tr are those of the improved
approximation (`medium.diffusion.improved`).  Lengths are in the aggregate's unit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from bakery.physics.granular._distance import distance
from bakery.physics.granular.aggregate import clearance, depth
from bakery.physics.medium.diffusion import improved
from bakery.physics.medium.phase import mean_cosine

_INSIDE = 1 - 1e-9  # of a distance: rounding leaves no point of a sphere outside of the mesh
_COARSE = 4.0  # diagonals of a voxel: where the bound of the voxels is worse than that, the mesh is asked


class Diffuse(NamedTuple):
    """Where and how light diffuses in a medium in a mesh.

    near : from so far inside on light diffuses; infinite: never
    ahead : light scattered once goes on by so much before it has lost its direction
    sigma_tr : (L,) its decay
    depth : (X, Y, Z) float32, of voxels, lower bounds of distances to the mesh
    free : (X, Y, Z) float32, the same to other things; empty where there are none
    """

    near: float
    ahead: float
    sigma_tr: np.ndarray
    depth: np.ndarray
    free: np.ndarray


def diffuse(aggregate, sigma_t, albedo, v, phase, occupied) -> Diffuse:
    """Diffusion in a medium in the mesh of an aggregate.

    Parameters
    ----------
    sigma_t, albedo : (L,) 1/unit, 1
    v, phase : (A,) 1 - cos theta, (L, A) 1/sr
    occupied : (X, Y, Z), voxels where there is something else; empty where there are none

    Notes
    -----
    near is the largest of the wavelengths' min(1/sigma_t', 0.5/sigma_tr); infinite where one of them is not scattered.
    Source: Meng et al. 2015, section 5.
    """
    g = mean_cosine(2 * np.arcsin(np.sqrt(np.clip(v / 2, 0, 1))), phase)
    found = improved(albedo * sigma_t, (1 - albedo) * sigma_t, g)
    with np.errstate(divide="ignore", invalid="ignore"):
        near = np.max(np.minimum(1 / found.sigma_t, np.where(found.sigma_tr > 0, 0.5 / found.sigma_tr, np.inf)))
        ahead = np.mean(g / found.sigma_t)
    none = np.zeros((0, 0, 0), np.float32)
    free = clearance(occupied > 0, aggregate.edge).astype(np.float32) if occupied.any() else none
    return Diffuse(float(near), float(ahead) if np.isfinite(near) else 0.0, np.array(found.sigma_tr),
                   depth(aggregate).astype(np.float32), free)


def never(sigma_t) -> Diffuse:
    """No diffusion at wavelengths (L,)."""
    none = np.zeros((0, 0, 0), np.float32)
    return Diffuse(math.inf, 0.0, np.zeros(len(sigma_t)), none, none)


@njit(cache=True, nogil=True, error_model="numpy")
def clear(aggregate, diffuse, p, room):
    """Radius of a sphere around p (3,), which lies inside, that is inside too and meets nothing else."""
    low, edge, depth = aggregate.low, aggregate.edge, diffuse.depth
    a = min(max(math.floor((p[0] - low[0]) / edge[0]), 0), depth.shape[0] - 1)
    b = min(max(math.floor((p[1] - low[1]) / edge[1]), 0), depth.shape[1] - 1)
    c = min(max(math.floor((p[2] - low[2]) / edge[2]), 0), depth.shape[2] - 1)
    radius = float(depth[a, b, c])
    diagonal = math.sqrt(edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2])
    if radius < _COARSE * diagonal:
        radius = distance(aggregate.tree, aggregate.middle, aggregate.scale, p, radius + 2.0 * diagonal, room[0])
    if diffuse.free.size > 0:
        radius = min(radius, float(diffuse.free[a, b, c]))
    return radius * _INSIDE


@njit(cache=True, nogil=True, error_model="numpy")
def decayed(x):
    """x / sinh x, x >= 0: what is left of diffuse light from a sphere of radius x / sigma_tr at its middle."""
    if x < 1e-3:
        return 1.0 - x * x / 6.0  # off by less than x^4/50: 2e-14
    return 2.0 * x * math.exp(-x) / (1.0 - math.exp(-2.0 * x))
