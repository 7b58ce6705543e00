"""`bake export --to pbrt`, `materialx`, `usd`: what other programs read from the files is the medium, less what is stated."""

import json
import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from bakery.export.bands import beyond
from bakery.export.mixture import Loss, Mixture, identifier
from bakery.export.openpbr import observed_colour
from bakery.physics.medium.lobe_fits import best_hg
from bakery.physics.medium.lobes import Lobes, misfit
from bakery.physics.medium.phase import cumulative, normalised, phase_at
from bakery.store.tree import Dataset
from bakery.store.write import write
from renderers.colour import BANDS
from tests import pbrt
from tests.samples import small_asset, with_member

NO_MATERIALX = "the package MaterialX is not installed (extra `exchange`)"
NO_USD = "the package usd-core is not installed (extra `exchange`)"


def henyey_greenstein(g, angle):
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * np.cos(angle)) ** 1.5)


@pytest.fixture(scope="module")
def root():
    """Wavelengths that descend, 0.61 and 0.465 um; g about 0.8 and 0.7; absorption that single precision keeps."""
    tree = small_asset()
    return with_member(tree, "medium/sigma_a", Dataset(0.2 * tree["medium/sigma_s"].data, "1/m", "absorption coefficient"))


@pytest.fixture(scope="module")
def fog(tmp_path_factory, root):
    path = tmp_path_factory.mktemp("export") / "fog.h5"
    write(path, root)
    return path


def mean_g(tree) -> float:
    sigma_s = tree["medium/sigma_s"].data
    return float(sigma_s @ tree["medium/g"].data / sigma_s.sum())


# ---- pbrt

NM = np.arange(360, 831)  # what pbrt samples


def test_pbrt_reads_the_medium(call, fog, root, tmp_path):
    status, out, err = call("export", fog, "--to", "pbrt", "-o", tmp_path, "--json")
    report = json.loads(out)
    # one g for a medium with 0.8 and 0.7
    warning = "fog.pbrt: reduced scattering is off by +25 % at 0.61 um, and thick media with it"
    assert status == 0 and report["warnings"] == [warning] and err == f"warning: {warning}\n"
    assert report["files"] == [str(tmp_path / "fog.pbrt")]
    text = (tmp_path / "fog.pbrt").read_text()
    ((directive, names, given),) = pbrt.directives(text)
    assert (directive, names) == ("MakeNamedMedium", ["fog"])
    found, um, medium = pbrt.homogeneous(given), root["wavelength"].data, root["medium"]
    assert set(found) == {"sigma_a", "sigma_s", "g", "scale"} and found["scale"] == ("float", [1.0])
    for name in ("sigma_a", "sigma_s"):
        # as Bakery has them, the first and the last value beyond the asset's wavelengths
        expected = np.interp(NM, 1e3 * um[::-1], medium[name].data[::-1])
        assert np.allclose(pbrt.spectrum(found[name], NM), expected, rtol=2e-7, atol=0)
    g = found["g"][1][0]
    assert found["g"][0] == "float" and g == pytest.approx(mean_g(root), abs=1e-7)
    # how it is used, as its comment says
    scene = pbrt.directives("\n".join(line[3:] for line in text.splitlines() if line.startswith("#   ")))
    assert [directive for directive, *_ in scene] == ["Include", "AttributeBegin", "MediumInterface", "Material", "Shape",
                                                      "AttributeEnd"] and scene[2][1] == ["fog", ""]
    theta = np.union1d(np.geomspace(1e-6, math.pi, 20000), np.linspace(0, math.pi, 20000))
    for i, lost in enumerate(report["lost"]):
        own = phase_at(medium["theta"].data, medium["phase"].data[i], theta)
        share = math.pi * np.trapezoid(np.abs(henyey_greenstein(g, theta) - own) * np.sin(theta), theta)
        assert lost["wavelength"] == um[i] and lost["misdirected"] == pytest.approx(share, abs=1e-4) and share > 0.01
        assert lost["reduced"] == pytest.approx((1 - g) / (1 - medium["g"].data[i]) - 1, abs=1e-6)
    said = call("export", fog, "--to", "pbrt", "-o", tmp_path)[2]
    assert "misdirected" in said and "at 0.465 um" in said


