"""`bake render SCENE.yaml` as a user calls it: what is known of the picture in closed form, and every way to fail."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import bakery
from bakery.cli import status_of
from renderers import scene as scenes
from renderers.fog import kernels
from renderers.pictures import denoise, images
from tests.conftest import slow
from tests.exr import layers, library

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "assets/scenes"
RECIPE = """\
bakery: 1
name: fog
wavelengths: rgb
tolerance: 20%
medium: {albedo: [1, 0.9, 0.6], mean_free_path: [10, 9, 8] m, phase: {type: hg, g: 0.6}}
"""
SCENE = """\
bakery_scene: 2
name: night
asset: fog.h5
camera: {origin: [0, -12, 1.7] m, target: [0, 0, 2] m, fov: 40 deg}
picture: {color: clear.exr, depth: depth.npy, measure: distance}
fog: {density: {type: uniform, scale: 0.5}}
"""
XML = """<scene version="3.0.0"><default name="sky" value="0.5"/><integrator type="path"/>
<shape type="sphere"><float name="radius" value="2"/></shape>
<emitter type="constant"><rgb name="radiance" value="$sky"/></emitter>
<sensor type="perspective"><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0,-12,1.7" target="0,0,2" up="0,0,1"/></transform>
<film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="18"/></film>
<sampler type="independent"><integer name="sample_count" value="32"/></sampler></sensor></scene>"""
SIGMA_A = np.array([0, 0.1, 0.4]) / np.array([10, 9, 8])  # red, green, blue


@pytest.fixture(scope="module")
def assets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("assets")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        for name, more in (("fog", "beam: {depth: 3, photons: 1000}\n"), ("bare", "")):
            (folder / f"{name}.yaml").write_text(RECIPE + more)
            assert status_of([str(folder / f"{name}.yaml"), "-o", str(folder / f"{name}.h5"), "--quiet"]) in (0, 3)
    return folder


@pytest.fixture
def place(assets, tmp_path):
    """A folder with a scene whose picture is constant, at distances from 5 m to 50 m."""
    for name in ("fog.h5", "bare.h5"):
        (tmp_path / name).symlink_to(assets / name)
    (tmp_path / "s.yaml").write_text(SCENE)
    (tmp_path / "street.xml").write_text(XML)
    write(tmp_path, np.full((18, 32, 3), 0.25), np.random.default_rng(0).uniform(5, 50, (18, 32)))
    return tmp_path


def write(folder, color, depth):
    library().Bitmap(np.ascontiguousarray(color, np.float32)).write(str(folder / "clear.exr"))
    np.save(folder / "depth.npy", depth)


def rgb(path):
    found = layers(path)
    return np.stack([found[c] for c in "RGB"], axis=-1)


@pytest.mark.slow
def test_a_constant_picture_fades_by_absorption_only(call, place):
    """For distances of any kind where nothing is absorbed (red); at one distance by the kernels' power (all channels)."""
    status, out, err = call("render", place / "s.yaml", "--json")
    assert status == 0, err
    report = json.loads(out)
    assert report["files"] == [str(place / "night.png"), str(place / "night.exr")]
    assert np.allclose(rgb(place / "night.exr")[..., 0], 0.25, rtol=1e-6)
    assert report["optical_depth"]["largest"][0] == pytest.approx(0.05 * np.load(place / "depth.npy").max())
    assert 0 < report["share_scattered"] < 1 and report["share_sun"] == 0
    np.save(place / "depth.npy", np.full((18, 32), 20.0))
    assert call("render", place / "s.yaml", "-o", place / "b.png", "--set", "fog.density.scale=2", "--quiet")[0] == 0
    fog = kernels.fog_of(bakery.open(place / "fog.h5"))
    left = np.exp(-40 * fog.sigma_t) + fog.powers(np.array(40.0), "kept")[0]
    assert np.allclose(rgb(place / "b.exr"), 0.25 * left, rtol=1e-5)
    assert (left <= np.exp(-SIGMA_A * 40) * (1 + 1e-9)).all() and left[0] == pytest.approx(1)


