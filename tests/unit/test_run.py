"""The runner and its cache, with two small stages of the tests' own."""

import os
import re
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import bakery.stages
from bakery import plan as planning
from bakery import run
from bakery.errors import StageError
from bakery.physics import mie
from bakery.plan.suffice import Held
from bakery.recipe import load
from bakery.run import compiling, execute
from bakery.run.cache import Cache
from bakery.run.executors import Context
from bakery.run.progress import Lines, Progress, State
from bakery.stages import all_stages
from bakery.stages.declaration import Cost, Result, Stage
from bakery.store.read import read
from bakery.store.tree import Dataset, Group
from bakery.system import sources
from tests.conftest import ROOT

COUNT = {"dig": 0, "grind": 0}


def square(start, stop):
    return np.arange(start, stop, dtype=float) ** 2


def dig(inputs, context):
    COUNT["dig"] += 1
    blocks = context.map(square, [(i, i + 3) for i in range(0, inputs["n"], 3)])
    context.report(0.5, 0.1)
    return Result({"value": Dataset(np.concatenate(blocks), "m", "squares")}, 0.01, ("a remark",))


def grind(inputs, context):
    COUNT["grind"] += 1
    if inputs["factor"] < 0:
        raise MemoryError
    return Result({"value": Dataset(inputs["factor"] * inputs["value"], "m", "scaled")}, 0.02)


def rule(group):
    return [] if (group["value"].data < 1e6).all() else ["value: above 1e6"]


def cost(recipe):
    return Cost(1.0, 1e6, 1e3, "counted")


DIG = Stage("dig", 1, "dig", ("n",), (), lambda r: True, (), "relative", cost, lambda r, up: {"n": r.leaves["n"]}, dig, rule)
GRIND = Stage("grind", 1, "grind", ("factor",), ("dig",), lambda r: True, (), "relative", cost,
              lambda r, up: {"factor": r.leaves["factor"], "value": up["dig"]["value"].data}, grind, rule)


@pytest.fixture(autouse=True)
def _stages(monkeypatch):
    monkeypatch.setattr(bakery.stages, "STAGES", (f"{__name__}:DIG", f"{__name__}:GRIND"))
    all_stages.cache_clear()
    COUNT.update(dig=0, grind=0)
    yield
    all_stages.cache_clear()


def recipe(factor=2.0, n=9):
    return SimpleNamespace(path=Path("r.yaml"), name="r", text="bakery: 1\n", wavelength=(0.55,), tolerance=0.05, seed=0,
                           files=(), warnings=(), leaves={"factor": factor, "n": n})


def plan(tmp_path, cache, **values):
    return planning.make(recipe(**values), tmp_path / "r.h5", in_cache=cache.has)


def messages():
    said = []

    class Told(Progress):
        def say(self, text):
            said.append(text)

    return said, Told()


def test_bake_then_reuse_from_the_cache(tmp_path):
    said, told = messages()
    cache = Cache(tmp_path / "cache")
    baked = execute(plan(tmp_path, cache), cache=cache, progress=told)
    assert baked.written and [step["source"] for step in baked.steps] == ["computed", "computed"]
    assert "dig: a remark" in said
    root = read(tmp_path / "r.h5")
    np.testing.assert_array_equal(root["grind/value"].data, 2.0 * np.arange(9.0) ** 2)
    assert root["dig"].attributes["achieved_error"] == 0.01 and root["dig"].attributes["stage_version"] == 1
    first = root.attributes["content_hash"]
    (tmp_path / "r.h5").unlink()
    again = execute(plan(tmp_path, cache), cache=cache)
    assert [step["source"] for step in again.steps] == ["from the cache"] * 2 and COUNT == {"dig": 1, "grind": 1}
    assert read(tmp_path / "r.h5").attributes["content_hash"] == first


def test_a_finished_stage_survives_the_failure_of_the_next(tmp_path):
    cache = Cache(tmp_path / "cache")
    with pytest.raises(StageError, match="grind: out of memory; the plan expected 1 MB"):
        execute(plan(tmp_path, cache, factor=-1.0), cache=cache)
    assert not (tmp_path / "r.h5").exists()
    execute(plan(tmp_path, cache), cache=cache)
    assert COUNT == {"dig": 1, "grind": 2}


