"""Bakes that are killed, stopped and started together: no broken file, no finished stage lost, the same values afterwards."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bakery.store.read import read
from tests.conftest import DROPS, ROOT, slow


def start(recipe, output, *more):
    call = [sys.executable, "-m", "bakery", str(recipe), "-o", str(output), *more]
    return subprocess.Popen(call, cwd=recipe.parent, env={**os.environ, "PYTHONPATH": str(ROOT)}, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def ends_well(process):
    _, message = process.communicate(timeout=240)
    assert process.returncode == 0, message


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The hash of a bake of `drops` that nobody disturbs, and how long the process takes once kernels are compiled."""
    folder = tmp_path_factory.mktemp("undisturbed")
    (folder / "drops.yaml").write_text(DROPS.format(name="drops", tolerance="5%", radius="0.5 um"))
    started = time.monotonic()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BAKERY_CACHE", str(folder / "cache"))
        ends_well(start(folder / "drops.yaml", folder / "reference.h5"))
    return read(folder / "reference.h5").attributes["content_hash"], time.monotonic() - started


def no_parts(folder):
    return not [path for path in folder.rglob("*") if path.name.endswith(".part")]


@pytest.mark.slow
def test_kill_at_random_moments(drops, tmp_path, undisturbed):
    expected, seconds = undisturbed
    output = tmp_path / "out.h5"
    moments = random.Random(1)
    for turn in range(2):
        process = start(drops, output, "--force")
        time.sleep(moments.uniform(0.05, 1.1) * min(seconds, 6.0))
        process.kill()
        process.communicate()
        if output.exists():
            assert read(output).attributes["content_hash"] == expected, f"turn {turn}"
    ends_well(start(drops, output))
    assert read(output).attributes["content_hash"] == expected
    assert no_parts(tmp_path)


def test_an_unchanged_bake_sweeps_too(milk, tmp_path, call):
    """A bake that was killed while it wrote over a finished asset leaves a part file; the next one has nothing to write."""
    output = tmp_path / "out.h5"
    assert call(milk, "-o", output)[0] == 0
    left = [folder / f".out.h5.{'0123456789abcdef'}.part" for folder in (tmp_path, Path(os.environ["BAKERY_CACHE"]))]
    for path in left:
        path.write_bytes(b"half")
    status, _, message = call(milk, "-o", output)
    assert status == 0 and "unchanged" in message + _
    assert not any(path.exists() for path in left)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), slow(signal.SIGTERM, 143)])
def test_signals_leave_nothing_behind(tmp_path, number, status):
    recipe = tmp_path / "slow.yaml"
    # large drops at 0.3 %: some 20 s of one core, so the signal meets the bake in the middle
    recipe.write_text(DROPS.format(name="slow", tolerance="0.3%", radius="30 um").replace(", max: 3 um", ""))
    output = tmp_path / "out.h5"
    output.write_bytes(b"bakery-asset 1 that stood here before")
    process = start(recipe, output)
    time.sleep(2.0)
    process.send_signal(number)
    _, message = process.communicate(timeout=60)
    if process.returncode == 0:
        pytest.fail("the bake ended before the signal came: this test needs a longer one")
    assert process.returncode == status
    assert "Traceback" not in message
    assert output.read_bytes() == b"bakery-asset 1 that stood here before"
    assert no_parts(tmp_path)


@pytest.mark.parametrize(("first", "other", "status"),
                         [(signal.SIGINT, signal.SIGTERM, 130), (signal.SIGTERM, signal.SIGINT, 143)])
