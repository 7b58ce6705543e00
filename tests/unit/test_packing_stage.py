"""The stage `packing`: from a recipe to tiles in an asset, its rules, what is refused, what is exported and drawn."""

import math
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import bakery
from bakery.asset.verify import _broken
from bakery.errors import AssetError, RecipeError, StageError
from bakery.physics.packing.tiles import tile_of
from bakery.recipe import load
from bakery.run import overrides
from bakery.run.bake import planned
from bakery.run.executors import Context, threads
from bakery.stages import conform
from bakery.stages.packing import stage, view
from bakery.store.tree import Dataset, Group
from tests.conftest import slow
from tests.samples import small_asset, with_member

TILE = "bakery: 1\nname: tile\ntolerance: 30%\npacking: {{{}}}\n"


@pytest.fixture
def write(tmp_path):
    def recipe(inside: str, more: str = ""):
        path = tmp_path / "tile.yaml"
        path.write_text(TILE.format(inside) + more)
        return path

    return recipe


@pytest.fixture
def bake(write, tmp_path):
    def baked(inside: str, name: str = "tile.h5", **options):
        return bakery.open(bakery.bake(write(inside), output=tmp_path / name, **options))

    return baked


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """A dictionary of two small tiles."""
    import os

    folder = tmp_path_factory.mktemp("two")
    os.environ["BAKERY_CACHE"] = str(folder / "cache")
    (folder / "two.yaml").write_text(TILE.format("fraction: [40%, 0.2], count: 60, seed: 4"))
    return bakery.open(bakery.bake(folder / "two.yaml", output=folder / "two.h5"))


# ---- recipes


def test_values_and_defaults(write):
    recipe = load(write("fraction: 0.6"))
    assert (recipe.packing.fraction, recipe.packing.count, recipe.packing.cell) == ((0.6,), 500, (1.0, 1.0, 1.0))
    assert recipe.packing.radii == "equal" and recipe.packing.growth is recipe.packing.equilibration is None
    assert recipe.packing.seed == recipe.leaves["packing.seed"] == 0
    # one fraction is one tile, however many wavelengths there are
    assert [key for key in recipe.leaves if key.startswith("packing.fraction")] == ["packing.fraction[0]"]
    assert load(write("fraction: 0.6", "seed: 7\n")).packing.seed == 7
    recipe = load(write("fraction: [10%, 0.2], seed: 3, growth: 0.05, equilibration: 20, radii: {distribution: lognormal, sigma: "
                        "1.3}, cell: [1, 2, 3], count: 50"))
    assert recipe.packing.fraction == (0.1, 0.2) and recipe.packing.seed == 3 and recipe.packing.growth == 0.05
    assert recipe.packing.equilibration == 20 and recipe.packing.radii.sigma == 1.3 and recipe.packing.cell == (1, 2, 3)
    assert load(write("fraction: 0.1, radii: [{share: 40%, radius: 1}, {share: 0.6, radius: 2}]")).packing.radii == (
        {"share": 0.4, "radius": 1.0}, {"share": 0.6, "radius": 2.0})


@pytest.mark.parametrize("inside, place, words", [
    ("fraction: 0.74", "packing.fraction", r'found 0\.74; expected at most 0\.64, as far as equal spheres.*several sizes'),
    ("fraction: [0.3, 0.65]", "packing.fraction[1]", r"found 0\.65; expected at most 0\.64"),
    ("fraction: 1.2", "packing.fraction", r"below 1"),
    ("fraction: 0", "packing.fraction", r"at least 1e-06"),
    ("fraction: [0.3, 30%]", "packing.fraction[1]", r"30 % more than once; expected distinct"),
    ("fraction: 0.6, count: 1", "packing.fraction", r"the sphere meets its own image: the cell is 0\.956 .*less than 0\.523"),
    ("fraction: 0.5, count: 100, cell: [1, 1, 0.01]", "packing.fraction", r"largest of 100 spheres meets its own image"),
    ("fraction: 0.3, count: 0", "packing.count", r"from 1 to"),
    ("fraction: 0.3, count: 10, radii: [{share: 0.99, radius: 1}, {share: 0.01, radius: 3}]", "packing.radii",
     r"a share of 0\.01 of 10 spheres is none"),
    ("fraction: 0.3, radii: [{share: 0.5, radius: 1}, {share: 0.4, radius: 3}]", "packing.radii", r"add up to 0\.9"),
    ("fraction: 0.3, growth: 2", "packing.growth", r"auto or|at most 1"),
    ("count: 10", "packing.fraction", r"missing"),
])
def test_refused_before_any_work(write, inside, place, words):
    with pytest.raises(RecipeError, match=words) as refused:
        planned(write(inside))
    assert [problem.key for problem in refused.value.problems] == [place]
    assert all(problem.line == 4 and problem.file.endswith("tile.yaml") for problem in refused.value.problems)


