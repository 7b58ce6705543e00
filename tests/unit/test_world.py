"""Surfaces and lights as arrays, against Mitsuba's own path tracer: a path tracer of a few lines walks on them."""

import gc

import numpy as np
import pytest

from bakery.errors import UsageError
from renderers.mitsuba import lights
from renderers.mitsuba.shading import FAR, met
from renderers.mitsuba.world import World
from tests.conftest import ROOT, slow
from tests.renders import undisturbed_by_scenes

DEPTH = 5  # surfaces

SENSOR = """
  <integrator type="path"><integer name="max_depth" value="5"/><integer name="rr_depth" value="100"/></integrator>
  <sensor type="perspective"><float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="0.2, -3.6, 0.1" target="0, 0, 0" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="9"/><integer name="height" value="6"/><rfilter type="box"/></film>
  </sensor>"""
# a box that is open towards the camera, all kinds of surfaces in it
BOX = """
  <bsdf type="twosided" id="white"><bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.6 0.5"/></bsdf></bsdf>
  <shape type="rectangle" id="floor"><transform name="to_world"><translate z="-1"/></transform><ref id="white"/></shape>
  <shape type="rectangle" id="back"><transform name="to_world"><rotate x="1" angle="90"/><translate y="1"/></transform>
    <bsdf type="twosided"><bsdf type="roughconductor"><float name="alpha" value="0.3"/></bsdf></bsdf></shape>
  <shape type="rectangle" id="left"><transform name="to_world"><rotate y="1" angle="90"/><translate x="-1"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.8 0.1 0.1"/></bsdf></bsdf></shape>
  <shape type="sphere" id="ball"><float name="radius" value="0.4"/><point name="center" x="0.4" y="-0.2" z="-0.6"/>
    <bsdf type="dielectric"/></shape>
  <shape type="rectangle" id="veil"><transform name="to_world"><scale value="0.5"/><rotate x="1" angle="90"/>
    <translate x="-0.5" y="-0.5"/></transform><bsdf type="null"/></shape>"""
LAMP = """<shape type="rectangle" id="lamp"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="180"/>
    <translate z="0.98"/></transform><emitter type="area"><rgb name="radiance" value="4 5 6"/></emitter></shape>"""
LIGHTS = {
    "area": LAMP,
    "without extent": """
        <emitter type="point" id="bulb"><point name="position" x="0.3" y="-0.5" z="0.7"/><rgb name="intensity" value="1 0.7 0.5"/>
        </emitter>
        <emitter type="spot" id="spot"><transform name="to_world"><lookat origin="0, -1, 1" target="0, 0.2, -1" up="0, 1, 0"/>
        </transform><rgb name="intensity" value="9 9 9"/><float name="cutoff_angle" value="30"/></emitter>
        <emitter type="directional" id="sun"><vector name="direction" x="-0.1" y="0.9" z="-0.5"/>
        <rgb name="irradiance" value="1 2 3"/></emitter>""",
    "picture": LAMP.replace('<rgb name="radiance" value="4 5 6"/>', """<texture type="bitmap" name="radiance">
        <string name="filename" value="lamp.exr"/><boolean name="raw" value="true"/></texture>"""),
    "sky": """<emitter type="envmap" id="sky"><string name="filename" value="sky.exr"/></emitter>""",
    "many": LAMP + """
        <emitter type="point"><point name="position" x="0" y="-0.5" z="0.5"/><rgb name="intensity" value="0.3"/></emitter>
        <emitter type="point"><point name="position" x="0.5" y="-0.5" z="0.5"/><rgb name="intensity" value="0.3"/></emitter>
        <emitter type="constant"><rgb name="radiance" value="0.1 0.2 0.3"/></emitter>""",
}


def written(folder, *parts):
    path = folder / "scene.xml"
    path.write_text('<scene version="3.0.0">' + "".join(parts) + "</scene>")
    return path


