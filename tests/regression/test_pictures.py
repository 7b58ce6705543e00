"""What `pictures.json` keeps of pictures, and how a new run is compared with it; three entries of it, rendered anew."""

import json

import numpy as np
import pytest

from tests.conftest import slow
from tests.odds import SIGMAS
from tests.regression import pictures
from tests.regression.picture_figures import EDGE, Figures, compare


def sampled(random, count, level=1.0, names=("mean", "order0")):
    """Figures of blocks whose values scatter by a tenth."""
    sums = Figures()
    for _ in range(count):
        sums.add({name: level * random.normal(1.0, 0.1, 3) for name in names})
    return sums


def through_file(sums):
    return Figures.of(json.loads(json.dumps(sums.kept())), sums.count)


def test_means_and_errors():
    """NumPy's, also of a layer that some blocks lack, and of sums that went through the file in between."""
    random = np.random.default_rng(1)
    rows = random.normal(5.0, 1.0, (40, 3))
    rows[:3], sums = 0.0, Figures()
    for i, row in enumerate(rows):
        sums.add({"mean": row + 1} | ({"light.lamp": row} if row.any() else {}))
        sums = through_file(sums) if i == 20 else sums
    for name, values in {"mean": rows + 1, "light.lamp": rows}.items():
        assert np.allclose(sums.value[name], values.mean(axis=0), rtol=1e-5)
        assert np.allclose(sums.error[name], values.std(axis=0, ddof=1) / 40**0.5, rtol=5e-3)


def test_same_pictures_agree():
    """Forty pairs of equal pictures: none is said to differ, at the odds of all 240 figures; p-values are even."""
    random, odds = np.random.default_rng(2), []
    for _ in range(40):
        odds += [one.odds for one in compare(through_file(sampled(random, 200)), sampled(random, 20))]
    assert min(odds) > 1e-7 * len(odds)
    assert abs(np.mean(odds) - 0.5) < SIGMAS / (12 * len(odds)) ** 0.5


@pytest.mark.parametrize("changed, expected", [("level", "mean"), ("missing", "order0")])
def test_changed_pictures_do_not(changed, expected):
    """A tenth more light is seen by forty blocks with a scatter of a tenth; a layer that is gone by as many."""
    random = np.random.default_rng(3)
    old = through_file(sampled(random, 200))
    new = sampled(random, 40, 1.1) if changed == "level" else sampled(random, 40, names=("mean",))
    worst = compare(old, new)[0]
    assert worst.odds < 1e-6 and (changed == "level" or worst.name.startswith(expected))


def test_light_that_is_found_seldom():
    """One block in fifty brings it: none of twenty blocks with it is no change, and neither is one."""
    def rare(*blocks):
        sums = Figures()
        for i in range(200 if len(blocks) > 1 else 20):
            sums.add({"mean": np.ones(3), "orders": np.full(3, float(i in blocks))})
        return sums

    old = through_file(rare(3, 60, 110, 190))
    assert all(compare(old, new)[0].odds > 0.01 for new in (rare(-1), rare(7)))


def test_figures_without_scatter():
    """Agree to rounding, or differ for certain."""
    def still(level):
        sums = Figures()
        for _ in range(20):
            sums.add({"mean": np.full(3, level)})
        return sums

    assert compare(through_file(still(1 / 3)), still(1 / 3))[0].odds == 1
    assert compare(through_file(still(1 / 3)), still(0.334))[0].odds == 0


def test_file():
    """Entries are kept of every scene that ships, each with what every picture has; written again it is the same text."""
    kept, known = pictures.read(), {entry.name: entry for entry in pictures.entries()}
    assert set(kept) <= set(known)
    assert {entry.path.stem for entry in known.values() if entry.path} == {name.split("/")[0] for name in kept} - {"small"}
    assert pictures.written(kept) == pictures.FILE.read_text()
    for name, one in kept.items():
        orders = {"order"} if known[name].renderer == "fog" else {"order0", "order1", "order2", "orders"}
        assert {"mean", "regions"} | orders <= set(one["figures"]), name
        assert len(one["figures"]["regions"]["value"]) == EDGE**2 and one["blocks"] >= pictures.LEAST


@pytest.mark.parametrize("name", [slow(name) for name in ("small/matched_ball/paths", "small/beads_stored/particles",
                                                          "small/grains_clear/ept")])
def test_pictures_stay(name):
    """The check of all is `make pictures-check`."""
    (entry,) = (one for one in pictures.entries() if one.name == name)
    kept = pictures.read()
    worst, *_ = pictures.differences(entry, kept[name], 1.5)[0]
    assert worst.odds > 1e-7 * pictures.number_of_figures({name: kept[name]}), worst
