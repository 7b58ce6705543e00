"""Bodies of grains whose packing fraction and mixture vary: which spheres are there, and the medium that stands for them.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from bakery import kernels
from bakery.physics.packing.instances import left_out
from renderers.materials.grains import medium, transport
from renderers.materials.grains.teleport import Teleports
from tests.odds import ODDS, SIGMAS
from tests.oracles.instances import instances
from tests.physics.particles import Sky, camera, same
from tests.physics.test_aggregate import bumpy, check, listed, rays, tile
from tests.physics.test_granular_medium import MESH, continuous
from tests.physics.test_granular_render import COLOURS, GLASS, NOTHING, STEEL, STONE, Kind, grains, passes, place, through

BODY = bumpy(12.0)
LOW, HIGH = BODY[0].min(axis=0) - 1, BODY[0].max(axis=0) + 1


def grid(values):
    return kernels.field(LOW, HIGH, values)


def test_between_the_middles_of_cells():
    """Trilinear, as SciPy has it, constant in the outer halves; the same number everywhere where all are the same."""
    random = np.random.default_rng(1)
    values = random.random((3, 1, 5)).astype(np.float32)
    found, points = kernels.aggregate(*tile(), *BODY, grid(values)), random.uniform(LOW - 3, HIGH + 3, (50, 3))
    place = ((points - LOW) / (HIGH - LOW) * values.shape - 0.5).T
    expected = map_coordinates(values.astype(float), place, order=1, mode="nearest")
    assert np.allclose([kernels.share_at(found, *point) for point in points], expected, atol=1e-6)
    alike = kernels.aggregate(*tile(), *BODY, grid(np.full((3, 2, 5), np.float32(0.3))))
    assert {kernels.share_at(alike, *point) for point in points} == {float(np.float32(0.3))}


STEP = np.ones((1, 1, 12))
STEP[:, :, 3:10] = 0
STEP[:, :, 10:] = 0.4


@pytest.mark.parametrize("values", [np.full((1, 1, 1), 0.5), STEP], ids=["half", "step"])
def test_spheres_that_are_there(values):
    """Along rays those of the explicit list that the hash keeps, none else; of half of them, as many as chance would have."""
    spheres = tile(0.6)
    found = kernels.aggregate(*spheres, *BODY, grid(values), 7)
    names, centre, radius = listed(*spheres, *BODY)
    share = np.array([kernels.share_at(found, *point) for point in centre])
    keep = np.array([not left_out(np.uint64(7), *name[1:], name[0], s) for name, s in zip(names, share)])
    assert abs(keep.sum() - share.sum()) < SIGMAS * np.sqrt(np.sum(share * (1 - share)) + 1)
    assert not keep[share == 0].any() and keep[share == 1].all()
    assert check(found, (names[keep], centre[keep], radius[keep]), *rays(BODY[0], 300, 3)) > 100
    room, met = kernels.aggregate_scratch(), np.empty(4, np.int64)
    for n in range(0, len(names), 7):
        assert kernels.enclosing_sphere(found, centre[n], met, room) == keep[n]
        assert not keep[n] or met.tolist() == names[n].tolist()
    passed = (kernels.aggregate(*spheres, *BODY).voxels & 4) != (found.voxels & 4)  # voxels without a sphere
    assert passed.any() == (values.min() == 0)


def test_which_grain_where():
    """The hash against the shares at the sphere's centre; the same as everywhere where they are."""
    shares = np.array([[0.0, 0.3, 1.0], [0.5, 0.5, 1.0]]).reshape(2, 1, 1, 3)
    field, number = grid(shares), np.arange(1000)
    for x, expected in ((LOW[0], shares[0]), (HIGH[0], shares[1]), (0.5 * (LOW + HIGH)[0], shares.mean(axis=0))):
        found = [kernels.instance_of(np.uint64(1), n, -n, 0, 3, field, x, 0.0, 0.0)[0] for n in number]
        alike, _ = instances(1, np.stack([number, -number, 0 * number], 1), 3 + 0 * number, np.diff(expected.ravel(), prepend=0))
        assert np.array_equal(found, alike)


def test_nothing_is_lost_among_those_that_are_left():
    """Clear and shiny grains, ever fewer towards the foot, in two mixtures: each path brings 1; with all of them others do."""
    kinds, view = [Kind(GLASS), Kind(STEEL, STONE)], camera((24, 24), (0.0, -60.0, 3.0), (0.0, 0.0, 0.0), 34)
    whole = grains(kinds, BODY)
    left = whole._replace(aggregate=kernels.aggregate(*tile(), *BODY, grid(np.linspace(0, 1, 6).reshape(1, 1, 6))),
                          mixture=grid(np.array([[0.0, 1.0], [1.0, 1.0]]).reshape(1, 1, 2, 2)))
    sums = [transport.one_pass(Sky(above=1, below=1), through(place(one)), view, (24, 24), 0, 0).by_order
            for one in (whole, left)]
    assert all(np.allclose(one.sum(axis=0), 1, rtol=1e-12) for one in sums)
    assert sums[1][0].sum() > 1.05 * sums[0][0].sum()  # seen past the grains


