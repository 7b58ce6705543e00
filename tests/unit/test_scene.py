"""Scene files and what they name: every fault with its line, pictures and cameras as Mitsuba has them, files of densities."""

import re
import struct
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from bakery.errors import RecipeError, UsageError
from renderers import scene
from renderers.camera import Camera
from renderers.fog import picture
from renderers.scene import grids
from tests.exr import library

SCENE = """\
bakery_scene: 2
name: night
asset: fog.h5
camera: {origin: [0, -12, 1.7] m, target: [0 m, 0 m, 200 cm], fov: 40 deg}
picture: {color: a.exr, depth: a.exr, channel: depth.Z, measure: z, far: 1 km}
fog:
  density: {type: height, falloff: 6 m}
  light: [{type: sun, direction: [0, 0, -1], irradiance: [1, 2, 3]}, {type: ambient, radiance: 2}]
"""


@pytest.fixture
def load(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("fog.h5", "a.exr", "street.xml", "cloud.h5", "cloud.vol"):
        (tmp_path / name).write_bytes(b"x")

    def loaded(text=SCENE, **settings):
        (tmp_path / "s.yaml").write_text(text)
        return scene.load("s.yaml", {key.replace("__", "."): value for key, value in settings.items()})

    return loaded


def test_values_in_base_units(load):
    found = load(fog__density__scale="5", filter="{cut_off: none, energy: lost}")
    values = found.values
    assert list(values.camera.origin) == [0, -12, 1.7] and list(values.camera.target) == [0, 0, 2]
    assert values.camera.fov == pytest.approx(np.radians(40)) and list(values.camera.up) == [0, 0, 1]
    assert values.picture.far == 1000 and values.picture.unit == 1 and values.picture.sky is None
    assert (values.fog.density.scale, values.fog.density.base, values.fog.density.falloff) == (5, 0, 6)
    assert (values.filter.energy, values.filter.outside, values.filter.cut_off) == ("lost", None, None)
    assert values.display.curve == "reinhard" and values.fog.diffuse is True
    assert found.renderer == "renderers.fog" and found.picture == Path("night.png")
    assert found.file(values.asset) == Path("fog.h5")


def test_every_fault_at_once(load):
    bad = SCENE.replace("scene: 2", "scene: 3").replace("fog.h5", "gone.h5").replace("40 deg", "40")
    bad = bad.replace("measure: z", "masure: z")
    bad = bad.replace("6 m}", "6 m, sclae: 3}").replace("irradiance: [1, 2, 3]", "irradiance: [1, 2]").replace("ambient", "moon")
    with pytest.raises(RecipeError) as raised:
        load(bad)
    said = [(p.line, p.key) for p in raised.value.problems]
    assert said == [(1, "bakery_scene"), (3, "asset"), (4, "camera.fov"), (5, "picture.masure"), (7, "fog.density.sclae"),
                    (8, "fog.light[0].irradiance"), (8, "fog.light[1].type")]
    text = str(raised.value)
    assert "s.yaml:5: picture.masure" in text and "(measure?)" in text and "(scale?)" in text
    assert "no such file" in text and "has no unit" in text and "recipe" not in text


@pytest.mark.parametrize(("change", "said"), [
    ({"fog:": "fgo:"}, 'unknown key "fgo"'),
    ({"{color: a.exr, depth: a.exr, channel: depth.Z, measure: z, far: 1 km}": "{mitsuba: street.xml}"}, "found a camera beside"),
    ({"camera: {origin: [0, -12, 1.7] m, target: [0 m, 0 m, 200 cm], fov: 40 deg}\n": ""}, "camera: missing"),
    ({"color: a.exr, depth: a.exr, ": ""}, "picture: found keys with values; expected {mitsuba"),
    ({"[0 m, 0 m, 200 cm]": "[0, -12, 1.7] m"}, "the camera's own place"),
    ({"[0 m, 0 m, 200 cm]": "[0, -12, 5] m"}, "looks along its own up"),
    ({"fov: 40 deg": "fov: 40 deg, up: [0, 0, 0]"}, "camera.up: found a direction of length 0"),
    ({"[0, 0, -1]": "[0, 0, 0]"}, r"fog.light[0].direction: found a direction of length 0"),
    ({"[0, -12, 1.7] m": "[0, -12] m"}, "expected three numbers"),
    ({"fov: 40 deg": "fov: 180 deg"}, "camera.fov"),
    ({"{type: height, falloff: 6 m}": "{type: grid, file: cloud.h5}"}, "fog.density.dataset: missing"),
    ({"{type: height, falloff: 6 m}": "{type: grid, file: cloud.h5}"}, "fog.density.lo: missing"),
    ({"{type: height, falloff: 6 m}": "{type: grid, file: cloud.vol, dataset: a}"}, ".vol files hold one array"),
    ({"{type: height, falloff: 6 m}": "{type: grid, file: a.exr}"}, "expected .h5, .hdf5, .npy or .vol"),
    ({"{type: height, falloff: 6 m}": "{type: grid, file: cloud.vol, lo: [0,0,0] m, hi: [1,1,0] m}"}, "a box without volume"),
    ({"type: height": "type: heigth"}, '"heigth"'),
    ({"asset: fog.h5": "asset: ."}, "a folder or a device"),
    ({"name: night": "name: &a night"}, "scenes have no anchors"),
    ({"name: night": "name: night\nname: day"}, "a second time"),
])
def test_one_fault(load, change, said):
    text = SCENE
    for old, new in change.items():
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(RecipeError, match=re.escape(said)):
        load(text)


@pytest.mark.parametrize("text", ["", "- a\n", "3", "a: [", "\0", "bakery: 1\n"])
def test_no_scene(load, text):
    with pytest.raises(RecipeError):
        load(text)


def test_no_file_and_wrong_settings(load, tmp_path):
    for path in (tmp_path, tmp_path / "gone.yaml"):
        with pytest.raises(UsageError, match="no such scene"):
            scene.load(path)
    with pytest.raises(RecipeError, match="--set fog.density.scale: .*-1"):
        load(fog__density__scale="-1")
    with pytest.raises(RecipeError, match="unknown key"):
        load(fog__densty="3")


# ---- pictures


def exr(path, **channels):
    mi = library()
    stack = np.ascontiguousarray(np.stack(list(channels.values()), axis=-1), np.float32)
    names = [name.replace("_", ".") for name in channels]
    mi.Bitmap(stack, pixel_format=mi.Bitmap.PixelFormat.MultiChannel, channel_names=names).write(str(path))


LOOK = {"origin": (1, -4, 2), "target": (0.2, 0.1, 0.3), "up": (0, 0, 1), "fov": 0.9}


def test_the_angle_of_a_pixel_is_the_root_of_its_solid_angle():
    """By triangles of Van Oosterom and Strackee; pixels are small, so the middle stands for the pixel to its square, 1e-3."""
    camera = Camera.looking(**LOOK, height=30, width=40)
    y, x = np.mgrid[:31, :41]
    corner = camera.corner + x[..., None] * camera.right + y[..., None] * camera.down
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    solid = 0.0
    for p, q, r in ((a, b, c), (a, c, d)):
        p, q, r = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (p, q, r))
        turned = np.abs(np.sum(p * np.cross(q, r), -1))
        solid = solid + 2 * np.arctan2(turned, 1 + np.sum(p * q, -1) + np.sum(q * r, -1) + np.sum(r * p, -1))
    assert np.allclose(camera.angle(30, 40) ** 2, solid, rtol=1e-3)
    ahead = np.subtract(LOOK["target"], LOOK["origin"])
    cosine = camera.rays(30, 40) @ (ahead / np.linalg.norm(ahead))
    assert np.allclose(camera.angle(30, 40), 2 * np.tan(0.45) / 40 * cosine**1.5, rtol=1e-13)


