"""Radii that stand for a law of sizes in packed grains."""

import numpy as np

from bakery.physics.packing import radii

_CLASSES = 8  # radii that stand for a continuous law
_QUANTILES = 4096


def classes(law) -> tuple[np.ndarray, np.ndarray]:
    """Radii over their mean (S,) and shares by number (S,) that stand for a law of radii.

    A list is taken as it is.  A log-normal law is cut into classes of equal cross section, each with its mean radius by cross
    section and so many grains that it keeps that cross section: light meets classes as it meets the law, and finds its volume.
    """
    if law.distribution == "equal":
        return np.ones(1), np.ones(1)
    if law.distribution == "list":
        share, radius = (np.array(column, float) for column in zip(*law.of, strict=True))
        return radius / (share @ radius), share / share.sum()
    r = radii.lognormal(law.sigma, _QUANTILES)
    area = np.cumsum(r**2)
    which = np.minimum((_CLASSES * (area - 0.5 * r**2) / area[-1]).astype(int), _CLASSES - 1)
    parts = [r[which == k] for k in range(_CLASSES)]
    radius = np.array([np.sum(p**3) / np.sum(p**2) for p in parts])
    share = np.array([np.sum(p**2) for p in parts]) / radius**2
    return radius, share / share.sum()
