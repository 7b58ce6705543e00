"""Light of the sun that fog scatters towards the camera.

Along a viewing ray L = integral of e^{-tau(t)} J(t) dtau(t).  J, what a collision sends towards the camera, is

    albedo [ p(theta) E e^{-tau_light}  +  p'(theta) E (e^{-tau'} - e^{-tau_light})  +  (phi + 3 g w.F)/(4 pi) ]

the sun's unscattered light, with the whole phase function; what its peak has scattered before, still nearly
parallel (delta scaling: a share f, the second Legendre moment, goes on, so tau' = (1 - albedo f) tau_light); and diffuse light
of the two-stream method in a column (`_columns`): along the vertical where density depends on height only, along the sun's
direction where fog fills a box.  Without diffuse light the first term alone: single scattering, exact.

What is approximate: light changes no columns; surfaces cast no shadows into the fog; the ground under fog that depends on height
is black.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bakery.errors import StageError, UsageError
from renderers.fog import _columns

TOLERANCE = 0.01
_BLOCK = 8192  # rays at a time
_DARK = 40.0  # optical depth of the nearest channel beyond which nothing is seen
_NOTHING = 1e-15  # optical depth of a step that is left out
_STEP = 20.0  # largest optical depth of a step that is looked at; deeper ones are halved first
_HALVINGS = 60
# Gauss's 3 points within Kronrod's 7 on (-1, 1)
_NODES = np.array([-0.9604912687080202, -0.7745966692414834, -0.4342437493468026, 0.0,
                   0.4342437493468026, 0.7745966692414834, 0.9604912687080202])
_KRONROD = np.array([0.1046562260264673, 0.2684880898683334, 0.4013974147759622, 0.4509165386584741,
                     0.4013974147759622, 0.2684880898683334, 0.1046562260264673])
_GAUSS = np.array([0, 5 / 9, 0, 8 / 9, 0, 5 / 9, 0])


@dataclass(frozen=True)
class Sun:
    """Parallel light: direction of travel (3,), irradiance (C,) across it."""

    direction: Sequence[float]
    irradiance: Sequence[float]


class Medium:
    """What scatters: coefficients, moments of the phase function, and what delta scaling leaves of them, all (C,).

    sigma_t, sigma_s : (C,) 1/m at density 1
    phase : theta (...) rad -> (C, ...) 1/sr, integral 1 over the sphere

    Raises ValueError: a phase function whose integral is not 1 to 2 %.
    """

    def __init__(self, sigma_t, sigma_s, phase: Callable):
        self.sigma_t, sigma_s, self.phase = np.array(sigma_t, float), np.asarray(sigma_s, float), phase
        self.albedo = np.divide(sigma_s, self.sigma_t, out=np.zeros_like(self.sigma_t), where=self.sigma_t > 0)
        self.g, self.peak = _columns.moments(phase)


def scattered(density, origin, direction, distance, medium: Medium, lights, *, diffuse=True, tolerance=TOLERANCE):
    """Radiance that fog scatters into viewing rays.

    Parameters
    ----------
    density : relative density with `at` and `integrals`; `up` (3,) and `base` (m) where it depends on the height over `up` only,
        `lo`, `hi` (3,) m where it fills a box, none of these where it has no end
    origin, direction : (N, 3) m and unit vectors, away from the camera
    distance : (N,) m, of the surface, finite
    medium : `Medium`
    lights : of `Sun`
    diffuse : whether light that is scattered more than once is added
    tolerance : largest relative error of the integral along a ray, in each channel (where that is below 1e-3 of the ray's
        brightest channel or 1e-6 of the brightest ray: relative to those)

    Returns
    -------
    radiance : (N, C), unit of the lights

    Raises
    ------
    UsageError : a sun over fog without an end, where its light never arrives
    StageError : the tolerance was not reached
    ValueError : distances that are not finite

    Notes
    -----
    The integral is exact where J is constant: steps add J(middle) (e^-tau_a - e^-tau_b) and quadrature of the rest.
    """
    origin, direction = np.broadcast_arrays(np.asarray(origin, float), np.asarray(direction, float))
    distance = np.broadcast_to(np.asarray(distance, float), origin.shape[:-1])
    if not np.isfinite(distance).all():
        raise ValueError("distances of surfaces are finite; cut the sky off at a far distance")
    sources = [_source(light, density, medium, origin, direction, distance, diffuse) for light in lights]
    out = np.zeros((len(origin), len(medium.sigma_t)))
    for start in range(0, len(origin) if sources else 0, _BLOCK):
        rays = slice(start, start + _BLOCK)
        directed = [of_rays(direction[rays]) for of_rays in sources]
        # half: steps that are given up as fine leave less for the others
        out[rays], error = march(density, origin[rays], direction[rays], distance[rays], medium.sigma_t, directed, tolerance / 2)
        if (error > tolerance * _least(out[rays])).any():
            raise StageError(f"external light: an error of {tolerance:g} along viewing rays is out of reach; the density may "
                             "jump too often: smooth it, or ask for a larger tolerance")
    return out


# ---- along viewing rays


def _least(total):
    """What errors are relative to, (N, C): the ray's light in a channel, or shares of the brightest channel and ray."""
    return np.maximum(total, np.maximum(1e-3 * total.max(axis=1, keepdims=True), 1e-6 * total.max(initial=0.0)))


