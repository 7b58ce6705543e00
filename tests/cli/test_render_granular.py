"""`bake render SCENE.yaml` of grains as a user calls it: report, layers, resuming, a recipe that is baked, and ways to fail."""

import numpy as np
import pytest

from bakery.cli import status_of
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from renderers.mitsuba import variants
from renderers.mitsuba.world import World
from tests.conftest import slow
from tests.renders import picture, refused, rendered

RECIPE = """\
bakery: 1
name: beads
wavelengths: rgb
tolerance: 20%
grains:
  radius: 1 mm
  components:
    - {name: clear, weight: 40%, shape: {type: sphere}, surface: {type: dielectric, material: {n: 1.5}}}
    - {name: matt, weight: 60%, shape: {type: sphere}, surface: {type: diffuse, reflectance: [0.9, 0.5, 0.3]}}
packing: {fraction: 0.5, count: 30}
effective_medium: {sigma_t: mean_flight}
"""
SCENE = """\
bakery_scene: 2
name: heap
scene: {mitsuba: lamp.xml, unit: 1 mm}
camera: {origin: [0, -30, 8] mm, target: [0, 0, 0] mm, fov: 30 deg}
film: {width: 40, height: 32}
stop: {samples: 2}
materials:
  - {where: {mesh: heap.ply, unit: 1 mm}, asset: beads.h5, method: ept}
"""
XML = """<scene version="3.0.0"><shape type="rectangle" id="floor"><transform name="to_world"><scale value="30"/>
<translate z="-5"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.4 0.3"/></bsdf></shape>
<shape type="rectangle" id="panel"><transform name="to_world"><scale value="10"/><rotate x="1" angle="180"/>
<translate x="8" y="-6" z="20"/></transform><emitter type="area"><rgb name="radiance" value="3 3 3"/></emitter></shape></scene>"""

NOTHING = RECIPE.split("    - {name")[0] + """\
    - {name: air, shape: {type: sphere}, surface: {type: dielectric, material: {n: 1}}}
packing: {fraction: 0.5, count: 30}
"""
WHITE = """<scene version="3.0.0"><emitter type="constant"><rgb name="radiance" value="1 1 1"/></emitter></scene>"""


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("assets")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        (folder / "beads.yaml").write_text(RECIPE)
        assert status_of([str(folder / "beads.yaml"), "-o", str(folder / "beads.h5"), "--quiet"]) == 0
        assert status_of([str(folder / "beads.yaml"), "-o", str(folder / "bare.h5"), "--stage", "grains", "--quiet"]) == 0
        (folder / "nothing.yaml").write_text(NOTHING)
        assert status_of([str(folder / "nothing.yaml"), "-o", str(folder / "nothing.h5"), "--quiet"]) == 0
    return folder


@pytest.fixture
def place(asset, tmp_path):
    for name in ("beads.h5", "bare.h5", "nothing.h5"):
        (tmp_path / name).symlink_to(asset / name)
    vertices, faces = icosphere(80)
    (tmp_path / "heap.ply").write_bytes(ply.mesh(6 * vertices, faces))
    (tmp_path / "open.ply").write_bytes(ply.mesh(6 * vertices, faces[:-1]))
    (tmp_path / "s.yaml").write_text(SCENE)
    (tmp_path / "lamp.xml").write_text(XML)
    return tmp_path


def test_a_camera_among_grains_is_told_before_and_after(call, place):
    settings = "--set", "camera.origin=[0, -5, 0] mm", "--set", "film={width: 4, height: 4}", "--set", "materials[0].method=vpt"
    status, _, told = call("render", place / "s.yaml", "-o", place / "a.png", *settings)
    before, _, after = told.partition("pictures: ")
    sentence = "s.yaml:8: materials[0].where.mesh: the camera is in the grains of materials[0]: heap.ply is 1.2 cm across"
    assert status == 0 and "warning: " in before and before.count(sentence) == after.count(sentence) == 1


