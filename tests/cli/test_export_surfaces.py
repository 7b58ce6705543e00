"""`bake export` of baked surfaces: what stock Mitsuba, pbrt's format, MaterialX and Blender make of them is the asset's, less
what is stated.

Draws are seeded.  Comparisons with chance fail a right program with the odds of `tests.odds`.
"""

import json
import math
import runpy
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

import bakery
from bakery.export.blender import surface_text
from bakery.physics.surfaces import fresnel, measured, principled
from bakery.physics.surfaces.by_view import by_view
from bakery.physics.surfaces.nodes import nodes
from bakery.physics.surfaces.spread import profile_within
from tests import pbrt
from tests.cli.test_export_blender import fake_bpy
from tests.odds import sigmas

RECIPE = """\
bakery: 1
name: coat
wavelengths: [0.61, 0.55, 0.465]
tolerance: 1%
medium: {{albedo: [0.99, 0.9, 0.6], mean_free_path: 1 mm, phase: {{type: hg, g: 0.3}}}}
surface: {surface}
"""
# name -> section, index of a mirror
SURFACES = {"gloss": ("{thickness: 3 mm, boundary: {index: 1.5}, base: {albedo: 20%}}", 1.5),
            "matt": ("{boundary: {index: 1.4, roughness: 0.3}}", 1.0), "sheet": ('{thickness: "[1, 3] mm"}', 1.0),
            "lighter": ("{boundary: {index: 0.8}}", 0.8)}


@pytest.fixture(scope="module")
def assets(tmp_path_factory):
    """Mapping of names to paths of assets, which are baked when they are asked for."""
    folder = tmp_path_factory.mktemp("surfaces")

    class Baked(dict):
        def __missing__(self, name):
            recipe = folder / f"{name}.yaml"
            recipe.write_text(RECIPE.format(surface=SURFACES[name][0]))
            self[name] = bakery.bake(recipe, folder / f"{name}.h5").path
            return self[name]

    return Baked()


@pytest.fixture
def export(assets, call, tmp_path):
    """Function of name and format to the folder of its files and the report."""
    def run(name, target):
        status, out, err = call("export", assets[name], "--to", target, "-o", tmp_path, "--json", "--overwrite")
        assert status == 0, err
        return tmp_path, [lost for lost in json.loads(out)["lost"] if "surface" in lost]
    return run


def even(count, seed):
    """Angles in, out and azimuth of light from all sides."""
    random = np.random.default_rng(seed)
    into, out = np.arccos(np.sqrt(random.random((2, count))))
    return into, out, math.pi * random.random(count)


# ---- tables


def tensors(path) -> dict:
    """Fields of a tensor file, read by its head."""
    data, at, fields = path.read_bytes(), 18, {}
    assert data[:12] == b"tensor_file\0" and data[12:14] == b"\1\0"
    for _ in range(struct.unpack_from("<I", data, 14)[0]):
        length, = struct.unpack_from("<H", data, at)
        name = data[at + 2:at + 2 + length].decode()
        rank, kind, where = struct.unpack_from("<HBQ", data, at + 2 + length)
        shape = struct.unpack_from(f"<{rank}Q", data, at + 13 + length)
        at += 13 + length + 8 * rank
        fields[name] = np.frombuffer(data, {1: np.uint8, 10: np.float32}[kind], math.prod(shape), where).reshape(shape)
    return fields


@pytest.mark.parametrize("name", ["gloss", pytest.param("matt", marks=pytest.mark.slow)])
def test_pbrt_gets_the_reflectance(name, export, assets):
    """By the format: spectra over the square of half vectors, times ndf over 4 sigma; mirrored light is named as lost."""
    folder, (lost,) = export(name, "pbrt")
    ((directive, names, given),) = pbrt.directives((folder / f"{name}_surface.pbrt").read_text())
    assert (directive, names) == ("MakeNamedMaterial", [f"{name}_surface"]) and given["type"] == ("string", ["measured"])
    fields = tensors(folder / given["filename"][1][0])
    assert fields["phi_i"].shape == (1,) and fields["ndf"].min() == fields["ndf"].max() == 1
    assert np.all(4 * fields["sigma"] == 1) and np.all(fields["vndf"] == 1)
    spectra, asset = fields["spectra"][0], bakery.open(assets[name])
    assert spectra.shape[:2] == (len(fields["theta_i"]), 3) and fields["luminance"].shape[2:] == spectra.shape[2:]
    assert np.allclose(fields["wavelengths"], [465, 550, 610])
    # at nodes of the table the asset's value to rounding: half vectors (u, v) and the light that they turn
    i, row, column = 5, 7, 20
    theta, turn = 0.5 * math.pi * (column / (spectra.shape[3] - 1)) ** 2, math.pi * (2 * row / (spectra.shape[2] - 1) - 1)
    into = np.array([math.sin(fields["theta_i"][i]), 0, math.cos(fields["theta_i"][i])])
    half = np.array([math.sin(theta) * math.cos(turn), math.sin(theta) * math.sin(turn), math.cos(theta)])
    out = 2 * (half @ into) * half - into
    expected = asset.surface.reflectance(fields["theta_i"][i], math.acos(out[2]), math.atan2(out[1], -out[0]))
    assert np.allclose(spectra[i, ::-1, row, column], expected * out[2] / math.pi, rtol=1e-4)
    mirrored = lost.get("mirrored", [0.0])[0]
    assert mirrored == pytest.approx(float(fresnel.reflected(1.0, SURFACES[name][1])))


