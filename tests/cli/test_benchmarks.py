"""Every benchmark, and every command that fills a page of claims, runs in its small form (`benchmarks/sizes.py`) to its end.

What they measure in that form says nothing and is not looked at; peers that are not installed are left out by the benchmarks.
"""

import os
import subprocess
import sys

import pytest

import bakery
from tests.conftest import ROOT

FOLDER = ROOT / "benchmarks"
SHARED = {"claims", "compiled_trace", "peers", "planned", "sizes"}  # what benchmarks have in common
GEL = """bakery: 1
name: gel
wavelengths: [0.55]
tolerance: 10%
medium: {albedo: 0.9, mean_free_path: 1 m, phase: {type: hg, g: 0.3}}
multiple_scattering: {extent: 4, orders: 8, tolerance: 10%}
beam: {depth: 4, photons: 4000, tolerance: 50%}
"""
# arguments of each call; ASSET stands for an asset of `GEL`, FOLDER for an empty folder
CALLS = {
    "averages": ("", "--rates", "--model", "--whole"), "beam": ("", "--pictures"),
    "cluster": ("overhead", "speed", "killed"), "emitter": ("ASSET --pictures FOLDER/sheet.png",), "granular": ("--quick",),
    "multiple": ("--photons",), "packing": ("", "--jamming"), "pictures": ("ASSET",),
    "first_picture": ("-o FOLDER",), "requirements": ("--pictures",), "scatterometer": ("", "--accuracy"),
    "small_lamps": ("", "--bias"),
    "variants": ("-o FOLDER",),
}


def benchmarks():
    files = {path.stem for path in FOLDER.glob("*.py")} - SHARED
    return sorted(files | {path.parent.name for path in FOLDER.glob("*/__main__.py")})


@pytest.fixture(scope="module")
def gel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gel")
    (folder / "gel.yaml").write_text(GEL)
    return bakery.bake(folder / "gel.yaml", output=folder / "gel.h5").path


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name, arguments", [(name, arguments) for name in benchmarks() for arguments in CALLS.get(name, ("",))])
def test_benchmarks_run(name, arguments, gel, tmp_path):
    words = arguments.replace("ASSET", str(gel)).replace("FOLDER", str(tmp_path)).split()
    done = subprocess.run([sys.executable, "-m", f"benchmarks.{name}", *words, "--small"], cwd=ROOT, capture_output=True,
                          text=True, timeout=900, env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)})
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-3000:]
    assert done.stdout.strip() or name == "catalogue", "it says nothing"  # which fills its page


def test_benchmarks_are_known():
    """Names in this file and in the Makefile are those of benchmarks, and each has a small form."""
    known = benchmarks()
    assert set(CALLS) <= set(known) and {f"figures_{of}" for of in ("goa", "discrete", "granular", "translucent")} <= set(known)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    in_turn = makefile.split("\nbench:")[1].split("for job in ")[1].split(";")[0].split()
    assert len(in_turn) > 10 and set(in_turn) <= set(known)
    for name in known:
        sources = [FOLDER / f"{name}.py"] if (FOLDER / f"{name}.py").exists() else list((FOLDER / name).glob("*.py"))
        assert any("benchmarks.sizes" in path.read_text(encoding="utf-8") for path in sources), f"{name} has no small form"