def march(density, origin, direction, distance, sigma_t, sources, tolerance):
    """Integral of e^-tau source dtau along rays, in steps that are halved until their error is small: radiance and error (N, C).

    The error is the difference of two quadrature rules, and what density they missed.

    density, origin, direction, distance, sigma_t, tolerance : as in `scattered`
    sources : what collisions send to the camera, to be added: points (M, 3), numbers of their rays (M,) -> (M, C)
    """
    count, C = len(origin), len(sigma_t)
    summed, error = np.zeros((count, C)), np.zeros((count, C))
    number = np.zeros(count, int)  # of finished steps
    thin, thick = sigma_t[sigma_t > 0].min(initial=np.inf), sigma_t.max(initial=0.0)

    def columns(ray, t):
        """Density integrated between successive distances (M, T): (M, T - 1) m."""
        start, length = t[:, :-1], np.diff(t, axis=1)
        rays = np.repeat(ray, length.shape[1])
        points = origin[rays] + start.reshape(-1, 1) * direction[rays]
        return np.asarray(density.integrals(points, direction[rays], length.ravel()), float)[:, 0].reshape(length.shape)

    def per_ray(ray, values):
        return np.stack([np.bincount(ray, values[:, c], count) for c in range(C)], axis=1)

    # steps from a to b (m): `before` is the column in front of one, `inside` its own
    ray, a, b = np.arange(count), np.zeros(count), np.array(distance)
    before, inside = np.zeros(count), columns(ray, np.stack([a, b], axis=1))[:, 0]
    for halving in range(_HALVINGS + 1):
        keep = (inside * thick > _NOTHING) & (before * thin < _DARK)
        ray, a, b, before, inside = ray[keep], a[keep], b[keep], before[keep], inside[keep]
        if not len(ray):
            break
        last = halving == _HALVINGS
        deep = (inside * thick > _STEP) & (not last)
        look, blind = np.flatnonzero(~deep), np.flatnonzero(deep)
        t = ((a + b)[:, None] + (b - a)[:, None] * np.r_[-1, _NODES, 1]) / 2
        pieces = columns(ray[look], t[look])
        value, off = _steps(density, origin, direction, sigma_t, sources, ray[look], t[look], before[look], pieces)
        total, sum_off = summed + per_ray(ray[look], value), error + per_ray(ray[look], off)
        # where a deep step waits the sum is not known yet: what is small beside the known part is small
        reached = (sum_off <= tolerance * _least(total)).all(axis=1) & (np.bincount(ray[blind], minlength=count) == 0)
        allowed = tolerance * _least(total) / (2 * np.maximum(number + np.bincount(ray, minlength=count), 1))[:, None]
        fine = reached[ray[look]] | (off <= allowed[ray[look]]).all(axis=1) | last
        summed, error = summed + per_ray(ray[look[fine]], value[fine]), error + per_ray(ray[look[fine]], off[fine])
        number += np.bincount(ray[look[fine]], minlength=count)
        split = np.append(look[~fine], blind)
        half = np.append(pieces[~fine][:, :4].sum(axis=1), columns(ray[blind], t[blind][:, [0, 4]])[:, 0])
        beyond = np.append(pieces[~fine][:, 4:].sum(axis=1), columns(ray[blind], t[blind][:, [4, 8]])[:, 0])
        middle = t[split, 4]
        ray, a, b = np.tile(ray[split], 2), np.append(a[split], middle), np.append(middle, b[split])
        before, inside = np.append(before[split], before[split] + half), np.append(half, beyond)
    return summed, error