XML = """<scene version="3.0.0"><integrator type="path"/><emitter type="constant"/><shape type="sphere"/>
<sensor type="{kind}"><float name="near_clip" value="0.5"/>{lens}
<transform name="to_world"><lookat origin="1,-4,2" target="0.2,0.1,0.3" up="0,0,1"/></transform>
<film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="30"/>{crop}</film>
<sampler type="independent"><integer name="sample_count" value="2"/></sampler></sensor></scene>"""
FOV = '<float name="fov" value="50"/><string name="fov_axis" value="y"/>'
CROP = "".join(f'<integer name="crop_{name}" value="{value}"/>' for name, value in
               (("offset_x", 4), ("offset_y", 3), ("width", 20), ("height", 15)))


@pytest.mark.parametrize("variant", [None, "scalar_rgb"])
@pytest.mark.parametrize(("lens", "crop"), [(FOV, ""), (FOV + '<float name="principal_point_offset_x" value="0.1"/>', CROP)])
def test_rays_and_distances_of_a_sensor(tmp_path, lens, crop, variant):
    """Rays are those that the sensor sends; distances are those of the sphere to float32, whatever the near plane."""
    (tmp_path / "s.xml").write_text(XML.format(kind="perspective", lens=lens, crop=crop))
    found = picture.from_mitsuba(tmp_path / "s.xml", unit=2.0, variant=variant)
    import mitsuba as mi

    height, width = found.distance.shape
    rays = found.camera.rays(height, width)
    sensor = mi.load_file(str(tmp_path / "s.xml")).sensors()[0]
    for y, x in ((0, 0), (height - 1, 3), (7, width - 1)):
        ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f((x + 0.5) / width, (y + 0.5) / height), mi.Point2f(0.5, 0.5))
        assert np.allclose(np.ravel(ray.d), rays[y, x], atol=1e-6)
    origin = found.camera.origin / 2
    ahead = -rays @ origin
    inside = ahead**2 - (origin @ origin - 1)
    exact = np.where(inside > 0, ahead - np.sqrt(np.maximum(inside, 0)), np.inf)
    assert np.array_equal(np.isfinite(exact), np.isfinite(found.distance)) and np.isfinite(exact).sum() > 50
    assert np.allclose(found.distance / 2, exact, rtol=1e-5)
    if not crop:
        fov = 2 * np.arctan(np.tan(np.radians(25)) * 4 / 3)
        ours = Camera.looking(**{**LOOK, "fov": fov}, height=30, width=40)
        assert np.allclose(ours.rays(30, 40), rays, atol=1e-6)