def walked(world, samples, generator, depth=DEPTH):
    """One picture, (H, W, 3), of paths that meet up to `depth` surfaces or lights."""
    height, width = world.size
    pixel = np.tile(np.stack(np.mgrid[:height, :width], axis=-1).reshape(-1, 2), (samples, 1))
    origin, direction = world.camera_rays(generator.random((len(pixel), 2)), pixel)
    weight, radiance = np.ones((len(pixel), 3)), np.zeros((len(pixel), 3))
    density, delta = np.zeros(len(pixel)), np.ones(len(pixel), bool)
    for surface in range(depth):
        shading = world.shade(origin, direction, generator.random((len(pixel), 5)), density, delta)
        radiance += weight * shading.emitted
        if surface < depth - 1:
            radiance += weight * shading.light.radiance
        weight = weight * shading.weight
        origin, direction, density, delta = shading.origin, shading.direction, shading.density, shading.delta
    return radiance.reshape(samples, height, width, 3).mean(axis=0)


def estimated(pictures):
    """Mean and standard error of passes, in blocks of 3 x 3 pixels."""
    blocks = np.array(pictures).reshape(len(pictures), 2, 3, 3, 3, 3).mean(axis=(2, 4))
    return blocks.mean(axis=0), blocks.std(axis=0, ddof=1) / len(blocks) ** 0.5


