"""Event-driven hard spheres that grow: queue, collisions, neighbour lists, cells of centres.

Lubachevsky & Stillinger 1990; Skoge, Donev, Stillinger & Torquato 2006 (collision rule); Donev, Torquato & Stillinger 2005
(near-neighbour lists).  Each sphere moves inside a fixed ball, its *bubble*, and is tested only against the spheres whose
bubbles touch its own.  It has exactly one pending event: a contact, leaving its bubble, or a check (its partner went elsewhere).
The image of a pair is that of the two bubble centres, so it cannot change between two events of kind leave; in a small cell one
sphere may stand in a list several times, once an image.

Masses are 1.  Positions are kept for clock zero: a pair's distance at t takes no stored time of its own, and `advance` sets the
clock back before that costs digits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.packing._approach import DUE as NEXT
from bakery.physics.packing._approach import LANES, A, B, C, approach, lowest, scratch
from bakery.system.compiled import njit

STRICT = dict(cache=True, nogil=True, error_model="numpy")
INNER = dict(STRICT, forceinline=True)  # a call would copy the whole of `State`: a third of the time of an event
LEAVE, CHECK, NONE = -1, -2, -3  # in place of a partner
CENTRE = 13  # code of the image without shift; CODES - 1 - code is the opposite one
CODES = 27
DEEP = 2000  # nodes of a tree (beyond 4096 spheres) from which memory is asked for ahead: with fewer all stays in the cache
STOPPED, PAUSED, WINDOW, FULL = 0, 1, 2, 3  # why `run` came back
X, V, R, DUE = 0, 3, 6, 7  # columns of `sphere`
FIRST, LAST, ROOM, PARTNER = 4, 5, 6, 7  # columns of `index`; a partner is 32 j + code of j's image, or LEAVE, CHECK, NONE
TIME, SCALE, RATE, VIRIAL, NEAREST, FARTHEST = range(6)  # of `clock`
COLLISIONS, LEAVES, CHECKS = range(3)  # of `tally`


class State(NamedTuple):
    """Everything that the kernels share; N spheres.

    What belongs together lies in one cache line of 64 bytes: with many spheres the time goes into waiting for memory.
    """

    sphere: np.ndarray  # (N, 8): position at clock zero, velocity, final radius, time of the pending event
    bubble: np.ndarray  # (N, 8): centre in [0, cell), radius; the other half is that of `index`
    index: np.ndarray  # (N, 8) integers, the same memory: FIRST, LAST (excluded) and end of ROOM of i's list in `near`, PARTNER
    tree: np.ndarray  # (M, 8): four pending times, whose they are; node n is fed by 4 n + 1 ... 4 n + 4, the last ones by spheres
    near: np.ndarray  # neighbours as 32 j + code of the image
    shift: np.ndarray  # (27, 3): translation of each image
    cell: np.ndarray  # (3,)
    level: np.ndarray  # (N,): class of bubble size
    reach: np.ndarray  # (K,): largest bubble of each class
    cells: np.ndarray  # (K, 3): cells of the grid of each class
    offset: np.ndarray  # (K,): where its heads begin
    head: np.ndarray  # first sphere of each cell of each grid, or -1
    following: np.ndarray  # (N,): next sphere in the cell, or -1
    clock: np.ndarray
    tally: np.ndarray


@intrinsic
def prefetch(typing, address):
    """Ask for the cache line of an address, without waiting; no value depends on it."""

    def code(context, builder, signature, arguments):
        byte, word = ir.PointerType(), ir.IntType(32)
        name = "llvm.prefetch.p0"
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(ir.VoidType(), [byte, word, word, word]), name)
        builder.call(function, [builder.inttoptr(arguments[0], byte), word(0), word(3), word(1)])
        return context.get_dummy_value()

    return types.void(types.uintp), code


@njit(**INNER)
def call_neighbours(st, i):
    """Ask for the records of all neighbours of i at once: from memory, one after the other would cost four times the sums."""
    base = st.sphere.ctypes.data
    for k in range(st.index[i, FIRST], st.index[i, LAST]):
        prefetch(np.uintp(base + 64 * (st.near[k] >> 5)))


@njit(**INNER)
def call_record(st, i):
    """Ask for i's own records and its place in the tree."""
    prefetch(np.uintp(st.bubble.ctypes.data + 64 * i))
    prefetch(np.uintp(st.sphere.ctypes.data + 64 * i))
    prefetch(np.uintp(st.tree.ctypes.data + 64 * leaf_of(st, i)))