def test_no_perspective_camera(tmp_path):
    (tmp_path / "s.xml").write_text(XML.format(kind="orthographic", lens="", crop=""))
    with pytest.raises(UsageError, match="expected a .*perspective camera"):
        picture.from_mitsuba(tmp_path / "s.xml")


def test_depth_becomes_distance(tmp_path):
    """z of a wall across the axis is constant, its distance is not; sky is what the file says, and inf."""
    z = np.full((6, 8), 3.0)
    z[0, 0], z[0, 1] = 1e10, np.inf
    exr(tmp_path / "a.exr", R=np.full((6, 8), 0.1), G=np.zeros((6, 8)), B=np.zeros((6, 8)), depth_Z=z)
    files = {"color": tmp_path / "a.exr", "depth": tmp_path / "a.exr", "channel": "depth.Z", "look": SimpleNamespace(**LOOK)}
    flat = picture.from_files(**files, measure="z", unit=0.01, sky=1e10)
    points = flat.camera.points(6, 8)
    assert np.isinf(flat.distance[0, :2]).all() and np.isfinite(flat.distance).sum() == 46
    assert np.allclose(flat.distance[1:], 0.03 * np.linalg.norm(points, axis=-1)[1:])
    assert np.allclose(picture.from_files(**files, measure="distance", sky=1e10).distance[1:], 3)
    assert flat.rgb[2, 2].tolist() == pytest.approx([0.1, 0, 0])