def test_several_sizes_reach_more_than_equal_ones(write):
    path = write("fraction: 0.65, radii: {distribution: lognormal, sigma: 1.5}")
    assert load(path).packing.fraction == (0.65,)


def test_a_tile_beside_a_medium_has_no_effect(write):
    with pytest.raises(RecipeError, match="packing beside medium, which it has no effect on; expected it alone or with grains"):
        load(write("fraction: 0.1", "medium: {albedo: 1, mean_free_path: 1 m, phase: {type: isotropic}}\n"))


# ---- bakes


def test_a_tile_holds_what_the_contract_says(bake, call):
    asset = bake("fraction: 0.5, count: 64, seed: 1")
    tile = asset.packing
    assert tile.centers.shape == (64, 3) and tile.radii.shape == (64,) and tile.cell.shape == (3,)
    assert tile.fraction[0] == pytest.approx(0.5, rel=1e-12) and tile.radii.mean() == pytest.approx(1, abs=1e-14)
    assert tile.contacts_per_sphere.shape == tile.error["contacts_per_sphere"].shape == (1,)
    assert tile.pair_correlation.r.shape == tile.pair_correlation.g.shape == tile.pair_correlation.error["g"].shape
    chords = tile.chord_length
    assert chords.edges.size == chords.density.size + 1 and chords.mean_exact[0] == pytest.approx(4 / 3, rel=1e-12)
    assert abs(chords.mean[0] - 4 / 3) < 5 * chords.error["mean"][0]
    assert _broken(str(asset.path)) == []
    assert asset.stages["packing"]["achieved_error"] <= 0.3
    status, out, _ = call("query", asset.path, "packing/fraction")
    assert status == 0 and "0.5" in out


@pytest.mark.slow
@pytest.mark.parametrize("inside, count", [
    ("fraction: 0.3, count: 1", 1), ("fraction: 0.4, count: 2", 2), ("fraction: 0.4, count: 3, cell: [1, 1, 2]", 3),
    ("fraction: 0.01, count: 8", 8),
])
def test_few_spheres(bake, inside, count):
    tile = bake(inside).packing
    assert tile.radii.size == count and ("pair_correlation" in tile) == (count > 1)


@pytest.mark.slow
def test_same_content_for_any_number_of_threads(bake):
    inside = "fraction: [0.1, 0.3, 0.5], count: 40"
    first, again = bake(inside, "a.h5", jobs=1), bake(inside, "b.h5", jobs=3, force=True)
    assert first.tree["packing"].attributes["content_hash"] == again.tree["packing"].attributes["content_hash"]
    # a tile does not depend on the others of its dictionary
    alone = bake("fraction: 0.3, count: 40", "c.h5")
    assert (alone.packing.centers == first.packing["f30/centers"]).all()
    assert (alone.packing.chord_length.density == first.packing["f30/chord_length/density"]).all()
    other = bake("fraction: 0.3, count: 40, seed: 1", "d.h5")
    assert (other.packing.centers != alone.packing.centers).any()


def test_sizes(bake):
    tile = bake("fraction: 0.4, count: 50, radii: [{share: 0.8, radius: 2}, {share: 0.2, radius: 5}]").packing
    sizes, numbers = np.unique(np.round(tile.radii, 12), return_counts=True)
    assert numbers.tolist() == [40, 10] and sizes[1] / sizes[0] == pytest.approx(2.5) and tile.radii.mean() == pytest.approx(1)
    assert tile.fraction[0] == pytest.approx(0.4, rel=1e-12)


