"""Translucent bodies: methods against each other, closed forms, a white world, and Mitsuba's `volpath`.

Comparisons with chance go wrong once in 1e7 seeds; seeds are fixed.
"""

import numpy as np
import pytest
from scipy import stats

import bakery
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from renderers.materials.bodies import methods
from renderers.materials.bodies.bodies import refusal
from renderers.mitsuba.world import World
from renderers.pictures.engine import in_time, shares
from tests.odds import ODDS, sigmas
from tests.physics.particles import averaged, blocks, same
from tests.physics.test_aggregate import bumpy

SKY = '<emitter type="constant"><rgb name="radiance" value="1 1 1"/></emitter>'
PANEL = """<shape type="rectangle" id="panel"><transform name="to_world"><scale value="5"/><rotate x="1" angle="180"/>
<translate x="3" y="-3" z="13"/></transform><emitter type="area"><rgb name="radiance" value="4 4 4"/></emitter></shape>"""
FLOOR = """<shape type="rectangle" id="floor"><transform name="to_world"><scale value="12"/><translate z="-6"/></transform>
<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.5 0.5"/></bsdf></bsdf></shape>"""
BLACK = '<bsdf type="diffuse"><rgb name="reflectance" value="0 0 0"/></bsdf>'
LAMP = '<emitter type="area"><rgb name="radiance" value="5 5 5"/></emitter>'
SENSOR = """<sensor type="perspective"><float name="fov" value="34"/><transform name="to_world"><lookat origin="ORIGIN"
target="0, 0, 0" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="SIZE"/>
<integer name="height" value="SIZE"/><rfilter type="box"/></film></sensor>"""
BOUNDARIES = {1.0: '<bsdf type="null"/>', 1.4: '<bsdf type="dielectric"><float name="int_ior" value="1.4"/>'
              '<float name="ext_ior" value="1"/></bsdf>',
              1.5: '<bsdf type="roughdielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/>'
              '<float name="alpha" value="0.15"/></bsdf>'}
RECIPE = """\
bakery: 1
name: {name}
wavelengths: [0.55]
tolerance: 1%
medium: {{albedo: {albedo}, mean_free_path: 1 m, phase: {{type: hg, g: {g}}}}}
multiple_scattering: {{extent: {extent}, tolerance: {tolerance}}}
"""
BALL = icosphere(320)[0] * 5, icosphere(320)[1]


ASSETS = {}  # that `baked` has baked, for the tests of every file


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    """The asset of albedo, g, extent of its tables (mean free paths of 1 m)."""
    folder = tmp_path_factory.mktemp("assets")

    def bake(albedo=0.9, g=0.0, extent=12, tolerance="5%"):
        name = f"m{albedo}_{g}_{extent}_{tolerance[:-1]}".replace(".", "_")
        if name not in ASSETS:
            (folder / f"{name}.yaml").write_text(RECIPE.format(name=name, albedo=albedo, g=g, extent=extent, tolerance=tolerance))
            with pytest.MonkeyPatch.context() as patch:
                patch.setenv("BAKERY_CACHE", str(folder / "cache"))
                ASSETS[name] = bakery.open(bakery.bake(folder / f"{name}.yaml", output=folder / f"{name}.h5"))
        return ASSETS[name]

    return bake


def shape(folder, name, mesh, inside):
    """XML of a mesh in a file."""
    (folder / f"{name}.ply").write_bytes(ply.mesh(*mesh))
    return f'<shape type="ply" id="{name}"><string name="filename" value="{name}.ply"/>{inside}</shape>'


def transport(folder, assets, bodies, around, index=1.0, size=16, origin="0, -19, 5"):
    """How light goes in bodies, meshes by name, among other things, `around`."""
    sensor = SENSOR.replace("SIZE", str(size)).replace("ORIGIN", origin)
    shapes = "".join(shape(folder, name, mesh, BOUNDARIES[index]) for name, mesh in bodies.items())
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{sensor}{shapes}{around}</scene>')
    return methods.transport_of(World(folder / "scene.xml"), list(bodies), assets, [None] * len(bodies),
                                lambda number, key, message: ValueError(f"{number} {key}: {message}"))


def passes(how, name, boundary="negative", *, numbers, seed=0, layer=""):
    """Pictures (passes, H, W, 3) of a layer."""
    parts = methods.parts(how, name, boundary, seed)
    return np.array([sum(part.render(number)[layer] for part in parts) for number in numbers])


def means(*args, **more):
    return passes(*args, **more).mean(axis=(1, 2, 3))


