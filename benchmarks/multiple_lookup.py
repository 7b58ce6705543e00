"""Time of look-ups in tables of multiple scattering: one by one, in sums, plainly, in Dr.Jit; and of queries.

    python benchmarks/multiple_lookup.py [lookups] [queries] [drjit]      all three if none is named; two minutes

Places and directions without order; the shortest of several turns, processor time of one core but for Dr.Jit.  `plain` is the
look-up as one would write it: functions of the C library, and a loop over the functions of the table.
"""

import math
import sys
import time
from functools import cache
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np  # noqa: E402
from numba import njit  # noqa: E402

from bakery import kernels  # noqa: E402
from bakery.errors import UsageError  # noqa: E402
from bakery.physics.multiple import build, frame, legendre, locate, lookup, queries, solution, sums  # noqa: E402
from bakery.physics.multiple.kinds import KINDS  # noqa: E402
from bakery.system import llvm  # noqa: E402
from benchmarks.sizes import sized  # noqa: E402

MEDIA = sized(((0.7, 0.95), (0.9, 0.93)), ((0.3, 0.9), (0.5, 0.9)))
# look-ups, queries, and those of Dr.Jit, which gives a core no fewer than 16384
COUNT, LINES, WIDE = sized((300_000, 4_000, 32_768), (500, 20, 32))


def shortest(jobs, rounds, clock=time.process_time):
    """Seconds of each job {name: function}, one call each in turn, after one call to warm up."""
    for job in jobs.values():
        job()
    seconds = dict.fromkeys(jobs, math.inf)
    for _ in range(rounds):
        for name, job in jobs.items():
            start = clock()
            job()
            seconds[name] = min(seconds[name], clock() - start)
    return seconds


@cache
def tables(g, albedo):
    solved = solution.solve(albedo, legendre.henyey_greenstein(g, 200))
    return [lookup.ready(build.table(solved, kind, extent=32.0)) for kind in (0, 1)]


def units(random, count):
    v = random.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


# ---- one look-up


@njit(nogil=True, error_model="numpy")
def plain(table, rho, z, x, y, along, a):
    m, tangent, singular, sine, cosine = locate.place(table.kind, table.length, max(rho, frame.CLOSEST), z)
    s, t = locate.direction(sine, cosine, x, y, along)
    grid, basis = table.grid, table.basis
    u = math.asinh(m / frame.CORE[table.kind]) * table.stretch * (grid.shape[0] - 3)
    v = (2 / math.pi) * math.atan(frame.SKEW[table.kind] * tangent) * (grid.shape[1] - 3)
    s, t = s * (basis.shape[0] - 1), t * (basis.shape[1] - 1)
    i, j = min(int(u), grid.shape[0] - 4), min(int(v), grid.shape[1] - 4)
    k, l = min(int(s), basis.shape[0] - 2), min(int(t), basis.shape[1] - 2)
    p, w, s, t = cubic(u - i), cubic(v - j), s - k, t - l
    for f in range(len(a)):
        a[f] = 0
    for n in range(4):
        for m in range(4):
            weight = np.float32(p[n] * w[m])
            for f in range(len(a)):
                a[f] += weight * grid[i + n, j + m, f]
    total = 0.0
    for f in range(len(a)):
        b = ((1 - s) * ((1 - t) * basis[k, l, f] + t * basis[k, l + 1, f])
             + s * ((1 - t) * basis[k + 1, l, f] + t * basis[k + 1, l + 1, f]))
        total += a[f] * b if f else a[f] + b
    return singular * math.exp(total)


@njit(nogil=True, error_model="numpy")
def cubic(t):
    return (t * (-0.5 + t * (1 - 0.5 * t)), 1 + t * t * (1.5 * t - 2.5), t * (0.5 + t * (2 - 1.5 * t)), t * t * (0.5 * t - 0.5))


@njit(nogil=True, error_model="numpy")
def plainly(table, places, out):
    a = np.empty(table.grid.shape[2], np.float32)
    for n in range(len(out)):
        out[n] = plain(table, places[0, n], places[1, n], places[2, n], places[3, n], places[4, n], a)


@njit(nogil=True, error_model="numpy")
def singly(table, places, out):
    for n in range(len(out)):
        out[n] = kernels.point_source(table, places[0, n], places[1, n], places[2, n], places[3, n], places[4, n])


@njit(nogil=True, error_model="numpy")
def summed(table, places, out):
    to = sums.no_look_ups()
    for n in range(len(out)):
        sums.add_look_up(to, table, places[0, n], places[1, n], places[2, n], places[3, n], places[4, n], 1.0)
    out[0] = sums.sum_of_look_ups(to, table)