def test_size_of_the_file_is_foreseen(write, tmp_path):
    plan = planned(write("fraction: [0.1, 0.2], count: 400"), tmp_path / "t.h5")
    size = Path(bakery.bake(write("fraction: [0.1, 0.2], count: 400"), output=tmp_path / "t.h5")).stat().st_size
    assert 0.7 < plan.file / size < 1.5


# ---- a dictionary


def test_a_dictionary_has_a_group_a_tile(two):
    assert list(two.packing) == ["f20", "f40"] and two.packing.f40.fraction[0] == pytest.approx(0.4)
    assert [view.tile_name(f) for f in (0.001, 0.1, 0.625, 1 / 3)] == ["f0_1", "f10", "f62_5", "f33_3333"]


@pytest.mark.parametrize("wished, name", [(0.05, "f20"), (0.2, "f20"), (0.21, "f40"), (0.4, "f40"), (0.45, "f40")])
def test_the_nearest_denser_tile_is_widened(two, wished, name):
    from bakery.physics.packing import structure

    centers, radii, cell, _ = tile_of(two.packing, {"fraction": [wished]})
    assert structure.fraction(radii, cell) == pytest.approx(min(wished, 0.4), rel=1e-12 if wished <= 0.4 else 1e-3)
    assert (radii == two.packing[name].radii).all() and (centers < cell).all()
    assert structure.smallest_gap(centers, radii, cell) >= -1e-9


# ---- rules


def broken(group: Group, path: str, change) -> list[str]:
    old = group[path]
    changed = with_member(group, path, Dataset(change(old.data.copy()), old.units, old.description))
    return conform.broken(stage.STAGE, changed)


def moved(to):
    def change(data):
        data.reshape(-1)[0] = to(data.reshape(-1)[0])
        return data

    return change


@pytest.mark.parametrize("path, change, words", [
    ("f20/centers", lambda c: np.vstack([c[1:2] + 1e-3, c[1:]]), "two spheres overlap, 2 centres lie where one has room"),
    ("f20/centers", lambda c: np.vstack([c[1:][np.argmin(c[1:, 2])] + [0, 0, 1.9], c[1:]]), "two spheres overlap by "),
    ("f20/centers", lambda c: c + 50, "a centre outside"),
    ("f20/radii", lambda r: 1.01 * r, "mean radius is 1.01"),
    ("f20/cell", lambda c: 1.001 * c, "fraction is not the volume"),
    ("f20/fraction", moved(lambda f: f * (1 + 1e-9)), "fraction is not the volume"),
    ("f20/smallest_gap", moved(lambda g: g + 1e-6), "smallest_gap is not"),
    ("f20/chord_length/density", lambda d: 1.001 * d, "integrates to 1.00"),
    ("f20/chord_length/mean", moved(lambda m: 1.5 * m), "more than six standard errors"),
    ("f20/chord_length/mean_exact", moved(lambda m: 1.001 * m), "mean_exact is not 4 V/S"),
    ("f20/pair_correlation/g_error", moved(lambda m: -1.0), "g_error: holds -1, below 0"),
    ("f20/bond_order", moved(lambda m: 1.5), "bond_order: holds 1.5, above 1"),
    ("f20/rattlers", moved(lambda m: np.nan), "rattlers: not finite"),
])
def test_a_broken_rule_is_named(two, path, change, words):
    faults = broken(two.tree["packing"], path, change)
    assert any(words in fault and "f20" in fault for fault in faults), faults


def test_sound_groups_and_empty_ones(two):
    assert list(stage.check(two.tree["packing"])) == []
    assert conform.broken(stage.STAGE, Group()) == ["holds no tile"]


# ---- what can happen on the way


@pytest.fixture
def packed(monkeypatch):
    """`pack` as it is, its result changed."""
    import bakery.physics.packing

    original = bakery.physics.packing.pack

    def change(**fields):
        monkeypatch.setattr(bakery.physics.packing, "pack", lambda *args, **more: replace(original(*args, **more), **fields))

    return change


