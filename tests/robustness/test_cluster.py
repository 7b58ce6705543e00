"""Blocks on a Dask cluster: the values of one process, workers of another version refused, workers and schedulers that die."""

import os
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

import bakery
from bakery.errors import StageError, UsageError
from bakery.run import dask, many, messages
from bakery.run.executors import library_versions
from bakery.store.read import read
from tests.conftest import DROPS, ROOT, slow
from tests.robustness import blocks


@contextmanager
def running(settings="n_workers=2, threads_per_worker=1", failures=1):
    """A process with a scheduler and two workers that are started again when they die; a block may end so many workers."""
    code = ("from distributed import LocalCluster\n"
            "if __name__ == '__main__':\n"
            f"    with LocalCluster({settings}, dashboard_address=None) as cluster:\n"
            "        print(cluster.scheduler_address, flush=True)\n"
            "        input()\n")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(failures)}
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


@pytest.mark.slow
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


@pytest.mark.parametrize("address", ["nonsense", "", "ucx://h:1", "inproc://x:1", "tcp://localhost:99999", "localhost:0",
                                     "tcp:8786"])
def test_what_is_no_address_is_refused(call, drops, tmp_path, address):
    status, out, err = call(drops, "-o", tmp_path / "a.h5", "--cluster", address)
    assert status == 2 and not out and not (tmp_path / "a.h5").exists()
    assert err.endswith(f'--cluster: found "{address}"; expected the address of a Dask scheduler, such as tcp://host:8786\n')
    with pytest.raises(UsageError, match="expected the address of a Dask scheduler"):
        bakery.bake(drops, tmp_path / "a.h5", cluster=address)


