"""Frames and passes on a Dask cluster: the bytes of one machine, whichever workers live, and faults in the renderer's words."""

import os
import signal
from types import SimpleNamespace

import pytest

from bakery.errors import BakeryError
from bakery.run import dask
from bakery.run.progress import Progress
from renderers import sequence
from renderers.cluster import passes
from renderers.pictures import passes as passes_of_picture
from renderers.pictures.versions import versions
from renderers.sequence import far, film
from tests.cli.test_frames import bake, content, lay_out
from tests.robustness.test_cluster import running

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scheduler():
    with running() as (_, address):
        yield address


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    return bake(tmp_path_factory.mktemp("assets"))


@pytest.fixture
def place(baked, tmp_path, monkeypatch):
    monkeypatch.setattr(film, "program", lambda: None)
    return lay_out(tmp_path, baked)


class Killing:
    """Progress that kills a worker when the first frame is there."""

    def __init__(self, workers):
        self._workers, self.killed = workers, []

    def update(self, fraction, error=None, state=""):
        busy = next((address for address, keys in self._workers._client.processing().items() if keys), None)
        if self.killed or busy is None:
            return
        pid = self._workers._client.run(os.getpid, workers=[busy])[busy]
        self.killed.append(pid)
        os.kill(pid, signal.SIGKILL)

    def __getattr__(self, name):
        return getattr(Progress(), name)


def test_frames_of_workers_have_the_bytes_of_one_machine(call, place, scheduler):
    """As a user calls it; the second call finds them all, and goes on with none."""
    assert call("render", place / "s.yaml", "--frames", "1-3")[0] == 0
    near = content(place)
    status, out, err = call("render", place / "s.yaml", "-o", place / "apart" / "drift.png", "--frames", "1-3", "--cluster",
                            scheduler)
    assert status == 0, err
    assert content(place / "apart") == near and out.count("drift.0") == 6
    again = call("render", place / "s.yaml", "-o", place / "apart" / "drift.png", "--frames", "1-3", "--cluster", scheduler)
    assert again[0] == 0 and "3 left as they are" in again[2]


def test_a_frame_of_a_killed_worker_is_done_by_another(call, place, scheduler):
    scene = place / "s.yaml"
    scene.write_text(scene.read_text().replace("samples: 2", "samples: 24").replace("[3, 4, 5]", "[3, 4, 5, 6, 7]"))
    with dask.cluster(scheduler) as workers:
        killing = Killing(workers)
        report = sequence.render(scene, place / "apart" / "drift.png", progress=killing, cluster=workers)
    assert len(killing.killed) == 1 and [row["status"] for row in report["frames"]] == ["rendered"] * 5
    assert call("render", scene, "--frames", "2,5")[0] == 0
    near, distant = content(place), content(place / "apart")
    assert len(distant) == 10 and all(distant[name] == near[name] for name in near)


def test_faults_of_a_worker(place, scheduler):
    """A worker that lacks what a frame needs says so in one sentence with the number of the frame and the status."""
    (place / "lamp.xml").write_text("<scene $panel")
    with dask.cluster(scheduler) as workers, pytest.raises(BakeryError) as fault:
        sequence.render(place / "s.yaml", place / "apart" / "drift.png", (2,), cluster=workers)
    assert fault.value.exit_status == 2 and "Mitsuba cannot load this scene" in str(fault.value)


def test_a_worker_with_another_mitsuba_is_refused():
    asked = SimpleNamespace(scene=SimpleNamespace(versions=versions() | {"mitsuba": "2.0"}), number=7)
    for rendered, arguments in (far.rendered, ({}, asked)), (passes.rendered, (asked, "walk", 0)):
        with pytest.raises(BakeryError, match="instead of 2.0; equal versions give equal pictures") as fault:
            rendered({}, *arguments)
        assert fault.value.exit_status == 2


def test_passes_of_workers_have_the_bytes_of_one_machine(call, place, scheduler):
    """Parts of several kinds, and on with what an interrupted render left."""
    scene, first = place / "s.yaml", ("--set", "stop.samples=3")
    for folder, options in ("near", ()), ("apart", ("--cluster", scheduler)):
        (place / folder).mkdir(exist_ok=True)
        picture = ("-o", place / folder / "drift.png")
        assert call("render", scene, *picture, *first, *options)[0] == 0
        assert call("render", scene, *picture, "--set", "stop.samples=12", "--resume", *options)[0] == 0
    assert content(place / "apart") == content(place / "near")


def test_passes_of_a_killed_worker_are_done_by_others(place, scheduler):
    scene, wanted = place / "s.yaml", {"stop.samples": "40"}
    with dask.cluster(scheduler) as workers:
        killing = Killing(workers)
        report = passes_of_picture.render(scene, place / "apart" / "drift.png", overrides=wanted,
                                          elsewhere=passes.workers(workers),
                                          progress=lambda fraction, noise=None: killing.update(fraction))
    assert len(killing.killed) == 1 and report["samples"] >= 40
    (place / "near").mkdir()
    passes_of_picture.render(scene, place / "near" / "drift.png", overrides=wanted)
    assert content(place / "apart") == content(place / "near")


def test_noise_ends_passes_of_workers(place, scheduler):
    """Those that were rendered beyond the last one are of no use, and nothing waits for them."""
    scene = place / "s.yaml"
    scene.write_text(scene.read_text().replace("stop: {samples: 2}", "stop: {noise: 30%}"))
    with dask.cluster(scheduler) as workers:
        report = passes_of_picture.render(scene, place / "apart" / "drift.png", elsewhere=passes.workers(workers))
    assert report["stopped_by"] == "noise" and report["noise"] <= 0.3


def test_one_frame_is_shared_by_passes(call, place, scheduler):
    assert call("render", place / "s.yaml", "--frames", "2")[0] == 0
    near = content(place)
    assert call("render", place / "s.yaml", "-o", place / "apart" / "drift.png", "--frames", "2", "--cluster", scheduler)[0] == 0
    assert content(place / "apart") == near