def compute(write, inside):
    recipe = load(write(inside))
    return stage.compute(stage.inputs(recipe, {}), Context(recipe.tolerance))


def test_what_was_not_reached_is_stored_and_said(write, packed):
    packed(wished=0.35, reached=False, status="jammed", reason="the pressure rose above 1e6")
    result = compute(write, "fraction: 0.3, count: 30")
    assert result.achieved_error == pytest.approx(0.05 / 0.35, rel=0.5) and result.achieved_error >= 0.05 / 0.35 - 1e-12
    assert "0.35 was not reached: the pressure rose above 1e6; stored is the tile of fraction 0.3" in result.missed[0]
    assert list(stage.check(Group(result.members))) == []


def test_a_crystal_is_not_stored(write, packed):
    packed(status="crystal", reached=False, reason="three streams crystallised")
    with pytest.raises(StageError, match="three streams crystallised; nothing is stored"):
        compute(write, "fraction: 0.3, count: 30")


def test_an_interrupt_reaches_the_threads(write, monkeypatch):
    """The bake's thread is interrupted while a worker packs: the worker stops at its next report."""
    import bakery.physics.packing

    started, ended = threading.Event(), []

    def forever(fraction, radii, cell, *, report, **more):
        try:
            while True:
                report(0.1, 1.0, 0.5)
                started.set()
                threading.Event().wait(0.01)
        except KeyboardInterrupt:
            ended.append(fraction)
            raise RuntimeError("stopped") from None

    monkeypatch.setattr(bakery.physics.packing, "pack", forever)
    recipe = load(write("fraction: 0.3, count: 30"))
    with threads(1) as pool:
        context = Context(0.3, 0, pool)

        def interrupted(function, tasks):
            futures = [pool.submit(function, *task) for task in tasks]
            assert started.wait(20) and futures
            raise KeyboardInterrupt

        context.map = interrupted
        with pytest.raises(KeyboardInterrupt):
            stage.compute(stage.inputs(recipe, {}), context)
    assert ended == [0.3]


def test_quality_chooses_the_schedule():
    from bakery.physics.packing import SCHEDULES

    assert [stage._schedule(t, None, None) for t in (0.1, 0.03, 0.01, 1e-4)] == [
        SCHEDULES["draft"], SCHEDULES["preview"], SCHEDULES["final"], SCHEDULES["final"]]
    own = stage._schedule(0.01, 0.003, 7)
    assert min(rate for _, rate in own.growth) == pytest.approx(0.003) and own.equilibrate == 7
    assert [until for until, _ in own.growth] == [until for until, _ in SCHEDULES["final"].growth]


def test_errors_against_a_converged_tile(two):
    group = two.tree["packing"]
    same = stage.measures(group, group)
    assert same["g2"] == same["second_moment"] == 0 and same["fraction"] < 1e-12 and 0 < same["mean_chord"] < 0.1
    assert list(same)[0] == "error"
    other = Group({"f20": group["f40"], "f40": group["f20"]})
    assert stage.measures(other, group)["g2"] > 0.1 and stage.measures(other, group)["fraction"] == pytest.approx(1)


# ---- other software, pictures


def test_ply_and_xyz_hold_every_digit(two):
    from bakery.export.tiles import ply_files, xyz_files

    tile = two.packing.f20
    stored = np.column_stack([tile.centers, tile.radii])
    assert list(ply_files(two.tree)) == ["_f20.ply", "_f40.ply"]
    lines = ply_files(two.tree)["_f20.ply"].splitlines()
    assert lines[:2] == ["ply", "format ascii 1.0"] and "element vertex 60" in lines
    body = lines[lines.index("end_header") + 1:]
    assert (np.array([row.split() for row in body], float) == stored).all()
    count, head, *rows = xyz_files(two.tree)["_f20.xyz"].splitlines()
    assert count == "60" and 'pbc="T T T"' in head and "radius:R:1" in head
    lattice = np.array(head.split('"')[1].split(), float).reshape(3, 3)
    assert (lattice == np.diag(tile.cell)).all()
    assert (np.array([row.split()[1:] for row in rows], float) == stored).all()
    with pytest.raises(AssetError, match="no stage `packing`"):
        ply_files(small_asset())


