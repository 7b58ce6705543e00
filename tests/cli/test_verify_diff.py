"""`bake verify` and `bake diff`: what they print and how they exit."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bakery.store.tree import Group
from bakery.store.write import write
from tests.conftest import MILK
from tests.samples import small_asset, with_member


@pytest.fixture(scope="module")
def milk(tmp_path_factory):
    """A baked asset."""
    import bakery

    folder = tmp_path_factory.mktemp("milk")
    (folder / "milk.yaml").write_text(MILK.format(name="milk", g=0.7))
    return Path(bakery.bake(folder / "milk.yaml", folder / "milk.h5"))


@pytest.fixture
def scaled(milk, tmp_path):
    """The same with a phase function that is 1 % too large, all hashes right: only physics can tell."""
    from bakery.store.read import read

    root = read(milk)
    phase = root["medium/phase"]
    path = tmp_path / "scaled.h5"
    write(path, with_member(root, "medium/phase", replace(phase, data=1.01 * phase.data)))
    return path


def test_a_sound_asset(call, milk):
    assert call("verify", milk) == (0, f"ok      {milk}  checksums, format and physics hold\n", "")


@pytest.mark.usefixtures("verified_here")
def test_each_asset_has_its_verdict(call, milk, scaled, tmp_path):
    data = bytearray(milk.read_bytes())
    data[len(data) // 2] ^= 4
    (tmp_path / "flipped.h5").write_bytes(data)
    status, out, err = call("verify", milk, tmp_path / "flipped.h5", scaled)
    assert status == 1 and not err
    heads = [line for line in out.splitlines() if not line.startswith(" ")]
    assert [head.split()[0] for head in heads] == ["ok", "broken", "broken"]
    assert "container" in out and "medium" in out.split("scaled.h5")[1]
    sound, *others = json.loads(call("verify", milk, tmp_path / "flipped.h5", scaled, "--json")[1])
    assert sound == {"file": str(milk), "ok": True, "broken": []} and all(not row["ok"] and row["broken"] for row in others)


@pytest.mark.usefixtures("verified_here")
def test_what_is_no_asset(call, milk, tmp_path):
    status, out, err = call("verify", milk, tmp_path / "none.h5")
    assert status == 2 and out.splitlines() == [
        f"ok      {milk}  checksums, format and physics hold", f"missing {tmp_path / 'none.h5'}",
        "        there is no such file; expected the path of a baked asset"]
    status, out, _ = call("verify", tmp_path / "none.h5", milk, tmp_path, "--json")
    assert status == 2 and [row["ok"] for row in json.loads(out)] == [False, True, False]
    (tmp_path / "text.h5").write_text("hello")
    status, out, _ = call("verify", tmp_path / "text.h5")
    assert status == 1 and "not a bakery asset" in out
    assert call("verify")[0] == 2


def test_equal_assets(call, tmp_path):
    root = small_asset()
    write(tmp_path / "a.h5", root)
    write(tmp_path / "b.h5", with_member(root, "provenance", Group()))
    status, out, _ = call("diff", tmp_path / "a.h5", tmp_path / "b.h5")
    assert status == 0 and out.startswith("equal: ")
    found = json.loads(call("diff", tmp_path / "a.h5", tmp_path / "b.h5", "--json")[1])
    assert found["equal"] and found["differences"] == []


def test_differences_by_dataset(call, tmp_path):
    root = small_asset()
    a, b = tmp_path / "a.h5", tmp_path / "b.h5"
    write(a, root)
    g = root["medium/g"]
    other = with_member(root, "medium/g", replace(g, data=g.data * [1, 1 + 1e-9]))
    sigma = root["optics/droplets/scattering"]
    other = with_member(other, "optics/droplets/scattering", replace(sigma, data=sigma.data * (1 + 3e-4)))
    write(b, with_member(other, "medium/more", replace(g, description="one more")))
    status, out, _ = call("diff", a, b)
    rows = {line.split()[0]: line.split() for line in out.splitlines()[3:]}
    assert status == 1 and set(rows) == {"medium/g", "optics/droplets/scattering", "medium/more"}
    assert float(rows["medium/g"][1]) == pytest.approx(1e-9, rel=0.01) and rows["medium/g"][3] == "-"
    # each side states 1e-4 of the value, so 3e-4 apart are 3 / sqrt(2) standard errors of the difference
    assert float(rows["optics/droplets/scattering"][3]) == pytest.approx(3 / np.sqrt(2), rel=0.01)
    assert "only in B" in out
    found = json.loads(call("diff", a, b, "--json")[1])
    assert {row["path"] for row in found["differences"]} == set(rows) and not found["equal"]
    # a tolerance lets numbers pass, never structure
    assert "medium/g" not in call("diff", a, b, "--rtol", "1e-8")[1]
    assert call("diff", a, b, "--rtol", "1")[0] == 1


def test_one_that_the_system_will_not_read_does_not_hide_the_others(call, milk, monkeypatch):
    import bakery.store.read

    def refused(path, files):
        raise PermissionError(13, "Permission denied", path)

    with monkeypatch.context() as patch:
        patch.setattr(bakery.store.read, "_slurped", refused)
        status, out, _ = call("verify", milk)
    assert status == 3 and out.startswith(f"unread  {milk}\n        cannot be read")


def test_a_tolerance_in_per_cent(call, tmp_path):
    root = small_asset()
    write(tmp_path / "a.h5", root)
    write(tmp_path / "b.h5", with_member(root, "medium/g", replace(root["medium/g"], data=1.04 * root["medium/g"].data)))
    assert call("diff", tmp_path / "a.h5", tmp_path / "b.h5", "--rtol", "5%")[0] == 0
    assert call("diff", tmp_path / "a.h5", tmp_path / "b.h5", "--rtol", "3%")[0] == 1


def test_wrong_calls(call, milk, tmp_path):
    for args, said in (((milk, tmp_path / "none.h5"), "no such file"), ((milk, milk, "--rtol", "-1"), "a number from 0"),
                       ((milk, milk, "--rtol", "nan"), "a number from 0"), ((milk,), "B")):
        status, out, err = call("diff", *args)
        assert status == 2 and not out and said in err, err
