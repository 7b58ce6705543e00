"""Straight lines through a mesh: hit probability, length inside, missed chords, and whether points lie inside.

What every closed mesh must obey (mean length inside = V/(pi R^2), as many ways in as out) tells at once whether parity, winding
and units are right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bakery.physics.shapes.noise import directions, stream


@dataclass(frozen=True)
class Tree:
    """A mesh with a tree of boxes over its triangles, in the order of a space-filling curve."""

    vertices: np.ndarray
    faces: np.ndarray
    order: np.ndarray
    box: np.ndarray


@dataclass(frozen=True)
class Lines:
    """Isotropic uniform chords of the unit sphere against a mesh inside it; lengths in radii, each with its standard error.

    Attributes
    ----------
    hit_probability, inner_length (a chord, hit or not), lambda_delta (of chords not hit; nan where all hit)
    unbalanced : share of chords that enter and leave a different number of times; 0 for closed meshes up to rounding
    """

    hit_probability: float
    hit_probability_error: float
    inner_length: float
    inner_length_error: float
    lambda_delta: float
    lambda_delta_error: float
    unbalanced: float


def tree(vertices, faces) -> Tree:
    """A tree of boxes over triangles (F, 3) of vertices (V, 3)."""
    from bakery.physics.shapes._triangles import boxes

    vertices, faces = np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces, np.int32)
    centre = vertices[faces].mean(axis=1)
    low = centre.min(axis=0)
    cell = (1023 * ((centre - low) / max(float(np.ptp(centre, axis=0).max()), 1e-300))).astype(np.int64)
    order = np.argsort(_spread(cell[:, 0]) | _spread(cell[:, 1]) << 1 | _spread(cell[:, 2]) << 2, kind="stable")
    return Tree(vertices, faces, order, boxes(vertices, faces, order))


def measure(mesh: Tree, count=100_000, seed=0) -> Lines:
    """Hits, misses and lengths inside of `count` random chords of the unit sphere; 1e6 chords of 20,000 triangles take 3 s."""
    from bakery.physics.shapes._triangles import crossings

    rng = stream(seed, 1)
    forward = directions(rng, count)
    square, turn = rng.random(count), 2 * np.pi * rng.random(count)
    helper = np.where(np.abs(forward[:, :1]) < 0.7, [[1.0, 0, 0]], [[0.0, 1, 0]])
    across = np.cross(forward, helper)
    across /= np.sqrt((across**2).sum(axis=1))[:, None]
    entry = np.sqrt(square)[:, None] * (np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(forward, across))
    times, balance, length = crossings(mesh.vertices, mesh.faces, mesh.order, mesh.box, np.zeros(len(mesh.faces), np.int32),
                                       entry - 2 * forward, forward, np.full(count, -1, np.int32))
    hit = times > 0
    beta = float(hit.mean())
    missed = 2 * np.sqrt(1 - square[~hit])

    def mean(values):
        return (float(values.mean()), float(values.std() / np.sqrt(values.size))) if values.size else (np.nan, np.nan)

    return Lines(beta, float(np.sqrt(beta * (1 - beta) / count)), *mean(length), *mean(missed), float((balance != 0).mean()))


def inside(mesh: Tree, points, body=None, skip=None):
    """Whether points (N, 3) lie inside: the parity of crossings, by the majority of three half-lines each; (N,) bool.

    Parameters
    ----------
    body : (F,) number of each triangle's body, and skip : (N,) the body that does not count for a point; all count if absent
    """
    from bakery.physics.shapes._triangles import crossings

    points = np.ascontiguousarray(points, float)
    body = np.zeros(len(mesh.faces), np.int32) if body is None else body
    skip = np.full(len(points), -1, np.int32) if skip is None else skip
    votes = [crossings(mesh.vertices, mesh.faces, mesh.order, mesh.box, body, points,
                       np.broadcast_to(way, points.shape).copy(), skip)[0] % 2 for way in directions(stream(0, 2), 3)]
    return np.sum(votes, axis=0) >= 2


def _spread(x):
    """Bits of ten-bit numbers with two zeros between each and the next."""
    x = (x | x << 16) & 0x030000FF
    x = (x | x << 8) & 0x0300F00F
    x = (x | x << 4) & 0x030C30C3
    return (x | x << 2) & 0x09249249
