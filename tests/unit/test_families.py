"""Families of a medium given by numbers: baked, opened, interpolated, damaged, compared."""

import shutil
from dataclasses import replace
from pathlib import Path

import matplotlib.figure
import numpy as np
import pytest

import bakery
from bakery.asset.compare_families import compare_any
from bakery.cli.inspect import _family
from bakery.family.axes import Axis, Swept
from bakery.family.members import broken
from bakery.family.pictures import pictures
from bakery.family.refine import ROOM, refined
from bakery.family.tree import departures, physics
from bakery.physics.medium.between import Optics, common_angles, difference, hole, interpolated, tabulated
from bakery.plan.asked import Asked
from bakery.run.bake import executed, planned
from bakery.run.family_pilot import foretold
from bakery.run.messages import ClusterLost
from bakery.run.progress import Progress
from bakery.store.missed import missed
from bakery.store.read import read
from bakery.store.write import write
from tests.conftest import slow
from tests.failing import fails_at

LOBES = """\
bakery: 1
name: lobes
wavelengths: [0.55]
tolerance: 5%
medium:
  albedo: 0.9
  mean_free_path: 1 mm
  phase: {type: hg, g: 0.2}
sweep:
  medium.phase.g: [0.0, 0.5, 0.8]
"""


@pytest.fixture(scope="module")
def lobes(tmp_path_factory):
    """(recipe, family): a lobe by its g, refined."""
    folder = tmp_path_factory.mktemp("lobes")
    path = folder / "lobes.yaml"
    path.write_text(LOBES)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        bakery.bake(path, folder / "lobes.h5")
    return path, folder / "lobes.h5"


@pytest.fixture
def own(lobes, tmp_path):
    """A copy of the family with its members, to be damaged."""
    shutil.copytree(lobes[1].parent, tmp_path / "own")
    return tmp_path / "own" / "lobes.h5"


def hg(theta, g):
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * np.cos(theta)) ** 1.5)


# ---- interpolation


def media(values, theta=None):
    theta = np.linspace(0, np.pi, 400) if theta is None else theta
    return [Optics(theta, np.array([1e3 * g]), np.array([g**2]), hg(theta, g)[None, None]) for g in values]


@pytest.mark.parametrize("method, bound", [("cubic", 3e-3), ("linear", 2e-2)])
def test_between_points_and_at_them(method, bound):
    nodes = np.linspace(0.3, 0.5, 5)
    tables = tabulated([np.log(nodes)], media(nodes))
    at = interpolated(tables, [np.log(nodes[2])], method)
    assert difference(at, media([nodes[2]])[0], False) < 1e-4  # it is made to integrate to 1
    middle = 0.5 * (nodes[1] + nodes[2])
    between = interpolated(tables, [np.log(middle)], method)
    assert difference(between, media([middle])[0], False) < bound
    assert between.sigma_s[0] == pytest.approx(1e3 * middle, rel=1e-12)  # powers are lines in logarithms
    assert between.sigma_a[0] == pytest.approx(middle**2, rel=1e-12)
    assert difference(between, media([0.6])[0], False) > 0.3


def test_two_axes_and_a_hole():
    x, y = np.array([1.0, 2.0, 4.0]), np.array([0.0, 1.0])
    points = [(a, b) for a in x for b in y]
    theta = np.array([0.0, 1.0, np.pi])
    made = [Optics(theta, np.array([a]), np.array([b]), np.full((1, 1, 3), 1 / (4 * np.pi))) for a, b in points]
    made[5] = None  # (4, 1)
    tables = tabulated([np.log(x), y], made)
    found = interpolated(tables, [np.log(1.5), 0.25], "linear")
    assert found.sigma_s[0] == pytest.approx(1.5) and found.sigma_a[0] == pytest.approx(0.25)
    assert hole(tables, [np.log(1.5), 0.25]) is None and hole(tables, [np.log(3), 0.0]) is None
    assert hole(tables, [np.log(3), 0.25]) == (2, 1)


