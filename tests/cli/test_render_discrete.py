"""`bake render SCENE.yaml` of particles as a user calls it: report, layers, the same bytes, resuming, and every way to fail."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from bakery.cli import status_of
from bakery.physics.shapes.radial import icosphere
from tests.conftest import slow
from tests.exr import layers
from tests.renders import picture, rendered

RECIPE = """\
bakery: 1
name: drops
wavelengths: rgb
tolerance: 20%
particles:
  host: air
  number_density: 4e14 /m^3
  components: [{name: drops, material: water, size: {distribution: single, radius: 2 um}}]
discrete: {count: 200, box: [80 um, 80 um, 80 um], seed: 3, METHOD}
"""
SCENE = """\
bakery_scene: 2
name: lamp
scene: {mitsuba: lamp.xml, unit: 1 um}
camera: {origin: [40, -150, 40] um, target: [40, 40, 40] um, fov: 30 deg}
film: {width: 80, height: 64}
stop: {samples: 2}
materials:
  - {asset: drops.h5, method: particles}
"""
HASHED = "materials[0].asset=hashed.h5"
XML = """<scene version="3.0.0">
<shape type="rectangle" id="floor"><transform name="to_world"><scale value="200"/></transform>
  <bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.4 0.3"/></bsdf></shape>
<shape type="rectangle" id="panel"><transform name="to_world"><scale value="40"/><rotate x="1" angle="180"/>
  <translate x="40" y="40" z="120"/></transform><emitter type="area"><rgb name="radiance" value="3 3 3"/></emitter></shape>
