"""Pencils of light among discs: which particle stops one first, and at which wavelengths it gets through.

A particle stops a pencil at a wavelength if its centre is nearer to it than the radius of its disc, sqrt(C_ext / pi), and if the
foot of the perpendicular from its centre lies between the pencil's ends.  Among particles at independent places the share of
pencils that get through a distance s is exp(-sigma_t s), for any sizes.

A pencil goes through the lattice of a level in layers across its main axis; in each it looks through the cells that it passes
nearer than the level's largest disc, so a particle is listed once, in the cell of its centre, and need not be stored at all.
"""

from __future__ import annotations

import math

import numpy as np

from bakery.physics.discrete.hashing import cell_count, cell_hash, cell_particle
from bakery.physics.discrete.levels import along_axis, block_steps, cell_index
from bakery.physics.discrete.region import relative_density
from bakery.physics.packing.instances import hashed
from bakery.system.compiled import njit

NO_DISC = -1
_PRIME = np.uint64(0xD1B54A32D192ED03)


@njit(cache=True, nogil=True, error_model="numpy")
def first_disc(discs, ox, oy, oz, dx, dy, dz, begin, end, sx, sy, sz, room):
    """The first particle whose disc, the largest of all wavelengths, stops a pencil.

    Parameters
    ----------
    discs : `Discs`
    ox, oy, oz, dx, dy, dz : origin (m) and unit direction
    begin, end : m, distances between which (begin excluded) feet of perpendiculars count; end may be inf
    sx, sy, sz : place of a particle that is left out, as this function gave it; nan: none
    room : from `mesh_scratch`

    Returns
    -------
    class : int, or NONE
    distance : m, of the foot; `end` where there is none
    square : m^2, squared distance of the centre from the pencil
    x, y, z : m, centre
    """
    best = end
    hit, square, x, y, z = NO_DISC, 0.0, 0.0, 0.0, 0.0
    nobody = np.empty(0, np.uint8)
    for level in range(len(discs.reach)):
        kind, t, d2, px, py, pz = _search(discs, level, ox, oy, oz, dx, dy, dz, begin, best, sx, sy, sz, nobody, True, room)
        if kind != NO_DISC:
            hit, best, square, x, y, z = kind, t, d2, px, py, pz
    return hit, best, square, x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def open_wavelengths(discs, ox, oy, oz, dx, dy, dz, begin, end, sx, sy, sz, open, room):
    """At how many wavelengths a pencil gets through; arguments as in `first_disc`.

    open : (L,) uint8, 1 where the pencil is still open; becomes 0 at each wavelength at which a disc stops it
    """
    left = 0
    for w in range(len(open)):
        left += open[w]
    for level in range(len(discs.reach)):
        if left == 0:
            return 0
        left = _search(discs, level, ox, oy, oz, dx, dy, dz, begin, end, sx, sy, sz, open, False, room)[0]
    return left



@njit(cache=True, nogil=True, error_model="numpy")
def _clip(o, d, low, high, begin, end):
    """The part of (begin, end) in which o + t d is between low and high."""
    if d == 0.0:
        return (begin, end) if low <= o <= high else (1.0, 0.0)
    a, b = (low - o) / d, (high - o) / d
    return max(begin, min(a, b)), min(end, max(a, b))