def test_common_angles_hold_every_table():
    grids = [np.concatenate([[0.0], np.geomspace(1e-4, 0.1, 60), np.linspace(0.12, np.pi, 40)]), np.linspace(0, np.pi, 91)]
    theta = common_angles(grids)
    assert theta[0] == 0 and theta[-1] == np.pi and (np.diff(theta) > 0).all() and len(theta) < 4 * 101
    for grid in grids:
        low, high = grid[:-1], grid[1:]
        inside = np.searchsorted(theta, high, side="right") - np.searchsorted(theta, low)
        assert (inside[low > 1e-3] >= 2).all()  # as dense as each of them, twice


def test_half_the_points_of_a_uniform_grid():
    """Lobes by g within the tolerance at 100 random places; uniform grids with twice the points are not."""
    theta = np.concatenate([[0.0], np.geomspace(1e-3, 0.2, 100), np.linspace(0.21, np.pi, 200)])

    def medium(point):
        return Optics(theta, np.ones(1), np.zeros(1), hg(theta, point[0])[None, None])

    axes = [Axis((Swept("medium.phase.g", "g", "1", ("0", "0.98"), (0.0, 0.98)),))]
    found = refined(axes, medium, 0.03, False, lambda error: None)
    assert not found.limits and found.error < 0.03 and 10 < len(found.values[0]) < 40
    places = np.random.default_rng(2).uniform(0, 0.98, 100)
    errors = [difference(interpolated(found.tables, [g], found.method), medium([g]), False) for g in places]
    assert 0.01 < max(errors) < 0.03
    nodes = np.linspace(0, 0.98, 2 * len(found.values[0]))
    uniform = tabulated([nodes], [medium([g]) for g in nodes])
    assert difference(interpolated(uniform, [nodes[-2:].mean()], "cubic"), medium([nodes[-2:].mean()]), False) > 0.03


# ---- the file


def test_points_are_added_and_places_between_are_within_the_tolerance(lobes):
    family = bakery.open(lobes[1])
    axis = family.axes["g"]
    assert 5 <= len(axis.values) <= 10 and family.achieved_error <= family.tolerance == 0.05 and (axis.error > 0).all()
    worst = 0.0
    for g in np.random.default_rng(7).uniform(0, 0.8, 15):
        medium = family.at(g=g).medium
        worst = max(worst, np.max(np.abs(medium["phase"][0] / hg(medium.theta, g) - 1)), abs(medium.g[0] - g))
    assert 0.003 < worst < family.tolerance
    assert family.at(g=0.5).medium.albedo[0] == pytest.approx(0.9)
    assert family.at(g=np.array([0.5])).content_hash == family.at(g=np.float64(0.5)).content_hash == family.at(g=0.5).content_hash


def test_a_place_is_an_asset(lobes, tmp_path):
    family = bakery.open(lobes[1])
    place = family.at(g="0.3")
    path = place.save(tmp_path / "place.h5")
    again = bakery.open(path)
    assert again.content_hash == place.content_hash and again.medium.phase([0.0, 1.0]).shape == (1, 2)
    assert "interpolated at g 0.3" in again.provenance["medium/notes"]
    with pytest.raises(bakery.UsageError, match="is read by this very call"):
        place.save(lobes[1])
    assert "g: 0.3" in again.recipe and "none" in again.recipe  # what bakes it anew, without the sweep
    (tmp_path / "again.yaml").write_text(again.recipe)
    bakery.bake(tmp_path / "again.yaml", tmp_path / "baked.h5")
    assert bakery.open(tmp_path / "baked.h5").medium.g[0] == pytest.approx(again.medium.g[0], abs=2e-3)
    member = next(each for each in family.members if each.at["g"] == 0.5)
    assert member.open().medium.g[0] == pytest.approx(family.at(g=0.5).medium.g[0], abs=1e-4)


