"""Paths of the loop of Dr.Jit: against the compiled walk, a white world, closed forms, and themselves.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import gc
from types import SimpleNamespace

import numpy as np
import pytest

from bakery.physics.medium import phase
from bakery.physics.shapes.radial import icosphere
from renderers import colour
from renderers.choice import trial
from renderers.materials.bodies import methods
from renderers.materials.bodies.bodies import rounded, rounding
from renderers.materials.bodies.declaration import FEW
from renderers.mitsuba import variants
from renderers.mitsuba.world import World
from renderers.pictures.engine import ORDERS
from renderers.transport import boundaries, loop, scene, steps, wavefront
from renderers.transport.media import Media, scattered
from renderers.transport.paths import Colours, Paths
from renderers.transport.scattering import of_asset
from renderers.transport.scene import Scene
from tests.conftest import slow
from tests.odds import ODDS, sigmas
from tests.physics import test_translucent as bodies
from tests.physics.particles import blocks, same
from tests.physics.test_translucent import BALL, FLOOR, PANEL, SKY
from tests.renders import undisturbed_by_scenes

import drjit as dr  # isort: skip  behind renderers.mitsuba, which finds LLVM
import mitsuba as mi  # isort: skip

SIDES = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
                  [1, 5, 7], [1, 7, 3]])
POINT = """<emitter type="point"><point name="position" x="6" y="-6" z="9"/><rgb name="intensity" value="300 300 300"/>
</emitter>"""


def asset(albedo, g, free_path=(1.0, 1.0, 1.0), wavelength=(0.65, 0.55, 0.45)):
    """A medium by Henyey and Greenstein, as an asset holds it: figures of each wavelength."""
    theta = np.concatenate([[0.0], np.geomspace(1e-3, np.pi, 300)])
    g = np.broadcast_to(np.asarray(g, float), len(wavelength))[:, None]
    table = (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * np.cos(theta)) ** 1.5)
    table /= np.array([phase.phase_integral(theta, row) for row in table])[:, None]
    medium = {"phase": table}
    medium = type("Medium", (dict,), {})(medium)
    medium.sigma_t, medium.theta = 1 / np.broadcast_to(np.asarray(free_path, float), len(wavelength)), theta
    medium.albedo = np.broadcast_to(np.asarray(albedo, float), len(wavelength)).copy()
    return SimpleNamespace(medium=medium, stages=("medium",), wavelength=np.array(wavelength))


def box(low, high):
    return np.array(low) + SIDES * (np.array(high) - np.array(low)), FACES


def transport(folder, meshes, around, indices, size=16, origin="0, -19, 5"):
    """How light goes in bodies, pairs of mesh and asset by name."""
    sensor = bodies.SENSOR.replace("SIZE", str(size)).replace("ORIGIN", origin)
    shapes = "".join(bodies.shape(folder, name, mesh, bodies.BOUNDARIES[index])
                     for (name, (mesh, _)), index in zip(meshes.items(), indices))
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{sensor}{shapes}{around}</scene>')
    return methods.transport_of(World(folder / "scene.xml"), list(meshes), [medium for _, medium in meshes.values()],
                                [None] * len(meshes), lambda number, key, message: ValueError(f"{number} {key}: {message}"),
                                "paths")


def passes(how, numbers, layer="", seed=0):
    assert methods.in_one_loop(how)
    (part,) = methods.parts(how, "paths", "negative", seed)
    return np.array([part.render(number)[layer] for number in numbers])


def walked(how, monkeypatch, method="paths"):
    """Passes of paths by the compiled walk, which follows them where the loop cannot."""
    with monkeypatch.context() as patch:
        patch.setattr(methods, "in_one_loop", lambda how: False)
        return methods.parts(how, method, "negative", 1)[0]


@pytest.fixture
def matched(tmp_path):
    return transport(tmp_path, {"ball": (BALL, asset([0.9, 0.8, 0.5], 0.3, (1.0, 0.8, 0.6)))}, PANEL + FLOOR, [1.0])


@pytest.mark.slow
def test_pilots_share_what_does_not_depend_on_the_film(tmp_path, monkeypatch):
    """The picture behind a pilot has the light samples that were prepared for that, and is the same as without one."""
    prepared, measure = [], scene.samples
    monkeypatch.setattr(scene, "samples", lambda *arguments: prepared.append(arguments) or measure(*arguments))
    meshes = {"ball": (BALL, asset(0.9, 0.3))}
    how = transport(tmp_path, meshes, PANEL + FLOOR, [1.4])
    small = trial.smaller(how.world, 64)
    pilot = passes(how._replace(world=small), [0])
    picture = passes(how, [0])
    assert len(prepared) == 1 and pilot.shape[1:3] == (8, 8) and picture.shape[1:3] == (16, 16)
    assert np.array_equal(picture, passes(transport(tmp_path, meshes, PANEL + FLOOR, [1.4]), [0])) and len(prepared) == 2


def test_passes_depend_on_their_number_and_the_seed_alone(matched):
    first, again = passes(matched, [0, 1]), passes(matched, [1, 0])
    assert np.array_equal(first, again[::-1]) and not np.array_equal(first[0], first[1])
    assert not np.array_equal(first[0], passes(matched, [0], seed=1)[0])
    threads = dr.thread_count()
    try:
        dr.set_thread_count(1)
        assert np.array_equal(passes(matched, [0])[0], first[0])
    finally:
        dr.set_thread_count(threads)


def kernels_of_passes(ball):
    """Hashes of the kernels of three passes, of two seeds."""
    compiled = []
    for number, seed in ((0, 0), (1, 3), (2, 3)):
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            passes(ball, [number], seed=seed)
            kernels = dr.kernel_history([dr.KernelType.JIT])
        compiled.append([kernel["hash"] for kernel in kernels if kernel["size"] > 200])
    return compiled


def test_one_kernel_serves_all_passes_and_seeds(matched):
    first, *later = undisturbed_by_scenes(kernels_of_passes, matched)
    assert len(first) == 1 and all(hashes == first for hashes in later), "a launch a pass"


def kernels_of_scenes(folder):
    """Hashes of the kernels, from the file to the picture, of a glassy ball under a lamp, and whether they go by where NumPy's
    memory begins; of scenes in which numbers differ, also those of triangles.  That of the camera holds the size of the film."""
    compiled, coarse = [], (icosphere(80)[0] * 5, icosphere(80)[1])
    of_scenes = [(BALL, 0.9, 16, "0, -19, 5"), (coarse, [0.5, 0.8, 0.9], 24, "3, -15, 8")]
    for number, (mesh, albedo, size, origin) in enumerate(of_scenes):
        gc.collect()  # the scene before
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            (here := folder / f"{number}").mkdir(exist_ok=True)
            how = transport(here, {"ball": (mesh, asset(albedo, 0.5 - number))}, PANEL + FLOOR, [1.4], size, origin)
            passes(how, [number], seed=number)
            del how
            kernels = dr.kernel_history([dr.KernelType.JIT])
        compiled.append({(kernel["hash"], ", align 1," in kernel["ir"].getvalue()) for kernel in kernels if kernel["size"] > 4})
    return compiled


def test_scenes_in_which_only_numbers_differ_have_the_same_kernels(tmp_path):
    first, second = undisturbed_by_scenes(kernels_of_scenes, tmp_path)
    assert len(first) > 5 and first == second and not any(by_chance for _, by_chance in first)


@pytest.mark.parametrize("index", [slow(1.0), 1.4])
def test_a_white_world(tmp_path, index):
    """Albedo 1 in light from everywhere is 1, whatever the wavelengths and their free paths."""
    white = asset(1.0, 0.5, (0.9, 0.7, 1.1, 2.0, 0.8), (0.45, 0.5, 0.55, 0.6, 0.65))
    how = transport(tmp_path, {"ball": (BALL, white)}, SKY, [index], size=8)
    rows = passes(how, range(8)).mean(axis=(2, 3)).ravel()  # of which half at least see the ball
    error = rows.std(ddof=1) / rows.size**0.5
    assert error < 0.005 and abs(rows.mean() - 1) < sigmas(rows.size / 2) * error


def test_scattering_follows_the_phase_functions():
    """Of what is drawn, weighted as paths are, the mean cosine at each wavelength."""
    variants.activate("rgb")
    g = np.array([-0.3, 0.6, 0.9])

    media = Media([of_asset(asset(0.5, 0.0)), of_asset(asset([0.9, 0.5, 0.7], g))], 1.0)
    random = mi.PCG32(1 << 18)
    way, _, weight = scattered(media, mi.UInt32(1), mi.Vector3f(0, 0.6, 0.8), [mi.Float(1.0), mi.Float(0.5), mi.Float(0.25)],
                               [random.next_float32() for _ in range(3)])
    cosine = np.array(0.6 * way.y + 0.8 * way.z, float)
    for found, start, albedo, mean in zip(weight, (1.0, 0.5, 0.25), (0.9, 0.5, 0.7), g):
        weights = np.array(found, float) / (start * albedo)
        for values, wanted in ((weights, 1.0), (weights * cosine, mean)):
            assert abs(values.mean() - wanted) < 6 * values.std() / len(values) ** 0.5 + 1e-4


def test_a_floor_is_lit_through_a_matched_body(tmp_path):
    """By a point, past which no path comes: what the body leaves of it, exp(-sigma_t d), order 0."""
    dark = asset(0.0, 0.0, (4.0, 4.0, 4.0))
    lamp = POINT.replace('x="6" y="-6" z="9"', 'x="0" y="0" z="40"')
    meshes = {"slab": (box((-60, -60, 10), (60, 60, 14)), dark)}
    view = "0, -4, 6"
    shaded = passes(transport(tmp_path, meshes, FLOOR + lamp, [1.0], origin=view), range(2)).mean()
    none = {"slab": (box((-60, -60, 200), (60, 60, 204)), dark)}
    free = passes(transport(tmp_path, none, FLOOR + lamp, [1.0], origin=view), range(2)).mean()
    assert np.exp(-1.1) < shaded / free < np.exp(-0.99)


def test_what_the_loop_leaves_to_the_walk(tmp_path):
    glass = transport(tmp_path, {"ball": (BALL, asset(0.9, 0.0))}, POINT, [1.4])
    rough = transport(tmp_path, {"ball": (BALL, asset(0.9, 0.0))}, POINT, [1.5])
    assert not methods.in_one_loop(glass) and methods.in_one_loop(rough)


@pytest.mark.parametrize("method, orders", [("vrl+tables", 3), slow("vrl", 2), slow("dipole", 2)])
def test_light_of_few_events_is_that_of_paths(tmp_path, method, orders):
    """Order by order, in a body that light enters once, and none of more: the rest is for beams and tables."""
    how = transport(tmp_path, {"ball": (BALL, asset([0.9, 0.8, 0.5], 0.3, (1.0, 0.8, 0.6)))}, SKY + PANEL, [1.0], size=8)
    (few, *_), (paths,) = methods.parts(how, method, "negative", 1), methods.parts(how, "paths", "negative", 0)
    assert few.name == FEW and few.samples == paths.samples
    ours, theirs = ([part.render(number) for number in range(12)] for part in (few, paths))
    for layer in ORDERS[:orders]:
        assert same(*(blocks(np.array([layers[layer] for layers in images]), (2, 2)) for images in (ours, theirs))) > ODDS, layer
    for layers in ours:
        assert not any(layers[layer].any() for layer in ORDERS[orders:])
        assert np.allclose(layers[""], sum(layers[layer] for layer in ORDERS), rtol=1e-6, atol=1e-12)


WARM, COOL = asset([0.9, 0.8, 0.5], 0.0, (1.0, 0.8, 0.6)), asset([0.99, 0.5, 0.9], 0.3, (0.4, 2.0, 1.0))


def test_paths_go_on_where_balls_touch_at_the_origin(tmp_path):
    """An offset by the coordinates of the point alone is less than the rounding of the triangles there: a path never ended."""
    left, right = ((0.8 * BALL[0] + [x, 0, 0], BALL[1]) for x in (-4, 4))
    how = transport(tmp_path, {"left": (left, WARM), "right": (right, COOL)}, SKY, [1.0, 1.0])
    met = Scene(how.world, how.bodies, how.colours)
    random = np.random.default_rng(0)
    origin = np.array([[0.0], [-1.0], [0.0]]) + 10.0 ** random.uniform(-12, -4, 20_000) * random.normal(size=(3, 20_000))
    ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(0, 1, 0))
    active = dr.full(mi.Bool, True, 20_000)
    for _ in range(40):
        surface = met.scene.ray_intersect(ray, mi.RayFlags.Minimal, False, active)
        active &= surface.is_valid() & met.boundaries.is_blind(surface.shape)
        ray.o = dr.select(active, met.boundaries.across(surface, ray.d), ray.o)
        dr.eval(ray, active)  # one kernel for all steps
    assert not dr.any(active)


@pytest.mark.slow
@pytest.mark.parametrize("meshes, around, indices, origin", [
    ({"ball": (BALL, WARM)}, PANEL + FLOOR, [1.0], "0, -19, 5"),
    ({"ball": (BALL, asset([0.99, 0.95, 0.3], 0.9, (1.0, 0.5, 0.3)))}, SKY + PANEL, [1.0], "0, -19, 5"),
    ({"ball": (BALL, asset([0.9, 0.6, 0.3], -0.3))}, POINT, [1.0], "0, -19, 5"),
    ({"ball": (BALL, asset([0.9, 0.8, 0.5], [0.5, 0.4, 0.3]))}, SKY + PANEL, [1.4], "0, -19, 5"),
    ({"ball": (BALL, asset([0.95, 0.8, 0.5], 0.0))}, SKY + PANEL, [1.5], "0, -19, 5"),
    ({"ball": (BALL, WARM)}, SKY + PANEL, [1.0], "0, -3, 0"),
    ({"ball": (BALL, WARM), "inner": ((0.5 * BALL[0], BALL[1]), COOL)}, SKY + PANEL, [1.4, 1.0], "0, -19, 5"),
    ({"left": (box((-4, -2, -2), (-0.01, 2, 2)), WARM), "right": (box((0, -2, -2), (4, 2, 2)), COOL)}, SKY + PANEL, [1.0, 1.0],
     "0, -19, 5"),
], ids=["panel", "forward", "point", "glass", "rough", "camera", "nested", "beside"])
def test_as_the_compiled_walk(tmp_path, monkeypatch, meshes, around, indices, origin):
    how = transport(tmp_path, meshes, around, indices, size=16, origin=origin)
    (part,), walk = methods.parts(how, "paths", "negative", 0), walked(how, monkeypatch)
    assert part.samples > 1 == walk.samples
    ours, theirs = [part.render(number) for number in range(16)], [walk.render(number) for number in range(40)]
    for layer in ("order1", "orders", ""):
        pictures = (blocks(np.array([one[layer] for one in images]), (2, 2)) for images in (ours, theirs))
        assert same(*pictures) > ODDS, layer


@pytest.mark.slow
@pytest.mark.parametrize("meshes, around, indices", [
    ({"ball": (BALL, asset([0.9, 0.8, 0.5], [0.5, 0.4, 0.3]))}, SKY + PANEL + FLOOR, [1.4]),
    ({"ball": (BALL, WARM), "inner": ((0.5 * BALL[0], BALL[1]), COOL)}, SKY + PANEL, [1.4, 1.0]),
    ({"left": (box((-4, -2, -2), (0, 2, 2)), WARM), "right": (box((0, -2, -2), (4, 2, 2)), COOL)}, PANEL + FLOOR, [1.0, 1.0]),
], ids=["glass", "nested", "beside"])
def test_few_events_between_two_surfaces_as_in_the_compiled_walk(tmp_path, monkeypatch, meshes, around, indices):
    """Each surface that turns light back, and each boundary, lets it scatter anew: so it has three events and more."""
    how = transport(tmp_path, meshes, around, indices)
    (few, *_), walk = methods.parts(how, "vrl+tables", "negative", 0), walked(how, monkeypatch, "vrl+tables")
    ours, theirs = [few.render(number) for number in range(16)], [walk.render(number) for number in range(60)]
    for layer in (*ORDERS, ""):
        pictures = [blocks(np.array([layers[layer] for layers in images]), (2, 2)) for images in (ours, theirs)]
        assert pictures[1].mean() > 0 and same(*pictures) > ODDS, layer


@pytest.mark.slow
def test_bodies_that_share_a_face(tmp_path, monkeypatch):
    """As those with a gap between them that is hardly there; a path that takes a crossing for what it meets goes wrong."""
    def later(gap):
        meshes = {"left": (box((-4, -2, -2), (0, 2, 2)), WARM), "right": (box((gap, -2, -2), (4, 2, 2)), COOL)}
        return blocks(passes(transport(tmp_path, meshes, SKY + PANEL, [1.0, 1.0]), range(32), "orders"), (2, 2))

    apart = later(0.005)
    assert same(later(0.0), apart) > ODDS
    monkeypatch.setattr(boundaries, "needs_search", lambda world, bodies: False)
    assert same(later(0.0), apart) < ODDS


@pytest.mark.slow
def test_wavelengths_as_their_means(tmp_path):
    """Five wavelengths of one medium make the grey picture that one makes."""
    five, one = asset([0.9] * 5, 0.3, [1.0] * 5, (0.45, 0.5, 0.55, 0.6, 0.65)), asset([0.9], 0.3, [1.0], (0.55,))
    assert colour.srgb_matrix(five.wavelength).shape == (3, 5)
    pictures = [blocks(passes(transport(tmp_path, {"ball": (BALL, medium)}, SKY + PANEL, [1.0]), range(24)), (2, 2))
                for medium in (five, one)]
    assert same(*pictures) > ODDS


def test_refraction_is_no_loss_to_roulette(tmp_path, monkeypatch):
    """In an even sky every path of a glass body that loses no light brings exactly its radiance: none ends, or is made brighter,
    because refraction into glass divides radiance.  But for a few at the edges of the ball's triangles, which lose their side."""
    monkeypatch.setattr(loop, "_FAR", 1 << 20)  # else some paths that are caught for long end
    even = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
    how = transport(tmp_path, {"ball": (BALL, asset(1.0, 0.0))}, even, [1.4], size=16)
    by_order, _ = loop.trace(Scene(how.world, how.bodies, how.colours, drawn=False), (1, 2), 256, 1, False)
    assert np.quantile(abs(by_order.sum(axis=1) - 1), 0.95) < 1e-4


