"""`bake export --to blender`: the script's numbers are the medium, less what is stated, and Cycles renders it as Mitsuba does."""

import ast
import json
import math
import os
import runpy
import subprocess
import sys
from collections import defaultdict
from types import SimpleNamespace

import numpy as np
import pytest

from bakery.physics.medium.lobes import Lobes
from bakery.physics.medium.phase import cumulative, mean_cosine, normalised, phase_at
from bakery.store.write import write
from renderers.colour import band_matrix
from tests import pbrt
from tests.conftest import ROOT
from tests.slab import SIGMA_A, SIGMA_S, in_mitsuba, medium_of_lobes, once, with_medium

NO_BLENDER = "BAKERY_BLENDER names no Python that has bpy: `make test-blender` installs one and runs this"
LOBES = Lobes((0.6, 0.4), (0.9, 0.4), (0.0, 6.0))


@pytest.fixture(scope="module")
def root():
    """Of lobes that Cycles has."""
    return medium_of_lobes(LOBES)


@pytest.fixture(scope="module")
def fog(tmp_path_factory, root):
    path = tmp_path_factory.mktemp("blender") / "fog.h5"
    write(path, root)
    return path


def constants(text: str) -> dict:
    """NAME = …, …, of the script."""
    return {node.targets[0].id: ast.literal_eval(node.value) for node in ast.parse(text).body
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id.isupper()}


def test_the_script_holds_the_medium(call, fog, root, tmp_path):
    status, out, err = call("export", fog, "--to", "blender", "-o", tmp_path, "--json")
    report = json.loads(out)
    assert status == 0 and not err and report["warnings"] == [] and report["files"] == [str(tmp_path / "fog.py")]
    found = constants((tmp_path / "fog.py").read_text())
    bands = band_matrix(root["wavelength"].data)
    assert found["NAME"] == "fog" and np.allclose(found["ABSORPTION"], bands @ SIGMA_A, rtol=1e-8)
    scattering, g, alpha = zip(*found["LOBES"], strict=True)
    assert np.allclose(np.sum(scattering, axis=0), bands @ SIGMA_S, rtol=1e-8)
    share = np.array(scattering)[:, 0] / (bands @ SIGMA_S)[0]
    mixture = Lobes(tuple(share), g, alpha)
    # the lobes that it was made of come back, as far as 400 angles of the table tell
    theta = np.radians([0, 1, 5, 20, 60, 90, 120, 180])
    assert np.allclose(mixture(theta), LOBES(theta), rtol=0.02)
    assert mixture.mean_cosine == pytest.approx(root["medium/g"].data[0], abs=1e-6)
    for lost in report["lost"]:
        assert lost["misdirected"] < 3e-3 and abs(lost["reduced"]) < 1e-5 and lost["unscattered"] == 0


class Outputs(dict):
    """By name or number."""

    def __init__(self, kind):
        super().__init__({0: f"{kind} {id(self)} out"})

    def __missing__(self, name):
        return f"{self[0]} {name}"


class Stops(list):
    """Of a colour ramp, which has two at first and sorts those that are added."""

    def __init__(self):
        super().__init__(SimpleNamespace(position=x, color=None) for x in (0.0, 1.0))

    def new(self, position):
        assert 0 <= position <= 1 and len(self) < 32
        self.append(SimpleNamespace(position=position, color=None))
        self.sort(key=lambda stop: stop.position)


class FakeNode(SimpleNamespace):
    """A node with sockets by name, which are made when they are asked for."""

    def __init__(self, kind):
        super().__init__(kind=kind, inputs=defaultdict(SimpleNamespace), outputs=Outputs(kind))
        if kind == "ShaderNodeValToRGB":
            self.color_ramp = SimpleNamespace(elements=Stops())