def test_colors_of_files(tmp_path):
    """PNG by IEC 61966-2-1; EXR by its only layer, the nameless one, or the one that is asked for."""
    mi = library()
    codes = np.arange(18, dtype=np.uint8).reshape(2, 3, 3) * 14
    mi.Bitmap(codes).write(str(tmp_path / "a.png"))
    v = codes / 255
    linear = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    assert np.allclose(picture.read_color(tmp_path / "a.png"), linear, atol=1e-6)
    one = np.ones((2, 3))
    exr(tmp_path / "two.exr", R=one, G=one, B=one, clear_R=2 * one, clear_G=one, clear_B=one)
    assert picture.read_color(tmp_path / "two.exr")[0, 0, 0] == 1
    assert picture.read_color(tmp_path / "two.exr", "clear")[0, 0, 0] == 2
    exr(tmp_path / "named.exr", V_Combined_R=3 * one, V_Combined_G=one, V_Combined_B=one, V_Z=one)
    assert picture.read_color(tmp_path / "named.exr")[0, 0, 0] == 3
    exr(tmp_path / "more.exr", a_R=one, a_G=one, a_B=one, b_R=one, b_G=one, b_B=one)
    with pytest.raises(UsageError, match="a.R, .*`layer:`"):
        picture.read_color(tmp_path / "more.exr")
    with pytest.raises(UsageError, match="`channel:`"):
        picture.read_depth(tmp_path / "more.exr")
    with pytest.raises(UsageError, match="and no Z"):
        picture.read_depth(tmp_path / "more.exr", "Z")
    mi.Bitmap((np.arange(6).reshape(2, 3) * 10000).astype(np.uint16)).write(str(tmp_path / "d.png"))
    assert picture.read_depth(tmp_path / "d.png").tolist() == [[0, 10000, 20000], [30000, 40000, 50000]]
    np.save(tmp_path / "d.npy", np.arange(6).reshape(2, 3))
    assert picture.read_depth(tmp_path / "d.npy")[1, 2] == 5


@pytest.mark.parametrize(("color", "depth", "said"), [
    (np.full((2, 3), np.nan), np.ones((2, 3)), "radiance nan at row 0, column 0 and in 5 more pixels"),
    (np.ones((2, 3)), np.zeros((2, 3)), "depth 0 at row 0"),
    (np.ones((2, 3)), np.full((2, 3), np.nan), "depth nan"),
    (np.ones((2, 3)), np.ones((3, 2)), "found 2 x 3 pixels"),
    (np.ones((2, 3)), np.ones((2, 3, 1)), "shape"),
    (np.ones((2, 3)), np.array([["a"]]), "shape"),
])
def test_pictures_that_will_not_do(tmp_path, color, depth, said):
    exr(tmp_path / "a.exr", R=color, G=color, B=color)
    np.save(tmp_path / "d.npy", depth)
    with pytest.raises(UsageError, match=said):
        picture.from_files(tmp_path / "a.exr", tmp_path / "d.npy", SimpleNamespace(**LOOK))


@pytest.mark.parametrize("name", ["a.exr", "a.png", "a.npy", "a.txt"])
def test_files_that_are_no_pictures(tmp_path, name):
    for data in (b"", b"\x93NUMPY", b"\x76\x2f\x31\x01" + bytes(40), b"\x89PNG\r\n\x1a\n"):
        (tmp_path / name).write_bytes(data)
        for read in (picture.read_color, picture.read_depth):
            with pytest.raises(UsageError, match=name):
                read(tmp_path / name)


# ---- densities


