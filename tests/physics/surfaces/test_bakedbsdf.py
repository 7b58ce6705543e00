"""The plugin `bakedbsdf`: the asset's values, samples that are distributed as their density, and no light lost.

Draws are seeded.  A test that compares with chance is made so that a right program fails it with odds below 1e-6.
"""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("renderers.mitsuba", exc_type=ImportError)  # before mitsuba: it finds LLVM for it

import drjit as dr
import mitsuba as mi

from bakery.errors import UsageError
from bakery.kernels import surface_reflectance
from bakery.physics.surfaces import fresnel
from bakery.physics.surfaces.slab import upside_down
from bakery.physics.surfaces.solution import solve
from bakery.physics.surfaces.table import surface_table
from bakery.physics.surfaces.unscattered import unscattered
from renderers.mitsuba import layers
from tests.conftest import slow
from tests.devices import jit, on_each_device
from tests.odds import sigmas
from tests.physics.surfaces.layers import LAYERS, RGB, solutions, table
from tests.physics.surfaces.test_stack import planes, stack, under_rings

VARIANTS = [*jit("ad_rgb"), "scalar_rgb"]


@pytest.fixture(autouse=True)
def _solved(monkeypatch):
    """Layers by name in place of files."""
    def load(path, number):
        name = Path(path).name
        looked_up, errors = table(name)
        return layers.Layer(np.array(RGB[:len(looked_up.once)]) if len(looked_up.once) > 1 else np.array([0.55]), looked_up,
                            errors.largest)

    monkeypatch.setattr(layers, "load", load)


def plugin(name, **parameters):
    return mi.load_dict({"type": "bakedbsdf", "filename": name, **parameters})


def unit(theta, phi):
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def values_of(bsdf, wi, wo, wavelengths=()):
    """pi times BRDF or BTDF (channels, n) and density (n,) at directions (3, n)."""
    context, count = mi.BSDFContext(), wi.shape[1]
    if not dr.is_jit_v(mi.Float):
        values, density = [], []
        for a, b in zip(wi.T, wo.T, strict=True):
            si = mi.SurfaceInteraction3f()
            si.wi = mi.Vector3f(*a)
            value, pdf = bsdf.eval_pdf(context, si, mi.Vector3f(*b))
            values.append(np.array(value).ravel())
            density.append(pdf)
        return np.array(values).T * math.pi / np.abs(wo[2]), np.array(density)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(wi)
    if len(wavelengths):
        si.wavelengths = type(si.wavelengths)(*wavelengths)
    value, pdf = bsdf.eval_pdf(context, si, mi.Vector3f(wo))
    return np.array(value).reshape(-1, count) * math.pi / np.abs(wo[2]), np.array(pdf)


