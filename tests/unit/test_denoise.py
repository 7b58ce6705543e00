"""Pictures without their noise: what a filter may change, when it runs, and what pixels show of a scene."""

import sys
import types

import numpy as np
import pytest

from bakery.errors import UsageError
from renderers import colour
from renderers.pictures import denoise, engine
from renderers.pictures.denoise import Features, denoised

HAS = pytest.mark.skipif(bool(denoise.fault()), reason="mitsuba-oidn is not installed")
SHAPE = (24, 32, 3)


@pytest.fixture
def any_filter(monkeypatch):
    """In place of the network any function, with or without the package."""
    monkeypatch.setattr(denoise, "_version", lambda: "of the test")

    def put(function):
        monkeypatch.setattr(denoise, "_filtered", lambda picture, features, quick: function(picture))

    return put


def noisy(scatter=0.3, word=0):
    """A picture with a gradient, and its variance and that of its luminance, where colours have nothing in common."""
    level = np.broadcast_to(np.linspace(0.5, 2, SHAPE[1])[None, :, None], SHAPE)
    picture = level * (1 + scatter * np.random.default_rng(word).standard_normal(SHAPE))
    return level, np.maximum(picture, 0), with_luminance((scatter * level) ** 2)


def with_luminance(variance):
    return np.dstack([variance, variance @ colour.LUMINANCE**2])


def scene_saying(word):
    return types.SimpleNamespace(values=types.SimpleNamespace(denoise=word),
                                 wrong=lambda key, message: UsageError(f"s.yaml:3: {key}: {message}"))


# ---- when


@pytest.mark.parametrize("word, quality, filters", [
    ("auto", None, False), ("auto", "final", False), ("auto", "preview", True), ("auto", "draft", True),
    ("yes", None, True), ("no", "draft", False)])
def test_when_the_noise_is_taken_out(monkeypatch, word, quality, filters):
    monkeypatch.setattr(denoise, "fault", lambda: "")
    assert denoise.chosen(scene_saying(word).values, quality, "") == (filters, [])


def test_without_the_package(monkeypatch):
    """A draft keeps its noise and says so; who asks for it is told before any work."""
    monkeypatch.setitem(sys.modules, "mitsuba_oidn", None)
    filters, (said,) = denoise.chosen(scene_saying("auto").values, "draft", "")
    assert not filters and "mitsuba-oidn" in said and ".[denoise]" in said
    with pytest.raises(UsageError, match=r"s.yaml:3: denoise: found yes.*mitsuba-oidn \(.*\.\[denoise\].*auto"):
        denoise.refuse_absent(scene_saying("yes"))
    denoise.refuse_absent(scene_saying("auto"))
    denoise.refuse_absent(types.SimpleNamespace(values=object()))  # fog has no such key


def test_noise_that_pixels_share_is_left(monkeypatch):
    """But where somebody asks for it."""
    monkeypatch.setattr(denoise, "fault", lambda: "")
    filters, (said,) = denoise.chosen(scene_saying("auto").values, "draft", "pixels share it")
    assert not filters and "pixels share it" in said and "denoise: yes" in said
    assert denoise.chosen(scene_saying("yes").values, None, "pixels share it")[0]


# ---- what a filter may change


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 0.0, -5.0, 1e30])
def test_nothing_a_filter_gives_gets_far(any_filter, wrong):
    """Within two standard errors, and between the least and the most of what is near."""
    any_filter(lambda picture: np.full_like(picture, wrong))
    _, picture, variance = noisy()
    found = denoised({"walk": (picture, variance)}).rgb
    assert np.isfinite(found).all() and (found >= 0).all()
    assert (found <= picture.max()).all() and (found >= picture.min()).all()
    assert (abs(found - picture) <= 2.001 * np.sqrt(variance.max())).all()


def test_light_that_is_known_stays(any_filter):
    """A lamp, on which all passes agree, far from noise: a network made a flame a third brighter."""
    any_filter(lambda picture: 1.4 * picture)
    _, picture, variance = noisy()
    picture[4:16, 4:16], variance[:, :22] = 1e5, 0.0
    found = denoised({"walk": (picture, variance)}).rgb
    assert np.array_equal(found[:, :18], picture[:, :18]) and not np.array_equal(found[:, 22:], picture[:, 22:])


def test_a_single_bright_sample_goes_and_a_small_lamp_stays(any_filter):
    """Passes that agree on a rare bright sample leave a pixel with little scatter: a dot, unless neighbours are as bright."""
    any_filter(np.ones_like)
    level, variance = np.ones(SHAPE), with_luminance(np.full(SHAPE, 0.04))
    level[5, 5] = level[15:17, 20:22] = 2.0  # five standard errors: two may be held, a single one moved by eight
    cleared = denoised({"walk": (level, variance)}).rgb
    assert np.array_equal(cleared[5, 5], cleared[5, 9])
    assert (cleared[15:17, 20:22] >= 1.5).all()


