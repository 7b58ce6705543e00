"""What earlier runs left behind, changed by others: records, metadata, names.  Each is told or left out, none is a traceback."""

import json
import math
import os
from types import SimpleNamespace

import numpy as np
import pytest

import bakery
from bakery.cli.options import file_of
from bakery.errors import UsageError
from bakery.run import cache
from bakery.trade import check_budget
from bakery.trade.runs import Run, Store
from renderers.pictures import comparison, progressive
from renderers.pictures.progressive import Estimate, Part, error_of_mean

NESTED = "[" * 200_000
SIZE = 4, 6


def passes(**changed):
    """An estimate, and what an EXR holds of it: channels, and its state with some entries of its part changed."""
    estimate = Estimate([Part("walk", lambda index: {"": np.full((*SIZE, 3), 1.0 + index)})], {"size": list(SIZE)})
    estimate.run(progressive.Stop(samples=3))
    written = {}
    job = SimpleNamespace(finish=lambda rgb, layers, text, **_: written.update(layers=layers, text=text) or {})
    estimate.finish(job, method="walk")
    channels = dict(zip("RGB", np.moveaxis(estimate.rgb, -1, 0))) | written["layers"]
    (key, state), = ((key, json.loads(value)) for key, value in written["text"].items())
    state["parts"]["walk"] |= changed
    return estimate, channels, {key: json.dumps(state)}


def resumed(monkeypatch, tmp_path, channels, text):
    monkeypatch.setattr(progressive.bitmaps, "read", lambda path: (channels, text))
    (tmp_path / "a.exr").touch()
    estimate = Estimate([Part("walk", None)], {"size": list(SIZE)})
    estimate.resume(tmp_path / "a.exr")
    return estimate


def test_passes_as_they_were_left(monkeypatch, tmp_path):
    whole, channels, text = passes()
    assert np.allclose(resumed(monkeypatch, tmp_path, channels, text).variance, whole.variance)
    assert error_of_mean(text).shape == (4,)


@pytest.mark.parametrize("changed", [
    {"passes": -1}, {"passes": 0}, {"passes": 1e300}, {"passes": math.inf}, {"lost": -1}, {"spread": [-1.0] * 4},
    {"spread": [math.nan] * 4}, {"spread": [1.0]}, {"spread": "much"}, {"layers": []}, {"layers": 3},
], ids=str)
def test_passes_that_nobody_renders(monkeypatch, tmp_path, changed):
    _, channels, text = passes(**changed)
    with pytest.raises(UsageError, match="holds no passes to go on with"):
        resumed(monkeypatch, tmp_path, channels, text)
    error = error_of_mean(text)
    assert error is None or (np.isfinite(error).all() and "spread" not in changed)


def test_metadata_and_layers_of_another_kind(monkeypatch, tmp_path):
    _, channels, text = passes()
    (key, state), = text.items()
    smaller = {name: image[1:] for name, image in channels.items()}
    dark = channels | {"noise.R": np.full(SIZE, np.nan)}
    for layers, metadata in ((channels, NESTED), (channels, "3"), (channels, 3.0), (channels, '{"parts": [], "identity": []}'),
                             (smaller, state), (dark, state)):
        with pytest.raises(UsageError, match="holds no passes to go on with"):
            resumed(monkeypatch, tmp_path, layers, {key: metadata})
        assert error_of_mean({key: metadata}) is None or metadata == state


@pytest.mark.parametrize("text", [NESTED, "3", "[]", "{}", '{"run": 3}'])
def test_records_of_another_kind(tmp_path, text):
    """Of `bake trade`, of `bake compare`, and of the times of stages."""
    record, pair = tmp_path / "record.json", (tmp_path / "a.png", tmp_path / "a.exr")
    for path in (record, tmp_path / cache.SPEED):
        path.write_text(text)
    for path in pair:
        path.touch()
    assert Store(tmp_path).load(record, "optics", "0") is None
    assert comparison._kept(SimpleNamespace(record=record, pair=pair)) == {}
    assert cache.Cache(tmp_path).speed("optics", "0", 1.0) == (1.0, 0)


def test_figures_that_no_run_shows(tmp_path):
    sound = {"stage": "optics", "input_hash": "0", "setting": {}, "seconds": [1.0], "wall": [1.0], "baseline": [1.0],
             "memory": 1e6, "errors": {"all": 0.1}, "achieved": 0.1}
    for changed, kept in (({}, True), ({"errors": {"all": 1e308}}, False), ({"errors": {"all": math.nan}}, False),
                          ({"wall": [-1.0]}, False), ({"memory": math.inf}, False), ({"achieved": 1e308}, False)):
        (tmp_path / "a.json").write_text(json.dumps({"run": sound | changed}))
        assert isinstance(Store(tmp_path).load(tmp_path / "a.json", "optics", "0"), Run) == kept, changed


@pytest.mark.parametrize("minutes", [0.0, -1.0, math.inf, math.nan, 1e300])
def test_budgets(minutes):
    with pytest.raises(UsageError, match="--budget: found .* expected a number of minutes above 0, at most 1,000,000"):
        check_budget(minutes)


def test_folders_that_cannot_be(call, milk, monkeypatch):
    for variable in ("BAKERY_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.setenv("BAKERY_CACHE", "")
        monkeypatch.setenv(variable, "/tmp/" + "c" * 300)
        for words in (("cache", "info"), ("cache", "clear"), (milk,)):
            status, out, err = call(*words)
            assert (status, out) == (2, "") and "which cannot be a folder (File name too long)" in err, err


def test_names_that_are_no_utf8(call, undrawn, milk, tmp_path):
    """A depfile, a page; the picture on it is by Mitsuba, which cannot open such a file by its name and gets another one."""
    name = os.fsdecode(b"m\xff")
    os.rename(milk, tmp_path / f"{name}.yaml")
    assert call(tmp_path / f"{name}.yaml", "-o", tmp_path / f"{name}.h5", "--depfile", tmp_path / "m.d", "--quiet")[0] == 0
    assert os.fsencode(tmp_path / f"{name}.yaml") in (tmp_path / "m.d").read_bytes()
    assert call("report", tmp_path / f"{name}.h5", "--no-render")[0] == 0 and (tmp_path / f"{name}.html").exists()
    (tmp_path / "scratch").mkdir()
    other = file_of(bakery.open(tmp_path / f"{name}.h5"), tmp_path / "scratch")
    assert other.isascii() and bakery.open(other).name == "milk"
    status, out, err = call("render", tmp_path / f"{name}.h5", "-o", tmp_path / "m.png")
    assert (status, out) == (2, "") and "a name that is no UTF-8" in err
