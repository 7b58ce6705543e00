"""The plugin `bakedphase`: it samples the baked table, evaluates it, and puts it the right way round.

All draws are seeded.  A test that compares with chance is made so that a right program fails it with odds below 1e-7.
"""

import numpy as np
import pytest
from scipy import stats

renderer = pytest.importorskip("renderers.mitsuba", exc_type=ImportError)  # before mitsuba: it finds LLVM for it

import drjit as dr
import mitsuba as mi

from renderers.mitsuba import passes, tables
from renderers.preview import preview
from tests.conftest import slow
from tests.devices import jit, on_each_device
from tests.odds import ODDS
from tests.physics.media import RGB, angles, asset_file, henyey_greenstein


def variants(*names):
    """Those with `llvm` on a graphics card too, where there is one."""
    return pytest.mark.parametrize("variant", [each for name in names for each in
                                               (jit(name.removeprefix("llvm_")) if name.startswith("llvm") else [name])])


def load(path, **parameters):
    return mi.load_dict({"type": "bakedphase", "filename": path, **parameters})


def interaction(wi=(0.3, 0.2, 0.9), wavelengths=()):
    mei = dr.zeros(mi.MediumInteraction3f)
    mei.wi = dr.normalize(mi.Vector3f(*wi))
    if wavelengths:
        mei.wavelengths = type(mei.wavelengths)(*wavelengths)
    return mei


def mean_cosines(held):
    """(L,), exact for the interpolant of `renderers.mitsuba.tables.Tables`."""
    f0, f1, s0, h = held.value[:, :-1], held.value[:, 1:], held.s[:-1], np.diff(held.s)
    return 1 - 8 * np.pi * np.sum(h * (s0 * (f0 + f1) / 2 + h * (f0 / 6 + f1 / 3)), axis=1)


def drawn(phase, count, mei=None, seed=0):
    """`count` samples: (directions (N, 3), weights (N, channels), pdf (N,))."""
    mei = interaction() if mei is None else mei
    random = np.random.default_rng(seed).random((3, count)).astype(np.float32)
    context = mi.PhaseFunctionContext(None)
    if dr.is_jit_v(mi.Float):
        wo, weight, pdf = phase.sample(context, mei, mi.Float(random[0]), mi.Point2f(mi.Float(random[1]), mi.Float(random[2])))
        weight = np.array(weight).reshape(-1, count).T if np.size(np.array(weight)) > 1 else np.ones((count, 1))
        return np.array(wo, dtype=float).T, weight, np.array(pdf)
    rows = [phase.sample(context, mei, float(a), mi.Point2f(float(b), float(c))) for a, b, c in random.T]
    return (np.array([np.array(wo) for wo, _, _ in rows], dtype=float), np.array([np.array(w).ravel() for _, w, _ in rows]),
            np.array([pdf for _, _, pdf in rows]))


def s_of(wo, wi):
    """sin^2(theta/2) of directions (N, 3), in double precision."""
    wi = np.array(wi, dtype=float).ravel()
    return ((wo / np.linalg.norm(wo, axis=1)[:, None] + wi / np.linalg.norm(wi)) ** 2).sum(axis=1) / 4


def share_below(theta, phase, s):
    """Share of the light scattered into sin^2(angle/2) < s, exact for a table (A,) that is linear in between."""
    nodes = np.sin(theta / 2) ** 2
    cdf = np.concatenate([[0], np.cumsum(2 * np.pi * (phase[1:] + phase[:-1]) * np.diff(nodes))])
    i = np.clip(np.searchsorted(nodes, s, side="right") - 1, 0, len(nodes) - 2)
    x = s - nodes[i]
    slope = (phase[i + 1] - phase[i]) / (nodes[i + 1] - nodes[i])
    return (cdf[i] + 4 * np.pi * (phase[i] * x + slope * x * x / 2)) / cdf[-1]