def drawn(bsdf, mu, count, seed=1, types=None):
    """Directions (3, n), weights (channels, n), densities (n,) and types (n,) of samples."""
    context = mi.BSDFContext()
    if types is not None:
        context.type_mask = types
    random = np.random.default_rng(seed).random((3, count)).astype(np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(math.sqrt(1 - mu * mu), 0, mu)
    sample, weight = bsdf.sample(context, si, mi.Float(random[0]), mi.Point2f(mi.Float(random[1]), mi.Float(random[2])))
    return np.array(sample.wo), np.array(weight).reshape(-1, count), np.array(sample.pdf), np.array(sample.sampled_type)


def some_slow(names, quick):
    return [pytest.param(name, marks=() if name in quick else pytest.mark.slow) for name in names]


@pytest.mark.slow
@pytest.mark.parametrize("variant", VARIANTS)
def test_light_counted_among_grains_is_looked_up_as_in_compiled_loops(variant):
    """To 89.9 degrees in both directions, straight back too, where the plugin's single precision allows."""
    mi.set_variant(variant)
    count = 15 if variant.startswith("scalar") else 400
    rng = np.random.default_rng(4)
    theta, theta0 = np.radians(np.concatenate([rng.uniform(0, 89.9, (2, count // 2)), rng.uniform(85, 89.9, (2, count // 2))], 1))
    phi = np.where(rng.random(len(theta)) < 0.3, math.pi, rng.uniform(0, math.pi, len(theta)))
    values, _ = values_of(plugin("grains"), unit(theta0, 0 * phi), unit(theta, math.pi + phi))
    looked_up, pairs = table("grains")[0], zip(*np.cos([theta, theta0, phi]), strict=True)
    exact = [surface_reflectance(looked_up, 0, *at) for at in pairs]
    np.testing.assert_allclose(values, np.broadcast_to(exact, values.shape), rtol=2e-3)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", some_slow(LAYERS, ("white", "sheet")))
def test_values_are_the_solutions(name, variant):
    mi.set_variant(variant)
    count = 15 if variant.startswith("scalar") else 400
    rng = np.random.default_rng(3)
    least = 0.62 if name == "lighter" else 0.01
    mu, mu0 = rng.uniform(least, 1, (2, count))
    phi, turn = rng.uniform(0, 2 * math.pi, (2, count))
    wi, wo = unit(np.arccos(mu0), turn), unit(np.arccos(mu), turn + math.pi + phi)  # phi = 0 goes on forward
    bsdf = plugin(name)
    sides = [(wi, wo, "reflection")]
    if LAYERS[name][2] < math.inf and LAYERS[name][4] is None:
        sides += [(wi, wo * [[1], [1], [-1]], "transmission"), (wi * [[1], [1], [-1]], wo * [[1], [1], [-1]], "reflection")]
    for directions, onward, function in sides:
        values, density = values_of(bsdf, directions, onward)
        exact = np.array([getattr(solution, function)(mu, mu0, phi) for solution in solutions(name)])
        np.testing.assert_allclose(values, np.broadcast_to(exact, values.shape), rtol=3e-3, atol=1e-5)
        assert (density > 0).all()


@pytest.mark.slow
@on_each_device
@pytest.mark.parametrize("mu", [1.0, 0.6, 0.1])
@pytest.mark.parametrize(("name", "share"), [("half space", 1), ("white", 1), ("sheet", 1), ("matt", None), ("paint", None)])
def test_furnace(device, name, share, mu):
    """In even light a lossless layer is as bright as the light; another one as its albedo says."""
    mi.set_variant(f"{device}_ad_rgb")
    _, weight, *_ = drawn(plugin(name), mu, 400_000)
    mean, error = weight.mean(axis=1), weight.std(axis=1) / math.sqrt(weight.shape[1])
    if share is None:
        x, w = np.polynomial.legendre.leggauss(64)
        cosine, turn = ((1 + x) / 2) ** 2, math.pi * (1 + x) / 2
        index = LAYERS[name][3]
        front = 0 if name == "matt" else fresnel.reflected(mu, index)
        share = [front + np.einsum("i,j,ij->", 2 * cosine * (1 + x) / 2 * w, w / 2,
                                   solution.reflection(cosine[:, None], mu, turn)) for solution in solutions(name)]
    # 5e-4: the table's own error; 6 standard errors: 2e-9 each
    np.testing.assert_array_less(np.abs(mean - share), 5e-4 + 6 * error)
    assert weight.max() < (4 if name == "matt" else 1.6)  # directions are drawn well


@pytest.mark.slow
@on_each_device
@pytest.mark.parametrize(("name", "mu"), [("tinted", 0.9), ("tinted", 0.1), ("sheet", 0.5), ("sheet", -0.5), ("matt", 0.4),
                                          ("paint", 0.7)])
def test_samples_are_distributed_as_their_density(device, name, mu):
    """Mitsuba's own test; at 1 % a case, of which the seed is one that passes, and a wrong density fails by far."""
    from mitsuba.chi2 import BSDFAdapter, ChiSquareTest, SphericalDomain

    mi.set_variant(f"{device}_ad_rgb")
    context = mi.BSDFContext()
    context.type_mask = mi.BSDFFlags.Smooth
    wi = [math.sqrt(1 - mu * mu) * 0.6, math.sqrt(1 - mu * mu) * 0.8, mu]
    sample, density = BSDFAdapter("bakedbsdf", {"type": "bakedbsdf", "filename": name}, wi=wi, ctx=context)

    def run(pdf):
        test = ChiSquareTest(SphericalDomain(), sample, pdf, sample_dim=3, sample_count=200_000, res=51, ires=32)
        return test.run(0.01)

    assert run(density)
    assert not run(lambda wo: density(wo) * (1 + 0.1 * wo.x))


@on_each_device
def test_mirrored_and_unscattered_light_go_on_in_single_directions(device):
    mi.set_variant(f"{device}_ad_rgb")
    types = mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.DeltaTransmission
    bsdf, mu, wi = plugin("sheet"), 0.6, np.array([0.8, 0.0, 0.6])
    inner, front = fresnel.inside(mu, 1.4), fresnel.reflected(mu, 1.4)
    passes = math.exp(-3 * solutions("sheet")[0].cut.shrinks / inner)
    down = (1 - front) ** 2 * passes / (1 - (front * passes) ** 2)
    for kind, towards, share in zip(types, (wi * [-1, -1, 1], -wi), (front + down * front * passes, down), strict=True):
        wo, weight, density, sampled = drawn(bsdf, mu, 8, types=kind)
        np.testing.assert_allclose(wo, np.tile(towards, (8, 1)).T, atol=1e-6)
        assert (sampled == int(kind)).all()
        # smooth lobes are not asked for: all samples are of this one
        np.testing.assert_allclose(weight, share, rtol=1e-3)
        np.testing.assert_allclose(density, 1, rtol=1e-6)


@on_each_device
def test_other_layers_are_black_from_behind(device):
    mi.set_variant(f"{device}_ad_rgb")
    wi, wo = np.array([[0.6], [0.0], [-0.8]]), np.array([[0.0], [0.6], [-0.8]])
    values, density = values_of(plugin("white"), wi, wo)
    assert not values.any() and not density.any()


@pytest.mark.slow
@on_each_device
def test_spectra_are_linear_between_the_wavelengths(device):
    mi.set_variant(f"{device}_ad_spectral")
    wi, wo = unit(np.array([0.5]), np.array([0.0])), unit(np.array([1.0]), np.array([2.0]))
    values, _ = values_of(plugin("tinted"), wi, wo, [465.0, 550.0, 580.0, 900.0])
    at = math.cos(1.0), math.cos(0.5), 2.0 - math.pi
    blue, green, red = (solution.reflection(*at) for solution in solutions("tinted")[::-1])
    np.testing.assert_allclose(values[:, 0], [blue, green, green + (red - green) / 2, red], rtol=2e-3)


@pytest.mark.slow
@on_each_device
def test_one_wavelength_by_position_or_by_length(device):
    mi.set_variant(f"{device}_ad_rgb")
    wi, wo = unit(np.array([0.5]), np.array([0.0])), unit(np.array([1.0]), np.array([2.0]))
    whole, by_place, by_length = (values_of(plugin("bare", **more), wi, wo)[0][:, 0]
                                  for more in ({}, {"channel": 1}, {"wavelength": 0.55}))
    np.testing.assert_allclose(by_place, whole[1], rtol=1e-6)
    np.testing.assert_allclose(by_length, whole[1], rtol=1e-6)
    with pytest.raises(RuntimeError, match="channel 3"):
        plugin("bare", channel=3)


@on_each_device
def test_a_refused_plugin_is_not_called_by_the_next_scene(device):
    """Dr.Jit calls all BSDFs that there are; the one that was refused lives on in what was raised."""
    mi.set_variant(f"{device}_ad_rgb")
    with pytest.raises(RuntimeError, match="channel 3") as refused:
        plugin("white", channel=3)
    shape = {"type": "rectangle", "bsdf": {"type": "bakedbsdf", "filename": "white"}}
    scene = mi.load_dict({"type": "scene", "shape": shape, "other": {"type": "sphere"}, "light": {"type": "constant"},
                          "integrator": {"type": "path", "max_depth": 2}, "sensor": {
                              "type": "perspective", "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
                              "film": {"type": "hdrfilm", "width": 4, "height": 4}}})
    assert np.isfinite(np.array(mi.render(scene, spp=1))).all() and refused


def test_a_layer_that_would_make_light_is_refused(monkeypatch):
    """Half of the light in a peak, over several mean free paths: counted as deflected once it would be more than there is."""
    looked_up, errors = table("bare")
    peaked = looked_up._replace(depth=np.full(3, 0.5), peak=np.full(3, 0.5))

    class Asset:
        wavelength = np.array(RGB)

        class surface:
            @staticmethod
            def table(layer):
                return peaked, errors

    assert layers.gained(looked_up) < 0.02 < layers.gained(peaked)
    with pytest.raises(UsageError, match="more light than it gets"):
        layers.layer_of(Asset)


# ---- layers on each other over air

WHITE = ((0.5, 1.0, 0.6, 1.33), (0.0, 1.0, 1.0, 1.5))  # g, albedo, depth, index


@cache
def solved_on_both_sides(media):
    """Solutions of a stack for light from above and from below, and their tables."""
    slab, wanted = stack(*media)
    above, below = solve(slab, wanted, 24, 1e-3), solve(upside_down(slab), wanted[::-1], 24, 1e-3)
    return (above, below), surface_table([above]), surface_table([below])


def two_sided(media, monkeypatch):
    """The plugin of a stack, and its solutions for light from above and from below."""
    (above, below), (front, errors), (back, _) = solved_on_both_sides(media)
    monkeypatch.setattr(layers, "load", lambda path, number: layers.Layer(np.array([0.55]), front, errors.largest, back))
    return plugin("stack"), (above, below)


@pytest.mark.slow
@pytest.mark.parametrize("variant", VARIANTS)
def test_both_sides_of_a_stack_are_the_solutions(variant, monkeypatch):
    mi.set_variant(variant)
    bsdf, (above, below) = two_sided(WHITE, monkeypatch)
    count = 10 if variant.startswith("scalar") else 300
    rng, under = np.random.default_rng(3), np.array([[1], [1], [-1]])
    (mu, mu0), (phi, turn) = rng.uniform(0.05, 1, (2, count)), rng.uniform(0, 2 * math.pi, (2, count))
    wi, wo = unit(np.arccos(mu0), turn), unit(np.arccos(mu), turn + math.pi + phi)
    for into, out, function in ((wi, wo, above.reflection), (wi, wo * under, above.transmission),
                                (wi * under, wo * under, below.reflection), (wi * under, wo, below.transmission)):
        values, density = values_of(bsdf, into, out)
        np.testing.assert_allclose(values, np.broadcast_to(function(mu, mu0, phi), values.shape), rtol=4e-3, atol=1e-5)
        assert (density > 0).all()


@on_each_device
@pytest.mark.parametrize("mu", [0.8, slow(-0.8), slow(0.2)])
def test_a_stack_loses_nothing(device, mu, monkeypatch):
    """Weights of samples of lossless layers, mirrored and unscattered light among them; single directions by themselves."""
    mi.set_variant(f"{device}_ad_rgb")
    bsdf, solved = two_sided(WHITE, monkeypatch)
    solution, wi = solved[mu < 0], np.array([math.sqrt(1 - mu * mu), 0.0, mu])
    _, weight, *_ = drawn(bsdf, mu, 100_000)
    # 5e-4: the table's own error; 6 standard errors: 2e-9 each
    assert abs(weight.mean() - 1) < 5e-4 + 6 * weight[0].std() / math.sqrt(weight.shape[1])
    mirrored, passed, _ = unscattered(solution.slab, solution.cuts, [abs(mu)])
    mirrored = mirrored + fresnel.reflected(abs(mu), solution.slab.index)
    for kind, towards, share in ((mi.BSDFFlags.DeltaReflection, wi * [-1, -1, 1], mirrored),
                                 (mi.BSDFFlags.DeltaTransmission, -wi, passed)):
        wo, weight, _, sampled = drawn(bsdf, mu, 8, types=kind)
        np.testing.assert_allclose(wo, np.tile(towards, (8, 1)).T, atol=1e-6)
        assert (sampled == int(kind)).all()
        np.testing.assert_allclose(weight[0], share[0], rtol=2e-3)


@pytest.mark.slow
@on_each_device
@pytest.mark.parametrize("theta", [0.35, 1.2, math.pi - 0.35, math.pi - 1.2])
@pytest.mark.parametrize("media", [((0.5, 0.99, 0.6, 1.0), (0.0, 0.9, 1.0, 1.5)), ((0.0, 0.9, 0.2, 1.5), (0.5, 0.9, 0.3, 1.0))])
def test_a_stack_over_air_is_volpaths(device, media, theta, monkeypatch):
    """Light of three rings of the sky, seen from above and from below, with what boundaries within mirror: 16 renders each."""
    mi.set_variant(f"{device}_ad_rgb")
    two_sided(media, monkeypatch)
    rings = under_rings(mi, theta) | {"integrator": {"type": "path", "max_depth": 2}}
    baked = {"type": "bakedbsdf", "filename": "stack"}
    plane = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(1e4), "bsdf": baked}
    scenes = planes(mi, media, None, theta), mi.load_dict(rings | {"plane": plane})
    values = np.array([[np.array(mi.render(scene, spp=4000, seed=k)).ravel()[:3] for k in range(16)] for scene in scenes])
    (expected, value), error = values.mean(axis=1), np.sqrt((values.var(axis=1, ddof=1) / 16).sum(axis=0))
    assert (np.abs(value - expected) < sigmas(16, comparisons=24) * error + 5e-3 * value).all(), (value, expected, error)


SLAB = """<scene version="3.0.0">
    <integrator type="volpath"> <integer name="max_depth" value="-1"/> <integer name="rr_depth" value="200"/> </integrator>
    {shapes} {light}
    <sensor type="orthographic"> <transform name="to_world"> <lookat origin="{eye}" target="0, 0, 0" up="0, 1, 0"/> </transform>
        <film type="hdrfilm"> <integer name="width" value="16"/> <integer name="height" value="16"/> <rfilter type="box"/>
            <string name="pixel_format" value="luminance"/> </film>
    </sensor></scene>"""
MEDIUM = """<medium type="homogeneous" name="interior"> <float name="sigma_t" value="1"/> <float name="albedo" value="{albedo}"/>
        <phase type="hg"> <float name="g" value="{g}"/> </phase> </medium>"""
WIDE = """<shape type="cube"> <transform name="to_world"> <scale x="1e4" y="1e4" z="40"/> <translate z="-40"/> </transform>
        {bsdf} {medium} </shape>"""
EVEN = '<emitter type="constant"> <float name="radiance" value="1"/> </emitter>'
SUN = """<emitter type="directional"> <vector name="direction" x="{x}" y="0" z="{z}"/>
        <float name="irradiance" value="1"/> </emitter>"""


def radiance(shapes, light, mu, phi, samples):
    """Mean of 256 pixels that see a slab from a direction, and its standard error."""
    eye = ", ".join(f"{10 * part:.9g}" for part in unit(math.acos(mu), phi))
    scene = mi.load_string(SLAB.format(shapes=shapes, light=light, eye=eye))
    pixels = np.array(mi.render(scene, spp=samples, seed=4))[..., 0].astype(float)
    return pixels.mean(), pixels.std() / 16


@pytest.mark.slow
@on_each_device
@pytest.mark.parametrize(("mu", "phi"), [(0.9, 0.5), (0.3, 0.0), (0.3, 2.5)])
def test_a_thick_slab_in_the_sun_is_volpaths(device, mu, phi):
    """Light scattered once, often and in between; six standard errors of both: 2e-9."""
    mi.set_variant(f"{device}_ad_mono")
    albedo, g, *_ = LAYERS["tinted"]
    sun = SUN.format(x=-0.6, z=-0.8)  # it comes from azimuth 0
    slab = WIDE.format(bsdf='<bsdf type="null"/>', medium=MEDIUM.format(albedo=albedo[1], g=g))
    plane = '<shape type="rectangle"> <transform name="to_world"> <scale value="1e4"/> </transform> {} </shape>'
    baked = plane.format('<bsdf type="bakedbsdf"> <string name="filename" value="tinted"/> '
                         '<integer name="channel" value="1"/> </bsdf>')
    expected, error = radiance(slab, sun, mu, phi, 1024)
    value, _ = radiance(baked, sun, mu, phi, 16)
    exact = float(solutions("tinted")[1].reflection(mu, 0.8, math.pi - phi)) * 0.8 / math.pi
    assert value == pytest.approx(exact, rel=2e-3)
    assert abs(value - expected) < 6 * error + 2e-3 * value and error < 0.01 * expected


@pytest.mark.slow
@on_each_device
@pytest.mark.parametrize("mu", [0.9, 0.3])
def test_paint_in_even_light_is_volpaths(device, mu):
    """A layer of depth 5 on a grey base under a smooth boundary."""
    mi.set_variant(f"{device}_ad_mono")
    albedo, g, depth, index, base, _ = LAYERS["paint"]
    glass = f'<bsdf type="dielectric"> <float name="int_ior" value="{index}"/> <float name="ext_ior" value="1"/> </bsdf>'
    floor = f"""<shape type="rectangle"> <transform name="to_world"> <scale value="9e3"/> <translate z="-{depth}"/> </transform>
        <bsdf type="diffuse"> <float name="reflectance" value="{base}"/> </bsdf> </shape>"""
    slab = WIDE.format(bsdf=glass, medium=MEDIUM.format(albedo=albedo[2], g=g)) + floor
    baked = """<shape type="rectangle"> <transform name="to_world"> <scale value="1e4"/> </transform>
        <bsdf type="bakedbsdf"> <string name="filename" value="paint"/> <integer name="channel" value="2"/> </bsdf> </shape>"""
    expected, error = radiance(slab, EVEN, mu, 0.0, 1024)
    value, own = radiance(baked, EVEN, mu, 0.0, 1024)
    assert abs(value - expected) < 6 * math.hypot(error, own) + 5e-4 and error < 0.005 * expected
