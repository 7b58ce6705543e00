"""`bake cache` and the folder that it tidies: entries are taken, whatever else lies there never is."""

import json
import re
import shutil

import pytest

import bakery
from bakery.run.cache import Cache
from bakery.store.read import read

HASH = "0123456789abcdef" * 4
ENTRY = re.compile(r"[a-z]+-[0-9a-f]{64}\.h5")


@pytest.fixture
def here(tmp_path, monkeypatch, milk):
    """A folder of someone's that is the cache at the same time: one entry, and files that only look like some."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BAKERY_CACHE", str(tmp_path))
    bakery.bake(milk, "milk.h5")
    (entry,) = tmp_path.glob("medium-*.h5")
    shutil.copy("milk.h5", f"milk-{HASH}.h5")  # a sound asset
    shutil.copy("milk.h5", f"medium-{HASH}.h5")
    shutil.copy(entry, "copy.h5")  # an entry under a name of the user's
    shutil.copy(entry, f"medium-{HASH[::-1]}.h5")  # of another hash
    (tmp_path / f"optics-{HASH}.h5").write_bytes(b"\x89HDF\r\n\x1a\n measurements of somebody")
    (tmp_path / "notes.bad").write_text("what went wrong")
    (tmp_path / "theirs.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    (tmp_path / "scenes").mkdir(exist_ok=True)
    (tmp_path / "scenes" / "street.yaml").write_text("theirs")
    return tmp_path


def everything(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def entry_of(folder):
    (entry,) = (path for path, _, _ in Cache(folder).entries())
    return entry


def test_info_counts_entries_alone(call, here):
    found = json.loads(call("cache", "info", "--json")[1])
    assert (found["entries"], set(found["stages"]), found["others"]) == (1, {"medium"}, 10)
    assert "besides  10 files or folders that do not belong to the cache" in call("cache", "info")[1]


def test_clear_asks_where_the_folder_is_not_the_caches_alone(call, here, monkeypatch):
    """Without a terminal status 2 and nothing removed; yes removes the entry and nothing else."""
    before, entry = everything(here), entry_of(here)
    for answer in (None, False):
        if answer is not None:
            monkeypatch.setattr("sys.stdin.isatty", lambda: True)
            monkeypatch.setattr("click.confirm", lambda *_, **__: answer)
        status, out, err = call("cache", "clear")
        assert status == 2 and not out and everything(here) == before, err
        assert answer is not None or "holds besides 1 entry also" in err and "and 6 more" in err and "--yes" in err
    monkeypatch.setattr("click.confirm", lambda *_, **__: True)
    assert call("cache", "clear")[:2] == (0, "1 entry removed\n")
    before.pop(entry)
    assert everything(here) == before
    assert call("cache", "clear", "--json")[0] == 0 and everything(here) == before, "nothing to ask about"


def test_clear_with_yes_and_prune_take_entries_alone(call, here):
    before, entry = everything(here), entry_of(here)
    aside = here / f"medium-{HASH}.bad"
    aside.write_bytes(entry.read_bytes()[:600])
    assert json.loads(call("cache", "prune", "--json")[1])["removed"] == [aside.name] and everything(here) == before
    assert json.loads(call("cache", "prune", "--max-size", "0B", "--json")[1])["removed"] == [entry.name]
    for words in (("--max-size", "many"), ("--max-age", "nan")):
        status, out, err = call("cache", "prune", *words)
        assert status == 2 and not out and words[0] in err
    before.pop(entry)
    assert everything(here) == before
    bakery.bake("milk.yaml", "again.h5", force=True)
    assert json.loads(call("cache", "clear", "--yes", "--json")[1])["removed"] == [entry.name]
    assert everything(here).keys() == before.keys() | {here / "again.h5"}


def test_a_cache_of_its_own_is_cleared_without_a_question(call, milk, drops, tmp_path, monkeypatch):
    """Locks, speeds, damaged entries and part files are the cache's."""
    cache = tmp_path / "cache"
    monkeypatch.setenv("BAKERY_CACHE", str(cache))
    for recipe in (milk, drops):
        bakery.bake(recipe, recipe.with_suffix(".h5"))
    first = next(cache.glob("optics-*.h5"))
    first.write_bytes(first.read_bytes()[:5000])
    (cache / f".{first.name[:40]}.0123456789abcdef.part").write_bytes(b"of a writer")
    assert all(ENTRY.fullmatch(path.name) for path in cache.glob("*.h5"))
    assert json.loads(call("cache", "info", "--json")[1])["others"] == 0
    assert call("cache", "clear")[:2] == (0, "3 entries removed\n") and not list(cache.glob("*.h5"))


@pytest.mark.usefixtures("verified_here")
def test_an_asset_under_the_name_of_an_entry_is_a_miss(call, tmp_path, milk, monkeypatch):
    """Its values are right, its provenance is that of an asset: computed again, each time, and never replaced."""
    cache = tmp_path / "cache"
    monkeypatch.setenv("BAKERY_CACHE", str(cache))
    assert call(milk, "-o", tmp_path / "a.h5")[0] == 0
    (entry,) = cache.glob("medium-*.h5")
    shutil.copy(tmp_path / "a.h5", entry)
    for name in ("b.h5", "c.h5"):
        status, _, err = call(milk, "-o", tmp_path / name, "--json")
        assert status == 0 and "is an asset and no entry of the cache; left as it is" in err, err
        assert call("verify", tmp_path / name)[0] == 0
        assert read(tmp_path / name).attributes["content_hash"] == read(tmp_path / "a.h5").attributes["content_hash"]
    assert entry.read_bytes() == (tmp_path / "a.h5").read_bytes()
