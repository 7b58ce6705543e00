"""The scatterometer's two engines, numba and Mitsuba (Embree, Dr.Jit): python benchmarks/scatterometer_mitsuba.py [PATHS]

Both follow the same entries through the same grains, in turn, each in blocks of the size that `measure` gives it, on one thread
(least CPU seconds of the rounds) and on two (least wall seconds).  Ratios: Mitsuba's time over numba's.  With --rates: paths that
contradict themselves, by how far off the surface rays start and by Embree's mode.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]
os.environ["HOME"] = tempfile.mkdtemp()  # Dr.Jit keeps compiled kernels there: here each is compiled

import numpy as np  # noqa: E402
from scatterometer import rock  # noqa: E402

from bakery.physics.grains.bvh import Mesh  # noqa: E402
from bakery.physics.grains.mitsuba_walk import MitsubaWalker, _modules  # noqa: E402
from bakery.physics.grains.points import points, scrambled  # noqa: E402
from bakery.physics.grains.surface import conductor, dielectric, diffuse  # noqa: E402
from bakery.physics.grains.walk import CONTRADICTED, Walker  # noqa: E402
from benchmarks.sizes import sized  # noqa: E402

ROUNDS, BLOCK = sized(3, 1), 8192
SURFACES = {"glass": dielectric(1.5), "rough glass": dielectric(1.5, 0.2), "white": diffuse(1.0),
            "copper": conductor([0.27 + 3.41j, 1.03 + 2.59j, 1.25 + 2.48j], 0.3)}
TABLE, SHIFT = scrambled(np.random.default_rng(0))


def followed(walker, paths, pool):
    """Meetings and contradictions of all paths."""
    block = getattr(walker, "batch", BLOCK)

    def task(first):
        found = walker.trace(points(TABLE, SHIFT, first, min(block, paths - first)), first, 0, (1, 2))
        return found.events.sum(), np.count_nonzero(found.status == CONTRADICTED)

    return np.sum(list((pool.map if pool else map)(task, range(0, paths, block))), axis=0)


def speed(paths):
    dr = _modules()[1]
    print("| triangles | surface | threads | numba, s | Mitsuba, s | ratio | compiling, s | meetings a path: numba | Mitsuba | "
          "contradicted |\n|" + "---|" * 10)
    for n in sized((32, 100), (4,)):
        vertices, faces = rock(n)
        mesh = Mesh(vertices, faces)
        for name, surface in SURFACES.items():
            mu = np.zeros(surface.channels.shape[1])
            walkers = {"numba": Walker(mesh, surface, mu), "mitsuba": MitsubaWalker(vertices, faces, surface, mu)}
            followed(walkers["numba"], 1000, None)
            with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
                dr.kernel_history_clear()
                followed(walkers["mitsuba"], 1000, None)
                compiling = sum(k["codegen_time"] + k["backend_time"] for k in dr.kernel_history([dr.KernelType.JIT])) / 1e3
            for threads, clock in ((1, time.process_time), (2, time.perf_counter)):
                dr.set_thread_count(threads)
                spent, found = {key: [] for key in walkers}, {}
                for _ in range(ROUNDS):
                    for key, walker in walkers.items():
                        with ThreadPoolExecutor(threads) as pool:
                            begin = clock()
                            found[key] = followed(walker, paths, pool if threads > 1 else None)
                            spent[key].append(clock() - begin)
                numba, mitsuba = min(spent["numba"]), min(spent["mitsuba"])
                events, wrong = found["mitsuba"] / paths
                print(f"| {len(faces)} | {name} | {threads} | {numba:.2f} | {mitsuba:.2f} | {mitsuba / numba:.2f} | "
                      f"{compiling:.2f} | {found['numba'][0] / paths:.4f} | {events:.4f} | {wrong:.0e} |", flush=True)


def rates(paths):
    import bakery.physics.grains.mitsuba_walk as engine

    mi = _modules()[0]
    load = mi.load_dict
    print("| triangles | robust | off the surface, R | contradicted |\n|---|---|---|---|")
    for n in sized((32, 100), (4,)):
        vertices, faces = rock(n)
        for robust in (True, False):
            engine._SCENES.clear()
            mi.set_variant(engine.VARIANT)
            mi.load_dict = lambda d: load(d | {"embree_use_robust_intersections": robust} if d["type"] == "scene" else d)
            for exponent in (23, 21, 18):
                engine._OFF = 2.0**-exponent
                count = followed(MitsubaWalker(vertices, faces, SURFACES["glass"], 0.0), paths, None)[1]
                print(f"| {len(faces)} | {robust} | 2^-{exponent} | {count / paths:.1e} |", flush=True)


if __name__ == "__main__":
    asked = [int(float(word)) for word in sys.argv[1:] if not word.startswith("--")]
    (rates if "--rates" in sys.argv else speed)(asked[0] if asked else sized(1_000_000, 2000))
