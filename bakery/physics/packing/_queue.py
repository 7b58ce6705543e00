"""The queue of events, a tree of pending times, and memory that is asked for before it is needed."""

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.packing._lists import DUE, FIRST, INNER, LAST, PARTNER
from bakery.system.compiled import njit


@njit(**INNER)
def leaf_of(st, i):
    """Node of the last level, which begins at M//4, that holds sphere i."""
    return (st.tree.shape[0] >> 2) + (i >> 2)


@njit(**INNER)
def best_of(st, node):
    """Which of a node's four times is the first."""
    k = st.tree
    child = 1 if k[node, 1] < k[node, 0] else 0
    right = 3 if k[node, 3] < k[node, 2] else 2
    return right if k[node, right] < k[node, child] else child


@njit(**INNER)
def runner_up(st, first):
    """Who is likely to be next: the best of the root's four but the first."""
    best, sphere = np.inf, 0
    for slot in range(4):
        if slot != first and st.tree[0, slot] < best:
            best, sphere = st.tree[0, slot], int(st.tree[0, 4 + slot])
    return sphere


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
