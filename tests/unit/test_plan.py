"""What runs and why: the plan against made-up stages and recipes."""

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from bakery import plan as planning
from bakery.errors import UsageError
from bakery.plan.inputs import differences, input_hash, parts, reads_key
from bakery.plan.suffice import Held
from bakery.stages.declaration import Cost, Result, Stage


def stage(name="grind", needs=(), reads=("particles.components[*].size",), version=1):
    return Stage(name, version, "a title", tuple(reads), tuple(needs), lambda recipe: True, (), "none",
                 lambda recipe: Cost(2.0, 1e6, 1e3, "counted"), lambda recipe, up: {}, lambda inputs, ctx: Result({}, 0.0),
                 lambda group: [])


@dataclass(frozen=True)
class File:
    key: str
    path: Path
    sha256: str


def recipe(**leaves):
    base = {"particles.components[0].size.radius": 5.0, "particles.components[0].sizes": 1, "particles.number_density": 1e8}
    return SimpleNamespace(leaves=base | leaves, files=(), warnings=(), path=Path("fog.yaml"))


@pytest.mark.parametrize(("pattern", "key", "expected"), [
    ("particles.components[*].size", "particles.components[0].size.radius", True),
    ("particles.components[*].size", "particles.components[12].size.of[1].share", True),
    ("particles.components[*].size", "particles.components[0].sizes", False),
    ("particles.*.size", "particles.a.size", True),
    ("particles.*.size", "particles.a.b.size", False),
    ("tolerance", "tolerance", True),
    ("tolerance", "scatterometer.tolerance", False),
])
def test_patterns(pattern, key, expected):
    assert reads_key(stage(reads=(pattern,)), key) is expected


def test_hash_depends_on_what_is_read_and_on_nothing_else():
    first = input_hash(parts(stage(), recipe(), {}))
    assert first == input_hash(parts(stage(), recipe(**{"particles.number_density": 2e8}), {}))
    assert first != input_hash(parts(stage(), recipe(**{"particles.components[0].size.radius": 5.000000000000001}), {}))
    assert first != input_hash(parts(stage(version=2), recipe(), {}))
    needs = stage(needs=("dig",))
    assert input_hash(parts(needs, recipe(), {"dig": "a"})) != input_hash(parts(needs, recipe(), {"dig": "b"}))


def test_a_data_file_counts_by_its_content():
    with_file = recipe()
    with_file.files = (File("particles.components[0].size.file", Path("a/sizes.csv"), "11"),)
    moved = recipe()
    moved.files = (File("particles.components[0].size.file", Path("b/sizes.csv"), "11"),)
    changed = recipe()
    changed.files = (File("particles.components[0].size.file", Path("a/sizes.csv"), "22"),)
    hashes = [input_hash(parts(stage(), r, {})) for r in (with_file, moved, changed)]
    assert hashes[0] == hashes[1] != hashes[2]


def test_reasons_name_the_key_the_file_and_the_stage():
    old = parts(stage(), recipe(), {})
    new = parts(stage(version=2), recipe(**{"particles.components[0].size.radius": 6.0}), {})
    new["file sizes.csv (x)"] = "ab"
    said = differences(old, new)
    assert "particles.components[0].size.radius: 5 -> 6" in said
    assert "stage version 1 -> version 2" in said
    assert "file sizes.csv (x) is new" in said
    assert differences({"upstream a": "1"}, {"upstream a": "2"}) == ["a runs again"]


@pytest.fixture
def two_stages(monkeypatch):
    import bakery.stages

    pair = (stage("dig"), stage("grind", needs=("dig",), reads=("particles.number_density",)))
    monkeypatch.setattr(bakery.stages, "all_stages", lambda: pair)
    return pair


def test_actions(two_stages):
    fresh = planning.make(recipe(), Path("fog.h5"))
    assert [step.action for step in fresh.steps] == ["run", "run"]
    assert fresh.write and fresh.seconds == 4.0 and fresh.memory == 1e6 and fresh.file == 2e3 + planning.FRAME
    stored = {step.stage.name: Held({}, step.input_hash, 0.0) for step in fresh.steps}
    held = planning.make(recipe(), Path("fog.h5"), held=stored, same_recipe=True)
    assert not held.write and [step.action for step in held.steps] == ["reuse", "reuse"]
    assert planning.make(recipe(), Path("fog.h5"), held=stored, same_recipe=False).write
    forced = planning.make(recipe(), Path("fog.h5"), held=stored, same_recipe=True, force=True)
    assert forced.write and [step.action for step in forced.steps] == ["run", "run"]
    assert all(step.force for step in forced.steps) and not any(step.force for step in (*fresh.steps, *held.steps))
    cached = planning.make(recipe(), Path("fog.h5"), in_cache=lambda name, key: name == "dig")
    assert [step.action for step in cached.steps] == ["reuse", "run"]


def test_only_what_a_change_concerns_runs_again(two_stages):
    before = {s.stage.name: s for s in planning.make(recipe(), Path("fog.h5")).steps}
    stored = {name: Held(step.parts, step.input_hash, 0.0) for name, step in before.items()}
    after = planning.make(recipe(**{"particles.number_density": 2e8}), Path("fog.h5"), held=stored)
    assert [step.action for step in after.steps] == ["reuse", "run"]
    assert after.steps[1].why == ("particles.number_density: 100000000 -> 200000000",)


def test_only_brings_what_is_needed(two_stages):
    assert [s.name for s in planning.chosen(recipe(), ["grind"])] == ["dig", "grind"]
    assert [s.name for s in planning.chosen(recipe(), ["dig"])] == ["dig"]
    with pytest.raises(UsageError, match='found "digg"; this recipe has the stages dig, grind'):
        planning.chosen(recipe(), ["digg"])


def test_plan_as_data(two_stages):
    plan = planning.make(recipe(), Path("fog.h5"))
    data = plan.as_dict()
    assert data["steps"][0]["why"] and data["seconds"] == plan.seconds
    assert replace(plan, write=False).as_dict()["write"] is False


def test_blocks_that_wait_for_each_other_keep_fewer_cores_busy():
    three, many = (Cost(3.0, 0.0, 0.0, "", most=most, blocks=blocks) for most, blocks in ((3, 3), (4, 9)))
    assert [three.cores(workers) for workers in (1, 2, 3, 8)] == [1, 1.5, 3, 3]
    assert [many.cores(workers) for workers in (1, 2, 4, 64)] == [1, 9 / 5, 3, 3]  # four, four and one
    assert [Cost(1.0, 0.0, 0.0, "", most=2).cores(workers) for workers in (1, 2, 8)] == [1, 2, 2]
