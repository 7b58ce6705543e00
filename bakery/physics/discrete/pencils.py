"""Pencils of light among discs: which particle stops one first, and at which wavelengths it gets through.

A particle stops a pencil at a wavelength if its centre is nearer to it than the radius of its disc, sqrt(C_ext / pi), and if the
foot of the perpendicular from its centre lies between the pencil's ends.  Among particles at independent places the share of
pencils that get through a distance s is exp(-sigma_t s), for any sizes.

A pencil goes through the lattice of a level in layers across its main axis; in each it looks through the cells that it passes
nearer than the level's largest disc, so a particle is listed once, in the cell of its centre, and need not be stored at all.
"""

import math
from typing import NamedTuple

import numpy as np

from bakery.physics.discrete.hashing import cell_count, cell_hash, cell_particle
from bakery.physics.discrete.levels import along_axis, block_steps, cell_index
from bakery.physics.discrete.region import relative_density
from bakery.physics.lent import lent
from bakery.physics.packing.instances import hashed
from bakery.system.compiled import njit

NO_DISC = -1
_PRIME = np.uint64(0xD1B54A32D192ED03)


class Pencil(NamedTuple):
    """A pencil of light.

    Attributes
    ----------
    origin, direction : (3) m, and of length 1
    begin, end : m, distances between which (begin excluded) feet of perpendiculars count; end may be inf
    left_out : (3) m, place of a particle that is left out, as `first_disc` gave it; nan: none
    """

    origin: tuple
    direction: tuple
    begin: float
    end: float
    left_out: tuple


class Particles(NamedTuple):
    """Room for particles: position (n, 3) m, class (n,), identity (n,) uint64, of each particle the same however it moves."""

    position: np.ndarray
    kind: np.ndarray
    identity: np.ndarray


class _Level(NamedTuple):
    """One of the levels: its number, whether its particles are stored, whether it has moved, m, its largest disc."""

    number: int
    stored: bool
    moved: bool
    reach: float


class _Course(NamedTuple):
    """A pencil's way through the lattice of a level, axes in an order that begins with its main one.

    main : that axis;  begin, end : m, where it is near the box
    q, d : origin from the corner of the lattice, which moves with its particles, and direction;  h : edges of a cell
    low, high : the first and last cells in the box;  stride, bits : of `along_axis`
    """

    main: int
    begin: float
    end: float
    q: tuple
    d: tuple
    h: tuple
    low: tuple
    high: tuple
    stride: tuple
    bits: tuple


class _Cell(NamedTuple):
    """A cell: its numbers and hash, the corner of its lattice (m), its first particle and the one behind its last."""

    i: int
    j: int
    k: int
    hash: int
    ex: float
    ey: float
    ez: float
    first: int
    after: int


class _Hit(NamedTuple):
    """The first disc so far: class or NO_DISC, distance of the foot and squared distance of the centre (m, m^2), centre (m)."""

    kind: int
    distance: float
    square: float
    x: float
    y: float
    z: float


@njit(cache=True, nogil=True, error_model="numpy")
def first_disc(discs, pencil, scratch):
    """The first particle whose disc, the largest of all wavelengths, stops a pencil.

    Parameters
    ----------
    discs : `Discs`
    pencil : `Pencil`
    scratch : from `mesh_scratch`

    Returns
    -------
    class : int, or NO_DISC
    distance : m, of the foot; the pencil's end where there is none
    square : m^2, squared distance of the centre from the pencil
    x, y, z : m, centre
    """
    hit, none = _Hit(NO_DISC, pencil.end, 0.0, 0.0, 0.0, 0.0), np.empty(0, np.uint8)
    for level in range(len(discs.reach)):
        _, nearer = _search(discs, level, pencil, hit.distance, none, True, scratch)
        if nearer.kind != NO_DISC:
            hit = nearer
    return hit.kind, hit.distance, hit.square, hit.x, hit.y, hit.z


@njit(cache=True, nogil=True, error_model="numpy")
def open_wavelengths(discs, pencil, open, scratch):
    """At how many wavelengths a pencil gets through; arguments as in `first_disc`.

    open : (L,) uint8, 1 where the pencil is still open; becomes 0 at each wavelength at which a disc stops it
    """
    still = 0
    for w in range(len(open)):
        still += open[w]
    for level in range(len(discs.reach)):
        if still == 0:
            return 0
        still, _ = _search(discs, level, pencil, pencil.end, open, False, scratch)
    return still


