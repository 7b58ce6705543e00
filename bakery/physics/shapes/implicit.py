"""Closed meshes of bodies that are given by a function: negative inside, positive outside.

Marching through tetrahedra: six to a cell of a grid.  Inside each the surface is one or two triangles with corners on its edges,
so the mesh is closed, has two triangles to an edge and crosses itself nowhere, whatever the function does between grid points.
Grid points near the surface step back from it, which leaves hardly any slivers.
"""

from itertools import permutations

import numpy as np

SPARE = 3.0  # triangles made for one that is kept: slivers go first
_COARSE = 40  # cells along the longest edge in the first try
_POINTS = 1 << 16  # evaluated at once
_BLOCK = 8  # grid points, cubed, that are looked at together
_GRID = 4e7  # points for the sake of details
_CRUMB = 2.5  # cells: edge of the cube whose volume a separate piece or a cavity must exceed
_CLEAR = 0.2  # of a cell: distance that grid points keep from the surface; tetrahedra stay whole up to 0.28


def surface(function, low, high, triangles, detail=np.inf):
    """Mesh of the body where a function is negative, several times as fine as asked for.

    Parameters
    ----------
    function : (N, 3) -> (N,), continuous, positive on the faces of the box, never steeper than a distance: where it is far
        from zero it is not asked again
    low, high : (3,) corners of a box around the body
    triangles : number that shall be left when the mesh is simplified; made are three times as many, or more
    detail : largest step of the grid

    Returns
    -------
    vertices : (V, 3), where the function is zero on edges of a grid, to 1e-6 of its cells
    faces : (F, 3) int32, outward

    Raises
    ------
    ValueError : the function is negative nowhere, or on the box's faces; the detail takes too fine a grid
    """
    from bakery.physics.shapes.quality import bodies

    low, high = np.asarray(low, float), np.asarray(high, float)
    step = first_step(low, high, detail)
    wanted = SPARE * triangles
    for _ in range(4):
        vertices, faces = marched(function, low, high, step)
        if len(faces) >= 0.9 * wanted:
            break
        step *= np.sqrt(len(faces) / (1.05 * wanted))
    # a crease narrower than a cell can leave crumbs and bubbles of a grid point or two
    body, volume = bodies(vertices, faces)
    solid = (np.abs(volume) > (_CRUMB * step) ** 3) | (volume == volume.max())
    used, numbers = np.unique(faces[solid[body]], return_inverse=True)
    return vertices[used], numbers.reshape(-1, 3).astype(np.int32)


def first_step(low, high, detail) -> float:
    """Step of the grid of the first try; ValueError where the detail (arguments as of `surface`) takes too fine a grid."""
    size = np.subtract(high, low)
    step = min(float(size.max()) / _COARSE, detail)
    if (size / step).prod() > _GRID:
        least = (size.prod() / _GRID) ** (1 / 3)
        raise ValueError(f"details of {detail / size.max():.2g} of the whole are too small to be resolved; "
                         f"{least / size.max():.2g} would do")
    return step


def marched(function, low, high, step):
    """The mesh on a grid with this step; arguments and result as of `surface`."""
    shape = np.ceil((high - low) / step).astype(int) + 2
    value = _sampled(function, low, step, shape)
    solid = value < 0
    rim = solid.copy()
    rim[1:-1, 1:-1, 1:-1] = False
    if not solid.any() or rim.any():
        raise ValueError("the body fills none of its box" if not solid.any() else "the body leaves its box")
    corners = _tetrahedra(solid)
    # an edge of the grid is its lower end and its offset, 1 to 7; each that is cut becomes a vertex
    edge, faces = np.unique(corners, return_inverse=True)
    start, offset = edge // 8, edge % 8
    end = start + (offset >> 2 & 1) * (shape[1] * shape[2]) + (offset >> 1 & 1) * shape[2] + (offset & 1)
    moved, stepped = _step_back(function, low, step, value)

    def ends(index):
        at = low + step * np.stack(np.unravel_index(index, shape), axis=1)
        row = np.minimum(np.searchsorted(moved, index), max(len(moved) - 1, 0))
        return np.where((moved[row] == index)[:, None], stepped[row], at) if len(moved) else at

    vertices = _cuts(function, ends(start), ends(end), value.ravel()[start], value.ravel()[end])
    return vertices, faces.reshape(-1, 3).astype(np.int32)


