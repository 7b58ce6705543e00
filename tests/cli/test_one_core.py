"""A machine of one core."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

WRITE = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import numpy as np
from pathlib import Path
from renderers.mitsuba import bitmaps
picture = np.full((48, 64, 3), 0.25)
bitmaps.write((Path("a.png"), Path("a.exr")), picture, picture)
assert (bitmaps.read(Path("a.exr"))[0]["R"] == 0.25).all()
"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="processes cannot be held to one core here")
def test_pictures_are_written(tmp_path):
    subprocess.run([sys.executable, "-c", WRITE], cwd=tmp_path, check=True, timeout=60)
