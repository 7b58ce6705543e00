"""Layers under a smooth boundary against photons that are counted one by one: what comes back, by angle, and what passes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bakery.physics.surfaces import fresnel, nodes
from bakery.physics.surfaces.slab import Slab
from bakery.physics.surfaces.solution import solve
from tests.conftest import slow
from tests.odds import sigmas
from tests.physics.surfaces.test_layers import henyey_greenstein

COUNT = 400_000
EDGES = np.linspace(0, 1, 6)  # of the cosine in air


def deflected(direction, g, rng):
    """Directions (N, 3) after a Henyey-Greenstein scattering."""
    u = rng.random(len(direction))
    cosine = (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g)
    helper = np.where(np.abs(direction[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    x = np.cross(direction, helper)
    x /= np.linalg.norm(x, axis=1)[:, None]
    y, phi = np.cross(direction, x), 2 * math.pi * rng.random(len(direction))
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    return cosine[:, None] * direction + sine[:, None] * (np.cos(phi)[:, None] * x + np.sin(phi)[:, None] * y)


def photons(slab: Slab, g: float, mu0: float, rng):
    """Cosines in air of those that come back having entered; depth grows along -z."""
    inside = np.full(COUNT, -fresnel.inside(mu0, slab.index))
    direction = np.stack([np.sqrt(1 - inside**2), np.zeros(COUNT), inside], axis=1)
    direction = direction[rng.random(COUNT) >= fresnel.reflected(mu0, slab.index)]
    depth, back = np.zeros(len(direction)), []
    while len(depth):
        depth = depth - direction[:, 2] * rng.exponential(size=len(depth))
        alive = np.ones(len(depth), bool)
        for _ in range(200):  # mirrored at the top, sent back by the base, to and fro
            up, down = alive & (depth < 0), alive & (depth > slab.depth)
            if not (up.any() or down.any()):
                break
            cosine = np.abs(direction[:, 2])
            outside = fresnel.outside(cosine, slab.index)
            leaves = up & (rng.random(len(depth)) >= np.where(outside > 0, fresnel.reflected(outside, slab.index), 1.0))
            back.append(outside[leaves])
            mirrored = up & ~leaves
            alive &= ~leaves
            depth[mirrored], direction[mirrored, 2] = -depth[mirrored], -direction[mirrored, 2]
            sent = down & (rng.random(len(depth)) < slab.base)
            alive &= ~(down & ~sent)
            number = int(sent.sum())
            cosine, phi = np.sqrt(rng.random(number)), 2 * math.pi * rng.random(number)
            sine = np.sqrt(1 - cosine**2)
            # at the base flights begin anew: the exponential has no memory
            direction[sent] = np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=1)
            depth[sent] = slab.depth - cosine * rng.exponential(size=number)
        alive &= rng.random(len(depth)) < slab.albedo
        depth, direction = depth[alive], deflected(direction[alive], g, rng)
    return np.concatenate(back)


def returned(solution, mu0: float) -> float:
    """Share of light that enters and comes back."""
    index = solution.slab.index
    mirrored = fresnel.reflected(solution.nodes.air, index)
    at = nodes.interpolation(solution.nodes.at, nodes.coordinate(mu0, index))
    return float(at @ ((solution.albedo - mirrored) / (1 - mirrored)) * (1 - fresnel.reflected(mu0, index)))


@pytest.mark.slow
@pytest.mark.parametrize(("index", "g", "depth", "mu0"), [slow(1.5, 0.5, 2.0, 0.3),
                                                          (1.33, -0.4, 0.5, 0.9), (0.8, 0.7, 3.0, 0.75)])
def test_counted_photons(index, g, depth, mu0):
    """Six figures a case; a base that is wrong by a tenth is seen."""
    most = sigmas(comparisons=6)
    slab = Slab(*henyey_greenstein(g), 0.95, depth, index, 0.4)
    back = photons(slab, g, mu0, np.random.default_rng(7))
    solution = solve(slab, g ** np.arange(49.0), 48, 1e-4)
    entered, wrong = (returned(case, mu0) for case in (solution, solve(replace(slab, base=0.44), g ** np.arange(49.0), 48, 1.0)))
    sigma = math.sqrt(entered * (1 - entered) / COUNT)
    assert abs(len(back) / COUNT - entered) < most * sigma < abs(len(back) / COUNT - wrong)
    x, weight = np.polynomial.legendre.leggauss(40)
    phi = math.pi * (np.arange(64) + 0.5) / 64
    counts = np.histogram(back, EDGES)[0] / COUNT
    for low, high, share in zip(EDGES[:-1], EDGES[1:], counts, strict=True):
        cosine = low + (high - low) * 0.5 * (1 + x)
        lobe = solution.reflection(cosine[:, None], mu0, phi).mean(axis=1)
        expected = float((high - low) * weight * cosine @ lobe)
        assert abs(share - expected) < most * math.sqrt(max(expected, 1 / COUNT) / COUNT) + 1e-4, (low, share, expected)
