"""Fog in screen space: the filter against every pair of pixels, and both against integrals over the asset's kernels."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import bakery
from bakery.errors import UsageError
from benchmarks.screen import scene
from renderers import threads
from renderers.fog import filter as screen
from renderers.fog import kernels
from tests.conftest import slow
from tests.oracles import beam as oracle
from tests.oracles.fog import direct, look

RECIPE = """\
bakery: 1
name: fog
wavelengths: [0.45, 0.55, 0.65]
tolerance: 5%
medium: {{albedo: {albedo}, mean_free_path: [10, 8, 12] m, phase: {{type: gaussian, spread: {spread} deg}}}}
beam: {{depth: {depth}, photons: 2000, tolerance: 50%}}
"""


def baked(folder, spread=30, albedo="[1, 0.95, 0.9]", depth=12):
    (folder / "fog.yaml").write_text(RECIPE.format(spread=spread, albedo=albedo, depth=depth))
    return bakery.open(bakery.bake(folder / "fog.yaml", output=folder / "fog.h5"))


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    """Channels are red, green, blue; blue (the shortest wavelength) absorbs nothing."""
    return baked(tmp_path_factory.mktemp("fog"))


@pytest.fixture(scope="module")
def fog(asset):
    return kernels.fog_of(asset)


def rms(found, expected):
    """Root mean square difference over the image's mean, the largest of the channels."""
    axes = tuple(range(found.ndim - 1))
    return float((np.sqrt(np.square(found - expected).mean(axes)) / expected.mean(axes)).max())


# ---- kernels


def test_look_up_is_the_assets_kernel(asset, fog):
    """Linear in a table of 24 steps a decade: 1 % of the largest r Psi."""
    r = np.geomspace(1e-3, 3, 60)
    for tau in (0.004, 0.3, 2.7, 9.1):
        exact = asset.beam.kernel(tau, r * tau, "flux")[::-1] * tau * tau * r
        for c in range(3):
            keep = look(fog, c, tau, 1e-3) / exact[c, 0]  # renormalised: one factor a depth
            # cut where more would be within than arrives; the edge is two steps of the table wide
            near = look(fog, c, tau, r * 1.25) > 0
            assert abs(look(fog, c, tau, r) / keep - exact[c])[near].max() < 0.01 * exact[c].max(), (tau, c)
            assert near[r < 0.5].all()
    assert np.allclose(fog.within[..., -1], 1, atol=1e-9)


def test_means_over_pixels(asset, fog):
    """Against 200 x 200 points a pixel of the asset's own kernel; the one on the axis by polar coordinates."""
    offsets = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
    means = kernels.over_pixels(fog, offsets)
    tau, n = 1.0, 200
    i = round(math.log(tau / fog.depth[0]) / math.log(fog.depth[1] / fog.depth[0]))
    at = (np.arange(n) + 0.5) / n - 0.5
    scale = look(fog, 2, tau, 0.01) / (asset.beam.kernel(tau, 0.01 * tau, "flux")[0] * 0.01 * tau**2)
    for j in np.searchsorted(fog.ratio, (0.003, 0.03, 0.3)):
        u = fog.ratio[j]
        for o, (dx, dy) in enumerate(offsets[1:], 1):
            r = u * np.hypot(dx + at[:, None], dy + at) * tau
            exact = (asset.beam.kernel(tau, r, "flux")[0] * (u * tau) ** 2).mean() * scale
            assert u * means[2, i, j, o] == pytest.approx(exact, rel=0.01)
        # polar integral over the square: no singularity
        angle = (np.arange(400) + 0.5) / 400 * math.pi / 4
        r = (np.arange(2000) + 0.5) / 2000 * (0.5 * u / np.cos(angle))[:, None]
        exact = (8 * scale * asset.beam.kernel(tau, r * tau, "flux")[0] * tau**2 * r * (0.5 * u / np.cos(angle))[:, None]).mean()
        assert u * means[2, i, j, 0] == pytest.approx(exact * math.pi / 4, rel=0.01)