@pytest.mark.parametrize("density", ["{type: uniform, scale: 0}", slow("{type: height, base: -90 m, falloff: 5 cm}")])
def test_without_fog_the_picture_is_the_picture(call, place, density):
    color = np.random.default_rng(1).random((18, 32, 3))
    write(place, color, np.full((18, 32), 30.0))
    status, _, err = call("render", place / "s.yaml", "--set", f"fog.density={density}")
    assert status == 0, err
    assert np.array_equal(rgb(place / "night.exr"), color.astype(np.float32))


@pytest.mark.parametrize("energy", ["kept", slow("lost")])
def test_ambient_light_counts_once(call, place, energy):
    """A picture of radiance L in ambient light L, where nothing is absorbed (red), stays L; in the dark it fades."""
    sky, filtered = "fog.light=[{type: ambient, radiance: 0.25}]", f"filter.energy={energy}"
    assert call("render", place / "s.yaml", "--set", sky, "--set", filtered)[0] == 0
    whole = rgb(place / "night.exr")
    assert np.allclose(whole[..., 0], 0.25, rtol=1e-6) and (whole[..., 1:] < 0.25).all()
    assert call("render", place / "s.yaml", "--set", "filter.outside=black", "--set", filtered)[0] == 0
    dark = rgb(place / "night.exr")
    assert (dark[..., 0] < 0.25).all()
    write(place, np.zeros((18, 32, 3)), np.load(place / "depth.npy"))
    assert call("render", place / "s.yaml", "--set", sky, "--set", filtered)[0] == 0  # the rest of what is seen is the sky
    sky_only = rgb(place / "night.exr")
    assert (sky_only >= 0).all() and np.allclose((sky_only + dark)[..., 0], 0.25, rtol=1e-5)
    status, _, err = call("render", place / "s.yaml", "--set", sky, "--set", "filter.outside=edge")
    assert status == 2 and "beside ambient light" in err


def test_deep_fog_in_ambient_light(call, place):
    """It sends back what a slab reflects: all where nothing is absorbed, the rest by P1."""
    from renderers.fog import _columns

    deep = ("--set", "fog.light=[{type: ambient, radiance: 2}]", "--set", "fog.density.scale=1e4")
    assert call("render", place / "s.yaml", *deep)[0] == 0
    back = _columns.slab([1, 0.9, 0.6], 0.6, 0.36, 1e6)[1]
    assert np.allclose(rgb(place / "night.exr"), 2 * back, rtol=1e-3, atol=1e-5)


def test_density_of_a_file(call, place):
    """A grid of ones over all that is seen is the uniform density; a sun upon it adds light."""
    np.save(place / "cloud.npy", np.ones((2, 3, 4), np.float32))
    grid = "fog.density={type: grid, file: cloud.npy, lo: [-90, -90, -90] m, hi: [90, 90, 90] m, scale: 0.5}"
    assert call("render", place / "s.yaml", "-o", place / "uniform.exr")[0] == 0
    assert call("render", place / "s.yaml", "-o", place / "grid.exr", "--set", grid)[0] == 0
    assert np.allclose(rgb(place / "grid.exr"), rgb(place / "uniform.exr"), rtol=1e-3)
    sun = "fog.light=[{type: sun, direction: [0, 0, -1], irradiance: [1, 1, 1]}]"
    status, _, err = call("render", place / "s.yaml", "-o", place / "lit.exr", "--set", grid, "--set", sun)
    assert status == 0, err
    assert (rgb(place / "lit.exr") > rgb(place / "grid.exr")).all()


