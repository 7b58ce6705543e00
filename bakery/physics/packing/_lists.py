"""Hard spheres of a periodic cell in memory: their record, cells of centres, and lists of neighbours.

Near-neighbour lists: Donev, Torquato & Stillinger 2005.  Each sphere moves inside a fixed ball, its *bubble*, and is tested only
against the spheres whose bubbles touch its own.  The image of a pair is that of the two bubble centres, so it cannot change
between two events of kind leave; in a small cell one sphere may stand in a list several times, once an image.
"""

from typing import NamedTuple

import numpy as np

from bakery.system.compiled import njit

# no arrays are created here, so none are counted: numba's counters cost up to a sixth of the time
STRICT = dict(cache=True, nogil=True, error_model="numpy", _nrt=False)
INNER = dict(STRICT, forceinline=True)  # a call would copy the whole of `State`: a third of the time of an event
CENTRE = 13  # code of the image without shift; CODES - 1 - code is the opposite one
CODES = 27
X, V, R, DUE = 0, 3, 6, 7  # columns of `sphere`
FIRST, LAST, ROOM = 4, 5, 6  # columns of `index`


class State(NamedTuple):
    """Everything that the kernels share; N spheres.

    What belongs together lies in one cache line of 64 bytes: with many spheres the time goes into waiting for memory.
    """

    sphere: np.ndarray  # (N, 8): position at clock zero, velocity, final radius, time of the pending event
    bubble: np.ndarray  # (N, 8): centre in [0, cell), radius; the other half is that of `index`
    index: np.ndarray  # (N, 8) integers, the same memory: FIRST, LAST (excluded) and end of ROOM of i's list in `near`
    partner: np.ndarray  # (N,): 32 j + code of the image of whom a sphere will meet next, or one of `_events`
    entry: np.ndarray  # (E, 2): time of an event; the other half is that of `link`
    link: np.ndarray  # (E, 4) integers, the same memory: in the last two the sphere, and the next entry in its bucket, or -1
    bucket: np.ndarray  # (B,): first entry of each bucket, or -1
    year: np.ndarray  # (2,): time at which it begins, buckets a time
    page: np.ndarray  # (2,): the open bucket, entries of the year so far
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
