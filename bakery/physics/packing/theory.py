"""What theory says of every packing of disjoint spheres: the mean chord between them."""

import numpy as np


def mean_chord(fraction, radii=(1.0,)):
    """Mean chord between disjoint spheres along isotropic uniform lines, 4 V_void/S: exact for every arrangement.

    fraction : 1, of the volume in spheres
    radii : (N,) any length
    """
    radii = np.asarray(radii, float)
    f = np.asarray(fraction, float)
    return 4 / 3 * np.sum(radii**3) / np.sum(radii**2) * (1 - f) / f