def peaked(theta, x):
    """Half of the light in the core of the diffraction of a sphere of size parameter x, half everywhere alike."""
    return x**2 / (8 * np.pi) * np.exp(-((x * theta) ** 2) / 4) + 1 / (8 * np.pi)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("assets")


@pytest.fixture(scope="module")
def grey(folder):
    return asset_file(folder / "grey.h5", henyey_greenstein(0.8, angles()))


@pytest.fixture(scope="module")
def coloured(folder):
    return asset_file(folder / "coloured.h5", henyey_greenstein([0.9, 0.7, 0.2], angles()), wavelength=RGB, sigma_t=[1, 2, 4],
                      albedo=[0.5, 0.5, 1.0])


@pytest.mark.slow
@variants("llvm_ad_mono", "scalar_rgb")
@pytest.mark.parametrize("wi", [(0.3, 0.2, 0.9), (0, 0, -1), (0, 1, 0)])
def test_sampling_follows_the_table(variant, wi, grey):
    """Chi-square on 24 x 8 cells in (s, azimuth); a right sampler gives p < 1e-8 with those odds."""
    mi.set_variant(variant)
    count = 400_000 if dr.is_jit_v(mi.Float) else 20_000
    mei = interaction(wi)
    wo, _, _ = drawn(load(grey), count, mei)
    theta, phase = angles(), henyey_greenstein(0.8, angles())[0]
    edges = np.interp(np.linspace(0, 1, 25), share_below(theta, phase, np.sin(theta / 2) ** 2), np.sin(theta / 2) ** 2)
    edges[[0, -1]] = 0, 1 + 1e-6
    share = np.diff(share_below(theta, phase, np.minimum(edges, 1.0)))
    first = np.cross(wi, (0.36, 0.48, -0.8))
    second = np.cross(wi, first)
    azimuth = np.arctan2(wo @ second / np.linalg.norm(second), wo @ first / np.linalg.norm(first))
    seen, _, _ = np.histogram2d(s_of(wo, mei.wi), azimuth, bins=[edges, np.linspace(-np.pi, np.pi, 9)])
    expected = np.repeat(count * share[:, None] / 8, 8, axis=1)
    assert seen.sum() == count
    assert stats.chi2.sf(((seen - expected) ** 2 / expected).sum(), expected.size - 1) > ODDS
    # The same draws against a table that is off by 0.02 in g must fail.
    wrong = np.diff(share_below(theta, henyey_greenstein(0.82, theta)[0], np.minimum(edges, 1.0)))[:, None] * count / 8
    if count > 1e5:
        assert stats.chi2.sf(((seen - wrong) ** 2 / wrong).sum(), expected.size - 1) < ODDS


@variants("llvm_ad_mono", "llvm_ad_rgb", "scalar_rgb", "scalar_spectral")
def test_value_is_the_table_and_pdf_is_the_value(variant, grey):
    mi.set_variant(variant)
    phase, mei = load(grey), interaction()
    wo, weight, pdf = drawn(phase, 200, mei)
    np.testing.assert_allclose(weight, 1, rtol=1e-5)
    s = s_of(wo, mei.wi)
    nodes = np.sin(angles() / 2) ** 2
    baked = henyey_greenstein(0.8, angles())[0]
    table = np.interp(s, nodes, baked / (2 * np.pi * np.sum((baked[1:] + baked[:-1]) * np.diff(nodes))))
    # Float32 directions: s is uncertain by 1e-7 * sqrt(s), the steepest part of the table is d ln f / ds = 30 here.
    np.testing.assert_allclose(pdf, table, rtol=2e-4)
    for direction, expected in zip(wo[:20], pdf):
        value, density = phase.eval_pdf(mi.PhaseFunctionContext(None), mei, mi.Vector3f(*map(float, direction)))
        assert np.array(density).item() == pytest.approx(expected, rel=1e-4)
        np.testing.assert_allclose(np.array(value).ravel(), expected, rtol=1e-4)


