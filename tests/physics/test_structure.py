"""What tiles look like: crystals that are known in every digit, random arrangements with exact laws, theory of the fluid."""

import math

import mpmath
import numpy as np
import pytest

from bakery.physics.packing import structure
from bakery.physics.packing.radii import lognormal, room, species
from bakery.physics.packing.theory import mean_chord
from tests.conftest import slow
from tests.oracles import packing as theory

CORNERS = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])


def fcc(n: int, gap: float = 0.0):
    """Face-centred cubic spheres of radius 1, n^3 cubes; `gap` in diameters."""
    edge = 2 * math.sqrt(2) * (1 + gap)
    grid = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    return ((grid + CORNERS).reshape(-1, 3) * edge), np.ones(4 * n**3), np.full(3, n * edge)


def stream(index):
    return np.random.default_rng([5, index])


def test_neighbours_are_those_of_brute_force():
    """Any radii, a flat cell, more than one image: against a loop over all pairs and 5 x 5 x 9 images."""
    rng = np.random.default_rng(1)
    radii, cell = rng.choice([0.1, 0.35, 1.0], 25), np.array([5.0, 4.0, 1.5])
    centers = rng.random((25, 3)) * cell
    shifts = np.stack(np.meshgrid(*[np.arange(-k, k + 1) for k in (2, 2, 4)], indexing="ij"), -1).reshape(-1, 3)
    expected = set()
    for i in range(25):
        for j in range(25):
            away = centers[j] + shifts * cell - centers[i]
            distance = np.linalg.norm(away, axis=1)
            near = (distance <= 0.2 + 1.3 * (radii[i] + radii[j])) & ((i != j) | (distance > 0))
            expected |= {(i, j, *np.round(a, 9)) for a in away[near]}
    found = [(i, j, *np.round(v, 9)) for part in structure.neighbours(centers, radii, cell, 0.2, 1.3)
             for i, j, v in zip(*part[:3], strict=True)]
    assert len(found) == len(set(found)) and set(found) == expected


@pytest.mark.parametrize("n, gap", [(1, 0.0), (2, 0.01), (3, 0.2)])
def test_face_centred_crystal(n, gap):
    """12 contacts, no rattlers, Q6 of Steinhardt et al., fraction pi/sqrt(18); also where the cell is two spheres wide."""
    centers, radii, cell = fcc(n, gap)
    assert structure.smallest_gap(centers + 0.3, radii, cell) == pytest.approx(gap, abs=1e-12)
    assert structure.fraction(radii, cell) == pytest.approx(math.pi / math.sqrt(18) / (1 + gap) ** 3, rel=1e-12)
    touching = structure.contacts(centers, radii, cell)
    assert (touching.mean, touching.rattlers) == ((12.0, 0.0) if gap == 0 else (0.0, 1.0)) and touching.error == 0
    order = structure.bond_order(centers, radii, cell)
    assert structure.global_bond_order(centers, radii, cell) == pytest.approx(order.q6, rel=1e-12)
    assert order.bonds == 12 and order.q6 == pytest.approx(0.57452, abs=1e-5) == pytest.approx(order.local, abs=1e-5)


def test_bond_order_of_other_crystals():
    cubic = structure.bond_order(np.zeros((1, 3)), np.ones(1), np.full(3, 2.0))
    assert cubic.bonds == 6 and cubic.q6 == pytest.approx(1 / math.sqrt(8), abs=1e-12)
    # hexagonal close packing in a right-angled cell of four
    cell = np.array([2.0, 2 * math.sqrt(3), 4 * math.sqrt(2 / 3)])
    centers = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 1 / 6, 0.5], [0, 2 / 3, 0.5]]) * cell
    hexagonal = structure.bond_order(centers, np.ones(4), cell)
    assert hexagonal.bonds == 12 and hexagonal.q6 == pytest.approx(0.48476, abs=1e-5)
    rng = np.random.default_rng(2)
    points = structure.bond_order(rng.random((4000, 3)) * 40, np.full(4000, 1.0), np.full(3, 40.0))
    # bonds of one point to another count twice, so sqrt(13) Q6 sqrt(bonds / 2) has the square of a chi-square mean of 13
    assert points.q6 < 2 * points.random(4000)