@pytest.mark.slow
def test_the_error_at_a_point_is_the_members_own(tmp_path):
    """Of two axes: between the points of one its error counts, of none nothing but the member's; a member's tolerance is 5 %."""
    (tmp_path / "lobes.yaml").write_text(LOBES.replace("[0.0, 0.5, 0.8]", "[0.1, 0.2]"))
    settings = {"sweep.medium.albedo": "[0.8, 0.9]", "sweep.tolerance": "20%"}
    family = bakery.open(bakery.bake(tmp_path / "lobes.yaml", tmp_path / "lobes.h5", settings=settings))
    largest = max(member.open().stages["medium"]["achieved_error"] for member in family.members)
    for member in family.members:
        stage = family.at(**member.at).stages["medium"]
        assert stage["achieved_error"] == member.open().stages["medium"]["achieved_error"]
        assert stage["tolerance"] == 0.05 and stage["error_measure"].startswith("error of the member")
    both, one = (family.at(**at).stages["medium"] for at in ({"g": 0.15, "albedo": 0.85}, {"g": 0.15, "albedo": 0.9}))
    assert both["achieved_error"] == pytest.approx(family.achieved_error + largest) and both["tolerance"] == pytest.approx(0.25)
    assert largest < one["achieved_error"] < both["achieved_error"]
    assert one["achieved_error"] == pytest.approx(family.axes["g"].error.max() / ROOM + largest)


@pytest.mark.parametrize("values, says", [
    ({"g": 0.9}, "g: found 0.9; the family covers 0 to 0.8"),
    ({"h": 0.5}, 'found "h"; the axes of the family are g (1)'),
    ({}, "found no value of g"),
    ({"g": "5 um"}, 'g: found "5 um"; expected a number without unit'),
    ({"g": float("nan")}, "g: found nan; the family covers 0 to 0.8"),
    ({"g": [0.1, 0.2]}, 'g: found "[0.1, 0.2]"; expected one number, or text with a unit'),
    ({"g": None}, 'g: found "None"; expected one number, or text with a unit'),
    ({"g": 10**400}, "g: found inf; the family covers 0 to 0.8"),
    ({"g": np.complex64(0.3 + 1j)}, "expected one number, or text with a unit"),
    ({"g": b"0.3"}, "expected one number, or text with a unit"),
])
def test_places_that_there_are_not(lobes, values, says):
    with pytest.raises(bakery.UsageError) as error:
        bakery.open(lobes[1]).at(**values)
    assert says in str(error.value)


def test_a_key_that_goes_in_step_with_the_axis_is_told_so(tmp_path):
    (tmp_path / "lobes.yaml").write_text(LOBES.replace("[0.0, 0.5, 0.8]", "[0.1, 0.5]"))
    settings = {"sweep.medium.mean_free_path": "[1, 4] mm", "sweep.refine": "false", "sweep.combine": "zip"}
    family = bakery.open(bakery.bake(tmp_path / "lobes.yaml", tmp_path / "lobes.h5", settings=settings))
    assert list(family.axes) == ["mean_free_path"]  # the first by the alphabet
    with pytest.raises(bakery.UsageError, match='found "g", which goes in step with mean_free_path; give mean_free_path'):
        family.at(g=0.3)


def test_a_family_is_no_asset(lobes):
    with pytest.raises(bakery.AssetError, match=r"is a family of assets, which has no 'medium' of its own: `at\(g=…\)`"):
        _ = bakery.open(lobes[1]).medium


def test_up_to_date_and_again(lobes, tmp_path):
    recipe, family = lobes
    before = family.stat().st_mtime_ns
    plan = planned(recipe, family)
    assert not plan.write and not executed(plan).written
    assert family.stat().st_mtime_ns > before
    assert planned(recipe, family, asked=Asked({"sweep.tolerance": "4%"})).write
    assert planned(recipe, family, force=True).write