@pytest.mark.parametrize("text", [
    'MakeNamedMedium fog', 'MakeMedium "fog"', 'MakeNamedMedium "fog', 'MakeNamedMedium "f\\og"',
    'MakeNamedMedium "fog" "float" 1',
    'MakeNamedMedium "fog" "float g" [ 1', 'MakeNamedMedium "fog" "float g" nan', 'MakeNamedMedium "fog" "float g" 1#',
    'MakeNamedMedium "fog" "float g" "1"', 'MakeNamedMedium "fog" "real g" 1', 'MakeNamedMedium "fog" "float g" []',
    'MakeNamedMedium "fog" "float g" 1_0', 'MakeNamedMedium "fog" "string type" [ "a" 1 ]'])
def test_the_grammar_refuses_what_pbrt_refuses(text):
    with pytest.raises(pbrt.Refused):
        pbrt.directives(text)


@pytest.mark.parametrize("text", [
    '"string type" "fog"', '"string type" "homogeneous" "float h" 1', '"string type" "homogeneous" "float sigma_a" 1',
    '"string type" "homogeneous" "float g" [ 1 2 ]'])
def test_a_medium_refuses_what_pbrt_refuses(text):
    ((_, _, given),) = pbrt.directives(f'MakeNamedMedium "fog" {text} # comment "here"')
    with pytest.raises(pbrt.Refused):
        pbrt.homogeneous(given)


def test_pbrt_takes_nothing_beyond_the_pairs_and_refuses_their_disorder():
    assert pbrt.spectrum(("spectrum", [400.0, 1.0, 500.0, 3.0]), [399, 450, 501]).tolist() == [0, 2, 0]
    for pairs in ([400.0, 1.0, 400.0, 1.0], [500.0, 1.0, 400.0, 1.0], [400.0, 1.0, 500.0]):
        with pytest.raises(pbrt.Refused):
            pbrt.spectrum(("spectrum", pairs), [450])


def test_one_wavelength_in_pbrt(call, root, tmp_path):
    """The medium at every wavelength that pbrt samples."""
    one = with_member(root, "wavelength", Dataset(np.array([0.9]), "um", "wavelength"))
    for name, member in root["medium"].members.items():
        if member.data.shape[0] == 2:
            one = with_member(one, f"medium/{name}", Dataset(member.data[:1], member.units, name))
    write(tmp_path / "one.h5", with_member(one, "optics", None))
    assert call("export", tmp_path / "one.h5", "--to", "pbrt")[0] == 0
    ((_, _, given),) = pbrt.directives((tmp_path / "one-pbrt" / "one.pbrt").read_text())
    sigma_s = pbrt.spectrum(pbrt.homogeneous(given)["sigma_s"], NM)
    assert np.allclose(sigma_s, root["medium/sigma_s"].data[0], rtol=2e-7, atol=0)


def test_a_lobe_of_little_use_is_said_first(call, root, tmp_path):
    theta = root["medium/theta"].data
    phase = normalised(theta, henyey_greenstein(np.array([[0.95], [0.0]]), theta))[0]
    write(tmp_path / "odd.h5", with_member(root, "medium/phase", Dataset(phase, "1/sr", "phase function")))
    status, _, err = call("export", tmp_path / "odd.h5", "--to", "pbrt")
    assert status == 0 and re.match(r"warning: odd\.pbrt: one lobe sends \d\d % of the light", err)
    # thick media are off by the factor of ten and more that (1 - g) sigma_s is
    assert "right, thin ones" not in err and re.search(r"reduced scattering is off by \S+ % at 0.61 um, and thick media", err)