def test_rattlers_are_left_out_one_by_one():
    """A chain that hangs on a crystal's hole: each ball looses hold when its neighbour is gone."""
    centers, radii, cell = fcc(2)
    kept = np.delete(np.arange(32), 5)
    assert structure.contacts(centers[kept], radii[kept], cell).rattlers == 0
    loose = np.vstack([centers[kept], centers[5]])
    sizes = np.append(radii[kept], 0.9)
    found = structure.contacts(loose, sizes, cell)
    assert found.rattlers == pytest.approx(1 / 32) and found.mean == pytest.approx((20 * 12 + 12 * 11 - 12 + 0) / 32, abs=0.4)


def test_overlap_of_any_size_is_seen():
    centers, radii, cell = fcc(2, 0.05)
    for depth in (1e-12, 1e-9, 1e-3, 0.5):
        moved = centers.copy()
        moved[3] += (moved[0] - moved[3]) * ((0.05 + depth) / 1.05)
        assert structure.smallest_gap(moved, radii, cell) == pytest.approx(-depth, rel=1e-2, abs=1e-13)
    assert structure.smallest_gap(np.zeros((1, 3)), np.ones(1), [1.9, 5, 5]) == pytest.approx(-0.05)
    assert structure.smallest_gap(np.zeros((1, 3)), np.ones(1), [200.0, 300, 400]) == pytest.approx(99)


# ---- pair correlation


def test_pair_correlation_of_random_points_is_one():
    """Poisson points, whose pairs have Poisson's variance exactly: means and errors from 40 sets of 24 bins.

    Errors are the larger of two estimates, so a little too large.  The odds of z outside are below 1e-6: chi-square of 960 is
    within 23 % of its mean, and the mean of 960 deviates within 0.16.
    """
    rng = np.random.default_rng(3)
    cell, edges = np.array([12.0, 15.0, 18.0]), np.linspace(0.5, 2.9, 25)
    found = [structure.pair_correlation(rng.random((400, 3)) * cell, np.ones(400), cell, edges) for _ in range(40)]
    z = np.array([(g.g - 1) / g.g_error for g in found])
    assert 0.6 < np.mean(z**2) < 1.2 and abs(z.mean()) < 0.16


def test_pair_correlation_counts_shells_of_a_crystal():
    centers, radii, cell = fcc(4, 0.0)
    edges = np.array([1.9, 2.1, 2.7, 2.9, 3.3, 3.6])
    found = structure.pair_correlation(centers, radii, cell, edges)
    count = radii.size
    numbers = found.g * (count - 1) / np.prod(cell) * 4 / 3 * np.pi * np.diff(edges**3)
    assert numbers == pytest.approx([12, 0, 6, 0, 24], abs=1e-9)
    with pytest.raises(ValueError, match="no pairs"):
        structure.pair_correlation(np.zeros((1, 3)), np.ones(1), np.full(3, 9.0), edges)


def test_species_are_seen_together():
    rng = np.random.default_rng(4)
    cell, radii = np.full(3, 10.0), rng.choice([0.1, 0.2, 0.9], 200)
    centers, edges = rng.random((200, 3)) * cell, np.array([0.0, 1.0, 2.0, 4.0])
    alone = structure.pair_correlation(centers, np.ones(200), cell, edges)
    assert (structure.pair_correlation(centers, radii, cell, edges).g == alone.g).all()


# ---- theory


def wertheim(x, f):
    """Percus-Yevick's g2 at x diameters as the sum over residues, in 40 digits (Smith & Henderson, Mol. Phys. 19, 411 (1970))."""
    with mpmath.workdps(40):
        x, f = mpmath.mpf(x), mpmath.mpf(f)
        cubic = [(1 - f) ** 2, 6 * f * (1 - f), 18 * f**2, -12 * f * (1 + 2 * f)]
        roots = [mpmath.findroot(lambda t: mpmath.fdot(zip(cubic, (t**3, t**2, t, 1), strict=True)), complex(root))
                 for root in np.roots([float(c) for c in cubic])]
        total = mpmath.mpf(0)
        for n in range(1, int(x) + 1):
            for i, root in enumerate(roots):
                a, b = (roots[j] for j in range(3) if j != i)
                term = mpmath.taylor(lambda t, a=a, b=b, n=n: t * mpmath.exp(t * (x - n)) * (
                    ((1 + f / 2) * t + 1 + 2 * f) / ((1 - f) ** 2 * (t - a) * (t - b))) ** n, root, n - 1)[n - 1]
                total += (-12 * f) ** (n - 1) * term
        return float(mpmath.re(total / x))


