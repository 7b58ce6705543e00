"""Blocks on a Dask cluster: the values of one process, workers of another version refused, workers and schedulers that die."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import Future
from contextlib import contextmanager

import numpy as np
import pytest

from bakery.errors import StageError, UsageError
from bakery.run import dask
from bakery.store.read import read
from tests.conftest import ROOT
from tests.robustness import blocks


@contextmanager
def running(settings="n_workers=2, threads_per_worker=1"):
    """A process with a scheduler and two workers that are started again when they die; a block may end one worker, not two."""
    code = ("from distributed import LocalCluster\n"
            "if __name__ == '__main__':\n"
            f"    with LocalCluster({settings}, dashboard_address=None) as cluster:\n"
            "        print(cluster.scheduler_address, flush=True)\n"
            "        input()\n")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                          stderr=subprocess.DEVNULL, env=environment) as process:
        yield process, process.stdout.readline().strip()
        if process.poll() is None:
            process.communicate("\n", timeout=60)


@pytest.fixture(scope="module")
def scheduler():
    """The address of a cluster of two worker processes on this machine."""
    with running() as (_, address):
        yield address


@pytest.fixture
def workers(scheduler):
    with dask.cluster(scheduler) as workers:
        yield workers


def test_a_cluster_gives_the_values_of_one_process(call, scheduler, drops, tmp_path):
    # here first: workers find kernels compiled, where each of them would compile its own
    for name, where in ("near.h5", ("--jobs", 1)), ("far.h5", ("--cluster", scheduler)):
        status, _, err = call(drops, "-o", tmp_path / name, "--force", *where)
        assert status == 0, err
    far, near = (read(tmp_path / name).attributes["content_hash"] for name in ("far.h5", "near.h5"))
    assert far == near


def test_workers_of_another_version_are_refused(call, monkeypatch, scheduler, drops, tmp_path):
    monkeypatch.setattr("bakery.__version__", "99.0")
    status, _, err = call(drops, "-o", tmp_path / "a.h5", "--cluster", scheduler)
    assert status == 2 and "99.0" in err and "equal versions give equal values" in err
    assert not (tmp_path / "a.h5").exists()


def test_no_scheduler(call, drops, tmp_path):
    status, _, err = call(drops, "-o", tmp_path / "a.h5", "--cluster", "nonsense")
    assert status == 2 and "nonsense" in err


def test_blocks_come_back_in_order_and_what_they_share_goes_once(workers):
    table = np.arange(1e4)
    assert workers.map(blocks.scaled, [table] * 37, range(37)) == [(table.sum() * k, True) for k in range(37)]
    assert len(workers._shared) == 1
    assert workers.map(blocks.scaled, [table + 1], [2]) == [((table + 1).sum() * 2, True)]
    assert workers.map(blocks.scaled) == []


def test_blocks_of_a_killed_worker_are_done_again(workers, tmp_path, capfd):
    table = np.arange(1e4)
    workers.map(blocks.scaled, [table] * 4, range(4))
    mark = tmp_path / "killed"
    assert workers.map(blocks.killed_once, [mark] * 20, range(20)) == list(range(20)) and mark.exists()
    assert [value for value, _ in workers.map(blocks.scaled, [table] * 4, range(4))] == [table.sum() * k for k in range(4)]
    assert capfd.readouterr().err == ""


def test_a_block_that_kills_its_workers_is_told(workers, capfd):
    with pytest.raises(StageError, match="2 workers died on the same block"):
        workers.map(blocks.deadly, range(3))
    assert capfd.readouterr().err == ""


def test_faults_of_a_block_are_not_those_of_the_cluster(workers):
    with pytest.raises(FileNotFoundError, match="block"):
        workers.map(blocks.refused, range(3))


def test_a_worker_that_dies_before_it_tells_its_versions_is_passed_over():
    class Shrunk:
        def wait_for_workers(self, count, timeout):
            pass

        def run(self, function, on_error):
            assert on_error == "return"
            return {"tcp://here:1": function(), "tcp://gone:2": OSError("Address removed."), **self.more}

    Shrunk.more = {}
    dask._check_workers(Shrunk())
    Shrunk.more = {"tcp://odd:3": ImportError("No module named 'bakery'")}
    with pytest.raises(UsageError, match="tcp://odd:3 does not tell its versions"):
        dask._check_workers(Shrunk())


@pytest.mark.slow
def test_a_cluster_without_workers_is_not_waited_for_without_end(monkeypatch):
    class Deserted:
        status = "running"

        def get_executor(self, **options):
            return self

        def submit(self, *arguments, **options):
            return Future()  # never done

        def nthreads(self):
            return {}

    monkeypatch.setattr(dask, "_LOOK", 0.01)
    monkeypatch.setattr(dask, "_PATIENCE", 0.02)
    with pytest.raises(StageError, match="no worker"):
        dask.Cluster(Deserted()).map(blocks.deadly, range(3))


@pytest.mark.slow
def test_a_scheduler_that_dies(tmp_path):
    recipe = tmp_path / "slab.yaml"
    recipe.write_text("bakery: 1\nname: slab\nwavelengths: [0.5 um]\ntolerance: 10%\n"
                      "medium: {albedo: 0.9, mean_free_path: 1 mm, phase: {type: hg, g: 0.5}}\n"
                      "multiple_scattering: {sources: [point]}\n")
    # the second stage's blocks end the scheduler
    code = ("import sys\nfrom bakery.run import dask\nfrom bakery.cli import status_of\nfrom tests.robustness import blocks\n"
            "whole = dask.Cluster.map\n"
            "dask.Cluster.map = lambda self, *ignored: whole(self, blocks.beheaded, [int(sys.argv[1])])\n"
            "sys.exit(status_of(sys.argv[2:]))\n")
    # the block ends its worker with the scheduler
    with running("n_workers=1, processes=False, protocol='tcp://'") as (process, address):
        call = [sys.executable, "-c", code, str(process.pid), str(recipe), "-o", str(tmp_path / "a.h5"), "--cluster", address]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "BAKERY_CACHE": str(tmp_path / "cache")}
        done = subprocess.run(call, text=True, capture_output=True, env=environment, timeout=120)
    # what the finished stage took, and, on a slow machine, what the other is expected to take, what takes long
    lines = [line for line in done.stderr.splitlines()
             if not line.startswith(("medium: ", "multiple: ")) and not line.endswith(" so far")]
    assert done.returncode == 3 and len(lines) == 1 and "the scheduler of the cluster is gone" in lines[0], done.stderr
    assert not (tmp_path / "a.h5").exists() and len(list((tmp_path / "cache").glob("medium-*.h5"))) == 1
