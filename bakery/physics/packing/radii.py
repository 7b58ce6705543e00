"""Radii of a tile's spheres from a law, without random numbers: every tile of a law has the same ones."""

import numpy as np


def lognormal(sigma: float, count: int) -> np.ndarray:
    """Quantiles of a log-normal law, (count,) ascending, mean 1.

    sigma : geometric standard deviation by number, above 1
    count : spheres; radius i stands for the share (i + 1/2)/count

    The tails beyond half a sphere are left out: at sigma 1.3 and 500 spheres <r^3>/<r>^3 is 0.8 % below the law's.
    """
    from scipy.special import ndtri

    r = np.exp(np.log(sigma) * ndtri((np.arange(count) + 0.5) / count))
    return r / r.mean()


def species(shares, radii, count: int) -> np.ndarray:
    """Radii of species in given shares of the number of spheres, (count,) species by species, mean 1.

    shares : (S,) adding up to 1
    radii : (S,) any unit
    count : spheres; the numbers are rounded so that they add up, each share to less than one sphere

    Raises ValueError : a species would have no sphere
    """
    exact = np.asarray(shares, float) * count
    number = np.floor(exact + 1e-9).astype(int)
    remaining = count - number.sum()
    number[np.argsort(-(exact - number), kind="stable")[:remaining]] += 1
    if not number.all():
        missing = int(np.argmin(number))
        raise ValueError(f"a share of {shares[missing]:g} of {count} spheres is none")
    r = np.repeat(np.asarray(radii, float), number)
    return r / r.mean()


def room(fraction: float, radii, cell) -> float:
    """Shortest edge of the cell over the largest diameter; at 1 a sphere touches its own image.

    fraction : of the volume that the spheres fill
    radii : (N,), any unit
    cell : (3,) proportions of the edges
    """
    radii, cell = np.asarray(radii, float), np.asarray(cell, float)
    volume = 4 / 3 * np.pi * np.sum(radii**3) / fraction
    return float(cell.min() * (volume / np.prod(cell)) ** (1 / 3) / (2 * radii.max()))