@pytest.mark.parametrize("fraction", [0.01, 0.3, 0.5])
def test_percus_yevick(fraction):
    for x in (1, 1.3, 2.4, 3.3):
        assert theory.percus_yevick(2 * x, fraction) == pytest.approx(wertheim(x, fraction), abs=1e-12)
    assert theory.percus_yevick(np.array([1.0, 1.99]), fraction).tolist() == [0, 0]
    # the compressibility equation of the closure
    edges = np.linspace(2, 100, 5000)
    h = theory.in_bins(lambda r: theory.percus_yevick(r, fraction) - 1, edges)
    integral = fraction * (np.sum(h * np.diff(edges**3)) - 8)
    assert 1 + integral == pytest.approx((1 - fraction) ** 4 / (1 + 2 * fraction) ** 2, abs=1e-6)


def test_equation_of_state():
    """The figures of granular.md's table (public numbers 19), and the virial theorem Z = 1 + 4 f g(contact)."""
    for f, z in ((0.1, 1.521), (0.3, 3.974), (0.5, 13.0)):
        assert theory.carnahan_starling(f) == pytest.approx(z, abs=1e-3)
        assert theory.carnahan_starling(f) == pytest.approx(1 + 4 * f * theory.contact_value(f), rel=1e-14)
        assert theory.verlet_weis(2.0, f) == pytest.approx(theory.contact_value(f), rel=1e-12)
        # S(0) = 1 / (d(f Z)/df)
        slope = ((f + 1e-5) * theory.carnahan_starling(f + 1e-5) - (f - 1e-5) * theory.carnahan_starling(f - 1e-5)) / 2e-5
        assert theory.compressibility(f) == pytest.approx(1 / slope, rel=1e-7)


# ---- chords


def test_chords_of_a_cubic_lattice():
    """One sphere a cell, which meets its own images only: 4 V/S within 5 standard errors; corridors have no end."""
    from bakery.physics.packing import _chords
    from bakery.physics.packing.cells import tile_grid

    cell, center, one = np.full(3, 2.5), np.array([[0.1, 2.4, 0.3]]), np.ones(1)
    found = structure.chord_lengths(center, one, cell, 0.02, stream)
    assert found.exact == pytest.approx((2.5**3 - 4 / 3 * math.pi) / math.pi, rel=1e-12)  # 4 V/S with S = 4 pi
    assert abs(found.mean - found.exact) < 5 * found.mean_error
    m = np.array([1, 1, 1])
    grid = tile_grid(center, one, cell, m)[:2]
    o, d = np.array([1.35, 1.15, 0.0]), np.array([0.0, 0.0, -1.0])
    assert _chords.first_hit(o, d, cell, m, *grid, 1e4) == 1e4
    o = np.array([0.1, -0.1, 1.55])  # half-way between a sphere and its image
    assert _chords.first_hit(o, d, cell, m, *grid, 1e4) == pytest.approx(0.25, abs=1e-12)


def test_chords_against_brute_force():
    """Three species in a flat cell: each ray against all images, one by one."""
    from bakery.physics.packing import _chords
    from bakery.physics.packing.cells import tile_grid

    rng = np.random.default_rng(6)
    cell, radii = np.array([5.0, 6.0, 2.4]), np.array([1.0, 0.3, 0.6, 0.2, 0.5, 0.4])
    centers = np.zeros((6, 3))
    while structure.smallest_gap(centers, radii, cell) < 0.01:
        centers = rng.random((6, 3)) * cell
    m = np.array([3, 4, 2])
    grid = tile_grid(centers, radii, cell, m)[:2]
    shifts = np.stack(np.meshgrid(*[np.arange(-k, k + 1) for k in (4, 4, 8)], indexing="ij"), -1).reshape(-1, 3) * cell
    images, sizes = (centers[:, None] + shifts).reshape(-1, 3), np.repeat(radii, len(shifts))
    for _ in range(200):
        o, d = rng.random(3) * cell, rng.standard_normal(3)
        d /= np.linalg.norm(d)
        if (np.linalg.norm(images - o, axis=1) < sizes).any():
            continue
        along = (images - o) @ d
        inside = sizes**2 - np.sum((images - o - along[:, None] * d) ** 2, axis=1)
        hit = along[(inside > 0) & (along > 0)] - np.sqrt(inside[(inside > 0) & (along > 0)])
        expected = min(hit.min(initial=15.0), 15.0)
        assert _chords.first_hit(o.copy(), d, cell, m, *grid, 15.0) == pytest.approx(expected, abs=1e-9)