def test_a_mitsuba_scene_and_its_picture_again(call, place):
    """The EXR holds what it takes to fog the picture anew: the same result, to the filter's own error."""
    text = SCENE.replace("camera: {origin: [0, -12, 1.7] m, target: [0, 0, 2] m, fov: 40 deg}\n", "")
    text = text.replace("{color: clear.exr, depth: depth.npy, measure: distance}", "{mitsuba: street.xml, far: 100 m}")
    (place / "m.yaml").write_text(text)
    status, out, err = call("render", place / "m.yaml", "-o", place / "m.exr", "--quality", "draft", "--seed", "3")
    assert status == 0, err
    assert out == f"{place / 'm.png'}\n{place / 'm.exr'}\n"
    assert "without a surface" in err and "optical depth" in err and (place / "m.png").stat().st_size > 100
    first = layers(place / "m.exr")
    assert list(first)[:3] == ["R", "G", "B"] and np.isinf(first["distance"][0, 0])
    # the camera is at (0, -12, 1.7), the ball of radius 2 at the origin
    assert first["distance"].min() == pytest.approx(np.hypot(12, 1.7) - 2, abs=0.02)
    own = "color: m.exr, layer: clear, depth: m.exr, channel: distance, far: 100 m"
    again = SCENE.replace("color: clear.exr, depth: depth.npy", own)
    (place / "again.yaml").write_text(again)
    for quality, near in (("draft", 0.01), ("final", 0.1)):  # a draft has the filter's points farther apart
        status, out, err = call("render", place / "again.yaml", "--quality", quality, "--json")
        assert status == 0, err
        assert np.allclose(rgb(place / "night.exr"), rgb(place / "m.exr"), rtol=near)
        filtered = json.loads(out)["filter"]
        assert filtered["points"] == quality and 0 < filtered["error"] < 0.03
    for told in (("--seed", "3"), ("--variant", "scalar_rgb")):
        status, _, err = call("render", place / "again.yaml", *told)
        assert status == 2 and "comes from files" in err


@pytest.mark.slow
def test_fog_over_a_scene_of_materials(call, place):
    """The render's EXR is picture and depth: the nearest point of the ball, 4 m wide, gives the least optical depth."""
    (place / "cloud.yaml").write_text("bakery_scene: 2\nname: cloud\nscene: {mitsuba: street.xml}\nstop: {samples: 1}\n"
                                      "materials:\n  - {where: {box: {lo: [-3, -3, -3] m, hi: [3, 3, 3] m}}, asset: bare.h5}\n")
    status, _, err = call("render", place / "cloud.yaml")
    assert status == 0, err
    own = "{color: cloud.exr, depth: cloud.exr, channel: depth.Z, measure: z, far: 100 m}"
    (place / "s.yaml").write_text(SCENE.replace("{color: clear.exr, depth: depth.npy, measure: distance}", own))
    status, out, err = call("render", place / "s.yaml", "--json")
    assert status == 0, err
    near = 0.5 * (np.hypot(12, 1.7) - 2) / np.array([10, 9, 8])
    assert json.loads(out)["optical_depth"]["smallest"] == pytest.approx(near, rel=0.01)


def test_the_noise_of_a_picture_is_taken_out_before_its_fog(call, place):
    """Where pixels do not share samples; the noise of files is not known."""
    if denoise.fault():
        pytest.skip("mitsuba-oidn is not installed")
    text = SCENE.replace("camera: {origin: [0, -12, 1.7] m, target: [0, 0, 2] m, fov: 40 deg}\n", "")
    files, rendered = "{color: clear.exr, depth: depth.npy, measure: distance}", "{mitsuba: street.xml, far: 100 m, samples: 64}"
    text = text.replace(files, rendered)
    (place / "m.yaml").write_text(text)
    status, out, err = call("render", place / "m.yaml", "-o", place / "m.exr", "--quality", "draft", "--json")
    report = json.loads(out)
    assert status == 0 and report["denoised"] is False and any('<rfilter type="box"/>' in line for line in report["reasons"]), err
    (place / "street.xml").write_text(XML.replace("</film>", '<rfilter type="box"/></film>'))
    status, out, err = call("render", place / "m.yaml", "-o", place / "m.exr", "--quality", "draft", "--json", "--seed", "1")
    report, found = json.loads(out), layers(place / "m.exr")
    assert status == 0 and report["denoised"] is True and report["denoising"]["features"] == ["albedo", "normal"], err
    assert "denoising" in report["seconds"] and abs(report["denoising"]["mean_change"]) < 0.02
    ball = found["albedo.G"] == 0.5  # of a surface that does not say, in all of a pixel
    assert 60 < ball.sum() < 120 and (found["distance"][ball] < 12).all() and (found["normal.Y"][ball] < 0).all()
    clear, clean = (np.sqrt(np.mean((found[f"{name}.G"][ball] - 0.25) ** 2)) for name in ("clear", "denoised.clear"))
    assert clean < 0.7 * clear  # a ball that reflects half of a sky of 0.5
    assert not np.array_equal(found["denoised.G"], found["denoised.clear.G"])  # which is behind the fog
    status, _, err = call("render", place / "s.yaml", "--denoise")
    assert status == 2 and "denoise: found yes beside a picture from files" in err