@njit(**INNER)
def call_list(st, i):
    """Ask for i's list, half of it where that is long."""
    address = st.near.ctypes.data + 4 * st.index[i, FIRST]
    prefetch(np.uintp(address))
    prefetch(np.uintp(address + 64))


@njit(**INNER)
def call_ahead(st, i):
    """Ask for what the best of the tree's branches around i will need: each of 64 is some 64 events away, and so on.

    Of 64: the record; of 16: the list and the partner's record; of 4: the partner's list.  `run` then asks for the neighbours of
    the next in line.  With 1e5 spheres a collision takes 0.85 us instead of 1.16 us, and 1.9 us without any of this.
    """
    node = leaf_of(st, i)
    while node > 84:
        node = (node - 1) >> 2
    call_record(st, int(st.tree[node, 4 + best_of(st, node)]))
    node = (node - 1) >> 2
    sphere = int(st.tree[node, 4 + best_of(st, node)])
    call_list(st, sphere)
    partner = st.index[sphere, PARTNER]
    if partner >= 0:
        call_record(st, partner >> 5)
    node = (node - 1) >> 2
    partner = st.index[int(st.tree[node, 4 + best_of(st, node)]), PARTNER]
    if partner >= 0:
        call_list(st, partner >> 5)


@njit(**INNER)
def runner_up(st, first):
    """Who is likely to be next: the best of the root's four but the first."""
    best, sphere = np.inf, 0
    for slot in range(4):
        if slot != first and st.tree[0, slot] < best:
            best, sphere = st.tree[0, slot], int(st.tree[0, 4 + slot])
    return sphere


@njit(**STRICT)
def cell_of(st, level, x, y, z):
    """Index of the grid cell that holds a point of [0, cell)."""
    nx, ny, nz = st.cells[level, 0], st.cells[level, 1], st.cells[level, 2]
    i = min(int(x / st.cell[0] * nx), nx - 1)
    j = min(int(y / st.cell[1] * ny), ny - 1)
    k = min(int(z / st.cell[2] * nz), nz - 1)
    return st.offset[level] + (i * ny + j) * nz + k


@njit(**STRICT)
def enter(st, i):
    """Put bubble i into the grid of its class."""
    c = cell_of(st, st.level[i], st.bubble[i, 0], st.bubble[i, 1], st.bubble[i, 2])
    st.following[i] = st.head[c]
    st.head[c] = i


@njit(**STRICT)
def withdraw(st, i):
    """Take bubble i out of the grid of its class."""
    c = cell_of(st, st.level[i], st.bubble[i, 0], st.bubble[i, 1], st.bubble[i, 2])
    if st.head[c] == i:
        st.head[c] = st.following[i]
        return
    k = st.head[c]
    while st.following[k] != i:
        k = st.following[k]
    st.following[k] = st.following[i]


@njit(**STRICT)
def touching(st, i, x, y, z, b, out, most):
    """Images of other spheres than i whose bubbles touch a ball of radius b: their number, entries 32 j + code in `out`.

    Ends when there are more than `most`.  Cells are counted on past the border of the periodic cell: each is another image, so
    small cells need no rule of their own.
    """
    number = 0
    for level in range(st.reach.size):
        nx, ny, nz = st.cells[level, 0], st.cells[level, 1], st.cells[level, 2]
        sx, sy, sz = st.cell[0] / nx, st.cell[1] / ny, st.cell[2] / nz
        far = b + st.reach[level]
        for cx in range(int(np.floor((x - far) / sx)), int(np.floor((x + far) / sx)) + 1):
            ix = -1 if cx < 0 else int(cx >= nx)
            for cy in range(int(np.floor((y - far) / sy)), int(np.floor((y + far) / sy)) + 1):
                iy = -1 if cy < 0 else int(cy >= ny)
                for cz in range(int(np.floor((z - far) / sz)), int(np.floor((z + far) / sz)) + 1):
                    iz = -1 if cz < 0 else int(cz >= nz)
                    j = st.head[st.offset[level] + ((cx - ix * nx) * ny + cy - iy * ny) * nz + cz - iz * nz]
                    while j >= 0:
                        dx = st.bubble[j, 0] + ix * st.cell[0] - x
                        dy = st.bubble[j, 1] + iy * st.cell[1] - y
                        dz = st.bubble[j, 2] + iz * st.cell[2] - z
                        s = b + st.bubble[j, 3]
                        if dx * dx + dy * dy + dz * dz < s * s and j != i:
                            if number == most:
                                return number + 1
                            out[number] = 32 * j + CENTRE + 9 * ix + 3 * iy + iz
                            number += 1
                        j = st.following[j]
    return number


