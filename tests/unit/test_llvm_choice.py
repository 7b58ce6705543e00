"""A picture always comes out: which variant is chosen for which LLVM, and what happens with the machine's own."""

import glob
import importlib.util
import os
import subprocess
import sys

import pytest

from tests.conftest import ROOT, slow

if importlib.util.find_spec("mitsuba") is None:
    pytest.skip("Mitsuba is not installed", allow_module_level=True)

from bakery.errors import UsageError
from bakery.system import llvm
from renderers.mitsuba import variants

# Renders 8 x 8 pixels of a glowing ball of fog: the smallest kernel with `dr.minimum` in it, which LLVM 15 dies of.
RENDER = """
import renderers.mitsuba as renderer
import mitsuba as mi, numpy as np
variant, reason = renderer.variants.activate("mono")
scene = mi.load_dict({"type": "scene", "integrator": {"type": "volpath"}, "light": {"type": "constant"},
    "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8},
               "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0])},
    "ball": {"type": "sphere", "bsdf": {"type": "null"}, "interior": {"type": "homogeneous", "phase": {"type": "hg"}}}})
assert np.isfinite(np.array(mi.render(scene, spp=1))).all()
print(variant, "|", reason)
"""


@pytest.mark.parametrize("version", [(-1, -1, -1), (14, 0, 6), (15, 0, 7), (16, 0, 0), (17, 0, 6), (18, 1, 8)])
def test_old_or_no_llvm_means_scalar(version):
    choice = variants.decide(False, version)
    assert choice.names == ("scalar_rgb",)
    assert "pip install" in choice.reason
    assert version[0] < 0 or str(version[0]) in choice.reason


@pytest.mark.parametrize("version", [(19, 0, 0), (19, 1, 7), (23, 1, 4)])
@pytest.mark.parametrize("kind", ["mono", "rgb", "spectral", "spectral_polarized"])
def test_new_llvm_is_used(version, kind):
    names, _ = variants.decide(False, version, kind)
    assert names[0] == f"llvm_ad_{kind}" and names[-1].startswith("scalar") and len(names) == 2
    assert variants.decide(True, version, kind).names[0] == f"cuda_ad_{kind}"


def test_cuda_needs_no_llvm():
    assert variants.decide(True, (15, 0, 7)).names == ("cuda_ad_mono", "scalar_rgb")


def test_unknown_kind_and_variant():
    with pytest.raises(UsageError, match="mono, rgb"):
        variants.decide(False, (19,), "cmyk")
    with pytest.raises(UsageError, match="scalar_rgb"):
        variants.activate("mono", "llvm_rgb")


def run(library, code=RENDER):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DRJIT_LIBLLVM_PATH": str(library)}
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=240)


OLD = {version: found[0] for version in range(14, 19) if (found := sorted(
    glob.glob(f"/usr/lib/*/libLLVM-{version}.so*") + glob.glob(f"/usr/lib/llvm-{version}/lib/libLLVM*.so*")))}


@pytest.mark.parametrize("version", [*map(slow, OLD)] or [
    pytest.param(0, marks=pytest.mark.skip("the system has no LLVM before 19"))])
def test_system_llvm_still_gives_a_picture(version):
    done = run(OLD[version])
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("scalar_rgb | ") and "pip install" in done.stdout


@pytest.mark.slow
def test_missing_library_still_gives_a_picture(tmp_path):
    done = run(tmp_path / "libLLVM.so")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("scalar_rgb | ")


@pytest.mark.slow
def test_aborting_llvm_is_refused_even_on_request():
    found = sorted(glob.glob("/usr/lib/*/libLLVM-15.so*"))
    if not found:
        pytest.skip("no LLVM 15 here")
    done = run(found[0], RENDER.replace('activate("mono")', 'activate("mono", "llvm_ad_mono")'))
    assert done.returncode == 1 and "UsageError" in done.stderr and "15 and 16 abort" in done.stderr


@pytest.mark.slow
def test_mitsuba_before_us_with_an_old_llvm_is_refused():
    """README had it so; the process was aborted at the first kernel."""
    found = sorted(glob.glob("/usr/lib/*/libLLVM-15.so*"))
    if not found:
        pytest.skip("no LLVM 15 here")
    done = run(found[0], 'import mitsuba as mi\nmi.set_variant("llvm_ad_rgb")\nimport renderers.mitsuba\n')
    assert done.returncode == 1 and "UsageError" in done.stderr and "turn them round" in done.stderr


def test_library_of_the_environment_is_found(monkeypatch, tmp_path):
    """Only where the user chose nothing, and never once drjit is there."""
    library = tmp_path / "lib" / "libLLVM.so"
    library.parent.mkdir()
    library.touch()
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "mine")
    assert llvm.find() == "mine"
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH")
    assert llvm.find() is None  # drjit is imported
    monkeypatch.delitem(sys.modules, "drjit")
    assert llvm.find() == str(library) == os.environ["DRJIT_LIBLLVM_PATH"]
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "restored afterwards")


def test_missing_mitsuba_names_the_extra():
    code = ("import importlib.util, sys\n"
            "find = importlib.util.find_spec\n"
            "importlib.util.find_spec = lambda name, *a: None if name == 'mitsuba' else find(name, *a)\n"
            "try:\n    import renderers.mitsuba\n"
            "except Exception as error:\n    from bakery.errors import BakeryError\n"
            "    print(isinstance(error, BakeryError), isinstance(error, ImportError), error)\n")
    done = run("none", code)
    assert done.stdout.startswith("True True") and 'pip install ".[mitsuba,llvm]"' in done.stdout, done.stderr


@pytest.mark.parametrize("version", [(-1, -1, -1), (14, 0, 6), (18, 1, 8)])
def test_an_unusable_llvm_is_named(version):
    fault = llvm.fault(version)
    assert "pip install" in fault and (version[0] < 0 or str(version[0]) in fault)
