"""The preview of an asset and the rendering of scenes, tiny."""

import os
import shutil
import signal
import types

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

renderer = pytest.importorskip("renderers.mitsuba", exc_type=ImportError)

import mitsuba as mi
from PIL import Image

import bakery
from bakery.draw.files import PREVIEW_OF
from bakery.errors import AssetError, UsageError
from bakery.grammar.qualities import Panel
from renderers.mitsuba import passes, tables
from renderers.pictures.engine import Part, Stop
from renderers.preview import describe, lobe, preview, studio
from renderers.preview.picture import block_edge
from tests.conftest import slow
from tests.physics.media import RGB, angles, asset_file, henyey_greenstein

SMALL = Panel(48, 2, 0.05, 120.0)


@pytest.fixture(scope="module")
def wax(tmp_path_factory):
    """Absorbs blue."""
    theta = angles(200, 1e-3)
    return asset_file(tmp_path_factory.mktemp("assets") / "wax.h5", henyey_greenstein([0.6, 0.6, 0.6], theta), theta=theta,
                      wavelength=RGB, sigma_t=2000, albedo=[0.999, 0.99, 0.9], name="wax")


@pytest.fixture
def no_strip(monkeypatch):
    """Without the strip below the picture, which takes as long as the picture."""
    monkeypatch.setattr(lobe, "strip", lambda asset, tables, width, words: np.zeros((1, width, 3)))


def pixels(path):
    return np.array(mi.Bitmap(str(path)))