def test_what_breaks_a_rule_is_not_stored(tmp_path):
    cache = Cache(tmp_path / "cache")
    with pytest.raises(StageError, match="grind: .*value: above 1e6"):
        execute(plan(tmp_path, cache, factor=1e9), cache=cache)
    assert not (tmp_path / "r.h5").exists()
    assert [path.name.split("-")[0] for path, _, _ in cache.entries()] == ["dig"]


@pytest.mark.parametrize("workers", [None, 1, 3, "processes"])
def test_values_do_not_depend_on_the_workers(tmp_path, workers):
    cache = Cache(tmp_path / "cache")
    if workers == "processes":
        with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
            execute(plan(tmp_path, cache), cache=cache, executor=pool)
    elif workers:
        with ThreadPoolExecutor(workers) as pool:
            execute(plan(tmp_path, cache), cache=cache, executor=pool)
    else:
        execute(plan(tmp_path, cache), cache=cache)
    np.testing.assert_array_equal(read(tmp_path / "r.h5")["dig/value"].data, np.arange(9.0) ** 2)


def flip(path):
    data = bytearray(path.read_bytes())
    data[-40] ^= 1
    path.write_bytes(data)


def swap(path):
    other = next(p for p in path.parent.glob("*.h5") if p != path)
    path.write_bytes(other.read_bytes())


@pytest.mark.parametrize("damage", [
    flip, swap, lambda p: p.write_bytes(p.read_bytes()[:700]), lambda p: p.write_bytes(b""), lambda p: p.write_bytes(b"hello"),
    lambda p: p.write_bytes(p.read_bytes().replace(b"bakery-asset 1 ", b"bakery-asset 9 ", 1)),
], ids=["bit", "other entry", "cut", "empty", "foreign", "version"])
def test_a_damaged_entry_is_moved_aside_and_computed_again(tmp_path, damage):
    said, told = messages()
    cache = Cache(tmp_path / "cache", say=told.say)
    execute(plan(tmp_path, cache), cache=cache)
    before = read(tmp_path / "r.h5").attributes["content_hash"]
    (tmp_path / "r.h5").unlink()
    damage(next((tmp_path / "cache").glob("dig-*.h5")))
    execute(plan(tmp_path, cache), cache=cache)
    assert COUNT == {"dig": 2, "grind": 1}
    assert len([text for text in said if "moved aside" in text]) == 1
    assert len(list((tmp_path / "cache").glob("*.bad"))) == 1
    assert read(tmp_path / "r.h5").attributes["content_hash"] == before
    assert len(cache.prune()) == 1 and not list((tmp_path / "cache").glob("*.bad"))


def test_a_cache_that_cannot_be_written_costs_one_warning(tmp_path):
    (tmp_path / "file").write_text("")
    said, told = messages()
    cache = Cache(tmp_path / "file" / "cache", say=told.say)
    execute(plan(tmp_path, cache), cache=cache)
    assert (tmp_path / "r.h5").exists()
    assert len([text for text in said if text.startswith("cache:")]) == 1


def test_two_bakes_at_once_compute_each_stage_once(tmp_path):
    cache = Cache(tmp_path / "cache")
    start = threading.Barrier(4)
    failures = []

    def one(i):
        try:
            start.wait()
            execute(planning.make(recipe(), tmp_path / f"{i % 2}.h5"), cache=Cache(tmp_path / "cache"))
        except BaseException as error:
            failures.append(error)

    workers = [threading.Thread(target=one, args=(i,)) for i in range(4)]
    [worker.start() for worker in workers]
    [worker.join() for worker in workers]
    assert not failures
    assert COUNT == {"dig": 1, "grind": 1}
    assert read(tmp_path / "0.h5").attributes["content_hash"] == read(tmp_path / "1.h5").attributes["content_hash"]
    assert len(cache.entries()) == 2


