"""How far light spreads in plane layers: against photons that are followed one by one in NumPy, closed forms and the solver.

Draws are seeded; comparisons with chance fail a right program with the odds of `tests.odds`.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from bakery.physics.multiple.legendre import moments
from bakery.physics.surfaces import fresnel, rough
from bakery.physics.surfaces._spread import _return_to_plane
from bakery.physics.surfaces.slab import Slab
from bakery.physics.surfaces.solution import solve
from bakery.physics.surfaces.spread import CLASSES, profile, profile_within, spread, without_aureole
from tests.conftest import slow
from tests.odds import sigmas
from tests.physics.surfaces.test_layers import henyey_greenstein
from tests.physics.surfaces.test_photons import deflected


def layer(albedo, g, depth, index=1.0, base=None, roughness=0.0):
    return Slab(*henyey_greenstein(g), albedo, depth, index, base, roughness)


def followed(albedo, g, depth, count, seed):
    """Squared distances and weights of photons from all sides that come out of a layer on nothing, without a boundary."""
    rng = np.random.default_rng(seed)
    down, turn = np.sqrt(rng.random(count)), 2 * math.pi * rng.random(count)
    across = np.sqrt(1 - down**2)
    direction = np.stack([across * np.cos(turn), across * np.sin(turn), down], axis=1)
    position, weight, out = np.zeros((count, 3)), np.ones(count), []
    while len(weight):
        flight = rng.exponential(size=len(weight))
        reached = position + flight[:, None] * direction
        top, bottom = reached[:, 2] < 0, reached[:, 2] > depth
        leaves = position[top] - (position[top, 2] / direction[top, 2])[:, None] * direction[top]
        out.append(np.stack([leaves[:, 0] ** 2 + leaves[:, 1] ** 2, weight[top]]))
        stays = ~(top | bottom) & (rng.random(len(weight)) < albedo)
        position, weight, direction = reached[stays], weight[stays], deflected(direction[stays], g, rng)
    return np.concatenate(out, axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(("albedo", "g", "depth"), [(0.99, 0.85, math.inf), slow(0.99, 0.1, math.inf), (0.98, -0.3, 4.0)])
def test_followed_photons(albedo, g, depth):
    """Mean squared distance, what comes out, and the share within some distances: four figures a case.

    With a forward peak that is made even within 0.3 rad, and with light that returns to a plane from the deep.
    """
    result, count = spread(layer(albedo, g, depth), 3, 0, 0), 60_000
    squares, weights = followed(albedo, g, depth, count, 5)
    most, light = sigmas(blocks=16, comparisons=12), result.light.mean(axis=0).sum(axis=0)
    scatter = math.sqrt(np.var(squares) / len(squares))
    assert abs(squares.mean() - result.mean_square) < most * math.hypot(scatter, result.mean_square_error)
    errors = np.sqrt((result.light_error**2).sum(axis=(0, 1))) / CLASSES
    for last in (18, 26, len(light)):
        share, error = (squares < result.edges[last] ** 2).sum() / count, math.sqrt((errors[:last] ** 2).sum())
        assert abs(share - light[:last].sum()) < most * math.hypot(math.sqrt(share * (1 - share) / count), error)


def followed_in_two(media, index, base, count, seed):
    """Squared distances, weights and the cosine in air of photons from all sides that come out of two layers on a matt base.

    media : two of albedo, g, sigma_t, thickness;  index : of both
    """
    rng = np.random.default_rng(seed)
    albedo, g, sigma_t, thickness = (np.array(column) for column in zip(*media, strict=True))
    faces, outside, out = np.concatenate([[0.0], np.cumsum(thickness)]), np.array([1.0, *index, np.inf]), []
    down, turn = np.sqrt(rng.random(count)), 2 * math.pi * rng.random(count)
    across = np.sqrt(1 - down**2)
    keep = rng.random(count) >= fresnel.reflected(down, index[0])
    direction = np.stack([across * np.cos(turn), across * np.sin(turn), down], axis=1)[keep]
    direction[:, :2] /= index[0]
    direction[:, 2] = fresnel.inside(direction[:, 2], index[0])
    position, layer = np.zeros(direction.shape), np.zeros(len(direction), int)
    while len(layer):
        upward = direction[:, 2] < 0
        with np.errstate(divide="ignore"):
            wall = (faces[layer + ~upward] - position[:, 2]) / direction[:, 2]
        flight = rng.exponential(size=len(layer)) / sigma_t[layer]
        meets = flight >= wall
        position = position + np.minimum(flight, wall)[:, None] * direction
        scattered = ~meets & (rng.random(len(layer)) < albedo[layer])
        for k in range(2):
            rows = scattered & (layer == k)
            direction[rows] = deflected(direction[rows], g[k], rng)
        matt = meets & ~upward & (layer == 1)
        returned = matt & (rng.random(len(layer)) < base)
        up, turn = np.sqrt(rng.random(len(layer))), 2 * math.pi * rng.random(len(layer))
        diffuse = np.stack([np.sqrt(1 - up**2) * np.cos(turn), np.sqrt(1 - up**2) * np.sin(turn), -up], axis=1)
        direction[returned] = diffuse[returned]
        meets &= ~matt
        ratio = np.where(meets, outside[layer + np.where(upward, 0, 2)] / outside[layer + 1], 1.0)
        passes = meets & (rng.random(len(layer)) >= fresnel.reflected(np.abs(direction[:, 2]), ratio))
        direction[meets & ~passes, 2] *= -1
        beyond = fresnel.inside(np.abs(direction[:, 2]), ratio) * np.sign(direction[:, 2])
        direction[passes, :2] /= ratio[passes, None]
        direction[passes, 2] = beyond[passes]
        layer = layer + passes * np.where(upward, -1, 1)
        leaves, stays = layer < 0, (layer >= 0) & (scattered | returned | meets)
        out.append(np.stack([(position[leaves, :2] ** 2).sum(axis=1), -direction[leaves, 2]]))
        position, direction, layer = position[stays], direction[stays], layer[stays]
    return np.concatenate(out, axis=1)


@pytest.mark.parametrize(("media", "index"), [
    (((0.98, 0.5, 2.0, 0.3), (0.9, 0.1, 0.5, 4.0)), (1.0, 1.0)),
    slow(((0.9, 0.1, 0.4, 2.0), (0.995, 0.7, 4.0, 20.0)), (1.4, 1.2)),
    (((0.0, 0.0, 0.2, 1.0), (0.99, 0.3, 3.0, 0.5)), (1.3, 1.6))])
def test_photons_followed_in_two_layers(media, index):
    """Mean squared distance of light of the three classes of exitance and of all, and light within some distances.

    A second medium of 80 mean free paths, where light leaps; one that only absorbs on top.
    """
    under = None
    for (albedo, g, sigma_t, thickness), n in zip(media[::-1], index[::-1], strict=True):
        base = 0.5 if under is None else None
        under = Slab(*henyey_greenstein(g), albedo, sigma_t * thickness, n, base, 0.0, under, 1 / sigma_t)
    result, count = spread(under, 3, 0, 0), 40_000
    squares, cosine = followed_in_two(media, index, 0.5, count, 5)
    most, kinds = sigmas(blocks=16, comparisons=21), np.minimum((CLASSES * (1 - cosine**2)).astype(int), CLASSES - 1)
    within = squares < result.edges[-1] ** 2
    scatter = squares[within].std() / math.sqrt(within.sum())
    assert abs(squares[within].mean() - result.mean_square) < most * math.hypot(scatter, result.mean_square_error)
    light, error = result.light.mean(axis=0), np.sqrt((result.light_error**2).sum(axis=0)) / CLASSES
    for out in range(CLASSES):
        for last in (18, len(light[0])):
            share = (squares[kinds == out] < result.edges[last] ** 2).sum() / count
            off = math.hypot(math.sqrt(share * (1 - share) / count), math.sqrt((error[out, :last] ** 2).sum()))
            assert abs(share - light[out, :last].sum()) < most * off


def test_bins_of_deep_layers_on_what_does_not_scatter():
    """Where no transport mean free path is in the way, or none is beyond a deep layer, all edges are numbers."""
    for lower in (layer(0.0, 0.0, 2.0, base=0.5), layer(0.0, 0.0, math.inf), replace(layer(0.0, 0.0, 0.0, base=0.5), length=3.0)):
        for upper in (layer(0.9, 0.5, 1e6), layer(0.9, 0.5, 0.1), layer(0.0, 0.0, 2.0)):
            edges = spread(replace(upper, under=lower), 1, 0, 0, tolerance=1.0).edges
            assert np.isfinite(edges).all() and (np.diff(edges) > 0).all()


def test_parts_of_a_layer_spread_light_as_far_as_it():
    """Also where they say their lengths in other units: a part that is clear, but for a thickness of 0."""
    whole = spread(layer(0.99, 0.5, 5.0, 1.3, 0.2), 1, 0, 0)
    bottom = replace(layer(0.99, 0.5, 4.5, 1.3, 0.2), length=1.0)
    middle = replace(layer(0.0, 0.0, 0.0, 1.3), under=bottom, length=0.0)
    parts = spread(replace(layer(0.99, 0.5, 0.5, 1.3), under=middle), 2, 0, 0)
    np.testing.assert_allclose(parts.edges, whole.edges, rtol=1e-12)
    most = sigmas(blocks=16, comparisons=2)
    assert abs(parts.mean_square - whole.mean_square) < most * math.hypot(parts.mean_square_error, whole.mean_square_error)
    light, error = (np.array([getattr(part, name) for part in (parts, whole)]) for name in ("light", "light_error"))
    assert abs(light[0].sum() - light[1].sum()) < most * math.sqrt((error**2).sum())


@pytest.mark.parametrize(("albedo", "g", "depth", "index", "base"), [
    (0.95, 0.5, 2.0, 1.33, 0.4), (0.9999, 0.6, math.inf, 1.0, None), (0.999, 0.3, 60.0, 1.5, 0.2), (0.9, 0.4, 3.0, 0.8, None)])
def test_as_much_comes_out_as_the_solver_says(albedo, g, depth, index, base):
    """Of every class of incidence; exchanging the classes changes nothing.  Where light leaps, too."""
    slab = layer(albedo, g, depth, index, base)
    result, solution = spread(slab, 1, 0, 0), solve(slab, g ** np.arange(65.0), 64, 1e-4)
    air, most = solution.nodes.air, sigmas(blocks=16, comparisons=40)
    s, weight = np.polynomial.legendre.leggauss(200)
    for k in range(CLASSES):
        mu = np.sqrt(1 - (k + 0.5 + 0.5 * s) / CLASSES)
        back = np.interp(mu, air, solution.albedo - fresnel.reflected(air, index))
        error = math.sqrt((result.light_error[k] ** 2).sum())
        assert abs(0.5 * weight @ back - result.light[k].sum() - (result.beyond if k == 1 else 0)) < most * error + 2e-3
    there, error = result.light.sum(axis=2), np.sqrt((result.light_error**2).sum(axis=2))
    assert np.all(np.abs(there - there.T) <= most * np.hypot(error, error.T))


def test_facets_let_as_much_out():
    """Of light that several facets send on only the sum is right: 2 %."""
    slab = layer(0.95, 0.5, math.inf, 1.4, None, 0.3)
    result, solution = spread(slab, 1, 0, 0), solve(slab, 0.5 ** np.arange(17.0), 16, 1e-3)
    directions = solution.nodes
    mirrored = rough.facets(directions, directions, 1.4, 0.3, 1).mirrored
    back, error = directions.flux @ (solution.albedo - mirrored), math.sqrt((result.light_error**2).sum()) / CLASSES
    assert abs(result.light.sum() / CLASSES - back) < sigmas(blocks=16) * error + 0.02 * back


def test_nothing_is_lost():
    """Of a lossless half space all comes out, next to none of it beyond the last bin.

    Diffuse radiance that varies as exp(ikx) along the face sends 4/3 k transport mean free paths of what falls on it into the
    medium on balance.  So at a distance r as much comes out per area as 4/3 of these over 2 pi r^3, and the mean square within R
    is 4/3 R, but for what is near.
    """
    result = spread(layer(1.0, 0.5, math.inf), 1, 0, 0)
    error = math.sqrt((result.light_error**2).sum()) / CLASSES
    assert abs(result.light.sum() / CLASSES + result.beyond - 1) < sigmas(blocks=16) * math.hypot(error, result.beyond)
    assert 0 <= result.beyond < 0.01 and 0 < result.mean_square_error < 0.03 * result.mean_square
    exact = 4 / 3 * 2.0 * result.edges[-1]
    assert abs(result.mean_square - exact) < sigmas(blocks=16) * result.mean_square_error + 0.01 * exact


def test_a_clear_layer_on_a_base():
    """Light goes down, and up again in another direction: <r^2> is the sum of both mean squared tangents, times the depth's."""
    result = spread(layer(0.0, 0.0, 0.0, base=0.8), 1, 0, 0)
    tangents = -1 - 3 * math.log(2 / 3)  # of directions with a sine squared below 1/3
    off = result.square[0, 0] - 2 * tangents
    assert abs(off) < sigmas(blocks=16) * result.square_error[0, 0] and result.square_error[0, 0] < 0.03
    # the weight of a walk is the base's albedo
    assert np.allclose(result.light.sum(axis=(1, 2)) + [0, 0, CLASSES * result.beyond], 0.8, atol=0.02)