def test_both_files_and_a_report(wax, tmp_path):
    seen = []
    report = preview(wax, tmp_path / "wax.png", panel=SMALL, progress=lambda fraction, noise: seen.append((fraction, noise)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["wax.exr", "wax.png"]
    png, exr = pixels(tmp_path / "wax.png"), pixels(tmp_path / "wax.exr")
    assert png.dtype == np.uint8 and exr.dtype == np.float32 and png.shape == exr.shape == (30 + 40, 48, 3)
    with Image.open(tmp_path / "wax.png") as image:  # by this `bake report` knows whose picture it is
        assert image.info[PREVIEW_OF].strip('"') == bakery.open(wax).content_hash
    assert np.isfinite(exr).all() and exr[:30].max() > 0.1
    assert [f for f, _ in seen] == sorted(f for f, _ in seen) and seen[-1] == (1.0, report["noise"])
    assert report["samples"] == 2 and report["rows"] == 30 and 0 < report["noise_shown"] < report["noise"]
    # 3 reduced mean free paths at the shortest, that of blue, which absorbs most
    assert report["block_edge"] == pytest.approx(3 / (2000 * (1 - 0.9 * 0.6)), rel=1e-3)
    assert report["misdirected"] == 0
    assert report["variant"] in " ".join(describe(report)) and "block" in " ".join(describe(report))
    block = exr[8:22, 16:32].reshape(-1, 3).mean(axis=0)
    assert block[0] > 1.2 * block[2]  # red comes back, blue does not
    floor = exr[26:30, :8].reshape(-1, 3)
    assert np.median(np.abs(floor[:, 0] - floor[:, 2])) < 0.05 * floor.mean()  # grey is without colour noise, though 50 % noisy


@pytest.mark.slow
def test_same_seed_same_picture(wax, tmp_path, no_strip):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        preview(wax, tmp_path / f"{name}.exr", panel=SMALL, seed=seed)
    a, b, c = (pixels(tmp_path / f"{name}.exr") for name in "abc")
    np.testing.assert_array_equal(a, b)
    assert np.any(a != c)


def test_scalar_variant_states_its_loss(wax, tmp_path):
    """Mitsuba's own table on a regular grid; at most 0.1 % of the light is misdirected."""
    report = preview(wax, tmp_path / "wax.png", panel=SMALL._replace(width=16, samples=1), variant="scalar_rgb")
    assert report["variant"] == "scalar_rgb" and (tmp_path / "wax.exr").exists()
    assert 0 < report["misdirected"] <= 1e-3 and "regular grid" in " ".join(describe(report))


@pytest.mark.slow
def test_scalar_equals_jit(wax, tmp_path, no_strip):
    """The mean of the picture, within 6 standard errors of both."""
    reports = {}
    for variant in ("scalar_rgb", renderer.variants.choose().names[0]):
        report = preview(wax, tmp_path / "x.exr", panel=SMALL._replace(width=16, samples=8), variant=variant)
        reports[variant] = pixels(tmp_path / "x.exr")[:10].mean(), report["noise"] / np.sqrt(160)
    (a, da), (b, db) = list(reports.values())[0], list(reports.values())[-1]
    assert a == pytest.approx(b, rel=6 * np.hypot(da, db))


@pytest.mark.slow
def test_more_wavelengths_than_channels(tmp_path, no_strip):
    wavelength = np.linspace(0.405, 0.755, 4)
    path = asset_file(tmp_path / "haze.h5", np.full((4, 50), 1 / (4 * np.pi)), theta=np.linspace(0, np.pi, 50),
                      wavelength=wavelength, sigma_t=1e-5 * (0.55 / wavelength) ** 4, name="haze")
    preview(path, tmp_path / "haze.png", panel=SMALL._replace(width=16))
    assert np.isfinite(pixels(tmp_path / "haze.exr")).all()


@pytest.mark.slow
def test_stops_by_noise_and_by_time(wax, tmp_path, no_strip):
    report = preview(wax, tmp_path / "x.png", panel=Panel(16, 64, 10.0, 120.0))
    assert report["stopped_by"] == "noise" and report["samples"] == 16  # four passes
    report = preview(wax, tmp_path / "x.png", panel=Panel(16, 64, 0.0, 0.0))
    assert report["stopped_by"] == "time" and report["samples"] == 8
    assert "depends on the machine" in " ".join(describe(report))


@pytest.mark.slow
def test_filtered_picture_stops_the_passes(wax, tmp_path, no_strip):
    """At equal noise asked for, what is shown has it after fewer samples than the EXR, and is as low as was asked for.

    Shown are 7 to 8 % after 16 samples, the fewest that stop it; the EXR has 25 %.  The seed is the default one: no false alarm.
    """
    until = Panel(48, 24, 0.1, 120.0)
    filtered, plain = (preview(wax, tmp_path / "x.png", panel=until, denoise=denoise) for denoise in (True, False))
    assert (filtered["stopped_by"], filtered["noise_of"], plain["noise_of"]) == ("noise", "PNG", "EXR")
    assert filtered["samples"] < plain["samples"]
    assert filtered["noise_shown"] <= 0.1 < filtered["noise"] and plain["noise_shown"] == plain["noise"]
    assert "was reached in the PNG" in " ".join(describe(filtered))


def test_measures_at_doubling_passes_and_before_it_stops():
    """Passes of noise 1, of which a filter leaves a tenth after 4 passes and a sixth later: the promise at 4 does not stop it."""
    random, asked = np.random.default_rng(5), []

    def one_pass(index):
        rgb = 1 + random.standard_normal((40, 40, 1)) * np.ones(3)
        return {"": rgb} | ({} if index % 2 else {"even": rgb})

    def measure(picture):
        asked.append(picture.samples)
        return picture.noise / (10 if picture.samples == 4 else 6)

    halves = passes.Picture([Part("noise", one_pass, 1)])
    halves.measure = measure
    halves.run(Stop(noise=0.03, samples=99))
    # 1 / sqrt(n): at 4 there are 5 %; a tenth would be 3 % after 12, a sixth is after 31
    assert halves.stopped_by == "noise" and 29 <= halves.samples <= 33 and asked[:3] == [4, 8, 16]
    assert asked[-1] == halves.samples and len(asked) <= 6


def test_refuses_before_rendering(wax, tmp_path):
    for output in (tmp_path / "no" / "x.png", tmp_path / "x.gif"):
        with pytest.raises(UsageError):
            preview(wax, output)
    for wrong in ({"quality": "best"}, {"variant": "llvm_rgb"}, {"panel": SMALL._replace(width=3)}):
        with pytest.raises(UsageError):
            preview(wax, tmp_path / "x.png", **wrong)
    clear = asset_file(tmp_path / "clear.h5", np.full((1, 50), 1 / (4 * np.pi)), theta=np.linspace(0, np.pi, 50), sigma_t=0)
    with pytest.raises(AssetError, match="nothing to see"):
        preview(clear, tmp_path / "x.png")
    assert not list(tmp_path.glob("x.*"))


def test_scene_with_the_plugin(wax, tmp_path):
    (tmp_path / "scene.xml").write_text("""<scene version="3.0.0">
        <integrator type="volpath"/> <emitter type="constant"/>
        <sensor type="perspective">
            <transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
            <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film>
            <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
        </sensor>
        <shape type="sphere"> <bsdf type="null"/> <medium type="homogeneous" name="interior"> <float name="sigma_t" value="2"/>
            <phase type="bakedphase"><string name="filename" value="wax.h5"/></phase> </medium> </shape>
    </scene>""")
    shutil.copy(wax, tmp_path / "wax.h5")
    report = renderer.render_scene(tmp_path / "scene.xml", tmp_path / "scene.exr", parameters={"spp": 8})
    assert report["samples"] == 8 and pixels(tmp_path / "scene.png").shape == (12, 16, 3)
    report = renderer.render_scene(tmp_path / "scene.xml", tmp_path / "scene.exr", quality="draft", parameters={"spp": 32})
    assert report["samples"] == 2
    (tmp_path / "broken.xml").write_text("<scene version='3.0.0'><shape type='tube'/></scene>")
    for name in ("broken.xml", "absent.xml"):
        with pytest.raises(UsageError):
            renderer.render_scene(tmp_path / name, tmp_path / "scene.png")


@pytest.mark.parametrize(("sigma_t", "albedo", "g", "edge", "words"), [
    (2.0, 1.0, 0.5, 3.0, "3 reduced mean free paths at 0.550"),
    (2.0, 0.5, 0.0, 1.5, "3 reduced mean free paths at 0.550"),
    (2.0, 0.5, 0.9, 4 / np.sqrt(3 * 1.1), "4 diffusion lengths at 0.550"),
    (2.0, 1.0, 0.99, 30.0, "60 mean free paths at 0.550"),
    (0.01, 1.0, 0.5, 300.0, "3 reduced mean free paths at 0.800"),  # the wavelength that scatters most decides
])
def test_edge_of_the_block(sigma_t, albedo, g, edge, words):
    def arrays(other, value):
        return np.array([other, value])

    medium = types.SimpleNamespace(sigma_t=arrays(0.02, sigma_t), albedo=arrays(1.0, albedo), g=arrays(0.5, g))
    found, why = block_edge(types.SimpleNamespace(wavelength=[0.8, 0.55], medium=medium))
    assert found == pytest.approx(edge) and words in why


@pytest.mark.slow
def test_studio_is_what_mitsuba_shows():
    """With a block that is not there the picture is the ground's light; its checks are where `features` says."""
    renderer.variants.activate("mono")
    width, height = 96, 60
    built = studio.scene(mi, {"type": "homogeneous", "sigma_t": 1e-6, "albedo": 1.0}, width, height, 8)
    image = passes.render([built], np.ones((3, 1)), samples=128, per_pass=16).rgb[..., 0]
    features = studio.features(width, height, 1e-6)
    assert features[..., :4].max() < 1e-4
    light = np.sum(image) / np.sum(features[..., 4])
    # open ground: radiance = reflectance x irradiance / pi everywhere; noise is 1 to 3 % a pixel
    assert np.median(np.abs(image / (light * features[..., 4]) - 1)) < 0.03
    assert np.corrcoef(image.ravel(), features[..., 4].ravel())[0, 1] > 0.995
    # the map of the sky, integrated here in other coordinates
    z, phi = np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(800) + 0.5) / 800 * 2 * np.pi, indexing="ij")
    rho = np.sqrt(1 - z * z)
    irradiance = 2 * np.pi * np.mean(studio.sky(np.stack([rho * np.cos(phi), rho * np.sin(phi), z], axis=-1)) * z)
    assert light == pytest.approx(irradiance / np.pi, rel=0.01)


