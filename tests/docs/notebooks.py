"""The notebooks of docs/: text with a header that names the format, `file_format: mystnb`."""

from __future__ import annotations

from tests.conftest import ROOT

NOTEBOOKS = [path for path in sorted((ROOT / "docs").rglob("*.md"))
             if path.read_text(encoding="utf-8").startswith("---\nfile_format: mystnb\n")]
