"""Kept kernels are those of all the sources that they were compiled from."""

import gc
import os
import pickle
import re
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numba.core import ir

from bakery.system import compiled, sources
from tests.conftest import ROOT

CALLED = """
from bakery.system.compiled import njit

FACTOR = {factor}


@njit(cache=True)
def times(x):
    return FACTOR * x
"""
CALLER = """
from bakery.system.compiled import njit
from toy.called import times


@njit(cache=True)
def plus(x):
    return 1 + times(x)
"""
USE = """
from bakery.system import compiled, sources
sources.PACKAGES = (*sources.PACKAGES, "toy")
from toy.caller import plus
print(plus(2.0), sum(plus.stats.cache_hits.values()))
"""


@pytest.fixture
def toy(tmp_path):
    """Writes a package of two files, and gives what its kernel gives in a new process and whether that was kept."""
    (tmp_path / "toy").mkdir()
    (tmp_path / "toy" / "__init__.py").touch()
    (tmp_path / "toy" / "caller.py").write_text(CALLER)

    def run(factor):
        (tmp_path / "toy" / "called.py").write_text(CALLED.format(factor=factor))
        environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
        environment.pop("NUMBA_CACHE_DIR", None)
        value, kept = subprocess.run([sys.executable, "-c", USE], env=environment, capture_output=True, text=True,
                                     check=True).stdout.split()
        return float(value), int(kept)

    return run


@pytest.mark.slow
def test_a_kernel_of_another_file_that_changes_is_noticed(toy):
    assert toy(3.0) == (7.0, 0)
    assert toy(3.0) == (7.0, 1), "written again with the same text, it is kept"
    assert toy(5.0) == (11.0, 0)


def test_kernels_compile_also_where_none_can_be_kept(tmp_path):
    """As in a container whose user has no home: numba finds no folder, which ended the import."""
    (tmp_path / "toy.py").write_text(CALLED.format(factor=3.0))
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}",
                                "NUMBA_CACHE_LOCATOR_CLASSES": "IPythonCacheLocator"}
    call = subprocess.run([sys.executable, "-c", "import toy; print(toy.times(2.0), toy.times.is_kept(()))"], env=environment,
                          capture_output=True, text=True)
    assert (call.returncode, call.stdout.split()) == (0, ["6.0", "False"])
    assert call.stderr.count("compiled kernels are not kept") == 1 and "NUMBA_CACHE_DIR" in call.stderr


def test_every_kernel_is_kept_by_its_sources():
    """numba calls ours first; another version of it might not."""
    from bakery import kernels
    from renderers.transport import wavefront

    for dispatcher in (kernels.phase_value, wavefront.to_rgb):
        assert isinstance(dispatcher._cache._impl.locator, compiled._BySources)


def test_a_record_that_has_moved_since_is_no_error(tmp_path):
    index = compiled._Index(str(tmp_path), "toy", "stamp")
    index._save_index({"types": sources.Path})
    kept = (tmp_path / "toy.nbi").read_bytes()
    for module, name in ((b"nowhere", b"Path"), (b"pathlib", b"Gone")):
        (tmp_path / "toy.nbi").write_bytes(pickle.dumps(index._version) + b"c" + module + b"\n" + name + b"\n.")
        assert index._load_index() == {}
    (tmp_path / "toy.nbi").write_bytes(kept)
    assert index._load_index() == {"types": sources.Path}


def test_sources_are_the_file_and_what_it_imports():
    names = {str(path.relative_to(ROOT)) for path in sources.with_imports(ROOT / "renderers" / "transport" / "scattering.py")}
    assert names >= {"renderers/transport/scattering.py", "renderers/transport/wavefront.py", "bakery/kernels.py"}
    assert "renderers/pictures/passes.py" not in names
    ours = [path for folder in ("bakery", "renderers") for path in (ROOT / folder).rglob("*.py") if path.name != "compiled.py"]
    assert not [path for path in ours if re.search(r"^from numba import.*\bnjit\b", path.read_text(), re.MULTILINE)]


def test_two_threads_may_call_a_kernel_first(monkeypatch):
    """Later calls find it by themselves, without asking numba for it again."""
    @compiled.njit(nogil=True)
    def total(values):
        return values.sum()

    values, together = np.arange(3.0), threading.Barrier(2)
    with ThreadPoolExecutor(2) as pool:
        sums = pool.map(lambda _: (together.wait(), total(values))[1], range(2))
        assert list(sums) == [3.0, 3.0]
    asked = []
    monkeypatch.setattr(compiled.Kernel, "_compile_for_args", lambda self, *arguments: asked.append(self))
    assert total(values) == 3.0 and not asked


def test_what_a_kernel_was_compiled_from_is_let_go():
    """numba's instructions, which every collection of garbage would look at."""
    @compiled.njit
    def total(values):
        return values.sum() + len(values)

    assert total(np.arange(3.0)) == 6.0
    gc.collect()
    assert not [part for part in gc.get_objects() if type(part) in (ir.Assign, ir.Expr) and part.loc.filename == __file__]