@variants("llvm_ad_mono", "scalar_rgb")
def test_forward_is_where_the_light_was_going(variant, grey):
    """`wi` points back along the path: the peak is at wo = -wi, as in Mitsuba's own `hg`."""
    mi.set_variant(variant)
    phase, own, mei, context = load(grey), mi.load_dict({"type": "hg", "g": 0.8}), interaction(), mi.PhaseFunctionContext(None)
    for wo in (-mei.wi, mei.wi, mi.Frame3f(mei.wi).s):
        ours, theirs = (np.array(p.eval_pdf(context, mei, wo)[1]).item() for p in (phase, own))
        assert ours == pytest.approx(theirs, rel=1e-3)
    forward, backward = (np.array(phase.eval_pdf(context, mei, wo)[1]).item() for wo in (-mei.wi, mei.wi))
    assert forward > 100 * backward


@on_each_device
@pytest.mark.parametrize("x", [100, 1000, 30_000])
def test_sharp_peaks_survive(device, x, folder):
    """g and the share of the peak, against the function itself on a grid 20 times finer; sampled, within 5 standard errors."""
    theta = np.union1d(np.concatenate([[0], np.geomspace(0.02 / x, 12 / x, 500)]), np.linspace(12 / x, np.pi, 500))
    fine = np.concatenate([np.interp(np.arange(20 * (len(theta) - 1)) / 20, np.arange(len(theta)), theta), [np.pi]])
    mu_step = np.diff(np.sin(fine / 2) ** 2)
    exact = peaked(fine, x)
    mean_s = (np.sum(mu_step * (exact[1:] * np.sin(fine[1:] / 2) ** 2 + exact[:-1] * np.sin(fine[:-1] / 2) ** 2) / 2)
              / np.sum(mu_step * (exact[1:] + exact[:-1]) / 2))
    path = asset_file(folder / f"peak{x}.h5", peaked(theta, x), theta=theta)
    held = tables.load(path)
    assert mean_cosines(held)[0] == pytest.approx(1 - 2 * mean_s, abs=1e-3)
    assert held.cdf()[0, -1] == 1
    mi.set_variant(f"{device}_ad_mono")
    mei = interaction()
    wo, _, pdf = drawn(load(path), 400_000, mei)
    s = s_of(wo, mei.wi)
    assert np.all(pdf > 0)
    assert s.mean() == pytest.approx(mean_s, abs=5.5 * s.std() / 632 + 5e-4)
    limit = np.sin(1.0 / x) ** 2
    share = share_below(theta, peaked(theta, x), limit)
    assert np.mean(s < limit) == pytest.approx(share, abs=5.5 * np.sqrt(share * (1 - share) / 4e5) + 1e-3)


def test_normalised_on_float32_nodes(folder):
    """Angles that float32 cannot tell apart are merged, the integral stays 1 and both ends stay."""
    theta = np.concatenate([[0], np.geomspace(1e-7, 0.1, 300), np.linspace(0.1, np.pi - 1e-3, 300)[1:],
                            np.pi - np.geomspace(1e-3, 1e-7, 50)[1:], [np.pi]])
    held = tables.load(asset_file(folder / "ends.h5", henyey_greenstein(0.9, theta), theta=theta))
    assert held.s[0] == 0 and held.s[-1] == 1 and np.all(np.diff(held.s) > 0)
    assert len(held.s) < len(theta)
    assert 2 * np.pi * np.sum((held.value[0, 1:] + held.value[0, :-1]) * np.diff(held.s)) == pytest.approx(1, abs=1e-14)
    assert held.value[0, -1] == pytest.approx(henyey_greenstein(0.9, np.pi).item(), rel=2e-3)


@variants("llvm_ad_rgb", "scalar_rgb")
def test_a_table_for_each_channel(variant, coloured):
    """One direction serves all channels; with its weights each channel keeps its own mean cosine (5.5 standard errors)."""
    mi.set_variant(variant)
    phase, mei = load(coloured), interaction()
    count = 400_000 if dr.is_jit_v(mi.Float) else 20_000
    wo, weight, pdf = drawn(phase, count, mei)
    cosine = 1 - 2 * s_of(wo, mei.wi)
    for channel, g in enumerate((0.9, 0.7, 0.2)):
        product = weight[:, channel] * cosine
        assert product.mean() == pytest.approx(g, abs=5.5 * product.std() / np.sqrt(count) + 1e-3)
        assert weight[:, channel].mean() == pytest.approx(1, abs=5.5 * weight[:, channel].std() / np.sqrt(count))
    assert weight.max() <= 3 + 1e-4  # the density is the mean of the three


