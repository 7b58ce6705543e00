"""Random directions and solid noise, both fixed by a seed and free of NumPy's own distributions, which may change."""

import numpy as np

from bakery import rng as streams


def stream(seed, part):
    """A generator of its own for each seed and part of a shape; only `.random` is used here."""
    return streams.generator(seed, "shapes", part)


def directions(rng, count):
    """Unit vectors (count, 3), uniform on the sphere."""
    z, turn = 2 * rng.random(count) - 1, 2 * np.pi * rng.random(count)
    across = np.sqrt(np.maximum(1 - z * z, 0.0))
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def gradient_noise(points, rng):
    """Noise with continuous second derivatives on the lattice of whole numbers, root mean square 0.19, within -1 and 1.

    points : (N, 3)
    rng : gives the table of 256 directions and the permutation; the pattern repeats after 256

    Returns value : (N,)

    Source: Perlin, Improving noise, SIGGRAPH 2002; with directions that are uniform on the sphere.
    """
    slope = directions(rng, 256)
    shuffle = np.argsort(rng.random(256), kind="stable")
    cell = np.floor(points)
    inside = points - cell
    blend = inside**3 * (inside * (inside * 6 - 15) + 10)
    cell = cell.astype(np.int64)
    value = np.zeros(len(points))
    for corner in np.ndindex(2, 2, 2):
        at = (cell + corner) & 255
        index = shuffle[(shuffle[(shuffle[at[:, 0]] + at[:, 1]) & 255] + at[:, 2]) & 255]
        weight = np.where(corner, blend, 1 - blend).prod(axis=1)
        value += weight * (slope[index] * (inside - corner)).sum(axis=1)
    return value


def fractal_noise(points, rng, octaves=5, frequency=1.0):
    """Sum of octaves of `gradient_noise`, each of twice the frequency and half the height of the one before; (N,)."""
    value = np.zeros(len(points))
    for octave in range(octaves):
        value += 0.5**octave * gradient_noise(points * (frequency * 2**octave) + 17.3 * octave, rng)
    return value