def test_report_and_layers(call, place):
    report, found = rendered(call, place, "a")
    assert report["renderer"] == "granular" and report["method"] == "ept" and report["size"] == [40, 32]
    assert report["materials"] == [{"kind": "grains", "method": "ept", "bias": report["bias"], "reasons": report["reasons"],
                                    "pilot": None}]
    assert report["passes"] == {"ept": 2} and report["grains"] == pytest.approx(0.5 * 6**3 * 0.95, rel=0.1)
    assert {"scene", "preparation", "passes", "write", "total"} <= report["seconds"].keys()
    orders = [picture(found, f"{name}.") for name in ("order0", "order1", "order2", "orders")]
    whole = picture(found)
    assert np.allclose(sum(orders), whole, rtol=1e-5, atol=1e-6) and all(one.any() for one in orders)
    assert np.allclose(picture(found, "light.panel."), whole, rtol=1e-5, atol=1e-6)
    assert np.isfinite(whole).all() and (whole >= 0).all() and (found["noise.Y"] >= 0).all()


def test_the_medium(call, place):
    report, found = rendered(call, place, "a", "materials[0].method=vpt")
    assert report["method"] == "vpt" and report["passes"] == {"vpt": 2} and picture(found, "order1.").any()
    assert any("no grain" in said for said in report["reasons"]) and any("opaque" in said for said in report["reasons"])


def test_what_a_graphics_card_cannot_render_the_processor_does(call, place, monkeypatch):
    """The medium in its mesh, where no variant is asked for; the report says so."""
    card, of = [True], World.of

    def on(scene, variant=None):
        card[0] = variant is None
        return of(scene, variant)

    monkeypatch.setattr(World, "of", staticmethod(on))
    monkeypatch.setattr(variants, "on_gpu", lambda variant: card[0])
    report, found = rendered(call, place, "a", "materials[0].method=vpt")
    assert any(sentence.startswith("rendered on the processor: a graphics card") for sentence in report["reasons"])
    assert report["passes"] == {"vpt": 2} and picture(found, "order1.").any()


def test_grains_and_medium(call, place):
    """Each technique's part, that make up the picture, and how many grains paths met before they switched."""
    report, found = rendered(call, place, "a", "materials[0].method=ept+vpt")
    assert report["method"] == "ept+vpt" and report["passes"] == {"grains": 2, "medium": 2}
    parts = [picture(found, f"{name}.") for name in ("ept", "vpt")]
    assert np.allclose(sum(parts), picture(found), rtol=1e-5, atol=1e-6) and parts[0].any() and parts[1].any()
    depth = found["switch"]
    assert depth.max() >= 1 and np.all(depth[picture(found, "vpt.").sum(axis=-1) > 0] > 0)
    assert report["bias"] is None and any("how far ept+vpt is off is not measured" in said for said in report["reasons"])
    assert any("of opaque grains it leaves more light out" in said for said in report["reasons"])


@pytest.mark.slow
def test_auto_of_opaque_grains_is_explicit(call, place):
    """The same picture as that of `ept`, without pilots where the picture is small, and the report says why."""
    report, found = rendered(call, place, "a", "materials[0].method=auto")
    assert report["method"] == "ept" and report["bias"] is None and "switch" not in found
    assert any("auto is ept here" in said and "pilots" in said for said in report["reasons"])
    assert np.array_equal(picture(found), picture(rendered(call, place, "b")[1]))


@pytest.mark.parametrize("method", ["auto", slow("ept"), slow("vpt"), slow("ept+vpt"), slow("ept+vpt+da"), slow("teleport")])
def test_grains_of_the_host_s_index_are_not_seen(call, place, method):
    """They turn no light and absorb none: a white world is 1 (a false alarm once in 1e7, seeds are fixed)."""
    (place / "lamp.xml").write_text(WHITE)
    report, found = rendered(call, place, "a", "materials[0].asset=nothing.h5", f"materials[0].method={method}")
    light = picture(found).mean(axis=-1)
    # light before and after the switch has paths of its own: a pixel at the edge of a body may have both, or none
    error = light.std() / np.sqrt(light.size) if "+" in method or method == "auto" else 1e-6
    assert abs(light.mean() - 1) < 5.4 * error + 1e-6 and error < 0.01 and report["grains"] > 40
    assert picture(found, "order1.").any() or method == "vpt"