@variants("llvm_ad_spectral", "scalar_spectral")
def test_between_wavelengths(variant, coloured):
    """Linear in wavelength between the tables, clamped outside."""
    mi.set_variant(variant)
    phase, mei = load(coloured), interaction(wavelengths=(400.0, 465.0, 580.0, 800.0))
    wo = mi.Frame3f(mei.wi).s
    value, pdf = phase.eval_pdf(mi.PhaseFunctionContext(None), mei, wo)
    at = np.array([np.interp(0.5, np.sin(angles() / 2) ** 2, row) for row in henyey_greenstein([0.9, 0.7, 0.2], angles())])
    expected = [at[2], at[2], (at[0] + at[1]) / 2, at[0]]
    np.testing.assert_allclose(np.array(value).ravel(), expected, rtol=1e-3)
    assert np.array(pdf).item() == pytest.approx(np.mean(expected), rel=1e-3)
    count = 200_000 if dr.is_jit_v(mi.Float) else 10_000
    directions, weight, _ = drawn(phase, count, mei)
    product = weight * (1 - 2 * s_of(directions, mei.wi))[:, None]
    for channel, g in enumerate((0.2, 0.2, 0.8, 0.9)):
        assert product[:, channel].mean() == pytest.approx(g, abs=5.5 * product[:, channel].std() / np.sqrt(count) + 1e-3)


def test_which_tables(coloured, folder):
    mi.set_variant("scalar_rgb")
    assert mean_cosines(load(coloured, channel=1).tables) == pytest.approx([0.7], abs=1e-3)
    assert load(coloured, wavelength=0.58).tables.wavelength == pytest.approx([0.58])
    assert mean_cosines(load(coloured, wavelength=0.58).tables) == pytest.approx([0.8], abs=1e-3)
    assert mean_cosines(load(coloured, wavelength=1.0).tables) == pytest.approx([0.9], abs=1e-3)
    weight = np.array([0.5, 1.0, 4.0])  # sigma_s
    assert mean_cosines(tables.load(coloured).selected())[0] == pytest.approx(weight @ [0.9, 0.7, 0.2] / weight.sum(), abs=1e-3)
    eight = asset_file(folder / "eight.h5", henyey_greenstein(np.linspace(0.1, 0.8, 8), angles()),
                       wavelength=np.arange(0.405, 0.76, 0.05))
    red, green, blue = mean_cosines(tables.load(eight).selected(bands="rgb"))
    assert 0.1 < blue < 0.35 < green < 0.45 < red < 0.7
    for wrong in ({"channel": 3}, {"wavelength": -1.0}):
        with pytest.raises(Exception, match="wavelengths; give|give micrometres"):
            load(coloured, **wrong)


def image_of(phase, seed):
    scene = mi.load_dict({
        "type": "scene", "integrator": {"type": "volpath", "max_depth": 64, "rr_depth": 64},
        "sensor": {"type": "perspective", "fov": 32, "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
                   "film": {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "box"},
                            "pixel_format": "luminance"}},
        "light": {"type": "rectangle", "to_world": mi.ScalarTransform4f().look_at([3, 0.5, -2], [0, 0, 0], [0, 1, 0]),
                  "emitter": {"type": "area", "radiance": 10.0}},
        "ball": {"type": "sphere", "bsdf": {"type": "null"},
                 "interior": {"type": "homogeneous", "sigma_t": 1.0, "albedo": 0.9, "phase": phase}}})
    picture = passes.render([scene], np.ones((3, 1)), samples=1024, per_pass=256, seed=seed)
    return picture.rgb[..., 0], picture.variance[..., 0]


