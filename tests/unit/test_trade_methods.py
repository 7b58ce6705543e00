"""Error against time of methods, each from one render: who is closest when, the knee, and what is said of a tolerance."""

import pytest

from bakery.trade.methods import Curve, advised, compared, contenders, times

EXACT = Curve("exact", seconds=100.0, first=1.0, noise=0.05, error=0.0, most=0.0)
QUICK = Curve("quick", seconds=10.0, first=0.1, noise=0.02, error=0.03, most=0.032)


def test_noise_falls_and_the_rest_stays():
    assert EXACT.after(100.0) == pytest.approx(0.05) and EXACT.after(400.0) == pytest.approx(0.025)
    assert QUICK.after(10.0) == pytest.approx(0.0013**0.5) and QUICK.after(1e9) == pytest.approx(0.03, rel=1e-4)
    assert EXACT.until(0.01) == pytest.approx(2500) and QUICK.until(0.05) == pytest.approx(0.004 / 0.0016)
    assert QUICK.until(0.03) == QUICK.until(0.01) == float("inf")


def test_who_is_closest_changes_where_the_curves_cross():
    """0.25/t = 0.0009 + 0.004/t at t = 273 s, to a step of the grid; the knee is where the quick one's noise is gone."""
    found = compared([EXACT, QUICK], 0.05)
    (first, second), step = found["ranges"], times([EXACT, QUICK])[1] / times([EXACT, QUICK])[0]
    assert (first["name"], second["name"]) == ("quick", "exact") and second["end"] is None
    assert first["begin"] == pytest.approx(0.1)
    assert 273 <= second["begin"] <= 273 * step**2 and first["end"] == second["begin"]
    assert found["knee"]["name"] == "quick" and 1 < found["knee"]["seconds"] < 30
    assert found["until"] == {"exact": pytest.approx(100), "quick": pytest.approx(2.5)}
    assert found["advice"] == ["Closest to the reference, by time of all cores together: quick up to 5 min, exact from there on.",
                               found["advice"][1],
                               "For 5 %: quick, after 2.5 s; 40 times as fast as exact; its own error is 3 %."]
    assert found["advice"][1].startswith("Knee: quick after ")


@pytest.mark.parametrize(("curves", "tolerance", "said"), [
    ([EXACT, QUICK], 0.02, ["For 2 %: exact, after 10 min.", "quick stays 3 % off, however long."]),
    ([QUICK], 0.02, ["For 2 %: none of them, however long.", "quick stays 3 % off, however long."]),
    ([EXACT, QUICK._replace(error=0.0, most=0.06)], 0.05,
     ["For 5 %: exact, after 2 min; noise hides whether quick would be quicker.",
      "Noise hides whether quick reaches 5 %: its error is below 6 %."]),
    ([QUICK._replace(error=0.0, most=0.06)], 0.05, ["Noise hides whether quick reaches 5 %: its error is below 6 %."]),
])
def test_what_is_said_of_a_tolerance(curves, tolerance, said):
    found = compared(curves, tolerance)
    sentences = found["advice"][1:] + found["others"]
    assert [sentence for sentence in sentences if not sentence.startswith("Knee")] == said


def test_a_step_is_no_knee():
    """Where a better method has its first picture."""
    assert compared([EXACT._replace(first=100.0), EXACT._replace(name="worse", seconds=300.0)], 0.01)["knee"] is None


def test_noise_alone_has_no_knee():
    found = compared([EXACT, EXACT._replace(name="slower", seconds=200.0)], 0.01)
    assert found["knee"] is None and [one["name"] for one in found["ranges"]] == ["exact"]
    assert found["advice"][0] == "exact is closest to the reference at all times."


def test_preparations_count_once():
    """12 s, of which 10 before the first pass: 0.05^2 x 2 s of passes for the square of the tolerance."""
    curve = Curve("a", seconds=12.0, first=10.5, noise=0.05, error=0.0, most=0.0, setup=10.0, spread=0.2)
    assert curve.until(0.025) == pytest.approx(10 + 8) and curve.after(18.0) == pytest.approx(0.025)
    assert curve.point(0.025).spread == pytest.approx((0.1**2 + (0.2 * 8 / 18) ** 2) ** 0.5)


def test_what_noise_hides():
    """Counts as half of the tolerance of a method that keeps it by itself, else as its upper bound."""
    hidden = Curve("hidden", seconds=10.0, first=1.0, noise=0.02, error=0.0, most=0.2)
    assert hidden.until(0.05) == float("inf")
    kept = hidden._replace(kept=0.5)
    assert kept.until(0.05) == pytest.approx(0.004 / (0.05**2 - 0.025**2)) and kept._replace(most=0.01).beneath(0.05) == 0.01
    assert kept._replace(error=0.04, most=0.041).beneath(0.05) == pytest.approx((2 * 0.04**2 - 0.041**2) ** 0.5)
    assert hidden._replace(kept=0.0).until(0.05) == pytest.approx(0.004 / 0.05**2)
    assert compared([EXACT, hidden._replace(error=0.1, most=0.14)], 0.05)["never"] == []
    unsure = compared([EXACT, hidden], 0.05)
    assert unsure["advised"]["name"] == "exact" and unsure["advised"]["open"] == ["hidden"]
    assert unsure["advice"][-1] == "For 5 %: exact, after 2 min; noise hides whether hidden would be quicker."
    found = advised([EXACT, kept], 0.05)
    assert found["name"] == "hidden" and found["hidden"] and found["beneath"] == 0.025
    assert contenders([EXACT, hidden], 0.05) == ["exact", "hidden"] and contenders([EXACT, QUICK], 0.05) == []


def test_near_times_are_not_distinguished():
    """Three standard errors of both logarithms: 3 x 0.2 is a factor of 1.8."""
    one = EXACT._replace(spread=0.1)
    found = advised([one, one._replace(name="near", seconds=130.0), one._replace(name="far", seconds=250.0)], 0.05)
    assert found["alike"] == ["near"] and found["next"] == {"name": "far", "ratio": pytest.approx(2.5)}
    assert "not distinguished from near" in compared([one, one._replace(name="near", seconds=130.0)], 0.05)["advice"][-1]