@pytest.mark.parametrize("lights", [lights if lights == "many" else slow(lights) for lights in LIGHTS])
def test_pictures_are_those_of_mitsuba(tmp_path, lights):
    """In 5 standard errors of 16 passes each: 18 numbers of 30 degrees of freedom, false alarm in 1 of 2,000 runs."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    sky = np.random.default_rng(5).random((4, 8, 3)) ** 4
    mi.Bitmap(sky.astype(np.float32)).write(str(tmp_path / "sky.exr"))
    mi.Bitmap(9 * np.sqrt(sky).astype(np.float32)).write(str(tmp_path / "lamp.exr"))
    path = written(tmp_path, SENSOR, BOX, LIGHTS[lights])
    world = World(path, unit=0.01)
    generator = np.random.default_rng(1)
    ours, our_error = estimated([walked(world, 128, generator) for _ in range(16)])
    scene = mi.load_file(str(path))
    theirs, their_error = estimated([np.array(mi.render(scene, spp=128, seed=seed))[..., :3] for seed in range(16)])
    assert np.median(our_error / ours) < 0.02 and ours.min() > 0.003
    assert np.all(np.abs(ours - theirs) < 5 * np.hypot(our_error, their_error))


def test_white_things_under_a_white_sky_are_white(tmp_path):
    """A diffuse ball, a mirror and a pane of glass of albedo 1; in 6 standard errors (18 numbers, 7 degrees of
    freedom) and the paths that are cut off, false alarm in 1 of 100 runs were the seed not fixed."""
    path = written(tmp_path, SENSOR, """<emitter type="constant"/>
        <shape type="sphere"><float name="radius" value="0.5"/>
            <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>
        <shape type="sphere"><float name="radius" value="0.4"/><point name="center" x="1" y="0" z="0"/>
            <bsdf type="dielectric"/></shape>
        <shape type="rectangle">
            <transform name="to_world"><rotate x="1" angle="90"/><scale value="4"/><translate y="2"/></transform>
            <bsdf type="twosided"><bsdf type="conductor"><string name="material" value="none"/></bsdf></bsdf></shape>""")
    world, generator = World(path), np.random.default_rng(2)
    pictures = [walked(world, 64, generator, depth=12) for _ in range(8)]
    mean, error = estimated(pictures)
    assert np.abs(np.mean(pictures) - 1).max() < 0.003
    assert np.all(np.abs(mean - 1) < 6 * error + 1e-4)


def test_rays_and_lights_in_metres(tmp_path):
    """A lamp of 0.8 x 0.8 units at height 0.98, a floor of 2 x 2 at -1; a unit is 1 cm."""
    world = World(written(tmp_path, SENSOR, BOX, LIGHTS["many"]), unit=0.01)
    assert sorted(world.light_names) == ["ConstantBackgroundEmitter", "PointLight", "PointLight2", "lamp"]
    assert np.allclose(world.box, [[-0.01] * 3, [0.01] * 3])
    # from below the lamp down to the floor, and out of the box
    origin = np.array([[-0.005, 0.005, 0.0], [-0.005, 0.005, 0.0], [0.0, -0.008, 0.0]])
    direction = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
    assert np.allclose(world.trace(origin, direction, np.array([1.0, 0.009, 1.0])), [0.01, np.inf, np.inf])
    assert np.allclose(world.trace(origin, direction, np.inf), [0.01, 0.01, np.inf])

    light = world.lights(np.tile([0.0, 0.0, -0.0099], (4000, 1)), np.random.default_rng(0).random((4000, 3)))
    for name, distance in (("PointLight", 0.01 * np.hypot(0.5, 1.49)), ("ConstantBackgroundEmitter", FAR)):
        assert np.allclose(light.distance[light.light == world.light_names.index(name)], distance)
    lamp = light.light == world.light_names.index("lamp")
    assert np.ptp(light.distance[lamp]) > 0 and abs(light.distance[lamp] * light.direction[lamp, 2] - 0.0197).max() < 1e-6
    assert not light.delta[lamp].any() and light.delta[light.light == world.light_names.index("PointLight")].all()
    # chosen among four lights, 16 / 25 units^2 at distance d, seen at an angle of cosine z / d
    clear = lamp & (light.radiance[:, 0] > 0)
    density = (100 * light.distance[clear]) ** 2 / light.direction[clear, 2] / 0.64 / 4
    assert np.allclose(light.density[clear], density, rtol=1e-4)
    assert np.allclose(light.radiance[clear] * light.density[clear, None], [4, 5, 6], rtol=1e-4)
    assert 0.7 < clear.sum() / lamp.sum() < 1  # the veil hides the rest


def test_a_world_without_anything_is_dark():
    world = World()
    origin, direction = np.zeros((3, 3)), np.eye(3)
    assert world.box is None and world.light_names == () and world.camera is None
    assert np.all(np.isinf(world.trace(origin, direction, 1.0)))
    assert not world.lights(origin, np.full((3, 2), 0.5)).radiance.any()
    shading = world.shade(origin, direction, np.full((3, 5), 0.5), np.ones(3), np.zeros(3, bool))
    assert not shading.hit.any() and not shading.emitted.any() and not shading.weight.any() and np.all(shading.source == -1)


@pytest.mark.parametrize("count", [0, 1, 7])
@pytest.mark.parametrize("lights", [LAMP, ""])
def test_wavefronts_of_hardly_any_ray(tmp_path, count, lights):
    """Every array has a row a ray, also where it is the same for all."""
    world, some = World(written(tmp_path, SENSOR, BOX, lights)), np.zeros((count, 3), np.float32)
    down, random = some - np.array([0, 0, 1]), np.full((count, 5), 0.3)
    assert np.array_equal(world.trace(some, down, 2.0), np.ones(count))
    shading = world.shade(some, down, random, np.ones(count), np.zeros(count, bool))
    for light in (world.lights(some, random), shading.light):
        assert [field.shape for field in light] == [(count, 3), (count,), (count, 3), (count,), (count,), (count,)]
        assert light.share(np.ones(count)).shape == (count,)
    for name, field in shading._asdict().items():
        wide = name in ("point", "emitted", "origin", "direction", "weight")
        assert name == "light" or field.shape == ((count, 3) if wide else (count,))


def kernels_of_lengths(world):
    """Hashes of the kernels that wavefronts of some lengths take."""
    import drjit as dr

    compiled = []
    for count in (100, 100, 101, 3000, 7, 1):
        random = np.random.default_rng(count).random((count, 5))
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
            dr.kernel_history_clear()
            down = np.tile([0.0, 0.0, -1.0], (count, 1))
            world.trace(random[:, :3], down, 1.0)
            world.lights(random[:, :3], random)
            drawn = random[:, 2:] if count < 100 else None
            world.shade(random[:, :3], down, random, np.ones(count), np.zeros(count, bool), drawn)
            compiled.append([kernel["hash"] for kernel in dr.kernel_history([dr.KernelType.JIT])])
    return compiled


def test_a_kernel_serves_wavefronts_of_all_lengths(tmp_path):
    """Neither length nor NumPy's alignment of the memory may be part of it, nor whether directions were drawn elsewhere:
    compiling takes longer than most wavefronts."""
    first, *others = undisturbed_by_scenes(kernels_of_lengths, World(written(tmp_path, SENSOR, BOX, LIGHTS["many"])))
    assert len(first) == 3 and all(hashes == first for hashes in others)


def test_shapes_are_numbered_in_the_order_of_the_file():
    """Dr.Jit's kernels hold their numbers, which several threads that load them would give out by chance."""
    import drjit as dr
    import mitsuba as mi

    loaded = World(ROOT / "assets" / "scenes" / "snow_at_night.xml").scene
    numbers = np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(loaded.shapes())), int)
    assert len(numbers) > 5 and np.all(np.diff(numbers) > 0)