def test_an_entry_that_vanishes_is_only_a_miss(tmp_path):
    cache = Cache(tmp_path / "cache")
    execute(plan(tmp_path, cache), cache=cache)
    (tmp_path / "r.h5").unlink()
    stale = plan(tmp_path, cache)
    assert len(cache.clear()) == 2
    execute(stale, cache=cache)
    assert COUNT == {"dig": 2, "grind": 2} and (tmp_path / "r.h5").exists()


def test_prune_takes_the_least_recently_used(tmp_path):
    cache = Cache(tmp_path / "cache")
    execute(plan(tmp_path, cache), cache=cache)
    old = next((tmp_path / "cache").glob("grind-*.h5"))
    os.utime(old, (1, 1))
    total = sum(size for _, size, _ in cache.entries())
    assert cache.prune(max_bytes=total - 1) == [old]
    assert cache.prune(max_age=3600) == []
    assert len(cache.entries()) == 1


def test_a_cache_that_cannot_be_written_says_why_in_words(tmp_path):
    (tmp_path / "file").touch()
    said = []
    Cache(tmp_path / "file" / "cache", said.append).put("dig", "a", Group(), Group())
    assert said == ["cache: not written (Not a directory); the bake goes on without it"]


def test_a_speed_that_cannot_be_put_into_its_place_leaves_nothing(tmp_path):
    (tmp_path / "speed.json").mkdir()  # no file can be renamed to it
    Cache(tmp_path).note_speed("dig", "a", 1.0, 2.0)
    assert [path.name for path in tmp_path.iterdir()] == ["speed.json"]


def test_speed_is_remembered_and_a_broken_file_is_not_believed(tmp_path):
    cache = Cache(tmp_path)
    assert cache.speed("dig", "a", 1.0) == (1.0, 0)
    for key, seconds in (("a", 2.0), ("b", 20.0), ("c", 2.4), ("a", 2.2)):
        cache.note_speed("dig", key, 1.0, seconds)
    assert cache.speed("dig", "b", 1.0) == (20.0, 1), "the same inputs take what they took"
    assert cache.speed("dig", "a", 1.0) == (2.2, 1), "the last time counts"
    assert cache.speed("dig", "d", 1.0) == (2.4, 3), "one slow bake does not spoil the others"
    (tmp_path / "speed.json").write_text('{"dig": ["x"')
    assert cache.speed("dig", "a", 1.0) == (1.0, 0)
    (tmp_path / "speed.json").write_text('{"dig": [2.0, 3.0]}')  # as bakery 0.1 wrote it
    assert cache.speed("dig", "a", 1.0) == (1.0, 0)


def test_work_of_another_amount_or_kind_says_little_of_speed(tmp_path):
    cache = Cache(tmp_path)
    cache.note_speed("dig", "a", 1.0, 5.0)
    assert cache.speed("dig", "b", 1.5) == (5.0, 1)
    assert cache.speed("dig", "b", 100.0) == (1.0, 1), "half a second of starting up is not the speed of minutes"
    assert cache.speed("grind", "b", 1.0) == (1.0, 0)
    for kind in ("saw", "drill", "file"):
        cache.note_speed(kind, "c", 1.0, 3.0)
    assert cache.speed("grind", "b", 1.0) == (3.0, 0), "a machine that is slow at all kinds is slow at this"


def test_every_kernel_that_stages_name_has_a_time():
    """Where nothing is compiled yet, a plan says how long that takes."""
    for path in (ROOT / "bakery" / "stages").glob("*/*.py"):
        for names in re.findall(r"kernels=\(([^()]*)\)", path.read_text()):
            for name in re.findall(r'"([\w.]+)"', names):
                assert name in compiling.SECONDS, (path.name, name)


