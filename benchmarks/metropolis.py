"""Chains of paths in a ball of wax: mutations a second, and what they bring beside paths drawn alike.

    python benchmarks/metropolis.py [--small] [--width 128] [--rounds 6]

A ball of published wax (Wang, Ge and Holzschuch 2018) of 8 mean free paths in radius, matched and of glass, on a floor under a
panel.  A row a boundary and kind of passes, which take turns: `paths` in the loop of Dr.Jit and by the compiled walk, and
`metropolis`.  Microseconds of processor time a path or mutation, how many that is a second of two cores, mean over `paths`,
with its standard error, and processor time to a noise of 1 % of a pixel, root mean square, over the picture's mean, and of 8 x 8
blocks of pixels.  --small: 16 pixels wide, three rounds.
Error against mutations in shipped scenes: `python -m benchmarks.figures_translucent --only fig30`.
"""

import argparse
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from bakery.physics.medium import phase
from bakery.physics.shapes.radial import icosphere
from bakery.store import ply
from benchmarks.lamps import BALL, PANEL
from benchmarks.sizes import sized
from benchmarks.transport import GLASS, NULL, WAX
from renderers.colour import LUMINANCE
from renderers.materials.bodies import methods
from renderers.mitsuba import variants
from renderers.mitsuba.world import World

COMPILES = 1 << 20  # number of a pass that is not counted
CORES = 2


def setup(folder, bsdf, width):
    """How light goes."""
    albedo, free_path, g = WAX
    theta = np.concatenate([[0.0], np.geomspace(1e-3, np.pi, 500)])
    table = (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * np.cos(theta)) ** 1.5)
    tabulated = type("Medium", (dict,), {})(phase=np.tile(table / phase.phase_integral(theta, table), (3, 1)))
    tabulated.sigma_t, tabulated.albedo, tabulated.theta = 1e3 / np.array(free_path), np.array(albedo), theta
    asset = SimpleNamespace(medium=tabulated, stages=("medium",), wavelength=np.array([0.65, 0.55, 0.45]))
    vertices, faces = icosphere(1280)
    (folder / "ball.ply").write_bytes(ply.mesh(5 * vertices, faces))
    (folder / "ball.xml").write_text(BALL.replace(GLASS, bsdf).replace("LAMP", PANEL.replace("SIZE", "5")))
    world = World(folder / "ball.xml", unit=1e-3, size=(width, width))
    return methods.transport_of(world, ["ball"], [asset], [None], lambda number, key, message: ValueError(message), "paths")


def walked(how):
    """Passes of `paths` by the compiled walk."""
    in_one_loop = methods.in_one_loop
    try:
        methods.in_one_loop = lambda how: False
        (part,) = methods.parts(how, "paths", "negative", 2)
    finally:
        methods.in_one_loop = in_one_loop
    return part


def rows(label, how, rounds):
    """Measures a ball and prints its rows."""
    (paths,), (chains,) = (methods.parts(how, name, "negative", seed) for seed, name in enumerate(("paths", "metropolis")))
    parts = {"paths": paths, "paths, compiled walk": walked(how), "metropolis": chains}
    pixels, seconds, light = np.prod(how.world.size), dict.fromkeys(parts, 0.0), {name: [] for name in parts}
    for number in (COMPILES, *range(rounds)):
        for name, part in parts.items():
            begin = time.process_time()
            picture = part.render(number)[""] @ LUMINANCE
            if number != COMPILES:
                seconds[name] += time.process_time() - begin
                light[name].append(picture)
    reference = np.mean(light["paths"])
    for name, pictures in light.items():
        group = getattr(parts[name].render, "group", None)
        count = group.candidates + group.chains * group.steps if group else parts[name].samples * pixels
        each, means = seconds[name] / rounds, np.mean(pictures, axis=(1, 2))
        of_blocks = np.reshape(pictures, (rounds, 8, how.world.size[0] // 8, 8, how.world.size[1] // 8)).mean(axis=(2, 4))
        times = [each * float(np.mean(np.var(images, axis=0, ddof=1))) / (0.01 * means.mean()) ** 2
                 for images in (pictures, of_blocks)]
        print(f"| {label} | {name} | {1e6 * each / count:.2f} | {CORES * count / each:.3g} | {means.mean() / reference:.4f} ± "
              f"{means.std(ddof=1) / rounds**0.5 / reference:.4f} | {times[0]:.3g} | {times[1]:.3g} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=sized(128, 16), help="a multiple of 8")
    parser.add_argument("--rounds", type=int, default=sized(6, 3))
    args = parser.parse_args()
    print(variants.activate("rgb"))
    print("| ball | passes | us | a second of two cores | mean over `paths` | noise 1 % of a pixel, s | of blocks, s |\n|"
          + "---|" * 7, flush=True)
    for label, bsdf in (("matched", NULL), ("glass", GLASS)):
        with tempfile.TemporaryDirectory() as temporary:
            rows(label, setup(Path(temporary), bsdf, args.width), args.rounds)


if __name__ == "__main__":
    main()