@pytest.mark.parametrize("parts", [(BOX, LIGHTS["many"]), slow((BOX,)), (LIGHTS["without extent"],)])
def test_what_is_the_same_for_all_rays_is_done_once_and_changes_nothing(tmp_path, parts):
    """To the bit, for wavefronts of any length, also those as long as an array of the scene; a constant has the length of its.
    There is another scene all the while, with surfaces and lights that this one may lack."""
    (tmp_path / "other").mkdir()
    beside, world = World(written(tmp_path / "other", SENSOR, BOX, LAMP)), World(written(tmp_path, SENSOR, *parts))
    plain = World(world.scene)
    plain.__dict__["_meets"] = met
    for count in (50, 3, 1, 700, 8, 12, 50):
        random = np.random.default_rng(count).random((count, 5))
        rays = random[:, :3], np.tile([0.0, 0.0, -1.0], (count, 1)), random, np.ones(count), random[:, 3] < 0.5
        for drawn in (None, random[:, :3] + 1):
            ours, theirs = (one.shade(*rays, drawn) for one in (world, plain))
            for field, other in zip((*ours[:5], *ours.light, *ours[6:]), (*theirs[:5], *theirs.light, *theirs[6:]), strict=True):
                assert field.dtype == other.dtype and np.array_equal(field, other, equal_nan=field.dtype.kind == "f")
    assert beside.light_names


def test_surfaces_of_other_kinds_in_another_scene_change_nothing(tmp_path):
    """What is done once for all rays of a scene knows of all surfaces that there are."""
    metal = BOX + '<bsdf type="roughconductor" id="of no shape"><string name="material" value="Au"/></bsdf>'
    random = np.random.default_rng(3).random((64, 5))
    rays = random[:, :3], np.tile([0.0, 0.0, -1.0], (64, 1)), random, np.ones(64), random[:, 3] < 0.5
    alone = World(written(tmp_path, SENSOR, BOX, LAMP)).shade(*rays)
    (tmp_path / "other").mkdir()
    beside = World(written(tmp_path / "other", SENSOR, metal, LAMP))
    again = World(written(tmp_path, SENSOR, BOX, LAMP)).shade(*rays)
    assert beside.shade(*rays).hit.any() and all(np.array_equal(*fields) for fields in zip(alone[:4], again[:4]))


def test_nothing_is_collected_while_rays_are_recorded(tmp_path):
    """A scene that Python's collector took away meanwhile would end the process."""
    world, collects = World(written(tmp_path, SENSOR, BOX, LAMP)), []
    meets = world._meets
    world.__dict__["_meets"] = lambda *rays: collects.append(gc.isenabled()) or meets(*rays)
    world.shade(np.zeros((2, 3)), np.eye(2, 3), np.full((2, 5), 0.5), np.ones(2), np.ones(2, bool))
    assert collects == [False] and gc.isenabled()


def test_numbers_next_to_one(tmp_path):
    """Samplers take numbers below 1, and 1 - 1e-12 is 1 in single precision."""
    world = World(written(tmp_path, SENSOR, BOX, LAMP))
    light = world.lights(np.zeros((2, 3)), np.full((2, 2), 1 - 1e-12))
    assert np.isfinite(light.radiance).all() and light.radiance.any()