@pytest.mark.parametrize("compiled, believed", [(0.0, 10.0), (4.0, 6.0), (9.0, None)])
def test_measured_speeds_leave_compiling_out(tmp_path, monkeypatch, compiled, believed):
    @contextmanager
    def watched(modules, tell):
        yield SimpleNamespace(seconds=compiled)

    monkeypatch.setattr(compiling, "watched", watched)
    monkeypatch.setattr(run, "time", SimpleNamespace(monotonic=iter([0.0, 10.0, 20.0, 30.0]).__next__))
    cache = Cache(tmp_path / "cache")
    wanted = plan(tmp_path, cache)
    execute(wanted, cache=cache, jobs=1)
    assert cache.speed("dig", wanted.steps[0].input_hash, 1.0) == ((believed, 1) if believed else (1.0, 0))


def test_compiling_is_timed_and_told_while_it_lasts():
    from numba import njit

    told = []
    with compiling.watched(("x",), told.append) as clock:
        kernel = njit(lambda x: x + 1)
        kernel(1)
        once = clock.seconds
        assert told == [True, False] and once > 0
        kernel(2)
    assert clock.seconds == once and len(told) == 2
    njit(lambda x: x + 2)(1)
    assert len(told) == 2, "what is compiled later is another's"


def test_a_machine_compiles_a_kernel_once(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    seconds = compiling.expected(("mie.angular", "packing._chords"))
    assert seconds == compiling.SECONDS["mie.angular"] + compiling.SECONDS["packing._chords"]
    kept = tmp_path / "mie_0123"
    kept.mkdir()
    (kept / "angular.f-1.py311.nbi").write_text(f"0.68 {sources.stamp(Path(mie.__file__).with_name('angular.py'))}")
    assert compiling.expected(("mie.angular", "packing._chords")) == compiling.SECONDS["packing._chords"]
    (kept / "angular.f-1.py311.nbi").write_text("0.68 of other sources")
    assert compiling.expected(("mie.angular", "packing._chords")) == seconds


@pytest.mark.parametrize("name", ["fog", "salt", "glass_beads", "wax", "emitter", "motes"])
def test_stages_name_modules_that_hold_kernels(name, monkeypatch):

    monkeypatch.undo()  # of bakery's own stages
    all_stages.cache_clear()
    found = load(Path(__file__).parents[2] / "recipes" / f"{name}.yaml", {})
    for stage in all_stages():
        if stage.applies(found):
            assert set(stage.cost(found).kernels) <= set(compiling.SECONDS)
    for module in compiling.SECONDS:
        assert "@njit" in (Path(compiling.__file__).parents[1] / "physics" / (module.replace(".", "/") + ".py")).read_text()


def test_map_cancels_what_waits_when_a_block_fails():
    ran = []

    def block(i):
        ran.append(i)
        if i == 0:
            raise ValueError("block 0")

    with ThreadPoolExecutor(1) as pool, pytest.raises(ValueError, match="block 0"):
        Context(0.1, executor=pool).map(block, [(i,) for i in range(200)])
    assert len(ran) < 200


class Log(list):
    """A stream that tells the test when a line comes: lines are written by a timer's thread."""

    def __init__(self):
        self._more = threading.Semaphore(0)

    def write(self, text):
        if text.strip():
            self.append(text)
            self._more.release()

    def flush(self):
        pass

    def next(self):
        assert self._more.acquire(timeout=60)
        return self[-1]


def test_lines_name_what_lasts_and_survive_a_closed_stream(tmp_path):
    log = Log()
    lines = Lines(log, first=0.0, every=0.02)
    lines.begin("reading snow.h5")
    assert log.next().startswith("reading snow.h5: ")
    lines.end()
    lines.stage("dig", "dig", 0.01, 3.0)
    assert log.next().startswith("dig: about ")
    lines.compiling(True)
    while "compiling" not in log.next():
        pass
    assert log[-1].startswith("dig: compiling kernels, once (")
    lines.compiling(False)
    lines.update(0.5, 0.2)
    while "50 %" not in log.next():
        pass
    assert log[-1].startswith("dig: 50 %, error 0.2 of 0.01")
    lines.done("dig", "1 s")
    assert log[-1] == "dig: 1 s"
    path = tmp_path / "log"
    with path.open("w") as stream:
        lines = Lines(stream)
        lines.stage("dig", "dig", 0.01, 1.0)
        lines.done("dig", "1 s")
    lines.say("into the void")
    assert path.read_text() == "dig: 1 s\n", "what is done in a moment has one line"


class Hands:
    """A clock that stands until it is moved."""

    now = 1000.0

    def __call__(self):
        return self.now


def test_time_left_follows_the_work_and_not_the_compiling():
    clock = Hands()
    state = State(0.01, planned=1.1, clock=clock)
    assert state.words() == "about 1.1 s"
    state.compiling(True)
    clock.now += 20.0
    assert state.words() == "compiling kernels, once (20 s)"
    state.compiling(False)
    assert state.left() == pytest.approx(1.1)
    clock.now += 0.5
    state.update(0.5, None, "")
    assert state.left() == pytest.approx(0.5 * (0.5 + 0.11) / 0.6)
    clock.now += 0.1
    assert state.left() == pytest.approx(0.5 * (0.5 + 0.11) / 0.6 - 0.1), "counts down between two words of the stage"
    clock.now += 100.0
    assert state.left() is None and "left" not in state.words(), "beyond what was thought nothing is promised"


def test_a_plan_that_was_far_off_is_forgotten():
    clock = Hands()
    state = State(planned=600.0, clock=clock)
    clock.now += 95.0
    state.update(0.95, None, "")
    assert state.left() < 10  # by the plan alone 30 s, by what was done 5 s


def test_loading_is_not_taken_for_work():
    clock = Hands()
    state = State(planned=2.0, clock=clock)
    clock.now += 1.5
    state.update(0.001, None, "")  # the first block is done; the seconds before went into loading
    assert state.left() == pytest.approx(2.0, rel=0.01)


def test_the_group_holds_what_the_contract_names(tmp_path):
    cache = Cache(tmp_path / "cache")
    execute(plan(tmp_path, cache), cache=cache)
    root = read(tmp_path / "r.h5")
    assert list(root.members) == ["recipe", "wavelength", "dig", "grind", "provenance"]
    for name in ("dig", "grind"):
        promised = {"stage", "stage_version", "input_hash", "content_hash", "tolerance", "achieved_error", "error_measure"}
        assert promised <= set(root[name].attributes)
        own = root[f"provenance/{name}"]
        assert isinstance(own, Group) and {"seconds", "peak_memory", "workers"} <= set(own.attributes)


def test_what_misses_its_tolerance_is_stored_and_told_each_time(tmp_path):
    """By the bake that computes it, the one that finds it in the cache, the one that finds the asset up to date, and its plan."""
    strict = recipe()
    strict.tolerance = 0.015  # between the errors of dig and grind
    told = ("grind: its error is 0.02, above the tolerance of 0.015",)
    for path, source in ((tmp_path / "a.h5", "computed"), (tmp_path / "b.h5", "from the cache")):
        plan = planning.make(strict, path, in_cache=Cache().has)
        baked = execute(plan)
        assert baked.missed == told and [step["source"] for step in baked.steps] == [source] * 2
    held = {step.stage.name: Held({}, step.input_hash, 0.0) for step in plan.steps}
    again = execute(planning.make(strict, path, held=held, same_recipe=True))
    assert not again.written and again.missed == told and again.steps[1]["achieved_error"] == 0.02
    assert execute(planning.make(recipe(factor=3.0), tmp_path / "c.h5")).missed == ()


@pytest.mark.parametrize(("achieved", "tolerance", "misses"), [(0.02, 0.01, True), (0.01, 0.01, False), (0.0, 0.01, False),
                                                               (float("nan"), 0.01, True), (float("inf"), 0.5, True)])
def test_one_rule_says_what_misses(achieved, tolerance, misses):
    from bakery.store.missed import missed
    from bakery.store.tree import text

    attributes = {"stage": "dig", "achieved_error": achieved, "tolerance": tolerance}
    assert bool(missed(Group({"dig": Group({}, attributes)}))) == misses
    wish = Group({"dig": Group({"missed": text("too wet", "wishes that were not met")})})
    line = missed(Group({"dig": Group({}, attributes), "provenance": wish}))["dig"]
    assert line.endswith("too wet") and ("above the tolerance" in line) == misses
