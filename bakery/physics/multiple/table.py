"""A table of the light of third and later events: lobes as a few coefficients at the corners of a quadtree.

    ln T = ln N + a_0 + B_0 + sum over k of a_k B_k

N is the singular part, B depends on the direction in the frame of the position, a on the place (u, v) (see `frame`).  Corners
that no cell has are filled in by cubics, level by level, so that a look-up finds a uniform grid: the tree is a matter of the file
and of the work, not of the look-up.  What makes a table of a solution: `build`.
"""

from dataclasses import dataclass, field

import numpy as np

from bakery.physics.multiple import frame, tree
from bakery.physics.multiple.tree import ASPECT, COARSE

COORDINATES = (
    f"u = arsinh(r / {frame.CORE[0]}) / arsinh(extent / {frame.CORE[0]}), v = (2/pi) arctan({frame.SKEW[0]} tan(Theta / 2)): "
    "distance from the source and angle from +z",
    f"u = arsinh(b / {frame.CORE[1]}) / arsinh(extent / {frame.CORE[1]}), v = (2/pi) arctan({frame.SKEW[1]} tan(nu / 2)): "
    "ellipses about the ends of the segment, b = sqrt((r1 + r2)^2 - length^2) / 2, cos nu = (r1 - r2) / length")
SINGULAR = ("1 / r", "2 artanh(length / (r1 + r2))")
FRAME = (f"axis away from the origin, +z at azimuth 0; s = (2/pi) arctan({frame.SHARP} tan(polar / 2)), t = |azimuth| / pi, both "
         "equidistant with both ends")
INTERPOLATION = (
    "ln(T / singular) = a_0 + B_0 + sum a_k B_k; a_k by Catmull-Rom in u, v on the finest cells, whose missing corners are "
    "(-1, 9, 9, -1)/16 of the next coarser ones, even in v, by cubics beyond u; B_k by cubic splines, three times as fine, "
    "then linear; beyond the extent, with m = r or b, "
    "a_k + k0 m at k = 0 and a_k else go on as c + d / m through their values at extent / 2 and extent")
ARRAYS = ("node_bounds", "node_child", "corner", "offset", "coefficient", "coefficient_scale", "basis", "basis_scale")
RINGS = 24  # of directions of a basis, and one more for every second order
STEPS = 32767  # of int16


@dataclass(frozen=True)
class Table:
    """One source and one wavelength.  Arrays as in the asset."""

    kind: int  # POINT or SEGMENT
    length: float  # of the segment, mfp; 0 for a point
    extent: float  # m (see `frame`) where the table ends, mfp
    k0: float  # decay of diffuse light beyond the extent, 1/mfp
    node_bounds: np.ndarray = field(repr=False)  # (M, 4) u_min, u_max, v_min, v_max of each cell
    node_child: np.ndarray = field(repr=False)  # (M,) index of the first of four children, or -1
    # (N, 2) place of a corner in units of 2^-depth for u and 2^-depth / ASPECT for v, ascending
    corner: np.ndarray = field(repr=False)
    offset: np.ndarray = field(repr=False)  # (N,) a_0
    coefficient: np.ndarray = field(repr=False)  # (N, K) times coefficient_scale (K,): a_k
    coefficient_scale: np.ndarray = field(repr=False)
    basis: np.ndarray = field(repr=False)  # (K + 1, A, B) times basis_scale (K + 1,): B_k on s, t equidistant with both ends
    basis_scale: np.ndarray = field(repr=False)
    # relative error of a lobe (root mean square over directions, then over positions between the corners, plus three of its
    # standard errors), without and with what the solver contributes
    error: float = 0.0
    error_with_solver: float = 0.0
    worst: float = 0.0  # largest of these positions

    @property
    def depth(self) -> int:
        return tree.depth(self.corner)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(a.nbytes for a in self.arrays().values())

    @property
    def empty(self) -> bool:
        """Whether there is no light of third events: nothing scatters."""
        return len(self.corner) == 0

    def arrays(self) -> dict[str, np.ndarray]:
        return {name: getattr(self, name) for name in ARRAYS}

    def coefficients(self) -> np.ndarray:
        """a_0 .. a_K on the uniform grid of the finest cells, (2^depth + 1, ASPECT 2^depth + 1, K + 1)."""
        size = 1 << self.depth
        columns = np.column_stack([self.offset, self.coefficient * self.coefficient_scale.astype(float)])
        values = np.full((size + 1, ASPECT * size + 1, columns.shape[1]), np.nan)
        values[self.corner[:, 0], self.corner[:, 1]] = columns
        return fill(values)

    def functions(self) -> np.ndarray:
        """B_k, (K + 1, A, B)."""
        return self.basis * self.basis_scale.astype(float)[:, None, None]