@njit(cache=True, nogil=True, error_model="numpy")
def _clip(o, d, low, high, begin, end):
    """The part of (begin, end) in which o + t d is between low and high."""
    if d == 0.0:
        return (begin, end) if low <= o <= high else (1.0, 0.0)
    a, b = (low - o) / d, (high - o) / d
    return max(begin, min(a, b)), min(end, max(a, b))


@njit(cache=True, nogil=True, error_model="numpy")
def _search(discs, number, pencil, end, open, nearest, scratch):
    """One level: how many wavelengths are still open, and with `nearest` the first disc."""
    discs, open, scratch = lent(discs), lent(open), lent(scratch)
    level, hit, still = _level(discs, number), _Hit(NO_DISC, end, 0.0, 0.0, 0.0, 0.0), 0
    for w in range(len(open)):
        still += open[w]
    begin, end = _near_box(discs.region, pencil, level.reach, end)
    if not begin < end:
        return still, hit
    course = _course(discs, level, pencil, begin, end)
    layer, layers, sign = _layers(course, level.reach)
    for _ in range(layers):
        enter, leave = _crossing(course, layer, sign, level.reach)
        if nearest and enter > hit.distance:
            break
        rows, columns = _cells_near(course, max(enter, begin), min(leave, min(end, hit.distance)), level.reach)
        for row in range(rows[0], rows[1] + 1):
            for column in range(columns[0], columns[1] + 1):
                cell = _cell(discs, level, course, layer, row, column)
                still, hit = _through_cell(discs, level, cell, pencil, hit, still, open, nearest, scratch)
                if not nearest and still == 0:
                    return still, hit
        layer += sign
    return still, hit


@njit(nogil=True, error_model="numpy", forceinline=True)
def _level(discs, number):
    """The level with a number."""
    shift = discs.shift[number]
    return _Level(number, discs.stored == 1, shift[0] != 0.0 or shift[1] != 0.0 or shift[2] != 0.0, discs.reach[number])


@njit(nogil=True, error_model="numpy", forceinline=True)
def _near_box(region, pencil, reach, end):
    """The part of a pencil in the box with a margin, in which discs reach out of it."""
    low, high, o, d = region.lo, region.hi, pencil.origin, pencil.direction
    t0, t1 = _clip(o[0], d[0], low[0] - reach, high[0] + reach, pencil.begin, end)
    t0, t1 = _clip(o[1], d[1], low[1] - reach, high[1] + reach, t0, t1)
    return _clip(o[2], d[2], low[2] - reach, high[2] + reach, t0, t1)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _from_main(main, x, y, z):
    """Numbers of the three axes in the order that begins with the main one."""
    if main == 1:
        return y, z, x
    if main == 2:
        return z, x, y
    return x, y, z


@njit(nogil=True, error_model="numpy", forceinline=True)
def _course(discs, level, pencil, begin, end):
    """The way of a pencil through the lattice of a level."""
    (ox, oy, oz), (dx, dy, dz) = pencil.origin, pencil.direction
    ax, ay, az = abs(dx), abs(dy), abs(dz)
    main = 0
    if ay > ax and ay >= az:
        main = 1
    elif az > ax and az > ay:
        main = 2
    low, high, shift, step = discs.region.lo, discs.region.hi, discs.shift[level.number], discs.step[level.number]
    oa, ob, oc = _from_main(main, ox, oy, oz)
    d = _from_main(main, dx, dy, dz)
    ha, hb, hc = _from_main(main, step[0], step[1], step[2])
    la, lb, lc = _from_main(main, low[0], low[1], low[2])
    wa, wb, wc = _from_main(main, high[0] - low[0], high[1] - low[1], high[2] - low[2])
    sa, sb, sc = _from_main(main, shift[0], shift[1], shift[2])
    first = math.floor(-sa / ha), math.floor(-sb / hb), math.floor(-sc / hc)
    last = (math.ceil((wa - sa) / ha - 1e-9) - 1, math.ceil((wb - sb) / hb - 1e-9) - 1, math.ceil((wc - sc) / hc - 1e-9) - 1)
    s0, s1, s2 = block_steps(discs.cells[level.number, 1], discs.cells[level.number, 2])
    return _Course(main, begin, end, (oa - la - sa, ob - lb - sb, oc - lc - sc), d, (ha, hb, hc), first, last,
                   _from_main(main, s0, s1, s2), _from_main(main, 4, 2, 0))


