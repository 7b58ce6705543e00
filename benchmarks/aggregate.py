"""What rays and paths among the grains of a mesh cost, for numbers of grains from ten to 1e12.

    python benchmarks/aggregate.py                   processor time of one core, without compilation

A dented ball is filled with copies of a tile of 500 spheres at fraction 0.6.  Rays go through its surroundings from outside: time
to find the first sphere, and each next one; whole paths of glass balls and of stones (320 facets), index 1.5, and of the medium,
sigma_t 0.45 in 1/radius, in light from everywhere; the aggregate fills the picture.
"""

import argparse
import resource
import time

import numpy as np

from benchmarks.sizes import sized
from tests.physics.particles import Sky, camera
from tests.physics.test_aggregate import bumpy, rays, tile, walked
from tests.physics.test_granular_medium import continuous
from tests.physics.test_granular_render import GLASS, STONE, Kind, grains, passes, place

SIZE, COUNT, NEXT = sized((96, 4000, 32), (8, 40, 4))
NUMBERS = sized((1e1, 1e3, 1e5, 1e7, 1e9, 1e12), (1e1, 1e9))


def spent(function, *arguments):
    """Seconds of the processor, of the second call."""
    function(*arguments)
    begin = time.process_time()
    result = function(*arguments)
    return time.process_time() - begin, result


def row(number, spheres):
    size = (number / len(spheres[1]) * np.prod(spheres[2]) / 4.2) ** (1 / 3)
    mesh = bumpy(size)
    begin = time.process_time()
    balls = grains([Kind(GLASS)], mesh, spheres)
    setup = time.process_time() - begin
    origin, direction = rays(mesh[0], COUNT, 1)
    first, _ = spent(walked, balls.aggregate, origin, direction, np.inf, 1)
    several, (_, found) = spent(walked, balls.aggregate, origin, direction, np.inf, NEXT)
    met = int(np.isfinite(found).sum() - np.isfinite(found[:, 0]).sum())
    view, sky = camera((SIZE, SIZE), (0.0, -5.0 * size, 0.0), (0.0, 0.0, 0.0), 10), Sky(above=1, below=1)
    thick = continuous(0.45, 1.0, mesh=mesh)
    paths = [spent(passes, sky, how, view, (SIZE, SIZE), [0])[0] / SIZE**2
             for how in (place(balls), place(grains([Kind(GLASS, STONE)], mesh, spheres)),
                         thick)] if number <= 1e7 else [None] * 3
    return [f"{number:.0e}", f"{setup:.2f}", f"{balls.aggregate.voxels.nbytes / 2**20:.2f}", f"{1e6 * first / COUNT:.2f}",
            f"{1e6 * (several - first) / max(met, 1):.2f}", *("" if one is None else f"{1e6 * one:.0f}" for one in paths)]


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print("| grains | setup, s | voxels, MiB | first sphere, us | each next, us | path of balls, us | stones | the medium |")
    print("|---" * 8 + "|")
    spheres = tile(0.6, sized(500, 60))
    for number in NUMBERS:
        print("| " + " | ".join(row(number, spheres)) + " |", flush=True)
    print(f"\n{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB of memory in all")


if __name__ == "__main__":
    main()