@pytest.mark.slow
def test_deeper_than_the_tables(asset, fog, tmp_path):
    """Shape at twice the deepest depth: 11 % of the light is misplaced."""
    short = kernels.fog_of(baked(tmp_path, depth=5))
    x = np.geomspace(1e-6, 100, 2000)
    weight = math.pi * x * math.log(x[1] / x[0])
    for c in range(3):
        assert (abs(look(short, c, 10.0, x) - look(fog, c, 10.0, x)) * weight).sum() < 0.15


def test_light_that_arrives(asset, fog):
    """Power and shares in rings against photons that a plane stops: behind it there is nothing that would send them back.

    The photons' noise is below 0.4 % of the power and 0.02 in the sum of differences; the seed is fixed.
    """
    theta = np.linspace(0, math.pi, 2001)
    phase = asset.medium.phase(theta)
    for k, albedo in ((0, 1.0), (2, 0.9)):
        for tau, bound in ((0.5, 0.09), (3.0, 0.2)):
            edges = tau * np.r_[0, np.geomspace(0.03, 10, 15), 1e9]
            found = oracle.count(albedo, theta, phase[k], [tau], edges, 100_000, layers=((0.0, tau), (1.0, 0.0)))
            power = found.flux[0] * math.pi * np.diff(edges**2)
            c = 2 - k
            own = fog.powers(np.array(tau / fog.sigma_t[c]), "lost")[0][c]
            assert own == pytest.approx(power.sum(), rel=0.035)
            inside = np.interp(edges / tau, np.r_[0, fog.ratio], np.r_[0, fog.within[c, int(fog.place(tau, fog.depth))]])
            assert abs(np.diff(inside) - power / power.sum()).sum() < bound


def test_powers(fog):
    """Nothing is lost at albedo 1; kept is all but what is absorbed, lost less; thin fog scatters albedo tau."""
    column = np.r_[0, np.geomspace(1e-12, 1e9, 60)]
    tau = column[:, None] * fog.sigma_t
    (kept, none), (lost, back) = fog.powers(column, "kept"), fog.powers(column, "lost")
    assert not none.any() and (back >= 0).all() and (lost <= kept + 1e-12).all()
    assert kept[:, 2] == pytest.approx(-np.expm1(-tau[:, 2]), rel=1e-12)
    assert (lost + back)[:, 2] == pytest.approx(-np.expm1(-tau[:, 2]), rel=1e-6, abs=1e-12)
    absorbing = column[1:] > 0
    assert ((kept <= -np.expm1(-tau))[1:][absorbing]).all()
    assert kept[1:20] == pytest.approx(column[1:20, None] * fog.sigma_s, rel=1e-4)
    straight = np.exp(-column[:, None] * (fog.sigma_t - fog.sigma_s)) * -np.expm1(-column[:, None] * fog.sigma_s)
    assert (kept <= straight * (1 + 1e-6)).all()  # scattered ways are longer than the straight one


class Gaussians:
    """An asset whose beams are Gaussians of known power and width: of two wavelengths one absorbs half, the other nothing."""

    albedo, B, wavelength = np.array([0.5, 1.0]), np.array([0.02, 0.02]), np.array([0.6, 0.5])
    depth = np.geomspace(1e-3, 12, 200)

    def __init__(self, power=1.0):
        self.power, self.beam = power, self
        self.medium = type("Medium", (dict,), {"phase": lambda _, theta: np.full((2, *np.shape(theta)), 1 / (4 * math.pi))})(
            sigma_t=np.array([0.1, 0.2]), albedo=self.albedo)

    def __getitem__(self, name):
        width = np.sqrt(2 * self.B[:, None] * self.depth) * self.depth
        return {"depth": self.depth, "gaussian_b": self.B, "model": np.zeros(2), "beta": width}[name]

    def kernel(self, depth, r, name):
        own = (np.broadcast_to(a, (2, *np.shape(a)[-2:])) for a in (depth, r))
        depth, r = (np.asarray(a, float) for a in own)
        a = self.albedo[:, None, None]
        width = depth**3 * self.B[:, None, None]
        return self.power * np.exp(-(1 - a) * depth) * -np.expm1(-a * depth) * np.exp(-r * r / width) / (math.pi * width)


