"""Shortcuts through numba's compiler: kernels are what they are without them, and numba is as it was when they are left."""

import functools
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from llvmlite import binding as llvm
from numba import njit as njit_of_numba
from numba.core import base, codegen, compiler, cpu, ir, postproc, types
from numba.core.runtime import _nrt_python, rtsys
from numba.core.runtime.context import NRTContext
from numba.core.typing import templates
from numba.np import arrayobj

from bakery.system import linked, shortcuts
from bakery.system.compiled import Overload, njit

CHANGED = (
    (types.Function, "get_call_type"), (cpu.CPUContext, "refresh"), (ir.Inst, "_rec_list_vars"), (postproc.PostProcessor, "run"),
    (templates._OverloadFunctionTemplate, "_get_jit_decorator"), (llvm.ffi.lib._lock, "_cblist"), (NRTContext, "get_meminfos"),
    (arrayobj, "make_array"), (codegen.CPUCodeLibrary, "add_ir_module"), (cpu.CPUContext, "get_abi_sizeof"),
    (base, "_has_loc"))


def sums(count, values):
    out = np.zeros((count, 2))
    for i, value in enumerate(values):
        out[i % count, 0] += max(value, 1.5)
        out[i % count, 1] += min(i, 3) / value
    return np.sqrt(out)


def numba_now():
    return [vars(owner).get(name) for owner, name in CHANGED]


def test_whether_a_function_takes_loc_is_found_as_numba_finds_it():
    def outer(first, *rest, loc=None):
        loc_within = loc
        return loc_within

    @functools.wraps(outer)
    def wrapped(*rest):
        return outer(*rest)

    def local(first):
        loc = first
        return loc

    functions = [outer, wrapped, local, functools.partial(outer, 1), lambda loc, /: loc, lambda *rest: rest]
    assert [shortcuts._has_loc(function) for function in functions] == [base._has_loc(function) for function in functions]
    assert [shortcuts._has_loc(function) for function in functions] == [True, True, False, True, True, False]


@pytest.mark.slow
def test_kernels_are_what_they_are_without_them_to_the_last_digit():
    values, before = np.linspace(0.1, 4.0, 37), numba_now()
    assert np.array_equal(njit(sums)(5, values), njit_of_numba(sums)(5, values))
    assert numba_now() == before
    with pytest.raises(ValueError, match="negative dimensions"):
        njit(sums)(-1, values)


def test_numba_is_as_it_was_after_an_error():
    before = numba_now()
    with pytest.raises(Exception, match="Cannot unify"):
        njit(lambda x: x + "1" if x > 2 else 1)(1.0)
    assert numba_now() == before


def test_others_get_machine_code_of_what_was_linked():
    def ratio(values):
        return values.size / np.count_nonzero(values)

    linked_in = []

    class Seen(Overload):
        def _link(self, arguments):
            entry = super()._link(arguments)
            linked_in.append(linked.only(self.overloads[arguments]))
            return entry

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bakery.system.compiled.Overload", Seen)
        assert njit(ratio)(np.array([3.0, 0.0])) == 2.0
    assert linked_in
    assert all(linked_in)
    # the same flags: numba takes the dispatchers that ours has left
    assert njit_of_numba(ratio, no_cfunc_wrapper=True)(np.array([3.0, 0.0])) == 2.0


def test_a_kernel_with_other_flags_has_signatures_and_functions_of_its_own():
    def spread(x):
        return max(x[0] * x[1] + 1.0, x[1])

    x = np.array([1 + 2.0**-30, 1 - 2.0**-30])
    assert njit(spread)(x) == max(x[0] * x[1] + 1.0, x[1])
    assert njit(spread, fastmath={"contract"})(x) == pytest.approx(2.0, rel=1e-15)


class Record(NamedTuple):
    values: np.ndarray
    count: int
    inner: tuple[np.ndarray, float]


def rows(record, indices):
    """Reads and writes by negative, unsigned, partial, sliced and boolean indices; arrays of records outlive these."""
    out = np.zeros((record.count, 3))
    for i, index in enumerate(indices):
        out[i] = record.values[index]
        out[-1, i] += record.values[np.uint64(i), -1] * record.inner[1]
        out[i, 1:] *= record.inner[0][::-1][:2]
    out[0][record.values[0] > 0.5] = -1.0
    kept = Record(out[:-1].T, len(out), (record.inner[0][1:], 2.0))
    return kept.values, kept.inner[0]


@pytest.mark.slow
def test_records_and_indexed_arrays_are_what_they_are_without_them():
    values = np.random.default_rng(3).random((4, 3))
    record = Record(values, 4, (np.array([2.0, 3.0, 4.0]), 0.25))
    result = njit(rows)(record, np.array([0, -1, 2]))
    for mine, theirs, plain in zip(result, njit_of_numba(rows)(record, np.array([0, -1, 2])), rows(record, [0, -1, 2])):
        assert np.array_equal(mine, theirs)
        assert np.array_equal(mine, plain)


def test_counts_of_references_are_kept():
    """What a kernel returns is freed with its last name, and what it was given is not."""
    def turned(record):
        first = Record(record.values[::-1].copy(), record.count, (record.inner[0] + 1, 1.0))
        return first, first.values[0]

    kernel, given = njit(turned), Record(np.ones((5, 2)), 5, (np.arange(3.0), 1.0))
    kernel(given)
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        for _ in range(20):
            copy, row = kernel(given)
        assert row.tolist() == [1.0, 1.0]
        del copy, row
        after = rtsys.get_allocation_stats()
    finally:
        _nrt_python.memsys_disable_stats()
    assert after.alloc - before.alloc == after.free - before.free >= 40


def test_variables_of_instructions_are_those_that_numba_lists():
    code = compiler.run_frontend(sums)
    statements = [statement for block in code.blocks.values() for statement in block.body]
    assert statements
    for statement in statements:
        theirs = statement.list_vars()
        assert shortcuts._variables(statement, vars(statement)) == theirs


COMPILING = """
import gc
import numpy as np
from bakery.system.compiled import njit

def looked_at(phase, _):
    if phase == "start":
        young.append(len(gc.get_objects(generation=0)))

young, kernel = [], njit(lambda values: np.sqrt(values[0]) + len(values))
gc.collect()
gc.callbacks.append(looked_at)
assert kernel(np.array([4.0, 1.0])) == 4.0
more = [[] for _ in range(1000)]
assert max(young) < 2000, young
"""


@pytest.mark.slow
def test_compiling_leaves_little_to_collect_at_once():
    """In a process of its own: here all is frozen that there was before the first test.  It was 69,000 objects."""
    done = subprocess.run([sys.executable, "-c", COMPILING], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
