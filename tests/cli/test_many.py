"""Several recipes in one call: what is shared, what stops, what is told; the bytes of bakes by themselves."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from multiprocessing import Pipe
from types import SimpleNamespace

import pytest

from bakery.errors import StageError
from bakery.plan import RUN
from bakery.run import many
from bakery.run.bake import planned
from bakery.run.executors import Lent
from bakery.run.messages import ClusterLost
from bakery.run.wire import Wire
from bakery.stages import all_stages
from bakery.store.read import read
from tests.conftest import DROPS, MILK, ROOT


def hash_of(path):
    return read(path).attributes["content_hash"]


@pytest.fixture
def recipes(tmp_path):
    """Recipes that bake in a moment."""
    paths = [tmp_path / f"{name}.yaml" for name in "abc"]
    for k, path in enumerate(paths):
        path.write_text(MILK.format(name=path.stem, g=0.5 + 0.1 * k))
    return paths


@pytest.fixture
def failing(monkeypatch, recipes):
    """The second recipe fails."""
    real = many.executed

    def executed(plan, **options):
        if plan.recipe.name == "b":
            raise StageError("burnt")
        return real(plan, **options)

    monkeypatch.setattr(many, "executed", executed)
    return recipes


def test_after_a_failure_no_recipe_is_started(call, failing, tmp_path):
    status, out, err = call(*failing, "-o", f"{tmp_path}/")
    assert status == 3 and out == f"{tmp_path}/a.h5\n" and not (tmp_path / "c.h5").exists()
    assert err.splitlines()[-2:] == ["1 of 3 recipes failed, 1 not started (--keep-going bakes them):", f"{failing[1]}: burnt"]
    found = json.loads(call(*failing, "-o", f"{tmp_path}/", "--json")[1])
    assert [one.get("failed") for one in found] == [None, "burnt", "not started"]


def test_keep_going_bakes_the_others_and_gives_the_worst_status(call, failing, tmp_path):
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("bakery: 1\nname: wrong\nmedium: {albedo: 2}\n")
    status, out, err = call(wrong, *failing, "-o", f"{tmp_path}/", "--keep-going")
    assert status == 3 and out == f"{tmp_path}/a.h5\n{tmp_path}/c.h5\n"
    told = err[err.index("2 of 4 recipes failed:"):]
    assert "wrong.yaml:3: medium.albedo" in told and told.endswith(f"{failing[1]}: burnt\n")
    assert call(wrong, failing[0], "-o", f"{tmp_path}/", "-k")[0] == 2
    assert call(wrong, failing[0], "-o", f"{tmp_path}/other/")[0] == 2 and not (tmp_path / "other").exists()


def test_a_lost_cluster_ends_the_bake_whatever_was_asked_for(call, recipes, tmp_path, monkeypatch):
    def executed(plan, **options):
        raise ClusterLost("gone")

    monkeypatch.setattr(many, "executed", executed)
    status, _, err = call(*recipes, "-o", f"{tmp_path}/", "--keep-going")
    assert status == 3 and "1 of 3 recipes failed, 2 not started:\n" in err


def test_recipes_that_share_a_stage_follow_each_other_and_memory_is_shared_out(tmp_path):
    def plan(key, memory):
        cost = SimpleNamespace(kernels=(), seconds=1.0)
        step = SimpleNamespace(action=RUN, stage=SimpleNamespace(name="optics"), input_hash=key, force=False, cost=cost)
        return SimpleNamespace(steps=[step], memory=memory, seconds=1.0, write=True)

    plans = [plan("x", 1e6), plan("x", 1e6), plan("z", 1e18), plan("y", 1e6)]
    bakery = many._Bakery(plans, 4, SimpleNamespace(where=tmp_path, has=lambda name, key: key == "y"), None, None)
    bakery._busy, bakery._waiting = {0: None}, [1, 2, 3]
    assert bakery._next() == 3
    bakery._waiting = [1, 2]
    assert bakery._next() is None
    bakery._busy = {}
    assert bakery._next() == 1


def test_threads_that_are_lent_are_the_most_that_run():
    running, most, lock, go = 0, 0, threading.Lock(), threading.Barrier(2)

    def block(_):
        nonlocal running, most
        with lock:
            running, most = running + 1, max(most, running + 1)
        if lent:
            go.wait(10)
        with lock:
            running -= 1

    with Lent(3) as pool:
        lent = 0
        list(pool.map(block, range(6)))
        assert most == 1
        lent, most = 2, 0
        pool.lend(2)
        list(pool.map(block, range(6)))
    assert most == 2


def test_plans_travel_whole(drops):
    near, far = Pipe()
    plan = planned(drops)
    Wire(near).send("bake", plan)
    kind, found = Wire(far).receive()
    assert kind == "bake" and [step.stage for step in found.steps] == [step.stage for step in plan.steps]
    assert found.steps[0].stage is next(stage for stage in all_stages() if stage.name == "optics")
    assert found.recipe.leaves == plan.recipe.leaves and found.output == plan.output


@pytest.fixture
def family(tmp_path):
    """Five recipes of drops, the first two of equal optics."""
    paths = []
    for k, (radius, density) in enumerate([(0.5, 1e8), (0.5, 2e8), (0.6, 1e8), (0.7, 1e8), (0.8, 1e8)]):
        paths.append(tmp_path / f"d{k}.yaml")
        paths[-1].write_text(DROPS.format(name=f"d{k}", tolerance="5%", radius=f"{radius} um").replace("1e8", f"{density:g}"))
    return paths


@pytest.mark.slow
def test_processes_give_the_bytes_of_single_bakes_and_share_stages(call, family, tmp_path, monkeypatch):
    for path in family:
        assert call(path, "-o", tmp_path / f"{path.stem}-alone.h5", "--force")[0] == 0
    monkeypatch.setenv("BAKERY_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(many, "SHORT", 0.0)
    status, out, err = call(*family, "-o", f"{tmp_path}/", "--jobs", 3)
    assert status == 0 and out.split() == [str(tmp_path / f"{path.stem}.h5") for path in family], err
    for path in family:
        assert hash_of(tmp_path / f"{path.stem}.h5") == hash_of(tmp_path / f"{path.stem}-alone.h5")
    assert err.count("optics: from the cache") == 1 and "waiting" not in err
    assert len(list((tmp_path / "cache").glob("optics-*.h5"))) == 4


def workers_of(pid):
    """The processes that a process has started."""
    found = subprocess.run(["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True).stdout
    return [int(word) for word in found.split()]


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def start(tmp_path, *more):
    """A bake of three recipes of some ten seconds each, once its two workers are there."""
    for k in range(3):
        recipe = DROPS.format(name=f"s{k}", tolerance="0.3%", radius=f"{20 + k} um").replace(", max: 3 um", "")
        (tmp_path / f"s{k}.yaml").write_text(recipe)
    process = subprocess.Popen([sys.executable, "-m", "bakery", "s0.yaml", "s1.yaml", "s2.yaml", "--jobs", "2", *more],
                               cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               env={**os.environ, "PYTHONPATH": str(ROOT)})
    until = time.monotonic() + 60
    while time.monotonic() < until and len(workers := workers_of(process.pid)) < 2 and process.poll() is None:
        time.sleep(0.1)
    time.sleep(2.0)
    return process, workers


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9)])
def test_no_worker_outlives_the_bake(tmp_path, number, status):
    process, workers = start(tmp_path)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == status and "Traceback" not in err, err
    until = time.monotonic() + 10
    while time.monotonic() < until and any(map(alive, workers)):
        time.sleep(0.1)
    assert len(workers) == 2 and not any(map(alive, workers))
    assert not list(tmp_path.glob("*.h5")) and not list(tmp_path.glob(".*.part"))


@pytest.mark.slow
def test_a_worker_that_is_killed_takes_one_recipe_with_it(tmp_path):
    process, workers = start(tmp_path, "--keep-going", "--tolerance", "0.5%")
    os.kill(workers[0], signal.SIGKILL)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 3 and len(out.split()) == 2, err
    assert "1 of 3 recipes failed:" in err and "most likely it ran out of memory" in err
