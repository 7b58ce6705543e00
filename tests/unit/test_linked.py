"""Kernels that only other kernels call have no machine code of their own, and are what they are with it."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from numba import njit as njit_of_numba

from bakery.system import linked
from bakery.system.compiled import njit
from tests.conftest import ROOT

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


KEPT = """
from typing import NamedTuple

from bakery.system.compiled import njit


class Both(NamedTuple):
    twice: float
    half: float


@njit(cache=True)
def both(x):
    if x < 0:
        raise ValueError("below")
    return Both(2 * x, x / 2)


@njit(cache=True)
def total(x):
    return both(x).twice + both(x).half
"""
USE = """
from bakery.system import linked, sources
sources.PACKAGES = (*sources.PACKAGES, "toy")
from toy.kept import both, total


def compile_nothing(*arguments):
    raise AssertionError("compiled from source")


def below():
    try:
        both(-1.0)
    except ValueError as error:
        return str(error)
"""


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


@pytest.mark.slow
def test_machine_code_is_made_of_what_another_process_kept_for_linking(tmp_path):
    (tmp_path / "toy").mkdir()
    (tmp_path / "toy" / "__init__.py").touch()
    (tmp_path / "toy" / "kept.py").write_text(KEPT)

    def run(line):
        environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
        environment.pop("NUMBA_CACHE_DIR", None)
        return subprocess.run([sys.executable, "-c", USE + line], env=environment, capture_output=True, text=True,
                              check=True).stdout.strip()

    assert run("print(total(2.0))") == "5.0"
    assert run("linked.compiler.compile_extra = compile_nothing\nprint(*both(2.0), below())") == "4.0 1.0 below"
    # and from there it is linked
    assert run("from bakery.system.compiled import njit\nprint(njit(lambda x: both(x).half)(4.0), *both(4.0))") == "2.0 8.0 2.0"