@pytest.mark.slow
def test_a_member_that_is_gone_is_baked_again(own, monkeypatch):
    monkeypatch.setenv("BAKERY_CACHE", str(own.parent / "cache"))
    recipe, gone = own.with_suffix(".yaml"), next((own.parent / "lobes").glob("g_0.5.h5"))
    gone.unlink()
    assert [line.partition(";")[0] for line in broken(own, read(own))] == [f"member g 0.5: {gone}: there is no such file"]
    plan = planned(recipe, own)
    assert plan.write
    before = own.read_bytes()
    assert executed(plan).written and gone.exists() and own.read_bytes() == before  # its own file is as it was


def test_members_that_a_family_has_no_more_are_removed(own, monkeypatch):
    monkeypatch.setenv("BAKERY_CACHE", str(own.parent / "cache"))
    recipe, folder = own.with_suffix(".yaml"), own.with_suffix("")
    before = {path.name for path in folder.iterdir()}
    shutil.copy(folder / "g_0.5.h5", folder / "mine.h5")  # what the family does not list stays
    added = sorted(before - {"g_0.h5", "g_0.5.h5", "g_0.8.h5"})
    (folder / added[0]).write_text("no asset")
    shutil.copy(folder / "g_0.5.h5", folder / added[1])  # nor does it list this one: it is another asset
    bakery.bake(recipe, own, settings={"medium.albedo": "0.2", "sweep.refine": "false"})
    assert len(added) > 2
    assert {path.name for path in folder.iterdir()} == {"g_0.h5", "g_0.5.h5", "g_0.8.h5", "mine.h5", *added[:2]}
    assert broken(own, read(own)) == []


@pytest.mark.slow
def test_a_place_that_is_no_member_any_more_is_removed_though_it_was_baked_anew(tmp_path, monkeypatch):
    """It is a middle of the new family, which passes; a file of someone else in such a place is not written over."""
    monkeypatch.setenv("BAKERY_CACHE", str(tmp_path / "cache"))
    recipe, family, folder = tmp_path / "lobes.yaml", tmp_path / "lobes.h5", tmp_path / "lobes"
    recipe.write_text(LOBES)
    bakery.bake(recipe, family)
    before = {path.name for path in folder.iterdir()}
    bakery.bake(recipe, family, settings={"sweep.tolerance": "40%", "medium.albedo": "0.2"})
    members = {member.path.name for member in bakery.open(family).members}
    assert {path.name for path in folder.iterdir()} == members < before
    (other := folder / "g_0.25.h5").write_bytes((folder / "g_0.8.h5").read_bytes())  # half-way from 0 to 0.5
    bytes_ = other.read_bytes()
    bakery.bake(recipe, family, settings={"sweep.tolerance": "40%", "medium.albedo": "0.3"})
    assert other.name not in members and other.read_bytes() == bytes_


def test_a_family_that_moved_leaves_the_members_of_its_old_name(own, monkeypatch):
    """Its file lists them until it is baked again; another family of that name may have them."""
    monkeypatch.setenv("BAKERY_CACHE", str(own.parent / "cache"))
    before = {path.name for path in own.with_suffix("").iterdir()}
    moved = own.rename(own.with_name("moved.h5"))
    bakery.bake(own.with_suffix(".yaml"), moved, settings={"sweep.refine": "false"})
    assert {path.name for path in own.with_suffix("").iterdir()} == before and len(list(moved.with_suffix("").iterdir())) == 3


@pytest.mark.parametrize("damage, says", [
    (lambda path: path.write_bytes(path.read_bytes()[:-1] + b"x"), "do not match the SHA-256"),
    (lambda path: path.write_bytes(path.with_name("g_0.8.h5").read_bytes()), "another asset than the family was made of"),
])
def test_a_damaged_member_is_named_and_the_others_serve(own, damage, says):
    damage(own.parent / "lobes" / "g_0.5.h5")
    (line,) = broken(own, read(own))
    assert line.startswith("member g 0.5:") and says in line
    assert bakery.open(own).at(g=0.5).medium.g[0] == pytest.approx(0.5, abs=1e-3)