def means_of_layers(how, name, layers, *, numbers, seed=0):
    """Means (layers, passes) of pictures that are rendered once for all layers."""
    parts = methods.parts(how, name, "negative", seed)
    pictures = [[part.render(number) for part in parts] for number in numbers]
    return np.array([[sum(part[layer] for part in picture).mean() for picture in pictures] for layer in layers])


def chance(ours, theirs):
    """That means of two sets of passes differ by chance as they do (Welch's t)."""
    return stats.ttest_ind(ours, theirs, equal_var=False).pvalue


@pytest.mark.slow
def test_tables_and_events_agree(baked, tmp_path):
    """A ball of radius 5 mean free paths under a panel and on a floor; without a boundary it is too bright."""
    how = transport(tmp_path, [baked()], {"ball": BALL}, PANEL + FLOOR)
    events = means(how, "paths", numbers=range(12))
    tables = means(how, "vrl+tables", numbers=range(12), seed=1)
    assert events.std() < 0.1 * events.mean() and tables.std() < 0.1 * tables.mean()
    assert chance(tables, events) > ODDS
    assert tables.mean() == pytest.approx(events.mean(), rel=0.05)
    assert chance(means(how, "vrl+tables", "none", numbers=range(12), seed=1), events) < ODDS, "nothing would be seen"


@pytest.mark.slow
def test_a_ball_on_the_floor(baked, tmp_path, monkeypatch):
    """The floor just touches the ball: triangles around bodies need not enclose anything."""
    monkeypatch.setattr("renderers.transport.guides._VOXELS", 64)  # light is right by any
    light = []
    for height in (-5.0, -5.001):
        folder = tmp_path / f"{height}"
        folder.mkdir()
        floor = FLOOR.replace('z="-6"', f'z="{height}"')
        light.append(means(transport(folder, [baked()], {"ball": BALL}, SKY + floor, 1.4, size=8), "paths", numbers=range(8)))
    assert chance(*light) > ODDS


@pytest.mark.slow
def test_the_same_bytes_whatever_threads(baked, tmp_path, monkeypatch):
    from renderers import threads

    how = transport(tmp_path, [baked()], {"ball": BALL}, PANEL + FLOOR)
    found = passes(how, "vrl+tables", numbers=[0])
    monkeypatch.setattr(threads, "_pool", lambda: threads.ThreadPoolExecutor(1))
    assert np.array_equal(passes(how, "vrl+tables", numbers=[0]), found)
    assert not np.array_equal(passes(how, "vrl+tables", numbers=[0], seed=1), found)


@pytest.mark.parametrize("form, index, more, refused", [
    ("{ball}", 1.4, "", False), ("{turned}", 1.4, "", True), ("{turned}", 1.0, "", False),
    ("{turned}", 1.4, '<boolean name="flip_normals" value="true"/>', False),
    ("{ball}", 1.5, '<transform name="to_world"><scale x="-1" y="1" z="1"/></transform>', True),
    # its own normals point outward
    ('<shape type="cube" id="ball">', 1.4, '<transform name="to_world"><scale x="-1" y="1" z="1"/></transform>', False)])
def test_boundaries_that_refract_inside_out(tmp_path, form, index, more, refused):
    """Light would see a bubble: a grey ball of index 1.4 was 0.96 of its sky, in place of 0.57."""
    for name, faces in (("ball", BALL[1]), ("turned", BALL[1][:, ::-1])):
        (tmp_path / f"{name}.ply").write_bytes(ply.mesh(BALL[0], faces))
    files = {name: f'<shape type="ply" id="ball"><string name="filename" value="{name}.ply"/>' for name in ("ball", "turned")}
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{SENSOR.replace("SIZE", "4").replace("ORIGIN", "0, -19, 5")}'
                                        f'{form.format(**files)}{BOUNDARIES[index]}{more}</shape></scene>')
    assert ("inside out" in refusal(World(tmp_path / "scene.xml").shapes(), "ball", index)) == refused


HOLLOW = np.concatenate([BALL[0], 0.6 * BALL[0]]), np.concatenate([BALL[1], len(BALL[0]) + BALL[1][:, ::-1]])