def test_a_scene_takes_its_own_samples_unless_told(call, place):
    (place / "m.yaml").write_text(SCENE[:SCENE.index("camera:")] + "picture: {mitsuba: street.xml, samples: 16, far: 100 m}\n"
                                  "fog: {density: {type: uniform}}\n")
    for told, scene, own in (((), 32, 16), (("--quality", "preview"), 8, 4)):
        assert json.loads(call("render", place / "street.xml", "--json", *told)[1])["samples"] == scene
        assert json.loads(call("render", place / "m.yaml", "--json", *told)[1])["picture"]["samples"] == own


@pytest.mark.slow
def test_the_noise_of_a_foggy_picture(call, place):
    """As stated, and as pictures of other seeds scatter.  Seeds are given: it came out 11 % less, of errors of 6 %."""
    (place / "m.yaml").write_text(SCENE[:SCENE.index("camera:")] + "picture: {mitsuba: street.xml, far: 100 m}\n"
                                  "fog: {density: {type: uniform}}\n")
    stated, pictures = [], []
    for seed in range(6):
        status, out, err = call("render", place / "m.yaml", "--seed", seed, "--set", "stop.noise=0.6%", "--json")
        assert status == 0, err
        stated.append(json.loads(out)["noise"])
        pictures.append(layers(place / "night.exr"))
    luminance = np.array([one["R"] * 0.2126 + one["G"] * 0.7152 + one["B"] * 0.0722 for one in pictures])
    true = np.sqrt(luminance.var(axis=0, ddof=1).mean()) / luminance.mean()
    assert np.sqrt(np.mean(np.square(stated))) == pytest.approx(true, rel=0.25)
    assert 0.003 < true < 0.007 and np.sqrt(np.mean(np.square([one["noise.Y"] for one in pictures]))) / luminance.mean() \
        == pytest.approx(true, rel=0.25)


def test_pictures_are_not_written_over_what_a_scene_reads(call, place):
    """Whatever the name; a file of another kind neither, unless told.  Asked before anything is rendered."""
    ball = '<shape type="sphere"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">' \
           '<string name="filename" value="$what.exr"/></texture></bsdf></shape>'
    (place / "deep").mkdir()
    (place / "deep" / "ball.xml").write_text(f'<scene version="3.0.0"><default name="what" value="bark"/>{ball}</scene>')
    (place / "deep" / "bark.exr").write_bytes((place / "clear.exr").read_bytes())
    (place / "wood.xml").write_text(XML.replace("</scene>", '<include filename="deep/ball.xml"/></scene>'))
    (place / "w.yaml").write_text(SCENE[:SCENE.index("camera:")] + "picture: {mitsuba: wood.xml, far: 9 m}\n"
                                  "fog: {density: {type: uniform}}\n")
    (place / "linked.exr").hardlink_to(place / "clear.exr")
    (place / "notes.png").write_text("what I saw")
    before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    for scene, output, said in (("s.yaml", "clear.png", "clear.exr: is read by this very call"),
                                ("s.yaml", "linked.png", "under the name"), ("s.yaml", "notes.exr", "not a PNG picture"),
                                ("w.yaml", "deep/bark.png", "bark.exr: is read by this very call"),
                                ("wood.xml", "deep/bark.exr", "bark.exr: is read by this very call"),
                                ("clear.exr", "new.png", "which is a picture; expected a scene"),
                                ("fog.h5", "notes.png", "not a PNG picture")):
        status, out, err = call("render", place / scene, "-o", place / output)
        assert status == 2 and said in err and not out, err
        assert {path: path.read_bytes() for path in place.rglob("*") if path.is_file()} == before
    assert call("render", place / "s.yaml", "-o", place / "notes.png", "--overwrite", "--quiet")[0] == 0
    assert call("render", place / "s.yaml", "-o", place / "notes.png", "--quiet") == \
        (0, f"{place / 'notes.png'}\n{place / 'notes.exr'}\n", "")