def test_a_table_is_as_far_off_as_it_says():
    """Against other directions than those by which it was measured, and a lobe that no grid holds says so."""
    def smooth(theta_in, theta_out, phi):
        sines = np.sin(theta_in) * np.sin(theta_out)
        return np.stack([1 + 0.5 * np.cos(theta_in) * np.cos(theta_out) + 0.3 * sines * np.cos(phi)])

    def narrow(theta_in, theta_out, phi):
        return np.stack([1 + 100 * np.exp(-((theta_in - theta_out) ** 2 + (np.pi - phi) ** 2) / 2e-3)])

    for function, low, high in ((smooth, 0, 5e-3), (narrow, 0.01, 1)):
        table, at = measured.measured(function, [0.55]), even(20000, 3)
        true = function(*at)[0]
        off = 0.5 * np.abs(measured.looked_up(table, *at)[0] - true).mean() / true.mean()
        assert low <= table.losses.misdirected <= high
        assert off == pytest.approx(table.losses.misdirected, rel=0.5)


def test_many_wavelengths_get_a_coarser_grid():
    """At most 134 MB, and the error of that grid."""
    def smooth(theta_in, theta_out, phi):
        return np.ones((300, 1)) * (1 + np.cos(theta_in) * np.cos(theta_out) * np.cos(phi) ** 2)

    table = measured.measured(smooth, np.linspace(0.3, 1.0, 300))
    single = measured.measured(lambda *at: smooth(*at)[:1], [0.5], 1e-6)
    assert table.values.nbytes <= 4 * measured.MOST and table.values.shape[3] < single.values.shape[3]
    assert table.losses.misdirected > single.losses.misdirected


# ---- Mitsuba


def spectral():
    """Mitsuba in a variant that has `measured`."""
    renderer = pytest.importorskip("renderers.mitsuba", exc_type=ImportError)
    import mitsuba as mi

    if not any(name.startswith("llvm") for name in renderer.variants.choose().names):
        pytest.skip("no LLVM that Dr.Jit can use")
    mi.set_variant("llvm_ad_spectral")
    return mi


def at_directions(mi, bsdf, theta_in, theta_out, phi, nm):
    """BSDF times the cosine of exitance, (3, n)."""
    import drjit as dr

    si = dr.zeros(mi.SurfaceInteraction3f, len(phi))
    si.wi = mi.Vector3f(np.sin(theta_in), 0 * theta_in, np.cos(theta_in))
    si.wavelengths = type(si.wavelengths)(*nm, 600.0)
    wo = mi.Vector3f(np.sin(theta_out) * np.cos(math.pi - phi), np.sin(theta_out) * np.sin(math.pi - phi), np.cos(theta_out))
    return np.array(bsdf.eval(mi.BSDFContext(), si, wo))[:3]