<emitter type="spot" id="spot"><transform name="to_world"><lookat origin="-60, 40, 60" target="40, 40, 40" up="0, 0, 1"/>
  </transform><rgb name="intensity" value="9000 8000 7000"/><float name="cutoff_angle" value="30"/></emitter></scene>"""


@pytest.fixture(scope="module")
def assets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("assets")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        for name, method in (("drops", "method: stored"), ("hashed", "method: procedural")):
            (folder / f"{name}.yaml").write_text(RECIPE.replace("METHOD", method))
            assert status_of([str(folder / f"{name}.yaml"), "-o", str(folder / f"{name}.h5"), "--quiet"]) == 0
        (folder / "bare.yaml").write_text(RECIPE[:RECIPE.index("discrete")])
        assert status_of([str(folder / "bare.yaml"), "-o", str(folder / "bare.h5"), "--quiet"]) == 0
    return folder


@pytest.fixture
def place(assets, tmp_path):
    for name in ("drops.h5", "hashed.h5", "bare.h5"):
        (tmp_path / name).symlink_to(assets / name)
    (tmp_path / "s.yaml").write_text(SCENE)
    (tmp_path / "lamp.xml").write_text(XML)
    return tmp_path


def test_report_and_layers(call, place):
    report, found = rendered(call, place, "a", "materials[0].method=auto", "tolerance=20%")
    assert report["renderer"] == "discrete" and report["method"] == "particles+continuous" and report["size"] == [80, 64]
    assert report["files"] == [str(place / "a.png"), str(place / "a.exr")] and report["particles"] == 200
    assert report["samples"] == 2 and report["stopped_by"] == "samples" and report["passes"] == {"walk": 2, "splat": 2}
    assert 0 < report["noise"] < 10 and len(report["optical_depth"]) == 2 and 0 < report["optical_depth"][0] < 3
    assert 0 < report["as_particles"] <= 1 and any("forward" in said for said in report["reasons"])
    assert {"scene", "preparation", "passes", "write", "total"} <= report["seconds"].keys()
    orders = [picture(found, f"{name}.") for name in ("order0", "order1", "order2", "orders")]
    lights = [picture(found, f"light.{name}.") for name in ("panel", "spot")]
    whole = picture(found)
    assert np.allclose(sum(orders), whole, rtol=1e-5, atol=1e-6) and np.allclose(sum(lights), whole, rtol=1e-5, atol=1e-6)
    assert all(one.any() for one in (*orders[:2], *lights)) and np.isfinite(whole).all() and (whole >= 0).all()
    assert found["detail"].max() > 0 and (found["noise.Y"] >= 0).all()
    assert np.allclose(report["mean"], whole.mean(axis=(0, 1)), rtol=1e-5)


@pytest.mark.parametrize("method", ["continuous", slow("query"), slow("explicit")])
def test_other_methods(call, place, method):
    """Without particles that are told apart there are no depths; light that particles do not scatter is the same in all."""
    wide = ["materials[0].footprint=100"] * (method == "query")  # spheres that hold a particle now and then
    report, found = rendered(call, place, method, f"materials[0].method={method}", *wide)
    assert report["method"] == method and report["passes"] == {"paths" if method == "continuous" else "walk": 2}
    assert np.isfinite(picture(found)).all() and picture(found, "order0.").any() and picture(found, "order1.").any()
    assert ("detail" in found) == (method == "continuous")
    said = {"continuous": "forward", "query": "cylinders of 100 pixels", "explicit": "without diffraction"}[method]
    assert any(said in reason for reason in report["reasons"])


@pytest.mark.slow
def test_a_lone_particle_in_a_white_sky(call, place):
    """Lossless, in light of 0.5: 0.5, as the medium around it is that of the others, of which there are none (one picture in
    70,000 is farther off by chance)."""
    text = RECIPE.replace("name: drops", "name: lone", 1).replace("material: water", "material: {n: 1.33, k: 0}")
    text = text.replace("4e14", "1e15").replace("count: 200, box: [80 um, 80 um, 80 um]", "count: 1, box: [10 um, 10 um, 10 um]")
    (place / "lone.yaml").write_text(text.replace("METHOD", "method: stored"))
    assert call("bake", place / "lone.yaml", "-o", place / "lone.h5")[0] == 0
    (place / "lamp.xml").write_text('<scene version="3.0.0"><emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>'
                                    "</scene>")
    report, _ = rendered(call, place, "a", "materials[0].asset=lone.h5", "materials[0].method=auto", "materials[0].peak=keep",
                         "film={width: 16, height: 16}", "stop={samples: 100, noise: 0.01%}",
                         "camera={origin: [5, -24, 5] um, target: [5, 5, 5] um, fov: 22 deg}")
    assert report["noise_mean"] < 0.02 and abs(report["mean"][1] / 0.5 - 1) < 4.4 * report["noise_mean"]


def test_procedural_in_a_box_of_the_scene(call, place):
    """Twice the box at the same density, somewhere else."""
    box = "materials[0].where={box: {lo: [0, 0, 0] um, hi: [80, 80, 160] um}}"
    report, found = rendered(call, place, "twice", "materials[0].asset=hashed.h5", box)
    assert report["particles"] == pytest.approx(400) and picture(found, "order1.").any()
    away = "materials[0].where={box: {lo: [500, 0, 0] um, hi: [580, 80, 80] um}}"
    report, found = rendered(call, place, "away", away, "film={width: 8, height: 6}")
    # out of sight: hardly a path finds it by way of the floor
    assert report["particles"] == 200 and picture(found, "order1.").sum() < 0.02 * picture(found, "order0.").sum()


@pytest.mark.slow
def test_particles_fall(call, place):
    still = picture(rendered(call, place, "still")[1], "order1.")
    falling = "materials[0].velocity=[0, 0, -1] mm/s"
    moved = picture(rendered(call, place, "moved", falling, "materials[0].time=4 ms")[1], "order1.")
    assert not np.allclose(still, moved) and 0.3 < moved.sum() / still.sum() < 3
    # once through the box
    again = picture(rendered(call, place, "again", falling, "materials[0].time=80 ms")[1], "order1.")
    assert np.mean(np.abs(again - still)) < 0.1 * still.mean()


@pytest.mark.slow
def test_the_same_bytes_for_any_number_of_threads(call, place, monkeypatch):
    """Of the kernels: one thread or three; Mitsuba's rays do not see each other."""
    from renderers import threads

    made = []
    for workers in (1, 3):
        with ThreadPoolExecutor(workers) as pool, monkeypatch.context() as patch:
            patch.setattr(threads, "_pool", lambda: pool)
            rendered(call, place, "a", options=("--seed", "5"))
            made.append([(place / f"a.{kind}").read_bytes() for kind in ("exr", "png")])
    assert made[0] == made[1]
    before = picture(layers(place / "a.exr"))
    _, other = rendered(call, place, "a", options=("--seed", "6"))
    assert not np.array_equal(picture(other), before)


@pytest.mark.slow
def test_resuming_is_going_on(call, place):
    small = "film={width: 40, height: 32}"
    _, whole = rendered(call, place, "whole", "stop.samples=4", small)
    rendered(call, place, "parts", small)
    report, found = rendered(call, place, "parts", "stop.samples=4", small, options=("--resume",))
    assert report["samples"] == 4 and report["passes"] == {"walk": 4, "splat": 4}
    assert found.keys() == whole.keys()
    for name in found:
        scale = np.abs(whole[name][np.isfinite(whole[name])]).max(initial=0)
        assert np.allclose(found[name], whole[name], rtol=1e-4, atol=1e-5 * scale), name


def test_no_resuming_of_something_else(call, place):
    small = ("--set", "film={width: 8, height: 6}")
    rendered(call, place, "a", options=small)
    shown = ("display.exposure=2", "name=other", "description=other")  # how the picture is shown, no other picture
    rendered(call, place, "a", *shown, options=("--resume", *small))
    for setting, said in (("materials[0].method=continuous", "other parts, scene"),
                          ("materials[0].asset=hashed.h5", "other asset, scene")):
        status, _, err = call("render", place / "s.yaml", "-o", place / "a.png", "--resume", *small, "--set", setting)
        assert status == 2 and said in err, err