def test_the_camera_of_the_file_or_of_the_scene(tmp_path):
    """A film of another size keeps width and middle of the view; YAML's camera needs no sensor in the file."""
    path = written(tmp_path, SENSOR)
    usual, other = World(path, unit=2.0), World(path, unit=2.0, size=(12, 18))
    assert usual.size == (6, 9) and np.allclose(usual.camera.origin, [0.4, -7.2, 0.2])
    assert np.allclose(other.camera.rays(12, 18)[::11, ::17], doubled(path).camera.rays(12, 18)[::11, ::17])
    view = {"origin": (0.4, -7.2, 0.2), "target": (0, 0, 0), "up": (0, 0, 1), "fov": np.radians(50)}
    bare = World(written(tmp_path, LAMP), unit=2.0, view=view, size=(6, 9))
    origin, direction = bare.camera_rays(np.full((54, 2), 0.5), np.stack(np.mgrid[:6, :9], axis=-1).reshape(-1, 2))
    assert np.allclose(direction.reshape(6, 9, 3), usual.camera.rays(6, 9), atol=1e-6)
    assert np.allclose(origin, usual.camera.origin)


def test_a_loaded_scene_and_one_of_its_sensors(tmp_path):
    """The second sensor's film shows a part of the first one's."""
    from renderers.mitsuba.scene import load

    part = '<integer name="width" value="9"/>' + "".join(f'<integer name="crop_{name}" value="{value}"/>' for name, value in
                                                         (("offset_x", 4), ("offset_y", 1), ("width", 5), ("height", 3)))
    sensor = SENSOR[SENSOR.index("<sensor"):]
    scene = load(written(tmp_path, SENSOR, sensor.replace('<integer name="width" value="9"/>', part)))[0]
    whole, cropped = World(scene, unit=2.0), World(scene, unit=2.0, sensor=scene.sensors()[1])
    assert whole.size == (6, 9) and cropped.size == (3, 5)
    assert np.allclose(cropped.camera.rays(3, 5), whole.camera.rays(6, 9)[1:4, 4:], atol=1e-6)


def doubled(path):
    text = path.read_text().replace('value="9"', 'value="18"').replace('value="6"', 'value="12"')
    path.write_text(text)
    return World(path, unit=2.0)


@pytest.mark.parametrize("text, message", [
    ('<sensor type="orthographic"/>', "first sensor is of the kind OrthographicCamera; expected a perspective camera"),
    ('<sensor type="radiancemeter"><film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/>'
     '</film></sensor>', "first sensor is of the kind RadianceMeter; expected a perspective camera"),
    ("", "the scene has no sensor"),
])
def test_views_that_are_refused(tmp_path, text, message):
    with pytest.raises(UsageError, match=message):
        World(written(tmp_path, text))


SHAPED = '<shape type="{}" id="lamp">{}<emitter type="area"><rgb name="radiance" value="{}"/></emitter></shape>'
FLAT = '<transform name="to_world"><scale value="0"/></transform>'
SCALED = '<transform name="to_world"><scale value="3"/><rotate x="1" angle="70"/></transform>'
SKY = '<emitter type="envmap" id="sky"><string name="filename" value="{}.exr"/></emitter>'


