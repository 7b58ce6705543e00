"""The notebooks run from the first cell to the last in an empty folder, and show pictures."""

from __future__ import annotations

import os
import sys
import warnings
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
    if "to_xarray" in path.read_text(encoding="utf-8"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what it imports
            pytest.importorskip("xarray", reason=f"xarray {WITHOUT}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")  # they call `bake`
    notebook = reading.read_myst_markdown_notebook(path.read_text(encoding="utf-8"))
    nbclient.NotebookClient(notebook, timeout=240, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [(kind, data) for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs
             for kind, data in output.get("data", {}).items()]
    assert any(kind == "image/png" or "data:image/png" in data for kind, data in shown)  # a picture's own HTML holds it


def test_there_are_a_tutorial_and_how_tos():
    assert {path.parent.name for path in NOTEBOOKS} == {"tutorial", "how-to"} and len(NOTEBOOKS) >= 5