def test_thick_media_are_right_where_the_reduced_scattering_is():
    """Half of the light in a forward peak: one lobe of the right g misdirects much, and thick media are right."""
    theta = np.union1d(np.geomspace(1e-6, math.pi, 4000), np.linspace(0, math.pi, 400))
    phase = 0.5 * henyey_greenstein(0.999, theta) + 0.5 * henyey_greenstein(0.5, theta)
    lobe = Lobes((1.0,), (0.75,), (0.0,))
    lost = misfit(theta, normalised(theta, phase)[0], lobe)

    def said(reduced):
        losses = tuple(Loss(lost, error, 0.0) for error in (0.0, reduced))
        return Mixture(np.array([0.5, 1.0]), np.ones(2), np.ones(2), lobe, losses, 0.0, 0.0).useless()

    (line,) = said(-0.05)
    assert line.endswith("thick media are about right, thin ones and halos around lamps are not")
    (line,) = said(-0.15)
    assert line.endswith("; thin media and halos around lamps are not right")
    assert said(-0.25)[1:] == ["reduced scattering is off by -25 % at 1 um, and thick media with it"]


@pytest.mark.parametrize(("target", "file", "g"), [("pbrt", "steep.pbrt", 0.9995), ("materialx", "steep.mtlx", 0.9995),
                                                   ("blender", "steep.py", 0.9995)])
def test_a_lobe_that_a_format_cannot_hold_is_warned_of(call, root, tmp_path, target, file, g):
    """Formats clip g, and thick media scatter by a multiple of what they should."""
    theta = np.union1d(np.concatenate([[0.0], np.geomspace(1e-7, math.pi, 4000)]), root["medium/theta"].data)
    phase = np.tile(normalised(theta, henyey_greenstein(g, theta))[0], (2, 1))
    tree = with_member(with_member(root, "optics", None), "medium/theta", Dataset(theta, "rad", "theta"))
    for name, data in {"phase": phase, "cdf": cumulative(theta, phase), "phase_bias": 0 * phase}.items():
        tree = with_member(tree, f"medium/{name}", Dataset(data, root[f"medium/{name}"].units, name))
    for name in {"s11", "s12", "s33", "s34"} & root["medium"].members.keys():
        tree = with_member(tree, f"medium/{name}", None)
    write(tmp_path / "steep.h5", tree)
    status, out, err = call("export", tmp_path / "steep.h5", "--to", target, "-o", tmp_path / "o", "--json")
    assert status == 0 and "about right" not in err
    assert any(line.startswith(f"{file}: reduced scattering is off by +") for line in json.loads(out)["warnings"])


TARGETS = {"pbrt": "fog.pbrt", "materialx": "fog.mtlx", "usd": "fog.usda", "blender": "fog.py", "mitsuba": "fog.xml"}


@pytest.mark.parametrize(("um", "said", "targets"), [
    ((1.0, 1.5), "red, green and blue (0.4 to 0.7 um) lie beyond the asset's wavelengths, 1 to 1.5 um, and have the values at "
                 "1 um", TARGETS),
    ((0.7, 0.5), "blue (0.4 to 0.5 um) lies beyond the asset's wavelengths, 0.5 to 0.7 um, and has the values at 0.5 um",
     ["mitsuba"]),
    ((0.35, 0.45), "red and green (0.5 to 0.7 um) lie beyond the asset's wavelengths, 0.35 to 0.45 um, and have the values at "
                   "0.45 um", ["mitsuba"]),
    ((0.69, 0.49), "", ["mitsuba"]),
])
def test_bands_beyond_the_wavelengths_are_warned_of(call, root, tmp_path, um, said, targets):
    write(tmp_path / "fog.h5", with_member(root, "wavelength", Dataset(np.array(um), "um", "wavelengths in vacuum")))
    for target in targets:
        out = call("export", tmp_path / "fog.h5", "--to", target, "-o", tmp_path / "o", "--json")[1]
        found = [line for line in json.loads(out)["warnings"] if "beyond" in line]
        assert found == ([f"{TARGETS[target]}: {said}"] if said else [])
    out = call("export", tmp_path / "fog.h5", "--to", "mitsuba", "--each-wavelength", "-o", tmp_path / "o", "--json")[1]
    assert not any("beyond" in line for line in json.loads(out)["warnings"])