def test_what_nothing_comes_out_of():
    for slab in (layer(0.0, 0.0, math.inf), layer(0.0, 0.0, 5.0), layer(1.0, 0.0, 0.0)):
        result = spread(slab, 1, 0, 0)
        assert not result.light.any() and result.mean_square == result.mean_square_error == result.beyond == 0
        assert profile(result.edges, result.light[0, 0], 0.0) == (0.0, 0.0)


def test_diffuse_light_returns_to_a_plane():
    """Light at rho or further: height exp(-decay rho) / rho; the mean squared distance within one, lossless, in closed form."""
    for decay in (0.0, 0.1):
        rng, blocks = np.random.default_rng(2), []
        for _ in range(16):
            draws = [_return_to_plane(rng, 1.0, 0.0, 0.0, 3.0, 300.0, decay) for _ in range(1000)]
            weight, importance, x, y = np.array(draws).T
            square, light = x * x + y * y, weight * importance
            beyond = [(light * (square > r * r)).mean() for r in (0.0, 4.0, 40.0)]
            blocks.append([*beyond, (light * square * (square < 1e4)).mean()])
        rho = np.sqrt(9.0 + np.array([0.0, 16.0, 1600.0]))
        exact = 3.0 * np.exp(-decay * rho) / rho
        error = np.std(blocks, axis=0, ddof=1) / 4
        assert np.all(np.abs(np.mean(blocks, axis=0)[:3] - exact) <= sigmas(blocks=16, comparisons=7) * error[:3])
        if decay == 0:
            far = math.sqrt(9.0 + 1e4)
            assert abs(np.mean(blocks, axis=0)[3] - 3 * (far - 3) ** 2 / far) < sigmas(blocks=16, comparisons=7) * error[3]
            assert error[3] < 0.03 * 3 * far