def fake_bpy(bounces, version=(5, 0, 0)):
    """What the script asks of Blender, as far as it is written down in Blender's Python reference; the material is kept."""
    nodes, links, tags = [], [], []
    material = SimpleNamespace(asset_data=None, node_tree=SimpleNamespace(
        nodes=SimpleNamespace(clear=nodes.clear, new=lambda kind: nodes.append(FakeNode(kind)) or nodes[-1]),
        links=SimpleNamespace(new=lambda start, end: links.append((start, end)))))
    metadata = SimpleNamespace(tags=SimpleNamespace(new=lambda name, skip_if_exists=False: tags.append(name)))
    material.asset_mark = lambda: setattr(material, "asset_data", metadata)
    cycles = SimpleNamespace(volume_bounces=bounces, max_bounces=12)
    scene = SimpleNamespace(unit_settings=SimpleNamespace(scale_length=0.01), cycles=cycles)
    bpy = SimpleNamespace(app=SimpleNamespace(version=version, version_string="5.0.0"), context=SimpleNamespace(scene=scene),
                          data=SimpleNamespace(materials=SimpleNamespace(get=lambda name: material)))
    return bpy, SimpleNamespace(nodes=nodes, links=links, tags=tags, material=material, cycles=cycles)


@pytest.mark.parametrize(("options", "bounces"), [((), 0), (("--index", "1.35", "--roughness", "0.09"), 2000)])
def test_the_script_runs(options, bounces, call, fog, root, tmp_path, monkeypatch):
    """Volume, surface, bounces and mark; what the scene allows already is not taken back."""
    assert call("export", fog, "--to", "blender", "-o", tmp_path, *options)[0] == 0
    bpy, blender = fake_bpy(bounces)
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    constants_of = runpy.run_path(str(tmp_path / "fog.py"))
    by_kind = {node.kind: node for node in blender.nodes}
    output, volume = by_kind["ShaderNodeOutputMaterial"], by_kind["ShaderNodeAddShader"]
    assert (volume.outputs[0], output.inputs["Volume"]) in blender.links and blender.tags == ["bakery"]
    bands = band_matrix(root["wavelength"].data)
    coefficients = [node.inputs for node in blender.nodes if node.kind == "ShaderNodeVolumeCoefficients"]
    assert np.allclose(sum(np.array(one["Scatter Coefficients"].default_value) for one in coefficients), 0.01 * bands @ SIGMA_S)
    albedo = (bands @ SIGMA_S / (bands @ (SIGMA_S + SIGMA_A))).max()
    assert albedo ** constants_of["BOUNCES"] <= 0.01 < albedo ** (constants_of["BOUNCES"] - 1)
    assert blender.cycles.volume_bounces == max(bounces, constants_of["BOUNCES"])
    assert blender.cycles.max_bounces == max(12, constants_of["BOUNCES"])
    if not options:
        assert "ShaderNodeBsdfGlass" not in by_kind and blender.material.asset_data.description == "Baked medium, no surface"
        return
    glass = by_kind["ShaderNodeBsdfGlass"]
    assert (glass.outputs[0], output.inputs["Surface"]) in blender.links
    assert "index 1.35" in blender.material.asset_data.description
    assert glass.inputs["IOR"].default_value == 1.35 and glass.inputs["Roughness"].default_value == pytest.approx(0.3)


def narrow(root):
    """Half of the light in a peak of half a degree, 45 % at the other wavelength."""
    theta = root["medium/theta"].data
    peak = normalised(theta, np.exp(-0.5 * (theta / math.radians(0.4)) ** 2))[0]
    broad = normalised(theta, Lobes((1.0,), (0.6,), (0.0,))(theta))[0]
    share = np.array([[0.5], [0.45]])
    phase = share * peak + (1 - share) * broad
    return with_medium(root, phase=phase, cdf=cumulative(theta, phase), g=mean_cosine(theta, phase))


def test_a_forward_peak_may_count_as_unscattered(call, root, tmp_path):
    """One lobe is then right for the rest; sigma_s and sigma_t lose each wavelength's share, thick media stay as they were."""
    tree = narrow(root)
    write(tmp_path / "peak.h5", tree)
    args = ("export", tmp_path / "peak.h5", "--to", "pbrt", "-o", tmp_path)
    plain, said = json.loads(call(*args, "--json")[1])["lost"], call(*args)[2]
    assert min(lost["misdirected"] for lost in plain) > 0.4
    assert "--unscattered-within 2deg would misdirect" in said
    folded = json.loads(call(*args, "--unscattered-within", "2deg", "--json")[1])["lost"]
    for lost, share in zip(folded, (0.5, 0.45), strict=True):
        assert lost["misdirected"] < 0.02 and lost["unscattered"] == pytest.approx(share, abs=0.005)
        assert math.radians(2) <= lost["within"] < math.radians(2.5) and abs(lost["reduced"]) < 0.01
    text = (tmp_path / "peak.pbrt").read_text()
    ((_, _, given),) = pbrt.directives(text)
    kept, nm = [1 - lost["unscattered"] for lost in folded], 1e3 * tree["wavelength"].data
    assert np.allclose(pbrt.spectrum(given["sigma_s"], nm), SIGMA_S * kept, rtol=2e-7)
    assert np.allclose(pbrt.spectrum(given["sigma_a"], nm), SIGMA_A, rtol=2e-7)
    said = call(*args, "--unscattered-within", "2deg")[2]
    assert "and counts as unscattered: sigma_s and sigma_t are smaller" in said and "would misdirect" not in said
    assert "# Up to 50 %" in text or "# Up to 49 %" in text


