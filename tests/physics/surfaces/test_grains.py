"""Surfaces of packed grains against Mitsuba's `path` over the same balls, closed forms of sparse packings, energy, reciprocity.

Statistical tests have fixed seeds; limits are six standard errors of both sides, and what cells smooth (2 % of the light) where a
single pair of directions is asked for: a false alarm in 1e-6 a run, should random numbers be drawn anew.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest

from bakery.physics.grains.sampling import next_uniform
from bakery.physics.grains.sphere import ball
from bakery.physics.grains.surface import conductor, dielectric, diffuse
from bakery.physics.grains.traces import nodes
from bakery.physics.granular._aimed import aimed
from bakery.physics.granular._clear import refracted
from bakery.physics.granular._packed import Draws
from bakery.physics.granular.goniometer import BINS, CELLS, Goniometer, together
from bakery.physics.granular.packed import Grain
from bakery.physics.granular.reflectance import LEAST, measured, straight_back
from bakery.physics.medium import phase
from bakery.physics.packing import pack
from bakery.physics.surfaces import pairs
from bakery.physics.surfaces.corrected import Corrected, middles
from bakery.physics.surfaces.fit import SHOWN, Fit, _entering, forgotten, merged
from bakery.physics.surfaces.refine import refined
from bakery.physics.surfaces.slab import Slab
from bakery.system.compiled import njit
from tests.conftest import slow

SMOOTHED = 0.02  # of the reflectance at a single pair: what interpolation between cells leaves
BACK = 0.04  # the same within a degree of straight back: 2 % in root mean square at a stated error of 2 %
SURFACES = {"matt": diffuse(0.8), "dark": diffuse(0.1), "white": diffuse(1.0), "black": diffuse(0.0), "glass": dielectric(1.5),
            "copper": conductor(0.27 + 3.41j)}


@cache
def tile(fraction, count=500):
    return pack(fraction, np.ones(count), seed=1, schedule="draft")


@cache
def medium(name, depth=math.inf, base=None):
    """Half space or layer of the medium that stands for balls of a surface, and their mean cosine."""
    theta, edges = nodes()
    figures = ball(SURFACES[name], 0.0, edges)
    lobe, _ = phase.normalised(theta, np.atleast_2d(figures.phase)[0])
    albedo = min(float(np.atleast_1d(figures.albedo)[0]), 1.0)
    return refined(Slab(theta, lobe, albedo, depth, 1.0, base), 0.05)[0], float(np.atleast_1d(figures.g)[0])


def goniometer(name, fraction, count=500, seed=1, surface=(0.0, 1.0), **layer):
    packed, grain = tile(fraction, count), SURFACES[name]
    return Goniometer(packed.centers, packed.radii, packed.cell, [Grain(grain)], mu=np.zeros((1, 1)),
                      channels=grain.channels[None], seed=seed, g=medium(name)[1], surface=surface, **layer)


@cache
def baked(name, fraction, tolerance, **options):
    result = measured(goniometer(name, fraction, **options), [medium(name)[0]], tolerance)
    return Corrected(medium(name)[0], result.each[0].factors), result


@cache
def layer(name, thickness, tolerance, base=None, surface=(0.0, 1.0)):
    """Grains within a thickness in radii, at a fraction of 0.6."""
    solution = medium(name, 0.75 * 0.6 / 0.4 * thickness, base)[0]
    walked = goniometer(name, 0.6, surface=surface, thickness=thickness, base=None if base is None else np.array([base]))
    result = measured(walked, [solution], tolerance)
    each = result.each[0]
    return Corrected(solution, each.factors, each.below and each.below.factors, each.straight), each


def test_pairs():
    """Coordinates do not know which of two directions is which; cells hold all pairs, and each point of a cell is in it."""
    rng = np.random.default_rng(1)
    mu, mu0 = rng.random((2, 50))
    cosine = mu * mu0 - np.sqrt((1 - mu**2) * (1 - mu0**2)) * np.cos(rng.random(50) * math.pi)
    for a, b, c in zip(mu, mu0, cosine, strict=True):
        assert pairs.coordinates(a, b, c) == pairs.coordinates(b, a, c)
    counts = np.array([12, 4, 4])
    mu, mu0, phi, weight = pairs.quadrature(tuple(counts), (4, 4, 4))
    assert weight.sum() == pytest.approx(2 * math.pi**2, rel=1e-8)
    assert (weight * mu * mu0).sum() == pytest.approx(math.pi**2 / 2, rel=1e-7)
    _, _, _, single = pairs.quadrature(CELLS, (1, 4, 3))
    back = np.cumsum(single.reshape(CELLS[0], -1).sum(axis=1))[:3]  # the second direction is in a cap about the first
    np.testing.assert_allclose(back, 2 * math.pi**2 * (1 - np.cos(math.pi * (np.arange(1, 4) / CELLS[0]) ** 2)), rtol=4e-3)
    cosine = mu * mu0 - np.sqrt((1 - mu**2) * (1 - mu0**2)) * np.cos(phi)
    for cell, point in rng.integers((192, 64), size=(200, 2)):
        assert pairs.cell_of(mu[cell, point], mu0[cell, point], cosine[cell, point], counts) == cell


def test_few_walks_move_no_light_between_cells():
    """Of light that is a smooth factor times the medium's, without noise, each of 96 cells gets its own: 1.5 % root mean square.

    Where 30,000 walks held cells to larger ones, not to a polynomial, it was 2.5 % of the first order and 5.3 % of others.
    """
    fit = Fit(medium("matt")[0], CELLS, BINS, LEAST)
    for order, fine in enumerate(fit.tables):
        a, b, c = np.meshgrid(*((np.arange(n) + 0.5) / n for n in fine), indexing="ij")
        table, scale = 1 + 0.4 * np.cos(3 * a) * np.sin(2 * c) + 0.3 * b * b * np.exp(-a), np.ones(BINS)
        true, albedo = fit.in_cells(order, table.ravel(), scale), fit.albedo(order, table.ravel(), scale)
        table, scale, variance, _ = fit.fitted(order, true, albedo, 3e4)
        fitted, light = (np.bincount(merged(CELLS, (6, 4, 4)), part) for part in (fit.in_cells(order, table, scale), true))
        assert np.sqrt(np.average((fitted / light - 1) ** 2, weights=light)) < 0.015
        assert np.all(variance > 0) and np.median(variance) < 0.1


def test_light_of_walks_that_enter_at_the_rim_is_in_its_cells():
    """All cells hold what R = 1/(mu + mu0) sends back, in closed form: 0.9 % less of it where four points told what enters."""
    mu, mu0, _, light = _entering(CELLS, LEAST)
    s, weight = np.polynomial.legendre.leggauss(200)
    root = LEAST + (1 - LEAST) * 0.5 * (1 + s)
    albedo = 2 * (1 - root**2 * np.log1p(1 / root**2))
    assert (light / (mu + mu0)).sum() == pytest.approx(0.5 * albedo @ weight, rel=2e-3)


def test_stated_errors_cover_cells_that_stay_dark():
    """Where a fiftieth of the light goes of what goes beside it, three stated errors hold 96 % of the cells.

    They held 84 to 86 %, with cells at 5 times their light by a stated error of 7 %; five seeds bring 97.4 to 99.1 %.
    """
    fit, walks = Fit(medium("matt")[0], CELLS, BINS, LEAST), 3e5
    a, b, c = np.meshgrid(*((np.arange(n) + 0.5) / n for n in fit.tables[0]), indexing="ij")
    table = np.where((b > 0.75) & (c > 0.3), 0.02, 1 + 0.3 * np.cos(3 * a)).ravel()
    true, albedo = fit.in_cells(0, table, np.ones(BINS)), fit.albedo(0, table, np.ones(BINS))
    counted = np.random.default_rng(1).poisson(walks * true) / walks
    table, scale, variance, misfit = fit.fitted(0, counted, albedo, walks)
    fitted, light = (np.bincount(merged(CELLS, SHOWN), part) for part in (fit.in_cells(0, table, scale), true))
    off = np.abs(fitted - light) / (fitted * np.sqrt(np.minimum(variance, 1) + misfit))
    assert np.mean(off < 3) > 0.96


@njit
def _turns(draws, out):
    """Directions and weights (N, 4) of light that comes in at 45 degrees."""
    s = math.sqrt(0.5)
    for row in out:
        across, azimuth = next_uniform(draws.stream, draws.pool), 2 * math.pi * next_uniform(draws.stream, draws.pool)
        lobe = math.sqrt(across) * math.cos(azimuth), math.sqrt(across) * math.sin(azimuth), math.sqrt(1 - across)
        (row[0], row[1], row[2]), _, row[3] = aimed((s, 0.0, -s), (0.0, 0.0, 1.0), lobe, draws)


def test_aimed_walks_bring_what_a_matt_surface_sends_back():
    """All of it, and within a of straight back sin^2(a) times the cosine, Lambert's lobe over a cap; six standard errors: 2e-9.

    Of 40,000 directions some 40 would be within 2 degrees without that.
    """
    out = np.empty((40_000, 4))
    _turns(Draws(np.array([1, 2, 3, 4, 0], np.uint64), np.empty(4)), out)
    back = out[:, :3] @ np.array([-math.sqrt(0.5), 0, math.sqrt(0.5)])
    assert np.count_nonzero(back > math.cos(math.radians(2))) > 3000
    for angle, share in ((math.pi, 1.0), *((a, math.sin(a) ** 2 * math.sqrt(0.5)) for a in np.radians([0.2, 2, 11]))):
        light = np.where(back > math.cos(angle), out[:, 3], 0.0)
        assert abs(light.mean() - share) < 6 * light.std() / 200


@njit
def _refractions(cosine, wanted, draws, out):
    """Cosines of the angles by which a ball of index 1.5 turns light, and weights (N, 2)."""
    d = (math.sqrt(1.0 - cosine * cosine), 0.0, -cosine)
    for row in out:
        turned_to, _, row[1], _ = refracted(1.5, d, (0.0, 0.0, 1.0), draws, (1000, wanted))
        row[0] = d[0] * turned_to[0] + d[2] * turned_to[2]


def test_clear_balls_turn_light_as_fresnel_has_it_however_they_are_asked():
    """Reflected, refracted, and reflected inside once, in closed form; six standard errors: 2e-9 each.

    Where what is reflected is wanted it comes five times as often, its variance is less by as much, and no light is lost.
    """
    cosine, variances = 0.9, []
    inner = math.sqrt(1 - (1 - cosine**2) / 1.5**2)
    share = 0.5 * (((cosine - 1.5 * inner) / (cosine + 1.5 * inner))**2 + ((1.5 * cosine - inner) / (1.5 * cosine + inner))**2)
    a, b = math.acos(cosine), math.acos(inner)
    for wanted in (False, True):
        out = np.empty((40_000, 2))
        _refractions(cosine, wanted, Draws(np.array([1, 2, 3, 4, 0], np.uint64), np.empty(4)), out)
        for angle, light in ((math.pi - 2 * a, share), (2 * (a - b), (1 - share)**2),
                             (math.pi + 2 * a - 4 * b, share * (1 - share)**2)):
            part = np.where(np.abs(out[:, 0] - math.cos(angle)) < 1e-9, out[:, 1], 0.0)
            assert abs(part.mean() - light) < 6 * part.std() / 200
            variances.append(part.var())
        assert abs(out[:, 1].mean() - 1) < 6 * out[:, 1].std() / 200 + 1e-12
    assert variances[3] < 0.3 * variances[0] and variances[5] < 0.4 * variances[2]


def test_light_that_forgot_where_it_entered():
    """All of it is in the cells, each has R = L(mu) L(mu0) / int 2 mu L dmu, and replicates move it as their bins do."""
    at, walks = middles(BINS, LEAST), np.full((4, BINS), 1e3)
    entered = np.tile((0.3 + 0.2 * at**2) * 1e3, (4, 1))
    entered[0] *= 1.01
    entered[1] *= 0.99
    cells = forgotten(CELLS, LEAST, entered, walks)
    mu, mu0, _, light = _entering(CELLS, LEAST)
    exact = (light * (0.3 + 0.2 * mu) * (0.3 + 0.2 * mu0)).sum(axis=1) / (0.3 + 0.4 / 3)
    np.testing.assert_allclose(cells.sum(axis=0), 4 * 16e3 * exact, rtol=1e-3)
    np.testing.assert_allclose(cells[0] - cells[1], 0.02 * 16e3 * exact, rtol=1e-6)
    assert cells.sum() == pytest.approx(entered.sum(), rel=3e-3)
    assert not forgotten(CELLS, LEAST, 0 * entered, walks).any()


def test_what_clear_balls_send_straight_back_is_narrower_than_steps_of_phase_functions():
    """Cells within 0.3125 degrees have what one ball sends there, over that around, to how both stand to the surface (5 %)."""
    solution = medium("glass")[0]
    peak = straight_back(goniometer("glass", 0.6), solution, 0)
    within = math.pi * (2 / 48)**2
    narrow = ball(SURFACES["glass"], 0.0, np.array([0, math.pi - within, math.pi])).phase[0, 1] * (1 - math.cos(within))
    with_peak, without = (Fit(solution, CELLS, BINS, LEAST, peak=part).in_cells(0, np.ones(math.prod(CELLS)), np.ones(BINS))
                          .reshape(CELLS[0], -1).sum(axis=1) for part in (peak, None))
    around = slice(5, 9)
    middle = math.pi * (np.arange(49)[around] + 0.5)**2 / 48**2
    solid = np.cos(math.pi * (np.arange(48)[around] / 48)**2) - np.cos(math.pi * (np.arange(1, 49)[around] / 48)**2)
    wide = phase.phase_at(solution.slab.theta, solution.slab.phase, math.pi - middle) * solid
    assert with_peak[:2].sum() / without[around].sum() == pytest.approx(narrow / wide.sum(), rel=0.08)
    assert without[:2].sum() < 0.5 * with_peak[:2].sum() and (peak[5:] == 1).all()
    assert straight_back(goniometer("matt", 0.6), medium("matt")[0], 0) is None


@pytest.mark.slow
def test_clear_balls_straight_back_are_as_bright_as_walks_say():
    """First order, within 0.3125 degrees, from a bake at 10 %: 0.5 of it was there. Some 200 walks tell what it is, to 10 %."""
    walked = goniometer("glass", 0.6)
    counts = walked.unpacked(walked.counted(100_000, 0, False, lambda function, tasks: [function(*task) for task in tasks]))
    counted = counts.cells[:, 0, 0, 0].sum(axis=0).reshape(CELLS[0], -1)[:2].sum() / counts.walks.sum()
    factors, fit = baked("glass", 0.6, 0.1)[1].each[0].factors, Fit(medium("glass")[0], CELLS, BINS, LEAST)
    stored = fit.in_cells(0, factors.cells[0].ravel(), factors.scale[0]).reshape(CELLS[0], -1)[:2].sum()
    assert 0.7 < stored / counted < 1.6


def test_a_peak_of_higher_orders_straight_back_is_that_of_its_counts():
    """By counts without noise to 3 % in each slice, where cells are 1.25 degrees wide; counts of a single walk make no peak."""
    fit = Fit(medium("glass")[0], CELLS, BINS, LEAST, peak=np.ones(CELLS[0]))
    peak = 1 + 1.5 * np.exp(-np.arange(CELLS[0]) / 3)
    even = fit.in_cells(2, np.ones(math.prod(SHOWN)), np.ones(BINS))
    light = even * np.repeat(peak, math.prod(CELLS[1:]))
    narrowed = fit.narrowed(light, 1e9)
    table = pairs.finer(np.ones(SHOWN), CELLS[0]) * narrowed.peak[:, None, None]
    of_slices = [part.reshape(CELLS[0], -1).sum(axis=1)[:12] for part in (
        narrowed.in_cells(2, np.ones(math.prod(SHOWN)), np.ones(BINS)), light)]
    np.testing.assert_allclose(*of_slices, rtol=0.03)
    np.testing.assert_allclose(table[:12, 0, 0], peak[:12], rtol=0.03)
    np.testing.assert_allclose(fit.narrowed(light, 1.0).peak, 1, atol=1e-3)


def test_what_leaves_by_its_first_ball_in_the_third_order_is_counted_once(monkeypatch):
    """Walks to the second order tell as much of it as those to their end leave out: six standard errors of both, 2e-9."""
    walked, light, entered = goniometer("glass", 0.6), [], []
    for returns, through in ((True, False), (True, True), (False, True)):
        monkeypatch.setattr(Goniometer, "returns", returns)
        counts = walked.unpacked(walked.counted(2000, 0, through, lambda function, tasks: [function(*task) for task in tasks]))
        light.append(counts.cells[:, 0, 2, 0].sum(axis=-1) / counts.walks.sum(axis=1))
        entered.append(counts.entered[:, 0, 2, 0].sum(axis=-1) / counts.walks.sum(axis=1))
    told, missing = light[0], light[2] - light[1]
    np.testing.assert_allclose(entered[1], entered[2], rtol=1e-12)  # of albedos nothing is missing
    assert told.min() > 0 and abs(told.mean() - missing.mean()) < 6 * math.sqrt((told.var() + missing.var()) / 15)
    assert math.sqrt(told.var() / 15) < 0.1 * told.mean() and told.std() < missing.std()


@pytest.mark.slow
def test_clear_balls_beside_straight_back_are_as_bright_as_walks_say():
    """All orders, 0.31 to 1.25 degrees, mean of six bakes at 3 %: 0.82 to 0.85 of it was there.  Seeds scatter by 4 %, and 3e6
    and 8e5 walks know it to 3 %, so 0.14 is four standard deviations (6e-5)."""
    walked, solution = goniometer("glass", 0.6, seed=77), medium("glass")[0]
    counts = together(walked, *(walked.counted(number // 16, 0, through, lambda function, tasks: [
        function(*task) for task in tasks]) for number, through in ((3_000_000, False), (800_000, True))))[0]
    cells = counts.cells[:, :, 0].sum(axis=0) / np.array([counts.walks.sum()] * 2 + [counts.walks_through.sum()])[:, None]
    mu, mu0, phi, light = (part.ravel() for part in _entering(CELLS, LEAST))
    stored = [(light * sum(Corrected(solution, baked("glass", 0.6, 0.03, seed=seed)[1].each[0].factors).orders(mu, mu0, phi)))
              .reshape(CELLS[0], -1)[2:4].sum() for seed in range(3, 9)]
    assert np.mean(stored) / cells.sum(axis=0).reshape(CELLS[0], -1)[2:4].sum() == pytest.approx(1, abs=0.14)


@pytest.mark.slow
def test_late_light_has_forgotten_where_it_entered():
    """Walks four times as long bring the same light to the slices of the phase angle and to the bins of incidence: within four
    standard errors (24 numbers: 2e-3 for other random numbers)."""
    packed, grain, sums = tile(0.6), SURFACES["glass"], []
    for longer in (1, 4):
        walked = Goniometer(packed.centers, packed.radii, packed.cell, [Grain(grain)], mu=np.full((1, 1), 2e-2),
                            channels=grain.channels[None], seed=longer, g=medium("glass")[1])
        walked.late *= longer
        walks = [walked.counted(number, 0, through, lambda function, tasks: [function(*task) for task in tasks])
                 for number, through in ((256, False), (4_000, True))]
        counts = together(walked, *walks)[0]
        light = counts.cells[:, 2, 0].reshape(len(counts.cells), 12, -1).sum(axis=-1)[:, 4:], counts.entered[:, 2, 0]
        sums.append(np.concatenate(light, axis=1) / 4e3)
    error = np.sqrt(sum(part.var(axis=0, ddof=1) for part in sums) / len(sums[0]))
    change = np.diff([part.mean(axis=0) for part in sums], axis=0)[0]
    assert np.all(np.abs(change) < 4 * error) and np.median(error / sums[0].mean(axis=0)) < 0.04


@pytest.mark.slow
def test_same_bytes_for_any_number_of_workers():
    with ThreadPoolExecutor(3) as pool:
        several = measured(goniometer("matt", 0.6), [medium("matt")[0]], 0.1,
                           map=lambda function, tasks: list(pool.map(lambda task: function(*task), tasks)))
    single = baked("matt", 0.6, 0.1)[1]
    assert several.hits == single.hits
    for name in ("cells", "scale"):
        for a, b in zip(getattr(several.each[0].factors, name), getattr(single.each[0].factors, name), strict=True):
            assert a.tobytes() == b.tobytes()


@pytest.mark.parametrize("name", ["matt", slow("white")])
def test_energy_and_reciprocity(name):
    """The reflectance adds up to what was counted, and exchanging directions changes nothing."""
    surface, result = baked(name, 0.6, 0.1)
    mu = np.array([2e-3, 0.05, 0.3, 0.7, 1.0])  # 89.9 degrees to 0
    there, back = (surface.reflection(a, b, 0.7) for a, b in ((mu[:, None], mu), (mu, mu[:, None])))
    np.testing.assert_allclose(there, back, rtol=1e-12)
    each = result.each[0]
    at = middles(each.albedo.shape[1], LEAST)
    counted, error = each.albedo.sum(axis=0), np.sqrt((each.albedo_error**2).sum(axis=0))
    if name == "white":
        assert each.lossless
        counted, error = np.ones(len(at)), 0.0
    np.testing.assert_array_less(np.abs(surface.albedos(at**2).sum(axis=0) - counted), 6 * error + 0.012)


@pytest.mark.slow
def test_what_clear_grains_send_back_is_known_better_than_by_which_order():
    """Whether light comes back in a lower order or a higher one is chance, and that it comes back is hardly any.

    The scatter between three seeds is 0.27 +- 0.08 of what the higher orders are off by (five times three seeds): 0.7 is five of
    its standard deviations more, and by chance alone it were 1.
    """
    packed, grain, albedos = tile(0.6), SURFACES["glass"], []
    for seed in (1, 2, 3):
        walked = Goniometer(packed.centers, packed.radii, packed.cell, [Grain(grain)], mu=np.full((1, 1), 1e-3),
                            channels=grain.channels[None], seed=seed, g=medium("glass")[1])
        each = measured(walked, [medium("glass")[0]], 0.01, hits=200_000).each[0]
        albedos.append(each.albedo.sum(axis=0))
    scatter = np.sqrt(np.var(albedos, axis=0, ddof=1).mean())
    assert 0.88 < np.mean(albedos) < 0.95 and scatter < 0.7 * each.albedo_error[2].mean()


def test_black_grains_send_nothing_back():
    surface, result = baked("black", 0.6, 0.1)
    assert result.reached and (surface.reflection(0.5, np.array([2e-3, 0.5, 1.0]), 1.0) == 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("thickness, base", [slow(0.0, None), (0.5, None), slow(4.0, None), (4.0, 1.0)])
def test_layers_of_white_grains_keep_all_light(thickness, base):
    """What comes back and what passes is all there is, and directions may be exchanged; without grains all passes."""
    surface, each = layer("white", thickness, 0.1, base)
    sides = [each] if base else [each, each.below]
    total = sum(side.albedo.sum(axis=0) for side in sides) + (0.0 if base else each.straight)
    assert each.lossless
    np.testing.assert_allclose(total, 1, atol=1e-9)
    mu = np.array([2e-3, 0.05, 0.3, 0.7, 1.0])
    for value in (surface.reflection, surface.transmission)[:len(sides)]:
        np.testing.assert_allclose(value(mu[:, None], mu, 0.7), value(mu, mu[:, None], 0.7), rtol=1e-12)
    if thickness == 0:
        assert (each.straight == 1).all() and each.achieved_error == 0
    elif base is None:
        at, weight = np.polynomial.legendre.leggauss(40)
        out, phi = (0.5 * (1 + at)) ** 2, math.pi * (np.arange(24) + 0.5) / 24
        lobe = surface.transmission(out[:, None], 0.7, phi).mean(axis=-1) @ (2 * out * 0.5 * (1 + at) * weight)
        counted = np.interp(math.sqrt(0.7), middles(BINS, LEAST), each.below.albedo.sum(axis=0))
        assert lobe == pytest.approx(counted, abs=0.01)


@pytest.mark.slow
def test_thick_layers_are_half_spaces():
    """Of grains that take a fifth of the light at each hit, 45 mean flights deep; next to nothing passes."""
    (deep, each), (half, result) = layer("matt", 40.0, 0.02), baked("matt", 0.6, 0.02)
    error = np.hypot(each.albedo_error, result.each[0].albedo_error)
    np.testing.assert_array_less(np.abs(each.albedo - result.each[0].albedo), 6 * error + 2e-3)
    mu0, mu, phi = np.array([0.9, 0.6, 0.3, 0.7]), np.array([0.7, 0.4, 0.8, 0.7]), np.array([2.0, 1.5, 0.5, math.pi])
    np.testing.assert_allclose(deep.reflection(mu, mu0, phi), half.reflection(mu, mu0, phi), rtol=0.08)
    assert each.below.albedo.sum() < 1e-3


@pytest.mark.slow
def test_noise_is_what_it_is_said_to_be():
    """Cells of two seeds differ by their stated errors: chi^2 of the 300 brightest cells, to six of its standard deviations.

    Neighbouring cells share what they are held to, so they scatter by no more than independent ones; and stated errors also hold
    what cells are off by that no seed changes.
    """
    (a, one), (b, other) = (baked("matt", 0.6, 0.1, seed=seed) for seed in (1, 2))
    mu, mu0, phi, weight = pairs.quadrature(SHOWN, (2, 2, 2))
    x, y = ((weight * mu * mu0 * s.reflection(mu, mu0, phi)).sum(axis=1) for s in (a, b))
    assert len(merged(CELLS, SHOWN)) == math.prod(CELLS)
    error = np.hypot(one.each[0].error, other.each[0].error).ravel()
    bright = np.argsort(x + y)[-300:]
    chi = np.mean((2 * (x - y) / (x + y) / error)[bright] ** 2)
    assert 0.1 < chi < 1 + 6 * math.sqrt(2 / 300)


@pytest.mark.slow
def test_one_grain_in_the_tile():
    """A cubic lattice: nothing is lost, and the albedo of white grains is 1."""
    result = measured(goniometer("white", 0.3, 1), [medium("white")[0]], 0.2)
    albedo = result.each[0].albedo.sum(axis=0)
    np.testing.assert_allclose(albedo, 1, atol=1e-9)
    assert result.given_up < 1e-3


@pytest.mark.slow
def test_sparse_grains_are_a_medium():
    """A thousandth of the volume: away from the opposition, the first order is Lommel and Seeliger's with the ball's own phase
    function, in closed form, and albedos are the medium's."""
    surface, result = baked("dark", 0.001, 0.05)
    solution, _ = medium("dark")
    mu0, mu, phi = np.array([0.9, 0.6, 0.3]), np.array([0.7, 0.4, 0.8]), np.array([2.0, 1.5, 2.5])
    cosine = -mu * mu0 + np.sqrt((1 - mu**2) * (1 - mu0**2)) * np.cos(phi)
    alpha = math.pi - np.arccos(cosine)
    lambert = 8 / (3 * math.pi) * (np.sin(alpha) + (math.pi - alpha) * np.cos(alpha))
    closed = 0.1 / 4 * lambert / (mu + mu0)
    np.testing.assert_allclose(surface.orders(mu, mu0, phi)[0], closed, rtol=0.15)
    at = middles(result.each[0].albedo.shape[1], LEAST)
    counted, error = result.each[0].albedo.sum(axis=0), np.sqrt((result.each[0].albedo_error**2).sum(axis=0))
    mediums = np.array([_albedo(solution, m) for m in at**2])
    # spheres' own radius over the mean free path, a thousandth, and the rim at grazing angles
    np.testing.assert_array_less(np.abs(counted - mediums)[4:], (6 * error + 0.02 * mediums)[4:])