@pytest.mark.parametrize(("address", "encrypted", "says"), [
    slow("tls://localhost:9", "False", "Dask has no certificates for it; its options distributed.comm.tls.ca-file"),
    slow("tcp://localhost:9", "True", "where no Dask scheduler answers (encryption required by Dask configuration"),
])
def test_an_address_that_dask_cannot_call_ends_at_once(drops, tmp_path, address, encrypted, says):
    """Clients that fail while they connect wait for a minute to be collected, unless they are closed."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": encrypted}
    done = subprocess.run([sys.executable, "-m", "bakery", drops, "-o", tmp_path / "a.h5", "--force", "--cluster", address],
                          capture_output=True, text=True, timeout=45, env=environment)
    assert done.returncode == 2 and not done.stdout
    assert says in done.stderr and "Traceback" not in done.stderr and "Exception ignored" not in done.stderr


SWEPT = ("bakery: 1\nname: lobes\nwavelengths: [0.55]\ntolerance: 5%\n"
         "medium: {albedo: 0.9, mean_free_path: 1 mm, phase: {type: hg, g: 0.5}}\n"
         "sweep: {medium.phase.g: [0.1, 0.2, 0.3], refine: false}\n")


@pytest.mark.slow
def test_a_family_calls_its_cluster_once(call, tmp_path, monkeypatch):
    monkeypatch.setattr(dask, "_ANSWER", "1s")
    (tmp_path / "lobes.yaml").write_text(SWEPT)
    status, out, err = call(tmp_path / "lobes.yaml", "-o", tmp_path / "a.h5", "--cluster", "localhost:9")
    assert status == 2 and not out and "no Dask scheduler answers" in err and "point" not in err
    assert {path.name for path in tmp_path.iterdir()} <= {"lobes.yaml", "cache"}


@pytest.mark.slow
def test_no_recipe_is_started_after_one_that_found_no_cluster(call, drops, milk, tmp_path, monkeypatch):
    monkeypatch.setattr(dask, "_ANSWER", "1s")
    status, out, err = call(drops, milk, "-o", f"{tmp_path}/", "--force", "--keep-going", "--jobs", 1, "--cluster", "localhost:9")
    assert status == 2 and not out and err.count("no Dask scheduler answers") == 1 and "1 not started" in err


@pytest.mark.slow
def test_blocks_come_back_in_order_and_what_they_share_goes_once(workers):
    table = np.arange(1e4)
    assert workers.map(blocks.scaled, [table] * 37, range(37)) == [(table.sum() * k, True) for k in range(37)]
    assert len(workers._shared) == 1
    assert workers.map(blocks.scaled, [table + 1], [2]) == [((table + 1).sum() * 2, True)]
    assert workers.map(blocks.scaled) == []


@pytest.mark.slow
def test_blocks_of_a_killed_worker_are_done_again(workers, tmp_path, capfd):
    table = np.arange(1e4)
    workers.map(blocks.scaled, [table] * 4, range(4))
    mark = tmp_path / "killed"
    assert workers.map(blocks.killed_once, [mark] * 20, range(20)) == list(range(20)) and mark.exists()
    assert [value for value, _ in workers.map(blocks.scaled, [table] * 4, range(4))] == [table.sum() * k for k in range(4)]
    assert capfd.readouterr().err == ""


@pytest.mark.slow
def test_a_block_that_kills_its_workers_is_told(workers, capfd):
    with pytest.raises(StageError, match="2 workers died on the same block"):
        workers.map(blocks.deadly, range(3))
    assert capfd.readouterr().err == ""


@pytest.mark.slow
def test_faults_of_a_block_are_not_those_of_the_cluster(workers):
    with pytest.raises(FileNotFoundError, match="block"):
        workers.map(blocks.refused, range(3))


class Listed:
    """A client whose workers answer as it is told."""

    status = "running"
    scheduler = SimpleNamespace(address="tcp://here:0")

    def __init__(self, **answers):
        self.answers = answers

    def wait_for_workers(self, count, timeout):
        pass

    def get_executor(self, **options):
        return None

    def nthreads(self):
        return dict.fromkeys(self.answers, 1)

    def run(self, function, workers, on_error):
        assert on_error == "return"
        return {name: self.answers[name] for name in workers}


@pytest.mark.slow
def test_only_workers_with_our_versions_get_blocks(monkeypatch):
    monkeypatch.setattr(dask, "LOOK", 0.0)
    ours, said = library_versions(), []
    client = Listed(good=ours, old={**ours, "numba": "0.1"}, odd=ImportError("No module named 'bakery'"), dying=OSError("gone"))
    found = dask._connected(client, said.append)
    assert found.threads == {"good": 1}
    assert [line.split(";")[0] for line in said] == [
        "cluster: worker odd gets no blocks: it does not tell its versions (ImportError: No module named 'bakery')",
        f"cluster: worker old gets no blocks: it has numba 0.1 instead of {ours['numba']}"]
    client.answers = {"old": client.answers["old"], "dying": ours}  # it answers this time, the good one is gone
    said.clear()
    found.look()
    assert found.threads == {"dying": 1} and said == ["cluster: worker good is gone; what it had is done again"]
    del client.answers["dying"]
    with pytest.raises(UsageError, match="old gets no blocks: it has numba 0.1.*equal versions"):
        dask._connected(client, said.append)


@pytest.mark.slow
def test_a_cluster_without_workers_is_not_waited_for_without_end(monkeypatch):
    monkeypatch.setattr(messages, "LOOK", 0.01)
    monkeypatch.setattr(messages, "_PATIENCE", 0.02)
    with pytest.raises(messages.ClusterLost, match="no worker"):
        dask.Cluster(Listed()).map(blocks.deadly, range(3))


@pytest.mark.slow
def test_a_worker_of_another_version_is_left_out(call, drops, milk, tmp_path, scheduler, monkeypatch):
    """A real one, which says that it has another bakery; the hash is that of one machine, and one line says so."""
    monkeypatch.setattr(many, "SHORT", 0.0)
    preload = tmp_path / "other.py"
    preload.write_text("import bakery\nbakery.__version__ = '0.1'\n")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_worker", scheduler, "--nthreads", "1", "--no-dashboard",
                           "--no-nanny", "--preload", str(preload)], env=environment, stderr=subprocess.PIPE, text=True) as other:
        while "Registered to" not in other.stderr.readline():
            pass
        try:
            assert call(drops, "-o", tmp_path / "near.h5", "--force", "--jobs", 1)[0] == 0
            status, _, err = call(drops, milk, "-o", f"{tmp_path}/", "--force", "--cluster", scheduler, "--jobs", 2)
        finally:
            other.kill()
    assert status == 0 and err.count("cluster: ") == err.count("bakery 0.1 instead of") == 1, err
    far, near = (read(tmp_path / name).attributes["content_hash"] for name in ("drops.h5", "near.h5"))
    assert far == near


@pytest.mark.slow
def test_workers_that_are_killed_again_and_again(call, tmp_path, monkeypatch):
    """Three recipes at once while three workers are killed, one after another: the hashes of one machine."""
    monkeypatch.setattr(many, "SHORT", 0.0)
    recipes = []
    for k in range(3):
        recipes.append(tmp_path / f"r{k}.yaml")
        recipes[-1].write_text(DROPS.format(name=f"r{k}", tolerance="0.7%", radius=f"{9 + k} um").replace(" 3 um", " 60 um"))
    for name in "near", "far":
        (tmp_path / name).mkdir()
    assert call(*recipes, "-o", f"{tmp_path}/near/", "--force", "--jobs", 2)[0] == 0

    def kill(address):
        from distributed import Client

        with Client(address, set_as_default=False) as client:
            pids, killed = client.run(os.getpid), 0
            while killed < 3 and not stop.wait(0.1):
                busy = next((address for address, keys in client.processing().items() if keys and address in pids), None)
                if busy:
                    os.kill(pids.pop(busy), signal.SIGKILL)
                    killed += 1
                    stop.wait(2.0)
                    pids |= client.run(os.getpid, on_error="ignore")

    with running("n_workers=3, threads_per_worker=1", failures=3) as (_, address):
        stop = threading.Event()
        killer = threading.Thread(target=kill, args=(address,))
        killer.start()
        try:
            status, _, err = call(*recipes, "-o", f"{tmp_path}/far/", "--force", "--jobs", 2, "--cluster", address)
        finally:
            stop.set()
            killer.join()
    assert status == 0 and "is gone; what it had is done again" in err, err
    for recipe in recipes:
        far, near = (read(tmp_path / folder / f"{recipe.stem}.h5").attributes["content_hash"] for folder in ("far", "near"))
        assert far == near


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
