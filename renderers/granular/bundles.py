"""When paths switch from explicit grains to the medium: once those of a few neighbouring pixels have come apart.

Meng et al. 2015, section 5, whose bundle is 16 paths of one pixel; here it is one path from each of 4 x 4 pixels, so that a pass
takes one path a pixel.  The share of paths that go on after the switch is the one that makes the picture's variance least in its
time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

EDGE = 4  # pixels of a bundle's square


class Switch(NamedTuple):
    """spread : in radii of the largest sphere, beyond which the paths of a bundle switch (tau of the paper)"""

    spread: float = 4.0

    def due(self, pixel, place, radius, width):
        """Whether each of n paths is to switch at its next grain (n,) bool.

        pixel : (n,);  place : (n, 3) m, where they met their last grains, all the same number;  radius : (n,) m
        width : of the picture

        Source: eq. 5; the standard deviation is the root of the covariance's trace, over the paths that are left.
        """
        which, number = np.unique(_bundle(pixel, width), return_inverse=True)
        left = np.bincount(number, minlength=len(which))
        about = np.stack([np.bincount(number, place[:, k], len(which)) / left for k in range(3)], axis=1)
        square = np.bincount(number, ((place - about[number]) ** 2).sum(axis=1), len(which)) / left
        spread = np.sqrt(square)[number] > self.spread * radius * (left / EDGE**2)[number]
        return spread | (left == 1)[number]


def _bundle(pixel, width):
    across = -(-width // EDGE)
    return (pixel // width // EDGE) * across + pixel % width // EDGE


def by_bundle(height, width):
    """All pixels (H W,), those of a bundle one after the other."""
    pixel = np.arange(height * width)
    return pixel[np.argsort(_bundle(pixel, width), kind="stable")]


def accepted(low, high, work):
    """Share of paths that go on after the switch (0 to 1] with which the picture's variance times its time is least.

    Parameters
    ----------
    low, high : (passes, pixels) light of each path before and after the switch
    work : (2,) time of both

    Notes
    -----
    Paths that go on with chance P bring 1/P as much.  The variance of low + high/P is V_L + 2 C - m^2 + S/P, with the covariance
    C of low and high, the mean m of high and S of its square, and the time t_L + P t_H.  (The paper's eq. 8 leaves out C and m.)
    """
    mean = high.mean(axis=0)
    apart = ((low - low.mean(axis=0)) * (high - mean)).sum(axis=0) / (len(low) - 1)
    rest = float(np.mean(low.var(axis=0, ddof=1) + 2 * apart - mean**2))
    square = float(np.mean(high**2))
    if not (rest > 0 and square > 0 and work[1] > 0):
        return 1.0
    return float(min(np.sqrt(square * work[0] / (rest * work[1])), 1.0))