def test_lights_are_shared_out_among_the_samples_of_a_pixel(tmp_path):
    """A matt floor under a lamp and a weak sky, two samples a pixel: each light has one of them, and all pixels are what a closed
    form says; chosen by chance for each sample, lights leave a noise of 0.64."""
    shade = '<bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>'
    around = f"""<shape type="rectangle"><transform name="to_world"><scale value="2000"/></transform>{shade}</shape>
<emitter type="directional"><vector name="direction" x="0" y="0" z="-1"/><rgb name="irradiance" value="3"/></emitter>
<emitter type="constant"><rgb name="radiance" value="0.05"/></emitter>"""
    sensor = bodies.SENSOR.replace("SIZE", "64").replace("ORIGIN", "0, -19, 15")
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{sensor}{around}</scene>')
    colours = Colours(np.eye(3), np.eye(3))
    view = Scene(World(tmp_path / "scene.xml"), [], colours)
    light = loop.trace(view, (1, 2), 64 * 64, 2, False)[0].sum(axis=1)[:, 1] / 2
    expected = 0.5 * (3 / np.pi + 0.05)
    assert light.std() < 0.06 * expected
    assert light.mean() == pytest.approx(expected, abs=sigmas() * 0.06 * expected / 64)


class Caught:
    """Light caught by total reflection in a cube of glass, in which the camera stands, until it meets a small black lamp."""

    CAMERA = ("""<sensor type="perspective"><float name="fov" value="12"/><transform name="to_world">
<lookat origin="0.1, -0.2, 0.05" target="1.1, 0.75, 1" up="0, 0, 1"/></transform><film type="hdrfilm">
<integer name="width" value="64"/> <integer name="height" value="64"/> <rfilter type="box"/></film></sensor>""")
    GLASS = '<bsdf type="dielectric"/><boolean name="face_normals" value="true"/>'
    LAMP = f"""<shape type="rectangle"><transform name="to_world"><scale value="0.25"/><rotate x="1" angle="180"/>
<translate x="0.3" y="-0.2" z="0.9999"/></transform>{bodies.BLACK}<emitter type="area"><rgb name="radiance" value="1"/></emitter>
</shape>"""

    def __init__(self, folder):
        glass = bodies.shape(folder, "glass", box((-1, -1, -1), (1, 1, 1)), self.GLASS)
        ball = bodies.shape(folder, "ball", (0.1 * BALL[0] + 9, BALL[1]), bodies.BOUNDARIES[1.0])
        (folder / "scene.xml").write_text(f'<scene version="3.0.0">{self.CAMERA}{glass}{self.LAMP}{ball}</scene>')
        self.how = methods.transport_of(World(folder / "scene.xml"), ["ball"], [asset(0.5, 0.0)], [None], None, "paths")

    def over_surfaces(self):
        scene = Scene(self.how.world, [], self.how.colours)
        return loop.trace(scene, (1, 2), 64 * 64, 1, False)[0].sum(axis=1)[:, 1]

    def through_media(self):
        scene = Scene(self.how.world, self.how.bodies, self.how.colours)
        return loop.trace(scene, (1, 2), 64 * 64, 1, False)[0].sum(axis=1)[:, 1]

    @staticmethod
    def of_wavefronts():
        """The same, but for where it is: the lamp is met one time in a hundred."""
        count, seen, random = 64 * 64, [], np.random.default_rng(3)
        states = random.integers(1 << 63, size=count).astype(np.uint64)
        paths = Paths.begun(np.zeros((count, 3)), np.ones((count, 3)), 1, states, np.arange(count))
        while paths.count:
            meets = random.random(paths.count) < 0.01
            seen.append(paths.throughput[meets, 0])
            paths = paths.of(~meets)
            paths.bounces[:] += 1
            paths = steps.thinned(paths, 64)
        seen = np.concatenate(seen)
        return np.concatenate([seen, np.zeros(count - len(seen))])