def test_rays_that_start_on_or_in_a_sphere():
    """On the surface that is left, or a rounding inside: passed over.  In a sphere whose centre lies ahead: met at once."""
    from bakery.physics.packing import _chords
    from bakery.physics.packing.cells import tile_grid

    cell, m = np.array([6.0, 6.0, 6.0]), np.array([3, 3, 3])
    grid = tile_grid(np.array([[3.0, 3.0, 3.0]]), np.ones(1), cell, m)[:2]

    def way(x, y=3.0, turn=1.0):
        return _chords.first_hit(np.array([x, y, 3.0]), np.array([turn, 0.0, 0.0]), cell, m, *grid, 1e4)

    for start in (4.0, 4.0 - 1e-12, 3.5, 3.01):
        assert way(start) == pytest.approx(8 - start, rel=1e-12)  # of the next image
    assert [way(start) for start in (2.99, 2.5, 2.0 + 1e-12)] == [0, 0, 0]
    assert way(1.99) == pytest.approx(0.01, rel=1e-9) and way(1.5, turn=-1.0) == pytest.approx(3.5, rel=1e-12)
    # near the rim: met 0.99 of the radius off the centre, missed at 1.01
    assert way(1.5, y=3.99) == pytest.approx(1.5 - math.sqrt(1 - 0.99**2), rel=1e-12) and way(1.5, y=4.01) == 1e4


def test_chords_start_on_spheres_and_end_at_the_next():
    """The law of starts and every sum: each line by itself against all images, touching spheres among them."""
    from bakery.physics.packing import _chords
    from bakery.physics.packing.cells import tile_grid

    rng = np.random.default_rng(11)
    cell, radii = np.array([4.0, 5.0, 4.5]), np.array([1.0, 0.5, 0.7])
    centers = np.array([[1.0, 1.0, 1.0], [2.5, 1.0, 1.0], [1.0, 3.2, 2.9]])  # the first two touch
    share, m, limit = np.cumsum(radii**2) / np.sum(radii**2), np.array([3, 4, 3]), 12.0
    edges, uniform = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0]), rng.random((300, 5))
    tile = _chords.Tile(centers, radii, share, cell, m, *tile_grid(centers, radii, cell, m)[:2])
    found = _chords.chords(uniform, tile, edges, limit)
    shifts = np.stack(np.meshgrid(*[np.arange(-4, 5)] * 3, indexing="ij"), -1).reshape(-1, 3) * cell
    images, sizes = (centers[:, None] + shifts).reshape(-1, 3), np.repeat(radii, len(shifts))

    def unit(a, b):
        return np.array([math.sqrt(1 - (2 * a - 1) ** 2) * f(2 * math.pi * b) for f in (math.cos, math.sin)] + [2 * a - 1])

    lengths = []
    for which, *pairs in uniform:
        i = int(np.argmax(which < share))
        normal = unit(*pairs[:2])
        start, way = centers[i] + radii[i] * normal, normal + unit(*pairs[2:])
        way /= np.linalg.norm(way)
        along = (images - start) @ way
        inside = sizes**2 - np.sum((images - start - along[:, None] * way) ** 2, axis=1)
        met = (inside > 0) & (along > 0)
        lengths.append(min(np.min(along[met] - np.sqrt(inside[met]), initial=limit), limit))
    lengths = np.maximum(lengths, 0)
    assert (found[0] == np.histogram(np.minimum(lengths, 7.9), edges)[0]).all()
    assert found[1] == pytest.approx([np.sum(lengths**k) for k in range(1, 5)], rel=1e-9)
    assert found[2] == pytest.approx(lengths.max(), rel=1e-12) and found[3] == np.sum(lengths >= limit)


