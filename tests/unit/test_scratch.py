"""Temporary folders of one's own: gone at the end, and after a kill with the next run."""

import subprocess
import sys
from pathlib import Path

import pytest

import bakery
from bakery.store import scratch
from tests.conftest import ROOT


@pytest.mark.parametrize("purpose", ["family", "draft"])
def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path, milk, monkeypatch, purpose):
    """Its folder in the temporary folder goes, that of a process that lives stays, and so does what is no folder of ours."""
    place = tmp_path / "tmp"
    place.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(place))
    old = place / f"bakery-{purpose}-0a_9zzzz"  # of an earlier version, which had no locks
    for folder in (old, place / f"bakery-{purpose}-notes", place / "elsewhere"):
        folder.mkdir()
        (folder / "middle.h5").touch()
    (place / f"bakery-{purpose}-linked00").symlink_to(place / "elsewhere")
    holder = (f"import sys, time, tempfile; from bakery.store import scratch\ntempfile.tempdir = {str(place)!r}\n"
              f"with scratch.folder({purpose!r}) as folder:\n    print(folder, flush=True)\n    time.sleep(60)")
    started = [subprocess.Popen([sys.executable, "-c", holder], stdout=subprocess.PIPE, text=True, cwd=ROOT) for _ in range(2)]
    try:
        killed, living = (Path(process.stdout.readline().strip()) for process in started)
        assert not old.exists(), "the first of them removed it"
        started[0].kill()
        started[0].wait()
        assert killed.is_dir()
        bakery.bake(milk, tmp_path / "a.h5")
        assert not killed.exists() and living.is_dir()
        assert {path.name for path in place.iterdir()} == {
            living.name, "elsewhere", f"bakery-{purpose}-notes", f"bakery-{purpose}-linked00"}
        assert (place / "elsewhere" / "middle.h5").is_file()
    finally:
        for process in started:
            process.kill()
            process.wait()
            process.stdout.close()


def test_what_a_killed_worker_of_a_cluster_left_is_removed_by_the_next(tmp_path, monkeypatch):
    """The folder with the files of a scene, and that of a frame which it was rendering."""
    holder = (f"import sys, time, tempfile; tempfile.tempdir = {str(tmp_path)!r}\n"
              "from renderers.cluster import files; from bakery.store import scratch\n"
              "print(files.unpacked({'/s.yaml': b'bakery_scene: 2'}), flush=True)\n"
              "with scratch.folder('frame'):\n    print(flush=True)\n    time.sleep(60)")
    with subprocess.Popen([sys.executable, "-c", holder], stdout=subprocess.PIPE, text=True, cwd=ROOT) as worker:
        folder = Path(worker.stdout.readline().strip())
        worker.stdout.readline()
        worker.kill()
    assert (folder / "s.yaml").is_file() and len(list(tmp_path.iterdir())) == 2
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with scratch.folder("frame") as other:
        assert list(tmp_path.iterdir()) == [other]


def test_no_scratch_folder_stays_where_all_goes_well(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with scratch.folder("draft") as folder, scratch.folder("family") as other:
        (folder / "draft.h5").touch()
        scratch.sweep()
        assert folder.is_dir() and other.is_dir(), "they are held"
    assert not list(tmp_path.iterdir())