def _sampled(function, low, step, shape):
    """Values at the grid points near the surface; elsewhere that of the middle of their block, which has the right sign."""
    blocks = -(-shape // _BLOCK)
    middle = low + step * (_BLOCK * np.stack(np.unravel_index(np.arange(blocks.prod()), blocks), axis=1) + 0.5 * (_BLOCK - 1))
    value = np.concatenate([function(middle[s]) for s in _slices(len(middle))])
    near = np.flatnonzero(np.abs(value) < (0.5 * 3**0.5 * _BLOCK + 2) * step)
    value = np.repeat(value[:, None], _BLOCK**3, axis=1)
    inside = step * (np.stack(np.unravel_index(np.arange(_BLOCK**3), (_BLOCK,) * 3), axis=1) - 0.5 * (_BLOCK - 1))
    for s in _slices(len(near), _POINTS // _BLOCK**3):
        points = middle[near[s], None] + inside
        value[near[s]] = function(points.reshape(-1, 3)).reshape(points.shape[:2])
    value = value.reshape(*blocks, *(_BLOCK,) * 3).transpose(0, 3, 1, 4, 2, 5).reshape(blocks * _BLOCK)
    return np.ascontiguousarray(value[:shape[0], :shape[1], :shape[2]])


def _step_back(function, low, step, value):
    """Grid points close to the surface, by index, and where they go: away from it along the gradient, with new values."""
    near = np.flatnonzero(np.abs(value) < 4 * step)
    index = np.stack(np.unravel_index(near, value.shape), axis=1)
    within = ((index > 0) & (index < np.array(value.shape) - 1)).all(axis=1)
    near, index = near[within], index[within]
    slope = np.stack([(value[tuple((index + unit).T)] - value[tuple((index - unit).T)]) / (2 * step)
                      for unit in np.eye(3, dtype=int)], axis=1)
    steep = (slope**2).sum(axis=1)
    old = value.ravel()[near]
    close = (np.abs(old) < _CLEAR * step * np.sqrt(steep)) & (steep > 0)
    near, index, slope, steep, old = near[close], index[close], slope[close], np.sqrt(steep[close]), old[close]
    away = np.where(old < 0, -1.0, 1.0) * _CLEAR * step - old / steep
    stepped = low + step * index + (away / steep)[:, None] * slope
    new = np.concatenate([function(stepped[s]) for s in _slices(len(stepped))]) if len(stepped) else old
    fits = ((new < 0) == (old < 0)) & (np.abs(new) > np.abs(old))
    value.ravel()[near[fits]] = new[fits]
    return near[fits], stepped[fits]


def _tetrahedra(solid):
    """Triangles (F, 3) as keys of the grid edges at their corners."""
    shape = solid.shape
    stride = np.array([shape[1] * shape[2], shape[2], 1])
    count = np.zeros(tuple(n - 1 for n in shape), np.int8)
    for x, y, z in np.ndindex(2, 2, 2):
        count += solid[x:shape[0] - 1 + x, y:shape[1] - 1 + y, z:shape[2] - 1 + z]
    cell = np.stack(np.nonzero((count > 0) & (count < 8)), axis=1) @ stride
    inside, triangles = solid.ravel(), []
    for order in permutations(range(3)):  # from corner 000 to 111, one axis after the other
        steps = np.concatenate([[0], np.cumsum(stride[list(order)])])
        bits = np.concatenate([[0], np.cumsum([4 >> axis for axis in order])])
        even = order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        state = inside[cell[:, None] + steps]

        def cut(rows, i, k, steps=steps, bits=bits):
            i, k = min(i, k), max(i, k)
            return (cell[rows] + steps[i]) * 8 + (bits[k] - bits[i])

        for number in range(1, 15):
            pattern = np.array([number >> i & 1 for i in range(4)], bool)
            rows = np.flatnonzero((state == pattern).all(axis=1))
            ins, outs = np.flatnonzero(pattern).tolist(), np.flatnonzero(~pattern).tolist()
            if not rows.size:
                continue
            if len(ins) == 2:
                (i, j), (k, m) = ins, outs
                loop = [cut(rows, i, k), cut(rows, i, m), cut(rows, j, m), cut(rows, j, k)]
                new = [(loop[0], loop[1], loop[2]), (loop[0], loop[2], loop[3])]
                turn = _parity((i, j, k, m)) ^ even
            else:
                lone, others = (ins[0], outs) if len(ins) == 1 else (outs[0], ins)
                new = [tuple(cut(rows, lone, corner) for corner in others)]
                turn = _parity((lone, *others)) ^ even ^ (len(ins) == 3)
            for triangle in new:
                triangles.append(np.stack(triangle if turn else triangle[::-1], axis=1))
    return np.concatenate(triangles)


def _parity(order):
    """Whether a permutation is odd."""
    return sum(order[i] > order[j] for i in range(len(order)) for j in range(i + 1, len(order))) % 2 == 1


def _cuts(function, a, b, at_a, at_b):
    """Zeros of a function on segments whose ends have different signs, by the Illinois method; never at an end."""
    low, high = np.zeros(len(a)), np.ones(len(a))
    f, g = at_a.copy(), at_b.copy()
    before = np.zeros(len(a), np.int8)  # which end moved last: the other one counts half if it stays again
    for _ in range(9):
        t = np.clip((low * g - high * f) / (g - f), 0.0, 1.0)
        h = np.concatenate([function(a[s] + t[s, None] * (b[s] - a[s])) for s in _slices(len(a))])
        same = (h < 0) == (f < 0)
        f, g = np.where(same, h, np.where(before == 2, 0.5 * f, f)), np.where(same, np.where(before == 1, 0.5 * g, g), h)
        before = np.where(same, 1, 2)
        low, high = np.where(same, t, low), np.where(same, high, t)
    t = np.clip(t, 1e-3, 1 - 1e-3)
    return a + t[:, None] * (b - a)


def _slices(number, size=_POINTS):
    return [slice(start, start + size) for start in range(0, number, size)]
