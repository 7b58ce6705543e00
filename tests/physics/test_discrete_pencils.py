"""Pencils among discs: what stops them against all particles one by one, how many get through, and hashed particles as chance.

Each comparison with chance goes wrong once in 1e7 seeds (`ODDS`, or `SIGMAS` standard errors of a normal number); seeds
are fixed.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats
from scipy.spatial import ConvexHull, cKDTree

import bakery
from bakery import kernels, rng
from bakery.physics.discrete import hashing
from bakery.physics.shapes.radial import icosphere
from bakery.system.compiled import njit
from renderers import scene
from renderers.materials.particles import place
from renderers.materials.particles.medium import classes_of, without_peak
from tests.odds import ODDS, SIGMAS

NOBODY = np.full(3, np.nan)
DROPS_SEEN = """\
bakery: 1
name: drops
wavelengths: rgb
tolerance: 20%
particles:
  host: air
  number_density: 1e15 /m^3
  components: [{name: drops, material: water, size: {distribution: single, radius: 2 um}}]
"""
MOVING = """\
bakery_scene: 2
name: drift
camera: {origin: [40, -150, 40] um, target: [40, 40, 40] um, fov: 30 deg}
materials:
  - {asset: drops.h5, velocity: [3, -1, 0.5] um/s}
frames:
  count: 4
  materials[0].time: {from: 10 s, to: 11.5 s}
  camera.fov: {from: 30 deg, to: 5 deg}