def test_lights_stand_where_they_should():
    """Mitsuba's own look-up of its map of directions against the function that was drawn; half a pixel is 0.7 degrees."""
    mi.set_variant("scalar_rgb")
    built = studio.scene(mi, {"type": "homogeneous"}, 16, 16, 8)
    random = np.random.default_rng(3).standard_normal((300, 3))
    direction = random / np.linalg.norm(random, axis=1, keepdims=True)
    seen = mi.SurfaceInteraction3f()
    found = []
    for d in direction:
        seen.wi = mi.Vector3f(*map(float, -d))
        found.append(float(built.environment().eval(seen)[0]))
    np.testing.assert_allclose(found, studio.sky(direction), atol=0.05)
    right = np.cross(studio.TARGET - studio.CAMERA, [0, 0, 1])
    key, rim = (studio._towards(*light[:2]) for light in (studio.KEY, studio.RIM))
    assert key @ right < 0 < rim @ right and rim @ (studio.TARGET - studio.CAMERA) > 0  # key left, rim behind on the right


def test_block_is_where_the_features_say():
    """An opaque black block: dark where opacity is 1, ground elsewhere."""
    renderer.variants.activate("mono")
    width, height = 96, 60
    built = studio.scene(mi, {"type": "homogeneous", "sigma_t": 1e4, "albedo": 0.0}, width, height, 8)
    image = passes.render([built], np.ones((3, 1)), samples=32, per_pass=16).rgb[..., 0]
    features = studio.features(width, height, 1e4)
    inside, outside = (binary_erosion(features[..., 0] == value) for value in (1, 0))  # edges are known to a third of a pixel
    assert inside.mean() > 0.3 and image[inside].max() < 1e-3 and image[outside].min() > 0.01
    np.testing.assert_allclose(features[inside][:, 1:4].sum(axis=-1), 0.5)  # each pixel is entered by one face
    assert (features[..., 1:4].reshape(-1, 3).max(axis=0) == 0.5).all()  # and all three faces are seen


