"""The stage `optics`: what it declares, stores, checks and predicts."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bakery.errors import StageError
from bakery.recipe.model import SingleScattering
from bakery.stages.optics import STAGE
from bakery.store.tree import Dataset, Group


def size(distribution="lognormal", **given):
    values = dict(radius=0.5, sigma=1.5, variance=None, min=None, max=None, table=None, of=())
    return SimpleNamespace(distribution=distribution, **(values | given))


def index(n, k=0.0):
    return SimpleNamespace(name="x", n=np.full(2, n), k=np.full(2, k))


def recipe(polarized=False, tolerance=0.03, number=1e8, filled=None, host=1.0, host_k=0.0, **of_size):
    components = (SimpleNamespace(name="drops", material=index(1.33, 1e-3), fraction=0.8, size=size(**of_size)),
                  SimpleNamespace(name="dust", material=index(1.55, 0.01), fraction=0.2, size=size("single", radius=0.2)))
    options = SingleScattering("auto", 3, polarized, None, "narrow", True, True, None, None)
    particles = SimpleNamespace(host=index(host, host_k), number_density=number, volume_fraction=filled, components=components)
    return SimpleNamespace(wavelength=(0.6, 0.45), tolerance=tolerance, measure="pointwise", medium=None, phase=options,
                           particles=particles)


class Here:
    """A context without workers."""

    seed = 0

    def __init__(self, tolerance=0.03):
        self.tolerance, self.reports = tolerance, []

    def map(self, function, tasks):
        return [function(*task) for task in tasks]

    def report(self, fraction, error=None):
        self.reports.append((fraction, error))


@pytest.fixture(scope="module")
def baked():
    made = recipe(polarized=True)
    context = Here()
    return STAGE.compute(STAGE.inputs(made, {}), context), context


def test_members_are_those_declared(baked):
    group = Group(baked[0].members)
    found = {path for path, member in group.walk() if isinstance(member, Dataset)}
    declared = {o.path.replace("COMPONENT", name): o for o in STAGE.outputs for name in ("drops", "dust")}
    assert found == set(declared)
    for path, output in declared.items():
        dataset = group[path]
        assert dataset.units == output.units and dataset.description == output.description
        assert dataset.data.ndim == output.shape.count(",") - output.shape.count(",)") + 1
        assert dataset.data.flags.c_contiguous or dataset.data.size
    assert group["drops/method"].choices == ("rayleigh", "mie", "goa") and (group["drops/method"].data == 1).all()


def test_rules_hold_and_the_tolerance_is_met(baked):
    result, context = baked
    assert list(STAGE.check(Group(result.members))) == []
    assert 0 < result.achieved_error <= 0.03
    fractions = [fraction for fraction, _ in context.reports]
    assert all(0 <= f <= 1 for f in fractions) and fractions[-1] == 1


TAMPERED = [
    ("drops/phase", lambda a: a * 1.001, "integrates"),
    ("drops/phase", lambda a: -a, "below 0"),
    ("drops/weight", lambda a: a * 0.999, "add up"),
    ("drops/scattering", lambda a: a * 1.01, "scattering"),
    ("drops/mean_scattering", lambda a: a * 1.01, "mean_"),
    ("drops/extinction", lambda a: a * (1 +1e-9),
     "extinction"),
    ("dust/mean_absorption", lambda a: a +1, "mean_"),
    ("theta", lambda a: a[:: -1],
     "ascend"),
    ("theta", lambda a: a * 0.999, "ascend"),
    ("dust/s12", lambda a: a +1, "exceeds"),
    ("drops/radius", lambda a: a * np.nan, "not finite"),
    ("drops/method", lambda a: a +2, "method"),
    ("drops/error", lambda a: -a, "below 0"),
    ("drops/radius", lambda a: -a, "radius"),]


def tamper(group: Group, path, change) -> Group:
    head, _, rest = path.partition("/")
    member = group.members[head]
    new = tamper(member, rest, change) if rest else replace(member, data=change(member.data))
    return Group(group.members | {head: new}, group.attributes)


@pytest.mark.parametrize("path, change, words", TAMPERED)
def test_tampered_values_are_found(baked, path, change, words):
    faults = list(STAGE.check(tamper(Group(baked[0].members), path, change)))
    assert any(words in fault for fault in faults), faults


def test_missing_datasets_are_named(baked):
    drops = baked[0].members["drops"]
    less = Group(baked[0].members | {"drops": Group({k: v for k, v in drops.members.items() if k != "weight"})})
    assert list(STAGE.check(less)) == ["drops: weight missing"]


def test_index_is_relative_to_the_host():
    assert STAGE.inputs(recipe(host=1.33), {})["components"][0].m == pytest.approx(1 + 1e-3j / 1.33)


def test_reads_what_matters_and_nothing_else():
    from bakery.plan.inputs import reads_key

    yes = [
    "particles.components[0].size.sigma",
    "particles.components[1].size.of[0].share",
    "particles.components[0].material.n[1]",
    "particles.host",
    "wavelengths[2]",
    "tolerance",
    "phase.polarized",
    "phase.orders",
    "particles.components[0].name",
     "particles.components[0].size.file"]
    no = [
    "particles.number_density",
    "particles.volume_fraction",
    "particles.components[0].fraction",
    "name",
    "description",
    "seed"]
    assert all(reads_key(STAGE, key) for key in yes) and not any(reads_key(STAGE, key) for key in no)


def test_bad_sizes_are_stage_errors():
    with pytest.raises(StageError, match="drops: no particle"):
        STAGE.inputs(recipe(min=1e3), {})


def test_cost_grows_with_the_work():
    small, large = recipe(), recipe(radius=20.0)
    assert STAGE.cost(large).seconds > 5 * STAGE.cost(small).seconds > 0
    cost = STAGE.cost(small)
    assert cost.seconds > 0 and 1e4 < cost.file < 1e7 and cost.memory < 1e9 and "angles" in cost.basis
