"""Bodies as their baked surfaces: what is expected of that, and where `auto` takes one."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from bakery.physics.shapes.radial import icosphere

pytest.importorskip("renderers.mitsuba", exc_type=ImportError)

from renderers import choice
from renderers import scene as scenes
from renderers.choice import surfaces
from renderers.materials.surface import far, onset
from renderers.mitsuba.shapes import Shape
from renderers.mitsuba.world import World
from renderers.scene import assets, budget, candidates

RECIPE = """\
bakery: 1
name: wall
wavelengths: [0.55]
tolerance: 1%
medium: {albedo: 0.9, mean_free_path: 2 mm, phase: {type: hg, g: 0.3}}
surface: {}
"""
XML = """<scene version="3.0.0">
    <emitter type="constant"> <float name="radiance" value="0.3"/> </emitter>
    <emitter type="directional" id="sun"> <vector name="direction" x="-0.8" y="-0.35" z="-0.6"/>
        <float name="irradiance" value="3"/> </emitter>
    <shape type="SHAPE" id="field"> <transform name="to_world"> <scale x="20" y="20" z="1"/> <translate z="-1"/> </transform>
        <bsdf type="BSDF"/> </shape>
    <shape type="cube"> <transform name="to_world"> <scale x="0.4" y="0.4" z="1"/> </transform> </shape> </scene>"""
SCENE = """\
bakery_scene: 2
name: field
scene: {mitsuba: field.xml, unit: 1 m}
materials: [{where: {shape: field}, recipe: wall.yaml}]
camera: {origin: [0, -8, 3] m, target: [0, 0, 0] m, fov: 40 deg}
film: {width: 160, height: 160}
tolerance: 5%
stop: {noise: 1%, time: 600 s}
"""
WHITE = """<scene version="3.0.0"> <emitter type="constant"/>
    <shape type="SHAPE" id="field"> <transform name="to_world"> <scale x="20" y="20" z="1"/> <translate z="-1"/> </transform>
        <bsdf type="BSDF"/> </shape> </scene>"""
EYE = {"camera.origin": "[0, -3, 0.6] m", "camera.target": "[0, -2, 0] m", "camera.fov": "50 deg", "tolerance": "0.7%"}
NEAR = {"camera.origin": "[0, -0.42, 0.05] m", "camera.target": "[0, -0.4, 0] m"}


def opened(folder, settings=None, shape="cube", bsdf="null", recipe=RECIPE, xml=XML):
    (folder / "wall.yaml").write_text(recipe)
    (folder / "field.xml").write_text(xml.replace("SHAPE", shape).replace("BSDF", bsdf))
    (folder / "field.yaml").write_text(SCENE)
    scene = assets.together([scenes.load(folder / "field.yaml", settings or {})])[0]
    return choice.Opened.of(scene), World.of(scene)


def medium(albedo, g=0.0, **more):
    one = np.array([1.0])
    return SimpleNamespace(medium={"sigma_t": 1e3 * one, "albedo": albedo * one, "g": g * one}, surface=more)


def test_the_mean_distance_by_diffusion_is_below_the_root_of_the_mean_square():
    """Numerically, against the closed form of the same two points for the mean square; with absorption both fall."""
    distances = [(far.mean_distance(medium(albedo))[0], far.spread(medium(albedo))[0]) for albedo in (0.5, 0.9, 0.99, 0.9999)]
    means, roots = np.transpose(distances)
    assert (means < roots).all() and (np.diff(means) > 0).all() and (np.diff(roots) > 0).all()
    assert means[-1] < 0.5 * roots[-1]  # few paths go far


def test_the_mean_distance_of_bins_is_that_of_their_middles():
    bins = {"mean_square": np.ones((1, 1)), "spread_radius": np.array([[[1e3, 3e3]]]), "spread": np.zeros((1, 1, 1, 1, 2))}
    bins["spread"][..., :] = 0.6, 0.2
    assert far.mean_distance(medium(0.9, **bins))[0] == pytest.approx((0.6 * 0.5e-3 + 0.2 * 2e-3) / 0.8)


def test_a_ball_of_triangles_is_off_by_its_radius():
    """2 % : facets are not all alike.  A box, whose sides are wider than light spreads, is off at its edges only."""
    vertices, faces = icosphere(1280)
    ball = Shape("ball", 3 * np.asarray(vertices), np.asarray(faces), np.array([[-3.0] * 3, [3.0] * 3]), 1.0, True)
    assert far.bent(ball, np.array([0.1, 1.0])) == pytest.approx(far.OFF * np.array([0.1, 1.0]) / 3, rel=0.02)
    round_one = ball._replace(vertices=None, faces=None)
    assert far.bent(round_one, np.array([0.3])) == pytest.approx(far.OFF * 0.1)


SHADED = """<scene version="3.0.0"> <emitter type="directional" id="sun"> <vector name="direction" x="-1" y="0" z="-1"/>
    <float name="irradiance" value="3"/> </emitter>
    <shape type="SHAPE" id="field"> <transform name="to_world"> <scale x="20" y="20" z="1"/> <translate z="-1"/> </transform>
        <bsdf type="BSDF"/> </shape>
    <shape type="rectangle"> <transform name="to_world"> <scale value="0.5"/> <translate x="10" z="10"/> </transform> </shape>
    MORE </scene>"""
ABOVE = {"camera.origin": "[0.011, 0.023, 8] m", "camera.target": "[0.011, 0.023, 0] m", "camera.up": "[0, 1, 0]",
         "film.width": "64", "film.height": "64", "camera.fov": f"{2 * math.degrees(math.atan(0.25))} deg"}  # 4 m across


@pytest.mark.slow
def test_pixels_that_shadows_edges_cross(tmp_path):
    """A square shadow, 1 m wide: of the pixels on its four sides the light changes by all that there is elsewhere; without it by
    none.  Behind glass no light comes straight, and the edges are a square's outline."""
    pane = '<shape type="cube"> <transform name="to_world"> <scale value="25"/> </transform> <bsdf type="dielectric"/> </shape>'
    steps = []
    for name, more in (("shaded", ""), ("even", ""), ("behind", pane)):
        (tmp_path / name).mkdir()
        xml = SHADED.replace("MORE", more).replace('value="0.5"', 'value="1e-6"' if name == "even" else 'value="0.5"')
        _, world = opened(tmp_path / name, ABOVE, xml=xml)
        steps.append(far.seen_by(world, next(shape for shape in world.shapes() if shape.name == "field")).steps)
    assert np.mean(steps[0]) == pytest.approx(4 * 1 / (4 * 64) / (1 - 1 / 16) ** 2, rel=0.05)
    assert steps[1].max() < 1e-6 and np.mean(steps[2]) == pytest.approx(4 / 64)