@pytest.mark.slow
def test_several_bodies(call, place):
    """Two meshes of grains with assets of their own, of which the scene need name none."""
    vertices, faces = icosphere(80)
    for name, x in (("left", -6), ("right", 6)):
        (place / f"{name}.ply").write_bytes(ply.mesh(5 * vertices + [x, 0, 0], faces))
    text = SCENE[:SCENE.index("  - ")] + "".join(f"  - {{where: {{mesh: {name}.ply, unit: 1 mm}}, asset: beads.h5}}\n"
                                                 for name in ("left", "right"))
    (place / "s.yaml").write_text(text)
    for method in ("ept", "ept+vpt+da"):
        report, found = rendered(call, place, f"{len(method)}", f"method={method}")
        first = picture(found, "order1.").sum(axis=-1)
        assert report["grains"] == pytest.approx(2 * 0.5 * 5**3 * 0.95, rel=0.1) and first[:, :16].any() and first[:, 24:].any()
    right = "right.ply, unit: 1 mm}, asset: beads.h5"
    for change, said in [((right, right.replace("beads", "gone")), 'materials[1].asset: found "gone.h5"'),
                         (("mesh: right.ply", "mesh: open.ply"), "materials[1].where.mesh: not closed"),
                         ((right, right.replace(", asset: beads.h5", "")), "materials[1].asset: missing"),
                         (("mesh: right.ply", "mesh: heap.ply"), "materials[1].where.mesh: reaches 0.00"),
                         (("mesh: right.ply", "mash: right.ply"), "materials[1].where: found keys with values; expected every")]:
        assert change[0] in text
        (place / "s.yaml").write_text(text.replace(*change))
        status, out, err = call("render", place / "s.yaml", "-o", place / "x.png")
        assert status and not out and said in err and "Traceback" not in err, err


BOX = "lo: [-7, -7, -7] mm, hi: [7, 7, 7] mm"


