"""Rays through the box that holds particles."""

import numpy as np


def inside(region, origin, direction, far):
    """Where rays enter and leave the region's box before `far`, (n,) m; begin >= end where they miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (region.lo - origin) / direction, (region.hi - origin) / direction
    a, b = np.nan_to_num(a, nan=-np.inf), np.nan_to_num(b, nan=np.inf)
    return np.maximum(np.minimum(a, b).max(axis=1), 0.0), np.minimum(np.maximum(a, b).min(axis=1), far)


def column(region, origin, direction, far):
    """Lengths (n,) m of rays up to `far` within the region's box."""
    begin, end = inside(region, origin, direction, far)
    return np.maximum(end - begin, 0.0)


def absorb(medium, paths, distance):
    """Takes from the throughput of paths what the host of the particles absorbs of each up to its distance (n,) m."""
    if medium.host.any():
        length = column(medium.discs.region, paths.origin, paths.direction, distance)
        paths.throughput[:] *= np.exp(-medium.host * length[:, None])
