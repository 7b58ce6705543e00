"""Paths that switch from grains to their medium, and go from one body into another.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from bakery import kernels
from renderers.materials.grains import bundles, material, medium, methods, paths, shapes, transport
from renderers.materials.grains._medium import Medium
from renderers.materials.grains._paths import PASSES
from renderers.pictures import engine
from renderers.transport.steps import light_choices
from tests.odds import ODDS, SIGMAS, sigmas
from tests.physics.particles import THETA, Sky, blocks, camera, henyey_greenstein, same
from tests.physics.test_aggregate import CUBE, tile
from tests.physics.test_granular_render import COLOURS, GLASS, MATT, NOTHING, STONE, Kind, bumpy, grains, passes

VIEW = camera((24, 24), (0.0, -40.0, 3.0), (0.0, 0.0, 0.0), 34)


def joined(bodies, technique=transport.GRAINS, spread=4.0, albedo=1.0):
    """How light goes through bodies of grains and isotropic media, each with the extinction 0.4."""
    made = []
    for one in bodies:
        v, steps, phase, cdf = kernels.phase_layout(THETA, henyey_greenstein(0.0))
        aggregate = one.aggregate
        stands = Medium(aggregate, one.unit, np.full(3, 0.4), np.full(3, float(albedo)), v, steps, np.array([phase] * 3),
                        np.array([cdf] * 3), material.seldom(aggregate, 0.4))
        around = NOTHING
        if len(bodies) > 1:  # everywhere
            around = np.ones(aggregate.voxels.shape, np.uint8)
        made.append(transport.Body(paths.Explicit(one, around, COLOURS), medium.Continuous(stands, around, COLOURS),
                                   material.radius_of(one)))
    switch = spread if technique == transport.GRAINS else None
    return transport.Transport(tuple(made), COLOURS, technique, switch)


def halves(size, x=0.3):
    """Two boxes that touch at x, in place of one, and that one."""
    vertices, faces = CUBE
    whole = 2 * size * (vertices - 0.5)
    left, right = whole.copy(), whole.copy()
    left[:, 0] = np.minimum(left[:, 0], x)
    right[:, 0] = np.maximum(right[:, 0], x)
    return [(left, faces), (right, faces)], (whole, faces)


# ---- bundles


def test_bundles_are_squares_of_pixels():
    order = bundles.by_bundle(6, 9)
    assert sorted(order) == list(range(54)) and set(order[:16]) == {9 * y + x for y in range(4) for x in range(4)}
    assert set(order[-2:]) == {9 * y + 8 for y in (4, 5)}


def test_when_paths_switch():
    """Spread over tau N_k / N, each bundle by itself, and a path that is left alone."""
    pixel = np.array([0, 1, 2, 3, 4, 5, 6])  # of two bundles in a picture 8 wide: four and three paths
    place = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [9, 9, 9], [9, 9, 9], [9, 9, 9]], float)
    spread = np.sqrt((place[:4].var(axis=0)).sum())
    # spread = tau N_k / N times the radius
    assert np.array_equal(bundles.due(4.0, pixel, place, np.full(7, spread), (8, 8)), [False] * 7)
    assert np.array_equal(bundles.due(4.0, pixel, place, np.full(7, 0.999 * spread), (8, 8)), [True] * 4 + [False] * 3)
    assert bundles.due(4.0, pixel[:1], place[:1], np.full(1, 1e9), (8, 8)).all()


# ---- switching


@pytest.mark.slow
def test_nothing_is_lost_where_paths_switch():
    """Lossless grains and media in light from everywhere: 1, whoever switches when, also by passes of light before and after."""
    kinds = [Kind(GLASS), Kind(MATT, STONE)]
    how = joined([grains(kinds, bumpy(9.0), tile(0.5, 40))])
    sky = Sky(above=1, below=1)
    rarer = how._replace(share=0.25)
    ways = (how, transport.ALL), (how, transport.BEFORE), (how, transport.AFTER), (rarer, transport.AFTER)
    found, *apart, few = [[transport.one_pass(sky, way, VIEW, (24, 24), number, which, which) for number in range(24)]
                          for way, which in ways]
    whole, before, after, by_chance = [np.array([one.by_order.mean() * len(one.by_order) for one in part])
                                       for part in (found, *apart, few)]
    for mean in (whole, before + after, before + by_chance):
        error = mean.std(ddof=1) / np.sqrt(len(mean))
        assert error < 0.03 and abs(mean.mean() - 1) < SIGMAS * error
    assert not any(one.by_technique[1:].any() for one in apart[0]) and not any(one.by_technique[0].any() for one in apart[1])
    parts = np.mean([one.by_technique.sum(axis=(1, 2)) for one in found], axis=0)
    assert parts[:2].min() > 0.05 * parts.sum() and np.isclose(parts.sum(), sum(one.by_order.sum() for one in found) / len(found))
    switched = np.sum([one.switched for one in found], axis=0)
    assert switched[:, 0].sum() > 1.5 * switched[:, 1].sum() > 0, "they switch after some grains"


def test_the_first_grain_is_explicit():
    """However far away: no path switches before it has met a grain, also where a bundle is wider than the body."""
    one = grains([Kind(GLASS)], bumpy(9.0))
    far = camera((24, 24), (0.0, -4000.0, 300.0), (0.0, 0.0, 0.0), 1)
    sums = transport.one_pass(Sky(above=1, below=1), joined([one]), far, (24, 24), 0, 0)
    count = sums.switched[sums.switched[:, 1] > 0, 0]
    assert len(count) > 10 and np.all(count >= 1)


def test_lights_are_shared_out_among_samples_and_neighbours():
    """At first surfaces: of two lights each has half of the samples of a pixel, and half of 4 x 4 pixels to within two; over
    passes each number is as likely as any other."""
    size, samples, passes = (32, 48), 4, 256
    pixel = np.arange(samples * size[0] * size[1])
    begun = paths.starting(np.zeros((len(pixel), 3)), np.ones((len(pixel), 3)), 3, np.zeros(len(pixel), np.uint64), pixel, 0)
    numbers = np.empty((passes, samples, *size))
    for number in range(passes):
        choices = light_choices(size, int(kernels.stream_key(1, "render.grains", 0, number)) / 2**64)
        numbers[number] = transport.Sums(choices, 0, transport.ALL, samples).light_choices(begun).reshape(samples, *size)
    assert numbers.min() >= 0 and numbers.max() < 1
    second = numbers >= 0.5
    assert np.all(second.sum(axis=1) == samples // 2)
    blocks = second[:, 0].reshape(passes, 8, 4, 12, 4).sum(axis=(2, 4))
    assert np.all(abs(blocks - 8) <= 2)
    deviation = np.sqrt(passes / 12)
    assert np.all(abs(numbers.sum(axis=0) - passes / 2) < sigmas(comparisons=numbers[0].size) * deviation)


def test_paths_that_go_on_by_chance():
    """A share of those that switch, each of which counts the more."""
    how, n = joined([grains([Kind(GLASS)], bumpy(9.0))]), 4000
    how = how._replace(share=0.25)
    states = np.arange(n, dtype=np.uint64) * np.uint64(7919)
    some = paths.starting(np.zeros((n, 3)), np.tile([0.0, 0.0, 1.0], (n, 1)), 3, states, np.arange(n), transport.GRAINS)
    some.body[:] = 0
    onward = transport.joined(transport._switched(Sky(), how, some, transport.Sums(np.zeros(n), 0, transport.AFTER)))
    assert np.all(onward.throughput == 4) and abs(onward.count / n - 0.25) < SIGMAS * np.sqrt(0.25 * 0.75 / n)


@pytest.mark.parametrize("share, late, brings", [(0.5, 2, {0.0, 1.0, 2.0}), (0.25, 1, {0.0, 1.0, 4.0})])
def test_long_paths_among_grains_go_on_by_chance(share, late, brings):
    """A share of them after some grains: each brings light from everywhere, that of others too, or nothing, and the mean is 1."""
    how = transport.Transport((joined([grains([Kind(GLASS)], bumpy(9.0))]).bodies), COLOURS, share=share, late=late)
    pictures = np.round([transport.one_pass(Sky(above=1, below=1), how, VIEW, (24, 24), number, 0).by_order.sum(axis=0)
                         for number in range(48)], 9)
    error = pictures[..., 0].std() / np.sqrt(pictures[..., 0].size)
    assert set(np.unique(pictures)) == brings and np.mean(pictures == 1 / share) > 0.05
    assert abs(pictures.mean() - 1) < SIGMAS * error < 0.05


@pytest.mark.parametrize("seconds, followed", [(60.0, (1.0, 2)), (4.0, (0.5, 2)), (2.0, (0.5, 2)), (0.9, (1 / 6, 2))])
def test_the_shorter_a_render_the_fewer_long_paths_it_follows(monkeypatch, seconds, followed):
    """Where a pass meets a million grains."""
    asked, how = [], transport.Transport((joined([grains([Kind(GLASS)], bumpy(9.0))]).bodies), COLOURS)
    world = SimpleNamespace(size=(512, 512), camera=VIEW, corners=None)
    monkeypatch.setattr(shapes, "fit", lambda *_: False)
    monkeypatch.setattr(methods, "_layers", lambda *_: {})
    monkeypatch.setattr(transport, "one_pass", lambda _world, scene, *_: asked.append((scene.share, scene.late)))
    engine.in_time([methods.part(world, how, "ept", 0, meetings=20.0)], seconds)[0].render(0)
    assert asked == [followed]


def test_paths_of_many_steps_end_by_chance(monkeypatch):
    """White matt grains ask for a light sample at each: there are fewer steps, and the mean stays 1."""
    monkeypatch.setattr(transport, "_LEAST", 1 / 8)  # with fewer light samples there are fewer steps in any case
    how = transport.Transport(joined([grains([Kind(MATT)], bumpy(9.0))]).bodies, COLOURS, share=0.25)
    counts, on = [], transport._on
    monkeypatch.setattr(transport, "_on", lambda *step: (counts.append(step[2].count), on(*step))[1])
    taken = []
    for steps, n in ((10**9, 4), (2, 48)):
        monkeypatch.setattr(transport, "_STEPS", steps)
        counts.clear()
        found = [transport.one_pass(Sky(above=1, below=1), how, VIEW, (24, 24), number, 0).by_order.sum(axis=0).mean()
                 for number in range(n)]
        taken.append(len(counts) / n)
    error = np.std(found, ddof=1) / np.sqrt(n)
    assert error < 0.02 and abs(np.mean(found) - 1) < sigmas(n) * error and taken[1] < 0.7 * taken[0]


def test_what_grains_do_not_turn_goes_on():
    """A share of the paths that switch at a grain goes on as it came, where the medium lets such a share pass; weights stay."""
    how = joined([grains([Kind(GLASS)], bumpy(9.0))])
    body = how.bodies[0]
    passed, found = np.array([0.0, 0.3, 1.0]), []
    for share in passed:
        stands = medium.Continuous(body.medium.medium._replace(turned=np.full(3, 1 - share)), NOTHING, COLOURS)
        n = 4000
        states = np.arange(n, dtype=np.uint64) * np.uint64(7919)
        some = paths.starting(np.zeros((n, 3)), np.tile([0.0, 0.0, 1.0], (n, 1)), 3, states, np.arange(n), transport.GRAINS)
        status = stands.arrive(some).status
        found.append(np.mean(status == PASSES))
        assert np.allclose(some.throughput, 1) and np.array_equal(some.order, status != PASSES)
        assert np.array_equal(some.single, status == PASSES)
    assert np.allclose(found, passed, atol=5.4 * np.sqrt(0.25 / n))


# ---- several bodies


@pytest.mark.parametrize("technique", [transport.GRAINS, transport.MEDIUM], ids=["grains", "media"])
def test_bodies_that_touch_are_as_one(technique):
    """Balls of the host's index, or media, that only absorb: exactly the light of one body, through whichever they pass."""
    parts, whole = halves(5.0)
    kinds = [Kind(kernels.dielectric(1.0))]
    pictures = []
    for meshes in (parts, [whole]):
        bodies = [grains(kinds, mesh, tile(0.5, 40), absorption=0.2) for mesh in meshes]
        how = joined(bodies, technique, albedo=0.0)._replace(switch=None)
        if technique == transport.MEDIUM:
            point = np.tile(VIEW.origin, (576, 1))
            pictures.append(transport.transmittance(how, technique, point, VIEW.rays(24, 24).reshape(-1, 3), np.full(576, 1e12)))
        else:
            pictures.append(passes(Sky(above=1, below=1), how, VIEW, (24, 24), [0]))
    assert np.allclose(pictures[0], pictures[1], rtol=1e-9) and pictures[0].min() < 0.2