@pytest.mark.parametrize("light, said", [
    (SHAPED.format("rectangle", "", "nan"), "light lamp: radiance is nan nan nan; expected finite numbers"),
    (SHAPED.format("rectangle", "", "1 inf 1"), "light lamp: radiance is 1 inf 1; expected finite numbers"),
    (SHAPED.format("cube", "", "1 -1 1"), "light lamp: radiance is 1 -1 1; expected 0 and above"),
    (SHAPED.format("rectangle", FLAT, "1"), "light lamp: its shape has an area of 0; expected a shape of some size"),
    (SHAPED.format("cube", FLAT, "1"), "light lamp: its shape has an area of 0"),
    (SHAPED.format("disk", FLAT.replace("0", "nan"), "1"), "light lamp: its shape has an area of nan"),
    (SHAPED.format("sphere", '<float name="radius" value="0"/>', "1"), "light lamp: its shape has an area of 0"),
    ('<emitter type="point"><rgb name="intensity" value="-1"/></emitter>', "light PointLight: intensity is -1 -1 -1; expected"),
    ('<emitter type="point"><point name="position" value="nan, 0, 0"/></emitter>', "position is nan 0 0; expected finite"),
    ('<emitter type="spot" id="s"><float name="cutoff_angle" value="0"/></emitter>', "light s: cutoff_angle is 0; expected an"),
    ('<emitter type="directional"><rgb name="irradiance" value="nan"/></emitter>', "DirectionalEmitter: irradiance is nan nan"),
    ('<emitter type="directional"><vector name="direction" x="0" y="0" z="0"/></emitter>', "to_world is nan in 9 of 16 places"),
    ('<emitter type="constant"><rgb name="radiance" value="1 1 -0.1"/></emitter>', "BackgroundEmitter: radiance is 1 1 -0.1"),
    (SKY.format("below"), "light sky: data is -1 in 3 of 120 places; expected 0 and above"),
    (SKY.format("none"), "light sky: data is nan in 1 of 120 places; expected finite numbers"),
    (SKY.replace("</emitter>", '<float name="scale" value="-1"/></emitter>').format("even"), "light sky: scale is -1; expected"),
    (SKY.replace("</emitter>", f"{SCALED}</emitter>").format("even"), "light sky: its to_world scales"),
    (f'<emitter type="directional">{SCALED}</emitter>', "light DirectionalEmitter: its to_world scales"),
    (SKY.format("gone"), "Mitsuba cannot load this scene: .*gone.exr"),
])
def test_lights_that_are_refused(tmp_path, light, said):
    """Mitsuba renders them black, but for the last ones (by a scale of 3 a sun is 3 times as bright); a light with nothing wrong
    beside them is not named."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    sky = np.ones((3, 4, 8, 3), np.float32)
    sky[0, 1, 2], sky[1, 2, 1, 0] = -1, np.nan
    for name, pixels in zip(("below", "none", "even"), sky):
        mi.Bitmap(pixels).write(str(tmp_path / f"{name}.exr"))
    with pytest.raises(UsageError, match=said) as refused:
        World(written(tmp_path, SENSOR, light, SHAPED.format("rectangle", "", "1").replace("lamp", "good")))
    assert "good" not in str(refused.value)


def test_a_sky_that_is_turned_mirrored_and_rounded_is_no_fault(tmp_path):
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mi.Bitmap(np.ones((4, 8, 3), np.float32)).write(str(tmp_path / "even.exr"))
    turned = '<transform name="to_world"><scale x="-1"/>' \
        '<matrix value="1 0 0 0  0 .707 -.707 0  0 .707 .707 2  0 0 0 1"/></transform></emitter>'
    World(written(tmp_path, SENSOR, SKY.replace("</emitter>", turned).format("even")), unit=1e-3)


def test_what_shines(tmp_path):
    """No light, and lights that are 0 everywhere: nothing does."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    for name, level in (("black", 0.0), ("even", 1.0)):
        mi.Bitmap(np.full((4, 8, 3), level, np.float32)).write(str(tmp_path / f"{name}.exr"))
    lights = {"": True, SHAPED.format("rectangle", "", "0"): True, SHAPED.format("rectangle", "", "0 0 1"): False,
              SKY.format("black"): True, SKY.format("even"): False,
              '<emitter type="point"><rgb name="intensity" value="0"/></emitter>': True, '<emitter type="spot"/>': False}
    assert [World(written(tmp_path, SENSOR, light)).dark for light in lights] == list(lights.values())


def test_variants_that_are_refused():
    with pytest.raises(UsageError, match="variant scalar_rgb: .* such as llvm_ad_rgb"):
        World(variant="scalar_rgb")


