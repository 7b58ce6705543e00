"""The preview of packed grains, tiny: exemplars with their surfaces and interiors, beside the medium that stands for them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

renderer = pytest.importorskip("renderers.mitsuba", exc_type=ImportError)

import mitsuba as mi

import bakery
from bakery.errors import AssetError
from bakery.grammar.qualities import Panel
from bakery.physics.grains.sphere import ball
from bakery.physics.grains.surface import conductor, dielectric, diffuse
from bakery.store.tree import text
from bakery.store.write import write
from renderers.mitsuba import passes
from renderers.preview import describe, grains, preview, studio
from tests.grain_assets import RADIUS, asset, component
from tests.samples import with_member

SMALL = Panel(64, 2, 0.05, 120.0)

GLASS = {"type": "dielectric", "index": [1.5, 1.5, 1.5], "roughness": 0.0}
RED = {"type": "diffuse", "reflectance": [0.8, 0.4, 0.1]}


@pytest.fixture(scope="module")
def tree():
    return asset({"glass": component({"type": "sphere"}, GLASS, weight=0.4),
                  "clay": component({"type": "box", "size": [1, 1, 1]}, RED, weight=0.6, tolerance=0.1)})


@pytest.fixture(scope="module")
def beads(tree, tmp_path_factory):
    path = tmp_path_factory.mktemp("beads") / "beads.h5"
    write(path, tree)
    return path


def pixels(path):
    return np.array(mi.Bitmap(str(path)))


@pytest.mark.slow
def test_two_panels_and_a_report(beads, tmp_path):
    seen = []
    report = preview(beads, tmp_path / "x.png", panel=SMALL, progress=lambda fraction, noise: seen.append(fraction))
    png, exr = pixels(tmp_path / "x.png"), pixels(tmp_path / "x.exr")
    assert png.shape == exr.shape == (40 + 56, 2 * 64 + 1, 3) and np.isfinite(exr).all()
    assert [panel["shows"] for panel in report["panels"]] == ["grains", "medium"] and report["width"] == png.shape[1]
    assert report["grains"] == ["clay", "glass"] and report["grains_left_out"] == 0  # the commonest first
    assert report["grain_radius"] == pytest.approx(RADIUS)
    assert seen == sorted(seen) and seen[-1] == 1.0
    opened = bakery.open(beads)
    # 40 mean free paths, about a hundred radii of the grains
    assert report["block_edge"] == pytest.approx(40 / opened.medium.sigma_t.max()) and 50 < report["block_edge"] / RADIUS < 200
    words = " ".join(describe(report))
    assert "clay, glass" in words and "500 um" in words and "40 mean free paths" in words
    preview(beads, tmp_path / "again.exr", panel=SMALL)
    np.testing.assert_array_equal(pixels(tmp_path / "again.exr"), exr)
    clay = exr[14:26, 14:24].reshape(-1, 3).mean(axis=0)  # the box stands on the left
    assert clay[0] > 1.3 * clay[1] > 1.6 * clay[2]


@pytest.mark.slow
def test_grains_alone(tree, tmp_path):
    """An asset baked with `--stage grains`: one panel; without both, the message says what is missing."""
    write(tmp_path / "alone.h5", with_member(tree, "medium", None))
    report = preview(tmp_path / "alone.h5", tmp_path / "x.png", panel=SMALL._replace(width=48))
    assert pixels(tmp_path / "x.png").shape == (30 + 40, 48, 3) and "block" not in report
    write(tmp_path / "none.h5", with_member(with_member(tree, "medium", None), "grains", None))
    with pytest.raises(AssetError, match="no stage 'medium'"):
        preview(tmp_path / "none.h5", tmp_path / "y.png", panel=SMALL._replace(width=48))


@pytest.mark.parametrize("variant", ["scalar_rgb", renderer.variants.choose().names[0]])
def test_balls_return_the_light_of_the_closed_form(variant):
    """Under equal light from everywhere a ball, seen whole from afar, is as bright as its albedo says.

    Dielectric with absorbing interior, Lambertian, metal.  25,000 rays of radiance 0 to 1 have a standard error below 0.0032 of
    the mean; 6 of them, and 1 % more for pixels at the rim.
    """
    renderer.variants.activate("mono", variant)
    mu = 0.7 / RADIUS
    cases = [({"type": "dielectric", "index": [1.5]}, mu, dielectric(1.5), mu * RADIUS),
             ({"type": "diffuse", "reflectance": [0.6]}, 0.0, diffuse(0.6), 0.0),
             ({"type": "conductor", "n": [0.3], "k": [2.5]}, 0.0, conductor(0.3 + 2.5j), 0.0),
             ({"type": "conductor", "n": [float("inf")], "k": [0.0]}, 0.0, conductor(np.inf), 0.0)]
    for stored, interior, surface, absorbed in cases:
        grain = grains.Grain("ball", 1.0, None, None, stored, np.array([interior]))
        unit = grains.scale(1)
        shape = grains._shape(grain, (0.0, 0.0), unit, RADIUS, 0, None)
        place = mi.ScalarTransform4f().look_at(origin=[0, -5, 1 / unit], target=[0, 0, 1 / unit], up=[0, 0, 1])
        built = mi.load_dict({"type": "scene", "integrator": {"type": "volpath", "max_depth": 200}, "light": {"type": "constant"},
                              "sensor": {"type": "orthographic", "to_world": place @ mi.ScalarTransform4f().scale([1 / unit] * 3),
                                         "film": {"type": "hdrfilm", "width": 64, "height": 64, "pixel_format": "luminance",
                                                  "rfilter": {"type": "box"}}},
                              "ball": shape})
        image = np.array(mi.render(built, spp=8, seed=1))[..., 0]
        across = (np.arange(64) + 0.5) / 32 - 1
        inside = np.hypot(across, across[:, None]) < 1
        assert image[inside].mean() == pytest.approx(ball(surface, absorbed).albedo[0], abs=0.03)


def test_clear_grains_vanish_in_equal_light(monkeypatch):
    """Glass, smooth and rough, and white clay under radiance 1 from all sides on white ground cannot be seen: energy is kept.

    Rough glass loses what its facets hide from each other (few per cent at this roughness); paths are ended by roulette only.
    """
    monkeypatch.setattr(studio, "sky", lambda direction: np.ones(direction.shape[:-1]))
    monkeypatch.setattr(studio, "reflectance", lambda x, y: np.ones(np.broadcast(x, y).shape))
    renderer.variants.activate("mono")
    mesh = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (0, 2)]) / np.sqrt(3)
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                      [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    clear = np.zeros(1)
    shown = [grains.Grain("a", 0.5, mesh, faces, {"type": "dielectric", "index": [1.3]}, clear),
             grains.Grain("b", 0.3, None, None, {"type": "dielectric", "index": [1.5], "roughness": 0.05}, clear),
             grains.Grain("c", 0.2, mesh, faces, {"type": "diffuse", "reflectance": [1.0]}, clear)]
    picture = passes.render([grains.scene(mi, shown, RADIUS, 0, 96, 60)], np.ones((3, 1)), samples=16, per_pass=8)
    assert picture.rgb.mean() == pytest.approx(1, abs=0.01)
    features = grains.features(mi, shown, RADIUS, 96, 60)
    seen = np.abs(features[..., :3]).max(axis=-1) > 0.3
    assert 0.05 < seen.mean() < 0.6 and picture.rgb[seen].mean() == pytest.approx(1, abs=0.02)


def test_grains_lie_stable():
    """Turned anyhow, a slab comes to lie on its large face, whole and on the ground."""
    slab = np.array([[x, y, z] for x in (-1, 1) for y in (-0.8, 0.8) for z in (-0.2, 0.2)]) / 1.3
    turn = Rotation.align_vectors([2.0, 1.0, -2.0], [0.0, 0.0, 1.0])[0].as_matrix()
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    lying = grains.resting(slab @ turn.T)
    np.testing.assert_allclose(np.sort(lying[:, 2]), [0] * 4 + [0.4 / 1.3] * 4, atol=1e-9)
    for count in range(1, grains.MOST + 1):
        places, unit = grains._PLACES[count]
        apart = [np.hypot(*np.subtract(a, b)) for i, a in enumerate(places) for b in places[:i]]
        assert len(places) == count and min(apart, default=2.0) >= 2.0 and unit > 1  # bounding spheres do not meet


@pytest.mark.slow
@pytest.mark.parametrize(("path", "stored", "message"), [
    ("surface", "{", "no JSON object"), ("surface", '{"type": "jelly"}', "found type 'jelly'"),
    ("surface", '{"type": "dielectric", "index": [1.5]}', "3 numbers are needed"), ("shape", "[]", "no JSON object")])
def test_damage_is_named(tree, tmp_path, path, stored, message):
    write(tmp_path / "x.h5", with_member(tree, f"grains/clay/{path}", text(stored, path)))
    with pytest.raises(AssetError, match=message):
        preview(tmp_path / "x.h5", tmp_path / "x.png", panel=SMALL._replace(width=48))


def test_faces_that_name_no_vertex_are_refused(tree, tmp_path):
    faces = tree["grains/clay/faces"]
    broken = type(faces)(faces.data + 5, faces.units, faces.description)
    write(tmp_path / "x.h5", with_member(tree, "grains/clay/faces", broken))
    with pytest.raises(AssetError, match="grains/clay/faces: holds"):
        preview(tmp_path / "x.h5", tmp_path / "x.png", panel=SMALL._replace(width=48))