def test_parameters_of_a_mitsuba_scene(call, place):
    status, _, err = call("render", place / "street.xml", "--quality", "draft", "--set", "sky=2")
    assert status == 0, err
    assert rgb(place / "street.exr")[0, 0] == pytest.approx([2, 2, 2], rel=1e-3)


def test_large_seeds_are_seeds_too(call, place):
    """Mitsuba takes 32 bits: of those above other pictures, the same for the same seed, and nothing above what recipes take."""
    pictures = []
    for seed in (0, 1 << 16, 1 << 32, 1 << 32):
        assert call("render", place / "street.xml", "-o", place / "s.png", "--quality", "draft", "--seed", seed)[0] == 0
        pictures.append(rgb(place / "s.exr"))
    # threads add to the same pixels of Mitsuba's film in an order of chance: once in a hundred renders values differ by 1.3e-7
    assert [np.allclose(pictures[2], picture, rtol=1e-6, atol=0) for picture in pictures] == [False, False, True, True]
    assert not np.allclose(*pictures[:2], rtol=1e-6, atol=0)
    for name in "street.xml", "m.yaml":
        status, _, err = call("render", place / name, "--seed", 2**53 + 1)
        assert status == 2 and f"{2**53 + 1} is not in the range 0<=x<={2**53}" in err


def test_a_mitsuba_scene_without_light_or_integrator(call, place):
    """Black, which is said of the file itself and of the scene in fog; who renders it has to be said."""
    (place / "dark.xml").write_text(re.sub("<emitter.*?</emitter>", "", XML, flags=re.DOTALL))
    status, out, err = call("render", place / "dark.xml", "-o", place / "dark.png", "--json")
    assert status == 0 and json.loads(out)["reasons"] == ["nothing in the scene shines: its picture is black"]
    (place / "m.yaml").write_text(SCENE[:SCENE.index("camera:")] + "picture: {mitsuba: dark.xml, far: 100 m}\ntolerance: 5%\n"
                                  "fog: {density: {type: uniform}}\n")
    status, out, err = call("render", place / "m.yaml", "--json")
    assert status == 0, err
    assert json.loads(out)["reasons"][-1] == "no light is in the picture, and it stays black"
    (place / "dark.xml").write_text(XML.replace('<integrator type="path"/>', ""))
    status, _, err = call("render", place / "dark.xml", "-o", place / "dark.png")
    assert status == 2 and "dark.xml: the scene has no integrator; expected <integrator" in err


@pytest.mark.slow
def test_a_recipe_in_place_of_the_asset(call, assets, place, monkeypatch):
    """Baked into the cache, of stages that are kept there, and nothing beside the scene; the picture is that of the asset."""
    monkeypatch.setenv("BAKERY_CACHE", str(assets / "cache"))
    (place / "fog.yaml").write_text((assets / "fog.yaml").read_text().replace("name: fog", "name: own"))
    (place / "s.yaml").write_text(SCENE.replace("asset: fog.h5", "recipe: fog.yaml"))
    (place / "fog.h5").unlink()
    before = set(place.iterdir())
    status, out, err = call("render", place / "s.yaml", "-o", place / "own.png", "--json")
    assert status == 0 and set(place.iterdir()) - before == {place / "own.png", place / "own.exr"}, err
    (place / "given.h5").write_bytes(Path(json.loads(out)["asset"]).read_bytes())
    own = rgb(place / "own.exr")
    (place / "s.yaml").write_text(SCENE.replace("asset: fog.h5", "asset: given.h5"))
    assert call("render", place / "s.yaml", "-o", place / "given.png")[0] == 0
    assert np.array_equal(own, rgb(place / "given.exr"))