def test_pixels_and_the_bend_decide_where_a_surface_is_offered(tmp_path):
    far_off, world = opened(tmp_path)
    offered, refused = surfaces.beside(far_off, world, candidates.of(far_off.scene))
    assert [candidate.name for candidate in offered[:2]] == ["paths", "surface"] and not refused
    assert 0 < offered[1].stated(0.05) < budget.ROOM * 0.05
    near = far_off._replace(scene=scenes.load(tmp_path / "field.yaml", NEAR, assets=False))
    offered, refused = surfaces.beside(near, World.of(near.scene), candidates.of(near.scene))
    assert "surface" not in [candidate.name for candidate in offered]
    assert "is expected, and 2.5 % allowed" in refused["materials[0] by surface"]


@pytest.mark.slow
def test_a_body_is_its_surface_from_where_that_keeps_the_tolerance(tmp_path):
    """Nearer with a larger tolerance; nowhere with the least; and as the scene says, at no distance and at any."""
    field, world = opened(tmp_path, EYE)
    begins = [onset.of(scenes.load(tmp_path / "field.yaml", EYE | more, assets=False), 0, field.asset, world) for more in (
        {"tolerance": "0.01%"}, {"tolerance": "0.7%"}, {"tolerance": "2%"}, {"materials[0].surface_from": "1 km"},
        {"materials[0].surface_from": "0 m"})]
    assert begins[0].near == math.inf and begins[1].near > 1.5 * begins[2].near > 0
    assert 0.1 < begins[1].share < begins[2].share < 1
    assert begins[1].error <= budget.ROOM * 0.007 and begins[2].error <= budget.ROOM * 0.02
    assert begins[3] == (1000.0, 0.0, 0.0)
    assert begins[4].share == 1 and begins[4].error == pytest.approx(far.deviation(field.scene, 0, field.asset, world))
    offered, _ = surfaces.beside(field, world, candidates.of(field.scene))
    (changing,) = (candidate for candidate in offered if candidate.name == "paths+surface")
    assert changing.methods == ("paths+surface",) and changing.stated(0.007) == pytest.approx(begins[1].error)
    assert changing.name not in [candidate.name for candidate in surfaces.beside(*opened(tmp_path), ())[0]]  # all of it is far