@pytest.mark.parametrize("power", [1.0, 0.8])
def test_powers_of_a_model_for_comparison(power):
    """Power times e^-tau_a (1 - e^-tau_s), inside of the tables to their trapezoids, 1e-3, and beyond, down to 1e-20."""
    fog = kernels.fog_of(Gaussians(power), channels=2, kernel="small_angle")
    tau = np.array([0.01, 0.3, 3.0, 11.0, 30.0, 90.0])
    for c, albedo in enumerate((0.5, 1.0)):
        found = fog.powers(tau / fog.sigma_t[c], "lost")[0][:, c]
        assert found == pytest.approx(power * np.exp(-(1 - albedo) * tau) * -np.expm1(-albedo * tau), rel=2e-3)
    # the shape is the Gaussian's, whatever its power
    x = np.array([0.01, 0.05, 0.1, 0.2])
    tau = fog.depth[np.searchsorted(fog.depth, 3.0)]
    assert look(fog, 0, tau, x) == pytest.approx(x * np.exp(-x * x / (0.02 * tau)) / (0.02 * math.pi * tau), rel=0.01)
    # beyond the deepest table that shape is stretched, and with it the length that a cut-off counts in
    deep = np.searchsorted(fog.depth, 100.0)
    for c, albedo in enumerate((0.5, 1.0)):
        far, last = kernels._spread(0.02, albedo, np.array([fog.depth[deep], 12.0]))
        square = 0.02 * 12 * far / last
        assert look(fog, c, fog.depth[deep], x) == pytest.approx(x * np.exp(-x * x / square) / (math.pi * square), rel=0.01)
        assert fog.width[c, deep] == pytest.approx(math.sqrt(2 * square), rel=1e-3)


def test_what_arrives_goes_from_the_slab_to_the_share_of_the_integral():
    """Of 0.9 in a plane: 0.5 passes shallow slabs, 5/8 arrives for the first time deep, their geometric mean in between."""
    held = np.array([1e-9, 5.0, 1e3])

    def slab(tau):
        return np.full_like(tau, 0.5), None, np.where(tau < 2e3, 0.8, 1.0)

    expected = np.array([0.5, 0.5 ** math.exp(-1) * (0.9 * 0.625) ** (1 - math.exp(-1)), 0.9 * 0.625])
    assert kernels._arriving(slab, 0.9, held, held) == pytest.approx(expected, rel=1e-8)
    # deeper than the tables it changes as the share does
    assert kernels._arriving(slab, 0.9, held, held + 3e3) == pytest.approx(expected * 0.8, rel=1e-8)


@pytest.mark.parametrize("albedo, tau", [(0.9, 0.05), (0.9, 3.0), (0.5, 30.0), (0.8, 300.0)])
def test_spread_solves_the_moments_of_small_angles(albedo, tau):
    """Covariance of angle and place under scattering, and the loss on longer ways: Riccati's equation, step by step."""
    from scipy.integrate import solve_ivp

    B, loss = 0.1, 1 - albedo
    made = solve_ivp(lambda z, v: (2 * B * albedo - loss * v[0] ** 2, v[0] - loss * v[0] * v[1], 2 * v[1] - loss * v[1] ** 2),
                     (0, tau), (0.0, 0.0, 0.0), rtol=1e-9, atol=1e-14, method="LSODA")
    square = 2 * made.y[2, -1] / tau**2
    assert kernels._spread(B, albedo, np.array([tau]))[0] == pytest.approx(square / (1 + square), rel=1e-5)


# ---- the filter


OPTIONS = [{}, {"outside": "black", "energy": "lost"}, {"cut_off": 1.0}]


@pytest.mark.parametrize("narrow, options", [
    (1, OPTIONS[0]), slow(1, OPTIONS[1]), (1, OPTIONS[2]), slow(20, OPTIONS[0]), (20, OPTIONS[1]), slow(20, OPTIONS[2])])
