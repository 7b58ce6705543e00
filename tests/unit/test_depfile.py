"""Depfiles as Make and Ninja read them, with names that need guarding."""

import shutil
import subprocess
import sys

import pytest

from bakery.errors import UsageError
from bakery.run.depfile import text, write

NAMES = ["plain.yaml", "with space.csv", "hash#tag.csv", "dollar$sign.csv", "both # $x.csv"]


@pytest.mark.skipif(shutil.which("make") is None, reason="make is the test")
@pytest.mark.parametrize("name", NAMES)
def test_make_rebuilds_when_a_named_file_changes(tmp_path, name):
    (tmp_path / name).write_text("1")
    write(tmp_path / "out.d", "out", [name])
    (tmp_path / "Makefile").write_text("out:\n\t@echo ran >> log; touch out\n-include out.d\n")
    make = ["make", "-s", "out"]
    subprocess.run(make, cwd=tmp_path, check=True)
    subprocess.run(make, cwd=tmp_path, check=True)
    assert (tmp_path / "log").read_text().count("ran") == 1
    later = (tmp_path / "out").stat().st_mtime_ns + 10**9
    import os

    os.utime(tmp_path / name, ns=(later, later))
    subprocess.run(make, cwd=tmp_path, check=True)
    assert (tmp_path / "log").read_text().count("ran") == 2
    (tmp_path / name).unlink()  # a removed input must not stop Make: its empty rule stands in
    subprocess.run(make, cwd=tmp_path, check=True)


def test_ninja_reads_it(tmp_path):
    pytest.importorskip("ninja")
    for name in NAMES:
        (tmp_path / name).write_text("1")
    write(tmp_path / "deps.txt", "out", NAMES)
    (tmp_path / "build.ninja").write_text(
        "rule bake\n  command = cp deps.txt out.d && echo ran >> log && touch out\n"
        "  depfile = out.d\n  deps = gcc\nbuild out: bake\n")
    ninja = [sys.executable, "-m", "ninja", "-v"]
    for _ in range(2):
        subprocess.run(ninja, cwd=tmp_path, check=True, capture_output=True)
    assert (tmp_path / "log").read_text().count("ran") == 1
    known = subprocess.run([*ninja, "-t", "deps"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    for name in NAMES:
        assert f"    {name}\n" in known


def test_a_line_break_is_refused():
    with pytest.raises(UsageError, match="line break"):
        text("out", ["a\nb"])