def _albedo(solution, mu0):
    x, weight = np.polynomial.legendre.leggauss(64)
    mu, phi = (0.5 * (1 + x)) ** 2, math.pi * (np.arange(32) + 0.5) / 32
    value = solution.reflection(mu[:, None], mu0, phi).mean(axis=-1)
    return float(value @ (2 * mu * 0.5 * (1 + x) * weight))


@pytest.mark.slow
def test_opposition():
    """Shadows vanish where light goes straight back: among sparse grains as shadow hiding has it (Hapke 2012, Theory of
    Reflectance and Emittance Spectroscopy, chapter 9: 1/(1 + tan(alpha/2)/h), h 3/8 of the fraction), and over tens of degrees
    among packed ones, of whose first order media have 0.43 to 0.66."""
    alpha = np.radians([0.0, 0.3, 1.0, 2.0, 4.0, 20.0, 60.0])
    lambert = 8 / (3 * math.pi) * (np.sin(alpha) + (math.pi - alpha) * np.cos(alpha))
    closed = 0.1 / 4 * lambert / (1 + np.cos(alpha))
    packed, sparse = (baked("dark", fraction, tolerance)[0].orders(np.cos(alpha), np.ones(7), np.zeros(7))[0] / closed
                      for fraction, tolerance in ((0.6, 0.05), (0.03, 0.02)))
    np.testing.assert_allclose(sparse, 1 + 1 / (1 + np.tan(alpha / 2) / (3 / 8 * 0.03)), rtol=0.08)  # 0.05 straight back
    assert ((packed[4:] > 1 / 0.66) & (packed[4:] < 1 / 0.43)).all()


