"""Light that diffuses in a medium in a mesh: far from the mesh its fluence at a point is the mean over a sphere around it.

Far from its sources light obeys laplacian phi = sigma_tr^2 phi.  So, whatever the shape of the body,

    phi(x) = sigma_tr R / sinh(sigma_tr R) * mean of phi over the sphere of radius R around x

where that sphere lies in it.  A path that gathers light goes to a point of the sphere, in place of all the scatterings on its way
there, and on to the next sphere; near the mesh, where light does not diffuse, it scatters again.  Lengths are in the aggregate's
unit.  Source: Muller, Ann. Math. Stat. 27, 569 (1956), for walks on spheres.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from bakery.physics.granular.aggregate import clearance, depth_in_mesh
from bakery.physics.granular.distance import distance_to_triangles
from bakery.physics.multiple.legendre import moments as legendre
from bakery.system.compiled import njit

_NEAR, _SKIN = 1.5, 0.5  # 1/sigma_t'
_MOMENTS = 63  # of a phase function
_INSIDE = 1 - 1e-9  # of a distance: rounding leaves no point of a sphere outside of the mesh
_COARSE = 4.0  # diagonals of a voxel: where the bound of the voxels is worse than that, the mesh is asked


class Diffuse(NamedTuple):
    """Where and how light diffuses in a medium in a mesh.

    near : from so far inside on light diffuses; infinite: never
    skin : spheres end so far from the mesh and other things
    ahead : a scattering sends on the fluence of so much farther on along the path
    sigma_tr : (L,) its decay
    depth : (X, Y, Z) float32, of voxels, lower bounds of distances to the mesh
    free : (X, Y, Z) float32, the same to other things; empty where there are none
    """

    near: float
    skin: float
    ahead: float
    sigma_tr: np.ndarray
    depth: np.ndarray
    free: np.ndarray


def decay(albedo, moments):
    """Decay of light far from its sources, over sigma_t: exact transport in an infinite medium.

    albedo : 0 to 1
    moments : (N,) Legendre moments of the phase function, g the one after the first, 1

    Returns 0 without absorption; isotropic: the root of albedo = k / artanh k

    1/k is the largest eigenvalue of the moments' recurrence, h_l phi_l = k (l phi_(l-1) + (l + 1) phi_(l+1)) with
    h_l = (2 l + 1)(1 - albedo p_l).  At albedo 0.9 and g = 0.65 that is 0.331; similarity and the improved D (Grosjean 1956)
    give 0.317.
    Source: Case & Zweifel, Linear Transport Theory (1967), section 4; d'Eon, Transport Theory Stat. Phys. 42, 237 (2013).
    """
    l = np.arange(len(moments))
    h = (2 * l + 1) * (1 - albedo * np.asarray(moments, float))
    if h[0] <= 0:
        return 0.0
    return float(1 / eigvalsh_tridiagonal(np.zeros(len(h)), l[1:] / np.sqrt(h[1:] * h[:-1]), select="i",
                                          select_range=(len(h) - 1, len(h) - 1))[0])


def diffuse_in_mesh(aggregate, sigma_t, albedo, v, phase, occupied) -> Diffuse:
    """Diffusion in a medium in the mesh of an aggregate.

    Parameters
    ----------
    sigma_t, albedo : (L,) 1/unit, 1
    v, phase : (A,) 1 - cos theta, (L, A) 1/sr
    occupied : (X, Y, Z), voxels where there is something else; empty where there are none

    Notes
    -----
    near is 1.5/sigma_t', skin 0.5/sigma_t', of the wavelength where that is most.  Meng et al. 2015, section 5, take
    min(1/sigma_t', 0.5/sigma_tr) and no skin; `python benchmarks/diffusion.py` shows what both do.
    """
    moments = [legendre(2 * np.arcsin(np.sqrt(np.clip(v / 2, 0, 1))), row, _MOMENTS) for row in phase]
    k = np.array([decay(*row) for row in zip(albedo, moments)])
    g = np.array([row[1] for row in moments])
    with np.errstate(divide="ignore"):
        longest = float(np.max(1 / (sigma_t * (1 - albedo * g))))
    ahead = 0.0
    if np.isfinite(longest) and albedo.any():
        # light that comes to a scattering, of fluence phi and flux -D grad phi, is sent on as phi + 3 g D dphi/dx along the path
        D = np.where(k > 0, (1 - albedo) / np.where(k > 0, k, 1) ** 2, 1 / (3 * (1 - g))) / sigma_t
        ahead = np.average(3 * g * D, weights=albedo)
    free = clearance(occupied > 0, aggregate.edge) if occupied.any() else np.zeros((0, 0, 0))
    return Diffuse(_NEAR * longest, _SKIN * longest, float(ahead), sigma_t * k, depth_in_mesh(aggregate).astype(np.float32),
                   free.astype(np.float32))


def never_diffuse(sigma_t) -> Diffuse:
    """No diffusion at wavelengths (L,)."""
    none = np.zeros((0, 0, 0), np.float32)
    return Diffuse(math.inf, 0.0, 0.0, np.zeros(len(sigma_t)), none, none)


@njit(cache=True, nogil=True, error_model="numpy")
def clear_in_mesh(aggregate, diffuse, p, enough, scratch):
    """Radius of a sphere around p (3,), a point inside, that is inside too and meets nothing else.

    0 where the voxels tell that it would be less than `enough`.
    """
    low, edge, depth = aggregate.low, aggregate.edge, diffuse.depth
    a = min(max(math.floor((p[0] - low[0]) / edge[0]), 0), depth.shape[0] - 1)
    b = min(max(math.floor((p[1] - low[1]) / edge[1]), 0), depth.shape[1] - 1)
    c = min(max(math.floor((p[2] - low[2]) / edge[2]), 0), depth.shape[2] - 1)
    radius, free = float(depth[a, b, c]), float(diffuse.free[a, b, c]) if diffuse.free.size > 0 else np.inf
    diagonal = math.sqrt(edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2])
    if min(radius + 2.0 * diagonal, free) < enough:
        return 0.0
    if radius < _COARSE * diagonal:
        radius = distance_to_triangles(aggregate.tree, aggregate.middle, aggregate.scale, p,
                                       min(radius + 2.0 * diagonal, free), scratch[0])
    return min(radius, free) * _INSIDE


@njit(cache=True, nogil=True, error_model="numpy")
def diffuse_share(x):
    """x / sinh x, x >= 0: what is left of diffuse light from a sphere of radius x / sigma_tr at its middle."""
    if x < 1e-3:
        return 1.0 - x * x / 6.0  # off by less than x^4/50: 2e-14
    return 2.0 * x * math.exp(-x) / (1.0 - math.exp(-2.0 * x))