def weights(mi, bsdf, theta, nm, count, seed):
    """Of samples, (3, n)."""
    import drjit as dr

    random = np.random.default_rng(seed).random((3, count)).astype(np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(math.sin(theta), 0, math.cos(theta))
    si.wavelengths = type(si.wavelengths)(*nm, 600.0)
    return np.array(bsdf.sample(mi.BSDFContext(), si, mi.Float(random[0]), mi.Point2f(random[1], random[2]))[1])[:3]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gloss", "matt", "sheet", "lighter"])
def test_stock_mitsuba_reflects_like_the_asset(name, export, assets):
    """Values, and by samples the albedo with what a smooth boundary mirrors; the plugin's fragment gives the asset's values."""
    folder, losses = export(name, "mitsuba")
    mi = spectral()
    asset, last = bakery.open(assets[name]), len(losses) - 1
    nm = [float(1e3 * um) for um in asset.wavelength]
    stem = f"{name}_surface" + (f"_{last}" if last else "")
    (folder / f"{name}.h5").write_bytes(Path(asset.path).read_bytes())
    mi.load_file(str(folder / f"{stem}.xml"), parallel=False)  # as it is written
    at = even(4000, 1)
    # away from the mirror, whose lobe is 0.005 rad wide: the normal between both directions
    apart = np.abs(np.exp(1j * (math.pi - at[2])) * np.sin(at[1]) + np.sin(at[0])) > 0.1
    at = [part[apart] for part in at]
    true = asset.surface.reflectance(*at, layer=last) * np.cos(at[1]) / math.pi
    bsdf = mi.load_dict(fragment(folder / f"{stem}.xml", folder))
    values = at_directions(mi, bsdf, *at, nm)
    lost = losses[-1]
    most = 0.1 if name == "lighter" else 0.02  # the critical angle is a jump
    assert np.abs(values - true).mean() / true.mean() < 3 * lost["misdirected"] < most
    plugin = mi.load_dict(fragment(folder / f"{stem}_plugin.xml", folder))
    assert np.abs(at_directions(mi, plugin, *at, nm) - true).mean() / true.mean() < 2e-3
    for theta in np.radians([0.0, 40.0, 75.0]):
        drawn = weights(mi, bsdf, theta, nm, 100000, 2)
        noise = sigmas(comparisons=9) * drawn.std(axis=1) / math.sqrt(drawn.shape[1])
        albedo = asset.surface.albedo(theta).reshape(3, -1)[:, last]
        assert np.all(np.abs(drawn.mean(axis=1) - albedo) < noise + albedo * lost["albedo"] + 1e-3)


def fragment(path, folder) -> dict:
    """The one BSDF of a scene file as Mitsuba's own parser has it."""
    from xml.etree import ElementTree

    def of(node):
        values = {"type": node.get("type")}
        for number, child in enumerate(node):
            if child.tag == "bsdf":
                values[f"nested_{number}"] = of(child)
            elif child.tag == "spectrum":
                values[child.get("name")] = {"type": "spectrum", "value": float(child.get("value"))}
            else:
                kind = {"float": float, "integer": int, "string": str}[child.tag]
                values[child.get("name")] = kind(child.get("value"))
        if "filename" in values:
            values["filename"] = str(folder / values["filename"])
        return values
    return of(ElementTree.parse(path).getroot().find("bsdf"))


# ---- fits


def test_a_white_base_keeps_all_light():
    """Of any roughness, to what its formula keeps: 5e-4."""
    directions = nodes(32)
    phi = math.pi * (np.arange(48) + 0.5) / 48
    mu, mu0, phi = np.meshgrid(directions.mu, directions.mu, phi, indexing="ij")
    for roughness in (0.0, 0.3, 1.0):
        albedo = np.einsum("i,ijk->j", directions.flux, principled.diffuse(mu, mu0, phi, 1.0, roughness)) / 48
        assert np.allclose(albedo, 1, atol=5e-4)


@pytest.mark.slow
def test_a_base_under_a_boundary_comes_back():
    """What is the model itself is fitted without loss; a lobe that it lacks is lost as it should be."""
    bands, colour = np.eye(3), np.array([[0.8], [0.4], [0.1]])

    def model(theta_in, theta_out, phi):
        mu, mu0 = np.cos(theta_out), np.cos(theta_in)
        return (1 - fresnel.reflected(mu, 1.4)) * principled.diffuse(mu, mu0, phi, colour, 0.35)

    fit = principled.principled(model, 1.4, 0.0, bands)
    assert np.allclose(fit.colour, colour.ravel(), rtol=1e-4) and fit.diffuse_roughness == pytest.approx(0.35)
    assert fit.misdirected.max() < 1e-4 and np.abs(fit.brightness_error).max() < 1e-4 and fit.clipped == 0
    # light that goes forward only: Lambert's base sends half of it back
    forward = principled.principled(lambda theta_in, theta_out, phi: np.full((3, 1), 0.5) * (1 + np.sign(np.cos(phi))), 1.0, 0.0,
                                    bands)
    assert forward.misdirected == pytest.approx(0.5, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gloss", pytest.param("matt", marks=pytest.mark.slow)])
def test_materialx_and_blender_hold_one_fit(name, export, assets, monkeypatch):
    mx = pytest.importorskip("MaterialX", reason="the package MaterialX is not installed (extra `exchange`)")
    folder, (lost,) = export(name, "materialx")
    document, library = mx.createDocument(), mx.createDocument()
    mx.readFromXmlFile(document, str(folder / f"{name}_surface.mtlx"))
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    document.importLibrary(library)
    assert document.validate() == (True, "")
    (material,) = document.getMaterialNodes()
    (shader,) = mx.getShaderNodes(material)
    definition = shader.getNodeDef()
    assert material.getName() == f"{name}_surface" and definition.getName() == "ND_open_pbr_surface_surfaceshader"
    inputs = {one.getName(): one.getValue() for one in shader.getInputs()}
    assert all(definition.getActiveInput(one.getName()).getType() == one.getType() for one in shader.getInputs())
    index, alpha = (1.5, 0.0) if name == "gloss" else (1.4, 0.3)
    assert inputs["specular_ior"] == pytest.approx(index) and inputs["specular_roughness"] == pytest.approx(math.sqrt(alpha))
    folder, (of_blender,) = export(name, "blender")
    assert of_blender["misdirected"] == lost["misdirected"] and max(lost["misdirected"]) < 0.12
    bpy, blender = fake_bpy(0)
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    runpy.run_path(str(folder / f"{name}_surface.py"))
    surface, = (node for node in blender.nodes if node.kind == "ShaderNodeBsdfPrincipled")
    assert np.allclose(surface.inputs["Base Color"].default_value[:3], inputs["base_color"].asTuple(), rtol=1e-6)
    assert surface.inputs["Diffuse Roughness"].default_value == pytest.approx(inputs["base_diffuse_roughness"])
    assert surface.inputs["IOR"].default_value == index and blender.tags == ["bakery"]
    assert "Subsurface Weight" not in surface.inputs
    # with SPREAD, by Cycles' own definition, the profile that is baked
    script = (folder / f"{name}_surface.py").read_text()
    (folder / "spread.py").write_text(script.replace("SPREAD = False", "SPREAD = True"))
    bpy, blender = fake_bpy(0)
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    runpy.run_path(str(folder / "spread.py"))
    surface, = (node for node in blender.nodes if node.kind == "ShaderNodeBsdfPrincipled")
    albedo, radius = (np.array(surface.inputs[key].default_value[:3]) for key in ("Base Color", "Subsurface Radius"))
    widths = 0.01 * radius / (4 * math.pi) / (1.9 - albedo + 3.5 * (albedo - 0.8) ** 2)
    assert surface.subsurface_method == "BURLEY"
    assert np.allclose(widths, 1e-6 * bakery.open(assets[name]).surface["profile"][:, 0], rtol=1e-5)
    # light reddens: the albedo falls from the first band to the last
    assert np.all(np.diff(inputs["base_color"].asTuple()) < 0)


def test_blender_gets_curves_over_the_angle_of_view(tmp_path, monkeypatch):
    """By the nodes that the script makes, Cycles' formulas and other directions: as far off as is stated."""
    def grazing(theta_in, theta_out, phi):  # light that one event sends back, here and there more of it forward
        return np.array([[0.7], [0.3], [0.1]]) * (1 + 0.5 * np.cos(phi) * np.sin(theta_in) * np.sin(theta_out)) \
            / (np.cos(theta_in) + np.cos(theta_out))

    layer = principled.Sampled(grazing, 1.0, 0.0, np.eye(3))
    fit, stated = principled.fitted(layer), by_view(layer)
    assert stated.better_than(fit) and np.all(stated.misdirected < 0.6 * fit.misdirected)
    assert np.abs(stated.brightness_error).max() < 0.01 < 0.2 < np.abs(fit.brightness_error).max()
    (tmp_path / "grazing.py").write_text(surface_text("grazing", fit, [], None, stated))
    bpy, blender = fake_bpy(0)
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    runpy.run_path(str(tmp_path / "grazing.py"))
    by_kind = {node.kind: node for node in blender.nodes}
    view, base, glossy, both, output = (by_kind[f"ShaderNode{name}"] for name in (
        "LayerWeight", "BsdfPrincipled", "BsdfAnisotropic", "AddShader", "OutputMaterial"))
    ramps = [node for node in blender.nodes if node.kind == "ShaderNodeValToRGB"]
    assert view.inputs["Blend"].default_value == 0.5 and glossy.distribution == "GGX"
    assert all((view.outputs["Facing"], ramp.inputs[0]) in blender.links for ramp in ramps)
    ends = {id(end): start for start, end in blender.links}  # of several links of a socket the last one stays
    assert ends[id(output.inputs["Surface"])] == both.outputs[0]
    assert [ends[id(both.inputs[k])] for k in (0, 1)] == [base.outputs[0], glossy.outputs[0]]
    assert [ends[id(socket)] for socket in (base.inputs["Base Color"], glossy.inputs["Color"])] \
        == [ramp.outputs["Color"] for ramp in ramps]
    assert base.inputs["Diffuse Roughness"].default_value == base.inputs["Specular IOR Level"].default_value == 0
    into, out, phi = even(20000, 4)
    m0, m = np.cos(into), np.cos(out)
    colours = [np.stack([np.interp(1 - m, [stop.position for stop in ramp.color_ramp.elements], channel)
                         for channel in np.transpose([stop.color[:3] for stop in ramp.color_ramp.elements])]) for ramp in ramps]
    assert all(colour.min() >= 0 and colour.max() <= 1 for colour in colours)
    # kernel/closure/bsdf_microfacet.h: D / (4 cos cos (1 + lambda + lambda)), roughness the root of alpha
    alpha2 = glossy.inputs["Roughness"].default_value ** 4
    ahead = np.stack([np.sin(into) + np.sin(out) * np.cos(math.pi - phi), np.sin(out) * np.sin(phi), m0 + m])
    half = ahead[2] / np.linalg.norm(ahead, axis=0)
    masked = 1 + sum(0.5 * (np.sqrt(1 + alpha2 * (1 / x**2 - 1)) - 1) for x in (m, m0))
    lobe = alpha2 / (1 + (alpha2 - 1) * half**2) ** 2 / (4 * m * m0 * masked)
    true = grazing(into, out, phi)
    off = np.abs(colours[0] + colours[1] * lobe - true)
    assert np.allclose(0.5 * off.mean(axis=1) / true.mean(axis=1), stated.misdirected, rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "better"), [("sheet", True), ("gloss", False)])
def test_curves_are_written_where_they_are_better(name, better, export):
    folder, (*_, lost) = export(name, "blender")
    assert ("by_view" in lost) == better == ("LOOK_UP = True" in (folder / f"{name}_surface{'_1' * better}.py").read_text())
    if better:
        assert np.all(np.array(lost["by_view"]["misdirected"]) < 0.9 * np.array(lost["misdirected"]))
    else:  # the base is not darkened by what the boundary mirrors of light that comes in: said
        assert np.abs(lost["albedo_error"]).max() > 0.2 > 0.1 > np.abs(lost["brightness_error"]).max()


@pytest.mark.slow
def test_a_band_of_wavelengths_gets_the_profile_nearest_to_its_light(call, tmp_path):
    """Not the mean of theirs: two that spread tenfold differently have none that is as near as each had, and that is stated."""
    recipe = tmp_path / "two.yaml"
    recipe.write_text(RECIPE.format(surface="{}").replace("[0.61, 0.55, 0.465]", "[0.40, 0.42, 0.44, 0.46]").replace(
        "[0.99, 0.9, 0.6]", "[0.2, 0.99, 0.2, 0.99]").replace("coat", "two"))
    asset = bakery.bake(recipe, tmp_path / "two.h5")
    status, out, err = call("export", asset.path, "--to", "blender", "-o", tmp_path / "out", "--json")
    assert status == 0, err
    lost = next(lost for lost in json.loads(out)["lost"] if "surface" in lost)
    from renderers.colour import band_matrix

    blue, radius = band_matrix(asset.wavelength)[2], np.geomspace(1e-5, 1, 300)
    light = blue * asset.surface.spherical_albedo.reshape(-1)
    within = light @ asset.surface.spread_within(1e6 * radius) / light.sum()
    off = np.abs(profile_within(radius, lost["profile"][2]) - within).max()
    assert off <= lost["profile_misfit"] + 2e-3 and off < 0.1
    # no other width is nearer
    assert off < 2e-3 + min(np.abs(profile_within(radius, lost["profile"][2] * factor) - within).max() for factor in (0.8, 1.25))


@pytest.mark.slow
def test_blender_takes_no_index_below_1(export):
    """It clips them to 1, without which light from beyond the critical angle comes out: the fit is of that, and says so."""
    folder, (lost,) = export("lighter", "blender")
    script = (folder / "lighter_surface.py").read_text()
    assert "takes no index below 1; light that the smooth boundary mirrors" in script and "'Specular IOR Level': 0.0" in script
    assert max(lost["misdirected"]) > 0.5 and np.abs(lost["brightness_error"]).max() < 1e4