def test_a_body_that_bends_is_nowhere_its_surface(tmp_path):
    field, _ = opened(tmp_path, EYE)
    (tmp_path / "field.xml").write_text(XML.replace("SHAPE", "cube").replace("BSDF", "null").replace('"20"', '"0.01"').replace(
        'z="1"/> <translate z="-1"', 'z="0.01"/> <translate z="-0.01"'))
    assert onset.of(field.scene, 0, field.asset, World.of(field.scene)).near == math.inf


def rendered(folder, method, settings, passes):
    scene = assets.together([scenes.load(folder / "field.yaml", settings | {"materials[0].method": method})])[0]
    prepared = scene.prepare(choice.Opened.of(scene), World.of(scene), 0)
    (part,) = prepared.parts
    return np.array([part.render(number)[""] for number in range(passes)]), prepared.reasons


SMALL = {"film.width": "16", "film.height": "16"}


@pytest.mark.slow
def test_the_edge_of_a_shadow_moves_as_much_light_as_is_expected(tmp_path):
    """Pixels 2 mm wide on both sides of an edge along the sun's azimuth: what paths bring into the shadow, over a lit pixel, is
    0.85 +- 0.02 of the mean distance over pi, which is that of light from all sides; eight standard errors."""
    width = 2e-3
    settings = {"camera.origin": "[0.001, 0.5, 0.2] m", "camera.target": "[0.001, 0.5, 0] m", "camera.up": "[0, 1, 0]",
                "camera.fov": f"{2 * math.degrees(math.atan(2 * width / 0.2))} deg", "film.width": "4", "film.height": "16",
                "materials[0].method": "surface"}
    field, _ = opened(tmp_path, settings, xml=SHADED.replace("MORE", ""))
    paths, surface = (rendered(tmp_path, method, settings, passes)[0].mean(axis=(0, 2, 3)) for method, passes in (
        ("paths", 150), ("surface", 2)))
    lit = surface > surface.max() / 2
    assert lit.sum() == 8 and surface[~lit].max() == 0
    moved, expected = paths[~lit].sum() / surface.max(), far.mean_distance(field.asset)[0] / (math.pi * width)
    assert 0.7 < moved / expected < 1


@pytest.mark.slow
def test_near_with_all_its_parts_it_is_paths_and_far_with_all_of_them_its_surface(tmp_path):
    """To the last bit."""
    settings = EYE | SMALL
    opened(tmp_path, settings)
    for from_, method in (("1 km", "paths"), ("0 m", "surface")):
        mixed, reasons = rendered(tmp_path, "paths+surface", settings | {"materials[0].surface_from": from_}, 1)
        assert np.array_equal(mixed, rendered(tmp_path, method, settings, 1)[0]), reasons