def test_grids_of_files(tmp_path):
    values = np.random.default_rng(0).random((2, 3, 4))
    np.save(tmp_path / "a.npy", values)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["in/rho"] = values
    assert np.array_equal(grids.read(tmp_path / "a.npy")[0], values)
    assert np.array_equal(grids.read(tmp_path / "a.h5", "in/rho")[0], values)
    head = struct.pack("<3sB5i6f", b"VOL", 3, 1, *values.shape, 1, 0, 0, 0, 1, 2, 3)
    (tmp_path / "a.vol").write_bytes(head + np.ascontiguousarray(values.T, "<f4").tobytes())
    back, lo, hi = grids.read(tmp_path / "a.vol")
    assert np.array_equal(back, values.astype(np.float32)) and (lo, hi) == ((0, 0, 0), (1, 2, 3))


def _bad_hdf5(path):
    with h5py.File(path, "w") as file:
        file["flat"], file["text"], file["one"] = np.ones((2, 2)), np.full((1, 1, 1), b"a"), 1.0
        file["nan"] = np.full((1, 2, 1), np.nan)
        file["soft"] = h5py.SoftLink("/nan")
        file["other"] = h5py.ExternalLink("x.h5", "/nan")
        file.create_dataset("empty", (0, 2, 2), "f4")
        file["void"] = h5py.Empty("f")
        file.create_dataset("huge", (2**20, 2**20, 2**20), chunks=(64, 64, 64), dtype="f4")
        file.create_dataset("bomb", (512, 512, 512), chunks=(64, 64, 64), dtype="f4")
        file.create_dataset("unwritten", (512, 512, 512), dtype="f4")
        file.create_dataset("outside", (1, 1, 1), "f4", external=[("/etc/hostname", 0, 4)])


@pytest.mark.parametrize(("dataset", "said"), [
    ("flat", "2 x 2 values"), ("text", "real numbers"), ("one", "three axes"), ("nan", r"density nan at \[0, 0, 0\]"),
    ("soft", "a link"), ("other", "a link"), ("empty", "0 x 2 x 2"), ("void", "three axes"), ("huge", "at most 1,073,741,824"),
    ("bomb", "does not hold"), ("unwritten", "does not hold"),
    ("outside", "not stored in the file"), ("gone", 'no dataset "gone"; expected one that the file holds'),
    ("/", "a group"),
])
def test_datasets_that_are_no_densities(tmp_path, dataset, said):
    _bad_hdf5(tmp_path / "a.h5")
    with pytest.raises(UsageError, match=said):
        grids.read(tmp_path / "a.h5", dataset)


@pytest.mark.parametrize(("name", "data", "said"), [
    ("a.vol", b"VOL", "no VOL file"),
    ("a.vol", struct.pack("<3sB5i6f", b"VOL", 3, 2, 1, 1, 1, 1, *range(6)) + bytes(2), "encoding 2"),
    ("a.vol", struct.pack("<3sB5i6f", b"VOL", 3, 1, 2**20, 2**20, 2**20, 1, *range(6)), "at most"),
    ("a.vol", struct.pack("<3sB5i6f", b"VOL", 3, 1, 1, -1, 1, 1, *range(6)), "three axes"),
    ("a.vol", struct.pack("<3sB5i6f", b"VOL", 3, 1, 2, 1, 1, 1, *range(6)) + bytes(4), "4 bytes for 2 x 1 x 1"),
    ("a.vol", struct.pack("<3sB5i7f", b"VOL", 3, 1, 1, 1, 1, 1, 0, 0, 0, 1, 0, 1, 5), "a box from"),
    ("a.vol", struct.pack("<3sB5i7f", b"VOL", 3, 1, 1, 1, 1, 1, 0, 0, 0, 1, 1, 1, -5), "density -5"),
    ("a.npy", b"", "cannot be read"), ("a.npy", b"\x93NUMPY\x01\x00", "cannot be read"), ("a.h5", b"", "cannot be read"),
    ("a.vdb", b"", "found the ending .vdb"),
])
def test_files_that_are_no_densities(tmp_path, name, data, said):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(UsageError, match=re.escape(said)):
        grids.read(tmp_path / name, "rho")
