"""Grains drawn by a hash: the published mixing function, uniform rotations, shares of types, independence of neighbours.

Statistical tests have a fixed seed; comparisons are within 5.5 standard errors (4e-8 each), 4e-6 for the file.
"""

import numpy as np
import pytest

from bakery.physics.packing.instances import cumulated_shares, hashed, rotation_matrix, uniforms
from tests.odds import sigmas
from tests.oracles.instances import instances

MASK = (1 << 64) - 1
GOLDEN = 0x9E3779B97F4A7C15
SIGMAS = sigmas(odds=4e-8)


def literal(h):
    h = ((h ^ (h >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    h = ((h ^ (h >> 27)) * 0x94D049BB133111EB) & MASK
    return h ^ (h >> 31)


def literal_uniforms(seed, *words):
    """The text of the module's docstring, in whole numbers of any size."""
    h = literal((seed + GOLDEN) & MASK)
    for word in words:
        h = literal(((h ^ (word & MASK)) + GOLDEN) & MASK)
    return [((literal((h + n * GOLDEN) & MASK) >> 12) + 0.5) / 2**52 for n in range(4)]


def test_the_mixing_function_is_that_of_splitmix64():
    """First outputs of SplitMix64 for the seed 1234567, as Rosetta Code lists them."""
    state, known = 1234567, (6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431,
                             16408922859458223821)
    for value in known:
        state = (state + GOLDEN) & MASK
        assert int(hashed(np.uint64(state))) == value


@pytest.mark.parametrize("place", [(0, 0, 0, 0, 0), (7, 1, -1, 2, 3), (2**64 - 1, -2**63, 2**63 - 1, -5, 4_000_000_000)])
def test_numbers_are_those_of_a_literal_twin(place):
    """Indices of both signs and at the ends of their range."""
    seed, *words = place
    found = uniforms(np.uint64(seed), *(np.int64(w) for w in words))
    assert list(found) == literal_uniforms(seed, *words)
    assert all(0 < u < 1 for u in found)


def places(side=16, spheres=16):
    tile = np.stack(np.meshgrid(*[np.arange(-side // 2, side // 2)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    return tile, np.arange(spheres)[None, :]


def test_rotations_are_uniform():
    """Means of the matrix, of products of its entries, of the squared trace; a turned axis is uniform on the sphere."""
    _, quaternion = instances(3, *places())
    q = quaternion.reshape(-1, 4)
    assert np.allclose(np.sum(q**2, axis=1), 1, atol=1e-14)
    turned = np.array([rotation_matrix(*row) for row in q[:20_000]]).reshape(-1, 3, 3)
    assert np.allclose(np.einsum("nij,nkj->nik", turned, turned), np.eye(3), atol=1e-14)
    assert np.allclose(np.linalg.det(turned), 1, atol=1e-14)
    n = len(turned)
    assert np.all(abs(turned.mean(0)) < SIGMAS * np.sqrt(1 / 3 / n))  # each entry has mean 0, mean square 1/3
    squares = turned**2
    assert np.all(abs(squares.mean(0) - 1 / 3) < SIGMAS * np.sqrt(4 / 45 / n))
    trace = np.trace(turned, axis1=1, axis2=2)
    assert abs(np.mean(trace**2) - 1) < SIGMAS * np.sqrt((3 - 1) / n)  # <trace^4> = 3 over SO(3)
    for axis in turned.transpose(2, 0, 1):  # the z of each turned axis is uniform in -1 ... 1, its azimuth too
        for value in (0.5 * (axis[:, 2] + 1), np.arctan2(axis[:, 1], axis[:, 0]) / (2 * np.pi) + 0.5):
            counts = np.histogram(value, 20, (0, 1))[0]
            chi = np.sum((counts - n / 20) ** 2) / (n / 20)
            assert chi < 19 + SIGMAS * np.sqrt(2 * 19) + 8  # tail of chi^2 with 19 degrees of freedom


def test_neighbours_share_nothing():
    """Correlations of all numbers between places whose index differs by 1 or in sign, or is swapped; and between seeds."""
    side = 24
    k = np.arange(1, side)
    i, j, s = (a.reshape(-1) for a in np.meshgrid(k, k, k, indexing="ij"))

    def drawn(seed, *words):
        kinds, q = instances(seed, np.stack(words[:3], axis=-1), words[3], np.ones(1000))
        return np.concatenate([kinds[:, None] / 999 - 0.5, q], axis=1)

    one = drawn(5, i, j, 0 * i, s)
    o = 0 * i
    for other in ((5, i + 1, j, o, s), (5, i, j + 1, o, s), (5, i, j, o + 1, s), (5, i, j, o, s + 1), (5, -i, j, o, s),
                  (6, i, j, o, s), (5, j, i, o, s + 1), (5, s, j, o, i + 100)):
        other = drawn(*other)
        r = np.corrcoef(one.T, other.T)[:5, 5:]
        assert np.all(abs(r) < SIGMAS / np.sqrt(len(i))), r


def test_types_have_their_shares():
    weights = np.array([0.0, 3.0, 1.0, 0.0, 6.0, 0.0])
    kinds, _ = instances(11, *places(), weights)
    share = np.bincount(kinds.ravel(), minlength=6) / kinds.size
    assert share[0] == share[3] == share[5] == 0
    assert np.all(abs(share - weights / 10) < SIGMAS * np.sqrt(0.25 / kinds.size))
    assert cumulated_shares(np.full(7, 1 / 7))[-1] == 1.0


def test_any_order_and_shape_gives_the_same():
    tile, sphere = places(4, 8)
    kinds, quaternion = instances(2, tile, sphere, [1, 1])
    order = np.random.default_rng(0).permutation(len(tile))
    again = instances(2, tile[order], sphere, [1, 1])
    assert np.array_equal(kinds[order], again[0]) and np.array_equal(quaternion[order], again[1])
    one = instances(2, tile[7, 0], 5, [1, 1])
    assert one[0] == kinds[7, 5] and np.array_equal(one[1], quaternion[7, 5])


@pytest.mark.parametrize("arguments", [(-1, [0, 0, 0], 0), (1 << 64, [0, 0, 0], 0), (0, [0, 0], 0), (0, [0, 0, 0], 0, []),
                                       (0, [0, 0, 0], 0, [-1, 2]), (0, [0, 0, 0], 0, [0, 0]), (0, [0, 0, 0], 0, [np.nan])])
def test_what_is_refused(arguments):
    with pytest.raises(ValueError, match=r"seed|tile|weights"):
        instances(*arguments)