@pytest.mark.parametrize("kind", ["over_surfaces", "through_media", "of_wavefronts"])
def test_what_light_that_is_caught_in_glass_counts(tmp_path, kind):
    """All of it comes to the lamp, after a hundred bounces; no path is made much brighter by those that end on their way.

    Were one in twenty to end at each bounce, one of the four thousand would count some hundred times.
    """
    light = getattr(Caught(tmp_path), kind)()
    assert light.max() < 40
    assert light.mean() == pytest.approx(1, abs=sigmas() * light.std() / np.sqrt(len(light)))
    assert light.std() < 1


def test_the_longest_paths_count_as_the_fourth_power_of_their_bounces():
    """From 100,000 to 110,000: 1.1^-4 of them are left, and count 1.1^4."""
    count = 1000
    weight, alive = np.ones((count, 1)), np.ones(count, bool)
    states = np.random.default_rng(4).integers(1 << 63, size=count).astype(np.uint64)
    for bounces in range(100_000, 110_000):
        wavefront.roulette(weight, states, np.full(len(states), bounces), alive, 0, len(states))
        if not alive.all():
            weight, states, alive = weight[alive], states[alive], alive[alive]
    assert np.allclose(weight, 1.1**4, rtol=1e-4)
    share = 1.1**-4
    assert len(states) == pytest.approx(count * share, abs=sigmas() * np.sqrt(count * share * (1 - share)))


