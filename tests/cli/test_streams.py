"""Standard streams that are closed or full: a status, a message where one can be read, no traceback, no damaged asset."""

import os
import subprocess
import sys

import pytest

import bakery
from tests.conftest import ROOT

UNWRITTEN = "standard output: cannot be written: No space left on device\n"


@pytest.fixture
def shell(tmp_path):
    """Run `bake` with redirections as a shell makes them: (status, stdout, stderr)."""

    def run(words, **env):
        done = subprocess.run(["sh", "-c", f'exec "$0" -m bakery {words}', sys.executable], cwd=tmp_path, text=True, timeout=60,
                              capture_output=True, env={**os.environ, "PYTHONPATH": str(ROOT), **env})
        assert "Traceback" not in done.stderr, done.stderr
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.mark.slow
def test_closed_streams_are_like_dev_null(shell, milk, tmp_path):
    for redirection, out in (("<&- >&- 2>&-", ""), ("2>&-", "milk.h5\n")):
        assert shell(f"milk.yaml --force {redirection}")[:2] == (0, out)
        assert bakery.open(tmp_path / "milk.h5").name == "milk"  # no file got the stream's number, and what a library printed
    assert shell("milk.yaml --tolerance none 2>&-")[:2] == (2, "")


@pytest.mark.slow
def test_a_full_standard_output_is_a_failure(shell, milk, tmp_path):
    """With Python's own buffer, which fails when it is flushed, and without, where the first write fails."""
    assert shell("milk.yaml --quiet >/dev/full", PYTHONUNBUFFERED="") == (3, "", UNWRITTEN)
    assert bakery.open(tmp_path / "milk.h5").name == "milk"
    assert shell("--version >/dev/full", PYTHONUNBUFFERED="1") == (3, "", UNWRITTEN)
    status, _, err = shell("milk.yaml --tolerance none --json >/dev/full")
    assert status == 2 and "tolerance" in err and UNWRITTEN in err  # the recipe's fault comes first


@pytest.mark.slow
def test_a_full_standard_error_leaves_the_status(shell, milk):
    assert shell("milk.yaml 2>/dev/full", PYTHONUNBUFFERED="") == (0, "milk.h5\n", "")
    assert shell("milk.yaml --tolerance none >/dev/full 2>/dev/full") == (2, "", "")


def test_a_reader_that_has_gone_is_no_failure():
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([sys.executable, "-m", "bakery", "--help"], stdout=writer, stderr=subprocess.PIPE, timeout=60,
                          env={**os.environ, "PYTHONPATH": str(ROOT)})
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, b"")