def largest_z(a, b):
    """Largest difference of two pictures in standard errors, over blocks of 8 x 8 pixels (near normal by their 65,536 paths)."""
    def blocks(image):
        return image.reshape(3, 8, 3, 8).mean(axis=(1, 3))

    error = np.sqrt((blocks(a[1]) + blocks(b[1])) / 64)
    return np.max(np.abs(blocks(a[0]) - blocks(b[0])) / error)


@on_each_device
@pytest.mark.slow
def test_image_equals_hg(device, folder):
    """9 blocks: |z| < 6 everywhere but for odds of 2e-8; a g that is off by 0.07 is seen."""
    mi.set_variant(f"{device}_ad_mono")
    reference = image_of({"type": "hg", "g": 0.7}, 1)
    ours = image_of({"type": "bakedphase", "filename": asset_file(folder / "hg70.h5", henyey_greenstein(0.7, angles()))}, 2)
    other = image_of({"type": "bakedphase", "filename": asset_file(folder / "hg77.h5", henyey_greenstein(0.77, angles()))}, 3)
    assert largest_z(reference, ours) < 6
    assert largest_z(reference, other) > 6


def rayleigh(folder):
    theta = np.linspace(0, np.pi, 400)
    mu = np.cos(theta)
    k = 3 / (16 * np.pi)
    return asset_file(folder / "rayleigh.h5", k * (1 + mu**2), theta=theta,
                      elements={"s12": k * (mu**2 - 1), "s33": 2 * k * mu, "s34": 0 * mu})


@variants("llvm_ad_spectral_polarized", "scalar_spectral_polarized")
def test_sky_polarisation(variant, folder):
    """Sun overhead, level view, single Rayleigh scattering: vibration across the plane of sun and view, that is horizontal."""
    mi.set_variant(variant)
    path = rayleigh(folder)
    results = []
    for up in ((0, 1, 0), (1, 1, 0), (1, 0, 0)):
        scene = mi.load_dict({
            "type": "scene", "integrator": {"type": "stokes", "nested": {"type": "volpath", "max_depth": 2}},
            "sensor": {"type": "perspective", "fov": 1,
                       "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], list(up)),
                       "film": {"type": "hdrfilm", "width": 2, "height": 2, "rfilter": {"type": "box"}}},
            "sun": {"type": "directional", "direction": [0, -1, 0], "irradiance": 1.0},
            "ball": {"type": "sphere", "bsdf": {"type": "null"},
                     "interior": {"type": "homogeneous", "sigma_t": 0.5, "albedo": 1.0,
                                  "phase": {"type": "bakedphase", "filename": path}}}})
        mean = np.array(mi.render(scene, spp=64, seed=0)).mean(axis=(0, 1))[-12:].reshape(4, 3).mean(axis=1)
        results.append(mean[1:] / mean[0])
    upright, rolled, sideways = results
    # The view is 0.5 degrees wide: its edge is off 90 degrees by 0.01 rad, which costs 1e-4.
    np.testing.assert_allclose(upright, [1, 0, 0], atol=1e-2)
    np.testing.assert_allclose([rolled[0], abs(rolled[1]), rolled[2]], [0, 1, 0], atol=2e-2)
    np.testing.assert_allclose(sideways, [-1, 0, 0], atol=1e-2)