@pytest.mark.parametrize("dim", [0.0, 0.1])
def test_light_that_few_pixels_have_found_is_spread(any_filter, dim):
    """Where a path in fifty finds any light, three squares of 5 x 5 pixels in five have none: they are no black specks.  Nor are
    they dim squares, where all paths find a tenth of the light with little noise."""
    any_filter(np.ones_like)
    random = np.random.default_rng(1)
    lit = random.random((96, 96, 1)) < 0.02
    rare = np.where(lit, (1 - dim) / lit.mean(), 0.0) * np.ones(3)
    variance = rare**2 + (0.2 * dim) ** 2
    picture = rare + dim * (1 + 0.2 * random.standard_normal(rare.shape))
    spread = denoised({"walk": (picture, with_luminance(variance))}).rgb
    assert np.mean(spread <= 2 * dim) < 1e-3 and np.median(spread) == pytest.approx(1.0, abs=0.1)


def test_rare_light_beside_dark_ground_has_no_notches(any_filter):
    """One path in ten finds nine tenths of light; where no pixel of 5 x 5 has, the mean of 25 x 25 is dark with the ground."""
    random, truth = np.random.default_rng(1), np.where(np.arange(96)[:, None] < 24, 1.0, 0.02) * np.ones((96, 1, 3))
    rare = np.where(random.random((96, 96, 1)) < 0.1, 9.0, 0.0) * (truth > 0.5)
    picture = rare + np.where(truth > 0.5, 0.1, truth)
    level = picture.mean()
    any_filter(lambda picture: truth / level)
    spread = denoised({"walk": (picture, with_luminance(rare**2 + 1e-4))}).rgb
    assert np.mean(spread[:, :21] < 0.8) < 0.01 and spread[:, 40:].max() < 0.05


def test_what_is_kept_apart_is_not_smeared(any_filter):
    """Glints to the last bit on top of the rest; with `detail`, in those pixels alone."""
    any_filter(lambda picture: np.full_like(picture, picture.mean()))
    _, picture, variance = noisy()
    glints = np.zeros(SHAPE)
    glints[3::5, 2::7] = 40.0
    parts = {"walk": (picture, variance), "splat": (glints, variance)}
    rest = denoised({"walk": (picture, variance)}).rgb
    found = denoised(parts, ["splat"])
    assert np.array_equal(found.rgb, rest + glints) and found.figures["apart"] == ["splat"]
    detail = np.zeros(SHAPE[:2])
    detail[:, :16] = 1.0
    some = Features(*np.zeros((2, *SHAPE)), np.ones(SHAPE[:2]), detail)
    mixed, whole = denoised(parts, ["splat"], some).rgb, denoised(parts, features=some).rgb
    rest = denoised({"walk": (picture, variance)}, features=some).rgb
    assert np.array_equal(mixed[:, :16], (rest + glints)[:, :16]) and np.array_equal(mixed[:, 16:], whole[:, 16:])
    assert np.array_equal(denoised(parts, ["walk", "splat"]).rgb, picture + glints)
    nowhere = denoised(parts, ["splat"], some._replace(detail=0 * detail))  # then the filter sees all, as it says
    assert np.array_equal(nowhere.rgb, whole) and nowhere.figures["apart"] == []
    said = denoise.sentence(found.figures)  # of what the person has, not of parts of the code
    assert "grains and particles" in said and "splat" not in said


def test_a_black_picture_stays_black(any_filter):
    any_filter(lambda picture: picture + 1)
    black = denoised({"walk": (np.zeros(SHAPE), np.zeros((*SHAPE[:2], 4)))})
    assert not black.rgb.any() and black.figures["mean_change"] == 0.0


def test_the_change_of_the_mean_is_stated(any_filter):
    any_filter(lambda picture: 0.9 * picture)
    _, picture, variance = noisy()
    found = denoised({"walk": (picture, variance)}, features=Features(*np.ones((2, *SHAPE)), np.full(SHAPE[:2], np.inf)))
    after, before = ((image @ colour.LUMINANCE).sum() for image in (found.rgb, picture))
    assert found.figures["mean_change"] == pytest.approx(after / before - 1) and -0.101 < after / before - 1 < -0.05
    assert {"denoised.R", "albedo.G", "normal.Z", "distance.Z"} <= found.channels.keys()
    assert "of the test" in found.text[denoise.TEXT]


@HAS
def test_the_network_takes_white_noise_out():
    """A quarter of the error at most (0.22), the same at any level of light, and the same bits again."""
    import renderers.mitsuba  # noqa: F401

    level, picture, variance = noisy()
    found = denoised({"walk": (picture, variance)})
    assert np.std(found.rgb - level) < 0.25 * np.std(picture - level) and abs(found.figures["mean_change"]) < 0.02
    assert np.array_equal(denoised({"walk": (picture, variance)}).rgb, found.rgb)
    for scale in (1e-20, 1e6):
        scaled = denoised({"walk": (scale * picture, scale**2 * variance)}).rgb
        assert np.allclose(scaled, scale * found.rgb, rtol=1e-3, atol=0)
    assert denoised({"walk": (picture[:1, :1], None)}).rgb.shape == (1, 1, 3)


