"""Every snippet of README and docs: Python runs, recipes load, commands and their options exist."""

import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys

import click
import pytest

import bakery
from bakery.grammar import tables
from bakery.physics.medium import analytic
from bakery.recipe import load
from tests.conftest import DROPS, MILK, ROOT

PAGES = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
         for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]}
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
BLOCKS = [(page, *block) for page, text in PAGES.items() for block in BLOCK.findall(text)]
# what the snippets of a page take from the reader
ANGLES, LOBES = analytic.tabulated("hg", 1e-3, 1, [0.5])[:2]
LOBE = {"theta": ANGLES, "phase": LOBES[0], "albedo": 0.9}
GIVEN = {"docs/multiple.md": LOBE | {"rho": 1.0, "z": 1.0, "phi": 0.5, "r": 1.0, "angle": 0.5}, "docs/multiple-peaks.md": LOBE}
CHEAP = """\
bakery: 1
name: milk
wavelengths: [0.55]
tolerance: 50%
medium: {{albedo: 0.5, mean_free_path: 1 mm, phase: {{type: isotropic}}}}
multiple_scattering: {{extent: 0.5, length: 0.1, orders: 2, method: {method}, photons: {photons}}}
"""


def blocks(kind: str) -> dict[str, list[str]]:
    """The snippets of a kind, page by page."""
    found: dict[str, list[str]] = {}
    for page, language, text in BLOCKS:
        if language == kind:
            found.setdefault(page, []).append(text)
    return found


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with what the snippets name: the recipes, and a small fog.h5 of three wavelengths."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recipes").symlink_to(ROOT / "recipes")
    shutil.copy(ROOT / "recipes" / "soil.yaml", tmp_path)  # a link would lead out of the folder
    (tmp_path / "fog.yaml").write_text(MILK.format(name="fog", g=0.5))
    bakery.bake("fog.yaml")
    return tmp_path


def test_all_kinds_of_snippets_are_looked_at():
    assert {language for _, language, _ in BLOCKS} == {"", "python", "yaml", "text", "make", "sh", "xml"}
    assert len(blocks("python")) >= 6


@pytest.mark.parametrize("page", sorted(set(blocks("python")) - {"README.md", "docs/multiple-photons.md", "docs/live.md"}))
def test_python(page, folder, capsys):
    names = dict(GIVEN.get(page, {}))
    for text in blocks("python")[page]:
        exec(compile(text, page, "exec"), names)