def test_one_wavelength_is_grey_and_three_colours_are_the_channels():
    bands = dict(zip(("red", "green", "blue"), BANDS, strict=True))
    assert beyond([1.0], bands) == beyond([0.58, 0.5, 0.4], bands) == beyond([0.61, 0.55, 0.465], bands) == []


@pytest.mark.parametrize(("name", "plain"), [("fog", "fog"), ('a" "b\n', "a___b_"), ("2nd", "_2nd"), ("--", "__"), ("", "_"),
                                             ("né", "n_")])
def test_names_are_identifiers(name, plain):
    assert identifier(name) == plain


# ---- OpenPBR in MaterialX and USD

def coefficients(volume: dict) -> tuple:
    """sigma_t, sigma_s as the specification of OpenPBR has them, in single precision."""
    depth = np.float32(volume["transmission_depth"])
    colour, scatter = (np.array(volume[f"transmission_{key}"], np.float32) for key in ("color", "scatter"))
    return -np.log(colour) / depth, scatter / depth


def assert_is(root, volume: dict, subsurface: dict) -> None:
    """That the inputs of two surfaces are the medium, averaged over a red, a green and a blue band."""
    from renderers.colour import band_matrix

    bands, medium = band_matrix(root["wavelength"].data), root["medium"]
    sigma_t, sigma_s = (bands @ x for x in (medium["sigma_a"].data + medium["sigma_s"].data, medium["sigma_s"].data))
    assert volume["transmission_weight"] == subsurface["subsurface_weight"] == 1
    assert volume["specular_ior"] == subsurface["specular_ior"] == 1
    extinction, scattering = coefficients(volume)
    assert np.allclose(extinction, sigma_t, rtol=2e-6, atol=0) and np.allclose(scattering, sigma_s, rtol=1e-6, atol=0)
    g = volume["transmission_scatter_anisotropy"]
    assert g == subsurface["subsurface_scatter_anisotropy"] == pytest.approx(mean_g(root), abs=1e-6)
    path = subsurface["subsurface_radius"] * np.array(subsurface["subsurface_radius_scale"])
    assert np.allclose(1 / path, sigma_t, rtol=1e-6, atol=0)
    # the specification's inversion
    c = np.array(subsurface["subsurface_color"])
    s = 4.09712 + 4.20863 * c - np.sqrt(9.59217 + 41.6808 * c + 17.7126 * c * c)
    assert np.allclose((1 - s * s) / (1 - g * s * s), sigma_s / sigma_t, rtol=1e-4, atol=0)
    assert all(0 <= x <= 1 for key in ("transmission_color", "transmission_scatter") for x in volume[key])


@pytest.fixture(scope="module")
def exported(tmp_path_factory, fog):
    """The files of both formats, by name."""
    from bakery.cli import status_of

    folder = tmp_path_factory.mktemp("openpbr")
    for target in ("materialx", "usd"):
        assert status_of(["export", str(fog), "--to", target, "-o", str(folder)]) == 0
    return folder / "fog.mtlx", folder / "fog.usda"


def test_both_texts_hold_the_medium(exported, root):
    mtlx, usda = exported
    found = {}
    for node in ElementTree.parse(mtlx).getroot().iter("open_pbr_surface"):
        found[node.get("name")] = {one.get("name"): json.loads(f"[{one.get('value')}]") for one in node.iter("input")}
    for inputs in found.values():
        inputs |= {key: value[0] for key, value in inputs.items() if len(value) == 1}
    assert_is(root, found["fog_volume_surface"], found["fog_subsurface_surface"])
    lines = re.findall(r"(float|color3f) inputs:(\w+) = \(?([^)\n]+)", usda.read_text())
    values = {key: json.loads(f"[{text}]") for _, key, text in lines}
    assert all(len(values[key]) == {"float": 1, "color3f": 3}[kind] for kind, key, _ in lines)
    for inputs in found.values():
        assert all(np.array_equal(np.ravel(value), values[key]) for key, value in inputs.items())