# ---- Mitsuba over the same balls


def scene(packed, height, bsdf, copies, depth, base=None, thickness=None):
    """The tile's balls below a plane, repeated; or those within a thickness (radii, up to the tile's height) below it."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    top, centers = height * packed.cell[2], np.mod(packed.centers, packed.cell)
    parts = {"type": "scene", "integrator": {"type": "path", "max_depth": 100000, "rr_depth": 1000}, "mat": bsdf | {"id": "mat"}}
    if thickness is not None:  # from the plane downwards, in one piece
        centers[:, 2] -= packed.cell[2] * (centers[:, 2] > top)
        centers, depth = centers[centers[:, 2] > top - thickness], 0
    for name, keep in (("half", centers[:, 2] <= top), ("full", centers[:, 2] <= math.inf))[:1 + bool(depth)]:
        parts[name] = {"type": "shapegroup"} | {
            f"ball{n}": {"type": "sphere", "center": center.tolist(), "radius": 1.0, "surface": {"type": "ref", "id": "mat"}}
            for n, center in enumerate(centers[keep])}
    for i in range(-copies, copies + 1):
        for j in range(-copies, copies + 1):
            for k in range(-depth, 1):
                shift = mi.ScalarTransform4f().translate((np.array([i, j, k]) * packed.cell).tolist())
                parts[f"tile{i}_{j}_{k}"] = {"type": "instance", "to_world": shift,
                                             "balls": {"type": "ref", "id": "full" if k else "half"}}
    if base is not None:
        bottom = -depth * packed.cell[2] if thickness is None else top - thickness
        under = mi.ScalarTransform4f().translate([0, 0, bottom - 1]).scale(1e4)
        parts["base"] = {"type": "rectangle", "to_world": under,
                         "surface": {"type": "diffuse", "reflectance": {"type": "rgb", "value": base}}}
    return mi, parts


def seen(mi, parts, packed, height, light, theta, azimuth, samples, seed):
    """Mean radiance (3,) towards a direction of the middle tile; theta above pi/2: from below, `height` is the lower plane's."""
    toward = [math.sin(theta) * math.cos(azimuth), math.sin(theta) * math.sin(azimuth), math.cos(theta)]
    x, y, z = packed.cell * np.array([0.5, 0.5, height])
    plane = mi.ScalarTransform4f().translate([x, y, z + math.copysign(1.0001, math.cos(theta))]).scale([x, y, 1])
    sensor = {"type": "distant", "direction": [-part for part in toward], "target": {"type": "rectangle", "to_world": plane},
              "film": {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
              "sampler": {"type": "independent"}}
    loaded = mi.load_dict(parts | {"light": light, "sensor": sensor})
    return np.array(mi.render(loaded, spp=samples, seed=seed)).ravel()[:3]


def sent(mi, parts, packed, height, a, b, phi, samples):
    """pi times BRDF or BTDF of light from an angle to another one (`seen`), mean of twelve azimuths, and its standard error."""
    values = []
    for k in range(12):
        around = 0.1 + 2 * math.pi * k / 12
        travel = [math.sin(a) * math.cos(around), math.sin(a) * math.sin(around), -math.cos(a)]
        light = {"type": "directional", "direction": travel, "irradiance": {"type": "rgb", "value": 1.0}}
        values.append(math.pi / math.cos(a) * seen(mi, parts, packed, height, light, b, around + phi, samples, k)[0])
    return np.mean(values), np.std(values, ddof=1) / math.sqrt(12)


PAIRS = ((20, 0, 0), (20, 20, 180), (60, 60, 0), (60, 40, 90), (75, 60, 180), (45, 10, 0))
STRAIGHT_BACK = ((45, 45, 180), (70, 70, 180), (20, 20.3, 180), (33, 33, 179))
OF_LAYERS = tuple((a, b + 2 * (a == b and phi > 0), phi) for a, b, phi in PAIRS)  # few walks of a layer come straight back


@pytest.mark.slow
@pytest.mark.parametrize("name", ["matt", "dark"])
def test_matt_balls_are_mitsubas(name):
    """Pairs of directions, means over twelve azimuths, of one and the same cut through the tile."""
    packed, height = tile(0.6), 0.5
    surface, result = baked(name, 0.6, 0.01, surface=(height, height))
    noise = result.each[0].error.ravel()
    reflectance = float(SURFACES[name].channels[0, 0])
    mi, parts = scene(packed, height, {"type": "diffuse", "reflectance": {"type": "rgb", "value": reflectance}}, 2, 1)
    for a, b, phi in np.radians(PAIRS + STRAIGHT_BACK):
        mean, error = sent(mi, parts, packed, height, a, b, phi, 4096)
        value = float(surface.reflection(math.cos(b), math.cos(a), phi))
        cells, weight = pairs.interpolation(*(np.array([x]) for x in (math.cos(b), math.cos(a), phi)), result.each[0].error.shape)
        stated = float(noise[cells[0]] @ weight[0])
        print(name, np.degrees((a, b, phi)).round(1), value, mean, error, stated)
        left = BACK if abs(a - b) < 0.018 and math.pi - phi < 0.018 else SMOOTHED
        assert abs(value - mean) < 6 * math.hypot(error, stated * mean) + left * mean, (a, b, phi, value, mean, error, stated)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["matt", "dark"])
