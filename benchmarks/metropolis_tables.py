"""Metropolis with tables: candidates a second, and noise in light of three and more events beside other methods.

    python -m benchmarks.metropolis_tables [--small] [--scenes wax wax_glass bumpy_ball] [--methods metropolis metropolis+tables]
                                           [--size 48] [--seconds 30 120] [--light three] [--picture FILE] [--pilots]

Scenes: a ball of published wax (Wang, Ge and Holzschuch 2018) of 8 mean free paths in radius under a panel, matched or of glass,
shipped ones, and `caustic` (`stand.caustic`).  A row a method and time, methods in turns, of light of three and more events, of
which passes are run alone, or with --light of one and more, or all: processor seconds; this light over that of the first method,
with its standard error; paths, mutations or candidates a second of two cores; noise after 1000 of them a pixel; processor seconds
to a noise of 1 % of a pixel, root mean square, over the picture's mean; noise now; what pixels lose by sharing (layers
`closer_even`, `closer_odd`); and both together over the noise of the first method at equal time.  All methods but the last stop
after the first of the seconds.  --small: 16 pixels wide, a second.

--pilots: what pilots of so many seconds tell `auto` of a picture of so many pixels a side: processor seconds to a noise of 1 % in
all light, and how the kinds of passes share them.
"""

import argparse
from types import SimpleNamespace

import numpy as np
from matplotlib import image

from benchmarks.figures_translucent import stand
from benchmarks.figures_translucent.mutations import MUTATIONS
from benchmarks.sizes import sized
from benchmarks.transport import WAX
from renderers.choice import trial
from renderers.materials.bodies import methods
from renderers.materials.bodies.declaration import GATHERED, MUTATED
from renderers.mitsuba import variants

METHODS = "metropolis", "vrl+tables", "metropolis+tables"
LATER_KINDS = {"vrl+tables": (GATHERED,), "metropolis+tables": (MUTATED,)}  # parts of light of three and more events
PILOTED = "paths", "vrl+tables", "metropolis", "metropolis+tables"
BALLS = {"wax": (1.0, 8), "wax_glass": (1.4, 8), "wax_large": (1.0, 32)}  # refractive index, radius in mean free paths
ROUNDS, CORES = 2, 2


def setup(scene, size):
    """How light goes."""
    if scene == "caustic":
        return stand.caustic(stand.medium((0.9, 0.9, 0.9), 0.5), size)
    if scene not in BALLS:
        return stand.shipped(scene, size)
    albedo, free_path, g = WAX
    index, radius = BALLS[scene]
    how = stand.ball(stand.medium(albedo, g), index, size, stand.PANEL)
    return stand.thicker(how, radius * free_path[1] / np.array(free_path))


def a_second(parts):
    """Paths, mutations or candidates of two cores; None where there are several kinds of passes, or beams are gathered."""
    (part, *others) = parts
    if others:
        return None
    if hasattr(part.render, "count"):
        return CORES * part.render.count * part.count / (part.count + 1) / part.seconds  # less the pass that compiles
    group = getattr(part.render, "group", None)
    return group and CORES * part.count * (group.candidates + group.chains * group.steps) / part.seconds


def rows(scene, size, names, seconds, layer):
    """Measures a scene and prints its rows; all methods but the last stop after the first of the seconds.  Pictures (H, W, 3) of
    the methods after these, from 0 to 1."""
    transported = setup(scene, size)
    kinds = LATER_KINDS if layer == stand.LATER else {}
    runs = {method: stand.Run(transported, method, kinds=kinds.get(method.split(",")[0])) for method in names}
    first, pictures = None, []
    for until in seconds:
        stand.together(runs, dict.fromkeys(runs, until), ROUNDS)
        for method, run in runs.items():
            light, spent = run.found(layer), sum(part.seconds for part in run.parts)
            first = first or light
            if until == seconds[0]:
                pictures.append(stand.shown(light.image, 1.5 * np.quantile(first.image, 0.99)))
            ratio = (1.0, first.error / first.total) if light is first else stand.ratio(light, first)
            speed, loss = a_second(run.parts), np.sqrt(sum(part.loss() ** 2 for part in run.parts)) / light.total
            drawn = speed and speed * spent / CORES / size**2  # a pixel
            noise = f"{100 * light.noise * np.sqrt(drawn / MUTATIONS):.2g}" if speed else ""
            whole = np.hypot(light.noise, loss) / (0.01 * np.sqrt(first.seconds / spent))
            speed = f"{speed:.2g}" if speed else ""
            print(f"| {scene} | `{method}` | {spent:.0f} | {stand.over(*ratio)} | {speed} | {noise} | "
                  f"{stand.of_seconds(light.seconds)} | {100 * light.noise:.2f} | {100 * loss:.2f} | {whole:.3f} |", flush=True)
        runs = {names[-1]: runs[names[-1]]}
    return pictures


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
    parser.add_argument("--methods", nargs="+", default=METHODS)
    parser.add_argument("--seconds", type=float, nargs="+", default=sized([6.0], [1.0]))
    parser.add_argument("--light", choices=stand.LAYERS, default=stand.LATER, help="all, or that of so many events and more")
    parser.add_argument("--picture", help="file: a row a scene, a column a method, after the first of the seconds")
    parser.add_argument("--pilots", action="store_true")
    args = parser.parse_args()
    print(variants.activate("rgb"))
    if args.pilots:
        print("| scene | method | noise 1 % after, s | shares of its kinds of passes |\n|" + "---|" * 4, flush=True)
        for scene in args.scenes:
            pilots(scene, args.size, args.seconds[0])
        return
    print("| scene | method | s | light over the first | a second of two cores | noise after 1000 a pixel, % | "
          "noise 1 % after, s | noise, % | loss, % | error over the first, equal time |\n|" + "---|" * 10, flush=True)
    pictures = [np.hstack(rows(scene, args.size, args.methods, args.seconds, args.light)) for scene in args.scenes]
    if args.picture:
        image.imsave(args.picture, np.vstack(pictures))


if __name__ == "__main__":
    main()