def without(group, path):
    head, _, rest = path.partition("/")
    members = dict(group.members)
    if rest:
        members[head] = without(members[head], rest)
    else:
        del members[head]
    return replace(group, members=members)


def changed(group, path, data):
    head, _, rest = path.partition("/")
    inner = group.members[head]
    inner = changed(inner, rest, data) if rest else replace(inner, data=data(inner.data))
    return replace(group, members={**group.members, head: inner})


@pytest.mark.parametrize("wrong, says", [
    (lambda root: without(root, "family/members"), "KeyError: 'members'"),
    (lambda root: without(root, "family/axes/g/value"), "KeyError: 'value'"),
    (lambda root: changed(root, "family/axes/g/value", lambda data: data[::-1]), "family/axes/g/value: not ascending"),
    (lambda root: changed(root, "family/phase", lambda data: data[:-1]), "family/phase: not numbers of the shape"),
    (lambda root: changed(root, "family/members/file", lambda data: np.zeros(data.shape)), "members/file: not texts"),
    (lambda root: replace(root, members=root.members | {"family": replace(root["family"], attributes={
        "stage": "family", "stage_version": 1, "method": "cubic"})}), "tolerance is missing or not float"),
])
def test_what_is_no_family_is_refused(lobes, tmp_path, wrong, says):
    write(tmp_path / "wrong.h5", wrong(read(lobes[1])))
    with pytest.raises(bakery.AssetError) as error:
        bakery.open(tmp_path / "wrong.h5")
    assert says in str(error.value)


def test_values_that_are_no_media_are_found(lobes):
    root = read(lobes[1])
    assert departures(root) == physics(root) == []
    assert physics(changed(root, "family/phase", lambda data: 1.01 * data)) == [
        "family: phase does not integrate to 1", "family: g is not the mean cosine of phase"]
    assert physics(changed(root, "family/sigma_a", lambda data: -data))[0] == "family: a coefficient below 0"


# ---- extremes


def test_one_point(tmp_path, monkeypatch):
    path = tmp_path / "one.yaml"
    path.write_text(LOBES.replace("[0.0, 0.5, 0.8]", "0.5"))
    family = bakery.open(bakery.bake(path, tmp_path / "one.h5"))
    assert len(family.members) == 1 and family.achieved_error == 0
    assert family.at(g=0.5).medium.g[0] == pytest.approx(0.5, abs=1e-3)
    assert "'lobes', 1 asset, " in repr(family) and "  g  0.5, medium.phase.g" in repr(family)
    monkeypatch.setattr("bakery.draw.picture.drawn", lambda picture, forms, of="": {"png": b"PNG of " + picture.name.encode()})
    assert "data:image/png;base64,UE5HIG9mIHBoYXNl" in family._repr_html_()  # "PNG of phase": its only place, as of `bake plot`
    with pytest.raises(bakery.UsageError, match="covers 0.5 alone"):
        family.at(g=0.4)


