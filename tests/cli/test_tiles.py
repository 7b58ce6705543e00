"""Tiles from the command line: wishes that are not met, refusals, exports."""

import json

import numpy as np
import pytest

import bakery
from bakery.errors import StageError

TILE = """\
bakery: 1
name: tile
tolerance: 10%
packing: {{fraction: {fraction}, count: {count}}}
"""


def recipe(tmp_path, fraction, count):
    path = tmp_path / "tile.yaml"
    path.write_text(TILE.format(fraction=fraction, count=count))
    return path


def test_a_wish_that_is_not_met(call, tmp_path):
    """Three spheres jam at a fraction of 0.56 (they form a line of touching layers): stored, said, status 3, every time."""
    path, asset = recipe(tmp_path, 0.6, 3), tmp_path / "tile.h5"
    for again in (False, True):
        status, out, err = call(path, "-o", asset)
        assert status == 3 and out == f"{asset}\n" and ("is up to date" in err) == again
        assert "0.6 was not reached" in err
    assert 0.5 < float(bakery.open(asset).packing.fraction[0]) < 0.6
    status, out, _ = call(path, "-o", asset, "--force", "--json", "--quiet")
    assert status == 3 and "not reached" in json.loads(out)[0]["missed"][0]
    with pytest.raises(StageError, match="is written, but packing: fraction 0.6 was not reached"):
        bakery.bake(path, asset)


def test_more_than_can_be_packed_is_refused_before_any_work(call, tmp_path):
    status, out, err = call("plan", recipe(tmp_path, 0.74, 500))
    assert status == 2 and not out and "tile.yaml:4: packing.fraction: found 0.74; expected at most 0.64" in err


def test_exports(call, tmp_path):
    asset = tmp_path / "tile.h5"
    assert call(recipe(tmp_path, 0.3, 30), "-o", asset)[0] == 0
    for target in ("ply", "xyz"):
        status, out, _ = call("export", asset, "--to", target, "-o", tmp_path / target)
        assert status == 0
        lines = (tmp_path / target / f"tile.{target}").read_text().splitlines()
        rows = [line.split() for line in lines[-30:]]
        found = np.array([row[-4:-1] for row in rows], float)
        assert np.array_equal(found, bakery.open(asset).packing.centers)
    assert call("export", asset, "--to", "csv", "-o", tmp_path / "csv")[0] == 0
    status, _, err = call("export", asset, "--to", "netcdf", "-o", tmp_path / "netcdf")
    assert status == 2 and "from a recipe with `particles` or `medium` or `packing` and `grains`" in err