def test_csv_has_one_table_of_spheres_a_tile(two):
    from bakery.export.csv import csv_files

    files = csv_files(two.tree)
    assert {f"packing_{tile}_{what}.csv" for tile in ("f20", "f40") for what in
            ("spheres", "pair_correlation", "chord_length", "figures")} <= set(files)
    head, *rows = files["packing_f20_spheres.csv"].splitlines()
    assert head == "x [mean radius],y [mean radius],z [mean radius],radius [mean radius]" and len(rows) == 60
    assert (np.array([row.split(",") for row in rows], float)[:, :3] == two.packing.f20.centers).all()
    assert any(row.startswith("chord_length/mean_exact,") for row in files["packing_f40_figures.csv"].splitlines())
    assert not any("centers" in name for name in files)


def test_a_sphere_covers_its_disc():
    """The drawn picture of four spheres apart: their area to a pixel's width along the rims, lit in front, one in colour."""
    from bakery.stages.packing.pictures import rendered

    image, (left, right, bottom, top), corners = rendered(np.full((1, 3), 6.0), np.ones(1), np.full(3, 12.0), 300)
    pixel = (right - left) / image.shape[1]
    assert (top - bottom) / image.shape[0] == pytest.approx(pixel)
    assert image[..., 3].sum() / 255 * pixel**2 == pytest.approx(4 * np.pi, rel=0.005)
    assert image.dtype == np.uint8 and corners.shape == (8, 2)
    # red exceeds blue in the tile's own sphere only
    warm = (image[..., 0] > 1.4 * image[..., 2]) & (image[..., 3] == 255)
    assert warm.sum() * pixel**2 == pytest.approx(np.pi, rel=0.15)


def test_pictures_of_a_tile_and_of_a_dictionary(two):
    from bakery.stages.packing.pictures import pictures
    from tests.oracles import packing as theory

    many = {picture.name: picture for picture in pictures(two.tree)}
    assert list(many) == ["tiles", "pair_correlation", "chord_length"]
    one = {picture.name: picture for picture in pictures(Group({"packing": two.tree["packing/f40"]}))}
    assert list(one) == ["tile", "pair_correlation", "chord_length"]
    for picture in (*many.values(), *one.values()):
        assert len({len(values) for _, values in picture.columns}) == 1
    tile, law = two.tree["packing/f40"], dict(one["chord_length"].columns)["Dixmier [1/mean radius]"]
    fraction, radii = float(tile["fraction"].data[0]), tile["radii"].data
    at = np.linspace(tile["chord_length/edges"].data[:-1], tile["chord_length/edges"].data[1:], 101)
    assert np.allclose(law, np.mean(theory.dixmier(0.5 * (at[1:] + at[:-1]), fraction, radii), axis=0), rtol=1e-3)


@pytest.mark.parametrize("name", [slow("tile"), "chord_length"])
def test_a_picture_is_the_same_twice(two, name):
    from bakery.draw.picture import drawn
    from bakery.stages.packing.pictures import pictures

    def draw():
        return drawn(next(p for p in pictures(Group({"packing": two.tree["packing/f40"]})) if p.name == name), ("png",))["png"]

    assert draw() == draw()


def test_quality_is_the_tolerance(write):
    assert load(write("fraction: 0.2"), overrides(quality="preview")).tolerance == 0.03


def test_the_state_of_the_work_has_no_pressure_before_spheres_have_met():
    said = []
    watch = stage._Watch(SimpleNamespace(report=lambda share, error, state: said.append((share, state))), [0.3], [0.5])
    watch.tell(0, 0.1, math.nan, 0.0)
    watch.tell(0, 0.2, 4.5, 0.4)
    assert said == [(0.0, "fraction 0.100 of 0.3"), (0.2, "fraction 0.200 of 0.3, pressure 4.5")]