def test_against_every_pair(fog, options, narrow):
    """With points as close as the blocks 4 % at worst (a small dark picture), with closer ones 1 %."""
    image, z, angle, column, lever = scene(54, 72)
    some = np.random.default_rng(3).choice(z.size, 500, replace=False)
    expected = direct(image, z, angle * narrow, column, lever, fog, pixels=some, **options)
    off = {points: rms(screen.fogged(image, z, angle * narrow, column, lever, fog, points=points, **options).reshape(-1, 3)[some],
                       expected) for points in screen.POINTS}
    assert off["final"] < 0.01 and off["every pixel"] < 0.01 and off["preview"] < 0.015 and off["draft"] < 0.04


@pytest.mark.parametrize("points, bound", [("draft", 0.15), slow("preview", 0.05), slow("final", 0.022), ("every pixel", 0.02)])
def test_points_around_a_lamp(fog, points, bound):
    """A single bright pixel, where points matter most: 12, 4, 1.8 and 1.6 % of the mean of what is seen."""
    image = np.zeros((100, 140, 3))
    image[41, 63] = 100
    some = np.random.default_rng(1).choice(14000, 300, replace=False)
    arguments = image, 20.0, 0.0025, 20.0, 20.0, fog
    expected = direct(*arguments, pixels=some)
    assert rms(screen.fogged(*arguments, points=points).reshape(-1, 3)[some], expected) < bound


@pytest.mark.parametrize("options", [OPTIONS[0], slow(OPTIONS[1]), OPTIONS[2]])
def test_dr_jit_has_the_same_sums(fog, options):
    """Single precision of some thousand terms: 5e-6 of the brightest."""
    on_drjit = pytest.importorskip("renderers.fog.on_drjit")
    arguments = scene(41, 54)
    expected = screen.fogged(*arguments, fog, points="every pixel", **options)
    assert abs(on_drjit.fogged(*arguments, fog, backend="llvm", **options) - expected).max() < 5e-6 * expected.max()


@pytest.mark.slow
def test_dr_jit_with_other_channels(fog):
    """One wavelength for two channels; a medium of two; distances that are all one; a constant stays."""
    from renderers.fog import on_drjit

    image, z, angle, column, lever = scene(30, 37)
    names = ("sigma_t", "sigma_s", "g", "peak", "shape", "width")
    for some in ([1], [0, 2]):
        medium = replace(fog, **{name: getattr(fog, name)[some] for name in names})
        for distance in (z, np.full_like(z, 7.0)):
            arguments = image[..., :2], distance, angle, column, lever, medium
            expected = screen.fogged(*arguments, points="every pixel")
            assert abs(on_drjit.fogged(*arguments, backend="llvm") - expected).max() < 5e-6 * expected.max()
    constant = on_drjit.fogged(np.full_like(image, 0.7), z, angle, column, lever, fog, backend="llvm")
    assert constant[..., 2] == pytest.approx(0.7, rel=3e-6)
    clear = on_drjit.fogged(image, z, angle, np.zeros_like(z), np.zeros_like(z), fog, backend="llvm")
    assert clear == pytest.approx(image, rel=1e-6)


@pytest.mark.parametrize("size", [(1, 1), (7, 60), (37, 22)])
@pytest.mark.parametrize("pixel", [1e-9, 1e-3, 0.1, 100.0])
@pytest.mark.parametrize("cut_off", [None, 0.5])
def test_a_constant_stays(fog, size, pixel, cut_off):
    """Without absorption, for any distances and any fog: near and far shares are of one."""
    _, z, _, column, lever = scene(*size)
    found = screen.fogged(np.full((*size, 3), 0.7), z, pixel, column, lever, fog, cut_off=cut_off)
    assert found[..., 2] == pytest.approx(0.7, rel=1e-7)  # single precision of kernels, twice
    same = screen.fogged(np.full((*size, 3), 0.7), 30.0, pixel, 17.0, 25.0, fog, cut_off=cut_off)
    left = np.exp(-17.0 * fog.sigma_t) + fog.powers(np.array(17.0), "kept")[0]
    assert same == pytest.approx(np.broadcast_to(0.7 * left, same.shape), rel=1e-7)
    lost = screen.fogged(np.full((*size, 3), 0.7), 30.0, pixel, 17.0, 25.0, fog, energy="lost")
    assert (lost <= same * (1 + 1e-7)).all() and (lost < 0.98 * same).all()