def test_the_other_signal_does_not_break_off_the_clean_up(first, other, status):
    code = ("import os, sys, time\nfrom bakery import cli\n"
            "def work(**_):\n"
            "    try:\n        os.kill(os.getpid(), int(sys.argv[1]))\n        time.sleep(60)\n"
            "    finally:\n        os.kill(os.getpid(), int(sys.argv[2]))\n        time.sleep(0.1)\n        print('cleaned up')\n"
            "cli.cli.main = work\ncli.main([])\n")
    done = subprocess.run([sys.executable, "-c", code, str(int(first)), str(int(other))], capture_output=True, text=True,
                          timeout=60, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert (done.returncode, done.stdout) == (status, "cleaned up\n") and "Traceback" not in done.stderr


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_while_packages_load_ends_as_quietly(number, status):
    """The first package of another project that the command line loads is click."""
    code = ("import os, sys\n"
            "class Finder:\n"
            "    def find_spec(self, name, *_):\n"
            "        if name == 'click':\n            sys.meta_path.remove(self)\n"
            "            os.kill(os.getpid(), int(sys.argv[1]))\n"
            "sys.meta_path.insert(0, Finder())\n"
            "from bakery.cli import main\nmain(['--help'])\n")
    done = subprocess.run([sys.executable, "-c", code, str(int(number))], capture_output=True, text=True, timeout=60,
                          env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode == status and "no file is incomplete" in done.stderr and "Traceback" not in done.stderr, done.stderr


SWALLOWS = """\
import os, sys, time
try:
    os.kill(os.getpid(), int(sys.argv[1]))
    for _ in range(5):
        time.sleep(0.02)
except BaseException:
    pass
whole = True
"""


@pytest.mark.parametrize("work", ["import swallows; assert swallows.whole", "Destroyed()"])
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_where_exceptions_are_swallowed_is_not_lost(tmp_path, number, status, work):
    """A module that catches all that goes wrong while it is imported, and a destructor, whose exceptions Python drops."""
    (tmp_path / "swallows.py").write_text(SWALLOWS)
    code = ("import os, sys, time\nfrom bakery import cli\n"
            "class Destroyed:\n"
            "    def __del__(self):\n        os.kill(os.getpid(), int(sys.argv[1]))\n        time.sleep(0.01)\n"
            "def work(**_):\n"
            "    try:\n"
           f"        {work}\n"
            "        time.sleep(60)\n"
            "    finally:\n        print('cleaned up')\n"
            "cli.cli.main = work\ncli.main([])\n")
    done = subprocess.run([sys.executable, "-c", code, str(int(number))], capture_output=True, text=True, timeout=30,
                          env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"})
    assert (done.returncode, done.stdout) == (status, "cleaned up\n") and "Traceback" not in done.stderr, done.stderr


@pytest.mark.slow
def test_bakes_at_once(drops, tmp_path, undisturbed):
    expected, _ = undisturbed
    processes = [start(drops, tmp_path / f"{i % 2}.h5", "--verbose") for i in range(3)]
    ends = [process.communicate(timeout=240) for process in processes]
    assert [process.returncode for process in processes] == [0] * 3, ends
    for i in range(2):
        assert read(tmp_path / f"{i}.h5").attributes["content_hash"] == expected


@pytest.mark.slow
def test_the_holder_of_a_lock_dies(drops, tmp_path):
    holder = subprocess.Popen([sys.executable, "-c", (
        "import time\nfrom pathlib import Path\nfrom bakery.run.bake import planned\nfrom bakery.run.cache import Cache\n"
        f"plan = planned({str(drops)!r})\ncache = Cache()\n"
        "with cache.lock('optics', plan.steps[0].input_hash):\n    print('held', flush=True)\n    time.sleep(600)\n")],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, text=True)
    assert holder.stdout.readline() == "held\n"
    waiting = start(drops, tmp_path / "out.h5")
    assert any("another bake computes it; waiting" in line for line in waiting.stderr)  # on a slow machine not the first one
    holder.kill()
    holder.communicate()
    ends_well(waiting)


@pytest.mark.soak
def test_kill_two_hundred_times(drops, tmp_path, undisturbed):
    expected, seconds = undisturbed
    moments = random.Random(2)
    for _ in range(200):
        process = start(drops, tmp_path / "out.h5", "--force")
        time.sleep(moments.uniform(0.01, 1.1) * seconds)
        process.kill()
        process.communicate()
        if (tmp_path / "out.h5").exists():
            assert read(tmp_path / "out.h5").attributes["content_hash"] == expected