@pytest.mark.slow
def test_from_inside_there_is_no_surface(tmp_path):
    """A camera under the top of the block sees the light that gets in, though all of the block is far; hardly any leaves it and
    would come back.  Six standard errors: 2e-9."""
    inside = EYE | SMALL | {"camera.origin": "[0, -3, -0.001] m", "camera.target": "[0, -2, 0.3] m"}
    opened(tmp_path, inside)
    pictures = [rendered(tmp_path, method, inside | more, 8)[0].mean(axis=(1, 2, 3)) for method, more in (
        ("paths", {}), ("paths+surface", {"materials[0].surface_from": "0 m"}))]
    paths, changing = ((means.mean(), means.std(ddof=1) / len(means)**0.5) for means in pictures)
    assert paths[1] < 0.02 * paths[0] and abs(paths[0] - changing[0]) < 6 * math.hypot(paths[1], changing[1])


@pytest.mark.slow
def test_a_white_half_space_that_changes_into_its_surface_stays_white(tmp_path):
    """The table's error, 0.2 %, and six standard errors: 2e-9."""
    settings = EYE | SMALL | {"materials[0].surface_from": "1.2 m"}
    recipe = RECIPE.replace("albedo: 0.9", "albedo: 1").replace("2 mm", "50 mm")  # paths of hundreds of events, not thousands
    opened(tmp_path, settings, recipe=recipe, xml=WHITE)
    images, reasons = rendered(tmp_path, "paths+surface", settings, 8)
    assert any("it changes from 1.2 m to 2.4 m from the camera" in reason for reason in reasons)
    means = images.mean(axis=(1, 2, 3))
    error = means.std(ddof=1) / len(means)**0.5
    assert error < 3e-3 and abs(means.mean() - 1) < 2e-3 + 6 * error


@pytest.mark.slow
def test_an_open_sheet_is_a_surface_and_a_boundary_of_another_index_is_not(tmp_path):
    sheet, world = opened(tmp_path, shape="rectangle", bsdf="diffuse")
    offered, refused = surfaces.beside(sheet, world, candidates.of(sheet.scene))
    assert [candidate.name for candidate in offered] == ["surface"] and "is no closed mesh" in refused["paths"]
    taken = choice.chosen(sheet, world)
    assert taken.method == "surface" and taken.methods == ["surface"] and "no other candidate" in taken.sentence
    glass, world = opened(tmp_path, bsdf="dielectric")
    assert "surface" not in [candidate.name for candidate in surfaces.beside(glass, world, candidates.of(glass.scene))[0]]
    assert "index 1, and the shape's has" in far.unfit(glass.scene.values.materials[0], glass.asset, world)


@pytest.mark.slow
def test_auto_is_a_surface_from_afar_and_as_bright_as_paths(tmp_path, monkeypatch):
    """Pilots of so many samples, so that no clock decides how many; the picture's mean within what is allowed and six standard
    errors: 2e-9."""
    of, trials = choice.trial.of, []

    def counted(prepare, world, seconds, **_):
        trials.append(of(prepare, world, None, 64))
        return trials[-1]

    monkeypatch.setattr(choice.trial, "of", counted)
    field, world = opened(tmp_path)
    offered = [candidate for candidate in surfaces.beside(field, world, candidates.of(field.scene))[0]
               if candidate.name in ("paths", "surface")]
    best = choice._Pilots(field, world, choice.stop_of(field.scene, None), offered).choice()
    paths, surface = (row["seconds"] for row in best.table)
    assert best.method == "surface" and surface < paths, best.table
    assert best.approximations <= budget.ROOM * 0.05
    (mean, error), (expected, its_error) = ((pilot.level, math.sqrt(pilot.light[""].variance.sum()) / pilot.light[""].mean.size)
                                            for pilot in (trials[1], trials[0]))
    assert abs(mean - expected) < best.approximations * expected + 6 * math.hypot(error, its_error)
    assert error < 0.01 * mean and its_error < 0.01 * expected
    assert all(shape.index == 1 for shape in world.shapes() if shape.name == "field")  # as it was before the pilots