@pytest.mark.slow
def test_fraction_and_mixture(call, place):
    """A grid of the tile's own fraction changes nothing; one with an empty half shows grains in the other alone, of the component
    that the mixture says is there; the same in the medium, where lights are seen through what is loose."""
    def gridded(name, values, key="fraction", box=BOX):
        np.save(place / f"{name}.npy", values)
        return f"materials[0].{key}={{grid: {name}.npy, {box}}}"

    plain = rendered(call, place, "a")[1]
    same = rendered(call, place, "b", gridded("whole", np.full((2, 1, 3), 0.5)))[1]
    assert all(np.array_equal(plain[name], same[name]) for name in plain)
    half, clear = gridded("half", np.repeat([0.5, 0.0], 7).reshape(14, 1, 1)), np.ones((1, 1, 1))
    for method in ("ept", "vpt"):
        of_clear, by = gridded("clear", clear, "mixture.clear"), f"materials[0].method={method}"
        report, found = rendered(call, place, method, half, of_clear, by)
        assert report["grains"] == pytest.approx(0.25 * 6**3 * 0.95, rel=0.2)
        behind = picture(found, "order0.")[12:20]  # the floor
        assert behind[:, 12:18].mean() < 0.2 * behind[:, 24:28].mean()
        clear_one = picture(found, "order1.")[12:20, 12:18].mean(axis=(0, 1))
    report, found = rendered(call, place, "c", half, "materials[0].method=ept+vpt+da", gridded("matt", clear, "mixture.matt"))
    matt_one = picture(found, "order1.")[12:20, 12:18].mean(axis=(0, 1))
    assert matt_one[2] < 0.6 * matt_one[0] and clear_one[2] > 0.7 * clear_one[0] and "da.R" not in found
    assert any("no light diffuses" in said for said in report["reasons"])
    for setting, said in [
        (gridded("dense", np.array([[[0.2, 0.6]]])), "found the fraction 0.6 at [0, 0, 1], [0, 0, 0.0035] m; at most 0.5"),
        (gridded("small", clear, box="lo: [0, 0, 0] mm, hi: [7, 7, 7] mm"), "but the mesh reaches from [-0.006"),
        (gridded("flat", clear, box="lo: [0, 0, 0] mm, hi: [7, 7, 0] mm"), "found a box without volume"),
        (gridded("less", -clear), "found the density -1 at [0, 0, 0]"), (gridded("nan", np.nan * clear), "found the density nan"),
        (gridded("salt", clear, "mixture.salt"), "mixture.salt: the asset has no such component; clear, matt would do"),
        ("materials[0].fraction={grid: gone.npy, lo: [0, 0, 0] m, hi: [1, 1, 1] m}", "there is no such file"),
        ("materials[0].mixture={clear: {grid: gone.npy}}", "mixture.clear.grid: found \"gone.npy\""),
        (gridded("units", clear, box="lo: [0, 0, 0], hi: [7, 7, 7]"), "unit"),
        ("materials[0].fraction={grid: clear.npy}", "found no box in the file; expected lo and hi"),
        (f"materials[0].fraction={{grid: clear.npy, dataset: rho, {BOX}}}", "found a dataset of a file that has none"),
        ('materials[0].mixture={"a[b.c]": {grid: clear.npy, ' + BOX + "}}", "the asset has no such component"),
        ("materials[0].mixture={}", "at least 1"), ("materials[0].mixture=salt", "materials[0].mixture"),
    ]:
        refused(call, place, said, setting)


def test_a_medium_of_components_is_that_of_all(place):
    """With the asset's own weights in a mixture: the extinction, albedo and phase function that were baked."""
    import bakery
    from bakery import kernels
    from renderers.materials.grains import local, material

    asset, (vertices, faces) = bakery.open(place / "beads.h5"), icosphere(80)
    same = kernels.field([-1] * 3, [1] * 3, np.array([0.4, 1.0]).reshape(1, 1, 1, 2))
    alike, *_ = material.medium_of(asset, material.grains_of(asset, 0.006 * vertices, faces))
    parts, varied, _ = material.medium_of(asset, material.grains_of(asset, 0.006 * vertices, faces, local.Local(None, same)))
    found = np.empty((2, 3))
    kernels.extinctions_at(varied, 0.5, 0.0, 0.0, found)
    scattered = found * parts.albedo.reshape(2, 3)
    assert np.allclose(found.sum(axis=0), alike.sigma_t, rtol=1e-3) and np.all(found.max(axis=0) < varied.most)
    assert np.allclose(scattered.sum(axis=0), alike.albedo * alike.sigma_t, rtol=1e-3)
    phase = np.einsum("cw,cwa->wa", scattered / scattered.sum(axis=0), parts.phase.reshape(2, 3, -1))
    assert np.allclose(phase, alike.phase, atol=0.01 * alike.phase.max())


@pytest.mark.slow
@pytest.mark.parametrize("method", ["ept", "ept+vpt+da", "auto"])
def test_going_on_is_as_not_having_stopped(call, place, method):
    method = f"materials[0].method={method}"
    straight = picture(rendered(call, place, "a", method, "stop={samples: 4, noise: 0.01%}")[1])
    first = picture(rendered(call, place, "b", method)[1])
    resumed = rendered(call, place, "b", method, "stop={samples: 4, noise: 0.01%}", options=("--resume",))[1]
    assert np.allclose(picture(resumed), straight, rtol=1e-5, atol=1e-6)
    assert not np.array_equal(picture(rendered(call, place, "c", method, options=("--seed", "1"))[1]), first)