def test_no_fog_no_change(fog):
    image, z, angle, column, lever = scene(40, 50)
    assert (screen.fogged(image, z, angle, 0.0, 0.0, fog) == image).all()
    clear = z > 50
    mixed = screen.fogged(image, z, angle, np.where(clear, 0, column), lever, fog)
    assert (mixed[clear] == image[clear]).all() and (mixed[~clear] != image[~clear]).all()


def test_halo_of_a_lamp(asset, fog):
    """One bright pixel on a black wall: its halo is the asset's kernel, times a pixel's area, at any place and any scale."""
    tau = np.array([2.0])
    column = float(tau[0] / fog.sigma_t[2])
    for u in (0.002, 0.02):  # pixel over distance
        image = np.zeros((90, 90, 3))
        image[37, 41] = 1
        found = screen.fogged(image, 20.0, u, column, 20.0, fog, outside="black")
        r = np.hypot(*np.mgrid[-37:53, -41:49]) * u
        far = (r > 2.5 * u) & (r < 1)
        exact = asset.beam.kernel(tau, np.maximum(r, u) * tau, "flux")[0] * (u * tau) ** 2
        power = -math.expm1(-tau[0])
        exact *= power * look(fog, 2, tau, 0.01) / (0.01 * tau**2 * asset.beam.kernel(tau, 0.01 * tau, "flux")[0])
        assert found[..., 2][far] == pytest.approx(exact[far], rel=0.06)
        assert np.sqrt(np.mean((found[..., 2][far] / exact[far] - 1) ** 2)) < 0.02
        assert abs(np.mean(found[..., 2][far] / exact[far] - 1)) < 0.01


def test_edges_do_not_bleed(fog):
    """Half the picture is near, half far: closed forms of both sides from the share H of the near kernel beyond a line."""
    u, x = 0.2, np.arange(80) + 0.5 - 40
    near_column, far_column, c = 8.0, 40.0, 2
    tau = near_column * fog.sigma_t[c]
    place = round(float(fog.place(tau, fog.depth)))
    near_column, tau = float(fog.depth[place] / fog.sigma_t[c]), float(fog.depth[place])
    weight = np.diff(fog.within[c, place], prepend=0)
    H = np.array([np.sum(weight * np.arccos(np.clip(d * u / fog.ratio, -1, 1))) / math.pi for d in abs(x)])
    left = np.broadcast_to(x < 0, (90, 80))
    z, column = np.where(left, 5.0, 50.0), np.where(left, near_column, far_column)
    share, far_share = -math.expm1(-tau), -math.expm1(-far_column * fog.sigma_s[c])

    def middle(bright):
        image = np.where(bright, 1.0, 0.0)[..., None] * np.ones(3)
        return screen.fogged(image, z, u * z / z, column, z, fog)[45, :, c]

    # the picture ends 40 pixels from the edge: compare near it, where the kernel sees nothing of that
    here = abs(x) < 10
    dark, bright = middle(~left), middle(left)
    assert dark[here & (x < 0)] == pytest.approx((share * H)[here & (x < 0)], abs=0.01)
    assert bright[here & (x > 0)] == pytest.approx((share * H)[here & (x > 0)], abs=0.01)
    # no light of the wall is lost behind the near thing, none is invented: both pictures add up to the constant
    assert dark + bright == pytest.approx(1.0, abs=1e-7)
    exact = math.exp(-far_column * fog.sigma_t[c]) + far_share - share * H
    assert dark[here & (x > 0)] == pytest.approx(exact[here & (x > 0)], abs=0.01)