@pytest.mark.parametrize("radii, edge", [slow(np.ones(200), 14.0), (lognormal(1.4, 200), 16.0)])
def test_mean_chord_is_four_volumes_over_surface(radii, edge):
    """Exact for any arrangement; the sampled mean within 5 standard errors (odds 6e-7), all bins add up, the error as asked."""
    centers, cell = inserted(radii, edge, 7)
    found = structure.chord_lengths(centers, radii, cell, 0.02, stream)
    assert abs(found.mean - found.exact) < 5 * found.mean_error
    assert found.exact == pytest.approx(4 * (np.prod(cell) - 4 / 3 * np.pi * np.sum(radii**3)) / (4 * np.pi * np.sum(radii**2)))
    assert np.sum(found.density * np.diff(found.edges)) == pytest.approx(1, abs=1e-12)
    assert found.error <= 0.02 * 1.05 and found.cut == 0
    # the mean from the bins' law agrees with the mean of chords to the width of bins
    middle = 0.5 * (found.edges[1:] + found.edges[:-1])
    assert np.sum(found.density * np.diff(found.edges) * middle) == pytest.approx(found.mean, rel=0.03)
    # a seeded defect: one radius of the 200 forgotten shifts the mean far beyond its error
    wrong = mean_chord(structure.fraction(0.98 * radii, cell), 0.98 * radii)
    assert abs(found.mean - wrong) > 5 * found.mean_error


def test_errors_of_chords_are_those_of_repeats(monkeypatch):
    """16 repeats with other streams scatter as their errors say: chi-square of 15 in 2.5 .. 50, odds of a false alarm 2e-5."""
    monkeypatch.setattr(structure, "_LINES", 1 << 12)  # of a task, of which there are eight at least
    radii = np.ones(60)
    centers, cell = inserted(radii, 9.0, 8)
    runs = [structure.chord_lengths(centers, radii, cell, 0.2, lambda i, k=k: np.random.default_rng([k, i]), most=1 << 18)
            for k in range(16)]
    for value, error in (("mean", "mean_error"), ("spread", "spread_error")):
        values, errors = (np.array([getattr(run, name) for run in runs]) for name in (value, error))
        assert 2.5 < np.sum((values - values.mean()) ** 2) / np.mean(errors**2) < 50
    bins = np.array([run.density for run in runs])[:, :20]
    ratio = np.var(bins, axis=0, ddof=1) / np.mean([run.density_error[:20] ** 2 for run in runs], axis=0)
    assert 0.6 < ratio.mean() < 1.6


def test_error_of_the_spread_is_that_of_its_moments():
    """Covariance of the first two moments of the chords, through the slope of <z^2>/(2 <z>^2) by differences."""
    from bakery.physics.packing import _chords
    from bakery.physics.packing.cells import tile_grid

    radii = np.ones(20)
    centers, cell = inserted(radii, 7.0, 8)
    found = structure.chord_lengths(centers, radii, cell, 0.5, stream, most=1 << 18)
    m = np.array([2, 2, 2])
    tile = _chords.Tile(centers, radii, np.arange(1, 21) / 20, cell, m, *tile_grid(centers, radii, cell, m)[:2])
    uniform = np.concatenate([stream(k).random((1 << 15, 5)) for k in range(8)])
    z = _chords.chords(uniform, tile, found.edges, 1000 * found.exact)[1] / found.lines
    assert found.lines == len(uniform) and found.mean == pytest.approx(z[0], rel=1e-12)
    covariance = np.array([[z[1] - z[0] ** 2, z[2] - z[0] * z[1]], [z[2] - z[0] * z[1], z[3] - z[1] ** 2]]) / found.lines
    h = 1e-5

    def spread(first, second):
        return second / (2 * first**2)

    slope = np.array([spread(z[0] + h, z[1]) - spread(z[0] - h, z[1]), spread(z[0], z[1] + h) - spread(z[0], z[1] - h)]) / (2 * h)
    assert found.spread == pytest.approx(spread(*z[:2]), rel=1e-12)
    assert found.spread_error == pytest.approx(math.sqrt(slope @ covariance @ slope), rel=1e-6)


def test_errors_between_octants():
    """The variance of the sum of eight sums that differ from their mean as independent numbers do."""
    rng = np.random.default_rng(3)
    values, octant = rng.random((50, 2)), rng.integers(0, 8, 50)
    sums = np.array([[np.sum(column[octant == k] - column.mean()) for k in range(8)] for column in values.T])
    assert structure._between_octants(values, octant) == pytest.approx(np.sqrt(8 * np.var(sums, axis=1, ddof=1)) / 50, rel=1e-12)