def from_arrays(arrays, *, kind, length, extent, k0, error=0.0, error_with_solver=0.0, worst=0.0) -> Table:
    """A table of stored arrays (as `Table.arrays` names them).

    Raises ValueError : they do not make a table
    """
    a = {name: np.asarray(arrays[name]) for name in ARRAYS}
    count, corners = len(a["coefficient_scale"]), len(a["corner"])
    shapes = {"node_bounds": (len(a["node_child"]), 4), "corner": (corners, 2), "offset": (corners,),
              "coefficient": (corners, count), "basis": (count + 1, *a["basis"].shape[1:]), "basis_scale": (count + 1,)}
    for name, expected in shapes.items():
        if a[name].shape != expected:
            raise ValueError(f"{name} has shape {a[name].shape}; with the other arrays of the table it would be {expected}")
    table = Table(kind, float(length), float(extent), float(k0), **a, error=error, error_with_solver=error_with_solver,
                  worst=worst)
    for fault in tree.broken(a["corner"], a["node_bounds"]):
        raise ValueError(fault)
    return table


def shape(order):
    """Rings and half meridians of the directions of a basis."""
    rings = min(RINGS + order // 2, 80)
    return rings, int(0.42 * rings) | 1


def fill(values):
    """Fills the gaps (nan) of a grid whose coarsest level is known, from coarse to fine."""
    size = len(values) - 1
    step = size >> COARSE
    grid = values[::step, ::step]
    while step > 1:
        step //= 2
        coarse = values[::step, ::step]
        grid = np.where(np.isnan(coarse), between(grid), coarse)
    return grid


def between(grid):
    """A grid (U, V, K) with the middles added by cubics through four neighbours, (2 U - 1, 2 V - 1, K)."""
    U, V, K = grid.shape
    padded = margins(grid)
    rows = np.empty((2 * U - 1, V + 2, K))
    rows[::2] = padded[1:-1]
    rows[1::2] = (9 * (padded[1:-2] + padded[2:-1]) - padded[:-3] - padded[3:]) / 16
    out = np.empty((2 * U - 1, 2 * V - 1, K))
    out[:, ::2] = rows[:, 1:-1]
    out[:, 1::2] = (9 * (rows[:, 1:-2] + rows[:, 2:-1]) - rows[:, :-3] - rows[:, 3:]) / 16
    return out


def margins(grid):
    """One more row on all sides: even in v, by cubics in u."""
    low = 4 * grid[:1] - 6 * grid[1:2] + 4 * grid[2:3] - grid[3:4]
    high = 4 * grid[-1:] - 6 * grid[-2:-1] + 4 * grid[-3:-2] - grid[-4:-3]
    tall = np.concatenate([low, grid, high])
    return np.concatenate([tall[:, 1:2], tall, tall[:, -2:-1]], axis=1)


def scales(basis):
    """Of the functions of a basis, so that int16 holds them."""
    return np.maximum(np.abs(basis).max(axis=1) / STEPS, 1e-30).astype(np.float32)


def quantised(basis):
    """The functions of a basis as int16 holds them."""
    scale = scales(basis).astype(float)[:, None]
    return np.rint(basis / scale) * scale


def empty(kind, length, extent, k0) -> Table:
    """The table of a medium that scatters nothing."""
    none = np.zeros((0, 2))
    roots = np.array([[0, 1, 0, 0.5], [0, 1, 0.5, 1]], np.float32)
    return Table(kind, length, float(extent), k0, roots, np.array([-1, -1], np.int32),
                 none.astype(np.int16), np.zeros(0, np.float32), np.zeros((0, 0), np.int16), np.zeros(0, np.float32),
                 np.zeros((1, 2, 2), np.int16), np.zeros(1, np.float32))