@njit(nogil=True, error_model="numpy", forceinline=True)
def _layers(course, reach):
    """The first of the layers across the main axis that a pencil goes through, how many, and which way: 1 or -1."""
    q, d, over = course.q[0], course.d[0], 1.0 / course.h[0]
    if d > 0:
        first = max(math.floor((q + course.begin * d - reach) * over), course.low[0])
        return first, min(math.floor((q + course.end * d + reach) * over), course.high[0]) - first + 1, 1
    first = min(math.floor((q + course.begin * d + reach) * over), course.high[0])
    return first, first - max(math.floor((q + course.end * d - reach) * over), course.low[0]) + 1, -1


@njit(nogil=True, error_model="numpy", forceinline=True)
def _crossing(course, layer, sign, reach):
    """Where a pencil comes within reach of a layer, and leaves it."""
    over, h, q = 1.0 / course.d[0], course.h[0], course.q[0]
    near, far = layer * h - reach - q, (layer + 1) * h + reach - q
    return (near * over, far * over) if sign > 0 else (far * over, near * over)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _cells_near(course, enter, leave, reach):
    """The first and the last cells, along the two other axes, within reach of a part of a pencil."""
    _, qb, qc = course.q
    _, db, dc = course.d
    vb, vc = 1.0 / course.h[1], 1.0 / course.h[2]
    y0, y1, z0, z1 = qb + enter * db, qb + leave * db, qc + enter * dc, qc + leave * dc
    rows = (max(math.floor((min(y0, y1) - reach) * vb), course.low[1]),
            min(math.floor((max(y0, y1) + reach) * vb), course.high[1]))
    columns = (max(math.floor((min(z0, z1) - reach) * vc), course.low[2]),
               min(math.floor((max(z0, z1) + reach) * vc), course.high[2]))
    return rows, columns


@njit(nogil=True, error_model="numpy", forceinline=True)
def _cell(discs, level, course, layer, row, column):
    """The cell in a layer, at numbers along the two other axes."""
    low, shift = discs.region.lo, discs.shift[level.number]
    ex, ey, ez = low[0] + shift[0], low[1] + shift[1], low[2] + shift[2]
    i, j, k = layer, row, column
    if level.moved or not level.stored:
        if course.main == 1:
            i, j, k = column, layer, row
        elif course.main == 2:
            i, j, k = row, column, layer
    if not level.stored:
        h = cell_hash(discs.key[level.number], i, j, k)
        return _Cell(i, j, k, h, ex, ey, ez, np.int64(0), cell_count(h, discs.counts[level.number]))
    if level.moved:
        return _repeated(discs, level.number, i, j, k)
    (sa, sb, sc), (ba, bb, bc) = course.stride, course.bits
    cell = discs.start[level.number] + along_axis(layer, sa, ba) + along_axis(row, sb, bb) + along_axis(column, sc, bc)
    return _Cell(i, j, k, np.uint64(0), ex, ey, ez, np.int64(discs.offset[cell]), np.int64(discs.offset[cell + 1]))


@njit(nogil=True, error_model="numpy", forceinline=True)
def _repeated(discs, level, i, j, k):
    """Stored cell (i, j, k) of a lattice that may have moved: the box repeats in it."""
    low, high, shift, cells = discs.region.lo, discs.region.hi, discs.shift[level], discs.cells[level]
    wi, wj, wk = i // cells[0], j // cells[1], k // cells[2]
    i, j, k = i - wi * cells[0], j - wj * cells[1], k - wk * cells[2]
    cell = discs.start[level] + cell_index(i, j, k, cells[1], cells[2])
    return _Cell(i, j, k, np.uint64(0), low[0] + shift[0] + wi * (high[0] - low[0]), low[1] + shift[1] + wj * (high[1] - low[1]),
                 low[2] + shift[2] + wk * (high[2] - low[2]), np.int64(discs.offset[cell]), np.int64(discs.offset[cell + 1]))


@njit(nogil=True, error_model="numpy", forceinline=True)
def _particle(discs, level, cell, p):
    """Centre of particle p of a cell (m), and the numbers that decide on its class and whether it is there."""
    if level.stored:
        return cell.ex + discs.place[p, 0], cell.ey + discs.place[p, 1], cell.ez + discs.place[p, 2], 0.0, 0.0
    u, v, w, chosen, share = cell_particle(cell.hash, p)
    step = discs.step[level.number]
    return cell.ex + (cell.i + u) * step[0], cell.ey + (cell.j + v) * step[1], cell.ez + (cell.k + w) * step[2], chosen, share


