"""`bake cluster-script`: scripts that the shell accepts, with what Slurm has to be asked for; the local one bakes."""

import re
import shlex
import signal
import subprocess
import time

import pytest

from bakery.store.read import read

# stands for the Python of a script: a scheduler and workers that only wait, and a bake that does what its first argument says
STAND_IN = """\
#!/usr/bin/env bash
case "$2" in
*dask_scheduler) echo '{}' >"$4"; exec sleep 600;;
*dask_worker) exec sleep 600;;
bakery) echo "$$"; exec bash -c "$3";;
*) echo tcp://127.0.0.1:1;;
esac
"""


@pytest.mark.parametrize(("kind", "more", "held"), [
    ("slurm", ("--workers", 64, "--memory", 3, "--time", "12:00:00"),
     ("#SBATCH --ntasks=65\n", "#SBATCH --mem-per-cpu=3000M\n", "#SBATCH --time=12:00:00\n", "srun --ntasks=64 ")),
    ("local", ("--workers", 3), ("--host 127.0.0.1", "--nworkers 3", "--nthreads 1", "NUMBA_NUM_THREADS=1")),
])
def test_scripts_are_bash_and_hold_what_was_asked_for(call, kind, more, held):
    status, script, told = call("cluster-script", kind, *more)
    assert status == 0 and "cluster.sh RECIPE…" in told
    assert all(text in script for text in held)
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)


def test_wrong_options_of_a_script(call):
    assert call("cluster-script", "slurm", "--time", "soon")[0] == 2
    assert call("cluster-script", "local", "--time", "1:00:00")[0] == 2
    assert call("cluster-script", "pbs")[0] == 2
    for option, values in {"--memory": ("nan", "inf", "0", "1e300"), "--workers": ("0", 10**20)}.items():
        for value in values:
            status, out, err = call("cluster-script", "local", option, value)
            assert status == 2 and not out and option in err


@pytest.fixture
def local(call, tmp_path, monkeypatch):
    """The local script with what stands for Python; its folder is in `tmp_path`."""
    (tmp_path / "python").write_text(STAND_IN)
    (tmp_path / "python").chmod(0o755)
    text = call("cluster-script", "local", "--workers", 1)[1]
    (tmp_path / "cluster.sh").write_text(re.sub("(?m)^PYTHON=.*", f"PYTHON={shlex.quote(str(tmp_path / 'python'))}", text))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path / "cluster.sh"


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_script_that_is_ended_ends_its_bake(local, tmp_path, number, status):
    with subprocess.Popen(["bash", local, "exec sleep 60"], stdout=subprocess.PIPE, text=True) as process:
        bake = process.stdout.readline().strip()
        started = time.monotonic()
        process.send_signal(number)
        process.communicate(timeout=120)
    assert process.returncode == status and time.monotonic() - started < 20  # a moment, on a busy machine
    assert subprocess.run(["ps", "-p", bake], capture_output=True).returncode == 1
    assert not list(tmp_path.glob("bakery-cluster-*"))


def test_a_script_has_the_status_and_the_standard_input_of_its_bake(local, tmp_path):
    done = subprocess.run(["bash", local, "cat; exit 3"], input="a recipe", capture_output=True, text=True, timeout=120)
    assert done.returncode == 3 and done.stdout.endswith("\na recipe") and not list(tmp_path.glob("bakery-cluster-*"))


@pytest.mark.slow
def test_the_local_script_bakes_and_leaves_nothing(call, drops, tmp_path, monkeypatch):
    assert call(drops, "-o", tmp_path / "near.h5", "--jobs", 1)[0] == 0
    (tmp_path / "cluster.sh").write_text(call("cluster-script", "local", "--workers", 2)[1])
    (tmp_path / "scratch").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "scratch"))
    done = subprocess.run(["bash", tmp_path / "cluster.sh", str(drops), "-o", str(tmp_path / "far.h5"), "--force"],
                          capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and done.stdout == f"{tmp_path}/far.h5\n", done.stderr
    far, near = (read(tmp_path / name).attributes["content_hash"] for name in ("far.h5", "near.h5"))
    assert far == near
    left = list((tmp_path / "scratch").glob("bakery-cluster-*"))
    running = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True).stdout
    assert not left and str(tmp_path / "scratch") not in running


@pytest.mark.slow
def test_the_local_script_alone_says_what_to_call(call, tmp_path, monkeypatch):
    (tmp_path / "cluster.sh").write_text(call("cluster-script", "local", "--workers", 1)[1])
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with subprocess.Popen(["bash", tmp_path / "cluster.sh"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith("bake RECIPE… --cluster tcp://127.0.0.1:")
        process.terminate()
        process.communicate(timeout=60)
    assert process.returncode == 143 and not list(tmp_path.glob("bakery-cluster-*"))