@pytest.mark.slow
def test_a_mesh_smaller_than_its_only_grain(call, place):
    """It is there, or it is not, with nothing wrong in either case."""
    vertices, faces = icosphere(20)
    (place / "heap.ply").write_bytes(ply.mesh(0.1 * vertices, faces))
    report, found = rendered(call, place, "a")
    assert report["grains"] < 0.01 and not picture(found, "order1.").any() and picture(found, "order0.").any()


@pytest.mark.parametrize("setting, said", [
    ("materials[0].where.mesh=open.ply", "materials[0].where.mesh: not closed: face 76 alone has the edge of the vertices"),
    ("materials[0].where.mesh=lamp.xml", "materials[0].where.mesh: meshes are"),
    ("materials[0].where.mesh=gone.ply", "there is no such file"),
    ("materials[0].method=magic", "expected auto, ept, vpt"),
    ("film.wavelengths=rgb", "found a key that granular does not use"),
    ("materials[0].asset=bare.h5", "no stage 'packing'"),
])
def test_what_is_refused(call, place, setting, said):
    refused(call, place, said, setting)


# ---- the integrator of Mitsuba

SENSOR = """<sensor type="perspective"><float name="fov" value="30"/><transform name="to_world"><lookat origin="0, -30, 8"
target="0, 0, 0" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="40"/>
<integer name="height" value="32"/></film></sensor>"""
INTEGRATOR = """<integrator type="bakery_granular"><string name="asset" value="beads.h5"/><string name="method" value="ept"/>
<float name="unit" value="0.001"/><shape type="ply"><string name="filename" value="half.ply"/>
<transform name="to_world"><scale value="2"/></transform></shape></integrator>"""


def mitsuba_scene(place, integrator=INTEGRATOR):
    vertices, faces = icosphere(80)
    (place / "half.ply").write_bytes(ply.mesh(3 * vertices, faces, single=True))
    (place / "heap.ply").write_bytes(ply.mesh(6 * vertices, faces, single=True))
    (place / "plugin.xml").write_text(XML.replace("</scene>", f"{SENSOR}{integrator}</scene>"))
    return place / "plugin.xml"


@pytest.mark.slow
def test_the_integrator_makes_the_same_picture(call, place):
    """With the scene in YAML and its seed: the film's, what `mi.render` gives, and another sensor's that is asked for."""
    import renderers.materials.grains.plugin  # noqa: F401
    import mitsuba as mi  # isort: skip

    path = mitsuba_scene(place)
    (place / "lamp.xml").write_text(XML.replace("</scene>", f"{SENSOR}</scene>"))
    (place / "s.yaml").write_text("\n".join(line for line in SCENE.splitlines() if not line.startswith("camera")) + "\n")
    report, layers = rendered(call, place, "a", options=("--seed", "3"))
    expected = picture(layers)
    mi.set_variant("llvm_ad_rgb")
    scene = mi.load_file(str(path))
    found = np.array(mi.render(scene, spp=report["samples"], seed=3))
    assert np.array_equal(found, expected.astype(np.float32))
    assert np.array_equal(np.array(scene.sensors()[0].film().bitmap())[..., :3], found)
    other = np.array(mi.render(scene, spp=2, seed=4))
    assert not np.array_equal(other, found) and other.mean() == pytest.approx(found.mean(), rel=0.2)


@pytest.mark.parametrize("old, new, said", [
    ('<string name="asset" value="beads.h5"/>', "", 'no asset; <string name="asset"'),
    ("beads.h5", "bare.h5", "no stage 'packing'"),
    ("beads.h5", "gone.h5", "gone.h5: there is no such file"),
    ('"ept"', '"magic"', 'method: found "magic", expected auto, ept'),
    ('"0.001"', '"-1"', "unit: found -1"),
    ("half.ply", "open.ply", "not closed: face 76 alone has the edge"),
    ('type="ply"><string name="filename" value="half.ply"/>', 'type="sphere">', "Sphere is no mesh; ply, obj or cube would do"),
    ("<shape", "<!--", "no shape to fill"),
])
def test_what_the_integrator_refuses(call, place, old, new, said):
    integrator = INTEGRATOR.replace(old, new).replace("/shape>", "-->" if new == "<!--" else "/shape>")
    refused(call, place, said, source=mitsuba_scene(place, integrator).name)


