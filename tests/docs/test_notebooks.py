"""The notebooks run from the first cell to the last in an empty folder, and show pictures."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.docs.notebooks import NOTEBOOKS

WITHOUT = "is not installed: pip install '.[docs]'"


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook(path, tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient", reason=f"nbclient {WITHOUT}")
    reading = pytest.importorskip("myst_nb.core.read", reason=f"myst-nb {WITHOUT}")
    pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install '.[mitsuba,llvm]'")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")  # they call `bake`
    notebook = reading.read_myst_markdown_notebook(path.read_text(encoding="utf-8"))
    nbclient.NotebookClient(notebook, timeout=240, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [kind for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs
             for kind in output.get("data", {})]
    assert "image/png" in shown


def test_there_are_a_tutorial_and_how_tos():
    assert {path.parent.name for path in NOTEBOOKS} == {"tutorial", "how-to"} and len(NOTEBOOKS) >= 5