@variants("llvm_ad_spectral_polarized", "scalar_spectral_polarized")
@pytest.mark.parametrize("incidence", [slow(0.3), 0.8, slow(1.2)])
def test_mueller_matrix_is_that_of_a_mirror(variant, incidence, folder):
    """A large absorbing sphere reflects like a plane: all elements and signs against Mitsuba's own Fresnel reflection.

    S1, S2 are Fresnel's amplitudes for m = n + ik (van de Hulst 1957, section 12.22); scattering angle pi - 2 incidence.
    """
    mi.set_variant(variant)
    m, cosine = 1.5 + 0.8j, np.cos(incidence)
    inside = np.sqrt(1 - (np.sin(incidence) / m) ** 2)
    s1, s2 = (cosine - m * inside) / (cosine + m * inside), (m * cosine - inside) / (m * cosine + inside)
    s11 = (abs(s1) ** 2 + abs(s2) ** 2) / 2
    flat = np.full((1, 9), 1 / (4 * np.pi))
    elements = {"s12": (abs(s2) ** 2 - abs(s1) ** 2) / 2, "s33": (s2 * np.conj(s1)).real, "s34": (s2 * np.conj(s1)).imag}
    path = asset_file(folder / f"mirror{incidence}.h5", flat, theta=np.linspace(0, np.pi, 9),
                      elements={name: value / s11 * flat for name, value in elements.items()})
    normal = dr.normalize(mi.Vector3f(0.2, -0.5, 0.7))
    frame, x, z = mi.Frame3f(normal), float(np.sin(incidence)), float(cosine)
    d_in, d_out = frame.to_world(mi.Vector3f(0.6 * x, 0.8 * x, -z)), frame.to_world(mi.Vector3f(0.6 * x, 0.8 * x, z))
    mei = interaction(wavelengths=(550.0,) * 4)
    mei.wi = d_out
    value, _ = load(path).eval_pdf(mi.PhaseFunctionContext(None), mei, -d_in)
    complex_type = mi.Complex2f if dr.is_jit_v(mi.Float) else dr.scalar.Complex2f
    mirror = mi.mueller.specular_reflection(mi.Float(z), complex_type(m.real, -m.imag))
    mirror = mi.mueller.rotate_mueller_basis(mirror, d_in, dr.cross(normal, d_in), mi.mueller.stokes_basis(d_in),
                                             d_out, dr.cross(normal, d_out), mi.mueller.stokes_basis(d_out))
    ours, theirs = (np.array([[np.array(matrix[i, j]).ravel()[0] for j in range(4)] for i in range(4)])
                    for matrix in (value, mirror))
    np.testing.assert_allclose(ours / ours[0, 0], theirs / theirs[0, 0], atol=3e-6)


def test_clear_messages(folder, tmp_path):
    """A damaged asset, one without a medium, none at all: named, with what to do, through a scene file as well."""
    from bakery.errors import AssetError
    from bakery.store.tree import Dataset, Group, text
    from bakery.store.write import write

    bare, damaged = tmp_path / "bare.h5", tmp_path / "damaged.h5"
    write(bare, Group({"recipe": text("bakery: 1\n", "recipe"), "wavelength": Dataset(np.array([0.55]), "um", "w")},
                      {"name": "bare", "bakery_version": "0.1.0"}))
    asset_file(damaged, henyey_greenstein(0.5, angles()))
    data = bytearray(damaged.read_bytes())
    data[-100] ^= 4
    damaged.write_bytes(data)
    scene = tmp_path / "scene.xml"
    for name, pattern in (("bare.h5", "medium"), ("damaged.h5", "damaged"), ("absent.h5", "cannot be read")):
        with pytest.raises(AssetError, match=pattern):
            preview(tmp_path / name, tmp_path / "x.png") if name != "absent.h5" else tables.load(tmp_path / name)
        scene.write_text('<scene version="3.0.0"><shape type="sphere"><medium type="homogeneous" name="interior">'
                         f'<phase type="bakedphase"><string name="filename" value="{name}"/></phase></medium></shape></scene>')
        with pytest.raises(AssetError, match=pattern) as caught:
            renderer.render_scene(scene, tmp_path / "x.png", variant="scalar_rgb")
        assert "Traceback" not in str(caught.value) and "scene.xml" in str(caught.value)
    assert not (tmp_path / "x.png").exists()


def test_registers_in_a_variant_that_is_set_later(grey):
    """Whatever was set before, and again on each change."""
    for variant in ("scalar_spectral", "scalar_rgb", "scalar_spectral"):
        mi.set_variant(variant)
        assert "BakedPhase" in str(load(grey))
