"""When paths switch from explicit grains to the medium: once those of a few neighbouring pixels have come apart.

Meng et al. 2015, section 5, whose bundle is 16 paths of one pixel; here it is one path from each of 4 x 4 pixels, in each
sample of a pass.
"""

import copy

import numpy as np

EDGE = 4  # pixels of a bundle's square


def due(spread, pixel, grain, radius, size):
    """Whether each of n paths is to switch at its next grain (n,) bool.

    spread : in radii of the largest sphere, beyond which the paths of a bundle switch (tau of the paper)
    pixel : (n,), as `by_bundle` counts them;  radius : (n,) m
    grain : (n, 3) m, where they met their last grains, all the same number
    size : height and width of the picture

    Source: eq. 5; the standard deviation is the root of the covariance's trace, over the paths that are left.
    """
    which, number = np.unique(_bundle(pixel, *size), return_inverse=True)
    remaining = np.bincount(number, minlength=len(which))
    about = np.stack([np.bincount(number, grain[:, k], len(which)) / remaining for k in range(3)], axis=1)
    square = np.bincount(number, ((grain - about[number]) ** 2).sum(axis=1), len(which)) / remaining
    return (np.sqrt(square)[number] > spread * radius * (remaining / EDGE**2)[number]) | (remaining == 1)[number]


def as_close(world):
    """A pilot's world whose pixels are bundles of the picture's, as close as there; any other world as it is."""
    if world.whole is None:
        return world
    rows, columns = (_spread(small, whole) for small, whole in zip(world.size, world.whole.size))
    bundled = copy.copy(world)
    bundled.camera = world.whole.camera
    bundled.corners = np.stack(np.broadcast_arrays(columns[None, :], rows[:, None]), axis=-1).reshape(-1, 2)
    return bundled


def _spread(small, whole):
    bundle, within = np.divmod(np.arange(small), EDGE)
    return EDGE * ((2 * bundle + 1) * max(whole // EDGE, 1) // (2 * -(-small // EDGE))) + within


def _bundle(pixel, height, width):
    sample, pixel = np.divmod(pixel, height * width)
    down, across = -(-height // EDGE), -(-width // EDGE)
    return (sample * down + pixel // width // EDGE) * across + pixel % width // EDGE


def by_bundle(height, width, samples=1):
    """All pixels of several samples, (samples H W,), those of a bundle one after the other; sample k begins at k H W."""
    pixel = np.arange(samples * height * width)
    return pixel[np.argsort(_bundle(pixel, height, width), kind="stable")]