def test_the_integrator_needs_arrays(call, place):
    status, _, err = call("render", mitsuba_scene(place), "-o", place / "x.png", "--variant", "scalar_rgb")
    assert status and "variant scalar_rgb; expected one that works on arrays of colours" in err


def test_what_the_camera_sees_of_grains(place, monkeypatch):
    """Their normals: a radius against them lies the middle of a sphere, the same for all pixels of it; and where grains show."""
    from renderers.materials.grains import features, material, methods
    from renderers.pictures.running import Render

    job = Render(place / "s.yaml", place / "a.png")
    world = World.of(job.scene)
    meshes = material.meshes_of(job.scene)
    grains = [material.grains_of(job.assets[0], *meshes[0])]
    how, _ = methods.transport_of("ept", world, job.assets, meshes, grains)
    seen = features.with_radius(how.interactor(0, how.technique).seen, how.bodies[0].radius)
    body, normal, distance, radius = features._at(world, [seen], np.array([0.5, 0.5]))
    met = body >= 0
    assert np.array_equal(radius, np.where(met, how.bodies[0].radius, 0))
    towards = world.camera.rays(*world.size)
    middle = world.camera.origin + np.where(met, distance, 0)[..., None] * towards - how.bodies[0].radius * normal
    aggregate, unit = grains[0].aggregate, grains[0].unit
    apart = middle[met][:, None] / unit - aggregate.centers
    apart -= aggregate.cell * np.round(apart / aggregate.cell)
    off = np.linalg.norm(apart, axis=2).min(axis=1)
    assert met.mean() > 0.2 and off.max() < 1e-5, "as positions of a camera are single precision"
    assert (np.einsum("ijk,ijk->ij", normal, towards)[met] < 0).all() and not normal[~met].any()
    found = features.first_hits(world, how, job.assets, meshes, 0)
    assert (found.detail[met] > 0).all() and (found.detail <= 1).all() and not found.detail[0].any()
    assert np.allclose(found.albedo[0], [0.5, 0.4, 0.3], atol=1e-5) or np.isinf(found.distance[0]).any()
    assert np.isfinite(found.albedo).all() and (abs(found.normal) <= 1 + 1e-6).all()
    monkeypatch.setattr(variants, "on_gpu", lambda variant: True)
    without_medium = features.first_hits(world, how, job.assets, meshes, 0)
    assert np.array_equal(without_medium.grain, found.grain) and np.isfinite(without_medium.albedo).all()


def test_a_draft_looks_for_the_first_grains_once(place, monkeypatch):
    """For layer depth.Z and for the filter; a final picture's filter looks at other places in the pixels."""
    from renderers.choice import Opened
    from renderers.materials.grains import paths
    from renderers.pictures.running import Render

    job = Render(place / "s.yaml", place / "a.png")
    world, looks, look = World.of(job.scene), [], paths.seen_grain
    monkeypatch.setattr(paths, "seen_grain", lambda *rays: looks.append(len(rays[1])) or look(*rays))
    method = job.scene.prepare(Opened.of(job.scene), world, 0)
    depth, pixels = world.depth(method.entry), world.size[0] * world.size[1]
    drawn = method.features("draft")
    assert looks == [pixels]
    along = np.linalg.norm(world.camera.points(*world.size), axis=-1)
    assert np.allclose((depth * along)[drawn.grain > 0], drawn.distance[drawn.grain > 0], rtol=1e-12) and (drawn.grain > 0).any()
    method.features("final")
    assert looks == [pixels] * 5