def _steps(density, origin, direction, sigma_t, sources, ray, t, before, pieces):
    """Values and errors (P, C) of P steps: ends and nodes `t` (P, 9), columns `before` (P,), between nodes `pieces` (P, 8)."""
    shape = (len(ray), len(_NODES))
    rays = np.repeat(ray, shape[1])
    points = origin[rays] + t[:, 1:-1].reshape(-1, 1) * direction[rays]
    rho = np.asarray(density.at(points), float).reshape(shape)
    J = sum(source(points, rays) for source in sources).reshape(*shape, len(sigma_t))
    column = np.cumsum(pieces, axis=1)
    inside, half = column[:, -1], (t[:, -1] - t[:, 0]) / 2
    middle = J[:, shape[1] // 2]
    correction = (J - middle[:, None]) * sigma_t * (rho * half[:, None])[..., None]
    correction *= np.exp(-sigma_t * (before[:, None] + column[:, :-1])[..., None])
    sure = np.exp(-sigma_t * before[:, None]) * -np.expm1(-sigma_t * inside[:, None])
    kronrod, gauss = np.einsum("k,pkc->pc", _KRONROD, correction), np.einsum("k,pkc->pc", _GAUSS, correction)
    # density that the nodes did not meet may hide another J: a little of it one like theirs, much of it any
    # (one rule may meet the right amount by chance, two hardly ever)
    missed = np.abs(half * (rho @ _KRONROD) / inside - 1) + 0.1 * np.abs(half * (rho @ _GAUSS) / inside - 1)
    missed = np.minimum(missed, 1.0)[:, None]
    hidden = missed * (J.max(axis=1) - J.min(axis=1)) + missed**2 * J.max(axis=1)
    return middle * sure + kronrod, np.abs(kronrod - gauss) + hidden * sure


# ---- what a collision sends towards the camera


def _source(light, density, medium, origin, direction, distance, diffuse):
    """Of a light, for viewing rays (N, 3) a function of points and numbers of their rays that gives the source (M, C).

    Columns are along `axis`, which leads away from the lit face; `mu` is the cosine between the two.
    """
    irradiance = np.array(np.broadcast_to(np.asarray(light.irradiance, float), (len(medium.sigma_t),)))
    travel = np.asarray(light.direction, float) / np.linalg.norm(light.direction)
    up = getattr(density, "up", None)
    if up is None:
        if not hasattr(density, "lo"):
            raise UsageError("fog.light: a sun does not shine into fog without an end; a density of type height or grid would do")
        axis, mu, floor = travel, 1.0, None
    else:
        axis = -np.asarray(up, float)
        mu, ends = float(axis @ travel), np.concatenate([origin, origin + distance[:, None] * direction]) @ -axis
        floor = min(float(density.base), float(ends.min(initial=np.inf)))
    constant = _columns.Medium(medium.sigma_t, medium.albedo, medium.g, medium.peak), _columns.Parallel(mu, irradiance, diffuse)

    def of_rays(direction):
        theta = np.arctan2(np.linalg.norm(np.cross(travel, -direction), axis=-1), -direction @ travel)
        single, turn, cosine = np.asarray(medium.phase(theta), float).T * irradiance, np.cos(theta), -direction @ axis

        def source(points, ray):
            out = np.zeros((len(points), len(medium.sigma_t)))
            if mu <= 0:  # below the horizon
                return out
            far, along = np.full(len(points), np.inf), np.broadcast_to(axis, points.shape)
            before = density.integrals(points, -along, far)[:, 0]
            to_floor = far if floor is None else np.maximum(points @ -axis - floor, 0)
            behind = density.integrals(points, along, to_floor)[:, 0] if diffuse else before
            _columns.source(np.ascontiguousarray(before), np.ascontiguousarray(behind), single[ray], turn[ray], cosine[ray],
                            *constant, out)
            return out

        return source

    return of_rays