def test_materialx_reads_it(exported, root):
    mx = pytest.importorskip("MaterialX", reason=NO_MATERIALX)
    document, library = mx.createDocument(), mx.createDocument()
    mx.readFromXmlFile(document, str(exported[0]))
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    document.importLibrary(library)
    assert document.validate() == (True, "") and document.getActiveColorSpace() == "lin_rec709"
    found = {}
    for material in document.getMaterialNodes():
        (shader,) = mx.getShaderNodes(material)
        definition = shader.getNodeDef()
        assert definition.getName() == "ND_open_pbr_surface_surfaceshader"
        for one in shader.getInputs():
            assert definition.getActiveInput(one.getName()).getType() == one.getType()
        found[material.getName()] = {one.getName(): value if isinstance(value := one.getValue(), float) else value.asTuple()
                                     for one in shader.getInputs()}
    assert_is(root, found["fog_volume"], found["fog_subsurface"])


def test_usd_reads_it(exported, root):
    pytest.importorskip("pxr", reason=NO_USD)
    from pxr import Usd, UsdGeom, UsdShade, UsdValidation

    stage = Usd.Stage.Open(str(exported[1]))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1 and stage.GetDefaultPrim().GetName() == "fog"
    wrong = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators()).Validate(stage)
    # the package is built without MaterialX's nodes and does not know the shader; test_materialx_reads_it looks the name up
    assert {error.GetName() for error in wrong} <= {"MissingShaderIdInRegistry"}
    found = {}
    for kind in ("volume", "subsurface"):
        shader, output, _ = UsdShade.Material(stage.GetPrimAtPath(f"/fog/{kind}")).ComputeSurfaceSource("mtlx")
        assert shader.GetIdAttr().Get() == "ND_open_pbr_surface_surfaceshader" and output == "out"
        found[kind] = {one.GetBaseName(): value if isinstance(value := one.Get(), float) else tuple(value)
                       for one in shader.GetInputs()}
    assert_is(root, found["volume"], found["subsurface"])


@pytest.mark.parametrize("target", ["pbrt", "materialx", "usd", pytest.param("blender", marks=pytest.mark.slow)])
def test_media_that_nothing_happens_in(call, root, target, tmp_path):
    """No collisions, and only absorption: numbers, and none of them infinite."""
    for name, absorption in (("empty", 0.0), ("black", 3.0)):
        tree = root
        for key, value in (("sigma_s", 0.0), ("sigma_a", absorption), ("sigma_t", absorption), ("albedo", 0.0)):
            tree = with_member(tree, f"medium/{key}", Dataset(np.full(2, value), root[f"medium/{key}"].units, key))
        write(tmp_path / f"{name}.h5", tree)
        status, out, _ = call("export", tmp_path / f"{name}.h5", "--to", target)
        assert status == 0
        with open(out.strip()) as file:
            text = file.read()
        assert not re.search(r"\b(nan|inf)\b", text) and ("= 0\n" in text or ", 0" in text or " 0 " in text)


def test_colour_of_a_half_space():
    """Against the exact plane albedo for diffuse light and isotropic scattering (Chandrasekhar's H)."""
    assert observed_colour(1.0, 0.5) == 1 and observed_colour(0.0, 0.5) < 1e-2
    mu = (np.polynomial.legendre.leggauss(64)[0] + 1) / 2
    weight = np.polynomial.legendre.leggauss(64)[1] / 2
    for albedo in (0.3, 0.8, 0.99):
        h = np.ones_like(mu)
        for _ in range(400):
            h = 1 / (math.sqrt(1 - albedo) + albedo / 2 * (weight * mu * h / (mu[:, None] + mu)).sum(axis=1))
        reflected = 1 - 2 * math.sqrt(1 - albedo) * np.sum(weight * mu * h)
        assert observed_colour(albedo, 0.0) == pytest.approx(reflected, abs=0.0025)


def test_the_best_lobe_within_a_bound(root):
    theta, phase = root["medium/theta"].data, root["medium/phase"].data[0]
    assert best_hg(theta, phase) == pytest.approx(0.8, abs=1e-3) and best_hg(theta, phase, 0.5) == pytest.approx(0.5, abs=1e-6)