@pytest.mark.slow
def test_a_point_that_fails_is_named_and_the_others_are_there(tmp_path, monkeypatch):
    mended = fails_at(monkeypatch, 0.5, ValueError("no such lobe"))
    path = tmp_path / "lobes.yaml"
    path.write_text(LOBES.replace("[0.0, 0.5, 0.8]", "[0.0, 0.2, 0.5, 0.8]") + "  tolerance: 40%\n")
    with pytest.raises(bakery.StageError, match=r"point failed: g 0.5: phase function hg: no such lobe") as error:
        bakery.bake(path, tmp_path / "lobes.h5")
    assert "between g 0.5 and g 0.8 its error is not known" in str(error.value)
    family = bakery.open(tmp_path / "lobes.h5")
    assert [member.reason for member in family.members if member.at["g"] == 0.5] == ["phase function hg: no such lobe"]
    assert family.method == "linear" and "point failed" in missed(family.tree)["family"]
    assert "'lobes', 3 assets (1 point failed), linear between them" in repr(family)
    assert broken(tmp_path / "lobes.h5", family.tree) == []
    assert family.at(g=0.1).medium.g[0] == pytest.approx(0.1, abs=0.02)
    with pytest.raises(bakery.AssetError, match=r"g 0.6 needs the point g 0.5, which failed: phase function hg: no such lobe"):
        family.at(g=0.6)
    answer = family.query("family/g")
    assert answer.values[2, 0] == 0
    assert [remark.text for remark in answer.remarks] == ["zeros stand for points that failed: g 0.5"]
    assert not family.query("family/members/reason").remarks
    mended()
    assert bakery.open(bakery.bake(path, tmp_path / "lobes.h5")).method == "cubic"  # what failed is tried again


def test_a_lost_cluster_is_no_fault_of_a_point(tmp_path, monkeypatch):
    """No family with holes is written; what was baked stays, and the same call goes on."""
    mended = fails_at(monkeypatch, 0.5, ClusterLost("the scheduler of the cluster is gone"))
    (tmp_path / "lobes.yaml").write_text(LOBES + "  tolerance: 40%\n")
    with pytest.raises(ClusterLost):
        bakery.bake(tmp_path / "lobes.yaml", tmp_path / "lobes.h5")
    assert not (tmp_path / "lobes.h5").exists() and [path.name for path in (tmp_path / "lobes").iterdir()] == ["g_0.h5"]
    mended()
    assert not any(member.reason for member in bakery.open(bakery.bake(tmp_path / "lobes.yaml", tmp_path / "lobes.h5")).members)


@pytest.mark.slow
def test_a_middle_that_failed_is_tried_again(tmp_path, monkeypatch):
    mended = fails_at(monkeypatch, 0.4, ValueError("no such lobe"))
    (tmp_path / "lobes.yaml").write_text(LOBES.replace("[0.0, 0.5, 0.8]", "[0.0, 0.8]"))
    with pytest.raises(bakery.StageError, match="its error is not known: a point there failed"):
        bakery.bake(tmp_path / "lobes.yaml", tmp_path / "lobes.h5")
    family = bakery.open(tmp_path / "lobes.h5")
    assert family.achieved_error is None and np.isnan(family.axes["g"].error).tolist() == [True]
    (remark,) = family.query("family/axes/g/error").remarks
    assert remark.text == "zeros stand for intervals whose error is not known"
    assert _family(family)["axes"][0]["error"] == [None]  # as JSON takes it
    assert missed(family.at(g=0.4).tree) == {
        "medium": "the error of the interpolation between g 0 and g 0.8 is not known: a point there failed"}
    assert missed(family.at(g=0.8).tree) == {}
    (drawn, *_) = pictures(family.tree)
    figure = matplotlib.figure.Figure()
    drawn.draw(figure)
    (panel,) = [panel for panel in figure.axes if panel.get_title() == "Error between members: not known"]
    assert np.isnan(panel.lines[0].get_ydata()).all()
    mended()
    family = bakery.open(bakery.bake(tmp_path / "lobes.yaml", tmp_path / "lobes.h5"))
    assert len(family.members) > 2 and 0 < family.achieved_error < family.tolerance


def test_no_point_at_all(tmp_path, monkeypatch):
    fails_at(monkeypatch, None, ValueError("no such lobe"))
    (tmp_path / "lobes.yaml").write_text(LOBES)
    with pytest.raises(bakery.StageError, match="no point could be baked: phase function hg: no such lobe"):
        bakery.bake(tmp_path / "lobes.yaml", tmp_path / "lobes.h5")
    assert not (tmp_path / "lobes.h5").exists()


