"""Reflectance and transmittance of baked layers inside compiled loops, from the tables of `table`.

Light scattered once, the boundary and the base are computed at the angle that is asked for; the rest is smooth, and linear
between the nodes of a grid over both directions and the azimuth.

Both functions are built into the loops that call them, and do not count the table's eleven arrays: handing these over took as
long, 64 ns, as a look-up.
"""

import math

from bakery.physics.lent import lent
from bakery.system.compiled import njit


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _fresnel(mu, within, index):
    """Unpolarised share that a smooth boundary reflects; cosines outside and inside."""
    if index == 1.0 or mu + within <= 0.0:
        return 0.0
    across, along = (mu - index * within) / (mu + index * within), (index * mu - within) / (index * mu + within)
    return 0.5 * (across * across + along * along)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _crowded(z):
    """Coordinate of z, both 0 to 1: nodes lie as squares of their numbers at either end."""
    return 0.5 * (1.0 + math.sqrt(z) - math.sqrt(1.0 - z))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _coordinate(within, mu, table, nodes):
    """Node below a direction, and its share of the way to the next one."""
    s = min(math.sqrt(min(within, mu)), 1.0) if table.rooted else mu
    x = (_crowded(s) if table.crowded else 1.0 - math.sqrt(max(1.0 - s, 0.0))) * (nodes - 1)
    i = min(int(x), nodes - 2)
    return i, x - i


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _between(grid, wave, at, at0, at_phi):
    """Value of a grid (L, K, K, P) between its nodes."""
    (i, x), (j, y), (k, z) = at, at0, at_phi
    total = 0.0
    for a in range(2):
        u = x if a else 1.0 - x
        for b in range(2):
            v = u * (y if b else 1.0 - y)
            below, above = grid[wave, i + a, j + b, k], grid[wave, i + a, j + b, k + 1]
            total += v * (below + z * (above - below))
    return total


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _phase(table, wave, s):
    """4 pi times the phase function, linear in s = sin^2(theta / 2)."""
    last = len(table.s) - 1
    bucket = min(int(math.sqrt(s) * (len(table.guide) - 1)), len(table.guide) - 2)
    low, high = table.guide[bucket], min(table.guide[bucket + 1] + 1, last)
    while high - low > 1:
        middle = (low + high) >> 1
        if table.s[middle] <= s:
            low = middle
        else:
            high = middle
    share = min(max((s - table.s[low]) / (table.s[low + 1] - table.s[low]), 0.0), 1.0)
    return table.phase[wave, low] + share * (table.phase[wave, low + 1] - table.phase[wave, low])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _facets(mu, mu0, cos_phi, index, roughness):
    """R of light that facets reflect once (GGX, Smith's shadowing), as `rough.reflected`."""
    doubled = mu * mu0 - math.sqrt((1.0 - mu * mu) * (1.0 - mu0 * mu0)) * cos_phi
    onto = math.sqrt(max(0.5 * (1.0 + doubled), 1e-30))
    upright, square = min(0.5 * (mu + mu0) / onto, 1.0), roughness * roughness
    spread = (square - 1.0) * upright * upright + 1.0
    seen = 4.0 / ((1.0 + math.sqrt(1.0 + square * (1.0 - mu * mu) / (mu * mu)))
                  * (1.0 + math.sqrt(1.0 + square * (1.0 - mu0 * mu0) / (mu0 * mu0))))
    within = math.sqrt(max((index - 1.0) * (index + 1.0) + onto * onto, 0.0)) / index
    return seen * _fresnel(onto, within, index) * square / (spread * spread) / (4.0 * mu * mu0)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def surface_reflectance(table, wave, mu, mu0, cos_phi):
    """pi times the BRDF of a layer at one wavelength, without light that a smooth boundary mirrors.

    Parameters
    ----------
    table : `table.SurfaceTable`
    wave : position of the wavelength
    mu, mu0 : cosines in air of the directions, above 0 to 1
    cos_phi : cosine of the azimuth between the directions of travel, 1 for light that goes on forward
    """
    table = lent(table)
    index, depth, nodes = table.index, table.depth[wave], table.reflected.shape[1]
    if table.roughness > 0.0:
        at, at0 = _coordinate(mu, mu, table, nodes), _coordinate(mu0, mu0, table, nodes)
        azimuth = _azimuth(cos_phi, table, table.reflected.shape[3])
        return _between(table.reflected, wave, at, at0, azimuth) + _facets(mu, mu0, cos_phi, index, table.roughness)
    inner = math.sqrt(max((index - 1.0) * (index + 1.0) + mu * mu, 0.0)) / index
    inner0 = math.sqrt(max((index - 1.0) * (index + 1.0) + mu0 * mu0, 0.0)) / index
    through = (1.0 - _fresnel(mu, inner, index)) * (1.0 - _fresnel(mu0, inner0, index)) / (index * index)
    if not through > 0.0:
        return 0.0
    at, at0 = _coordinate(inner, mu, table, nodes), _coordinate(inner0, mu0, table, nodes)
    smooth = _between(table.reflected, wave, at, at0, _azimuth(cos_phi, table, table.reflected.shape[3]))
    once = table.once[wave]
    if once > 0.0:  # among grains all is in the grid
        sines = math.sqrt(max((1.0 - mu * mu) * (1.0 - mu0 * mu0), 0.0)) / (index * index)
        once *= _phase(table, wave, min(max(0.5 * (1.0 + inner * inner0 - sines * cos_phi), 0.0), 1.0))
    if depth == math.inf:
        return through * (smooth + once) / (inner + inner0)
    stopped, stopped0 = -math.expm1(-depth / inner), -math.expm1(-depth / inner0)
    on_both = stopped + stopped0 - stopped * stopped0  # by the way in or out
    result = (smooth * stopped * stopped0 + once * on_both) / (inner + inner0)
    return through * (result + table.base[wave] * (1.0 - on_both))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def surface_transmittance(table, wave, mu, mu0, cos_phi):
    """The same of light that leaves below, pi times the BTDF: 0 over a base; unscattered light left out."""
    table = lent(table)
    if table.transmitted.shape[0] == 0:
        return 0.0
    index, below, depth, nodes = table.index, table.index_below, table.depth[wave], table.transmitted.shape[1]
    inner = math.sqrt(max((below - 1.0) * (below + 1.0) + mu * mu, 0.0)) / below
    inner0 = math.sqrt(max((index - 1.0) * (index + 1.0) + mu0 * mu0, 0.0)) / index
    through = (1.0 - _fresnel(mu, inner, below)) * (1.0 - _fresnel(mu0, inner0, index)) / (index * below)
    if not through > 0.0:
        return 0.0
    at, at0 = _coordinate(inner, mu, table, nodes), _coordinate(inner0, mu0, table, nodes)
    smooth = _between(table.transmitted, wave, at, at0, _azimuth(cos_phi, table, table.transmitted.shape[3]))
    if depth == math.inf:  # of layers on each other all is in the grid
        return through * smooth
    sines = math.sqrt(max((1.0 - mu * mu) * (1.0 - mu0 * mu0), 0.0)) / (index * index)
    # differences of the directions keep the digits of small angles
    s = 0.25 * ((inner - inner0) ** 2 + ((1.0 - mu * mu) + (1.0 - mu0 * mu0)) / (index * index) - 2.0 * sines * cos_phi)
    once = table.once[wave] * _phase(table, wave, min(max(s, 0.0), 1.0))
    x, x0 = 1.0 / inner, 1.0 / inner0
    stopped, stopped0 = -math.expm1(-depth * x), -math.expm1(-depth * x0)
    rate = depth * abs(x - x0)
    mean = -math.expm1(-rate) / rate if rate > 0.0 else 1.0
    direct = x * x0 * depth * (1.0 - min(stopped, stopped0)) * mean
    return through * (smooth * stopped * stopped0 + once * direct)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _azimuth(cos_phi, table, nodes):
    """Node below an azimuth, and its share of the way to the next one.

    Nodes are uniform in 1 + sin(phi / 2) - cos(phi / 2), and nearly in phi: that takes no arc cosine.
    """
    x = _crowded(0.5 - 0.5 * min(max(cos_phi, -1.0), 1.0))
    if table.crowded:
        x = _crowded(x)
    x *= nodes - 1
    k = min(int(x), nodes - 2)
    return k, x - k
