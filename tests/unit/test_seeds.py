"""Seeds as programs give them."""

import numpy as np
import pytest

import renderers
from bakery.errors import UsageError
from renderers import seeds
from renderers.pictures import passes
from tests.conftest import ROOT


@pytest.mark.parametrize("seed", [None, 0, 7, 2**64 - 1, np.int64(7), np.uint64(2**63)])
def test_whole_numbers_are_taken(seed):
    assert seeds.checked(seed) == (seed or 0)


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, "1", np.nan])
@pytest.mark.parametrize("renders", [passes.render, renderers.live])
def test_others_are_refused_before_anything_is_baked(renders, seed, monkeypatch):
    monkeypatch.setattr("renderers.pictures.running.Render.__init__", lambda *_, **__: pytest.fail("a scene was prepared"))
    with pytest.raises(UsageError, match="seed: found .*; expected a whole number from 0 to 2\\^64 - 1"):
        renders(ROOT / "assets/scenes/candle.yaml", seed=seed)