@njit(**STRICT)
def insert(st, begin, uniform):
    """Random sequential addition, spheres `begin` on: how many stand now, how many trials were used.

    uniform (M, 3): one row a trial.  The bubbles are the spheres themselves, at the present scale.
    """
    i, trial, none = begin, 0, st.near[:0]
    while i < st.sphere.shape[0] and trial < uniform.shape[0]:
        x, y, z = uniform[trial, 0] * st.cell[0], uniform[trial, 1] * st.cell[1], uniform[trial, 2] * st.cell[2]
        trial += 1
        if touching(st, i, x, y, z, st.bubble[i, 3], none, np.int64(0)) == 0:
            st.bubble[i, 0], st.bubble[i, 1], st.bubble[i, 2] = x, y, z
            enter(st, i)
            i += 1
    return i, trial


@njit(**INNER)
def best_of(st, node):
    """Which of a node's four times is the first."""
    k = st.tree
    child = 1 if k[node, 1] < k[node, 0] else 0
    right = 3 if k[node, 3] < k[node, 2] else 2
    return right if k[node, right] < k[node, child] else child


@njit(**INNER)
def reschedule(st, i, due):
    """Enter the time of i's pending event into its record and the tree; the walk ends where nothing changes."""
    st.sphere[i, DUE] = due
    node, slot, sphere = leaf_of(st, i), i & 3, float(i)
    while True:
        st.tree[node, slot] = due
        st.tree[node, 4 + slot] = sphere
        if node == 0:
            return
        best = best_of(st, node)
        due, sphere = st.tree[node, best], st.tree[node, 4 + best]
        slot = (node - 1) & 3
        node = (node - 1) >> 2
        if st.tree[node, slot] == due and st.tree[node, 4 + slot] == sphere:
            return


@njit(**INNER)
def leaf_of(st, i):
    """Node of the last level, which begins at M//4, that holds sphere i."""
    return (st.tree.shape[0] >> 2) + (i >> 2)


@njit(**INNER)
def _leaving(st, i, x, y, z, scale):
    """Time until sphere i, now at (x, y, z), leaves its bubble: |q + v tau| = w - g tau, the first root after now."""
    vx, vy, vz, radius = st.sphere[i, V], st.sphere[i, V + 1], st.sphere[i, V + 2], st.sphere[i, R]
    qx, qy, qz = x - st.bubble[i, 0], y - st.bubble[i, 1], z - st.bubble[i, 2]
    w, g = st.bubble[i, 3] - radius * scale, radius * st.clock[RATE]
    a = vx * vx + vy * vy + vz * vz - g * g
    b = qx * vx + qy * vy + qz * vz + w * g
    c = qx * qx + qy * qy + qz * qz - w * w
    root = np.sqrt(max(b * b - a * c, 0.0))
    if b > 0.0:
        return max(-c / (b + root), 0.0)
    if a > 0.0:
        return max((root - b) / a, 0.0)
    return np.inf  # at rest and not growing


@njit(**INNER)
def _touching(a, b, c):
    """The first tau >= 0 at which c + 2 b tau + a tau^2 falls below 0; inf where it never does."""
    if c <= 0.0:  # in touch, within rounding
        if b < 0.0:
            return 0.0
        return -2.0 * b / a if a < 0.0 else np.inf  # growth overtakes: when they are as far apart again as now
    d = b * b - a * c
    if d < 0.0:
        return np.inf
    if b < 0.0:
        return c / (np.sqrt(d) - b)
    return (-b - np.sqrt(d)) / a if a < 0.0 else np.inf


@njit(**INNER)
def _agree(st, i, choice, agreed, due):
    """Enter the next event of sphere i, for its partner too; partners that they had before have to look again."""
    if choice >= 0:
        j = choice >> 5
        if agreed >= 0:
            st.index[agreed >> 5, PARTNER] = CHECK
        if st.index[j, PARTNER] >= 0:
            st.index[st.index[j, PARTNER] >> 5, PARTNER] = CHECK
        st.index[j, PARTNER] = 32 * i + CODES - 1 - (choice & 31)
        reschedule(st, j, due)
    elif agreed >= 0:
        st.index[agreed >> 5, PARTNER] = CHECK
    st.index[i, PARTNER] = choice
    reschedule(st, i, due)