def test_ten_thousand_points_are_planned_and_refused_where_they_have_no_room(tmp_path, monkeypatch):
    path = tmp_path / "lobes.yaml"
    path.write_text(LOBES.replace("[0.0, 0.5, 0.8]", "{from: 0.1, to: 0.8, count: 10000}"))
    plan = planned(path, tmp_path / "lobes.h5")
    assert plan.points == 10_000 and plan.middles == 9_999 and plan.seconds > 100 and 5e7 < plan.file < 1e10
    monkeypatch.setattr("bakery.run.family_plan.free_space", lambda path: int(plan.file))
    with pytest.raises(bakery.UsageError, match=r"10,000 points take about .* are free there"):
        planned(path, tmp_path / "lobes.h5")
    assert not any(tmp_path.glob("*.h5"))


@pytest.mark.slow
@pytest.mark.parametrize("several", [slow(False), True], ids=["one wavelength", "values for each of three"])
def test_a_pilot_counts_what_the_bake_will_take(tmp_path, monkeypatch, several):
    """All its points, and all places: on one axis a place between each two points is the last to be looked at."""
    path = tmp_path / "lobes.yaml"
    path.write_text(LOBES.replace("[0.55]\n", "rgb\n").replace("0.9\n", "[0.9, 0.8, 0.7]\n") if several else LOBES)
    plan = foretold(planned(path, tmp_path / "lobes.h5"), Progress())
    family = bakery.bake(path, tmp_path / "lobes.h5")
    count = len(family.axes["g"].values)
    assert plan.expected == (count, 2 * count - 1, True) and count > plan.points
    before = replace(plan, expected=None)
    assert plan.seconds / before.seconds == pytest.approx((2 * count - 1) / 5) and plan.file > before.file
    assert plan.as_dict()["expected"] == {"points": count, "places": 2 * count - 1, "complete": True}
    monkeypatch.setattr("bakery.run.family_pilot.PATIENCE", 0.0)
    assert foretold(before, Progress()) == before and before.expected is None
    monkeypatch.setattr("bakery.run.family_pilot._first", lambda plan: 0.0)
    assert foretold(before, Progress()).expected == (3, 5, False)


def test_what_points_do_not_help_ends():
    """Media whose own errors are larger than the tolerance: after two halvings it is said."""
    def medium(point):
        theta = np.linspace(0, np.pi, 50)
        return Optics(theta, np.array([1 + 0.2 * np.sin(1e6 * point[0])]), np.zeros(1), np.full((1, 1, 50), 1 / (4 * np.pi)))

    axes = [Axis((Swept("medium.sigma_s", "sigma_s", "/m", ("1 /m", "2 /m"), (1.0, 2.0)),))]
    found = refined(axes, medium, 0.05, False, lambda error: None)
    assert "more points do not help" in found.limits[0] and len(found.values[0]) < 30 and found.error > 0.05
    found = refined(axes, lambda point: medium((1.0,)), 0.05, False, lambda error: None)
    assert found.limits == [] and found.error == 0 and found.values == [[1.0, 2.0]]


# ---- two families


def test_families_are_compared_at_the_points_of_both(lobes, tmp_path):
    recipe, family = lobes
    assert compare_any(family, family) == []
    plain = bakery.bake(recipe, tmp_path / "plain.h5", settings={"sweep.refine": "false"})
    assert plain.achieved_error is None
    assert [row.kind for row in compare_any(family, plain)] == ["grid"]
    rows = {row.path: row for row in compare_any(family, plain, 0.01)}
    assert rows["medium/phase"].relative > 0.02 and rows["medium/phase"].text.startswith("at g 0.")
    with pytest.raises(bakery.UsageError, match="is a family, the other file is one asset"):
        compare_any(family, Path(str(family)).parent / "lobes" / "g_0.5.h5")
