"""Grains in a mesh as their baked surface far from the camera: the limits of all near and all far, light that is kept, and where.

Statistical tests have fixed seeds; limits are six standard errors of both sides: false alarms in 2e-9 a comparison.
"""

import math

import numpy as np
import pytest

pytest.importorskip("renderers.mitsuba", exc_type=ImportError)

from bakery.cli import status_of
from bakery.errors import RecipeError
from bakery.store import ply
from renderers import choice
from renderers import scene as scenes
from renderers.choice import surfaces
from renderers.materials.grains import declared, far
from renderers.materials.surface import lobes
from renderers.mitsuba import layers
from renderers.mitsuba.shading import LightSample
from renderers.mitsuba.world import World
from renderers.scene import assets, candidates
from renderers.transport.paths import Colours, Paths
from tests.physics.surfaces.layers import RGB, table
from tests.physics.test_aggregate import CUBE

RECIPE = """\
bakery: 1
name: NAME
wavelengths: [0.55]
tolerance: 10%
grains: {radius: 0.5 mm, components: [{name: ball, shape: {type: sphere}, surface: {type: diffuse, reflectance: ALBEDO}}]}
packing: {fraction: 0.6, count: 60}
effective_medium: {walks: 30000}
surface: {method: medium, tolerance: 5%}
"""
SCENE = """\
bakery_scene: 2
name: field
scene: {mitsuba: LIGHT.xml, unit: 1 m}
materials: [{where: {PLACE}, asset: NAME.h5}]
camera: {origin: [0, -0.19, 0.02] m, target: [0, -0.1, 0] m, fov: 50 deg}
film: {width: 16, height: 16}
tolerance: 5%
stop: {noise: 1%, time: 600 s}
"""
SKY = '<emitter type="constant"/>'
SUN = """<emitter type="constant"> <float name="radiance" value="0.3"/> </emitter> <emitter type="directional">
    <vector name="direction" x="-0.8" y="-0.35" z="-0.6"/> <float name="irradiance" value="3"/> </emitter>"""
BLOCK = """<shape type="ply" id="field"> <string name="filename" value="field.ply"/>
    <boolean name="face_normals" value="true"/> <bsdf type="null"/> </shape>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Scenes of a slab of balls, 0.4 m wide and ten of them deep."""
    place = tmp_path_factory.mktemp("far_grains")
    (place / "field.ply").write_bytes(ply.mesh((CUBE[0] - [0.5, 0.5, 1.0]) * [0.4, 0.4, 0.01], CUBE[1]))
    for name, light in (("sky", SKY), ("sun", SUN), ("block", SUN + BLOCK)):
        (place / f"{name}.xml").write_text(f'<scene version="3.0.0"> {light} </scene>')
    return place


@pytest.fixture(scope="module")
def baked(folder):
    """Names of assets of balls by their reflectance."""
    def of(albedo):
        name = f"balls{round(10 * albedo)}"
        if not (folder / f"{name}.h5").exists():
            (folder / f"{name}.yaml").write_text(RECIPE.replace("NAME", name).replace("ALBEDO", str(albedo)))
            assert status_of([str(folder / f"{name}.yaml"), "-o", str(folder / f"{name}.h5"), "--quiet"]) in (0, 3)
        return name

    return of


def opened(folder, name, light="sun", settings=None, where="mesh: field.ply"):
    path = folder / f"{light}_{name}.yaml"
    path.write_text(SCENE.replace("LIGHT", light).replace("NAME", name).replace("PLACE", where))
    scene = assets.together([scenes.load(path, settings or {})])[0]
    return choice.Opened.of(scene), World.of(scene)


def rendered(scene, world, passes):
    """Luminance of passes (passes, H, W), the parts of the method added, and sentences about it."""
    method = scene.scene.prepare(scene, world, 0)
    return sum(np.array([part.render(number)[""][..., 1] for number in range(passes)]) for part in method.parts), method.reasons


def by_surface(from_):
    return {"materials[0].method": "ept+vpt+surface", "materials[0].surface_from": from_}


def same(one, other, but=0.0):
    """Whether means of passes (P, ...) are the same to six standard errors and a share of them."""
    means = [pictures.reshape(len(pictures), -1).mean(axis=1) for pictures in (one, other)]
    error = math.hypot(*(mean.std(ddof=1) / len(mean) ** 0.5 for mean in means))
    return abs(means[0].mean() - means[1].mean()) < 6 * error + but * means[1].mean()


def test_lobes_send_on_what_the_table_says():
    """Of light from all sides: by drawn directions, by even light samples, and by both joined; to six standard errors."""
    sends, n, rng = lobes.of_layer(layers.Layer(np.array(RGB), table("tinted")[0], 0.002)), 200_000, np.random.default_rng(1)
    normal, along = np.tile([0.0, 0.6, 0.8], (n, 1)), np.array([0.8, -0.48, -0.36])
    paths = Paths.begun(np.zeros((n, 3)), np.tile(along / np.linalg.norm(along), (n, 1)), 3,
                        rng.integers(1 << 62, size=n).astype(np.uint64), np.zeros(n, int))
    z, turn = rng.uniform(-1, 1, n), rng.uniform(0, 2 * math.pi, n)
    towards = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
    even, colours, none = 1 / (4 * math.pi), Colours(np.eye(3), np.eye(3)), np.zeros(n, bool)
    sample = LightSample(towards, np.ones(n), np.full((n, 3), 1 / even), np.full(n, even), none, np.zeros(n, int))
    joined, alone = (lobes.next_event(sends, colours, paths, normal, light, np.ones((n, 3)))
                     for light in (sample, sample._replace(delta=~none)))
    lobes.scatter(sends, paths, normal)
    drawn = paths.throughput
    assert np.all(np.sum(paths.direction * normal, axis=1) > 0) and np.allclose(np.linalg.norm(paths.direction, axis=1), 1)
    joined += drawn * (paths.density / (paths.density + even))[:, None]
    for other in (alone, joined):
        error = np.hypot(drawn.std(axis=0), other.std(axis=0)) / n**0.5
        assert np.all(np.abs(drawn.mean(axis=0) - other.mean(axis=0)) < 6 * error) and np.all(error < 0.01 * drawn.mean(axis=0))