@pytest.mark.slow
@pytest.mark.parametrize("name, index, g, mesh, inside, origin", [
    ("vrl", 1.4, 0.0, BALL, "", "0, -19, 5"), ("vrl+tables", 1.0, 0.7, BALL, "", "0, -19, 5"),
    ("vrl+tables", 1.4, 0.0, HOLLOW, "", "0, -19, 5"), ("vrl+tables", 1.4, 0.0, bumpy(5.0), "", "0, -19, 5"),
    ("vrl+tables", 1.0, 0.0, BALL, BLACK, "0, -19, 5"), ("vrl+tables", 1.4, 0.0, BALL, LAMP, "0, -19, 5"),
    ("vrl", 1.0, 0.0, BALL, LAMP, "0, -19, 5"), ("vrl+tables", 1.4, 0.0, BALL, "", "0, -3, 0"),
    ("beams", 1.4, 0.0, BALL, "", "0, -19, 5"), ("beams+tables", 1.4, 0.7, bumpy(5.0), "", "0, -19, 5"),
    ("beams+tables", 1.5, 0.0, HOLLOW, LAMP, "0, -19, 5"),
], ids=["vrl-glass", "forward", "hollow-glass", "concave-glass", "obstacle", "lamp-glass", "lamp-vrl", "camera-glass",
        "beams-glass", "joined-concave", "joined-rough-lamp"])
def test_methods_agree(baked, tmp_path, name, index, g, mesh, inside, origin):
    """With event by event, on bodies of many kinds; `inside`: what a ball in the body is."""
    around = SKY + PANEL + (shape(tmp_path, "inner", (0.3 * BALL[0], BALL[1]), inside) if inside else "")
    how = transport(tmp_path, [baked(0.9, g)], {"body": mesh}, around, index, size=24, origin=origin)
    events, found = means(how, "paths", numbers=range(40)), means(how, name, numbers=range(40), seed=1)
    error = np.hypot(events.std(ddof=1), found.std(ddof=1)) / 40**0.5
    assert error < 0.02 * events.mean() and chance(found, events) > ODDS


@pytest.mark.slow
@pytest.mark.parametrize("meshes, index", [
    ({"left": (0.8 * BALL[0] - [4, 0, 0], BALL[1]), "right": (0.8 * BALL[0] + [4, 0, 0], BALL[1])}, 1.4),
    ({"outer": BALL, "inner": (0.5 * BALL[0], BALL[1])}, 1.0),
], ids=["touching-glass", "one-in-another"])
def test_several_bodies(baked, tmp_path, meshes, index):
    """With assets of their own."""
    how = transport(tmp_path, [baked(0.9), baked(0.5)], meshes, SKY + PANEL, index, size=24)
    events, found = means(how, "paths", numbers=range(30)), means(how, "vrl+tables", numbers=range(30), seed=1)
    error = np.hypot(events.std(ddof=1), found.std(ddof=1)) / 30**0.5
    assert error < 0.02 * events.mean() and chance(found, events) > ODDS


@pytest.mark.slow
def test_without_a_boundary_light_comes_back(baked, tmp_path):
    """Later events of a ball of 5 mean free paths, albedo 0.99: the tables alone are some three times too bright (3.0 for a beam
    along the radius), the mirror takes half of that away, negative beams all."""
    how = transport(tmp_path, [baked(0.99, extent=40)], {"ball": BALL}, PANEL)
    events = means(how, "paths", numbers=range(60), layer="orders")
    bare, mirrored, exact = (means(how, "vrl+tables", one, numbers=range(30), layer="orders")
                             for one in ("none", "mirrored", "negative"))
    assert 2.5 < bare.mean() / events.mean() < 4.5 and 1.2 < mirrored.mean() / events.mean() < 2.2
    assert chance(exact, events) > ODDS and max(chance(bare, events), chance(mirrored, events)) < ODDS


@pytest.mark.slow
def test_nothing_is_lost(baked, tmp_path):
    """In light from everywhere what does not absorb is 1: the one of the methods below that 1 % would take minutes of."""
    how = transport(tmp_path, [baked(1.0, extent="auto")], {"ball": BALL}, SKY, 1.4, size=24)
    mean, error = averaged(means(how, "vrl+tables", numbers=range(60)))
    assert error < 0.01 and abs(mean - 1) < sigmas(60) * error