"""


# ---- plain twins


def listed(discs):
    """All particles, (N, 3) m and (N,) classes, cell by cell."""
    place, kind = np.empty((200_000, 3)), np.empty(200_000, np.int64)
    filled = gathered(discs, place, kind)
    assert filled < len(kind)
    return place[:filled], kind[:filled]


@njit
def gathered(discs, place, kind):
    room, filled = kernels.mesh_scratch(), np.int64(0)
    particles = kernels.Particles(place, kind, np.empty(len(kind), np.uint64))
    for level in range(len(discs.reach)):
        low_high = kernels.disc_cells(discs, level)
        for i in range(low_high[0], low_high[3] + 1):
            for j in range(low_high[1], low_high[4] + 1):
                for k in range(low_high[2], low_high[5] + 1):
                    filled, _ = kernels.discs_of_cell(discs, level, (i, j, k), np.int64(0), particles, filled, room)
    return filled


def met(discs, place, kind, ray):
    """Class, distance, squared distance and centre of the first disc, and the open wavelengths, from all particles."""
    origin, direction, begin, end, left_out = ray
    t = (place - origin) @ direction
    d2 = ((place - origin - t[:, None] * direction) ** 2).sum(axis=1)
    own = (place == left_out).all(axis=1)
    on_way = (begin < t) & (t < end) & ~own
    stopping = np.flatnonzero(on_way & (d2 < discs.largest[kind]))
    free = [not (on_way & (d2 < discs.square[kind, w])).any() for w in range(discs.square.shape[1])]
    if not len(stopping):
        return kernels.NO_DISC, end, 0.0, NOBODY, free
    first = stopping[np.argmin(t[stopping])]
    return kind[first], t[first], d2[first], place[first], free


@njit
def asked(discs, origin, direction, begin, end, left_out, kind, found, free):
    room = kernels.mesh_scratch()
    for i in range(len(origin)):
        o, d, s = origin[i], direction[i], left_out[i]
        pencil = kernels.Pencil((o[0], o[1], o[2]), (d[0], d[1], d[2]), begin[i], end[i], (s[0], s[1], s[2]))
        kind[i], found[i, 0], found[i, 1], found[i, 2], found[i, 3], found[i, 4] = kernels.first_disc(
            discs, pencil, room)
        kernels.open_wavelengths(discs, pencil, free[i], room)


def rays(discs, place, number=400, seed=3):
    """Rays of all kinds through a region: from outside and within, along axes and diagonals, on walls of cells, from centres."""
    random = np.random.default_rng(seed)
    lo, hi = discs.region.lo, discs.region.hi
    inside = lo + random.random((number, 3)) * (hi - lo)
    aim = lo + random.random((number, 3)) * (hi - lo)
    origin = np.where(random.random((number, 1)) < 0.5, inside, aim + 3 * np.max(hi - lo) * random.normal(size=(number, 3)))
    direction = aim - origin
    direction[::7] = np.sign(random.normal(size=(len(direction[::7]), 3)))  # diagonals
    straight = np.eye(3)[random.integers(3, size=number)] * random.choice([-1.0, 1.0], (number, 1))
    direction[::3] = straight[::3]
    if len(discs.step):
        walls = random.integers(0, discs.cells[0] + 1, (number, 3)) * discs.step[0] + discs.region.lo
        origin[1::6] = walls[1::6]
    left_out = np.full((number, 3), np.nan)
    if len(place):
        centre = place[random.integers(len(place), size=number)]
        origin[2::9] = left_out[2::9] = centre[2::9]
    direction = direction / np.linalg.norm(direction, axis=1)[:, None]
    length = np.linalg.norm(hi - lo)
    begin = np.where(random.random(number) < 0.2, random.random(number) * length, 0.0)
    end = np.where(random.random(number) < 0.3, begin + random.random(number) * length, np.inf)
    return origin, direction, begin, end, left_out


def compared(discs, place, kind):
    """Every ray against all particles; the shares that were stopped, and that got through at some wavelengths only."""
    ways = rays(discs, place)
    hit, t, partly = against_all(discs, place, kind, ways)
    # once more with rays that end just behind, or begin just before, what stopped them
    origin, direction, begin, end, left_out = (values[hit] for values in ways)
    small, odd = 1e-9 * np.linalg.norm(discs.region.hi - discs.region.lo), np.arange(len(origin)) % 2 == 1
    begin, end = np.where(odd, np.maximum(begin, t[hit] - small), begin), np.where(odd, end, t[hit] + small)
    again, _, _ = against_all(discs, place, kind, (origin, direction, begin, end, left_out))
    assert again.all()
    return hit.mean(), partly.mean()


def against_all(discs, place, kind, ways):
    """Which rays are stopped, where, and which are open at some wavelengths only, if they are the same as by all particles."""
    number, waves = len(ways[0]), discs.square.shape[1]
    found_kind, found, free = np.empty(number, np.int64), np.empty((number, 5)), np.ones((number, waves), np.uint8)
    asked(discs, *ways, found_kind, found, free)
    extent = np.linalg.norm(discs.region.hi - discs.region.lo)
    for i, ray in enumerate(zip(*ways)):
        one, t, d2, centre, open_waves = met(discs, place, kind, ray)
        assert found_kind[i] == one and free[i].tolist() == open_waves, f"ray {i}"
        if one != kernels.NO_DISC:
            assert np.allclose(found[i, 1], d2, rtol=0, atol=1e-9 * extent**2)
            assert np.allclose(found[i, [0, 2, 3, 4]], [t, *centre], rtol=0, atol=1e-9 * extent)
        else:
            assert found[i, 0] == ray[3]
    return found_kind >= 0, found[:, 0], (free.sum(axis=1) > 0) & (free.sum(axis=1) < waves)


BOX = kernels.region_box([-1.0, 2.0, 0.5], [0.5, 3.0, 2.5])
FLAT = kernels.region_box([0.0, 0.0, 0.0], [1.0, 1.0, 1e-4])
NEEDLE = kernels.region_box([0.0, 0.0, 0.0], [1e-3, 2.0, 1e-3])


def sizes(optical_depth, share, radius, region=BOX):
    """Extinction (2, K) m^2 of classes with radii in these ratios, so that the box's mean edge has that depth; at a second
    wavelength 0.6 of it, but for the smallest, which grow there."""
    area = np.pi * np.array(radius, float) ** 2
    edge = (region.hi - region.lo).prod() ** (1 / 3)
    area *= optical_depth / (np.dot(share, area) / (region.hi - region.lo).prod() * edge)
    other = 0.6 * area
    other[-1] = 1.5 * area[-1]
    return np.array([area, other])


MANY = np.array([3, 30, 1000, 3000])  # of four sizes over three decades
CASES = {
    "one size": (BOX, [2000], sizes(2.0, [2000], [1])),
    "sizes over three decades": (BOX, MANY, sizes(2.0, MANY, [1000, 300, 40, 1])),
    "one disc as large as the box": (BOX, [1, 500], np.array([[4.0, 0.001], [3.0, 0.004]])),
    "discs that overlap all": (BOX, [40], np.array([[8.0], [7.0]])),
    "flat box": (FLAT, [3000], sizes(0.1, [3000], [1], FLAT)),
    "needle": (NEEDLE, [500], sizes(1e-1, [500], [1], NEEDLE)),
    "nobody": (BOX, [0], np.array([[0.1], [0.1]])),
    "one": (BOX, [1], np.array([[0.5], [0.3]])),
}


def stored(region, numbers, extinction, seed=1, **more):
    """Discs at places drawn by NumPy, and those places and classes."""
    random, kind = np.random.default_rng(seed), np.repeat(np.arange(len(numbers)), numbers)
    kind = random.permutation(kind)
    place = region.lo + random.random((len(kind), 3)) * (region.hi - region.lo)
    return kernels.stored_discs(region, extinction, place, kind, **more), place, kind


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_stored_particles_stop_what_all_of_them_do(case):
    region, numbers, extinction = CASES[case]
    discs, place, kind = stored(region, numbers, extinction)
    assert (kernels.disc_order(extinction) == np.arange(len(numbers))).all()
    # as they are kept, in single precision from the corner
    place = (place - region.lo).astype(np.float32).astype(float) + region.lo
    hit, partly = compared(discs, place, kind)
    assert (hit > 0.05 and partly > 0) or case in ("nobody", "one")
    assert len(discs.reach) == (3 if "decades" in case else 2 if "as large" in case else 1), "levels"
    there, of = listed(discs)
    assert np.array_equal(np.sort(there, axis=0), np.sort(place, axis=0)) and np.array_equal(np.sort(of), np.sort(kind))


@pytest.mark.slow
def test_what_leaves_a_stored_box_comes_in_on_the_other_side():
    region, numbers, extinction = CASES["sizes over three decades"]
    velocity = np.array([[0.3, -0.2, 0.1]] * 2 + [[-1.0, 0.0, 2.0]] * 2)
    time = 7.7
    discs, place, kind = stored(region, numbers, extinction, velocity=velocity, time=time)
    kept = (place - region.lo).astype(np.float32).astype(float)
    expected = region.lo + (kept + velocity[kind] * time) % (region.hi - region.lo)
    there, of = listed(discs)
    assert len(there) == len(place)
    for one in range(len(numbers)):
        assert np.allclose(np.sort(there[of == one], axis=0), np.sort(expected[kind == one], axis=0), rtol=0, atol=1e-12)
    assert compared(discs, there, of)[0] > 0.3


WORDS = rng.key(5, "discrete.cells")


def ball():
    vertices, faces = icosphere(300)
    return kernels.region_mesh(0.6 * vertices + [0.3, -1.0, 2.0], faces)


REGIONS = {
    "box": lambda: BOX,
    "grid": lambda: kernels.region_grid(BOX.lo, BOX.hi, np.random.default_rng(2).random((4, 3, 5)) ** 3),
    "mesh": ball,
}


def procedural(region, numbers, extinction, words=WORDS, **more):
    density = np.array(numbers, float) / (region.hi - region.lo).prod()
    return kernels.procedural_discs(region, extinction, density, words, **more)


@pytest.mark.slow
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("where", REGIONS)
def test_hashed_particles_stop_what_all_of_them_do(where, moving):
    region = REGIONS[where]()
    more = {"velocity": np.tile([0.4, 0.3, -5.0], (4, 1)), "time": 3.1} if moving else {}
    discs = procedural(region, MANY, sizes(4.0, MANY, [1000, 300, 40, 1], region), **more)
    assert len(discs.reach) == 3
    there, of = listed(discs)
    assert ((region.lo <= there) & (there < region.hi)).all() and (kernels.region_densities(region, there) > 0).all()
    hit, partly = compared(discs, there, of)
    assert hit > 0.05 and partly > 0


@pytest.mark.parametrize("case", ["flat box", "needle", "one disc as large as the box", "discs that overlap all"])
def test_hashed_particles_in_odd_boxes(case):
    region, numbers, extinction = CASES[case]
    discs = procedural(region, numbers, extinction)
    assert compared(discs, *listed(discs))[0] > 0.05


# ---- laws


@njit
def shares(discs, radius, width, realisations, pencils, passed):
    """Share of pencils down a fat ray of a radius (m) that get through, (realisations, L)."""
    room, free = kernels.mesh_scratch(), np.empty(passed.shape[1], np.uint8)
    state = np.uint64(12345)
    for i in range(realisations):
        for level in range(len(discs.key)):
            state = kernels.hashed(state + np.uint64(0x9E3779B97F4A7C15))
            discs.key[level] = state
        passed[i] = 0.0
        for _ in range(pencils):
            state = kernels.hashed(state + np.uint64(0x9E3779B97F4A7C15))
            u = (state >> np.uint64(32)) * 2.0**-32
            v = (state & np.uint64(0xFFFFFFFF)) * 2.0**-32
            x = width / 2 + radius * math.sqrt(u) * math.cos(2 * math.pi * v)
            y = width / 2 + radius * math.sqrt(u) * math.sin(2 * math.pi * v)
            free[:] = 1
            pencil = kernels.Pencil((x, y, -1.0), (0.0, 0.0, 1.0), 0.0, np.inf, (np.nan, np.nan, np.nan))
            kernels.open_wavelengths(discs, pencil, free, room)
            for w in range(len(free)):
                passed[i, w] += free[w] / pencils


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("depth", [0.5, 2.0])
def test_fat_rays_keep_the_exponential_law(depth, ratio):
    """The mean over realisations is exp(-sigma_t s) for fat rays narrower and wider than the particles (C_e = 2 pi r_p^2).

    3,000 realisations; as the table of errors of the paper's equations has it, counting all that touch gives 0.028 instead of
    0.135 at ratio 1.
    """
    r_p = 0.05
    area = 2 * np.pi * r_p**2
    width = 2 * (ratio * r_p + math.sqrt(2) * r_p) + 0.01
    region = kernels.region_box([0, 0, 0], [width, width, 1.0])
    # a second wavelength with a third of the cross section
    discs = kernels.procedural_discs(region, np.array([[area], [area / 3]]), [depth / area], (0, 0))
    passed = np.empty((3000, 2))
    shares(discs, ratio * r_p, width, 3000, 8, passed)
    error = passed.std(axis=0) / math.sqrt(len(passed))
    assert error.max() < 0.01
    assert np.all(np.abs(passed.mean(axis=0) - np.exp([-depth, -depth / 3])) < SIGMAS * error)


def test_mixtures_keep_the_exponential_law():
    """Three sizes over two decades on levels of their own, two wavelengths; discs from a fifth of the box to a five-hundredth."""
    radius, depth = np.array([0.2, 0.02, 0.002]), np.array([[0.3, 0.4, 0.5], [0.5, 0.1, 0.1]])
    area = np.pi * radius**2
    region = kernels.region_box([0, 0, 0], [0.5, 0.5, 1.0])
    density = depth[0] / area
    discs = kernels.procedural_discs(region, depth / density, density, (0, 0))
    assert len(discs.reach) > 1
    passed = np.empty((3000, 2))
    shares(discs, 0.01, 0.5, 3000, 4, passed)
    error = passed.std(axis=0) / math.sqrt(len(passed))
    assert np.all(np.abs(passed.mean(axis=0) - np.exp(-depth.sum(axis=1))) < SIGMAS * error)


@njit
def numbers_of_cells(key, table):
    out = np.empty(4000, np.int64)
    for c in range(4000):
        out[c] = hashing.cell_count(hashing.cell_hash(key, c // 200, c // 10 % 20 - 10, -(c % 10)), table)
    return out


@pytest.mark.parametrize("mean", [0.3, 1.5, 12.0])
def test_counts_in_hashed_cells_are_poisson(mean):
    table = hashing.counts(mean)
    observed = np.bincount(numbers_of_cells(np.uint64(99), table), minlength=40)
    number = np.arange(40)
    expected = 4000 * stats.poisson.pmf(number, mean)
    likely = expected > 5
    few, others = observed[likely], observed[~likely].sum()
    rest = 4000 - expected[likely].sum()
    square = ((few - expected[likely]) ** 2 / expected[likely]).sum() + (others - rest) ** 2 / rest
    assert stats.chi2.sf(square, likely.sum()) > ODDS and stats.chi2.cdf(square, likely.sum()) > ODDS
    with pytest.raises(ValueError, match="17 particles a cell"):
        hashing.counts(17.0)


def test_places_of_hashed_particles_are_chance():
    """Uniform in each direction, by themselves and against each other; counts of blocks of cells Poisson; classes by share."""
    numbers = np.array([9000, 21000])
    region = kernels.region_box([0, 0, 0], [1.0, 2.0, 0.5])
    discs = procedural(region, numbers, np.array([[2e-6, 1e-6]]))
    assert len(discs.reach) == 1
    place, kind = listed(discs)
    assert abs(len(place) - 30_000) < SIGMAS * math.sqrt(30_000)
    assert stats.binomtest(int((kind == 0).sum()), len(place), 0.3).pvalue > ODDS
    for axis in range(3):
        assert stats.kstest(place[:, axis], "uniform", (0, region.hi[axis])).pvalue > ODDS
        # within a cell, where the hash decides
        within = place[:, axis] / discs.step[0, axis] % 1
        assert stats.kstest(within, "uniform").pvalue > ODDS
        other = place[:, (axis + 1) % 3] / discs.step[0, (axis + 1) % 3] % 1
        table, *_ = np.histogram2d(within, other, bins=8, range=[[0, 1], [0, 1]])
        assert stats.chisquare(table.ravel()).pvalue > ODDS
    blocks = np.histogramdd(place, bins=(7, 13, 5), range=list(zip(region.lo, region.hi)))[0].ravel()
    dispersion = ((blocks - 30_000 / 455) ** 2).sum() / (30_000 / 455)
    assert stats.chi2.sf(dispersion, 455) > ODDS and stats.chi2.cdf(dispersion, 455) > ODDS


def test_hashed_particles_follow_density_grids_and_meshes():
    grid = kernels.region_grid([0, 0, 0], [4.0, 1.0, 1.0], np.array([0.0, 1.0, 0.2, 0.6]).reshape(4, 1, 1))
    place, _ = listed(procedural(grid, [20_000], np.array([[1e-6]])))
    fine = np.linspace(0, 4, 4001)
    law = np.interp((fine[1:] + fine[:-1]) / 2, [0.5, 1.5, 2.5, 3.5], [0.0, 1.0, 0.2, 0.6])
    assert abs(len(place) - 20_000 * law.mean()) < SIGMAS * math.sqrt(20_000 * law.mean())
    cumulated = np.concatenate([[0], np.cumsum(law)]) / law.sum()
    assert stats.kstest(place[:, 0], lambda x: np.interp(x, fine, cumulated)).pvalue > ODDS
    assert stats.kstest(place[:, 0], "uniform", (0, 4)).pvalue < ODDS
    region = ball()
    place, _ = listed(procedural(region, [20_000], np.array([[1e-6]])))
    vertices, _ = icosphere(300)
    hull = ConvexHull(0.6 * vertices + [0.3, -1.0, 2.0])
    assert (place @ hull.equations[:, :3].T + hull.equations[:, 3] < 1e-9).all()
    expected = 20_000 * hull.volume / (region.hi - region.lo).prod()
    assert abs(len(place) - expected) < SIGMAS * math.sqrt(expected)
    inner = (np.linalg.norm(place - [0.3, -1.0, 2.0], axis=1) < 0.4).sum()
    assert stats.binomtest(int(inner), len(place), 4 / 3 * math.pi * 0.4**3 / hull.volume).pvalue > ODDS


@pytest.mark.parametrize("kept", [True, False])
def test_moving_particles_do_not_pop(kept):
    """Between two moments every particle but those near the walls moves by velocity times time, and none else appears."""
    numbers, extinction, velocity = [3000], np.array([[1e-4]]), np.array([[0.5, -1.5, 20.0]])
    for time in (0.0, 0.3, 1e3):
        step = 1e-4
        moments = []
        for t in (time, time + step):
            more = {"velocity": velocity, "time": t}
            discs = stored(BOX, numbers, extinction, **more)[0] if kept else procedural(BOX, numbers, extinction, **more)
            moments.append(listed(discs)[0])
        moved = moments[0] + velocity[0] * step
        inside = ((BOX.lo <= moved) & (moved < BOX.hi)).all(axis=1)
        assert inside.mean() > 0.99
        far, _ = cKDTree(moments[1]).query(moved[inside])
        assert far.max() < 1e-9
        # what came in is at the walls
        new = cKDTree(moved[inside]).query(moments[1])[0] > 1e-9
        from_wall = np.minimum(moments[1] - BOX.lo, BOX.hi - moments[1])[new]
        assert (from_wall < np.abs(velocity[0]) * step + 1e-9).any(axis=1).all()


@pytest.mark.parametrize("method", ["stored", "procedural"])
def test_particles_of_frames_move_by_their_velocity(tmp_path, method):
    """From frame to frame of a scene whose camera and `time` change, each particle is where its velocity takes it: none jumps, at
    borders of cells neither, and what comes in comes through the walls."""
    (tmp_path / "drops.yaml").write_text(DROPS_SEEN + f"discrete: {{count: 500, box: [80 um, 80 um, 80 um], method: {method}}}\n")
    bakery.bake(tmp_path / "drops.yaml", tmp_path / "drops.h5")
    (tmp_path / "s.yaml").write_text(MOVING)
    velocity, lo, hi, moments = np.array([3e-6, -1e-6, 0.5e-6]), np.zeros(3), np.full(3, 80e-6), []
    for number in (1, 2, 3, 4):
        loaded = scene.load(tmp_path / "s.yaml", frame=number)
        asset, entry = bakery.open(tmp_path / "drops.h5"), loaded.values.materials[0]
        classes = without_peak(classes_of(asset.discrete), 1e-3 * number)  # as zooming cameras take it out
        order = kernels.disc_order(classes.extinction)
        region = place.region_of(loaded, asset.discrete)
        discs = place.discs_of(asset.discrete, region, entry.velocity, entry.time)
        moments.append(listed(discs(classes.extinction[:, order], classes.density[order], order))[0])
    for before, after in pairwise(moments):
        moved = before + velocity * 0.5
        inside = ((lo <= moved) & (moved < hi)).all(axis=1)
        assert inside.sum() > 400 and cKDTree(after).query(moved[inside])[0].max() < 1e-4 * 80e-6  # single precision
        new = after[cKDTree(moved[inside]).query(after)[0] > 1e-4 * 80e-6]
        assert (np.minimum(new - lo, hi - new) < np.abs(velocity) * 0.5 + 1e-9).any(axis=1).all()