@pytest.mark.parametrize(("settings", "said"), [
    (["asset=bare.h5"], "give its recipe a section `beam` and bake it again"),
    (["asset=depth.npy"], "depth.npy"),
    (["picture.color=depth.npy"], ".exr or .png would do"),
    (["fog.density.scale=thick"], "--set fog.density.scale"),
    (["fog={density: {type: grid, file: fog.h5, dataset: gone, lo: [0, 0, 0] m, hi: [1, 1, 1] m}}"], 'no dataset "gone"'),
    (["picture.far=10 m"], "nearer than the farthest surface"),
    (["picture.sky=7"], "in fog that goes on for ever"),
    (["fog.light=[{type: sun, direction: [0, 0, -1], irradiance: 1}]"], "without an end"),
    (["filter.cut_off=0"], "filter.cut_off"),
    (["stop={time: 5 s}"], "stop: found when to stop beside a picture from files; expected none"),
    (["stop={samples: 5}"], "stop.samples: found a key that fog does not use; expected picture: {samples: …}"),
    (["scene={mitsuba: street.xml}"], "expected picture: {mitsuba: …}"),
    (["film={width: 4, height: 4}"], "film: found a key that fog does not use"),
    (["measure=pixels"], "measure: found a key that fog does not use"),
    (["recipe=fog.h5"], "recipe: found a recipe beside an asset"),
])
def test_what_will_not_do(call, place, settings, said):
    """One message, status 2, nothing written."""
    np.save(place / "depth.npy", np.where(np.eye(18, 32), 7.0, 20.0))
    before = sorted(path.name for path in place.iterdir())
    status, out, err = call("render", place / "s.yaml", *(part for setting in settings for part in ("--set", setting)))
    assert status == 2 and said in err and "Traceback" not in err and not out
    assert sorted(path.name for path in place.iterdir()) == before


def test_problems_for_machines(call, place):
    (place / "s.yaml").write_text(SCENE.replace("uniform", "uniforn").replace("name: night", "name: 3"))
    status, out, err = call("render", place / "s.yaml", "--json")
    assert status == 2 and [p["line"] for p in json.loads(out)["problems"]] == [2, 6]
    assert "s.yaml:6: fog.density.type" in err
    assert call("render", place / "gone.yaml")[0] == 2
    status, _, err = call("render", place / "fog.h5", "--set", "a=b")
    assert status == 2 and "is an asset" in err