def test_ways_to_one_body_alone_are_not_looked_along_twice(monkeypatch):
    """Clear grains in two cubes apart: the same picture, to the last bit, as where all ways are looked along beforehand."""
    vertices, faces = CUBE
    meshes = [(4 * (vertices - 0.5) + [x, 0, 0], faces) for x in (-3.5, 3.5)]
    how = joined([grains([Kind(GLASS)], mesh, tile(0.5, 40), absorption=0.2) for mesh in meshes])._replace(switch=None)
    looked, entry = [], paths.Explicit.entry

    def counted(body, point, *way):
        looked.append(len(point))
        return entry(body, point, *way)

    monkeypatch.setattr(paths.Explicit, "entry", counted)
    pictures, counts = [], []
    for reached in (paths.Explicit.reached, lambda body, point, direction, far: np.ones(len(point), bool)):
        monkeypatch.setattr(paths.Explicit, "reached", reached)
        looked.clear()
        pictures.append(passes(Sky(above=1, below=0.2), how, VIEW, (24, 24), [0]))
        counts.append(sum(looked))
    assert np.array_equal(*pictures) and pictures[0].std() > 0.1 and counts[0] < 0.3 * counts[1]


@pytest.mark.slow
@pytest.mark.parametrize("technique", [transport.GRAINS, transport.MEDIUM], ids=["grains", "media"])
def test_light_goes_from_body_to_body(technique):
    """Matt grains and media in the sun, in two bodies or in one: the same blocks of the picture, and not if one were missing."""
    parts, whole = halves(4.0)
    kinds, pictures = [Kind(kernels.diffuse(0.8))], []
    for meshes, first in ((parts, 0), ([whole], 100), (parts[:1], 200)):
        how = joined([grains(kinds, mesh, tile(0.5, 40)) for mesh in meshes], technique, albedo=0.9)._replace(switch=None)
        pictures.append(blocks(passes(Sky((1, 1, -1), above=0.5), how, VIEW, (24, 24), range(first, first + 60)), (6, 6)))
    two, one, half = (found.reshape(10, 6, *found.shape[1:]).mean(axis=1) for found in pictures)
    assert same(two, one) > ODDS and same(half, one) < ODDS
