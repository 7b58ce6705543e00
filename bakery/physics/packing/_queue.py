"""The queue of events, a calendar, and memory that is asked for before it is needed.

After Paul, J. Comput. Phys. 221, 615 (2007): a year of buckets of equal time, of which only the open one is in order.  An entry
says that something may happen to a sphere at a time.  None is taken out: it counts if that is still the sphere's pending event
then.  Where a year ends, the next one is written from the spheres' records.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.packing._lists import DUE, FIRST, INNER, LAST, STRICT
from bakery.system.compiled import njit

BEGIN, PACE = 0, 1  # of `year`
OPEN, USED = 0, 1  # of `page`
OWNER, NEXT = 2, 3  # columns of `link`
ENTRIES, BUCKETS = 4, 2  # of a year, a sphere; at least 2 entries; twice as many leave the second cache sooner
BUSY = 4.0  # buckets a sphere in the mean time until a pending event: about one event a bucket
AHEAD = 4  # buckets that pass while memory comes; twice as many, or half, are as good


@njit(**INNER)
def push(st, sphere, due):
    """Enter a pending event, under the first sphere of a pair; not beyond the year, nor without an entry left, which ends it."""
    bucket = (due - st.year[BEGIN]) * st.year[PACE]
    entry = st.page[USED]
    if bucket >= st.bucket.shape[0] or entry == st.entry.shape[0]:
        return
    st.page[USED] = entry + 1
    st.entry[entry, 0] = due
    st.link[entry, OWNER] = sphere
    k = int(bucket)
    if k > st.page[OPEN]:
        st.link[entry, NEXT] = st.bucket[k]
        st.bucket[k] = entry
    else:
        _sort_in(st, entry)


@njit(**INNER)
def _sort_in(st, entry):
    """Put an entry into the open bucket: in order of time, at equal times of spheres."""
    due, sphere = st.entry[entry, 0], st.link[entry, OWNER]
    before, after = -1, st.bucket[st.page[OPEN]]
    while after >= 0 and (st.entry[after, 0] < due or st.entry[after, 0] == due and st.link[after, OWNER] < sphere):
        before, after = after, st.link[after, NEXT]
    st.link[entry, NEXT] = after
    if before >= 0:
        st.link[before, NEXT] = entry
    else:
        st.bucket[st.page[OPEN]] = entry


@njit(**STRICT)
def _new_year(st, now):
    """Enter all pending events from now on; False where there is none."""
    count = st.sphere.shape[0]
    total, pending, earliest = 0.0, 0, np.inf
    for i in range(count):
        if st.sphere[i, DUE] < np.inf:
            total += st.sphere[i, DUE] - now
            pending += 1
            earliest = min(earliest, st.sphere[i, DUE])
    if pending == 0:
        return False
    st.year[BEGIN] = earliest  # not now: all of few spheres may be due after a year of half their mean, which would be empty
    st.year[PACE] = BUSY * pending / max(total / pending, 1e-300)
    st.bucket[:] = -1
    st.page[USED] = st.page[OPEN] = 0
    for i in range(count):
        partner = st.partner[i]
        if partner < 0 or i <= partner >> 5:
            push(st, i, st.sphere[i, DUE])
    return True


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
def _call_neighbours(st, i):
    """Ask for the records of all neighbours of i at once: from memory, one after the other would cost four times the sums."""
    base = st.sphere.ctypes.data
    for k in range(st.index[i, FIRST], st.index[i, LAST]):
        prefetch(np.uintp(base + 64 * (st.near[k] >> 5)))


@njit(**INNER)
def _call_record(st, i):
    """Ask for i's own records."""
    prefetch(np.uintp(st.sphere.ctypes.data + 64 * i))
    prefetch(np.uintp(st.bubble.ctypes.data + 64 * i))


@njit(**INNER)
def _call_list(st, i):
    """Ask for i's list, half of it where that is long."""
    address = st.near.ctypes.data + 4 * st.index[i, FIRST]
    prefetch(np.uintp(address))
    prefetch(np.uintp(address + 64))


@njit(**INNER)
def _call_ahead(st):
    """Ask for what the buckets to come need, each step for nearer ones, where the step before has come.

    Entries; their spheres; partners of these, and lists; the partners' lists; all neighbours.
    """
    ahead = st.page[OPEN] + AHEAD
    if ahead + 4 * AHEAD >= st.bucket.shape[0]:
        return
    if st.bucket[ahead + 4 * AHEAD] >= 0:
        prefetch(np.uintp(st.entry.ctypes.data + 16 * st.bucket[ahead + 4 * AHEAD]))
    for step in range(4):
        entry = st.bucket[ahead + step * AHEAD]
        while entry >= 0:
            sphere = np.int64(st.link[entry, OWNER])  # of one type with partners, so that what follows is compiled once
            if step == 3:
                _call_record(st, sphere)
            elif st.sphere[sphere, DUE] == st.entry[entry, 0]:
                _call_step(st, sphere, step)
            entry = st.link[entry, NEXT]


@njit(**INNER)
def _call_step(st, sphere, step):
    """One of the last three steps for a sphere and who it will meet."""
    partner = st.partner[sphere] >> 5
    if step == 2:
        _call_list(st, sphere)
        if partner >= 0:
            _call_record(st, partner)
    elif step == 1:
        if partner >= 0:
            _call_list(st, partner)
    else:
        _call_neighbours(st, sphere)
        if partner >= 0:
            _call_neighbours(st, partner)


@njit(**INNER)
def _open_next(st, deep):
    """Open the next bucket, or end the year."""
    st.page[OPEN] += 1
    if st.page[OPEN] == st.bucket.shape[0]:
        st.page[USED] = st.entry.shape[0]
        return
    if deep:
        _call_ahead(st)
    entry = st.bucket[st.page[OPEN]]
    st.bucket[st.page[OPEN]] = -1
    while entry >= 0:
        after = st.link[entry, NEXT]
        if st.sphere[st.link[entry, OWNER], DUE] == st.entry[entry, 0]:
            _sort_in(st, np.int64(entry))  # as `push` does: for another type it would be compiled again
        entry = after


@njit(**INNER)
def next_event(st, now, deep):
    """Sphere of the next pending event, the first one of a pair; -1 where nothing will ever happen."""
    while True:
        if st.page[USED] == st.entry.shape[0] and not _new_year(st, now):
            return -1
        entry = st.bucket[st.page[OPEN]]
        while entry >= 0:
            sphere = st.link[entry, OWNER]
            if st.sphere[sphere, DUE] == st.entry[entry, 0]:
                st.bucket[st.page[OPEN]] = entry
                return sphere
            entry = st.link[entry, NEXT]
        _open_next(st, deep)