@pytest.mark.parametrize(("args", "said"), [
    (("--to", "hg", "--unscattered-within", "1deg"), "has no effect on hg"),
    (("--to", "blender", "--unscattered-within", "11deg"), "above 0 to 10deg"),
    (("--to", "blender", "--unscattered-within", "0deg"), "above 0 to 10deg"),
    (("--to", "blender", "--unscattered-within", "1"), "has no unit"),
    (("--to", "blender", "--index", "glass"), '--index: found "glass"; expected a number from 0.2 to 5'),
    (("--to", "blender", "--index", "1.4", "--roughness", "2"), "expected a number from 0 to 1"),
    (("--to", "blender", "--roughness", "0.1"), "found without --index"),
    (("--to", "hg", "--index", "1.4"), "has no effect on hg"),
])
def test_wrong_options(call, fog, args, said):
    status, out, err = call("export", fog, *args)
    assert status == 2 and not out and said in err


@pytest.mark.slow
def test_cycles_renders_it(call, fog, root, tmp_path):
    """Scattered once at eight angles and unscattered against closed forms; scattered often against the asset in Mitsuba.

    Bounds are 6 standard errors (of 39 numbers: a false alarm once in 10 million, pixels taken as independent) and what lobes and
    table differ by, 1 %.
    """
    if not os.environ.get("BAKERY_BLENDER"):
        pytest.skip(NO_BLENDER)
    assert call("export", fog, "--to", "blender", "-o", tmp_path)[0] == 0
    angles = np.radians([0.5, 5, 20, 40, 70, 110, 150, 180])
    thick = np.radians([30, 140])
    (tmp_path / "job.json").write_text(json.dumps({
        "material": str(tmp_path / "fog.py"), "output": str(tmp_path / "found.json"),
        "renders": [{"light": "sun", "angle": angle, "samples": 256, "bounces": 0} for angle in angles]
        + [{"light": "behind", "samples": 1024, "bounces": 0}]
        + [{"light": "sun", "angle": angle, "samples": 1024, "bounces": 1000} for angle in thick]}))
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    subprocess.run([os.environ["BAKERY_BLENDER"], "-P", str(ROOT / "tests" / "blender_scene.py"), str(tmp_path / "job.json")],
                   check=True, stdout=subprocess.DEVNULL, env=environment)
    found = json.loads((tmp_path / "found.json").read_text())
    bands, theta, phase = band_matrix(root["wavelength"].data), root["medium/theta"].data, root["medium/phase"].data[0]
    sigma_s, sigma_t = bands @ SIGMA_S, bands @ (SIGMA_S + SIGMA_A)
    for angle, image in zip(angles, found, strict=False):
        expected = phase_at(theta, phase, angle) * once(angle, sigma_s, sigma_t)
        assert np.all(np.abs(np.array(image["mean"]) - expected) < 6 * np.array(image["error"]) + 0.01 * expected), angle
    behind = found[len(angles)]
    assert np.all(np.abs(np.array(behind["mean"]) - np.exp(-sigma_t)) < 6 * np.array(behind["error"]))
    for angle, image in zip(thick, found[len(angles) + 1:], strict=True):
        expected, noise = in_mitsuba(fog, sigma_s, sigma_t, angle)
        error = np.hypot(noise, image["error"])
        assert np.all(np.abs(np.array(image["mean"]) - expected) < 6 * error + 0.01 * expected), angle
        assert np.all(error < 0.035 * expected)
        # much of it was scattered more than once
        assert np.all(expected > 1.2 * phase_at(theta, phase, angle) * once(angle, sigma_s, sigma_t))
