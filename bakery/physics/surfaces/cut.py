"""The medium without its forward peak: what a given number of Legendre moments can carry (delta-M, Wiscombe 1977)."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Cut:
    """A phase function whose peak counts as light that goes straight on."""

    moments: np.ndarray  # (M,) Legendre moments of what is left, the first is 1
    share: float  # of the scattered light that was in the peak
    albedo: float  # single-scattering albedo without it
    shrinks: float  # optical depths without the peak over those with it


def cut(moments, albedo: float, count: int) -> Cut:
    """Keep `count` moments.

    moments : at least count + 1 Legendre moments of the phase function
    albedo : single-scattering albedo

    The first moment that is not carried becomes that of the peak.  A negative one is no forward peak, and nothing is cut.
    """
    moments = np.asarray(moments, float)
    share = max(float(moments[count]), 0.0)
    return replace(without_peak(albedo, share), moments=(moments[:count] - share) / (1 - share))


def without_peak(albedo: float, share: float) -> Cut:
    """The medium without a given share of its scattered light; moments are not known."""
    # lossless media stay lossless to the last digit
    remaining = 1.0 if albedo == 1 else albedo * (1 - share) / (1 - albedo * share)
    return Cut(np.empty(0), share, remaining, 1 - albedo * share)