@njit(nogil=True, error_model="numpy", forceinline=True)
def _class(discs, level, p, chosen):
    """Class of particle p."""
    if level.stored:
        return np.int64(discs.kind[p])
    kind, after = discs.classes[level.number], discs.classes[level.number + 1]
    while kind < after - 1 and chosen >= discs.cumulated[kind]:
        kind += 1
    return kind


@njit(nogil=True, error_model="numpy", forceinline=True)
def _exists(region, level, x, y, z, share, scratch):
    """Whether a particle that cells list is in the region."""
    if not (level.moved or not level.stored):
        return True
    low, high = region.lo, region.hi
    if not (low[0] <= x < high[0] and low[1] <= y < high[1] and low[2] <= z < high[2]):
        return False
    return level.stored or region.kind == 0 or share < relative_density(region, x, y, z, scratch)


@njit(nogil=True, error_model="numpy", forceinline=True)
def _through_cell(discs, level, cell, pencil, hit, still, open, nearest, scratch):
    """As `_search`, of the particles of a cell."""
    farthest = level.reach * level.reach * (1 + 1e-12)
    (ox, oy, oz), (dx, dy, dz), (sx, sy, sz) = pencil.origin, pencil.direction, pencil.left_out
    for p in range(cell.first, cell.after):
        x, y, z, chosen, share = _particle(discs, level, cell, p)
        gx, gy, gz = x - ox, y - oy, z - oz
        t = gx * dx + gy * dy + gz * dz
        gx, gy, gz = gx - t * dx, gy - t * dy, gz - t * dz
        d2 = gx * gx + gy * gy + gz * gz
        # most are farther than any disc of the level reaches
        if d2 >= farthest or not pencil.begin < t < hit.distance:
            continue
        kind = _class(discs, level, p, chosen)
        if d2 >= discs.largest[kind] or (x == sx and y == sy and z == sz):
            continue
        if not _exists(discs.region, level, x, y, z, share, scratch):
            continue
        if nearest:
            hit = _Hit(kind, t, d2, x, y, z)
        else:
            for w in range(len(open)):
                if open[w] and d2 < discs.square[kind, w]:
                    open[w] = 0
                    still -= 1
            if still == 0:
                return still, hit
    return still, hit


@njit(cache=True, nogil=True, error_model="numpy")
def disc_cells(discs, level):
    """Bounds (6,) int64 of the cells of a level that reach into the box: i, j, k from and to, the last included."""
    out, region = np.empty(6, np.int64), discs.region
    for axis in range(3):
        step, shift = discs.step[level, axis], discs.shift[level, axis]
        out[axis] = math.floor(-shift / step)
        out[3 + axis] = math.ceil((region.hi[axis] - region.lo[axis] - shift) / step - 1e-9) - 1
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def discs_of_cell(discs, level, cell, first, particles, filled, scratch):
    """Particles of a cell (i, j, k) of a level from number `first` on, written to `Particles` from `filled` on.

    Returns how far these are filled, and the number of the particle to go on with, or -1 where the cell is done.
    """
    discs, scratch, (position, kind, identity) = lent(discs), lent(scratch), lent(particles)
    of, (i, j, k) = _level(discs, level), cell
    if of.stored:
        inside = _repeated(discs, level, i, j, k)
    else:
        shift, low, h = discs.shift[level], discs.region.lo, cell_hash(discs.key[level], i, j, k)
        inside = _Cell(i, j, k, h, low[0] + shift[0], low[1] + shift[1], low[2] + shift[2], np.int64(0),
                       cell_count(h, discs.counts[level]))
    p = inside.first + first
    while p < inside.after:
        if filled == len(kind):
            return filled, p - inside.first
        x, y, z, chosen, share = _particle(discs, of, inside, p)
        if _exists(discs.region, of, x, y, z, share, scratch):
            position[filled, 0], position[filled, 1], position[filled, 2], kind[filled] = x, y, z, _class(discs, of, p, chosen)
            identity[filled] = hashed(inside.hash + np.uint64(p + 1) * _PRIME)
            filled += 1
        p += 1
    return filled, -1
