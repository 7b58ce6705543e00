"""The preview of an asset and the rendering of scenes, tiny."""

from __future__ import annotations

import shutil
import types

import numpy as np
import pytest

renderer = pytest.importorskip("renderers.mitsuba", exc_type=ImportError)

import mitsuba as mi  # noqa: E402

from bakery.errors import AssetError, UsageError  # noqa: E402
from renderers.mitsuba import lobe  # noqa: E402
from renderers.mitsuba.preview import block_edge  # noqa: E402
from tests.physics.media import RGB, angles, asset_file, henyey_greenstein  # noqa: E402

SMALL = {"width": 48, "spp": 2}


@pytest.fixture(scope="module")
def wax(tmp_path_factory):
    """Absorbs blue."""
    theta = angles(200, 1e-3)
    return asset_file(tmp_path_factory.mktemp("assets") / "wax.h5", henyey_greenstein([0.6, 0.6, 0.6], theta), theta=theta,
                      wavelength=RGB, sigma_t=2000, albedo=[0.999, 0.99, 0.9], name="wax")


def pixels(path):
    return np.array(mi.Bitmap(str(path)))


def test_both_files_and_a_report(wax, tmp_path):
    seen = []
    report = renderer.preview(wax, tmp_path / "wax.png", **SMALL, progress=lambda fraction, noise: seen.append((fraction, noise)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["wax.exr", "wax.png"]
    png, exr = pixels(tmp_path / "wax.png"), pixels(tmp_path / "wax.exr")
    assert png.dtype == np.uint8 and exr.dtype == np.float32 and png.shape == exr.shape == (30 + 13, 48, 3)
    assert np.isfinite(exr).all() and exr[:30].max() > 0.1
    assert [f for f, _ in seen] == sorted(f for f, _ in seen) and seen[-1] == (1.0, report["noise"])
    assert report["samples"] == 2 and report["rows"] == 30 and 0 < report["noise_shown"] < report["noise"]
    assert report["block_edge"] == pytest.approx(5 / (2000 * (1 - 0.99 * 0.6)), rel=1e-3)
    assert report["variant"] in " ".join(renderer.describe(report)) and "block" in " ".join(renderer.describe(report))
    block = exr[8:22, 16:32].reshape(-1, 3).mean(axis=0)
    assert block[0] > 1.2 * block[2]  # red comes back, blue does not
    floor = exr[26:30, :8].reshape(-1, 3)
    assert np.median(np.abs(floor[:, 0] - floor[:, 2])) < 0.05 * floor.mean()  # grey is without colour noise, though 50 % noisy


def test_same_seed_same_picture(wax, tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        renderer.preview(wax, tmp_path / f"{name}.exr", **SMALL, seed=seed)
    a, b, c = (pixels(tmp_path / f"{name}.exr") for name in "abc")
    np.testing.assert_array_equal(a, b)
    assert np.any(a != c)


def test_scalar_variant(wax, tmp_path):
    report = renderer.preview(wax, tmp_path / "wax.png", width=16, spp=1, variant="scalar_rgb")
    assert report["variant"] == "scalar_rgb" and (tmp_path / "wax.exr").exists()


def test_scalar_equals_jit(wax, tmp_path):
    """The mean of the picture, within 6 standard errors of both."""
    reports = {}
    for variant in ("scalar_rgb", renderer.variants.choose().names[0]):
        report = renderer.preview(wax, tmp_path / "x.exr", width=16, spp=8, variant=variant)
        reports[variant] = pixels(tmp_path / "x.exr")[:10].mean(), report["noise"] / np.sqrt(160)
    (a, da), (b, db) = list(reports.values())[0], list(reports.values())[-1]
    assert a == pytest.approx(b, rel=6 * np.hypot(da, db))


def test_eight_wavelengths(tmp_path):
    wavelength = np.arange(0.405, 0.76, 0.05)
    path = asset_file(tmp_path / "haze.h5", np.full((8, 50), 1 / (4 * np.pi)), theta=np.linspace(0, np.pi, 50),
                      wavelength=wavelength, sigma_t=1e-5 * (0.55 / wavelength) ** 4, name="haze")
    renderer.preview(path, tmp_path / "haze.png", width=32, spp=2)
    assert np.isfinite(pixels(tmp_path / "haze.exr")).all()


def test_stops_by_noise_and_by_time(wax, tmp_path):
    report = renderer.preview(wax, tmp_path / "x.png", width=48, spp=64, tolerance=10.0)
    assert report["stopped_by"] == "noise" and report["samples"] == 8
    report = renderer.preview(wax, tmp_path / "x.png", width=48, spp=64, tolerance=0.0, time_limit=0.0)
    assert report["stopped_by"] == "time" and report["samples"] == 8
    assert "depends on the machine" in " ".join(renderer.describe(report))


def test_refuses_before_rendering(wax, tmp_path):
    for output in (tmp_path / "no" / "x.png", tmp_path / "x.gif"):
        with pytest.raises(UsageError):
            renderer.preview(wax, output)
    for wrong in ({"quality": "best"}, {"variant": "llvm_rgb"}, {"width": 3}):
        with pytest.raises(UsageError):
            renderer.preview(wax, tmp_path / "x.png", **wrong)
    clear = asset_file(tmp_path / "clear.h5", np.full((1, 50), 1 / (4 * np.pi)), theta=np.linspace(0, np.pi, 50), sigma_t=0)
    with pytest.raises(AssetError, match="nothing to see"):
        renderer.preview(clear, tmp_path / "x.png")
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


@pytest.mark.parametrize(("sigma_t", "albedo", "g", "edge"), [
    (2.0, 1.0, 0.5, 5.0),  # reduced mean free paths
    (2.0, 0.0, 0.0, 2.5 / np.sqrt(12)),  # diffusion lengths
    (2.0, 1.0, 0.99, 30.0),  # mean free paths
])
def test_edge_of_the_block(sigma_t, albedo, g, edge):
    def arrays(value):
        return np.array([7.0, value])

    medium = types.SimpleNamespace(sigma_t=arrays(sigma_t), albedo=arrays(albedo), g=arrays(g))
    assert block_edge(types.SimpleNamespace(wavelength=[0.8, 0.55], medium=medium))[0] == pytest.approx(edge)


def test_lengths_with_units():
    assert [lobe.length(x) for x in (34.42, 0.00075, 1e5, 5.5e-7, 1.0)] == ["34.4 m", "750 um", "100 km", "550 nm", "1 m"]
