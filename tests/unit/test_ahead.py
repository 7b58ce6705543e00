"""Kernels that are compiled ahead, and turns of processes that compile."""

import gc
import inspect
import json
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from bakery.run import ahead
from bakery.system import compiled, signatures, turns
from renderers.scene import Scene
from tests.conftest import ROOT


def entries():
    return [(group, *kernel) for group, kernels in ahead.recorded().items() for kernel in kernels]


def test_every_entry_is_a_kernel_with_so_many_arguments():
    """Where a kernel is renamed or takes other arguments: `python -m benchmarks.first_render --record`."""
    assert {group.split()[0] for group in ahead.recorded()} <= {"plan", "stage", "render"}
    for group, name, arguments in entries():
        kernel = signatures.by_name(name)
        assert isinstance(kernel, compiled.Kernel), f"{group}: {name}"
        wanted = inspect.signature(kernel.py_func).parameters.values()
        least = sum(each.default is inspect.Parameter.empty for each in wanted)
        assert least <= len(arguments) <= len(wanted), f"{group}: {name}"
        types = [signatures.read(form) for form in arguments]
        assert [signatures.written(one) for one in types] == arguments, f"{group}: {name}"


def test_no_entry_is_for_one_value_of_an_integer():
    assert "iteral" not in ahead.RECORD.read_text()


def test_named_tuples_have_the_fields_of_their_class():
    def check(form):
        if isinstance(form, dict):
            (name, fields), = form.items()
            assert len(signatures.by_name(name)._fields) == len(fields), name
        for one in form if isinstance(form, list) else form.values() if isinstance(form, dict) else ():
            check(one)

    for _, _, arguments in entries():
        check(arguments)


def test_the_kernels_of_a_stage_are_those_of_its_modules():
    tiles = ahead.of("stage packing", ("packing._events",))
    assert tiles and {name.split(":")[0] for name, _ in tiles} == {"bakery.physics.packing._events"}
    assert len(ahead.of("stage packing")) > len(tiles)
    assert ahead.of("stage none", ("packing._events",)) == []


def test_what_is_met_last_is_compiled_first():
    waiting = ahead.Waiting()
    waiting.add([["picture 1", []], ["picture 2", []]])
    waiting.add([["stage 1", []], ["stage 2", []]])
    waiting.add([["rays 1", []], ["rays 2", []]], now=True)
    assert [waiting.take(0.0)[0] for _ in range(6)] == ["rays 2", "rays 1", "picture 2", "picture 1", "stage 2", "stage 1"]
    assert waiting.take(0.0) is None


def test_what_is_not_remembered_is_compiled_for(monkeypatch):
    class Memory(dict):
        def get(self, name, key):
            return super().get((name, key))

        def put(self, name, key, group, provenance):
            self[name, key] = group, provenance

    expected = []
    monkeypatch.setattr(ahead, "expect", lambda kernels, now: expected.extend(kernels if now else ()))
    memory = ahead.Measuring(Memory())
    memory.put("rays", "known", 1, 2)
    assert memory.get("rays", "known") == (1, 2) and not expected
    assert memory.get("rays", "unknown") is None
    modules = {name.split(":")[0].split(".")[2] for name, _ in expected}
    assert modules == {"mie", "goa"}


def test_a_scene_has_the_kernels_of_its_kinds_and_its_entries():
    """Grains and bodies in fog, of these surfaces as well, in which nothing is followed."""
    entries = [SimpleNamespace(kind=kind, method=method) for kind, method in
               [("grains", "auto"), ("medium", "auto"), ("grains", "auto"), ("body", "surface")]]
    scene = SimpleNamespace(section="mixed", materials=entries, followed=Scene.followed.fget(SimpleNamespace(materials=entries)))
    assert ahead.groups_of(scene) == ["render mixed", "render mixed: grains", "render mixed: medium",
                                      "render mixed: body surface, grains auto, grains auto, medium auto"]
    packages = {name.split(".")[2] for name, _ in ahead.of_scene(scene) if name.startswith("renderers.materials.")}
    assert packages == {"grains", "medium"}


def test_nothing_starts_where_all_is_kept_or_no_processor_is_free(monkeypatch):
    started = []
    monkeypatch.setattr(ahead, "_process", lambda: started.append(1))
    shared = ahead._Ahead()
    shared.expect([])
    monkeypatch.setattr(ahead.resources, "processors", lambda: 1)
    shared.expect([["bakery.physics.grains.bvh:_build", []]])
    assert not started