def test_where_surfaces_are(tmp_path):
    """Meshes by their triangles, other shapes by their boxes, in m; a world without any has none."""
    cube = '<shape type="cube"><transform name="to_world"><scale value="2"/></transform></shape>'
    ball = '<shape type="sphere"><point name="center" x="1" y="2" z="3"/><float name="radius" value="0.5"/></shape>'
    world = World(written(tmp_path, SENSOR, cube, ball), unit=0.1)
    triangles, boxes = world.extents()
    assert triangles.shape == (12, 3, 3) and np.allclose(np.abs(triangles), 0.2)
    assert np.allclose(boxes, [[[0.05, 0.15, 0.25], [0.15, 0.25, 0.35]]])
    assert [len(one) for one in World().extents()] == [0, 0]


def test_a_sphere_around_a_box_is_not_in_it(tmp_path):
    """A sky that is a sphere: neither surface nor lamp stands in what it is around; in a box that it passes through both do."""
    sky = ('<shape type="sphere" id="sky"><point name="center" x="1" y="2" z="3"/><float name="radius" value="5"/>'
           '<emitter type="area"/></shape>')
    world, middle = World(written(tmp_path, SENSOR, sky)), np.array([1.0, 2.0, 3.0])
    for half, passes in ((2.8, False), (2.9, True), (6.0, True)):  # its corners are at 4.85, 5.02 and 10.4
        box = np.array([middle - half, middle + half])
        assert (len(world.extents(within=box)[1]) == 1) == passes
        assert (len(world.lights_in([box])) == 1) == passes
    assert len(world.lights_in([box, np.array([middle - 1, middle + 1])])) == 1
    assert world.lights_in([np.array([middle + 20, middle + 21])]) == []


BULB = '<emitter type="point" id="bulb"><point name="position" x="0" y="0" z="0"/></emitter>'
CUBES = "".join(f'<shape type="cube" id="{name}"><transform name="to_world"><scale value="{size}"/></transform>'
                '<bsdf type="null"/></shape>' for name, size in (("veil", 0.5), ("body", 0.7)))


def test_shapes_that_are_nothing_hide_no_lamp(tmp_path):
    """A bulb in two cubes without a boundary: those that no material fills are taken out, and all where nobody says which."""
    path, outside = written(tmp_path, SENSOR, CUBES, BULB, LAMP), np.full((64, 3), 0.6)
    numbers = np.random.default_rng(1).random((64, 2))
    worlds = [World(path, filled=filled) for filled in ({"body"}, {None}, None)]
    names = [[shape.name for shape in world.shapes()] for world in worlds]
    assert names == [["body", "lamp"], ["lamp"], ["veil", "body", "lamp"]]
    assert all(set(world.light_names) == {"bulb", "lamp"} and world.size == (6, 9) for world in worlds)
    bright = [world.lights(outside, numbers) for world in worlds[1:]]
    assert [bool(np.any(sample.radiance[sample.delta] > 0)) for sample in bright] == [True, False]


@pytest.mark.parametrize("surfaces", ["", '<shape type="sphere"/>'], ids=["alone", "within"])
def test_a_bulb_in_the_middle_of_all_surfaces(tmp_path, surfaces):
    """From there it has no direction: its place was nan, and paths in fog everywhere around it never ended."""
    bulb = '<emitter type="point"><rgb name="intensity" value="1"/></emitter>'
    (light,) = World(written(tmp_path, SENSOR, surfaces, bulb)).ideal_lights()
    assert np.array_equal(light.place, np.zeros(3)) and not light.distant


def test_what_light_samples_do_not_get_through_is_named(tmp_path):
    """By their ids, also in groups of instances, which keep what is nothing; not where all lamps have an extent."""
    shapes = CUBES + """<shape type="rectangle" id="leaf"><bsdf type="mask"><float name="opacity" value="0.5"/>
        <bsdf type="diffuse"/></bsdf></shape><shape type="instance"><ref id="group"/></shape>
        <shape type="shapegroup" id="group"><shape type="sphere" id="pane"><bsdf type="dielectric"/></shape></shape>
        <shape type="sphere" id="coated"><bsdf type="plastic"/></shape>"""
    mirrors, straight = World(written(tmp_path, SENSOR, shapes, BULB), filled={"body"}).left_out({"body"})
    assert "glass (coated, pane) is left out" in mirrors and "null (veil, leaf) is left out" in straight
    assert World(written(tmp_path, SENSOR, shapes, LAMP)).left_out() == []
    beam = '<shape type="disk" id="beam"><emitter type="directionalarea"/></shape>'
    unseen = '<emitter type="point" id="unseen"><float name="sampling_weight" value="0"/></emitter>'
    (unmet,) = World(written(tmp_path, SENSOR, beam, unseen, BULB)).left_out()
    assert "(beam, unseen) is left out" in unmet


