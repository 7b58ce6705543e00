"""Light of points that glass turns back before its first event, and of points inside of glass, against photons of our own.

Photons are followed one by one from the point through a cube, by Fresnel's equations and chance, and counted where they leave
towards the camera.  Of that light a quarter has been turned back before its first event.  Seeds are fixed; comparisons go wrong
once in 1e7 seeds each.
"""

import math

import numpy as np
import pytest
from numba import njit

import bakery
from bakery.store import ply
from renderers.materials.bodies import chains, methods
from renderers.mitsuba.world import World
from renderers.pictures.engine import in_time
from tests.odds import SIGMAS

INDEX, ALBEDO, HALF = 1.5, 0.9, 0.6  # half an edge, mean free paths
VERTICES = HALF * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
                  [1, 5, 7], [1, 7, 3]], np.int32)
EYE = np.array([0.6, 0.3, 0.7]) / np.linalg.norm([0.6, 0.3, 0.7])
CONE = math.radians(8)  # about the direction of the camera, in which photons count
AWAY = 200.0  # of the camera
POINTS = {"outside": (2.0, 1.0, 5.0), "inside": (0.1, 0.2, -0.1)}
RECIPE = """\
bakery: 1
name: glass
wavelengths: [0.55]
tolerance: 1%
medium: {albedo: 0.9, mean_free_path: 1 m, phase: {type: hg, g: 0}}
multiple_scattering: {extent: 12, tolerance: 3%}
"""
XML = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="FOV"/><transform name="to_world">
<lookat origin="ORIGIN" target="TARGET" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="16"/>
<integer name="height" value="16"/><rfilter type="box"/></film></sensor><emitter type="point"><point name="position"
value="POINT"/><rgb name="intensity" value="1, 1, 1"/></emitter><shape type="ply" id="cube"><string name="filename"
value="cube.ply"/><boolean name="face_normals" value="true"/><bsdf type="dielectric"><float name="int_ior" value="INDEX"/>
<float name="ext_ior" value="1"/></bsdf></shape>AROUND</scene>"""


@njit
def _reflectance(cosine, index):
    """Of light that goes to a medium of so many times the index, and its cosine there."""
    square = 1 - (1 - cosine * cosine) / (index * index)
    if square <= 0:
        return 1.0, 0.0
    beyond = math.sqrt(square)
    s = (cosine - index * beyond) / (cosine + index * beyond)
    p = (index * cosine - beyond) / (index * cosine + beyond)
    return 0.5 * (s * s + p * p), beyond


@njit
def _photons(count, half, point, inside, index, albedo, eye, cone, seed):
    """Intensity (4,) W/sr towards the eye of a point of 1 W/sr, by events (0 to 3 and more); what of it was turned back first."""
    np.random.seed(seed)
    intensity, turned_back = np.zeros(4), np.zeros(4)
    distance, reach = math.sqrt(point @ point), half * math.sqrt(3.0)
    narrow = -1.0 if inside else math.sqrt(1 - (reach / distance) ** 2)
    ahead = -point / distance
    side = np.cross(ahead, np.array([0.0, 1.0, 0.0]))
    side /= math.sqrt(side @ side)
    other = np.cross(ahead, side)
    each = 2 * math.pi * (1 - narrow) / count / (2 * math.pi * (1 - math.cos(cone)))
    for _ in range(count):
        c, turn = 1 - (1 - narrow) * np.random.random(), 2 * math.pi * np.random.random()
        d = c * ahead + math.sqrt(max(1 - c * c, 0.0)) * (math.cos(turn) * side + math.sin(turn) * other)
        p, weight, events, first = point.copy(), 1.0, 0, False
        if not inside:
            enters, leaves, axis = -np.inf, np.inf, 0
            for k in range(3):
                near, far = (-math.copysign(half, d[k]) - p[k]) / d[k], (math.copysign(half, d[k]) - p[k]) / d[k]
                if near > enters:
                    enters, axis = near, k
                leaves = min(leaves, far)
            if enters >= leaves:
                continue
            p += enters * d
            reflected, beyond = _reflectance(abs(d[axis]), index)
            if np.random.random() < reflected:
                continue
            sign = math.copysign(1.0, d[axis])
            d /= index
            d[axis] = sign * beyond
        while weight > 0:
            far, axis = np.inf, 0
            for k in range(3):
                t = max((math.copysign(half, d[k]) - p[k]) / d[k], 0.0)
                if t < far:
                    far, axis = t, k
            t = -math.log(1 - np.random.random())
            if t < far:
                events += 1
                weight *= albedo
                if weight < 0.1:
                    weight = 0.2 if np.random.random() < weight / 0.2 else 0.0
                c, turn = 2 * np.random.random() - 1, 2 * math.pi * np.random.random()
                p += t * d
                s = math.sqrt(1 - c * c)
                d[0], d[1], d[2] = s * math.cos(turn), s * math.sin(turn), c
                continue
            p += far * d
            reflected, beyond = _reflectance(abs(d[axis]), 1 / index)
            if np.random.random() < reflected:
                d[axis] = -d[axis]
                first |= events == 0
                continue
            sign = math.copysign(1.0, d[axis])
            d *= index
            d[axis] = sign * beyond
            if d @ eye > math.cos(cone):
                intensity[min(events, 3)] += each * weight
                turned_back[min(events, 3)] += each * weight * first
            break
    return intensity, turned_back


@pytest.fixture(scope="module")
def glass(tmp_path_factory):
    folder = tmp_path_factory.mktemp("assets")
    (folder / "glass.yaml").write_text(RECIPE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        return bakery.open(bakery.bake(folder / "glass.yaml", output=folder / "glass.h5"))


@pytest.fixture(scope="module")
def photons():
    """Intensities by events, (8 runs, 4) each, all and turned back first, of a place of the point."""
    kept = {}

    def follow(place):
        if place not in kept:
            runs = [_photons(1_000_000, HALF, np.array(POINTS[place]), place == "inside", INDEX, ALBEDO, EYE, CONE, seed)
                    for seed in range(8)]
            kept[place] = np.array(runs).transpose(1, 0, 2)
        return kept[place]

    return follow


def transport(folder, asset, point, index=INDEX, around="", origin=AWAY * EYE, target=(0.0, 0.0, 0.0)):
    """How light goes in the cube, and the area that the picture shows about it, m^2."""
    half_width = 1.1 * HALF * math.sqrt(3)
    (folder / "cube.ply").write_bytes(ply.mesh(VERTICES, FACES))
    text = XML.replace("FOV", repr(math.degrees(2 * math.atan(half_width / np.linalg.norm(np.subtract(origin, target))))))
    for name, place in (("ORIGIN", origin), ("TARGET", target), ("POINT", point)):
        text = text.replace(name, ", ".join(repr(float(one)) for one in place))
    text = text.replace("INDEX", repr(index)).replace("AROUND", around)
    (folder / "scene.xml").write_text(text)
    how = methods.transport_of(World(folder / "scene.xml"), ["cube"], [asset], [None],
                               lambda number, key, message: ValueError(f"{number} {key}: {message}"))
    return how, (2 * half_width) ** 2


def measured(how, area, name, count, seconds=None):
    """(passes, 4) W/sr, by events, of a render of so many seconds."""
    passes = []
    for number in range(count):
        layers = [part.render(number) for part in in_time(methods.parts(how, name, "negative", 1), seconds)]
        passes.append([sum(layer[order].mean() for layer in layers) * area for order in ("order0", "order1", "order2", "orders")])
    return np.array(passes)


@pytest.mark.slow
@pytest.mark.parametrize("name, place, count, seconds", [
    ("paths", "outside", 30, None), ("vrl", "outside", 20, None), ("vrl+tables", "outside", 20, None),
    ("beams", "outside", 12, None), ("beams+tables", "outside", 12, None), ("paths", "inside", 80, None),
    ("vrl+tables", "inside", 60, None), ("paths", "outside", 90, 1.0)])
def test_light_that_glass_turns_back_is_there(glass, photons, tmp_path, name, place, count, seconds):
    """By events; events near a point inside are bright and rare, so its noise is four times that of one outside.  In a render
    of a second shares of paths stand for all."""
    more = 4.0 if place == "inside" else 1.0
    all_light, turned_back = photons(place)
    how, area = transport(tmp_path, glass, POINTS[place])
    ours = measured(how, area, name, count, seconds)
    for select, within in ((slice(1, 2), 0.02), (slice(2, 3), 0.05), (slice(1, 4), 0.03)):
        theirs, mine = all_light[:, select].sum(axis=1), ours[:, select].sum(axis=1)
        error = math.hypot(theirs.std(ddof=1) / len(theirs)**0.5, mine.std(ddof=1) / len(mine)**0.5)
        assert error < more * within * theirs.mean()
        assert abs(mine.mean() - theirs.mean()) < SIGMAS * error, (mine.mean() / theirs.mean(), error / theirs.mean())
    lost = turned_back[:, 1:].sum() / all_light[:, 1:].sum()
    assert lost > 0.2, "nothing would be seen"


@pytest.mark.slow
def test_caustics_are_left_out_and_measured(glass, tmp_path):
    """Glass of almost no index, a thousandth of a mean free path wide, casts a shadow that its caustic alone would fill."""
    floor = """<shape type="rectangle" id="floor"><transform name="to_world"><scale value="9"/><translate z="-2"/></transform>
<bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.5, 0.5"/></bsdf></shape>"""
    point, middle = np.array([6.0, 0.5, 5.0]), np.array([-2.4, -0.2, -2.0])  # of the shadow
    how, _ = transport(tmp_path, glass, point, 1.0001, floor, middle + [0.0, 0.1, 20.0], middle)
    how = how._replace(bodies=[body._replace(medium=body.medium._replace(sigma_t=1e-3 * body.medium.sigma_t))
                               for body in how.bodies])
    missing, sentences = chains.left_out(how, 0)
    assert len(sentences) == 1 and "caustics" in sentences[0]
    seen = np.mean([methods.parts(how, "paths", "negative", 0)[0].render(number)["order0"].mean() for number in range(8)])
    rows = np.stack(np.mgrid[:16, :16], axis=-1).reshape(-1, 2)
    origin, direction = how.world.camera_rays(np.full((256, 2), 0.5), rows)
    away = point - (origin + (-2 - origin[:, 2:]) / direction[:, 2:] * direction)
    without = np.mean(0.5 / np.pi * away[:, 2] / np.linalg.norm(away, axis=1) ** 3)
    # of a picture of 256 pixels, 12 of them on the edge of the shadow, each known to 0.2 of one: 0.01 of the shadow
    assert 0.2 < 1 - seen / without < 0.9
    assert missing.mean() == pytest.approx(without - seen, rel=0.05)


@pytest.mark.slow
def test_light_by_way_of_mirrors_is_said_to_be_left_out(glass, tmp_path):
    mirror = '<shape type="rectangle" id="mirror"><transform name="to_world"><translate z="-2"/></transform>' \
             '<bsdf type="conductor"/></shape>'
    how, _ = transport(tmp_path, glass, POINTS["outside"], around=mirror)
    missing, sentences = chains.left_out(how, 0)
    assert missing is None and len(sentences) == 1 and "(mirror)" in sentences[0]
