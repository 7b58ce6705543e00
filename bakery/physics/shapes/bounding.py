"""The smallest sphere around a set of points, and the frame in which every grain is stored: that sphere is the unit sphere.

Why not trimesh's: every grain's bytes would change, and its sphere is up to 2 % too large (`python benchmarks/meshes.py ball`).
"""

from itertools import combinations

import numpy as np

_EPS = float(np.finfo(float).eps)


def minimum_sphere(points):
    """Smallest sphere that holds all points.

    Parameters
    ----------
    points : (N, 3) any length, finite, N >= 1

    Returns
    -------
    centre : (3,) unit of the points
    radius : unit of the points; distance of the farthest point from `centre`

    Notes
    -----
    The sphere of at most four points grows by the farthest point outside until there is none: each step is the exact smallest
    sphere of at most five points, and the radius rises strictly, so it ends.  Radius within 1e-13 of the optimum, relative, in
    general position and where many points lie on the sphere.  Source: Gaertner, Fast and robust smallest enclosing balls,
    ESA 1999 (pivoting on the farthest point).

    Examples
    --------
    >>> centre, radius = minimum_sphere([[0, 0, 0], [2, 0, 0], [1, 0.5, 0]])
    >>> centre.tolist(), radius
    ([1.0, 0.0, 0.0], 1.0)
    """
    points = np.asarray(points, float)
    shift = points.min(axis=0) + 0.5 * np.ptp(points, axis=0)
    size = float(np.abs(points - shift).max())
    if size == 0:
        return shift, 0.0
    local = (points - shift) / size
    centre, square, support = np.zeros(3), -1.0, []
    while True:
        apart = ((local - centre) ** 2).sum(axis=1)
        farthest = int(np.argmax(apart))
        if apart[farthest] <= square * (1 + 8 * _EPS):
            break
        grown = _smallest(local[support], local[farthest])
        if grown[1] <= square:  # rounding: the points on the sphere cannot be distinguished any more
            break
        centre, square, chosen = grown
        support = [support[i] for i in chosen] + [farthest]
    return centre * size + shift, float(np.sqrt(((local - centre) ** 2).sum(axis=1).max())) * size


def onto_unit_sphere(vertices):
    """Points moved and scaled so that their smallest sphere is the unit sphere: every norm at most 1, the largest 1 to 4e-16.

    Returns
    -------
    scaled : (V, 3)
    centre : (3,), radius : what was taken off; vertices = centre + radius * scaled
    """
    vertices = np.asarray(vertices, float)
    centre, radius = minimum_sphere(vertices)
    scaled = (vertices - centre) / radius
    while (largest := (scaled**2).sum(axis=1).max()) > 1:
        scaled *= min(1 - _EPS, 1 / np.sqrt(largest))
    return scaled, centre, radius


def _smallest(inner, point):
    """Smallest sphere of up to four points and one outside their sphere, which therefore lies on it: centre, squared radius and
    the indices of `inner` that carry it.  Of all centres it is the one with the nearest farthest point: safe in rounding."""
    best = None
    for size in range(min(len(inner), 3) + 1):
        for chosen in combinations(range(len(inner)), size):
            offset = _circumcentre([inner[i] - point for i in chosen])
            if offset is None:
                continue
            square = max((offset**2).sum(), ((inner - point - offset) ** 2).sum(axis=1).max(initial=0.0))
            if best is None or square < best[1]:
                best = point + offset, float(square), chosen
    return best


def _circumcentre(edges):
    """Centre of the smallest sphere through the origin and up to three more points; None where they are dependent."""
    if not edges:
        return np.zeros(3)
    square = [(edge**2).sum() for edge in edges]
    if len(edges) == 1:
        return 0.5 * edges[0]
    normal = np.cross(edges[0], edges[1])
    if len(edges) == 2:
        over, under = np.cross(square[0] * edges[1] - square[1] * edges[0], normal), 2 * (normal**2).sum()
    else:
        over = square[0] * np.cross(edges[1], edges[2]) + square[1] * np.cross(edges[2], edges[0]) + square[2] * normal
        under = 2 * (normal * edges[2]).sum()
    return over / under if under != 0 else None
