"""Whether triangles are a solid in the unit sphere: what exemplar grains are, and what walks and pictures count on.

Whether a solid crosses itself is not asked here: `quality.self_crossings` tells, in half a second.
"""

from collections.abc import Iterator

import numpy as np

from bakery.physics.shapes.quality import FACES, volume

OUTSIDE = 1e-9  # how far beyond the unit sphere a vertex may lie by rounding
LARGEST = 1e30  # of a coordinate: fourth powers must not leave the range of numbers


def arrays(vertices, faces):
    """Triangles whose numbers can be worked with.

    Parameters
    ----------
    vertices : (V, 3) any length
    faces : (F, 3) indices of vertices

    Returns
    -------
    vertices : (V, 3) float64
    faces : (F, 3) whole numbers

    Raises
    ------
    ValueError : what is wrong and where, with vertices and faces numbered from 0
    """
    vertices, faces = np.array(vertices, float, ndmin=2), np.array(faces, ndmin=2)
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,) or not np.issubdtype(faces.dtype, np.integer):
        raise ValueError("a mesh is vertices (V, 3) and triangles (F, 3) of whole numbers")
    if len(faces) > FACES[1]:
        raise ValueError(f"{len(faces):,} triangles; at most {FACES[1]:,} (simplify it first)")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1) | (np.abs(vertices) > LARGEST).any(axis=1))
    if bad.size:
        raise ValueError(f"vertex {bad[0]} is {point(vertices[bad[0]])}; coordinates are finite numbers up to {LARGEST:g}"
                         f"{more(bad)}")
    bad = np.flatnonzero((faces < 0).any(axis=1) | (faces >= len(vertices)).any(axis=1))
    if bad.size:
        raise ValueError(f"face {bad[0]} names the vertices {faces[bad[0]].tolist()}, but there are only {len(vertices):,} (0 to "
                         f"{len(vertices) - 1}){more(bad)}")
    if not len(faces):
        raise ValueError("no triangle")
    return vertices, faces


def faults(vertices, faces, closed=True) -> Iterator[str]:
    """Why triangles, arrays as `arrays` gives them, are no solid in the unit sphere that is wound outward, in words.

    closed : whether every edge is looked at; walks count the rays that find a hole
    """
    if len(faces) < FACES[0]:
        yield f"{len(faces)} triangles enclose nothing; at least {FACES[0]}"
    bad = np.flatnonzero((faces == np.roll(faces, 1, axis=1)).any(axis=1))
    if bad.size:
        yield f"face {bad[0]} names a vertex twice{more(bad)}"
        return
    bad = np.flatnonzero((vertices**2).sum(axis=1) > (1 + OUTSIDE) ** 2)
    if bad.size:
        yield f"vertex {bad[0]} at {point(vertices[bad[0]])} lies outside of the bounding sphere{more(bad)}"
    # a number for each edge of each face, as it runs and turned; 60 ms for 200,000 triangles
    along, back = (np.sort(np.concatenate([faces[:, k].astype(np.int64) * len(vertices) + faces[:, (k + step) % 3]
                                           for k in range(3)])) if closed else np.zeros(0) for step in (1, -1))
    if (along[1:] == along[:-1]).any() or not np.array_equal(along, back):
        yield "not closed: an edge of a solid has two triangles, which run along it in opposite directions"
    elif not (enclosed := volume(vertices, faces)) > 0:
        yield f"encloses a volume of {enclosed:.3g}: faces run counterclockwise seen from outside"


def point(p) -> str:
    """A point for messages."""
    return "(" + ", ".join(f"{x:.6g}" for x in p) + ")"


def more(bad, noun="place") -> str:
    """How many there are besides the first of what is wrong, for messages."""
    return f" (and {len(bad) - 1:,} more {noun}{'s' if len(bad) > 2 else ''})" if len(bad) > 1 else ""