@pytest.mark.slow
def test_teleports_agree():
    """As much light meets no grain among spheres that are drawn as among those that the hash leaves."""
    kinds, view = [Kind(GLASS)], camera((32, 32), (0.0, -60.0, 3.0), (0.0, 0.0, 0.0), 34)
    loose = grid(np.linspace(0, 0.6, 6).reshape(1, 1, 6))
    left = grains(kinds, BODY)._replace(aggregate=kernels.aggregate(*tile(), *BODY, loose))
    found = [[transport.one_pass(Sky(above=1, below=1), through(way), view, (32, 32), number, 0).by_order[0].mean()
              for number in range(20)] for way in (place(left), Teleports(left, NOTHING, COLOURS))]
    assert np.mean(found[0]) < 0.8 and np.mean(found[1]) == pytest.approx(np.mean(found[0]), rel=0.02)


def varied(how, share=None, slack=1.0, second=None):
    """The medium of `continuous` as one that varies: by a field, with flights that are `slack` times as dense as need be.

    second : (3,) extinction of another component over that of the first, with its phase functions in another order
    """
    stands, void, mixture, hits = how.medium, 4 / 3, kernels.uniform_field(), np.ones((1, 3))
    along = np.array([1 / stands.sigma_t - void * 0.4 / 0.6])  # so that extinction at a fraction of 0.6 is just sigma_t
    if second is not None:
        hits, along, mixture = np.array([[1.0] * 3, second]), np.repeat(along, 2, axis=0), kernels.field(*BOX, MIXED)
        stands = stands._replace(albedo=np.tile(stands.albedo, 2), phase=np.concatenate([stands.phase, stands.phase[::-1]]),
                                 cdf=np.concatenate([stands.cdf, stands.cdf[::-1]]))
    made = kernels.varied_medium(share or kernels.uniform_field(), mixture, 0.6, void, hits, along, np.zeros(3))
    return medium.Continuous(stands, how.occupied, how.colours, varied=made._replace(most=slack * made.most))


BOX = MESH[0].min(axis=0), MESH[0].max(axis=0)
MIXED = np.array([[0.0, 1.0], [1.0, 1.0]]).reshape(1, 1, 2, 2)
LOOSE = kernels.field(*BOX, np.linspace(0, 1, 6).reshape(1, 1, 6))


def test_extinction_where_all_are_there():
    """At the tile's fraction the homogeneous medium's, for each wavelength; of few grains, in proportion to their number."""
    how = continuous([0.2, 0.4, 0.6], 0.9)
    found = np.empty((1, 3))
    kernels.extinctions_at(varied(how).varied, 0.0, 0.0, 0.0, found)
    assert np.allclose(found[0], how.medium.sigma_t)
    few = varied(how, kernels.field(*BOX, np.full((1, 1, 1), 1e-4))).varied
    kernels.extinctions_at(few, 0.0, 0.0, 0.0, found)
    assert np.allclose(found[0], 0.6e-4 / (4 / 3), rtol=1e-3)


@pytest.mark.slow
def test_flights_that_meet_nothing():
    """A medium that is the same everywhere, by flights three times as dense: as in closed form, at all wavelengths."""
    how = continuous([0.3, 0.5, 0.9], [0.95, 0.9, 0.7], 0.3)
    view = camera((16, 16), (0.0, -25.0, 3.0), (0.0, 0.0, 0.0), 24)
    one, other = (passes(Sky((1, 1, -1), above=0.5), each, view, (16, 16), range(first, first + 60)).mean(axis=(1, 2))
                  for each, first in ((how, 0), (varied(how, slack=3.0), 500)))
    one, other = (each.reshape(20, 3, 3).mean(axis=1)[:, None] for each in (one, other))
    assert same(one, other) > ODDS and same(one, 1.15 * other) < ODDS


@pytest.mark.slow
def test_nothing_is_lost_where_it_varies():
    """Lossless, two components, ever fewer grains towards the foot: in light from everywhere 1 at all wavelengths."""
    how = varied(continuous([0.3, 0.5, 0.8], 1.0, [0.0, 0.3, 0.6]), LOOSE, second=[0.6, 0.8, 0.3])
    found = passes(Sky(above=1, below=1), how, camera((24, 24), (0.0, -25.0, 3.0), (0.0, 0.0, 0.0), 34), (24, 24), range(40))
    mean = found.mean(axis=(1, 2))
    error = mean.std(axis=0, ddof=1) / np.sqrt(40)
    assert error.max() < 6e-3 and np.all(np.abs(mean.mean(axis=0) - 1) < SIGMAS * error)
