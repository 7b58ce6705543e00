"""Man pages: one a command with all its options, and `man` has nothing to complain of."""

import os
import re
import runpy
import shutil
import subprocess
import sys

import click
import pytest

from bakery.cli import COMMANDS, cli
from tests.conftest import ROOT

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("man")
    runpy.run_path(str(ROOT / "docs/man.py"))["main"](folder)
    return folder / "man1"


def test_help_makes_no_folder(tmp_path):
    done = subprocess.run([sys.executable, ROOT / "docs/man.py", "--help"], cwd=tmp_path, capture_output=True, text=True,
                          env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode == 0 and "Man pages of all commands" in done.stdout and not list(tmp_path.iterdir())


def test_every_command_has_a_page_with_all_its_options(pages):
    assert {f"bake-{name}.1" for name in COMMANDS} <= {path.name for path in pages.iterdir()}
    for name in COMMANDS:
        text = (pages / f"bake-{name}.1").read_text(encoding="utf-8").replace(r"\-", "-")
        for option in cli.get_command(click.Context(cli), name).params:
            if isinstance(option, click.Option) and not option.hidden:
                assert all(word in text for word in option.opts), f"{name}: {option.opts}"
        assert re.search(r"^\.SH EXIT STATUS\n\.TP\n\.B 0\ndone\n", text, re.MULTILINE)
    assert "bake query fog.h5 medium/sigma_t wavelength=0.55um\nbake" in (pages / "bake-query.1").read_text(encoding="utf-8")


def test_man_shows_them(pages):
    if not (shutil.which("man") and shutil.which("groff") and shutil.which("lexgrog")):
        pytest.skip("man-db or groff is not installed")
    for path in sorted(pages.iterdir()):
        shown = subprocess.run(["man", "--warnings", "-E", "UTF-8", "-l", path], text=True, capture_output=True, encoding="utf-8",
                               env={**os.environ, "LC_ALL": "C.UTF-8", "MANWIDTH": "80"})
        assert shown.returncode == 0 and not shown.stderr, shown.stderr
        assert "EXIT STATUS" in shown.stdout and "\\" not in shown.stdout.replace("\\*", "")
        named = subprocess.run(["lexgrog", path], text=True, capture_output=True)
        assert named.returncode == 0 and f'"{path.stem} - ' in named.stdout
