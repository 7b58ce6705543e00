"""Kernels that only other kernels call have no machine code of their own, and are what they are with it."""

import numpy as np
import pytest
from numba import njit as njit_of_numba

from bakery.system import linked
from bakery.system.compiled import njit

TABLE = np.array([2.0, 3.0, 5.0])


@njit
def entry(i):
    if i > 2:
        raise ValueError("no such entry")  # kept where the constants of the function are
    return TABLE[i]


@njit
def twice(i):
    return 2 * entry(i)


@njit
def thrice(i):
    return twice(i) + entry(i)


@njit
def factorial(n):
    return 1 if n < 2 else n * factorial(n - 1)


@njit
def below(n):
    return factorial(n) - 1


@njit
def even(n):
    return True if n == 0 else odd(n - 1)


@njit
def odd(n):
    return False if n == 0 else even(n - 1)


@njit(fastmath={"contract"})
def plus(x, y):
    return x * y + 1.0


@njit
def minus(x):
    return plus(x, x) - 1.0


@njit_of_numba
def of_numba(i):
    return half(i) + 1


@njit
def half(i):
    return entry(i) / 2


def is_linked(kernel) -> list[bool]:
    return [linked.only(result) for result in kernel.overloads.values()]


def test_what_kernels_call_is_linked_and_gets_machine_code_when_python_calls_it():
    assert thrice(1) == 9.0
    assert is_linked(thrice) == [False]
    assert is_linked(twice) == is_linked(entry) == [True]
    with pytest.raises(ValueError, match="no such entry"):
        thrice(3)
    assert twice(2) == 10.0
    assert is_linked(twice) == [False]
    assert is_linked(entry) == [True]
    with pytest.raises(ValueError, match="no such entry"):
        twice(4)
    assert thrice(2) == 15.0


def test_a_kernel_that_calls_itself_is_linked_and_of_two_that_call_each_other_none():
    assert below(4) == 23
    assert is_linked(factorial) == [True]
    assert even(10)
    assert not even(7)
    assert is_linked(even) == is_linked(odd) == [False]


def test_a_kernel_whose_sums_hang_on_optimisations_is_optimised_by_itself():
    assert minus(3.0) == 9.0
    assert is_linked(plus) == [False]


def test_a_kernel_of_others_may_call_ours():
    assert of_numba(2) == 3.5
    assert is_linked(half) == [False]


def test_flags_are_those_of_numba():
    ours, theirs = linked._Flags(), linked.compiler.Flags()
    assert ours == theirs
    assert hash(ours) == hash(theirs)
    ours.no_compile = False  # its default
    assert ours == theirs
    ours.no_compile = True
    assert ours != theirs
    assert ours.copy() == ours
    theirs.no_compile = True
    assert theirs == ours