@pytest.mark.parametrize("unit, place, scale", [(1000, (0, 0, 0), 0.001), (1, (2000, 0, 0), 1)], ids=["in km", "far away"])
def test_shadows_lost_to_single_precision_are_named(tmp_path, unit, place, scale):
    """Of a ball of 1 m from 3.6 m away: rays begin 9 or 18 cm beside it; not in units of 1 m near the origin."""
    def scene(unit, place, scale):
        view = ("{}, {}, {}".format(*(x + y for x, y in zip(place, (0, -3.6 * scale, 0)))), "{}, {}, {}".format(*place))
        sensor = SENSOR.replace("0.2, -3.6, 0.1", view[0]).replace('target="0, 0, 0', f'target="{view[1]}')
        ball = f"""<shape type="sphere"><transform name="to_world"><scale value="{scale}"/>
            <translate value="{view[1]}"/></transform></shape>"""
        return World(written(tmp_path, sensor, ball), unit).left_out()

    assert scene(1, (0, 0, 0), 1) == []
    (told,) = scene(unit, place, scale)
    assert f"some {0.09 if unit > 1 else 0.18} m beside surfaces" in told and "what is seen is 2." in told


def test_a_lamp_that_shows_a_picture(tmp_path):
    """Rays that meet its left and right half, and a matt ball that it lights: a recording took no samples of such lamps."""
    import mitsuba as mi

    picture = np.repeat(np.array([[[1, 2, 3], [7, 5, 4]]], np.float32), 8, axis=1)
    mi.Bitmap(picture).write(str(tmp_path / "lamp.exr"))
    ball = '<shape type="sphere"><float name="radius" value="0.3"/></shape>'
    world = World(written(tmp_path, SENSOR, ball, LIGHTS["picture"]))
    origin, direction = np.array([[-0.2, 0, 0.5], [0.2, 0, 0.5], [0, 0, 0.5]]), np.array([[0, 0, 1], [0, 0, 1], [0, 0, -1.0]])
    shading = world.shade(origin, direction, np.full((3, 5), 0.5), np.zeros(3), np.ones(3, bool))
    assert np.allclose(shading.emitted, [picture[0, 4], picture[0, 12], np.zeros(3)], rtol=0.01)
    assert np.all(shading.light.radiance[2] > 0)


@pytest.mark.parametrize("weight, drawn", [("", (0.917 + 0.125) / 1.25), ('<float name="sampling_weight" value="3"/>', 0.75)])
def test_lights_are_drawn_by_what_they_bring(tmp_path, weight, drawn):
    """A bulb that brings 0.917 of the light, and a sky; what they bring stays the same.  Weights of the file stay, too.  With so
    many samples the shares are off by 0.006: no false alarm, as the numbers are always the same."""
    (tmp_path / "scene.xml").write_text(f'''<scene version="3.0.0"><sensor type="perspective"/>
        <shape type="sphere"><point name="center" x="0" y="0" z="9"/><float name="radius" value="0.1"/>
        <emitter type="area"><rgb name="radiance" value="90000"/>{weight}</emitter></shape>
        <emitter type="constant"><rgb name="radiance" value="0.25"/></emitter></scene>''')
    world, point, random = World(tmp_path / "scene.xml"), np.zeros((4000, 3)), np.random.default_rng(0).random((4000, 2))

    def brought():
        sample = world.lights(point, random)
        return np.mean(sample.light == 0), np.bincount(sample.light, sample.radiance[:, 0]) / len(point)

    _, before = brought()
    lights.favour(world, point[:3])
    share, after = brought()
    assert share == pytest.approx(drawn, abs=0.02) and after == pytest.approx(before, rel=0.08)
    assert before[0] / before.sum() == pytest.approx(0.917, abs=0.01)