def lookups():
    random = np.random.default_rng(1)
    r, mu = np.exp(random.uniform(math.log(0.1), math.log(30), COUNT)), random.uniform(-1, 1, COUNT)
    places, out = np.array([r * np.sqrt(1 - mu * mu), r * mu, *units(random, COUNT).T]), np.empty((2, COUNT))
    print("\n| g | source | functions | plain, ns | one by one, ns | in a sum, ns | differ, rms |\n|---|---|---|---|---|---|---|")
    for g, albedo in MEDIA:
        for kind, table in enumerate(tables(g, albedo)):
            seconds = shortest({"plain": lambda: plainly(table, places, out[0]), "single": lambda: singly(table, places, out[1]),
                                "sum": lambda: summed(table, places, np.empty(COUNT))}, 15)
            near = r < 0.9 * table.extent
            differ = math.sqrt(np.mean((out[1] / out[0] - 1)[near]**2))
            print(f"| {g:g} | {KINDS[kind]} | {np.abs(table.basis).max(axis=(0, 1)).astype(bool).sum() - 1} | "
                  + " | ".join(f"{1e9 * s / COUNT:.0f}" for s in seconds.values()) + f" | {differ:.1e} |", flush=True)


# ---- queries


def asked(points, segments, module, count):
    """The queries, by name, of a module or of Dr.Jit's tables."""
    random = np.random.default_rng(2)
    (o, e), axis, v = 2 * random.normal(size=(2, count, 3)), units(random, count), units(random, count)
    distance = random.uniform(0.5, 8, count)
    one, two = ((points,), (points, segments)) if module is queries else ((), ())
    jobs = {"point at a point": lambda: module.point_to_point(*one, o, axis, e, v)}
    lengths = {"1.3": 1.3, "5": 5.0, "one tile": segments.length, "pencil": math.inf}
    jobs |= {f"{name} at a point": lambda length=length: module.segment_to_point(*two, o, axis, length, e, v)
             for name, length in lengths.items()}
    jobs["point along a line"] = lambda: module.point_to_segment(*one, o, axis, e, v, distance)
    jobs |= {f"{name} along a line": lambda length=length: module.segment_to_segment(*two, o, axis, length, e, v, distance)
             for name, length in lengths.items()}
    return jobs


def times_of_queries():
    found = {g: shortest(asked(*tables(g, albedo), queries, LINES), 5) for g, albedo in MEDIA}
    print("\n| us a query | " + " | ".join(f"g = {g:g}" for g in found) + " |\n|" + "---|" * (len(found) + 1))
    for name in found[MEDIA[0][0]]:
        print(f"| {name} | " + " | ".join(f"{1e6 * seconds[name] / LINES:.2f}" for seconds in found.values()) + " |")


# ---- Dr.Jit


class Arrays:
    """The queries of Dr.Jit on arrays of NumPy; waits for the answer."""

    def __init__(self, dr, number, vector, points, segments):
        self._dr, self._number, self._vector = dr, number, vector
        self._tables, self._known = kernels.drjit_tables(points, segments, number), {}

    def __getattr__(self, name):
        def query(*arguments):
            self._dr.eval(getattr(self._tables, name)(*(self._there(x) for x in arguments)))
            self._dr.sync_thread()

        return query

    def _there(self, x):
        if id(x) not in self._known:
            wide = self._vector(x.T) if np.ndim(x) == 2 else self._number(np.broadcast_to(x, WIDE).copy())
            self._dr.eval(wide)
            self._known[id(x)] = wide, x
        return self._known[id(x)][0]


def times_in_drjit():
    llvm.find()
    try:
        import drjit as dr
        from drjit import llvm as kinds

        kernels.drjit_tables(*tables(*MEDIA[0]), kinds.Float)
    except (ImportError, UsageError) as error:
        print(f"Dr.Jit: {error}; its rows are left out")
        return
    found = {}
    for g, albedo in MEDIA:
        jobs = asked(*tables(g, albedo), Arrays(dr, kinds.Float, kinds.Array3f, *tables(g, albedo)), WIDE)
        for threads in (1, 2):
            dr.set_thread_count(threads)
            found[g, threads] = shortest({name: jobs[name] for name in jobs if name[0] == "p"}, 2, time.perf_counter)
    titles = " | ".join(f"g = {g:g}, {threads} threads" for g, threads in found)
    print(f"\n| us a query, Dr.Jit | {titles} |\n|" + "---|" * (len(found) + 1))
    for name in next(iter(found.values())):
        print(f"| {name} | " + " | ".join(f"{1e6 * seconds[name] / WIDE:.2f}" for seconds in found.values()) + " |")


if __name__ == "__main__":
    parts = {"lookups": lookups, "queries": times_of_queries, "drjit": times_in_drjit}
    began = time.perf_counter()
    for name in sys.argv[1:] or parts:
        parts[name]()
    print(f"\n{time.perf_counter() - began:.0f} s")
