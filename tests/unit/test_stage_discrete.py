"""The stage `discrete`: its sections, what it stores against the medium, the same for any workers, files that count as inputs."""

import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest

import bakery
from bakery.asset import read_checked
from bakery.asset.verify import _broken
from bakery.errors import RecipeError, StageError
from bakery.recipe import load
from bakery.run.bake import planned
from bakery.stages import measures
from bakery.stages.discrete.stage import STAGE, check
from bakery.store.tree import Group
from tests.conftest import ROOT
from tests.odds import SIGMAS

CASE = (ROOT / "tests" / "regression" / "cases" / "discrete.yaml").read_text()
SECTION = CASE[CASE.index("discrete:\n"):]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recipe, its asset, and a cache that keeps optics and medium for its variants."""
    made = tmp_path_factory.mktemp("discrete")
    (made / "d.yaml").write_text(CASE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(made / "cache"))
        bakery.bake(made / "d.yaml", output=made / "d.h5")
    return made


@pytest.fixture
def recipe(folder, monkeypatch):
    """Write the recipe with another section; give its path."""
    monkeypatch.setenv("BAKERY_CACHE", str(folder / "cache"))

    def written(section: str, old: str = "", new: str = ""):
        assert not old or old in CASE
        path = folder / "variant.yaml"
        path.write_text(CASE.replace(SECTION, f"discrete: {section}\n").replace(old, new) if section else CASE.replace(old, new))
        return path

    return written


def baked(path, **more):
    bakery.bake(path, output=path.with_suffix(".h5"), **more)
    assert _broken(str(path.with_suffix(".h5"))) == []
    return bakery.open(path.with_suffix(".h5"))


@pytest.fixture(scope="module")
def asset(folder):
    return bakery.open(folder / "d.h5")


def test_what_is_stored(asset, folder):
    found = asset.discrete
    assert _broken(str(folder / "d.h5")) == []
    assert found.position.shape == (2000, 3) and found.position.dtype == np.float32 and int(found.number) == 2000
    assert found.box.tolist() == pytest.approx([0.1, 0.1, 0.2]) and float(found.volume) == pytest.approx(2e-3)
    assert float(found.number_density) == pytest.approx(1e6)
    assert (found.position < found.box).all() and found.choices["method"][int(found.method)] == "stored"
    drops, dust = (found[name] for name in ("drops", "dust"))
    assert np.isin(found.radius[found.component == 0], drops.radius.astype(np.float32)).all()
    assert set(found.radius[found.component == 1].tolist()) == {0.5} and dust.share.tolist() == [1.0]
    # binomial: 2000 of 0.25, 19.4 its standard deviation
    assert abs(int((found.component == 1).sum()) - 500) < 105
    assert drops.phase(np.array([0.5])).shape == (2, len(drops.radius), 1)


def test_the_classes_add_up_to_the_medium(asset):
    classes, medium = asset.discrete.classes(), asset.medium
    assert classes.names == ("drops", "dust") and classes.share.sum() == pytest.approx(1, abs=1e-12)
    tolerance = asset.stages["discrete"]["tolerance"]
    for of, name in ((classes.extinction, "sigma_t"), (classes.scattering, "sigma_s")):
        assert 1e6 * 1e-12 * of @ classes.share == pytest.approx(medium[name], rel=0.01)  # tolerance 10 %, hardly any error left
    scattered = classes.scattering * classes.share
    mixed = np.einsum("lk,lka->la", scattered, classes.phase) / scattered.sum(axis=1)[:, None]
    both = np.union1d(classes.theta, medium.theta)
    seen = [bakery.stages.members.Phase(theta, table)(both) for theta, table in
            ((classes.theta, mixed), (medium.theta, medium["phase"]))]
    assert measures.integrated_difference(both, *seen).max() < tolerance
    assert asset.discrete.law_extinction == pytest.approx(classes.extinction @ classes.share, rel=1e-12)


def test_each_particle_has_its_class(asset):
    classes, kinds = asset.discrete.classes(), asset.discrete.kinds()
    assert (classes.radius[kinds].astype(np.float32) == asset.discrete.radius).all()
    assert (classes.component[kinds] == asset.discrete.component).all()
    mean = classes.extinction[:, kinds].mean(axis=1)
    assert mean == pytest.approx(asset.discrete.mean_extinction, rel=1e-9)
    off = (asset.discrete.mean_extinction - asset.discrete.law_extinction) / asset.discrete.error["mean_extinction"]
    assert (np.abs(off) < SIGMAS).all()


def test_a_seed_is_another_realisation_of_the_same(recipe, asset):
    other = baked(recipe("", "  count: 2000", "  count: 2000\n  seed: 1"))
    assert not np.array_equal(other.discrete.position, asset.discrete.position)
    assert other.discrete.drops.extinction == pytest.approx(asset.discrete.drops.extinction, abs=0)


def test_a_procedural_realisation_stores_no_place(recipe, asset):
    found = baked(recipe("{count: 10000000000, box: [1 m, 1 m, 1 m], method: procedural}")).discrete
    assert not {"position", "radius", "component"} & set(found) and float(found.number) == 1e10
    assert found.key.tolist() == asset.discrete.key.tolist()
    with pytest.raises(AttributeError, match="procedural"):
        found.kinds()


def test_chance_decides_the_number_where_there_is_no_count(recipe):
    found = baked(recipe("{box: [10 cm, 10 cm, 20 cm]}")).discrete
    assert abs(int(found.number) - 2000) < SIGMAS * 2000**0.5 and int(found.number) != 2000
    assert float(found.number_density) == 1e6


@pytest.mark.parametrize("count", [0, 1])
def test_none_and_one(recipe, count):
    found = baked(recipe(f"{{count: {count}, box: [2 um, 2 um, 2 um]}}")).discrete
    assert found.position.shape == (count, 3) and "cell_dispersion" not in found
    assert ("mean_extinction" in found) == bool(count)


@pytest.mark.slow
def test_a_grid_of_either_kind_is_an_input(recipe):
    values = np.random.default_rng(0).random((3, 4, 5))
    path = recipe("{count: 3000, box: [1 m, 1 m, 1 m], grid: {file: rho.h5, dataset: fields/rho}}")
    with h5py.File(path.with_name("rho.h5"), "w") as file:
        file["fields/rho"] = values
    np.save(path.with_name("rho2.npy"), 7 * values)  # only proportions count
    first = baked(path)
    assert first.discrete.density.max() == 1 and float(first.discrete.volume) == pytest.approx(values.mean() / values.max())
    second = baked(recipe("{count: 3000, box: [1 m, 1 m, 1 m], grid: {file: rho2.npy}}"))
    assert np.allclose(first.discrete.density, second.discrete.density, rtol=1e-6)
    assert np.mean(first.discrete.position == second.discrete.position) > 0.9
    plan = planned(recipe("{count: 3000, box: [1 m, 1 m, 1 m], grid: {file: rho2.npy}}"), path.with_suffix(".h5"), jobs=1)
    assert [step.action for step in plan.steps][-1] == "reuse"
    np.save(path.with_name("rho2.npy"), values**2)
    plan = planned(path, path.with_suffix(".h5"), jobs=1)
    assert [step.action for step in plan.steps] == ["reuse", "reuse", "run"]
    assert "rho2.npy" in " ".join(plan.steps[-1].why)


MESH = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


def test_a_mesh_holds_the_particles(recipe):
    path = recipe("{count: 500, mesh: {file: body.off, unit: 2 cm}}")
    path.with_name("body.off").write_text(MESH)
    found = baked(path).discrete
    assert found.box.tolist() == pytest.approx([0.02] * 3) and float(found.volume) == pytest.approx(0.02**3 / 6)
    assert (found.position.sum(axis=1) < 0.02 * (1 + 1e-6)).all()


def test_a_mesh_with_a_hole_is_refused_with_its_place(recipe):
    path = recipe("{count: 500, mesh: {file: open.off}}")
    path.with_name("open.off").write_text(MESH.replace("4 4 0", "4 3 0").removesuffix("3 1 2 3\n"))
    says = r"variant.yaml:\d+: discrete.mesh.file: open.off: not closed: face 0 alone has .* vertices 2 and 1 at \(0.5, 0.5, 0\)"
    with pytest.raises(StageError, match=says):
        planned(path, path.with_suffix(".h5"), jobs=1)


REFUSED = {
    "{count: 5}": "found neither box nor mesh",
    "{count: 5, box: [1 m, 1 m, 1 m], mesh: {file: body.off}}": "found a box beside a mesh",
    "{count: 5, mesh: {file: body.off}, grid: {file: rho.npy}}": "found a grid without a box",
    "{count: 200000000, box: [1 m, 1 m, 1 m]}": r"found 2e\+08 particles to be stored; expected method: procedural, which stores "
                                                r"none, or method: stored \(3.2 GB\)",
    "{box: [1 km, 1 m, 1 m]}": "is no unit of length",
    "{box: [1000 m, 1 m, 1 m]}": r"found 1e\+09 particles",
    "{count: 2000000000, box: [1 m, 1 m, 1 m], method: stored}": r"found 2e\+09 .*procedural, which stores none, or a smaller",
    "{count: 5, box: [1 m, 1 m, 1 m], grid: {file: none.npy}}": "there is no such file",
    "{count: 5, box: [1 m, 1 m, 1 m], grid: {file: flat.npy}}": "found 3 x 2 values; expected three axes",
    "{count: 5, box: [1 m, 1 m, 1 m], grid: {file: negative.npy}}": r"found the density -1 at \[0, 0, 0\]",
    "{count: 5, box: [1 m, 1 m, 1 m], grid: {file: zero.npy}}": "zero everywhere",
    "{count: 5, box: [1 m, 1 m, 1 m], grid: {file: words.npy}}": "found a file that cannot be read",
    "{count: 5, box: [1 m, 1 m, 1 m], grid: {file: pairs.h5}}": "found no dataset; expected dataset: NAME",
    "{count: 5, box: [1 m, 1 m, 1 m], grid: {file: pairs.h5, dataset: rho}}": r'found no dataset "rho"; .*\(a/b\)',
    "{count: 5, box: [1 m, 1 m, 1 m], grid: {file: pairs.h5, dataset: a}}": 'found "a", a group',
    "{count: 5, box: [1 m, 1 m, 1 m], grid: {file: pairs.txt}}": "a file that ends in .h5, .hdf5 or .npy",
}


@pytest.mark.parametrize("section", REFUSED)
def test_what_cannot_be_is_refused_with_its_place(recipe, section):
    path = recipe(section)
    for name, values in (("flat", np.ones((3, 2))), ("negative", np.full((1, 1, 1), -1.0)), ("zero", np.zeros((2, 2, 2)))):
        np.save(path.with_name(name + ".npy"), values)
    path.with_name("words.npy").write_text("no grid")
    with h5py.File(path.with_name("pairs.h5"), "w") as file:
        file["a/b"] = np.ones((1, 2, 2))
    shutil.copy(path.with_name("words.npy"), path.with_name("pairs.txt"))
    with pytest.raises(RecipeError, match=REFUSED[section]) as refused:
        load(path)
    assert all(problem.line for problem in refused.value.problems)


def test_names_that_the_group_uses_are_taken(recipe):
    with pytest.raises(RecipeError, match='found "position", which the asset uses'):
        load(recipe("", "name: dust", "name: position"))
    taken = {output.path for output in STAGE.outputs if "/" not in output.path}
    from bakery.stages.discrete.section import TAKEN

    assert set(TAKEN) == taken


def test_verify_sees_what_is_not_chance(folder):
    group = read_checked(folder / "d.h5").members["discrete"]
    assert not list(check(group))

    def with_data(name, data):
        return Group(group.members | {name: replace(group[name], data=data)}, group.attributes)

    outside = group["position"].data.copy()
    outside[0, 2] = 0.2
    clumped = with_data("cell_dispersion", np.array([2.0]))
    assert any("outside of the box" in fault for fault in check(with_data("position", outside)))
    assert any("cell_dispersion is 2" in fault for fault in check(clumped))
    assert any("none of its component" in fault for fault in check(with_data("radius", group["radius"].data * np.float32(1.01))))
    assert any("number is" in fault for fault in check(with_data("number", np.array([1.0]))))
    assert any("does not ascend" in fault for fault in check(with_data("component", group["component"].data[::-1])))


def test_the_plan_tells_memory_and_file(recipe):
    path = recipe("{count: 100000000, box: [1 m, 1 m, 1 m]}")
    plan = planned(path, path.with_suffix(".h5"), jobs=1)
    cost = plan.steps[-1].cost
    assert 1.2e9 < cost.file < 1.6e9 and 5e9 < cost.memory < 8e9
    assert "bytes a particle" in cost.basis