@pytest.mark.slow
def test_near_with_all_parts_it_is_the_method_without_a_surface(folder, baked):
    """To the last bit."""
    (scene, world), (plain, _) = (opened(folder, baked(0.6), settings=settings) for settings in (
        by_surface("1 km"), {"materials[0].method": "ept+vpt"}))
    pictures, reasons = rendered(scene, world, 1)
    assert np.array_equal(pictures, rendered(plain, world, 1)[0])
    assert any("0 % of what the camera sees of it is its surface" in reason for reason in reasons)
    assert not any("light leaves where it came in" in reason for reason in reasons)


@pytest.mark.slow
def test_far_with_all_parts_it_is_the_surface_of_a_body(folder, baked):
    """That of Mitsuba's loop, with its own draws, over the same mesh as a shape; the sky behind is the same, too."""
    scene, world = opened(folder, baked(0.6), settings=by_surface("0 m"))
    body, around = opened(folder, baked(0.6), "block", {"materials[0].method": "surface"}, "shape: field")
    one, other = rendered(scene, world, 32)[0], rendered(body, around, 32)[0]
    for rows in np.array_split(np.arange(16), 4)[1:]:
        assert same(one[:, rows], other[:, rows], 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("from_", ["0 m", "40 mm"])
def test_white_grains_stay_white(folder, baked, from_):
    """In light from everywhere, all far and changing; the table's error is 0.2 %."""
    scene, world = opened(folder, baked(1.0), "sky", by_surface(from_))
    pictures, reasons = rendered(scene, world, 24 if from_ == "0 m" else 6)
    means = pictures.mean(axis=(1, 2))
    error = means.std(ddof=1) / len(means) ** 0.5
    assert error < 3e-3 and abs(means.mean() - 1) < 2e-3 + 6 * error, reasons


@pytest.mark.slow
def test_a_surface_counted_among_grains_is_as_bright_as_the_grains(folder):
    """Beside `ept`, which has no error of its own, by thirds of the picture's rows, the sun 50 degrees off the view's azimuth.

    Within 2.5 % and six standard errors: 2 % of the surface, 1.5 % by which a tile that is cut once differs from its mean.
    """
    recipe = RECIPE.replace("NAME", "counted").replace("ALBEDO", "0.6").replace("count: 60", "count: 300")
    (folder / "counted.yaml").write_text(recipe.replace("{method: medium, tolerance: 5%}", "{tolerance: 2%}"))
    assert status_of([str(folder / "counted.yaml"), "-o", str(folder / "counted.h5"), "--quiet"]) in (0, 3)
    view = {"camera.origin": "[0, -0.19, 0.06] m", "camera.target": "[0, 0, 0] m", "camera.fov": "40 deg"}
    far_off, _ = rendered(*opened(folder, "counted", settings=view | by_surface("0 m")), 48)
    near_by, _ = rendered(*opened(folder, "counted", settings=view | {"materials[0].method": "ept"}), 96)
    for rows in np.array_split(np.arange(16), 3):
        means = near_by[:, rows].mean(axis=(1, 2))
        assert means.std() / len(means) ** 0.5 < 0.005 * means.mean()
        assert same(far_off[:, rows], near_by[:, rows], 0.025)


def test_grains_are_their_surface_from_where_pixels_are_wide_against_them(folder, baked):
    """Farther off by narrower pixels, and nowhere where no tolerance is kept; there `auto` does not try it."""
    near, offered = [], []
    for width, tolerance in (("16", "50%"), ("64", "50%"), ("16", "0.1%")):
        scene, world = opened(folder, baked(0.6), settings={"tolerance": tolerance, "film.width": width})
        begins = far.onset_of(scene.scene, 0, scene.asset, world, declared.methods()["ept+vpt+surface"])
        kept, refused = surfaces.beside(scene, world, candidates.of(scene.scene))
        near.append(begins.near)
        offered.append({candidate.name: candidate.stated(float(tolerance[:-1]) / 100) for candidate in kept})
    assert 0 < near[0] < near[1] < near[2] == math.inf
    assert list(offered[0]) == ["ept", "ept+vpt+da", "ept+vpt", "ept+vpt+surface", "ept+wide"]
    assert offered[0]["ept+vpt+surface"] > offered[0]["ept+vpt"] > 0
    assert list(offered[2]) == ["ept", "ept+vpt+da", "ept+vpt", "ept+wide"] and not refused
    with pytest.raises(RecipeError, match="surface_from, which method ept does not use.*ept[+]vpt[+]surface"):
        opened(folder, baked(0.6), settings={"materials[0].method": "ept", "materials[0].surface_from": "1 m"})