def test_one_task_or_many_give_the_same_chords():
    radii = np.ones(40)
    centers, cell = inserted(radii, 9.0, 9)
    seen = []

    def backwards(function, tasks):
        seen.append(len(tasks))
        return list(reversed([function(*task) for task in reversed(tasks)]))

    one, other = (structure.chord_lengths(centers, radii, cell, 0.03, stream, each) for each in (None, backwards))
    assert sum(seen) * (1 << 15) == other.lines == one.lines
    assert (one.density == other.density).all() and one.mean == other.mean and one.spread == other.spread


def inserted(radii, edge: float, seed: int):
    """Random sequential addition into a cube, largest spheres first."""
    rng = np.random.default_rng(seed)
    cell, centers = np.full(3, edge), np.zeros((len(radii), 3))
    placed = []
    for i in np.argsort(-radii):
        while True:
            x = rng.random(3) * edge
            away = centers[placed] - x
            away -= edge * np.round(away / edge)
            if (np.sum(away**2, axis=1) > (radii[placed] + radii[i]) ** 2).all():
                break
        centers[i] = x
        placed.append(i)
    return centers, cell


# ---- what growth and collisions make of it


@pytest.mark.slow
@pytest.mark.parametrize("fraction, second_moment", [slow(0.1, 0.973), slow(0.5, 0.929), (0.63, 0.967)])
def test_packed_tiles(fraction, second_moment):
    """Four tiles of 500: g2 of the fluid within its stated errors, the second moment of chords (packings of 2000 by other code).

    Mean z^2 of 220 bins has a standard deviation of 0.1; theory is off by up to 0.06 at 0.5, half an error.  A tile's second
    moment scatters by 0.003 and the reference by 0.0015: 0.008 is 4 standard errors of four.
    """
    from bakery.physics.packing import pack

    z, moments = [], []
    for seed in range(4):
        tile = pack(fraction, np.ones(500), seed=seed)
        form = tile.centers, tile.radii, tile.cell
        found = structure.pair_correlation(*form, structure.shells(*form[1:]))
        fluid = theory.in_bins(lambda r: theory.verlet_weis(r, fraction), found.edges)
        z.append((found.g - fluid) / found.g_error)
        chords = structure.chord_lengths(*form, 0.015, stream)
        assert abs(chords.mean - chords.exact) < 5 * chords.mean_error
        moments.append(chords.spread)
        order = structure.bond_order(*form)
        assert order.q6 < 6 * order.random(500)  # 0.1; a crystal has 0.5
    # a jammed tile is no fluid, and is seen not to be one
    assert (0.5 < np.mean(np.square(z)) < 1.5) == (fraction <= 0.5)
    assert np.mean(moments) == pytest.approx(second_moment, abs=0.008)


def test_a_crystal_of_the_same_fraction_is_told_apart():
    """The second moment of chords sees what the mean cannot."""
    centers, radii, cell = fcc(5, (0.74048 / 0.5) ** (1 / 3) - 1)
    found = structure.chord_lengths(centers, radii, cell, 0.015, stream)
    assert abs(found.mean - 4 / 3) < 5 * found.mean_error + 1e-4 and abs(found.spread - 0.929) > 0.05


# ---- radii


def test_radii_follow_their_laws():
    r = lognormal(1.3, 20_000)
    assert r.mean() == pytest.approx(1, rel=1e-14) and (np.diff(r) > 0).all()
    s2 = math.log(1.3) ** 2
    # <r^3>/<r>^3 and <r^2>/<r>^2 of the law
    assert np.mean(r**2) == pytest.approx(math.exp(s2), rel=1e-3) and np.mean(r**3) == pytest.approx(math.exp(3 * s2), rel=3e-3)
    two = species([0.7, 0.3], [2.0, 5.0], 11)
    assert np.unique(two, return_counts=True)[1].tolist() == [8, 3] and two.mean() == pytest.approx(1)
    assert two[-1] / two[0] == pytest.approx(2.5)
    with pytest.raises(ValueError, match=r"0\.01 of 20 spheres is none"):
        species([0.99, 0.01], [1, 2], 20)


def test_room_for_a_sphere_beside_its_image():
    assert room(math.pi / 6, np.ones(1), (1, 1, 1)) == pytest.approx(1)
    assert room(0.5, np.ones(100), (1, 1, 0.01)) == pytest.approx(0.01 * (100 * 4 / 3 * math.pi / 0.5 / 0.01) ** (1 / 3) / 2)