def test_a_failed_write_leaves_the_old_pictures(call, place, monkeypatch):
    assert call("render", place / "s.yaml", "--quiet")[0] == 0
    old = [(place / f"night.{kind}").read_bytes() for kind in ("png", "exr")]
    import renderers.pictures.images

    def full(path, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(renderers.pictures.images.os, "replace", full)
    status, _, err = call("render", place / "s.yaml", "--set", "fog.density.scale=3")
    assert status == 3 and "No space left" in err
    assert [(place / f"night.{kind}").read_bytes() for kind in ("png", "exr")] == old
    assert not [path for path in place.iterdir() if path.name.startswith(".night")]


def test_the_tone_curve_can_be_left_out(call, place):
    """Without a curve the PNG is the sRGB code of the radiance: 0.25 is 137."""
    assert call("render", place / "s.yaml", "--set", "display.curve=none", "--set", "fog.density.scale=0")[0] == 0
    assert (np.array(library().Bitmap(str(place / "night.png")))[..., :3] == 137).all()


# ---- the scenes that are shipped


def shipped(name, folder):
    """A copy of a scene of assets/scenes whose film is a few pixels wide, and which takes an asset in place of its recipe."""
    for suffix in (".yaml", ".xml"):
        text = re.sub("^recipe: .*$", "asset: given.h5", (SCENES / f"{name}{suffix}").read_text(), flags=re.MULTILINE)
        for edge, size in (("width", 40), ("height", 24)):
            text, _ = re.subn(f'name="{edge}" value="[0-9]+"', f'name="{edge}" value="{size}"', text)
        (folder / f"{name}{suffix}").write_text(text)
    return folder / f"{name}.yaml"


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_scene_renders_in_a_fresh_clone(path):
    """Each material's recipe is named and ships, and so does every other file; no scene reads what somebody has to bake first."""
    loaded = scenes.load(path)
    text = path.read_text()
    kinds = set(re.findall(r"where: \{?(\w+)", text))
    of_kind = {"box": "discrete", "mesh": "granular", "shape": "translucent"}
    section = "mixed" if len(kinds) > 1 or "method: surface" in text else of_kind[kinds.pop()] if kinds else "fog"
    assert loaded.values.name == path.stem and loaded.section == section and (section == "fog" or loaded.values.stop.time)
    assert f"pictures/{path.stem}.png" in (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert all(one.recipe and not one.asset for one in loaded.materials)
    own = [loaded.file(one.recipe).resolve() for one in loaded.materials] + [one.resolve() for one in loaded.inputs]
    assert all(one.is_file() and (one.is_relative_to(SCENES) or one.is_relative_to(ROOT / "recipes")) for one in own)


@pytest.mark.slow
def test_the_readmes_scene_in_small(call, tmp_path, monkeypatch):
    """The file as it ships, with fewer samples: its recipe is baked into the cache, and nothing is written but the pictures."""
    monkeypatch.chdir(ROOT)
    assert "bake render assets/scenes/night_street.yaml" in (ROOT / "README.md").read_text()
    before = {path for folder in (SCENES, ROOT / "recipes") for path in folder.rglob("*")}
    text = (SCENES / "night_street.xml").read_text()
    small = re.sub(r'name="(width|height)" value="[0-9]+"', r'name="\1" value="24"', text)
    (tmp_path / "small.xml").write_text(small)
    assert all(f'name="{edge}" value="24"' in small for edge in ("width", "height"))
    status, out, err = call("render", "assets/scenes/night_street.yaml", "-o", tmp_path / "street.png", "--json",
                            "--set", f"picture.mitsuba={tmp_path / 'small.xml'}", "--set", "picture.samples=4")
    assert status == 0 and json.loads(out)["size"] == [24, 24] and min(json.loads(out)["mean"]) > 0, err
    assert {path for folder in (SCENES, ROOT / "recipes") for path in folder.rglob("*")} == before


@pytest.mark.slow
def test_square_emitter(call, tmp_path):
    """Its fog dims the light, spreads it, and goes on as its recipe says; grey, one wavelength for three channels."""
    asset = tmp_path / "emitter.h5"
    assert call(ROOT / "recipes/emitter.yaml", "-o", asset, "--set", "tolerance=20%", "--set", "beam.photons=1000")[0] in (0, 3)
    status, out, err = call("render", shipped("square_emitter", tmp_path), "--json", "--set", f"asset={asset}",
                            "--set", "picture.samples=4")
    assert status == 0, err
    report, found = json.loads(out), layers(tmp_path / "square_emitter.exr")
    assert report["size"] == [40, 24] and report["optical_depth"]["smallest"] == pytest.approx([5, 5, 5], rel=0.01)
    middle, corner = found["R"][12, 20], found["R"][0, 0]
    assert found["clear.R"][12, 20] == pytest.approx(1) and found["clear.R"][0, 0] == 0
    assert 0 < corner < middle < 0.5 and report["share_scattered"] > 0.9
    assert np.allclose(found["G"], 0.06 * found["R"], rtol=1e-4) and np.allclose(found["B"], 0.03 * found["R"], rtol=1e-4)


@pytest.mark.slow
def test_night_street(call, tmp_path):
    """Lamps glow, what is far fades to the sky; without fog the picture is the street."""
    asset = tmp_path / "street_fog.h5"
    fast = ("wavelengths=[0.55]", "tolerance=30%", "beam.photons=1000", "beam.depth=8", "particles.components[0].size.max=12 um")
    assert call(ROOT / "recipes/street_fog.yaml", "-o", asset, *(part for each in fast for part in ("--set", each)))[0] in (0, 3)
    scene = shipped("night_street", tmp_path)
    fixed = ("--set", f"asset={asset}", "--set", "picture.samples=16", "--seed", "1", "--quality", "draft",
             "--variant", "scalar_rgb", "--no-denoise")
    status, out, err = call("render", scene, "--json", *fixed)
    assert status == 0, err
    report, found = json.loads(out), layers(tmp_path / "night_street.exr")
    assert report["size"] == [40, 24] and report["without_surface"] > 50 and 0.1 < report["share_scattered"] < 0.9
    assert all(np.isfinite(found[c]).all() and (found[c] >= 0).all() for c in "RGB")
    street = np.isfinite(found["distance"])
    assert 3 < found["distance"][street].min() < 20 and 80 < found["distance"][street].max() < 230
    clear, fogged = (np.mean([found[f"{layer}{c}"] for c in "RGB"], axis=0) for layer in ("clear.", ""))
    dark = clear < np.quantile(clear, 0.4)
    assert fogged[dark].mean() > 1.5 * clear[dark].mean() and fogged.max() < clear.max()
    assert call("render", scene, *fixed, "--set", "fog.density.scale=0")[0] == 0
    found = layers(tmp_path / "night_street.exr")
    assert all(np.allclose(found[c], found[f"clear.{c}"], rtol=1e-6) for c in "RGB")


def test_the_street_is_what_its_script_writes(tmp_path):
    (tmp_path / "night_street.py").write_bytes((SCENES / "night_street.py").read_bytes())
    subprocess.run([sys.executable, str(tmp_path / "night_street.py")], check=True)
    assert (tmp_path / "night_street.xml").read_bytes() == (SCENES / "night_street.xml").read_bytes()


def test_a_picture_larger_than_the_memory_is_refused_before_it_is_rendered(place, monkeypatch, capfd):
    monkeypatch.setattr(images, "free_memory", lambda: 1e5)
    assert status_of(["render", str(place / "s.yaml"), "-o", str(place / "big.png")]) == 2
    assert "32 x 18 pixels" in (err := capfd.readouterr().err) and "million pixels" in err
    assert not (place / "big.png").exists()


def test_noise_beyond_the_mean_is_said_in_plain_numbers():
    from renderers.fog import describe

    report = {"files": ["a.png", "a.exr"], "size": [4, 3], "noise": 1.04, "share_scattered": 0.5, "share_sun": 0.0,
              "filter": {"points": "draft", "error": 0.0054}, "without_surface": 0,
              "optical_depth": {"median": [1.0, 1.0, 1.0]}, "seconds": {"total": 1.0},
              "picture": {"from": "mitsuba", "scene": "a.xml", "samples": 4, "noise": 1.3, "variant": "llvm", "reason": "fast"}}
    said = " ".join(describe(report))
    assert "filter: draft, within 0.54 %" in said and "noise 104 %" in said and "noise 130 %" in said and "e+" not in said


def test_frames_of_fog(call, place):
    """A filter over finished pictures has frames too, which cannot be gone on with: densities that rise, other pictures."""
    np.save(place / "near.npy", np.full((18, 32), 5.0))
    (place / "s.yaml").write_text(SCENE + "frames:\n  fog.density.scale: {from: 0.5, to: 2}\n"
                                          "  picture.depth: [depth.npy, near.npy, near.npy]\n")
    status, out, err = call("render", place / "s.yaml", "--frames", "1-3", "--json")
    assert status == 0, err
    rows = json.loads(out)["frames"]
    assert [row["method"] for row in rows] == ["screen"] * 3 and rows[0]["noise"] is None
    second, third = (layers(place / f"night.000{number}.exr") for number in (2, 3))
    assert (second["distance"] == 5).all() and third["B"].mean() < second["B"].mean()
    assert call("render", place / "s.yaml", "-o", place / "plain.png")[0] == 0
    assert all(np.array_equal(values, layers(place / "night.0001.exr")[name])
               for name, values in layers(place / "plain.exr").items())
    status, _, err = call("render", place / "s.yaml", "--frames", "1", "--resume")
    assert status == 2 and "--resume: the renderer fog cannot go on from an EXR" in err
