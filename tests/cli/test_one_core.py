"""A machine of one core."""

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

LOAD = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from renderers.mitsuba import scene
assert len(scene.load("scene.xml")[0].emitters()) == 1
"""
SCENE = """<scene version="3.0.0"><sensor type="perspective"/><emitter type="envmap"><string name="filename" value="a.exr"/>
</emitter></scene>"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="processes cannot be held to one core here")
@pytest.mark.slow
def test_pictures_are_written_and_light_a_scene(tmp_path):
    subprocess.run([sys.executable, "-c", WRITE], cwd=tmp_path, check=True, timeout=60)
    (tmp_path / "scene.xml").write_text(SCENE)
    subprocess.run([sys.executable, "-c", LOAD], cwd=tmp_path, check=True, timeout=60)