@njit(**INNER)
def predict(st, i, t):
    """Find i's next event after t and enter it, for its partner too; one that a partner has already agreed on is a candidate."""
    scale, rate = st.clock[SCALE] + st.clock[RATE] * t, st.clock[RATE]
    vx, vy, vz, radius = st.sphere[i, V], st.sphere[i, V + 1], st.sphere[i, V + 2], st.sphere[i, R]
    x, y, z = st.sphere[i, X] + vx * t, st.sphere[i, X + 1] + vy * t, st.sphere[i, X + 2] + vz * t

    soon = _leaving(st, i, x, y, z, scale)
    choice = LEAVE
    agreed = st.index[i, PARTNER]
    if agreed >= 0 and st.sphere[i, DUE] - t <= soon:
        soon = st.sphere[i, DUE] - t
        choice = agreed

    moving, now = (x, y, z, vx, vy, vz, radius), (scale, rate, t)
    gaps = scratch()
    gap = carray(gaps, 4 * LANES)
    last = st.index[i, LAST]
    # lists take whole cache lines: what stands behind the last one is some sphere's number, or was
    for first in range(st.index[i, FIRST], last, LANES):
        bits = approach(st.sphere, st.near, first, st.shift, CENTRE, moving, now, soon, gaps)
        bits &= (1 << min(last - first, LANES)) - 1
        while bits != 0:
            k = lowest(bits)
            bits &= bits - 1
            a, b, c = gap[A + k], gap[B + k], gap[C + k]
            until = min(soon, gap[NEXT + k])
            if c > 0.0 and c + until * (2.0 * b + until * min(a, 0.0)) >= 0.0:
                continue  # no longer, for something else comes sooner
            tau = _touching(a, b, c)
            if tau < until:
                soon = tau
                choice = st.near[first + k]

    if choice == agreed and agreed >= 0:
        return
    _agree(st, i, choice, agreed, t + soon)


@njit(**INNER)
def collide(st, i, j, code, t):
    """Elastic collision in the frame of the growing surfaces: the normal velocity u_n becomes 2 G - u_n."""
    si, sj = st.sphere[i], st.sphere[j]
    dx = (si[0] + si[3] * t - st.shift[code, 0]) - (sj[0] + sj[3] * t)
    dy = (si[1] + si[4] * t - st.shift[code, 1]) - (sj[1] + sj[4] * t)
    dz = (si[2] + si[5] * t - st.shift[code, 2]) - (sj[2] + sj[5] * t)
    d = np.sqrt(dx * dx + dy * dy + dz * dz)
    nx, ny, nz = dx / d, dy / d, dz / d
    radii = si[6] + sj[6]
    s, g = radii * (st.clock[SCALE] + st.clock[RATE] * t), radii * st.clock[RATE]
    kick = g - ((si[3] - sj[3]) * nx + (si[4] - sj[4]) * ny + (si[5] - sj[5]) * nz)
    kick = max(kick, 1e-12)  # never 0: the pair must part even where rounding says that it stands still
    si[3] += kick * nx
    si[4] += kick * ny
    si[5] += kick * nz
    sj[3] -= kick * nx
    sj[4] -= kick * ny
    sj[5] -= kick * nz
    si[0] -= kick * nx * t
    si[1] -= kick * ny * t
    si[2] -= kick * nz * t
    sj[0] += kick * nx * t
    sj[1] += kick * ny * t
    sj[2] += kick * nz * t
    st.clock[VIRIAL] += kick * s
    off = d / s - 1.0
    st.clock[NEAREST] = min(st.clock[NEAREST], off)
    st.clock[FARTHEST] = max(st.clock[FARTHEST], off)


@njit(**STRICT)
def recentre(st, i, t):
    """Put the bubble of i around its present place, wrapped into the cell."""
    for k in range(3):
        x = st.sphere[i, X + k] + st.sphere[i, V + k] * t
        turns = np.floor(x / st.cell[k])
        wrapped = x - turns * st.cell[k]
        if wrapped >= st.cell[k] or wrapped < 0.0:  # rounding at the border
            wrapped = 0.0
        st.sphere[i, X + k] += wrapped - x
        st.bubble[i, k] = wrapped


