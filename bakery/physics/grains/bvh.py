"""Nearest hits of rays with a closed mesh: a tree of boxes, eight children a node, four triangles a leaf.

Boxes are float32 and widened, so that the rounding of rays and boxes loses no hit; triangles are float64 and watertight.
"""

import hashlib
import math
import threading
from collections import OrderedDict

import numpy as np

from bakery.physics.grains.grid import Grid, laid
from bakery.physics.grains.lanes import BLOCK, BOXES, NODE, TRIANGLES, boxes_hit, fetch, triangles_hit
from bakery.physics.shapes.solid import arrays, faults
from bakery.physics.vectors import lowest
from bakery.system.compiled import njit

# Box planes err by less than 1e-6 in position: |coordinate| <= 1.02, differences <= 2.1, and five float32 roundings.
MARGIN = 1.5e-6
_BINS = 16
_DEEP = 24  # levels after which ranges are halved by number, so that the stack below suffices
_PENDING = 512
_BLOCK_LINES, _NODE_LINES = -(-BLOCK // 8), NODE // 16


@njit(cache=True, nogil=True, error_model="numpy")
def _half_area(low, high):
    x, y, z = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    return x * y + y * z + z * x


@njit(cache=True, nogil=True, error_model="numpy")
def _bounds(boxes, order, start, end, low, high):
    """Box around order[start:end] into low, high (3,); returns half its surface."""
    low[:], high[:] = np.inf, -np.inf
    for i in range(start, end):
        k = order[i]
        for axis in range(3):
            low[axis] = min(low[axis], boxes[k, axis])
            high[axis] = max(high[axis], boxes[k, 3 + axis])
    return _half_area(low, high)


@njit(cache=True, nogil=True, error_model="numpy")
def _cut(number, edge, scale):
    """Axis and bin (the last below) of the cut with the least area times leaves; axis -1 where there is none."""
    best, best_axis, best_bin = np.inf, -1, 0
    right, low, high = np.empty(_BINS), np.empty(3), np.empty(3)
    for axis in range(3):
        if not 0 < scale[axis] < np.inf:
            continue
        low[:], high[:] = np.inf, -np.inf
        count = 0
        for b in range(_BINS - 1, 0, -1):
            count += number[axis, b]
            for c in range(3):
                low[c] = min(low[c], edge[axis, b, c])
                high[c] = max(high[c], edge[axis, b, 3 + c])
            right[b] = _half_area(low, high) * ((count + TRIANGLES - 1) // TRIANGLES) if count else np.inf
        low[:], high[:] = np.inf, -np.inf
        count = 0
        for b in range(_BINS - 1):
            count += number[axis, b]
            for c in range(3):
                low[c] = min(low[c], edge[axis, b, c])
                high[c] = max(high[c], edge[axis, b, 3 + c])
            if count:
                cost = _half_area(low, high) * ((count + TRIANGLES - 1) // TRIANGLES) + right[b + 1]
                if cost < best:
                    best, best_axis, best_bin = cost, axis, b
    return best_axis, best_bin


@njit(cache=True, nogil=True, error_model="numpy")
def _split(boxes, order, start, end, by_number, spare):
    """Reorder order[start:end] into two parts and return where the second begins: least area times leaves over binned cuts."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for i in range(start, end):
        k = order[i]
        for axis in range(3):
            middle = boxes[k, axis] + boxes[k, 3 + axis]
            low[axis] = min(low[axis], middle)
            high[axis] = max(high[axis], middle)
    number, edge = np.zeros((3, _BINS), np.int64), np.empty((3, _BINS, 6))
    edge[:, :, :3], edge[:, :, 3:] = np.inf, -np.inf
    scale = np.zeros(3)
    for axis in range(3):
        if high[axis] > low[axis]:
            scale[axis] = _BINS * (1 - 1e-9) / (high[axis] - low[axis])
    best_axis, best_bin = -1, 0
    if not by_number:
        for i in range(start, end):
            k = order[i]
            for axis in range(3):
                b = int((boxes[k, axis] + boxes[k, 3 + axis] - low[axis]) * scale[axis])
                number[axis, b] += 1
                for c in range(3):
                    edge[axis, b, c] = min(edge[axis, b, c], boxes[k, c])
                    edge[axis, b, 3 + c] = max(edge[axis, b, 3 + c], boxes[k, 3 + c])
        best_axis, best_bin = _cut(number, edge, scale)
    if best_axis < 0:
        return (start + end) // 2
    origin = np.inf
    for i in range(start, end):
        origin = min(origin, boxes[order[i], best_axis] + boxes[order[i], 3 + best_axis])
    middle, above = start, 0
    for i in range(start, end):
        k = order[i]
        if int((boxes[k, best_axis] + boxes[k, 3 + best_axis] - origin) * scale[best_axis]) <= best_bin:
            order[middle] = k
            middle += 1
        else:
            spare[above] = k
            above += 1
    for i in range(above):  # numba compiles a copy of slices, with its messages, for seconds
        order[middle + i] = spare[i]
    return middle


@njit(cache=True, nogil=True, error_model="numpy")
def _build(boxes, margin):
    """Nodes (K, 64) float32, children (K, 8) int32 and leaves (M, 2) of ranges in the order (T,) of triangles.

    A child >= 0 is a node, otherwise ~child is a leaf.
    """
    count = len(boxes)
    order, spare = np.arange(count), np.empty(count, np.int64)
    planes, children = np.empty((16, 6, BOXES), np.float32), np.zeros((16, BOXES), np.int32)
    leaves, used = np.empty((16, 2), np.int64), 0
    low, high = np.empty(3), np.empty(3)
    todo = [(0, 0, count, 0)]
    nodes = 1
    start, end, area = np.empty(BOXES, np.int64), np.empty(BOXES, np.int64), np.empty(BOXES)
    while len(todo):
        node, start[0], end[0], level = todo.pop()
        area[0] = np.inf
        parts = 1
        while parts < BOXES:
            pick = -1
            for i in range(parts):
                if end[i] - start[i] > TRIANGLES and (pick < 0 or area[i] > area[pick]):
                    pick = i
            if pick < 0:
                break
            cut = _split(boxes, order, start[pick], end[pick], level > _DEEP, spare)
            start[parts], end[parts], end[pick] = cut, end[pick], cut
            area[pick] = _bounds(boxes, order, start[pick], end[pick], low, high)
            area[parts] = _bounds(boxes, order, start[parts], end[parts], low, high)
            parts += 1
        if nodes + parts > len(planes):
            wider, fewer = np.empty((2 * len(planes), 6, BOXES), np.float32), np.zeros((2 * len(planes), BOXES), np.int32)
            for n in range(nodes):
                for b in range(BOXES):
                    fewer[n, b] = children[n, b]
                    for k in range(6):
                        wider[n, k, b] = planes[n, k, b]
            planes, children = wider, fewer
        if used + parts > len(leaves):
            longer = np.empty((2 * len(leaves), 2), np.int64)
            for n in range(used):
                longer[n, 0], longer[n, 1] = leaves[n, 0], leaves[n, 1]
            leaves = longer
        planes[node, :3], planes[node, 3:] = 1e30, -1e30  # a child that is not there: entered late, left early
        for i in range(parts):
            _bounds(boxes, order, start[i], end[i], low, high)
            for axis in range(3):
                planes[node, axis, i], planes[node, 3 + axis, i] = low[axis] - margin, high[axis] + margin
            if end[i] - start[i] <= TRIANGLES:
                leaves[used, 0], leaves[used, 1] = start[i], end[i]
                children[node, i] = ~used
                used += 1
            else:
                children[node, i] = nodes
                todo.append((nodes, start[i], end[i], level + 1))
                nodes += 1
    return planes[:nodes], children[:nodes], leaves[:used], order


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(vertices, faces, leaves, order, blocks, names):
    """Blocks (M, 3, 3, 4) of triangles and their numbers (M, 4), -1 where a place is empty."""
    for m in range(len(leaves)):
        for lane in range(TRIANGLES):
            i = leaves[m, 0] + lane
            if i < leaves[m, 1]:
                names[m, lane] = order[i]
                for corner in range(3):
                    for axis in range(3):
                        blocks[m, axis, corner, lane] = vertices[faces[order[i], corner], axis]
            else:
                names[m, lane] = -1  # corners at one point: never hit
                blocks[m, :, :, lane] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def mesh_scratch():
    """Memory of one thread for `nearest_triangle`: four arrays, overwritten at each call."""
    return np.empty(_PENDING, np.int32), np.empty(_PENDING, np.float32), np.empty(BOXES, np.float32), np.empty(TRIANGLES)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _nearest_child(nodes, children, blocks, at, child, lane, bits, scratch, top):
    """The child that a ray enters first, of that in `lane` and those in `bits`, and how many are pending: the others on top."""
    pending, reach, enter, _ = scratch
    t, base = enter[lane], top
    while bits:
        lane = lowest(bits)
        bits &= bits - 1
        second, far = np.int64(children[at + lane]), enter[lane]
        if far < t:
            child, second, t, far = second, child, far, t
        if second < 0:
            fetch(blocks, ~second * BLOCK, _BLOCK_LINES)
        else:
            fetch(nodes, second * NODE, _NODE_LINES)
        j = top
        while j > base and reach[j - 1] < far:  # the nearest comes on top
            reach[j], pending[j] = reach[j - 1], pending[j - 1]
            j -= 1
        reach[j], pending[j] = far, second
        top += 1
    return child, top


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_triangle(nodes, children, blocks, ox, oy, oz, dx, dy, dz, skip, scratch):
    """Place (4 block + lane) of the first triangle along unit d from o, and its distance; (-1, inf) where there is none.

    skip : place of the triangle that the ray starts on, or -1;  scratch : from `mesh_scratch`.
    """
    pending, reach, enter, distance = scratch
    if abs(dx) >= abs(dy) and abs(dx) >= abs(dz):
        axes, sheared_start, shear = (1, 2, 0), (oy, oz, ox), (dy / dx, dz / dx, 1.0 / dx)
    elif abs(dy) >= abs(dz):
        axes, sheared_start, shear = (2, 0, 1), (oz, ox, oy), (dz / dy, dx / dy, 1.0 / dy)
    else:
        axes, sheared_start, shear = (0, 1, 2), (ox, oy, oz), (dx / dz, dy / dz, 1.0 / dz)
    # 1e-18 moves a ray by nothing, and no product is 0 * inf
    rx = np.float32(1.0 / math.copysign(max(abs(dx), 1e-18), dx))
    ry = np.float32(1.0 / math.copysign(max(abs(dy), 1e-18), dy))
    rz = np.float32(1.0 / math.copysign(max(abs(dz), 1e-18), dz))
    start, over = (np.float32(ox), np.float32(oy), np.float32(oz)), (rx, ry, rz)
    near = (3 * BOXES * (rx < 0), 3 * BOXES * (ry < 0), 3 * BOXES * (rz < 0))
    best, limit, triangle = np.inf, np.float32(np.inf), -1
    child, top = np.int64(0), 0
    while True:
        if child < 0:
            block = ~child
            bits = triangles_hit(blocks, block * BLOCK, axes, sheared_start, shear, best, distance)
            while bits:
                lane = lowest(bits)
                bits &= bits - 1
                if distance[lane] < best and TRIANGLES * block + lane != skip:
                    best, triangle = distance[lane], TRIANGLES * block + lane
                    limit = np.float32(best) * np.float32(1.0000003)
        else:
            at = child * NODE
            bits = boxes_hit(nodes, at, near, start, over, limit, enter)
            at += 6 * BOXES
            if bits:
                lane = lowest(bits)
                bits &= bits - 1
                child = np.int64(children[at + lane])
                if bits:  # else the usual case: straight on, nothing to sort
                    child, top = _nearest_child(nodes, children, blocks, at, child, lane, bits, scratch, top)
                continue
        while top > 0 and reach[top - 1] > limit:
            top -= 1
        if top == 0:
            break
        top -= 1
        child = np.int64(pending[top])
    return triangle, best


@njit(cache=True, nogil=True, error_model="numpy")
def triangle_normal(blocks, triangle):
    """Unit normal (x, y, z) of a triangle, outward where corners run counterclockwise seen from outside."""
    at = (triangle // TRIANGLES) * BLOCK + triangle % TRIANGLES
    ax, ay, az = blocks[at], blocks[at + 3 * TRIANGLES], blocks[at + 6 * TRIANGLES]
    ux, vx = blocks[at + TRIANGLES] - ax, blocks[at + 2 * TRIANGLES] - ax
    uy, vy = blocks[at + 4 * TRIANGLES] - ay, blocks[at + 5 * TRIANGLES] - ay
    uz, vz = blocks[at + 7 * TRIANGLES] - az, blocks[at + 8 * TRIANGLES] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    over = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * over, ny * over, nz * over


@njit(cache=True, nogil=True, error_model="numpy")
def _rays(nodes, children, blocks, names, origin, direction, face, distance):
    scratch = mesh_scratch()
    for i in range(len(origin)):
        triangle, t = nearest_triangle(nodes, children, blocks, origin[i, 0], origin[i, 1], origin[i, 2],
                                    direction[i, 0], direction[i, 1], direction[i, 2], np.int64(-1), scratch)
        face[i], distance[i] = names[triangle] if triangle >= 0 else -1, t


class Mesh:
    """A closed mesh of triangles inside the unit sphere, with the tree for its rays.

    Parameters
    ----------
    vertices : (V, 3) in units of the bounding radius, none farther than 1 from the origin
    faces : (T, 3) indices, counterclockwise seen from outside

    Raises
    ------
    ValueError : not such arrays, a vertex outside of the unit sphere, no volume, or inside out

    Notes
    -----
    That the mesh is closed and does not cut itself is the caller's to know; walks count the rays that find it otherwise.
    Pickled, it is its vertices and faces; a process keeps the trees and grids of its last meshes.
    """

    def __init__(self, vertices, faces):
        vertices, faces = arrays(vertices, faces)
        for fault in faults(vertices, faces, closed=False):
            raise ValueError(fault)
        self.vertices, self.faces = np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64)
        self._made, self._lock = {}, threading.Lock()

    @property
    def volume(self) -> float:
        """Of the solid, in R^3."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(np.sum(a * np.cross(b, c))) / 6

    @property
    def surface(self) -> float:
        """Area, in R^2."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return 0.5 * float(np.sum(np.linalg.norm(np.cross(b - a, c - a), axis=1)))

    @property
    def tree(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """That of `triangle_tree`."""
        return self._kept(triangle_tree)

    @property
    def grid(self) -> Grid:
        """What walks of many rays at once take."""
        return self._kept(laid)

    def _kept(self, make):
        with self._lock:
            if make not in self._made:
                self._made[make] = _kept(make, self.vertices, self.faces)
            return self._made[make]

    def first_hit(self, origin, direction):
        """Faces (n,) and distances (n,) that rays from origin (n, 3), |origin| < 1.02, along unit direction (n, 3) meet first.

        -1 and inf where there is none.
        """
        origin, direction = np.ascontiguousarray(origin, float), np.ascontiguousarray(direction, float)
        face, distance = np.empty(len(origin), np.int64), np.empty(len(origin))
        _rays(*self.tree, origin, direction, face, distance)
        return face, distance

    def __getstate__(self):
        return self.vertices, self.faces

    def __setstate__(self, state):
        (self.vertices, self.faces), self._made, self._lock = state, {}, threading.Lock()


_MADE: OrderedDict[tuple, tuple] = OrderedDict()
_MADE_LOCK = threading.Lock()
_MADE_MAX = 4


def _kept(make, vertices, faces):
    """make(vertices, faces), once a process: in worker processes each task unpickles the mesh anew."""
    key = make, hashlib.sha256(vertices.tobytes() + faces.tobytes()).digest()
    with _MADE_LOCK:
        if key not in _MADE:
            _MADE[key] = make(vertices, faces)
            while len(_MADE) > _MADE_MAX:
                _MADE.popitem(last=False)
        _MADE.move_to_end(key)
        return _MADE[key]


def triangle_tree(vertices, faces):
    """What `nearest_triangle` takes of triangles, closed or not.

    Parameters
    ----------
    vertices : (V, 3) inside the unit sphere
    faces : (T, 3) int64, indices

    Returns
    -------
    nodes, children, blocks, names : (64 K,) float32, the same memory as int32, (36 M,), and (4 M,) number of the triangle at each
        place of the blocks, -1 where there is none
    """
    corners = vertices[faces]
    planes, children, leaves, order = _build(np.concatenate([corners.min(1), corners.max(1)], axis=1), MARGIN)
    nodes = np.zeros((len(planes), NODE), np.float32)
    nodes[:, : 6 * BOXES] = planes.reshape(len(planes), -1)
    nodes[:, 6 * BOXES : 7 * BOXES] = children.view(np.float32)
    blocks, names = np.empty((len(leaves), 3, 3, TRIANGLES)), np.empty((len(leaves), TRIANGLES), np.int64)
    _fill(np.array(vertices), faces, leaves, order, blocks, names)  # writable: one kind of array is compiled for
    nodes = nodes.reshape(-1)
    return nodes, nodes.view(np.int32), blocks.reshape(-1), names.reshape(-1)
