"""Address limits (`ulimit -v`), under which OpenBLAS and LLVM end the process or loop for ever by themselves."""

import resource
import tracemalloc

import pytest

from bakery.system import memory
from tests.conftest import slow


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "words", "library"), [
    (100, ("--version",), "numpy"), (256, ("drops.yaml",), "scipy"), slow(512, ("drops.yaml",), "llvmlite")])
def test_a_library_that_does_not_fit_is_not_begun(command, drops, tmp_path, limit, words, library):
    size = limit << 20
    done = command(*words, cwd=tmp_path, env={"OPENBLAS_NUM_THREADS": "3"},
                   preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size)))
    assert (done.returncode, done.stdout) == (3, "") and "Traceback" not in done.stderr
    # the last line: a slow machine says before it what takes long
    assert done.stderr.splitlines()[-1].startswith(f"out of memory ({library} takes ")


def test_a_small_file_takes_little_memory(drops):
    """Whatever the most that a file may have: 67 MB were asked for, and an address limit of 256 MB has them or not."""
    from bakery.grammar.files import read_recipe

    tracemalloc.start()
    try:
        assert read_recipe(drops) == drops.read_bytes()
        assert tracemalloc.get_traced_memory()[1] < 1e5
    finally:
        tracemalloc.stop()


def test_without_a_limit_nothing_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "address_space_left", lambda: None)
    monkeypatch.setattr(memory.sys, "meta_path", [])
    memory.refuse_what_does_not_fit()
    assert memory.sys.meta_path == []
    monkeypatch.setattr(memory, "address_space_left", lambda: 1e6)
    memory.refuse_what_does_not_fit()
    assert memory.free_memory() == 1e6 and memory.sys.meta_path[0].find_spec("json") is None


def test_what_libraries_make_of_too_little_memory(call, monkeypatch):
    """Beside MemoryError: a shared object that cannot be mapped, a thread that cannot be started; nothing else."""
    from bakery.cli import cli

    for error in (MemoryError(), ImportError("x.so: failed to map segment from shared object"),
                  RuntimeError("can't start new thread"), OSError(12, "Cannot allocate memory")):
        def fail(error=error, **_):
            raise error

        monkeypatch.setattr(cli, "main", fail)
        status, _, err = call("inspect")
        assert status == 3 and err.startswith("out of memory")
    for error in (ImportError("no module"), RuntimeError("no")):
        monkeypatch.setattr(cli, "main", lambda error=error, **_: (_ for _ in ()).throw(error))
        with pytest.raises(type(error)):
            call("inspect")
