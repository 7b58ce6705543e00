"""What this machine allows: python -m benchmarks.limits

Rates of one core in processor time, the best of many tries: what bounds a kernel is the largest of its counted operations over
the rate of each kind (docs/measurements/limits.md).
"""

import time

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from bakery.physics.mie.vector import Memory, Wide
from bakery.system.compiled import njit
from benchmarks.sizes import sized

LANES = 8  # doubles of the widest vectors


def _repeated(*operations):
    """A loop whose every step does `operation(value, factor)` to a vector of its own, for each of the operations."""

    @intrinsic
    def loop(typingctx, numbers, count):
        def codegen(context, builder, signature, args):
            rows = Memory(context, builder, signature.args[0], args[0], LANES)
            slots = [cgutils.alloca_once_value(builder, rows[1].value) for _ in operations]
            factor = rows[0]
            with cgutils.for_range(builder, args[1]):
                for slot, operation in zip(slots, operations):
                    builder.store(operation(Wide(builder, builder.load(slot)), factor).value, slot)
            total = Wide(builder, builder.load(slots[0]))
            for slot in slots[1:]:
                total = total + Wide(builder, builder.load(slot))
            rows[1] = total
            return context.get_dummy_value()

        return types.void(numbers, types.intp), codegen

    return loop


def _product(value, factor):
    return value.times_plus(factor, factor)


def _quotient(value, factor):
    return Wide(value.builder, value.builder.fdiv(factor.value, value.value))


_products, _quotients = _repeated(*[_product] * 16), _repeated(*[_quotient] * 8)
_many_products, _both = _repeated(*[_product] * 24), _repeated(*([_product] * 12 + [_quotient]) * 2)


@njit(nogil=True)
def multiply_add(numbers, count):
    """16 chains of fused multiply-adds, `count` steps."""
    _products(numbers, count)


@njit(nogil=True)
def divide(numbers, count):
    """8 chains of quotients, `count` steps."""
    _quotients(numbers, count)


@njit(nogil=True)
def multiply_only(numbers, count):
    """24 chains of fused multiply-adds, `count` steps."""
    _many_products(numbers, count)


@njit(nogil=True)
def multiply_and_divide(numbers, count):
    """24 chains of fused multiply-adds and two of quotients, `count` steps."""
    _both(numbers, count)


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
    numbers[:] = 0.9
    alone = best(lambda: multiply_only(numbers, count))
    numbers[:] = 0.9
    rates["quotients among products"] = 2 * LANES * count / max(best(lambda: multiply_and_divide(numbers, count)) - alone, 1e-9)
    for name, size in (("bytes of the second cache", 20_000), ("bytes of memory", 8_000_000)):
        target, source = np.ones((2, sized(size, 1000)))
        times = max(1, sized(4_000_000, 1000) // size)

        def often(target=target, source=source, times=times):
            for _ in range(times):
                add_to(target, source)

        rates[name] = 3 * 8 * target.size * times / best(often, sized(10, 2))
    return rates


def mie(rates):
    """Kernels of Mie on one core: (name, operations, seconds of the bound, measured seconds)."""
    from bakery.physics.mie import angular, coefficients, cosines, fourier, legendre

    product, quotient, byte = (1.0 / rates[kind] for kind in ("multiply-adds", "quotients among products", "bytes of memory"))
    x = np.linspace(0.1, 1000.0, sized(10_000, 32))
    orders, out = sum(coefficients.terms(size) for size in x), np.empty((5, x.size))
    yield ("efficiencies, 10,000 sizes, m = 1.33", "an order: 21 products, 2 quotients", orders * (21 * product + 2 * quotient),
           best(lambda: coefficients.efficiency_block(1.33 + 0j, x, *out)))
    size, theta = sized(20_000.0, 200.0), np.linspace(0.0, np.pi, sized(1801, 20))
    last, pairs = coefficients.terms(size), np.empty((1, theta.size, 4))
    yield (f"recurrence of angles, x = {size:,.0f}", "an order and angle: 9 products", 9 * last * theta.size * product,
           best(lambda: angular.amplitude_block(1.33 + 0j, np.array([size]), theta, pairs), sized(10, 1)))
    size = sized(200_000.0, 600.0)
    last = coefficients.terms(size)
    grid = fourier.blocks(np.array([size]), np.array([0]))[0][0]
    _, (_, h, tree, values) = fourier._memory(last, 1, grid)
    between = np.zeros(5 * values.size)
    h[:], tree[:], values[:] = 0.0, 0.0, 0.0
    table, tables, only = legendre.ratios(2 * h.shape[3] + 4 * legendre.LEAF), legendre.box_tables(), np.array([last])
    yield (f"transform, boxes nearby, x = {size:,.0f}", "an order: 88 targets of 5 products", 440 * last * product,
           best(lambda: [legendre._near(h, parity, table, only) for parity in range(2)], sized(10, 1)))
    yield ("transform, boxes and their tree", "an order: 1080 products", 1080 * last * product,
           best(lambda: legendre.legendre_to_fourier(h, only, table, tables, tree), sized(10, 1)))
    flops = 4 * 2.5 * grid * np.log2(grid)
    yield ("transform, cosines", "four series, 2.5 n log2 n sums and products; memory written and read twice",
           max(0.5 * flops * product, 4 * values.nbytes * byte), best(lambda: cosines.cosine_sums(values, between), sized(10, 1)))


def main():
    print("| one core, a second | 1e9 |\n|---|---|")
    rates = machine()
    for kind, rate in rates.items():
        print(f"| {kind} | {rate / 1e9:.2f} |", flush=True)
    print("\n| kernel | operations | bound, ms | measured, ms | reached |\n|---|---|---|---|---|")
    for name, operations, bound, seconds in mie(rates):
        print(f"| {name} | {operations} | {bound * 1e3:.2f} | {seconds * 1e3:.2f} | {bound / seconds:.2f} |", flush=True)


if __name__ == "__main__":
    main()