@pytest.mark.slow
def test_baked_from_its_recipe(call, assets, place):
    (place / "drops.yaml").write_text((assets / "drops.yaml").read_text().replace("name: drops\nw", "name: own\nw"))
    scene = SCENE.replace("80, height: 64", "8, height: 6")
    (place / "s.yaml").write_text(scene.replace("asset: drops.h5", "recipe: drops.yaml"))
    report, _ = rendered(call, place, "own")
    assert not (place / "own.h5").exists()
    (place / "own.h5").write_bytes(Path(report["asset"]).read_bytes())
    (place / "s.yaml").write_text(scene.replace("asset: drops.h5", "asset: own.h5"))
    _, given = rendered(call, place, "given")
    assert np.array_equal(picture(given), picture(layers(place / "own.exr")))


@pytest.mark.parametrize(("settings", "said"), [
    (["materials[0].asset=bare.h5"], "give its recipe a section `discrete`"),
    (["materials[0].method=fog"], 'found "fog"; expected auto, particles, particles+continuous, continuous, query or explicit'),
    (["materials[0].metod=auto"], "materials[0].metod"),
    (["materials[0].footprint=1"], "which method particles does not use"),
    (["materials[0].method=explicit", "materials[0].peak=keep"], "found peak, which method explicit does not use"),
    ([HASHED, "materials[0].where={box: {lo: [0, 0, 0] um, hi: [1, 1, 1] m}}", "materials[0].method=query",
      "film={width: 4, height: 4}", "camera.origin=[40, -1500, 40] um"], "particles, and 3,600 are possible; "),
    (["materials[0].peak=5 um"], "materials[0].peak"),
    (["materials[0].peak=200 deg"], "an angle from 0 to 180 deg"),
    (["materials[0].peak=-5 deg"], "an angle from 0 to 180 deg"),
    (["materials[0].velocity=3 m/s"], "materials[0].velocity"),
    (["materials[0].time=3 um"], "materials[0].time"),
    (["materials[0].where={box: {lo: [0, 0, 0] um, hi: [80, 80, 90] um}}"], "its places are stored"),
    (["materials[0].where={box: {lo: [0, 0, 0] um, hi: [80, 80, 0] um}}"], "found a box without volume"),
    (["materials[0].where={sphere: 3}"], "materials[0].where"),
    (["materials[0].where={mesh: gone.ply}"], "gone.ply"),
    ([HASHED, "materials[0].where={mesh: hole.obj, unit: 1 um}"], "materials[0].where.mesh: not closed: face"),
    ([HASHED, "materials[0].where={grid: zero.npy, lo: [0, 0, 0] um, hi: [9, 9, 9] um}"], "densities that are 0"),
    ([HASHED, "materials[0].where={grid: ones.npy}"], "expected lo and hi"),
    (["materials[0].where={mesh: whole.obj}"], "the asset's places are stored"),
    (["camera=null"], "camera"),
])
def test_what_will_not_do(call, place, settings, said):
    """One message, status 2, nothing written."""
    vertices, faces = icosphere(80)
    for name, kept in (("whole", faces), ("hole", faces[1:])):
        lines = [f"v {x} {y} {z}" for x, y, z in 30 * vertices] + [f"f {a} {b} {c}" for a, b, c in kept + 1]
        (place / f"{name}.obj").write_text("\n".join(lines))
    np.save(place / "zero.npy", np.zeros((2, 2, 2)))
    np.save(place / "ones.npy", np.ones((2, 2, 2)))
    before = sorted(path.name for path in place.iterdir())
    status, out, err = call("render", place / "s.yaml", *(part for setting in settings for part in ("--set", setting)))
    assert status == 2 and said in err and "Traceback" not in err and not out, err
    assert sorted(path.name for path in place.iterdir()) == before


def test_particles_in_a_mesh_and_in_a_grid_of_the_scene(call, place):
    vertices, faces = icosphere(80)
    lines = [f"v {x} {y} {z}" for x, y, z in 40 * vertices + 40] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    (place / "ball.obj").write_text("\n".join(lines))
    np.save(place / "cloud.npy", np.random.default_rng(1).random((3, 4, 5)))
    for where in ("{mesh: ball.obj, unit: 1 um}", "{grid: cloud.npy, lo: [0, 0, 0] um, hi: [80, 80, 80] um}"):
        _, found = rendered(call, place, "in", HASHED, f"materials[0].where={where}", "film={width: 16, height: 12}")
        assert picture(found, "order1.").any() and np.isfinite(picture(found)).all()