def test_python_of_the_readme(folder):
    """In a process of its own: with the wrong LLVM it would be aborted, at the first kernel."""
    if importlib.util.find_spec("mitsuba") is None:
        pytest.skip("Mitsuba is not installed")
    texts = blocks("python")["README.md"]
    assert any("bakedphase" in text for text in texts) and any("bakery.mie" in text for text in texts)
    look_up = ("import drjit as dr\nmei = dr.zeros(mi.MediumInteraction3f)\nmei.wi = mi.Vector3f(0, 0, 1)\n"
               "print(phase.eval_pdf(mi.PhaseFunctionContext(None), mei, mi.Vector3f(0, 0, -1)))\n")
    environment = {name: value for name, value in os.environ.items() if name != "DRJIT_LIBLLVM_PATH"}
    done = subprocess.run([sys.executable, "-c", "\n".join([*texts, look_up])], cwd=folder, text=True, capture_output=True,
                          timeout=240, env=environment | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 0 and "[" in done.stdout, done.stderr


@pytest.mark.slow
def test_python_of_tables_by_photons(folder):
    for method, photons in (("solver", "auto"), ("photons", "1000")):
        (folder / "milk.yaml").write_text(CHEAP.format(method=method, photons=photons))
        bakery.run.execute(bakery.run.bake.planned("milk.yaml", f"{method}.h5"))  # 1,000 photons miss any tolerance
    for text in blocks("python")["docs/multiple-photons.md"]:
        exec(compile(text, "docs/multiple-photons.md", "exec"), {})


@pytest.mark.parametrize("page", sorted(set(blocks("yaml")) - {"docs/frames.md", "docs/scenes.md"}))
def test_recipes(page, folder):
    """Whole recipes as they are, sections in a recipe that has a place for them, and scenes."""
    from renderers import scene

    for text in blocks("yaml")[page]:
        if "bakery_scene:" in text:
            (folder / "drink.xml").touch()
            (folder / "drink.yaml").write_text(text)
            assert scene.load("drink.yaml").materials[0].kind == "body"
            continue
        if "watr" in text:
            continue  # shown for its errors, which tests/unit/test_recipe.py compares
        if "bakery: 1" not in text:
            alone = re.search("^(packing|grains):", text, re.MULTILINE)
            drops, milk = DROPS.format(name="fog", tolerance="5%", radius="1 um"), MILK.format(name="fog", g=0.5)
            other = drops if "discrete:" in text else milk
            text = ("bakery: 1\nname: fog\n" if alone else other) + text
        (folder / "fog.yaml").write_text(text)
        assert load("fog.yaml").leaves["bakery"] == 1


def test_frames(folder):
    """The section of the page, in a scene of particles with a camera and a lamp."""
    from renderers import scene

    section, = blocks("yaml")["docs/frames.md"]
    (folder / "scenes").mkdir()
    (folder / "scenes" / "lit.xml").write_text("<scene>$lamp</scene>")
    (folder / "scenes" / "snow.yaml").write_text("bakery: 1\nname: snow\ndiscrete: {}\n")
    (folder / "scenes" / "drift.yaml").write_text(
        "bakery_scene: 2\nname: drift\nscene: {mitsuba: lit.xml}\nmaterials: [{recipe: snow.yaml}]\n"
        "camera: {origin: [0, 0, 1] m, target: [0, 0, 0.5] m, fov: 40 deg}\n" + section)
    last = scene.load("scenes/drift.yaml", frame=48).values
    assert list(last.camera.origin) == [4, -12, 1.7] and last.materials[0].time == 1.96
    assert last.scene.parameters == {"lamp": "3"} and last.frames.rate == 24


def test_scenes(folder):
    """The first blocks are scenes, of materials and of fog; the others take the place of the second one's picture."""
    from renderers import scene

    of_materials, whole, *pictures = blocks("yaml")["docs/scenes.md"]
    for name in ("build/street_fog.h5", "scenes/street.xml", "scenes/street.exr", "scenes/night.exr"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()
    (folder / "scenes" / "snow.yaml").write_text("bakery: 1\nname: snow\ndiscrete: {}\n")
    (folder / "scenes" / "lamp.yaml").write_text(of_materials)
    assert scene.load("scenes/lamp.yaml").section == "discrete"
    camera = re.search("^camera: .*$", "".join(pictures), re.MULTILINE)[0]
    for text in ("", *pictures):
        made = re.sub("^picture: .*\n", text, whole, flags=re.MULTILINE) if text else whole
        (folder / "scenes" / "night.yaml").write_text(made if not text or "camera" in text else f"{made}{camera}\n")
        assert scene.load("scenes/night.yaml").values.name == "night"


def commands():
    """(page, line) of every line that calls `bake`."""
    for page, language, text in BLOCKS:
        if language in ("", "sh"):
            lines = text.splitlines()
            typed = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")] or lines
            yield from ((page, line) for line in typed if line.startswith("bake "))


def parsed(line: str, call):
    """Status and message of a command line, read by the command itself up to the place where it would work."""
    return call(*shlex.split(re.split(r"\s>>?\s", line)[0], comments=True)[1:])[::2]


def test_commands(monkeypatch, call):
    monkeypatch.setattr(click.Command, "invoke", lambda self, ctx: 0)
    lines = list(commands())
    assert len(lines) > 25
    for page, line in lines:
        status, err = parsed(line, call)
        assert status == 0, f"{page}: {line}: {err}"
        for path in re.findall(r"(?<!\S)(?:recipes|assets)/\S+", line):
            assert any(ROOT.glob(path)), f"{page}: {line}"
    for wrong in ("bake fog.yaml --tolernce 1%", "bake fase fog.h5"):
        assert parsed(wrong, call)[0] == 2


def test_targets_of_make():
    rules = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = {target for text in PAGES.values() for target in re.findall(r"(?:^|`)make ([a-z][\w-]*)", text, re.MULTILINE)}
    assert {"bake", "test"} <= named <= rules


def test_rules_of_make(folder):
    if shutil.which("make") is None:
        pytest.skip("no make")
    text, = blocks("make")["README.md"]
    (folder / "Makefile").write_text(text)
    (folder / "fog.h5").unlink()
    assert dry_run(folder, "fog.h5") == "bake fog.yaml -o fog.h5 --depfile fog.d\n"


def test_make_scenes_renders_all_that_ship():
    if shutil.which("make") is None:
        pytest.skip("no make")
    listed = re.search(r"for scene in (.*?);", dry_run(ROOT, "scenes"))[1].split()
    assert sorted(listed) == sorted(path.stem for path in (ROOT / "assets" / "scenes").glob("*.yaml"))


def dry_run(folder, target):
    """What make would call, not as a part of the make that may run these tests."""
    alone = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")}
    done = subprocess.run(["make", "-n", target], cwd=folder, text=True, capture_output=True, timeout=60, env=alone)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_table_of_ones_own():
    text, = (text for _, language, text in BLOCKS if "wavelength_um,n,k" in text and not language)
    assert tables.read(text.encode(), "own.csv", "", tables.INDEX).shape == (3, 2)


ROOM = """<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="-1"/>
<integer name="rr_depth" value="1000000"/></integrator>
<emitter type="constant"/><shape type="cube"><bsdf type="null"/>MEDIUM</shape>
<sensor type="perspective"><transform name="to_world"><lookat origin="0, -5, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
<film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film>
<sampler type="independent"><integer name="sample_count" value="16"/></sampler></sensor></scene>"""


@pytest.mark.parametrize("scale", ["as it is", "1470"])
def test_a_medium_in_ones_own_scene(folder, call, scale):
    """In light from everywhere what absorbs nothing is as bright as that; also where sigma_t is far above 1, as of milk."""
    if importlib.util.find_spec("mitsuba") is None:
        pytest.skip("Mitsuba is not installed")
    (text,) = re.findall(r"^## In your own scenes\n```xml\n(.*?)^```$", PAGES["docs/mitsuba.md"], re.MULTILINE | re.DOTALL)
    given = 'name="scale" value="0.0231"'
    assert given in text
    (folder / "scene.xml").write_text(ROOM.replace("MEDIUM", text if "as" in scale else text.replace(
        given, f'name="scale" value="{scale}"')))
    status, _, err = call("render", "scene.xml", "-o", "scene.png", "--quality", "draft")
    assert status == 0 and (folder / "scene.exr").is_file(), err
    from tests.exr import layers

    red = layers(folder / "scene.exr")["R"]
    error = red.std() / red.size**0.5
    # without roulette, by which most renders of milk have a mean of 0.8: few paths hold the rest.  Six standard errors, which are
    # 0.01 in milk: odds of 2e-9
    assert abs(red.mean() - 1) < 6 * error and error < 0.03


@pytest.mark.slow
def test_the_medium_in_ones_own_scene_is_that_of_the_recipe(folder):
    fog = bakery.open(bakery.bake(ROOT / "recipes" / "fog.yaml", "own.h5")).medium
    shown = "sigma_t\" value=\"" + ", ".join(f"{one:.3g}" for one in fog.sigma_t / max(fog.sigma_t))
    assert shown in PAGES["docs/mitsuba.md"] and f'name="scale" value="{max(fog.sigma_t):.3g}"' in PAGES["docs/mitsuba.md"]


def test_xml():
    from xml.etree import ElementTree

    for texts in blocks("xml").values():
        for text in texts:
            ElementTree.fromstring(f"<scene>{text}</scene>")