def test_a_process_that_has_ended_is_replaced(monkeypatch):
    """And its pipe closed: warnings are errors in tests."""
    monkeypatch.setattr(ahead, "_process", lambda: subprocess.Popen([sys.executable, "-c", ""], stdin=subprocess.PIPE))
    monkeypatch.setattr(ahead.resources, "processors", lambda: 3)
    monkeypatch.setattr(ahead.resources, "jobs", lambda: 3)
    shared, kernels = ahead._Ahead(), [["bakery.physics.grains.bvh:_build", []]]
    shared.expect(kernels)
    first = list(shared._processes)
    assert len(first) == 2
    for process in first:
        process.wait()
    shared.expect(kernels)
    assert len(shared._processes) == 2 and not set(first) & set(shared._processes)
    shared.end()
    shared.end()
    assert not shared._processes and all(process.stdin.closed for process in first)


# ---- one process compiles, others take what it kept

KERNELS = """
from bakery.system.compiled import njit


@njit(cache=True)
def inner(x, n):
    return x * n


@njit(cache=True)
def outer(x, n):
    return inner(x, n) + inner(x, 3) + inner(x, 4)
"""
HEAD = """
import sys
from bakery.system import sources
sources.PACKAGES = (*sources.PACKAGES, "toy")
from toy import kernels
"""
CALL = HEAD + """
from numba.core import event
compiled = []
class Listener(event.Listener):
    def on_start(self, found):
        compiled.append(found.data["dispatcher"].py_func.__name__ + " waits" * bool(found.data.get("waiting")))
    def on_end(self, found):
        pass
event.register("numba:compile", Listener())
value = kernels.outer(2.0, 5)
import json
print(json.dumps([value, compiled, len(kernels.inner.signatures)]))
"""
AHEAD = HEAD + """
from bakery.run import ahead
print(ahead.compile_one("toy.kernels:outer", ["float64", "int64"], lambda turn: False))
print(ahead.compile_one("toy.kernels:outer", ["float64", "int64"], lambda turn: False))
print(ahead.compile_one("toy.kernels:outer", ["float64", "float64"], lambda turn: True))
"""
HOLD = HEAD + """
from bakery.system import turns
with turns.of(kernels.outer.turn):
    print("holds", flush=True)
    sys.stdin.readline()
"""


@pytest.fixture
def toy(tmp_path):
    """Starts a script in a process that has a package with two kernels."""
    (tmp_path / "toy").mkdir()
    (tmp_path / "toy" / "__init__.py").touch()
    (tmp_path / "toy" / "kernels.py").write_text(KERNELS)
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}", "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    processes = []

    def start(script):
        processes.append(subprocess.Popen([sys.executable, "-c", script], env=environment, stdin=subprocess.PIPE,
                                          stdout=subprocess.PIPE, text=True))
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.communicate()


@pytest.mark.slow
def test_what_was_compiled_ahead_is_found(toy):
    assert toy(AHEAD).communicate()[0].split() == ["True", "False", "False"]
    value, met, signatures_of_inner = json.loads(toy(CALL).communicate()[0])
    assert value == 24.0 and met == [], "all of it is on disk"


@pytest.mark.slow
def test_a_kernel_is_compiled_once_for_all_integers(toy):
    value, met, signatures_of_inner = json.loads(toy(CALL).communicate()[0])
    assert value == 24.0 and signatures_of_inner == 1
    assert sorted(one for one in met if one in ("inner", "outer")) == ["inner", "outer"]


@pytest.mark.slow
def test_a_process_waits_while_another_compiles(toy):
    other = toy(HOLD)
    assert other.stdout.readline() == "holds\n"
    waits = toy(CALL)
    with pytest.raises(subprocess.TimeoutExpired):
        waits.wait(6.0)
    other.kill()  # whoever ends, however, has no turn any more
    value, met, _ = json.loads(waits.communicate()[0])
    assert value == 24.0 and met[0] == "outer waits"


def test_a_turn_within_the_same_turn():
    with turns.of("test"), turns.of("test"):
        assert not turns.taken("test"), "it is this process's"
    assert not turns._held


def test_without_a_file_to_lock_nobody_waits(monkeypatch):
    monkeypatch.setattr(turns, "_file", lambda process: None)
    with turns.of("test"):
        assert not turns.taken("test")


def test_the_collector_of_garbage_is_as_before():
    assert gc.isenabled()
    with compiled._no_collector(), compiled._no_collector():
        assert not gc.isenabled()
    assert gc.isenabled()
