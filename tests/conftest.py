"""What all tests share: a cache of their own, recipes that bake in a moment, the command line as a user calls it."""

import contextlib
import ctypes
import gc
import importlib
import io
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

# Before NumPy comes: two workers with two threads of BLAS each wait for each other, in `eigvalsh` 10 times as long as they work
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.pop("COLUMNS", None)  # which pytest-xdist sets: lines would be broken by it

ROOT = Path(__file__).resolve().parents[1]


def slow(*values):
    """A case of a parametrised test that `make test-slow` runs: quicker ones see most of what it sees."""
    return pytest.param(*values, marks=pytest.mark.slow)


MILK = """\
bakery: 1
name: {name}
wavelengths: rgb
tolerance: 1%
medium:
  albedo: [0.9998, 0.9995, 0.998]
  mean_free_path: "[0.84, 0.75, 0.68] mm"
  phase: {{type: hg, g: {g}}}
"""

DROPS = """\
bakery: 1
name: {name}
wavelengths: [0.55]
tolerance: {tolerance}
particles:
  host: air
  number_density: 1e8 /m^3
  components:
    - name: droplets
      material: water
      size: {{distribution: lognormal, radius: {radius}, sigma: 1.2, min: 0.1 um, max: 3 um}}
"""


@pytest.fixture(scope="session")
def _caches(tmp_path_factory):
    """Paths of folders that are not there yet, without end.

    pytest numbers its folders by a look at all that there are: with one a test, five thousand tests take a hundred times as long.
    """
    root = tmp_path_factory.mktemp("caches")
    return (root / str(number) for number in itertools.count())


@pytest.fixture(autouse=True)
def _own_cache(_caches, monkeypatch):
    """No test sees another's cache, nor the user's."""
    cache = next(_caches)
    cache.mkdir()
    monkeypatch.setenv("BAKERY_CACHE", str(cache))
    monkeypatch.delenv("BAKERY_JOBS", raising=False)


@pytest.fixture
def milk(tmp_path):
    """A recipe that bakes in a moment: coefficients, no particles."""
    path = tmp_path / "milk.yaml"
    path.write_text(MILK.format(name="milk", g=0.7))
    return path


@pytest.fixture
def drops(tmp_path):
    """A recipe with both stages: small drops, one wavelength, 5 %."""
    path = tmp_path / "drops.yaml"
    path.write_text(DROPS.format(name="drops", tolerance="5%", radius="0.5 um"))
    return path


@pytest.fixture
def call(capsys, monkeypatch):
    """Run the command line in this process: (status, stdout, stderr); nothing is named only because the machine is slow."""
    from bakery.cli import status_of
    from bakery.run import progress

    monkeypatch.setattr(progress, "FIRST", 1e6)

    def run(*args):
        capsys.readouterr()
        status = status_of([str(arg) for arg in args])
        out, err = capsys.readouterr()
        return status, out, err

    return run


@pytest.fixture
def verified_here(monkeypatch):
    """`bake verify` reads files in this process, for tests of what it finds; `test_damaged_assets.py` sees its own process."""
    verify = importlib.import_module("bakery.asset.verify")
    apart = verify._in_child

    def here(path, task, time_limit, memory):
        if task != "all":
            return apart(path, task, time_limit, memory)
        with monkeypatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as out:
            patch.setattr(sys, "argv", ["verify", task, path, "0"])
            verify._child()
        return json.loads(out.getvalue())

    monkeypatch.setattr(verify, "_in_child", here)


@pytest.fixture
def undrawn(monkeypatch):
    """Blank pictures in no time, for tests of what stands around them: `bake plot` and `bake report` draw nothing."""
    from PIL import Image

    png = io.BytesIO()
    Image.new("RGB", (2, 1)).save(png, "png")
    blank = {"png": png.getvalue(), "svg": b'<svg xmlns="http://www.w3.org/2000/svg"/>'}
    for place in ("bakery.draw.picture", "bakery.report.figures"):
        monkeypatch.setattr(f"{place}.drawn", lambda picture, forms=("png", "svg"), of="": {form: blank[form] for form in forms})