def test_resolution_does_not_matter(fog):
    """Pixels as 2 x 2 of their kind; no lamps, whose own pixel is as large as they are."""
    image, z, angle, column, lever = scene(32, 40)
    image = np.minimum(image, 1)
    coarse = screen.fogged(image, z, angle, column, lever, fog)
    fine = screen.fogged(*(np.repeat(np.repeat(a, 2, 0), 2, 1) for a in (image, z, angle / 2, column, lever)), fog)
    assert rms(fine.reshape(32, 2, 40, 2, 3).mean((1, 3)), coarse) < 0.005


def test_dark_surroundings(fog):
    """White picture, black outside: at its middle the share of the kernel inside of the picture."""
    n, u, c = 101, 0.02, 2
    i = int(fog.place(2.0, fog.depth))
    tau = float(fog.depth[i])
    column = tau / fog.sigma_t[c]
    found = screen.fogged(np.ones((n, n, 3)), 10.0, u, column, 10.0, fog, outside="black")
    angle = (np.arange(200) + 0.5) / 200 * math.pi / 4
    inside = np.interp(n / 2 * u / np.cos(angle), fog.ratio, fog.within[c, i]).mean()
    assert 0.5 < inside < 0.98
    assert found[n // 2, n // 2, c] == pytest.approx(math.exp(-tau) - math.expm1(-tau) * inside, rel=0.01)


def test_cut_off(fog):
    image = np.zeros((60, 60, 3))
    image[30, 30] = 1
    u, column = 0.05, 10.0
    found, exact = (screen.fogged(image, 10.0, u, column, 10.0, fog, cut_off=1.0, points=points)
                    for points in ("final", "every pixel"))
    length = [float(np.interp(np.log(column * s), np.log(fog.depth), w)) for s, w in zip(fog.sigma_t, fog.width)]
    r = np.hypot(*np.mgrid[-30:30, -30:30]) * u
    for c in range(3):
        beyond, within = r > 1.2 * length[c], (r > 0) & (r < 0.8 * length[c])
        assert exact[beyond, c].max() < 1e-6 < 1e-4 < exact[within, c].min()
        # linear between points that are two pixels apart: 1.5e-6 gets past the edge
        assert found[beyond, c].max() < 3e-6 < 1e-4 < found[within, c].min()


@pytest.mark.slow
def test_one_wavelength_for_all_channels(fog):
    """The same as three alike, for a picture of any number of channels."""
    image, z, angle, column, lever = scene(50, 40)
    one, three = (replace(fog, **{name: getattr(fog, name)[[1] * count] for name in
                                  ("sigma_t", "sigma_s", "g", "peak", "shape", "width")}) for count in (1, 3))
    for options in ({}, {"outside": "black", "energy": "lost"}, {"cut_off": 1.0}):
        found = screen.fogged(image, z, angle, column, lever, one, **options)
        assert (found == screen.fogged(image, z, angle, column, lever, three, **options)).all()
        two = screen.fogged(image[..., :2], z, angle, column, lever, one, **options)
        assert rms(two, found[..., :2]) < 0.003  # a block's light is centred by all channels together
    exact = [direct(image, z, angle, column, lever, kind, pixels=np.arange(0, 2000, 60)) for kind in (one, three)]
    assert (exact[0] == exact[1]).all()


def test_threads_do_not_matter(fog, monkeypatch):
    arguments, pictures = scene(50, 40), []
    for count in (1, 3):
        with ThreadPoolExecutor(count) as pool:
            monkeypatch.setattr(threads, "_pool", lambda pool=pool: pool)
            pictures.append(screen.fogged(*arguments, fog))
    assert (pictures[0] == pictures[1]).all()


@pytest.mark.parametrize("spread", [slow(0.1), slow(90)])
def test_extremes(tmp_path, spread):
    """Optical depths 1e-8 to 1e3, albedo 0, 1/2 and 1: finite, not negative, never brighter than what shines."""
    fog = kernels.fog_of(baked(tmp_path, spread, "[0, 0.5, 1]", 4))
    if spread == 0.1:
        # ten times deeper than the tables: M2/M0 = 4/3 B tau/(1 - e^-tau), B half the square of the spread; 1 - e^-4 at the last
        x = np.geomspace(1e-6, 1, 2000)
        square = np.trapezoid(2 * math.pi * x**3 * look(fog, 0, 40.0, x), np.log(x))
        assert square == pytest.approx(2 / 3 * math.radians(spread) ** 2 * 40 / -math.expm1(-4), rel=0.05)
    image, z, angle, column, _ = scene(12, 16)
    for tau in (1e-8, 1.0, 1e3):
        for lever in (0.0, 1e-9, 1e9):
            deep = column / column.max() * tau / fog.sigma_t.max()
            for options in ({}, {"outside": "black"}, {"energy": "lost"}, {"cut_off": 2.0}):
                found = screen.fogged(image, z, angle, deep, lever, fog, **options)
                assert np.isfinite(found).all() and (found >= 0).all()
                assert found.max() <= image.max() * (1 + 2e-4)  # light and shares of a block have two centres: 6e-5
            assert found[..., 2] == pytest.approx(np.exp(-deep * fog.sigma_t[2]) * image[..., 2], rel=1e-12)
        if spread == 0.1 and tau <= 1:  # narrower than a pixel: nothing is blurred
            assert screen.fogged(image, z, 0.1, deep, z, fog)[..., 0] == pytest.approx(image[..., 0], abs=0.03 * image.max())


@pytest.mark.parametrize("kernel", ["fluence", "forward", "small_angle", "erf", "path_integral", "elek", "single"])
@pytest.mark.slow
def test_other_kernels(asset, kernel):
    other = kernels.fog_of(asset, kernel=kernel)
    image, z, angle, column, lever = scene(30, 40)
    some = np.arange(0, z.size, 7)
    found = screen.fogged(image, z, angle, column, lever, other)
    assert rms(found.reshape(-1, 3)[some], direct(image, z, angle, column, lever, other, pixels=some)) < 0.015
    assert screen.fogged(np.ones_like(image), z, angle, column, lever, other)[..., 2] == pytest.approx(1, rel=1e-7)


def test_bad_input(asset, fog):
    image, z, angle, column, lever = scene(6, 8)
    far = z.copy()
    far[2, 3] = math.inf
    for arguments, text in (((image, far, angle, column, lever), "distance: inf at row 2, column 3; a finite number above 0"),
                            ((image, z, angle, column[:2], lever), r"column: shape \(2, 8\); \(6, 8\) would do"),
                            ((image, z, angle, -column, lever), "column: -"),
                            ((image, z, 0.0, column, lever), "angle: 0 at row 0"),
                            ((image[..., :2], z, angle, column, lever), r"image: shape \(6, 8, 2\)"),
                            ((image * np.inf, z, angle, column, lever), "image: row 0, column 0 is not finite")):
        with pytest.raises(UsageError, match=text):
            screen.fogged(*arguments, fog)
    for options, text in (({"outside": "white"}, "edge or black"), ({"energy": "more"}, "kept or lost"),
                          ({"cut_off": 0}, "filter.cut_off"), ({"points": "good"}, "points 'good'; draft, preview, final")):
        with pytest.raises(UsageError, match=text):
            screen.fogged(image, z, angle, column, lever, fog, **options)
    with pytest.raises(UsageError, match="3 wavelengths for a picture of 1 channels"):
        kernels.fog_of(asset, channels=1)
    with pytest.raises(UsageError, match="filter.kernel: "):
        kernels.fog_of(asset, kernel="best")


def test_without_a_graphics_card(fog, monkeypatch):
    """One message; what would do."""
    from renderers.fog import on_drjit

    monkeypatch.setattr(on_drjit.dr, "has_backend", lambda backend: False)
    with pytest.raises(UsageError, match="no graphics card that CUDA could use"):
        on_drjit.fogged(*scene(6, 8), fog)
