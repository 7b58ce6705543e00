"""How densely spheres of given sizes pack at random."""

import heapq

import numpy as np

EQUAL = 0.64  # of equal spheres: more is on the way to the crystal
RODS = 4000
GAP = 0.7654  # smallest gap over the shorter of its two rods (Farr & Groot, fitted there to one simulation of equal spheres)


def limit(radii) -> float:
    """Greatest fraction to which spheres of these sizes are packed; 0.64 where all are equal.

    radii : (N,), any unit

    Returns fraction : 0.64 plus what Farr & Groot's rods say that the spread of sizes adds

    The spheres that a line meets, with the chords as rods, are packed again on the line: longest first, each into the widest gap.
    Measured against our own slow compressions in docs/packing.md.  Source: J. Chem. Phys. 131, 244104 (2009), section II.
    """
    radii = np.asarray(radii, float)
    if np.ptp(radii) <= 1e-9 * radii.max():
        return EQUAL
    return EQUAL + _on_a_line(radii) - _on_a_line(np.ones(1))


def _on_a_line(radii) -> float:
    """Share of the line in rods."""
    radii = np.sort(radii)
    shadows = np.cumsum(radii**2)  # a line meets a sphere as often as its shadow is large
    sphere = np.searchsorted(shadows, (np.arange(RODS) + 0.5) / RODS * shadows[-1])
    # uniform over the shadow, in an order foreign to the radii
    chord = np.sqrt((np.arange(RODS) * 0.6180339887498949 + 0.5) % 1.0)
    rods = np.sort(radii[np.minimum(sphere, radii.size - 1)] * chord)[::-1]
    gaps = [-GAP * rods[0]]
    for rod in rods[1:]:
        widest = -heapq.heappop(gaps)
        heapq.heappush(gaps, -GAP * rod)
        heapq.heappush(gaps, -max(GAP * rod, widest - (1.0 + GAP) * rod))
    return float(rods.sum() / (rods.sum() - sum(gaps)))
