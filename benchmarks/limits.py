"""What this machine allows: python -m benchmarks.limits

Rates of one core in processor time, the best of many tries: what bounds a kernel is the largest of its counted operations over
the rate of each kind (docs/measurements/limits.md).
"""

from __future__ import annotations

import time

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.mie.vector import Memory, Wide
from bakery.system.compiled import njit
from benchmarks.sizes import sized

LANES = 8  # doubles of the widest vectors


def _repeated(operation, chains):
    """A loop whose every step does `operation(value, factor)` to each of `chains` independent vectors."""

    @intrinsic
    def loop(typingctx, numbers, count):
        def codegen(context, builder, signature, args):
            rows = Memory(context, builder, signature.args[0], args[0], LANES)
            slots = [cgutils.alloca_once_value(builder, rows[1].value) for _ in range(chains)]
            factor = rows[0]
            with cgutils.for_range(builder, args[1]):
                for slot in slots:
                    builder.store(operation(Wide(builder, builder.load(slot)), factor).value, slot)
            total = Wide(builder, builder.load(slots[0]))
            for slot in slots[1:]:
                total = total + Wide(builder, builder.load(slot))
            rows[1] = total
            return context.get_dummy_value()

        return types.void(numbers, types.intp), codegen

    return loop


_products, _quotients = _repeated(lambda value, factor: value.times_plus(factor, factor), 16), _repeated(
    lambda value, factor: Wide(value.builder, value.builder.fdiv(factor.value, value.value)), 8)


@njit(nogil=True)
def multiply_add(numbers, count):
    """16 chains of fused multiply-adds, `count` steps."""
    _products(numbers, count)


@njit(nogil=True)
def divide(numbers, count):
    """8 chains of quotients, `count` steps."""
    _quotients(numbers, count)


@njit(nogil=True)
def add_to(target, source):
    """One array added to another: two are read and one is written."""
    for i in range(target.size):
        target[i] += source[i]


def best(job, rounds=sized(30, 2)):
    """Least processor seconds of one call."""
    job()
    seconds = []
    for _ in range(rounds):
        start = time.process_time()
        job()
        seconds.append(time.process_time() - start)
    return min(seconds)


def machine():
    """Rates of one core: {kind: per second}."""
    numbers, count = np.full(2 * LANES, 0.9), sized(400_000, 1000)
    rates = {"multiply-adds": 16 * LANES * count / best(lambda: multiply_add(numbers, count))}
    numbers[:] = 0.9
    rates["quotients"] = 8 * LANES * (count // 8) / best(lambda: divide(numbers, count // 8))
    for name, size in (("bytes of the second cache", 20_000), ("bytes of memory", 8_000_000)):
        target, source = np.ones((2, sized(size, 1000)))
        times = max(1, sized(4_000_000, 1000) // size)

        def often(target=target, source=source, times=times):
            for _ in range(times):
                add_to(target, source)

        rates[name] = 3 * 8 * target.size * times / best(often, sized(10, 2))
    return rates


def main():
    print("| one core, a second | 1e9 |\n|---|---|")
    for kind, rate in machine().items():
        print(f"| {kind} | {rate / 1e9:.2f} |", flush=True)


if __name__ == "__main__":
    main()