# method, index, pixels a side, passes.  Without a boundary beams+tables is vrl+tables; with one both would take two to four
# minutes: what they share with these is here, and what glass adds is held to 2 % above
WHITE = [("paths", 1.0, 32, 40), ("paths", 1.4, 32, 200), ("vrl", 1.0, 32, 90), ("vrl+tables", 1.0, 16, 380),
         ("beams", 1.0, 32, 12), ("beams", 1.4, 32, 20)]


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name, index, size, count", WHITE, ids=[f"{name}-{index}" for name, index, *_ in WHITE])
def test_means_are_known_to_one_per_cent(baked, tmp_path, name, index, size, count):
    """In light from everywhere what does not absorb is 1: to 1 %, which is three standard errors or more.  A right method fails
    once in 370 seeds, which are fixed; one that loses or adds 2 % of its light passes once in 700."""
    how = transport(tmp_path, [baked(1.0, extent="auto", tolerance="1%")], {"ball": BALL}, SKY, index, size=size)
    mean, error = averaged(means(how, name, numbers=range(count)))
    assert error < 0.01 / 3 and abs(mean - 1) < 0.01, (mean, error)


@pytest.mark.slow
@pytest.mark.parametrize("index", [1.0, 1.4])
def test_mitsuba_sees_the_same(baked, tmp_path, index):
    """By blocks of pixels, on a floor under a sky, against `volpath`."""
    import mitsuba as mi

    how = transport(tmp_path, [baked()], {"ball": BALL}, FLOOR + SKY, index, size=48)
    text = (tmp_path / "scene.xml").read_text().replace(
        BOUNDARIES[index], BOUNDARIES[index] + '<medium type="homogeneous" name="interior"><float name="albedo" value="0.9"/>'
        '<float name="sigma_t" value="1"/></medium>')
    (tmp_path / "explicit.xml").write_text(text.replace('<sensor', '<integrator type="volpath"><integer name="max_depth" '
                                                        'value="-1"/><integer name="rr_depth" value="100"/></integrator><sensor'))
    scene = mi.load_file(str(tmp_path / "explicit.xml"))
    theirs = blocks(np.array([np.array(mi.render(scene, seed=seed, spp=16))[..., :3] for seed in range(12)]), (6, 6))
    for name in ("paths", "vrl+tables"):
        ours = blocks(passes(how, name, numbers=range(24)), (6, 6))
        noisy = (theirs.std(axis=0) > 1e-4) & (ours.std(axis=0) > 1e-4)  # where there is only sky, they differ by rounding
        assert noisy.mean() > 0.5 and same(ours[:, noisy], theirs[:, noisy]) > ODDS
        assert same(ours[:, noisy], 1.05 * theirs[:, noisy]) < ODDS, "nothing would be seen"


@pytest.mark.slow
def test_beams_that_are_far_away_bring_numbers(baked, tmp_path):
    """A ball of 10,000 mean free paths, where most beams are so far from lines of sight that their light has no digits left."""
    how = transport(tmp_path, [baked()], {"ball": BALL}, PANEL)
    how = how._replace(bodies=[body._replace(medium=body.medium._replace(sigma_t=2000 * body.medium.sigma_t))
                               for body in how.bodies])
    beams = methods.parts(how, "vrl", "negative", 0)[1]
    assert all(np.isfinite(beams.render(number)[""]).all() for number in range(40))


@pytest.mark.slow
def test_few_lines_of_sight_gather_for_all(baked, tmp_path, monkeypatch):
    """In a short render those of an eighth of the pixels, with other random numbers: the same in the mean, with more noise."""
    monkeypatch.setattr(methods, "_LOOKING_UP", 0)
    how = transport(tmp_path, [baked()], {"ball": BALL}, PANEL, index=1.4)
    all_gather = methods.parts(how, "vrl+tables", "negative", 0)[1]
    assert all_gather.fewest == 1 / 8
    (few,) = in_time([all_gather], 1.0)
    few_gather = np.array([few.render(number)[""].mean() for number in range(100, 140)])
    pictures = np.array([all_gather.render(number)[""].mean() for number in range(64)])
    assert few_gather.std() > 1.5 * pictures.std() and pictures.std() < 0.15 * pictures.mean()
    assert chance(few_gather, pictures) > ODDS and chance(2 * few_gather, pictures) < ODDS


@pytest.mark.slow
@pytest.mark.parametrize(("name", "size", "share"), [("vrl+tables", 16, 1), ("vrl+tables", 128, 1 / 4), ("vrl", 16, 1 / 8)])
def test_all_pixels_of_small_pictures_look_beams_up(baked, tmp_path, name, size, share):
    """There the beams take the time, and an eighth of the pixels took 0.9 of their time, with up to 16 times the variance."""
    beams = methods.parts(transport(tmp_path, [baked()], {"ball": BALL}, PANEL, size=size), name, "negative", 0)[1]
    assert shares([beams], 1.0) == {"beams": share}
