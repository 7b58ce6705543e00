"""Blocks on a Dask cluster: the values of one process, workers of another version refused."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from bakery.store.read import read
from tests.conftest import ROOT


@pytest.fixture(scope="module")
def scheduler():
    """The address of a cluster of two worker processes on this machine."""
    code = ("from distributed import LocalCluster\n"
            "if __name__ == '__main__':\n"
            "    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:\n"
            "        print(cluster.scheduler_address, flush=True)\n"
            "        input()\n")
    process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                               stderr=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": str(ROOT)})
    yield process.stdout.readline().strip()
    process.communicate("\n", timeout=60)


def test_a_cluster_gives_the_values_of_one_process(command, scheduler, drops, tmp_path):
    done = command(drops, "-o", tmp_path / "far.h5", "--force", "--cluster", scheduler, timeout=240)
    assert done.returncode == 0, done.stderr
    assert command(drops, "-o", tmp_path / "near.h5", "--force", "--jobs", 1, timeout=240).returncode == 0
    far, near = (read(tmp_path / name).attributes["content_hash"] for name in ("far.h5", "near.h5"))
    assert far == near


def test_workers_of_another_version_are_refused(command, scheduler, drops, tmp_path):
    code = ("import sys, bakery\nbakery.__version__ = '99.0'\n"
            "from bakery.cli import status_of\nsys.exit(status_of(sys.argv[1:]))\n")
    call = [sys.executable, "-c", code, str(drops), "-o", str(tmp_path / "a.h5"), "--cluster", scheduler]
    done = subprocess.run(call, text=True, capture_output=True, env={**os.environ, "PYTHONPATH": str(ROOT)}, timeout=240)
    assert done.returncode == 2 and "99.0" in done.stderr and "equal versions give equal values" in done.stderr
    assert not (tmp_path / "a.h5").exists()


def test_no_scheduler(command, drops, tmp_path):
    done = command(drops, "-o", tmp_path / "a.h5", "--cluster", "nonsense")
    assert done.returncode == 2 and "nonsense" in done.stderr and "Traceback" not in done.stderr
