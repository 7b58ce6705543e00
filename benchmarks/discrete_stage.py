"""Stored realisations against plain NumPy: python benchmarks/discrete_stage.py [PARTICLES]

Both draw as many particles with radii of the same log-normal law in a cube and sort them by cells of about one; NumPy draws and
sorts all at once, we class by class and block by block.  Processor seconds of one core, medians of three rounds in turn; memory
is what a process of its own needs at most beyond what it had; bytes in the file are those of the group as it is stored.
"""

import math
import subprocess
import sys
import time
from pathlib import Path
from statistics import median

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

import numpy as np  # noqa: E402

from bakery.physics.discrete import classes, realise, statistics  # noqa: E402
from bakery.physics.shapes.radial import icosphere  # noqa: E402
from bakery.physics.sizes import Lognormal, Population  # noqa: E402
from bakery.physics.sizes.distributions import Part  # noqa: E402
from bakery.store.image import image  # noqa: E402
from bakery.store.tree import Dataset, Group  # noqa: E402
from benchmarks.sizes import sized  # noqa: E402

ROUNDS = sized(3, 1)
SIZES = Population((Part(Lognormal(5.0, 1.5), 1.0),))
CUBE = realise.Region((1.0, 1.0, 1.0))


def plain(number, seed):
    """All at once."""
    random = np.random.default_rng(seed)
    place = random.random((number, 3), np.float32)
    radius = random.lognormal(math.log(5.0), math.log(1.5), number).astype(np.float32)
    cells = round(number ** (1 / 3))
    index = np.minimum((place * cells).astype(np.int64), cells - 1)
    order = np.argsort((index[:, 0] * cells + index[:, 1]) * cells + index[:, 2], kind="stable")
    return place[order], radius[order]


def ours(number, seed, region=CUBE):
    made = classes.classes(SIZES)
    counts = realise.numbers(seed, made.share, 0.0, number)
    return realise.realised(region, counts, seed), np.repeat(made.radius.astype(np.float32), counts)


def ball():
    vertices, faces = icosphere(1280)
    vertices = 0.5 * (vertices - vertices.min(axis=0))
    return realise.Region(tuple(vertices.max(axis=0)), None, vertices, faces)


def grid():
    density = np.random.default_rng(0).random((32, 32, 32)).astype(np.float32)
    return realise.Region((1.0, 1.0, 1.0), density / density.max())


KINDS = {"NumPy": plain, "ours": ours, "ours, grid of 32^3": lambda number, seed: ours(number, seed, grid()),
         "ours, mesh of 1,280": lambda number, seed: ours(number, seed, ball())}


def memory(kind, number):
    """Bytes a particle that a process of its own needs at most, beyond what it had."""
    code = ("import sys, benchmarks.discrete_stage as b; b.KINDS[sys.argv[1]](1000, 0); a = b.peak(); "
            "b.KINDS[sys.argv[1]](int(sys.argv[2]), 0); print(b.peak() - a)")
    out = subprocess.run([sys.executable, "-c", code, kind, str(number)], capture_output=True, text=True, check=True,
                         cwd=Path(__file__).resolve().parents[1])
    return float(out.stdout) / number


def peak():
    """Bytes of memory at most so far; ru_maxrss would begin with that of the process that called this one."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return 1024 * int(line.split()[1])


def seconds(function, *arguments):
    start = time.process_time()
    function(*arguments)
    return time.process_time() - start


def main(number):
    for function in KINDS.values():
        function(1000, 0)  # compiles
    rounds = [{kind: seconds(function, number, seed) for kind, function in KINDS.items()} for seed in range(ROUNDS)]
    taken = {kind: median(one[kind] for one in rounds) for kind in KINDS}
    print(f"| {number:,} particles | ns a particle | of NumPy's | bytes a particle in memory |\n" + "|---" * 4 + "|")
    for kind, each in taken.items():
        print(f"| {kind} | {1e9 * each / number:.0f} | {each / taken['NumPy']:.2f} | {memory(kind, number):.1f} |")
    place, radius = ours(number, 0)
    group = Group({"position": Dataset(place, "m", "centres"), "radius": Dataset(radius, "um", "radii"),
                   "component": Dataset(np.zeros(number, np.uint8), "1", "components")})
    figure = statistics.dispersion(*statistics.in_cells(CUBE, place))
    print(f"\n{len(image(group)) / number:.2f} bytes a particle in the file; dispersion of counts {figure.value:.4f} +- "
          f"{figure.error:.4f}")


if __name__ == "__main__":
    main(int(float(sys.argv[1])) if len(sys.argv) > 1 else sized(10**6, 10**4))