def test_equal_light_from_everywhere_shows_nothing_of_a_white_medium(monkeypatch):
    """A block of albedo 1 under equal radiance from all sides on ground of reflectance 1 cannot be seen: energy is kept.

    4 standard errors of the mean over 60 x 96 pixels; the lights' own scatter is gone, so that is far below 1 %.
    """
    monkeypatch.setattr(studio, "sky", lambda direction: np.ones(direction.shape[:-1]))
    monkeypatch.setattr(studio, "reflectance", lambda x, y: np.ones(np.broadcast(x, y).shape))
    renderer.variants.activate("mono")
    built = studio.scene(mi, {"type": "homogeneous", "sigma_t": 10.0, "albedo": 1.0, "sample_emitters": False,
                              "phase": {"type": "hg", "g": 0.8}}, 96, 60, 100_000)
    picture = passes.render([built], np.ones((3, 1)), samples=16, per_pass=8)
    inside = studio.features(96, 60, 10.0)[..., 0] > 0.99
    assert picture.rgb[inside].mean() == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("variant", [slow("scalar_rgb"), renderer.variants.choose().names[0]])
def test_interruption_is_handed_on(variant, wax, tmp_path, no_strip):
    """SIGINT in the midst of Mitsuba's work: KeyboardInterrupt, not an error of Mitsuba, and no file."""
    calls = []

    def progress(fraction, noise):
        calls.append(fraction)
        if len(calls) == 1:
            signal.setitimer(signal.ITIMER_REAL, 0.05)

    usual = signal.signal(signal.SIGALRM, lambda *arrived: os.kill(os.getpid(), signal.SIGINT))
    # a job in the background starts with SIGINT ignored: what this test is about is what happens where it is not
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            preview(wax, tmp_path / "x.png", panel=Panel(96, 4096, 0.0, 120.0), variant=variant, progress=progress)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, usual)
        found = signal.signal(signal.SIGINT, before)
    assert not list(tmp_path.iterdir()) and found is signal.default_int_handler


@pytest.mark.parametrize("width", [320, 576, 1280])
@pytest.mark.parametrize("kind", ["medium", "grains"])
def test_letters_of_the_strip_are_legible(width, kind, wax, monkeypatch):
    """As drawn: at least 11 pixels, and no line leaves the picture."""
    figures, page = [], lobe._page
    monkeypatch.setattr(lobe, "_page", lambda *arguments: figures.append(page(*arguments)) or figures[-1])
    if kind == "medium":
        words = ["block edge 899 m = 3 reduced mean free paths at 0.610 um"]
        strip = lobe.strip(bakery.open(wax), tables.load(wax), width, words)
    else:
        part = {"hit_probability": [0.7], "albedo": [0.99995] * 3, "g": [-0.85] * 3, "lambda_s": [1.25] * 3,
                "forward_delta": [0.0113] * 3, "phase": np.full((3, 91), 1 / (4 * np.pi))}
        asset = types.SimpleNamespace(wavelength=RGB, grains={"long_crystals": part, "theta": np.linspace(0, np.pi, 91)})
        strip = lobe.grain_strip(asset, [types.SimpleNamespace(name="long_crystals", share=0.125)], width, ["R = 1 mm"])
    assert strip.shape[1] == width and figures[0].texts
    for text in figures[0].texts:
        box = text.get_window_extent()
        assert text.get_fontsize() * 100 / 72 >= 10.999 and box.x0 >= 0 and box.x1 <= width, text


def test_albedos_are_as_narrow_as_four_decimals():
    assert [lobe._close(x) for x in (1, 0.999911, 0.99951, 0.9994, 0)] == ["1", "1-9e-5", "1-5e-4", "0.9994", "0.0000"]


def test_lengths_with_units():
    assert [lobe.length(x) for x in (34.42, 0.00075, 1e5, 5.5e-7, 1.0, 4.0934e7)] == [
        "34.4 m", "750 um", "100 km", "550 nm", "1 m", "40900 km"]