@pytest.mark.parametrize("g", [0.0, 0.6, 0.95])
def test_an_even_aureole_keeps_the_transport_mean_free_path(g):
    theta, phase = henyey_greenstein(g)
    (v, _, f, cdf), share = without_aureole(theta, phase)
    step = np.diff(v)
    turned = 2 * math.pi * float(np.sum(step * (v[:-1] * (f[1:] + f[:-1]) / 2 + step * (f[:-1] / 6 + f[1:] / 3))))
    assert (1 - share) * turned == pytest.approx(1 - moments(theta, phase, 1)[1], rel=1e-8)
    assert cdf[-1] == pytest.approx(1) and (f >= 0).all() and (share > 0.5) == (g == 0.95) and (share < 1e-12) == (g == 0)


def test_same_numbers_same_walks():
    slab = layer(0.9, 0.5, math.inf)
    first, again, other = (spread(slab, 1, 0, k) for k in (0, 0, 1))
    assert np.array_equal(first.light, again.light) and not np.array_equal(first.light, other.light)


def test_profile():
    """Its own light comes back; its density integrates to its share; light at one distance is far from it."""
    edges = np.concatenate([[0.0], np.geomspace(0.01, 1e3, 60)])
    light = np.diff(profile_within(edges, 2.5))
    width, misfit = profile(edges, light, 1 - light.sum())
    assert width == pytest.approx(2.5, rel=1e-4) and misfit < 1e-5
    r = np.linspace(1e-6, 7.0, 200_001)
    density = (np.exp(-r / 2.5) + np.exp(-r / 7.5)) / (8 * math.pi * 2.5 * r)
    assert np.trapezoid(2 * math.pi * r * density, r) == pytest.approx(float(profile_within(7.0, 2.5)), rel=1e-6)
    ring = np.where((edges[1:] > 1) & (edges[:-1] <= 1), 1.0, 0.0)
    assert profile(edges, ring, 0.0)[1] > 0.3