@pytest.mark.slow
def test_light_that_rounding_takes(tmp_path):
    """A cube far from the origin loses light, about as much as is stated, and a report says so."""
    media, pictures = asset([0.99, 0.9, 0.5], 0.5, (0.05,) * 3), []
    for number, far in enumerate((0, 1 << 15)):
        (tmp_path / str(number)).mkdir()
        around = transport(tmp_path / str(number), {"ball": (box((far - 5, -5, 0), (far + 5, 5, 5)), media)}, SKY, [1.0])
        camera = (tmp_path / str(number) / "scene.xml").read_text().replace('origin="0,', f'origin="{far},')
        (tmp_path / str(number) / "scene.xml").write_text(camera.replace('target="0,', f'target="{far},'))
        world = World(tmp_path / str(number) / "scene.xml")
        around = methods.transport_of(world, ["ball"], [media], [None], lambda *where: ValueError(where), "paths")
        pictures.append(passes(around, range(20)).mean(axis=(1, 2)))
    near, at = pictures
    lost = 1 - at.mean(axis=0) / near.mean(axis=0)
    error = np.hypot(*(part.std(axis=0, ddof=1) / part.mean(axis=0) for part in pictures)) / 20**0.5
    (body,) = around.bodies
    assert 0.02 < rounding(body) < 0.04 and np.all(lost < 1.5 * rounding(body) + sigmas(20) * error)
    assert lost[1] > 0.5 * rounding(body) + sigmas(20) * error[1]
    assert "3.28e+04 m" in rounded([body])[0]
    dense = body._replace(medium=body.medium._replace(sigma_t=1e12 * body.medium.sigma_t))
    assert rounding(dense) == 1 and "some 100 % of its light" in rounded([dense])[0]
    assert not rounded([body._replace(vertices=body.vertices - [far, 0, 0])])