@njit(cache=True, nogil=True, error_model="numpy")
def _search(discs, level, ox, oy, oz, dx, dy, dz, begin, end, sx, sy, sz, open, nearest, room):
    """One level.  nearest: (class, distance, squared distance, centre) of the first disc; else (wavelengths still open, ...)."""
    region = discs.region
    stored, reach = discs.stored == 1, discs.reach[level]
    lo, hi, shift = region.lo, region.hi, discs.shift[level]
    first_class, after_class = discs.classes[level], discs.classes[level + 1]
    left = 0
    if not nearest:
        for w in range(len(open)):
            left += open[w]
    hit, best, square, fx, fy, fz = NO_DISC, end, 0.0, 0.0, 0.0, 0.0
    # the box with a margin in which discs reach out of it
    t0, t1 = _clip(ox, dx, lo[0] - reach, hi[0] + reach, begin, end)
    t0, t1 = _clip(oy, dy, lo[1] - reach, hi[1] + reach, t0, t1)
    t0, t1 = _clip(oz, dz, lo[2] - reach, hi[2] + reach, t0, t1)
    if not t0 < t1:
        return (hit if nearest else left), best, square, fx, fy, fz
    # axis a: the main one
    ax, ay, az = abs(dx), abs(dy), abs(dz)
    a, b, c = 0, 1, 2
    oa, ob, oc, da, db, dc = ox, oy, oz, dx, dy, dz
    if ay > ax and ay >= az:
        a, b, c = 1, 2, 0
        oa, ob, oc, da, db, dc = oy, oz, ox, dy, dz, dx
    elif az > ax and az > ay:
        a, b, c = 2, 0, 1
        oa, ob, oc, da, db, dc = oz, ox, oy, dz, dx, dy
    step, cells = discs.step[level], discs.cells[level]
    ha, hb, hc = step[a], step[b], step[c]
    # from the corner of the lattice, which moves with its particles
    qa, qb, qc = oa - lo[a] - shift[a], ob - lo[b] - shift[b], oc - lo[c] - shift[c]
    a_low, a_high = math.floor(-shift[a] / ha), math.ceil((hi[a] - lo[a] - shift[a]) / ha - 1e-9) - 1
    b_low, b_high = math.floor(-shift[b] / hb), math.ceil((hi[b] - lo[b] - shift[b]) / hb - 1e-9) - 1
    c_low, c_high = math.floor(-shift[c] / hc), math.ceil((hi[c] - lo[c] - shift[c]) / hc - 1e-9) - 1
    moved = shift[0] != 0.0 or shift[1] != 0.0 or shift[2] != 0.0
    va, vb, vc = 1.0 / ha, 1.0 / hb, 1.0 / hc
    over = 1.0 / da
    if da > 0:
        layer, last, sign = math.floor((qa + t0 * da - reach) * va), math.floor((qa + t1 * da + reach) * va), 1
        layer, last = max(layer, a_low), min(last, a_high)
        layers = last - layer + 1
    else:
        layer, last, sign = math.floor((qa + t0 * da + reach) * va), math.floor((qa + t1 * da - reach) * va), -1
        layer, last = min(layer, a_high), max(last, a_low)
        layers = layer - last + 1
    key, table, base = discs.key[level], discs.counts[level], discs.start[level]
    n0, n1, n2 = cells[0], cells[1], cells[2]
    s0, s1, s2 = block_steps(n1, n2)
    # the three axes in the order a, b, c
    sa, sb, sc, ba, bb, bc = s0, s1, s2, 4, 2, 0
    if a == 1:
        sa, sb, sc, ba, bb, bc = s1, s2, s0, 2, 0, 4
    elif a == 2:
        sa, sb, sc, ba, bb, bc = s2, s0, s1, 0, 4, 2
    h0, h1, h2 = step[0], step[1], step[2]
    place, offset, farthest = discs.place, discs.offset, reach * reach * (1 + 1e-12)
    partial = region.kind != 0
    for _ in range(layers):
        if sign > 0:
            enter, leave = (layer * ha - reach - qa) * over, ((layer + 1) * ha + reach - qa) * over
        else:
            enter, leave = ((layer + 1) * ha + reach - qa) * over, (layer * ha - reach - qa) * over
        if nearest and enter > best:
            break
        enter, leave = max(enter, t0), min(leave, min(t1, best))
        y0, y1 = qb + enter * db, qb + leave * db
        z0, z1 = qc + enter * dc, qc + leave * dc
        j_low, j_high = math.floor((min(y0, y1) - reach) * vb), math.floor((max(y0, y1) + reach) * vb)
        k_low, k_high = math.floor((min(z0, z1) - reach) * vc), math.floor((max(z0, z1) + reach) * vc)
        cell_a = base + along_axis(layer, sa, ba)
        for jb in range(max(j_low, b_low), min(j_high, b_high) + 1):
            cell_b = cell_a + along_axis(jb, sb, bb)
            for kc in range(max(k_low, c_low), min(k_high, c_high) + 1):
                ex, ey, ez = lo[0] + shift[0], lo[1] + shift[1], lo[2] + shift[2]
                i, j, k, h = layer, jb, kc, np.uint64(0)
                if moved or not stored:
                    if a == 1:
                        i, j, k = kc, layer, jb
                    elif a == 2:
                        i, j, k = jb, kc, layer
                if stored:
                    cell = cell_b + along_axis(kc, sc, bc)
                    if moved:  # the box repeats in the moving lattice
                        wi, wj, wk = i // n0, j // n1, k // n2
                        cell = base + cell_index(i - wi * n0, j - wj * n1, k - wk * n2, n1, n2)
                        ex, ey, ez = ex + wi * (hi[0] - lo[0]), ey + wj * (hi[1] - lo[1]), ez + wk * (hi[2] - lo[2])
                    begins, after = np.int64(offset[cell]), np.int64(offset[cell + 1])
                else:
                    h = cell_hash(key, i, j, k)
                    begins, after = np.int64(0), cell_count(h, table)
                for p in range(begins, after):
                    chosen, share = 0.0, 0.0
                    if stored:
                        px, py, pz = ex + place[p, 0], ey + place[p, 1], ez + place[p, 2]
                    else:
                        u, v, w, chosen, share = cell_particle(h, p)
                        px, py, pz = ex + (i + u) * h0, ey + (j + v) * h1, ez + (k + w) * h2
                    gx, gy, gz = px - ox, py - oy, pz - oz
                    t = gx * dx + gy * dy + gz * dz
                    gx, gy, gz = gx - t * dx, gy - t * dy, gz - t * dz
                    d2 = gx * gx + gy * gy + gz * gz
                    # most are farther than any disc of the level reaches
                    if d2 >= farthest or not begin < t < best:
                        continue
                    kind = first_class
                    if stored:
                        kind = np.int64(discs.kind[p])
                    else:
                        while kind < after_class - 1 and chosen >= discs.cumulated[kind]:
                            kind += 1
                    if d2 >= discs.largest[kind] or (px == sx and py == sy and pz == sz):
                        continue
                    if moved or not stored:
                        if not (lo[0] <= px < hi[0] and lo[1] <= py < hi[1] and lo[2] <= pz < hi[2]):
                            continue
                        if partial and not stored and share >= relative_density(region, px, py, pz, room):
                            continue
                    if nearest:
                        hit, best, square, fx, fy, fz = kind, t, d2, px, py, pz
                    else:
                        for w in range(len(open)):
                            if open[w] and d2 < discs.square[kind, w]:
                                open[w] = 0
                                left -= 1
                        if left == 0:
                            return left, best, square, fx, fy, fz
        layer += sign
    return (hit if nearest else left), best, square, fx, fy, fz


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
def discs_of_cell(discs, level, i, j, k, first, place, kind, identity, filled, room):
    """Particles of cell (i, j, k) of a level from number `first` on, written from `filled` on.

    place : (n, 3) m;  kind : (n,) class;  identity : (n,) uint64, of each particle the same however it moves

    Returns how far these are filled, and the number of the particle to go on with, or -1 where the cell is done.
    """
    region, step, cells, shift = discs.region, discs.step[level], discs.cells[level], discs.shift[level]
    lo, hi = region.lo, region.hi
    ex, ey, ez = lo[0] + shift[0], lo[1] + shift[1], lo[2] + shift[2]
    moved = shift[0] != 0.0 or shift[1] != 0.0 or shift[2] != 0.0
    h, begin, after = np.uint64(0), np.int64(0), np.int64(0)
    if discs.stored == 1:
        wi, wj, wk = i // cells[0], j // cells[1], k // cells[2]
        i, j, k = i - wi * cells[0], j - wj * cells[1], k - wk * cells[2]
        ex, ey, ez = ex + wi * (hi[0] - lo[0]), ey + wj * (hi[1] - lo[1]), ez + wk * (hi[2] - lo[2])
        cell = discs.start[level] + cell_index(i, j, k, cells[1], cells[2])
        begin, after = np.int64(discs.offset[cell]), np.int64(discs.offset[cell + 1])
    else:
        h = cell_hash(discs.key[level], i, j, k)
        after = cell_count(h, discs.counts[level])
    p = begin + first
    while p < after:
        if filled == len(kind):
            return filled, p - begin
        share = 0.0
        if discs.stored == 1:
            px, py, pz = ex + discs.place[p, 0], ey + discs.place[p, 1], ez + discs.place[p, 2]
            one = np.int64(discs.kind[p])
        else:
            u, v, w, chosen, share = cell_particle(h, p)
            px, py, pz = ex + (i + u) * step[0], ey + (j + v) * step[1], ez + (k + w) * step[2]
            one = discs.classes[level]
            while one < discs.classes[level + 1] - 1 and chosen >= discs.cumulated[one]:
                one += 1
        p += 1
        if moved or discs.stored == 0:
            if not (lo[0] <= px < hi[0] and lo[1] <= py < hi[1] and lo[2] <= pz < hi[2]):
                continue
            if region.kind != 0 and discs.stored == 0 and share >= relative_density(region, px, py, pz, room):
                continue
        place[filled, 0], place[filled, 1], place[filled, 2], kind[filled] = px, py, pz, one
        identity[filled] = hashed(h + np.uint64(p) * _PRIME)
        filled += 1
    return filled, -1
