"""Metropolis with tables: candidates a second, and noise in light of three and more events beside other methods.

    python -m benchmarks.metropolis_tables [--small] [--scenes wax wax_glass bumpy_ball] [--size 48] [--seconds 6] [--pilots]

Scenes: a ball of published wax (Wang, Ge and Holzschuch 2018) of 8 mean free paths in radius under a panel, matched or of glass,
and shipped ones.  A row a method, which take turns, for so many processor seconds each: light of three and more events over that
of the first, with its standard error; paths, mutations or candidates a second of two cores, of these passes alone; noise in light
of three and more events after 1000 of them a pixel; processor seconds to a noise of 1 % of a pixel, root mean square, over the
picture's mean, in all light and in that of three and more events; and the noise in the latter over `metropolis` at equal time,
without what pixels lose by sharing (layers `closer_even`, `closer_odd`), less in each pass.  --small: 16 pixels wide, a second.

--pilots: what pilots of so many seconds tell `auto` of a picture of so many pixels a side: processor seconds to a noise of 1 % in
all light, and how the kinds of passes share them.
"""

import argparse
from types import SimpleNamespace

import numpy as np

from benchmarks.figures_translucent import stand
from benchmarks.figures_translucent.mutations import MUTATIONS
from benchmarks.sizes import sized
from benchmarks.transport import WAX
from renderers.choice import trial
from renderers.materials.bodies import methods
from renderers.mitsuba import variants

METHODS = "metropolis", "vrl+tables", "metropolis+tables", "metropolis+tables, none"
PILOTED = "paths", "vrl+tables", "metropolis", "metropolis+tables"
BALLS = {"wax": (1.0, 8), "wax_glass": (1.4, 8), "wax_large": (1.0, 32)}  # refractive index, radius in mean free paths
ROUNDS, CORES = 2, 2


def setup(scene, size):
    """How light goes."""
    if scene not in BALLS:
        return stand.shipped(scene, size)
    albedo, free_path, g = WAX
    index, radius = BALLS[scene]
    how = stand.ball(stand.medium(albedo, g), index, size, stand.PANEL)
    return stand.thicker(how, radius * free_path[1] / np.array(free_path))


def a_second(run):
    """Paths, mutations or candidates of two cores; None where beams are gathered."""
    (*others, last) = run.parts
    if hasattr(last.render, "count"):
        count = last.render.count * last.count / (last.count + 1)  # less the pass that compiles
    elif others:
        return None
    else:
        group = last.render.group
        count = last.count * (group.candidates + group.chains * group.steps)
    return CORES * count / last.seconds


def rows(scene, size, seconds):
    """Measures a scene and prints its rows."""
    how = setup(scene, size)
    runs = {method: stand.Run(how, method) for method in METHODS}
    stand.together(runs, dict.fromkeys(runs, seconds), ROUNDS)
    later = {method: run.found(stand.LATER) for method, run in runs.items()}
    first = later[METHODS[0]]
    for method, run in runs.items():
        ratio = (1.0, first.error / first.total) if method == METHODS[0] else stand.ratio(later[method], first)
        speed = a_second(run)
        drawn = speed and speed * run.parts[-1].seconds / CORES / size**2  # a pixel
        noise = f"{100 * later[method].noise * np.sqrt(drawn / MUTATIONS):.2g}" if speed else ""
        times = [stand.of_seconds(light.seconds) for light in (run.found(), later[method])]
        print(f"| {scene} | `{method}` | {stand.over(*ratio)} | {f'{speed:.2g}' if speed else ''} | {noise} | {times[0]} | "
              f"{times[1]} | {np.sqrt(later[method].seconds / first.seconds):.2g} |", flush=True)


def pilots(scene, size, seconds):
    """Tries methods in a scene as `auto` does and prints a row of each."""
    whole = setup(scene, size)
    for method in PILOTED:
        piloted = trial.of(lambda world, seed, method=method: SimpleNamespace(
            parts=methods.parts(whole._replace(world=world), method, "negative", seed)), whole.world, seconds)
        by_kind = np.sqrt([cost.pixel * (cost.fixed + cost.by_pixel * size**2) for cost in piloted.costs])
        shares = ", ".join(f"{share:.2f}" for share in by_kind / by_kind.sum())
        print(f"| {scene} | `{method}` | {stand.of_seconds(1e4 * piloted.rate(size**2))} | {shares} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=sized(["wax", "wax_glass", "bumpy_ball"], ["bumpy_ball"]))
    parser.add_argument("--size", type=int, default=sized(48, 16), help="pixels a side, a multiple of 8")
    parser.add_argument("--seconds", type=float, default=sized(6.0, 1.0))
    parser.add_argument("--pilots", action="store_true")
    args = parser.parse_args()
    print(variants.activate("rgb"))
    if args.pilots:
        print("| scene | method | noise 1 % after, s | shares of its kinds of passes |\n|" + "---|" * 4, flush=True)
        for scene in args.scenes:
            pilots(scene, args.size, args.seconds)
        return
    print("| scene | method | three and more events over `metropolis` | a second of two cores | noise after 1000 a pixel, % | "
          "noise 1 % after, s | of three and more events | error over `metropolis`, equal time |\n|" + "---|" * 8, flush=True)
    for scene in args.scenes:
        rows(scene, args.size, args.seconds)


if __name__ == "__main__":
    main()
