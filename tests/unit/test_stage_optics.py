"""The stage `optics`: what it declares, stores, checks and predicts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bakery.errors import StageError
from bakery.run.cache import Cache
from bakery.stages.conform import broken
from bakery.stages.declaration import remembering
from bakery.stages.optics.stage import STAGE
from bakery.store.tree import Dataset, Group


def size(distribution="lognormal", **given):
    values = dict(radius=0.5, sigma=1.5, variance=None, min=None, max=None, of=())
    return SimpleNamespace(distribution=distribution, **(values | given))


def index(n, k=0.0):
    return SimpleNamespace(name="x", n=np.full(2, n), k=np.full(2, k))


def recipe(polarized=False, tolerance=0.03, number=1e8, filled=None, host=1.0, host_k=0.0, **of_size):
    amounts = dict(volume_concentration=None, mass_concentration=None)
    rest = amounts | dict(number_density=None, volume_fraction=None, density=None, coating=None, growth=None)
    components = (SimpleNamespace(name="drops", material=index(1.33, 1e-3), fraction=0.8, size=size(**of_size), **rest),
                  SimpleNamespace(name="dust", material=index(1.55, 0.01), fraction=0.2, size=size("single", radius=0.2), **rest))
    options = SimpleNamespace(method="auto", orders=3, polarized=polarized, switch=None, edge="narrow", rainbow=True, axis=True,
                              radii=None, angles=None)
    particles = SimpleNamespace(host=index(host, host_k), number_density=number, volume_fraction=filled, components=components,
                                relative_humidity=None, **amounts)
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
    ("drops/extinction", lambda a: a * (1 +1e-9), "extinction"),
    ("dust/mean_absorption", lambda a: a +1, "mean_"),
    ("theta", lambda a: a[:: -1], "ascend"),
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
    faults = broken(STAGE, tamper(Group(baked[0].members), path, change))
    assert any(words in fault for fault in faults), faults


def test_missing_datasets_are_named(baked):
    drops = baked[0].members["drops"]
    less = Group(baked[0].members | {"drops": Group({k: v for k, v in drops.members.items() if k != "weight"})})
    assert broken(STAGE, less) == ["optics/drops/weight: missing"]


def test_index_is_relative_to_the_host():
    assert STAGE.inputs(recipe(host=1.33), {})["components"][0].m == pytest.approx(1 + 1e-3j / 1.33)


def test_reads_what_matters_and_nothing_else():
    from bakery.plan.inputs import reads_key

    yes = ["particles.components[0].size.sigma", "particles.components[1].size.of[0].share", "particles.host", "wavelengths[2]",
           "particles.components[0].material.n[1]", "tolerance", "phase.polarized", "phase.orders",
           "particles.components[0].name", "particles.components[0].size.file"]
    no = ["particles.number_density", "particles.volume_fraction", "particles.components[0].fraction", "name", "description",
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


class Counted:
    """`bakery.physics.averages.choice._measured`, counted."""

    def __init__(self, monkeypatch):
        from bakery.physics.averages import choice

        self.calls, self.real = 0, choice._measured.__wrapped__  # past the memory of this process
        monkeypatch.setattr(choice, "_measured", self)

    def __call__(self, *asked):
        self.calls += 1
        return self.real(*asked)


def large(radius=60.0, **more):
    """Spheres for which rays are compared with series."""
    made = recipe(radius=radius, sigma=1.3, tolerance=0.1, **more)
    made.measure = "integrated"
    return made


def test_choices_of_rays_are_remembered_by_content(tmp_path, monkeypatch):
    measured, cache = Counted(monkeypatch), Cache(tmp_path)
    alone = STAGE.compute(STAGE.inputs(large(), {}), Here(0.1))
    first = measured.calls
    assert first
    with remembering(cache):
        cost = STAGE.cost(large())  # a plan
        kept = measured.calls
        again = STAGE.cost(large())  # another, and the bake after it
        result = STAGE.compute(STAGE.inputs(large(), {}), Here(0.1))
        assert measured.calls == kept and again == cost and cost.remarks
        STAGE.cost(large(radius=61.0))  # other spheres are another question
        assert measured.calls > kept
    for path in ("theta", "drops/phase", "drops/phase_bias", "drops/switch", "drops/ray_difference"):
        assert Group(result.members)[path].data.tobytes() == Group(alone.members)[path].data.tobytes(), path


@pytest.mark.parametrize("spoil", [
    lambda path: path.write_bytes(path.read_bytes()[:-100]), lambda path: path.write_bytes(b"no asset"),
    lambda path: path.write_bytes(b""),
])
def test_a_broken_choice_is_measured_again(tmp_path, monkeypatch, spoil):
    measured, cache = Counted(monkeypatch), Cache(tmp_path)
    with remembering(cache):
        cost = STAGE.cost(large())
        before = measured.calls
        entries = list(tmp_path.glob("rays-*.h5"))
        assert len(entries) == before
        for path in entries:
            spoil(path)
        assert STAGE.cost(large()) == cost and measured.calls == 2 * before


def test_a_foreign_choice_is_measured_again(tmp_path, monkeypatch):
    """Whole, rightly named, but not what this version keeps."""
    measured, cache = Counted(monkeypatch), Cache(tmp_path)
    with remembering(cache):
        cost = STAGE.cost(large())
        before = measured.calls
        for path in tmp_path.glob("rays-*.h5"):
            key = path.stem.removeprefix("rays-")
            cache.put("rays", key, Group({"figures": Dataset(np.zeros(2), "1", "two")}, {"input_hash": key}), Group())
        assert STAGE.cost(large()) == cost and measured.calls == 2 * before
