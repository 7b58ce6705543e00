"""Which sigma_t stands for packed grains, and how far light spreads otherwise among the grains themselves."""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.granular.effective import Effective
from bakery.physics.granular.packed import Walks


class Matched(NamedTuple):
    """What was chosen."""

    # sigma_t, error: (L,) in the inverse unit of length, and its standard error
    sigma_t: np.ndarray
    error: np.ndarray
    bias: np.ndarray  # (L,) of sigma_t by `farther`, its size
    # name in `kinds.CHOICES` -> sigma_t and its standard error, (L,); random_walk only where `walked`
    each: dict[str, tuple[np.ndarray, np.ndarray]]
    walked: bool  # whether the random walk gives a mean square displacement
    # relative, how much farther light spreads in the walk than sigma_t says; 0 where that is matched, or not known
    farther: float
    spread: float  # relative error of the walk's root mean square displacement; 0 where it gives none


def matched(coefficients: Effective, lossless: Effective, walks: Walks | None, radius: float, at: int,
            wanted: str | None) -> Matched:
    """Chooses sigma_t: as wanted, or the random walk's, or that of Eq. 4 where the walk gives none.

    coefficients, lossless : the medium, and the same if nothing were absorbed
    walks : `packed.walk`, lengths in units of; None where there was none
    radius : in the unit of the medium
    at : the channel of the walk's grains
    wanted : in `kinds.CHOICES`, or None

    Raises ValueError : the random walk is wanted and gives no mean square displacement
    """
    measured = {"mean_flight": (coefficients.sigma_t, coefficients.errors["sigma_t"]),
            "second_moment": (coefficients.sigma_t_second_moment, coefficients.errors["sigma_t_second_moment"])}
    if walks is None or walks.reason and not math.isfinite(walks.achieved_error):
        if wanted == "random_walk":
            raise ValueError(f"random_walk: {walks.reason}")
        sigma_t, error = measured[wanted or "mean_flight"]
        return Matched(sigma_t, error, np.zeros_like(sigma_t), measured, False, 0.0, 0.0)
    M, spread = walks.mean_square_displacement * radius**2, walks.achieved_error
    far = {"mean_flight": lossless.m_rte[at], "second_moment": lossless.m_tele[at]}
    ratio = math.sqrt(lossless.m_rte[at] / M)
    value, error = measured["mean_flight"]
    measured["random_walk"] = value * ratio, np.hypot(error * ratio, value * ratio * spread)
    name = wanted or "random_walk"
    farther = math.sqrt(M / far[name]) - 1 if name in far else 0.0
    sigma_t, error = measured[name]
    return Matched(sigma_t, error, abs(farther) * sigma_t, measured, True, farther, spread)
