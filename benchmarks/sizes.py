"""The small form of every benchmark: `python -m benchmarks.NAME --small` runs all of its code in seconds.

Its numbers say nothing; that it ends says that the benchmark still works (`tests/cli/test_benchmarks.py`).  A benchmark gives its
sizes as `sized(usual, small)`; processes that it starts are small, too.  What it would write into docs/ goes elsewhere then.
"""

import atexit
import os
import shutil
import sys
import tempfile
from contextlib import ExitStack
from functools import cache
from pathlib import Path

_WORD, _VARIABLE = "--small", "BAKERY_SMALL_BENCHMARKS"
if _WORD in sys.argv[1:]:
    sys.argv.remove(_WORD)
    os.environ[_VARIABLE] = "1"
SMALL = _VARIABLE in os.environ


def sized(usual, small):
    """`usual`, or `small` in the small form."""
    return small if SMALL else usual


_COPIES = ExitStack()  # gone with the process
atexit.register(_COPIES.close)


@cache
def docs() -> Path:
    """The folder of the documentation; in the small form a copy of its pages in a temporary folder."""
    folder = Path(__file__).resolve().parents[1] / "docs"
    if not SMALL:
        return folder
    copy = Path(_COPIES.enter_context(tempfile.TemporaryDirectory(prefix="bakery-benchmarks-")))
    (copy / "pictures").mkdir()
    for page in (*folder.glob("*.md"), *folder.glob("measurements/*.md")):
        (copy / page.relative_to(folder)).parent.mkdir(exist_ok=True)
        shutil.copy(page, copy / page.relative_to(folder))
    return copy