def test_light_that_grazes_balls_is_mitsubas(name):
    """At 88.5 and 89.5 degrees, and so, the other way, light that leaves there.  Few balls stand out there, so that means over
    twelve azimuths have standard errors of 2 to 6 %."""
    packed, height = tile(0.6), 0.5
    surface, _ = baked(name, 0.6, 0.02, surface=(height, height))
    grey = {"type": "rgb", "value": float(SURFACES[name].channels[0, 0])}
    for a, copies in ((88.5, 6), (89.5, 16)):
        mi, parts = scene(packed, height, {"type": "diffuse", "reflectance": grey}, copies, 1)
        mean, error = sent(mi, parts, packed, height, *np.radians((a, 45, 90)), 2048)
        value = float(surface.reflection(math.cos(math.radians(45)), math.cos(math.radians(a)), math.pi / 2))
        print(name, a, value, mean, error)
        assert error < 0.08 * mean and abs(value - mean) < 6 * error


RINGS = ((0, 30), (30, 60), (60, 90))


@pytest.mark.slow
@pytest.mark.parametrize("name, bsdf, depth, samples", [
    ("copper", {"type": "conductor", "eta": {"type": "rgb", "value": 0.27}, "k": {"type": "rgb", "value": 3.41}}, 1, 16384),
    ("glass", {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}, 2, 1200)])