@njit(**STRICT)
def relist(st, i, t):
    """New bubble and list for sphere i, in its neighbours' lists too; False where a list is full."""
    for k in range(st.index[i, FIRST], st.index[i, LAST]):
        j = st.near[k] >> 5
        m, last = st.index[j, FIRST], st.index[j, LAST] - 1
        while m <= last:
            if st.near[m] >> 5 == i:
                st.near[m] = st.near[last]
                last -= 1
            else:
                m += 1
        st.index[j, LAST] = last + 1
    withdraw(st, i)
    recentre(st, i, t)
    enter(st, i)
    if not list_of(st, i):
        return False
    for k in range(st.index[i, FIRST], st.index[i, LAST]):
        j = st.near[k] >> 5
        if st.index[j, LAST] == st.index[j, ROOM]:
            return False
        st.near[st.index[j, LAST]] = 32 * i + CODES - 1 - (st.near[k] & 31)
        st.index[j, LAST] += 1
    return True


@njit(**STRICT)
def list_of(st, i):
    """Fill i's own list; False where it is full."""
    listed = st.near[st.index[i, FIRST]:st.index[i, ROOM]]
    number = touching(st, i, st.bubble[i, 0], st.bubble[i, 1], st.bubble[i, 2], st.bubble[i, 3], listed, listed.size)
    st.index[i, LAST] = st.index[i, FIRST] + min(number, listed.size)
    return number <= listed.size


@njit(**STRICT)
def relist_all(st):
    """Bubbles around the spheres of now, all lists anew; False where one is full.  The clock is at zero."""
    st.head[:] = -1
    for i in range(st.sphere.shape[0]):
        recentre(st, i, 0.0)
        enter(st, i)
    complete = True
    for i in range(st.sphere.shape[0]):
        complete = complete and list_of(st, i)
    return complete


@njit(**STRICT)
def predict_all(st):
    """Forget all events and find them anew at clock zero."""
    count = st.sphere.shape[0]
    st.tree[:, :4] = np.inf
    st.tree[:, 4:] = -1.0
    for i in range(count):
        st.sphere[i, DUE] = np.inf
        st.index[i, PARTNER] = NONE
    for i in range(count):
        predict(st, i, 0.0)


@njit(**STRICT)
def advance(st):
    """Bring all spheres to the clock's time and set it to zero; returns twice the kinetic energy, at zero total momentum."""
    t = st.clock[TIME]
    count = st.sphere.shape[0]
    twice = 0.0
    for k in range(3):
        drift = 0.0
        for i in range(count):
            st.sphere[i, X + k] += st.sphere[i, V + k] * t
            drift += st.sphere[i, V + k]
        drift /= count
        for i in range(count):
            st.sphere[i, V + k] -= drift
            twice += st.sphere[i, V + k] ** 2
    st.clock[SCALE] += st.clock[RATE] * t
    st.clock[TIME] = 0.0
    return twice


@njit(**STRICT)
def run(st, stop, collisions, events):
    """Handle events up to a time, a number of collisions in all, or a number of events, and say which it was."""
    handled = 0
    deep = st.tree.shape[0] > DEEP
    ahead = -1
    while True:
        first = best_of(st, 0)
        t = st.tree[0, first]
        if t >= stop:
            st.clock[TIME] = stop
            return STOPPED
        if st.tally[COLLISIONS] >= collisions:
            st.clock[TIME] += 0.5 * (t - st.clock[TIME])  # between two events, where no pair is in touch
            return WINDOW
        if handled >= events:
            return PAUSED
        handled += 1
        i = int(st.tree[0, 4 + first])
        st.clock[TIME] = t
        partner = st.index[i, PARTNER]
        partner_left = -1
        if deep:
            if i != ahead:
                call_neighbours(st, i)
                if partner >= 0:
                    call_neighbours(st, partner >> 5)
            second = runner_up(st, first)
            if second != ahead:
                ahead = second
                call_neighbours(st, second)
                if st.index[second, PARTNER] >= 0:
                    call_neighbours(st, st.index[second, PARTNER] >> 5)
        if partner >= 0:
            partner_left = partner >> 5
            collide(st, i, partner_left, partner & 31, t)
            st.tally[COLLISIONS] += 1
            st.index[i, PARTNER] = NONE
            st.index[partner_left, PARTNER] = NONE
            st.sphere[i, DUE] = np.inf
            st.sphere[partner_left, DUE] = np.inf
        elif partner == LEAVE:
            st.tally[LEAVES] += 1
            if not relist(st, i, t):
                return FULL
        else:
            st.tally[CHECKS] += 1
        first_changed, second_changed = i, partner_left
        while i >= 0:  # one call of `predict` in the code, for it is compiled in place
            predict(st, i, t)
            i, partner_left = partner_left, -1
        if deep:
            while first_changed >= 0:
                call_ahead(st, first_changed)
                first_changed, second_changed = second_changed, -1
