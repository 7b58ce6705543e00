"""What was asked of a picture, and whether it got there."""

from types import SimpleNamespace

import pytest

from bakery.errors import UsageError
from renderers.pictures import reached
from renderers.pictures.passes import pace_of


def values(tolerance=None, noise=None):
    return SimpleNamespace(tolerance=tolerance, stop=SimpleNamespace(noise=noise))


def test_passes_that_end_before_the_noise():
    assert reached.unreached("time", 0.05, 0.74) == ("time ended the passes: a noise of 5 % was wanted, it is 74 %",)
    assert "of 99 of 100 pixels of 5 %" in reached.unreached("samples", 0.05, 0.06, pixels=True)[0]
    assert reached.unreached("samples", 0.05, None)[0].endswith("was wanted, after so few it is not known")
    for stopped_by, wanted, noise in (("noise", 0.05, 0.05), ("samples", None, 0.5), ("samples", 0.05, 0.05), ("", 0.05, None)):
        assert reached.unreached(stopped_by, wanted, noise) == ()


def test_a_miss_is_of_what_was_asked_for():
    """Of a scene that says no noise and no tolerance, and of a draft, it is a remark."""
    said = ("time ended the passes",)
    for scene in (values(tolerance=0.1), values(noise=0.1)):
        assert reached.verdict(scene, "final", said, None) == reached.verdict(scene, None, said, None) == (said, ())
        assert reached.verdict(scene, "preview", said, None) == (said, ())
        assert reached.verdict(scene, "draft", said, None) == ((), said)
        assert reached.verdict(scene, None, (), None) == ((), ())
    assert reached.verdict(values(), None, said, None) == ((), said)


def test_an_error_of_the_method_above_the_tolerance_is_a_miss():
    missed, _ = reached.verdict(values(tolerance=0.1), None, (), 0.23)
    assert missed == ("the method's own error, 23 %, is above the tolerance of 10 %",)
    assert reached.verdict(values(tolerance=0.1), None, (), 0.1) == ((), ())
    assert reached.verdict(values(noise=0.1), None, (), 0.23) == ((), ())  # no tolerance was asked for


def test_limits_of_time():
    """By the square of the noise; a draft has one where the scene has none."""
    assert [reached.limit(60.0, quality) for quality in (None, "final", "preview", "draft")] == [60.0, 60.0, 15.0, 3.75]
    assert [reached.limit(None, quality) for quality in (None, "final", "preview", "draft")] == [None, None, None, 60.0]
    with pytest.raises(UsageError, match="expected draft, preview, final"):
        reached.limit(60.0, "best")


@pytest.mark.parametrize("whole, quality, seconds", [(False, None, 4.0), (False, "draft", 0.25), (True, None, None),
                                                     (True, "draft", None)])
def test_passes_of_figures_are_those_of_a_long_render(whole, quality, seconds):
    """`bake trade` tells what a picture takes from a render of a second; small passes would tell another time."""
    values = SimpleNamespace(stop=SimpleNamespace(time=4.0))
    assert pace_of(SimpleNamespace(whole=whole, values=values), quality) == seconds
