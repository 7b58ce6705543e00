"""Bodies that need no tables of multiple scattering: thin ones, in which light hardly scatters three times, and wide ones."""

from __future__ import annotations

import numpy as np

# Third and later events that carry less of the light than that are followed one by one: nothing is left out, and they are so few
# that paths have hardly more noise than tables
FEW = 0.01
WALKS = 8192  # of light, in a pass
# beams a square transport mean free path of the boundary, below which the shells' jumps take less time to equal error: of 0.05
# (bust, marble) a fifth of the time, of 0.23 (head, skin) five times as much
DENSE = 0.1
_OUTSIDE = 0.1  # of diffuse light, what a boundary reflects from outside: 0.09 at index 1.5, 0.07 at 1.33


def chord(vertices, faces) -> float:
    """Mean chord of a closed mesh, in the unit of its vertices (V, 3): 4 V/S of isotropic lines (Cauchy)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = abs(float(np.sum(a * np.cross(b, c)))) / 6
    return 4 * volume / _area(vertices, faces)


def sparse(vertices, faces, reduced) -> bool:
    """Whether beams of a pass are further apart, on the boundary of a body, than light in it forgets its direction.

    vertices, faces : (V, 3) m, (F, 3), of a closed mesh;  reduced : (L,) 1/m, over transport mean free paths
    """
    return bool(density(vertices, faces, reduced) < DENSE)


def density(vertices, faces, reduced) -> float:
    """Beams of a pass to a square transport mean free path of the boundary, of the wavelength that has fewest; as `sparse`."""
    squares = _area(vertices, faces) * np.max(reduced) ** 2
    return WALKS / squares if squares > 0 else np.inf


def _area(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.sum(np.linalg.norm(np.cross(b - a, c - a), axis=1))) / 2


def again(depth, albedo, index):
    """Share of scattered light that is scattered three times and more, (albedo p')^2.

    depth : optical depth of the mean chord;  albedo : of the medium;  index : inside over outside, or the reverse; all broadcast

    Notes
    -----
    Wigner's rational approximation of the escape from a lump (Case, de Hoffmann & Placzek 1953): light that comes in, or that was
    scattered, collides again with probability p = tau/(1 + tau).  What meets the boundary from inside is turned back with
    probability R = 1 - (1 - R_outside)/n^2, so p' = p/(1 - (1 - p) R).  Of a ball with isotropic scattering `later` is 1 to 1.4
    times what photons say from a depth of 1 on, 2.6 times at 0.2 (tests/unit/test_requirements.py).
    """
    p = depth / (1 + depth)
    back = np.where(index == 1, 0.0, 1 - (1 - _OUTSIDE) / np.maximum(index, 1 / index) ** 2)
    return (albedo * p / (1 - (1 - p) * back)) ** 2


def later(depth, albedo, index):
    """Share of the light that meets a body which is scattered three times and more, p (albedo p')^2; as `again`."""
    return depth / (1 + depth) * again(depth, albedo, index)