# ---- what pixels show

SCENE = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0, -4, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
<film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="12"/></film></sensor>
<shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate x="1" angle="90"/><translate y="2"/></transform>
  <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.8 0.2 0.1"/></bsdf></bsdf></shape>
<shape type="cube"><transform name="to_world"><scale value="0.5, 0.1, 3"/><translate x="-0.8"/></transform>
  <bsdf type="dielectric"/></shape>
<shape type="cube" id="wax"><transform name="to_world"><scale value="0.5, 0.5, 3"/><translate x="0.8"/></transform>
  <bsdf type="{boundary}"/></shape></scene>"""


@pytest.mark.parametrize("boundary", ["dielectric", "null"])
def test_first_hits(tmp_path, boundary):
    """A wall, the wall through a pane, and a body that lets nothing through, whose boundary gives the normal."""
    from renderers.mitsuba.world import World
    from renderers.transport import features
    from renderers.transport.scattering import scatterer

    (tmp_path / "s.xml").write_text(SCENE.format(boundary=boundary))
    world = World(tmp_path / "s.xml", 0.1)
    shape = next(shape for shape in world.shapes() if shape.name == "wax")
    medium = scatterer(np.full(3, 1e5), np.array([0.9, 0.6, 0.3]), np.array([0, np.pi]), np.full((3, 2), 1 / (4 * np.pi)))
    body = types.SimpleNamespace(name="wax", vertices=shape.vertices, faces=shape.faces, medium=medium,
                                 matched=boundary == "null")
    found = features.first_hits(world, [body], types.SimpleNamespace(to_rgb=np.eye(3), to_waves=np.eye(3)), 0)
    wall, pane, wax = (found.albedo[6, column] for column in (12, 7, 17))
    assert np.allclose(wall, [0.8, 0.2, 0.1], atol=1e-5) and np.allclose(pane, wall, atol=1e-5)
    assert np.allclose(wax, [0.9, 0.6, 0.3], atol=1e-5)
    for column, distance in ((12, 0.6), (7, 0.6), (17, 0.35)):
        assert np.allclose(found.normal[6, column], [0, -1, 0], atol=1e-3)
        assert found.distance[6, column] == pytest.approx(distance, rel=0.05)
    assert np.array_equal(found.distance, features.first_hits(world, [body], types.SimpleNamespace(
        to_rgb=np.eye(3), to_waves=np.eye(3)), 0).distance)


def test_first_hits_in_haze_have_no_noise(tmp_path):
    """A wall behind a slab of haze: both count by Beer's law, and the distance is where half of the light has been scattered."""
    from renderers.mitsuba.world import World
    from renderers.transport import features, regions
    from renderers.transport.scattering import scatterer

    (tmp_path / "s.xml").write_text(SCENE.format(boundary="null"))
    world, depth = World(tmp_path / "s.xml", 0.1), np.array([1.0, 2.0, 3.0])  # of 0.2 m
    medium = scatterer(5 * depth, np.array([0.9, 0.6, 0.3]), np.array([0, np.pi]), np.full((3, 2), 1 / (4 * np.pi)))
    haze = regions.Medium(regions.Box(np.array([-9, -0.2, -9]), np.array([9, 0.0, 9])), medium)
    found = features.first_hits(world, [haze], types.SimpleNamespace(to_rgb=np.eye(3), to_waves=np.eye(3)), 0)
    wall, kept = (slice(4, 8), slice(11, 14)), np.exp(-depth)
    # a ray 4 pixels beside the middle is 0.3 % longer, which changes what gets through by at most 0.1 %
    expected = kept.mean() * np.array([0.8, 0.2, 0.1]) + (1 - kept) * [0.9, 0.6, 0.3]
    assert np.allclose(found.albedo[wall], expected, atol=4e-3)
    assert np.allclose(found.normal[wall], kept.mean() * np.array([0, -1, 0]), atol=2e-3)
    # of three colours by their mean extinction, so that 6 % is what is lost
    assert np.allclose(found.distance[wall], 0.2 + 0.2 * np.log(2) / 2, rtol=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("size", [(16, 24), (64, 96)])
@pytest.mark.parametrize("passes", [2, 8])
def test_shared_noise_is_found(size, passes):
    """Of 40 pictures none whose pixels are independent, and most whose pixels have a common noise three times their own."""
    from renderers.pictures.passes import _shared

    def found(common, word):
        def render(index):
            random = np.random.default_rng([word, index])
            grey = 5 + common * random.standard_normal() + random.standard_normal((*size, 1))
            return {"": np.repeat(grey, 3, axis=2)}

        estimate = engine.Passes([engine.Part("walk", render)])
        estimate.run(engine.Stop(samples=passes))
        return bool(_shared(estimate))

    assert not any(found(0.0, word) for word in range(40))
    assert sum(found(3.0, word) for word in range(40)) >= (35 if passes > 2 else 20)
