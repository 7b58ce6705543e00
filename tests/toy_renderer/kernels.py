"""The toy renderer's loop: compiled, with look-ups through `bakery.kernels`."""

from numba import njit

from bakery import kernels


@njit
def glow(v, steps, f, _cdf, rays, sun, albedo, out):
    """Radiance (H, W) seen along unit rays (H, W, 3), of light of irradiance 1 that travels along `sun`, a unit vector."""
    for y in range(rays.shape[0]):
        for x in range(rays.shape[1]):
            cosine = -(rays[y, x, 0] * sun[0] + rays[y, x, 1] * sun[1] + rays[y, x, 2] * sun[2])
            out[y, x] = albedo * kernels.phase_value(v, steps, f, 1 - cosine)