def test_shiny_and_clear_balls_are_mitsubas(name, bsdf, depth, samples):
    """Light from rings of the sky, seen at three angles: reciprocal to light of one angle that leaves into rings.

    Each ring is a colour.  Under glass lies a white plane, five transport lengths deep, for what comes back from deeper.
    """
    packed, height = tile(0.6), 0.5
    surface, _ = baked(name, 0.6, 0.03, surface=(height, height))
    mi, parts = scene(packed, height, bsdf, 8 if name == "glass" else 3, depth, 1.0 if name == "glass" else 0.0)
    sky, row, rings = np.zeros((360, 4, 3), np.float32), math.pi * (np.arange(360) + 0.5) / 360, np.radians(RINGS)
    for colour, (low, high) in enumerate(rings):
        sky[(row > low) & (row < high), :, colour] = 1.0
    light = {"type": "envmap", "bitmap": mi.Bitmap(sky), "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], 90)}
    for theta in np.radians([10.0, 65.0]):
        values = np.array([seen(mi, parts, packed, height, light, theta, 0.1 + 2 * math.pi * k / 8, samples // 8, k)
                           for k in range(8)])
        mean, error = values.mean(axis=0), values.std(axis=0, ddof=1) / math.sqrt(8)
        for (low, high), there, off in zip(rings, mean, error, strict=True):
            cosine, phi = np.linspace(math.cos(high), math.cos(low), 49), math.pi * (np.arange(48) + 0.5) / 48
            cosine = 0.5 * (cosine[1:] + cosine[:-1])
            lobe = surface.reflection(cosine[:, None], math.cos(theta), phi).mean(axis=-1)
            value = float(2 * np.mean(lobe * cosine) * (math.cos(low) - math.cos(high)))
            print(name, theta, low, value, there, off)
            assert abs(value - there) < 6 * off + SMOOTHED * there, (theta, low, value, there, off)


@pytest.mark.slow
@pytest.mark.parametrize("name, thickness, base, tolerance", [
    ("matt", 4.0, None, 0.01), ("dark", 1.5, None, 0.03), ("matt", 3.0, 0.7, 0.01)])
def test_layers_of_matt_balls_are_mitsubas(name, thickness, base, tolerance):
    """Both sides of a layer of one to two balls, of one and the same cut through the tile."""
    packed, height = tile(0.6), 0.5
    surface, each = layer(name, thickness, tolerance, base, (height, height))
    grey = {"type": "rgb", "value": float(SURFACES[name].channels[0, 0])}
    mi, parts = scene(packed, height, {"type": "diffuse", "reflectance": grey}, 3, 0, base, thickness)
    for a, b, phi in np.radians(OF_LAYERS):
        for value, side in ((surface.reflection, each), (surface.transmission, each.below))[:1 if base else 2]:
            below = side is each.below
            level, toward = (height - thickness / packed.cell[2], math.pi - b) if below else (height, b)
            mean, error = sent(mi, parts, packed, level, a, toward, phi, 2048)
            there = float(value(math.cos(b), math.cos(a), phi))
            turned = math.pi - phi if below else phi
            cells, weight = pairs.interpolation(*(np.array([x]) for x in (math.cos(b), math.cos(a), turned)), SHOWN)
            stated = float(side.error.ravel()[cells[0]] @ weight[0])
            print(name, thickness, base, below, np.degrees((a, b, phi)).round(), there, mean, error, stated)
            assert abs(there - mean) < 6 * math.hypot(error, stated * mean) + SMOOTHED * mean, (a, b, phi, below)


@pytest.mark.slow
def test_layers_send_as_much_straight_back():
    """By 3 % it is 3 % off in root mean square within a degree of it, as walks are aimed there: without that 12 %."""
    packed, height, thickness = tile(0.6), 0.5, 1.5
    surface, _ = layer("dark", thickness, 0.03, None, (height, height))
    mi, parts = scene(packed, height, {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.1}}, 3, 0, None, thickness)
    for a, b, phi in np.radians(PAIRS[1:2] + STRAIGHT_BACK):
        mean, error = sent(mi, parts, packed, height, a, b, phi, 2048)
        value = float(surface.reflection(math.cos(b), math.cos(a), phi))
        print(np.degrees((a, b, phi)).round(1), value, mean, error)
        assert abs(value - mean) < 6 * error + 0.1 * mean


@pytest.mark.slow
def test_layers_of_clear_balls_are_mitsubas():
    """Light from rings of the sky, a colour each, from both sides of three balls of glass; below, with what passes straight."""
    packed, height, thickness = tile(0.6), 0.5, 6.0
    surface, each = layer("glass", thickness, 0.02, None, (height, height))
    mi, parts = scene(packed, height, {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}, 8, 0, None, thickness)
    sky, row, rings = np.zeros((360, 4, 3), np.float32), math.pi * (np.arange(360) + 0.5) / 360, np.radians(RINGS)
    for colour, (low, high) in enumerate(rings):
        sky[(row > low) & (row < high), :, colour] = 1.0
    light = {"type": "envmap", "bitmap": mi.Bitmap(sky), "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], 90)}
    for theta in np.radians([10.0, 65.0]):
        for value, below in ((surface.reflection, False), (surface.transmission, True)):
            level, toward = (height - thickness / packed.cell[2], math.pi - theta) if below else (height, theta)
            values = np.array([seen(mi, parts, packed, level, light, toward, 0.1 + 2 * math.pi * k / 8, 1024, k)
                               for k in range(8)])
            mean, error = values.mean(axis=0), values.std(axis=0, ddof=1) / math.sqrt(8)
            for (low, high), there, off in zip(rings, mean, error, strict=True):
                cosine, phi = np.linspace(math.cos(high), math.cos(low), 49), math.pi * (np.arange(48) + 0.5) / 48
                cosine = 0.5 * (cosine[1:] + cosine[:-1])
                lobe = value(cosine[:, None], math.cos(theta), phi).mean(axis=-1)
                whole = float(2 * np.mean(lobe * cosine) * (math.cos(low) - math.cos(high)))
                if below and low < theta < high:
                    whole += float(surface.unscattered(math.cos(theta)))
                print("glass", np.degrees((theta, low)).round(), below, whole, there, whole / there - 1, off / there)
                assert abs(whole - there) < 6 * off + SMOOTHED * there, (theta, low, below)