@pytest.fixture
def command():
    """Run the command line as a process of its own."""

    def run(*args, cwd=None, env=None, timeout=120, **more):
        return subprocess.run([sys.executable, "-m", "bakery", *map(str, args)], cwd=cwd, timeout=timeout, text=True,
                              capture_output=True, env={**os.environ, "PYTHONPATH": str(ROOT), **(env or {})}, **more)

    return run


def where_rights_bind(check: Callable[[Path], None]) -> None:
    """Call `check` with an empty folder, where rights bind, root too.

    Root stays who it is, so that it reaches its sources and Python in a folder that others may not enter, and gives up the
    capabilities that pass over rights: in a thread, since Linux keeps them for each, and they do not come back.
    """
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1, initializer=_without_privileges) as thread:
        thread.submit(check, Path(folder)).result()


def _without_privileges() -> None:
    version_3 = 0x20080522  # linux/capability.h; two words of each set: effective, permitted, inheritable
    if os.geteuid() != 0:
        return
    header, sets = (ctypes.c_uint32 * 2)(version_3, 0), (ctypes.c_uint32 * 6)()
    libc = ctypes.CDLL(None, use_errno=True)
    assert libc.capget(header, sets) == 0, os.strerror(ctypes.get_errno())
    override, read_search = 1 << 1, 1 << 2
    for capabilities in range(3):
        sets[capabilities] &= ~(override | read_search)
    assert libc.capset(header, sets) == 0, os.strerror(ctypes.get_errno())


def pytest_addoption(parser):
    parser.addoption("--update", metavar="CASE", default=None, help="rewrite the golden values of a case (or all)")


def pytest_sessionstart(session):
    """Workers of pytest-xdist import test files in turns, each from another one on.

    What pytest makes of a file it keeps on disk, and it takes 10 s for all of them: two workers that begin with the same file do
    it twice.  Nothing of it is garbage.
    """
    gc.disable()
    worker = getattr(session.config, "workerinput", None)
    if worker is None:
        return
    with contextlib.suppress(Exception):
        importlib.import_module("renderers.mitsuba")  # finds LLVM, before a test file imports Dr.Jit
    files, number = sorted((ROOT / "tests").glob("*/test_*.py")), int(worker["workerid"].removeprefix("gw"))
    for file in files[number::worker["workercount"]]:
        # what does not import is told where pytest itself imports it
        with contextlib.suppress(Exception, pytest.skip.Exception):
            importlib.import_module(f"tests.{file.parent.name}.{file.stem}")


def pytest_collection_finish(session):
    """What is there before the first test stays until the last, and Python's collector need not look at it.

    Every render calls it, to be rid of the scenes before: with all tests collected 0.25 s, a quarter of a small picture's time.
    What numba fetches with the first kernel is another 0.03 s.
    """
    from numba.core.registry import cpu_target

    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True, scope="session")
def _nothing_ahead():
    """Workers have tests for all processors, and compile what these meet; a process that compiles ahead of one only has to start.

    Where the machine gives no process, a bake or a render goes on without.
    """
    def refused():
        raise OSError("no process for kernels ahead of tests")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bakery.run.ahead._process", refused)
        yield


@pytest.fixture(autouse=True, scope="session")
def _integrators_once():
    """Each change of Mitsuba's variant imports its differentiable integrators anew, a tenth of a second.  No test renders by
    them: once for a variant is enough."""
    reload, imported = importlib.reload, set()

    def once(module):
        if module.__name__ != "mitsuba.python.ad.integrators":
            return reload(module)
        variant = sys.modules["mitsuba"].variant()
        if variant not in imported:
            reload(module)
            imported.add(variant)
        return module

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(importlib, "reload", once)
        yield


@pytest.fixture(autouse=True, scope="session")
def _interruptible():
    """A shell starts what it puts into the background with SIGINT ignored; tests of interruptions need Python's own handler."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
